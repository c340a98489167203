"""Free-running simulation of runs, how well it explains the measured speeds, and fits of it.

`fit_free_runs` fits models that miss too much for their innovations to smoothed speeds.

Runs of many time constants are cut into windows. The simulation of a window begins at its measured speeds; the sum of
squares of its errors in u, v and r is the least (Ljung 1999, section 7.2, the output-error criterion). `FreeRuns` takes
the place of the innovations in a `PlanarLikelihood`, so search, errors and held-out tests are those of the innovations.
The errors of a simulation are correlated. Their variance is therefore multiplied by their correlation time in samples,
and n correlated errors count as the equivalent number of independent ones (Priestley 1981, section 5.3.2).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Self

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.estimate.estimate import r_squared
from rovid.estimate.fisher_information import Innovations
from rovid.estimate.maximum_likelihood import INNOVATIONS_R2, MAX_R2_LOSS
from rovid.model.bound_effects import BoundEffect
from rovid.planar import dataset
from rovid.planar.coordinates import PlanarSizes
from rovid.planar.equations import CURRENT, HEADING, NORTH, STATES, SURGE, simulate_runs
from rovid.planar.likelihood import CriterionRows
from rovid.planar.model import AXIS_NAMES, AXIS_SPEEDS, SENSORS, PlanarModel
from rovid.planar.optimum import PlanarOptimum
from rovid.planar.start_values import start_values, with_rudders_of

# Time constants whose readings determine the start of a simulation, least number of readings, Gauss-Newton steps.
_START_TIMES, _START_READINGS, _START_ITERATIONS = 2.0, 30, 4
# Longest window in the longest time constant. Short windows let a wrong model lean on the measured speeds at their
# start.
_WINDOW = 20.0
# Width of the smoothing in the shortest time constant, and in intervals of the slowest sensor at least.
_WIDTH, _LEAST_WIDTH = 0.2, 2.0
# Least standard deviation of a speed that counts, in its RMS value: a cruise at one speed says little about the rest.
_LEAST_CHANGE = 0.1
# Largest error of a simulation in these sizes: beyond it the simulation diverges. The least error that counts in them.
_LARGEST, _LEAST_ERROR = 30.0, 0.02
# Least mean R^2 of the likeliest model for its difference to count as an error of the best free-running simulation. A
# decision.
_LEAST_R2 = 0.5
# Steps to fit noise and disturbance.
_NOISE_ITERATIONS = 12


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarMotion:
    """Free-running simulation of a run at the instants of its ``time``."""

    time: FloatArray  #: (n,) s.
    heading: FloatArray  #: (n,) rad.
    #: ``surge_velocity``, ``sway_velocity``: (n,) m/s over ground, in body axes; ``yaw_rate``: (n,) rad/s.
    surge_velocity: FloatArray
    sway_velocity: FloatArray
    yaw_rate: FloatArray
    #: ``north``, ``east``: (n,) m.
    north: FloatArray
    east: FloatArray
    through_water: FloatArray  #: (n, 3) u, v, r.

    @classmethod
    def simulated(
        cls,
        model: PlanarModel,
        offsets: IntArray,
        time: FloatArray,
        inputs: FloatArray,
        starts: FloatArray,
        speed: FloatArray,
        *,
        yaw_only: bool = False,
        sensors: Sequence[str] = SENSORS,
    ) -> Self:
        """The motion by `rovid.planar.equations.simulate_runs`, of runs or windows one after the other.

        ``starts``: (runs, 6) as the ``sensors`` of the logs read them at their places; see `PlanarModel.places`.
        """
        states, first = np.zeros((len(time), STATES)), starts.copy()
        log_x, log_y, x, y = model.places(sensors)
        cosine, sine, rate = np.cos(first[:, 0]), np.sin(first[:, 0]), first[:, 3]
        first[:, [1, 2, 4, 5]] -= np.column_stack(
            (-log_y * rate, log_x * rate, x * cosine - y * sine, x * sine + y * cosine)
        )
        simulate_runs(offsets, time, inputs, first, speed, yaw_only, model.coefficients, states)
        return cls.of_states(time, states, model, sensors)

    @classmethod
    def of_states(
        cls, time: FloatArray, states: FloatArray, model: PlanarModel, sensors: Sequence[str] = SENSORS
    ) -> Self:
        """The motion of (n, 12) states of `rovid.planar.kernels`, at the places of the ``sensors``."""
        heading, rate, current = states[:, HEADING], states[:, SURGE + 2], model.current
        cosine, sine = np.cos(heading), np.sin(heading)
        log_x, log_y, x, y = model.places(sensors)
        north, east = current[0] + states[:, CURRENT], current[1] + states[:, CURRENT + 1]
        return cls(
            time=time,
            heading=heading,
            surge_velocity=states[:, SURGE] + north * cosine + east * sine - log_y * rate,
            sway_velocity=states[:, SURGE + 1] + east * cosine - north * sine + log_x * rate,
            yaw_rate=rate,
            north=states[:, NORTH] + x * cosine - y * sine,
            east=states[:, NORTH + 1] + x * sine + y * cosine,
            through_water=states[:, SURGE : SURGE + 3],
        )

    def sensor(self, name: str) -> FloatArray:
        """(n,) noise-free readings of a sensor, by its name."""
        return np.asarray(getattr(self, name))

    def sensors(self, names: Sequence[str]) -> FloatArray:
        """(n, k) noise-free readings of k sensors."""
        return np.column_stack(list(map(self.sensor, names)))


def simulate_planar(
    model: PlanarModel, run: dataset.PlanarRun, start: FloatArray | None = None, *, yaw_only: bool = False
) -> PlanarMotion:
    """Free-running simulation of ``run``.

    ``start``: (6,) heading, u and v over ground, r, north and east at the first instant; by default from the readings.
    ``yaw_only``: Whether surge and sway are left out.
    """
    inputs = run.forces(model.actuator_effects).inputs
    first = measured_start(run) if start is None else np.asarray(start, dtype=np.float64)
    speed = np.maximum(np.abs(first[1:4]), 0.1)
    offsets = np.array([0, len(run.time)])
    return PlanarMotion.simulated(
        model, offsets, run.time, inputs, first[None], speed, yaw_only=yaw_only, sensors=run.sensors
    )


def measured_start(run: dataset.PlanarRun) -> FloatArray:
    """(6,) heading, u and v over ground, r, north and east at the first instant, by the readings; zeros where none."""
    start = np.zeros(6)
    smooth = dataset.smooth_motion(run)
    if smooth is not None:
        start[1:4] = smooth.speeds[0]
    for at, name in ((0, "heading"), (4, "north"), (5, "east")):
        if name in run.sensors:
            start[at] = run.readings(name).values[0]
    return start


def estimated_start(model: PlanarModel, run: dataset.PlanarRun, *, yaw_only: bool) -> FloatArray:
    """(6,) heading, u and v over ground, r, north and east at the first instant of a run.

    Least squares of the simulation against the readings of the first time constants, by the Gauss-Newton method.
    """
    start = measured_start(run)
    speed = np.maximum(np.abs(start[1:4]), 0.1)
    rates = (model.base[4:7] + 2.0 * model.base[7:10] * speed) / np.diag(model.mass_matrix)
    fastest = float(rates.max())  # 1/s; 0 without drag, as where no actuator acts
    last = int(np.searchsorted(run.time, run.time[0] + _START_TIMES / fastest)) if fastest else len(run.time)
    events = max(int(np.searchsorted(run.event_index, last)), _START_READINGS)
    index, sensor, value = run.event_index[:events], run.event_sensor[:events], run.event_value[:events]
    rows = slice(0, int(index[-1]) + 2)
    inputs, time = run.forces(model.actuator_effects).inputs[rows], run.time[rows]
    noise = np.array([dataset.sensor_noise(run, SENSORS[at]) if at in sensor else 1.0 for at in range(len(SENSORS))])
    weight = 1.0 / np.where(noise > 0.0, noise, 1.0)[sensor]

    def simulated(first: FloatArray) -> FloatArray:
        offsets = np.array([0, len(time)])
        motion = PlanarMotion.simulated(
            model, offsets, time, inputs, first[None], speed, yaw_only=yaw_only, sensors=run.sensors
        )
        return weight * motion.sensors(SENSORS)[index, sensor]

    steps = 1e-4 * np.array([1.0, *speed, 1.0, 1.0])
    free = [0, 3] if yaw_only else range(len(start))
    for _ in range(_START_ITERATIONS):
        now = simulated(start)
        columns = [(simulated(start + steps * (np.arange(len(start)) == at)) - now) / steps[at] for at in free]
        jacobian = np.column_stack(columns)
        if not (np.isfinite(now).all() and np.isfinite(jacobian).all()):
            return measured_start(run)  # The model diverges within the readings.
        # The least-norm step: components that these readings do not determine keep their values.
        change = np.linalg.lstsq(jacobian, weight * value - now, rcond=1e-9)[0]
        start = start + np.bincount(list(free), change, len(start))
    return start


def free_run_r2(model: PlanarModel, data: dataset.PlanarData, *, yaw_only: bool = False) -> Mapping[str, float]:
    """Axis -> R^2 of the free-running speed against the measured one; axes that are not measured are left out.

    Both come from readings of the same sensors through the same kernel.
    """
    measured, simulated = list[FloatArray](), list[FloatArray]()
    for run in data.runs:
        smooth = dataset.smooth_motion(run)
        if smooth is None:
            continue
        start = estimated_start(model, run, yaw_only=yaw_only)
        motion = simulate_planar(model, run, start, yaw_only=yaw_only)
        read = motion.sensors(SENSORS)[run.event_index, run.event_sensor]
        other = dataset.smooth_motion(replace(run, event_value=read))
        assert other is not None  # noqa: S101 - the measured run is as long
        measured.append(smooth.speeds)
        simulated.append(other.speeds)
    if not measured:
        return {}
    whole, rest = np.concatenate(measured), np.concatenate(measured) - np.concatenate(simulated)
    known = (False, False, True) if yaw_only else dataset.measured_axes(data.sensors)
    return {name: r_squared(whole[:, at], rest[:, at]) for at, name in enumerate(AXIS_NAMES) if known[at]}


def mean_free_run_r2(model: PlanarModel, data: dataset.PlanarData, *, yaw_only: bool) -> float:
    """Mean R^2 of the free-running speeds, each -1 at least."""
    with np.errstate(over="ignore", invalid="ignore"):
        r2 = free_run_r2(model, data, yaw_only=yaw_only)
    return float(np.mean([max(value, -1.0) if math.isfinite(value) else -1.0 for value in r2.values()] or [-1.0]))


@dataclass(frozen=True, eq=False)
class FreeRuns:
    """Smoothed runs in windows, whose simulations are compared with the smoothed speeds."""

    data: dataset.PlanarData
    width: float  #: s; standard deviation of the smoothing kernel.
    #: Number of each run that is long enough, and its smoothed motion.
    smooth: tuple[tuple[int, dataset.SmoothRun], ...]
    offsets: IntArray  #: (w + 1,) first row of each window, and the number of all rows.
    scale: FloatArray  #: (3,) typical speeds.
    usual: FloatArray  #: (a,) typical changes of the measured speeds.
    variance: FloatArray  #: (a,) of the errors, in SI, times their correlation time in samples.

    @classmethod
    def of(cls, data: dataset.PlanarData, sizes: PlanarSizes) -> Self | None:
        """The runs of ``data``, with the same weight for errors of all axes; None where all runs are too short."""
        slowest = max(map(dataset.slowest_interval, data.runs))
        width = max(_WIDTH * float(sizes.time.min()), _LEAST_WIDTH * slowest)
        found = [(at, one) for at, run in enumerate(data.runs) if (one := dataset.smooth_run(run, width)) is not None]
        if not found:
            return None
        offsets = [0]
        for _, run in found:
            count, begin = (
                math.ceil(float(run.time[-1] - run.time[0]) / (_WINDOW * float(sizes.time.max()))),
                offsets[-1],
            )
            offsets += [begin + round(len(run.time) * part / count) for part in range(1, count + 1)]
        axes = np.flatnonzero(dataset.measured_axes(data.sensors))
        own = np.concatenate([run.speeds for _, run in found])[:, axes]
        usual = np.maximum(np.std(own, axis=0), _LEAST_CHANGE * np.sqrt(np.mean(own**2, axis=0)))
        return cls(data, width, tuple(found), np.array(offsets, dtype=np.intp), sizes.speed, usual, usual**2)

    @cached_property
    def _axes(self) -> IntArray:
        return np.flatnonzero(dataset.measured_axes(self.data.sensors))

    @cached_property
    def _measured(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(n,) s; (n, 3) speeds; (w, 6) starts."""
        names = ("time", "heading", "speeds")
        time, heading, speeds = (np.concatenate([getattr(run, name) for _, run in self.smooth]) for name in names)
        first = self.offsets[:-1]
        starts = np.zeros((len(first), 6))
        starts[:, 0], starts[:, 1:4] = heading[first], speeds[first]
        return time, speeds, starts

    @cached_property
    def rows(self) -> CriterionRows:
        """Origin of the (n a,) errors."""
        count = len(self._axes)
        run = np.concatenate([np.full(len(one.time), at) for at, one in self.smooth])
        sensors = np.array([SENSORS.index(AXIS_SPEEDS[axis]) for axis in self._axes.tolist()], dtype=np.intp)
        first = [self.data.runs[at].time[0] for at, _ in self.smooth]
        time = np.concatenate([one.time - begin for (_, one), begin in zip(self.smooth, first, strict=True)])
        return CriterionRows(np.repeat(run, count), np.repeat(time, count), np.tile(sensors, len(time)))

    def _inputs(self, effects: tuple[BoundEffect, ...]) -> FloatArray:
        """(n, k) inputs from each row to the next, with ``effects`` between command and thrust."""
        each = [dataset.mean_inputs(self.data.runs[at], self.width, effects) for at, _ in self.smooth]
        means = [np.vstack((0.5 * (one[1:] + one[:-1]), one[-1:])) for one in each]
        return np.ascontiguousarray(np.concatenate(means))

    @cached_property
    def _plain_inputs(self) -> FloatArray:
        return self._inputs(())

    def _differences(self, model: PlanarModel) -> FloatArray:
        """(n, a) simulated minus measured speeds in SI; bounded where the simulation diverges."""
        time, speeds, starts = self._measured
        most = _LARGEST * self.usual
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            inputs = self._inputs(model.actuator_effects) if model.actuator_effects else self._plain_inputs
            logged = self.data.sensors
            motion = PlanarMotion.simulated(model, self.offsets, time, inputs, starts, self.scale, sensors=logged)
            found = motion.sensors(AXIS_SPEEDS)
            # The kernel of the measured speeds, over each run.
            ends = np.cumsum([len(run.time) for _, run in self.smooth])[:-1]
            found = np.concatenate(list(map(dataset.smoothed, np.split(found, ends)))) - speeds
        return np.clip(np.where(np.isfinite(found), found, math.inf)[:, self._axes], -most, most)

    def errors(self, model: PlanarModel) -> Innovations:
        """(n a,) errors of the simulations of ``model`` in SI, and their variances."""
        found = self._differences(model)
        return Innovations(found.ravel(), np.tile(self.variance, len(found)))

    def weighted(self, model: PlanarModel) -> Self:
        """The same runs with the variance and the correlation time of the errors of ``model``.

        The axes keep their weights: with those of the errors, an axis that the model misses would no longer tie the
        inertia to the thrust.
        """
        found = self._differences(model) / self.usual
        size = max(float(np.mean(found**2)), _LEAST_ERROR**2)
        windows = [found[begin:end] for begin, end in pairwise(self.offsets.tolist())]
        return replace(self, variance=self.usual**2 * size * correlation_time(windows))


