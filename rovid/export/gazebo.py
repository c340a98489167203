"""Gazebo: models in SDF for gz-sim and VRX, and a xacro for uuv_simulator.

Axes are FLU, z up: sway and yaw have the opposite signs of rovid's.

gz-sim with DART, from its sources: <fluid_added_mass> joins the link's spatial inertia, Coriolis forces included, at
velocities over ground. Hydrodynamics adds the force sum of (<yV> + <yVabsU>*|u| + …)*v over all pairs, at velocities
through the water; the names are the axis in lower case, then the velocities in upper case, and the numbers negative for
damping. <nRR> is the term without absolute value.

VRX, from its sources: the torque is -(nR + nRR*|r|)*r - nDotR*rdot, limited to max_effort, with rdot of the step
before. An added inertia as large as the rigid body's makes that loop diverge, a smaller one adds a lag: the link has
the whole inertia. There are no terms off the diagonal, and no Coriolis force: its matrix is computed but not applied.

uuv_simulator, from its sources: the torque is -Ma*a + (linear_damping + quadratic_damping*|r|)*r, with positive added
mass and negative damping; a is the acceleration of the step before through a filter of weight 0.3. A thruster is a lag
of the command (FirstOrder) in front of a conversion (LinearInterp). Of the coupled model it has the Coriolis force of
the whole added-mass matrix and full linear damping, all through the water.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import shortened_list
from rovid.core.formatting import TextTemplates, identifiers, xml_comment
from rovid.core.output_files import export_mark
from rovid.effects.actuator_inputs import actuator_inputs
from rovid.export.body_equation import BodyEquation, Scheme
from rovid.export.interface import ExportInput, ExportResult, simulation
from rovid.export.planar_input import PlanarInput
from rovid.export.thruster_curves import ThrusterUnit, curve_comment, number_list, thruster_inputs
from rovid.trial.trial import Trial

_TEXTS = TextTemplates(__file__, "gazebo")

_NEWTONS = (
    "Thruster takes newtons, on the topics {}: convert commands by the curves in the comments, which hold the effects "
    "of the curve."
)
# s, integration steps of gz-sim with DART (semi-implicit Euler) and of VRX's worlds.
_GZ_STEP, _VRX_STEP = 0.001, 0.004
# VRX: default limit of a hydrodynamic force in N or torque in N m, and its limit relative to the largest drag in logs.
_EFFORT, _EFFORT_FACTOR = 10_000.0, 10.0
# kg/m^3, density of fresh water.
_WATER = 1000.0
# Number of points of a curve behind a dead band.
_POINTS = 20001
_ROWS, _VELOCITIES = "xyn", "UVR"
_PLANAR_GZ = (
    "The added mass stands in <fluid_added_mass>, which DART alone honours, with its Coriolis forces and the Munk "
    "moment; <xDotU>, <yDotV>, <nDotR> of the plugin would count it twice."
)
_PLANAR_VRX = (
    "The added mass stands in <fluid_added_mass> of the link, with its Coriolis forces and the Munk moment. <xDotU>, "
    "<yDotV>, <nDotR> are 0: VRX takes the acceleration of the step before and no Coriolis force."
)
_DEFAULTS = "What is not written keeps SimpleHydrodynamics' defaults, which are not zero ({}): set your own."


def export_gz_sim(subject: ExportInput) -> ExportResult:
    """A model in SDF for gz-sim with DART."""
    model = subject.model
    terms = {"nR": -model.linear_drag, "nRabsR": -model.quadratic_drag}
    notes = (
        "The added inertia stands in <fluid_added_mass>, which DART alone honours; <nDotR> would count it twice.",
        "<nRabsR> needs a gz-sim that has it (its pull request 1888); older ones give <nR> the opposite sign.",
    )
    equation = subject.equation(_GZ_STEP, Scheme.BODY_EULER)
    added = {"rr": subject.added_inertia}
    return _model("gz-sim", subject, subject.rigid_inertia, added, terms, equation, notes)


def export_planar_gz_sim(subject: PlanarInput) -> ExportResult:
    """A model of surge, sway and yaw in SDF for gz-sim with DART."""
    linear, absolute, kept = subject.damping
    terms: dict[str, float | str] = {}
    for i, row in enumerate(_ROWS):
        for j, first in enumerate(_VELOCITIES):
            terms[f"{row}{first}"] = -linear[i, j]
            for k, second in enumerate(_VELOCITIES):
                terms[f"{row}{first}abs{second}"] = -absolute[i, j, k]
    terms = {name: value for name, value in terms.items() if value}
    north, east = subject.model.current
    losses, notes = [], [_PLANAR_GZ, "<xUabsU> and its like need a gz-sim that has them (its pull request 1888)."]
    if north or east:
        terms["default_current"] = f"{east:.10g} {north:.10g} 0"
        kept |= {"current"} & subject.effects.keys()
        losses.append(("current", "DART's added mass acts at velocities over ground, not through the water"))
        notes.append("<default_current> is in ENU axes: start the model with a yaw of 90 deg less the heading.")
    damping = {"linear": linear, "absolute": absolute}
    equation = subject.equation(
        _GZ_STEP, Scheme.BODY_EULER, **damping, current=np.array([north, east]), inertia_in_water=False
    )
    made = _model("gz-sim", subject, subject.rigid_inertia, _added_mass(subject), terms, equation, notes)
    return replace(made, kept_effects=made.kept_effects | kept, base_losses=losses)


def export_vrx(subject: ExportInput) -> ExportResult:
    """A model in SDF for VRX on gz-sim."""
    model = subject.model
    effort = max(_EFFORT, _EFFORT_FACTOR * float(model.drag(np.array(subject.largest_rate))))
    terms = {"nDotR": 0.0, "nR": model.linear_drag, "nRR": model.quadratic_drag, "max_effort": effort}
    ratio = subject.added_inertia / subject.rigid_inertia
    note = (
        "The whole inertia is the link's and <nDotR> 0: VRX takes the acceleration of the step before, which lags and, "
        f"with an added inertia beyond the body's (here {ratio:.2g} times it), diverges."
    )
    notes = (note, _DEFAULTS.format("xU, yV 20"))
    return _model("vrx", subject, model.inertia, {}, terms, subject.equation(_VRX_STEP, Scheme.BODY_EULER), notes)


def export_planar_vrx(subject: PlanarInput) -> ExportResult:
    """A model of surge, sway and yaw in SDF for VRX on gz-sim."""
    base = subject.model.base
    largest = np.max(base[4:7] * subject.envelope + base[7:10] * subject.envelope**2)
    still = dict.fromkeys(("xDotU", "yDotV", "nDotR"), 0.0)
    drags = dict(zip(("xU", "xUU", "yV", "yVV", "nR", "nRR"), base[[4, 7, 5, 8, 6, 9]].tolist(), strict=True))
    terms = still | drags | {"max_effort": max(_EFFORT, _EFFORT_FACTOR * float(largest))}
    notes = (_PLANAR_VRX, _DEFAULTS.format("zW, kP, mQ 20"))
    equation = subject.equation(_VRX_STEP, Scheme.BODY_EULER)
    return _model("vrx", subject, subject.rigid_inertia, _added_mass(subject), terms, equation, notes)


def _added_mass(subject: PlanarInput) -> dict[str, float]:
    """Added mass by the names of SDF; products of sway and yaw keep their sign in FLU axes."""
    mass, inertia = subject.mass, subject.model.mass_matrix
    xx, yy, yr, rr = inertia[0, 0] - mass, inertia[1, 1] - mass, inertia[1, 2], inertia[2, 2] - subject.rigid_inertia
    return {name: value for name, value in {"xx": xx, "yy": yy, "yr": yr, "rr": rr}.items() if value}


def _model(
    name: str,
    subject: ExportInput | PlanarInput,
    izz: float,
    added: Mapping[str, float],
    terms: Mapping[str, float | str],
    equation: BodyEquation,
    notes: Sequence[str],
) -> ExportResult:
    """An SDF model with one link, its thrusters, ``added`` masses, and ``terms`` of the hydrodynamics of ``name``."""
    units, thrusters, topics = [], "", []
    vehicle, _ = subject.thrusters
    names = [one.name for one in vehicle.thrusters]
    (name_in_topics,) = identifiers(["_".join(re.findall(r"[A-Za-z0-9]+", vehicle.name))])
    for unit in subject.units:
        band = _deadband_thrust(subject, names.index(unit.curve.name))
        units.append(_with_deadband(unit, band))
        if unit.curve.side or isinstance(subject, PlanarInput):
            place, direction = unit.flu
            topics.append(f"/model/{name_in_topics}/joint/{unit.curve.identifier}_joint/cmd_thrust")
            thrusters += _TEXTS["thruster"].format(
                comment=curve_comment(unit.curve),
                name=unit.curve.identifier,
                place=place,
                direction=direction,
                most=max(float(unit.curve.thrust.max()), 0.0),
                least=min(float(unit.curve.thrust.min()), 0.0),
                deadband=f"\n      <deadband>{band:.10g}</deadband>" if band > 0.0 else "",
            )
    fluid = "".join(f"<{key}>{value:.10g}</{key}>" for key, value in added.items())
    lines = [f"      <{key}>{one if isinstance(one, str) else f'{one:.10g}'}</{key}>\n" for key, one in terms.items()]
    sinks = _TEXTS["sinks"].format(volume=subject.mass / _WATER, system=_TEXTS[f"buoyancy_{name}"])
    content = _TEXTS["model"].format(
        sinks=sinks,
        mark=export_mark(name),
        words=xml_comment(vehicle.name),
        title=subject.title,
        name=f'"{name_in_topics}"',
        mass=subject.mass,
        izz=izz,
        fluid=f"<fluid_added_mass>{fluid}</fluid_added_mass>" if fluid else "",
        plugin=_TEXTS[name],
        terms="".join(lines),
        thrusters=thrusters,
    )
    return ExportResult(
        content=content,
        simulate=simulation(subject, equation, units),
        equation=equation,
        kept_effects=subject.curve_keys,
        notes=(sinks, *subject.frame_notes, *[_NEWTONS.format(shortened_list(topics))] * bool(topics), *notes),
    )


def _deadband_thrust(subject: ExportInput | PlanarInput, index: int) -> float:
    """Thrust in N at the edge of a thruster's dead band, if thrust sets in with a jump; else 0."""
    values = subject.effects.get("thruster_deadband:jump")
    if values is None:
        return 0.0
    vehicle, _ = subject.thrusters
    where = actuator_inputs(vehicle, Trial.from_commands(np.zeros(1), np.zeros((1, len(vehicle.thrusters)))))
    # The smaller thrust of both directions, half a ramp before the threshold: no thrust of the curve is lost.
    size = np.full(len(where.names), (1.0 - 0.5 * values["edge"]) * values["deadband"])
    ends = [vehicle.thrust(where.from_excess(sign * size)[None])[0, index] for sign in (1.0, -1.0)]
    return min(abs(float(end)) for end in ends)


