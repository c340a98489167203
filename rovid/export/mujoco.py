"""MuJoCo: a hinge about z in MJCF, for the engine from 3.7 on, whose joint damping may be a polynomial.

As its engine does: damping="a b c" opposes with a*v + b*|v|*v + c*v^3. An actuator lags by dyntype "filterexact",
waits by its delay, and pushes steadily by an affine bias. z is up: the yaw rate is minus rovid's.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.escaping import xml_attribute
from rovid.core.signatures import export_mark
from rovid.export.curves import ThrusterCurve, curve_effect_keys, number_list, thruster_curves
from rovid.export.export_input import ExportInput
from rovid.export.export_result import ExportResult
from rovid.export.resimulation import first_order_lag, integrate_rate, repeat_held

_STEP = 0.002  # s, MuJoCo's default
_ACTUATOR_EFFECTS = ("thruster_lag", "command_delay")
_JOINT_EFFECTS = ("drag_curvature", "bias_torque", "tether_torsion")


def export(subject: ExportInput) -> ExportResult:
    """A hinge with its damping and one actuator a thruster, whose control is the steady thrust in N."""
    held = frozenset(key for key in subject.effects if key in {*_ACTUATOR_EFFECTS, *_JOINT_EFFECTS})
    propulsion = thruster_curves(subject)
    return ExportResult(
        content=_mjcf(subject, propulsion),
        simulate=_plant(subject, propulsion),
        kept_effects=held | curve_effect_keys(subject),
        notes=(
            "z is up: a yaw rate there is minus rovid's, which grows with the heading.",
            "Needs MuJoCo 3.7 or newer: an older one refuses a damping of more than one number.",
            "Controls are steady thrusts in N; the curves in <custom> turn commands into them.",
            "The whole inertia is the body's; its other axes, and the mass where not known, are stand-ins.",
        ),
    )


def _value(subject: ExportInput, key: str, name: str) -> float:
    """A parameter of the effect ``key``; 0 where the model is without it."""
    return subject.effects.get(key, {}).get(name, 0.0)


def _mjcf(subject: ExportInput, propulsion: list[ThrusterCurve]) -> str:
    model = subject.model
    damping = np.array([model.linear_drag, model.quadratic_drag, _value(subject, "drag_curvature", "cubic")])
    stiffness = _value(subject, "tether_torsion", "stiffness")
    bias = -_value(subject, "bias_torque", "torque")
    dynamics = _dynamics(subject)
    actuators, tables = [], []
    for curve in propulsion:
        name = curve.identifier
        actuators.append(f'    <general name="{name}" joint="yaw" gear="{-curve.arm:.10g}"{dynamics}/>')
        tables.append(f'    <numeric name="{name}_command" data="{number_list(curve.command)}"/>')
        tables.append(f'    <numeric name="{name}_thrust" data="{number_list(curve.thrust)}"/>')
    if bias:
        actuators.append(
            f'    <general name="bias_torque" joint="yaw" gainprm="0" biastype="affine" biasprm="{bias:.10g} 0 0"/>'
        )
    joint = f'<joint name="yaw" type="hinge" axis="0 0 1" damping="{number_list(damping)}"'
    if stiffness:
        joint += f' stiffness="{stiffness:.10g}"'
    return f"""<mujoco model={xml_attribute(subject.vehicle.name)}>
  <!-- {export_mark("mujoco")}. Yaw identified by rovid; z up, a yaw rate is minus the heading's. -->
  <option timestep="{_STEP:g}" gravity="0 0 0" integrator="implicitfast"/>
  <custom>
{chr(10).join(tables)}
  </custom>
  <worldbody>
    <body name="base_link">
      {joint}/>
      <inertial pos="0 0 0" mass="{subject.mass:.10g}" diaginertia="{number_list(np.full(3, model.inertia))}"/>
    </body>
  </worldbody>
  <actuator>
{chr(10).join(actuators)}
  </actuator>
</mujoco>
"""


def _dynamics(subject: ExportInput) -> str:
    """Attributes of an actuator that lags and waits."""
    lag, delay = _value(subject, "thruster_lag", "time_constant"), _value(subject, "command_delay", "delay")
    dynamics = ""
    if lag > 0.0:
        dynamics += f' dyntype="filterexact" dynprm="{lag:.10g}"'
    if delay > 0.0:
        samples = math.ceil(delay / _STEP) + 2
        dynamics += f' delay="{delay:.10g}" nsample="{samples}" interp="zoh"'
    return dynamics


def _delayed(series: FloatArray, count: int) -> FloatArray:
    """``series`` later by ``count`` steps, the first value held until then."""
    return np.concatenate([np.full(count, series[0]), series])[: len(series)]


def _joint(subject: ExportInput) -> Callable[[float, float, float], float]:
    """From rate, angle and torque to the rate one step later, as the engine does it."""
    model = subject.model
    cubic, stiffness = _value(subject, "drag_curvature", "cubic"), _value(subject, "tether_torsion", "stiffness")
    bias = -_value(subject, "bias_torque", "torque")

    def advance(rate: float, angle: float, torque: float) -> float:
        size = abs(rate)
        drag = (model.linear_drag + (model.quadratic_drag + cubic * size) * size) * rate
        total = torque + bias - drag
        slope = model.linear_drag + (2.0 * model.quadratic_drag + 3.0 * cubic * size) * size
        # implicitfast: one Newton step of the velocity-dependent forces.
        return rate + _STEP * (total - stiffness * angle) / (model.inertia + _STEP * slope)

    return advance


def _plant(subject: ExportInput, propulsion: list[ThrusterCurve]) -> Callable[[FloatArray, float], FloatArray]:
    advance = _joint(subject)
    lag, delay = _value(subject, "thruster_lag", "time_constant"), _value(subject, "command_delay", "delay")
    wait = round(delay / _STEP)

    def plant(commands: FloatArray, period: float) -> FloatArray:
        torque = np.zeros(len(commands) * round(period / _STEP))
        for curve, command in zip(propulsion, commands.T, strict=True):
            late = _delayed(repeat_held(curve(command), period, _STEP), wait)
            torque -= curve.arm * first_order_lag(late, lag, _STEP)
        return -integrate_rate(torque, round(period / _STEP), advance, _STEP)

    return plant
