"""Fisher scoring with Levenberg-Marquardt damping and bounds.

One step s from x solves the damped normal equations (docs/method.md, (13))

    (J_FF + lambda diag(J_FF)) s_F = -g_F,        s_i = 0 for i not in F,

with the gradient g and the Fisher information J of the negative log-likelihood at x, and the damping lambda of
Marquardt (1963). F is the set of free coordinates. A coordinate at a bound is not in F where -g, or the solved step,
points out of the bounds; such coordinates are removed and the system is solved again until none is left. The step is
shortened until no logarithmic coordinate changes by more than one. Then x + s is clipped to the bounds.

J is corrected by BFGS updates over the last steps (docs/method.md, (14); Nocedal and Wright 2006, equation 6.19), since
the Fisher information underestimates the curvature far from white innovations. lambda falls tenfold after a step whose
gain exceeds three quarters of the expected gain -(g's + s'Js/2), and rises tenfold after a smaller gain than 0.4 of it
(Nocedal and Wright 2006, section 10.3).
"""

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

# Steps, and the least gain of log-likelihood (nats) for which another step is taken.
ITERATIONS, TOLERANCE = 60, 0.01
# Damping lambda: of the first step, the least, and the largest that is tried.
_FIRST_DAMPING, _LEAST_DAMPING, _MAX_DAMPING = 1e-3, 1e-7, 1e6
# Factors on the damping after a poor and after a good step.
_MORE_DAMPING, _LESS_DAMPING = 10.0, 0.1
# Ratios of the actual to the expected gain above which a step is good and below which it is poor.
_GOOD_STEP, _POOR_STEP = 0.75, 0.4
# Largest change of a logarithmic coordinate in one step.
_MAX_LOG_CHANGE = 1.0
# Least ratio of the measured to the expected curvature for a BFGS update. Below it the difference is noise.
_LEAST_CURVATURE = 1e-3
# A goal is unreachable if this many steps like the last would not reach it.
_STEPS_TO_GOAL = 10.0
# Floor of the diagonal, relative to its largest element, which keeps coordinates without information solvable.
_FLOOR = 1e-12


class StopReason(Enum):
    """Why the optimiser stopped."""

    CONVERGED = "the gain still expected is below the tolerance"
    NO_PROGRESS = "no step reduces the objective although the gradient promises it"
    MAX_ITERATIONS = "the maximum number of steps was taken"
    GOAL_UNREACHABLE = "ten more steps like the last would not reach the goal"
    DIVERGED = "the model diverges, so there is no gradient"


@dataclass(frozen=True, eq=False)
class OptimizeResult:
    """Result of `minimize`."""

    x: FloatArray  #: (p,) coordinates.
    value: float  #: Negative log-likelihood there.
    stop_reason: StopReason
    remaining_gain: float  #: Upper estimate of the log-likelihood still to be gained.


@dataclass(eq=False)
class _Point:
    """Coordinates, their evaluations (None once used), the objective, and the damping of the next step."""

    x: FloatArray
    known: tuple[Innovations, list[Innovations]] | None
    value: float
    damping: float


def minimize(
    objective: NegativeLogLikelihood,
    start: FloatArray,
    *,
    iterations: int = ITERATIONS,
    tolerance: float = TOLERANCE,
    goal: float = math.inf,
) -> OptimizeResult:
    """Minimise the negative log-likelihood within its bounds, from (p,) ``start``; see the module for the algorithm.

    Stops when the expected gain falls below ``tolerance``, or when the value will not reach the ``goal``.
    """
    (here,) = _evaluate(objective, [np.clip(start, *objective.parametrization.bounds)], [_FIRST_DAMPING])
    stop_reason, gained, small_steps = StopReason.MAX_ITERATIONS, math.inf, 0
    # Points and gradients of the last steps.
    history: list[tuple[FloatArray, FloatArray]] = []
    for _ in range(iterations):
        gradient, information = NormalEquations.from_jacobians(objective.jacobian(here.x, here.known))
        # Evaluations of long logs take much memory and are not needed again.
        here.known = None
        if not np.isfinite(information).all():
            stop_reason = StopReason.DIVERGED
            break
        history = [*history, (here.x, gradient)][-objective.bfgs_pairs - 1 :]
        information = with_bfgs_updates(information, history)
        ahead = _step(objective, here, gradient, information, tolerance)
        if isinstance(ahead, StopReason):
            stop_reason = ahead
            break
        # One small gain of a poor or of a strongly damped step is no sign of an optimum.
        doubtful = ahead.damping > min(here.damping, _FIRST_DAMPING)
        gained, here = here.value - ahead.value, ahead
        small_steps = small_steps + 1 if gained < tolerance else 0
        if small_steps > doubtful:
            stop_reason = StopReason.CONVERGED
            break
        if here.value - goal > _STEPS_TO_GOAL * gained:
            stop_reason = StopReason.GOAL_UNREACHABLE
            break
    # The gain of a strongly damped step is no measure of the remaining gain.
    more = _STEPS_TO_GOAL * gained if here.damping <= _FIRST_DAMPING else math.inf
    stopped = {StopReason.CONVERGED: tolerance, StopReason.NO_PROGRESS: 0.0, StopReason.DIVERGED: 0.0}
    return OptimizeResult(here.x, here.value, stop_reason, stopped.get(stop_reason, more))


