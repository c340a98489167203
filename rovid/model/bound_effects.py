"""The effects of a model, each with its parameters."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple, TypeVar

from rovid.core.array_types import FloatArray
from rovid.effects import Effect
from rovid.effects.base import Values

Act = TypeVar("Act")


class BoundEffect(NamedTuple):
    """An effect, and its (p,) parameters in their order."""

    effect: Effect
    parameters: FloatArray

    @property
    def values(self) -> Values:
        """Its parameters by name."""
        return self.effect.values(self.parameters)


def effects_at(every: Sequence[BoundEffect], where: type[Act]) -> Iterator[tuple[BoundEffect, Act]]:
    """Those that act ``where``, one of `rovid.effects.stages`, and what they do there."""
    for one in every:
        if isinstance(one.effect.acts, where):
            yield one, one.effect.acts


def actions_at(every: Sequence[BoundEffect], where: type[Act]) -> Iterator[tuple[Act, Values]]:
    """What those do that act ``where``, and their parameters."""
    return ((act, one.values) for one, act in effects_at(every, where))
