"""Torque inputs of runs, and how finely commands are resolved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rovid.effects import Effect, effect_named
from rovid.estimate.dataset import InputCache
from rovid.model.actuator_model import CommandSeries
from rovid.model.torque_input import MAX_SUBDIVISION
from rovid.trial.preprocessing import Run
from tests import synthetic
from tests.effects.test_effects import EVERY
from tests.model.test_actuator_model import model_with

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


def driving(run: Run, *, quick: bool = False) -> InputCache:
    return InputCache(
        runs=[run],
        vehicle=synthetic.VEHICLE,
        inertia=synthetic.ROSUB.inertia,
        position_noise=1e-4,
        steps=[STEPS] if quick else None,
    )


def test_without_an_effect_the_logged_torque_drives(run: Run) -> None:
    (drive,) = driving(run).at_samples(synthetic.ROSUB)
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


QUICK = [effect for effect in EVERY if model_with(effect).actuators.settling_time(1.0) > 0.0]


@pytest.mark.parametrize("noise", [1.0, 1e-8], ids=["whole", "cut"])
@pytest.mark.parametrize("few", [False, True], ids=["all", "few"])
@pytest.mark.parametrize("effect", QUICK, ids=lambda effect: effect.key)
def test_settled_commands_need_few_samples(run: Run, effect: Effect, noise: float, *, few: bool) -> None:
    model = model_with(effect)
    steps = np.arange(0, len(TIME), 8)
    here = replace(driving(run), position_noise=noise, steps=[steps] if few else None)
    found = here.between_steps(model)
    parts = MAX_SUBDIVISION if noise < 1e-6 else 1
    given = CommandSeries.from_trials(synthetic.VEHICLE, [run.trial], parts)
    true = model.actuators.torque_inputs(given, given.intervals_between([steps]) if few else None)
    # Only samples in transients are used: for the longest of two lags they are most of the log.
    looked_at, _ = here._commands(synthetic.VEHICLE, model)  # noqa: SLF001 - what it is for
    assert len(looked_at.inputs.time) < 0.9 * len(given.inputs.time) or (parts == 1 and not few)
    most = np.max(np.abs(true.torque))
    np.testing.assert_allclose(found.torque, true.torque, atol=2e-4 * most, rtol=0.0)
    # A torque without transients has rounding errors only.
    large = max(np.max(np.abs(true.timing_moment)), 1e-9 * most)
    np.testing.assert_allclose(found.timing_moment, true.timing_moment, atol=0.02 * large, rtol=0.0)


@pytest.mark.parametrize("few", [False, True], ids=["all", "few"])
def test_a_subset_has_the_resolution_of_all_runs(run: Run, *, few: bool) -> None:
    """Of a log with a low sampling rate and small command changes too."""
    time = TIME[::4]
    seldom = synthetic.run(time, 0.2 * TORQUE[::4])
    seldom = replace(seldom, trial=replace(seldom.trial, name="seldom", commands=0.2 * COMMAND[::4, None]))
    steps = [np.arange(0, len(one.trial.time), 8) for one in (run, seldom)] if few else None
    both = replace(driving(run), runs=[run, seldom], steps=steps, position_noise=1e-8)
    whole = both.between_steps(LAGGED)
    parts = [both.subset(slice(at, at + 1)).between_steps(LAGGED) for at in range(2)]
    for part, true in zip(parts, whole.by_trial, strict=True):
        np.testing.assert_array_equal(part.torque, true.torque)
        np.testing.assert_array_equal(part.timing_moment, true.timing_moment)
