"""Criteria of the planar model: priors, runs as the arrays of the compiled loops, and the innovation likelihood.

The prior of an inertia is normal in its logarithm, that of any other parameter in the parameter. Its negative logarithm
is added to every criterion of the coupled model as one more error a parameter, with the variance of the prior. So all
models of a search have the same penalty terms, and each difference of their criteria is a difference of log posterior
densities. Held-out gains do not contain it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray, IntArray
from rovid.core.threads import thread_map
from rovid.estimate.fisher_information import (
    Innovations,
    Jacobian,
    NormalEquations,
    jacobian_chunks,
    total_negative_log_likelihood,
)
from rovid.planar.coordinates import PlanarCoordinates
from rovid.planar.equations import STATES
from rovid.planar.kernels import NOISE_SENSOR, filter_runs
from rovid.planar.model import SENSORS, PlanarModel, is_of_actuators

if TYPE_CHECKING:
    from rovid.planar.dataset import PlanarData, PlanarRun
    from rovid.planar.free_runs import FreeRuns

# Sensors with a first reading that starts the filter and has no innovation.
_STARTING = [SENSORS.index(name) for name in ("heading", "north", "east")]
# Number of sensors that measure yaw alone, the first ones.
_OF_YAW = 2
# s; stamps closer than this are one instant.
_SAME_INSTANT = 1e-6
# Largest coupling of sway and yaw in the inertia of a start.
MAX_COUPLING = 0.8


@dataclass(frozen=True, kw_only=True)
class PriorValue:
    """What is known of a parameter before the logs."""

    value: float  #: SI.
    standard_error: float  #: SI; of an inertia, the relative error is that of its logarithm.
    source: str  #: For people, as "strip theory".


@dataclass(frozen=True, eq=False)
class PlanarPrior:
    """Independent priors of base parameters and of coefficients of rudders."""

    values: Mapping[str, PriorValue]

    @cached_property
    def is_logarithm(self) -> BoolArray:
        """(k,) whether the prior is one of a logarithm."""
        return np.array([name.endswith(".inertia") and name != "sway_yaw.inertia" for name in self.values])

    @cached_property
    def _centre(self) -> FloatArray:
        return np.array([one.value for one in self.values.values()])

    @cached_property
    def width(self) -> FloatArray:
        """(k,) standard errors in the units of `scaled`."""
        return np.array([one.standard_error for one in self.values.values()]) * self.slopes(self._centre)

    def index(self, names: Sequence[str]) -> IntArray:
        """(k,) place of each parameter among the ``names`` of a model."""
        return np.array([names.index(name) for name in self.values], dtype=np.intp)

    def scaled(self, values: FloatArray) -> FloatArray:
        """(k,) logarithms of inertias, and the other ``values`` as they are."""
        return np.where(self.is_logarithm, np.log(np.where(self.is_logarithm, values, 1.0)), values)

    def slopes(self, values: FloatArray) -> FloatArray:
        """(k,) derivatives of `scaled`."""
        return 1.0 / np.where(self.is_logarithm, values, 1.0)

    def start(self, model: PlanarModel) -> PlanarModel:
        """The ``model`` with the values of the prior, and with a coupling of the inertias that these allow."""
        values = model.values.copy()
        values[self.index(model.names)] = self._centre
        most = MAX_COUPLING * math.sqrt(values[1] * values[2])
        values[3] = np.clip(values[3], -most, most)
        return model.with_values(values)

    def errors(self, coordinates: PlanarCoordinates, x: FloatArray) -> Innovations:
        """(k,) differences of the parameters at ``x`` from the prior, and its variances."""
        own = coordinates.values(x)[self.index(coordinates.base_names)]
        return Innovations(self.scaled(own) - self.scaled(self._centre), self.width**2)

    def jacobian(self, coordinates: PlanarCoordinates, x: FloatArray) -> FloatArray:
        """(k, p) derivatives of `errors` by the coordinates, in the prior's standard errors; zeros for fixed ones."""
        at, found = self.index(coordinates.base_names), np.zeros((len(self.values), len(x)))
        slopes = self.slopes(coordinates.values(x)[at]) / self.width
        found[:, : coordinates.noise_begin] = coordinates.value_jacobian(x)[at] * slopes[:, None]
        return np.asarray(found * coordinates.free)


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarGrid:
    """Runs as the compiled loops read them; n instants and m readings of all runs."""

    runs: tuple[PlanarRun, ...]
    offsets: IntArray  #: (runs + 1,) first instant of each run.
    time: FloatArray  #: (n,) s.
    event_offsets: IntArray  #: (n + 1,) first reading at each instant.
    sensors: IntArray  #: (m,) index in `SENSORS`.
    values: FloatArray  #: (m,) SI, rad.
    used: BoolArray  #: (m,) whether the reading has an innovation that counts.
    run_index: IntArray  #: (m,) number of the run of each reading.
    starts: FloatArray  #: (runs, 6) as in `rovid.planar.kernels.filter_runs`.
    start_std: FloatArray  #: (runs, 6) likewise.
    speed: FloatArray  #: (3,) typical speeds.
    latency: FloatArray  #: (6,) s by which the stamps of each sensor were moved back.
    yaw_only: bool  #: Whether surge and sway are left out, and the readings of both.
    interval: float  #: s with one reading of each sensor; 0 for all readings.
    prior: PlanarPrior | None = None  #: What is known of the parameters from elsewhere.

    @classmethod
    def of(
        cls,
        data: PlanarData,
        starts: FloatArray,
        start_std: FloatArray,
        speed: FloatArray,
        *,
        yaw_only: bool,
        interval: float = 0.0,
        latency: FloatArray | None = None,
    ) -> Self:
        """The runs of ``data``; of each sensor one reading in ``interval`` s, stamps moved back by its ``latency``."""
        late = np.zeros(len(SENSORS)) if latency is None else latency
        times, counts, parts = [], [], []
        for number, run in enumerate(data.runs):
            sensor, value = run.event_sensor, run.event_value
            stamp = run.time[run.event_index] - late[sensor]
            chosen = (stamp >= 0.0) & ((sensor < _OF_YAW) | (not yaw_only))
            if interval > 0.0:
                chosen &= _thinned(stamp, sensor, interval)
            order = np.argsort(np.where(chosen, stamp, np.inf), kind="stable")[: int(chosen.sum())]
            stamp, sensor, value = stamp[order], sensor[order], value[order]
            time = np.unique(np.concatenate(([0.0], stamp) if interval > 0.0 else (run.time, stamp)))
            # Stamps that differ by rounding are one instant.
            time = time[np.diff(time, prepend=-1.0) > _SAME_INSTANT]
            index = np.searchsorted(time, stamp + _SAME_INSTANT, side="right") - 1
            counted = np.ones(len(index), dtype=bool)
            for one in _STARTING:
                counted[np.flatnonzero(sensor == one)[:1]] = False
            times.append(time)
            counts.append(np.bincount(index, minlength=len(time)))
            parts.append((sensor, value, counted, np.full(len(index), number)))
        sensors, values, used, numbers = map(np.concatenate, zip(*parts, strict=True))
        return cls(
            runs=data.runs,
            offsets=np.cumsum([0, *map(len, times)]),
            time=np.concatenate(times),
            event_offsets=np.concatenate(([0], np.cumsum(np.concatenate(counts)))).astype(np.intp),
            sensors=sensors.astype(np.intp),
            values=values,
            used=used,
            run_index=numbers,
            starts=starts,
            start_std=start_std,
            speed=speed,
            latency=late,
            yaw_only=yaw_only,
            interval=interval,
            prior=data.prior,
        )

    def inputs(self, model: PlanarModel) -> FloatArray:
        """(n, k) inputs of ``model``: means from each instant to the next."""
        effects = model.actuator_effects
        columns = []
        for number, run in enumerate(self.runs):
            held = run.forces(effects).inputs
            time = self.time[self.offsets[number] : self.offsets[number + 1]]
            if len(time) == len(run.time):
                columns.append(held)
                continue
            area = np.vstack((np.zeros(held.shape[1]), np.cumsum(held[:-1] * np.diff(run.time)[:, None], axis=0)))
            total = np.column_stack([np.interp(time, run.time, column) for column in area.T])
            means = np.diff(total, axis=0) / np.diff(time)[:, None]
            last = held[np.searchsorted(run.time, time[-1], side="right") - 1]
            columns.append(np.vstack((means, last)))
        return np.ascontiguousarray(np.concatenate(columns))

    @cached_property
    def plain_inputs(self) -> FloatArray:
        """(n, k) inputs without effects of the actuators."""
        return self.inputs(PlanarModel(base=np.ones(10)))


