"""The actuator model: uncertainty of the thrust scale."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from rovid.effects import effect_named
from rovid.model.model import Model
from rovid.trial.vehicle import ThrustCurve, Thruster, Vehicle
from tests.synthetic import trial


def test_the_uncertainty_of_the_thrust_scale() -> None:
    """Of a curve that bends by a power e, |e - 1| times the logarithm of the thrust over that of no change."""
    one = Thruster(
        name="one", arm=0.5, curve=ThrustCurve(command=np.array([-10.0, 10.0]), thrust=np.array([-1e3, 1e3]))
    )
    idle = replace(one, name="idle", arm=0.0)
    vehicle = Vehicle(name="", thrusters=(one, idle))
    time = np.array([0.0, 3.0, 4.0])  # 3 s of 200 N and 1 s of 600 N, and a tenth of the largest is 100 N
    commands = np.array([[2.0, 9.0], [-6.0, 9.0], [0.0, 9.0]])
    run = replace(trial(time, np.zeros(3)), commands=commands)
    bare = Model(inertia=1.0, quadratic_drag=1.0, linear_drag=1.0)
    model = replace(bare, effects=(effect_named("thrust_curve_shape"),), effect_values=(0.7,))
    squares = 0.3**2 * np.log([2.0, 6.0]) ** 2
    expected = math.sqrt(squares @ [200.0 * 3.0, 600.0 * 1.0] / 1200.0)
    assert model.actuators.thrust_scale_uncertainty(vehicle, [run]) == pytest.approx(expected)
    assert bare.actuators.thrust_scale_uncertainty(vehicle, [run]) == 0.0
    lagging = replace(bare, effects=(effect_named("thruster_lag"),), effect_values=(0.7,))
    assert lagging.actuators.thrust_scale_uncertainty(vehicle, [run]) == 0.0
