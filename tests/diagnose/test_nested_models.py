"""Which combinations of causes are simulated, and with what parameters."""

from __future__ import annotations

from rovid.diagnose.nested_models import subsets
from rovid.effects import CATALOGUE


def keys(count: int) -> list[tuple[str, ...]]:
    return [tuple(effect.key for effect in chosen) for chosen in subsets(CATALOGUE[:count])]


def test_of_up_to_three_causes_every_combination_is_there() -> None:
    one, two, three = (effect.key for effect in CATALOGUE[:3])
    assert keys(0) == keys(1) == []
    assert keys(2) == [(one,), (two,)]
    assert keys(3) == [(one,), (two,), (three,), (one, two), (one, three), (two, three)]


def test_of_more_one_is_added_after_another() -> None:
    names = tuple(effect.key for effect in CATALOGUE[:5])
    assert keys(5) == [names[:1], names[:2], names[:3], names[:4]]
