"""Rovid's own equation as ROS 2 parameters, MATLAB variables and JSON, of one axis and of the coupled model."""

import io
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from rovid.core.formatting import identifiers, to_json, toml_text
from rovid.core.output_files import export_mark
from rovid.export.interface import ExportInput, ExportResult
from rovid.export.planar_input import PlanarInput
from rovid.model.model import Model
from rovid.model.parameter_names import unit_of
from rovid.planar.model import SNAME
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import YAW

_BASE = ("inertia", "quadratic_drag", "linear_drag")
_EQUATION = "inertia*rdot + quadratic_drag*|r|*r + linear_drag*r = sum(yaw_arm*thrust(command)) + effects"
_AXES = "Yaw is positive in the sense in which the heading grows (NED: clockwise from above); SI units and radians."
_NOTE = _AXES + " In a z-up frame the rate and the thrusters' yaw arms change sign, inertia and drag do not."
# s, step for which stability is judged.
STEP = 0.02
STEP_NOTE = f"The format has no integrator: stability is judged for Runge-Kutta steps of {STEP:g} s."

EffectValues = Mapping[str, Mapping[str, float]]


def export_ros2(subject: ExportInput) -> ExportResult:
    """Parameters of any ROS 2 node in YAML; colons in names become underscores."""
    base, keys = _base_parameters(subject), _field_names(subject)
    names = ", ".join(toml_text(thruster.name) for thruster in subject.vehicle.thrusters)
    lines = [f"# {export_mark('ros2')}.", f"# {_EQUATION}", f"# {_AXES}", "/**:", "  ros__parameters:"]
    lines += [*yaml_lines("    ", base), f"    thruster_names: [{names}]"]
    for index, thruster in enumerate(_thrusters(subject)):
        lines.append(f"    thruster_{index}:")
        lines += yaml_lines("      ", {name: thruster[name] for name in ("yaw_arm", "command", "thrust")})
    lines.append(f"    effect_names: [{', '.join(map(toml_text, subject.effects))}]")
    if subject.effects:
        lines.append("    effects:")
    for key, values in subject.effects.items():
        lines += [f"      {keys[key]}:", *yaml_lines("        ", values)]
    return _result(subject, "\n".join(lines) + "\n", base, subject.effects)


def yaml_lines(indent: str, values: Mapping[str, Any]) -> list[str]:
    """Lines of a YAML mapping from names to numbers or lists of numbers."""
    return [f"{indent}{name}: {_yaml(value)}" for name, value in values.items()]


def _yaml(value: Any) -> str:
    """A list, or a float that every YAML 1.1 reader recognises: with a point and a signed exponent."""
    if isinstance(value, list):
        return f"[{', '.join(map(_yaml, value))}]"
    text = repr(float(value))
    return text.replace("e", ".0e") if "e" in text and "." not in text else text


def export_matlab(subject: ExportInput) -> ExportResult:
    """A .mat file of version 5 with one struct ``rovid``."""
    keys = _field_names(subject)
    values = _base_parameters(subject) | {
        "equation": _EQUATION,
        "axes": _AXES,
        "thrusters": _cells(_thrusters(subject)),
        "effects": {keys[key]: values for key, values in subject.effects.items()},
    }
    content, read = mat_file(values, subject.guess)
    effects = {key: {name: read["effects"][keys[key]][name] for name in own} for key, own in subject.effects.items()}
    return _result(subject, content, read, effects)


def mat_file(values: Mapping[str, Any], guess: Assumptions) -> tuple[bytes, Any]:
    """Content of a .mat file of version 5 with one struct ``rovid``, and the struct as read back from it."""
    from scipy.io import loadmat, savemat

    stream: Any = io.BytesIO()
    savemat(stream, {"rovid": values}, oned_as="column", long_field_names=True)
    # The file begins with 116 bytes of text.
    title = f"MATLAB 5.0 MAT-file. {export_mark('matlab')}. {guess.file_notice}".ljust(116)
    content = title.encode() + stream.getvalue()[116:]
    written: Any = io.BytesIO(content)
    return content, loadmat(written, simplify_cells=True)["rovid"]


