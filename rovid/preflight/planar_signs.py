"""Entries of rovid.toml with a wrong sign, a wrong unit, or exchanged axes, for the coupled model.

Each single correction is tried: the sign of a signal, of a thruster or of a rudder, and the eight mirror images and
quarter turns of north and east. A correction is named if a regression of the forces on the motion then leaves a small
part of what it leaves without; a hull that the equations describe badly is described badly with each of them.
Positions next to a velocity log are compared with its integral instead.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.core.errors import DataError
from rovid.planar.dataset import PlanarData, is_yaw_alone
from rovid.planar.model import SENSORS, PlanarActuators, PlanarCommands
from rovid.planar.start_values import unexplained_share
from rovid.preflight.advice import Advice
from rovid.preflight.sensor_lags import CORRELATED, SCALES, sensor_lags
from rovid.trial.vehicle import Thruster

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

Events = Callable[[IntArray, FloatArray], tuple[IntArray, FloatArray]]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Correction:
    """One change of rovid.toml, and the data with it."""

    text: str
    data: PlanarData


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
            text = (
                f"Correct the unit of the angle of {one.name} in rovid.toml: it reaches {math.degrees(most):.0f} deg."
            )
            unit = ' Write unit = "deg".' if most < 90.0 else ""
            yield Advice(kind="wrong_entry", text=text + unit, weight="grave")
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
    correlations = [agreement(one.data) for one in tried]
    most = max(correlations)
    if most < _SAME_TRACK:
        return ""
    close = 1.0 - _TIE * (1.0 - most)
    texts = [one.text for one, own in zip(tried, correlations, strict=True) if own >= close]
    end = f"The track then follows the velocity log with a correlation of {most:.2f}."
    return f"{'; or: '.join(texts)} in [signals] of rovid.toml. {end}"


def _of_forces(data: PlanarData) -> tuple[str, bool]:
    """The correction with which the forces explain the motion, and whether they explain it without."""
    has_log = set(_SPEEDS) <= set(data.sensors)
    if has_log and set(_TRACK) <= set(data.sensors):
        data = _without(data, _TRACK)
    try:
        left = unexplained_share(data, with_current=True)
        if not _SOUND < left < math.inf:
            return "", left <= _SOUND
        tried = [*_signs(data), *_actuators(data), *([] if has_log else _exchanges(data))]
        tried = [one for one in tried if set(one.data.sensors) == set(data.sensors)]
        shares = [unexplained_share(one.data, with_current=False) for one in tried]
        first = np.argsort(shares)[:_TRIED].tolist()
        in_current = {at: min(shares[at], unexplained_share(tried[at].data, with_current=True)) for at in first}
    except DataError:
        return "", False
    least = min(in_current.values(), default=math.inf)
    if least > _CORRECTED * left:
        return "", False
    texts = [tried[at].text for at in sorted(in_current, key=in_current.__getitem__) if in_current[at] <= _TIE * least]
    shown = f"The forces then explain {100 * (1 - least):.0f} % of the motion, and {100 * (1 - left):.0f} % now."
    return f"{'; or: '.join(texts)} in rovid.toml. {shown}", False


def _changed(data: PlanarData, change: Events) -> PlanarData:
    runs = []
    for run in data.runs:
        sensor, value = change(run.event_sensor.copy(), run.event_value.copy())
        runs.append(replace(run, event_sensor=sensor, event_value=value))
    return replace(data, runs=tuple(runs))


def _without(data: PlanarData, names: Sequence[str]) -> PlanarData:
    runs = []
    for run in data.runs:
        kept = ~np.isin(run.event_sensor, list(map(SENSORS.index, names)))
        own = {name: getattr(run, name)[kept] for name in ("event_index", "event_sensor", "event_value")}
        runs.append(replace(run, **own))
    return replace(data, runs=tuple(runs))


def _turned(names: Sequence[str]) -> Events:
    """Changes of sign of some sensors."""
    numbers = list(map(SENSORS.index, names))
    return lambda sensor, value: (sensor, np.where(np.isin(sensor, numbers), -value, value))


def _signs(data: PlanarData) -> Iterator[_Correction]:
    for names in (*((name,) for name in _SPEEDS), _SPEEDS, ("heading", "yaw_rate")):
        own = [name for name in names if name in data.sensors]
        if own and (len(own) == len(names) or "heading" in own):
            text = f"Change the sign of {' and '.join(own)}"
            yield _Correction(text=text, data=_changed(data, _turned(own)))


def _exchanges(data: PlanarData) -> Iterator[_Correction]:
    """The seven other mirror images and quarter turns of north and east."""
    if not set(_TRACK) <= set(data.sensors):
        return
    north, east = map(SENSORS.index, _TRACK)
    for swap, *negative in product((False, True), repeat=3):
        if not (swap or any(negative)):
            continue

        def change(
            sensor: IntArray, value: FloatArray, swap: bool = swap, negative: list[bool] = negative
        ) -> tuple[IntArray, FloatArray]:
            other = np.where(sensor == north, east, np.where(sensor == east, north, sensor)) if swap else sensor
            for at, is_negative in zip((north, east), negative, strict=True):
                value = np.where((other == at) & is_negative, -value, value)
            return other, value

        signs = " and ".join(name for name, is_negative in zip(_TRACK, negative, strict=True) if is_negative)
        words = [*(["exchange north and east"] * swap), *([f"change the sign of {signs}"] if signs else [])]
        text = ", and then ".join(words)
        yield _Correction(text=text[0].upper() + text[1:], data=_changed(data, change))


def _actuators(data: PlanarData) -> Iterator[_Correction]:
    """Thrusters that push the other way: each alone, all, and all arms; rudders that turn the other way."""
    names = [one.name for one in data.actuators.thrusters.thrusters]
    for own in (*([name] for name in names), *([names] if len(names) > 1 else [])):
        text = f"Change the sign of the thrust of {' and '.join(own)}, in the curve or in surge, sway and yaw_arm"
        yield _Correction(text=text, data=_with_thrusters(data, own, ("arm", "surge_share", "sway_share")))
    if data.actuators.matrix[2].any():
        text = "Change the sign of the yaw_arm of all thrusters"
        yield _Correction(text=text, data=_with_thrusters(data, names, ("arm",)))
    for at, one in enumerate(data.vehicle.thrusters):
        if one.is_angle:
            runs = []
            for run in data.runs:
                commands = run.trial.commands * np.where(np.arange(run.trial.commands.shape[1]) == at, -1.0, 1.0)
                series = PlanarCommands(data.actuators, replace(run.trial, commands=commands))
                runs.append(replace(run, commands=series))
            text = f"Change the sign of the angle of {one.turns or one.name}"
            yield _Correction(text=text, data=replace(data, runs=tuple(runs)))


def _with_thrusters(data: PlanarData, names: Sequence[str], parts: Sequence[str]) -> PlanarData:
    def turned(one: Thruster) -> Thruster:
        return replace(one, **{part: -getattr(one, part) for part in parts}) if one.name in names else one

    vehicle = replace(data.vehicle, thrusters=tuple(map(turned, data.vehicle.thrusters)))
    actuators = PlanarActuators(vehicle, data.actuators.steered)
    runs = [replace(run, actuators=actuators, commands=PlanarCommands(actuators, run.trial)) for run in data.runs]
    return replace(data, vehicle=vehicle, actuators=actuators, runs=tuple(runs))