def correlation_time(windows: Sequence[FloatArray]) -> float:
    """Samples of (n, a) errors that count as one: the sum of the mean autocorrelation to its first zero."""
    total = np.zeros(max(map(len, windows)))
    for one in windows:
        power = np.abs(np.fft.rfft(one, 2 * len(one), axis=0)) ** 2
        total[: len(one)] += np.fft.irfft(power, axis=0)[: len(one)].sum(axis=1)
    shares = total / max(float(total[0]), 1e-300)
    positive = np.cumprod(shares > 0.0)
    return float(1.0 + 2.0 * np.sum((shares * positive)[1:]))


def fit_free_runs(best: PlanarOptimum, data: dataset.PlanarData) -> PlanarOptimum:
    """The best fit of free-running simulations from ``best`` and a regression, with its own noise and disturbance.

    Runs that are all too short for it leave ``best`` as it is.
    """
    runs = FreeRuns.of(data, best.coordinates.sizes)
    if runs is None:
        return best
    coordinates, count = best.coordinates, best.coordinates.noise_begin
    # The likelihood may have led far astray; the regression that simulates best has not.
    regressed = [start.model for start in start_values(data, with_current=False)]
    start = max(regressed, key=lambda model: mean_free_run_r2(model, data, yaw_only=False))
    first = coordinates.initial(with_rudders_of(best.model, start), [one.parameters for one in best.model.effects])
    points = [best.x, coordinates.projected(np.concatenate((first[:count], best.x[count:])))]
    likelihood = replace(best.likelihood, free_runs=runs)
    found = min((PlanarOptimum.fit(likelihood, point) for point in points), key=lambda one: one.value)
    found = PlanarOptimum.fit(replace(likelihood, free_runs=runs.weighted(found.model)), found.x)
    # Disturbance and noise of this model, by the innovations.
    held = [np.concatenate((found.x[:count], one[count:])) for one in coordinates.bounds]
    of_noise = best.likelihood.with_coordinates(replace(coordinates, low=held[0], high=held[1]))
    noise = PlanarOptimum.fit(replace(of_noise, free_runs=None), found.x, _NOISE_ITERATIONS)
    if not math.isfinite(noise.value):
        return found
    return replace(found, x=np.concatenate((found.x[:count], noise.x[count:])))


