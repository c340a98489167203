"""Guess the position and the velocity along an axis but yaw, from names and units."""

from __future__ import annotations

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.preflight.raw_columns import COMMAND, MIN_SAMPLES, SIDE, SignalGuess, ending_unit, finite_values, word_list
from rovid.preflight.thruster_guess import Columns
from rovid.trial.axis import Axis
from rovid.trial.signal_names import name_words

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
    for source, logged in columns.items():
        if chosen and source != chosen and not axis.self_righting:
            continue
        values = finite_values(logged)
        if len(values) < MIN_SAMPLES or not np.ptp(values) > 0.0:
            continue
        words = name_words(source)
        unit = ending_unit(source)
        rank = 9 if source == chosen else _axis_rank(axis, words, unit)
        if rank:
            name, guess = _axis_signal(axis, source, words, unit, values)
            if name not in best or rank > best[name][0]:
                best[name] = (rank, guess)
    if axis.angular and axis.position_signal not in best:
        return {}
    found = {name: best[name][1] for name in (*axis.position_signals, axis.rate_signal) if name in best}
    first = next(iter(found), None)
    return {name: guess for name, guess in found.items() if name == first or guess.source in shared}


def _axis_rank(axis: Axis, words: set[str], unit: str) -> int:
    """Rank of a column as a measurement along ``axis`` by its name; 0 for other quantities."""
    named = words & _AXIS_WORDS[axis.name]
    if words & _NOT_MEASURED:
        return 0
    if axis.angular:
        return 3 if named and (not unit or unit in _ANGULAR_UNITS) else 0
    if unit in _ANGULAR_UNITS:
        return 0
    if named - _DIRECTION or (named and (unit or words & _SPEED)):
        return 3
    if words & set(_LETTERS[axis.name]) and (unit in _VELOCITY_UNITS or words & _SPEED):
        return 2
    return int(axis.name == "surge" and bool(words & _OVER_GROUND) and (not unit or unit in _VELOCITY_UNITS))


def _axis_signal(axis: Axis, source: str, words: set[str], unit: str, values: FloatArray) -> tuple[str, SignalGuess]:
    """Name of the signal in rovid.toml, and the guess."""
    is_rate = unit in _VELOCITY_UNITS or (not unit and bool(words & (_SPEED | _OVER_GROUND)) and not words & _DEPTH)
    name = axis.rate_signal if is_rate else axis.position_signal
    if axis.name == "heave" and not is_rate and not words & (_DEPTH | _HEIGHT):
        name = "heave_position"
    sign, reason = 1, f"named so; {values.min():.4g} to {values.max():.4g}"
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
    return name, SignalGuess(source=source, unit=unit, sign=sign, reason=reason + detail, is_rate=is_rate)
