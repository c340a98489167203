"""What was worked out lately, so that it need not be again: as much of it as there is room for."""

from __future__ import annotations

import random
import threading
from collections.abc import Callable, Hashable
from typing import Any, Protocol, TypeVar


class HasNbytes(Protocol):
    """What says how many bytes it takes."""

    @property
    def nbytes(self) -> int:
        """Bytes."""


Value = TypeVar("Value", bound=HasNbytes)


class SizedCache:
    """What was made, by all that it was made of; what has not been asked for the longest goes first.

    Of ``most`` bytes all together. A weak reference among what it was made of does not keep that alive. What is asked
    for ``in_turn``, from the first to the last again and again, is asked for next when it has not been for the longest:
    then any other goes, and the latest is kept however large it is. Threads may ask for the same at the same time, and
    make it twice.
    """

    def __init__(self, most: int, *, evict_randomly: bool = False) -> None:
        self.max_bytes, self.in_turn = most, evict_randomly
        self._made: dict[Hashable, Any] = {}
        self._bytes = 0
        self._lock = threading.Lock()
        self._chance = random.Random(0)  # noqa: S311 - nothing is secret

    def get_or_make(self, key: Hashable, make: Callable[[], Value]) -> Value:
        """What is kept under ``key``, or else what ``make`` gives, which is kept where there is room for it at all."""
        with self._lock:
            found: Value | None = self._taken(key)
            if found is not None:
                self._keep(key, found)
                return found
        made = make()
        if made.nbytes <= self.max_bytes or self.in_turn:
            with self._lock:
                self._taken(key)
                self._keep(key, made)
                while self._bytes > self.max_bytes and len(self._made) > self.in_turn:
                    self._taken(self._dispensable())
        return made

    def _dispensable(self) -> Hashable:
        keys = list(self._made)
        return keys[self._chance.randrange(len(keys) - 1)] if self.in_turn else keys[0]

    def _taken(self, key: Hashable) -> Any:
        found = self._made.pop(key, None)
        self._bytes -= 0 if found is None else found.nbytes
        return found

    def _keep(self, key: Hashable, made: Any) -> None:
        self._made[key] = made
        self._bytes += made.nbytes
