"""The coupled model in rovid's own equation: JSON, ROS 2 parameters, and a MATLAB struct with the matrices of MSS.

MSS (Fossen's Marine Systems Simulator) takes M, D and Coriolis matrices as m2c(M, nu) makes them; the struct has M, D
and the quadratic damping as diagonal, in its axes (NED, starboard and clockwise positive).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from rovid.core.formatting import identifiers, to_json, toml_text
from rovid.core.output_files import export_mark
from rovid.effects.base import Coupling, WaterCurrent
from rovid.export.body_equation import BodyEquation, Scheme
from rovid.export.planar_input import PlanarExportResult, PlanarInput, rovid_motion
from rovid.export.rovid_equation import STEP, STEP_NOTE, mat_file, yaml_lines
from rovid.model.parameter_names import unit_of
from rovid.planar.model import SNAME

EQUATION = (
    "M*nu' + C(nu)*nu + linear*nu + quadratic*|nu|*nu = tau + couplings; nu = (u, v, r) through the water, C of M"
)
_AXES = "x ahead, y to starboard, yaw clockwise from above (NED); SI units and radians; SNAME signs of derivatives."


def own_equation(subject: PlanarInput, step: float) -> BodyEquation:
    """Rovid's equation with a Runge-Kutta step of ``step`` s."""
    linear, absolute, _ = subject.damping
    return BodyEquation(
        mass=subject.model.mass_matrix,
        linear=linear,
        absolute=absolute,
        current=np.array(subject.model.current),
        coefficients=subject.model.coefficients,
        step=step,
        scheme=Scheme.RUNGE_KUTTA,
    )


def export_json(subject: PlanarInput) -> PlanarExportResult:
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
        "axes": _AXES,
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
    return _result(subject, content, {name: float(read[name]["value"]) for name in names})


def export_ros2(subject: PlanarInput) -> PlanarExportResult:
    """Parameters of any ROS 2 node in YAML; colons in names become underscores."""
    names = ", ".join(toml_text(one["name"]) for one in _thrusters(subject))
    lines = [f"# {export_mark('ros2')}.", f"# {EQUATION}", f"# {_AXES}", "/**:", "  ros__parameters:"]
    groups: dict[str, dict[str, float]] = {}
    for name, value in zip(subject.model.names, subject.model.values.tolist(), strict=True):
        group, _, last = name.rpartition(".")
        groups.setdefault(group, {})[last] = value
    for key, (group, values) in zip(identifiers(list(groups)), groups.items(), strict=True):
        lines += [f"    # {group}"] * (key != group) + [f"    {key}:", *yaml_lines("      ", values)]
    lines += [*yaml_lines("    ", {"mass_matrix": subject.model.mass_matrix.ravel().tolist()})]
    lines.append(f"    thruster_names: [{names}]")
    for kind, blocks in (("thruster", _thrusters(subject)), ("rudder", _rudders(subject))):
        for index, one in enumerate(blocks):
            words = [f"      {key}: {toml_text(value)}" for key, value in one.items() if isinstance(value, str)]
            numbers = {key: value for key, value in one.items() if not isinstance(value, str)}
            lines += [f"    {kind}_{index}:", *words, *yaml_lines("      ", numbers)]
    return _result(subject, "\n".join(lines) + "\n", None)


def export_matlab(subject: PlanarInput) -> PlanarExportResult:
    """A .mat file of version 5 with one struct ``rovid``, and in it the matrices of MSS."""
    linear, _, _ = subject.damping
    keys = dict(zip(subject.model.names, identifiers(list(subject.model.names)), strict=True))
    document = {
        "equation": EQUATION,
        "axes": _AXES,
        "parameters": {keys[name]: value for name, value in _values(subject).items()},
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
    return _result(subject, content, {name: float(read[keys[name]]) for name in subject.model.names})


def _values(subject: PlanarInput) -> dict[str, float]:
    return dict(zip(subject.model.names, subject.model.values.tolist(), strict=True))


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
        }
        for one, known in zip(subject.model.rudders, subject.actuators.rudders, strict=True)
    ]


def _thrusters(subject: PlanarInput) -> list[dict[str, Any]]:
    """Name, levers and bench curve of each thruster, and of one that turns its position and the name of its angle."""
    found = []
    angles = {one.turns: one.name for one in subject.actuators.angles.thrusters if one.turns}
    ends = subject.commands[subject.actuators.thruster_columns]
    for one, limits in zip(subject.actuators.thrusters.thrusters, ends, strict=True):
        command, thrust = (limits, limits) if one.curve is None else (one.curve.command, one.curve.thrust)
        levers = {"surge": one.surge_share, "sway": one.sway_share, "yaw_arm": one.arm}
        block = {"name": one.name, **levers, "command": command.tolist(), "thrust": thrust.tolist()}
        if one.name in angles and one.position is not None:
            block |= {"azimuth": angles[one.name], "position": list(one.position)}
        found.append(block)
    return found


def _result(subject: PlanarInput, content: str | bytes, read: Mapping[str, float] | None) -> PlanarExportResult:
    """The result, with the numbers as read back from the file."""
    model = subject.model
    if read is not None:
        model = model.with_values(np.array([read[name] for name in model.names]))
    acting = [one.effect.key for one in model.effects if not isinstance(one.effect.acts, Coupling | WaterCurrent)]
    notes = [f"{_AXES} In a z-up frame sway, yaw rate and the levers of both change sign, the matrices do not."]
    if acting:
        notes.append(f"{', '.join(acting)} act between command and thrust: the reader implements them.")
    notes.append(STEP_NOTE)
    return PlanarExportResult(
        content=content,
        equation=own_equation(subject, STEP),
        simulate=lambda commands: rovid_motion(subject, model, commands),
        kept_effects=frozenset(subject.effects),
        keeps_angles=True,
        notes=tuple(notes),
    )
