"""gz-sim: a model in SDF with the Hydrodynamics and Thruster systems.

Signs from gz-sim's sources: the torque on the link is (nR + nRabsR*|r|)*r, so that damping is negative; <nRR> is the
term without absolute value, which feeds a rotation one way. The axes are FLU, z up: the yaw rate is minus rovid's.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.escaping import xml_attribute, xml_comment
from rovid.core.signatures import export_mark
from rovid.effects.actuator_inputs import ActuatorInputs, actuator_inputs
from rovid.export.curves import ThrusterCurve, curve_comment, curve_effect_keys, thruster_curves
from rovid.export.export_input import ExportInput
from rovid.export.export_result import ExportResult
from rovid.export.resimulation import integrate_rate, thrust_torque
from rovid.trial.trial import Trial

NEWTONS = "Thruster takes newtons: the curves in the file turn commands into them, effects of the curve included."
_STEP = 0.001  # s, gz-sim's default; DART steps a rate by semi-implicit Euler


def export(subject: ExportInput) -> ExportResult:
    """A model in SDF for gz-sim with DART."""
    model, propulsion = subject.model, thruster_curves(subject)
    izz, added = subject.rigid_inertia, subject.added_inertia
    bands = [deadband_thrust(subject, index) for index in range(len(propulsion))]
    hydrodynamics = f"""    <plugin filename="gz-sim-hydrodynamics-system" name="gz::sim::systems::Hydrodynamics">
      <link_name>base_link</link_name>
      <nR>{-model.linear_drag:.10g}</nR>
      <nRabsR>{-model.quadratic_drag:.10g}</nRabsR>
    </plugin>"""
    fluid = f"<fluid_added_mass><rr>{added:.10g}</rr></fluid_added_mass>"
    content = sdf("gz-sim", subject, propulsion, bands, izz, fluid, hydrodynamics)

    def advance(rate: float, _: float, torque: float) -> float:
        drag = (-model.linear_drag - model.quadratic_drag * abs(rate)) * rate
        return rate + _STEP * (torque + drag) / (izz + added)

    return ExportResult(
        content=content,
        simulate=gazebo_simulator(propulsion, bands, advance, _STEP),
        kept_effects=curve_effect_keys(subject),
        notes=(
            *frame_notes(subject),
            NEWTONS,
            "The added inertia stands in <fluid_added_mass>, which DART alone honours; <nDotR> would count it twice.",
            "<nRabsR> needs a gz-sim that has it (its pull request 1888); older ones give <nR> the opposite sign.",
        ),
    )


def frame_notes(subject: ExportInput) -> tuple[str, ...]:
    """What was assumed of frames, inertia and places of thrusters in FLU axes."""
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
    """N below which a thruster gives nothing, where its thrust sets in at once; 0 elsewhere."""
    values = subject.effects.get("thruster_deadband:jump")
    if values is None:
        return 0.0
    still = Trial.from_commands(np.zeros(1), np.zeros((1, len(subject.vehicle.thrusters))))
    where: ActuatorInputs = actuator_inputs(subject.vehicle, still)
    # The smaller of both directions, a ramp's width short of the threshold: no thrust of the curve is lost.
    size = np.full(len(where.names), (1.0 - 0.5 * values["edge"]) * values["deadband"])
    ends = []
    for sign in (1.0, -1.0):
        command = where.from_excess(sign * size)
        thrust = subject.vehicle.thrust(command[None])
        ends.append(abs(float(thrust[0, index])))
    return min(ends)


def with_deadband(curve: ThrusterCurve, band: float) -> ThrusterCurve:
    """The curve behind a dead band in newtons."""
    if band <= 0.0:
        return curve
    fine = np.union1d(curve.command, np.linspace(curve.command[0], curve.command[-1], 20001))
    thrust = curve(fine)
    return replace(curve, command=fine, thrust=np.where(np.abs(thrust) < band, 0.0, thrust))


def gazebo_simulator(
    propulsion: list[ThrusterCurve], bands: list[float], advance: Callable[[float, float, float], float], step: float
) -> Callable[[FloatArray, float], FloatArray]:
    """Plant with Thruster systems and a rate stepped by ``advance`` in FLU axes."""
    behind = [with_deadband(curve, band) for curve, band in zip(propulsion, bands, strict=True)]

    def plant(commands: FloatArray, period: float) -> FloatArray:
        torque = -thrust_torque(behind, commands, period, step)
        return -integrate_rate(torque, round(period / step), advance, step)

    return plant


def sdf(
    name: str,
    subject: ExportInput,
    propulsion: list[ThrusterCurve],
    bands: list[float],
    izz: float,
    fluid: str,
    hydrodynamics: str,
) -> str:
    """An SDF model with one link, its thrusters and these hydrodynamics, for the format ``name``."""
    return f"""<?xml version="1.0"?>
<!-- {export_mark(name)}.
     {xml_comment(subject.vehicle.name)}: yaw identified by rovid; z up, a yaw rate is minus the heading's. -->
<sdf version="1.11">
  <model name={xml_attribute(subject.vehicle.name)}>
    <link name="base_link">
      <inertial>
        <mass>{subject.mass:.10g}</mass>
        <inertia><ixx>{izz:.10g}</ixx><iyy>{izz:.10g}</iyy><izz>{izz:.10g}</izz></inertia>
        {fluid}
      </inertial>
    </link>
{hydrodynamics}
{_thrusters(subject, propulsion, bands)}  </model>
</sdf>
"""


def _thrusters(subject: ExportInput, propulsion: Sequence[ThrusterCurve], bands: Sequence[float]) -> str:
    text = ""
    for index, thruster in enumerate(subject.vehicle.thrusters):
        # A logged torque has no thruster.
        if thruster.curve is not None:
            text += _thruster(propulsion[index], bands[index], side_of(index))
    return text


def side_of(index: int) -> float:
    """1 ahead and -1 astern, in turn: where thrusters stand is not known."""
    return 1.0 if index % 2 == 0 else -1.0


def place(curve: ThrusterCurve, side: float) -> tuple[float, float]:
    """Place on the x axis in m and direction along y, in FLU axes, that give minus arm * thrust about z."""
    return side * curve.arm, -side


def _thruster(curve: ThrusterCurve, band: float, side: float) -> str:
    name, (x, direction) = curve.identifier, place(curve, side)
    dead = f"\n      <deadband>{band:.10g}</deadband>" if band > 0.0 else ""
    return f"""    <!-- {curve_comment(curve)} -->
    <link name="{name}_link">
      <pose>{x:.10g} 0 0 0 0 0</pose>
      <inertial>
        <mass>1e-3</mass>
        <inertia><ixx>1e-6</ixx><iyy>1e-6</iyy><izz>1e-6</izz></inertia>
      </inertial>
    </link>
    <joint name="{name}_joint" type="revolute">
      <parent>base_link</parent>
      <child>{name}_link</child>
      <axis><xyz>0 {direction:g} 0</xyz></axis>
    </joint>
    <plugin filename="gz-sim-thruster-system" name="gz::sim::systems::Thruster">
      <joint_name>{name}_joint</joint_name>
      <use_angvel_cmd>false</use_angvel_cmd>
      <velocity_control>true</velocity_control>
      <max_thrust_cmd>{max(float(curve.thrust.max()), 0.0):.10g}</max_thrust_cmd>
      <min_thrust_cmd>{min(float(curve.thrust.min()), 0.0):.10g}</min_thrust_cmd>{dead}
    </plugin>
"""
