"""The coupled model for MuJoCo: two slides and a hinge in MJCF, and dampers in body axes.

From its engine: a body has one mass, and joints' damping acts in axes of the world. An actuator at a site acts in the
site's axes, and its affine bias takes the velocity there: linear damping in body axes. Axes are z up, as FLU.
"""

from __future__ import annotations

import math

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.export.body_equation import BodyEquation, Scheme
from rovid.export.mujoco import STEP, mjcf
from rovid.export.planar_input import PlanarInput
from rovid.export.planar_result import PlanarExportResult, simulation
from rovid.export.thruster_curves import THRUST_LAG, ThrusterLag, number_list

_SPEEDS = 200  # number of speeds in the fit of the drag


def export(subject: PlanarInput) -> PlanarExportResult:
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
