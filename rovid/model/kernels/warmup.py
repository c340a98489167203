"""What is compiled at first use: most of it by a second process, while this one reads the logs."""

from __future__ import annotations

import contextlib
import functools
import gc
import sys
from collections import deque
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from rovid.core.threads import core_count
from rovid.effects.base import Body
from rovid.jit.background_compiler import BackgroundCompiler, report_done
from rovid.jit.cache_dirs import can_cache
from rovid.jit.decorators import is_cached
from rovid.jit.simd import LANES
from rovid.signals.numba_loops import first_order_sum

Function = TypeVar("Function", bound=Callable[..., Any])

# s; whoever has waited longer for a loop compiles it here.
_PATIENCE = 60.0
_LONG: dict[str, Any] = {}
# Of these the first process compiles that one itself.
_OWN = "rovid.model.kernels.ekf3._filter"
# What it compiles as it waits for the second: each asked for next to nothing, until that is done.
_MEANWHILE: deque[Callable[[], object]] = deque()
_BEGUN: list[BackgroundCompiler] = []


def is_compiled() -> bool:
    """Whether this machine has compiled before what takes long."""
    return can_cache() and all(map(is_cached, _LONG.values()))


def start_compiling() -> bool:
    """Have a second process compile what is not compiled yet, if it can be kept and there is another core.

    Whether there is one.
    """
    if not _BEGUN and can_cache() and core_count() > 1 and sys.executable and not is_compiled():
        with contextlib.suppress(OSError):
            _BEGUN.append(
                BackgroundCompiler(f"import {__name__} as first_use; first_use.work()", _LONG.keys() - {_OWN})
            )
            _MEANWHILE.extend((long_loops()[_OWN], *quick_loops()))
    return bool(_BEGUN)


def compile_all() -> None:
    """Compile it in this process, before others are started that would each do so."""
    for loop in (*long_loops().values(), *quick_loops()):
        loop()


def warmed_up(loop: Function) -> Function:
    """A ``loop`` that takes long to compile: where there is a second process, it waits for that to have done so."""
    name = f"{loop.__module__}.{loop.__qualname__}"
    _LONG[name] = loop

    @functools.wraps(loop)
    def once_compiled(*arguments: Any) -> Any:
        for second in _BEGUN:
            while _MEANWHILE and not second.has_done(name):
                with contextlib.suppress(IndexError):
                    _MEANWHILE.popleft()()
            second.wait_for(name, _PATIENCE)
        return loop(*arguments)

    return once_compiled  # type: ignore[return-value]  # takes the same


def work() -> None:
    """As the second process: compile one after the other."""
    gc.disable()  # it is over before memory is
    report_done(name for name, loop in long_loops().items() if name != _OWN and loop() is not None)


def quick_loops() -> list[Callable[[], object]]:
    """Each loop over held signals, and the recursion, asked for next to nothing."""
    from rovid.effects import actuator_dynamics

    two = np.arange(2.0)
    held = [functools.partial(loop, two, two, *[1.0] * more) for loop, more in actuator_dynamics.LOOPS]
    return [*held, functools.partial(first_order_sum, two, 1.0)]


def long_loops() -> dict[str, Callable[[], object]]:
    """In the order in which a diagnosis needs them, each asked for next to nothing in numbers as it is always given."""
    from rovid.model import kernels
    from rovid.model.filter_batch import FilterData, FilterInputs, ParameterBatch
    from rovid.model.packed_terms import pack_terms
    from rovid.model.torque_input import TorqueInput

    body, terms, drive = Body(1.0, 1.0, 1.0), pack_terms([], 1.0), TorqueInput.held(np.zeros(2))
    begins, one, two = np.array([0, 2]), np.ones(1), np.arange(2.0)
    grid = drive.torque, drive.effect_inputs, two, two, np.zeros((2, 0))
    logged = FilterData(begins, two, two, one, np.ones((1, 2)), np.arange(4).reshape(2, 2))
    driven = FilterInputs.stack([drive] * LANES, [two] * LANES)
    models = ParameterBatch(np.ones((5, LANES)), terms, np.ones((4, LANES)), np.ones((3, LANES)))
    ends = begins[:1].copy(), begins[1:].copy(), one
    asked: dict[str, Callable[[], object]] = {
        "multi_step._predict": lambda: kernels.predict_multi_step(one, *grid, *ends, body, terms),
        "multi_step._follow": lambda: kernels.effects_along(
            begins, one, np.zeros((2, 3)), drive.effect_inputs, one, body, terms
        ),
        "ekf3._filter": lambda: kernels.ekf3_innovations(logged, driven, models),
        "ekf5._filter": lambda: kernels.ekf5_innovations(logged, driven, models),
    }
    return {f"{kernels.__name__}.{name}": loop for name, loop in asked.items()}
