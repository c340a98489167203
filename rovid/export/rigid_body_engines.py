"""Stonefish and MuJoCo: a vehicle for the rigid-body engine of each.

Stonefish: a robot in a scenario, with drag by coefficients of integrals over its mesh.

From Stonefish's sources of 2024 and 2025 (1.3 to 1.5): over the faces of the physical mesh, `quadratic_drag` multiplies
rho/2 * sum((r x v)_z |v| (-v.n) A), cubic in the rate, and `viscous_drag` multiplies rho * sum((r x v_t)_z A), linear.
There is no |r|*r. Axes are FRD, z down, as in rovid: no sign changes.

MuJoCo 3.7 or newer in MJCF: a hinge about z, or two slides and a hinge for the coupled model.
"""

import math
from collections.abc import Sequence

import numpy as np
from scipy.optimize import nnls

from rovid.core.array_types import FloatArray
from rovid.core.formatting import TextTemplates, xml_attribute
from rovid.core.output_files import export_mark
from rovid.export.body_equation import Scheme
from rovid.export.interface import ExportInput, ExportResult, simulation
from rovid.export.planar_input import PlanarInput
from rovid.export.thruster_curves import (
    THRUST_LAG,
    ThrusterCurve,
    ThrusterLag,
    curve_comment,
    number_list,
    thruster_inputs,
)

_TEXTS = TextTemplates(__file__, "stonefish")

_STEP = 0.002  # s
_DENSITY = 1025.0  # kg/m^3
_SUBDIVISIONS = 3  # of each face of Stonefish's box
_RATES = 200  # number of rates in the fit of the drag


def export_stonefish(subject: ExportInput) -> ExportResult:
    """A robot for Stonefish with a box as its body."""
    model, vehicle, curves, lag = subject.model, subject.vehicle, subject.curves, subject.lag
    # Drag by non-negative least squares up to the largest rate.
    largest = subject.largest_rate
    rates = np.linspace(0.0, largest, _RATES)
    wanted = model.drag(rates) + subject.value("drag_curvature", "cubic") * rates**3
    # Relative to the largest rate, for columns of equal size.
    columns = np.column_stack([rates / largest, (rates / largest) ** 3])
    torques, _ = nnls(columns, wanted)
    linear, cubic = float(torques[0] / largest), float(torques[1] / largest**3)
    # Relative to the largest torque.
    error = float(np.max(np.abs(columns @ torques - wanted))) / float(wanted[-1]) if wanted[-1] > 0.0 else 0.0
    length, width = vehicle.length or 1.0, vehicle.width or 1.0
    form_drag, friction = _mesh_integrals(length, width)
    inputs, input_note = thruster_inputs(curves, lag)
    thrusters = ""
    for curve, table in zip(inputs, curves, strict=True):
        if curve.side:
            thrusters += _thruster(curve, table, lag.time_constant)
    equation = subject.equation(_STEP, Scheme.BODY_EULER, linear=linear, quadratic=0.0, cubic=cubic)
    losses = []
    if model.quadratic_drag != 0.0:
        why = f"Stonefish has a linear and a cubic drag, no |r|*r: {linear:.4g}*r + {cubic:.4g}*r^3 is fitted "
        why += f"to the drag up to {subject.largest_rate:.3g} rad/s, with an error of up to {100.0 * error:.2g} % of "
        why += "its largest torque, and wrong beyond"
        losses.append(("quadratic_drag", why))
    box = f"a box of {length:g} x {width:g} x {width:g} m"
    if vehicle.length is None or vehicle.width is None:
        box += " (length or width not known: 1 m)"
    return ExportResult(
        content=_TEXTS["scenario"].format(
            mark=export_mark("stonefish"),
            linear=linear,
            cubic=cubic,
            name=xml_attribute(vehicle.name),
            length=length,
            width=width,
            mass=subject.mass,
            inertia=model.inertia,
            viscous_drag=linear / (_DENSITY * friction),
            quadratic_drag=cubic / (0.5 * _DENSITY * form_drag),
            thrusters=thrusters,
        ),
        simulate=simulation(subject, equation, lag=lag),
        equation=equation,
        kept_effects=subject.curve_keys | (subject.effects.keys() & {"drag_curvature", lag.key}),
        base_losses=tuple(losses),
        notes=(
            "Axes are FRD, z down, as rovid's: no sign changes.",
            f"The drag coefficients hold for {box}. For another mesh divide the torques in the file by its integrals.",
            "physics is 'floating' and the inertia the whole one: 'submerged' would add Stonefish's own added inertia.",
            "A newer Stonefish makes both terms quadratic; there neither coefficient is right.",
            input_note,
        ),
    )


