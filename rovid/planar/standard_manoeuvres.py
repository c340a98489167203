"""Turning circles and zigzags of the planar model and in the runs, with their measures and errors.

A simulated manoeuvre starts on a straight course at the steady speed of a constant thrust ahead (MSC.137(76), annex,
5.1). The steering is a rudder's angle, or a torque with the side force that comes with it in the runs.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.planar.dataset import PlanarData, PlanarRun, is_yaw_alone, measured_axes, smooth_motion
from rovid.planar.effect_fits import SHIP
from rovid.planar.fit import PlanarFit
from rovid.planar.free_runs import PlanarMotion, measured_start, simulate_planar
from rovid.planar.manoeuvres import (
    ManoeuvreMeasure,
    Measures,
    Track,
    nomoto,
    recognise,
    turning_circle,
    with_errors,
    zigzag,
)
from rovid.planar.model import INPUT_COUNT, RUDDER_INPUTS, PlanarModel

# Quantile of the speeds ahead in the runs that is the approach speed.
_APPROACH = 0.75
# Angle of a rudder in rad in a turning circle, and of a zigzag with its change of heading: MSC.137(76), annex, 5.
_TURN_ANGLE, _ZIGZAG_ANGLES = np.radians(35.0), (np.radians(10.0), np.radians(20.0))
# Time constants of a simulated manoeuvre at most, samples in a time constant, and sections of a zigzag.
_LONGEST, _SAMPLES, _SECTIONS = 60.0, 50.0, 5
# Attempts at a turning circle, each with an interval four times as long.
_COARSER = 3
# Share of the angle of a manoeuvre that is in the runs where they show it; relative standard errors of the measures of
# circles and zigzags where they do not, for the model's form, by simulated tankers (benchmarks/planar_manoeuvres.py).
_ALIKE, _CIRCLE_ERROR, _ZIGZAG_ERROR = 0.9, 0.12, 0.2
# Intervals between readings of a rudder, below which a change follows at the next reading.
_ONE_READING = 1.5
# Relative change of a parameter that is not determined, and change of a measure, in shares, that then counts.
_DOUBT, _SENSITIVE = 0.2, 0.01


@dataclass(frozen=True, kw_only=True)
class SteeringSystem:
    """How the vehicle of the runs is driven ahead and turned."""

    approach_speed: float  #: m/s.
    rudders: int  #: Number of rudders, which steer where there are any; else the torque of the thrusters.
    largest: float  #: Largest angle in rad, or torque in N m, in the runs.
    side_force: float  #: N for each N m of torque.
    slipstream: float  #: N of thrust ahead of each rudder for each N ahead.
    rudder_rate: float = math.inf  #: rad/s at which the rudders move, or 1/s of the largest torque.

    @classmethod
    def of(cls, data: PlanarData, model: PlanarModel) -> Self:
        """The steering of the runs. Raises DataError if the vehicle neither moves ahead nor turns in the runs."""
        held = [run.forces() for run in data.runs]
        names = ("force", "angle", "slipstream_thrust")
        force, angle, thrust = (np.concatenate([getattr(one, name) for one in held]) for name in names)
        ahead = np.concatenate([simulate_planar(model, run).through_water[:, 0] for run in data.runs])
        speed = float(np.quantile(np.abs(ahead), _APPROACH))
        rudders = angle.shape[1]
        size = np.abs(force[:, 2])
        largest = float(np.max(np.abs(angle))) if rudders else float(np.max(size))
        if speed <= 0.0 or largest <= 0.0:
            raise DataError("the runs hold no motion ahead, or no steering: there is nothing to simulate a turn with.")
        strong = size >= 0.5 * np.max(size)
        side = float(np.sum(force[strong, 1] * force[strong, 2]) / max(np.sum(force[strong, 2] ** 2), 1e-300))
        pushing = force[:, 0] > 0.5 * np.max(force[:, 0])
        slipstream = 0.0
        if rudders and pushing.any():
            slipstream = float(np.sum(thrust[pushing].mean(axis=1)) / np.sum(force[pushing, 0]))
        return cls(
            approach_speed=speed,
            rudders=rudders,
            largest=largest,
            side_force=side,
            slipstream=slipstream,
            rudder_rate=_rudder_rate(data),
        )

    @property
    def gain_unit(self) -> str:
        """Unit of Nomoto's K."""
        return "1/s" if self.rudders else "rad/s"

    def inputs(self, model: PlanarModel, steering: FloatArray) -> FloatArray:
        """(n, k) inputs of the equations for (n,) ``steering``: angle in rad, or share of the largest torque."""
        held = np.zeros((len(steering), INPUT_COUNT + RUDDER_INPUTS * self.rudders))
        speed = self.approach_speed
        held[:, 0] = (model.base[4] + model.base[7] * speed) * speed
        if self.rudders:
            for at in range(self.rudders):
                held[:, INPUT_COUNT + RUDDER_INPUTS * at] = steering
                held[:, INPUT_COUNT + RUDDER_INPUTS * at + 1] = self.slipstream * held[:, 0]
        else:
            held[:, 2] = self.largest * steering
            held[:, 1] = self.side_force * held[:, 2]
        return held

    def movement(self, begin: float, order: float, time: FloatArray) -> FloatArray:
        """(n,) steering at (n,) ``time`` in s after an ``order``, from ``begin`` on."""
        moved = np.sign(order - begin) * self.rudder_rate * time if math.isfinite(self.rudder_rate) else order - begin
        return np.asarray(np.clip(begin + moved, min(begin, order), max(begin, order)) + np.zeros(len(time)))

    def steering(self, run: PlanarRun) -> FloatArray:
        """(n,) steering of ``run``: mean angle of the rudders in rad, or share of the largest torque."""
        held = run.forces()
        return np.asarray(held.angle.mean(axis=1) if self.rudders else held.force[:, 2] / self.largest)


