"""Compilation at first use: a second process compiles most loops while this one reads the logs."""

import atexit
import contextlib
import functools
import gc
import os
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import numpy as np

from rovid.core.threads import core_count
from rovid.effects.base import Body
from rovid.jit.cache_dirs import can_cache
from rovid.jit.decorators import is_cached
from rovid.jit.simd import LANES
from rovid.trial.numba_loops import first_order_sum


class BackgroundCompiler:
    """Runs ``code`` in a second process with the import paths of this one, and ends it with this one.

    ``code``: Python code that passes the names of finished parts to `report_done`.
    ``parts``: Names of all parts.
    """

    def __init__(self, code: str, parts: Iterable[str]) -> None:
        self._done = {part: threading.Event() for part in parts}
        self._process = subprocess.Popen(  # noqa: S603 - Python itself
            [sys.executable, "-c", f"import sys; sys.path[:] = {sys.path!r}; {code}"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        )
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()
        atexit.register(self.stop)

    @property
    def pid(self) -> int:
        """Number of the second process."""
        return self._process.pid

    def _listen(self) -> None:
        with self._process as process:
            for line in process.stdout or ():
                if (part := line.strip()) in self._done:
                    self._done[part].set()
        # The process has ended: there is nothing more to wait for.
        for done in self._done.values():
            done.set()

    def is_done(self, part: str) -> bool:
        """Whether a part is finished, is not among the parts, or will never be finished."""
        return part not in self._done or self._done[part].is_set()

    def wait_for(self, part: str, timeout: float) -> None:
        """Wait until `is_done`, for ``timeout`` in s at most."""
        if not self.is_done(part):
            self._done[part].wait(timeout)

    def stop(self) -> None:
        """End the second process."""
        self._process.kill()
        self._listener.join()


def report_done(parts: Iterable[str]) -> None:
    """In the second process: report each of ``parts`` as finished, and end when the first process ends."""
    threading.Thread(target=_end_with_first_process, daemon=True).start()
    for part in parts:
        sys.stdout.write(f"{part}\n")
        sys.stdout.flush()


def _end_with_first_process() -> None:
    # The first process never writes: the read returns when that process has ended.
    sys.stdin.read()
    os._exit(1)


Function = TypeVar("Function", bound=Callable[..., Any])

# s; after that a loop is compiled in this process.
_TIMEOUT = 60.0
# Loops that take long to compile, by name.
_SLOW_LOOPS: dict[str, Any] = {}
# The slow loop that this process compiles.
_OWN = "rovid.model.kernels.ekf3._filter"
# Calls with which this process compiles while it waits for the second process.
_MEANWHILE: deque[Callable[[], object]] = deque()
_STARTED: list[BackgroundCompiler] = []


def is_compiled() -> bool:
    """Whether machine code of all slow loops is on disk."""
    return can_cache() and all(map(is_cached, _SLOW_LOOPS.values()))


def start_compiling() -> bool:
    """Let a second process compile what is missing, if there is a second core; returns whether there is one.

    Without room for machine code there is none.
    """
    if not _STARTED and can_cache() and core_count() > 1 and sys.executable and not is_compiled():
        code = f"import {__name__} as warmup; warmup.compile_in_background()"
        with contextlib.suppress(OSError):
            _STARTED.append(BackgroundCompiler(code, _SLOW_LOOPS.keys() - {_OWN}))
            _MEANWHILE.extend((slow_calls()[_OWN], *quick_calls()))
    return bool(_STARTED)


def compile_all() -> None:
    """Compile all loops in this process, before others are started that would each do it."""
    for call in (*slow_calls().values(), *quick_calls()):
        call()


def warmed_up(loop: Function) -> Function:
    """Decorator of a slow loop: its first call waits until the second process, if there is one, has compiled it."""
    name = f"{loop.__module__}.{loop.__qualname__}"
    _SLOW_LOOPS[name] = loop

    @functools.wraps(loop)
    def once_compiled(*arguments: Any) -> Any:
        for compiler in _STARTED:
            while _MEANWHILE and not compiler.is_done(name):
                with contextlib.suppress(IndexError):
                    _MEANWHILE.popleft()()
            compiler.wait_for(name, _TIMEOUT)
        return loop(*arguments)

    return once_compiled  # type: ignore[return-value]  # has the signature of the loop


def compile_in_background() -> None:
    """In the second process: compile one loop after the other."""
    gc.disable()  # the process ends before memory matters
    report_done(name for name, call in slow_calls().items() if name != _OWN and call() is not None)


def quick_calls() -> list[Callable[[], object]]:
    """Minimal calls of the loops that are compiled quickly."""
    from rovid.effects import actuator_dynamics

    two = np.arange(2.0)
    held = [functools.partial(loop, two, two, *[1.0] * count) for loop, count in actuator_dynamics.LOOPS]
    return [*held, functools.partial(first_order_sum, two, 1.0)]


def slow_calls() -> dict[str, Callable[[], object]]:
    """Minimal calls of the slow loops by name, in the order in which a diagnosis needs them; with the usual types."""
    from rovid.model import kernels
    from rovid.model.bound_effects import pack_terms
    from rovid.model.filter_batch import FilterData, FilterInputs, ParameterBatch
    from rovid.model.torque_input import TorqueInput

    body, terms, torque = Body(1.0, 1.0, 1.0), pack_terms([], 1.0), TorqueInput.held(np.zeros(2))
    offsets, one, two = np.array([0, 2]), np.ones(1), np.arange(2.0)
    grid = torque.torque, torque.effect_inputs, two, two, np.zeros((2, 0))
    data = FilterData(offsets, two, two, one, np.ones((1, 2)), np.arange(4).reshape(2, 2), np.zeros((1, 0)))
    inputs = FilterInputs.stack([torque] * LANES, [two] * LANES)
    models = ParameterBatch(np.ones((5, LANES)), terms, np.ones((4, LANES)), np.ones((3, LANES)))
    restart = offsets[:1].copy(), offsets[1:].copy(), one
    calls: dict[str, Callable[[], object]] = {
        "multi_step._predict": lambda: kernels.predict_multi_step(one, *grid, *restart, body, terms),
        "multi_step._follow": lambda: kernels.effects_along(
            offsets, one, np.zeros((2, 3)), torque.effect_inputs, one, body, terms
        ),
        "ekf3._filter": lambda: kernels.ekf3_innovations(data, inputs, models),
        "ekf5._filter": lambda: kernels.ekf5_innovations(data, inputs, models),
    }
    return {f"{kernels.__name__}.{name}": call for name, call in calls.items()}
