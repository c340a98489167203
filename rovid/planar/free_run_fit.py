"""Fit of free-running simulations to smoothed speeds, for models that miss too much for their innovations.

Runs of many time constants are cut into windows. The simulation of a window begins at its measured speeds; the sum of
squares of its errors in u, v and r, each in shares of its standard deviation, is the least (Ljung 1999, section 7.2,
the output-error criterion).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Self

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.core.threads import thread_map
from rovid.estimate.fisher_information import inverse_information, sandwich_covariance
from rovid.estimate.maximum_likelihood import INNOVATIONS_R2, MAX_R2_LOSS
from rovid.planar.coordinates import PlanarCoordinates, is_of_actuators
from rovid.planar.dataset import PlanarData
from rovid.planar.integration import STATES, simulate_runs
from rovid.planar.model import PlanarModel
from rovid.planar.optimum import PlanarOptimum
from rovid.planar.simulation import PlanarMotion, free_run_r2, mean_free_run_r2
from rovid.planar.smoothing import SmoothRun, measured_axes, slowest_interval, smooth_run
from rovid.planar.start_values import start_values

# Longest window, and length of the blocks whose scatter gives the errors, in the longest time constant; least number of
# blocks. Short windows let a wrong model lean on the measured speeds at their start.
_WINDOW, _BLOCK, _LEAST_BLOCKS = 20.0, 4.0, 12
# Width of the smoothing in the shortest time constant, and in intervals of the slowest sensor at least.
_WIDTH, _LEAST_WIDTH = 0.2, 2.0
# Least standard deviation of a speed that counts, in its RMS value: a cruise at one speed says little about the rest.
_LEAST_CHANGE = 0.1
# Largest error of a simulation in these sizes: beyond it the simulation diverges.
_LARGEST = 30.0
# Starts of the fit beside the likeliest model.
_STARTS = 2
# Evaluations with a Jacobian, difference step, and rounds of steps to fit noise and disturbance.
_EVALUATIONS, _STEP, _NOISE_ITERATIONS = 60, 1e-5, 12


@dataclass(frozen=True, eq=False)
class FreeRuns:
    """Smoothed runs in windows, whose simulations are compared with the smoothed speeds."""

    data: PlanarData
    coordinates: PlanarCoordinates
    width: float  #: s; standard deviation of the smoothing kernel.
    yaw_only: bool

    @classmethod
    def of(cls, data: PlanarData, coordinates: PlanarCoordinates, *, yaw_only: bool) -> Self:
        """The runs of ``data``, for models with these ``coordinates``."""
        time = coordinates.sizes.time[2:] if yaw_only else coordinates.sizes.time
        slowest = max(slowest_interval(run) for run in data.runs)
        return cls(data, coordinates, max(_WIDTH * float(time.min()), _LEAST_WIDTH * slowest), yaw_only)

    @cached_property
    def _smooth(self) -> list[SmoothRun]:
        return self._smoothed(())

    def _smoothed(self, effects: tuple[object, ...]) -> list[SmoothRun]:
        return [one for run in self.data.runs if (one := smooth_run(run, self.width, effects)) is not None]

    def _cut(self, longest: float) -> IntArray:
        """First row of each part of the runs, and the number of all rows; equal parts of nearly ``longest`` s."""
        begin, found = 0, [0]
        for run in self._smooth:
            count = math.ceil(float(run.time[-1] - run.time[0]) / longest)
            found += [begin + round(len(run.time) * part / count) for part in range(1, count + 1)]
            begin += len(run.time)
        return np.array(found, dtype=np.intp)

    @cached_property
    def _offsets(self) -> IntArray:
        return self._cut(_WINDOW * self._slowest)

    @property
    def _slowest(self) -> float:
        return float(self.coordinates.sizes.time[2 if self.yaw_only else 0 :].max())

    @cached_property
    def _measured(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """(n,) s; (n, 3) speeds; (w, 6) starts; (a,) sizes of the measured ones."""
        time, heading, speeds = (
            np.concatenate([getattr(run, name) for run in self._smooth]) for name in ("time", "heading", "speeds")
        )
        first = self._offsets[:-1]
        starts = np.zeros((len(first), 6))
        starts[:, 0], starts[:, 1:4] = heading[first], speeds[first]
        own = speeds[:, self._axes]
        usual = np.maximum(np.std(own, axis=0), _LEAST_CHANGE * np.sqrt(np.mean(own**2, axis=0)))
        return time, speeds, starts, usual

    @cached_property
    def _axes(self) -> list[int]:
        known = (False, False, True) if self.yaw_only else measured_axes(self.data.sensors)
        return np.flatnonzero(known).tolist()

    def inputs(self, model: PlanarModel) -> FloatArray:
        """(n, k) inputs from each row to the next, through the kernel of the speeds."""
        effects = tuple(one for one in model.effects if is_of_actuators(one.effect))
        return _held_inputs(self._smoothed(effects)) if effects else self._plain_inputs

    @cached_property
    def _plain_inputs(self) -> FloatArray:
        return _held_inputs(self._smooth)

    def errors(self, x: FloatArray) -> FloatArray:
        """(n, a) simulated minus measured speeds in shares of their standard deviations."""
        model, (time, speeds, starts, usual) = self.coordinates.model(x), self._measured
        states = np.zeros((len(time), STATES))
        scale, size = self.coordinates.sizes.speed, model.coefficients
        with np.errstate(over="ignore", invalid="ignore"):
            held = self.inputs(model)
            simulate_runs(self._offsets, time, held, starts, scale, self.yaw_only, size, states)
            motion = PlanarMotion.of_states(time, states, model.current)
            found = np.column_stack((motion.surge_velocity, motion.sway_velocity, motion.yaw_rate)) - speeds
            found = found[:, self._axes] / usual
        return np.clip(np.nan_to_num(found, nan=_LARGEST, posinf=_LARGEST, neginf=-_LARGEST), -_LARGEST, _LARGEST)

    def jacobian(self, x: FloatArray, free: IntArray) -> FloatArray:
        """(n a, f) derivatives of `errors` by the ``free`` coordinates."""
        steps = np.where(x + _STEP > self.coordinates.high, -_STEP, _STEP)[free]
        points = [x + step * (np.arange(len(x)) == at) for at, step in zip(free.tolist(), steps.tolist(), strict=True)]
        centre, *sides = thread_map(self.errors, [x, *points])
        return np.column_stack([(one - centre).ravel() / step for one, step in zip(sides, steps, strict=True)])

    def fit(self, start: FloatArray) -> tuple[FloatArray, float]:
        """(p,) coordinates with the least mean square error from ``start``, and that error; noise stays as it is."""
        # Imported here because the import takes longer than commands that fit nothing.
        from scipy.optimize import least_squares

        free, (low, high) = self._free, self.coordinates.bounds
        # The search begins within its bounds.
        room = np.minimum(1e-6, 0.25 * (high - low)[free])
        begin = np.clip(start[free], low[free] + room, high[free] - room)

        def whole(part: FloatArray) -> FloatArray:
            x = start.copy()
            x[free] = part
            return x

        def residuals(part: FloatArray) -> FloatArray:
            return self.errors(whole(part)).ravel()

        def derivatives(part: FloatArray) -> FloatArray:
            return self.jacobian(whole(part), free)

        found = least_squares(
            residuals,
            begin,
            jac=derivatives,
            bounds=(low[free], high[free]),
            x_scale=np.maximum(np.abs(begin), 0.1),
            max_nfev=_EVALUATIONS,
        )
        x = self.coordinates.projected(whole(found.x))
        return x, float(np.mean(self.errors(x) ** 2))

    @property
    def _free(self) -> IntArray:
        return np.flatnonzero(self.coordinates.free[: self.coordinates.noise_begin])

    def covariance(self, x: FloatArray) -> FloatArray:
        """(noise_begin, noise_begin) of the model's coordinates, by the scatter between blocks."""
        free, error = self._free, self.errors(x)
        matrix = self.jacobian(x, free)
        bread = inverse_information(matrix.T @ matrix)
        total = sum(float(run.time[-1] - run.time[0]) for run in self._smooth)
        edges = error.shape[1] * self._cut(min(_BLOCK * self._slowest, total / _LEAST_BLOCKS))
        rows = [slice(first, last) for first, last in pairwise(edges.tolist())]
        scores = np.array([matrix[one].T @ error.ravel()[one] for one in rows])
        full = np.zeros((self.coordinates.noise_begin, self.coordinates.noise_begin))
        full[np.ix_(free, free)] = sandwich_covariance(bread, scores)
        return full


