"""Compiled loops over samples. Nothing here knows of files, units or effects' names."""

from __future__ import annotations

import math

import numba
import numpy as np

from rovid.trial import FloatArray

# A step of this share of the shortest time constant leaves fourth-order Runge-Kutta exact to about 1e-6.
_STEP_SHARE = 0.2
_MAX_SUBSTEPS = 1000


# Compiled for the machine at first use; the result is kept on disk.
_compiled = numba.njit(cache=True, error_model="numpy")


@_compiled
def _acceleration(rate: float, torque: float, inertia: float, quadratic: float, linear: float) -> float:
    return (torque - (quadratic * abs(rate) + linear) * rate) / inertia


@_compiled
def simulate(
    time: FloatArray,
    torque: FloatArray,
    inertia: float,
    quadratic: float,
    linear: float,
    initial_rate: float,
) -> tuple[FloatArray, FloatArray]:
    """Integrate ``inertia*rdot + quadratic*|r|*r + linear*r = torque`` and ``angle_dot = r``.

    Parameters
    ----------
    time
        (n,) s, increasing.
    torque
        (n,) N m, held from each instant to the next.
    initial_rate
        rad/s at the first instant; the angle starts at 0.

    Returns
    -------
    rate, angle
        (n,) rad/s and (n,) rad. Classical fourth-order Runge-Kutta, sub-stepped so that a step is a small
        share of the local time constant ``inertia / (2*quadratic*|r| + linear)``.
    """
    n = len(time)
    rate = np.empty(n)
    angle = np.empty(n)
    rate[0] = initial_rate
    angle[0] = 0.0
    for k in range(n - 1):
        r = rate[k]
        a = angle[k]
        interval = time[k + 1] - time[k]
        # The rate heads for the one that balances the torque: the faster of the two sets the time constant.
        balance = math.sqrt(abs(torque[k]) / quadratic) if quadratic > 0.0 else 0.0
        if linear > 0.0:
            balance = min(balance, abs(torque[k]) / linear) if quadratic > 0.0 else 0.0
        stiffness = (2.0 * quadratic * max(abs(r), balance) + linear) / inertia
        wanted = interval * stiffness / _STEP_SHARE
        steps = 1 if not wanted > 1.0 else min(int(wanted) + 1, _MAX_SUBSTEPS)
        h = interval / steps
        for _ in range(steps):
            k1 = _acceleration(r, torque[k], inertia, quadratic, linear)
            r2 = r + 0.5 * h * k1
            k2 = _acceleration(r2, torque[k], inertia, quadratic, linear)
            r3 = r + 0.5 * h * k2
            k3 = _acceleration(r3, torque[k], inertia, quadratic, linear)
            r4 = r + h * k3
            k4 = _acceleration(r4, torque[k], inertia, quadratic, linear)
            a += h * (r + 2.0 * r2 + 2.0 * r3 + r4) / 6.0
            r += h * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0
        rate[k + 1] = r
        angle[k + 1] = a
    return rate, angle


@_compiled
def constant_runs(values: FloatArray, tolerance: FloatArray) -> FloatArray:
    """Cut (n, k) ``values`` greedily into runs within which no column spans more than its ``tolerance``.

    Returns
    -------
    starts
        (m,) index of each run's first row, as floats.
    """
    n, width = values.shape
    starts = np.empty(n)
    count = 0
    low = np.empty(width)
    high = np.empty(width)
    for k in range(n):
        fits = k > 0
        for j in range(width):
            if fits and max(high[j], values[k, j]) - min(low[j], values[k, j]) > tolerance[j]:
                fits = False
        if fits:
            for j in range(width):
                low[j] = min(low[j], values[k, j])
                high[j] = max(high[j], values[k, j])
        else:
            starts[count] = k
            count += 1
            for j in range(width):
                low[j] = high[j] = values[k, j]
    return starts[:count]
