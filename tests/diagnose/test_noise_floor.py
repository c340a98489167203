"""What a perfect model would miss, held against many simulated motions."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.diagnose.noise_floor import position_std_after
from rovid.model.model import Model

MODEL = Model(inertia=5000.0, quadratic_drag=3500.0, linear_drag=130.0)
TORQUE, MEMORY, RATE = 2.5, 4.0, 0.15


def drawn(seconds: float, begun: tuple[float, float], count: int = 4000, step: float = 0.02) -> float:
    """Standard deviation of the position over so many motions, one Euler step after another."""
    rng = np.random.default_rng(7)
    slope = 2.0 * MODEL.quadratic_drag * RATE + MODEL.linear_drag
    position, rate = (np.sqrt(variance) * rng.normal(size=count) for variance in begun)
    torque = TORQUE * rng.normal(size=count)
    kept = np.exp(-step / MEMORY)
    for _ in range(round(seconds / step)):
        position = position + step * rate
        rate = rate + step * (torque - slope * rate) / MODEL.inertia
        torque = kept * torque + TORQUE * np.sqrt(1.0 - kept**2) * rng.normal(size=count)
    return float(np.std(position))


@pytest.mark.parametrize("seconds", [10.0, 60.0])
def test_it_is_what_many_motions_scatter_by(seconds: float) -> None:
    begun = (1e-6, 1e-6)
    expected = position_std_after(MODEL, RATE, (TORQUE, MEMORY), begun, seconds)
    # 4000 motions know their scatter to 1.1 %.
    assert drawn(seconds, begun) == pytest.approx(expected, rel=0.05)


def test_a_vehicle_that_answers_at_once_overflows_nothing() -> None:
    quick = Model(inertia=0.01, quadratic_drag=1.0, linear_drag=5.0)
    off = position_std_after(quick, 1.0, (0.1, 0.2), (0.0, 0.0), 60.0)
    # Long after its memory a white torque of the same power: T sqrt(2 memory t) / slope.
    assert off == pytest.approx(0.1 * np.sqrt(2.0 * 0.2 * 60.0) / 7.0, rel=0.01)


def test_nothing_drives_what_is_known_exactly() -> None:
    assert position_std_after(MODEL, RATE, (0.0, MEMORY), (0.0, 0.0), 60.0) == 0.0