def _rudder_rate(data: PlanarData) -> float:
    """Rate in rad/s with which half of the movements of the rudders end at most; infinite without rudders.

    A log of orders, which jump, gives a jump within a sample. A rudder that is read less often than other columns moves
    on in the same direction from one of its readings to the next.
    """
    found: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    for run in data.runs:
        for angle in np.unwrap(run.trial.commands[:, data.actuators.angle_columns], axis=0).T:
            at = np.flatnonzero(np.diff(angle))
            found.append((np.diff(angle)[at], np.diff(run.time)[at], np.diff(run.time[at + 1], prepend=-np.inf)))
    change, row, since = (np.concatenate(each) for each in zip(*found, strict=True)) if found else [np.zeros(0)] * 3
    if not data.actuators.rudders or not len(change):
        return math.inf
    reading = float(since.min())
    goes_on = (since < _ONE_READING * reading) & (np.sign(change) == np.sign(np.roll(change, 1)))
    size = np.abs(change)
    rate = size / np.maximum(reading if size[goes_on].sum() > 0.5 * size.sum() else row, 1e-9)
    order = np.argsort(rate)
    return float(rate[order][np.searchsorted(np.cumsum(size[order]), 0.5 * size.sum())])


def simulate_turning_circle(model: PlanarModel, system: SteeringSystem, order: float) -> Track:
    """A turn at a steady ``order`` from a straight course, until two turns or `_LONGEST` time constants."""
    step, count = _step(model), int(_LONGEST * _SAMPLES)
    for _ in range(_COARSER):
        steering = system.movement(0.0, order, step * np.arange(count, dtype=np.float64))
        track = _simulated(model, system, np.zeros(6), steering, step)
        turned = np.flatnonzero(np.abs(track.heading) >= 4.0 * np.pi)
        if turned.size:
            return track.part(0, int(turned[0]) + 1)
        step *= 4.0
    return track


def simulate_zigzag(model: PlanarModel, system: SteeringSystem, order: float, threshold: float) -> Track:
    """A zigzag that reverses ``order`` when the heading has changed by ``threshold`` rad, for five sections."""
    step, start, begin, angle = _step(model), np.zeros(6), 0.0, 0.0
    parts: list[Track] = []
    count = int(0.5 * _LONGEST * _SAMPLES)
    for section in range(_SECTIONS):
        steering = system.movement(angle, order * (-1.0) ** section, step * np.arange(count, dtype=np.float64))
        track = _simulated(model, system, start, steering, step)
        turned = track.heading * np.sign(order) * (-1.0) ** section
        passed = np.flatnonzero(turned >= threshold)
        last = int(passed[0]) if passed.size else count - 1
        track = replace(track, time=track.time + begin)
        parts.append(track.part(0, last if section < _SECTIONS - 1 else last + 1))
        if not passed.size:
            break
        # The instant at which the heading passes the threshold lies between two samples.
        share = (threshold - turned[last - 1]) / (turned[last] - turned[last - 1])
        names = ("heading", "surge", "sway", "yaw_rate", "north", "east", "time")
        pairs = np.array([getattr(track, name)[last - 1 : last + 1] for name in names])
        *start, begin = pairs @ np.array([1.0 - share, share])
        start, angle = np.array(start), float(steering[last])
    joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0])}
    return Track(**joined)


def _step(model: PlanarModel) -> float:
    """Sampling interval in s: a part of the time constant of the yaw rate, and of a length travelled."""
    drag = model.base[6] + model.base[9] * 0.1
    return float(min(model.base[2] / max(drag, 1e-9), model.base[0] / max(model.base[4], 1e-9), 60.0) / _SAMPLES)


