"""Integration of the equation of motion, and the past of a log."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.effects import Effect
from rovid.effects.base import Actuating
from rovid.model.kernels import simulate
from rovid.model.model import Model
from rovid.model.ode import initial_rate, with_moved_past, with_past
from rovid.trial.preprocessing import split
from rovid.trial.trial import Trial
from tests import synthetic
from tests.effects.test_effects import EVERY, VEHICLE, logs, numbers
from tests.synthetic import ROSUB, clock, trial


@pytest.mark.parametrize("source", ["heading", "gyro"])
def test_the_initial_rate_from_positions(source: str) -> None:
    time = clock(10.0)
    heading = 0.2 * time + 0.03 * time**2
    gyro = 0.2 + 0.06 * time
    log = trial(time, np.zeros(len(time)), heading, rate=gyro if source == "gyro" else None)
    # The gyro's first five samples are averaged: 0.1 s of 0.06 rad/s^2 on.
    assert initial_rate(log) == pytest.approx(0.2, abs=1e-9 if source == "heading" else 0.0061)


def test_the_initial_rate_from_the_gyro() -> None:
    time = clock(20.0)
    gyro = np.where(time < 0.8, np.nan, 0.3)
    late = trial(time, np.zeros(len(time)), 0.3 * time, rate=gyro)
    assert initial_rate(late) == pytest.approx(0.3)


TIME = synthetic.clock(60.0)
# Effects that act between command and torque.
DRIVES = [one for one in EVERY if isinstance(one.acts, Actuating)]


def log(torque: FloatArray, first_rate: float = 0.0) -> Trial:
    """A log of this torque in N m, which begins at a rate in rad/s."""
    _, angle = simulate(TIME, torque, ROSUB.body, first_rate)
    return synthetic.trial(TIME, torque, angle)


def torque_before(trial: Trial) -> float:
    """Torque of the estimated commands before ``trial``, N m."""
    found = with_past(trial, ROSUB.body, synthetic.LOGGED)
    assert found.past is not None
    assert found.past.estimated
    return float(found.past.commands[0, 0])


STEADY = ROSUB.steady_rate(200.0)


@pytest.mark.parametrize(
    ("first", "rate", "before"),
    [
        # Switched on at the first sample, under way for long, switched off and reversed at the first sample.
        (200.0, 0.0, 0.0),
        (200.0, STEADY, 200.0),
        (0.0, STEADY, 200.0),
        (-200.0, STEADY, 200.0),
    ],
)
def test_the_torque_before_balances_the_drag(first: float, rate: float, before: float) -> None:
    torque = np.where(TIME < 20.0, first, 250.0)
    # The rate of an accelerating vehicle is that of the first few positions.
    assert torque_before(log(torque, rate)) == pytest.approx(before, abs=0.1 * 250.0)


@pytest.mark.parametrize("trim", [0.0, 1.0])
def test_a_log_that_begins_at_rest_has_no_other_past(trim: float) -> None:
    rest = log(np.where(TIME < 5.0, trim, 200.0))
    assert with_past(rest, ROSUB.body, synthetic.LOGGED) is rest


def test_a_past_that_is_known_for_long_is_not_estimated() -> None:
    whole = log(np.where(TIME < 30.0, 150.0, -150.0))
    part = whole.part(slice(700, None), "part")
    assert with_past(part, ROSUB.body, synthetic.LOGGED) is part
    short = whole.part(slice(10, None), "part")
    known = with_past(short, ROSUB.body, synthetic.LOGGED).past
    assert known is not None
    assert known.estimated
    assert known.time[-1] == pytest.approx(-0.5)  # the only known command, since the log began
    assert known.commands[-1, 0] == 150.0


def test_a_moved_past_tells_the_change_of_its_torque() -> None:
    trial = with_past(log(np.full(len(TIME), 200.0)), ROSUB.body, synthetic.LOGGED)
    moved, change = with_moved_past(trial, synthetic.LOGGED)
    assert trial.past is not None
    assert moved.past is not None
    assert moved.past.commands[0, 0] - trial.past.commands[0, 0] == pytest.approx(change)
    assert abs(change) == pytest.approx(50.0)


@pytest.mark.parametrize("effect", DRIVES, ids=lambda effect: effect.key)
def test_a_part_of_a_log_begins_in_the_state_that_the_log_left(effect: Effect) -> None:
    whole = logs()[0]
    values = tuple(numbers(effect, start=True).tolist())
    model = Model(inertia=5e3, quadratic_drag=3e3, linear_drag=1e2, effects=(effect,), effect_values=values)
    # A late cut, because a play has to be at its end once.
    first = len(whole.time) // 2
    cut = replace(whole, cuts=(float(whole.time[first]),))
    part = split(cut)[1]
    assert part.time[0] == 0.0
    expected = model.actuators.torque_input(VEHICLE, whole)
    found = model.actuators.torque_input(VEHICLE, part)
    for name in ("torque", "timing_moment", "impulse_variance"):
        wanted = getattr(expected, name)[first:]
        # Intervals before the first instant are not subdivided, so an effect behind a lag sees means over them.
        tolerance = 1e-9 if model.actuators.has_exact_means else 1e-3
        np.testing.assert_allclose(getattr(found, name), wanted, rtol=0.0, atol=tolerance * np.abs(wanted).max())


def test_commands_that_are_lost_are_no_past() -> None:
    whole = logs()[0]
    begin, end = float(whole.time[100]), float(whole.time[200])
    parts = split(replace(whole, unknown=((begin, end),)))
    assert len(parts) == 2
    past = parts[1].past
    assert past is None or past.time[0] > begin - end
