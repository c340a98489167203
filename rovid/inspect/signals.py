"""Which column or topic holds what: guesses from names, values and how the vehicle answers, each with its reason."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rovid.ground.arrays import FloatArray
from rovid.readers.words import CLOCK, words

_TURN = {"deg": 360.0, "rad": 2.0 * np.pi}
_UNITS = {"deg": "deg", "degrees": "deg", "rad": "rad", "radians": "rad", "dps": "deg/s", "rps": "rad/s"}
_NOT_MEASURED = {"set", "setpoint", "desired", "target", "ref", "reference", "wanted", "error", "err", "std", "sigma"}
_RATES = {"rate", "gyro", "angular", "velocity", "speed", "acc", "accel", "acceleration", "dps", "omega"}
_HEADING = {"heading", "hdg", "yaw", "psi", "compass", "kurs", "cap"}
_COMMAND = {"cmd", "command", "pwm", "throttle", "thruster", "thrusters", "motor", "motors", "servo", "esc", "output"}
_COMMAND |= {"actuator", "rcout", "rcou", "propeller", "prop", "thr"}
_VOLTS = {"v", "volt", "volts", "voltage"}
_SAYS_LITTLE = _VOLTS | {"cmd", "command", "data", "thruster", "thrusters", "us", "norm"}
_SUPPLY = {"supply", "battery", "batt", "bat", "bus"}
_NOT_VOLTS = {"curr", "current", "amps", "a", "temp", "temperature", "percent", "remaining", "id", "res", "resistance"}
_NOT_VOLTAGES = {"m", "s", "kn", "vel", "velocity", "speed", "dvl", "gps"}
# A pulse width in us is between these, 1500 for no thrust.
_PULSE, _REST = (800.0, 2200.0), 1500.0
# Of a regression of the rate's change on commands.
_WINDOW, _SURE = 0.5, 4.0
_FEWEST = 30
_LONGEST = 3e6  # s from the middle of a log
_MOST = 500_000  # windows of one log


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """One column or field of one log: its (n,) times in s and values; ``radians`` where it is an orientation."""

    source: str
    time: FloatArray
    values: FloatArray
    radians: bool = False


@dataclass(frozen=True, kw_only=True)
class Guess:
    """What one signal is taken from, in what unit and sense, and why."""

    source: str
    why: str
    unit: str = ""
    sign: int = 1


@dataclass(frozen=True, kw_only=True)
class Thrusting:
    """One command: whether more of it turns the heading up (1), down (-1) or not at all (0), and its range."""

    name: str
    source: str
    way: int
    neutral: float
    lowest: float
    highest: float
    why: str


@dataclass(frozen=True, kw_only=True)
class Guesses:
    """All of a folder; ``signals`` by their names in rovid.toml."""

    signals: Mapping[str, Guess]
    commands: tuple[Thrusting, ...]
    lacking: tuple[str, ...] = field(default=())


def guess(logs: Sequence[Mapping[str, Seen]]) -> Guesses:
    """What the columns of ``logs``, by source, are; the clock is none of them."""
    every: dict[str, list[Seen]] = {}
    for log in logs:
        for source, seen in log.items():
            every.setdefault(source, []).append(seen)
    # A log without a signal that is mapped cannot be read: what is not needed has to be in all of them.
    shared = {source: seen for source, seen in every.items() if len(seen) == len(logs)}
    signals: dict[str, Guess] = {}
    heading = _heading(every)
    if heading is not None:
        signals["heading"] = heading
        rate = _yaw_rate(shared, logs, heading)
        if rate is not None:
            signals["yaw_rate"] = rate
    for name, known in (("roll", {"roll", "phi"}), ("pitch", {"pitch", "theta"})):
        found = _angle(shared, known, heading)
        if found is not None:
            signals[name] = found
    taken = {one.source for one in signals.values()}
    commands = _commands({source: every[source] for source in every if source not in taken}, logs, heading)
    supply = next((s for s in shared if words(s) & _SUPPLY and not words(s) & _NOT_VOLTS and s not in taken), None)
    if supply is not None:
        signals["supply_voltage"] = Guess(source=supply, why="named so; the diagnosis tests what depends on it")
        commands = tuple(one for one in commands if one.source != supply)
    lacking = [what for what, there in (("heading", heading), ("command", commands)) if not there]
    return Guesses(signals=signals, commands=commands, lacking=tuple(lacking))


def _finite(seen: Sequence[Seen]) -> FloatArray:
    values = np.concatenate([one.values for one in seen])
    return np.asarray(values[np.isfinite(values)])


def _declared(source: str) -> str:
    return next((unit for word, unit in _UNITS.items() if word in words(source)), "")


def _heading(every: Mapping[str, Sequence[Seen]]) -> Guess | None:
    """By its name; without one, by jumps of a whole turn."""
    named = [
        source
        for source in every
        if words(source) & _HEADING and not words(source) & (_NOT_MEASURED | _RATES | _COMMAND)
    ]
    turned = next((source for source, seen in every.items() if seen[0].radians), None)
    if turned is not None and not named:
        return Guess(source=turned, unit="rad", why="an orientation, of which the heading is made")
    others = [source for source in every if not words(source) & (_NOT_MEASURED | _RATES | _COMMAND | _VOLTS)]
    found = [(source, *_turning(source, every[source])) for source in (named or others)]
    found = [one for one in found if one[1] and (named or "jumps" in one[2])]
    if not found:
        return None
    # The one that jumps is an angle for sure; of several the finest.
    source, unit, why = max(found, key=lambda one: ("jumps" in one[2], len(np.unique(_finite(every[one[0]])))))
    return Guess(source=source, unit=unit, why=("named so; " if source in named else "") + why)


def _turning(source: str, seen: Sequence[Seen]) -> tuple[str, str]:
    """Unit and reason if these are angles; empty if not."""
    values = _finite(seen)
    if len(values) < _FEWEST or np.ptp(values) == 0.0:
        return "", ""
    low, high = float(values.min()), float(values.max())
    span = f"{low:.4g} to {high:.4g}"
    for unit, turn in _TURN.items():
        steps = np.concatenate([np.abs(np.diff(one.values)) for one in seen])
        if -1.01 * turn / 2 <= low and high <= 1.01 * turn and np.any(np.abs(steps - turn) < 0.1 * turn):
            return unit, f"{span}, and it jumps by {turn:.4g}, a whole turn"
    declared = _declared(source)
    if declared in _TURN:
        return declared, f"{span}; the unit by its name"
    if max(-low, high) > 1.01 * _TURN["rad"]:
        return "deg", f"{span}, more than a turn in radians"
    return "rad", f"{span}: taken for radians, for it stays within a turn of them"


def _angle(every: Mapping[str, Sequence[Seen]], known: set[str], heading: Guess | None) -> Guess | None:
    """By its name; a tilt is small in either unit, and mostly in that of the heading."""
    for source in every:
        if words(source) & known and not words(source) & (_NOT_MEASURED | _RATES | _COMMAND):
            values = _finite(every[source])
            if len(values) < _FEWEST:
                continue
            span = f"{values.min():.3g} to {values.max():.3g}"
            if declared := _declared(source):
                return Guess(source=source, unit=declared, why=f"named so; {span}")
            if float(np.max(np.abs(values))) > 0.5 * np.pi:
                return Guess(source=source, unit="deg", why=f"named so; {span}, more than upright in radians")
            unit, like = ("deg", "") if heading is None else (heading.unit, " like the heading")
            return Guess(source=source, unit=unit, why=f"named so; {span}: taken for {unit}{like}")
    return None


def _yaw_rate(every: Mapping[str, Sequence[Seen]], logs: Sequence[Mapping[str, Seen]], heading: Guess) -> Guess | None:
    """A gyro that goes with the heading's own rate, which tells unit and sense too."""
    for source in every:
        named = words(source)
        about = named & _HEADING or "z" in named or "r" in named
        if source == heading.source or not named & _RATES or not about or named & _NOT_MEASURED:
            continue
        pairs = [_side_by_side(log, heading, source) for log in logs if heading.source in log and source in log]
        own, logged = (np.concatenate(column) for column in zip(*pairs, strict=True)) if pairs else (np.empty(0),) * 2
        if len(own) < _FEWEST or not np.std(own) > 0.0 or not np.std(logged) > 0.0:
            continue
        alike = float(np.corrcoef(own, logged)[0, 1])
        if abs(alike) < 0.7:
            continue
        ratio = abs(float(logged @ own / (own @ own)))
        unit = "deg/s" if ratio > np.sqrt(180.0 / np.pi) else "rad/s"
        sense = "as the heading's" if alike > 0.0 else "against the heading's: turned around here"
        return Guess(source=source, unit=unit, sign=1 if alike > 0.0 else -1, why=f"named so; it goes {sense}")
    return None


