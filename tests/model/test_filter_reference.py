"""The compiled filter, whose covariance is written out term by term, against the same filter in matrices."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from rovid.core.array_types import FloatArray
from rovid.model.kernels import ekf3_innovations, simulate
from rovid.model.model import Model
from rovid.model.torque_input import TorqueInput
from tests.abreast import Log, filtered

# Drag is linear: what the filter linearises is then the motion itself.
MODEL = Model(inertia=5057.0, quadratic_drag=0.0, linear_drag=800.0)
SIGMA, TAU, WHITE, GYRO = 20.0, 3.0, 2e-3, 5e-3  # N m, s, rad, rad/s
BEGIN = (0.02, 0.01)  # rad/s; the first rate and its standard deviation


def in_matrices(time: FloatArray, drive: TorqueInput, readings: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n, 2) innovations and variances of the (n, 2) ``readings`` of angle and rate; Maybeck 1979, chapter 5."""
    inertia, damping = MODEL.inertia, MODEL.linear_drag / MODEL.inertia
    motion = np.array([[0.0, 1.0, 0.0], [0.0, -damping, 1.0 / inertia], [0.0, 0.0, -1.0 / TAU]])
    noise, push = np.diag([0.0, 0.0, 2.0 * SIGMA**2 / TAU]), np.array([[0.0], [1.0 / inertia], [0.0]])
    state = np.array([readings[0, 0], BEGIN[0], 0.0])
    covariance = np.diag([WHITE**2, BEGIN[1] ** 2, SIGMA**2])
    found, variance = np.full_like(readings, np.nan), np.full_like(readings, np.nan)
    for k, both in enumerate(readings):
        if k > 0:
            h = time[k] - time[k - 1]
            grown = expm(np.block([[-motion, noise], [np.zeros((3, 3)), motion.T]]) * h)  # Van Loan 1978
            step = grown[3:, 3:].T
            pushed = expm(np.block([[motion, push], [np.zeros((1, 4))]]) * h)[:3, 3]
            late = drive.timing_moment[k - 1] / inertia * np.array([1.0, -damping, 0.0])
            state = step @ state + pushed * drive.torque[k - 1] + late
            kick = np.array([[h**2 / 3.0, h / 2.0, 0.0], [h / 2.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
            covariance = (
                step @ covariance @ step.T + step @ grown[:3, 3:] + drive.impulse_variance[k - 1] / inertia**2 * kick
            )
        for at in np.flatnonzero(np.isfinite(both)):
            found[k, at], variance[k, at] = both[at] - state[at], covariance[at, at] + (WHITE, GYRO)[at] ** 2
            gain = covariance[:, at] / variance[k, at]
            state, covariance = state + gain * found[k, at], covariance - np.outer(gain, covariance[at])
    return found, variance


@pytest.mark.parametrize("has_gyro", [False, True])
@pytest.mark.parametrize("is_late", [False, True])
def test_the_filter_is_that_of_the_textbook(*, has_gyro: bool, is_late: bool) -> None:
    rng = np.random.default_rng(7)
    time = np.cumsum(rng.uniform(0.05, 0.5, 300))
    torque, nothing = 100.0 * np.sign(np.sin(0.3 * time)), np.zeros(len(time))
    late, open_when = nothing, nothing
    if is_late:
        late, open_when = rng.normal(0.0, 5.0, len(time)), rng.uniform(0.0, 50.0, len(time))
    drive = TorqueInput(torque, late, np.zeros((len(time), 3)), open_when, np.array([0, len(time)]))
    rate, angle = simulate(time, torque, MODEL.body, BEGIN[0])
    readings = np.column_stack((angle + rng.normal(0.0, WHITE, len(time)), rate + rng.normal(0.0, GYRO, len(time))))
    readings[100:140, 0] = np.nan
    if not has_gyro:
        readings[:, 1] = np.nan
    wanted, wanted_variance = in_matrices(time, drive, readings)
    log = Log(time=time, angle=readings[:, 0], rate=readings[:, 1], first=BEGIN)
    found, variance = filtered(ekf3_innovations, log, drive, MODEL, (SIGMA, TAU, WHITE, GYRO))
    known = np.isfinite(wanted)
    assert (np.isfinite(found) == known).all()
    # The transition is a series of fourth order over steps of 0.3 of the shortest time constant.
    assert variance[known] == pytest.approx(wanted_variance[known], rel=2e-3)
    assert (found - wanted)[known] / np.sqrt(wanted_variance[known]) == pytest.approx(0.0, abs=5e-3)
