"""JSON: rovid's own equation and every number of it, for whoever states it again."""

from __future__ import annotations

import json
from typing import Any

from rovid.core.formatting import to_json
from rovid.export.export_input import ExportInput
from rovid.export.export_result import ExportResult
from rovid.export.rovid_equation import AXES, BASE, EQUATION, rovid_result, thruster_entry


def export(subject: ExportInput) -> ExportResult:
    """Everything, with units, standard errors and the effects' equations."""
    content = to_json(_document(subject)) + "\n"
    read = json.loads(content)
    base = [read["parameters"][name]["value"] for name in BASE]
    effects = {}
    for effect in read["effects"]:
        effects[effect["key"]] = {name: entry["value"] for name, entry in effect["parameters"].items()}
    return rovid_result(subject, content, base, effects)


def _document(subject: ExportInput) -> dict[str, Any]:
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
        "axes": AXES,
        "parameters": {name: value for name, value in entries.items() if "." not in name},
        "rigid_body_inertia": subject.vehicle.rigid_body_inertia,
        "thrusters": [thruster_entry(subject, index, list) for index in range(len(subject.vehicle.thrusters))],
        "effects": effects,
        "guessed": list(subject.guess.items),
    }
