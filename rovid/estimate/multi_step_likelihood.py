"""Negative log-likelihood of multi-step predictions; see `rovid.estimate.multi_step_data`."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.core.threads import thread_map
from rovid.effects.base import Term
from rovid.estimate.dataset import NOISE_FLOOR
from rovid.estimate.fisher_information import Innovations
from rovid.estimate.multi_step_data import MultiStepData, prediction_errors
from rovid.estimate.objective import NegativeLogLikelihood
from rovid.estimate.parametrization import DISTURBANCE, NOISE, Parametrization
from rovid.estimate.restart_grid import GRID, HORIZONS
from rovid.model.model import Model

# Index of the horizon between short and long ones.
_MIDDLE = len(HORIZONS) // 2
# Error of a model that diverges, over the scale of positions: large, but finite.
_DIVERGED = 1e6


@dataclass(frozen=True, eq=False)
class MultiStepLikelihood(NegativeLogLikelihood):
    """Negative log-likelihood of multi-step predictions of the position; docs/method.md, (16).

    The variance of each horizon is the mean square of its errors. So the coordinates of the disturbance and of the
    noise are fixed.
    """

    data: MultiStepData
    limit: float = math.inf

    method: ClassVar[str] = "maximum likelihood of predictions over half to eight time constants"
    # The Fisher information of least squares with an estimated variance is accurate.
    bfgs_pairs: ClassVar[int] = 0
    profiles_variance: ClassVar[bool] = True
    simd_slots_left: ClassVar[int] = 0
    is_smooth: ClassVar[bool] = False

    @cached_property
    def parametrization(self) -> Parametrization:
        """Coordinates within physical bounds, with disturbance and noise fixed."""
        parametrization = Parametrization.of(self.data, self.effects, self.limit)
        fixed = slice(DISTURBANCE, NOISE + 1)
        parametrization.low[fixed] = parametrization.high[fixed] = 0.0
        # States of effects that are faster than the grid have no influence on any prediction.
        grid = GRID * self.data.time_constant
        low, high = parametrization.bounds
        for at, effect, parameter in parametrization.effect_parameters():
            if not (isinstance(effect.acts, Term) and effect.acts.fastest):
                continue
            unit = self.data.scales.unit_size(parameter)
            if parameter.name == "time_constant":
                low[at] = min(max(low[at], grid / unit), high[at])
            if parameter.name == "frequency":
                high[at] = max(min(high[at], 1.0 / grid / unit), low[at])
        return parametrization

    @cached_property
    def _horizon(self) -> IntArray:
        """(N,) index of the horizon of each used prediction."""
        return self.masked(self.data.horizon)

    @cached_property
    def weight(self) -> FloatArray:
        """(N,) weight of each used prediction."""
        return self.data.weights[self._horizon]

    @property
    def batch_key(self) -> Hashable:
        """Unique: objectives are evaluated one at a time."""
        return id(self)

    @property
    def chunks(self) -> Sequence[Self]:
        """The objective itself: all predictions are evaluated at once."""
        return [self]

    @property
    def rows(self) -> slice:
        """All rows."""
        return slice(0, None)

    @property
    def _least_variance(self) -> float:
        """Least mean square error: two readings at the noise floor. A few predictions may all be met by chance."""
        return 2.0 * (NOISE_FLOOR * self.data.position_scale) ** 2

    def _predict(self, x: FloatArray) -> Innovations:
        """(N,) prediction errors in rad or m, and the mean square of the errors over the same horizon."""
        model = self.parametrization.model(x)
        with np.errstate(over="ignore", invalid="ignore"):
            error = prediction_errors(self.data, model)
            if self.mask is not None:
                error = error[self.mask]
            far = _DIVERGED * self.data.position_scale
            error = np.nan_to_num(error, nan=far, posinf=far, neginf=-far)
            variances = np.maximum(_mean_squares(self._horizon, error), self._least_variance)
            return Innovations(error, variances[self._horizon])

    def evaluate(self, points: Sequence[FloatArray]) -> list[Innovations]:
        """For each of the (p,) ``points``, (N,) errors in rad or m and mean squares over the same horizon."""
        return list(map(self._predict, points))

    def evaluate_nearby(
        self, x: FloatArray, near: Sequence[FloatArray], centre: Innovations | None = None
    ) -> list[Innovations]:
        """As `evaluate`, at ``x`` and at ``near`` points; ``centre`` is the known value at x."""
        if centre is None:
            return thread_map(self._predict, [x, *near])
        return [centre, *thread_map(self._predict, near)]

    @classmethod
    def evaluate_each(cls, pairs: Sequence[tuple[Self, FloatArray]]) -> list[Innovations]:
        """As `evaluate`, of objectives of the same data, each at a point of its own, on all cores."""
        return thread_map(lambda pair: pair[0].innovations(pair[1]), pairs)

    def held_out_values(self, tests: Sequence[Self], fits: Sequence[FloatArray]) -> list[float]:
        """Value of each of the ``tests`` at coordinates fitted to others; variances are those over all tests."""
        errors = [test.innovations(x).error for test, x in zip(tests, fits, strict=True)]
        horizons = [test.masked(self.data.horizon) for test in tests]
        variances = np.maximum(_mean_squares(np.concatenate(horizons), np.concatenate(errors)), self._least_variance)
        each = zip(tests, errors, horizons, strict=True)
        return [test.value_of(Innovations(error, variances[horizon])) for test, error, horizon in each]

    def reweighted(self, model: Model) -> Self:
        """The objective with weights by the correlation of the errors of ``model``."""
        return replace(self, data=self.data.reweighted(model))

    def split_horizons(self) -> tuple[Self, Self]:
        """The predictions over horizons below the middle one, and above it."""
        horizon = self.data.horizon
        return self.with_effects(self.effects, horizon < _MIDDLE), self.with_effects(self.effects, horizon > _MIDDLE)

    def at_limit(self, x: FloatArray) -> bool:  # noqa: ARG002 - as every objective
        """False: there is no disturbance."""
        return False

    def disturbance(self, x: FloatArray) -> tuple[float, float]:
        """Standard deviation in N m and correlation time in s of a torque that causes the errors over horizon 1."""
        memory = self.data.time_constant
        span = HORIZONS[0] * memory
        error = math.sqrt(float(_mean_squares(self._horizon, self.innovations(x).error)[0]))
        return 2.0 * self.parametrization.model(x).inertia * error / span**2, memory

    def disturbance_rate_std(self, x: FloatArray) -> float:  # noqa: ARG002 - as every objective
        """0: no error is attributed to a disturbance."""
        return 0.0

    def position_noise(self, x: FloatArray) -> float:  # noqa: ARG002 - as every objective
        """Standard deviation of the measurement noise, from differences of the measurements."""
        return self.data.position_noise


def _mean_squares(horizon: IntArray, error: FloatArray) -> FloatArray:
    """(q,) mean squares of the (N,) errors of each horizon; zero for an empty horizon."""
    square = np.bincount(horizon, weights=error**2, minlength=len(HORIZONS))
    return np.asarray(square / np.maximum(np.bincount(horizon, minlength=len(HORIZONS)), 1))
