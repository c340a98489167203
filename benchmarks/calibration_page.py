"""The page on calibration: coverage, ranks, and odds against what came of them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import norm

from benchmarks.estimator_digest import PAGE, line
from rovid.effects import CATALOGUE

LEVELS = (0.50, 0.80, 0.95)
PLAIN = ("inertia", "quadratic_drag", "linear_drag")
GROUPS = ("nothing hidden", "cause named", "cause not named")
# What says how large a cause is.
SIZES = {effect.id: effect.parameters[0].name for effect in CATALOGUE}
_BINS = 10
Record = dict[str, Any]


def write_page(records: Sequence[Record], path: Path | None, seed: int) -> str:
    """Text of the page; with ``path``, write the text there and the plots to pictures/."""
    readings = [one for record in records for one in readings_of(record)]
    odds = [pair for record in records for pair in odds_of(record)]
    text = "\n\n".join(
        [_head(records, seed), _coverage(readings), _ranks(), _odds(odds), _causes(readings), _failures(records)]
    )
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text + "\n", encoding="utf-8", newline="\n")
        _draw_ranks(readings, path.parent / "pictures" / "calibration_ranks.png")
        _draw_odds(odds, path.parent / "pictures" / "calibration_odds.png")
    return text


def group_of(record: Record) -> str:
    """Whether a cause was hidden, and named: by itself or among those it cannot be told from."""
    hidden = record["truth"]["hidden"]
    if hidden is None:
        return GROUPS[0]
    return GROUPS[1] if any(hidden in _names(one) for one in record["said"]["findings"]) else GROUPS[2]


def _names(named: Record) -> set[str]:
    return {named["effect"], *named["cannot_be_told_from"]}


def readings_of(record: Record) -> Iterable[Record]:
    """Each parameter whose truth is known: how far that is from the estimate, in standard normal units.

    The unit to either side is 1/1.96 of the 95 % interval that rovid prints, which is wider where few readings say how
    large the scatter is.
    """
    said, truth = record["said"], record["truth"]
    if said is None:
        return
    for name, here in said["parameters"].items():
        yield _reading(name, here, truth["parameters"][name], group_of(record))
    for finding in said["findings"]:
        size = SIZES[finding["effect"]]
        key = f"{finding['effect']}.{size}"
        # Another form of the cause has another parameter; of thrusters the first one is unlike.
        own = finding["form"] in {None, "fore"}
        if key in truth["parameters"] and own and size in finding["parameters"]:
            yield _reading(key, finding["parameters"][size], truth["parameters"][key], "size")


def _reading(name: str, said: Record, truth: float, group: str) -> Record:
    low, high = said["interval_95"]
    edge = high if truth > said["value"] else low
    reach = abs(edge - said["value"]) / norm.ppf(0.975)
    deviation = (truth - said["value"]) / reach if reach > 0.0 else math.nan
    return {"name": name, "group": group, "deviation": float(deviation), "relative": abs(said["value"] / truth - 1.0)}


def odds_of(record: Record) -> Iterable[tuple[float, bool]]:
    """(confidence, whether it is what was hidden) of each finding and suspect."""
    if record["said"] is None:
        return
    for one in (*record["said"]["findings"], *record["said"]["suspects"]):
        yield float(one["confidence"]), record["truth"]["hidden"] in _names(one)


def _head(records: Sequence[Record], seed: int) -> str:
    done = [record for record in records if record["said"] is not None]
    hidden = [record for record in done if record["truth"]["hidden"]]
    named = sum(group_of(record) == GROUPS[1] for record in hidden)
    nothing = [record for record in done if not record["truth"]["hidden"]]
    false = sum(bool(record["said"]["findings"]) for record in nothing)
    versions = Counter(str(record["rovid"]) for record in records)
    measured = " and ".join(f"rovid {name} ({count} campaigns)" for name, count in sorted(versions.items()))
    return f"""\
# Calibration of intervals and confidence

Measured with {measured}. Later versions have other searches and wider errors, and have not been measured here.

