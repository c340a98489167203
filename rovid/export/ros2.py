"""ROS 2: rovid's own equation and every number of it, as parameters of a node."""

from __future__ import annotations

from typing import Any

from rovid.export.plain import AXES, BASE, EQUATION, base_of, effect_names, target_of, thruster_of
from rovid.export.subject import Subject
from rovid.export.target import Target
from rovid.ground.files.form import export_mark
from rovid.ground.quoting import toml_text


def export(subject: Subject) -> Target:
    """A parameter YAML for any node; names with a colon keep it as an underscore."""
    lines = [f"# {export_mark('ros2')}.", f"# {EQUATION}", f"# {AXES}", "/**:", "  ros__parameters:"]
    lines += [f"    {name}: {_yaml(value)}" for name, value in base_of(subject).items()]
    thrusters = [toml_text(thruster.name) for thruster in subject.vehicle.thrusters]
    lines.append(f"    thruster_names: [{', '.join(thrusters)}]")
    for index in range(len(subject.vehicle.thrusters)):
        thruster = thruster_of(subject, index, list)
        lines.append(f"    thruster_{index}:")
        lines += [f"      {name}: {_yaml(thruster[name])}" for name in ("yaw_arm", "command", "thrust")]
    lines.append(f"    effect_names: [{', '.join(map(toml_text, subject.effects))}]")
    if subject.effects:
        lines.append("    effects:")
    keys = effect_names(subject)
    effects = {}
    for key, parameters in subject.effects.items():
        written = {name: _yaml(value) for name, value in parameters.items()}
        lines.append(f"      {keys[key]}:")
        lines += [f"        {name}: {text}" for name, text in written.items()]
        effects[key] = {name: float(text) for name, text in written.items()}
    base = [float(_yaml(base_of(subject)[name])) for name in BASE]
    return target_of(subject, "\n".join([*lines, ""]), base, effects)


def _yaml(value: Any) -> str:
    """A float that every YAML 1.1 reader takes for one: with a point and a signed exponent."""
    if isinstance(value, list):
        return f"[{', '.join(map(_yaml, value))}]"
    text = repr(float(value))
    if "e" in text and "." not in text:
        return text.replace("e", ".0e")
    return text