def _radians(heading: Guess, seen: Seen) -> tuple[FloatArray, FloatArray]:
    """(n,) s and the unwrapped heading in rad."""
    known = np.flatnonzero(np.isfinite(seen.values) & np.isfinite(seen.time))
    if known.size:
        # A stamp of before the clock was set, or a damaged one, is years away.
        known = known[np.abs(seen.time[known] - np.median(seen.time[known])) < _LONGEST]
    scale = 2.0 * np.pi / _TURN[heading.unit]
    return seen.time[known], np.unwrap(seen.values[known] * scale)


def _rates(heading: Guess, seen: Seen) -> tuple[FloatArray, FloatArray]:
    """(m + 1,) s, a window apart, and the (m,) mean rates in rad/s between them."""
    time, angle = _radians(heading, seen)
    if len(time) < _FEWEST:
        return np.empty(0), np.empty(0)
    # A single stamp weeks away would else make millions of windows.
    window = max(_WINDOW, 2.0 * float(np.median(np.diff(time))), float(np.ptp(time)) / _MOST)
    grid = np.arange(time[0], time[-1], window)
    return grid, np.diff(np.interp(grid, time, angle)) / window


def _side_by_side(log: Mapping[str, Seen], heading: Guess, source: str) -> tuple[FloatArray, FloatArray]:
    time, rate = _rates(heading, log[heading.source])
    other = log[source]
    known = np.isfinite(other.values)
    if not known.any() or not rate.size:
        return np.empty(0), np.empty(0)
    return rate, np.interp(0.5 * (time[1:] + time[:-1]), other.time[known], other.values[known])


