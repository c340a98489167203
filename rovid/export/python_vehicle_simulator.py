"""PythonVehicleSimulator: a vehicle class, because its vehicles have no parameter files and no free |r|*r term.

Its main loop calls stepInput(t) or a controller, then dynamics(eta, nu, u_actual, u_control, sampleTime). Axes are NED
as in rovid. Only yaw moves; users may extend the class.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.escaping import python_docstring
from rovid.core.signatures import export_mark
from rovid.export.interface import PERIOD, ExportInput, ExportResult
from rovid.export.resimulation import repeat_held
from rovid.export.thruster_curves import THRUST_LAG, curve_effect_keys, thruster_curves, thruster_lag

_STEP = 0.02  # s, of the simulator's main.py
# Further terms of the equation of motion in Python, torque in N m.
_TERMS = {
    "bias_torque": " + {torque!r}",
    "drag_curvature": " - {cubic!r} * r**3",
    "drag_asymmetry": " - ({ratio!r} - 1.0) * (self.DQ * abs(r) + self.DL) * r * (r < 0.0)",
    "tether_torsion": " - {stiffness!r} * psi",
}
# The class, with places for the numbers.
_MODULE = '''"""Yaw of {title}, identified by rovid, as a vehicle of PythonVehicleSimulator.

{mark}.

NED: the yaw rate nu[5] in rad/s and the heading eta[5] in rad are positive clockwise from above.
"""

import math

import numpy as np


class RovidVehicle:
    """I*rdot + DQ*|r|*r + DL*r = T; the other velocities stay as they are.

    The control is each thruster's command in the unit of its bench curve.
    """

    def __init__(self):
        self.name = {name!r}
        self.L = {length!r}
        self.controlMode = "stepInput"
        self.controlDescription = "Step commands"
        self.I = {inertia!r}  # kg m^2
        self.DQ = {quadratic_drag!r}  # N m s^2/rad^2
        self.DL = {linear_drag!r}  # N m s/rad
        self.lag = {time_constant!r}  # s
        # Yaw arm in m, command of no thrust, commands, thrusts in N of each thruster.
        self.thrusters = [
{tables}        ]
        self.arms = np.array([arm for arm, *_ in self.thrusters])
        self.curves = [np.array(curve) for _, _, *curve in self.thrusters]
        self.controls = {names!r}
        self.dimU = len(self.controls)
        self.nu = np.zeros(6)
        self.u_actual = np.array({start!r}, float)  # {acting} of each thruster, as it acts

    def thrusts(self, commands):
        return np.array([np.interp(u, *curve) for u, curve in zip(commands, self.curves)])

    def torque(self, commands):
        return float(np.dot(self.arms, self.thrusts(commands)))

    def acceleration(self, r, psi, torque):
        return (torque - self.DQ * abs(r) * r - self.DL * r{terms}) / self.I

    def dynamics(self, eta, nu, u_actual, u_control, sampleTime):
        h = sampleTime
        goal = np.asarray({goal}, float)
        fade = math.exp(-h / self.lag) if self.lag > 0.0 else 0.0
        mean = (1.0 - fade) * self.lag / h
        u = goal + (np.asarray(u_actual, float) - goal) * mean
        torque = {push}
        r, psi = nu[5], eta[5]
        k1 = self.acceleration(r, psi, torque)
        k2 = self.acceleration(r + 0.5 * h * k1, psi + 0.5 * h * r, torque)
        k3 = self.acceleration(r + 0.5 * h * k2, psi + 0.5 * h * r, torque)
        k4 = self.acceleration(r + h * k3, psi + h * r, torque)
        nu = np.array(nu, float)
        nu[5] = r + h * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0
        return nu, goal + (np.asarray(u_actual, float) - goal) * fade

    def stepInput(self, t):
        return np.array([table[-1] if 10.0 < t < 60.0 else neutral for _, neutral, table, _ in self.thrusters])
'''


def export(subject: ExportInput) -> ExportResult:
    """A module with the class RovidVehicle."""
    model, vehicle, curves = subject.model, subject.vehicle, thruster_curves(subject)
    lag = thruster_lag(subject)
    tables = ""
    for curve in curves:
        command, thrust = curve.command.tolist(), curve.thrust.tolist()
        tables += f"            ({curve.arm!r}, {curve.neutral!r}, {command!r}, {thrust!r}),\n"
    # The lag acts on the thrust, behind the curves, or on the command.
    lagged = {"acting": "command", "push": "self.torque(u)", "goal": "u_control", "start": [c.neutral for c in curves]}
    if lag.key == THRUST_LAG:
        push, goal = "float(np.dot(self.arms, u))", "self.thrusts(u_control)"
        lagged = {"acting": "thrust", "push": push, "goal": goal, "start": [0.0] * len(curves)}
    content = _MODULE.format(
        title=python_docstring(vehicle.name),
        mark=export_mark("python-vehicle-simulator"),
        name=vehicle.name,
        length=vehicle.length or 1.0,
        inertia=model.inertia,
        quadratic_drag=model.quadratic_drag,
        linear_drag=model.linear_drag,
        time_constant=lag.time_constant,
        terms="".join(_TERMS[key].format(**values) for key, values in subject.effects.items() if key in _TERMS),
        tables=tables,
        names=[f"{curve.name} command" for curve in curves],
        **lagged,
    )

    def simulate(commands: FloatArray) -> FloatArray:
        space: dict[str, Any] = {}
        exec(compile(content, "rovid_vehicle.py", "exec"), space)  # noqa: S102 - our own text, run as its user will
        simulated = space["RovidVehicle"]()
        nu, actual, eta, rates = simulated.nu, simulated.u_actual, np.zeros(6), []
        for control in repeat_held(commands, _STEP):
            rates.append(nu[5])
            nu, actual = simulated.dynamics(eta, nu, actual, control, _STEP)
            eta[5] += _STEP * nu[5]
        return np.array(rates[:: round(PERIOD / _STEP)])

    return ExportResult(
        content=content,
        simulate=simulate,
        kept_effects=curve_effect_keys(subject) | {key for key in subject.effects if key in _TERMS or key == lag.key},
        notes=(
            "Axes are NED, as rovid's: no sign changes.",
            "Yaw alone moves: surge to pitch keep their velocity.",
            "The simulator's vehicles share no base class: the class has what its main loop calls.",
        ),
    )
