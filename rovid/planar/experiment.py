"""Experiment design of the planar model: the run that reduces the standard error of a parameter most. docs/plan.md.

Candidate runs are steps, sines, circles, zigzags, random levels and a square.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray
from rovid.core.errors import ConfigError, DataError, suggestion
from rovid.core.formatting import significant
from rovid.estimate.candidate_runs import LEAD_SECONDS, CandidateRun, RunLimits
from rovid.estimate.experiment_design import ExpectedInformation, ExperimentPlan
from rovid.estimate.fisher_information import inverse_information
from rovid.planar.dataset import PlanarData, PlanarRun, slowest_interval, smooth_run
from rovid.planar.fit import PlanarFit, planar_result
from rovid.planar.free_runs import simulate_planar
from rovid.planar.likelihood import PlanarGrid, PlanarLikelihood
from rovid.planar.model import AXIS_NAMES, SENSORS
from rovid.planar.optimum import PlanarOptimum
from rovid.planar.start_values import START_STD
from rovid.planar.uncertainty import MAX_ERROR, parameter_scale
from rovid.trial.trial import Readings, Trial

# Shares of the full demand; length of a run in longest time constants; that of a step in time constants and its least
# in s, which a crew and its drives can play. Conventions.
_LEVELS, _LENGTH, _HOLD, _SHORTEST_HOLD = (0.3, 0.6, 1.0), 40.0, 4.0, 4.0
# Seed of random levels: a plan is the same whenever it is made.
_SEED = 20130401
# Points of a thrust curve that is inverted, and least share of a unit demand that the thrusters can follow.
_POINTS, _LEAST_SHARE = 401, 0.1
# Duration in s and demands along surge, sway and yaw, -1 to 1.
_Piece = tuple[float, Sequence[float] | FloatArray]
# Largest predicted speed over the largest in the logs: beyond it the model is not known.
_ENVELOPE = 1.5
# Longest interval between instants of a command file in the shortest time constant, and the shortest in s.
_INTERVAL, _LEAST_INTERVAL = 0.1, 0.02
# rad; headings at the start of a run in a current, of which the least gain counts: the crew may start on any.
_HEADINGS = (0.0, math.pi / 3.0, 2.0 * math.pi / 3.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarAllocation:
    """Commands of all k actuators for demands along surge, sway and yaw, within those of the logs."""

    data: PlanarData
    bounds: FloatArray  #: (2, k) least and largest command; the command without thrust is between them.
    neutral: FloatArray  #: (k,)
    ways: FloatArray  #: (3, t) N of each thruster at a full demand along each axis; zeros where none can follow.
    unused: tuple[str, ...]  #: Thrusters that never run in the logs: they use as much of their curves as the others.

    @classmethod
    def of(cls, data: PlanarData, share: float) -> Self:
        """For the given ``share`` of the commands in the logs."""
        vehicle, own = data.vehicle, data.actuators.thruster_columns
        commands = np.vstack([run.trial.commands for run in data.runs])
        turned = data.actuators.angle_columns
        commands[:, turned] = (commands[:, turned] + math.pi) % (2.0 * math.pi) - math.pi
        curves = [one.curve for one in vehicle.thrusters]
        neutral = np.array([0.0 if curve is None else curve.neutral for curve in curves])
        used = np.nanmin(commands, axis=0), np.nanmax(commands, axis=0)
        bounds = np.array([np.fmin(used[0], neutral), np.fmax(used[1], neutral)])
        ends = bounds.copy()
        for at, curve in enumerate(curves):
            if curve is not None:
                ends[:, at] = curve.command[[0, -1]]
        bounds = np.clip(bounds, *ends)
        idle = [at for at in own.tolist() if bounds[0, at] == bounds[1, at]]
        reach = np.ptp(bounds, axis=0)[own] / np.maximum(np.ptp(ends, axis=0)[own], 1e-300)
        bounds[:, idle] = neutral[idle] + reach.max(initial=0.0) * (ends[:, idle] - neutral[idle])
        bounds = neutral + share * (bounds - neutral)
        ways = _ways(data.actuators.matrix, np.abs(vehicle.thrust(bounds))[:, own].max(axis=0))
        names = tuple(vehicle.thrusters[at].name for at in idle)
        return cls(data=data, bounds=bounds, neutral=neutral, ways=ways, unused=names)

    @property
    def driven(self) -> BoolArray:
        """(3,) whether an actuator acts along surge, sway and yaw."""
        turned = np.ptp(self.bounds, axis=0)[self.data.actuators.angle_columns]
        return np.array([way.any() or (axis == 2 and turned.any()) for axis, way in enumerate(self.ways)], dtype=bool)

    def commands(self, demands: FloatArray) -> FloatArray:
        """(n, k) commands of (n, 3) demands."""
        found, wanted = np.tile(self.neutral, (len(demands), 1)), demands @ self.ways
        grid = np.linspace(self.bounds[0], self.bounds[1], _POINTS)
        thrust = self.data.vehicle.thrust(grid)
        for column, force in zip(self.data.actuators.thruster_columns.tolist(), wanted.T, strict=True):
            way = 1 if thrust[-1, column] >= thrust[0, column] else -1
            command = np.interp(force, np.maximum.accumulate(thrust[::way, column]), grid[::way, column])
            found[:, column] = np.where(force == 0.0, self.neutral[column], command)
        positions = {one.name: one.position or (0.0, 0.0) for one in self.data.vehicle.thrusters}
        for column in self.data.actuators.angle_columns.tolist():
            one = self.data.vehicle.thrusters[column]
            # A stern rudder turns the bow to the side of its angle, a stern thruster to the other side.
            ahead = -one.rudder.position[0] if one.rudder else positions[one.turns][0]
            turn = math.copysign(1.0, ahead) * demands[:, 2]
            found[:, column] = np.abs(turn) * np.where(turn > 0.0, self.bounds[1, column], self.bounds[0, column])
        return found + 0.0  # No -0 in the command file.


def _ways(matrix: FloatArray, thrusts: FloatArray) -> FloatArray:
    """(3, t) N of each thruster at a full demand, from the (3, t) ``matrix`` and the (t,) largest thrusts."""
    size = np.abs(matrix).max(axis=1, initial=0.0)
    scaled = matrix / np.where(size > 0.0, size, 1.0)[:, None]
    ways = np.zeros_like(matrix)
    for axis, row in enumerate(np.linalg.pinv(scaled, rcond=1e-6).T):
        used = (np.abs(row) > _LEAST_SHARE * np.abs(row).max(initial=0.0)) & (thrusts > 0.0)
        if scaled[axis] @ row > _LEAST_SHARE and used.any():
            ways[axis] = row * np.min(thrusts[used] / np.abs(row[used]))
    return ways


def planar_candidates_of(
    allocation: PlanarAllocation, axes: BoolArray, times: FloatArray, rate: float, period: float
) -> list[CandidateRun]:
    """Candidate runs along the (3,) ``axes``, each repeated for some time constants.

    (3,) ``times`` are the time constants in s, ``rate`` the usual yaw rate in rad/s, and ``period`` the interval
    between the instants of a command file in s.
    """
    runs, rest = [], (0.0, 0.0, 0.0)
    for level in _LEVELS:
        for name, pieces in _programmes(axes, times, 0.5 * math.pi / rate):
            seconds = sum(one for one, _ in pieces)
            count = max(1, int(_LENGTH * float(times[axes].max()) / seconds))
            time = period * np.arange(round((LEAD_SECONDS + count * seconds) / period) + 1, dtype=np.float64)
            starts = np.concatenate(([0.0], LEAD_SECONDS + np.cumsum([0.0, *[one for one, _ in pieces] * count])))
            levels = np.array([rest, *[one for _, one in pieces] * count, rest])
            # A tiny delay, because rounding must not move an instant to the previous level.
            at = np.searchsorted(starts, time + 1e-9, side="right") - 1
            named = f"{name}, at {100.0 * level:.0f} % of the command" + (f", {count} times" if count > 1 else "")
            runs.append(CandidateRun(name=named, time=time, commands=allocation.commands(level * levels[at])))
    return runs


def _programmes(axes: BoolArray, times: FloatArray, quarter: float) -> Iterator[tuple[str, Sequence[_Piece]]]:
    """Name and pieces of one period of each programme; a ``quarter`` turn takes so many s."""
    hold = np.maximum(_HOLD * times, _SHORTEST_HOLD).tolist()
    for axis in np.flatnonzero(axes).tolist():
        unit, coast = np.eye(3)[axis], (0.5 * hold[axis], np.zeros(3))
        parts = [(hold[axis], unit), coast, (hold[axis], -unit), coast]
        yield f"steps of {AXIS_NAMES[axis]} both ways, {hold[axis]:.0f} s each", parts
    rng = np.random.default_rng(_SEED)
    named = " and ".join(np.array(AXIS_NAMES)[axes].tolist())
    for word, typical in (("fast", 1.0), ("slow", 4.0)):
        lengths = max(typical * float(times[axes].min()), 0.5 * _SHORTEST_HOLD) * rng.uniform(0.5, 2.0, 16)
        levels = rng.uniform(-1.0, 1.0, (16, 3)) * axes
        yield f"{word} random levels of {named}", list(zip(lengths.tolist(), levels, strict=True))
    if axes[2]:
        for count in (3.0, 10.0):
            cycle = max(count * float(times[2]), _SHORTEST_HOLD)
            angles = 2.0 * math.pi * (np.arange(24) + 0.5) / 24.0
            yield f"sines of yaw of {cycle:.3g} s", [(cycle / 24.0, (0.0, 0.0, math.sin(one))) for one in angles]
    if axes[0] and axes[2]:
        long, swing = 2.0 * max(hold[0], hold[2]), max(2.0 * float(times[2]), _SHORTEST_HOLD)
        yield f"turning circles both ways, {long:.0f} s each", [(long, (1.0, 0.0, 0.7)), (long, (1.0, 0.0, -0.7))]
        swings = [(swing * (0.5, 1.0)[at > 0], (ahead, 0.0, (-1.0) ** at)) for ahead in (0.4, 1.0) for at in range(6)]
        yield f"zigzags at two speeds, {swing:.0f} s a swing", swings
        sides: list[_Piece] = [(hold[0], (1.0, 0.0, 0.0)), (quarter, (0.5, 0.0, 0.6))]
        yield f"square on about four headings, {hold[0]:.0f} s a side", sides * 4


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarPlan:
    """Candidate runs of the planar model, the best first."""

    ranked: ExperimentPlan  #: The parameter, and the runs with the predicted (3, n) u, v over ground and r.
    fit: PlanarFit  #: Of the logs at hand.
    #: Parameter -> standard error by the logs, and predicted with the best run; infinite where it is not determined.
    errors: Mapping[str, tuple[float, float]]
    left_out: Mapping[str, str]  #: Run that was left out -> why.
    warnings: tuple[str, ...]


def plan_planar(data: PlanarData, best: PlanarOptimum, limits: RunLimits, narrow: str = "") -> PlanarPlan:
    """The run that reduces most, per minute, the variance of the parameter ``narrow``, or of the least certain one.

    Raises ConfigError if there is no such parameter. Raises DataError if no run determines the parameter, nothing can
    be commanded, or no run stays within the limits.
    """
    fit, coordinates = planar_result(data, best), best.coordinates
    estimate, times, yaw_only = fit.estimate, coordinates.sizes.time, best.likelihood.grid.yaw_only
    names, scale, logged = estimate.names, parameter_scale(best), best.equations.information
    plain = _errors(best, logged)
    known = np.array([name not in estimate.refused for name in names])
    reported = np.where(known, np.sqrt(np.diag(estimate.covariance)), plain)
    target, reason = _target(best, fit, reported / scale, narrow)
    allocation = PlanarAllocation.of(data, limits.share)
    axes = allocation.driven & np.array([not yaw_only, not yaw_only, True])
    if not axes.any():
        raise DataError("no actuator runs in these logs: no commands can be planned.", mend="Log a run under thrust.")
    intervals = {}
    for name in data.sensors:
        stamps = [np.diff(run.readings(name).time) for run in data.runs if name in run.sensors]
        intervals[name] = float(np.median(np.concatenate(stamps)))
    period = max(min(*intervals.values(), _INTERVAL * float(times.min())), _LEAST_INTERVAL)
    smooth = [smooth_run(run, 2.0 * slowest_interval(run)) for run in data.runs]
    measured = np.concatenate([one.speeds for one in smooth if one is not None])
    found, left_out = list[tuple[ExpectedInformation, FloatArray]](), {}
    headings = _HEADINGS if any(best.model.current) else _HEADINGS[:1]
    starts = [_start(best.model.current, heading) for heading in headings]
    for run in planar_candidates_of(allocation, axes, times, float(coordinates.sizes.speed[2]), period):
        if run.seconds > limits.seconds + period:
            left_out[run.name] = "longer than the limit"
            continue
        planned = _planned(data, run, dict(intervals))
        motion = simulate_planar(best.model, planned, starts[0], yaw_only=yaw_only)
        speeds = np.array([motion.surge_velocity, motion.sway_velocity, motion.yaw_rate])
        if why := _excess(speeds, float(np.ptp(motion.heading)), measured, limits):
            left_out[run.name] = why
            continue
        each = [_errors(best, logged + _information(best, data, planned, start)) for start in starts]
        after = max(each, key=lambda errors: float(errors[target]))
        gain = 2.0 * math.log(plain[target] / after[target])
        found.append((ExpectedInformation(run=run, gain=gain, rates=speeds), after))
    if not found:
        reasons = ", or ".join(dict.fromkeys(left_out.values()))
        mend = "Allow a longer run, more turns or a higher rate, or smaller commands with --share."
        raise DataError(f"no run stays within these limits: each is {reasons}.", mend=mend)
    found.sort(key=lambda one: -one[0].gain_per_minute)
    # Where the reported errors are larger than those of the curvature, they stay so by the same factor.
    predicted = reported * np.divide(found[0][1], plain, out=np.ones(len(plain)), where=plain > 0.0)
    will_be = coordinates.free[: len(names)] & (known | (predicted <= MAX_ERROR * scale))
    pairs = np.column_stack((np.where(known, reported, np.inf), np.where(will_be, predicted, np.inf)))
    ranked = ExperimentPlan(
        models=(),
        parameter=names[target],
        runs=tuple(one for one, _ in found),
        thrusters=tuple(one.name for one in data.vehicle.thrusters),
        disturbance_rate=0.0,
        reason=reason,
    )
    return PlanarPlan(
        ranked=ranked,
        fit=fit,
        errors={name: (before, after) for name, (before, after) in zip(names, pairs.tolist(), strict=True)},
        left_out=left_out,
        warnings=tuple(_warnings(fit, allocation, guessed=bool((coordinates.free[: len(names)] & ~known).any()))),
    )


def _warnings(fit: PlanarFit, allocation: PlanarAllocation, *, guessed: bool) -> list[str]:
    found = list(fit.warnings)
    if guessed:
        text = "The prediction depends on parameters that these logs do not determine: begin with small commands."
        found.append(text)
    if fit.at_limit or not fit.white:
        found.append("The model misses something in these logs: the predicted standard errors are rough.")
    if allocation.unused:
        found.append(f"{', '.join(allocation.unused)} never runs in these logs; its commands are in no log.")
    if angles := [one.name for one in allocation.data.vehicle.thrusters if one.is_angle]:
        found.append(f"The command file gives {', '.join(angles)} in rad.")
    return found


def _target(best: PlanarOptimum, fit: PlanarFit, relative: FloatArray, narrow: str) -> tuple[int, str]:
    """Number of the parameter to improve, and why; (q,) ``relative`` standard errors."""
    estimate, free = fit.estimate, best.coordinates.free[: len(relative)]
    if narrow and narrow not in estimate.names:
        raise ConfigError(f"is {narrow!r}. {suggestion(narrow, estimate.names)}", where="--narrow")
    at = estimate.names.index(narrow) if narrow else int(np.argmax(np.where(free, relative, -1.0)))
    name = estimate.names[at]
    if not free[at]:
        mend = "Log what is missing, or give another parameter."
        raise DataError(f"no run can be planned for {name}: {estimate.refused[name]}.", where="--narrow", mend=mend)
    if name in estimate.refused:
        return at, f"these logs do not determine {name}"
    most = "" if narrow else ", the largest of all"
    return at, f"the standard error of {name} is {significant(100.0 * float(relative[at]), 2)} % of its scale{most}"


def _errors(best: PlanarOptimum, information: FloatArray) -> FloatArray:
    """(q,) standard errors of the model parameters with a (p, p) ``information`` of the coordinates."""
    own = np.ix_(best.coordinates.free, best.coordinates.free)
    covariance = np.zeros_like(information)
    covariance[own] = inverse_information(information[own])
    jacobian, count = best.coordinates.value_jacobian(best.x), best.coordinates.noise_begin
    return np.asarray(np.sqrt(np.maximum(np.diag(jacobian @ covariance[:count, :count] @ jacobian.T), 0.0)))


def _excess(speeds: FloatArray, heading_range: float, measured: FloatArray, limits: RunLimits) -> str:
    """Which limit (3, n) predicted ``speeds`` exceed, with (m, 3) ``measured`` ones of the logs; empty for none."""
    fastest = [(np.hypot(one[0], one[1]).max(), np.abs(one[2]).max()) for one in (speeds, _ENVELOPE * measured.T)]
    if not (np.asarray(fastest[0]) <= np.asarray(fastest[1]) + 1e-9).all():
        return f"faster than {_ENVELOPE:g} times the largest speed in the logs"
    if fastest[0][1] > limits.rate:
        return "beyond the limit of the yaw rate"
    return "beyond the limit of turns" if heading_range > 2.0 * math.pi * limits.travel else ""


def _planned(data: PlanarData, run: CandidateRun, intervals: dict[str, float]) -> PlanarRun:
    """The run with an instant for each reading of the sensors."""
    trial = Trial.from_commands(run.time, run.commands, name=run.name, reference=data.runs[0].trial.reference)
    position = np.full(len(run.time), np.nan)
    if heading := intervals.pop("heading", 0.0):
        position[np.unique(np.searchsorted(run.time, np.arange(0.0, run.seconds, heading) - 1e-9))] = 0.0
    stamps = {name: np.arange(0.0, run.seconds, interval) for name, interval in intervals.items()}
    readings = {name: Readings(time=time, values=np.zeros(len(time))) for name, time in stamps.items()}
    return PlanarRun.of(replace(trial, position=position, readings=readings, rate_only=not heading), data.actuators)


def _start(current: tuple[float, float], heading: float) -> FloatArray:
    """(6,) heading, u and v over ground, r, north and east, at rest in the water."""
    (north, east), cosine, sine = current, math.cos(heading), math.sin(heading)
    return np.array([heading, north * cosine + east * sine, east * cosine - north * sine, 0.0, 0.0, 0.0])


def _information(best: PlanarOptimum, data: PlanarData, planned: PlanarRun, start: FloatArray) -> FloatArray:
    """(p, p) Fisher information of a planned run from (6,) ``start``."""
    yaw_only = best.likelihood.grid.yaw_only
    motion = simulate_planar(best.model, planned, start, yaw_only=yaw_only)
    values = motion.sensors(SENSORS)[planned.event_index, planned.event_sensor]
    # The information of the logs already contains the prior.
    alone, sizes = replace(data, runs=(replace(planned, event_value=values),), prior=None), best.coordinates.sizes
    std = np.concatenate(([0.0], START_STD * sizes.speed, [0.0, 0.0]))
    grid = PlanarGrid.of(alone, start[None], std[None], sizes.speed, yaw_only=yaw_only)
    return PlanarLikelihood(grid, best.coordinates).equations(best.x).information
