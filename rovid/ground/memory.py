"""When memory that is no longer of use is given back."""

from __future__ import annotations

import gc
import sys

# Names of the settings in malloc.h.
_TRIM_THRESHOLD, _MMAP_THRESHOLD, _ARENA_MAX = -1, -3, -8
# Bytes; smaller than what a day's logs make, and larger than what is made again and again.
_LARGE = 16_000_000
# So many objects more are made before it is looked for those that are of no use any more.
_MANY = 100_000


def collect_seldom() -> None:
    """Nothing that is imported goes before the end: to look it all through again and again takes long."""
    gc.set_threshold(_MANY)


def give_back() -> None:
    """Give back large arrays when they go.

    The GNU library keeps a heap for each thread, and what it takes for large grows up to 32 MB with what it has seen.
    """
    if sys.platform != "linux":
        return
    import ctypes

    setting = getattr(ctypes.CDLL(None), "mallopt", None)
    if setting is not None:
        for name, value in ((_ARENA_MAX, 1), (_MMAP_THRESHOLD, _LARGE), (_TRIM_THRESHOLD, _LARGE)):
            setting(name, value)
