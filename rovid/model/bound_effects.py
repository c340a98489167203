"""The effects of a model, each with its parameters."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple, TypeVar

from rovid.core.array_types import FloatArray
from rovid.effects import Effect
from rovid.effects.base import Values

Act = TypeVar("Act")


class Acting(NamedTuple):
    """An effect, and its (p,) parameters in their order."""

    effect: Effect
    numbers: FloatArray

    @property
    def values(self) -> Values:
        """Its parameters by name."""
        return self.effect.values(self.numbers)


def each_that(every: Sequence[Acting], where: type[Act]) -> Iterator[tuple[Acting, Act]]:
    """Those that act ``where``, one of `rovid.effects.stages`, and what they do there."""
    for one in every:
        if isinstance(one.effect.acts, where):
            yield one, one.effect.acts


def that_act(every: Sequence[Acting], where: type[Act]) -> Iterator[tuple[Act, Values]]:
    """What those do that act ``where``, and their parameters."""
    return ((act, one.values) for one, act in each_that(every, where))
