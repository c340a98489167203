"""The law of the controller."""

from __future__ import annotations

import math

import pytest

from rovid.control.control_law import static_terms_of, wrapped
from tests.control.loops import closed, law, with_effect


@pytest.mark.parametrize(
    ("key", "values"),
    [
        ("bias_torque", (8.0,)),
        ("tether_torsion", (2.0,)),
        ("tether_torsion:stiffening", (2.0, 6.0)),
        ("heading_dependent_torque:mixed", (6.0, 0.4, 3.0, -1.0)),
    ],
)
def test_torques_at_rest_are_held_against(key: str, values: tuple[float, ...]) -> None:
    model = with_effect(key, *values)
    known = law(900.0, 3000.0, hold=static_terms_of(model))
    unknown = law(900.0, 3000.0)
    errors = [
        abs(math.degrees(wrapped(c.setpoint[-1] - c.heading[-1])))
        for c in (closed(model, known), closed(model, unknown))
    ]
    assert errors[0] < 1e-3
    assert errors[1] > 0.05
