"""PythonVehicleSimulator: a vehicle class, for its vehicles have no parameter files and no free |r|*r term."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.formatting import python_docstring
from rovid.core.output_files import export_mark
from rovid.export.interface import PERIOD, ExportInput, ExportResult
from rovid.export.planar_input import PlanarExportResult, PlanarInput
from rovid.export.resimulation import repeat_held
from rovid.export.rovid_equation import own_equation
from rovid.export.thruster_curves import (
    THRUST_LAG,
    ThrusterCurve,
    ThrusterLag,
    curve_effect_keys,
    thruster_curves,
    thruster_lag,
)
from rovid.trial.vehicle import Vehicle

STEP = 0.02  # s, of the simulator's main.py
# Further terms of the equation of motion in Python, torque in N m.
_TERMS = {
    "bias_torque": " + {torque!r}",
    "drag_curvature": " - {cubic!r} * r**3",
    "drag_asymmetry": " - ({ratio!r} - 1.0) * (self.DQ * abs(r) + self.DL) * r * (r < 0.0)",
    "tether_torsion": " - {stiffness!r} * psi",
}
_MODULE = '''"""{axes} of {title}, identified by rovid, as a vehicle of PythonVehicleSimulator.

{mark}.

NED: {frame}.
"""

import math

import numpy as np


class RovidVehicle:
    """{equation}; the other velocities stay as they are.

    The control is each thruster's command in the unit of its bench curve.
    """

    def __init__(self):
        self.name = {name!r}
        self.L = {length!r}
        self.controlMode = "stepInput"
        self.controlDescription = "Step commands"
{numbers}
        self.lag = {time_constant!r}  # s
        # {arms_text}, command of no thrust, commands, thrusts in N of each thruster.
        self.thrusters = [
{tables}        ]
        self.{arms} = np.array([{arm} for {arm}, *_ in self.thrusters])
        self.curves = [np.array(curve) for _, _, *curve in self.thrusters]
        self.controls = {names!r}
        self.dimU = len(self.controls)
        self.nu = np.zeros(6)
        self.u_actual = np.array({start!r}, float)  # {acting} of each thruster, as it acts

    def thrusts(self, commands):
        return np.array([np.interp(u, *curve) for u, curve in zip(commands, self.curves)])

{methods}

    def dynamics(self, eta, nu, u_actual, u_control, sampleTime):
        h = sampleTime
        goal = np.asarray({goal}, float)
        fade = math.exp(-h / self.lag) if self.lag > 0.0 else 0.0
        mean = (1.0 - fade) * self.lag / h
        u = goal + (np.asarray(u_actual, float) - goal) * mean
        {force} = {push}
{advance}
        return nu, goal + (np.asarray(u_actual, float) - goal) * fade

    def stepInput(self, t):
        return np.array([table[-1] if 10.0 < t < 60.0 else neutral for _, neutral, table, _ in self.thrusters])
'''
# The equation of yaw, with places for the numbers.
_NUMBERS = """        self.I = {inertia!r}  # kg m^2
        self.DQ = {quadratic_drag!r}  # N m s^2/rad^2
        self.DL = {linear_drag!r}  # N m s/rad"""
_METHODS = """    def torque(self, commands):
        return float(np.dot(self.arms, self.thrusts(commands)))

    def acceleration(self, r, psi, torque):
        return (torque - self.DQ * abs(r) * r - self.DL * r{terms}) / self.I"""
_ADVANCE = """        r, psi = nu[5], eta[5]
        k1 = self.acceleration(r, psi, torque)
        k2 = self.acceleration(r + 0.5 * h * k1, psi + 0.5 * h * r, torque)
        k3 = self.acceleration(r + 0.5 * h * k2, psi + 0.5 * h * r, torque)
        k4 = self.acceleration(r + h * k3, psi + h * r, torque)
        nu = np.array(nu, float)
        nu[5] = r + h * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0"""


