"""The thrusters' curves with the effects that a curve can hold."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.core.escaping import identifiers, xml_comment
from rovid.effects import Effect
from rovid.effects.actuator_inputs import neutral_commands
from rovid.effects.thruster_imbalance import WITH_OTHERS
from rovid.export.export_input import ExportInput
from rovid.model.command_series import CommandSeries
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Thruster

# Effects without a memory, between the command and the thrust of one thruster: a thrust curve holds them.
CURVE_EFFECTS = ("thruster_deadband", "thrust_asymmetry", "thrust_curve_shape", "thruster_imbalance")
_CURVE_POINTS = 2001
_CURVE_TOLERANCE = 1e-5  # of the largest thrust; far below what shows in the rate
# Names that targets use for parts of their own; a thruster's link is called by its name and "_link".
_TAKEN = ("base", "base_link", "bias_torque", "yaw")


@dataclass(frozen=True, kw_only=True, eq=False)
class ThrusterCurve:
    """Steady thrust of one thruster against its command, effects without memory included.

    Attributes
    ----------
    identifier
        The name as XML, YAML and topics take it, its own among the vehicle's.
    arm
        m; torque = arm * thrust, positive turns the heading up.
    neutral
        Command of no thrust.
    command, thrust
        (m,) in the log's unit; N (N m of an actuator whose logged command is the torque).
    """

    name: str
    identifier: str
    arm: float
    neutral: float
    command: FloatArray
    thrust: FloatArray

    def __call__(self, command: FloatArray) -> FloatArray:
        """Thrust in N."""
        return np.interp(command, self.command, self.thrust)


def is_curve_effect(effect: Effect) -> bool:
    """Whether a thrust curve alone holds it."""
    return effect.id in CURVE_EFFECTS and not effect.form.endswith(WITH_OTHERS)


def curve_effect_keys(subject: ExportInput) -> frozenset[str]:
    """Keys of the effects that a thrust curve holds."""
    return frozenset(effect.key for effect in subject.model.effects if is_curve_effect(effect))


def thruster_curves(subject: ExportInput) -> list[ThrusterCurve]:
    """Thrust curve of each thruster, with as many points as it takes."""
    held = [effect for effect in subject.model.effects if is_curve_effect(effect)]
    names = identifiers([thruster.name for thruster in subject.vehicle.thrusters], taken=_TAKEN)
    return [_curve(subject, held, index, name) for index, name in enumerate(names)]


def _curve(subject: ExportInput, held: list[Effect], index: int, identifier: str) -> ThrusterCurve:
    """That of the thruster at ``index``, with the effects on curves that are ``held``."""
    thruster = subject.vehicle.thrusters[index]
    command = _grid(thruster, subject.commands[index], fine=bool(held))
    thrust = _steady_thrust(subject, held, index, command)
    kept = _corners(command, thrust)
    return ThrusterCurve(
        name=thruster.name,
        identifier=identifier,
        arm=thruster.arm,
        neutral=float(neutral_commands(subject.vehicle)[index]),
        command=command[kept],
        thrust=thrust[kept],
    )


def _grid(thruster: Thruster, used: FloatArray, *, fine: bool) -> FloatArray:
    points = np.array([used[0], 0.0, used[1]])
    if thruster.curve is not None:
        points = thruster.curve.command
    if not fine:
        return np.unique(points)
    return np.union1d(points, np.linspace(points.min(), points.max(), _CURVE_POINTS))


def _steady_thrust(subject: ExportInput, held: list[Effect], index: int, command: FloatArray) -> FloatArray:
    """(m,) N of the thruster at ``index`` at each (m,) command, effects that are ``held`` on the way."""
    vehicle = subject.vehicle
    commands = np.tile(neutral_commands(vehicle), (len(command), 1))
    commands[:, index] = command
    trial = Trial.from_commands(np.arange(len(command), dtype=np.float64), commands)
    values = tuple(map(float, subject.effect_values(held)))
    model = replace(subject.model, effects=tuple(held), effect_values=values)
    thrust = model.actuators.thrust(CommandSeries.from_trials(vehicle, [trial]))
    return np.asarray(thrust[:, index])


def _corners(x: FloatArray, y: FloatArray) -> IntArray:
    """Rows between which (m,) ``y`` is straight: Ramer 1972, Douglas and Peucker 1973, by vertical distance."""
    tolerance = _CURVE_TOLERANCE * max(float(np.max(np.abs(y))), 1e-300)
    kept, open_spans = {0, len(x) - 1}, [(0, len(x) - 1)]
    while open_spans:
        first, last = open_spans.pop()
        inside, ends = slice(first, last + 1), [first, last]
        straight = np.interp(x[inside], x[ends], y[ends])
        off = np.abs(y[inside] - straight)
        worst = first + int(np.argmax(off))
        if last - first > 1 and off.max() > tolerance:
            kept.add(worst)
            open_spans += [(first, worst), (worst, last)]
    return np.array(sorted(kept), dtype=np.intp)


def number_list(values: FloatArray) -> str:
    """Numbers as a simulator's list."""
    return " ".join(f"{value:.10g}" for value in values)


def curve_comment(values: ThrusterCurve) -> str:
    """A thrust curve as a line for people and scripts."""
    return xml_comment(f"{values.name}: command {number_list(values.command)} | thrust {number_list(values.thrust)}")
