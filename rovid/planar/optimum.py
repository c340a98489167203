"""A fitted planar model: optimisation, nested fits with effects, and covariance.

A chord fit takes steps with one Jacobian, which is corrected by Broyden's update.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray, IntArray
from rovid.core.errors import DataError
from rovid.core.threads import thread_map
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects import Effect
from rovid.estimate.estimate import Estimate
from rovid.estimate.fisher_information import (
    OUTLIER,
    Innovations,
    NormalEquations,
    grouped_scores,
    inverse_of_triangle,
    is_white,
    sandwich_covariance,
)
from rovid.estimate.levenberg_marquardt import bounded_step, updated_damping, with_bfgs_updates
from rovid.estimate.maximum_likelihood import DISTURBANCE_LIMITS, REAL_DISTURBANCE_LIMIT
from rovid.planar.coordinates import PlanarCoordinates
from rovid.planar.likelihood import PlanarLikelihood, stacked
from rovid.planar.model import SENSORS, PlanarModel

# Steps, least gain of log-likelihood (nats) for which another step is taken, and the damping: first, largest, factor.
_ITERATIONS, _TOLERANCE = 40, 0.02
_FIRST_DAMPING, _MAX_DAMPING, _MORE_DAMPING = 1e-3, 1e7, 10.0
# Dampings that are tried at once, and largest change of a coordinate in one step, in units of its scale.
_AT_ONCE, _MAX_CHANGE = 2, 1.0
_BFGS_PAIRS = 8
# Most steps without a Jacobian of their own after each step with one: each takes one pass of the filter. Where they
# gain less than this share of that step, the next one has none: their share of the passes.
_CHORDS, _CHORD_SHARE = 5, 0.25
# Starts of an effect that are followed for some steps.
_CONTINUED = 3
# Length of a block in time constants, usual number of blocks in all runs, and the least number.
_BLOCK, _USUAL_BLOCKS, _BLOCKS = 8.0, 60, 12
_MIN_RUNS = 3
# Most steps of a chord fit, and its largest damping.
CHORD_STEPS, _MAX_CHORD_DAMPING = 14, 1e4


@dataclass(frozen=True, eq=False)
class PlanarOptimum:
    """Coordinates with the least negative log-likelihood."""

    likelihood: PlanarLikelihood
    x: FloatArray  #: (p,)
    value: float  #: Negative log-likelihood.
    #: (q,) parameters in SI of the likeliest model, of a fit of free runs that simulates better than this model.
    likeliest: FloatArray | None = None

    @classmethod
    def fit(cls, likelihood: PlanarLikelihood, start: FloatArray, iterations: int = _ITERATIONS) -> Self:
        """Minimise from (p,) ``start`` by Fisher scoring; `rovid.estimate.levenberg_marquardt` explains the step."""
        coordinates = likelihood.coordinates
        x = coordinates.projected(start)
        innovations = likelihood.evaluate(x)
        value, damping = likelihood.value_of(innovations), _FIRST_DAMPING
        history: list[tuple[FloatArray, FloatArray]] = []
        small, with_chords = 0, True
        for _ in range(iterations):
            free, pieces = likelihood.jacobian(x, innovations)
            gradient, information = likelihood.equations_of(free, pieces)
            # A model that diverges has no gradient, or one whose squares overflow.
            with np.errstate(over="ignore", invalid="ignore"):
                if not (np.isfinite(information @ information).all() and np.isfinite(gradient).all()):
                    break
            history = [*history, (x, gradient)][-_BFGS_PAIRS - 1 :]
            corrected = with_bfgs_updates(information, history)
            if not np.isfinite(corrected).all():
                corrected = information
            found = _step(likelihood, x, value, gradient, corrected, damping)
            if found is None:
                break
            gain = value - found[1]
            small = small + 1 if gain < _TOLERANCE else 0
            x, value, damping, innovations = found
            # After a small gain by a nearly undamped step that was as good as expected, the next gain is far smaller.
            if small > 1 or (small and damping < _FIRST_DAMPING):
                break
            if not with_chords:
                with_chords = True
                continue
            chord = chord_fit(likelihood, x, stacked(free, pieces, len(innovations.error)), steps=_CHORDS)
            with_chords = value - chord.value > _CHORD_SHARE * gain
            if chord.value < value:
                x, value, innovations = chord.x, chord.value, likelihood.evaluate(chord.x)
        return cls(likelihood, x, value)

    @property
    def coordinates(self) -> PlanarCoordinates:
        """The coordinates of ``x``."""
        return self.likelihood.coordinates

    @property
    def is_multi_step(self) -> bool:
        """Whether free-running simulations were fitted, and not the innovations."""
        return self.likelihood.free_runs is not None

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The effects, in the order of their parameters."""
        return self.coordinates.effects

    @cached_property
    def model(self) -> PlanarModel:
        """The model in SI."""
        return self.coordinates.model(self.x)

    def canonical(self) -> Self:
        """The same model with a current of 0 or more."""
        x = self.coordinates.canonical(self.x)
        return self if np.array_equal(x, self.x) else replace(self, x=x)

    @cached_property
    def is_white(self) -> bool:
        """Whether the normalised innovations of each sensor and run are white and without heavy tails."""
        error, variance = self.likelihood.evaluate(self.x)
        z, (run, _, sensor) = error / np.sqrt(variance), self.likelihood.rows
        for number in range(len(SENSORS)):
            own = [z[(run == at) & (sensor == number)] for at in np.unique(run)]
            if sum(map(len, own)) > 0 and not is_white(own):
                return False
        return True

    @property
    def limited(self) -> BoolArray:
        """(3,) whether the disturbance of each axis is at its upper limit."""
        first = self.coordinates.noise_begin
        own = slice(first, first + 3)
        return np.asarray((self.x[own] > self.coordinates.high[own] - 1e-3) & self.coordinates.free[own])

    def loosened(self, *, held: bool = False) -> Self:
        """The fit under the limit of a disturbance that makes a model with effects adequate; model ``held`` or not."""
        coordinates, more = self.coordinates, math.log(REAL_DISTURBANCE_LIMIT / DISTURBANCE_LIMITS[0])
        first = coordinates.noise_begin
        axes = [at for at in range(first, first + 3) if coordinates.free[at]]
        limits = {at: (coordinates.low[at], coordinates.high[at] + more) for at in axes}
        limits |= {at: (self.x[at], self.x[at]) for at in range(first if held else 0)}
        return type(self).fit(self.likelihood.with_coordinates(coordinates.bounded(limits)), self.x)

    def blocks(self) -> IntArray:
        """(N,) number of the block of each innovation: eight time constants or longer, less in short runs."""
        grid, (run, time, _) = self.likelihood.grid, self.likelihood.rows
        total = sum(one.duration for one in grid.runs)
        usual = float(np.max(self.coordinates.sizes.time[2:] if grid.yaw_only else self.coordinates.sizes.time))
        seconds = min(max(_BLOCK * usual, total / _USUAL_BLOCKS), total / _BLOCKS)
        longest = int(max(one.duration for one in grid.runs) / seconds) + 2
        return np.asarray(run * longest + np.floor(time / seconds).astype(np.intp))

    @property
    def equations(self) -> NormalEquations:
        """Gradient and Fisher information."""
        return self._curvature[0]

    @property
    def coordinate_covariance(self) -> FloatArray:
        """(p, p) of the coordinates: inverse information, or the sandwich of blocks where innovations are not white."""
        return self._curvature[1]

    @cached_property
    def _curvature(self) -> tuple[NormalEquations, FloatArray]:
        """`equations` and `coordinate_covariance`, by one Jacobian."""
        free, pieces = self.likelihood.jacobian(self.x)
        equations = self.likelihood.equations_of(free, pieces)
        groupings = [] if self.is_white else [self.blocks(), self.likelihood.rows.run]
        triangle, scores = grouped_scores(pieces, groupings)
        full = np.zeros((len(self.x), len(self.x)))
        if not math.isfinite(np.linalg.norm(triangle)):
            full[np.ix_(free, free)] = np.diag(np.full(int(free.sum()), math.inf))
            return equations, full
        plain = covariance = inverse_of_triangle(triangle)
        if scores:
            by_prior: FloatArray | float = 0.0
            if self.likelihood.rows.run[-1] < 0:
                # The first group is that of the priors, which do not scatter like the logs.
                scores = [one[1:] for one in scores]
            if (prior := self.likelihood.grid.prior) is not None:
                own = prior.jacobian(self.coordinates, self.x)[:, free] @ plain
                by_prior = own.T @ own
            covariance = sandwich_covariance(plain, scores[0]) + by_prior
            if len(scores[1]) >= _MIN_RUNS:
                by_run = np.diag(sandwich_covariance(plain, scores[1]) + by_prior)
                factor = np.sqrt(np.maximum(by_run / np.maximum(np.diag(covariance), 1e-300), 1.0))
                covariance = covariance * np.outer(factor, factor)
            # Few blocks scatter too little by chance; the curvature is what independent innovations give at least.
            grow = np.sqrt(np.maximum(np.diag(plain) / np.maximum(np.diag(covariance), 1e-300), 1.0))
            covariance = covariance * np.outer(grow, grow)
        full[np.ix_(free, free)] = covariance
        return equations, full

    @cached_property
    def covariance(self) -> FloatArray:
        """(q, q) of the model parameters in SI."""
        jacobian, count = self.coordinates.value_jacobian(self.x), self.coordinates.noise_begin
        return np.asarray(jacobian @ self.coordinate_covariance[:count, :count] @ jacobian.T)

    def effect_estimate(self, effect: Effect) -> Estimate:
        """The parameters of one of the effects."""
        at = [self.model.names.index(name) for name in effect.parameter_names]
        values, covariance = self.model.values[at], self.covariance[np.ix_(at, at)]
        samples = int(self.likelihood.grid.used.sum())
        return Estimate(names=effect.parameter_names, values=values, covariance=covariance, method="", samples=samples)

    def place(self, effect: Effect) -> slice:
        """Places of the parameters of one of the effects among the coordinates."""
        before = itertools.takewhile(lambda one: one.key != effect.key, self.effects)
        begin = self.coordinates.effects_begin + sum(len(one.parameters) for one in before)
        return slice(begin, begin + len(effect.parameters))

    def is_at_bound(self, effect: Effect) -> bool:
        """Whether a parameter of ``effect`` is at a bound that is not its neutral value."""
        for value, parameter in zip(self.x[self.place(effect)].tolist(), effect.parameters, strict=True):
            span = 1e-3 * (parameter.high - parameter.low)
            for bound in (parameter.low, parameter.high):
                if abs(value - bound) <= min(span, 1e-3 * max(abs(bound), 1e-3)) and bound != parameter.neutral:
                    return True
        return False

    def with_effect(self, effect: Effect, further: Sequence[FloatArray] = (), iterations: int = _ITERATIONS) -> Self:
        """The best fit with one more effect, from each of its initial values and from ``further`` coordinates."""
        coordinates = self.coordinates.with_effect(effect)
        likelihood = self.likelihood.with_coordinates(coordinates)
        at = self.coordinates.noise_begin
        starts = [np.concatenate((self.x[:at], own, self.x[at:])) for own in effect.initial_values]
        if effect.initial_values:
            nested = neutral_values(effect, effect.initial_values[0])
            starts.append(np.concatenate((self.x[:at], nested, self.x[at:])))
        starts = [coordinates.projected(start) for start in (*starts, *further)]
        first = starts[0]
        if len(starts) > 1:
            # A few steps from each start tell which valley is deepest.
            order = np.argsort(likelihood.values(starts))[:_CONTINUED]
            tried = [type(self).fit(likelihood, starts[number], iterations=3) for number in order.tolist()]
            first = min(tried, key=lambda one: one.value).x
        return type(self).fit(likelihood, first, iterations)


