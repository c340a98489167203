"""Settings of Python's garbage collector and of the memory allocator, for processes that rovid has to itself."""

from __future__ import annotations

import atexit
import gc
import sys

# New objects between two garbage collections.
_GC_THRESHOLD = 100_000
# Parameter numbers of glibc's mallopt, from malloc.h.
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD, _M_ARENA_MAX = -1, -3, -8
# Bytes; less than the arrays of a day's logs, and more than arrays that are made again and again.
_LARGE = 16_000_000


def tune_process() -> None:
    """Collect garbage seldom, and return large arrays to the system when they are deleted."""
    # Imported modules stay until the end. A collection would look through all of them, also the one at the end.
    gc.set_threshold(_GC_THRESHOLD)
    atexit.register(gc.freeze)
    if sys.platform == "linux":
        _tune_malloc()


def _tune_malloc() -> None:
    """Let glibc use one heap for all threads, and no heap for large arrays; by itself it raises that limit to 32 MB."""
    import ctypes

    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        for parameter, value in ((_M_ARENA_MAX, 1), (_M_MMAP_THRESHOLD, _LARGE), (_M_TRIM_THRESHOLD, _LARGE)):
            mallopt(parameter, value)
