"""Which columns command thrusters, and which way each turns the vehicle: by names, by the autopilot, by the motion."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rovid.campaign.profiles import SIDES, Profile
from rovid.ground.arrays import FloatArray
from rovid.inspect.autopilot import Output
from rovid.inspect.seen import FEWEST, Guess, Seen, finite, held_mean, rates
from rovid.readers.words import CLOCK, words

COMMAND = {"cmd", "command", "pwm", "throttle", "thruster", "thrusters", "motor", "motors", "servo", "esc", "output"}
COMMAND |= {"actuator", "rcout", "rcou", "propeller", "prop", "thr", "thrust", "schub", "antrieb", "propulseur"}
COMMAND |= {"stellgroesse", "stellgröße", "moteur", "moteurs", "poussee", "poussée", "helice", "hélice", "jet"}
COMMAND |= {"mando", "empuje", "propulsor", "motores", "pådrag", "paadrag", "thrustere"}
VOLTS = {"v", "volt", "volts", "voltage", "voltages", "spannung", "tension", "mv", "voltaje", "spenning"}
VOLTS |= {"batteriespannung", "batterispenning", "bordspannung"}
# What is driven by an output and moves nothing.
LIGHTS = {"light", "lights", "lamp", "lumen", "led", "licht", "scheinwerfer", "lumiere", "lumière", "camera", "cam"}
LIGHTS |= {"gimbal", "tilt", "mount", "gripper", "grabber", "kamera", "sonar", "winch", "pump", "laser"}
TORQUE = {"torque", "moment", "drehmoment", "couple", "nm", "dreiemoment", "par"}
# A number behind one of these letters is a thruster's: T1, M1, u1.
_LETTERS = {"t", "m", "u"}
_SIDED = frozenset().union(*SIDES.values())
_TURNS_PER_MINUTE = {"rpm", "drehzahl", "upm", "trmin", "turtall", "omdr"}
# What a thruster answered.
_ANSWER = {"fb", "feedback", "actual", "ist", "målt", "maalt", "measured", "meas", "medida", "medido", "mesure"}
_ANSWER |= {"mesuré"}
_ANSWER |= {"mesurée", "speed", "tacho", "telemetry", "status", "retour"}
# Where no output is logged, what a pilot asks for may stand in.
_PILOT = {"rcin", "rci", "joystick", "stick", "manette"}
# What is logged of a thruster or a side, and is no command.
_NOT_COMMAND = {"temp", "temperature", "curr", "current", "amps", "amp", "strom", "courant", "power", "watt"}
_NOT_COMMAND |= {"corriente", "strøm"}
_NOT_COMMAND |= {"depth", "roll", "pitch", "leak", "pressure", "lat", "lon", "north", "east", "flow", "fault", "status"}
_NOT_COMMAND |= {"error", "err", "load", "drop", "errors", "pos", "position", "vel", "velocity", "acc"}
_CLOCK = CLOCK - {"t"}
# Of a name's end: the unit of something else.
_OTHER_UNIT = re.compile(r"[^A-Za-z](A|W|C|K|bar|degC)\W*$")
# A command that asks for motion is none of one thruster.
_OF_MOTION = {"heading", "hdg", "yaw", "psi", "kurs", "cap", "rumbo", "gir", "surge", "sway", "heave", "rate"}
SUPPLY = {"supply", "battery", "batt", "bat", "bus", "akku", "batterie", "versorgung", "batteri", "bateria", "batería"}
SUPPLY |= {"batteriespannung", "batterispenning", "bordspannung", "voltaje", "alimentation"}
_NEVER = _CLOCK | LIGHTS | _NOT_COMMAND | _OF_MOTION | _PILOT | SUPPLY | _ANSWER
_NOT_VOLTAGES = {"m", "s", "kn", "vel", "velocity", "speed", "dvl", "gps"}
_SAYS_LITTLE = (VOLTS - {"tension"}) | {"cmd", "command", "data", "thruster", "thrusters", "us", "norm", "pct", "raw"}
_SAYS_LITTLE |= {"percent", "prozent", "pourcent", "rpm", "pwm", "servo", "output", "rcou"}
_PERCENT = {"pct", "percent", "prozent", "pourcent", "proz", "prosent", "porcentaje"}
# The autopilot's own torque about the vertical, which its mixer spreads over the outputs.
_DEMAND = "RATE.YOut"
# Of a regression of that on the outputs: how much of it they tell, and how small a share is no part of it.
_MIXED, _PART = 0.9, 0.1
# A pulse width in us is between these, 1500 for no thrust; who never comes near that is no thruster.
_PULSE, REST, _NEAR = (800.0, 2200.0), 1500.0, 25.0
# Windows over which rates are means, s; in one that is too short errors go against the one before by more than this.
_WINDOWS, _OPPOSITE = (0.5, 1.0, 2.0, 4.0, 8.0), -0.25
# Standard errors from which a sense is told.
_SURE = 4.0
# Of commands that go together to so little, that part of them tells nothing.
_ALIKE = 0.01
# A command that never comes nearer to its rest than this share of its largest is none.
_AWAY = 0.5


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """What is known before the logs are looked at.

    Attributes
    ----------
    heading, commands
        Sources that were named.
    outputs
        Source -> thruster, as the autopilot's parameters have it.
    profile
        The type of vehicle that was named, or that the parameters tell.
    """

    heading: str = ""
    commands: tuple[str, ...] = ()
    outputs: Mapping[str, Output] = field(default_factory=dict)
    profile: Profile | None = None


@dataclass(frozen=True, kw_only=True)
class Thrusting:
    """One command: whether more of it turns the heading up (1), down (-1) or not at all (0), and its range.

    Attributes
    ----------
    arm
        m; 0 where nobody knows.
    told
        Whether it is known which way it turns the vehicle, or that it does not.
    percent
        Whether the command is named a share of a hundred.
    """

    name: str
    source: str
    way: int
    neutral: float
    lowest: float
    highest: float
    why: str
    arm: float = 0.0
    told: bool = True
    percent: bool = False


def thrusting(
    every: Mapping[str, Sequence[Seen]], logs: Sequence[Mapping[str, Seen]], heading: Guess | None, wanted: Wanted
) -> tuple[Thrusting, ...]:
    """The commands: those that were named, those that the autopilot knows, or those with such names."""
    moving = _chosen(every, wanted)
    neutral = {source: _neutral(values) for source, values in moving.items()}
    ways = senses(neutral, logs, heading) if heading is not None and neutral else {}
    mixed = _mixed(neutral, logs)
    names: list[str] = []
    commands: list[Thrusting] = []
    for source, rest in neutral.items():
        values = moving[source]
        output = wanted.outputs.get(source)
        label = output.label if output else wanted.profile.label(words(source)) if wanted.profile else ""
        names.append(_unique(output.name, names) if output else _thruster(source, names))
        way, arm, told = _turned(source, label, wanted, ways, mixed)
        said = output.why if output else "given" if source in wanted.commands else "named so"
        commands.append(
            Thrusting(
                name=names[-1],
                source=source,
                way=way,
                neutral=rest,
                lowest=float(values.min()),
                highest=float(values.max()),
                why=f"{said}; {values.min():.4g} to {values.max():.4g}, no thrust at {rest:g}; {told}",
                arm=arm,
                told=bool(way or output or mixed or label),
                percent=bool(words(source) & _PERCENT) or "%" in source,
            )
        )
    return tuple(commands)


def _turned(
    source: str,
    label: str,
    wanted: Wanted,
    ways: Mapping[str, tuple[int, float]],
    mixed: Mapping[str, int],
) -> tuple[int, float, str]:
    """Sense in which a command turns the heading, its arm in m, and the reason."""
    seen, sure = ways.get(source, (0, 0.0))
    published = wanted.profile.arms.get(label, 0.0) if wanted.profile else 0.0
    output = wanted.outputs.get(source)
    if output is not None:
        way, reason = output.way, "the autopilot's parameters"
    elif mixed:
        way, reason = mixed.get(source, 0), f"the autopilot's own {_DEMAND}"
    elif label:
        way, reason = int(np.sign(published)), "its type of vehicle"
    else:
        return seen, 0.0, _by_motion(seen, sure)
    if output is None and label and not mixed and seen and seen != way:
        # Nobody but the motion knows which way round a propeller runs.
        way, reason = seen, f"these logs ({sure:.0f} standard errors), against its type of vehicle"
    known = 0.0 if wanted.profile is None or wanted.profile.senses_alone else abs(published)
    arm = (output.arm if output else 0.0) or known
    if not way:
        return 0, arm, f"by {reason} it does not turn the vehicle"
    agrees = f"; so do these logs ({sure:.0f} standard errors)" if seen == way else ""
    against = f"; these logs speak against it ({sure:.0f} standard errors)" if seen == -way else ""
    return way, arm, f"by {reason} more of it turns the heading {_sense(way)}{agrees}{against}"


def _by_motion(way: int, sure: float) -> str:
    if not way:
        return "whether it turns the vehicle is not told by these logs"
    return f"more of it turns the heading {_sense(way)} ({sure:.0f} standard errors)"


def _sense(way: int) -> str:
    return "up" if way > 0 else "down"


def _chosen(every: Mapping[str, Sequence[Seen]], wanted: Wanted) -> dict[str, FloatArray]:
    """Values of each source that is a command."""
    if wanted.commands:
        return {source: finite(every[source]) for source in wanted.commands if source in every}
    if told := {source: finite(every[source]) for source in wanted.outputs if source in every}:
        return {source: values for source, values in told.items() if len(values) and np.ptp(values) > 0.0}
    moving = {}
    for source, seen in every.items():
        values = finite(seen)
        if len(values) and np.ptp(values) > 0.0:
            moving[source] = values
    logged = any(words(source) & TORQUE for source in moving)
    for named_so in (_is_command, _is_like_one, _is_answer, _is_of_motion, *([_is_pilots] * (not logged))):
        found = {source: values for source, values in moving.items() if named_so(source)}
        coming = {source: values for source, values in found.items() if _neutral(values) == REST or _comes_by(values)}
        found = coming or found
        # Beside what is asked of a thruster its turns a minute are its answer.
        asked = {source: values for source, values in found.items() if not words(source) & _TURNS_PER_MINUTE}
        found = asked or found
        # What a person or an autopilot asks for goes to the thrusters by way of their own pulses.
        pulses = {source: values for source, values in found.items() if _neutral(values) == REST}
        if resting := {source: values for source, values in pulses.items() if _rests(values)}:
            return resting
        if found:
            return found
    return {}


def _rests(values: FloatArray) -> bool:
    """Whether pulses are of what pushes both ways, and comes by its rest."""
    return bool(values.min() <= REST + _NEAR and values.max() >= REST - _NEAR)


def _comes_by(values: FloatArray) -> bool:
    """Whether these come near nothing, as a command does and a supply does not."""
    low, high = float(values.min()), float(values.max())
    return low <= 0.0 <= high or min(abs(low), abs(high)) < _AWAY * max(abs(low), abs(high))


def _is_command(source: str) -> bool:
    named = words(source)
    return _may_command(source, named) and bool(named & (COMMAND | _SIDED) or _is_voltage(named))


def _is_like_one(source: str) -> bool:
    """By its number, or as so many turns a minute."""
    return _may_command(source, words(source)) and _is_of_one(words(source))


def _is_answer(source: str) -> bool:
    named = words(source)
    return bool(named & _ANSWER) and _may_command(source, named - _ANSWER) and _is_of_one(named - _ANSWER)


def _is_of_one(named: set[str]) -> bool:
    numbered = named & _LETTERS and any(word.isdigit() for word in named) and len(named) <= 4
    return bool(named & (_SIDED | _TURNS_PER_MINUTE) or numbered)


def _may_command(source: str, named: set[str]) -> bool:
    return not named & _NEVER and not _OTHER_UNIT.search(source)


def _is_voltage(named: set[str]) -> bool:
    # A v is a sway velocity as well, and a voltage by itself that of the supply.
    return bool(named & VOLTS and named - VOLTS and not named & _NOT_VOLTAGES)


def _is_of_motion(source: str) -> bool:
    """A demand that is spread over the thrusters."""
    named = words(source)
    return bool(named & COMMAND and named & _OF_MOTION and not named & LIGHTS)


def _is_pilots(source: str) -> bool:
    return bool(words(source) & _PILOT)


def _neutral(values: FloatArray) -> float:
    low, high = _PULSE
    if low <= values.min() and values.max() <= high and values.max() > 1.1 * low:
        return REST
    return 0.0


def senses(
    neutral: Mapping[str, float], logs: Sequence[Mapping[str, Seen]], heading: Guess
) -> dict[str, tuple[int, float]]:
    """Sense in which each command turns the heading, and in standard errors how surely; 0 where that is little.

    The mean rate over each window goes with that of the one before and the mean commands of both: so it does on a slow
    vehicle as on a fast one. In windows that are too short the heading's noise makes each rate the next one's opposite.
    """
    sure = np.zeros(len(neutral))
    for window in _WINDOWS:
        rows, turns = _in_windows(neutral, logs, heading, window)
        if len(turns) < FEWEST:
            break
        _, found, _, alike = _regressed(rows, turns)
        # Before the commands stand the constant and the rate of the window before.
        sure = found[2:]
        if alike > _OPPOSITE:
            break
    known = zip(neutral, sure.tolist(), strict=True)
    return {source: (int(np.sign(one)) if abs(one) > _SURE else 0, abs(one)) for source, one in known}


def _in_windows(
    neutral: Mapping[str, float], logs: Sequence[Mapping[str, Seen]], heading: Guess, window: float
) -> tuple[FloatArray, FloatArray]:
    """(n, 2 + k) a constant, the rate of the window before and the mean commands; (n,) the rates."""
    rows, turns = [np.empty((0, 2 + len(neutral)))], [np.empty(0)]
    for log in logs:
        if heading.source not in log or not set(neutral) <= set(log):
            continue
        time, rate = rates(heading, log[heading.source], window)
        if len(rate) < 3:
            continue
        means = []
        for source, rest in neutral.items():
            command = held_mean(log[source], time) - rest
            means.append(0.5 * (command[1:] + command[:-1]))
        rows.append(np.column_stack((np.ones(len(rate) - 1), rate[:-1], *means)))
        turns.append(rate[1:])
    return np.nan_to_num(np.concatenate(rows)), np.concatenate(turns)


def _mixed(neutral: Mapping[str, float], logs: Sequence[Mapping[str, Seen]]) -> dict[str, int]:
    """Sense with which each output takes part in the autopilot's torque; empty where that is not logged, or not so."""
    rows, demands = [], []
    for log in logs:
        if _DEMAND not in log or not set(neutral) <= set(log):
            continue
        demand = log[_DEMAND]
        at = [np.interp(demand.time, log[source].time, log[source].values) for source in neutral]
        rows.append(np.column_stack((np.ones(len(demand.time)), *at)))
        demands.append(demand.values)
    if not neutral or sum(map(len, demands)) < FEWEST:
        return {}
    values, _, told, _ = _regressed(np.nan_to_num(np.concatenate(rows)), np.nan_to_num(np.concatenate(demands)))
    shares = values[1:]
    if not told >= _MIXED:
        return {}
    most = float(np.max(np.abs(shares)))
    return {
        source: int(np.sign(share)) if abs(share) > _PART * most else 0
        for source, share in zip(neutral, shares, strict=True)
    }


