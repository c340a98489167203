"""Cache with a limited total size, which evicts the least recently used value, or a random one."""

import random
import threading
from collections.abc import Callable, Hashable
from typing import Any, Protocol, TypeVar


class HasNbytes(Protocol):
    """An object of known size, such as an array."""

    @property
    def nbytes(self) -> int:
        """Size in bytes."""


Value = TypeVar("Value", bound=HasNbytes)


class SizedCache:
    """Values by key, up to ``max_bytes`` in total. The value that was not used for the longest time is evicted first.

    A key that holds a weak reference does not keep its object alive. Several threads may compute the same value at
    once.

    ``evict_randomly``: For keys that are used in a fixed order again and again: the least recently used value is then
        needed next. A random value is evicted instead, and the latest is kept however large it is.
    """

    def __init__(self, max_bytes: int, *, evict_randomly: bool = False) -> None:
        self.max_bytes, self.evict_randomly = max_bytes, evict_randomly
        self._values: dict[Hashable, Any] = {}
        self._bytes = 0
        self._lock = threading.Lock()
        self._random = random.Random(0)  # noqa: S311 - nothing is secret

    def get_or_make(self, key: Hashable, make: Callable[[], Value]) -> Value:
        """The value under ``key``, or the value that ``make`` returns, which is kept if it fits."""
        with self._lock:
            found: Value | None = self._pop(key)
            if found is not None:
                self._put(key, found)
                return found
        made = make()
        if made.nbytes <= self.max_bytes or self.evict_randomly:
            with self._lock:
                self._pop(key)
                self._put(key, made)
                fewest = 1 if self.evict_randomly else 0
                while self._bytes > self.max_bytes and len(self._values) > fewest:
                    keys = list(self._values)
                    # The latest key stands last.
                    self._pop(keys[self._random.randrange(len(keys) - 1)] if self.evict_randomly else keys[0])
        return made

    def _pop(self, key: Hashable) -> Any:
        found = self._values.pop(key, None)
        self._bytes -= 0 if found is None else found.nbytes
        return found

    def _put(self, key: Hashable, value: Any) -> None:
        self._values[key] = value
        self._bytes += value.nbytes