def _held_inputs(runs: Iterable[SmoothRun]) -> FloatArray:
    means = [np.vstack((0.5 * (run.inputs[1:] + run.inputs[:-1]), run.inputs[-1:])) for run in runs]
    return np.ascontiguousarray(np.concatenate(means))


def fit_free_runs(best: PlanarOptimum, data: PlanarData, starts: Iterable[PlanarModel]) -> PlanarOptimum:
    """The best fit of free-running simulations from ``best`` and ``starts``, with its own noise and disturbance."""
    coordinates, grid = best.coordinates, best.likelihood.grid
    runs = FreeRuns.of(data, coordinates, yaw_only=grid.yaw_only)
    count = coordinates.noise_begin
    points = [best.x]
    for model in starts:
        first = coordinates.initial(model, [one.parameters for one in best.model.effects])
        points.append(coordinates.projected(np.concatenate((first[:count], best.x[count:]))))
    x, _ = min((runs.fit(point) for point in points), key=lambda one: one[1])
    # Disturbance and noise of this model, by the innovations.
    held = [np.concatenate((x[:count], one[count:])) for one in coordinates.bounds]
    likelihood = best.likelihood.with_coordinates(replace(coordinates, low=held[0], high=held[1]))
    noise = PlanarOptimum.fit(likelihood, x, _NOISE_ITERATIONS)
    found = np.concatenate((x[:count], noise.x[count:]))
    if not math.isfinite(noise.value):
        return best
    return PlanarOptimum(best.likelihood, found, noise.value, free_run_covariance=runs.covariance(x))


def better_simulating(best: PlanarOptimum, data: PlanarData) -> PlanarOptimum:
    """``best``, or the fit of free-running simulations where the model misses much and that fit simulates better.

    What a user means by a wrong model is the free-running simulation. Where the innovations are not white and the
    disturbance is at its limit, they say little about it.
    """
    yaw_only = best.likelihood.grid.yaw_only
    # With measurements of yaw alone the results are those of one axis.
    if yaw_only or best.is_white or not best.limited.any():
        return best
    r2 = free_run_r2(best.model, data, yaw_only=yaw_only)
    if all(value >= INNOVATIONS_R2 for value in r2.values()):
        return best
    starts = [one.model for one in start_values(data, with_current=False)]
    starts.sort(key=lambda model: -mean_free_run_r2(model, data, yaw_only=yaw_only))
    other = fit_free_runs(best, data, starts[:_STARTS])
    gained = mean_free_run_r2(other.model, data, yaw_only=yaw_only) - mean_free_run_r2(
        best.model, data, yaw_only=yaw_only
    )
    return other.canonical() if gained > MAX_R2_LOSS else best
