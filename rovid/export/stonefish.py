"""Stonefish: a robot in a scenario, its drag by coefficients of mesh integrals.

From Stonefish's sources of 2024 and 2025 (1.3 to 1.5): over the faces of the physical mesh, `quadratic_drag` multiplies
rho/2 * sum((r x v)_z |v| (-v.n) A), cubic in the rate, and `viscous_drag` rho * sum((r x v_t)_z A), linear. There is
no |r|*r. Axes are FRD, z down, as rovid's: no sign changes.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import nnls

from rovid.export.curves import Curve, curve_comment, curve_keys, curves, numbers
from rovid.export.gz_sim import side_of
from rovid.export.manoeuvre import march, thrust_torque
from rovid.export.rotor import BEHIND, first_order, input_notes, inputs_of
from rovid.export.subject import Subject
from rovid.export.target import Target
from rovid.ground.arrays import FloatArray
from rovid.ground.files.form import export_mark
from rovid.ground.quoting import xml_attribute

_STEP = 0.002  # s
_DENSITY = 1025.0  # kg/m^3
_SUBDIVISIONS = 3  # of a face of Stonefish's box
_RATES = 200


def export(subject: Subject) -> Target:
    """A robot for Stonefish whose body is a box."""
    model, tables = subject.model, curves(subject)
    size = (subject.vehicle.length or 1.0, subject.vehicle.width or 1.0)
    linear, cubic = _fitted(subject)
    form_drag, friction = _mesh_integrals(*size)
    lag, form = first_order(subject)
    inputs = inputs_of(tables, form)
    rates = np.linspace(0.0, subject.largest_rate, _RATES)
    wanted = _drag(subject, rates)
    off = linear * rates + cubic * rates**3 - wanted
    worst = float(np.max(np.abs(off)) / wanted[-1]) if wanted[-1] > 0.0 else 0.0
    coefficients = (cubic / (0.5 * _DENSITY * form_drag), linear / (_DENSITY * friction))
    why = (
        f"Stonefish has a linear and a cubic drag, no |r|*r: {linear:.4g}*r + {cubic:.4g}*r^3 is fitted to the drag up "
        f"to {subject.largest_rate:.3g} rad/s, off by up to {100.0 * worst:.2g} % of its largest torque, wrong beyond"
    )
    stated = {key for key in subject.effects if key in {"drag_curvature", form}}
    box = f"a box of {size[0]:g} x {size[1]:g} x {size[1]:g} m"
    if subject.vehicle.length is None or subject.vehicle.width is None:
        box += " (length or width not known: 1 m)"
    return Target(
        content=_scenario(subject, size, coefficients, (linear, cubic), inputs, tables, lag),
        plant=_plant(subject, (linear, cubic), tables, lag, form),
        holds=curve_keys(subject) | stated,
        misses=() if model.quadratic_drag == 0.0 else (("quadratic_drag", why),),
        notes=(
            "Axes are FRD, z down, as rovid's: no sign changes.",
            (
                f"The drag coefficients hold for {box}; for another mesh divide the two torques in the file by its own "
                "integrals."
            ),
            "physics is 'floating' and the inertia the whole one: 'submerged' would add Stonefish's own added inertia.",
            "A newer Stonefish makes both terms quadratic; there neither coefficient is right.",
            *input_notes(form),
        ),
    )


def _drag(subject: Subject, rates: FloatArray) -> FloatArray:
    cubic = subject.effects.get("drag_curvature", {}).get("cubic", 0.0)
    return subject.model.drag(rates) + cubic * rates**3


def _fitted(subject: Subject) -> tuple[float, float]:
    """Linear and cubic drag, neither negative, nearest to the model's up to the largest rate."""
    rates = np.linspace(0.0, subject.largest_rate, _RATES)
    share = rates / subject.largest_rate
    found, _ = nnls(np.column_stack([share, share**3]), _drag(subject, rates))
    return float(found[0] / subject.largest_rate), float(found[1] / subject.largest_rate**3)


def _mesh_integrals(length: float, width: float) -> tuple[float, float]:
    """Form drag over r^3 in m^7 and friction over r in m^4 of a box turning about z, over the faces of its mesh."""
    half = 0.5 * np.array([length, width, width])
    corners, _ = _box(half)
    a, b, c = corners
    normal = np.cross(b - a, c - a)
    area = 0.5 * np.linalg.norm(normal, axis=1)
    normal /= 2.0 * area[:, None]
    centre = (a + b + c) / 3.0
    flow = -np.cross(np.array([0.0, 0.0, 1.0]), centre)
    approach = np.einsum("ij,ij->i", flow, normal)
    tangent = flow - approach[:, None] * normal
    speed = np.linalg.norm(flow, axis=1)
    facing = np.where(approach < 0.0, -approach, 0.0)
    form_drag = -np.sum(np.cross(centre, flow)[:, 2] * speed * facing * area)
    return float(form_drag), float(-np.sum(np.cross(centre, tangent)[:, 2] * area))


