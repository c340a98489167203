"""The equation of motion with its effects."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from rovid.effects import effect_named
from rovid.model.model import Model
from rovid.trial.axis import AXES


def test_names_and_values_of_parameters_correspond() -> None:
    effects = (effect_named("thruster_lag"), effect_named("added_mass_memory"))
    model = Model(
        inertia=5.0,
        quadratic_drag=2.0,
        linear_drag=0.5,
        effects=effects,
        effect_values=(0.2, 1.5, 4.0),
        axis=AXES["pitch"],
        restoring_values=(30.0, 0.1),
    )
    named = dict(zip(model.names, model.values.tolist(), strict=True))
    assert named["inertia"] == 5.0
    assert [named[f"{e.key}.{p.name}"] for e in effects for p in e.parameters] == [0.2, 1.5, 4.0]
    assert model.natural_frequency == pytest.approx(np.sqrt(30.0 / 5.0))
    assert model.low_frequency_inertia > model.inertia


@pytest.mark.parametrize("stiffness", [0.0, 40.0])
def test_the_rate_under_a_disturbance_agrees_with_the_lyapunov_equation(stiffness: float) -> None:
    inertia, rate, memory = 5.0, 0.3, 2.5
    model = Model(
        inertia=inertia,
        quadratic_drag=3.0,
        linear_drag=1.2,
        axis=AXES["pitch"],
        restoring_values=(stiffness, 0.0),
    )
    damping = 2.0 * 3.0 * rate + 1.2
    # Angle, rate, disturbance of unit variance. Without a stiffness the angle wanders, and has no say.
    motion = np.array([[0.0, 1.0, 0.0], [-stiffness, -damping, 1.0], [0.0, 0.0, -1.0 / memory]])
    motion[1] /= inertia
    driven = np.diag([0.0, 0.0, 2.0 / memory])
    at = slice(None) if stiffness else slice(1, None)
    spread = solve_continuous_lyapunov(motion[at, at], -driven[at, at])
    assert model.rate_std_per_torque(rate, memory) == pytest.approx(np.sqrt(spread[-2, -2]), rel=1e-9)
