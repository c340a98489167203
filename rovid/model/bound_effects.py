"""Effects with parameter values, and as the arrays that compiled loops read."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple, TypeVar

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.effects import Effect, term_effect, term_kind
from rovid.effects.base import TERM_PARAMETERS, TERM_STATES, Body, Term, Values
from rovid.jit.simd import LANES

Action = TypeVar("Action")


class BoundEffect(NamedTuple):
    """An effect with its (p,) parameter values in SI, in the order of the effect's parameters."""

    effect: Effect
    parameters: FloatArray

    @property
    def values(self) -> Values:
        """Parameter values by name."""
        return self.effect.values(self.parameters)


def effects_at(effects: Sequence[BoundEffect], stage: type[Action]) -> Iterator[tuple[BoundEffect, Action]]:
    """Effects acting at ``stage``, a class of `rovid.effects.base`, each with its action there."""
    for one in effects:
        if isinstance(one.effect.acts, stage):
            yield one, one.effect.acts


def actions_at(effects: Sequence[BoundEffect], stage: type[Action]) -> Iterator[tuple[Action, Values]]:
    """Actions at ``stage``, each with the parameter values of its effect."""
    return ((action, one.values) for one, action in effects_at(effects, stage))


class PackedTerms(NamedTuple):
    """The m terms of an equation of motion: terms that entrain water first, then others with states, then the rest."""

    kinds: IntArray  #: (m,) kind of each term, see `rovid.effects.term_kind`.
    #: (m * TERM_PARAMETERS, LANES) parameters of one term after the other, with a column for each of several models.
    parameters: FloatArray
    fastest: float  #: 1/s; the fastest rate of change among the states and the motion.
    #: Number of terms that entrain water. Drag in all terms depends on the rate relative to that water.
    entraining: int
    stateful: int  #: Number of terms up to the last one with states.
    resetting: bool  #: Whether a term resets its state.
    oscillatory: int  #: Index of the oscillatory term, 0 if there is none.


def term_values(terms: PackedTerms) -> list[tuple[Term, Values]]:
    """Each of the terms of one model with the parameter values of its effect."""
    found: list[tuple[Term, Values]] = []
    for at, kind in enumerate(terms.kinds.tolist()):
        effect, first = term_effect(kind), TERM_PARAMETERS * at
        assert isinstance(effect.acts, Term)  # noqa: S101 - all of them are
        found.append((effect.acts, effect.values(terms.parameters[first : first + len(effect.parameters), 0])))
    return found


def unknown_states(terms: PackedTerms, rate: float, acceleration: float) -> list[tuple[int, float]]:
    """Index and standard deviation of each state of water or tether at the first sample of a log that begins in motion.

    ``rate``, ``acceleration``: Size of the motion in rad/s and rad/s^2, see `Term.unknown_start`.
    """
    return [
        (TERM_STATES * at + state, std)
        for at, (term, values) in enumerate(term_values(terms))
        if term.unknown_start is not None
        for state, std in enumerate(term.unknown_start(values, rate, acceleration))
    ]


class Equation(NamedTuple):
    """``inertia*rdot = torque - drag + terms``; ``start`` is the position in rad or m at the start of the trial.

    In compiled loops the numbers may be vectors, see `rovid.jit.simd`.
    """

    body: Body
    terms: PackedTerms
    start: float


def pack_terms(effects: Sequence[tuple[Effect, FloatArray]], fastest: float, inertia: float = math.inf) -> PackedTerms:
    """Pack effects with their parameters; ``fastest`` in 1/s is the rate of the motion itself.

    Water that is heavy against the ``inertia`` in kg m^2 or kg makes the motion follow it faster than it follows alone.
    """
    rows = sorted(
        ((effect, effect.acts, numbers) for effect, numbers in effects if isinstance(effect.acts, Term)),
        key=lambda row: (row[1].entrained_rate is None, not row[1].states),
    )
    parameters = np.zeros((len(rows) * TERM_PARAMETERS, LANES))
    stateful = oscillatory = 0
    for at, (effect, term, numbers) in enumerate(rows):
        first = TERM_PARAMETERS * at
        parameters[first : first + len(numbers)] = numbers[:, np.newaxis]
        if term.states:
            stateful = at + 1
        if term.oscillatory:
            oscillatory = at
        if term.fastest is not None:
            values = effect.values(numbers)
            added = term.added_inertia(values) if term.added_inertia else 0.0
            fastest = max(fastest, term.fastest(values) * (1.0 + max(added, 0.0) / inertia))
    return PackedTerms(
        kinds=np.array([term_kind(effect) for effect, _, _ in rows], dtype=np.int64),
        parameters=parameters,
        fastest=fastest,
        entraining=sum(term.entrained_rate is not None for _, term, _ in rows),
        stateful=stateful,
        resetting=any(term.reset is not None for _, term, _ in rows),
        oscillatory=oscillatory,
    )


def stack_terms(terms: Sequence[PackedTerms]) -> PackedTerms:
    """The same terms of several models: a column of parameters for each model."""
    return terms[0]._replace(
        parameters=np.column_stack([one.parameters[:, 0] for one in terms]), fastest=max(one.fastest for one in terms)
    )