{line("", PAGE.read_text(encoding="utf-8"))}

{len(records)} campaigns, seed {seed}, each with randomly drawn vehicle, water, instruments, runs and hidden
cause. `rovid fleet` diagnosed them. The simulator shares no code with rovid. rovid reads only the files. The
standard errors of the shares follow from the number of campaigns. The drawn values and the results of all
campaigns are in `benchmarks/records/calibration.jsonl`.

| drawn | from |
|---|---|
| vehicle | work class, observation class, small; equal probabilities |
| inertia, quadratic drag | value of the vehicle times a log-normal factor, standard deviation 0.2 of the logarithm |
| linear drag, disturbance, noise of the heading | likewise 0.4, 0.4, 0.5 |
| runs | 6 to 12 of the eighteen of a [trial day](tutorial.md): holds, sines, staircase, coasts, steps |
| hidden | no cause in one of three, else one of the catalogue's effects in its default form; equal probabilities |
| its size | from 0.7 of the sweep's weak size to 1.3 of its strong size, uniform in the logarithm |

{len(hidden)} campaigns have a hidden cause, and {named} of these causes are named, alone or among indistinguishable
causes. Of {len(nothing)} campaigns without a hidden cause {false} {"has" if false == 1 else "have"} a false finding.

<!-- test: not run; it takes a night -->
```sh
python -m benchmarks.calibration --state benchmarks/records/calibration.jsonl --page docs/calibration.md
```

continues the campaigns up to 2000 and writes this page. Without the file the command starts again."""


def _coverage(readings: Sequence[Record]) -> str:
    rows = []
    for group in GROUPS:
        rows += [_row(f"{group}: {name.replace('_', ' ')}", _of(readings, name, group)) for name in PLAIN]
    rows += [
        _row(f"**{name.replace('_', ' ')}**, no hidden cause, or cause named", _of(readings, name, *GROUPS[:2]))
        for name in PLAIN
    ]
    rows.append(_row("**a cause's size**, cause named", [one for one in readings if one["group"] == "size"]))
    text = """\
## Coverage

Share of true values within the intervals, in %, with the standard error of the share. rovid prints 95 %
intervals. The 50 % and 80 % intervals are computed from them by the normal distribution. If a hidden cause is
not named, inertia and drag absorb part of it, and no interval includes this bias."""
    return f"{text}\n\n{_table(['', 'number', *(f'{100 * level:.0f} %' for level in LEVELS)], rows)}"


def _of(readings: Sequence[Record], name: str, *groups: str) -> list[Record]:
    return [one for one in readings if one["name"] == name and one["group"] in groups]


def _row(label: str, some: Sequence[Record]) -> list[str]:
    return [label, str(len(some)), *(covered(some, level) for level in LEVELS)]


def covered(some: Sequence[Record], level: float) -> str:
    """Share of the truths within the interval of a level, and its standard error, in %."""
    if not some:
        return "–"
    reach = norm.ppf(0.5 + level / 2.0)
    share = float(np.mean([abs(one["deviation"]) <= reach for one in some]))
    # Of none or all the count itself has no scatter; half a campaign more has.
    smooth = (share * len(some) + 0.5) / (len(some) + 1.0)
    return f"{100 * share:.1f} ± {100 * math.sqrt(smooth * (1.0 - smooth) / len(some)):.1f}"


def _ranks() -> str:
    return """\
## Ranks

Rank of each true value in its estimated distribution. With correct distributions each tenth contains a tenth of
the campaigns. Peaks at the ends mean intervals that are too narrow, a peak in the middle means intervals that
are too wide, and a slope means biased estimates. The grey band contains 95 % of the bars by chance. Only
campaigns without a hidden cause, or with a named cause, are included.

![Share of true values in each tenth of the estimated distribution](pictures/calibration_ranks.png)"""


def _odds(odds: Sequence[tuple[float, bool]]) -> str:
    rows = []
    for low, high in ((0.0, 0.2), (0.2, 0.5), (0.5, 0.8), (0.8, 0.95), (0.95, 1.01)):
        some = [(sure, right) for sure, right in odds if low <= sure < high]
        if some:
            mean = float(np.mean([sure for sure, _ in some]))
            right = sum(right for _, right in some)
            rows.append([f"{low:g} to {min(high, 1.0):g}", str(len(some)), f"{mean:.2f}", f"{right / len(some):.2f}"])
    text = """\
