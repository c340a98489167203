"""The network of the upper bound learns a torque that the plain model lacks."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.upper_bound import Network, Series
from rovid.core.array_types import FloatArray
from rovid.model.model import Model

MODEL = Model(inertia=10.0, quadratic_drag=8.0, linear_drag=4.0)
STEP = 0.05


def series(seed: int) -> Series:
    """A run of random levels against a torque of 3*sin(2*heading) N m."""
    time = np.arange(0.0, 100.0, STEP)
    levels = np.random.default_rng(seed).uniform(-12.0, 12.0, 21)
    torque = levels[(time // 5.0).astype(int)]

    def slope(t: float, y: FloatArray) -> list[float]:
        drag = (8.0 * abs(y[0]) + 4.0) * y[0]
        return [(levels[int(t // 5.0)] + 3.0 * np.sin(2.0 * y[1]) - drag) / 10.0, y[0]]

    rate, angle = solve_ivp(slope, (0.0, 100.0), [0.0, 0.0], t_eval=time, max_step=0.1, rtol=1e-6).y
    return Series(time=time, step=STEP, rate=rate, torque=torque, angle=angle)


def test_a_network_predicts_runs_that_it_has_not_seen() -> None:
    network, held_out = Network(MODEL, [series(1), series(2), series(3)], constant=1.5), series(4)
    without = np.empty(len(held_out.rate))
    without[0] = 0.0
    for at, torque in enumerate(held_out.torque[:-1]):
        drag = (MODEL.quadratic_drag * abs(without[at]) + MODEL.linear_drag) * without[at]
        without[at + 1] = without[at] + STEP * (torque - drag) / MODEL.inertia
    errors = [float(np.mean((rate - held_out.rate) ** 2)) for rate in (network.simulate(held_out), without)]
    assert errors[0] < 0.3 * errors[1]
