"""Which columns command thrusters, and which way each turns the vehicle: by names, by the autopilot, by the motion."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.preflight.autopilot import AutopilotOutput
from rovid.preflight.raw_columns import (
    FEWEST,
    RawColumn,
    SignalGuess,
    finite_values,
    held_mean,
    mean_rates,
    position_at,
)
from rovid.trial.axis import YAW, Axis
from rovid.trial.signal_names import CLOCK_WORDS, HEADING_WORDS, YAW_RATE_WORDS, name_words
from rovid.trial.vehicle_presets import SIDE_WORDS, VehiclePreset

COMMAND = {"cmd", "command", "pwm", "throttle", "thruster", "thrusters", "motor", "motors", "servo", "esc", "output"}
COMMAND |= {"actuator", "rcout", "rcou", "propeller", "prop", "thr", "thrust", "schub", "antrieb", "propulseur"}
COMMAND |= {"stellgroesse", "stellgröße", "moteur", "moteurs", "poussee", "poussée", "helice", "hélice", "jet"}
COMMAND |= {
    "strahlruder",
    "bugstrahl",
    "heckstrahl",
    "bugstrahlruder",
    "heckstrahlruder",
    "bugstrahler",
    "heckstrahler",
}
COMMAND |= {"querstrahler", "elica", "propulsore", "motore", "spinta", "baugthruster", "hekkthruster"}
COMMAND |= {"mando", "empuje", "propulsor", "motores", "pådrag", "paadrag", "thrustere"}
VOLTS = {"v", "volt", "volts", "voltage", "voltages", "spannung", "tension", "mv", "voltaje", "spenning"}
VOLTS |= {"batteriespannung", "batterispenning", "bordspannung"}
# What is driven by an output and moves nothing.
LIGHTS = {"light", "lights", "lamp", "lumen", "led", "licht", "scheinwerfer", "lumiere", "lumière", "camera", "cam"}
LIGHTS |= {"gimbal", "tilt", "mount", "gripper", "grabber", "kamera", "sonar", "winch", "pump", "laser"}
TORQUE = {"torque", "moment", "drehmoment", "couple", "nm", "dreiemoment", "par"}
_NEWTON_METRES = re.compile(r"N[ ·*]?m\W*$")
# A number behind one of these letters is a thruster's: T1, M1, u1.
_LETTERS = {"t", "m", "u", "ch"}
SIDED = frozenset().union(*SIDE_WORDS.values())
_TURNS_PER_MINUTE = {"rpm", "drehzahl", "upm", "trmin", "turtall", "omdr"}
# What a thruster answered.
_ANSWER = {"fb", "feedback", "actual", "ist", "målt", "maalt", "measured", "meas", "medida", "medido", "mesure"}
_ANSWER |= {"mesuré"}
_ANSWER |= {"istwert", "rückmeldung", "rueckmeldung", "mesurée", "speed", "tacho", "telemetry", "status", "retour"}
# Where no output is logged, what a pilot asks for may stand in.
_PILOT = {"rcin", "rci", "joystick", "stick", "manette"}
# What is logged of a thruster or a side, and is no command.
_NOT_COMMAND = {"temp", "temperature", "curr", "current", "amps", "amp", "strom", "courant", "power", "watt"}
_NOT_COMMAND |= {"corriente", "strøm"}
_NOT_COMMAND |= {"depth", "roll", "pitch", "leak", "pressure", "lat", "lon", "north", "east", "flow", "fault", "status"}
_NOT_COMMAND |= {"error", "err", "load", "drop", "errors", "pos", "position", "vel", "velocity", "acc"}
_CLOCK = CLOCK_WORDS - {"t"}
# Of a name's end: the unit of something else.
_OTHER_UNIT = re.compile(
    r"(?:[^A-Za-z](?:A|W|C|K|bar|degC|m|m/s|kn|deg|grad|rad)|[^A-Za-z]?(?i:dps|deg/s|rad/s|rad_s|°/s))\W*$"
)
# A command that asks for motion is none of one thruster.
_OF_MOTION = (HEADING_WORDS - {"prua"}) | YAW_RATE_WORDS | {"surge", "sway", "heave", "rate"}
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
# s by which clocks of one trial's files are tried apart.
_APART = 3.0
# s of windows in which a rate changes after a command did; by so many standard errors the other way is the contrary. Of
# small vehicles, which have long done so by then, chance gives two.
_AFTER, _CONTRARY = 4.0, 2.2
# Standard errors from which a sense is told.
_SURE = 4.0
# A smaller share of the motion than this may be another one's that it goes with, unless it is beyond doubt.
_LITTLE = 0.005
# Of commands that go together to so little, that part of them tells nothing.
_ALIKE = 0.01
# A command that never comes nearer to its rest than this share of its largest is none.
_AWAY = 0.5


@dataclass(frozen=True, kw_only=True)
class GuessHints:
    """What is known before the logs are looked at.

    Attributes
    ----------
    axis
        The degree of freedom along which they are looked for.
    heading, commands
        Sources that were named; of another axis the first is what is measured along it.
    outputs
        Source -> thruster, as the autopilot's parameters have it.
    profile
        The type of vehicle that was named, or that the parameters tell.
    """

    axis: Axis = YAW
    heading: str = ""
    commands: tuple[str, ...] = ()
    outputs: Mapping[str, AutopilotOutput] = field(default_factory=dict)
    profile: VehiclePreset | None = None


@dataclass(frozen=True, kw_only=True)
class CommandEffect:
    """What logs tell of a command by themselves.

    Attributes
    ----------
    sure
        Standard errors by which it pushes up, or down where negative; errors that are alike from one window to the next
        count as fewer.
    share
        Of how the rate changes, beyond what follows from the rate before, 0 to 1 over all commands together.
    effect
        Change of the rate over a window for each unit of the command.
    contrary
        Whether the rate changes the other way after the command did: then somebody steers by the motion.
    """

    t_statistic: float = 0.0
    explained_share: float = 0.0
    gain: float = 0.0
    is_contradicted: bool = False

    @property
    def direction(self) -> int:
        """1 up, -1 down, 0 where it is not told."""
        little = self.explained_share < _LITTLE and abs(self.t_statistic) <= 2.0 * _SURE
        return 0 if self.is_contradicted or little or abs(self.t_statistic) <= _SURE else int(np.sign(self.t_statistic))

    @property
    def text(self) -> str:
        """How strong the evidence is."""
        return f"{abs(self.t_statistic):.0f} standard errors, {100.0 * max(self.explained_share, 0.0):.0f} % of how its rate changes"


@dataclass(frozen=True, kw_only=True)
class ThrusterCommand:
    """One command: whether more of it turns the heading up (1), down (-1) or not at all (0), and its range.

    Attributes
    ----------
    arm
        m; 0 where nobody knows.
    told
        Whether it is known which way it turns the vehicle, or that it does not.
    percent
        Whether the command is named a share of a hundred.
    sense
        What these logs tell by themselves.
    against
        What is to be said where that is not ``way``; empty where it is.
    given
        Whether somebody measured the arm and put it in.
    """

    name: str
    source: str
    direction: int
    neutral: float
    lowest: float
    highest: float
    reason: str
    arm: float = 0.0
    direction_known: bool = True
    in_percent: bool = False
    observed: CommandEffect = field(default_factory=CommandEffect)
    contradiction: str = ""
    arm_measured: bool = False


def guess_thrusters(
    every: Mapping[str, Sequence[RawColumn]],
    logs: Sequence[Mapping[str, RawColumn]],
    heading: SignalGuess | None,
    wanted: GuessHints,
) -> tuple[ThrusterCommand, ...]:
    """The commands: those that were named, those that the autopilot knows, or those with such names."""
    moving = _chosen(every, wanted)
    neutral = {source: _neutral(values) for source, values in moving.items()}
    ways = (
        command_effects(neutral, logs, heading, rights=wanted.axis.self_righting)
        if heading is not None and neutral
        else {}
    )
    yaw = wanted.axis is YAW
    mixed = _mixed(neutral, logs) if yaw else {}
    names: list[str] = []
    commands: list[ThrusterCommand] = []
    for source, rest in neutral.items():
        values = moving[source]
        output = wanted.outputs.get(source)
        label = output.label if output else wanted.profile.label(name_words(source)) if wanted.profile and yaw else ""
        names.append(_unique(output.name, names) if output else _thruster(source, names))
        sense = ways.get(source, CommandEffect())
        way, arm, told = _turned(source, label, wanted, sense, mixed)
        said = output.reason if output else "given" if source in wanted.commands else "named so"
        commands.append(
            ThrusterCommand(
                name=names[-1],
                source=source,
                direction=way,
                neutral=rest,
                lowest=float(values.min()),
                highest=float(values.max()),
                reason=f"{said}; {values.min():.4g} to {values.max():.4g}, no thrust at {rest:g}; {told}",
                arm=arm,
                direction_known=bool(way or (yaw and (output or mixed or label))),
                in_percent=bool(name_words(source) & _PERCENT) or "%" in source,
                observed=sense,
                contradiction=f"{source}: {told}." if "against" in told else "",
            )
        )
    return tuple(commands)


def _turned(
    source: str,
    label: str,
    wanted: GuessHints,
    sense: CommandEffect,
    mixed: Mapping[str, int],
) -> tuple[int, float, str]:
    """Sense in which a command turns the heading, its arm in m, and the reason."""
    seen, sure = sense.direction, sense.text
    if wanted.axis is not YAW:
        return seen, 0.0, _by_motion(sense, wanted.axis)
    published = wanted.profile.arms.get(label, 0.0) if wanted.profile else 0.0
    output = wanted.outputs.get(source)
    if output is not None:
        way, reason = output.direction, "the autopilot's parameters"
    elif mixed:
        way, reason = mixed.get(source, 0), f"the autopilot's own {_DEMAND}"
    elif label:
        way, reason = int(np.sign(published)), "its type of vehicle"
    else:
        return seen, 0.0, _by_motion(sense, YAW)
    if output is None and label and not mixed and seen and seen != way:
        # Nobody but the motion knows which way round a propeller runs.
        way, reason = seen, f"these logs ({sure}), against its type of vehicle"
    known = 0.0 if wanted.profile is None or wanted.profile.senses_alone else abs(published)
    arm = (output.arm if output else 0.0) or known
    if not way:
        return 0, arm, f"by {reason} it does not turn the vehicle"
    agrees = f"; so do these logs ({sure})" if seen == way else ""
    against = f"; these logs speak against it ({sure})" if seen == -way else ""
    return way, arm, f"by {reason} {_answers(way, YAW)}{agrees}{against}"


def _by_motion(sense: CommandEffect, axis: Axis) -> str:
    if not sense.direction:
        steered = ", in which it answers the motion" if sense.is_contradicted else ""
        return f"whether it {axis.motion_verb} the vehicle is not told by these logs{steered}"
    return f"{_answers(sense.direction, axis)} ({sense.text})"


def _answers(way: int, axis: Axis) -> str:
    """What more of a command does."""
    if axis is YAW:
        return f"more of it turns the heading {'up' if way > 0 else 'down'}"
    return f"more of it makes the {axis.position_words} {'grow' if way > 0 else 'fall'}"


def _chosen(every: Mapping[str, Sequence[RawColumn]], wanted: GuessHints) -> dict[str, FloatArray]:
    """Values of each source that is a command."""
    if wanted.commands:
        return {source: finite_values(every[source]) for source in wanted.commands if source in every}
    if told := {source: finite_values(every[source]) for source in wanted.outputs if source in every}:
        return {source: values for source, values in told.items() if len(values) and np.ptp(values) > 0.0}
    moving = {}
    for source, seen in every.items():
        values = finite_values(seen)
        if len(values) and np.ptp(values) > 0.0:
            moving[source] = values
    logged = any(is_torque(source, values) for source, values in moving.items())
    for named_so in (is_thruster_command, _is_like_one, _is_answer, *([] if logged else [_is_of_motion, _is_pilots])):
        found = {source: values for source, values in moving.items() if named_so(source)}
        if logged:  # beside which a voltage is none of a thruster unless it is named one
            found = {source: values for source, values in found.items() if name_words(source) & (COMMAND | SIDED)}
        coming = {source: values for source, values in found.items() if _neutral(values) == REST or _comes_by(values)}
        found = coming or found
        # Beside what is asked of a thruster its turns a minute are its answer.
        asked = {source: values for source, values in found.items() if not name_words(source) & _TURNS_PER_MINUTE}
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


def is_thruster_command(source: str) -> bool:
    """Whether a column is one of a thruster by its name."""
    named = name_words(source)
    return _may_command(source, named) and bool(named & (COMMAND | SIDED) or _is_voltage(named))


def _is_like_one(source: str) -> bool:
    """By its number, or as so many turns a minute."""
    return _may_command(source, name_words(source)) and _is_of_one(name_words(source))


def _is_answer(source: str) -> bool:
    named = name_words(source)
    return bool(named & _ANSWER) and _may_command(source, named - _ANSWER) and _is_of_one(named - _ANSWER)


def _is_of_one(named: set[str]) -> bool:
    numbered = named & _LETTERS and any(word.isdigit() for word in named) and len(named) <= 4
    return bool(named & (SIDED | _TURNS_PER_MINUTE) or numbered)


def _may_command(source: str, named: set[str]) -> bool:
    return not named & _NEVER and not _OTHER_UNIT.search(source)


def _is_voltage(named: set[str]) -> bool:
    # A v is a sway velocity as well, and a voltage by itself that of the supply.
    return bool(named & VOLTS and named - VOLTS and not named & _NOT_VOLTAGES)


def is_torque(source: str, values: FloatArray) -> bool:
    """Whether a column is named a torque about the vertical: by a word, its unit, or its symbol (SNAME), both ways."""
    symbol = source == "N" and values.min() < 0.0 < values.max()
    return bool(name_words(source) & TORQUE or _NEWTON_METRES.search(source) or symbol)


def _is_of_motion(source: str) -> bool:
    """A demand that is spread over the thrusters."""
    named = name_words(source)
    return bool(named & COMMAND and named & _OF_MOTION and not named & LIGHTS and not _OTHER_UNIT.search(source))


def _is_pilots(source: str) -> bool:
    return bool(name_words(source) & _PILOT)


def _neutral(values: FloatArray) -> float:
    low, high = _PULSE
    if low <= values.min() and values.max() <= high and values.max() > 1.1 * low:
        return REST
    return 0.0


def command_effects(
    neutral: Mapping[str, float], logs: Sequence[Mapping[str, RawColumn]], heading: SignalGuess, *, rights: bool = False
) -> dict[str, CommandEffect]:
    """What each command does to the motion along the axis, and how surely.

    The mean rate over each window goes with that of the one before and the mean commands of both: so it does on a slow
    vehicle as on a fast one. In windows that are too short the heading's noise makes each rate the next one's opposite.
    Who steers pushes against the motion, noise and all, within one window: so changes of commands are held against the
    changes of the rate that follow them, too. Where these say the contrary, the logs do not tell.
    """
    count, best = len(neutral), [CommandEffect()] * len(neutral)
    for window in _WINDOWS:
        rows, turns = _in_windows(neutral, logs, heading, window, rights=rights)
        if len(turns) < FEWEST:
            break
        values, found, _, alike = _regressed(rows, turns)
        pushes = rows[:, -count:] * values[-count:]
        turning = turns - rows[:, :-count] @ values[:-count]
        varied = turning - turning.mean()
        shares = varied @ pushes / max(float(varied @ varied), 1e-300)
        best = [
            CommandEffect(t_statistic=sure, explained_share=share, gain=effect)
            for sure, share, effect in zip(
                found[-count:].tolist(), shares.tolist(), values[-count:].tolist(), strict=True
            )
        ]
        if alike > _OPPOSITE:
            break
    drive = {source: one.gain for source, one in zip(neutral, best, strict=True)}
    # What rights itself swings back by itself.
    contrary = not rights and _after_changes(drive, logs, heading) < -_CONTRARY
    return {source: replace(one, is_contradicted=contrary) for source, one in zip(neutral, best, strict=True)}


def _after_changes(drive: Mapping[str, float], logs: Sequence[Mapping[str, RawColumn]], heading: SignalGuess) -> float:
    """Standard errors with which the rate changes after the drive of all commands did; 0 where there is too little."""
    for window in (_AFTER, 0.5 * _AFTER):
        rows, turns = [np.empty((0, 4))], [np.empty(0)]
        for log in logs:
            if heading.source not in log or not set(drive) <= set(log):
                continue
            time, rate = mean_rates(heading, log[heading.source], window)
            if len(rate) < 4:
                continue
            change = np.diff(rate)
            pushed = sum(effect * held_mean(log[source], time) for source, effect in drive.items())
            rows.append(np.column_stack((np.ones(len(change) - 2), change[1:-1], change[:-2], np.diff(pushed)[1:-1])))
            turns.append(change[2:])
        if sum(map(len, turns)) >= FEWEST:
            _, found, _, _ = _regressed(np.nan_to_num(np.concatenate(rows)), np.concatenate(turns))
            return float(found[3])
    return 0.0


def response_delay(neutral: Mapping[str, float], log: Mapping[str, RawColumn], heading: SignalGuess) -> float:
    """S after which the vehicle answers commands of another clock, to a window; negative where that is ahead."""
    if not neutral:
        return 0.0
    told = {0.0: 0.0}
    for late in np.arange(-_APART, _APART + _WINDOWS[0], _WINDOWS[0]).tolist():
        moved = {source: replace(seen, time=seen.time + late) for source, seen in log.items() if source in neutral}
        rows, turns = _in_windows(neutral, [dict(log) | moved], heading, _WINDOWS[1])
        if len(turns) >= FEWEST:
            told[late] = _regressed(rows, turns)[2]
    return max(told, key=lambda late: told[late])


def _in_windows(
    neutral: Mapping[str, float],
    logs: Sequence[Mapping[str, RawColumn]],
    heading: SignalGuess,
    window: float,
    *,
    rights: bool = False,
) -> tuple[FloatArray, FloatArray]:
    """(n, 2 + k) a constant, the rate of the window before and the mean commands; (n,) the rates.

    Along an axis that ``rights`` itself the place in front of the commands, (n, 3 + k).
    """
    rows, turns = [np.empty((0, 2 + rights + len(neutral)))], [np.empty(0)]
    for log in logs:
        if heading.source not in log or not set(neutral) <= set(log):
            continue
        time, rate = mean_rates(heading, log[heading.source], window)
        if len(rate) < 3:
            continue
        means = []
        for source, rest in neutral.items():
            command = held_mean(log[source], time) - rest
            means.append(0.5 * (command[1:] + command[:-1]))
        places = [position_at(heading, log[heading.source], time[1:-1])] * rights
        rows.append(np.column_stack((np.ones(len(rate) - 1), rate[:-1], *places, *means)))
        turns.append(rate[1:])
    return np.nan_to_num(np.concatenate(rows)), np.concatenate(turns)


def _mixed(neutral: Mapping[str, float], logs: Sequence[Mapping[str, RawColumn]]) -> dict[str, int]:
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
