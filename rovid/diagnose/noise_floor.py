"""What a perfect model would miss: what the disturbance drives, and the sensor's noise."""

from __future__ import annotations

import math

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.estimate.fit_result import FitResult
from rovid.model.model import Model

_DOUBLINGS = 12


def rate_floor(fitted: FitResult) -> float:
    """RMS rate that the disturbance drives, and what the low pass leaves of the sensor's noise."""
    return math.hypot(fitted.objective.disturbance_rate_std(fitted.x), _rate_noise(fitted))


def position_floor(fitted: FitResult, seconds: float) -> float:
    """RMS position in rad or m that a simulation is off so many ``seconds`` after a restart from the measurement.

    NaN where none of the misfit is known to be a disturbance's.
    """
    if fitted.objective.disturbance_rate_std(fitted.x) <= 0.0:
        return math.nan
    torque, memory = fitted.objective.disturbance(fitted.x)
    begun = 2.0 * fitted.objective.position_noise(fitted.x) ** 2, _rate_noise(fitted) ** 2
    return position_std_after(fitted.model, fitted.data.rms_rate, (torque, memory), begun, seconds)


def position_std_after(
    model: Model, rate: float, disturbance: tuple[float, float], begun: tuple[float, float], seconds: float
) -> float:
    """Standard deviation in rad or m of the position after so many ``seconds``, of the motion linearised at ``rate``.

    Parameters
    ----------
    disturbance
        Standard deviation in N m and memory in s of the torque, which acts from the first.
    begun
        Variances of position and rate at the beginning.
    """
    torque, memory = disturbance
    slope = 2.0 * model.quadratic_drag * rate + model.linear_drag
    motion = np.array(
        [
            [0.0, 1.0, 0.0],
            [-model.stiffness / model.inertia, -slope / model.inertia, 1.0 / model.inertia],
            [0.0, 0.0, -1.0 / memory],
        ]
    )
    driven = np.diag([0.0, 0.0, 2.0 * torque**2 / memory])
    spread = _carried(motion, driven, np.diag([*begun, torque**2]), seconds)
    return math.sqrt(max(float(spread[0, 0]), 0.0))


def _carried(motion: FloatArray, driven: FloatArray, begun: FloatArray, seconds: float) -> FloatArray:
    """(k, k) covariance of a linear motion driven by white noise, over a short step first (Van Loan 1978)."""
    from scipy import linalg

    zero, count = np.zeros_like(motion), len(motion)
    step = linalg.expm(np.block([[-motion, driven], [zero, motion.T]]) * (seconds / 2**_DOUBLINGS))
    onward = step[count:, count:].T
    added = onward @ step[:count, count:]
    # A step back in time grows without bounds: only short ones are taken, and each is doubled.
    for _ in range(_DOUBLINGS):
        added = onward @ added @ onward.T + added
        onward = onward @ onward
    return np.asarray(onward @ begun @ onward.T + added)


def _rate_noise(fitted: FitResult) -> float:
    """What the low pass leaves of the sensor's noise, in the rate."""
    return float(np.median([run.rates.rate_noise for run in fitted.data.runs]))
