"""MuJoCo 3.7 or newer in MJCF: a hinge about z, or two slides and a hinge for the coupled model."""

import math
from collections.abc import Sequence

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.formatting import TextTemplates, xml_attribute
from rovid.core.output_files import export_mark
from rovid.export.body_equation import Scheme
from rovid.export.interface import ExportInput, ExportResult
from rovid.export.planar_input import PlanarInput
from rovid.export.thruster_curves import THRUST_LAG, ThrusterCurve, ThrusterLag, number_list
from rovid.export.verification import simulation

_TEXTS = TextTemplates(__file__, "mujoco")

STEP = 0.002  # s, MuJoCo's default
# Effects that an actuator or the joint represents.
_KEPT = {"thruster_lag", "command_delay", "drag_curvature", "bias_torque", "tether_torsion"}
_NOTES = (
    "Needs MuJoCo 3.7 or newer: an older one refuses a damping of more than one number.",
    "Controls are steady thrusts in N; the curves in <custom> turn commands into them.",
)


def export(subject: ExportInput) -> ExportResult:
    """A hinge with damping, and one actuator for each thruster, whose control is the steady thrust in N."""
    model, curves = subject.model, subject.curves
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
    content = _model(subject, curves, body, actuators)
    equation = subject.equation(STEP, Scheme.WORLD_IMPLICIT, bias=-bias, cubic=cubic, stiffness=stiffness)

    return ExportResult(
        content=content,
        simulate=simulation(subject, equation, lag=ThrusterLag(lag, THRUST_LAG), delay=delay),
        equation=equation,
        kept_effects=subject.curve_keys | (_KEPT & subject.effects.keys()),
        notes=(
            "z is up: a yaw rate there is minus rovid's, which grows with the heading.",
            *_NOTES,
            "The whole inertia is the body's; its other axes, and the mass where not known, are stand-ins.",
        ),
    )


def _model(
    subject: ExportInput | PlanarInput, curves: Sequence[ThrusterCurve], body: Sequence[str], actuators: Sequence[str]
) -> str:
    """A model of one body with the thrust curves as tables; ``body`` and ``actuators`` are lines of XML."""
    tables = [
        f'    <numeric name="{curve.identifier}_{kind}" data="{number_list(values)}"/>'
        for curve in curves
        for kind, values in (("command", curve.command), ("thrust", curve.thrust))
    ]
    return _TEXTS["model"].format(
        name=xml_attribute(subject.vehicle.name),
        mark=export_mark("mujoco"),
        title=subject.title[:1].upper() + subject.title[1:],
        STEP=STEP,
        tables="\n".join(tables),
        body="\n".join(body),
        actuators="\n".join(actuators),
    )


_SPEEDS = 200  # number of speeds in the fit of the drag


def export_planar(subject: PlanarInput) -> ExportResult:
    """A body on planar joints; the control of each actuator is the steady thrust in N."""
    base, bias = subject.model.base, subject.bias
    drags = [_linear_drag(base[4 + axis], base[7 + axis], float(subject.envelope[axis])) for axis in (0, 1)]
    linear, absolute = np.diag([drags[0], drags[1], base[6]]), np.zeros((3, 3, 3))
    absolute[2, 2, 2] = base[9]
    lag = subject.value("thruster_lag", "time_constant")
    mass = 0.5 * float(base[0] + base[1])
    ahead = float(base[3]) / mass
    izz = float(base[2]) - mass * ahead**2
    if izz <= 0.0:
        ahead, izz = 0.0, float(base[2])
    inertia = np.array([[mass, 0.0, 0.0], [0.0, mass, mass * ahead], [0.0, mass * ahead, izz + mass * ahead**2]])
    terms = {"mass": inertia, "linear": linear, "absolute": absolute, "constant": bias}
    equation = subject.equation(STEP, Scheme.WORLD_IMPLICIT, **terms)
    dynamics = f' dyntype="filterexact" dynprm="{lag:.10g}"' if lag else ""
    sites, actuators = [], []
    for unit in subject.units:
        name = unit.curve.identifier
        place, direction = unit.flu
        sites.append(f'      <site name="{name}_site" pos="{place} 0"/>')
        actuators.append(f'    <general name="{name}" site="{name}_site" gear="{direction} 0 0 0 0"{dynamics}/>')
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
    content = _model(subject, [unit.curve for unit in subject.units], body, actuators)
    losses = []
    if abs(base[0] - base[1]) > 1e-3 * mass:
        why = f"a body has one mass: the mean, {mass:.4g} kg, stands for {base[0]:.4g} ahead and {base[1]:.4g} sideways"
        losses.append(("surge.inertia, sway.inertia", f"{why}; the Munk moment is missing"))
    if base[7] or base[8]:
        why = "dampers in body axes are linear: fitted to the drag up to the largest speeds in the logs"
        losses.append(("surge.quadratic_drag, sway.quadratic_drag", why))
    return ExportResult(
        content=content,
        equation=equation,
        simulate=simulation(subject, equation, lag=ThrusterLag(lag, THRUST_LAG)),
        kept_effects=subject.curve_keys | (subject.effects.keys() & {"bias_torque:planar", THRUST_LAG}),
        base_losses=losses,
        notes=("z is up: sway and yaw rate there are minus rovid's.", *_NOTES),
    )


def _linear_drag(linear: float, quadratic: float, largest: float) -> float:
    """Linear coefficient in N s/m by least squares of the drag up to the ``largest`` speed."""
    speeds: FloatArray = np.linspace(0.0, largest, _SPEEDS)
    wanted = (linear + quadratic * speeds) * speeds
    return float(speeds @ wanted / max(float(speeds @ speeds), 1e-12))
