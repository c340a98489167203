"""Allocation of torque to commands, and the frequency response of the actuators."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.control.actuators import ActuatorProbe, allocate
from rovid.core.errors import DataError
from rovid.trial.trial import Trial
from tests.control.loops import PAPER, VEHICLE, with_effect


def test_allocation_inverts_the_bench_curve() -> None:
    allocation = allocate(VEHICLE, PAPER)
    wanted = np.linspace(0.99 * allocation.lowest, 0.99 * allocation.highest, 301)
    given = VEHICLE.thrust(allocation(wanted)) @ np.array([0.43, -0.43])
    assert given == pytest.approx(wanted, abs=0.02)  # of 500 points of a square law between bench points
    assert np.abs(allocation(np.array([1.0]))) == pytest.approx(0.4, abs=0.1)  # beyond the dead zone at once
    assert allocation(np.zeros(1)) == pytest.approx(np.zeros((1, 2)))


@pytest.mark.parametrize(
    ("key", "values"),
    [
        ("thruster_deadband", (0.2,)),
        ("thrust_asymmetry", (0.7,)),
        ("thrust_curve_shape", (1.2,)),
        ("supply_sag", (0.5, 5.0)),
    ],
)
def test_allocation_inverts_known_effects(key: str, values: tuple[float, ...]) -> None:
    model = with_effect(key, *values)
    bench, known = allocate(VEHICLE, PAPER), allocate(VEHICLE, model)
    torques = []
    for allocation in (bench, known):
        commands = np.repeat(allocation(np.array([100.0])), 2, axis=0)
        held = Trial.from_commands(np.array([0.0, 0.1]), commands)
        torques.append(model.actuators.torque_input(VEHICLE, held).torque[0])  # settled drives
    assert torques[1] == pytest.approx(100.0, abs=0.1)
    assert abs(torques[0] - 100.0) > 2.0


def test_thrusters_that_act_one_way_are_refused() -> None:
    model = with_effect("thruster_lag", 1.0)
    probes = ActuatorProbe(vehicle=VEHICLE, parts=1, allocation=allocate(VEHICLE, PAPER), period=0.1, amplitude=0.0)
    assert np.all(probes.frequency_response(PAPER)[1] == 1.0)
    with pytest.raises(DataError, match="one way only"):
        probes.frequency_response(model)
