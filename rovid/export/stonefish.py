"""Stonefish: a robot in a scenario, its drag by coefficients of mesh integrals.

From Stonefish's sources of 2024 and 2025 (1.3 to 1.5): over the faces of the physical mesh, `quadratic_drag` multiplies
rho/2 * sum((r x v)_z |v| (-v.n) A), cubic in the rate, and `viscous_drag` rho * sum((r x v_t)_z A), linear. There is
no |r|*r. Axes are FRD, z down, as rovid's: no sign changes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from rovid.core.array_types import FloatArray
from rovid.core.escaping import xml_attribute
from rovid.core.signatures import export_mark
from rovid.export.command_lag import THRUST_LAG, input_notes, thruster_inputs, thruster_lag
from rovid.export.curves import ThrusterCurve, curve_comment, curve_effect_keys, number_list, thruster_curves
from rovid.export.export_input import ExportInput
from rovid.export.export_result import ExportResult
from rovid.export.gz_sim import side_of
from rovid.export.resimulation import integrate_rate, thrust_torque
from rovid.trial.vehicle import Vehicle

_STEP = 0.002  # s
_DENSITY = 1025.0  # kg/m^3
_SUBDIVISIONS = 3  # of a face of Stonefish's box
_RATES = 200


@dataclass(frozen=True, kw_only=True)
class _Drag:
    """``linear`` * r + ``cubic`` * r^3 in N m; ``off`` by at most such a share of the largest torque."""

    linear: float
    cubic: float
    off: float

    def __call__(self, rate: float) -> float:
        return (self.linear + self.cubic * rate * rate) * rate


@dataclass(frozen=True, kw_only=True)
class _Hull:
    """The box, in m, that stands in for the mesh, and the two coefficients that give it the drag."""

    length: float
    width: float
    quadratic_drag: float
    viscous_drag: float


def export(subject: ExportInput) -> ExportResult:
    """A robot for Stonefish whose body is a box."""
    tables = thruster_curves(subject)
    drag = _fitted(subject)
    hull = _hull(subject.vehicle, drag)
    lag, form = thruster_lag(subject)
    stated = {key for key in subject.effects if key in {"drag_curvature", form}}
    return ExportResult(
        content=_scenario(subject, hull, drag, thruster_inputs(tables, form), tables, lag),
        simulate=_plant(subject, drag, tables, lag, form),
        kept_effects=curve_effect_keys(subject) | stated,
        base_losses=_misses(subject, drag),
        notes=(*_notes(subject.vehicle, hull), *input_notes(form)),
    )


def _misses(subject: ExportInput, drag: _Drag) -> tuple[tuple[str, str], ...]:
    if subject.model.quadratic_drag == 0.0:
        return ()
    why = (
        f"Stonefish has a linear and a cubic drag, no |r|*r: {drag.linear:.4g}*r + {drag.cubic:.4g}*r^3 is fitted to "
        f"the drag up to {subject.largest_rate:.3g} rad/s, off by up to {100.0 * drag.off:.2g} % of its largest "
        "torque, wrong beyond"
    )
    return (("quadratic_drag", why),)


def _notes(vehicle: Vehicle, hull: _Hull) -> tuple[str, ...]:
    box = f"a box of {hull.length:g} x {hull.width:g} x {hull.width:g} m"
    if vehicle.length is None or vehicle.width is None:
        box += " (length or width not known: 1 m)"
    return (
        "Axes are FRD, z down, as rovid's: no sign changes.",
        (
            f"The drag coefficients hold for {box}; for another mesh divide the two torques in the file by its own "
            "integrals."
        ),
        "physics is 'floating' and the inertia the whole one: 'submerged' would add Stonefish's own added inertia.",
        "A newer Stonefish makes both terms quadratic; there neither coefficient is right.",
    )


def _fitted(subject: ExportInput) -> _Drag:
    """Neither part negative, and the nearest to the model's drag up to the largest rate."""
    largest = subject.largest_rate
    rates = np.linspace(0.0, largest, _RATES)
    own_cubic = subject.effects.get("drag_curvature", {}).get("cubic", 0.0)
    wanted = subject.model.drag(rates) + own_cubic * rates**3
    # Against shares of the largest rate: both columns are of one size.
    share = rates / largest
    columns = np.column_stack([share, share**3])
    torques, _ = nnls(columns, wanted)
    worst = float(np.max(np.abs(columns @ torques - wanted)))
    return _Drag(
        linear=float(torques[0] / largest),
        cubic=float(torques[1] / largest**3),
        off=worst / float(wanted[-1]) if wanted[-1] > 0.0 else 0.0,
    )


def _hull(vehicle: Vehicle, drag: _Drag) -> _Hull:
    length, width = vehicle.length or 1.0, vehicle.width or 1.0
    form_drag, friction = _mesh_integrals(length, width)
    return _Hull(
        length=length,
        width=width,
        quadratic_drag=drag.cubic / (0.5 * _DENSITY * form_drag),
        viscous_drag=drag.linear / (_DENSITY * friction),
    )


def _mesh_integrals(length: float, width: float) -> tuple[float, float]:
    """Form drag over r^3 in m^7 and friction over r in m^4 of a box turning about z, over the faces of its mesh."""
    a, b, c = _box(0.5 * np.array([length, width, width]))
    normal = np.cross(b - a, c - a)
    area = 0.5 * np.linalg.norm(normal, axis=1)
    normal /= 2.0 * area[:, None]
    centre = (a + b + c) / 3.0
    # Past a face, at a rate of 1 rad/s.
    flow = -np.cross(np.array([0.0, 0.0, 1.0]), centre)
    speed = np.linalg.norm(flow, axis=1)
    approach = np.einsum("ij,ij->i", flow, normal)
    tangent = flow - approach[:, None] * normal
    facing = np.where(approach < 0.0, -approach, 0.0)
    form_drag = -np.sum(_about_z(centre, flow) * speed * facing * area)
    friction = -np.sum(_about_z(centre, tangent) * area)
    return float(form_drag), float(friction)


