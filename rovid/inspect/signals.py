"""Which column or topic holds what: guesses from names, values and how the vehicle answers, each with its reason."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
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
    heading = _heading(every)
    signals = _motions(shared, logs, heading)
    taken = {signal.source for signal in signals.values()}
    free = {source: seen for source, seen in every.items() if source not in taken}
    commands = _commands(free, logs, heading)
    supply = _supply(shared, taken)
    if supply is not None:
        signals["supply_voltage"] = Guess(source=supply, why="named so; the diagnosis tests what depends on it")
        commands = tuple(command for command in commands if command.source != supply)
    lacking = [what for what, there in (("heading", heading), ("command", commands)) if not there]
    return Guesses(signals=signals, commands=commands, lacking=tuple(lacking))


def _motions(
    shared: Mapping[str, Sequence[Seen]], logs: Sequence[Mapping[str, Seen]], heading: Guess | None
) -> dict[str, Guess]:
    """Heading, rate and tilts, as far as they are there."""
    guesses = {"heading": heading}
    if heading is not None:
        guesses["yaw_rate"] = _yaw_rate(shared, logs, heading)
    guesses["roll"] = _angle(shared, {"roll", "phi"}, heading)
    guesses["pitch"] = _angle(shared, {"pitch", "theta"}, heading)
    return {name: guessed for name, guessed in guesses.items() if guessed is not None}


def _supply(shared: Iterable[str], taken: set[str]) -> str | None:
    """The first source that is named as the voltage of the supply."""
    free = {source: words(source) for source in shared if source not in taken}
    return next((source for source, said in free.items() if said & _SUPPLY and not said & _NOT_VOLTS), None)


def _finite(seen: Sequence[Seen]) -> FloatArray:
    values = np.concatenate([one.values for one in seen])
    return np.asarray(values[np.isfinite(values)])


def _declared(source: str) -> str:
    named = words(source)
    for word, unit in _UNITS.items():
        if word in named:
            return unit
    return ""


def _heading(every: Mapping[str, Sequence[Seen]]) -> Guess | None:
    """By its name; without one, by jumps of a whole turn."""
    measured = [source for source in every if not words(source) & (_NOT_MEASURED | _RATES | _COMMAND)]
    named = [source for source in measured if words(source) & _HEADING]
    turned = [source for source, seen in every.items() if seen[0].radians]
    if turned and not named:
        return Guess(source=turned[0], unit="rad", why="an orientation, of which the heading is made")
    best, best_rank = None, (False, 0)
    for source in named or measured:
        if not named and words(source) & _VOLTS:
            continue
        unit, why = _turning(source, every[source])
        jumps = "jumps" in why
        if not unit or not (named or jumps):
            continue
        # The one that jumps is an angle for sure; of several the finest.
        rank = (jumps, len(np.unique(_finite(every[source]))))
        if best is None or rank > best_rank:
            said = f"named so; {why}" if named else why
            best, best_rank = Guess(source=source, unit=unit, why=said), rank
    return best


def _turning(source: str, seen: Sequence[Seen]) -> tuple[str, str]:
    """Unit and reason if these are angles; empty if not."""
    values = _finite(seen)
    if len(values) < _FEWEST or np.ptp(values) == 0.0:
        return "", ""
    low, high = float(values.min()), float(values.max())
    span = f"{low:.4g} to {high:.4g}"
    steps = np.concatenate([np.abs(np.diff(one.values)) for one in seen])
    for unit, turn in _TURN.items():
        within = -1.01 * turn / 2 <= low and high <= 1.01 * turn
        if within and np.any(np.abs(steps - turn) < 0.1 * turn):
            return unit, f"{span}, and it jumps by {turn:.4g}, a whole turn"
    declared = _declared(source)
    if declared in _TURN:
        return declared, f"{span}; the unit by its name"
    if max(-low, high) > 1.01 * _TURN["rad"]:
        return "deg", f"{span}, more than a turn in radians"
    return "rad", f"{span}: taken for radians, for it stays within a turn of them"


def _angle(every: Mapping[str, Sequence[Seen]], known: set[str], heading: Guess | None) -> Guess | None:
    """By its name; a tilt is small in either unit, and mostly in that of the heading."""
    for source, seen in every.items():
        named = words(source)
        if not named & known or named & (_NOT_MEASURED | _RATES | _COMMAND):
            continue
        values = _finite(seen)
        if len(values) < _FEWEST:
            continue
        unit, why = _tilt_unit(source, values, heading)
        return Guess(source=source, unit=unit, why=f"named so; {values.min():.3g} to {values.max():.3g}{why}")
    return None


def _tilt_unit(source: str, values: FloatArray, heading: Guess | None) -> tuple[str, str]:
    """Unit of a tilt, and why that."""
    declared = _declared(source)
    if declared:
        return declared, ""
    if float(np.max(np.abs(values))) > 0.5 * np.pi:
        return "deg", ", more than upright in radians"
    if heading is None:
        return "deg", ": taken for deg"
    return heading.unit, f": taken for {heading.unit} like the heading"


def _yaw_rate(every: Mapping[str, Sequence[Seen]], logs: Sequence[Mapping[str, Seen]], heading: Guess) -> Guess | None:
    """A gyro that goes with the heading's own rate, which tells unit and sense too."""
    for source in every:
        if source == heading.source or not _named_yaw_rate(words(source)):
            continue
        own, logged = _in_all(logs, heading, source)
        if len(own) < _FEWEST or not np.std(own) > 0.0 or not np.std(logged) > 0.0:
            continue
        alike = float(np.corrcoef(own, logged)[0, 1])
        if abs(alike) < 0.7:
            continue
        ratio = abs(float(logged @ own / (own @ own)))
        # In the middle, as a ratio, between the same unit and degrees for radians.
        unit = "deg/s" if ratio > np.sqrt(180.0 / np.pi) else "rad/s"
        sign, sense = (1, "as the heading's") if alike > 0.0 else (-1, "against the heading's: turned around here")
        return Guess(source=source, unit=unit, sign=sign, why=f"named so; it goes {sense}")
    return None


