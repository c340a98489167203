"""Thrust curves that include the memoryless effects, and the lag in front of or behind them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.core.escaping import identifiers, xml_comment
from rovid.effects import Effect
from rovid.effects.actuator_inputs import neutral_commands
from rovid.effects.thruster_imbalance import WITH_OTHERS
from rovid.export.interface import ExportInput
from rovid.model.command_series import CommandSeries
from rovid.trial.trial import Trial

# Memoryless effects between the command and the thrust of one thruster.
_CURVE_EFFECTS = ("thruster_deadband", "thrust_asymmetry", "thrust_curve_shape", "thruster_imbalance")
# Number of points before simplification, and its tolerance relative to the largest thrust; not visible in the rate.
_POINTS, _TOLERANCE = 2001, 1e-5
# Names that simulators use for parts of their own; the link of a thruster is its name with "_link".
_RESERVED = ("base", "base_link", "bias_torque", "yaw")
# Keys of the lag of the thrust, behind the curve, and of the command, in front of the curve.
THRUST_LAG, COMMAND_LAG = "thruster_lag", "thruster_lag:command"


@dataclass(frozen=True, kw_only=True, eq=False)
class ThrusterCurve:
    """Steady thrust of one thruster over its command, memoryless effects included."""

    name: str
    identifier: str  #: Unique name for XML, YAML and topics.
    arm: float  #: m; torque = arm * thrust, positive where it turns the heading up.
    neutral: float  #: Command of no thrust.
    #: ``command``, ``thrust``: (m,) in the unit of the log, and in N (N m for a logged torque).
    command: FloatArray
    thrust: FloatArray

    def __call__(self, command: FloatArray) -> FloatArray:
        """Thrust in N."""
        return np.interp(command, self.command, self.thrust)


def curve_effect_keys(subject: ExportInput) -> frozenset[str]:
    """Keys of the effects that a thrust curve represents."""
    return frozenset(effect.key for effect in _curve_effects(subject))


def _curve_effects(subject: ExportInput) -> list[Effect]:
    effects = subject.model.effects
    return [one for one in effects if one.id in _CURVE_EFFECTS and not one.form.endswith(WITH_OTHERS)]


def thruster_curves(subject: ExportInput) -> list[ThrusterCurve]:
    """Thrust curve of each thruster, with no more points than necessary."""
    effects, vehicle = _curve_effects(subject), subject.vehicle
    names = identifiers([thruster.name for thruster in vehicle.thrusters], taken=_RESERVED)
    neutral = neutral_commands(vehicle)
    model = replace(subject.model, effects=tuple(effects), effect_values=subject.effect_values(effects))
    curves = []
    for index, thruster in enumerate(vehicle.thrusters):
        low, high = subject.commands[index]
        command = np.unique([low, 0.0, high] if thruster.curve is None else thruster.curve.command)
        if effects:
            command = np.union1d(command, np.linspace(command.min(), command.max(), _POINTS))
        commands = np.tile(neutral, (len(command), 1))
        commands[:, index] = command
        trial = Trial.from_commands(np.arange(len(command), dtype=np.float64), commands)
        thrust = model.actuators.thrust(CommandSeries.from_trials(vehicle, [trial]))[:, index]
        kept = _corners(command, thrust)
        curves.append(
            ThrusterCurve(
                name=thruster.name,
                identifier=names[index],
                arm=thruster.arm,
                neutral=float(neutral[index]),
                command=command[kept],
                thrust=thrust[kept],
            )
        )
    return curves


def _corners(x: FloatArray, y: FloatArray) -> IntArray:
    """Rows between which (m,) ``y`` is linear: Ramer 1972, Douglas and Peucker 1973, by vertical distance."""
    tolerance = _TOLERANCE * max(float(np.max(np.abs(y))), 1e-300)
    kept, spans = {0, len(x) - 1}, [(0, len(x) - 1)]
    while spans:
        first, last = spans.pop()
        inside, ends = slice(first, last + 1), [first, last]
        distance = np.abs(y[inside] - np.interp(x[inside], x[ends], y[ends]))
        worst = first + int(np.argmax(distance))
        if last - first > 1 and distance.max() > tolerance:
            kept.add(worst)
            spans += [(first, worst), (worst, last)]
    return np.array(sorted(kept), dtype=np.intp)


def number_list(values: FloatArray) -> str:
    """Numbers separated by spaces."""
    return " ".join(f"{value:.10g}" for value in values)


def curve_comment(curve: ThrusterCurve) -> str:
    """A thrust curve as an XML comment for people and scripts."""
    return xml_comment(f"{curve.name}: command {number_list(curve.command)} | thrust {number_list(curve.thrust)}")


# ---- thrusters with a first-order lag in front of the curve, as in uuv_simulator and Stonefish


def thruster_lag(subject: ExportInput) -> tuple[float, str]:
    """Time constant in s and key of the lag that such thrusters represent; 0 and empty without a lag."""
    for key, values in subject.effects.items():
        if key in {THRUST_LAG, COMMAND_LAG}:
            return values["time_constant"], key
    return 0.0, ""


def thruster_inputs(curves: list[ThrusterCurve], lag: str) -> list[ThrusterCurve]:
    """Curves from input to thrust with zero input at rest, where the lag starts.

    If thrust lags, behind the curve, the input is the steady thrust itself.
    """
    if lag != THRUST_LAG:
        return [replace(curve, command=curve.command - curve.neutral, neutral=0.0) for curve in curves]
    inputs = []
    for curve in curves:
        ends = np.array([min(float(curve.thrust.min()), 0.0), max(float(curve.thrust.max()), 0.0)])
        inputs.append(replace(curve, command=ends, thrust=ends, neutral=0.0))
    return inputs


def input_note(lag: str) -> str:
    """Meaning of the thrusters' input."""
    if lag == THRUST_LAG:
        return "The thrusters' input is the steady thrust in N, by the curves in the file: thrust lags, not command."
    return "The thrusters' input is the command less its neutral value."