def _step(
    likelihood: PlanarLikelihood,
    x: FloatArray,
    value: float,
    gradient: FloatArray,
    information: FloatArray,
    damping: float,
) -> tuple[FloatArray, float, float, Innovations] | None:
    """Next point, its value, damping and innovations; None where no step is worth taking."""
    coordinates = likelihood.coordinates
    while damping < _MAX_DAMPING:
        dampings = [damping * _MORE_DAMPING**more for more in range(_AT_ONCE)]
        steps = [bounded_step(x, gradient, information, one, coordinates.bounds) for one in dampings]
        steps = [step * min(1.0, _MAX_CHANGE / max(float(np.abs(step).max()), 1e-300)) for step in steps]
        points = [coordinates.projected(x + step) for step in steps]
        found = thread_map(likelihood.evaluate, points)
        values = [likelihood.value_of(one) for one in found]
        at = int(np.argmin(values))
        if values[at] < value:
            expected = -float(gradient @ steps[at]) - 0.5 * float(steps[at] @ information @ steps[at])
            ratio = (value - values[at]) / max(expected, 1e-300)
            return points[at], values[at], updated_damping(dampings[at], ratio), found[at]
        if -float(gradient @ steps[-1]) < _TOLERANCE:
            return None
        damping = dampings[-1] * _MORE_DAMPING
    return None


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Residuals of a model and their derivatives, in place of a complete Jacobian at each step of a fit."""

    optimum: PlanarOptimum
    innovations: Innovations
    matrix: FloatArray  #: (2N, p) derivatives of `residual_of` to first order; zero for fixed coordinates.

    @classmethod
    def of(cls, optimum: PlanarOptimum) -> Self:
        """The linearisation at the ``optimum``.

        Raises
        ------
        DataError
            The filter diverges next to the optimum, so that there are no derivatives.
        """
        centre = optimum.likelihood.evaluate(optimum.x)
        free, pieces = optimum.likelihood.jacobian(optimum.x, centre)
        matrix = stacked(free, pieces, len(centre.error))
        if not np.isfinite(matrix).all():
            text = "the coupled model fits these logs so badly that causes cannot be tested: the filter diverges."
            raise DataError(text, mend="Run `rovid check --axes planar`, and `rovid diagnose` for yaw alone.")
        return cls(optimum, centre, matrix)


def residual_of(here: Innovations) -> FloatArray:
    """(2N,) normalised innovations with Huber's limit, and variance residuals; see `Jacobian`."""
    z = here.error / np.sqrt(here.variance)
    limited = np.clip(z, -OUTLIER, OUTLIER)
    return np.concatenate((limited, (1.0 - limited * z) / math.sqrt(2.0)))


