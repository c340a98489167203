"""How functions are compiled: for the machine at first use, and kept on disk."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numba

from rovid.ground.caches import keeps_compiled

Function = TypeVar("Function", bound=Callable[..., object])

# Several may run at once; a division by zero gives infinity, as numpy's does.
compiled = numba.njit(cache=keeps_compiled(), error_model="numpy", nogil=True)
# What is called several times in each step of a loop. Numba hands over an array as seven numbers or more, and such a
# call costs more than what is done in it.
inlined = numba.njit(error_model="numpy", nogil=True, inline="always")
# An innermost loop, which makes no arrays of its own: those that it is given are not counted up and down on the way.
lean: Callable[[Function], Function] = numba.njit(  # type: ignore[call-overload]  # its types leave out _nrt
    cache=keeps_compiled(), error_model="numpy", nogil=True, _nrt=False
)
