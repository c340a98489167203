"""The misfit of each next reading: innovations of an extended Kalman filter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Self

import numpy as np

from rovid.ground.arrays import FloatArray
from rovid.identify.coordinates import COMMON, DISTURBANCE, MEMORY, NOISE, Coordinates
from rovid.identify.misfit import Misfit
from rovid.identify.readings import Readings
from rovid.identify.scoring import Innovations
from rovid.model.model import Model

# Of the usual rate: how well the first rate of a trial is known.
_RATE_ERROR = 0.2
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

    def innovations(self, x: FloatArray) -> Innovations:
        """(N,) innovations in rad or m, and rad/s or m/s, with their variances."""
        from rovid.model.kernels import innovations, innovations_wide

        records, model = self.records, self.coordinates.model(x)
        terms, active = model.terms()
        wave, wide = model.wave(), any(effect.wave or effect.carried for effect in model.effects)
        sizes = np.exp(x[DISTURBANCE:COMMON])
        gyro_noise = sizes[2] if records.integrated else records.gyro_noise
        noise = np.array([*sizes, gyro_noise])
        errors, variances = [], []
        parts = zip(records.of_runs, self.drives(model), records.initial_rates, strict=True)
        for readings, drive, initial_rate in parts:
            trial = readings.run.trial
            start = np.array([initial_rate, _RATE_ERROR * records.rate])
            true, slope = model.true_angle(trial, readings.angle, readings.at)
            driven = (readings.time, drive.torque, drive.beside, drive.moment, drive.scatter)
            gyro = readings.gyro_rate
            motion = (model.base(trial), terms, active, noise)
            if wide:
                error, variance = innovations_wide(*driven, true, gyro, *motion, wave, start)
            else:
                error, variance = innovations(*driven, true, gyro, *motion, start)
            known, known_rates = readings.known, readings.known_rates
            # The density is that of the measured heading, whatever it deviates by.
            errors += [error[known, 0] * slope[known], error[known_rates, 1]]
            variances += [variance[known, 0] * slope[known] ** 2, variance[known_rates, 1]]
        error, variance = np.concatenate(errors), np.concatenate(variances)
        if self.counted is None:
            return Innovations(error, variance)
        return Innovations(error[self.counted], variance[self.counted])

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