def _simulated(
    model: PlanarModel, system: SteeringSystem, start: FloatArray, steering: FloatArray, step: float
) -> Track:
    """Motion from (6,) ``start`` (heading, u, v, r, north, east; u is set on a straight course), in still water."""
    own = model.of_vehicle
    still = replace(own, effects=tuple(one for one in own.effects if one.effect.id != "current"))
    first = start.copy()
    if not first[1:4].any():
        first[1] = system.approach_speed
    time = step * np.arange(len(steering), dtype=np.float64)
    scale, offsets = np.array([system.approach_speed, system.approach_speed, 0.1]), np.array([0, len(time)])
    one = PlanarMotion.simulated(still, offsets, time, system.inputs(still, steering), first[None], scale)
    return Track(time, one.heading, one.yaw_rate, steering, one.north, one.east, one.surge_velocity, one.sway_velocity)


# ---- measures


def model_measures(model: PlanarModel, system: SteeringSystem) -> Measures:
    """Measures of a turning circle to each side and of the 10/10 and 20/20 zigzags; names as "circle.advance"."""
    order = _TURN_ANGLE if system.rudders else 1.0
    found: dict[str, ManoeuvreMeasure] = {}
    unit = "rad" if system.rudders else "1"
    for side, name in ((1.0, "starboard"), (-1.0, "port")):
        track = simulate_turning_circle(model, system, side * order)
        found[f"circle_{name}.steering"] = ManoeuvreMeasure(value=side * order, unit=unit)
        found[f"circle_{name}.approach_speed"] = ManoeuvreMeasure(value=system.approach_speed, unit="m/s")
        found |= {f"circle_{name}.{key}": one for key, one in turning_circle(track).items()}
    for angle in _ZIGZAG_ANGLES:
        given = angle if system.rudders else angle / _ZIGZAG_ANGLES[-1]
        track = simulate_zigzag(model, system, given, angle)
        name = f"zigzag_{np.degrees(angle):.0f}"
        found |= {f"{name}.{key}": one for key, one in zigzag(track).items()}
        if f"{name}.period" in found:
            # The error of K and T is that of the parameters: the simulated rate has no noise.
            fitted = {key: one for key, one in nomoto(track, system.gain_unit).items() if key in {"K", "T"}}
            found |= {f"{name}.{key}": replace(one, standard_error=None) for key, one in fitted.items()}
    return found


def model_manoeuvres(fit: PlanarFit, data: PlanarData) -> Measures:
    """`model_measures` of a fit with standard errors by the delta method.

    A measure may be known where single parameters are not: the covariance has their correlations. It is left out where
    its own error is as large as itself, or where it changes with a parameter that no measurement depends on. There are
    none where the vehicle neither moves ahead nor turns in the runs, or where they determine yaw alone.
    """
    if is_yaw_alone(data):
        return {}
    try:
        system = SteeringSystem.of(data, fit.model)
    except DataError:
        return {}

    def measure(values: FloatArray) -> Measures:
        return model_measures(fit.model.with_values(values), system)

    values, covariance = fit.model.values, np.asarray(fit.estimate.covariance)
    found = with_errors(measure, values, covariance)
    # The length of a ship's hull is given.
    unknown = set(fit.estimate.refused) - {f"{SHIP}.length"}
    for at in np.flatnonzero(np.diag(covariance) == 0.0).tolist():
        if fit.model.names[at] in unknown and values[at]:
            other = measure(values * (1.0 + _DOUBT * (np.arange(len(values)) == at)))
            found = {key: one for key, one in found.items() if _is_same(one, other.get(key))}
    found = {key: replace(one, standard_error=_whole_error(key, one, system)) for key, one in found.items()}
    given = {key for key in found if key.endswith((".steering", ".approach_speed"))}
    known = {key for key, one in found.items() if one.standard_error is not None}
    known -= {key for key in known if (found[key].standard_error or 0.0) >= abs(found[key].value)}
    return {key: one for key, one in found.items() if key in known | given}


def _whole_error(key: str, one: ManoeuvreMeasure, system: SteeringSystem) -> float | None:
    """Standard error with that of the model's form, where the rudder turns farther than in the runs."""
    angle, share = _ZIGZAG_ANGLES[key.startswith("zigzag_20")], _ZIGZAG_ERROR
    if key.startswith("circle"):
        angle, share = _TURN_ANGLE, _CIRCLE_ERROR
    inside = not system.rudders or system.largest > _ALIKE * angle
    if one.standard_error is None or inside or key.endswith((".steering", ".approach_speed")):
        return one.standard_error
    return math.hypot(one.standard_error, share * one.value)


