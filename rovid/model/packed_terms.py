"""A model's equation of motion, as compiled loops take it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.effects import TERM_EFFECTS, Effect
from rovid.effects.base import TERM_PARAMETERS, Body, Term
from rovid.jit.simd import LANES


class PackedTerms(NamedTuple):
    """Those that move the water stand first, then the others that remember, then the rest.

    Attributes
    ----------
    kinds
        (m,) index of each in ``rovid.effects.MOTION``.
    parameters
        (m * TERM_PARAMETERS, LANES) of each, one after the other; a column for each of several models side by side.
    fastest
        1/s; the fastest rate of their states.
    moving
        How many move the water: only once it is known how that moves can be said what drag there is.
    remembering
        How many there are down to the last that has states: whoever steps those need look no further.
    jumping
        Whether states of any jump.
    ringing
        Which one rings, or the first.
    """

    kinds: IntArray
    parameters: FloatArray
    fastest: float
    moving: int
    remembering: int
    jumping: bool
    ringing: int


class Equation(NamedTuple):
    """``inertia*rdot = torque - drag + terms``; ``start`` in rad or m is the position at the start of the trial.

    In compiled loops all numbers may be lanes, see `rovid.jit.simd`.
    """

    body: Body
    terms: PackedTerms
    start: float


def pack_terms(acting: Sequence[tuple[Effect, FloatArray]], fastest: float) -> PackedTerms:
    """Of effects with their parameters; ``fastest`` in 1/s is that of the motion itself."""
    rows = sorted(
        ((effect, effect.acts, numbers) for effect, numbers in acting if isinstance(effect.acts, Term)),
        key=lambda row: (row[1].entrained_rate is None, not row[1].states),
    )
    parameters = np.zeros((len(rows) * TERM_PARAMETERS, LANES))
    remembering = ringing = 0
    for at, (effect, term, numbers) in enumerate(rows):
        first = TERM_PARAMETERS * at
        parameters[first : first + len(numbers)] = numbers[:, np.newaxis]
        if term.states:
            remembering = at + 1
        if term.oscillatory:
            ringing = at
        if term.fastest is not None:
            fastest = max(fastest, term.fastest(effect.values(numbers)))
    return PackedTerms(
        kinds=np.array([TERM_EFFECTS.index(effect) for effect, _, _ in rows], dtype=np.int64),
        parameters=parameters,
        fastest=fastest,
        moving=sum(term.entrained_rate is not None for _, term, _ in rows),
        remembering=remembering,
        jumping=any(term.reset is not None for _, term, _ in rows),
        ringing=ringing,
    )


def stack_terms(every: Sequence[PackedTerms]) -> PackedTerms:
    """The same terms of several models side by side, a column of the parameters for each."""
    return every[0]._replace(
        parameters=np.column_stack([terms.parameters[:, 0] for terms in every]),
        fastest=max(terms.fastest for terms in every),
    )
