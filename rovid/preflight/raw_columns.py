"""Columns of raw logs before they are mapped to signals: samples, mean rates, and the words in their names."""

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.trial.axis import CLOCK_WORDS, HEADING_WORDS, YAW_RATE_WORDS, is_per_second, name_words
from rovid.trial.rates import integral
from rovid.trial.vehicle_presets import SIDE_WORDS

# A whole turn in each unit of angle.
FULL_TURN = {"deg": 360.0, "rad": 2.0 * np.pi, "0.01 deg": 36000.0}
# Minimum number of samples for a guess; decision.
MIN_SAMPLES = 30
# s, averaging window of a rate.
RATE_WINDOW = 0.5
# s from the median time stamp: stamps farther away are damaged, or older than the setting of the clock.
_MAX_TIME_OFFSET = 3e6
# Maximum number of averaging windows in one log.
_MAX_WINDOWS = 500_000

_LISTS = tomllib.loads(Path(__file__).with_name("words.toml").read_text(encoding="utf-8"))


def word_list(table: str, *names: str) -> frozenset[str]:
    """Words of the lists ``names`` in one ``table`` of words.toml."""
    return frozenset().union(*(_LISTS[table][name] for name in names))


COMMAND = word_list("thruster", "command")
LIGHT = word_list("thruster", "light")
SIDE = frozenset().union(*SIDE_WORDS.values())
VOLTAGE = word_list("supply", "voltage")
SUPPLY = word_list("supply", "source")
NOT_HEADING = word_list("yaw", "not_measured")
RATE = word_list("yaw", "rate")
_NOT_HEADING_ENDINGS = tuple(word_list("yaw", "not_measured_ending"))
_COMPASS = word_list("yaw", "compass")
_TORQUE = word_list("thruster", "torque")
# Words of a command of motion, which does not belong to one thruster. "prua" is a bow as well as a heading.
MOTION_COMMAND = (HEADING_WORDS - {"prua"}) | YAW_RATE_WORDS | word_list("thruster", "motion")
_NOT_COMMAND = (
    (CLOCK_WORDS - {"t"}) | SUPPLY | MOTION_COMMAND | word_list("thruster", "light", "other", "pilot", "feedback")
)
_NOT_THRUSTER_VOLTAGE = word_list("supply", "not_thruster_voltage")
_ENDS_IN_NEWTON_METRES = re.compile(r"N[ ·*]?m\W*$")
# Word in a name -> unit.
_UNITS = {"deg": "deg", "degrees": "deg", "grad": "deg", "rad": "rad", "radians": "rad", "dps": "deg/s", "rps": "rad/s"}
# Unit -> pattern of a name that ends in it.
_UNIT_ENDINGS: Mapping[str, re.Pattern[str]] = {
    unit: re.compile(rf"(?:^|[^A-Za-z]|(?<=[a-z])(?=[A-Z]))(?i:{'|'.join(ends)})\W*$")
    for unit, ends in _LISTS["unit_ending"].items()
}
# The unit of another quantity at the end of a name.
_OTHER_UNIT = re.compile(
    r"(?:[^A-Za-z](?:A|W|C|K|bar|degC|m|m/s|kn|deg|grad|rad)|[^A-Za-z]?(?i:dps|deg/s|rad/s|rad_s|°/s))\W*$"
)


# The field of a message that has one value.
_FIELD = re.compile(r"(?i)\.(?:data|value)(?:\[\d+\]|\.\d+)?$")
# Words of a yaw rate with the symbol r.
_RATE_SYMBOL = {"r", "deg", "rad", "degs", "rads", "dps", "s", "data", "value"}
# An error (e_psi, psi_e), an order (psi_d, psi_c, psi_r) or a difference (d_psi), by one letter.
_LETTER = re.compile(r"(?i)(?:^|[/.\s])[ed]_(?=[a-z])|(?<=[a-z])_[edcr]\W*$")


@dataclass(frozen=True, kw_only=True, eq=False)
class RawColumn:
    """Samples of one column or field of one log: (n,) times in s and (n,) values.

    ``radians`` marks headings in rad that were computed from an orientation.
    """

    source: str
    time: FloatArray
    values: FloatArray
    radians: bool = False


@dataclass(frozen=True, kw_only=True)
class SignalGuess:
    """Source of one signal with unit, sign and the reason of the guess; ``is_rate`` marks a velocity."""

    source: str
    reason: str
    unit: str = ""
    sign: int = 1
    is_rate: bool = False


# ---- samples


class SourceColumn:
    """One source in all logs that have it: the words and the unit of its name, and its values."""

    def __init__(self, source: str, logged: Sequence[RawColumn]) -> None:
        self.source, self.logged = source, logged
        self.words, self.unit = name_words(source), ending_unit(source)

    @cached_property
    def values(self) -> FloatArray:
        """(n,) finite values in all logs."""
        values = np.concatenate([column.values for column in self.logged])
        return np.asarray(values[np.isfinite(values)])

    @property
    def span(self) -> str:
        """Lowest and highest value, for people."""
        return f"{self.values.min():.4g} to {self.values.max():.4g}"

    @property
    def changes(self) -> bool:
        """Whether the values differ."""
        return bool(self.values.size) and bool(np.ptp(self.values) > 0.0)

    @property
    def is_long(self) -> bool:
        """Whether there are enough values for a guess."""
        return len(self.values) >= MIN_SAMPLES

    @property
    def varies(self) -> bool:
        """Whether there are enough values, and they differ."""
        return self.is_long and self.changes


