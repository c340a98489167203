"""The misfit of predictions some time ahead; see `rovid.estimate.multi_step_data`."""

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
from rovid.estimate.dataset import ANGLE_NOISE_FLOOR
from rovid.estimate.fisher_information import Innovations
from rovid.estimate.multi_step_data import MultiStepData, prediction_errors
from rovid.estimate.objective import NegativeLogLikelihood
from rovid.estimate.parametrization import DISTURBANCE, NOISE, Parametrization
from rovid.estimate.restart_grid import GRID, HORIZONS
from rovid.model.model import Model

# Of the horizons the middle one, between short and long.
_MIDDLE = len(HORIZONS) // 2
# rad or m: the error of a model that runs away. It is far off, and not out of this world.
_FAR_OFF = 1e6
_CAVEAT = (
    "The simulation misses too much for the likelihood of each next reading, which would call it disturbance: the "
    "parameters are those of the best predictions from half to eight time constants ahead."
)
_NO_GYRO = "--gyro has no say there: what is predicted is the position."


@dataclass(frozen=True, eq=False)
class MultiStepLikelihood(NegativeLogLikelihood):
    """Negative log-likelihood of predictions of the position.

    The disturbance's and the noise's coordinates have no say: the size of the errors over each horizon is that which
    there is.
    """

    data: MultiStepData
    limit: float = math.inf

    method: ClassVar[str] = "maximum likelihood of predictions over half to eight time constants"
    # Of least squares with a variance of their own the information promises what there is.
    bfgs_pairs: ClassVar[int] = 0
    profiles_variance: ClassVar[bool] = True
    simd_slots_left: ClassVar[int] = 0
    is_smooth: ClassVar[bool] = False

    @cached_property
    def parametrization(self) -> Parametrization:
        """Within physical bounds; what has no say is held, and states are no faster than the grid."""
        coordinates = Parametrization.of(self.data, self.effects, self.limit)
        idle = slice(DISTURBANCE, NOISE + 1)
        coordinates.low[idle] = coordinates.high[idle] = 0.0
        self._bound_states(coordinates)
        return coordinates

    def _bound_states(self, coordinates: Parametrization) -> None:
        """Keep the states of effects no faster than the grid: such an effect is told by no prediction."""
        grid = GRID * self.data.time_constant
        low, high = coordinates.bounds
        for at, effect, parameter in coordinates.effect_parameters():
            if not (isinstance(effect.acts, Term) and effect.acts.fastest):
                continue
            if parameter.name == "time_constant":
                low[at] = min(max(low[at], grid), high[at])
            if parameter.name == "frequency":
                high[at] = max(min(high[at], 1.0 / grid), low[at])

    @cached_property
    def _horizon(self) -> IntArray:
        """(N,) index of the horizon of each prediction that counts."""
        return self.masked(self.data.horizon)

    @cached_property
    def weight(self) -> FloatArray:
        """(N,) how much each prediction counts, for neighbours tell much the same."""
        return self.data.weights[self._horizon]

    @property
    def caveats(self) -> tuple[str, ...]:
        """That each next reading was not what was looked at."""
        if self.data.gyro:
            return _CAVEAT, _NO_GYRO
        return (_CAVEAT,)

    def mean_squares(self, error: FloatArray) -> FloatArray:
        """(q,) mean squares of the errors over each horizon."""
        return _mean_squares(self._horizon, error)

    def evaluate(self, points: Sequence[FloatArray]) -> list[Innovations]:
        """Of each of the (p,) ``points``, (N,) errors of the predictions in rad or m, and mean squares by horizon."""
        return [self._innovations(x) for x in points]

    def evaluate_nearby(
        self, x: FloatArray, near: Sequence[FloatArray], centre: Innovations | None = None
    ) -> list[Innovations]:
        """As `innovations_of`, of ``x`` and points ``near`` it; at ``x`` they are ``centre``."""
        if centre is None:
            return thread_map(self._innovations, [x, *near])
        return [centre, *thread_map(self._innovations, near)]

    @property
    def batch_key(self) -> Hashable:
        """Itself: one is looked at after the other."""
        return id(self)

    @classmethod
    def evaluate_each(cls, pairs: Sequence[tuple[Self, FloatArray]]) -> list[Innovations]:
        """As `innovations_of`, of misfits of the same records, each at a point of its own; on all cores at once."""
        return thread_map(lambda pair: pair[0].innovations(pair[1]), pairs)

    def _innovations(self, x: FloatArray) -> Innovations:
        model = self.parametrization.model(x)
        with np.errstate(over="ignore", invalid="ignore"):
            error = prediction_errors(self.data, model, self.data.torque_between_steps(model))
            if self.mask is not None:
                error = error[self.mask]
            # Even a model that runs away is to be compared with others.
            error = np.nan_to_num(error, nan=_FAR_OFF, posinf=_FAR_OFF, neginf=-_FAR_OFF)
            return Innovations(error, self._variances(self.mean_squares(error))[self._horizon])

    def held_out_values(self, tests: Sequence[Self], fits: Sequence[FloatArray]) -> list[float]:
        """Cost of each of ``tests`` with the coordinates that were fitted to others.

        The size of the errors is taken over all tests.
        """
        errors = [test.innovations(x).error for test, x in zip(tests, fits, strict=True)]
        horizons = [test.masked(self.data.horizon) for test in tests]
        sizes = _mean_squares(np.concatenate(horizons), np.concatenate(errors))
        costs = []
        for test, error, horizon in zip(tests, errors, horizons, strict=True):
            costs.append(test.value_of(Innovations(error, self._variances(sizes)[horizon])))
        return costs

    @staticmethod
    def _variances(sizes: FloatArray) -> FloatArray:
        """(q,) mean squares, and no less than two readings are off by at best: a few may all be met by chance."""
        return np.maximum(sizes, 2.0 * ANGLE_NOISE_FLOOR**2)

    def reweighted(self, model: Model) -> Self:
        """The same with as many predictions counted as the errors of ``model`` leave."""
        return replace(self, data=self.data.reweighted(model))

    def split_horizons(self) -> tuple[Self, Self]:
        """The predictions over horizons below the middle one, and those above it."""
        horizon = self.data.horizon
        return self.with_effects(self.effects, horizon < _MIDDLE), self.with_effects(self.effects, horizon > _MIDDLE)

    def at_limit(self, x: FloatArray) -> bool:  # noqa: ARG002 - as every misfit
        """False: nothing is set aside as a disturbance."""
        return False

    def disturbance(self, x: FloatArray) -> tuple[float, float]:
        """Standard deviation in N m and memory in s of a torque that would drive the errors of the shortest horizon."""
        memory = self.data.time_constant
        span = HORIZONS[0] * memory
        return 2.0 * self.parametrization.model(x).inertia * self._shortest_error(x) / span**2, memory

    def _shortest_error(self, x: FloatArray) -> float:
        """Root mean square of the errors of the shortest horizon."""
        error = self.innovations(x).error
        return math.sqrt(float(self.mean_squares(error)[0]))

    def disturbance_rate_std(self, x: FloatArray) -> float:  # noqa: ARG002 - as every misfit
        """Zero: none of the misfit is known to be a disturbance's."""
        return 0.0

    def position_noise(self, x: FloatArray) -> float:  # noqa: ARG002 - as every misfit
        """Standard deviation of the noise of what is measured, from its differences."""
        return self.data.position_noise


def _mean_squares(horizon: IntArray, error: FloatArray) -> FloatArray:
    """(q,) of the (N,) errors of each horizon; zero where there are none."""
    count = len(HORIZONS)
    square = np.bincount(horizon, weights=error**2, minlength=count)
    number = np.bincount(horizon, minlength=count)
    return np.asarray(square / np.maximum(number, 1))