def change_between(here: Innovations, there: Innovations) -> FloatArray:
    """(2N,) change of the innovations and of their variances, in the units of `residual_of`."""
    root = np.sqrt(here.variance)
    weight = np.sqrt(np.minimum(1.0, OUTLIER / np.maximum(np.abs(here.error / root), 1e-300)))
    with np.errstate(over="ignore", invalid="ignore"):
        error = (there.error - here.error) / root * weight
        variance = (there.variance - here.variance) / (math.sqrt(2.0) * here.variance)
    return np.nan_to_num(np.concatenate((error, variance)), nan=0.0, posinf=1e12, neginf=-1e12)


def chord_fit(
    likelihood: PlanarLikelihood,
    x: FloatArray,
    matrix: FloatArray,
    rows: BoolArray | None = None,
    steps: int = CHORD_STEPS,
) -> PlanarOptimum:
    """Minimum of the negative log-likelihood near ``x``, by steps with the (2N, p) ``matrix`` of derivatives.

    ``rows`` are the innovations that count; ``matrix`` is changed.
    """
    coordinates = likelihood.coordinates
    one: BoolArray | slice = slice(None) if rows is None else rows
    two: BoolArray | slice = slice(None) if rows is None else np.concatenate((rows, rows))

    def value_of(innovations: Innovations) -> float:
        return likelihood.value_of(Innovations(innovations.error[one], innovations.variance[one]))

    here = likelihood.evaluate(x)
    value, damping, small = value_of(here), _FIRST_DAMPING, 0
    information = matrix[two].T @ matrix[two]
    for _ in range(steps):
        gradient = matrix[two].T @ residual_of(here)[two]
        step = bounded_step(x, gradient, information, damping, coordinates.bounds)
        step *= min(1.0, 1.0 / max(float(np.abs(step).max()), 1e-300))
        expected = -float(gradient @ step) - 0.5 * float(step @ information @ step)
        if expected < THRESHOLDS.search_tolerance:
            break
        ahead = coordinates.projected(x + step)
        moved = ahead - x
        there = likelihood.evaluate(ahead)
        gained = value - value_of(there)
        # Broyden's update in the metric of the information, also after a step that fails.
        weighted = np.diag(information) * moved
        length = float(weighted @ moved)
        if length > 0.0:
            missing = change_between(here, there) - matrix @ moved
            if float(missing[two] @ missing[two]) < 4.0 * float(moved @ information @ moved):
                matrix += np.outer(missing, weighted / length)
                information = matrix[two].T @ matrix[two]
        if gained > 0.0:
            x, here, value = ahead, there, value - gained
            damping = updated_damping(damping, gained / expected)
            small = small + 1 if gained < THRESHOLDS.search_tolerance else 0
            if small > 1:
                break
        else:
            damping *= _MORE_DAMPING
            if damping > _MAX_CHORD_DAMPING:
                break
    return PlanarOptimum(likelihood, x, value)


def neutral_values(effect: Effect, start: FloatArray) -> FloatArray:
    """(k,) values without the effect, in units of the scales: neutral sizes, the rest as at ``start``."""
    values = start.copy()
    for at, parameter in enumerate(effect.parameters[: effect.size_count]):
        # A size whose neutral value is infinite has nearly no effect far from its start.
        values[at] = 20.0 * start[at] if parameter.neutral_at_infinity else parameter.neutral
    return values


def coordinates_without(fitted: PlanarOptimum, effect: Effect) -> tuple[PlanarCoordinates, FloatArray, IntArray]:
    """Coordinates without one effect, their values, and the kept columns."""
    coordinates = fitted.coordinates
    columns = np.delete(np.arange(len(fitted.x)), fitted.place(effect))
    kept = replace(
        coordinates,
        effects=tuple(one for one in coordinates.effects if one.key != effect.key),
        units=coordinates.units[columns],
        low=coordinates.low[columns],
        high=coordinates.high[columns],
    )
    return kept, fitted.x[columns], columns
