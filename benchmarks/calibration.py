"""Do intervals and odds hold over everything that a campaign may be? Simulation-based calibration, as a fleet.

Run ``python -m benchmarks.calibration --campaigns 2000 --state STATE --page docs/calibration.md``. Campaigns are drawn
from the priors below by the simulator of tools/, which shares no code with rovid; `rovid fleet` diagnoses them, a chunk
at a time, and sees files alone. STATE is a file, a campaign a line: started again with it the command goes on where it
stopped, and ``--campaigns 0`` writes the page of what there is.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.calibration_page import PLAIN, SIZES, Record, write_page
from tools.cases import CONTRACT_FORMS, Case, all_cases
from tools.hidden import FORMS
from tools.programme import campaign_for
from tools.trial_day import write_trial_day
from tools.truth import VEHICLES, Truth

PROJECT = Path(__file__).resolve().parents[1]
# Standard deviations of the logarithms of what is drawn about each vehicle's own.
SPREAD = {"inertia": 0.2, "quadratic_drag": 0.2, "linear_drag": 0.4, "disturbance": 0.4, "noise": 0.5}
# In so many campaigns nothing is hidden.
NOTHING = 1.0 / 3.0
# A cause's size is drawn between these times the weak and the strong one of the sweep, flat in its logarithm.
WEAKER, STRONGER = 0.7, 1.3
# The form that rovid has a cause in, where it is not the simulator's first.
OWN = {"drag_asymmetry": "whole", "wave_torque": "narrow_band"}
# Runs of a campaign, of the programme's eighteen.
RUNS = (6, 12)


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """What is true of a campaign; ``parameters`` by the names of a diagnosis."""

    number: int
    vehicle: str
    hidden: str | None
    parameters: dict[str, float]


def drawn(seed: int, number: int, folder: Path | None) -> Drawn:
    """Campaign ``number`` of the ``seed``; its logs are written into ``folder``."""
    rng = np.random.default_rng([seed, number])
    vehicle = VEHICLES[int(rng.integers(len(VEHICLES)))]
    factor = {name: math.exp(spread * rng.normal()) for name, spread in SPREAD.items()}
    dynamics, disturbance, instruments = vehicle.dynamics, vehicle.disturbance, vehicle.instruments
    truth = replace(
        vehicle,
        dynamics=replace(dynamics, **{name: getattr(dynamics, name) * factor[name] for name in PLAIN}),
        disturbance=replace(disturbance, standard_deviation=disturbance.standard_deviation * factor["disturbance"]),
        instruments=replace(instruments, angle_noise=instruments.angle_noise * factor["noise"]),
    )
    case = None if rng.random() < NOTHING else _cause(truth, rng)
    parameters = {name: float(getattr(truth.dynamics, name)) for name in PLAIN}
    if case is not None:
        truth = case.of(truth)
        parameters |= {
            f"{case.expected_effect}.{name}": size for name, size in (case.expected_parameters or {}).items()
        }
    programme = campaign_for(truth)
    chosen = rng.choice(len(programme), int(rng.integers(*RUNS, endpoint=True)), replace=False)
    if folder is not None:
        runs = [programme[place] for place in sorted(chosen.tolist())]
        write_trial_day(folder, seed=int(rng.integers(2**31)), formats="csv", truth=truth, campaign=runs)
    hidden = None if case is None else case.expected_effect
    return Drawn(number=number, vehicle=vehicle.name, hidden=hidden, parameters=parameters)


def _cause(truth: Truth, rng: np.random.Generator) -> Case:
    """A cause in the form that rovid has it in, each as likely as another, of a size between weak and strong."""
    pairs: dict[str, list[Case]] = {}
    for case in all_cases(truth):
        if case.expected_effect and case.hidden[0].form == _form(case.expected_effect):
            pairs.setdefault(case.expected_effect, []).append(case)
    names = sorted(pairs)
    weak, strong = pairs[names[int(rng.integers(len(names)))]]
    one, law = weak.hidden[0], weak.hidden[0].law
    low, high = (each.hidden[0].parameters[law.size] for each in (weak, strong))
    share = rng.random()
    if math.isinf(law.null):
        # A smaller parameter makes this effect stronger.
        low, high = low / WEAKER, high / STRONGER
        size = low * (high / low) ** share
    else:
        low, high = WEAKER * (low - law.null), STRONGER * (high - law.null)
        size = law.null + low * (high / low) ** share
    known = weak.expected_parameters or {law.size: size}
    expected = {name: size if name == law.size else value for name, value in known.items()}
    hidden = replace(one, parameters={**one.parameters, law.size: size})
    return replace(weak, hidden=(hidden,), expected_parameters=expected)


def _form(effect: str) -> str:
    return OWN.get(effect) or CONTRACT_FORMS.get(effect, tuple(FORMS[effect]))[0]


def diagnosed(seed: int, numbers: Sequence[int], jobs: int, timeout: float) -> Iterator[Record]:
    """Draw campaigns, diagnose them as a fleet, and yield the records for the page."""
    with tempfile.TemporaryDirectory() as name:
        logs, out = Path(name) / "logs", Path(name) / "out"
        truths = [drawn(seed, number, logs / _folder(number)) for number in numbers]
        command = [sys.executable, "-m", "rovid", "fleet", str(logs), "-o", str(out)]
        command += ["--jobs", str(jobs), "--timeout", str(timeout), "--json"]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, cwd=PROJECT)
        for truth in truths:
            kept = out / "campaigns" / f"{_folder(truth.number)}.json"
            yield told(asdict(truth), json.loads(kept.read_text(encoding="utf-8")))


def _folder(number: int) -> str:
    return f"campaign_{number:05d}"


def told(truth: Record, kept: Record) -> Record:
    """The truth of a campaign, and of what a fleet keeps of it as much as is held against that."""
    said = kept["diagnosis"]
    if said is not None:
        side = said["extended"] or said["base"] or {"parameters": {}}
        said = {
            "verdict": said["verdict"],
            "parameters": _sizes(side["parameters"], PLAIN),
            "findings": [
                {**_named(one), "form": one["form"], "parameters": _sizes(one["parameters"], [SIZES[one["effect"]]])}
                for one in said["findings"]
            ],
            "suspects": [_named(one) for one in said["suspects"]],
        }
    return {"truth": truth, "said": said, "error": kept["error"], "took": kept["took"], "rovid": kept["rovid"]}


def _named(one: Record) -> Record:
    return {name: one[name] for name in ("effect", "confidence", "cannot_be_told_from")}


def _sizes(parameters: Record, names: Sequence[str]) -> Record:
    """Those of these names, with their intervals."""
    some = {name: parameters[name] for name in names if name in parameters}
    return {name: {key: one[key] for key in ("value", "interval_95")} for name, one in some.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--campaigns", type=int, default=2000)
    parser.add_argument("--chunk", type=int, default=20, help="campaigns drawn at a time")
    parser.add_argument("--state", type=Path, required=True, help="file of what is done, a campaign a line")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--timeout", type=float, default=1200.0, help="s for a campaign")
    parser.add_argument("--page", type=Path, help="where to write the page, docs/calibration.md for instance")
    options = parser.parse_args()
    records = _read(options.state)
    done = {record["truth"]["number"] for record in records}
    left = [number for number in range(options.campaigns) if number not in done]
    for first in range(0, len(left), options.chunk):
        numbers = left[first : first + options.chunk]
        records += list(diagnosed(options.seed, numbers, options.jobs, options.timeout))
        lines = [json.dumps(record) for record in sorted(records, key=lambda one: int(one["truth"]["number"]))]
        scratch = options.state.with_suffix(".part")
        scratch.write_text("\n".join(lines) + "\n", encoding="utf-8")
        scratch.replace(options.state)
        print(f"{len(records)} of {options.campaigns} campaigns", file=sys.stderr, flush=True)
    print(write_page(records, options.page, options.seed))


def _read(state: Path) -> list[Record]:
    if not state.exists():
        return []
    return [json.loads(line) for line in state.read_text(encoding="utf-8").splitlines()]


if __name__ == "__main__":
    main()
