"""MuJoCo: a hinge about z in MJCF, for MuJoCo 3.7 or newer, whose joint damping may be a polynomial.

As in its engine, damping="a b c" opposes the motion with a*v + b*|v|*v + c*v^3. An actuator lags by dyntype
"filterexact", waits by its delay, and exerts a constant torque by an affine bias. z is up: the yaw rate is minus
rovid's.
"""

from __future__ import annotations

import math

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.escaping import xml_attribute
from rovid.core.signatures import export_mark
from rovid.export.interface import ExportInput, ExportResult
from rovid.export.resimulation import first_order_lag, integrate_rate, repeat_held
from rovid.export.thruster_curves import curve_effect_keys, number_list, thruster_curves

_STEP = 0.002  # s, MuJoCo's default
# Effects that an actuator or the joint represents.
_KEPT = {"thruster_lag", "command_delay", "drag_curvature", "bias_torque", "tether_torsion"}


def export(subject: ExportInput) -> ExportResult:
    """A hinge with damping, and one actuator for each thruster, whose control is the steady thrust in N."""
    model, curves = subject.model, thruster_curves(subject)
    lag, delay = subject.value("thruster_lag", "time_constant"), subject.value("command_delay", "delay")
    cubic, stiffness = subject.value("drag_curvature", "cubic"), subject.value("tether_torsion", "stiffness")
    bias = -subject.value("bias_torque", "torque")
    dynamics = ""
    if lag > 0.0:
        dynamics += f' dyntype="filterexact" dynprm="{lag:.10g}"'
    if delay > 0.0:
        dynamics += f' delay="{delay:.10g}" nsample="{math.ceil(delay / _STEP) + 2}" interp="zoh"'
    actuators, tables = [], []
    for curve in curves:
        name = curve.identifier
        actuators.append(f'    <general name="{name}" joint="yaw" gear="{-curve.arm:.10g}"{dynamics}/>')
        tables.append(f'    <numeric name="{name}_command" data="{number_list(curve.command)}"/>')
        tables.append(f'    <numeric name="{name}_thrust" data="{number_list(curve.thrust)}"/>')
    if bias:
        actuators.append(
            f'    <general name="bias_torque" joint="yaw" gainprm="0" biastype="affine" biasprm="{bias:.10g} 0 0"/>'
        )
    damping = number_list(np.array([model.linear_drag, model.quadratic_drag, cubic]))
    spring = f' stiffness="{stiffness:.10g}"' if stiffness else ""
    content = f"""<mujoco model={xml_attribute(subject.vehicle.name)}>
  <!-- {export_mark("mujoco")}. Yaw identified by rovid; z up, a yaw rate is minus the heading's. -->
  <option timestep="{_STEP:g}" gravity="0 0 0" integrator="implicitfast"/>
  <custom>
{chr(10).join(tables)}
  </custom>
  <worldbody>
    <body name="base_link">
      <joint name="yaw" type="hinge" axis="0 0 1" damping="{damping}"{spring}/>
      <inertial pos="0 0 0" mass="{subject.mass:.10g}" diaginertia="{number_list(np.full(3, model.inertia))}"/>
    </body>
  </worldbody>
  <actuator>
{chr(10).join(actuators)}
  </actuator>
</mujoco>
"""

    def advance(rate: float, angle: float, torque: float) -> float:
        size = abs(rate)
        drag = (model.linear_drag + (model.quadratic_drag + cubic * size) * size) * rate
        total = torque + bias - drag
        slope = model.linear_drag + (2.0 * model.quadratic_drag + 3.0 * cubic * size) * size
        # implicitfast: one Newton step of the velocity-dependent forces.
        return rate + _STEP * (total - stiffness * angle) / (model.inertia + _STEP * slope)

    def simulate(commands: FloatArray) -> FloatArray:
        wait = round(delay / _STEP)
        torque = np.zeros(len(repeat_held(commands, _STEP)))
        for curve, command in zip(curves, commands.T, strict=True):
            thrust = repeat_held(curve(command), _STEP)
            late = np.concatenate([np.full(wait, thrust[0]), thrust])[: len(thrust)]
            torque -= curve.arm * first_order_lag(late, lag, _STEP)
        return -integrate_rate(torque, advance, _STEP)

    return ExportResult(
        content=content,
        simulate=simulate,
        kept_effects=curve_effect_keys(subject) | (_KEPT & subject.effects.keys()),
        notes=(
            "z is up: a yaw rate there is minus rovid's, which grows with the heading.",
            "Needs MuJoCo 3.7 or newer: an older one refuses a damping of more than one number.",
            "Controls are steady thrusts in N; the curves in <custom> turn commands into them.",
            "The whole inertia is the body's; its other axes, and the mass where not known, are stand-ins.",
        ),
    )
