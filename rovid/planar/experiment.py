"""Experiment design of the planar model: the run that reduces the standard error of a parameter most. docs/plan.md."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import ConfigError, DataError, suggestion
from rovid.core.formatting import significant
from rovid.estimate.candidate_runs import CandidateRun, RunLimits
from rovid.estimate.experiment_design import ExpectedInformation, ExperimentPlan
from rovid.estimate.fisher_information import inverse_information
from rovid.planar.dataset import SENSORS, PlanarData, PlanarRun
from rovid.planar.fit import PlanarFit, parameter_scale, planar_result
from rovid.planar.likelihood import PlanarGrid, PlanarLikelihood
from rovid.planar.optimum import PlanarOptimum
from rovid.planar.preparation import START_STD
from rovid.planar.programmes import PlanarAllocation, planar_candidates_of
from rovid.planar.simulation import simulate_planar
from rovid.planar.smoothing import slowest_interval, smooth_run
from rovid.planar.undetermined import MAX_ERROR
from rovid.trial.trial import Readings, Trial

# Largest predicted speed over the largest in the logs: beyond it the model is not known.
_ENVELOPE = 1.5
# Longest interval between instants of a command file in the shortest time constant, and the shortest in s.
_INTERVAL, _LEAST_INTERVAL = 0.1, 0.02
# rad; headings at the start of a run in a current, of which the least gain counts: the crew may start on any.
_HEADINGS = (0.0, math.pi / 3.0, 2.0 * math.pi / 3.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarPlan:
    """Candidate runs of the planar model, the best first."""

    ranked: ExperimentPlan  #: The parameter, and the runs with the predicted (3, n) u, v over ground and r.
    fit: PlanarFit  #: Of the logs at hand.
    reason: str  #: Why this parameter.
    #: Parameter -> standard error by the logs, and predicted with the best run; infinite where it is not determined.
    errors: Mapping[str, tuple[float, float]]
    left_out: Mapping[str, str]  #: Run that was left out -> why.
    warnings: tuple[str, ...]


def plan_planar(data: PlanarData, best: PlanarOptimum, limits: RunLimits, narrow: str = "") -> PlanarPlan:
    """The run that reduces most, per minute, the variance of the parameter ``narrow``, or of the least certain one.

    Raises
    ------
    ConfigError
        There is no such parameter.
    DataError
        No run determines the parameter, nothing can be commanded, or no run stays within the limits.
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
    )
    return PlanarPlan(
        ranked=ranked,
        fit=fit,
        reason=reason,
        errors={name: (before, after) for name, (before, after) in zip(names, pairs.tolist(), strict=True)},
        left_out=left_out,
        warnings=tuple(_warnings(fit, allocation, guessed=bool((coordinates.free[: len(names)] & ~known).any()))),
    )


def _warnings(fit: PlanarFit, allocation: PlanarAllocation, *, guessed: bool) -> list[str]:
    found = list(fit.warnings)
    if guessed:
        found.append(
            "The prediction depends on parameters that these logs do not determine: begin with small commands."
        )
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
    values = np.column_stack([motion.sensor(name) for name in SENSORS])[planned.event_index, planned.event_sensor]
    alone, sizes = replace(data, runs=(replace(planned, event_value=values),)), best.coordinates.sizes
    std = np.concatenate(([0.0], START_STD * sizes.speed, [0.0, 0.0]))
    grid = PlanarGrid.of(alone, start[None], std[None], sizes.speed, yaw_only=yaw_only)
    return PlanarLikelihood(grid, best.coordinates).equations(best.x).information
