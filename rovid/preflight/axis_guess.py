"""Guess position and velocity along an axis but yaw, and the thrust of surge, sway and yaw together."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rovid.preflight.command_effects import CommandEffect, command_effects
from rovid.preflight.raw_columns import (
    COMMAND,
    SIDE,
    Columns,
    Log,
    SignalGuess,
    SourceColumn,
    columns_by_source,
    may_be_command,
    word_list,
)
from rovid.preflight.thruster_guess import ThrusterCommand, distinct_name, neutral_value, short_name
from rovid.trial.axis import AXES, GEODETIC_UNITS, LENGTH_UNITS, Axis

_NOT_MEASURED = word_list("axis", "not_measured") | COMMAND | SIDE
_SPEED = word_list("axis", "speed")
_DEPTH = word_list("axis", "depth")
_HEIGHT = word_list("axis", "height")
_OVER_GROUND = word_list("axis", "over_ground")
# Directions in which thrusters act: they need a unit or a word of speed.
_DIRECTION = word_list("axis", "direction")
_AXIS_WORDS = {name: word_list("axis", name) for name in ("surge", "sway", "roll", "pitch")}
_AXIS_WORDS["heave"] = word_list("axis", "heave", "depth", "height")
# Letters that name an axis in a column with the unit of a velocity.
_LETTERS = {"surge": "ux", "sway": "vy", "heave": "wz", "roll": "p", "pitch": "q"}
_VELOCITY_UNITS = {"mm/s", "cm/s", "m/s", "kn", "deg/s", "rad/s"}
_ANGULAR_UNITS = {"deg", "rad", "deg/s", "rad/s"}


def axis_signals(axis: Axis, columns: Columns, shared: Columns, chosen: str) -> dict[str, SignalGuess]:
    """Position and velocity along ``axis`` by name and unit; the user may have ``chosen`` one of them."""
    best: dict[str, tuple[int, SignalGuess]] = {}
    for source, column in columns.items():
        if (chosen and source != chosen and not axis.self_righting) or not column.varies:
            continue
        rank = 9 if source == chosen else _axis_rank(axis, column.words, column.unit)
        if rank:
            name, guess = _axis_signal(axis, column)
            if name not in best or rank > best[name][0]:
                best[name] = (rank, guess)
    if axis.angular and axis.position_signal not in best:
        return {}
    found = {name: best[name][1] for name in (*axis.position_signals, axis.rate_signal) if name in best}
    first = next(iter(found), None)
    return {name: guess for name, guess in found.items() if name == first or guess.source in shared}


def _axis_rank(axis: Axis, words: set[str], unit: str) -> int:
    """Rank of a column as a measurement along ``axis`` by name; 0 for other quantities."""
    named = words & _AXIS_WORDS[axis.name]
    if words & _NOT_MEASURED:
        return 0
    if axis.angular:
        return 3 if named and (not unit or unit in _ANGULAR_UNITS) else 0
    if unit in _ANGULAR_UNITS:
        return 0
    if named - _DIRECTION or (named and (unit or words & _SPEED)):
        return 3
    # A rate next to a letter is an angular rate, as in RATE.Y.
    if words & set(_LETTERS[axis.name]) and (unit in _VELOCITY_UNITS or words & _SPEED - {"rate"}):
        return 2
    return int(axis.name == "surge" and bool(words & _OVER_GROUND) and (not unit or unit in _VELOCITY_UNITS))


def _axis_signal(axis: Axis, column: SourceColumn) -> tuple[str, SignalGuess]:
    """Name of the signal in rovid.toml, and the guess."""
    words, unit, values = column.words, column.unit, column.values
    is_rate = unit in _VELOCITY_UNITS or (not unit and bool(words & (_SPEED | _OVER_GROUND)) and not words & _DEPTH)
    name = axis.rate_signal if is_rate else axis.position_signal
    if axis.name == "heave" and not is_rate and not words & (_DEPTH | _HEIGHT):
        name = "heave_position"
    sign, reason = 1, f"by name; {column.span}"
    if unit:
        detail = "; the unit by its name"
    elif not axis.angular:
        unit, detail = "m/s" if is_rate else "m", ""
    elif float(np.max(np.abs(values))) > 0.5 * np.pi:
        unit, detail = "deg" + "/s" * is_rate, "; more than upright in radians"
    else:
        unit, detail = "rad" + "/s" * is_rate, "; assumed to be in radians"
    if words & _HEIGHT and not is_rate:
        sign, reason = -1, f"{reason}; a height, converted to a depth"
    return name, SignalGuess(source=column.source, unit=unit, sign=sign, reason=reason + detail, is_rate=is_rate)


# Words of a position on the map.
_MAP = {"north": {"north", "northing", "nord", "norte", "n"}, "east": {"east", "easting", "ost", "est", "este", "e"}}
# Words of a latitude and of a longitude, the limit of each in deg, and the scale of integers.
_GLOBE = {"north": ({"lat", "latitude"}, 90.0), "east": ({"lon", "lng", "long", "longitude"}, 180.0)}
_SCALED = "1e-7 deg"
# Words of a thruster across the vehicle.
SIDEWAYS = word_list("axis", "sway") | {"tunnel", "querstrahlruder"}
# Largest difference between the largest values of a column and of a known command, relative, of a command like it.
_ALIKE = 0.25
# Words of a thruster along the vehicle.
_AHEAD = {"main", "aft", "stern", "forward", "haupt", "principal"}
# Remark on logs that are read for yaw alone.
COUPLED = "These logs also hold surge and sway: --axes planar fits them together with yaw."
# Words of the speed of a propeller.
_PROPELLER = {"propeller", "prop", "screw", "schraube", "rps", "rpm", "helice", "hélice", "elica"}
# Words of velocities, accelerations and errors.
_NOT_POSITION = COMMAND | {"v", "vel", "velocity", "speed", "rate", "acc", "std", "sigma", "err", "error", "wind"}


@dataclass(frozen=True, kw_only=True)
class PlanarGuess:
    """Findings in the logs of one format."""

    signals: Mapping[str, SignalGuess] = field(default_factory=dict)  #: Name in rovid.toml -> column.
    #: Axis (surge, sway) -> source of a command -> its effect along that axis.
    effects: Mapping[str, Mapping[str, CommandEffect]] = field(default_factory=dict)
    #: Column of a propeller's speed, which turns nothing, and its largest value; empty without.
    propeller: tuple[str, float] = ("", 0.0)

    @property
    def suits(self) -> bool:
        """Whether both velocities are logged, and a command, or the propeller next to a rudder, acts along them."""
        if self.propeller[0]:
            return "sway" in self.effects
        acts = any(effect.direction for along in self.effects.values() for effect in along.values())
        return acts and set(self.effects) == {"surge", "sway"}


def guess_planar(
    logs: Sequence[Log], taken: set[str], commands: Sequence[ThrusterCommand], heading: SignalGuess | None = None
) -> PlanarGuess:
    """Velocities and positions in columns that are not ``taken``, and the effects of the ``commands`` on the former."""
    free = _free_columns(logs, taken)
    signals: dict[str, SignalGuess] = {}
    effects = {}
    neutral = {command.source: command.neutral for command in commands}
    velocities = {}
    for name in ("surge", "sway"):
        axis = AXES[name]
        if motion := axis_signals(axis, free, free, "").get(axis.rate_signal):
            signals[axis.rate_signal] = velocities[name] = motion
    for name, motion in velocities.items():
        others = [one for other, one in velocities.items() if other != name]
        turn = (heading, *others) if heading and others else ()
        effects[name] = command_effects(neutral, logs, motion, turn=turn) if neutral else {}
    for guess in (_position, _fix):
        positions = {name: found for name in _MAP if (found := guess(name, free)) is not None}
        if len(positions) == len(_MAP):
            signals |= positions
            break
    propeller = ("", 0.0)
    for source, column in free.items():
        if not commands and column.words & _PROPELLER and column.is_long and np.any(column.values):
            propeller = source, float(np.max(np.abs(column.values)))
            break
    return PlanarGuess(signals=signals, effects=effects, propeller=propeller)


def _free_columns(logs: Sequence[Log], taken: set[str]) -> Columns:
    """Columns that all logs have and that are not ``taken``."""
    columns = columns_by_source(logs)
    return {name: one for name, one in columns.items() if len(one.logged) == len(logs) and name not in taken}


def further_thrusters(
    logs: Sequence[Log], taken: set[str], commands: Sequence[ThrusterCommand]
) -> list[ThrusterCommand]:
    """Commands of thrusters that do not turn the vehicle, in columns that are not ``taken``.

    Their values are like those of the ``commands``. They are pulses, or the name has a direction.
    """
    found: list[ThrusterCommand] = []
    largest = {max(abs(one.lowest), abs(one.highest)) for one in commands}
    for source, column in _free_columns(logs, taken).items():
        if not column.varies or not may_be_command(source, column.words):
            continue
        values, neutral = column.values, neutral_value(column.values)
        low, high = float(values.min()), float(values.max())
        is_named = neutral > 0.0 or column.words & (SIDEWAYS | _AHEAD)  # Pulses have a neutral value of their own.
        size = max(abs(low), abs(high))
        if is_named and low <= neutral <= high and any(math.isclose(size, one, rel_tol=_ALIKE) for one in largest):
            name = distinct_name(short_name(source), [one.name for one in (*commands, *found)])
            reason = f"{low:.4g} to {high:.4g}, like the other commands; no thrust at {neutral:g}"
            found.append(
                ThrusterCommand(
                    name=name, source=source, direction=0, neutral=neutral, lowest=low, highest=high, reason=reason
                )
            )
    return found


def _position(name: str, columns: Columns) -> SignalGuess | None:
    """North or east in a unit of length, by the name of the column."""
    for source, column in columns.items():
        words, unit = column.words, column.unit
        if words & _MAP[name] and not words & _NOT_POSITION and unit in {"", *LENGTH_UNITS} and column.varies:
            return SignalGuess(source=source, unit=unit or "m", reason=f"by name; {column.span}")
    return None


def _fix(name: str, columns: Columns) -> SignalGuess | None:
    """Latitude or longitude by the name of the column and its range."""
    named, limit = _GLOBE[name]
    for source, column in columns.items():
        values = column.values
        if not column.words & named or column.words & _NOT_POSITION or not column.is_long:
            continue
        low, high = np.quantile(values, (0.01, 0.99))
        unit = "deg" if max(-low, high) <= limit else _SCALED
        if low < high and max(-low, high) * GEODETIC_UNITS[unit] <= limit * GEODETIC_UNITS["deg"]:
            reason = f"by name; {values.min():.9g} to {values.max():.9g}, {unit}"
            return SignalGuess(source=source, unit=unit, reason=reason)
    return None
