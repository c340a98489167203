"""Do intervals and odds hold over everything that a campaign may be? Simulation-based calibration, as a fleet.

Run ``python -m benchmarks.calibration --campaigns 2000 --state STATE --page docs/calibration.md``. Campaigns are drawn
from the priors below by the simulator of tools/, which shares no code with rovid; `rovid fleet` diagnoses them, a chunk
at a time, and sees files alone. Started again with the same STATE it goes on where it stopped; ``--campaigns 0`` writes
the page of what there is.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.calibration_page import write_page
from tools.cases import CONTRACT_FORMS, Case, all_cases
from tools.hidden import FORMS
from tools.programme import campaign_for
from tools.trial_day import write_trial_day
from tools.truth import VEHICLES, Truth

PROJECT = Path(__file__).resolve().parents[1]
PLAIN = ("inertia", "quadratic_drag", "linear_drag")
# Standard deviations of the logarithms of what is drawn about each vehicle's own.
SPREAD = {"inertia": 0.2, "quadratic_drag": 0.2, "linear_drag": 0.4, "disturbance": 0.4, "noise": 0.5}
# In so many campaigns nothing is hidden.
NOTHING = 1.0 / 3.0
# A cause's size is drawn between these times the weak and the strong one of the sweep, flat in its logarithm.
WEAKER, STRONGER = 0.7, 1.3
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
    low, high = (each.hidden[0].parameters[law.size] - law.null for each in (weak, strong))
    low, high = WEAKER * low, STRONGER * high
    size = law.null + low * (high / low) ** rng.random()
    expected = {name: size if name == law.size else value for name, value in (weak.expected_parameters or {}).items()}
    hidden = replace(one, parameters={**one.parameters, law.size: size})
    return replace(weak, hidden=(hidden,), expected_parameters=expected)


def _form(effect: str) -> str:
    return CONTRACT_FORMS.get(effect, tuple(FORMS[effect]))[0]


def done_in(chunk: Path) -> Iterator[dict[str, Any]]:
    """Truth and diagnosis of each campaign of a chunk."""
    for truth in json.loads((chunk / "truth.json").read_text(encoding="utf-8")):
        kept = chunk / "out" / "campaigns" / f"campaign_{truth['number']:05d}.json"
        record = json.loads(kept.read_text(encoding="utf-8"))
        yield {"truth": truth, "said": record["diagnosis"], "error": record["error"], "took": record["took"]}


def run_chunk(chunk: Path, seed: int, numbers: Sequence[int], jobs: int, timeout: float) -> None:
    """Draw the campaigns, diagnose them as a fleet, and take the logs away, which can be drawn again."""
    logs = chunk / "logs"
    truths = [asdict(drawn(seed, number, logs / f"campaign_{number:05d}")) for number in numbers]
    (chunk / "truth.json").write_text(json.dumps(truths, indent=1), encoding="utf-8")
    command = [sys.executable, "-m", "rovid", "fleet", str(logs), "-o", str(chunk / "out")]
    command += ["--jobs", str(jobs), "--timeout", str(timeout), "--json"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, cwd=PROJECT)
    shutil.rmtree(logs)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--campaigns", type=int, default=2000)
    parser.add_argument("--chunk", type=int, default=20, help="campaigns drawn at a time")
    parser.add_argument("--state", type=Path, required=True, help="folder for what is done")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--timeout", type=float, default=1200.0, help="s for a campaign")
    parser.add_argument("--page", type=Path, help="where to write the page, docs/calibration.md for instance")
    options = parser.parse_args()
    place = options.state / f"seed_{options.seed}"
    for first in range(0, options.campaigns, options.chunk):
        chunk = place / f"chunk_{first:05d}"
        numbers = range(first, min(first + options.chunk, options.campaigns))
        chunk.mkdir(parents=True, exist_ok=True)
        if (chunk / "truth.json").exists() and not (chunk / "logs").exists():
            continue
        run_chunk(chunk, options.seed, numbers, options.jobs, options.timeout)
        print(f"{numbers[-1] + 1} of {options.campaigns} campaigns", file=sys.stderr, flush=True)
    chunks = [one for one in sorted(place.glob("chunk_*")) if (one / "out" / "fleet.parquet").exists()]
    records = [record for chunk in chunks for record in done_in(chunk)]
    print(write_page(records, options.page, options.seed))


if __name__ == "__main__":
    main()
