"""ROS 2: rovid's own equation and every number of it, as parameters of a node."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from rovid.core.escaping import toml_text
from rovid.core.signatures import export_mark
from rovid.export.export_input import ExportInput
from rovid.export.export_result import ExportResult
from rovid.export.rovid_equation import (
    AXES,
    BASE,
    EQUATION,
    base_parameters,
    effect_names,
    rovid_result,
    thruster_entry,
)


def export(subject: ExportInput) -> ExportResult:
    """A parameter YAML for any node; names with a colon keep it as an underscore."""
    lines = [f"# {export_mark('ros2')}.", f"# {EQUATION}", f"# {AXES}", "/**:", "  ros__parameters:"]
    lines += _entries("    ", base_parameters(subject))
    names = ", ".join(toml_text(thruster.name) for thruster in subject.vehicle.thrusters)
    lines.append(f"    thruster_names: [{names}]")
    lines += _thrusters(subject)
    lines.append(f"    effect_names: [{', '.join(map(toml_text, subject.effects))}]")
    if subject.effects:
        lines.append("    effects:")
    keys, effects = effect_names(subject), {}
    for key, parameters in subject.effects.items():
        lines.append(f"      {keys[key]}:")
        lines += _entries("        ", parameters)
        effects[key] = _read(parameters)
    base = _read(base_parameters(subject))
    content = "\n".join(lines) + "\n"
    return rovid_result(subject, content, [base[name] for name in BASE], effects)


def _thrusters(subject: ExportInput) -> Iterator[str]:
    """Lines of each thruster's arm and curve."""
    for index in range(len(subject.vehicle.thrusters)):
        thruster = thruster_entry(subject, index, list)
        yield f"    thruster_{index}:"
        yield from _entries("      ", {name: thruster[name] for name in ("yaw_arm", "command", "thrust")})


def _entries(indent: str, values: Mapping[str, Any]) -> list[str]:
    """A line for each value, as far in as its parent asks."""
    return [f"{indent}{name}: {_yaml(value)}" for name, value in values.items()]


def _read(values: Mapping[str, float]) -> dict[str, float]:
    """As they stand in the file."""
    return {name: float(_yaml(value)) for name, value in values.items()}


def _yaml(value: Any) -> str:
    """A float that every YAML 1.1 reader takes for one: with a point and a signed exponent."""
    if isinstance(value, list):
        return f"[{', '.join(map(_yaml, value))}]"
    text = repr(float(value))
    if "e" in text and "." not in text:
        return text.replace("e", ".0e")
    return text
