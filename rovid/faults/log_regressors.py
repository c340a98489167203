"""Regressors and instruments of one log for the quick model of all logs."""

import copy
from collections.abc import Sequence
from functools import cached_property
from typing import Self

import numpy as np

from rovid.core.array_types import ComplexArray, FloatArray
from rovid.trial.numba_loops import first_order_sum
from rovid.trial.preprocessing import Run
from rovid.trial.rates import fast_fft_length
from rovid.trial.vehicle import Thruster, Vehicle

# Share of the torque's RMS over which the sign of the motion changes.
_SIGN_WIDTH = 0.05
# Largest share of the torque's variance that a log's own model leaves, in a log that moves against its torque.
_OPPOSED = 0.5


class LogRegressors:
    """Regressors and instruments of a log, which may be in parts, without their means."""

    def __init__(self, name: str, runs: Sequence[Run], vehicle: Vehicle, tau: float, scale: float) -> None:
        self.name, self.start, self.runs = name, runs[0].trial.campaign_time, runs
        self._vehicle, self._scale, self._held = vehicle, scale, [held_torque(run) for run in runs]
        self.torque = self._joined(self._held)  #: (n,)
        pairs = [(run.rates.acceleration, run.rates.rate) for run in runs]
        #: (n, 3)
        self.x = self._joined([np.column_stack((change, np.abs(rate) * rate, rate)) for change, rate in pairs])
        self.follow(tau)

    def following(self, tau: float) -> Self:
        """The same log with instruments of the time constant ``tau`` in s, and without an ambient torque."""
        other = copy.copy(self)
        other.follow(tau)
        return other

    def follow(self, tau: float) -> None:
        """Set the instruments, see `following`."""
        for known in ("products", "waves"):
            self.__dict__.pop(known, None)
        self._tau, periods = tau, [run.rates.kernel.period for run in self.runs]
        self._follows = [first_order(each, tau, period) for each, period in zip(self._held, periods, strict=True)]
        pairs = zip(self._held, self._follows, strict=True)
        #: (n, 3)
        self.z = self._joined([np.column_stack(((t - own) / tau, np.abs(own) * own, own)) for t, own in pairs])
        self.ambient = np.zeros(len(self.torque))  #: (n,) torque that depends on the heading alone, without its mean.

    def _joined(self, parts: Sequence[FloatArray]) -> FloatArray:
        valid = [part[run.valid] for part, run in zip(parts, self.runs, strict=True)]
        return np.concatenate([part - part.mean(axis=0) for part in valid])

    @property
    def shapes(self) -> FloatArray:
        """(n, 3) torques of other shapes: of a delay or lag, a gain of one direction, and friction or a dead zone."""
        parts, width = [], _SIGN_WIDTH * self._scale
        for run, torque, own in zip(self.runs, self._held, self._follows, strict=True):
            change = np.gradient(torque, run.rates.kernel.period) * self._tau
            parts.append(np.column_stack((change, np.abs(torque), self._scale * np.tanh(own / width))))
        return self._joined(parts)

    @cached_property
    def single(self) -> FloatArray:
        """(n, k) torque of each thruster with its mean."""
        thrusters = enumerate(self._vehicle.thrusters)
        return np.column_stack([self.torque_by(thruster, at) for at, thruster in thrusters])

    @cached_property
    def features(self) -> FloatArray:
        """(5,) those of ``LogMoments``."""
        size = np.sqrt(np.mean(self.torque**2)).clip(1e-300)
        speed = np.std(np.diff(self.torque)).clip(1e-300) / size
        peak = max(np.mean(self.torque**4) / size**4, 1e-300)
        rate = np.sqrt(np.mean(self.x[:, 2] ** 2)).clip(1e-300)
        return np.append(np.log((size, rate, speed, peak)), self.start)

    @property
    def forcing(self) -> FloatArray:
        """(n,) torque of the thrusters and of the surroundings."""
        return np.asarray(self.torque + self.ambient)

    @cached_property
    def of_heading(self) -> FloatArray:
        """(n, 5) shapes of a torque of the heading, less their means: two harmonics, and the angle since the start."""
        parts = []
        for run in self.runs:
            # Where the position is absent, a logged rate may be known.
            angle = held(run, run.rates.position)[run.valid]
            columns = (*(each(k * angle) for k in (1.0, 2.0) for each in (np.sin, np.cos)), angle - angle[0])
            parts.append(np.column_stack([column - column.mean() for column in columns]))
        return np.concatenate(parts)

    @cached_property
    def time(self) -> FloatArray:
        """(n,) s from the beginning of the log's first part."""
        return np.concatenate([run.rates.time[run.valid] + run.trial.campaign_time - self.start for run in self.runs])

    def centred(self, values: FloatArray) -> FloatArray:
        """(n,) or (n, k) ``values`` without their mean in each part of the log, as the regressors are."""
        ends = np.cumsum([int(run.valid.sum()) for run in self.runs])[:-1]
        return np.concatenate([part - part.mean(axis=0) for part in np.split(values, ends)])

    @cached_property
    def is_opposite(self) -> bool:
        """Whether the vehicle moves against its torque: own inertia and drag both negative, which is impossible."""
        values = solved(self.x.T @ self.x, self.x.T @ self.torque)
        rest = self.torque - self.x @ values
        drag = values[2] + 1.5 * values[1] * np.sqrt(np.mean(self.x[:, 2] ** 2))
        explains = float(rest @ rest) < _OPPOSED * float(self.torque @ self.torque)
        return bool(values[0] < 0.0 and drag < 0.0 and explains)

    @cached_property
    def rms_rate(self) -> float:
        """RMS rate, with its mean."""
        return float(np.sqrt(np.mean(np.concatenate([run.rates.rate[run.valid] for run in self.runs]) ** 2)))

    @property
    def is_cut(self) -> bool:
        """Whether the log is in parts, because of another fault."""
        return len(self.runs) > 1

    @property
    def commands(self) -> FloatArray:
        """(m, k) commands at the log's own instants."""
        return np.concatenate([run.trial.commands for run in self.runs])

    def torque_by(self, thruster: Thruster, at: int) -> FloatArray:
        """(n,) torque of ``thruster`` with the command number ``at``."""
        parts = []
        for run in self.runs:
            torque = thruster.torque(run.trial.commands[:, at])
            parts.append(run.rates.filter_held(run.trial, torque)[run.valid])
        return np.concatenate(parts)

    @cached_property
    def products(self) -> FloatArray:
        """(3, 7 + k) instruments times regressors, other shapes, torque and the torque of each thruster."""
        return np.asarray(self.z.T @ np.column_stack((self.x, self.shapes, self.torque, self.single)))

    @cached_property
    def waves(self) -> ComplexArray:
        """(m, 3) spectrum of the instruments, of twice the length."""
        return np.asarray(np.fft.rfft(self.z, fast_fft_length(2 * len(self.z)), axis=0))


def first_order(values: FloatArray, tau: float, period: float) -> FloatArray:
    """(n,) first-order low pass of ``values`` with the time constant ``tau`` in s, from rest."""
    return first_order_sum(-np.expm1(-period / tau) * values, np.exp(-period / tau))


def held(run: Run, values: FloatArray) -> FloatArray:
    """(m,) ``values``, interpolated or held where they are unknown; zeros where all are."""
    time, known = run.rates.time, np.isfinite(values)
    return np.interp(time, time[known], values[known]) if known.any() else np.zeros(len(time))


def held_torque(run: Run) -> FloatArray:
    """(m,) torque on the grid of the rates, filtered where that is known."""
    held = np.interp(run.rates.time, run.trial.time, run.torque)
    return np.where(np.isfinite(run.filtered_torque), run.filtered_torque, held)


def solved(slope: FloatArray, score: FloatArray) -> FloatArray:
    """(p,) least-squares solution of ``slope`` (p, p) times x = ``score`` (p,), with scaled rows and columns."""
    size = np.sqrt(np.abs(np.diag(slope))).clip(1e-300)
    return np.asarray(np.linalg.lstsq(slope / size[:, None] / size, score / size, rcond=1e-9)[0] / size)
