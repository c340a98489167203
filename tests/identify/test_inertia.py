"""Inertia by each method side by side."""

from __future__ import annotations

import numpy as np

from rovid.identify.estimate import Estimate
from rovid.identify.inertia import fit_inertia
from tests.identify.test_sine import sine
from tests.synthetic import ROSUB


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