def export_json(subject: ExportInput) -> ExportResult:
    """All numbers with units and standard errors, and the equations of the effects."""
    entries: dict[str, dict[str, Any]] = {}
    for name, entry in subject.entries.items():
        entries[name] = {"value": entry.value, "standard_error": entry.standard_error, "unit": entry.unit}
    entries.setdefault("linear_drag", {"value": 0.0, "standard_error": None, "unit": "N m s/rad"})
    effects = []
    for effect in subject.model.effects:
        own = {parameter.name: entries[f"{effect.key}.{parameter.name}"] for parameter in effect.parameters}
        effects.append({"key": effect.key, "equation": effect.equation, "parameters": own})
    document = {
        "schema": "rovid-model/1",
        "vehicle": subject.vehicle.name,
        "equation": _EQUATION,
        "axes": _AXES,
        "parameters": {name: value for name, value in entries.items() if "." not in name},
        "rigid_body_inertia": subject.vehicle.rigid_body_inertia,
        "thrusters": _thrusters(subject),
        "effects": effects,
        "guessed": list(subject.guess.items),
    }
    content = to_json(document) + "\n"
    read = json.loads(content)
    base = {name: read["parameters"][name]["value"] for name in _BASE}
    values = {one["key"]: {name: own["value"] for name, own in one["parameters"].items()} for one in read["effects"]}
    return _result(subject, content, base, values)


def _field_names(subject: ExportInput) -> dict[str, str]:
    """Key of each effect -> name of a field."""
    return dict(zip(subject.effects, identifiers(list(subject.effects)), strict=True))


def _base_parameters(subject: ExportInput) -> dict[str, Any]:
    """Inertia and drag by name, in SI."""
    model = subject.model
    inertias = {"rigid_body_inertia": subject.rigid_inertia, "added_inertia": subject.added_inertia}
    return {"inertia": model.inertia, **inertias} | {name: getattr(model, name) for name in _BASE[1:]}


def _result(subject: ExportInput, content: str | bytes, base: Mapping[str, Any], effects: EffectValues) -> ExportResult:
    """The result, with rovid's equation and the numbers as read back from the file."""
    values = [value for one in subject.model.effects for value in effects[one.key].values()]
    read = Model.from_values([*(base[name] for name in _BASE), *values], YAW, subject.model.effects)
    return ExportResult(
        content=content,
        simulate=lambda commands: subject.motion(read, commands),
        equation=subject.equation(STEP, **subject.drag_terms),
        kept_effects=frozenset(subject.effects),
        notes=(_NOTE, STEP_NOTE),
    )


EQUATION = (
    "M*nu' + C(nu)*nu + linear*nu + quadratic*|nu|*nu = tau + couplings; nu = (u, v, r) through the water, C of M"
)
_PLANAR_AXES = (
    "x ahead, y to starboard, yaw clockwise from above (NED); SI units and radians; SNAME signs of derivatives."
)


def export_planar_json(subject: PlanarInput) -> ExportResult:
    """All numbers with units, standard errors and SNAME names, and the equations of the effects."""
    names, values = subject.model.names, subject.model.values.tolist()
    entries: dict[str, dict[str, Any]] = {}
    for name, value in zip(names, values, strict=True):
        entry = subject.entries.get(name)
        error = None if entry is None or not np.isfinite(entry.standard_error) else entry.standard_error
        entries[name] = {"value": value, "standard_error": error, "unit": unit_of(name), "assumed": entry is None}
        if name in SNAME:
            entries[name]["sname"] = SNAME[name]
    document = {
        "schema": "rovid-planar-model/1",
        "vehicle": subject.vehicle.name,
        "equation": EQUATION,
        "axes": _PLANAR_AXES,
        "parameters": entries,
        "mass_matrix": subject.model.mass_matrix.tolist(),
        "rigid_body": {"mass": subject.vehicle.mass, "inertia": subject.vehicle.rigid_body_inertia},
        "current": dict(zip(("north", "east"), subject.model.current, strict=True)),
        "thrusters": _thrusters(subject),
        "rudders": _rudders(subject),
        "effects": [{"key": one.effect.key, "equation": one.effect.equation} for one in subject.model.effects],
        "guessed": list(subject.guess.items),
    }
    content = to_json(document) + "\n"
    read = json.loads(content)["parameters"]
    return _planar_result(subject, content, {name: float(read[name]["value"]) for name in names})