def _mesh_integrals(length: float, width: float) -> tuple[float, float]:
    """Form drag over r^3 in m^7, and friction over r in m^4, of a box in yaw, over the faces of its mesh."""
    a, b, c = _box_mesh(0.5 * np.array([length, width, width]))
    normal = np.cross(b - a, c - a)
    area = 0.5 * np.linalg.norm(normal, axis=1)
    normal /= 2.0 * area[:, None]
    centre = (a + b + c) / 3.0
    # Velocity of the water past a face at a rate of 1 rad/s.
    flow = -np.cross(np.array([0.0, 0.0, 1.0]), centre)
    speed = np.linalg.norm(flow, axis=1)
    approach = np.einsum("ij,ij->i", flow, normal)
    tangent = flow - approach[:, None] * normal
    facing = np.where(approach < 0.0, -approach, 0.0)
    form_drag = -np.sum(np.cross(centre, flow)[:, 2] * speed * facing * area)
    friction = -np.sum(np.cross(centre, tangent)[:, 2] * area)
    return float(form_drag), float(friction)


def _box_mesh(half: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The three (n, 3) corners of each triangle in the mesh of a box with half edges in m, outside ccw."""
    triangles = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for sign in (1.0, -1.0):
            side = np.zeros((4, 3))
            side[:, axis] = sign * half[axis]
            side[:, u] = half[u] * np.array([-1.0, 1.0, 1.0, -1.0])
            side[:, v] = sign * half[v] * np.array([-1.0, -1.0, 1.0, 1.0])
            triangles += [side[[0, 1, 2]], side[[0, 2, 3]]]
    a, b, c = np.array(triangles).transpose(1, 0, 2)
    for _ in range(_SUBDIVISIONS):
        # Four triangles by the middles of the edges.
        ab, bc, ca = (a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0
        quarters = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
        a, b, c = (np.concatenate(corners) for corners in zip(*quarters, strict=True))
    return a, b, c


def _thruster(curve: ThrusterCurve, table: ThrusterCurve, lag: float) -> str:
    # FRD: a force along side*y at x = side*arm has the torque arm*thrust about z.
    rotor = '<rotor_dynamics type="zero_order"/>'
    if lag > 0.0:
        rotor = f'<rotor_dynamics type="first_order"><time_constant value="{lag:.10g}"/></rotor_dynamics>'
    limit = float(np.max(np.abs(curve.command)))
    return _TEXTS["thruster"].format(
        comment=curve_comment(table),
        name=curve.identifier,
        limit=limit,
        rotor=rotor,
        commands=number_list(curve.command),
        thrusts=number_list(curve.thrust),
        place=curve.side * curve.arm,
        direction=curve.side * np.pi / 2.0,
    )


_MUJOCO_TEXTS = TextTemplates(__file__, "mujoco")

STEP = 0.002  # s, MuJoCo's default
# Effects that an actuator or the joint represents.
_KEPT = {"thruster_lag", "command_delay", "drag_curvature", "bias_torque", "tether_torsion"}
_NOTES = (
    "Needs MuJoCo 3.7 or newer: an older one refuses a damping of more than one number.",
    "Controls are steady thrusts in N; the curves in <custom> turn commands into them.",
)


def export_mujoco(subject: ExportInput) -> ExportResult:
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
        note = f'    <general name="bias_torque" joint="yaw" gainprm="0" biastype="affine" biasprm="{bias:.10g} 0 0"/>'
        actuators.append(note)
    damping = number_list(np.array([model.linear_drag, model.quadratic_drag, cubic]))
    spring = f' stiffness="{stiffness:.10g}"' if stiffness else ""
    inertia = number_list(np.full(3, model.inertia))
    text = f'      <inertial pos="0 0 0" mass="{subject.mass:.10g}" diaginertia="{inertia}"/>'
    body = (f'      <joint name="yaw" type="hinge" axis="0 0 1" damping="{damping}"{spring}/>', text)
    content = _model(subject, curves, body, actuators)
    equation = subject.equation(STEP, Scheme.WORLD_IMPLICIT, bias=-bias, cubic=cubic, stiffness=stiffness)

    words = "The whole inertia is the body's; its other axes, and the mass where not known, are stand-ins."
    return ExportResult(
        content=content,
        simulate=simulation(subject, equation, lag=ThrusterLag(lag, THRUST_LAG), delay=delay),
        equation=equation,
        kept_effects=subject.curve_keys | (_KEPT & subject.effects.keys()),
        notes=("z is up: a yaw rate there is minus rovid's, which grows with the heading.", *_NOTES, words),
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
    return _MUJOCO_TEXTS["model"].format(
        name=xml_attribute(subject.vehicle.name),
        mark=export_mark("mujoco"),
        title=subject.title[:1].upper() + subject.title[1:],
        STEP=STEP,
        tables="\n".join(tables),
        body="\n".join(body),
        actuators="\n".join(actuators),
    )


_SPEEDS = 200  # number of speeds in the fit of the drag


def export_planar_mujoco(subject: PlanarInput) -> ExportResult:
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
            text = f'    <general name="{name}_drag" site="origin" gear="{gear}" {fixed} biasprm="{numbers}"/>'
            actuators.append(text)
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
