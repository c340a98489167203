"""Commands to torque."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.core.errors import ConfigError
from rovid.trial.trial import Trial
from rovid.trial.vehicle import ThrustCurve, Thruster, Vehicle, box_inertia
from tests.synthetic import LOGGED, trial

CURVE = ThrustCurve(command=np.array([-2.0, -0.5, 0.5, 2.0]), thrust=np.array([-30.0, 0.0, 0.0, 60.0]))


def log(*commands: FloatArray) -> Trial:
    time = np.arange(len(commands[0])) / 10.0
    return Trial(
        name="log.csv", path=trial(time, time).path, time=time, position=0.0 * time, commands=np.column_stack(commands)
    )


def vehicle(*arms: float, clamp: bool = False) -> Vehicle:
    thrusters = tuple(Thruster(name=f"t{k}", arm=arm, curve=CURVE, clamp=clamp) for k, arm in enumerate(arms))
    return Vehicle(name="v", thrusters=thrusters)


@pytest.mark.parametrize(
    ("command", "thrust"), [(0.0, 0.0), (0.4, 0.0), (1.25, 30.0), (2.0, 60.0), (-1.25, -15.0), (-2.0, -30.0)]
)
def test_thrust_is_linear_between_bench_points(command: float, thrust: float) -> None:
    assert CURVE(command) == pytest.approx(thrust)


def test_torque_is_the_sum_over_signed_arms() -> None:
    volts = np.array([0.0, 2.0, -2.0])
    assert vehicle(0.4).torque(log(volts)) == pytest.approx([0.0, 24.0, -12.0])
    assert vehicle(0.4, -0.4).torque(log(volts, -volts)) == pytest.approx([0.0, 24.0 + 12.0, -12.0 - 24.0])
    assert vehicle(0.4, -0.4).torque(log(volts, volts)) == pytest.approx([0.0, 0.0, 0.0])


def test_a_logged_torque_is_taken_as_it_is() -> None:
    assert LOGGED.torque(log(np.array([-300.0, 1e6]))) == pytest.approx([-300.0, 1e6])


def test_outside_the_curve_is_refused_with_place_and_number() -> None:
    with pytest.raises(ConfigError, match=r"log\.csv: thruster 't1' is commanded 2\.5 at 0\.20 s \(2 samples") as error:
        vehicle(0.4, 0.4).torque(log(np.zeros(4), np.array([0.0, 2.1, 2.5, -1.0])))
    assert 'outside = "clamp"' in str(error.value)


def test_outside_the_curve_holds_its_end_value_where_that_is_allowed() -> None:
    assert vehicle(0.5, clamp=True).torque(log(np.array([3.0, -9.0]))) == pytest.approx([30.0, -15.0])


def test_rounding_of_the_log_is_not_outside() -> None:
    assert CURVE.excess(np.array([2.003])) == 0.0
    assert CURVE.excess(np.array([2.005])) == pytest.approx(0.005)
    assert CURVE.excess(np.array([np.nan])) == 0.0


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"mass": 2604.0, "length": 2.6, "width": 2.0}, 2335.0),  # EFFECTS 1.4
        ({"mass": 2604.0, "length": 2.6}, None),
        ({"mass": 2604.0, "length": 2.6, "width": 2.0, "rigid_body_inertia": 2000.0}, 2000.0),
    ],
)
def test_rigid_body_inertia_is_a_box_unless_it_is_given(given: dict[str, Any], expected: float | None) -> None:
    found = Vehicle(name="v", thrusters=(), **given).rigid_body_inertia
    assert found == (None if expected is None else pytest.approx(expected, abs=0.5))
    assert box_inertia(12.0, 1.0, 2.0) == pytest.approx(5.0)


def test_full_thrust_is_the_curves_or_the_largest_that_was_logged() -> None:
    trials = [log(np.array([0.0, 30.0])), log(np.array([-70.0, 5.0]))]
    assert LOGGED.with_logged_torque(trials).thrusters[0].full_thrust == 70.0
    assert LOGGED.with_logged_torque([log(np.zeros(2))]).thrusters[0].full_thrust == 1.0
    assert vehicle(1.0).with_logged_torque(trials).thrusters[0].full_thrust == 60.0
