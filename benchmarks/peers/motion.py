"""The heading from rest under held torques, by Runge-Kutta in plain Python, as one would write it for a fitter."""

from __future__ import annotations

import numpy as np

from benchmarks.peers.log import Floats


def simulated(time: Floats, torque: Floats, heading: float, inertia: float, quadratic: float, linear: float) -> Floats:
    """(n,) rad at the instants of ``time`` in s, from ``heading`` on."""

    def change(rate: float, torque: float) -> float:
        return (torque - (quadratic * abs(rate) + linear) * rate) / inertia

    rate, angle = 0.0, heading
    headings = [angle]
    for step, push in zip(np.diff(time).tolist(), torque[:-1].tolist(), strict=True):
        k1 = change(rate, push)
        k2 = change(rate + 0.5 * step * k1, push)
        k3 = change(rate + 0.5 * step * k2, push)
        k4 = change(rate + step * k3, push)
        angle += step * (rate + step * (k1 + k2 + k3) / 6.0)
        rate += step * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0
        headings.append(angle)
    return np.array(headings)
