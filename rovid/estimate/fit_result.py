"""A fitted model: coordinates, covariance, innovations and free-running simulation."""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray
from rovid.effects import Effect
from rovid.estimate.dataset import FitData
from rovid.estimate.fisher_information import (
    grouped_scores,
    inverse_of_triangle,
    is_white,
    sandwich_covariance,
    whitening_gain,
)
from rovid.estimate.levenberg_marquardt import ITERATIONS, TOLERANCE, minimize
from rovid.estimate.objective import ModelKey, NegativeLogLikelihood
from rovid.estimate.parametrization import COMMON
from rovid.model.model import Model
from rovid.trial.vehicle import PLAUSIBLE_INERTIA_RATIO

# Least number of runs for a sandwich covariance by runs.
_MIN_RUNS = 3
# A piecewise constant likelihood is followed until this much log-likelihood is lost, with steps that begin with a share
# of the coordinate and grow by a factor; less than `_LOSS` lost on both sides says nothing.
_END, _LOSS, _FIRST_STEP, _GROWTH = 8.0, 0.5, 1e-4, 1.25


@dataclass(frozen=True, eq=False)
class FitResult:
    """A fitted model with some effects."""

    objective: NegativeLogLikelihood
    x: FloatArray  #: (p,) coordinates with the least negative log-likelihood.
    value: float  #: Negative log-likelihood there.
    remaining_gain: float = math.inf  #: Upper estimate of the log-likelihood that further steps would gain.

    @classmethod
    def at(cls, objective: NegativeLogLikelihood, x: FloatArray) -> Self:
        """A result at given coordinates, without a fit."""
        return cls(objective, x, objective.value(x))

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Effects in the order of their parameters in ``x``."""
        return self.objective.effects

    @property
    def data(self) -> FitData:
        """The data of the fit."""
        return self.objective.data

    @property
    def key(self) -> ModelKey:
        """Identity among models of the same data."""
        return self.objective.key

    @cached_property
    def model(self) -> Model:
        """The model with all parameters in SI units."""
        return self.objective.parametrization.model(self.x)

    def effect_coordinates(self, effect: Effect) -> FloatArray:
        """Coordinates of ``effect``."""
        for other, place in self.objective.parametrization.effect_slices():
            if other is effect:
                return self.x[place]
        raise KeyError(effect.key)

    @property
    def common_coordinates(self) -> FloatArray:
        """Coordinates before those of the effects."""
        return self.x[: self.objective.parametrization.effects_begin]

    def without(self, *effects: Effect) -> tuple[tuple[Effect, ...], FloatArray]:
        """The other effects, and the coordinates without those of ``effects``."""
        rest = tuple(other for other in self.effects if other not in effects)
        return rest, np.concatenate((self.common_coordinates, *map(self.effect_coordinates, rest)))

    def with_last(self, effect: Effect) -> Self:
        """The same result with ``effect`` as the last of its effects."""
        rest, x = self.without(effect)
        objective = self.objective.with_effects((*rest, effect))
        return replace(self, objective=objective, x=np.concatenate((x, self.effect_coordinates(effect))))

    def canonical(self) -> Self:
        """The same model with positive amplitudes and phases within one turn."""
        x = self.objective.parametrization.canonical(self.x)
        return self if np.array_equal(x, self.x) else replace(self, x=x)

    @cached_property
    def is_physical(self) -> bool:
        """Whether the ratio of the inertia to the rigid body's is plausible, or no worse than the initial model's.

        The inertia in slow motion must not be less than the rigid body's either, nor must the water drive the vehicle.
        """
        if self.model.damping(self.data.scales.rate) < 0.0:
            return False
        vehicle = self.data.vehicle
        rigid = None if vehicle is None else vehicle.reference_inertia
        if rigid is None or not self.data.has_actuators:
            return True
        low, high = PLAUSIBLE_INERTIA_RATIO
        before, model = self.data.initial_model.inertia, self.model
        # The thrust curve may be off, and every inertia with it.
        least = min(low * rigid, low * before)
        most = max(high * rigid, before / low)
        return least <= min(model.inertia, model.low_frequency_inertia) and model.inertia <= most

    @cached_property
    def is_white(self) -> bool:
        """Whether the normalised innovations are white and without heavy tails."""
        return is_white(self._normalised_innovations())

    @cached_property
    def whitening_gain(self) -> float:
        """Log-likelihood gain of an autoregression of the innovations."""
        return whitening_gain(self._normalised_innovations())

    def _normalised_innovations(self) -> list[FloatArray]:
        """Innovations of each run over their standard deviations."""
        error, variance = self.objective.innovations(self.x)
        run = self.objective.masked(self.data.run_index)
        z = error / np.sqrt(variance)
        return [z[run == number] for number in np.unique(run)]

    @cached_property
    def simulated_r2(self) -> float:
        """R^2 of the free-running rate."""
        return self.data.free_run_r2(self.model)

    @property
    def thrust_scale_uncertainty(self) -> float:
        """As `rovid.model.actuator_model.ActuatorModel.thrust_scale_uncertainty`, of these runs."""
        vehicle, runs = self.data.vehicle, self.data.runs
        if vehicle is None:
            return 0.0
        return self.model.actuators.thrust_scale_uncertainty(vehicle, [run.trial for run in runs])

    @cached_property
    def at_limit(self) -> bool:
        """Whether the likelihood grows with the disturbance at its limit."""
        return self.objective.at_limit(self.x)

    @property
    def is_adequate(self) -> bool:
        """Whether the innovations are white, and the disturbance is within its limit."""
        return not self.data.means_only and self.is_white and not self.at_limit

    @property
    def disturbance(self) -> tuple[float, float]:
        """Standard deviation of the disturbance torque in N m, and its correlation time in s."""
        return self.objective.disturbance(self.x)

    def covariance(self, *, sandwich: bool) -> FloatArray:
        """(p, p) of the model parameters: the inverse information, or the sandwich for correlated innovations."""
        parametrization, data = self.objective.parametrization, self.data
        # Coordinates at a bound are included: taking them as certain would make the others look certain.
        groupings = list(map(self.objective.masked, (data.block_index, data.run_index)))
        triangle, scores = grouped_scores(self.objective.robust_jacobian(self.x), groupings if sandwich else [])
        shown, size = parametrization.model_jacobian(self.x)
        if not math.isfinite(np.linalg.norm(triangle)):
            # A model that diverges within a difference step leaves the covariance unknown.
            return np.diag(np.full(len(size), math.inf))
        plain = covariance = inverse_of_triangle(triangle)
        flat = np.asarray(~triangle.any(axis=0))
        if sandwich:
            by_block, by_run = scores
            covariance = sandwich_covariance(plain, by_block)
            if len(by_run) >= _MIN_RUNS:
                # An incomplete model has other best parameters for each kind of run: errors grow to those by runs.
                ratio = np.diag(sandwich_covariance(plain, by_run)) / np.maximum(np.diag(covariance), 1e-300)
                factor = np.sqrt(np.maximum(ratio, 1.0))
                covariance = covariance * np.outer(factor, factor)
            # A coordinate without derivatives has no scores, which does not make it certain.
            covariance = np.where(flat | flat[:, np.newaxis], plain, covariance)
        inflation = float(np.median(np.sqrt(np.diag(covariance)[:3] / np.diag(plain)[:3])))
        covariance = self._with_piecewise_constant(covariance, inflation, flat)
        fixed = parametrization.fixed()
        covariance = np.where(fixed | fixed[:, np.newaxis], 0.0, covariance)
        return np.asarray(covariance[np.ix_(shown, shown)] * np.outer(size, size))

    def _with_piecewise_constant(self, covariance: FloatArray, inflation: float, flat: BoolArray) -> FloatArray:
        """``covariance`` with the variances of coordinates along which the likelihood is piecewise constant.

        That includes effect parameters along which it is ``flat`` here, such as a threshold between two commands. Their
        standard error is the RMS distance by the likelihood, times the ``inflation`` of the other errors by the
        sandwich if they grow, and at least that of a uniform distribution over the difference step.
        """
        parametrization = self.objective.parametrization
        among_effects = np.arange(len(self.x)) >= COMMON
        for at in {*parametrization.piecewise_constant(), *np.flatnonzero(flat & among_effects).tolist()}:
            distance = self._rms_distance(at)
            if distance is None:
                continue
            step = parametrization.parameters[at - COMMON].step * abs(self.x[at])
            error = max(inflation * distance, distance, step / math.sqrt(3.0))
            factor = np.where(np.arange(len(self.x)) == at, error / math.sqrt(covariance[at, at]), 1.0)
            covariance = covariance * np.outer(factor, factor)
        return covariance

    def _rms_distance(self, at: int) -> float | None:
        """RMS distance from the optimum along coordinate ``at``, weighted by likelihood; None where that is flat."""
        here, best = self.x[at], self.value
        low, high = self.objective.parametrization.bounds
        loss, weight, squares = 0.0, 0.0, 0.0
        for sign in (1.0, -1.0):
            near, step, lost = 0.0, _FIRST_STEP * max(abs(here), 1e-3), 0.0
            while lost < _END and step < max(abs(here), 1.0) and low[at] <= here + sign * step <= high[at]:
                moved = self.x.copy()
                moved[at] += sign * step
                before, lost = lost, max(self.objective.value(moved) - best, 0.0)
                if math.isnan(lost):  # the model diverges
                    lost = math.inf
                share = 0.5 * (math.exp(-before) + math.exp(-lost)) * (step - near)
                weight, squares = weight + share, squares + share * (0.5 * (near + step)) ** 2
                near, step, loss = step, step * _GROWTH, max(loss, lost)
        return math.sqrt(squares / weight) if loss > _LOSS else None


def fit(
    objective: NegativeLogLikelihood,
    start: FloatArray,
    *,
    iterations: int = ITERATIONS,
    tolerance: float = TOLERANCE,
    goal: float = math.inf,
) -> FitResult:
    """Fit from (p,) ``start``; see `rovid.estimate.levenberg_marquardt.minimize`."""
    found = minimize(objective, start, iterations=iterations, tolerance=tolerance, goal=goal)
    return FitResult(objective, found.x, found.value, found.remaining_gain)
