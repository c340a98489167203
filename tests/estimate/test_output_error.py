"""Parameters from the freely simulated rate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rovid.estimate.instrumental_variables import fit_regression
from rovid.estimate.output_error import fit_output_error
from tests.synthetic import ROSUB, clock, run


def test_a_delay_that_turns_both_drags_negative_leaves_a_start() -> None:
    time = clock(240.0)
    model = replace(ROSUB, inertia=200.0, quadratic_drag=10.0, linear_drag=100.0)
    torque = 100.0 * np.sign(np.sin(2.0 * np.pi * time / 4.0))
    log = run(time, np.roll(torque, 8), model)
    told = replace(log, torque=torque, filtered_torque=log.rates.filter_held(log.trial, torque))
    assert fit_regression([told]).estimate.values[1:].tolist() == [0.0, 0.0]
    fitted = fit_output_error([told])
    assert np.isfinite(fitted.values).all()
    assert fitted.inertia > 0.0