# Source -> its column: of one log, and of all logs.
Log = Mapping[str, RawColumn]
Columns = Mapping[str, SourceColumn]


def _positions(signal: SignalGuess, column: RawColumn) -> tuple[FloatArray, FloatArray]:
    """(n,) times in s and positions along the axis: angles unwrapped in rad, velocities integrated."""
    known = np.flatnonzero(np.isfinite(column.values) & np.isfinite(column.time))
    if known.size:
        stamps = column.time[known]
        known = known[np.abs(stamps - np.median(stamps)) < _MAX_TIME_OFFSET]
    time, values = column.time[known], signal.sign * column.values[known]
    if signal.is_rate:
        return time, integral(time, values)
    if signal.unit in FULL_TURN:
        return time, np.unwrap(values * (2.0 * np.pi / FULL_TURN[signal.unit]))
    return time, values


def mean_rates(signal: SignalGuess, column: RawColumn, window: float = RATE_WINDOW) -> tuple[FloatArray, FloatArray]:
    """(m + 1,) times in s, one ``window`` apart, and the (m,) mean rates between them, rad/s of angles."""
    time, position = _positions(signal, column)
    if len(time) < MIN_SAMPLES:
        return np.empty(0), np.empty(0)
    # One damaged time stamp could otherwise lead to millions of windows.
    window = max(window, 2.0 * float(np.median(np.diff(time))), float(np.ptp(time)) / _MAX_WINDOWS)
    grid = np.arange(time[0], time[-1], window)
    return grid, np.diff(np.interp(grid, time, position)) / window


def position_at(signal: SignalGuess, column: RawColumn, time: FloatArray) -> FloatArray:
    """(m,) positions along the axis at ``time`` in s, rad of angles."""
    known, position = _positions(signal, column)
    return np.asarray(np.interp(time, known, position))


def held_mean(time: FloatArray, values: FloatArray, edges: FloatArray) -> FloatArray:
    """(m,) means of (n,) ``values`` under a zero-order hold between the (m + 1,) ``edges`` in s."""
    ends = np.append(time, max(time[-1], edges[-1]) + 1.0)
    integral = np.concatenate(([0.0], np.cumsum(values * np.diff(ends))))
    return np.asarray(np.diff(np.interp(edges, ends, integral)) / np.diff(edges))


# ---- names


def is_thruster_command(source: str) -> bool:
    """Whether a column is a thruster command by its name."""
    words = name_words(source)
    # "v" is a sway velocity too, and a voltage without another word is that of the supply.
    voltage = words & VOLTAGE and words - VOLTAGE and not words & _NOT_THRUSTER_VOLTAGE
    return may_be_command(source, words) and bool(words & (COMMAND | SIDE) or voltage)


def columns_by_source(logs: Sequence[Log]) -> dict[str, SourceColumn]:
    """The columns of all logs with each source."""
    columns: dict[str, list[RawColumn]] = {}
    for log in logs:
        for source, column in log.items():
            columns.setdefault(source, []).append(column)
    return {source: SourceColumn(source, logged) for source, logged in columns.items()}


def may_be_command(source: str, words: set[str]) -> bool:
    """Whether neither ``words`` nor the unit in the name of ``source`` belong to another quantity."""
    return not words & _NOT_COMMAND and not has_other_unit(source)


def has_other_unit(source: str) -> bool:
    """Whether a name ends in a unit that no thruster command has."""
    return bool(_OTHER_UNIT.search(source))


def named_unit(source: str) -> str:
    """Unit of an angle or of its rate, from a word of the name; empty without one."""
    words = name_words(source)
    return next((unit for word, unit in _UNITS.items() if word in words), "")


def ending_unit(source: str) -> str:
    """Unit of a motion in which the name ends, but for the field of a message; empty without one."""
    name = _FIELD.sub("", source)
    return next((unit for unit, ending in _UNIT_ENDINGS.items() if ending.search(name)), "")


def is_torque(column: SourceColumn) -> bool:
    """Whether a column is a yaw torque by a word, its unit, or the SNAME symbol N with values of both signs."""
    symbol = column.source == "N" and column.values.min() < 0.0 < column.values.max()
    return bool(column.words & _TORQUE or _ENDS_IN_NEWTON_METRES.search(column.source) or symbol)


def is_error_or_order(source: str) -> bool:
    """Whether a letter in a name marks the error or the order of a controller."""
    return bool(_LETTER.search(source))


def is_yaw_rate(source: str) -> bool:
    """Whether a column is a yaw rate by its name."""
    words = name_words(source)
    if words & NOT_HEADING or is_error_or_order(source):
        return False
    if words & YAW_RATE_WORDS or {"rate", "turn"} <= words or (words & HEADING_WORDS and is_per_second(source)):
        return True
    # The SNAME symbol with a unit alone: r_deg_s; in wheel_r_deg_s it stands for right.
    if "r" in words and words <= _RATE_SYMBOL and ending_unit(source) in {"deg/s", "rad/s"}:
        return True
    return bool(words & (HEADING_WORDS | {"z", "r"}) and words & RATE)


def may_be_heading(words: set[str]) -> bool:
    """Whether no word of a name contradicts a measured heading."""
    if any(word.startswith("soll") or word.endswith(_NOT_HEADING_ENDINGS) for word in words):
        return False
    # A gyrocompass measures the heading.
    rates = RATE - {"gyro"} if words & _COMPASS else RATE
    return not words & (NOT_HEADING | rates | YAW_RATE_WORDS | COMMAND)
