"""gz-sim and VRX: models in SDF with thrusters, and with the systems Hydrodynamics or SimpleHydrodynamics.

gz-sim, from its sources: the torque on the link is (nR + nRabsR*|r|)*r, with negative numbers for damping; <nRR> is the
term without absolute value. VRX, from its sources: the torque is -(nR + nRR*|r|)*r - nDotR*rdot, limited to max_effort,
with rdot of the step before. An added inertia as large as the rigid body's makes that loop diverge, a smaller one adds
a lag: the link has the whole inertia. Axes are FLU, z up: the yaw rate is minus rovid's.
"""

from dataclasses import replace

import numpy as np

from rovid.core.formatting import TextTemplates, xml_attribute, xml_comment
from rovid.core.output_files import export_mark
from rovid.effects.actuator_inputs import actuator_inputs
from rovid.export.body_equation import Scheme
from rovid.export.interface import ExportInput, ExportResult
from rovid.export.resimulation import equation_rate, thrust_torque
from rovid.export.thruster_curves import ThrusterCurve, curve_comment, curve_effect_keys, thruster_curves
from rovid.trial.trial import Trial

_TEXTS = TextTemplates(__file__, "gazebo")

NEWTONS = "Thruster takes newtons: convert commands by the curves in the comments, which hold the effects of the curve."
# s, integration steps of gz-sim with DART (semi-implicit Euler) and of VRX's worlds.
GZ_STEP, VRX_STEP = 0.001, 0.004
# VRX: default limit of a hydrodynamic force in N or torque in N m, and its limit relative to the largest drag in logs.
EFFORT, EFFORT_FACTOR = 10_000.0, 10.0
# Number of points of a curve behind a dead band.
_POINTS = 20001


def export_gz_sim(subject: ExportInput) -> ExportResult:
    """A model in SDF for gz-sim with DART."""
    model, body, added = subject.model, subject.rigid_inertia, subject.added_inertia
    hydrodynamics = f"""    <plugin filename="gz-sim-hydrodynamics-system" name="gz::sim::systems::Hydrodynamics">
      <link_name>base_link</link_name>
      <nR>{-model.linear_drag:.10g}</nR>
      <nRabsR>{-model.quadratic_drag:.10g}</nRabsR>
    </plugin>"""
    fluid = f"<fluid_added_mass><rr>{added:.10g}</rr></fluid_added_mass>"

    notes = (
        "The added inertia stands in <fluid_added_mass>, which DART alone honours; <nDotR> would count it twice.",
        "<nRabsR> needs a gz-sim that has it (its pull request 1888); older ones give <nR> the opposite sign.",
    )
    return _model("gz-sim", subject, body, fluid, hydrodynamics, GZ_STEP, notes)


def export_vrx(subject: ExportInput) -> ExportResult:
    """A model in SDF for VRX on gz-sim."""
    model = subject.model
    effort = max(EFFORT, EFFORT_FACTOR * float(model.drag(np.array(subject.largest_rate))))
    hydrodynamics = f"""    <plugin filename="libSimpleHydrodynamics.so" name="vrx::SimpleHydrodynamics">
      <link_name>base_link</link_name>
      <nDotR>0</nDotR>
      <nR>{model.linear_drag:.10g}</nR>
      <nRR>{model.quadratic_drag:.10g}</nRR>
      <max_effort>{effort:.10g}</max_effort>
    </plugin>"""

    ratio = subject.added_inertia / subject.rigid_inertia
    inertia_note = (
        "The whole inertia is the link's and <nDotR> 0: VRX takes the acceleration of the step before, which lags and, "
        f"with an added inertia beyond the body's (here {ratio:.2g} times it), diverges."
    )
    notes = (
        inertia_note,
        "What is not written keeps SimpleHydrodynamics' defaults, which are not zero (xU, yV 20): set your own.",
    )
    return _model("vrx", subject, model.inertia, "", hydrodynamics, VRX_STEP, notes)