def _about_z(arm: FloatArray, force: FloatArray) -> FloatArray:
    """(n,) torque about z in N m of (n, 3) ``force`` at (n, 3) ``arm``."""
    return np.asarray(np.cross(arm, force)[:, 2])


def _box(half: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The three (n, 3) corners of each triangle of a box's mesh; ``half`` its edges in m."""
    triangles = []
    for axis in range(3):
        for way in (1.0, -1.0):
            side = _side(half, axis, way)
            triangles += [side[[0, 1, 2]], side[[0, 2, 3]]]
    mesh = np.array(triangles)
    for _ in range(_SUBDIVISIONS):
        mesh = _quartered(mesh)
    a, b, c = mesh.transpose(1, 0, 2)
    return a, b, c


def _side(half: FloatArray, axis: int, way: float) -> FloatArray:
    """(4, 3) corners of the side that looks along ``axis``, or against it, seen from outside counter-clockwise."""
    u, v = (axis + 1) % 3, (axis + 2) % 3
    side = np.zeros((4, 3))
    side[:, axis] = way * half[axis]
    side[:, u] = half[u] * np.array([-1.0, 1.0, 1.0, -1.0])
    side[:, v] = way * half[v] * np.array([-1.0, -1.0, 1.0, 1.0])
    return side


def _quartered(mesh: FloatArray) -> FloatArray:
    """Each of the (n, 3, 3) triangles as four, by the middles of its edges."""
    a, b, c = mesh.transpose(1, 0, 2)
    ab, bc, ca = (a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0
    quarters = [np.stack(corners, axis=1) for corners in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
    return np.concatenate(quarters)


def _plant(
    subject: ExportInput, drag: _Drag, propulsion: list[ThrusterCurve], lag: float, form: str
) -> Callable[[FloatArray, float], FloatArray]:
    inertia = subject.model.inertia

    def advance(rate: float, _: float, torque: float) -> float:
        return rate + _STEP * (torque - drag(rate)) / inertia

    def plant(commands: FloatArray, period: float) -> FloatArray:
        if form == THRUST_LAG:
            torque = thrust_torque(propulsion, commands, period, _STEP, thrust_lag=lag)
        else:
            torque = thrust_torque(propulsion, commands, period, _STEP, command_lag=lag)
        return integrate_rate(torque, round(period / _STEP), advance, _STEP)

    return plant


def _scenario(
    subject: ExportInput, hull: _Hull, drag: _Drag, inputs: list[ThrusterCurve], tables: list[ThrusterCurve], lag: float
) -> str:
    inertia = subject.model.inertia
    thrusters = []
    for index, thruster in enumerate(subject.vehicle.thrusters):
        if thruster.curve is not None:
            thrusters.append(_thruster(inputs[index], tables[index], side_of(index), lag))
    return f"""<?xml version="1.0"?>
<!-- {export_mark("stonefish")}. Yaw identified by rovid; z down, a yaw rate is the heading's.
     Torque of drag: {drag.linear:.10g}*r + {drag.cubic:.10g}*r^3 N m. -->
<scenario>
  <robot name={xml_attribute(subject.vehicle.name)} fixed="false" self_collisions="false">
    <base_link name="base_link" type="box" physics="floating">
      <dimensions xyz="{hull.length:.10g} {hull.width:.10g} {hull.width:.10g}"/>
      <origin xyz="0 0 0" rpy="0 0 0"/>
      <material name="Neutral"/>
      <look name="Yellow"/>
      <mass value="{subject.mass:.10g}"/>
      <inertia xyz="{inertia:.10g} {inertia:.10g} {inertia:.10g}"/>
      <cg xyz="0 0 0" rpy="0 0 0"/>
      <hydrodynamics viscous_drag="0 0 {hull.viscous_drag:.10g}" quadratic_drag="0 0 {hull.quadratic_drag:.10g}"/>
    </base_link>
{"".join(thrusters)}    <world_transform xyz="0 0 5" rpy="0 0 0"/>
  </robot>
</scenario>
"""


def _rotor_dynamics(lag: float) -> str:
    """A rotor that follows its set point at once, or with a ``lag`` in s."""
    if lag <= 0.0:
        return '<rotor_dynamics type="zero_order"/>'
    return f'<rotor_dynamics type="first_order"><time_constant value="{lag:.10g}"/></rotor_dynamics>'


def _thruster(curve: ThrusterCurve, table: ThrusterCurve, side: float, lag: float) -> str:
    # FRD: at x = side*arm, pushing along side*y, the torque about z is arm*thrust.
    limit = float(np.max(np.abs(curve.command)))
    return f"""    <!-- {curve_comment(table)} -->
    <actuator name="{curve.identifier}" type="thruster">
      <specs max_setpoint="{limit:.10g}" inverted_setpoint="false"/>
      <propeller diameter="0.1" right="true">
        <mesh filename="propeller.obj" scale="1"/>
        <material name="Neutral"/>
        <look name="Yellow"/>
      </propeller>
      {_rotor_dynamics(lag)}
      <thrust_model type="linear_interpolation">
        <input value="{number_list(curve.command)}"/>
        <output value="{number_list(curve.thrust)}"/>
      </thrust_model>
      <origin xyz="{side * curve.arm:.10g} 0 0" rpy="0 0 {side * np.pi / 2.0:.16g}"/>
      <link name="base_link"/>
    </actuator>
"""