def _with_deadband(unit: ThrusterUnit, band: float) -> ThrusterUnit:
    """The thruster without thrusts below ``band`` in N."""
    if band <= 0.0:
        return unit
    curve = unit.curve
    command = np.union1d(curve.command, np.linspace(curve.command[0], curve.command[-1], _POINTS))
    thrust = curve(command)
    return unit._replace(curve=replace(curve, command=command, thrust=np.where(np.abs(thrust) < band, 0.0, thrust)))


_UUV_TEXTS = TextTemplates(__file__, "uuv")

_UUV_STEP = 0.002  # s, of uuv_simulator's worlds
_FILTER = 0.3
# Share of the range. The filtered acceleration is late by 1/0.3 steps. With the added share of the inertia in it, the
# rate is off by at most 1/e of delay over settling time. Above this limit the added inertia joins the rigid one.
_VISIBLE = 3e-4
# Ratio of added to rigid inertia. The loop through the acceleration of the step before is stable for
# 0.7 - 0.3*ratio > -1; half of that ratio is safe.
_STABLE = 2.8


def export_uuv(subject: ExportInput) -> ExportResult:
    """A xacro for uuv_simulator."""
    body, added, equation, note = _split_inertia(subject)
    drags = [f"0 0 0 0 0 {-drag:.10g}" for drag in (subject.model.linear_drag, subject.model.quadratic_drag)]
    added_mass = "            0 0 0 0 0 0\n" * 5 + f"            0 0 0 0 0 {added:.10g}"
    return _robot(subject, equation, (subject.mass, body), (added_mass, *drags), frozenset(), [note])