def _thinned(stamp: FloatArray, sensor: IntArray, interval: float) -> BoolArray:
    """(m,) readings of which each sensor has one in an interval: the first."""
    cell = np.floor(stamp / interval + 1e-9).astype(np.intp)
    chosen = np.zeros(len(cell), dtype=bool)
    for one in np.unique(sensor):
        own = np.flatnonzero(sensor == one)
        chosen[own[np.unique(cell[own], return_index=True)[1]]] = True
    return chosen


class CriterionRows(NamedTuple):
    """Origin of each of N errors of a criterion; -1, 0 and -1 of the priors of disturbance and parameters."""

    run: IntArray  #: (N,) number of the run.
    time: FloatArray  #: (N,) s.
    sensor: IntArray  #: (N,) index in `SENSORS`; of a smoothed speed that of the sensor of that speed.


def stacked(free: BoolArray, pieces: Sequence[Jacobian], count: int) -> FloatArray:
    """(2 count, p) derivatives of normalised innovations and variances by all coordinates; zero but for ``free`` ones.

    ``pieces`` are the Jacobians by these, as of `PlanarLikelihood.jacobian`.
    """
    matrix = np.zeros((2 * count, len(free)))
    for piece in pieces:
        matrix[piece.rows, :][:, free], matrix[count:][piece.rows, :][:, free] = np.split(piece.matrix, 2)
    return matrix


