"""Which column or topic holds what: guesses from names, values and how the vehicle answers, each with its reason."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.preflight.axis_signal_guess import guessed_along
from rovid.preflight.raw_columns import FEWEST, TURN, RawColumn, SignalGuess, finite_values, mean_rates
from rovid.preflight.thruster_guess import (
    COMMAND,
    LIGHTS,
    SUPPLY,
    VOLTS,
    CommandEffect,
    GuessHints,
    ThrusterCommand,
    command_effects,
    guess_thrusters,
    is_torque,
)
from rovid.trial.axis import YAW
from rovid.trial.signal_names import HEADING_WORDS, YAW_RATE_WORDS, is_per_second, name_words

_UNITS = {"deg": "deg", "degrees": "deg", "grad": "deg", "rad": "rad", "radians": "rad", "dps": "deg/s", "rps": "rad/s"}
_NOT_MEASURED = {"set", "setpoint", "desired", "target", "ref", "reference", "wanted", "error", "err", "std", "sigma"}
_NOT_MEASURED |= {"sp", "soll", "sollkurs", "sollwert", "consigne", "consigna", "settpunkt", "ønsket", "deseado"}
_NOT_MEASURED |= {
    "deseada",
    "objetivo",
    "cible",
    "cmd",
    "demand",
    "erreur",
    "fehler",
    "feil",
    "avvik",
    "ecart",
    "écart",
    "desvio",
}
_NOT_MEASURED |= {"joystick", "stick", "manette", "pilot", "rcin", "input", "trim"}
# Ends of words of one piece that are no headings.
_ASTRAY = ("fehler", "feil", "avvik", "abweichung", "settpunkt")
# Where it goes, which is not where it points.
_NOT_MEASURED |= {"over", "über", "ueber", "ground", "grund", "grunn", "fond", "fondo", "sobre", "cog", "sog"}
_NOT_MEASURED |= {"gps", "track", "küg", "kueg"}
_NOT_MEASURED |= {"palanca", "manche", "spak", "steuerknüppel", "steuerknueppel", "joy", "leva"}
_RATES = {"rate", "gyro", "angular", "velocity", "speed", "acc", "accel", "acceleration", "dps", "omega"}
_RATES |= {"geschwindigkeit", "vitesse", "taux", "velocidad", "velocità", "velocita", "hastighet"}
# A gyro that is said to tell a heading is a compass.
_COMPASS = {"heading", "hdg", "kurs", "cap", "rumbo", "compass", "kompass", "azimuth"}
_ROLL = {"roll", "phi", "roulis", "rollwinkel", "kraengung", "krängung"}
_PITCH = {"pitch", "theta", "tangage", "nick", "nickwinkel", "assiette"}
_NOT_VOLTS = {"curr", "current", "amps", "a", "temp", "temperature", "percent", "remaining", "id", "res", "resistance"}
_NOT_VOLTS |= {"inst", "instance", "energy", "enrg", "consumed", "charge", "capacity", "type", "function", "mode"}
_NOT_VOLTS |= {"pct", "soc", "strom", "courant", "health", "state", "fault", "h", "sh"}
# Of a heading that is known by nothing but its values.
UNNAMED = "no column is named a heading"
# What drives a vehicle, in V or mV.
_SUPPLIES = (3.0, 1e5)


@dataclass(frozen=True, kw_only=True)
class ColumnMapping:
    """All of a folder; ``signals`` by their names in rovid.toml, and the sources that are none of them."""

    signals: Mapping[str, SignalGuess]
    commands: tuple[ThrusterCommand, ...]
    missing: tuple[str, ...] = field(default=())
    unused: tuple[str, ...] = field(default=())

    @property
    def measured(self) -> SignalGuess:
        """What tells where the vehicle is along the axis, or how fast it goes; there where nothing is lacking."""
        return next(iter(self.signals.values()))

    @property
    def has_actuation(self) -> bool:
        """Whether anything drives the vehicle along the axis."""
        return bool(self.commands) or "torque" in self.signals


def map_columns(logs: Sequence[Mapping[str, RawColumn]], wanted: GuessHints | None = None) -> ColumnMapping:
    """What the columns of ``logs``, by source, are, beside what is known; the clock is none of them."""
    wanted = wanted or GuessHints()
    every: dict[str, list[RawColumn]] = {}
    for log in logs:
        for source, seen in log.items():
            every.setdefault(source, []).append(seen)
    # A log without a signal that is mapped cannot be read: what is not needed has to be in all of them.
    shared = {source: seen for source, seen in every.items() if len(seen) == len(logs)}
    signals = _measured(every, shared, logs, wanted)
    measured = next(iter(signals.values()), None) if wanted.axis is not YAW else signals.get("heading")
    supply = _supply(shared, {signal.source for signal in signals.values()} | {*wanted.commands})
    if supply is not None:
        signals["supply_voltage"] = SignalGuess(
            source=supply, reason="named so; the diagnosis tests what depends on it"
        )
    taken = {signal.source for signal in signals.values()}
    free = {source: seen for source, seen in every.items() if source not in taken}
    commands = guess_thrusters(free, logs, measured, wanted)
    if wanted.axis.self_righting and not any(command.direction for command in commands):
        commands = ()  # it was tilted and let go of
    if not commands and wanted.axis is YAW and (torque := _torque(free, logs, measured)) is not None:
        signals["torque"] = torque
    known = bool(commands) or "torque" in signals or wanted.axis.self_righting
    lacking = [what for what, there in ((wanted.axis.position_signal, measured), ("command", known)) if not there]
    taken = {signal.source for signal in signals.values()} | {command.source for command in commands}
    unused = tuple(source for source in every if source not in taken)
    return ColumnMapping(signals=signals, commands=commands, missing=tuple(lacking), unused=unused)


def _measured(
    every: Mapping[str, Sequence[RawColumn]],
    shared: Mapping[str, Sequence[RawColumn]],
    logs: Sequence[Mapping[str, RawColumn]],
    wanted: GuessHints,
) -> dict[str, SignalGuess]:
    """What tells of the motion along the axis, that which places the vehicle first."""
    if wanted.axis is YAW:
        return _motions(shared, logs, _heading(every, wanted.heading))
    found = guessed_along(wanted.axis, every, wanted.heading)
    # Beside what is needed, only what all logs hold.
    return {name: one for number, (name, one) in enumerate(found.items()) if not number or one.source in shared}


def _motions(
    shared: Mapping[str, Sequence[RawColumn]], logs: Sequence[Mapping[str, RawColumn]], heading: SignalGuess | None
) -> dict[str, SignalGuess]:
    """Heading, rate and tilts, as far as they are there."""
    guesses = {"heading": heading}
    if heading is not None:
        guesses["yaw_rate"] = _yaw_rate(shared, logs, heading)
    guesses["roll"] = _angle(shared, _ROLL, heading)
    guesses["pitch"] = _angle(shared, _PITCH, heading)
    return {name: guessed for name, guessed in guesses.items() if guessed is not None}


def _supply(shared: Mapping[str, Sequence[RawColumn]], taken: set[str]) -> str | None:
    """The source that is named as the voltage of the supply, and could be one; the plainest name of several."""
    best, best_rank = None, 0
    for source, seen in shared.items():
        named = name_words(source)
        if source in taken or not named & SUPPLY or named & (_NOT_VOLTS | COMMAND):
            continue
        values = finite_values(seen)
        low, high = _SUPPLIES
        if not len(values) or not low <= np.median(values) <= high or np.ptp(values) == 0.0:
            continue
        rank = 1 + bool(named & VOLTS)
        if rank > best_rank:
            best, best_rank = source, rank
    return best


def _torque(
    free: Mapping[str, Sequence[RawColumn]], logs: Sequence[Mapping[str, RawColumn]], heading: SignalGuess | None
) -> SignalGuess | None:
    """A logged torque, where no command is logged; its sense is that in which it turns the heading."""
    for source, seen in free.items():
        named = name_words(source)
        values = finite_values(seen)
        if len(values) < FEWEST or not np.ptp(values) > 0.0:
            continue
        if not is_torque(source, values) or named & (_NOT_MEASURED | LIGHTS):
            continue
        unit = "kN m" if "knm" in named else "N m"
        sense = CommandEffect() if heading is None else command_effects({source: 0.0}, logs, heading)[source]
        against = f"; more of it turns the heading down ({sense.text}): turned around here"
        why = f"named so; {values.min():.4g} to {values.max():.4g}{against if sense.direction < 0 else ''}"
        return SignalGuess(source=source, unit=unit, sign=-1 if sense.direction < 0 else 1, reason=why)
    return None


def _declared(source: str) -> str:
    named = name_words(source)
    for word, unit in _UNITS.items():
        if word in named:
            return unit
    return ""


def _heading(every: Mapping[str, Sequence[RawColumn]], asked: str = "") -> SignalGuess | None:
    """By its name; without one, by jumps of a whole turn; or the one that was asked for."""
    if asked:
        unit, why = _turning(asked, every[asked]) if asked in every else ("", "")
        return SignalGuess(source=asked, unit=unit, reason=f"given; {why}") if unit else None
    measured = [source for source in every if _may_be_heading(name_words(source)) and not is_per_second(source)]
    named = [source for source in measured if name_words(source) & HEADING_WORDS]
    turned = [source for source, seen in every.items() if seen[0].radians]
    if turned and not named:
        return SignalGuess(source=turned[0], unit="rad", reason="an orientation, of which the heading is made")
    best, best_rank = None, (False, 0)
    for source in named or measured:
        if not named and name_words(source) & VOLTS:
            continue
        unit, why = _turning(source, every[source])
        jumps = "jumps" in why
        if not unit or not (named or jumps):
            continue
        # The one that jumps is an angle for sure; of several the finest.
        rank = (jumps, len(np.unique(finite_values(every[source]))))
        if best is None or rank > best_rank:
            said = f"named so; {why}" if named else f"{why}; {UNNAMED}"
            best, best_rank = SignalGuess(source=source, unit=unit, reason=said), rank
    return best


def turn_of_heading(seen: RawColumn) -> float | None:
    """What a whole turn is of a column that by its name and values is a heading; None where it is none."""
    if seen.radians:
        return TURN["rad"]
    # Who logs the thrusters may put their word before all that it logs.
    named = name_words(seen.source) - COMMAND
    if not named & HEADING_WORDS or not _may_be_heading(named) or is_per_second(seen.source):
        return None
    unit, _ = _turning(seen.source, [seen])
    return TURN.get(unit)


def is_yaw_rate(source: str) -> bool:
    """Whether a column is one by its name."""
    named = name_words(source)
    return _named_yaw_rate(named) or bool(named & HEADING_WORDS and is_per_second(source) and not named & _NOT_MEASURED)


def _may_be_heading(named: set[str]) -> bool:
    rates = _RATES - {"gyro"} if named & _COMPASS else _RATES
    wished = any(word.startswith("soll") or word.endswith(_ASTRAY) for word in named)
    return not wished and not named & (_NOT_MEASURED | rates | YAW_RATE_WORDS | COMMAND)


def _turning(source: str, seen: Sequence[RawColumn]) -> tuple[str, str]:
    """Unit and reason if these are angles; empty if not."""
    values = finite_values(seen)
    if len(values) < FEWEST or np.ptp(values) == 0.0:
        return "", ""
    low, high = float(values.min()), float(values.max())
    span = f"{low:.4g} to {high:.4g}"
    steps = np.concatenate([np.abs(np.diff(one.values)) for one in seen])
    for unit, turn in TURN.items():
        within = -1.01 * turn / 2 <= low and high <= 1.01 * turn
        if within and np.any(np.abs(steps - turn) < 0.1 * turn):
            return unit, f"{span}, and it jumps by {turn:.4g}, a whole turn"
    declared = _declared(source)
    if declared in TURN:
        return declared, f"{span}; the unit by its name"
    if max(-low, high) > 1.01 * TURN["rad"]:
        return "deg", f"{span}, more than a turn in radians"
    return "rad", f"{span}: taken for radians, for it stays within a turn of them"


def _angle(
    every: Mapping[str, Sequence[RawColumn]], known: set[str], heading: SignalGuess | None
) -> SignalGuess | None:
    """By its name; a tilt is small in either unit, and mostly in that of the heading."""
    for source, seen in every.items():
        named = name_words(source)
        if not named & known or named & (_NOT_MEASURED | _RATES | YAW_RATE_WORDS | COMMAND):
            continue
        values = finite_values(seen)
        if len(values) < FEWEST:
            continue
        unit, why = _tilt_unit(source, values, heading)
        return SignalGuess(source=source, unit=unit, reason=f"named so; {values.min():.3g} to {values.max():.3g}{why}")
    return None


def _tilt_unit(source: str, values: FloatArray, heading: SignalGuess | None) -> tuple[str, str]:
    """Unit of a tilt, and why that."""
    declared = _declared(source)
    if declared:
        return declared, ""
    if float(np.max(np.abs(values))) > 0.5 * np.pi:
        return "deg", ", more than upright in radians"
    if heading is None:
        return "deg", ": taken for deg"
    return heading.unit, f": taken for {heading.unit} like the heading"


def _yaw_rate(
    every: Mapping[str, Sequence[RawColumn]], logs: Sequence[Mapping[str, RawColumn]], heading: SignalGuess
) -> SignalGuess | None:
    """A gyro that goes with the heading's own rate, which tells unit and sense too."""
    for source in every:
        if source == heading.source or not is_yaw_rate(source):
            continue
        own, logged = _in_all(logs, heading, source)
        if len(own) < FEWEST or not np.std(own) > 0.0 or not np.std(logged) > 0.0:
            continue
        alike = float(np.corrcoef(own, logged)[0, 1])
        if abs(alike) < 0.7:
            continue
        ratio = abs(float(logged @ own / (own @ own)))
        # In the middle, as a ratio, between the same unit and degrees for radians.
        unit = "deg/s" if ratio > np.sqrt(180.0 / np.pi) else "rad/s"
        sign, sense = (1, "as the heading's") if alike > 0.0 else (-1, "against the heading's: turned around here")
        return SignalGuess(source=source, unit=unit, sign=sign, reason=f"named so; it goes {sense}")
    return None


