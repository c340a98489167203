"""MuJoCo: a hinge about z in MJCF, for MuJoCo 3.7 or newer, whose joint damping may be a polynomial.

As in its engine, damping="a b c" opposes the motion with a*v + b*|v|*v + c*v^3. An actuator lags by dyntype
"filterexact", waits by its delay, and exerts a constant torque by an affine bias. z is up: the yaw rate is minus
rovid's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.formatting import xml_attribute
from rovid.core.output_files import export_mark
from rovid.export.body_equation import Scheme
from rovid.export.interface import ExportInput, ExportResult
from rovid.export.resimulation import equation_rate, first_order_lag, repeat_held
from rovid.export.thruster_curves import ThrusterCurve, curve_effect_keys, number_list, thruster_curves

STEP = 0.002  # s, MuJoCo's default
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
        dynamics += f' delay="{delay:.10g}" nsample="{math.ceil(delay / STEP) + 2}" interp="zoh"'
    actuators = [
        f'    <general name="{curve.identifier}" joint="yaw" gear="{-curve.arm:.10g}"{dynamics}/>' for curve in curves
    ]
    if bias:
        actuators.append(
            f'    <general name="bias_torque" joint="yaw" gainprm="0" biastype="affine" biasprm="{bias:.10g} 0 0"/>'
        )
    damping = number_list(np.array([model.linear_drag, model.quadratic_drag, cubic]))
    spring = f' stiffness="{stiffness:.10g}"' if stiffness else ""
    inertia = number_list(np.full(3, model.inertia))
    body = (
        f'      <joint name="yaw" type="hinge" axis="0 0 1" damping="{damping}"{spring}/>',
        f'      <inertial pos="0 0 0" mass="{subject.mass:.10g}" diaginertia="{inertia}"/>',
    )
    title = "Yaw identified by rovid; z up, a yaw rate is minus the heading's"
    content = mjcf(subject.vehicle.name, title, curves, body, actuators)

    equation = subject.equation(STEP, Scheme.WORLD_IMPLICIT, bias=-bias, cubic=cubic, stiffness=stiffness)

    def simulate(commands: FloatArray) -> FloatArray:
        wait = round(delay / STEP)
        torque = np.zeros(len(repeat_held(commands, STEP)))
        for curve, command in zip(curves, commands.T, strict=True):
            thrust = repeat_held(curve(command), STEP)
            late = np.concatenate([np.full(wait, thrust[0]), thrust])[: len(thrust)]
            torque += curve.arm * first_order_lag(late, lag, STEP)
        return equation_rate(equation, torque)

    return ExportResult(
        content=content,
        simulate=simulate,
        equation=equation,
        kept_effects=curve_effect_keys(subject) | (_KEPT & subject.effects.keys()),
        notes=(
            "z is up: a yaw rate there is minus rovid's, which grows with the heading.",
            "Needs MuJoCo 3.7 or newer: an older one refuses a damping of more than one number.",
            "Controls are steady thrusts in N; the curves in <custom> turn commands into them.",
            "The whole inertia is the body's; its other axes, and the mass where not known, are stand-ins.",
        ),
    )


def mjcf(
    vehicle: str, title: str, curves: Sequence[ThrusterCurve], body: Sequence[str], actuators: Sequence[str]
) -> str:
    """A model of one body with the thrust curves as tables; ``body`` and ``actuators`` are lines of XML."""
    tables = [
        f'    <numeric name="{curve.identifier}_{kind}" data="{number_list(values)}"/>'
        for curve in curves
        for kind, values in (("command", curve.command), ("thrust", curve.thrust))
    ]
    return f"""<mujoco model={xml_attribute(vehicle)}>
  <!-- {export_mark("mujoco")}. {title}. -->
  <option timestep="{STEP:g}" gravity="0 0 0" integrator="implicitfast"/>
  <custom>
{chr(10).join(tables)}
  </custom>
  <worldbody>
    <body name="base_link">
{chr(10).join(body)}
    </body>
  </worldbody>
  <actuator>
{chr(10).join(actuators)}
  </actuator>
</mujoco>
"""