def misses_much(best: PlanarOptimum, data: dataset.PlanarData, *, whitened: bool = False) -> bool:
    """Whether the model is so wrong that its likelihood says little.

    The innovations are not white, the disturbance is at its limit, and free-running simulations are poor. ``whitened``
    innovations count as not white.
    """
    if (best.is_white and not whitened) or not best.limited.any():
        return False
    return any(value < INNOVATIONS_R2 for value in free_run_r2(best.model, data).values())


def better_simulating(best: PlanarOptimum, data: dataset.PlanarData) -> PlanarOptimum:
    """``best``, or the fit of free-running simulations where the model misses much and that fit simulates better.

    What a user means by a wrong model is the free-running simulation. A model with effects misses nothing if a larger
    disturbance makes its innovations white, as rough water does: it is then fitted with that. A current that wanders
    whitens the innovations whatever the model misses.
    """
    # With measurements of yaw alone the results are those of one axis.
    if best.likelihood.grid.yaw_only or best.is_multi_step or not misses_much(best, data):
        return best
    wanders = any(getattr(one.acts, "wanders", False) for one in best.effects)
    if best.effects and not wanders and best.loosened(held=True).is_white:
        loose = best.loosened()
        if loose.is_white and not loose.limited.any():
            return loose
    other = fit_free_runs(best, data).canonical()
    before, after = (mean_free_run_r2(one.model, data, yaw_only=False) for one in (best, other))
    if after - before <= MAX_R2_LOSS:
        return best
    return replace(other, likeliest=best.model.values) if before > _LEAST_R2 else other
