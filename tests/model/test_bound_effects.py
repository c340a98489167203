"""Packing of terms for compiled loops."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.effects import TERM_EFFECTS, effect_named
from rovid.effects.base import TERM_PARAMETERS
from rovid.model.bound_effects import BoundEffect, pack_terms


def acting(name: str, *numbers: float) -> BoundEffect:
    return BoundEffect(effect_named(name), np.array(numbers))


def test_terms_that_entrain_water_come_first_then_stateful_ones() -> None:
    drag, memory = acting("drag_curvature", 0.2), acting("added_mass_memory", 300.0, 4.0)
    swirl, delay = acting("entrained_swirl", 0.3, 20.0), acting("command_delay", 0.4)
    terms = pack_terms([drag, memory, delay, swirl], 0.5)
    assert [TERM_EFFECTS[kind].id for kind in terms.kinds] == ["entrained_swirl", "added_mass_memory", "drag_curvature"]
    assert (terms.entraining, terms.stateful) == (1, 2)
    assert terms.parameters[::TERM_PARAMETERS, 0].tolist() == [0.3, 300.0, 0.2]


def test_the_fastest_rate_is_at_least_that_of_the_motion() -> None:
    assert pack_terms([], 0.5).fastest == 0.5
    assert pack_terms([acting("tank_seiche", 0.1, 3.0, 0.05)], 0.5).fastest == 3.0
    assert pack_terms([acting("tank_seiche", 0.1, 0.2, 0.05)], 0.5).fastest == 0.5


def test_heavy_water_is_integrated_at_the_rate_of_motion_and_water_together() -> None:
    memory = acting("added_mass_memory", 9.0, 0.5)
    assert pack_terms([memory], 0.1, 3.0).fastest == pytest.approx((1.0 + 9.0 / 3.0) / 0.5)
