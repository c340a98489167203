"""Short logs for a trial day that are read and fitted quickly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from tools.programme import Hold, Run, Sine
from tools.trial_day import write_trial_day
from tools.truth import ROSUB

TRUTH = replace(ROSUB, instruments=replace(ROSUB.instruments, rate=5.0))
RUNS = (
    Run(name="hold_up", pieces=(Hold(1.55, 60.0),)),
    Run(name="hold_down", pieces=(Hold(-1.97, 60.0),)),
    Run(name="sine", pieces=(Sine(2.0, 2.51, 20.0, 4),)),
    Run(name="coast", pieces=(Hold(1.94, 30.0), Hold(0.0, 40.0))),
    Run(name="steps", pieces=tuple(Hold(volts, 10.0) for volts in (1.5, -1.9, 1.9, 0.0, -1.6))),
)


def write_day(folder: Path, runs: Sequence[Run] = RUNS) -> list[str]:
    """Write the logs with their rovid.toml; return the names in order of time."""
    write_trial_day(folder, seed=3, formats="csv", campaign=runs, truth=TRUTH)
    return [f"{run.name}.csv" for run in runs]
