"""The page of a round: rules, table, and every campaign, with the losses of each entrant."""

from __future__ import annotations

import math
from pathlib import Path
from statistics import fmean
from typing import Any

from benchmarks.challenge.rules import CAUSES, LABELS, LEVELS, PARAMETERS
from benchmarks.challenge.score import FALSE_ALARM, FLOOR, SILENCE, summary

Results = dict[str, dict[str, dict[str, Any]]]
ABOUT = {
    "prior": "the odds of the rules, without a look at the motion",
    "stepwise": "equation error through one filter, BIC of each term of a library, one step",
    "sindy": "sparse regression over the same library, by pysindy or, without it, by sequentially thresholded least "
    "squares of our own",
    "mujoco": "`mujoco.sysid` on pieces of the heading; the term that its residual torque correlates with",
    "likelihood": "a continuous-discrete Kalman filter as in CTSM-R, of our own; BIC of the eight terms that the "
    "regression ranks first",
    "rovid": "`rovid.open(folder).diagnose()`, each confidence turned into odds",
    "rovid_planar": '`rovid.open(folder, axes="planar").diagnose()` on the coupled vehicles alone, turned into odds '
    "alike; a cause of the coupling counts as one outside the list",
}
_COLUMNS = ("answered", "median probability of the truth", "log score", "most probable is true", "false names",
            "cost", "parameters", "heading")  # fmt: skip


def write_page(results: Results, documents: dict[str, Any], here: dict[str, Any], path: Path | None) -> str:
    """Text of the page; written with a ``path``."""
    simulators = sorted({one["simulator"] for scores in results.values() for one in scores.values()})
    count = max((len(one) for one in results.values()), default=0)
    parts = [_head(here, count, len(simulators)), _table("All campaigns", results, None), _beside_another(results)]
    parts += [_table(f"Simulator {name}", results, name) for name in simulators]
    parts += [_campaigns(results), _rules(), _failures(documents)]
    text = "\n\n".join(one for one in parts if one) + "\n"
    if path is not None:
        path.write_text(text, encoding="utf-8", newline="\n")
    return text


def _head(here: dict[str, Any], count: int, simulators: int) -> str:
    secret = f"The secret is `{here['secret']}`." if here["secret"] else "The secret is not published yet."
    return f"""# Name That Cause

{count} sealed campaigns from {simulators} simulators that share no code. An entrant gets the logs and a plain
description of the vehicle. The answer is a probability for each of {len(CAUSES)} causes, for no cause, and for a cause
outside the list, with quantiles of inertia and drag and of a held-out heading.

Round {here["round"]} was sealed on {here["sealed"]} with the SHA-256
`{here["sha256"]}`. {secret}
{here.get("remark", "")}

<!-- test: not run; it takes an hour -->
```sh
make challenge
```

draws the campaigns of the last open round, runs all baselines, and writes this page. It installs what it needs
into a clean clone. `make challenge CHALLENGE="--campaigns 1"` tries three campaigns, and writes no page.
`python -m benchmarks.challenge.score build/challenge/round_{here["round"]} ANSWERS.json` scores other answers. It needs
numpy and pandas, and not rovid."""


def _beside_another(results: Results) -> str:
    """Median and mean probability of rovid's entrants next to that of a comparable contest."""
    own = [f"*{name}* {100 * summary(list(scores.values()))['median_p']:.0f} % "
           f"(mean {100 * fmean(one['p'] for one in scores.values()):.0f} %)"
           for name, scores in results.items() if name.startswith("rovid") and scores]  # fmt: skip
    if not own:
        return ""
    return f"""A comparable contest, on engine faults (DX 2025), was won with a mean probability of the truth of 66 %.
The median here is {", ".join(own)}."""


def _row(name: str, one: dict[str, float]) -> str:
    numbers = [f"{one['median_p']:.2f}", f"{one['log_score']:.2f}", f"{100 * one['first']:.0f} %",
               f"{one['false']:.0f}", f"{one['cost']:.2f}", _percent(one["parameters"]),
               _percent(one["heading"])]  # fmt: skip
    return f"| {name} | {one['answered']:.0f} of {one['campaigns']:.0f} | {' | '.join(numbers)} |"


def _percent(value: float) -> str:
    return "-" if math.isnan(value) else f"{100 * value:.1f} %"


def _table(title: str, results: Results, simulator: str | None) -> str:
    lines = [f"## {title}", "", f"| entrant | {' | '.join(_COLUMNS)} |", f"| --- {'| --: ' * len(_COLUMNS)}|"]
    for name, scores in results.items():
        if some := [one for one in scores.values() if simulator in {None, one["simulator"]}]:
            lines.append(_row(name, summary(some)))
    return "\n".join(lines)


