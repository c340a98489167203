"""Latency of each position against a rate, and entries of rovid.toml with a wrong sign, unit or axis.

Each single correction is tried: the sign of a signal, of a thruster or of a rudder, and the eight mirror images and
quarter turns of north and east. A correction is named if a regression of the forces on the motion then leaves a small
part of what it leaves without; a hull that the equations describe badly is described badly with each of them.
Positions next to a velocity log are compared with its integral instead.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.planar.dataset import PlanarData, PlanarRun, is_yaw_alone
from rovid.planar.model import SENSORS, PlanarActuators, PlanarCommands
from rovid.planar.start_values import unexplained_share
from rovid.preflight.advice import Advice
from rovid.trial.rates import integral
from rovid.trial.vehicle import Thruster

# Scales between sensors whose units and signs agree; correlation below which two sensors say nothing of each other.
SCALES, CORRELATED = (0.8, 1.25), 0.7
# s; largest latency that is searched for, number of latencies to each side, and length of a window.
_MOST, _COUNT, _WINDOW = 1.5, 60, 20.0
_LAGS = np.linspace(-_MOST, _MOST, 2 * _COUNT + 1)
# Windows that an estimate needs, and readings of each sensor in a window.
_FEWEST_WINDOWS, _FEWEST_READINGS = 4, 8
# Groups of windows, one of which is left out at a time for the standard error.
_GROUPS = 10
# Share of the variance of the forces that a regression of sound logs leaves at most, and share of that which a
# correction may leave to be named. Sound logs of four generators left 0.05 at most in the median, and no correction
# left less than 0.5 of it; each of the wrong entries left 0.2 to 0.7, and its correction 0.01 to 0.05 of that.
_SOUND, _CORRECTED = 0.1, 0.25
# Corrections as good as the best one to this factor are named with it; number of corrections tried in a current.
_TIE, _TRIED = 1.5, 3
# Correlation of a position with the integral of a velocity log, from which an exchange of axes is named.
_SAME_TRACK = 0.9
# rad; angles beyond the first no rudder has, and a rudder within the second hardly steers.
_LARGEST, _SMALLEST = math.radians(95.0), math.radians(1.2)
_TRACK, _SPEEDS = ("north", "east"), ("surge_velocity", "sway_velocity")
# A change of rovid.toml in words, and the data with it.
_Correction = tuple[str, PlanarData]


@dataclass(frozen=True, kw_only=True)
class SensorLag:
    """How late a position is against a rate, and the scale between them."""

    late: str  #: Name of the position.
    against: str  #: Name of the rate.
    seconds: float
    standard_error: float  #: s, from windows that are left out in turn.
    scale: float  #: Change of the position over the integral of the rate: 1 if units and signs agree.
    correlation: float  #: Of both changes.


def sensor_lags(runs: Sequence[PlanarRun]) -> Iterator[SensorLag]:
    """Latency of the heading against the yaw rate, and of north and east against surge and sway velocity."""
    pairs = {
        ("heading", "yaw_rate"): [("heading", "yaw_rate")],
        ("position", "velocity"): [("north", "north"), ("east", "east")],
    }
    for (late, against), signals in pairs.items():
        windows = [sums for run in runs for position, rate in signals for sums in _windows(run, position, rate)]
        if len(windows) < _FEWEST_WINDOWS:
            continue
        sums = np.array(windows)  # (w, 3, lags): squares of the position, products, squares of the integral.
        seconds, scale, correlation = _best(sums.sum(axis=0))
        groups = np.arange(len(sums)) % min(_GROUPS, len(sums))
        others = [_best(sums[groups != group].sum(axis=0))[0] for group in np.unique(groups)]
        count = len(others)
        error = float(np.sqrt((count - 1) / count * np.sum((np.array(others) - np.mean(others)) ** 2)))
        sizes = {"seconds": seconds, "standard_error": error, "scale": scale, "correlation": correlation}
        yield SensorLag(late=late, against=against, **sizes)


def _windows(run: PlanarRun, position: str, rate: str) -> Iterator[FloatArray]:
    """(3, lags) sums of each window, without mean and trend."""
    time, turned = _integral(run, rate)
    if position not in run.sensors or len(time) < _FEWEST_READINGS:
        return
    readings = run.readings(position)
    gap = 5.0 * float(np.median(np.diff(time)))
    for begin in np.arange(time[0] + _MOST, time[-1] - _MOST - _WINDOW, _WINDOW):
        inside = (readings.time >= begin) & (readings.time < begin + _WINDOW)
        near = time[(time >= begin - _MOST) & (time < begin + _WINDOW + _MOST)]
        if inside.sum() < _FEWEST_READINGS or len(near) < _FEWEST_READINGS or np.diff(near).max() > gap:
            continue
        stamps, values = readings.time[inside], readings.values[inside]
        trend = np.column_stack((np.ones(len(stamps)), stamps - stamps.mean()))
        basis, _ = np.linalg.qr(trend)
        moved = np.interp(stamps[:, None] - _LAGS, time, turned)
        moved -= basis @ (basis.T @ moved)
        values = values - basis @ (basis.T @ values)
        yield np.stack((np.full(len(_LAGS), values @ values), values @ moved, np.einsum("ij,ij->j", moved, moved)))


def _integral(run: PlanarRun, rate: str) -> tuple[FloatArray, FloatArray]:
    """Instants, and the integral of the yaw rate, or of the velocity over ground to north or east."""
    needed = ("yaw_rate",) if rate == "yaw_rate" else ("surge_velocity", "sway_velocity", "heading")
    if not set(needed) <= set(run.sensors):
        return np.zeros(0), np.zeros(0)
    first = run.readings(needed[0])
    values = first.values
    if rate != "yaw_rate":
        sway, heading = run.readings("sway_velocity"), run.readings("heading")
        across = np.interp(first.time, sway.time, sway.values)
        course = np.interp(first.time, heading.time, heading.values)
        cos, sin = np.cos(course), np.sin(course)
        values = values * cos - across * sin if rate == "north" else values * sin + across * cos
    return first.time, integral(first.time, values)


def _best(sums: FloatArray) -> tuple[float, float, float]:
    """Latency in s, scale and correlation by least squares, between the latencies tried by a parabola."""
    squares, products, moved = sums
    gain = products * np.abs(products) / np.maximum(moved, 1e-300)
    best = int(np.argmax(np.abs(gain)))
    at = float(_LAGS[best])
    if 0 < best < len(_LAGS) - 1:
        left, middle, right = np.abs(gain[best - 1 : best + 2])
        bend = left - 2.0 * middle + right
        if bend < 0.0:
            at += 0.5 * (left - right) / bend * float(_LAGS[1] - _LAGS[0])
    scale = float(products[best] / max(moved[best], 1e-300))
    return at, scale, float(products[best] / np.sqrt(max(squares[best] * moved[best], 1e-300)))


# ---- wrong entries


def wrong_entries(data: PlanarData) -> Iterator[Advice]:
    """What to correct in rovid.toml before a fit; nothing where the logs agree with it, or do not show it."""
    angles = list(_angles(data))
    yield from angles
    if angles or is_yaw_alone(data):
        return
    text, is_sound = _of_forces(data)
    if text:
        yield Advice(kind="wrong_entry", text=text, weight="grave")
    elif text := _of_track(data, is_sound=is_sound):
        yield Advice(kind="sensors_disagree", text=text, weight="grave")


def _angles(data: PlanarData) -> Iterator[Advice]:
    """Rudders with angles that a unit explains."""
    for at, one in enumerate(data.vehicle.thrusters):
        if one.rudder is None:
            continue
        most = max(float(np.max(np.abs(run.trial.commands[:, at]))) for run in data.runs)
        if most > _LARGEST:
            text = f"Correct the unit of the angle of {one.name} in rovid.toml: it reaches "
            text += f"{math.degrees(most):.0f} deg." + (' Write unit = "deg".' if most < 90.0 else "")
            yield Advice(kind="wrong_entry", text=text, weight="grave")
        elif 0.0 < most < _SMALLEST:
            text = f"Check the unit of the angle of {one.name}: it reaches {math.degrees(most):.2f} deg at most."
            yield Advice(kind="wrong_entry", text=text, weight="care")


def _of_track(data: PlanarData, *, is_sound: bool) -> str:
    """The exchange of north and east by which the track follows the velocity log; empty without one.

    Unless the forces agree with the speeds of the log (``is_sound``), a sign of these may be wrong instead.
    """
    if not {*_TRACK, *_SPEEDS} <= set(data.sensors):
        return ""

    def agreement(one: PlanarData) -> float:
        found = (lag for lag in sensor_lags(one.runs) if lag.late == "position")
        return max((lag.correlation for lag in found if SCALES[0] < lag.scale < SCALES[1]), default=0.0)

    if agreement(data) > CORRELATED:
        return ""
    tried = [*_exchanges(data), *([] if is_sound else _signs(data))]
    correlations = [agreement(corrected) for _, corrected in tried]
    most = max(correlations)
    if most < _SAME_TRACK:
        return ""
    close = 1.0 - _TIE * (1.0 - most)
    texts = [text for (text, _), own in zip(tried, correlations, strict=True) if own >= close]
    end = f"The track then follows the velocity log with a correlation of {most:.2f}."
    return f"{'; or: '.join(texts)} in [signals] of rovid.toml. {end}"


def _of_forces(data: PlanarData) -> tuple[str, bool]:
    """The correction with which the forces explain the motion, and whether they explain it without."""
    has_log = set(_SPEEDS) <= set(data.sensors)
    if has_log and set(_TRACK) <= set(data.sensors):
        runs = []
        for run in data.runs:
            kept = ~np.isin(run.event_sensor, [SENSORS.index(name) for name in _TRACK])
            own = {name: getattr(run, name)[kept] for name in ("event_index", "event_sensor", "event_value")}
            runs.append(replace(run, **own))
        data = replace(data, runs=tuple(runs))
    try:
        left = unexplained_share(data, with_current=True)
        if not _SOUND < left < math.inf:
            return "", left <= _SOUND
        tried = [*_signs(data), *_actuators(data), *([] if has_log else _exchanges(data))]
        tried = [(text, corrected) for text, corrected in tried if set(corrected.sensors) == set(data.sensors)]
        shares = [unexplained_share(corrected, with_current=False) for _, corrected in tried]
        first = np.argsort(shares)[:_TRIED].tolist()
        in_current = {at: min(shares[at], unexplained_share(tried[at][1], with_current=True)) for at in first}
    except DataError:
        return "", False
    least = min(in_current.values(), default=math.inf)
    if least > _CORRECTED * left:
        return "", False
    texts = [tried[at][0] for at in sorted(in_current, key=in_current.__getitem__) if in_current[at] <= _TIE * least]
    shown = f"The forces then explain {100 * (1 - least):.0f} % of the motion, and {100 * (1 - left):.0f} % now."
    return f"{'; or: '.join(texts)} in rovid.toml. {shown}", False


def _signs(data: PlanarData) -> Iterator[_Correction]:
    for names in (*((name,) for name in _SPEEDS), _SPEEDS, ("heading", "yaw_rate")):
        own = [name for name in names if name in data.sensors]
        if own and (len(own) == len(names) or "heading" in own):
            runs = []
            for run in data.runs:
                is_turned = np.isin(run.event_sensor, [SENSORS.index(name) for name in own])
                runs.append(replace(run, event_value=np.where(is_turned, -run.event_value, run.event_value)))
            yield f"Change the sign of {' and '.join(own)}", replace(data, runs=tuple(runs))


def _exchanges(data: PlanarData) -> Iterator[_Correction]:
    """The seven other mirror images and quarter turns of north and east."""
    if not set(_TRACK) <= set(data.sensors):
        return
    north, east = map(SENSORS.index, _TRACK)
    for swap, *negative in product((False, True), repeat=3):
        if not (swap or any(negative)):
            continue
        runs = []
        for run in data.runs:
            sensor, value = run.event_sensor, run.event_value
            if swap:
                sensor = np.where(sensor == north, east, np.where(sensor == east, north, sensor))
            for at, is_negative in zip((north, east), negative, strict=True):
                value = np.where((sensor == at) & is_negative, -value, value)
            runs.append(replace(run, event_sensor=sensor, event_value=value))
        signs = " and ".join(name for name, is_negative in zip(_TRACK, negative, strict=True) if is_negative)
        words = [*(["exchange north and east"] * swap), *([f"change the sign of {signs}"] if signs else [])]
        text = ", and then ".join(words)
        yield text[0].upper() + text[1:], replace(data, runs=tuple(runs))


def _actuators(data: PlanarData) -> Iterator[_Correction]:
    """Thrusters that push the other way: each alone, all, and all arms; rudders that turn the other way."""
    names = [one.name for one in data.actuators.thrusters.thrusters]
    for own in (*([name] for name in names), *([names] if len(names) > 1 else [])):
        text = f"Change the sign of the thrust of {' and '.join(own)}, in the curve or in surge, sway and yaw_arm"
        yield text, _with_thrusters(data, own, ("arm", "surge_share", "sway_share"))
    if data.actuators.matrix[2].any():
        yield "Change the sign of the yaw_arm of all thrusters", _with_thrusters(data, names, ("arm",))
    for at, one in enumerate(data.vehicle.thrusters):
        if one.is_angle:
            runs = []
            for run in data.runs:
                commands = run.trial.commands * np.where(np.arange(run.trial.commands.shape[1]) == at, -1.0, 1.0)
                series = PlanarCommands(data.actuators, replace(run.trial, commands=commands))
                runs.append(replace(run, commands=series))
            yield f"Change the sign of the angle of {one.turns or one.name}", replace(data, runs=tuple(runs))


def _with_thrusters(data: PlanarData, names: Sequence[str], parts: Sequence[str]) -> PlanarData:
    def turned(one: Thruster) -> Thruster:
        return replace(one, **{part: -getattr(one, part) for part in parts}) if one.name in names else one

    vehicle = replace(data.vehicle, thrusters=tuple(map(turned, data.vehicle.thrusters)))
    actuators = PlanarActuators(vehicle, data.actuators.steered)
    runs = [replace(run, actuators=actuators, commands=PlanarCommands(actuators, run.trial)) for run in data.runs]
    return replace(data, vehicle=vehicle, actuators=actuators, runs=tuple(runs))