def export_planar_ros2(subject: PlanarInput) -> ExportResult:
    """Parameters of any ROS 2 node in YAML; colons in names become underscores."""
    names = ", ".join(toml_text(one["name"]) for one in _thrusters(subject))
    lines = [f"# {export_mark('ros2')}.", f"# {EQUATION}", f"# {_PLANAR_AXES}", "/**:", "  ros__parameters:"]
    groups: dict[str, dict[str, float]] = {}
    for name, value in zip(subject.model.names, subject.model.values.tolist(), strict=True):
        group, _, last = name.rpartition(".")
        groups.setdefault(group, {})[last] = value
    for key, (group, values) in zip(identifiers(list(groups)), groups.items(), strict=True):
        lines += [f"    # {group}"] * (key != group) + [f"    {key}:", *yaml_lines("      ", values)]
    lines += yaml_lines("    ", {"mass_matrix": subject.model.mass_matrix.ravel().tolist()})
    lines.append(f"    thruster_names: [{names}]")
    for kind, blocks in (("thruster", _thrusters(subject)), ("rudder", _rudders(subject))):
        for index, one in enumerate(blocks):
            words = [f"      {key}: {toml_text(value)}" for key, value in one.items() if isinstance(value, str)]
            numbers = {key: value for key, value in one.items() if not isinstance(value, str)}
            lines += [f"    {kind}_{index}:", *words, *yaml_lines("      ", numbers)]
    return _planar_result(subject, "\n".join(lines) + "\n", None)


def export_planar_matlab(subject: PlanarInput) -> ExportResult:
    """A .mat file of version 5 with one struct ``rovid``, and in it the matrices of MSS."""
    linear, _, _ = subject.damping
    keys = dict(zip(subject.model.names, identifiers(list(subject.model.names)), strict=True))
    document = {
        "equation": EQUATION,
        "axes": _PLANAR_AXES,
        "parameters": dict(zip(keys.values(), subject.model.values.tolist(), strict=True)),
        "M": subject.model.mass_matrix,
        "D": linear,
        "Dn": np.diag(subject.model.base[7:10]),
        "current": np.array(subject.model.current),
        "thrusters": _cells(_thrusters(subject)),
        "rudders": _cells(_rudders(subject)),
        "effects": [one.effect.equation for one in subject.model.effects],
    }
    content, written = mat_file(document, subject.guess)
    read = written["parameters"]
    return _planar_result(subject, content, {name: float(read[keys[name]]) for name in subject.model.names})


def _cells(blocks: list[dict[str, Any]]) -> np.ndarray[Any, Any]:
    """A cell array of structs."""
    cells = np.empty(len(blocks), dtype=object)
    for at, one in enumerate(blocks):
        cells[at] = {key: value if isinstance(value, str) else np.array(value) for key, value in one.items()}
    return cells


def _rudders(subject: PlanarInput) -> list[dict[str, Any]]:
    """Numbers of each rudder, as in `rovid.planar.model`; in m, rad, N s^2/(m^2 rad) and m^2/(s^2 N)."""
    return [
        {
            "name": one.name,
            "behind": known.behind,
            "position": list(one.position),
            "lift": one.lift,
            "slipstream": one.slipstream,
            "stall": one.stall,
            "resistance": 1.0 if one.resistance is None else one.resistance,
            "straightening": 1.0 if one.straightening is None else one.straightening,
            "asymmetry": one.asymmetry,
        }
        for one, known in zip(subject.model.rudders, subject.actuators.rudders, strict=True)
    ]


def _thrusters(subject: ExportInput | PlanarInput) -> list[dict[str, Any]]:
    """Name, levers and bench curve of each thruster, and of one that turns its position and the name of its angle.

    A logged torque is its own curve.
    """
    found, (vehicle, limits) = [], subject.thrusters
    angles = {one.turns: one.name for one in subject.vehicle.thrusters if one.turns}
    for one, ends in zip(vehicle.thrusters, limits, strict=True):
        command, thrust = (ends, ends) if one.curve is None else (one.curve.command, one.curve.thrust)
        shares = {"surge": one.surge_share, "sway": one.sway_share} if isinstance(subject, PlanarInput) else {}
        curve = {"command": command.tolist(), "thrust": thrust.tolist()}
        block = {"name": one.name, **shares, "yaw_arm": one.arm, **curve}
        if one.name in angles and one.position is not None:
            block |= {"azimuth": angles[one.name], "position": list(one.position)}
        found.append(block)
    return found


def _planar_result(subject: PlanarInput, content: str | bytes, read: Mapping[str, float] | None) -> ExportResult:
    """The result, with the numbers as read back from the file."""
    model = subject.model
    if read is not None:
        model = model.with_values(np.array([read[name] for name in model.names]))
    acting = [one.effect.key for one in model.actuator_effects]
    notes = [f"{_PLANAR_AXES} In a z-up frame sway, yaw rate and the levers of both change sign, the matrices do not."]
    if acting:
        notes.append(f"{', '.join(acting)} act between command and thrust: the reader implements them.")
    notes.append(STEP_NOTE)
    return ExportResult(
        content=content,
        equation=subject.own_equation(STEP),
        simulate=lambda commands: subject.motion(model, commands),
        kept_effects=frozenset(subject.effects),
        keeps_angles=True,
        notes=tuple(notes),
    )
