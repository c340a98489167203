"""uuv_simulator: a xacro with its plugins for underwater objects and thrusters, or, as .yaml, its controllers' model.

From its sources: the torque is -Ma*a + (linear_damping + quadratic_damping*|r|)*r, with positive added mass and
negative damping; a is the acceleration of the step before through a filter of weight 0.3. A thruster is a lag of the
command (FirstOrder) in front of a conversion (LinearInterp). Axes are FLU, z up: the yaw rate is minus rovid's.
"""

import math

from rovid.core.formatting import TextTemplates, identifiers
from rovid.core.output_files import export_mark
from rovid.export.body_equation import BodyEquation, Scheme
from rovid.export.gazebo import frame_notes
from rovid.export.interface import ExportInput, ExportResult
from rovid.export.resimulation import equation_rate, settling_time, thrust_torque
from rovid.export.thruster_curves import (
    ThrusterCurve,
    curve_comment,
    curve_effect_keys,
    number_list,
    thruster_curves,
    thruster_inputs,
    thruster_lag,
)

_TEXTS = TextTemplates(__file__, "uuv")

STEP = 0.002  # s, of uuv_simulator's worlds
FILTER = 0.3
# Share of the range. The filtered acceleration is late by 1/0.3 steps. With the added share of the inertia in it, the
# rate is off by at most 1/e of delay over settling time. Above this limit the added inertia joins the rigid one.
_VISIBLE = 3e-4
# Ratio of added to rigid inertia. The loop through the acceleration of the step before is stable for
# 0.7 - 0.3*ratio > -1; half of that ratio is safe.
_STABLE = 2.8


def export(subject: ExportInput) -> ExportResult:
    """A xacro for uuv_simulator."""
    body, added, equation, note = _split_inertia(subject)
    lag, curves = thruster_lag(subject), thruster_curves(subject)
    inputs, input_note = thruster_inputs(curves, lag)
    name = identifiers([subject.vehicle.name])[0].lower()
    thrusters = ""
    for index, (curve, table) in enumerate(zip(inputs, curves, strict=True)):
        if curve.side:
            x, direction = curve.place
            angle = direction * math.pi / 2.0
            thrusters += thruster_joint(name, index, curve, table, lag.time_constant, f"{x:.10g} 0 0", angle)
    model = subject.model
    content = xacro(
        name,
        "Yaw identified by rovid; z up, a yaw rate is minus the heading's",
        (subject.mass, body),
        "            0 0 0 0 0 0\n" * 5 + f"            0 0 0 0 0 {added:.10g}",
        (f"0 0 0 0 0 {-model.linear_drag:.10g}", f"0 0 0 0 0 {-model.quadratic_drag:.10g}"),
        thrusters,
    )
    return ExportResult(
        content=content,
        simulate=lambda commands: equation_rate(equation, thrust_torque(curves, commands, STEP, lag)),
        equation=equation,
        kept_effects=curve_effect_keys(subject) | (subject.effects.keys() & {lag.key}),
        notes=(*frame_notes(subject), note, input_note),
    )


def export_yaml(subject: ExportInput) -> ExportResult:
    """Model of uuv_simulator's controllers, without thrusters."""
    model, curves = subject.model, thruster_curves(subject)
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
        simulate=lambda commands: equation_rate(equation, thrust_torque(curves, commands, STEP)),
        equation=equation,
        kept_effects=curve_effect_keys(subject),
        notes=(*frame_notes(subject), note, "The controllers' model takes forces: a thruster manager has the curves."),
    )


def _split_inertia(subject: ExportInput) -> tuple[float, float, BodyEquation, str]:
    """Yaw inertia in kg m^2 of the link and of <added_mass>, the equation with them, and a note."""
    body, added = subject.rigid_inertia, subject.added_inertia
    late = STEP / FILTER * added / subject.model.inertia / settling_time(subject) / math.e
    note = "The added inertia stands in <added_mass>, the body's in <inertia>."
    if added > _STABLE * body or late >= _VISIBLE:
        body, added = subject.model.inertia, 0.0
        note = (
            "The whole inertia is the link's and the yaw entry of <added_mass> 0: the plugin filters the acceleration "
            f"of the step before, which would put the rate off by {100.0 * late:.2g} % or diverge."
        )
    equation = subject.equation(STEP, Scheme.WORLD_EULER, inertia=body, added=added, filter_weight=FILTER)
    return body, added, equation, note


def xacro(
    name: str, title: str, masses: tuple[float, float], added: str, drags: tuple[str, str], thrusters: str
) -> str:
    """A robot ``name`` with ``masses``, kg and kg m^2 in yaw, 6 x 6 ``added`` mass, linear and quadratic damping."""
    mass, izz = masses
    linear, quadratic = drags
    return _TEXTS["robot"].format(
        mark=export_mark("uuv"),
        title=title,
        name=name,
        mass=mass,
        izz=izz,
        added=added,
        linear=linear,
        quadratic=quadratic,
        thrusters=thrusters,
    )


def thruster_joint(
    name: str, index: int, curve: ThrusterCurve, table: ThrusterCurve, lag: float, place: str, direction: float
) -> str:
    """A thruster at ``place`` that pushes along ``direction`` in rad about z, in FLU axes."""
    link = f"{name}/thruster_{index}"
    dynamics = "<type>ZeroOrder</type>"
    if lag > 0:
        dynamics = f"<type>FirstOrder</type><timeConstant>{lag:.10g}</timeConstant>"
    return _TEXTS["thruster"].format(
        comment=curve_comment(table),
        link=link,
        place=place,
        direction=direction,
        name=name,
        index=index,
        dynamics=dynamics,
        commands=number_list(curve.command),
        thrusts=number_list(curve.thrust),
    )