def vehicle_module(
    vehicle: Vehicle,
    curves: Sequence[ThrusterCurve],
    levers: Sequence[object],
    lag: ThrusterLag,
    push: Mapping[str, str],
    **texts: str,
) -> str:
    """The module with the class.

    ``levers``: Lever, or levers, of the thrust of each thruster.
    ``push``: Expression of the forces, of the commands and of the thrusts ``u``.
    ``texts``: Places of the template that depend on the axes.
    """
    tables = ""
    for lever, curve in zip(levers, curves, strict=True):
        command, thrust = curve.command.tolist(), curve.thrust.tolist()
        tables += f"            ({lever!r}, {curve.neutral!r}, {command!r}, {thrust!r}),\n"
    # The lag acts on the thrust, behind the curves, or on the command.
    acting, goal, start = "command", "u_control", [curve.neutral for curve in curves]
    if lag.key == THRUST_LAG:
        acting, goal, start = "thrust", "self.thrusts(u_control)", [0.0] * len(curves)
    return _MODULE.format(
        title=python_docstring(vehicle.name),
        mark=export_mark("python-vehicle-simulator"),
        name=vehicle.name,
        length=vehicle.length or 1.0,
        time_constant=lag.time_constant,
        tables=tables,
        names=[f"{curve.name} command" for curve in curves],
        acting=acting,
        goal=goal,
        start=start,
        push=push[acting],
        **texts,
    )


def vehicle_in(module: str) -> Any:
    """The vehicle of a written module, as its user makes it."""
    space: dict[str, Any] = {}
    exec(compile(module, "rovid_vehicle.py", "exec"), space)  # noqa: S102 - our own text, run as its user will
    return space["RovidVehicle"]()


def export(subject: ExportInput) -> ExportResult:
    """A module with the class RovidVehicle."""
    model, curves, lag = subject.model, thruster_curves(subject), thruster_lag(subject)
    terms = [_TERMS[key].format(**values) for key, values in subject.effects.items() if key in _TERMS]
    content = vehicle_module(
        subject.vehicle,
        curves,
        [curve.arm for curve in curves],
        lag,
        {"command": "self.torque(u)", "thrust": "float(np.dot(self.arms, u))"},
        axes="Yaw",
        frame="the yaw rate nu[5] in rad/s and the heading eta[5] in rad are positive clockwise from above",
        equation="I*rdot + DQ*|r|*r + DL*r = T",
        arms_text="Yaw arm in m",
        arms="arms",
        arm="arm",
        force="torque",
        numbers=_NUMBERS.format(
            inertia=model.inertia, quadratic_drag=model.quadratic_drag, linear_drag=model.linear_drag
        ),
        methods=_METHODS.format(terms="".join(terms)),
        advance=_ADVANCE,
    )

    def simulate(commands: FloatArray) -> FloatArray:
        simulated = vehicle_in(content)
        nu, actual, eta, rates = simulated.nu, simulated.u_actual, np.zeros(6), []
        for control in repeat_held(commands, STEP):
            rates.append(nu[5])
            nu, actual = simulated.dynamics(eta, nu, actual, control, STEP)
            eta[5] += STEP * nu[5]
        return np.array(rates[:: round(PERIOD / STEP)])

    return ExportResult(
        content=content,
        simulate=simulate,
        equation=subject.equation(STEP, **subject.drag_terms),
        kept_effects=curve_effect_keys(subject) | {key for key in subject.effects if key in _TERMS or key == lag.key},
        notes=(
            "Axes are NED, as rovid's: no sign changes.",
            "Yaw alone moves: surge to pitch keep their velocity.",
            "The simulator's vehicles share no base class: the class has what its main loop calls.",
        ),
    )


_COUPLED = {"sway_yaw_damping", "sway_yaw_damping:lift", "speed_dependent_damping:planar"}
# Further terms of the force in Python: (X, Y, N) of u, v, r.
_PLANAR_TERMS = {
    "speed_dependent_damping:planar_quadratic": "(0.0, -{sway!r} * u * u * v, -{yaw!r} * u * u * r)",
    "bias_torque:planar": "({surge!r}, {sway!r}, {yaw!r})",
    "cross_flow_drag": "self.strips({coefficient!r}, {length!r}, 0.0, v, r)",
    "cross_flow_drag:off_centre": "self.strips({coefficient!r}, {length!r}, {centre!r}, v, r)",
}
_PLANAR_NUMBERS = """        self.M = np.array({mass!r})  # kg, kg m, kg m^2
        self.Minv = np.linalg.inv(self.M)
        self.DL = np.array({linear!r})  # linear damping
        self.DA = np.array({absolute!r})  # damping nu_j*|nu_k|
        self.V_c = {speed!r}  # m/s, speed of the current
        self.beta_c = {direction!r}  # rad, towards this direction from north"""