def _named_yaw_rate(named: set[str]) -> bool:
    about_vertical = named & (_HEADING | {"z", "r"})
    return bool(about_vertical and named & _RATES and not named & _NOT_MEASURED)


def _in_all(logs: Sequence[Mapping[str, Seen]], heading: Guess, source: str) -> tuple[FloatArray, FloatArray]:
    """The heading's own rates and those of ``source``, side by side, of all logs that hold both."""
    own, logged = [np.empty(0)], [np.empty(0)]
    for log in logs:
        if heading.source in log and source in log:
            rate, other = _side_by_side(log, heading, source)
            own.append(rate)
            logged.append(other)
    return np.concatenate(own), np.concatenate(logged)


def _radians(heading: Guess, seen: Seen) -> tuple[FloatArray, FloatArray]:
    """(n,) s and the unwrapped heading in rad."""
    known = np.flatnonzero(np.isfinite(seen.values) & np.isfinite(seen.time))
    if known.size:
        stamps = seen.time[known]
        # A stamp of before the clock was set, or a damaged one, is years away.
        known = known[np.abs(stamps - np.median(stamps)) < _LONGEST]
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
    middles = 0.5 * (time[1:] + time[:-1])
    return rate, np.interp(middles, other.time[known], other.values[known])


def _commands(
    every: Mapping[str, Sequence[Seen]], logs: Sequence[Mapping[str, Seen]], heading: Guess | None
) -> tuple[Thrusting, ...]:
    """By their names; which of them turns the vehicle is told by how its rate changes."""
    moving = _moving(every)
    neutral = {source: _neutral(values) for source, values in moving.items()}
    # What a person or an autopilot asks for goes to the thrusters by way of their own pulses, where those are logged.
    pulses = {source: rest for source, rest in neutral.items() if rest == _REST}
    neutral = pulses or neutral
    ways = _ways(neutral, logs, heading) if heading is not None and neutral else {}
    names: list[str] = []
    commands: list[Thrusting] = []
    for source, rest in neutral.items():
        names.append(_thruster(source, names))
        way, sure = ways.get(source, (0, 0.0))
        values = moving[source]
        why = f"named so; {values.min():.4g} to {values.max():.4g}, no thrust at {rest:g}; {_turns(way, sure)}"
        command = Thrusting(
            name=names[-1],
            source=source,
            way=way,
            neutral=rest,
            lowest=float(values.min()),
            highest=float(values.max()),
            why=why,
        )
        commands.append(command)
    return tuple(commands)


def _moving(every: Mapping[str, Sequence[Seen]]) -> dict[str, FloatArray]:
    """Values of each source that is named as a command, and moves."""
    moving = {}
    for source, seen in every.items():
        named = words(source)
        if not _commands_something(named) or named & (CLOCK | _SUPPLY):
            continue
        values = _finite(seen)
        if len(values) and np.ptp(values) > 0.0:
            moving[source] = values
    return moving


def _turns(way: int, sure: float) -> str:
    if not way:
        return "whether it turns the vehicle is not told by these logs"
    sense = "up" if way > 0 else "down"
    return f"more of it turns the heading {sense} ({sure:.0f} standard errors)"


def _commands_something(named: set[str]) -> bool:
    if named & _COMMAND:
        return True
    # A v is a sway velocity as well.
    return bool(named & _VOLTS and named != {"v"} and not named & _NOT_VOLTAGES)


def _neutral(values: FloatArray) -> float:
    low, high = _PULSE
    if low <= values.min() and values.max() <= high and values.max() > 1.1 * low:
        return _REST
    return 0.0


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
        means = []
        for source, rest in neutral.items():
            command = _mean(log[source], time) - rest
            means.append(0.5 * (command[1:] + command[:-1]))
        rows.append(np.column_stack((np.ones(len(rate) - 1), rate[:-1], *means)))
        rates.append(rate[1:])
    if sum(map(len, rates)) < _FEWEST:
        return {}
    sure = _significance(np.nan_to_num(np.concatenate(rows)), np.concatenate(rates))
    ways = {}
    # Before the commands stand the constant and the rate of the window before.
    for source, one in zip(neutral, sure[2:], strict=True):
        sense = int(np.sign(one)) if abs(one) > _SURE else 0
        ways[source] = (sense, abs(float(one)))
    return ways


def _significance(x: FloatArray, y: FloatArray) -> FloatArray:
    """Each coefficient of a regression of ``y`` on the columns of ``x``, in its standard errors."""
    scale = np.linalg.norm(x, axis=0)
    # Columns of one length: else a command in us would drown one in volts.
    x = x / np.where(scale > 0.0, scale, 1.0)
    # Commands that always go together leave no plain inverse.
    inverse = np.linalg.pinv(x.T @ x, rcond=1e-6)
    values = inverse @ (x.T @ y)
    left = y - x @ values
    spread = np.sqrt(np.diag(inverse) * float(left @ left) / max(len(y) - len(values), 1))
    # A column of zeros has no spread, and tells nothing.
    known = spread > 0.0
    return np.where(known, values / np.where(known, spread, 1.0), 0.0)


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
    parts = [part for part in re.split(r"[^\w]+|_", source) if part and part.lower() not in _SAYS_LITTLE]
    name = "_".join(parts).lower()
    if not name or name.isdigit():
        name = f"thruster_{name}"
    own, number = name, len(taken)
    while own in taken:
        number += 1
        own = f"{name}_{number}"
    return own