def export_planar_uuv(subject: PlanarInput) -> ExportResult:
    """A xacro of surge, sway and yaw for uuv_simulator."""
    inertia, base = subject.model.mass_matrix, subject.model.base
    # As much of the inertia as one mass can have is the body's: the rest acts late, through the filter.
    mass, izz = float(min(inertia[0, 0], inertia[1, 1])), float(inertia[2, 2])
    body, (linear, _) = np.diag([mass, mass, izz]), subject.own_damping
    kept = frozenset({"sway_yaw_damping", "current"} & subject.effects.keys())
    if "sway_yaw_damping" in kept:
        linear, _, _ = subject.damping
    north, east = subject.model.current
    equation = subject.equation(
        _UUV_STEP,
        Scheme.WORLD_EULER,
        mass=body,
        lagged=inertia - body,
        linear=linear,
        filter_weight=_FILTER,
        current=np.array([north, east]),
    )
    notes = ["Of surge and sway, the part that exceeds the smaller one is added mass."]
    if north or east:
        text = "The current is not part of the model: set it with the service hydrodynamics/set_current_velocity, "
        text += f"{math.hypot(north, east):.4g} m/s towards {math.degrees(math.atan2(east, north)):.4g} deg from north."
        notes.append(text)
    damping = f"\n{_six_by_six(-linear)}\n          "
    matrices = _six_by_six(inertia - body), damping, f"{-base[7]:.10g} {-base[8]:.10g} 0 0 0 {-base[9]:.10g}"
    return _robot(subject, equation, (mass, izz), matrices, kept, notes)


