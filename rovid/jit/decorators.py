"""How functions are compiled: for the machine at first use, and kept on disk."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

from rovid.jit.cache_dirs import can_cache

Function = TypeVar("Function", bound=Callable[..., object])


def compiled(function: Function) -> Function:
    """One that several may run at once; a division by zero gives infinity, as numpy's does."""
    return _kept(numba.njit(error_model="numpy", nogil=True)(function), function)


def njit_noalloc(function: Function) -> Function:
    """An innermost loop, which makes no arrays of its own: those given are not counted up and down on the way."""
    loop = numba.njit(error_model="numpy", nogil=True, _nrt=False)  # type: ignore[call-overload]  # its types leave it out
    return _kept(loop(function), function)


# What is called several times in each step of a loop. Numba hands over an array as seven numbers or more, and such a
# call costs more than what is done in it.
njit_inline = numba.njit(error_model="numpy", nogil=True, inline="always")


def is_cached(function: Any) -> bool:
    """Whether a compiled ``function`` is on disk, as it is now."""
    return hasattr(function, "_cache") and bool(function._cache.is_there())  # noqa: SLF001 - as below


def _kept(dispatcher: Any, function: Function) -> Function:
    """The ``dispatcher`` that compiles a ``function``, keeping what it compiled."""
    if can_cache():
        from rovid.jit.cache import ContentHashCache

        dispatcher._cache = ContentHashCache(function)  # noqa: SLF001 - numba lets nobody else say until when it is good
    return dispatcher  # type: ignore[no-any-return]  # takes and gives the same
