"""How to climb a likelihood: Fisher scoring with Levenberg-Marquardt steps, within bounds."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray
from rovid.estimate.fisher_information import Innovations, NormalEquations
from rovid.estimate.parametrization import LOGARITHMS

if TYPE_CHECKING:
    from rovid.estimate.objective import NegativeLogLikelihood

ITERATIONS, TOLERANCE = 60, 0.01
# Share of the information's diagonal that is added to it (Marquardt): at first, at least, and where a step is given up.
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-3, 1e-7, 1e6
# So many times as much after a step that failed or gained little, and after one that gained what it promised.
_MORE_DAMPING, _LESS_DAMPING = 10.0, 0.1
# What a step gains, by what was expected of it: above the one the slopes are believed more, below the other less.
_AS_PROMISED, _TOO_LITTLE = 0.75, 0.4
# No step changes a logarithm by more: far from the top the slopes promise too much.
_LONGEST = 1.0
# Curvature of less than this share of the promised is noise of the slopes.
_LEAST_CURVATURE = 1e-3
# A goal that so many steps like the last would not reach is out of reach.
_OUT_OF_REACH = 10.0
# Even a coordinate along which nothing changes has to be solved for: by this share of the largest.
_FLOOR = 1e-12


class StopReason(Enum):
    """Why a climb ended."""

    CONVERGED = "no more than the tolerance is left to gain"
    NO_PROGRESS = "no step gains anything, though the slopes promise it"
    MAX_ITERATIONS = "as many steps as were allowed were taken"
    GOAL_UNREACHABLE = "so much is lacking to a goal that many such steps would not reach it"
    DIVERGED = "the model runs away: there are no slopes"


@dataclass(frozen=True, eq=False)
class OptimizeResult:
    """Where a climb ended and why.

    Attributes
    ----------
    x
        (p,) coordinates.
    cost
        Negative log-likelihood there.
    left
        So much of it at most is taken to be still to be gained from there on.
    """

    x: FloatArray
    value: float
    stop_reason: StopReason
    remaining_gain: float


@dataclass(eq=False)
class _Point:
    """Coordinates with what is known there, and the damping of the step from there."""

    x: FloatArray
    known: tuple[Innovations, list[Innovations]] | None
    cost: float
    damping: float

    @classmethod
    def at(cls, misfit: NegativeLogLikelihood, x: FloatArray, damping: float) -> _Point:
        known = misfit.evaluate_with_spare(x)
        return cls(x, known, misfit.value_of(known[0]), damping)


def minimize(
    misfit: NegativeLogLikelihood,
    start: FloatArray,
    *,
    iterations: int = ITERATIONS,
    tolerance: float = TOLERANCE,
    goal: float = math.inf,
) -> OptimizeResult:
    """Most likely coordinates from (p,) ``start``, by Fisher scoring within the bounds.

    Ends when less than ``tolerance`` of log-likelihood is still to be gained, or where the cost will not come down to
    the ``goal``.
    """
    bounds = misfit.parametrization.bounds
    here, end = _Point.at(misfit, np.clip(start, *bounds), _FIRST_DAMPING), StopReason.MAX_ITERATIONS
    gained = math.inf
    # Points and gradients of before.
    been: list[tuple[FloatArray, FloatArray]] = []
    for _ in range(iterations):
        gradient, information = NormalEquations.from_jacobians(misfit.jacobian(here.x, here.known))
        # Of long logs it takes much, and has served.
        here.known = None
        if not np.isfinite(information).all():
            end = StopReason.DIVERGED
            break
        been = [*been, (here.x, gradient)][-misfit.bfgs_pairs - 1 :]
        information = with_bfgs_updates(information, been)
        ahead = _step(misfit, here, gradient, information, tolerance)
        if isinstance(ahead, StopReason):
            end = ahead
            break
        gained, here = here.cost - ahead.cost, ahead
        if gained < tolerance:
            end = StopReason.CONVERGED
            break
        if here.cost - goal > _OUT_OF_REACH * gained:
            end = StopReason.GOAL_UNREACHABLE
            break
    # Where no step gained anything or there were no slopes, none will; and short steps tell little of what is left.
    more = _OUT_OF_REACH * gained if here.damping <= _FIRST_DAMPING else math.inf
    left = {StopReason.CONVERGED: tolerance, StopReason.NO_PROGRESS: 0.0, StopReason.DIVERGED: 0.0}.get(end, more)
    return OptimizeResult(here.x, here.cost, end, left)


def _step(
    misfit: NegativeLogLikelihood, here: _Point, gradient: FloatArray, information: FloatArray, tolerance: float
) -> _Point | StopReason:
    """A point that costs less; where no step is worth it, why the climb ends."""
    bounds, damping, count = misfit.parametrization.bounds, here.damping, 1
    while damping < _MOST_DAMPING:
        dampings = [damping * _MORE_DAMPING**more for more in range(count)]
        steps = [_shortened(bounded_step(here.x, gradient, information, one, bounds)) for one in dampings]
        ahead = _points(misfit, [np.clip(here.x + step, *bounds) for step in steps], dampings)
        at = min(range(count), key=lambda at: ahead[at].cost)
        best, promised = ahead[at], [-float(gradient @ step) for step in steps]
        if best.cost < here.cost:
            expected = promised[at] - 0.5 * float(steps[at] @ information @ steps[at])
            ratio = (here.cost - best.cost) / max(expected, 1e-300)
            return replace(best, damping=updated_damping(best.damping, ratio))
        if promised[-1] < tolerance:
            return StopReason.CONVERGED
        # Several steps are tried at once where they come free with one.
        damping, count = dampings[-1] * _MORE_DAMPING, 1 + misfit.simd_slots_left
    return StopReason.NO_PROGRESS


def _points(misfit: NegativeLogLikelihood, every: Sequence[FloatArray], dampings: Sequence[float]) -> list[_Point]:
    """The one with all that comes free with it; of several their innovations alone are known."""
    if len(every) == 1:
        return [_Point.at(misfit, every[0], dampings[0])]
    each = zip(every, misfit.evaluate(every), dampings, strict=True)
    return [_Point(x, (here, []), misfit.value_of(here), damping) for x, here, damping in each]


def _shortened(step: FloatArray) -> FloatArray:
    """(p,) ``step``, its share that changes no logarithm by more than is trusted."""
    longest = float(np.max(np.abs(step[LOGARITHMS])))
    return step * min(1.0, _LONGEST / max(longest, 1e-300))


def bounded_step(
    x: FloatArray,
    gradient: FloatArray,
    information: FloatArray,
    damping: float,
    bounds: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """Levenberg-Marquardt step from ``x``; coordinates that would leave their lower and upper ``bounds`` stay."""
    free = ~_outward(x, -gradient, bounds)
    step = np.zeros(len(x))
    size = np.diag(information)
    floor = _FLOOR * float(size.max()) + _FLOOR
    for _ in range(len(x)):
        if not free.any():
            break
        part = np.ix_(free, free)
        matrix = information[part] + np.diag(damping * size[free] + floor)
        step[:] = 0.0
        step[free] = np.linalg.lstsq(matrix, -gradient[free], rcond=None)[0]
        # A coordinate at its bound that the others press outward is held there too.
        out = free & _outward(x, step, bounds)
        if not out.any():
            break
        free &= ~out
    return step


def _outward(x: FloatArray, way: FloatArray, bounds: tuple[FloatArray, FloatArray]) -> BoolArray:
    """(p,) which coordinates of ``x`` stand at a bound that they would leave this ``way``."""
    low, high = bounds
    return np.asarray(((x <= low) & (way < 0.0)) | ((x >= high) & (way > 0.0)))


def updated_damping(damping: float, ratio: float) -> float:
    """Damping of the next step, by the ``ratio`` of what the last one gained to what was expected of it."""
    if ratio > _AS_PROMISED:
        return max(damping * _LESS_DAMPING, _LEAST_DAMPING)
    if ratio < _TOO_LITTLE:
        return damping * _MORE_DAMPING
    return damping


def with_bfgs_updates(information: FloatArray, been: Sequence[tuple[FloatArray, FloatArray]]) -> FloatArray:
    """``information`` with the curvature between the points and gradients of before, last of all the latest.

    Far from white innovations the information promises too little of it, and scoring alone crawls. It is told by
    differences of gradients (BFGS: Nocedal & Wright 2006, section 6.1), which change nothing where it is right.
    """
    matrix = information.copy()
    for (x, gradient), (following, slope) in itertools.pairwise(been):
        step, change = following - x, slope - gradient
        expected = matrix @ step
        met, promised = float(step @ change), float(step @ expected)
        if met > _LEAST_CURVATURE * promised > 0.0:
            matrix += np.outer(change, change) / met - np.outer(expected, expected) / promised
    return matrix
