"""The misfit of each next reading: innovations of an extended Kalman filter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Self

import numpy as np

from rovid.ground.arrays import FloatArray
from rovid.ground.lanes import LANES
from rovid.identify.coordinates import COMMON, DISTURBANCE, MEMORY, NOISE, Coordinates
from rovid.identify.misfit import Misfit
from rovid.identify.readings import Readings
from rovid.identify.scoring import Innovations
from rovid.model.batch import Abreast, Driven
from rovid.model.model import Model

# A disturbance is at its limit where its logarithm is nearer to that.
_NEAR = 1e-3


@dataclass(frozen=True, eq=False)
class InnovationMisfit(Misfit):
    """Negative log-likelihood of each next reading, predicted from all before it.

    The filter passes over readings that do not count all the same.
    """

    records: Readings

    method: ClassVar[str] = "maximum likelihood of Kalman-filter innovations"
    remembered: ClassVar[int] = 10
    profiled: ClassVar[bool] = False

    @cached_property
    def coordinates(self) -> Coordinates:
        """Within physical bounds, and the disturbance below its limit."""
        return Coordinates.of(self.records, self.effects, self.limit)

    @property
    def weight(self) -> float:
        """One: each innovation is news."""
        return 1.0

    @property
    def caveats(self) -> tuple[str, ...]:
        """None."""
        return ()

    def innovations_of(self, points: Sequence[FloatArray]) -> list[Innovations]:
        """Of each of the (p,) ``points``, (N,) innovations in rad or m, and rad/s or m/s, with their variances."""
        found: list[Innovations] = []
        for first in range(0, len(points), LANES):
            found += self._side_by_side(points[first : first + LANES])
        return found

    def _side_by_side(self, points: Sequence[FloatArray]) -> list[Innovations]:
        from rovid.model.kernels import innovations, innovations_wide

        every = [*points, *points[-1:] * (LANES - len(points))]
        models = [self.coordinates.model(x) for x in points]
        models += models[-1:] * (LANES - len(points))
        seen = [self._seen(model) for model in models]
        lists = [self.drives(model) for model in models]
        flat = {id(one): _flat(one) for one in lists}
        driven = Driven.of([flat[id(one)] for one in lists], [angle for angle, _ in seen])
        abreast = Abreast.of(models, [self._noise(x) for x in every])
        is_wide = any(effect.oscillates for effect in self.effects)
        error, variance = (innovations_wide if is_wide else innovations)(self.records.logged, driven, abreast)
        told = self.of_counted(self.records.told)
        errors, variances = (np.ascontiguousarray(table.reshape(-1, LANES)[told].T) for table in (error, variance))
        found = []
        for own_error, own_variance, (_, slope) in zip(errors, variances, seen, strict=True):
            if slope is None:
                found.append(Innovations(own_error, own_variance))
            else:
                # The density is that of the measured heading, whatever it deviates by.
                gain = np.where(told % 2, 1.0, slope[told // 2])
                found.append(Innovations(own_error * gain, own_variance * gain**2))
        return found[: len(points)]

    def _noise(self, x: FloatArray) -> FloatArray:
        """(4,) as `rovid.model.batch.Abreast` takes it."""
        sizes = np.exp(x[DISTURBANCE:COMMON])
        return np.array([*sizes, sizes[2] if self.records.integrated else self.records.gyro_noise])

    def _seen(self, model: Model) -> tuple[FloatArray, FloatArray | None]:
        """(n,) angle without the deviation of the heading, and d(measured)/d(true) where there is one."""
        if not model.instrument.deviates:
            return self.records.angle, None
        runs = self.records.of_runs
        pairs = [model.instrument.true_angle(run.run.trial, run.angle, run.at) for run in runs]
        angle, slope = (np.concatenate(series) for series in zip(*pairs, strict=True))
        return angle, slope

    def held_out_costs(self, tests: Sequence[Self], fits: Sequence[FloatArray]) -> list[float]:
        """Cost of each of ``tests`` with the coordinates that were fitted to others."""
        return [test.cost(x) for test, x in zip(tests, fits, strict=True)]

    def recounted(self, model: Model) -> Self:  # noqa: ARG002 - as every misfit
        """Itself: each innovation is news."""
        return self

    def short_and_long(self) -> None:
        """None: all look at the next reading."""

    def at_limit(self, x: FloatArray) -> bool:
        """Whether the disturbance would be larger if it might."""
        return bool(x[DISTURBANCE] > self.coordinates.high[DISTURBANCE] - _NEAR)

    def disturbance(self, x: FloatArray) -> tuple[float, float]:
        """Standard deviation of the disturbance torque in N m, and its memory in s."""
        return math.exp(x[DISTURBANCE]), math.exp(x[MEMORY])

    def driven_rate(self, x: FloatArray) -> float:
        """Standard deviation of the rate that the disturbance drives, about the usual rate."""
        torque, memory = self.disturbance(x)
        return torque * self.coordinates.model(x).restlessness(self.records.rate, memory)

    def position_noise(self, x: FloatArray) -> float:
        """Standard deviation of the noise of what is measured."""
        return math.exp(x[NOISE])


def _flat(drives):
    from rovid.model.drive import Drive
    return Drive(*(np.concatenate([getattr(d, n) for d in drives]) for n in ("torque", "moment", "beside", "scatter")))
