"""What the formats that hold rovid's own equation share: ROS 2 parameters, MATLAB and JSON."""

from __future__ import annotations

from typing import Any

from rovid.core.array_types import FloatArray
from rovid.core.escaping import identifiers
from rovid.export.export_input import ExportInput
from rovid.export.export_result import ExportResult
from rovid.export.resimulation import rovid_rate
from rovid.model.model import Model

BASE = ("inertia", "quadratic_drag", "linear_drag")
EQUATION = "inertia*rdot + quadratic_drag*|r|*r + linear_drag*r = sum(yaw_arm*thrust(command)) + effects"
AXES = "Yaw is positive in the sense in which the heading grows (NED: clockwise from above); SI units and radians."
_NOTE = (AXES + " In a z-up frame the rate and the thrusters' yaw arms change sign, inertia and drag do not.",)


def effect_names(subject: ExportInput) -> dict[str, str]:
    """Key of each effect -> the same as a name of a field."""
    return dict(zip(subject.effects, identifiers(list(subject.effects)), strict=True))


def base_parameters(subject: ExportInput) -> dict[str, float]:
    """Inertia and drag by name, in SI."""
    model = subject.model
    return {
        "inertia": model.inertia,
        "rigid_body_inertia": subject.rigid_inertia,
        "added_inertia": subject.added_inertia,
        "quadratic_drag": model.quadratic_drag,
        "linear_drag": model.linear_drag,
    }


def thruster_entry(subject: ExportInput, index: int, made: Any) -> dict[str, Any]:
    """The bench curve; a logged torque is its own."""
    thruster = subject.vehicle.thrusters[index]
    if thruster.curve is None:
        command = thrust = made(subject.commands[index])
    else:
        command, thrust = made(thruster.curve.command), made(thruster.curve.thrust)
    return {"name": thruster.name, "yaw_arm": thruster.arm, "command": command, "thrust": thrust}


def rovid_result(
    subject: ExportInput, content: str | bytes, base: list[float], effects: dict[str, dict[str, float]]
) -> ExportResult:
    """The target's equation is rovid's, with the numbers as they stand in the file."""
    inertia, quadratic, linear = base
    values: list[float] = []
    for effect in subject.model.effects:
        values += effects[effect.key].values()
    read = Model(
        inertia=inertia,
        quadratic_drag=quadratic,
        linear_drag=linear,
        effects=subject.model.effects,
        effect_values=tuple(values),
    )

    def plant(commands: FloatArray, period: float) -> FloatArray:  # noqa: ARG001 - the manoeuvre's own
        return rovid_rate(subject, read, commands)

    return ExportResult(content=content, simulate=plant, kept_effects=frozenset(subject.effects), notes=_NOTE)
