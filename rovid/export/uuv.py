"""uuv_simulator: a xacro with its plugins for underwater objects and thrusters, or, as .yaml, its controllers' model.

From its sources: the torque is -Ma*a + (linear_damping + quadratic_damping*|r|)*r, with positive added mass and
negative damping; a is the acceleration of the step before through a filter of weight 0.3. A thruster is a lag of the
command (FirstOrder) in front of a conversion (LinearInterp). Axes are FLU, z up: the yaw rate is minus rovid's. Of the
coupled model it has the Coriolis force of the whole added-mass matrix and full linear damping, all through the water.
"""

import math
from collections.abc import Sequence

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.formatting import TextTemplates, identifiers
from rovid.core.output_files import export_mark
from rovid.export.body_equation import BodyEquation, Scheme
from rovid.export.interface import ExportInput, ExportResult
from rovid.export.planar_input import PlanarInput
from rovid.export.resimulation import simulation
from rovid.export.thruster_curves import curve_comment, number_list, thruster_inputs

_TEXTS = TextTemplates(__file__, "uuv")

_STEP = 0.002  # s, of uuv_simulator's worlds
_FILTER = 0.3
# Share of the range. The filtered acceleration is late by 1/0.3 steps. With the added share of the inertia in it, the
# rate is off by at most 1/e of delay over settling time. Above this limit the added inertia joins the rigid one.
_VISIBLE = 3e-4
# Ratio of added to rigid inertia. The loop through the acceleration of the step before is stable for
# 0.7 - 0.3*ratio > -1; half of that ratio is safe.
_STABLE = 2.8


def export(subject: ExportInput) -> ExportResult:
    """A xacro for uuv_simulator."""
    body, added, equation, note = _split_inertia(subject)
    drags = [f"0 0 0 0 0 {-drag:.10g}" for drag in (subject.model.linear_drag, subject.model.quadratic_drag)]
    added_mass = "            0 0 0 0 0 0\n" * 5 + f"            0 0 0 0 0 {added:.10g}"
    return _robot(subject, equation, (subject.mass, body), (added_mass, *drags), frozenset(), [note])


def export_planar(subject: PlanarInput) -> ExportResult:
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
        _STEP,
        Scheme.WORLD_EULER,
        mass=body,
        lagged=inertia - body,
        linear=linear,
        filter_weight=_FILTER,
        current=np.array([north, east]),
    )
    notes = ["Of surge and sway, the part that exceeds the smaller one is added mass."]
    if north or east:
        notes.append(
            "The current is not part of the model: set it with the service hydrodynamics/set_current_velocity, "
            f"{math.hypot(north, east):.4g} m/s towards {math.degrees(math.atan2(east, north)):.4g} deg from north."
        )
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
            thrusters += _TEXTS["thruster"].format(
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
        content=_TEXTS["robot"].format(
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


def export_yaml(subject: ExportInput) -> ExportResult:
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
    late = _STEP / _FILTER * added / subject.model.inertia / subject.settling_time / math.e
    note = "The added inertia stands in <added_mass>, the body's in <inertia>."
    if added > _STABLE * body or late >= _VISIBLE:
        body, added = subject.model.inertia, 0.0
        note = (
            "The whole inertia is the link's and the yaw entry of <added_mass> 0: the plugin filters the acceleration "
            f"of the step before, which would put the rate off by {100.0 * late:.2g} % or diverge."
        )
    equation = subject.equation(_STEP, Scheme.WORLD_EULER, inertia=body, added=added, filter_weight=_FILTER)
    return body, added, equation, note


def _six_by_six(matrix: FloatArray) -> str:
    """36 numbers of a (3, 3) matrix of surge, sway and yaw, row by row."""
    whole = np.zeros((6, 6))
    whole[np.ix_((0, 1, 5), (0, 1, 5))] = matrix
    return "\n".join("            " + number_list(row + 0.0) for row in whole)