def _campaigns(results: Results) -> str:
    names = list(results)
    lines = ["## Each campaign", "", "Probability of the truth. A false name is marked by an asterisk.", "",
             f"| campaign | cause | {' | '.join(names)} |", f"| --- | --- {'| --: ' * len(names)}|"]  # fmt: skip
    for campaign, first in next(iter(results.values()), {}).items():
        each = [results[name].get(campaign) for name in names]
        cells = [f"{one['p']:.2f}{'*' if one['false'] else ''}" if one else "" for one in each]
        lines.append(f"| {campaign} | {first['cause']} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _rules() -> str:
    entrants = "\n".join(f"- *{name}*: {text}." for name, text in ABOUT.items())
    quantiles = ", ".join(f'"{name}": [1, 2, 3, 4, 5]' for name in PARAMETERS)
    causes = "\n".join(f"- `{name}`: {text}" for name, text in CAUSES.items())
    return f"""## Entrants

{entrants}

All but rovid and the prior share one library of terms, which has no added mass with memory, no deviation of the
compass, no waves and no seiche. The conversion of rovid's result to probabilities was set before any of these
campaigns was drawn. The library of terms, and the scaling and the threshold of *sindy*, were still changed while the
first round was run.

## Scores

- *Median probability of the truth* and *log score*, the mean of -ln p in nats, with p at least {FLOOR:g}. An entrant
  without an answer gets equal probabilities, 1/{len(LABELS)}. Campaigns that an entrant was not given are left out.
- *Cost*: {FALSE_ALARM:g} for a false name, {SILENCE:g} for silence where a cause acts. The scorer names the most
  probable cause if this costs less on average, by the entrant's own probabilities, than silence. *False names*
  counts those where no cause, or another cause, acts.
- *Parameters* and *heading*: continuous ranked probability score by the pinball loss of the quantiles
  {", ".join(f"{one:g}" for one in LEVELS)}, relative to the true parameter and to the root mean square of the held-out
  turn; median of the campaigns that were answered.

At most one cause acts in a campaign. Lag, advance loss and waves that vehicle.json describes under `known` are not
causes. A quarter to a third of the campaigns have no cause.

## Format

A campaign is a folder with `vehicle.json` and `run_01.csv`, `run_02.csv` and so on. There is no rovid.toml.

- `vehicle`: mass in kg, length and width in m, and the rigid body's inertia in kg m^2, if known.
- `thrusters`: name, which is also the column of its commands, arm in m (torque = arm times thrust, positive turns the
  heading up), and curve: pairs of command and thrust in N. A command holds until the next row. Coupled vehicles also
  have surge and sway, the shares of the thrust ahead and to starboard.
- `known`: other known properties. `thruster_lag_s`: lag of the rotors. `advance_speed_loss`: N^0.5 s/m, as in
  [the effect](effects/advance_speed_loss.md). `waves`: whether there is a sea.
- `held_out`: after `after_s` the last run has commands only. Predict the turn from that instant to each of
  `times_s`.
- Columns: `time_s`, `heading_deg` (0 to 360, positive to starboard), and the other logged signals, in SI units if the
  name has no unit. An empty cell means no reading.

The answers are one JSON file:

```json
{{"entrant": "NAME", "campaigns": {{"calm_00": {{
  "causes": {{"thruster_lag": 0.7, "none": 0.2, "none of these": 0.1}},
  "parameters": {{{quantiles}}},
  "heading_deg": [[1, 2, 3, 4, 5], "one list for each of times_s"]}}}}}}
```

The probabilities sum to one. Quantities are in kg m^2, N m s^2/rad^2, N m s/rad and deg.

Names of causes:

{causes}

## A new round

`python -m benchmarks.challenge --seal FILE` makes a secret, keeps it in FILE, and prints its hash. The hash is entered
in `benchmarks/challenge/rounds.json` with `"secret": null`. `--secret` then draws the campaigns, whose folders without
truth.json go to the entrants. The secret is entered once their answers are in. Everybody can then check the hash and
draw the campaigns again."""


def _failures(documents: dict[str, Any]) -> str:
    lines = [f"- {name}, {campaign}: {text}" for name, one in documents.items()
             for campaign, text in one["failures"].items()]  # fmt: skip
    return "\n".join(["## Without an answer", "", *lines]) if lines else ""