def _step(
    objective: NegativeLogLikelihood, here: _Point, gradient: FloatArray, information: FloatArray, tolerance: float
) -> _Point | StopReason:
    """The next point, or why no step is worth taking."""
    bounds, damping, count = objective.parametrization.bounds, here.damping, 1
    while damping < _MAX_DAMPING:
        dampings = [damping * _MORE_DAMPING**more for more in range(count)]
        steps = [_shortened(bounded_step(here.x, gradient, information, one, bounds)) for one in dampings]
        ahead = _evaluate(objective, [np.clip(here.x + step, *bounds) for step in steps], dampings)
        at = min(range(count), key=lambda at: ahead[at].value)
        best, linear_gains = ahead[at], [-float(gradient @ step) for step in steps]
        if best.value < here.value:
            expected = linear_gains[at] - 0.5 * float(steps[at] @ information @ steps[at])
            ratio = (here.value - best.value) / max(expected, 1e-300)
            return replace(best, damping=updated_damping(best.damping, ratio))
        if linear_gains[-1] < tolerance:
            return StopReason.CONVERGED
        # After a failure, as many dampings are tried as one SIMD pass evaluates.
        damping, count = dampings[-1] * _MORE_DAMPING, 1 + objective.simd_slots_left
    return StopReason.NO_PROGRESS


def _evaluate(
    objective: NegativeLogLikelihood, points: Sequence[FloatArray], dampings: Sequence[float]
) -> list[_Point]:
    """The points evaluated; a single point with as many derivatives as one SIMD pass evaluates."""
    if len(points) == 1:
        known = objective.evaluate_with_spare(points[0])
        return [_Point(points[0], known, objective.value_of(known[0]), dampings[0])]
    each = zip(points, objective.evaluate(points), dampings, strict=True)
    return [_Point(x, (here, []), objective.value_of(here), damping) for x, here, damping in each]


def _shortened(step: FloatArray) -> FloatArray:
    """(p,) ``step``, scaled down until no logarithmic coordinate changes by more than its limit."""
    longest = float(np.max(np.abs(step[LOGARITHMS])))
    return step * min(1.0, _MAX_LOG_CHANGE / max(longest, 1e-300))


def bounded_step(
    x: FloatArray, gradient: FloatArray, information: FloatArray, damping: float, bounds: tuple[FloatArray, FloatArray]
) -> FloatArray:
    """(p,) Levenberg-Marquardt step from ``x`` within lower and upper ``bounds``; docs/method.md, (13)."""
    free = ~_leaves_bounds(x, -gradient, bounds)
    step = np.zeros(len(x))
    size = np.diag(information)
    floor = _FLOOR * float(size.max()) + _FLOOR
    while free.any():
        part = np.ix_(free, free)
        matrix = information[part] + np.diag(damping * size[free] + floor)
        step[:] = 0.0
        step[free] = np.linalg.lstsq(matrix, -gradient[free], rcond=None)[0]
        # A coordinate at its bound that the coupled step moves outwards is fixed as well.
        out = free & _leaves_bounds(x, step, bounds)
        if not out.any():
            break
        free &= ~out
    return step


def _leaves_bounds(x: FloatArray, direction: FloatArray, bounds: tuple[FloatArray, FloatArray]) -> BoolArray:
    """(p,) whether each coordinate of ``x`` stands at a bound that the ``direction`` would leave."""
    low, high = bounds
    return np.asarray(((x <= low) & (direction < 0.0)) | ((x >= high) & (direction > 0.0)))


def updated_damping(damping: float, ratio: float) -> float:
    """Damping of the next step, from the ``ratio`` of the last step's gain to its expected gain."""
    if ratio > _GOOD_STEP:
        return max(damping * _LESS_DAMPING, _LEAST_DAMPING)
    if ratio < _POOR_STEP:
        return damping * _MORE_DAMPING
    return damping


def with_bfgs_updates(information: FloatArray, history: Sequence[tuple[FloatArray, FloatArray]]) -> FloatArray:
    """(p, p) ``information`` with a BFGS update for each step between the points and gradients of the ``history``.

    The update changes nothing where the information already predicts the change of the gradient; docs/method.md, (14).
    """
    matrix = information.copy()
    for (x, gradient), (next_x, next_gradient) in itertools.pairwise(history):
        step, change = next_x - x, next_gradient - gradient
        expected_change = matrix @ step
        measured, expected = float(step @ change), float(step @ expected_change)
        if measured > _LEAST_CURVATURE * expected > 0.0:
            matrix += np.outer(change, change) / measured - np.outer(expected_change, expected_change) / expected
    return matrix
