"""Guess which columns hold which signal, from names, values and the response of the vehicle; with reasons."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.formatting import significant
from rovid.preflight.axis_guess import axis_signals
from rovid.preflight.command_effects import CommandEffect, command_effects
from rovid.preflight.drive_guess import (
    STEERING,
    RudderGuess,
    guess_rudder,
    guess_shaft,
    lone_yaw_rate,
    rate_unit,
    speed_question,
)
from rovid.preflight.raw_columns import (
    COMMAND,
    FULL_TURN,
    LIGHT,
    MIN_SAMPLES,
    NOT_HEADING,
    RATE,
    SUPPLY,
    VOLTAGE,
    Columns,
    Log,
    RawColumn,
    SignalGuess,
    SourceColumn,
    columns_by_source,
    is_error_or_order,
    is_torque,
    is_yaw_rate,
    may_be_heading,
    mean_rates,
    named_unit,
    word_list,
)
from rovid.preflight.thruster_guess import GuessHints, ThrusterCommand, azimuth_angles, guess_thrusters
from rovid.trial.axis import HEADING_WORDS, YAW, YAW_RATE_WORDS, is_per_second, name_words

# Signals that drive the vehicle.
_DRIVES = ("torque", "yaw_rate_order")
# Part of the reason of a heading that only its values reveal.
UNNAMED = "no column is named a heading"
_AZIMUTH = (
    "{} is the angle of an azimuth thruster, by its name. Give that thruster position and azimuth in rovid.toml, as in "
    "`rovid help files`; its force is only known with --axes planar."
)
# V or mV, range of the median of a supply.
_SUPPLY_RANGE = (3.0, 1e5)
_NOT_VOLTAGE = word_list("supply", "not_voltage") | COMMAND
# Minimum correlation of a gyro with the rate of the heading.
_CORRELATED = 0.7
# s, window of a course over ground.
_TRACK_WINDOW = 1.0
_TILTS = {"roll": word_list("yaw", "roll"), "pitch": word_list("yaw", "pitch")}
# "psi" as the unit of a pressure.
_PRESSURE = re.compile(r"(?i:press\w*\W?_?psi)|[a-z][\W_]*PSI\b")
_NOT_TILT = NOT_HEADING | RATE | YAW_RATE_WORDS | COMMAND


@dataclass(frozen=True, kw_only=True)
class ColumnMapping:
    """Guessed contents of the columns of all logs of one format."""

    signals: Mapping[str, SignalGuess]  #: Name in rovid.toml -> source, the signal that measures the motion first.
    commands: tuple[ThrusterCommand, ...]
    rudders: tuple[RudderGuess, ...] = ()
    #: Kinds of required columns that were not recognised: the position along the axis, "command".
    missing: tuple[str, ...] = ()
    unused: tuple[str, ...] = ()  #: Sources without a meaning.
    remarks: tuple[str, ...] = ()  #: Other choices of columns.

    @property
    def measured(self) -> SignalGuess:
        """Signal that measures the motion along the axis; present where nothing is missing."""
        return next(iter(self.signals.values()))

    @property
    def sources(self) -> list[str]:
        """Sources of all signals and commands."""
        angles = [rudder.angle.source for rudder in self.rudders]
        commands = [command.source for command in self.commands]
        return [signal.source for signal in self.signals.values()] + commands + angles

    def of(self, columns: Iterable[str]) -> Self:
        """The mapping with the sources among ``columns`` that have no meaning, those named as a command first."""
        unused = (source for source in columns if source not in self.sources)
        return replace(self, unused=tuple(sorted(unused, key=lambda source: not name_words(source) & COMMAND)))

    @property
    def actuation(self) -> set[str]:
        """Sources of the commands, of steering angles, and of a logged drive."""
        drives = [signal.source for name, signal in self.signals.items() if name in _DRIVES]
        return {*drives, *(command.source for command in self.commands), *(one.angle.source for one in self.rudders)}


def map_columns(logs: Sequence[Log], hints: GuessHints | None = None) -> ColumnMapping:
    """Guess the contents of the columns of ``logs``, each given by source without the clock."""
    hints = hints or GuessHints()
    columns = columns_by_source(logs)
    # A log without a mapped signal cannot be read: optional signals have to be in all logs.
    shared = {source: column for source, column in columns.items() if len(column.logged) == len(logs)}
    if hints.axis is YAW:
        signals = _yaw_signals(columns, shared, logs, hints.heading)
        position = signals.get("heading") or signals.get("yaw_rate")
        is_vehicle = "heading" in signals or (position is not None and is_yaw_rate(position.source))
        if not is_vehicle and (shaft := guess_shaft(columns, logs, hints.heading, hints.commands)) is not None:
            return ColumnMapping(signals=shaft[0], commands=shaft[1], remarks=shaft[2]).of(columns)
    else:
        signals = axis_signals(hints.axis, columns, shared, hints.heading)
        position = next(iter(signals.values()), None)
    supply = _supply(shared, {signal.source for signal in signals.values()} | {*hints.commands})
    if supply is not None:
        signals["supply_voltage"] = SignalGuess(source=supply, reason="by name; the diagnosis tests for its influence")
    taken = {signal.source for signal in signals.values()}
    free = {source: column for source, column in columns.items() if source not in taken}
    rudders, commands = _drives(free, logs, position, hints, signals)
    if hints.axis.self_righting and not any(command.direction for command in commands):
        # The vehicle was tilted and released.
        commands = ()
    if not commands and not rudders and hints.axis is YAW and (torque := _torque(free, logs, position)) is not None:
        signals["torque"] = torque
    missing = [] if position else [hints.axis.position_signal]
    if not (commands or rudders or "torque" in signals or hints.axis.self_righting):
        missing.append("command")
    remarks = [speed_question(free)] if "command" in missing and hints.axis is YAW else []
    if angles := ", ".join(azimuth_angles(free)):
        remarks.append(_AZIMUTH.format(angles))
    mapping = ColumnMapping(signals=signals, commands=commands, rudders=rudders, missing=tuple(missing))
    return replace(mapping, remarks=tuple(filter(None, remarks))).of(columns)


def _drives(
    free: Columns, logs: Sequence[Log], position: SignalGuess | None, hints: GuessHints, signals: dict[str, SignalGuess]
) -> tuple[tuple[RudderGuess, ...], tuple[ThrusterCommand, ...]]:
    """Rudders and thrusters among ``free`` columns; the speed at a rudder is added to ``signals``."""
    found = None
    if hints.axis is YAW and position is not None and not hints.outputs and not any(map(is_torque, free.values())):
        found = guess_rudder(free, logs, position, hints)
    if found is None:
        return (), guess_thrusters(free, logs, position, hints)
    rudder, speed = found
    # The order to the rudder and further columns of its angle are no thrusters.
    others = {one: logged for one, logged in free.items() if one != speed.source and not logged.words & STEERING}
    # A propeller in front of the rudder turns nothing.
    commands = tuple(one for one in guess_thrusters(others, logs, position, hints) if one.direction)
    if commands and not rudder.direction_known:
        return (), guess_thrusters(free, logs, position, hints)
    signals[rudder.speed] = speed
    return (rudder,), commands


def _supply(shared: Columns, taken: set[str]) -> str | None:
    """Source of the supply voltage by name and values; one with a word of voltage before the others."""
    found = []
    low, high = _SUPPLY_RANGE
    for source, column in shared.items():
        if source in taken or not column.words & SUPPLY or column.words & _NOT_VOLTAGE:
            continue
        if column.changes and low <= np.median(column.values) <= high:
            found.append(source)
    return max(found, key=lambda source: bool(shared[source].words & VOLTAGE), default=None)


def _torque(columns: Columns, logs: Sequence[Log], heading: SignalGuess | None) -> SignalGuess | None:
    """A logged yaw torque, in the sense in which it turns the heading."""
    for source, column in columns.items():
        if not column.varies or not is_torque(column) or column.words & (NOT_HEADING | LIGHT):
            continue
        effect = CommandEffect() if heading is None else command_effects({source: 0.0}, logs, heading)[source]
        sign, reason = 1, f"by name; {column.span}"
        if effect.direction < 0:
            sign, reason = -1, f"{reason}; more of it turns the heading down ({effect.text}): sign changed here"
        return SignalGuess(source=source, unit="kN m" if "knm" in column.words else "N m", sign=sign, reason=reason)
    return None


# ---- yaw


def _yaw_signals(columns: Columns, shared: Columns, logs: Sequence[Log], chosen: str) -> dict[str, SignalGuess]:
    """Heading, yaw rate and tilts that were found; the user may have ``chosen`` the heading."""
    heading = None
    if not chosen:
        heading = _heading(columns)
    elif chosen in columns and not is_yaw_rate(chosen) and not rate_unit(chosen):
        unit, reason = _angle_unit(columns[chosen])
        if _is_planar(chosen, columns):
            unit, reason = "rad", "the angle of a planar pose"
        heading = SignalGuess(source=chosen, unit=unit, reason=f"given; {reason}") if unit else None
    guesses = {"heading": heading}
    guesses["yaw_rate"] = lone_yaw_rate(columns, chosen) if heading is None else _yaw_rate(shared, logs, heading)
    for name, words in _TILTS.items():
        guesses[name] = _tilt(shared, name, words, heading)
    return {name: guess for name, guess in guesses.items() if guess is not None}


def _heading(columns: Columns) -> SignalGuess | None:
    """Heading by name, by an orientation, or by jumps of a whole turn."""
    measured = []
    for source, column in columns.items():
        if not (is_per_second(source) or is_error_or_order(source) or _PRESSURE.search(source)):
            measured += [source] if may_be_heading(column.words) else []
    named = [source for source in measured if name_words(source) & HEADING_WORDS or _is_planar(source, columns)]
    oriented = [source for source, column in columns.items() if column.logged[0].radians]
    best, best_rank = None, (False, False, 0)
    if oriented and not any(columns[source].varies for source in named):
        best = SignalGuess(source=oriented[0], unit="rad", reason="an orientation, from which the heading is computed")
        if name_words(best.source) != {"q"}:
            return best
        # Four columns q.x to q.w without another name may be odometry: an angle that jumps comes first.
        measured = [source for source in measured if source != best.source]
    for source in measured:
        column, is_named = columns[source], source in named
        unit, reason = _angle_unit(column)
        if unit and _is_planar(source, columns):
            unit, reason = "rad", f"the angle of a planar pose; {column.span}"
        elif unit and "jumps" not in reason and not named_unit(source) and (tracked := _unit_by_track(column, columns)):
            unit, reason = tracked, f"{column.span}; it turns with the track x, y"
        jumps = "jumps" in reason
        if not unit or not (is_named or (jumps and not column.words & VOLTAGE)):
            continue
        # A column that jumps is an angle for sure. Among several, the finest resolution is best.
        rank = (is_named, jumps, len(np.unique(column.values)))
        if rank > best_rank:
            reason = f"by name; {reason}" if is_named else f"{reason}; {UNNAMED}"
            best, best_rank = SignalGuess(source=source, unit=unit, reason=reason), rank
    return best


def _is_planar(source: str, columns: Columns) -> bool:
    """Whether a column is the angle of a planar pose x, y, theta, as of a Pose2D."""
    stem = source.removesuffix("theta")
    return stem != source and {stem + "x", stem + "y"} <= {*columns} and stem + "z" not in columns


def turn_of_heading(column: RawColumn) -> float | None:
    """Size of a whole turn in a column that is a heading by name and values; None for other columns."""
    if column.radians:
        return FULL_TURN["rad"]
    # A logger of thrusters may put its own name in front of every column.
    words = name_words(column.source) - COMMAND
    other = is_per_second(column.source) or is_error_or_order(column.source)
    if other or not words & HEADING_WORDS or not may_be_heading(words):
        return None
    unit, _ = _angle_unit(SourceColumn(column.source, [column]))
    return FULL_TURN.get(unit)


def _angle_unit(column: SourceColumn) -> tuple[str, str]:
    """Unit of a heading and the reason; empty for constant or too few values."""
    if not column.varies:
        return "", ""
    low, high, span = float(column.values.min()), float(column.values.max()), column.span
    steps = np.concatenate([np.abs(np.diff(one.values)) for one in column.logged])
    for unit, turn in FULL_TURN.items():
        within = -1.01 * turn / 2 <= low and high <= 1.01 * turn
        if within and np.any(np.abs(steps - turn) < 0.1 * turn):
            return unit, f"{span}, and it jumps by {significant(turn, 3)}, a whole turn"
    named = named_unit(column.source)
    if named in FULL_TURN:
        return named, f"{span}; the unit by its name"
    if max(-low, high) > 1.01 * FULL_TURN["rad"]:
        return "deg", f"{span}, more than a turn in radians"
    return "rad", f"{span}: assumed to be radians, because it stays within a turn"


def _unit_by_track(column: SourceColumn, columns: Columns) -> str:
    """Unit in which a heading turns as far as the course of the track x, y; empty if these do not turn together."""
    if not {"x", "y"} <= {*columns}:
        return ""
    turns: list[FloatArray] = []
    for heading, x, y in zip(column.logged, columns["x"].logged, columns["y"].logged, strict=False):
        if not len(heading.time) == len(x.time) == len(y.time):
            continue
        step = max(1, int(np.searchsorted(heading.time, heading.time[0] + _TRACK_WINDOW)))
        course = np.unwrap(np.angle(np.diff(x.values[::step]) + 1j * np.diff(y.values[::step])))
        middle = 0.5 * (heading.values[::step][1:] + heading.values[::step][:-1])
        turns.append(np.vstack([np.diff(middle), np.diff(course)]))
    own, track = np.concatenate([np.empty((2, 0)), *turns], axis=1)
    known = np.isfinite(own) & np.isfinite(track) & (np.abs(track) < 0.5 * np.pi)
    own, track = own[known], track[known]
    if len(own) < MIN_SAMPLES or not np.std(own) > 0.0 or not np.std(track) > 0.0:
        return ""
    if abs(np.corrcoef(own, track)[0, 1]) < _CORRELATED:
        return ""
    # The geometric mean of 1 and the number of radians in a degree.
    return "rad" if abs(track @ own / (own @ own)) > np.sqrt(np.pi / 180.0) else "deg"


def _tilt(columns: Columns, name: str, known: frozenset[str], heading: SignalGuess | None) -> SignalGuess | None:
    """Roll or pitch by name; "phi_p" is no roll."""
    unwanted = _NOT_TILT | ({"r", "p", "y"} - {name[0]})
    heading_words = name_words(heading.source) if heading else set()
    # The column that is named most like the heading is of the same sensor, in the same unit.
    for source, column in sorted(columns.items(), key=lambda item: -len(item[1].words & heading_words)):
        if not column.words & known or column.words & unwanted or is_error_or_order(source):
            continue
        if _is_planar(source, columns) or not column.is_long:
            continue
        values = column.values
        unit, reason = named_unit(source), ""
        if not unit and float(np.max(np.abs(values))) > 0.5 * np.pi:
            unit, reason = "deg", ", more than upright in radians"
        elif not unit:
            unit = "deg" if heading is None else heading.unit
            reason = f": assumed to be in {unit}{'' if heading is None else ' like the heading'}"
        text = f"by name; {values.min():.3g} to {values.max():.3g}{reason}"
        return SignalGuess(source=source, unit=unit, reason=text)
    return None


def _yaw_rate(columns: Columns, logs: Sequence[Log], heading: SignalGuess) -> SignalGuess | None:
    """A gyro by name, with unit and sign from its regression on the rate of the heading."""
    for source in columns:
        if source == heading.source or not is_yaw_rate(source):
            continue
        # (2, n) mean rates of the heading, and the values in the middles of their windows.
        pairs = [np.empty((2, 0))]
        for log in logs:
            if heading.source not in log or source not in log:
                continue
            time, rate = mean_rates(heading, log[heading.source])
            gyro = log[source]
            known = np.isfinite(gyro.values)
            if known.any() and rate.size:
                middles = 0.5 * (time[1:] + time[:-1])
                pairs.append(np.array([rate, np.interp(middles, gyro.time[known], gyro.values[known])]))
        own, logged = np.concatenate(pairs, axis=1)
        if len(own) < MIN_SAMPLES or not np.std(own) > 0.0 or not np.std(logged) > 0.0:
            continue
        correlation = float(np.corrcoef(own, logged)[0, 1])
        if abs(correlation) < _CORRELATED:
            continue
        ratio = abs(float(logged @ own / (own @ own)))
        # The geometric mean of 1 and the number of degrees in a radian.
        unit = "deg/s" if ratio > np.sqrt(180.0 / np.pi) else "rad/s"
        if correlation > 0.0:
            return SignalGuess(source=source, unit=unit, reason="by name; it follows the rate of the heading")
        reason = "by name; it follows the negative rate of the heading: sign changed here"
        return SignalGuess(source=source, unit=unit, sign=-1, reason=reason)
    return None