## Confidence

Confidence of each finding and suspect, and whether it is the hidden cause, alone or among the causes that rovid
reports as indistinguishable. It was calibrated on [hard water](hard.md), where several causes act."""
    picture = "![Confidence against outcomes](pictures/calibration_odds.png)"
    return f"{text}\n\n{_table(['confidence', 'number', 'mean', 'right'], rows)}\n\n{picture}"


def _causes(readings: Sequence[Record]) -> str:
    rows = []
    for name in sorted({one["name"] for one in readings if one["group"] == "size"}):
        some = [one for one in readings if one["name"] == name]
        apart = float(np.median([one["relative"] for one in some]))
        rows.append([name, str(len(some)), *(covered(some, level) for level in LEVELS), f"{100 * apart:.1f} %"])
    head = ["", "number", *(f"{100 * level:.0f} %" for level in LEVELS), "median error"]
    return f"## Sizes of causes\n\nAll causes that were hidden and named.\n\n{_table(head, rows)}"


def _failures(records: Sequence[Record]) -> str:
    failed = [record for record in records if record["said"] is None]
    little = [one for one in records if one["said"] and one["said"]["verdict"] == "too_little_data"]
    lines = [f"- campaign {one['truth']['number']}: {one['error']}" for one in failed]
    text = f"## Without an answer\n\n{len(little)} campaigns had too little data, {len(failed)} gave no diagnosis."
    return "\n".join([text, *([""] if lines else []), *lines])


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [list(head), ["---"] + ["--:"] * (len(head) - 1), *map(list, rows)]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def _draw_ranks(readings: Sequence[Record], path: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 2.6), layout="constrained")
    panels = figure.subplots(1, 4, sharex=True)
    titled = [(name, _of(readings, name, *GROUPS[:2])) for name in PLAIN]
    titled.append(("cause's size", [one for one in readings if one["group"] == "size"]))
    for panel, (name, some) in zip(panels, titled, strict=True):
        known = [one["deviation"] for one in some if math.isfinite(one["deviation"])]
        counts, edges = np.histogram(norm.cdf(known), _BINS, (0.0, 1.0))
        share = len(known) / _BINS
        doubt = 1.96 * math.sqrt(share * (1.0 - 1.0 / _BINS))
        panel.axhspan(max(share - doubt, 0.0), share + doubt, color="0.88")
        panel.axhline(share, color="0.6", linewidth=1)
        panel.bar(edges[:-1] + 0.05, counts, width=0.085, color="#0072B2")
        panel.set_title(f"{name.replace('_', ' ')}, {len(known)}", fontsize=10)
        panel.set_xlabel("rank of the truth")
    panels[0].set_ylabel("campaigns")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


def _draw_odds(odds: Sequence[tuple[float, bool]], path: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.6, 3.4), layout="constrained")
    panel = figure.subplots()
    panel.plot([0, 1], [0, 1], color="0.6", linewidth=1)
    sure = np.array([one for one, _ in odds])
    right = np.array([one for _, one in odds], dtype=float)
    for low in np.arange(0.0, 1.0, 0.2):
        inside = (sure >= low) & (sure < low + 0.2 + 1e-9)
        if inside.any():
            number, share = int(inside.sum()), float(right[inside].mean())
            doubt = math.sqrt(max(share * (1.0 - share), 0.25 / number) / number)
            panel.errorbar(sure[inside].mean(), share, yerr=doubt, fmt="o", color="#0072B2", capsize=3)
            panel.annotate(f" {number}", (float(sure[inside].mean()), share), fontsize=9, va="bottom")
    panel.set(xlabel="confidence", ylabel="share that is right", xlim=(0, 1.12), ylim=(-0.03, 1.12))
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
