"""MuJoCo 3.7 or newer in MJCF: a hinge about z, or two slides and a hinge for the coupled model."""

import math
from collections.abc import Sequence

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.formatting import TextTemplates, xml_attribute
from rovid.core.output_files import export_mark
from rovid.export.body_equation import BodyEquation, Scheme
from rovid.export.interface import ExportInput, ExportResult
from rovid.export.planar_input import PlanarExportResult, PlanarInput, simulation
from rovid.export.resimulation import equation_rate, first_order_lag, repeat_held
from rovid.export.thruster_curves import (
    THRUST_LAG,
    ThrusterCurve,
    ThrusterLag,
    curve_effect_keys,
    number_list,
    thruster_curves,
)

_TEXTS = TextTemplates(__file__, "mujoco")

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
    return _TEXTS["model"].format(
        name=xml_attribute(vehicle),
        mark=export_mark("mujoco"),
        title=title,
        STEP=STEP,
        tables=chr(10).join(tables),
        body=chr(10).join(body),
        actuators=chr(10).join(actuators),
    )


_SPEEDS = 200  # number of speeds in the fit of the drag


def export_planar(subject: PlanarInput) -> PlanarExportResult:
    """A body on planar joints; the control of each actuator is the steady thrust in N."""
    base = subject.model.base
    drags = [_linear_drag(base[4 + axis], base[7 + axis], float(subject.envelope[axis])) for axis in (0, 1)]
    linear, absolute = np.diag([drags[0], drags[1], base[6]]), np.zeros((3, 3, 3))
    absolute[2, 2, 2] = base[9]
    bias = subject.bias
    lag_time = dict(subject.effects.get("thruster_lag", {})).get("time_constant", 0.0)
    lag = ThrusterLag(lag_time, THRUST_LAG if lag_time else "")
    mass = 0.5 * float(base[0] + base[1])
    ahead = float(base[3]) / mass
    izz = float(base[2]) - mass * ahead**2
    if izz <= 0.0:
        ahead, izz = 0.0, float(base[2])
    inertia = np.array([[mass, 0.0, 0.0], [0.0, mass, mass * ahead], [0.0, mass * ahead, izz + mass * ahead**2]])
    equation = BodyEquation(
        mass=inertia, linear=linear, absolute=absolute, constant=bias, step=STEP, scheme=Scheme.WORLD_IMPLICIT
    )
    dynamics = f' dyntype="filterexact" dynprm="{lag_time:.10g}"' if lag_time else ""
    sites, actuators = [], []
    for unit in subject.units:
        name = unit.curve.identifier
        turn = f"{math.cos(unit.direction):.10g} {-math.sin(unit.direction):.10g} 0 0 0 0"
        sites.append(f'      <site name="{name}_site" pos="{unit.x:.10g} {-unit.y:.10g} 0"/>')
        actuators.append(f'    <general name="{name}" site="{name}_site" gear="{turn}"{dynamics}/>')
    signs = (1.0, -1.0, -1.0)
    gears = ("1 0 0 0 0 0", "0 1 0 0 0 0", "0 0 0 0 0 1")
    for name, gear, drag, push, sign in zip(("surge", "sway", "yaw"), gears, (*drags, 0.0), bias, signs, strict=True):
        if drag or push:
            numbers = f"{sign * push + 0.0:.10g} 0 {-drag + 0.0:.10g}"
            fixed = 'gainprm="0" biastype="affine"'
            actuators.append(
                f'    <general name="{name}_drag" site="origin" gear="{gear}" {fixed} biasprm="{numbers}"/>'
            )
    body = (
        '      <joint name="x" type="slide" axis="1 0 0"/>',
        '      <joint name="y" type="slide" axis="0 1 0"/>',
        f'      <joint name="yaw" type="hinge" axis="0 0 1" damping="{number_list(base[[6, 9]])}"/>',
        f'      <inertial pos="{ahead:.10g} 0 0" mass="{mass:.10g}" diaginertia="{number_list(np.full(3, izz))}"/>',
        '      <site name="origin"/>',
        *sites,
    )
    title = "Surge, sway and yaw identified by rovid; z up: sway and yaw are minus rovid's"
    content = mjcf(subject.vehicle.name, title, [unit.curve for unit in subject.units], body, actuators)
    losses = []
    if abs(base[0] - base[1]) > 1e-3 * mass:
        why = f"a body has one mass: the mean, {mass:.4g} kg, stands for {base[0]:.4g} ahead and {base[1]:.4g} sideways"
        losses.append(("surge.inertia, sway.inertia", f"{why}; the Munk moment is missing"))
    if base[7] or base[8]:
        why = "dampers in body axes are linear: fitted to the drag up to the largest speeds in the logs"
        losses.append(("surge.quadratic_drag, sway.quadratic_drag", why))
    run = simulation(subject, equation, subject.units, lag)
    return PlanarExportResult(
        content=content,
        equation=equation,
        simulate=run,
        kept_effects=subject.curve_keys | (subject.effects.keys() & {"bias_torque:planar", lag.key}),
        base_losses=tuple(losses),
        notes=(
            "z is up: sway and yaw rate there are minus rovid's.",
            "Needs MuJoCo 3.7 or newer: an older one refuses a damping of more than one number.",
            "Controls are steady thrusts in N; the curves in <custom> turn commands into them.",
        ),
    )


def _linear_drag(linear: float, quadratic: float, largest: float) -> float:
    """Linear coefficient in N s/m by least squares of the drag up to the ``largest`` speed."""
    speeds: FloatArray = np.linspace(0.0, largest, _SPEEDS)
    wanted = (linear + quadratic * speeds) * speeds
    return float(speeds @ wanted / max(float(speeds @ speeds), 1e-12))