def _robot(
    subject: ExportInput | PlanarInput,
    equation: BodyEquation,
    masses: tuple[float, float],
    matrices: Sequence[str],
    kept: frozenset[str],
    notes: list[str],
) -> ExportResult:
    """The robot with ``masses``, kg and kg m^2 in yaw, and 6 x 6 added mass, linear and quadratic damping."""
    lag = subject.lag
    inputs, input_note = thruster_inputs([unit.curve for unit in subject.units], lag)
    name, thrusters = identifiers([subject.vehicle.name])[0].lower(), ""
    dynamics = "<type>ZeroOrder</type>"
    if lag.time_constant > 0.0:
        dynamics = f"<type>FirstOrder</type><timeConstant>{lag.time_constant:.10g}</timeConstant>"
    for index, (unit, curve) in enumerate(zip(subject.units, inputs, strict=True)):
        if unit.curve.side or isinstance(subject, PlanarInput):
            thrusters += _UUV_TEXTS["thruster"].format(
                comment=curve_comment(unit.curve),
                link=f"{name}/thruster_{index}",
                place=f"{unit.flu[0]} 0",
                direction=-unit.direction,
                name=name,
                index=index,
                dynamics=dynamics,
                commands=number_list(curve.command),
                thrusts=number_list(curve.thrust),
            )
    mass, izz = masses
    added, linear, quadratic = matrices
    return ExportResult(
        content=_UUV_TEXTS["robot"].format(
            mark=export_mark("uuv"),
            title=subject.title[:1].upper() + subject.title[1:],
            name=name,
            mass=mass,
            izz=izz,
            added=added,
            linear=linear,
            quadratic=quadratic,
            thrusters=thrusters,
        ),
        simulate=simulation(subject, equation, lag=lag),
        equation=equation,
        kept_effects=kept | subject.curve_keys | ({lag.key} & subject.effects.keys()),
        notes=(*subject.frame_notes, *notes, input_note),
    )


def export_uuv_yaml(subject: ExportInput) -> ExportResult:
    """Model of uuv_simulator's controllers, without thrusters."""
    model = subject.model
    body, added, equation, note = _split_inertia(subject)
    lines = [
        f"# {export_mark('uuv')}.",
        "# Yaw identified by rovid; z up, a yaw rate is minus the heading's. Only the yaw entries are known.",
        f"mass: {subject.mass:.10g}",
        "inertial:",
        f"  izz: {body:.10g}",
        "Ma:",
        *["  - [0, 0, 0, 0, 0, 0]"] * 5,
        f"  - [0, 0, 0, 0, 0, {added:.10g}]",
        f"linear_damping: [0, 0, 0, 0, 0, {-model.linear_drag:.10g}]",
        f"quad_damping: [0, 0, 0, 0, 0, {-model.quadratic_drag:.10g}]",
        "",
    ]
    return ExportResult(
        content="\n".join(lines),
        simulate=simulation(subject, equation),
        equation=equation,
        kept_effects=subject.curve_keys,
        notes=(*subject.frame_notes, note, "The controllers' model takes forces: a thruster manager has the curves."),
    )


def _split_inertia(subject: ExportInput) -> tuple[float, float, BodyEquation, str]:
    """Yaw inertia in kg m^2 of the link and of <added_mass>, the equation with them, and a note."""
    body, added = subject.rigid_inertia, subject.added_inertia
    late = _UUV_STEP / _FILTER * added / subject.model.inertia / subject.settling_time / math.e
    note = "The added inertia stands in <added_mass>, the body's in <inertia>."
    if added > _STABLE * body or late >= _VISIBLE:
        body, added = subject.model.inertia, 0.0
        note = (
            "The whole inertia is the link's and the yaw entry of <added_mass> 0: the plugin filters the acceleration "
            f"of the step before, which would put the rate off by {100.0 * late:.2g} % or diverge."
        )
    equation = subject.equation(_UUV_STEP, Scheme.WORLD_EULER, inertia=body, added=added, filter_weight=_FILTER)
    return body, added, equation, note


def _six_by_six(matrix: FloatArray) -> str:
    """36 numbers of a (3, 3) matrix of surge, sway and yaw, row by row."""
    whole = np.zeros((6, 6))
    whole[np.ix_((0, 1, 5), (0, 1, 5))] = matrix
    return "\n".join("            " + number_list(row + 0.0) for row in whole)
