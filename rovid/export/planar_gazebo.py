"""The coupled model for gz-sim, VRX and uuv_simulator, in FLU axes: sway and yaw have the opposite signs of rovid's.

gz-sim with DART, from its sources: <fluid_added_mass> joins the link's spatial inertia, Coriolis forces included, at
velocities over ground. Hydrodynamics adds the force sum of (<yV> + <yVabsU>*|u| + …)*v over all pairs, at velocities
through the water; the names are the axis in lower case, then the velocities in upper case. SimpleHydrodynamics of VRX
has the diagonal alone, with the opposite sign, and no Coriolis force (its matrix is computed but not applied).
uuv_simulator: the added mass times the filtered acceleration of the step before, Coriolis force of the whole
added-mass matrix, full linear damping, all at velocities through the water.
"""

import math

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.formatting import identifiers
from rovid.export import gazebo
from rovid.export.body_equation import BodyEquation, Scheme
from rovid.export.planar_input import PlanarExportResult, PlanarInput, frame_notes, simulation
from rovid.export.thruster_curves import thruster_inputs, thruster_lag
from rovid.export.uuv import FILTER, thruster_joint, xacro
from rovid.export.uuv import STEP as UUV_STEP

_ROWS, _VELOCITIES = "xyn", "UVR"
_FLU = "Axes are FLU, z up: sway and yaw rate there are minus rovid's."


def export_gz_sim(subject: PlanarInput) -> PlanarExportResult:
    """A model in SDF for gz-sim with DART."""
    linear, absolute, kept = subject.damping
    terms = []
    for i, row in enumerate(_ROWS):
        for j, first in enumerate(_VELOCITIES):
            if linear[i, j]:
                terms.append(f"      <{row}{first}>{-linear[i, j]:.10g}</{row}{first}>\n")
            for k, second in enumerate(_VELOCITIES):
                name = f"{row}{first}abs{second}"
                if absolute[i, j, k]:
                    terms.append(f"      <{name}>{-absolute[i, j, k]:.10g}</{name}>\n")
    north, east = subject.model.current
    losses = []
    if north or east:
        terms.append(f"      <default_current>{east:.10g} {north:.10g} 0</default_current>\n")
        kept |= {key for key in subject.effects if key == "current"}
        losses.append(("current", "DART's added mass acts at velocities over ground, not through the water"))
    plugin = f"""    <plugin filename="gz-sim-hydrodynamics-system" name="gz::sim::systems::Hydrodynamics">
      <link_name>base_link</link_name>
{"".join(terms)}    </plugin>"""
    equation = BodyEquation(
        mass=subject.model.mass_matrix,
        linear=linear,
        absolute=absolute,
        current=np.array([north, east]),
        inertia_in_water=False,
        step=gazebo.GZ_STEP,
        scheme=Scheme.BODY_EULER,
    )
    notes = (
        (
            "The added mass stands in <fluid_added_mass>, which DART alone honours, with its Coriolis forces and the "
            "Munk moment; <xDotU>, <yDotV>, <nDotR> of the plugin would count it twice."
        ),
        "<xUabsU> and its like need a gz-sim that has them (its pull request 1888).",
        *(
            ["<default_current> is in ENU axes: start the model with a yaw of 90 deg less the heading."]
            if losses
            else []
        ),
    )
    return _sdf("gz-sim", subject, plugin, equation, kept, tuple(losses), notes)


def export_vrx(subject: PlanarInput) -> PlanarExportResult:
    """A model in SDF for VRX on gz-sim."""
    base = subject.model.base
    linear, absolute = subject.own_damping
    largest = np.max(base[4:7] * subject.envelope + base[7:10] * subject.envelope**2)
    effort = max(gazebo.EFFORT, gazebo.EFFORT_FACTOR * float(largest))
    names = (("xU", 4), ("xUU", 7), ("yV", 5), ("yVV", 8), ("nR", 6), ("nRR", 9))
    drags = "".join(f"      <{name}>{base[at]:.10g}</{name}>\n" for name, at in names)
    plugin = f"""    <plugin filename="libSimpleHydrodynamics.so" name="vrx::SimpleHydrodynamics">
      <link_name>base_link</link_name>
      <xDotU>0</xDotU>
      <yDotV>0</yDotV>
      <nDotR>0</nDotR>
{drags}      <max_effort>{effort:.10g}</max_effort>
    </plugin>"""
    equation = BodyEquation(
        mass=subject.model.mass_matrix, linear=linear, absolute=absolute, step=gazebo.VRX_STEP, scheme=Scheme.BODY_EULER
    )
    notes = (
        (
            "The added mass stands in <fluid_added_mass> of the link, with its Coriolis forces and the Munk moment. "
            "<xDotU>, <yDotV>, <nDotR> are 0: VRX takes the acceleration of the step before and no Coriolis force."
        ),
        "What is not written keeps SimpleHydrodynamics' defaults, which are not zero (zW, kP, mQ 20): set your own.",
    )
    return _sdf("vrx", subject, plugin, equation, frozenset(), (), notes)