def _is_same(one: ManoeuvreMeasure, other: ManoeuvreMeasure | None) -> bool:
    return other is not None and abs(other.value - one.value) <= _SENSITIVE * abs(one.value)


class RunManoeuvre(NamedTuple):
    """A manoeuvre that was recognised in a run, as measured and as simulated freely from its start."""

    run: str
    kind: str  #: "turning_circle" or "zigzag".
    begin: float  #: s from the start of the run.
    end: float  #: s.
    steering: float  #: First order: rad, or share of the largest torque.
    measured: Measures
    simulated: Measures


def run_manoeuvres(model: PlanarModel, data: PlanarData) -> list[RunManoeuvre]:
    """Manoeuvres in the runs; none where the vehicle neither moves ahead nor turns."""
    try:
        system = SteeringSystem.of(data, model)
    except DataError:
        return []
    found = []
    for run in data.runs:
        tracks = _run_tracks(model, system, run, data.sensors)
        if tracks is None:
            continue
        for one in recognise(tracks[0]):
            begin, end = tracks[0].time[[one.first, one.last - 1]].tolist()
            both = []
            for track in (each.part(one.first, one.last) for each in tracks):
                is_circle = one.kind == "turning_circle"
                both.append(
                    turning_circle(track) if is_circle else {**zigzag(track), **nomoto(track, system.gain_unit)}
                )
            found.append(RunManoeuvre(run.name, one.kind, begin, end, one.steering, *both))
    return found


def _run_tracks(
    model: PlanarModel, system: SteeringSystem, run: PlanarRun, sensors: Sequence[str]
) -> tuple[Track, Track] | None:
    """The measured and the simulated track through the water of a run; None for a run that is too short."""
    smooth = smooth_motion(run)
    if smooth is None:
        return None
    # Smoothing leaves out both ends, where an approach may lie: there the heading is as read, and the speeds are held.
    time = np.arange(run.time[0], run.time[-1], float(smooth.time[1] - smooth.time[0]))
    heading = np.interp(time, smooth.time, smooth.heading)
    ahead, side, rate = (np.interp(time, smooth.time, column) for column in smooth.speeds.T)
    outside = (time < smooth.time[0]) | (time > smooth.time[-1])
    if "heading" in run.sensors:
        read = run.readings("heading")
        raw = np.interp(time, read.time, read.values)
        heading, rate = np.where(outside, raw, heading), np.where(outside, np.gradient(raw, time), rate)
    north, east = model.current
    measured = measured_axes(tuple(sensors))
    ahead = ahead - north * np.cos(heading) - east * np.sin(heading)
    side = side - east * np.cos(heading) + north * np.sin(heading)
    missing = np.full(len(time), np.nan)
    ahead, side = ahead if measured[0] else missing, side if measured[1] else missing
    # Held orders: the last one at or before each instant.
    rows = np.clip(np.searchsorted(run.time, time, side="right") - 1, 0, len(run.time) - 1)
    steering = system.steering(run)[rows]
    motion = simulate_planar(model, run, measured_start(run))
    through = [np.interp(time, run.time, column) for column in motion.through_water.T]
    turned = np.interp(time, run.time, motion.heading)
    return (_track(time, heading, steering, ahead, side, rate), _track(time, turned, steering, *through))


def _track(
    time: FloatArray, heading: FloatArray, steering: FloatArray, ahead: FloatArray, side: FloatArray, rate: FloatArray
) -> Track:
    """The track with positions by integration of the velocities through the water."""
    cosine, sine = np.cos(heading), np.sin(heading)
    north, east = (
        np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time))))
        for speed in (ahead * cosine - side * sine, ahead * sine + side * cosine)
    )
    return Track(time, heading, rate, steering, north, east, ahead, side)


def turning_curve(model: PlanarModel, system: SteeringSystem, length: float, points: int = 9) -> FloatArray:
    """(points, 2) steering and r' = r L/U of steady turns: the r'-delta' curve (ITTC 7.5-02-06-01, spiral tests).

    ``length`` is L in m. The middle of the curve is unreliable for a vehicle that is not stable on a straight course.
    """
    largest = _TURN_ANGLE if system.rudders else 1.0
    rows = []
    for order in np.linspace(-largest, largest, points):
        count = int(_LONGEST * _SAMPLES)
        track = _simulated(model, system, np.zeros(6), np.full(count, order), _step(model))
        speed = float(np.hypot(track.surge[-1], track.sway[-1]))
        rows.append((float(order), float(track.yaw_rate[-1]) * length / max(speed, 1e-9)))
    return np.array(rows)