def _box(half: FloatArray) -> tuple[tuple[FloatArray, FloatArray, FloatArray], int]:
    triangles = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for way in (1.0, -1.0):
            quad = np.zeros((4, 3))
            quad[:, axis] = way * half[axis]
            quad[:, u] = half[u] * np.array([-1.0, 1.0, 1.0, -1.0])
            quad[:, v] = way * half[v] * np.array([-1.0, -1.0, 1.0, 1.0])
            triangles += [quad[[0, 1, 2]], quad[[0, 2, 3]]]
    mesh = np.array(triangles)
    for _ in range(_SUBDIVISIONS):
        a, b, c = mesh.transpose(1, 0, 2)
        ab, bc, ca = (a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0
        quarters = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
        mesh = np.concatenate([np.stack(corners, axis=1) for corners in quarters])
    a, b, c = mesh.transpose(1, 0, 2)
    return (a, b, c), len(mesh)


def _plant(
    subject: Subject, drag: tuple[float, float], propulsion: list[Curve], lag: float, form: str
) -> Callable[[FloatArray, float], FloatArray]:
    inertia, (linear, cubic) = subject.model.inertia, drag

    def advance(rate: float, _: float, torque: float) -> float:
        return rate + _STEP * (torque - (linear + cubic * rate * rate) * rate) / inertia

    def plant(commands: FloatArray, period: float) -> FloatArray:
        if form == BEHIND:
            torque = thrust_torque(propulsion, commands, period, _STEP, thrust_lag=lag)
        else:
            torque = thrust_torque(propulsion, commands, period, _STEP, command_lag=lag)
        return march(torque, round(period / _STEP), advance, _STEP)

    return plant


def _scenario(
    subject: Subject,
    size: tuple[float, float],
    coefficients: tuple[float, float],
    torques: tuple[float, float],
    inputs: list[Curve],
    tables: list[Curve],
    lag: float,
) -> str:
    inertia, (length, width) = subject.model.inertia, size
    thrusters = []
    for index, thruster in enumerate(subject.vehicle.thrusters):
        if thruster.curve is not None:
            thrusters.append(_thruster(inputs[index], tables[index], side_of(index), lag))
    return f"""<?xml version="1.0"?>
<!-- {export_mark("stonefish")}. Yaw identified by rovid; z down, a yaw rate is the heading's.
     Torque of drag: {torques[0]:.10g}*r + {torques[1]:.10g}*r^3 N m. -->
<scenario>
  <robot name={xml_attribute(subject.vehicle.name)} fixed="false" self_collisions="false">
    <base_link name="base_link" type="box" physics="floating">
      <dimensions xyz="{length:.10g} {width:.10g} {width:.10g}"/>
      <origin xyz="0 0 0" rpy="0 0 0"/>
      <material name="Neutral"/>
      <look name="Yellow"/>
      <mass value="{subject.mass:.10g}"/>
      <inertia xyz="{inertia:.10g} {inertia:.10g} {inertia:.10g}"/>
      <cg xyz="0 0 0" rpy="0 0 0"/>
      <hydrodynamics viscous_drag="0 0 {coefficients[1]:.10g}" quadratic_drag="0 0 {coefficients[0]:.10g}"/>
    </base_link>
{"".join(thrusters)}    <world_transform xyz="0 0 5" rpy="0 0 0"/>
  </robot>
</scenario>
"""


def _thruster(curve: Curve, table: Curve, side: float, lag: float) -> str:
    # FRD: at x = side*arm, pushing along side*y, the torque about z is arm*thrust.
    dynamics = '<rotor_dynamics type="zero_order"/>'
    if lag > 0.0:
        dynamics = f'<rotor_dynamics type="first_order"><time_constant value="{lag:.10g}"/></rotor_dynamics>'
    limit = float(np.max(np.abs(curve.command)))
    return f"""    <!-- {curve_comment(table)} -->
    <actuator name="{curve.identifier}" type="thruster">
      <specs max_setpoint="{limit:.10g}" inverted_setpoint="false"/>
      <propeller diameter="0.1" right="true">
        <mesh filename="propeller.obj" scale="1"/>
        <material name="Neutral"/>
        <look name="Yellow"/>
      </propeller>
      {dynamics}
      <thrust_model type="linear_interpolation">
        <input value="{numbers(curve.command)}"/>
        <output value="{numbers(curve.thrust)}"/>
      </thrust_model>
      <origin xyz="{side * curve.arm:.10g} 0 0" rpy="0 0 {side * np.pi / 2.0:.16g}"/>
      <link name="base_link"/>
    </actuator>
"""
