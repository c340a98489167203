"""Forms of effects outside the catalogue's list: further terms, and sizes of their own in some trials.

A further term is compiled alone, and called by the compiled loops through its address. A form with another size in each
trial, or in one trial alone, names the trials. Parts of a trial, cut for validation, have the size of that trial, their
`TrialRows.parent`.
"""

import functools
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numba
import numpy as np
from numba import carray  # type: ignore[attr-defined]  # as above

from rovid.core.array_types import FloatArray
from rovid.effects.base import ActuatorInputs, Body, Effect, EffectParameter, Instant, Term
from rovid.jit.decorators import FUNCTIONS, RESULTS, SIGNATURE, compiled
from rovid.jit.simd import LANES, broadcast, traced

# mypy: allow-untyped-calls, allow-untyped-decorators


# Numbers in `flattened`.
_COUNT = 19
# Address of its function -> effect.
_EFFECTS: dict[int, Effect] = {}
_ONE, _SEVERAL, _SEPARATOR = "trial ", "trials ", "|"


@traced
def flattened(at: Any, p: Any, x: Any) -> Any:
    """Tuple of vectors: the instant with the plain model at its end, the parameters and the states."""
    return (
        broadcast(at.rate),
        broadcast(at.relative_rate),
        broadcast(at.angle),
        broadcast(at.start),
        broadcast(at.thruster_torque),
        broadcast(at.wash),
        broadcast(at.surge),
        broadcast(at.sway),
        broadcast(at.body.inertia),
        broadcast(at.body.quadratic_drag),
        broadcast(at.body.linear_drag),
        broadcast(at.body.stiffness),
        broadcast(at.body.trim),
        broadcast(p[0]),
        broadcast(p[1]),
        broadcast(p[2]),
        broadcast(p[3]),
        broadcast(x[0]),
        broadcast(x[1]),
    )


@functools.cache
def address_of(effect: Effect) -> int:
    """Address of the compiled term of ``effect``, which the compiled loops take for its kind.

    Raises numba.errors.NumbaError if the term cannot be compiled.
    """
    term = effect.acts
    assert isinstance(term, Term)  # noqa: S101 - only terms are compiled
    if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]  # numba ships no types
        address = id(effect)
        FUNCTIONS[address] = functools.partial(_lane_by_lane, term)
    else:
        function = _compiled(term)
        address = int(function.address)
        FUNCTIONS[address] = function
    _EFFECTS[address] = effect
    return address


def effect_at(address: int) -> Effect:
    """The effect with this address."""
    return _EFFECTS[address]


def _compiled(term: Term) -> Any:
    function = term.torque if hasattr(term.torque, "py_func") else compiled(term.torque)
    states = term.states

    @numba.njit(error_model="numpy")
    def of_lane(n: Any, i: int) -> Any:
        body = Body(n[8, i], n[9, i], n[10, i], n[11, i], n[12, i])
        at = Instant(n[0, i], n[1, i], n[2, i], n[3, i], n[4, i], n[5, i], n[6, i], n[7, i], body)
        p, x = (n[13, i], n[14, i], n[15, i], n[16, i]), (n[17, i], n[18, i])
        if states == 0:
            return float(function(at, p)), 0.0, 0.0
        if states == 1:
            torque, first = function(at, p, x)
            return float(torque), float(first), 0.0
        torque, first, second = function(at, p, x)
        return float(torque), float(first), float(second)

    @numba.cfunc(SIGNATURE, error_model="numpy")
    def of_lanes(numbers: Any, results: Any) -> None:
        n, found = carray(numbers, (_COUNT, LANES)), carray(results, (RESULTS, LANES))
        for i in range(LANES):
            found[0, i], found[1, i], found[2, i] = of_lane(n, i)

    return of_lanes


def _lane_by_lane(term: Term, numbers: Any) -> Any:
    """`RESULTS` vectors of ``term`` without compilation."""
    found = np.zeros((RESULTS, LANES))
    for lane, n in enumerate(np.array(numbers).T.tolist()):
        at = Instant._make((*n[:8], Body._make(n[8:13])))
        torque, derivatives = term.evaluate(at, tuple(n[13:17]), tuple(n[17:]))
        found[: 1 + len(derivatives), lane] = torque, *derivatives
    return tuple(found)


def form_name(names: Sequence[str]) -> str:
    """Name of the form for trials with these ``names``."""
    return (_ONE if len(names) == 1 else _SEVERAL) + _SEPARATOR.join(names)


def trials_in_form(form: str) -> tuple[str, ...]:
    """Names of the trials in the name of a ``form``; empty for other forms."""
    if form.startswith(_ONE):
        return (form.removeprefix(_ONE),)
    if form.startswith(_SEVERAL):
        return tuple(form.removeprefix(_SEVERAL).split(_SEPARATOR))
    return ()


def one_size_per_trial(size: EffectParameter, count: int, start: float) -> tuple[EffectParameter, ...]:
    """``count`` parameters like ``size``. Each has one initial value ``start``, with the other parameters neutral."""
    parameters = []
    for own in range(count):
        initial_values = [size.neutral] * count
        initial_values[own] = start
        parameters.append(replace(size, name=f"{size.name}_{own + 1}", initial_values=tuple(initial_values)))
    return tuple(parameters)


def held_sizes(inputs: ActuatorInputs, names: Sequence[str], sizes: Sequence[float], otherwise: float) -> FloatArray:
    """(n,) size in the trial of each instant; ``otherwise`` in trials that are not among ``names``."""
    by_name = dict(zip(names, sizes, strict=True))
    series = np.full(len(inputs.time), otherwise)
    for trial in inputs.trials:
        series[trial.rows] = by_name.get(trial.parent, otherwise)
    return series
