"""The likelihood of the free-running rate, for models that miss too much to be judged by the next reading."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from rovid.effects import Effect
from rovid.identify.innovations import DISTURBANCE, MEMORY, NOISE, Likelihood, Records
from rovid.model import Model
from rovid.simulation import simulated_rate
from rovid.trial import FloatArray

# Decimal orders that the misfit may be smaller or larger than the usual rate.
_SMALLEST, _LARGEST = 1e-4, 10.0


@dataclass(frozen=True, eq=False, kw_only=True)
class SimulatedRecords(Records):
    """As `Records`, but what is looked at is the rate on the grid of each run.

    Attributes
    ----------
    misfit
        (N,) measured less simulated rate of a model of before, rad/s.
    correlation_time
        Within twice that many seconds misfits count as one.
    """

    misfit: FloatArray
    correlation_time: float

    @classmethod
    def of(cls, records: Records, model: Model) -> Self:
        """With the misfits of ``model``."""
        pairs = zip(records.runs, records.drives(model), strict=True)
        misfits = [np.nan_to_num(run.rates.rate - simulated_rate(run, model, drive)) for run, drive in pairs]
        return cls(
            runs=records.runs,
            vehicle=records.vehicle,
            start=records.start,
            gyro=records.gyro,
            misfit=np.concatenate(misfits),
            correlation_time=_correlation_time(misfits, records.runs[0].rates.kernel.period),
        )

    @cached_property
    def times(self) -> list[FloatArray]:
        """(m,) s, of the grid of each run."""
        return [run.rates.time for run in self.runs]

    @cached_property
    def known(self) -> list[NDArray[np.intp]]:
        """Where on the grid of each run the rate is known."""
        return [np.flatnonzero(np.isfinite(run.rates.rate)) for run in self.runs]

    @cached_property
    def looked_at(self) -> list[NDArray[np.intp]]:
        """As ``known``: the rate on the grid is all that is looked at, a gyro's or the position's."""
        return self.known


def _correlation_time(misfits: Sequence[FloatArray], period: float) -> float:
    """Integral of the autocorrelation of ``misfits`` up to where it first vanishes, s."""
    total = np.zeros(max(len(misfit) for misfit in misfits))
    for misfit in misfits:
        total[: len(misfit)] += signal.correlate(misfit, misfit, method="fft")[len(misfit) - 1 :]
    if total[0] <= 0.0:
        return period
    share = total / total[0]
    crossing = int(np.argmax(share <= 0.0)) or len(share)
    return float(period * (0.5 + share[1:crossing].sum()))


class SimulatedLikelihood(Likelihood):
    """Negative log-likelihood of the free-running rate's misfit.

    Misfits correlate: those within two correlation times count as one, so that gains and standard errors mean what
    they say. The coordinates are those of `Likelihood`, but ``NOISE`` is the logarithm of the misfit in rad/s; the
    disturbance's have no say, for it is not told from what the model misses.
    """

    records: SimulatedRecords
    method = "maximum likelihood of the free-running rate"
    # Of least squares with a variance of their own the information promises what there is.
    remembered = 0

    def __init__(
        self,
        records: Records,
        limit: float = math.inf,
        effects: tuple[Effect, ...] = (),
        counted: NDArray[np.bool_] | None = None,
    ) -> None:
        super().__init__(records, limit, effects, counted)
        self.weight = min(0.5 * records.runs[0].rates.kernel.period / self.records.correlation_time, 1.0)
        self.low[[DISTURBANCE, MEMORY]] = self.high[[DISTURBANCE, MEMORY]] = 0.0
        self.low[NOISE], self.high[NOISE] = np.log(np.array([_SMALLEST, _LARGEST]) * records.rate)

    def first(self) -> FloatArray:
        """Coordinates to start from, with the misfit of the start."""
        x = super().first()
        x[NOISE] = 0.5 * math.log(float(np.mean(self.records.misfit**2)) + 1e-300)
        return np.asarray(np.clip(x, self.low, self.high))

    def disturbance(self, x: FloatArray) -> tuple[float, float]:
        """Standard deviation of a torque in N m that would drive all of the misfit, and its memory in s."""
        memory = self.records.correlation_time
        return math.exp(x[NOISE]) / self.model(x).restlessness(self.records.rate, memory), memory

    def driven_rate(self, x: FloatArray) -> float:  # noqa: ARG002 - as in Likelihood
        """Zero: none of the misfit is known to be a disturbance's."""
        return 0.0

    def position_noise(self, x: FloatArray) -> float:  # noqa: ARG002 - as in Likelihood
        """Standard deviation of the noise of what is measured, from its differences."""
        return self.records.position_noise

    def at_limit(self, x: FloatArray) -> bool:  # noqa: ARG002 - as in Likelihood
        """False: nothing is set aside as a disturbance."""
        return False

    def calibrated(self, tests: Sequence[Self], fits: Sequence[FloatArray]) -> list[FloatArray]:
        """As fitted, but for the size of the misfit: that is taken over all tests."""
        errors = np.concatenate([test.innovations(x)[0] for test, x in zip(tests, fits, strict=True)])
        size = 0.5 * math.log(float(np.mean(errors**2)) + 1e-300)
        return [np.where(np.arange(len(x)) == NOISE, size, x) for x in fits]

    def _aside(
        self, x: FloatArray, centre: tuple[FloatArray, FloatArray], coordinate: int, step: float
    ) -> tuple[FloatArray, FloatArray]:
        # The misfit's size moves no simulation.
        if coordinate == NOISE:
            return centre[0], centre[1] * math.exp(2.0 * step)
        return super()._aside(x, centre, coordinate, step)

    def innovations(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(N,) misfits in rad/s and their variances; those not counted are left out."""
        model = self.model(x)
        errors = []
        for run, drive, known in zip(self.records.runs, self.drives(model), self.records.known, strict=True):
            misfit = run.rates.rate - simulated_rate(run, model, drive)
            errors.append(misfit[known])
        error = np.concatenate(errors)
        error = error if self.counted is None else error[self.counted]
        return error, np.full(len(error), math.exp(2.0 * x[NOISE]))
