"""`rovid check --axes planar`: sensors and their latencies, motions that the logs hold, and missing runs."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import RovidError
from rovid.core.formatting import plus_minus
from rovid.planar.dataset import (
    PlanarData,
    SmoothRun,
    measured_axes,
    planar_data,
    sensor_noise,
    slowest_interval,
    smooth_run,
)
from rovid.preflight.advice import Advice, cut_logs
from rovid.preflight.check import CheckedLogs, read_each_log
from rovid.preflight.planar_sensors import CORRELATED, SCALES, SensorLag, sensor_lags, wrong_entries
from rovid.readers.campaign import examine_campaign
from rovid.trial.config import Config
from rovid.trial.fault import stopping
from rovid.trial.segments import gap_limit
from rovid.trial.trial import Campaign, Remark, Trial

AXES = ("surge", "sway", "yaw")
# Smoothing of the motion, in intervals of the slowest sensor.
_WIDTH = 4.0
# Share of a term's variance that the other terms must leave: below it, errors grow more than fivefold.
_OWN_SHARE = 0.04
# Least share of smoothed points that a check of the motions needs, in all.
_FEWEST_POINTS = 40
# deg; spread of headings under way that separates a current from a steady force.
_HEADING_SPREAD = 90.0
# Standard errors, and s, from which a latency is reported.
_SIGMAS, _LEAST_LAG = 4.0, 0.03


@dataclass(frozen=True, kw_only=True)
class SensorCheck:
    """One sensor over all logs."""

    name: str
    logs: int  #: Number of logs, or parts of logs, with readings.
    readings: int
    rate: float  #: Hz, by the median interval.
    noise: float  #: SI, standard deviation of the white noise; NaN where unknown.
    gaps: int  #: Intervals longer than five usual ones.
    longest_gap: float  #: s; 0 without a gap.


@dataclass(frozen=True, kw_only=True)
class AxisCheck:
    """One degree of freedom over all logs."""

    axis: str
    measured: bool  #: As a velocity or as a position.
    actuators: tuple[str, ...]  #: Names of the actuators that act along it.
    force: float  #: N or N m; RMS of the forces of thrusters. Rudders are not counted.
    velocity: float  #: m/s or rad/s; RMS over ground. NaN where not measured.


@dataclass(frozen=True, kw_only=True)
class PlanarCheck(CheckedLogs):
    """The check for the coupled model."""

    sensors: tuple[SensorCheck, ...] = ()
    axes: tuple[AxisCheck, ...] = ()
    lags: tuple[SensorLag, ...] = ()


def check_planar(paths: Sequence[Path], config: Config) -> PlanarCheck:
    """Check all logs for the coupled model; ``config`` is of `load_planar_config`."""
    return check_planar_trials(config, *read_each_log(paths, config))


def check_planar_trials(
    config: Config, every: Sequence[Trial], problems: Mapping[str, str] | None = None, remarks: Sequence[Remark] = ()
) -> PlanarCheck:
    """Check trials that were read; ``problems`` has the message for each log that could not be read."""
    problems = dict(problems or {})
    trials, faults = examine_campaign(every, config)
    checked = PlanarCheck(trials=tuple(trials), problems=problems, remarks=tuple(remarks), faults=faults)
    if stopping(faults):
        return checked
    usable = []
    for trial in trials:
        try:
            config.vehicle.torque(trial)
            usable.append(trial)
        except RovidError as error:
            problems[trial.parent or trial.name] = str(error)
    checked = replace(checked, trials=tuple(usable), problems=problems)
    if not usable:
        return checked
    data = planar_data(Campaign(trials=tuple(usable), sources=()), config.vehicle)
    lags = tuple(sensor_lags(data.runs))
    smooth = _smoothed(data)
    axes = tuple(_axes(data, smooth))
    wrong = list(wrong_entries(data))
    advice = list(cut_logs(trials))
    if assumptions := config.vehicle.assumptions:
        text = f"Measure {assumptions.listing}, and put it into rovid.toml, where there is a guess."
        advice.append(Advice(kind="guessed", text=text))
    advice += wrong or _disagreements(lags)
    if names := [one.axis for one in axes if not one.measured]:
        signals = " and ".join(f"{name}_velocity" for name in names)
        text = f"Log {signals} (a DVL), or north and east: without them {' and '.join(names)} cannot be determined."
        advice.append(Advice(kind="unmeasured", text=text))
    advice += _missing_runs(data, smooth)
    order = ("grave", "care", "aside")
    return replace(
        checked,
        sensors=tuple(_sensor(data, name) for name in data.sensors),
        axes=axes,
        lags=lags,
        advice=tuple(sorted(advice, key=lambda one: order.index(one.weight))),
    )


def _sensor(data: PlanarData, name: str) -> SensorCheck:
    runs = [run for run in data.runs if name in run.sensors]
    intervals = [np.diff(run.readings(name).time) for run in runs]
    every = np.concatenate(intervals)
    gaps = every[every > gap_limit(every)] if every.size else every
    noise = [value for run in runs if math.isfinite(value := sensor_noise(run, name))]
    return SensorCheck(
        name=name,
        logs=len(runs),
        readings=sum(len(one) + 1 for one in intervals),
        rate=1.0 / float(np.median(every)) if every.size else 0.0,
        noise=float(np.median(noise)) if noise else math.nan,
        gaps=len(gaps),
        longest_gap=float(gaps.max(initial=0.0)),
    )


def _smoothed(data: PlanarData) -> list[SmoothRun]:
    interval = max(map(slowest_interval, data.runs))
    return [smooth for run in data.runs if (smooth := smooth_run(run, _WIDTH * interval)) is not None]


def _axes(data: PlanarData, smooth: Sequence[SmoothRun]) -> Iterator[AxisCheck]:
    force = np.concatenate([run.forces().force for run in data.runs])
    speeds = np.concatenate([run.speeds for run in smooth]) if smooth else np.zeros((0, 3))
    thrusters = data.actuators.thrusters.thrusters
    turned = {one.turns for one in data.vehicle.thrusters}
    for at, (axis, measured) in enumerate(zip(AXES, measured_axes(data.sensors), strict=True)):
        row = zip(thrusters, data.actuators.matrix[at].tolist(), strict=True)
        names = [one.name for one, lever in row if lever or one.name in turned]
        yield AxisCheck(
            axis=axis,
            measured=measured,
            actuators=(*names, *data.actuators.rudder_names),
            force=float(np.sqrt(np.mean(force[:, at] ** 2))),
            velocity=float(np.sqrt(np.mean(speeds[:, at] ** 2))) if measured and len(speeds) else math.nan,
        )


def _disagreements(lags: Sequence[SensorLag]) -> Iterator[Advice]:
    """Latencies that show, and sensors that differ in sign or unit."""
    for one in lags:
        if abs(one.correlation) < CORRELATED:
            continue
        if not SCALES[0] < one.scale < SCALES[1]:
            fault = "of the other sign" if one.scale < 0.0 else f"{one.scale:.2f} times as large"
            text = f"Correct sign or unit in rovid.toml: the changes of the {one.late} are {fault} as the {one.against}"
            text += " gives them." if one.scale > 0.0 else ", compared to what the signals should give."
            yield Advice(kind="sensors_disagree", text=text, weight="grave")
        elif abs(one.seconds) > max(_SIGMAS * one.standard_error, _LEAST_LAG):
            late, early = (one.late, one.against) if one.seconds > 0.0 else (one.against, one.late)
            size = plus_minus(abs(one.seconds), one.standard_error)
            text = f"The {late} is {size} s late against the {early}. The fit estimates such a latency."
            yield Advice(kind="latency", text=text.replace("_", " "), weight="aside")


def _missing_runs(data: PlanarData, smooth: Sequence[SmoothRun]) -> Iterator[Advice]:
    """Terms of the equation that the logs do not tell apart, each group with the run that would."""
    if sum(len(run.time) for run in smooth) < _FEWEST_POINTS:
        yield Advice(kind="short", text="Record longer runs: these are too short for their motions to be compared.")
        return
    speeds = np.concatenate([run.speeds for run in smooth])
    accelerations = np.concatenate([run.accelerations for run in smooth])
    measured = measured_axes(data.sensors)
    for at, axis in enumerate(AXES):
        if not measured[at]:
            continue
        rate = speeds[:, at]
        terms = {"inertia": accelerations[:, at], "linear_drag": rate, "quadratic_drag": np.abs(rate) * rate}
        if weak := _confused(terms):
            *others, last = [f"{axis}.{name}" for name in weak]
            listed = f"{', '.join(others)} and {last}" if others else last
            text = f"{_RUNS[axis, 'inertia' in weak]} These logs do not determine {listed} one by one."
            yield Advice(kind="missing_run", text=text)
    if not (measured[0] and measured[1]):
        return
    if _confused({"sway": speeds[:, 1], "yaw": speeds[:, 2]}):
        has_side_thrust = bool(np.any(data.actuators.matrix[1]))
        run = "Move sideways without turning, and turn on the spot." if has_side_thrust else _TURNS
        text = f"{run} In these logs the sway velocity follows the yaw rate, and damping of sway by yaw shows in both."
        yield Advice(kind="missing_run", text=text)
    moving = np.hypot(speeds[:, 0], speeds[:, 1]) > 0.3 * np.sqrt(np.mean(speeds[:, 0] ** 2 + speeds[:, 1] ** 2))
    heading = np.concatenate([run.heading for run in smooth])
    if moving.any() and _spread(heading[moving]) < _HEADING_SPREAD:
        text = "Run the same leg in opposite directions: with one heading a current cannot be told from a steady force."
        yield Advice(kind="missing_run", text=text)


_TURNS = "Log turns at two or more speeds ahead: turning circles or zigzags, slow and fast."
_LEVELS = "Log steady runs at several speeds, slow and fast, "
_STEPS = "Log steps of the thrust, 3 to 10 s a level, "
_ALONG = {"surge": "ahead and astern.", "sway": "to both sides.", "yaw": "turning to both sides."}
# (axis, whether the inertia is among the terms) -> the run that tells its terms apart.
_RUNS = {(axis, step): f"{_STEPS if step else _LEVELS}{where}" for axis, where in _ALONG.items() for step in (0, 1)}


def _confused(terms: dict[str, FloatArray]) -> list[str]:
    """Names of the ``terms`` that the others reproduce but for a small share of their variance."""
    columns = np.column_stack(list(terms.values()))
    size = np.sqrt(np.mean(columns**2, axis=0))
    if not size.all():
        return [name for name, one in zip(terms, size.tolist(), strict=True) if not one]
    # The inverse of the correlation matrix has 1/(1 - R^2) on its diagonal.
    gram = (columns / size).T @ (columns / size) / len(columns)
    own = 1.0 / np.diag(np.linalg.pinv(gram + 1e-9 * np.eye(len(size))))
    return [name for name, share in zip(terms, own.tolist(), strict=True) if share < _OWN_SHARE]


def _spread(heading: FloatArray) -> float:
    """deg; smallest arc that holds nearly all of the headings."""
    angles = np.sort(np.mod(np.degrees(heading), 360.0))
    angles = angles[:: len(angles) // 2000 + 1]
    free = np.diff(np.append(angles, angles[0] + 360.0))
    return 360.0 - float(free.max())