def _regressed(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, float, float]:
    """Coefficients of a regression of ``y`` on the columns of ``x``, of which the first is constant.

    Each in its standard errors too; R^2; and how the error of a row goes with that of the one before, -1 to 1.
    """
    x[:, 1:] -= x[:, 1:].mean(axis=0)
    scale = np.linalg.norm(x, axis=0)
    # Columns of one length: else a command in us would drown one in volts.
    scale = np.where(scale > 0.0, scale, 1.0)
    x = x / scale
    # Commands that always go together leave no plain inverse.
    inverse = np.linalg.pinv(x.T @ x, rcond=_ALIKE)
    values = inverse @ (x.T @ y)
    left = y - x @ values
    # Errors that are alike from one row to the next count as fewer.
    alike = float(left[1:] @ left[:-1]) / max(float(left @ left), 1e-300)
    positive = min(max(alike, 0.0), 0.98)
    fewer = (1.0 + positive) / (1.0 - positive)
    spread = np.sqrt(np.diag(inverse) * fewer * float(left @ left) / max(len(y) - len(values), 1))
    # A column of zeros has no spread, and tells nothing.
    known = spread > 0.0
    varied = y - y.mean()
    told = 1.0 - float(left @ left) / max(float(varied @ varied), 1e-300)
    return values / scale, np.where(known, values / np.where(known, spread, 1.0), 0.0), told, alike


def _thruster(source: str, taken: Sequence[str]) -> str:
    """A name for people: the source without what only says that it is a command."""
    parts = [part for part in re.split(r"[^\w]+|_", source) if part and part.lower() not in _SAYS_LITTLE]
    name = "_".join(parts).lower()
    if not name or name.isdigit():
        name = f"thruster_{name}"
    return _unique(name, taken)


def _unique(name: str, taken: Sequence[str]) -> str:
    own, number = name, len(taken)
    while own in taken:
        number += 1
        own = f"{name}_{number}"
    return own
