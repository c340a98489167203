"""Does a planned run decide? A few logs that leave two causes open, the run that `rovid plan` asks for, and both again.

Run ``python -m benchmarks.decisions``. The cause is hidden by the simulator, which plays the planned commands; rovid
sees files alone. A pair counts as decided where the true cause is the likelier by more than ``DECIDES``.
"""

from __future__ import annotations

import argparse
import csv
import json
import secrets
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tools.cases import Case, all_cases
from tools.programme import LEAD, Hold, Run, Sine
from tools.trial_day import write_trial_day
from tools.truth import ROSUB, Truth

DECIDES = 6.0
# What is hidden, what it is confused with, and what little is known at first: `EFFECTS` of tools/hidden.py.
PAIRS = (
    ("thruster_lag-first_order-weak", "command_delay"),
    ("command_delay-constant-weak", "thruster_lag"),
    ("entrained_swirl-first_order-weak", "tether_torsion"),
    ("tether_torsion-linear-weak", "entrained_swirl"),
    ("coulomb_resistance-smooth-weak", "drag_curvature"),
    ("bias_torque-constant-weak", "thrust_asymmetry"),
    ("drag_asymmetry-quadratic-weak", "bias_torque"),
    ("thrust_asymmetry-gain-weak", "drag_asymmetry"),
    ("added_mass_memory-trapped_water-weak", "thruster_lag"),
    ("oscillatory_drag-exponential-weak", "added_mass_memory"),
    ("thruster_deadband-shift-weak", "supply_sag"),
    ("command_hysteresis-play-weak", "command_delay"),
)
# The founding paper's kind of day: a hold or two and a sine.
FEW = (
    Run(name="hold_01", pieces=(Hold(1.55, 60.0), Hold(-2.0, 60.0))),
    Run(name="hold_02", pieces=(Hold(2.0, 60.0),)),
    Run(name="sine_40s", pieces=(Sine(1.8, 2.2, 40.0, 4),)),
)


def rovid(folder: Path, *arguments: str) -> dict[str, Any]:
    """JSON of a rovid command."""
    done = subprocess.run(
        [sys.executable, "-c", "from rovid.cli.cli import main; main()", *arguments, "--json"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(done.stderr)
    document: dict[str, Any] = json.loads(done.stdout)
    return document


def ratio(folder: Path, one: str, other: str) -> float:
    """Log-likelihood of ``one`` over that of ``other``."""
    fits = (rovid(folder, "fit", "day", "--effect", name, "-p", f"{name}.toml") for name in (one, other))
    first, second = (float(fit["log_likelihood"]) for fit in fits)
    return first - second


def played(path: Path) -> Run:
    """The command file as the simulator takes it: every thruster alike, or one of them alone."""
    with path.open() as stream:
        header, *rows = list(csv.reader(stream))
    table = np.array(rows, dtype=np.float64)
    moving = [name for at, name in enumerate(header[1:], start=1) if np.any(table[:, at] != 0.0)]
    volts = table[:, header.index(moving[0])]
    durations = np.diff(table[:, 0])
    durations[0] -= LEAD
    pieces = tuple(Hold(float(v), float(s)) for v, s in zip(volts[:-1], durations, strict=True) if s > 1e-9)
    return Run(name="planned", pieces=pieces, only=moving[0] if len(moving) == 1 else None)


def decided(case: Case, rival: str, seed: int, truth: Truth = ROSUB) -> tuple[float, float, str]:
    """Log-likelihood ratio before and after the planned run, and what that was."""
    cause = case.expected_effect or ""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        hidden = case.of(truth)
        write_trial_day(folder / "day", seed=seed, truth=hidden, formats="csv", campaign=FEW)
        before = ratio(folder, cause, rival)
        plan = rovid(folder, "plan", "day", "--between", cause, "--between", rival)
        run = played(folder / "plan.csv")
        # A campaign's runs are numbered: the planned one has noise of its own.
        write_trial_day(folder / "more", seed=seed + 1, truth=hidden, formats="csv", campaign=(run,))
        (folder / "more" / "planned.csv").rename(folder / "day" / "planned.csv")
        return before, ratio(folder, cause, rival), str(plan["runs"][0]["run"])


def rows(seed: int, only: str) -> Iterator[tuple[str, str, float, float, str]]:
    """Yield the result of each pair when it is complete."""
    cases = {case.name: case for case in all_cases(ROSUB)}
    for name, rival in PAIRS:
        if only in name and name in cases:
            yield (name, rival, *decided(cases[name], rival, seed))


def main() -> None:
    """Print each pair and how many were decided."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--seed", type=int, default=secrets.randbelow(10**6))
    parser.add_argument("--only", default="", help="pairs with this in the name of what is hidden")
    options = parser.parse_args()
    print(f"seed {options.seed}")
    print(f"{'hidden':40} {'rival':20} {'before':>8} {'after':>8}  planned run")
    right = count = 0
    for name, rival, before, after, run in rows(options.seed, options.only):
        count, right = count + 1, right + (after > DECIDES)
        print(f"{name:40} {rival:20} {before:8.1f} {after:8.1f}  {run}", flush=True)
    print(f"{right} of {count} decided")


if __name__ == "__main__":
    main()
