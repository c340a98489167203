"""Stonefish: a robot in a scenario, with drag by coefficients of integrals over its mesh.

From Stonefish's sources of 2024 and 2025 (1.3 to 1.5): over the faces of the physical mesh, `quadratic_drag` multiplies
rho/2 * sum((r x v)_z |v| (-v.n) A), cubic in the rate, and `viscous_drag` multiplies rho * sum((r x v_t)_z A), linear.
There is no |r|*r. Axes are FRD, z down, as in rovid: no sign changes.
"""

import numpy as np
from scipy.optimize import nnls

from rovid.core.array_types import FloatArray
from rovid.core.formatting import TextTemplates, xml_attribute
from rovid.core.output_files import export_mark
from rovid.export.body_equation import Scheme
from rovid.export.interface import ExportInput, ExportResult
from rovid.export.thruster_curves import ThrusterCurve, curve_comment, number_list, thruster_inputs
from rovid.export.verification import simulation

_TEXTS = TextTemplates(__file__, "stonefish")

_STEP = 0.002  # s
_DENSITY = 1025.0  # kg/m^3
_SUBDIVISIONS = 3  # of each face of Stonefish's box
_RATES = 200  # number of rates in the fit of the drag


def export(subject: ExportInput) -> ExportResult:
    """A robot for Stonefish with a box as its body."""
    model, vehicle, curves, lag = subject.model, subject.vehicle, subject.curves, subject.lag
    linear, cubic, error = _fit_drag(subject)
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
        why = (
            f"Stonefish has a linear and a cubic drag, no |r|*r: {linear:.4g}*r + {cubic:.4g}*r^3 is fitted "
            f"to the drag up to {subject.largest_rate:.3g} rad/s, with an error of up to {100.0 * error:.2g} % of "
            "its largest torque, and wrong beyond"
        )
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


def _fit_drag(subject: ExportInput) -> tuple[float, float, float]:
    """Linear and cubic coefficient by non-negative least squares up to the largest rate, and the largest error.

    The error is relative to the largest torque.
    """
    largest = subject.largest_rate
    rates = np.linspace(0.0, largest, _RATES)
    wanted = subject.model.drag(rates) + subject.value("drag_curvature", "cubic") * rates**3
    # Relative to the largest rate, for columns of equal size.
    columns = np.column_stack([rates / largest, (rates / largest) ** 3])
    torques, _ = nnls(columns, wanted)
    error = float(np.max(np.abs(columns @ torques - wanted)))
    share = error / float(wanted[-1]) if wanted[-1] > 0.0 else 0.0
    return float(torques[0] / largest), float(torques[1] / largest**3), share


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
