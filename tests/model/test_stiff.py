"""The filter along a stiff axis against matrix exponentials."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from rovid.core.array_types import FloatArray
from rovid.effects import effect_named
from rovid.model.kernels import ekf3_innovations, ekf5_innovations
from rovid.model.model import Model
from rovid.model.torque_input import TorqueInput
from rovid.trial.axis import AXES
from tests.abreast import Log, filtered

# Of a work-class vehicle in pitch; the disturbance's size and memory, the noise of angle and rate.
INERTIA, DRAG, STIFFNESS = 3500.0, 600.0, 2550.0
NOISE = (20.0, 4.0, 1e-3, 1.0)


def stiff(angle: FloatArray, time: FloatArray, wave: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
    """Innovations of a pitching vehicle's angle by the filter, and their variances."""
    model = Model(
        inertia=INERTIA,
        quadratic_drag=0.0,
        linear_drag=DRAG,
        axis=AXES["pitch"],
        restoring_values=(STIFFNESS, 0.0),
        effects=() if wave is None else (effect_named("wave_torque"),),
        effect_values=() if wave is None else tuple(wave),
    )
    log = Log(time=time, angle=angle, start=float(angle[0]))
    found = filtered(
        ekf3_innovations if wave is None else ekf5_innovations, log, TorqueInput.held(np.zeros(len(time))), model, NOISE
    )
    return found[0][:, 0], found[1][:, 0]


def exact(angle: FloatArray, time: FloatArray, wave: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
    """The same by matrix exponentials."""
    sigma, tau, white, _ = NOISE
    size = 3 if wave is None else 5
    a, q, p = np.zeros((size, size)), np.zeros((size, size)), np.zeros((size, size))
    a[0, 1], a[1, :3], a[2, 2] = 1.0, (-STIFFNESS / INERTIA, -DRAG / INERTIA, 1.0 / INERTIA), -1.0 / tau
    q[2, 2] = 2.0 * sigma**2 / tau
    p[:3, :3] = np.diag((white**2, 0.01**2, sigma**2))
    if wave is not None:
        height, frequency, damping = wave
        a[1, 3], a[3, 4], a[4, 3:] = 1.0 / INERTIA, 1.0, (-(frequency**2), -2.0 * damping * frequency)
        p[3:, 3:] = 0.5 * height**2 * np.diag((1.0, frequency**2))
        q[4, 4] = 2.0 * damping * frequency**3 * height**2
    state, errors, variances = np.zeros(size), np.full(len(time), np.nan), np.full(len(time), np.nan)
    state[0] = angle[0]
    for k, reading in enumerate(angle):
        if k > 0:
            both = expm(np.block([[-a, q], [np.zeros_like(a), a.T]]) * (time[k] - time[k - 1]))
            step = both[size:, size:].T
            state, p = step @ state, step @ p @ step.T + step @ both[:size, size:]
        if np.isfinite(reading):
            variances[k], errors[k] = p[0, 0] + white**2, reading - state[0]
            gain = p[:, 0] / variances[k]
            state, p = state + gain * errors[k], p - np.outer(gain, p[0])
    return errors, variances


@pytest.mark.parametrize(
    "wave", [None, *(np.array(wave) for wave in ((40.0, 0.9, 0.1), (40.0, 4.0, 0.02), (20.0, 2.0, 0.3)))]
)
@pytest.mark.parametrize("blind", [False, True])
def test_the_filter_of_a_stiff_vehicle_is_exact(wave: FloatArray | None, blind: bool) -> None:
    time = np.arange(0.0, 40.0, 0.2)
    angle = 1e-3 * np.cos(np.sqrt(STIFFNESS / INERTIA) * time)
    if blind:
        angle[10:-1] = np.nan
    (error, variance), (wanted, known) = stiff(angle, time, wave), exact(angle, time, wave)
    measured = np.isfinite(known)
    measured[0] = False  # where the filter starts
    share = 0.01 if wave is None else 1e-3
    assert variance[measured] == pytest.approx(known[measured], rel=share)
    assert np.abs(error - wanted)[measured].max() < share * np.sqrt(known[measured].max())