def _commands(
    every: Mapping[str, Sequence[Seen]], logs: Sequence[Mapping[str, Seen]], heading: Guess | None
) -> tuple[Thrusting, ...]:
    """By their names; which of them turns the vehicle is told by how its rate changes."""
    found = {
        source: values
        for source, seen in every.items()
        if _commands_something(words(source)) and not words(source) & (CLOCK | _SUPPLY)
        if len(values := _finite(seen)) and np.ptp(values) > 0.0
    }
    # What a person or an autopilot asks for goes to the thrusters by way of their own pulses, where those are logged.
    pulses = {source: values for source, values in found.items() if _neutral(values) == _REST}
    found = pulses or found
    neutral = {source: _neutral(values) for source, values in found.items()}
    ways = {} if heading is None or not found else _ways(neutral, logs, heading)
    commands: list[Thrusting] = []
    for source, values in found.items():
        way, sure = ways.get(source, (0, 0.0))
        if way:
            turns = f"more of it turns the heading {'up' if way > 0 else 'down'} ({sure:.0f} standard errors)"
        else:
            turns = "whether it turns the vehicle is not told by these logs"
        span = f"{values.min():.4g} to {values.max():.4g}, no thrust at {neutral[source]:g}"
        commands.append(
            Thrusting(
                name=_thruster(source, [one.name for one in commands]),
                source=source,
                way=way,
                neutral=neutral[source],
                lowest=float(values.min()),
                highest=float(values.max()),
                why=f"named so; {span}; {turns}",
            )
        )
    return tuple(commands)


def _commands_something(named: set[str]) -> bool:
    # A v is a sway velocity as well.
    return bool(named & _COMMAND or (named & _VOLTS and named != {"v"} and not named & _NOT_VOLTAGES))


def _neutral(values: FloatArray) -> float:
    low, high = _PULSE
    return _REST if low <= values.min() and values.max() <= high and values.max() > 1.1 * low else 0.0


def _ways(
    neutral: Mapping[str, float], logs: Sequence[Mapping[str, Seen]], heading: Guess
) -> dict[str, tuple[int, float]]:
    """Sense in which each command turns the heading, and in standard errors how surely; 0 where that is little.

    The mean rate over each window goes with that of the one before and the mean commands of both: so it does on a slow
    vehicle as on a fast one.
    """
    rows, rates = [], []
    for log in logs:
        if heading.source not in log or not set(neutral) <= set(log):
            continue
        time, rate = _rates(heading, log[heading.source])
        if len(rate) < 3:
            continue
        columns = [_mean(log[source], time) - rest for source, rest in neutral.items()]
        rows.append(np.column_stack((np.ones(len(rate) - 1), rate[:-1], *(0.5 * (u[1:] + u[:-1]) for u in columns))))
        rates.append(rate[1:])
    if sum(map(len, rates)) < _FEWEST:
        return {}
    x, y = np.nan_to_num(np.concatenate(rows)), np.concatenate(rates)
    scale = np.linalg.norm(x, axis=0)
    x = x / np.where(scale > 0.0, scale, 1.0)
    inverse = np.linalg.pinv(x.T @ x, rcond=1e-6)
    values = inverse @ (x.T @ y)
    left = y - x @ values
    spread = np.sqrt(np.diag(inverse) * float(left @ left) / max(len(y) - len(values), 1))
    sure = np.where(spread > 0.0, values / np.where(spread > 0.0, spread, 1.0), 0.0)[2:]
    return {
        source: (int(np.sign(one)) if abs(one) > _SURE else 0, abs(float(one)))
        for source, one in zip(neutral, sure, strict=True)
    }


def _mean(seen: Seen, time: FloatArray) -> FloatArray:
    """(m,) means of the held values between (m + 1,) ``time`` in s."""
    known = np.isfinite(seen.values)
    if not known.any():
        return np.zeros(len(time) - 1)
    clock, values = seen.time[known], seen.values[known]
    ends = np.append(clock, max(clock[-1], time[-1]) + 1.0)
    integral = np.concatenate(([0.0], np.cumsum(values * np.diff(ends))))
    return np.asarray(np.diff(np.interp(time, ends, integral)) / np.diff(time))


def _thruster(source: str, taken: Sequence[str]) -> str:
    """A name for people: the source without what only says that it is a command."""
    parts = [p for p in re.split(r"[^\w]+|_", source) if p and p.lower() not in _SAYS_LITTLE]
    name = "_".join(parts).lower()
    name = f"thruster_{name}" if not name or name.isdigit() else name
    return name if name not in taken else f"{name}_{len(taken) + 1}"