def _model(
    name: str, subject: ExportInput, izz: float, fluid: str, hydrodynamics: str, step: float, notes: tuple[str, ...]
) -> ExportResult:
    """An SDF model with one link, its thrusters and these hydrodynamics, in steps of ``step`` s."""
    curves = thruster_curves(subject)
    bands = [deadband_thrust(subject, index) for index in range(len(curves))]
    thrusters = []
    for curve, band in zip(curves, bands, strict=True):
        x, side = curve.place
        if curve.side:
            thrusters.append(thruster_xml(curve, band, f"{x:.10g} 0", f"0 {side:g}"))
    content = sdf(
        name,
        subject.vehicle.name,
        "yaw identified by rovid; z up, a yaw rate is minus the heading's",
        (subject.mass, izz),
        fluid,
        f"{hydrodynamics}\n{''.join(thrusters)}",
    )
    banded = [with_deadband(curve, band) for curve, band in zip(curves, bands, strict=True)]
    equation = subject.equation(step, Scheme.BODY_EULER)
    return ExportResult(
        content=content,
        simulate=lambda commands: equation_rate(equation, thrust_torque(banded, commands, step)),
        equation=equation,
        kept_effects=curve_effect_keys(subject),
        notes=(*frame_notes(subject), NEWTONS, *notes),
    )


def sdf(name: str, vehicle: str, title: str, masses: tuple[float, float], fluid: str, plugins: str) -> str:
    """A model with one link, ``masses`` in kg and kg m^2 in yaw, and its ``fluid`` added mass, ``plugins`` included."""
    mass, izz = masses
    return _TEXTS["model"].format(
        mark=export_mark(name),
        words=xml_comment(vehicle),
        title=title,
        name=xml_attribute(vehicle),
        mass=mass,
        izz=izz,
        fluid=fluid,
        plugins=plugins,
    )


def frame_notes(subject: ExportInput) -> tuple[str, ...]:
    """Assumptions about inertia and thrusters in FLU axes."""
    rigid = subject.vehicle.rigid_body_inertia
    notes = ["Axes are FLU, z up: a yaw rate there is minus rovid's, which grows with the heading."]
    if rigid is None:
        notes.append("The rigid-body inertia is not known: the whole inertia is taken as the body's, added inertia 0.")
    elif rigid > subject.model.inertia:
        notes.append(
            f"The rigid-body inertia of [vehicle], {rigid:.4g} kg m^2, exceeds the identified "
            f"{subject.model.inertia:.4g} kg m^2: the whole is taken as the body's, added inertia 0."
        )
    if subject.vehicle.mass is None:
        notes.append("The mass is not known: 1 kg stands in its place.")
    notes.append("Roll, pitch and the other axes are not identified: their inertia is a stand-in, their drag missing.")
    if any(thruster.curve is not None for thruster in subject.vehicle.thrusters):
        notes.append(
            "Thrusters stand on the x axis at plus and minus their yaw arm in turn, pushing across: the yaw torque is "
            "right, the places are not known."
        )
    return tuple(notes)


def deadband_thrust(subject: ExportInput, index: int) -> float:
    """Thrust in N at the edge of a thruster's dead band, if thrust sets in with a jump; else 0."""
    values = subject.effects.get("thruster_deadband:jump")
    if values is None:
        return 0.0
    still = Trial.from_commands(np.zeros(1), np.zeros((1, len(subject.vehicle.thrusters))))
    where = actuator_inputs(subject.vehicle, still)
    # The smaller thrust of both directions, half a ramp before the threshold: no thrust of the curve is lost.
    size = np.full(len(where.names), (1.0 - 0.5 * values["edge"]) * values["deadband"])
    ends = [subject.vehicle.thrust(where.from_excess(sign * size)[None])[0, index] for sign in (1.0, -1.0)]
    return min(abs(float(end)) for end in ends)


def with_deadband(curve: ThrusterCurve, band: float) -> ThrusterCurve:
    """The curve without thrusts below ``band`` in N."""
    if band <= 0.0:
        return curve
    command = np.union1d(curve.command, np.linspace(curve.command[0], curve.command[-1], _POINTS))
    thrust = curve(command)
    return replace(curve, command=command, thrust=np.where(np.abs(thrust) < band, 0.0, thrust))


def thruster_xml(curve: ThrusterCurve, band: float, place: str, direction: str) -> str:
    """A thruster at ``place`` and along ``direction``, both as x and y in FLU axes; ``band`` in N."""
    name = curve.identifier
    deadband = f"\n      <deadband>{band:.10g}</deadband>" if band > 0.0 else ""
    return _TEXTS["thruster"].format(
        comment=curve_comment(curve),
        name=name,
        place=place,
        direction=direction,
        most=max(float(curve.thrust.max()), 0.0),
        least=min(float(curve.thrust.min()), 0.0),
        deadband=deadband,
    )
