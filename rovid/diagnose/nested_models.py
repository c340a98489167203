"""The models between the plain one and the one that has all that was found: with some of it, all else fitted again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

from rovid.diagnose.validation import Work
from rovid.effects import Effect
from rovid.model.model import Model

# Up to so many causes every combination is looked at; of more, one is added after another.
MOST_COMBINED = 3


def subsets(effects: Sequence[Effect]) -> Iterator[tuple[Effect, ...]]:
    """Each choice of some of ``effects``, neither none nor all: of many, the first, the first two, and so on."""
    for count in range(1, len(effects)):
        if len(effects) <= MOST_COMBINED:
            yield from combinations(effects, count)
        else:
            yield tuple(effects[:count])


def nested_models(work: Work, effects: Sequence[Effect]) -> tuple[Model, ...]:
    """The final model of ``work`` with some of ``effects`` alone, every reading fitted again, as `some_of` has them.

    What else the final model has stays in.
    """
    between = []
    for kept in subsets(effects):
        fitted = work.final
        for effect in effects:
            if effect not in kept:
                fitted = work.search.without(fitted, effect)
        between.append(fitted)
    work.refine(between)
    return tuple(work.refined(fitted).model for fitted in between)
