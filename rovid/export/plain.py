"""ROS 2 parameters, MATLAB and JSON: rovid's own equation and every number of it, for whoever states it again."""

from __future__ import annotations

import io
import json
from typing import Any

import numpy as np

from rovid.export.manoeuvre import rovid_rate
from rovid.export.subject import Subject
from rovid.export.target import Target
from rovid.ground.arrays import FloatArray
from rovid.ground.files.form import export_mark
from rovid.ground.numbers import to_json
from rovid.ground.quoting import identifiers, toml_text
from rovid.model.model import Model

_BASE = ("inertia", "quadratic_drag", "linear_drag")
EQUATION = "inertia*rdot + quadratic_drag*|r|*r + linear_drag*r = sum(yaw_arm*thrust(command)) + effects"
_AXES = "Yaw is positive in the sense in which the heading grows (NED: clockwise from above); SI units and radians."
_NOTE = (_AXES + " In a z-up frame the rate and the thrusters' yaw arms change sign, inertia and drag do not.",)


def export_json(subject: Subject) -> Target:
    """Everything, with units, standard errors and the effects' equations."""
    content = to_json(_document(subject)) + "\n"
    read = json.loads(content)
    base = [read["parameters"][name]["value"] for name in _BASE]
    effects = {}
    for effect in read["effects"]:
        effects[effect["key"]] = {name: entry["value"] for name, entry in effect["parameters"].items()}
    return _target(subject, content, base, effects)


def export_matlab(subject: Subject) -> Target:
    """A .mat file of version 5 with one struct ``rovid``."""
    from scipy.io import loadmat, savemat

    keys = _identifiers(subject)
    thrusters = [_thruster(subject, index, np.array) for index in range(len(subject.vehicle.thrusters))]
    values = _base(subject) | {
        "equation": EQUATION,
        "axes": _AXES,
        "thrusters": np.array(thrusters, dtype=object),
        "effects": {keys[key]: parameters for key, parameters in subject.effects.items()},
    }
    stream: Any = io.BytesIO()
    savemat(stream, {"rovid": values}, oned_as="column", long_field_names=True)
    # 116 bytes of text for people begin such a file.
    title = f"MATLAB 5.0 MAT-file. {export_mark('matlab')}.".ljust(116)
    content = title.encode() + stream.getvalue()[116:]
    again: Any = io.BytesIO(content)
    read = loadmat(again, simplify_cells=True)["rovid"]
    base = [float(read[name]) for name in _BASE]
    effects = {}
    for key, parameters in subject.effects.items():
        fields = read["effects"][keys[key]]
        effects[key] = {name: float(fields[name]) for name in parameters}
    return _target(subject, content, base, effects)


def export_ros2(subject: Subject) -> Target:
    """A parameter YAML for any node; names with a colon keep it as an underscore."""
    lines = [f"# {export_mark('ros2')}.", f"# {EQUATION}", f"# {_AXES}", "/**:", "  ros__parameters:"]
    lines += [f"    {name}: {_yaml(value)}" for name, value in _base(subject).items()]
    thrusters = [toml_text(thruster.name) for thruster in subject.vehicle.thrusters]
    lines.append(f"    thruster_names: [{', '.join(thrusters)}]")
    for index in range(len(subject.vehicle.thrusters)):
        thruster = _thruster(subject, index, list)
        lines.append(f"    thruster_{index}:")
        lines += [f"      {name}: {_yaml(thruster[name])}" for name in ("yaw_arm", "command", "thrust")]
    lines.append(f"    effect_names: [{', '.join(map(toml_text, subject.effects))}]")
    if subject.effects:
        lines.append("    effects:")
    keys = _identifiers(subject)
    effects = {}
    for key, parameters in subject.effects.items():
        written = {name: _yaml(value) for name, value in parameters.items()}
        lines.append(f"      {keys[key]}:")
        lines += [f"        {name}: {text}" for name, text in written.items()]
        effects[key] = {name: float(text) for name, text in written.items()}
    base = [float(_yaml(_base(subject)[name])) for name in _BASE]
    return _target(subject, "\n".join([*lines, ""]), base, effects)


def _identifiers(subject: Subject) -> dict[str, str]:
    """Key of each effect -> the same as a name of a field."""
    return dict(zip(subject.effects, identifiers(list(subject.effects)), strict=True))


def _base(subject: Subject) -> dict[str, float]:
    model = subject.model
    return {
        "inertia": model.inertia,
        "rigid_body_inertia": subject.rigid_inertia,
        "added_inertia": subject.added_inertia,
        "quadratic_drag": model.quadratic_drag,
        "linear_drag": model.linear_drag,
    }


def _thruster(subject: Subject, index: int, made: Any) -> dict[str, Any]:
    """The bench curve; a logged torque is its own."""
    thruster = subject.vehicle.thrusters[index]
    if thruster.curve is None:
        command = thrust = made(subject.commands[index])
    else:
        command, thrust = made(thruster.curve.command), made(thruster.curve.thrust)
    return {"name": thruster.name, "yaw_arm": thruster.arm, "command": command, "thrust": thrust}


def _document(subject: Subject) -> dict[str, Any]:
    entries: dict[str, dict[str, Any]] = {}
    for name, entry in subject.entries.items():
        entries[name] = {"value": entry.value, "standard_error": entry.standard_error, "unit": entry.unit}
    entries.setdefault("linear_drag", {"value": 0.0, "standard_error": None, "unit": "N m s/rad"})
    effects = []
    for effect in subject.model.effects:
        own = {parameter.name: entries[f"{effect.key}.{parameter.name}"] for parameter in effect.parameters}
        effects.append({"key": effect.key, "equation": effect.equation, "parameters": own})
    return {
        "schema": "rovid-model/1",
        "vehicle": subject.vehicle.name,
        "equation": EQUATION,
        "axes": _AXES,
        "parameters": {name: value for name, value in entries.items() if "." not in name},
        "rigid_body_inertia": subject.vehicle.rigid_body_inertia,
        "thrusters": [_thruster(subject, index, list) for index in range(len(subject.vehicle.thrusters))],
        "effects": effects,
    }


def _yaml(value: Any) -> str:
    """A float that every YAML 1.1 reader takes for one: with a point and a signed exponent."""
    if isinstance(value, list):
        return f"[{', '.join(map(_yaml, value))}]"
    text = repr(float(value))
    if "e" in text and "." not in text:
        return text.replace("e", ".0e")
    return text


def _target(subject: Subject, content: str | bytes, base: list[float], effects: dict[str, dict[str, float]]) -> Target:
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

    return Target(content=content, plant=plant, holds=frozenset(subject.effects), notes=_NOTE)
