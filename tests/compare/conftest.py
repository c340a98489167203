"""Short campaigns of one vehicle before and after changes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from tools.hidden import Hidden
from tools.programme import Hold, Run, Sine, multilevel
from tools.trial_day import write_trial_day
from tools.truth import ROSUB, Instruments, Truth

VEHICLE = replace(ROSUB, instruments=Instruments(rate=5.0))
DAY = (
    Run(name="ahead", pieces=(Hold(1.6, 50.0), Hold(0.0, 12.0), Hold(1.1, 50.0))),
    Run(name="back", pieces=(Hold(-1.3, 50.0), Hold(-2.1, 50.0))),
    Run(name="sine", pieces=(Sine(2.0, 2.5, 20.0, 5),)),
    Run(name="levels", pieces=multilevel(100.0)),
    Run(name="fore only", pieces=(Hold(2.2, 25.0), Hold(-2.7, 25.0)), only="fore"),
    Run(name="aft only", pieces=(Hold(2.2, 25.0), Hold(-2.7, 25.0)), only="aft"),
)
LAG = Hidden(effect="thruster_lag", form="first_order", parameters={"time_constant": 0.5})
WEAK = Hidden(effect="thruster_imbalance", form="gain", parameters={"gain": 0.85}, thruster="fore")

Write = Callable[..., Path]


def more_drag(truth: Truth) -> Truth:
    """The vehicle with 10 % more drag, as from fouling."""
    old = truth.dynamics
    drag = replace(old, quadratic_drag=1.1 * old.quadratic_drag, linear_drag=1.1 * old.linear_drag)
    return replace(truth, dynamics=drag)


@pytest.fixture(scope="session")
def write(tmp_path_factory: pytest.TempPathFactory) -> Write:
    """Write a campaign of a vehicle into a folder of that name."""

    def written(name: str, truth: Truth = VEHICLE, *, seed: int) -> Path:
        folder = tmp_path_factory.mktemp("days") / name
        write_trial_day(folder, seed=seed, formats="csv", truth=truth, campaign=DAY)
        return folder

    return written


@pytest.fixture(scope="session")
def before(write: Write) -> Path:
    return write("before", seed=1)


@pytest.fixture(scope="session")
def lagging(write: Write) -> Path:
    return write("after", replace(VEHICLE, hidden=(LAG,)), seed=2)