_PLANAR_METHODS = """    def strips(self, c, length, centre, v, r):
        # Strip integrals of c*|v + x*r|*(v + x*r), less their values in pure sway and in pure yaw.
        x = centre + np.linspace(-0.5, 0.5, 401) * length
        w = v + x * r
        weight = np.full(len(x), length / 400.0)
        weight[[0, -1]] *= 0.5
        flow = c * np.abs(w) * w * weight
        side = np.sum(flow) - c * length * abs(v) * v
        turning = np.sum(x * flow) - c * np.sum(np.abs(x) ** 3 * weight) * abs(r) * r
        return (0.0, -side, -turning)

    def acceleration(self, psi, nu, tau):
        north, east = self.V_c * math.cos(self.beta_c), self.V_c * math.sin(self.beta_c)
        u_c = north * math.cos(psi) + east * math.sin(psi)
        v_c = east * math.cos(psi) - north * math.sin(psi)
        u, v, r = x = nu - np.array([u_c, v_c, 0.0])
        p = self.M @ x
        force = tau - self.DL @ x - np.einsum("ijk,j,k", self.DA, x, np.abs(x))
        force -= np.array([-p[1] * r, p[0] * r, p[1] * u - p[0] * v])
{terms}        return self.Minv @ force + r * np.array([v_c, -u_c, 0.0])"""
_PLANAR_ADVANCE = """        nu = np.array(nu, float)
        x, psi = nu[[0, 1, 5]], eta[5]
        k1 = self.acceleration(psi, x, tau)
        k2 = self.acceleration(psi + 0.5 * h * x[2], x + 0.5 * h * k1, tau)
        k3 = self.acceleration(psi + 0.5 * h * (x[2] + 0.5 * h * k1[2]), x + 0.5 * h * k2, tau)
        k4 = self.acceleration(psi + h * (x[2] + 0.5 * h * k2[2]), x + h * k3, tau)
        nu[[0, 1, 5]] = x + h * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0"""


def export_planar(subject: PlanarInput) -> PlanarExportResult:
    """A module with the class RovidVehicle."""
    columns = [one.name for one in subject.vehicle.thrusters]
    linear, absolute, _ = subject.damping
    lag = thruster_lag(subject.thrusters)
    terms = [_PLANAR_TERMS[key].format(**values) for key, values in subject.effects.items() if key in _PLANAR_TERMS]
    north, east = subject.model.current
    content = vehicle_module(
        subject.vehicle,
        subject.curves,
        [(one.surge_share, one.sway_share, one.arm) for one in subject.actuators.thrusters.thrusters],
        lag,
        {"command": "self.thrusts(u) @ self.levers", "thrust": "u @ self.levers"},
        axes="Surge, sway and yaw",
        frame="nu = (u, v, w, p, q, r) over ground, eta = (north, east, down, roll, pitch, heading)",
        equation="M*nu' + C(nu)*nu + D(nu)*nu = tau for (u, v, r) through the water",
        arms_text="Levers ahead, to starboard and in turn",
        arms="levers",
        arm="levers",
        force="tau",
        numbers=_PLANAR_NUMBERS.format(
            mass=subject.model.mass_matrix.tolist(),
            linear=linear.tolist(),
            absolute=absolute.tolist(),
            speed=float(np.hypot(north, east)),
            direction=float(np.arctan2(east, north)),
        ),
        methods=_PLANAR_METHODS.format(terms="".join(f"        force += np.array({term})\n" for term in terms)),
        advance=_PLANAR_ADVANCE,
    )

    def simulate(commands: FloatArray) -> FloatArray:
        simulated = vehicle_in(content)
        nu, actual, eta, rows = simulated.nu, simulated.u_actual, np.zeros(6), []
        chosen = commands[:, [columns.index(curve.name) for curve in subject.curves]]
        for control in repeat_held(chosen, STEP):
            rows.append((eta[5], nu[0], nu[1], nu[5]))
            before = nu[5]
            nu, actual = simulated.dynamics(eta, nu, actual, control, STEP)
            eta[5] += 0.5 * STEP * (before + nu[5])
        return np.array(rows[:: round(PERIOD / STEP)])

    kept = {key for key in subject.effects if key in _COUPLED or key in _PLANAR_TERMS or key in {lag.key, "current"}}
    return PlanarExportResult(
        content=content,
        equation=own_equation(subject, STEP),
        simulate=simulate,
        kept_effects=subject.curve_keys | kept,
        notes=(
            "Axes are NED, as rovid's: no sign changes.",
            "Surge, sway and yaw move: heave, roll and pitch keep their velocity.",
            "The simulator's vehicles share no base class: the class has what its main loop calls.",
        ),
    )
