"""What drives each run, worked out once for a model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rovid.effects import effect_named
from rovid.identify.driving import Driving
from rovid.motion.runs import Run
from tests import synthetic

TIME = synthetic.clock(60.0)
COMMAND = np.where(TIME % 20.0 < 10.0, 2.0, -2.0)
# 200 N at 2 V.
TORQUE = 100.0 * COMMAND
LAGGED = replace(synthetic.ROSUB, effects=(effect_named("thruster_lag"),), effect_values=(0.5,))
STEPS = np.arange(0, len(TIME), 50)


@pytest.fixture(scope="module")
def run() -> Run:
    made = synthetic.run(TIME, TORQUE)
    return replace(made, trial=replace(made.trial, commands=COMMAND[:, None]))


def driving(run: Run, *, quick: bool = False) -> Driving:
    return Driving(
        runs=[run],
        vehicle=synthetic.VEHICLE,
        inertia=synthetic.ROSUB.inertia,
        position_noise=1e-4,
        steps=[STEPS] if quick else None,
    )


def test_without_an_effect_the_logged_torque_drives(run: Run) -> None:
    drive = driving(run).at_instants(synthetic.ROSUB)
    assert (drive.torque == TORQUE).all()
    quick = driving(run, quick=True).between_steps(synthetic.ROSUB)
    # Of 2.5 s that change over half-way the mean is nothing.
    assert quick.torque[:-1] * np.diff(TIME[STEPS]) == pytest.approx(
        np.add.reduceat(TORQUE[:-1] * np.diff(TIME), STEPS[:-1])
    )


def test_a_lag_comes_between_command_and_torque(run: Run) -> None:
    drive = driving(run).between_steps(LAGGED)
    after = np.flatnonzero(np.diff(COMMAND))[0] + 1
    assert drive.torque[after] > 0.5 * TORQUE[after - 1]
    assert drive.torque[after + 60] == pytest.approx(TORQUE[after + 60], rel=0.01)


def test_fewer_steps_keep_the_impulse_of_a_lagging_thrust(run: Run) -> None:
    every, quick = driving(run).between_steps(LAGGED), driving(run, quick=True).between_steps(LAGGED)
    whole = np.sum(every.torque[: STEPS[-1]] * np.diff(TIME)[: STEPS[-1]])
    assert np.sum(quick.torque[:-1] * np.diff(TIME[STEPS])) == pytest.approx(whole, rel=1e-6, abs=1e-6)
