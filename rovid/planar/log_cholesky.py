"""Mass matrices as unbounded coordinates: logarithms of their Cholesky factors."""

import numpy as np

from rovid.core.array_types import FloatArray


def log_cholesky(mass: FloatArray, scale: FloatArray) -> FloatArray:
    """(4,) unbounded coordinates of a positive definite (3, 3) ``mass`` matrix, for (3,) typical inertias ``scale``."""
    sway = 0.5 * np.log(mass[1, 1] / scale[1])
    root = np.sqrt(scale[1] * scale[2])
    coupled = mass[1, 2] / root / np.exp(sway)
    rest = max(mass[2, 2] / scale[2] - coupled**2, 1e-12)
    return np.array([np.log(mass[0, 0] / scale[0]), sway, 0.5 * np.log(rest), coupled])


def from_log_cholesky(numbers: FloatArray, scale: FloatArray) -> FloatArray:
    """(4,) inertias of surge, sway, yaw and their coupling, from the coordinates of `log_cholesky`."""
    surge, sway, yaw, coupled = numbers
    side = np.exp(sway)
    return np.array(
        [
            scale[0] * np.exp(surge),
            scale[1] * side**2,
            scale[2] * (coupled**2 + np.exp(2.0 * yaw)),
            np.sqrt(scale[1] * scale[2]) * side * coupled,
        ]
    )
