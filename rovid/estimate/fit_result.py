"""A model with some effects, fitted: what it is, how sure it is, and what it leaves."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects import Effect
from rovid.estimate.dataset import FitData
from rovid.estimate.fisher_information import (
    GroupedScores,
    inverse_information,
    is_white,
    sandwich_covariance,
    whitening_gain,
)
from rovid.estimate.levenberg_marquardt import ITERATIONS, TOLERANCE, minimize
from rovid.estimate.objective import Key, NegativeLogLikelihood
from rovid.model.model import Model
from rovid.model.simulation import fit_measures, simulated_rate
from rovid.trial.vehicle import PLAUSIBLE_INERTIA_RATIO

# Runs that tell by their scatter how much the kind of run has to say.
_FEWEST_RUNS = 3
# Along stairs the likelihood is followed until so much is lost of it, in steps that begin with this share of the
# coordinate and grow.
_LOST, _FIRST_STEP, _GROWTH = 0.5, 1e-4, 1.5


@dataclass(frozen=True, eq=False)
class FitResult:
    """A model with some effects, fitted.

    Attributes
    ----------
    x
        (p,) coordinates at which the misfit is least.
    cost
        Negative log-likelihood there.
    left
        So much of it at most is taken to be still to be gained.
    """

    objective: NegativeLogLikelihood
    x: FloatArray
    value: float
    remaining_gain: float = math.inf

    @classmethod
    def at(cls, misfit: NegativeLogLikelihood, x: FloatArray) -> Self:
        """As if ``x`` were where a climb ended."""
        return cls(misfit, x, misfit.value(x))

    @property
    def effects(self) -> tuple[Effect, ...]:
        """In the order in which their parameters stand in ``x``."""
        return self.objective.effects

    @property
    def data(self) -> FitData:
        """What it was fitted to."""
        return self.objective.data

    @property
    def key(self) -> Key:
        """What tells it from other models of the same records."""
        return self.objective.key

    @cached_property
    def model(self) -> Model:
        """With all parameters in their units."""
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
        """The other effects, and the coordinates that are left."""
        rest = tuple(other for other in self.effects if other not in effects)
        return rest, np.concatenate((self.common_coordinates, *map(self.effect_coordinates, rest)))

    def with_last(self, effect: Effect) -> Self:
        """The same with ``effect`` as the last of its effects."""
        rest, x = self.without(effect)
        return replace(
            self,
            objective=self.objective.with_effects((*rest, effect)),
            x=np.concatenate((x, self.effect_coordinates(effect))),
        )

    def canonical(self) -> Self:
        """The same, no less likely, with amplitudes positive and phases within a turn."""
        return replace(self, x=self.objective.parametrization.canonical(self.x))

    @cached_property
    def is_physical(self) -> bool:
        """Whether the inertia is one that such a vehicle can have, or no farther from that than before any effect.

        In slow motion, too, it is no less than the rigid body's, whatever water goes along.
        """
        vehicle = self.data.vehicle
        rigid = None if vehicle is None else vehicle.reference_inertia
        if rigid is None or not self.data.has_actuators:
            return True
        low, high = PLAUSIBLE_INERTIA_RATIO
        before, model = self.data.initial_model.inertia, self.model
        # What thrust is taken for may be off, and with it every inertia.
        least = min(low * rigid, low * before)
        most = max(high * rigid, before / low)
        return least <= min(model.inertia, model.low_frequency_inertia) and model.inertia <= most

    @cached_property
    def is_white(self) -> bool:
        """Whether the normalised innovations are white and free of heavy tails."""
        return is_white(self._normalised())

    @cached_property
    def whitening_gain(self) -> float:
        """Log-likelihood that a model gains at least that leaves the innovations white; see `whitening_gain`."""
        return whitening_gain(self._normalised())

    def _normalised(self) -> list[FloatArray]:
        """Innovations of each run over their standard deviations."""
        error, variance = self.objective.innovations(self.x)
        trial = self.objective.masked(self.data.run_index)
        z = error / np.sqrt(variance)
        return [z[trial == number] for number in np.unique(trial)]

    @cached_property
    def simulated_r2(self) -> float:
        """R^2 of the free-running rate."""
        measured = np.concatenate([run.rates.rate for run in self.data.runs])
        return fit_measures(measured, self._simulated_rates()).r2

    def _simulated_rates(self) -> FloatArray:
        """(N,) free-running rate in each run."""
        pairs = zip(self.data.runs, self.data.torque_inputs(self.model), strict=True)
        return np.concatenate([simulated_rate(run, self.model, drive) for run, drive in pairs])

    @property
    def thrust_scale_uncertainty(self) -> float:
        """As `Model.scale_doubt`, of the runs that were looked at."""
        vehicle, runs = self.data.vehicle, self.data.runs
        if vehicle is None:
            return 0.0
        return self.model.actuators.thrust_scale_uncertainty(vehicle, [run.trial for run in runs])

    @cached_property
    def at_limit(self) -> bool:
        """Whether the disturbance would be larger if it might."""
        return self.objective.at_limit(self.x)

    @property
    def disturbance(self) -> tuple[float, float]:
        """Standard deviation of the disturbance torque in N m, and its memory in s."""
        return self.objective.disturbance(self.x)

    def covariance(self, *, sandwich: bool) -> FloatArray:
        """(p, p) of all parameters: inverse information, or the sandwich that allows for coloured innovations."""
        coordinates = self.objective.parametrization
        # All of them, a drag at its bound too: to take its zero for certain would make the rest look certain.
        records = self.data
        groupings = [self.objective.masked(groups) for groups in (records.block_index, records.run_index)]
        here = GroupedScores.of(self.objective.robust_jacobian(self.x), groupings if sandwich else [])
        shown, size = coordinates.model_jacobian(self.x)
        if not np.isfinite(here.information).all():
            # A model that runs away so near to this one tells nothing of it.
            return np.diag(np.full(len(size), math.inf))
        plain = spread = inverse_information(here.information)
        if sandwich:
            spread = _by_scatter(plain, *here.scores)
            # What has no slope has no scatter of it either, which is no certainty.
            flat = np.diag(here.information) == 0.0
            spread = np.where(flat | flat[:, np.newaxis], plain, spread)
        inflated = float(np.median(np.sqrt(np.diag(spread)[:3] / np.diag(plain)[:3])))
        spread = self._along_stairs(spread, inflated)
        held = coordinates.fixed()
        spread = np.where(held | held[:, np.newaxis], 0.0, spread)
        return np.asarray(spread[np.ix_(shown, shown)] * np.outer(size, size))

    def _along_stairs(self, spread: FloatArray, inflated: float) -> FloatArray:
        """``spread`` with what is known of coordinates along which there are no slopes."""
        coordinates = self.objective.parametrization
        for at in coordinates.piecewise_constant():
            reach = self._reach(at)
            if reach is None:
                continue
            # Stairs have no curvature: how far it goes until the likelihood has fallen says how sure it is, and no
            # surer than the step over which its slopes were taken, for where nature's threshold is in that is not told.
            step = coordinates.parameter(at).step * abs(self.x[at])
            reach = max(inflated * reach, step / math.sqrt(3.0))
            factor = np.where(np.arange(len(self.x)) == at, reach / math.sqrt(spread[at, at]), 1.0)
            spread = spread * np.outer(factor, factor)
        return spread

    def _reach(self, at: int) -> float | None:
        """How far coordinate ``at`` may go, all else held, until half a unit of likelihood is lost; None if never."""
        best = self.objective.value(self.x)
        low, high = self.objective.parametrization.bounds
        here = self.x[at]
        reaches = []
        for way in (1.0, -1.0):
            step = way * _FIRST_STEP * max(abs(here), 1e-3)
            while abs(step) < max(abs(here), 1.0):
                moved = self.x.copy()
                moved[at] += step
                if not low[at] <= moved[at] <= high[at]:
                    break
                if self.objective.value(moved) > best + _LOST:
                    reaches.append(abs(step))
                    break
                step *= _GROWTH
        return max(reaches, default=None)


def fit(
    misfit: NegativeLogLikelihood,
    start: FloatArray,
    *,
    iterations: int = ITERATIONS,
    tolerance: float = TOLERANCE,
    goal: float = math.inf,
) -> FitResult:
    """The model that a climb from (p,) ``start`` leads to; see `climb`."""
    climbing = minimize(misfit, start, iterations=iterations, tolerance=tolerance, goal=goal)
    return FitResult(misfit, climbing.x, climbing.value, climbing.remaining_gain)


def _by_scatter(plain: FloatArray, by_block: FloatArray, by_run: FloatArray) -> FloatArray:
    """(p, p) sandwich by the scores of stretches of time and of runs; ``plain`` is the inverse information."""
    spread = sandwich_covariance(plain, by_block)
    if len(by_run) < _FEWEST_RUNS:
        return spread
    # Each kind of run may ask for parameters of its own, where the model's form is not nature's.
    ratio = np.diag(sandwich_covariance(plain, by_run)) / np.maximum(np.diag(spread), 1e-300)
    wider = np.sqrt(np.maximum(ratio, 1.0))
    return np.asarray(spread * np.outer(wider, wider))
