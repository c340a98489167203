"""Inertia by each method side by side."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.core.errors import DataError
from rovid.estimate.estimate import Estimate
from rovid.estimate.inertia import fit_inertia
from rovid.signals.preprocessing import Run
from rovid.signals.rates import compute_rates
from tests.estimate.test_sine_inertia import sine
from tests.synthetic import ROSUB, clock, trial


def test_drag_error_widens_the_balance_but_not_the_orbit() -> None:
    runs = [sine(200.0, 20.0, 6), sine(200.0, 40.0, 6)]
    errors = []
    for size in (0.0, 300.0):
        drag = Estimate(
            names=("quadratic_drag", "linear_drag"),
            values=np.array([ROSUB.quadratic_drag, ROSUB.linear_drag]),
            covariance=np.diag([size**2, 0.0]),
            method="steady turns",
            samples=9,
        )
        methods = fit_inertia(runs, drag=drag, rigid_body=None).methods
        errors.append([methods[name].standard_error for name in ("orbit_integral", "harmonic_balance")])
    assert errors[0][0] == errors[1][0]
    assert errors[1][1] > errors[0][1]


def test_a_vehicle_that_does_not_move_has_no_inertia() -> None:
    time = clock(130.0, 10.0)
    torque = 200.0 * np.sin(2.0 * np.pi * time / 20.0)
    log = trial(time, torque, np.zeros(len(time)), rate=np.zeros(len(time)))
    rates = compute_rates(log, cutoff=1.0)
    still = Run(trial=log, torque=torque, rates=rates, filtered_torque=rates.filter_held(log, torque))
    with pytest.raises(DataError, match=r"never turns under the sine-shaped torque of log: its yaw rate is zero"):
        fit_inertia([still], drag=None, rigid_body=None)