def _sdf(
    name: str,
    subject: PlanarInput,
    plugin: str,
    equation: BodyEquation,
    kept: frozenset[str],
    losses: tuple[tuple[str, str], ...],
    notes: tuple[str, ...],
) -> PlanarExportResult:
    own = [one.name for one in subject.actuators.thrusters.thrusters]
    units, thrusters = [], []
    for unit in subject.units:
        band = gazebo.deadband_thrust(subject.thrusters, own.index(unit.curve.name))
        units.append(unit._replace(curve=gazebo.with_deadband(unit.curve, band)))
        direction = f"{math.cos(unit.direction):.10g} {-math.sin(unit.direction):.10g}"
        thrusters.append(gazebo.thruster_xml(unit.curve, band, f"{unit.x:.10g} {-unit.y:.10g}", direction))
    mass, izz, inertia = subject.mass, subject.rigid_inertia, subject.model.mass_matrix
    # Products of sway and yaw keep their sign in FLU axes.
    added = {"xx": inertia[0, 0] - mass, "yy": inertia[1, 1] - mass, "yr": inertia[1, 2], "rr": inertia[2, 2] - izz}
    fluid = "".join(f"<{key}>{value:.10g}</{key}>" for key, value in added.items() if value)
    content = gazebo.sdf(
        name,
        subject.vehicle.name,
        "surge, sway and yaw identified by rovid; FLU axes, z up",
        (mass, izz),
        f"<fluid_added_mass>{fluid}</fluid_added_mass>",
        f"{plugin}\n{''.join(thrusters)}",
    )
    return PlanarExportResult(
        content=content,
        equation=equation,
        simulate=simulation(subject, equation, units),
        kept_effects=kept | subject.curve_keys,
        base_losses=losses,
        notes=(_FLU, *frame_notes(subject), gazebo.NEWTONS, *notes),
    )


def export_uuv(subject: PlanarInput) -> PlanarExportResult:
    """A xacro for uuv_simulator."""
    inertia = subject.model.mass_matrix
    # As much of the inertia as one mass can have is the body's: the rest acts late, through the filter.
    mass, izz = float(min(inertia[0, 0], inertia[1, 1])), float(inertia[2, 2])
    body = np.diag([mass, mass, izz])
    added = inertia - body
    linear, absolute = subject.own_damping
    every_linear, _, kept = subject.damping
    kept &= {"sway_yaw_damping"}
    if kept:
        linear = every_linear
    base = subject.model.base
    north, east = subject.model.current
    kept |= {key for key in subject.effects if key == "current"}
    lag = thruster_lag(subject.thrusters)
    equation = BodyEquation(
        mass=body,
        lagged=added,
        filter_weight=FILTER,
        linear=linear,
        absolute=absolute,
        current=np.array([north, east]),
        step=UUV_STEP,
        scheme=Scheme.WORLD_EULER,
    )
    notes = [_FLU, *frame_notes(subject), "Of surge and sway, the part that exceeds the smaller one is added mass."]
    curves, input_note = thruster_inputs([unit.curve for unit in subject.units], lag)
    notes.append(input_note)
    if north or east:
        notes.append(
            "The current is not part of the model: set it with the service hydrodynamics/set_current_velocity, "
            f"{math.hypot(north, east):.4g} m/s towards {math.degrees(math.atan2(east, north)):.4g} deg from north."
        )
    name = identifiers([subject.vehicle.name])[0].lower()
    joints = ""
    for index, (unit, curve) in enumerate(zip(subject.units, curves, strict=True)):
        place = f"{unit.x:.10g} {-unit.y:.10g} 0"
        joints += thruster_joint(name, index, curve, unit.curve, lag.time_constant, place, -unit.direction)
    content = xacro(
        name,
        "Surge, sway and yaw identified by rovid; FLU axes, z up",
        (mass, izz),
        _six_by_six(added),
        (f"\n{_six_by_six(-linear)}\n          ", f"{-base[7]:.10g} {-base[8]:.10g} 0 0 0 {-base[9]:.10g}"),
        joints,
    )
    return PlanarExportResult(
        content=content,
        equation=equation,
        simulate=simulation(subject, equation, subject.units, lag),
        kept_effects=kept | subject.curve_keys | (subject.effects.keys() & {lag.key}),
        notes=tuple(notes),
    )


def _six_by_six(matrix: FloatArray) -> str:
    """36 numbers of a (3, 3) matrix of surge, sway and yaw, row by row."""
    whole = np.zeros((6, 6))
    whole[np.ix_((0, 1, 5), (0, 1, 5))] = matrix
    return "\n".join("            " + " ".join(f"{value:.10g}" for value in row + 0.0) for row in whole)
