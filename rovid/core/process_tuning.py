"""When memory that is no longer of use is looked for and given back, in a process of rovid's own."""

from __future__ import annotations

import atexit
import gc
import sys

# So many objects more are made before it is looked for those that are of no use any more.
_MANY = 100_000
# Names of the settings in malloc.h.
_TRIM_THRESHOLD, _MMAP_THRESHOLD, _ARENA_MAX = -1, -3, -8
# Bytes; smaller than what a day's logs make, and larger than what is made again and again.
_LARGE = 16_000_000


def tune_process() -> None:
    """Look seldom for small objects that are of no use any more, and give large arrays back when they go."""
    # Nothing that is imported goes before the end: to look it all through again and again takes long, and so it does
    # at the end, when all of it goes.
    gc.set_threshold(_MANY)
    atexit.register(gc.freeze)
    if sys.platform == "linux":
        _give_back()


def _give_back() -> None:
    """The GNU library keeps a heap for each thread, and what it takes for large grows up to 32 MB with what it sees."""
    import ctypes

    setting = getattr(ctypes.CDLL(None), "mallopt", None)
    if setting is not None:
        for name, value in ((_ARENA_MAX, 1), (_MMAP_THRESHOLD, _LARGE), (_TRIM_THRESHOLD, _LARGE)):
            setting(name, value)
