"""What is compiled at first use: most of it by a second process, while this one reads the logs."""

from __future__ import annotations

import contextlib
import functools
import gc
import sys
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import numpy as np

from rovid.effects.base import Body
from rovid.ground.caches import keeps_compiled
from rovid.ground.compiled import is_kept
from rovid.ground.lanes import LANES
from rovid.ground.second import Second, say
from rovid.ground.workers import cores

Function = TypeVar("Function", bound=Callable[..., Any])

# s; whoever has waited longer for a loop compiles it here.
_PATIENCE = 60.0
_LONG: dict[str, Any] = {}
_BEGUN: list[Second] = []


def is_compiled() -> bool:
    """Whether this machine has compiled before what takes long."""
    return keeps_compiled() and all(map(is_kept, _LONG.values()))


def begin() -> None:
    """Have a second process compile what is not compiled yet, if it can be kept and there is another core."""
    if not _BEGUN and keeps_compiled() and cores() > 1 and sys.executable and not is_compiled():
        with contextlib.suppress(OSError):
            _BEGUN.append(Second(f"import {__name__} as first_use; first_use.work()", _LONG))


def compile_now() -> None:
    """Compile it in this process, before others are started that would each do so."""
    for _ in compiled_in_order():
        pass


def long(loop: Function) -> Function:
    """A ``loop`` that takes long to compile: where there is a second process, it waits for that to have done so."""
    name = f"{loop.__module__}.{loop.__qualname__}"
    _LONG[name] = loop

    @functools.wraps(loop)
    def once_compiled(*arguments: Any) -> Any:
        for second in _BEGUN:
            second.wait_for(name, _PATIENCE)
        return loop(*arguments)

    return once_compiled  # type: ignore[return-value]  # takes the same


def work() -> None:
    """As the second process: compile one after the other."""
    gc.disable()  # it is over before memory is
    say(name for _ in compiled_in_order() for name, loop in _LONG.items() if loop.overloads)


def compiled_in_order() -> Iterator[object]:
    """Ask each for next to nothing, in numbers of the kind that they are always given, as a diagnosis needs them.

    The rest, which is quick, is compiled by the first process in the meantime.
    """
    from rovid.model import kernels
    from rovid.model.batch import Abreast, Driven, Logged
    from rovid.model.drive import Drive
    from rovid.model.equation import terms_of

    body, terms, drive = Body(1.0, 1.0, 1.0), terms_of([], 1.0), Drive.held(np.zeros(2))
    begins, one, two = np.array([0, 2]), np.ones(1), np.arange(2.0)
    grid = drive.torque, drive.beside, two, two, np.zeros((2, 0))
    yield kernels.predict(one, *grid, begins[:1].copy(), begins[1:].copy(), one, body, terms)
    yield kernels.effects_along(begins, one, np.zeros((2, 3)), drive.beside, one, body, terms)
    logged = Logged(begins, two, two, one, np.ones((1, 2)), np.arange(4).reshape(2, 2))
    driven = Driven.of([drive] * LANES, [two] * LANES)
    models = Abreast(np.ones((5, LANES)), terms, np.ones((4, LANES)), np.ones((3, LANES)))
    yield kernels.innovations(logged, driven, models)
    yield kernels.innovations_wide(logged, driven, models)