def _named_yaw_rate(named: set[str]) -> bool:
    if named & YAW_RATE_WORDS or {"rate", "turn"} <= named:
        return not named & _NOT_MEASURED
    about_vertical = named & (HEADING_WORDS | {"z", "r"})
    return bool(about_vertical and named & _RATES and not named & _NOT_MEASURED)


def _in_all(
    logs: Sequence[Mapping[str, RawColumn]], heading: SignalGuess, source: str
) -> tuple[FloatArray, FloatArray]:
    """The heading's own rates and those of ``source``, side by side, of all logs that hold both."""
    own, logged = [np.empty(0)], [np.empty(0)]
    for log in logs:
        if heading.source in log and source in log:
            rate, other = _side_by_side(log, heading, source)
            own.append(rate)
            logged.append(other)
    return np.concatenate(own), np.concatenate(logged)


def _side_by_side(log: Mapping[str, RawColumn], heading: SignalGuess, source: str) -> tuple[FloatArray, FloatArray]:
    time, rate = mean_rates(heading, log[heading.source])
    other = log[source]
    known = np.isfinite(other.values)
    if not known.any() or not rate.size:
        return np.empty(0), np.empty(0)
    middles = 0.5 * (time[1:] + time[:-1])
    return rate, np.interp(middles, other.time[known], other.values[known])