@dataclass(frozen=True, eq=False)
class PlanarLikelihood:
    """Negative log-likelihood of each reading, predicted from all readings before it; docs/method.md, (12)."""

    grid: PlanarGrid
    coordinates: PlanarCoordinates
    #: Free-running simulations with errors that take the place of the innovations; None for the innovations.
    free_runs: FreeRuns | None = None

    @property
    def free(self) -> BoolArray:
        """(p,) coordinates that the criterion determines: free runs have no disturbance and no noise of sensors."""
        free = self.coordinates.free
        if self.free_runs is None:
            return free
        return np.asarray(free & (np.arange(len(free)) < self.coordinates.noise_begin))

    @cached_property
    def rows(self) -> CriterionRows:
        """Where the errors of `evaluate` come from."""
        used, prior = self.grid.used, self.grid.prior
        time = np.repeat(self.grid.time, np.diff(self.grid.event_offsets))
        rows = CriterionRows(self.grid.run_index[used], time[used], self.grid.sensors[used])
        count = 0 if prior is None else len(prior.values)
        if self.free_runs is not None:
            rows = self.free_runs.rows
        else:
            count += NOISE_SENSOR
        ends = (np.full(count, end) for end in (-1, 0.0, -1))
        return CriterionRows(*(np.concatenate(pair) for pair in zip(rows, ends, strict=True)))

    def evaluate(self, x: FloatArray) -> Innovations:
        """(N,) innovations that count, in SI and rad, or errors of free runs, then those of the priors; variances."""
        if self.free_runs is not None:
            parts = [self.free_runs.errors(self.coordinates.model(x))]
        else:
            parts = [self.filtered(x)[0], self.coordinates.disturbance_errors(x)]
        if self.grid.prior is not None:
            parts.append(self.grid.prior.errors(self.coordinates, x))
        return Innovations(*map(np.concatenate, zip(*parts, strict=True)))

    def filtered(self, x: FloatArray, *, keep: bool = False) -> tuple[Innovations, FloatArray]:
        """Innovations that count, or errors of free runs, without priors; (n, 12) filtered states if asked for."""
        grid, model = self.grid, self.coordinates.model(x)
        # An effect far outside its range may give forces that are not finite: the likelihood is then the worst.
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            inputs = grid.inputs(model) if any(map(is_of_actuators, self.coordinates.effects)) else grid.plain_inputs
        error, variance = np.empty((2, len(grid.values)))
        states = np.zeros((len(grid.time) if keep else 0, STATES))
        readings = (grid.offsets, grid.time, inputs, grid.event_offsets, grid.sensors, grid.values)
        begin = (grid.starts, grid.start_std, grid.speed, grid.yaw_only)
        filter_runs(*readings, *begin, model.coefficients, self.coordinates.noise(x), error, variance, states)
        if self.free_runs is not None:
            return self.free_runs.errors(model), states
        return Innovations(error[grid.used], variance[grid.used]), states

    def value_of(self, innovations: Innovations) -> float:
        """Negative log-likelihood of ``innovations``."""
        return total_negative_log_likelihood(innovations, 1.0)

    def value(self, x: FloatArray) -> float:
        """Negative log-likelihood at ``x``."""
        return self.value_of(self.evaluate(x))

    def values(self, points: Sequence[FloatArray]) -> list[float]:
        """Negative log-likelihood at each of the ``points``, on all cores."""
        return thread_map(self.value, points)

    def jacobian(self, x: FloatArray, centre: Innovations | None = None) -> tuple[BoolArray, list[Jacobian]]:
        """(p,) free coordinates, and Jacobians by these; ``centre`` are the innovations at ``x`` where known."""
        free = self.free
        steps = self.coordinates.steps(x)
        # Differences go inwards at an upper bound.
        steps = np.where(x + steps > self.coordinates.high, -steps, steps)
        points = [x + np.where(np.arange(len(x)) == at, steps, 0.0) for at in np.flatnonzero(free)]
        if centre is None:
            points.append(x)
        found = thread_map(self.evaluate, points)
        if centre is None:
            centre = found.pop()
        return free, list(jacobian_chunks(centre, found, steps[free], 1.0))

    def equations(self, x: FloatArray, centre: Innovations | None = None) -> NormalEquations:
        """(p,) gradient and (p, p) Fisher information; zeros for fixed coordinates."""
        return self.equations_of(*self.jacobian(x, centre))

    @staticmethod
    def equations_of(free: BoolArray, pieces: Sequence[Jacobian]) -> NormalEquations:
        """`equations` by the Jacobians of `jacobian`."""
        own = NormalEquations.from_jacobians(pieces)
        gradient, information = np.zeros(len(free)), np.zeros((len(free), len(free)))
        gradient[free] = own.gradient
        information[np.ix_(free, free)] = own.information
        return NormalEquations(gradient, information)

    @property
    def of_logs(self) -> Self:
        """The same criterion without the prior."""
        return replace(self, grid=replace(self.grid, prior=None))

    def with_coordinates(self, coordinates: PlanarCoordinates) -> Self:
        """The same data with other coordinates."""
        return replace(self, coordinates=coordinates)
