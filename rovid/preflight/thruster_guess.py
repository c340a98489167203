"""Guess which columns command thrusters and in which direction, from names, autopilot parameters and the motion.

ArduPilot: SERVOn_FUNCTION is the function of output n (33 to 40 and 82 to 85: motors 1 to 12; 73 and 74: throttles to
port and to starboard); FRAME_CONFIG is the layout of the motors of a submarine; MOT_n_DIRECTION and SERVOn_REVERSED
reverse them. PX4: CA_ROTORn_PX, _PY, _AX, _AY and _CT are position, thrust axis and thrust coefficient of motor n.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.preflight.command_effects import YAW_DEMAND, CommandEffect, command_effects, mixer_directions
from rovid.preflight.raw_columns import (
    COMMAND,
    LIGHT,
    MOTION_COMMAND,
    SIDE,
    VOLTAGE,
    Columns,
    Log,
    SignalGuess,
    has_other_unit,
    is_thruster_command,
    is_torque,
    may_be_command,
    word_list,
)
from rovid.trial.axis import YAW, Axis, name_words
from rovid.trial.vehicle_presets import VehiclePreset

# FRAME_CONFIG of ArduSub -> direction in which each motor turns the bow to starboard; the other motors do not turn it.
# Source: the motor tables in ArduPilot's AP_Motors6DOF.
_PAIR, _VECTORED = {1: -1, 2: 1}, {1: 1, 2: -1, 3: -1, 4: 1}
_FRAMES = {0: _PAIR, 1: _VECTORED, 2: _VECTORED, 3: {2: 1, 7: -1}, 4: _PAIR, 5: _PAIR, 6: _PAIR}
_FRAME = "FRAME_CONFIG"
# Frames that only one type of vehicle has.
_TYPES = {1: "bluerov2", 2: "bluerov2-heavy"}
_MOTORS = {**{33 + at: 1 + at for at in range(8)}, **{82 + at: 9 + at for at in range(4)}}
_THROTTLES = {73: ("port", 1), 74: ("starboard", -1)}
_OUTPUTS = 16


@dataclass(frozen=True, kw_only=True)
class AutopilotOutput:
    """Thruster at one output of the autopilot."""

    label: str  #: Number of the motor, or its side.
    direction: int  #: Direction in which more of the command turns the heading; 0 for neither.
    reason: str  #: Parameters that define the thruster.
    arm: float = 0.0  #: m; 0 if not known.

    @property
    def name(self) -> str:
        """Name of the thruster in rovid.toml."""
        return f"motor_{self.label}" if self.label.isdigit() else self.label


def thruster_outputs(parameters: Mapping[str, float]) -> dict[str, AutopilotOutput]:
    """Source -> thruster that it commands; empty if the parameters do not say."""
    return _px4_outputs(parameters) or _ardupilot_outputs(parameters)


def vehicle_type(parameters: Mapping[str, float]) -> str:
    """Type of vehicle by the frame; empty if the parameters do not say."""
    return _TYPES.get(_integer(parameters, _FRAME, -1), "")


def _integer(parameters: Mapping[str, float], name: str, default: int) -> int:
    value = parameters.get(name, default)
    return int(value) if abs(value) < 1e6 else default


def _ardupilot_outputs(parameters: Mapping[str, float]) -> dict[str, AutopilotOutput]:
    directions = _FRAMES.get(_integer(parameters, _FRAME, -1))
    outputs = {}
    for number in range(1, _OUTPUTS + 1):
        key = f"SERVO{number}_FUNCTION"
        function = _integer(parameters, key, 0)
        if function in _THROTTLES:
            label, direction = _THROTTLES[function]
            reason = f"{key} is {function}, the throttle to {label}"
        elif function in _MOTORS and directions is not None:
            motor = _MOTORS[function]
            label, direction = str(motor), directions.get(motor, 0)
            if not parameters.get(f"MOT_{motor}_DIRECTION", 1.0) >= 0.0:
                direction = -direction
            reason = f"{key} is {function}, motor {motor}; by {_FRAME} and MOT_{motor}_DIRECTION"
        else:
            continue
        if _integer(parameters, f"SERVO{number}_REVERSED", 0):
            direction = -direction
        output = AutopilotOutput(label=label, direction=direction, reason=reason)
        # The source in a DataFlash log, and in telemetry.
        outputs[f"RCOU.C{number}" if number <= 14 else f"RCO2.C{number}"] = output
        outputs[f"SERVO_OUTPUT_RAW.servo{number}_raw"] = output
    return outputs


def _px4_outputs(parameters: Mapping[str, float]) -> dict[str, AutopilotOutput]:
    outputs = {}
    for at in range(_integer(parameters, "CA_ROTOR_COUNT", 0)):
        x, y, ahead, aside = (parameters.get(f"CA_ROTOR{at}_{what}", 0.0) for what in ("PX", "PY", "AX", "AY"))
        # Axes are forward, starboard, down: a positive torque about the last one turns the heading up.
        sign = 1.0 if parameters.get(f"CA_ROTOR{at}_CT", 1.0) >= 0.0 else -1.0
        arm = sign * (x * aside - y * ahead)
        direction = 0 if abs(arm) < 1e-3 else int(np.copysign(1.0, arm))
        outputs[f"actuator_motors.control[{at}]"] = AutopilotOutput(
            label=str(at + 1), direction=direction, arm=abs(arm), reason=f"CA_ROTOR{at}_PX, _PY, _AX and _AY"
        )
    # The motors of a multicopter thrust along z, and turn it by their drag.
    return outputs if any(output.direction for output in outputs.values()) else {}


_SPEED = word_list("thruster", "speed")
_FEEDBACK = word_list("thruster", "feedback")
_NUMBERED = word_list("thruster", "numbered")
_PERCENT = word_list("thruster", "percent")
_AZIMUTH = word_list("thruster", "azimuth")
_PILOT = word_list("thruster", "pilot")
_FILLER = word_list("thruster", "filler") | (VOLTAGE - {"tension"})
# us, range of pulse widths, the width of no thrust, and the largest distance of a command from it.
_PULSE, _NO_THRUST, _NEAR = (800.0, 2200.0), 1500.0, 25.0
# A command comes nearer to zero than this share of its largest value; a supply does not.
_NEAR_ZERO = 0.5


@dataclass(frozen=True, kw_only=True)
class GuessHints:
    """Facts known before the guess."""

    axis: Axis = YAW  #: Degree of freedom to look for.
    #: ``heading``, ``commands``: sources that the user named; ``heading`` is the source of the motion along any axis.
    heading: str = ""
    commands: tuple[str, ...] = ()
    #: Source -> thruster, from the autopilot's parameters.
    outputs: Mapping[str, AutopilotOutput] = field(default_factory=dict)
    profile: VehiclePreset | None = None  #: Type of the vehicle.


@dataclass(frozen=True, kw_only=True)
class ThrusterCommand:
    """Command of one thruster."""

    name: str
    source: str
    direction: int  #: 1 if more of the command turns the heading up, -1 if down, 0 if neither or not known.
    #: ``neutral``, ``lowest``, ``highest``: value of no thrust, and the range in the logs.
    neutral: float
    lowest: float
    highest: float
    reason: str
    arm: float = 0.0  #: m; 0 if not known.
    direction_known: bool = True  #: Whether the direction is known, no effect included.
    in_percent: bool = False  #: Whether the name contains a word of percent.
    observed: CommandEffect = field(default_factory=CommandEffect)  #: Effect on the motion in the logs.
    contradiction: str = ""  #: Warning if the logs contradict ``direction``; else empty.
    arm_measured: bool = False  #: Whether the user gave the arm.
    is_motor: bool = False  #: Whether the torque is a constant times the command.

    @property
    def turns_nothing(self) -> bool:
        """Whether it is known not to turn the vehicle."""
        return self.direction_known and not self.direction and not self.arm


def guess_thrusters(
    columns: Columns, logs: Sequence[Log], position: SignalGuess | None, hints: GuessHints
) -> tuple[ThrusterCommand, ...]:
    """Thruster commands, by the user's choice, by the autopilot's outputs, or by name."""
    ranges = _select_commands(columns, hints)
    neutral = {source: neutral_value(values) for source, values in ranges.items()}
    effects: Mapping[str, CommandEffect] = {}
    if position is not None and neutral:
        effects = command_effects(neutral, logs, position, self_righting=hints.axis.self_righting)
    yaw = hints.axis is YAW
    mixed = mixer_directions(neutral, logs) if yaw else {}
    names: list[str] = []
    commands: list[ThrusterCommand] = []
    for source, values in ranges.items():
        label, name, origin = "", short_name(source), "by name"
        if output := hints.outputs.get(source):
            label, name, origin = output.label, output.name, output.reason
        elif source in hints.commands:
            origin = "chosen by you"
        if hints.profile and yaw:
            label = label or hints.profile.label(name_words(source))
        names.append(distinct_name(name, names))
        effect = effects.get(source, CommandEffect())
        direction, arm, reason = _direction(source, label, hints, effect, mixed)
        low, high = float(values.min()), float(values.max())
        commands.append(
            ThrusterCommand(
                name=names[-1],
                source=source,
                direction=direction,
                neutral=neutral[source],
                lowest=low,
                highest=high,
                reason=f"{origin}; {low:.4g} to {high:.4g}, no thrust at {neutral[source]:g}; {reason}",
                arm=arm,
                direction_known=bool(direction or (yaw and (output or mixed or label))),
                in_percent=bool(name_words(source) & _PERCENT) or "%" in source,
                observed=effect,
                contradiction=f"{source}: {reason}." if "contradict" in reason else "",
            )
        )
    return tuple(commands)


def neutral_values(columns: Columns, hints: GuessHints) -> dict[str, float]:
    """Source of each thruster command -> its value of no thrust."""
    return {source: neutral_value(values) for source, values in _select_commands(columns, hints).items()}


def _direction(
    source: str, label: str, hints: GuessHints, effect: CommandEffect, mixed: Mapping[str, int]
) -> tuple[int, float, str]:
    """Direction of a command, arm of its thruster in m, and the reason."""
    observed, evidence = effect.direction, effect.text
    output = hints.outputs.get(source)
    if hints.axis is not YAW or not (output or mixed or label):
        feedback = "; the command responds to the motion" if effect.is_contradicted else ""
        text = f"these logs do not show whether it {hints.axis.motion_verb} the vehicle{feedback}"
        return observed, 0.0, f"{_in_words(observed, hints.axis)} ({evidence})" if observed else text
    published = hints.profile.arms.get(label, 0.0) if hints.profile else 0.0
    if output is not None:
        direction, reason = output.direction, "the autopilot's parameters"
    elif mixed:
        direction, reason = mixed.get(source, 0), f"the autopilot's demand {YAW_DEMAND}"
    else:
        direction, reason = int(np.sign(published)), "its type of vehicle"
        if observed not in {0, direction}:
            # Only the motion shows in which sense a propeller runs.
            direction, reason = observed, f"these logs ({evidence}), which contradict its type of vehicle"
    arm = output.arm if output else 0.0
    if not arm and hints.profile and not hints.profile.senses_alone:
        arm = abs(published)
    if not direction:
        return 0, arm, f"by {reason} it does not turn the vehicle"
    text = f"by {reason} {_in_words(direction, YAW)}"
    if observed == direction:
        text += f"; these logs agree ({evidence})"
    elif observed == -direction:
        text += f"; these logs contradict that ({evidence})"
    return direction, arm, text


def _in_words(direction: int, axis: Axis) -> str:
    if axis is YAW:
        return f"more of it turns the heading {'up' if direction > 0 else 'down'}"
    return f"more of it makes the {axis.position_words} {'grow' if direction > 0 else 'fall'}"


def _select_commands(columns: Columns, hints: GuessHints) -> dict[str, FloatArray]:
    """Finite values of each source that is a command."""
    if hints.commands:
        return {source: columns[source].values for source in hints.commands if source in columns}
    angles = azimuth_angles(columns)
    changing = {source: column for source, column in columns.items() if column.changes and source not in angles}
    varying = {source: column.values for source, column in changing.items()}
    outputs = [source for source in hints.outputs if source in columns]
    if outputs:
        return {source: varying[source] for source in outputs if source in varying}
    torque_logged = any(map(is_torque, changing.values()))
    name_tests = [is_thruster_command, _is_one_of_several, _is_feedback]
    if not torque_logged:
        name_tests += [_is_motion_command, lambda source: bool(name_words(source) & _PILOT)]
    for name_test in name_tests:
        found = {source: values for source, values in varying.items() if name_test(source)}
        # An array beside a command of its own holds something else.
        plain = {source.rpartition(".")[0] for source in found if not source.endswith("]")} - {""}
        for source, values in [*found.items()]:
            # A vehicle with a logged torque may have no thrusters, and a voltage that stays far from zero is a supply:
            # the name of such a column has to be that of a thruster.
            supply = name_words(source) & VOLTAGE and not _approaches_zero(values)
            other = (torque_logged or supply) and not name_words(source) & (COMMAND | SIDE)
            if other or (source.endswith("]") and source.rpartition(".")[0] in plain):
                del found[source]
        found = _prefer(found, lambda _, values: neutral_value(values) == _NO_THRUST or _approaches_zero(values))
        # Speeds are the response to the other commands.
        found = _prefer(found, lambda source, _: not name_words(source) & _SPEED)
        # Commands of a pilot or an autopilot reach the thrusters as pulses.
        found = _prefer(found, lambda _, values: neutral_value(values) == _NO_THRUST and _includes_no_thrust(values))
        if found:
            return found
    return {}


def azimuth_angles(columns: Columns) -> list[str]:
    """Sources that are the angle of an azimuth thruster by name; an az next to ax and ay is an acceleration."""
    words = set[str]().union(*(column.words for column in columns.values()))
    named = _AZIMUTH - ({"az"} if {"ax", "ay"} <= words else set())
    return [source for source, column in columns.items() if column.words & named and column.varies]


def _prefer(columns: dict[str, FloatArray], is_preferred: Callable[[str, FloatArray], bool]) -> dict[str, FloatArray]:
    """Columns that satisfy ``is_preferred``; all of ``columns`` if none does."""
    return {source: values for source, values in columns.items() if is_preferred(source, values)} or columns


def neutral_value(values: FloatArray) -> float:
    """Value of no thrust: 1500 for pulse widths in us, else 0."""
    low, high = _PULSE
    is_pulse = low <= values.min() and values.max() <= high and values.max() > 1.1 * low
    return _NO_THRUST if is_pulse else 0.0


def _includes_no_thrust(values: FloatArray) -> bool:
    return bool(values.min() <= _NO_THRUST + _NEAR and values.max() >= _NO_THRUST - _NEAR)


def _approaches_zero(values: FloatArray) -> bool:
    low, high = float(values.min()), float(values.max())
    return low <= 0.0 <= high or min(abs(low), abs(high)) < _NEAR_ZERO * max(abs(low), abs(high))


def _is_one_of_several(source: str) -> bool:
    """Whether the name has a side, a number or a unit of speed, and no word of another quantity."""
    words = name_words(source)
    return may_be_command(source, words) and _identifies_thruster(words)


def _is_feedback(source: str) -> bool:
    """Whether the name is that of a quantity the thruster reports back, as a measured speed."""
    words = name_words(source)
    others = words - _FEEDBACK
    return others != words and may_be_command(source, others) and _identifies_thruster(others)


def _identifies_thruster(words: set[str]) -> bool:
    numbered = words & _NUMBERED and any(word.isdigit() for word in words) and len(words) <= 4
    return bool(words & (SIDE | _SPEED) or numbered)


def _is_motion_command(source: str) -> bool:
    """Whether the command is distributed to the thrusters."""
    words = name_words(source)
    return bool(words & COMMAND and words & MOTION_COMMAND and not words & LIGHT and not has_other_unit(source))


def short_name(source: str) -> str:
    """Name of a thruster: its source without words of command and unit."""
    parts = [part for part in re.split(r"[^\w]+|_", source) if part and part.lower() not in _FILLER]
    name = "_".join(parts).lower()
    return f"thruster_{name}" if not name or name.isdigit() else name


def distinct_name(name: str, taken: Sequence[str]) -> str:
    """``name``, with a number if it is ``taken``."""
    own, number = name, len(taken)
    while own in taken:
        number += 1
        own = f"{name}_{number}"
    return own
