"""The coupled model for PythonVehicleSimulator: a vehicle class with surge, sway and yaw. Axes are NED, as rovid's."""

from __future__ import annotations

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.export.interface import PERIOD
from rovid.export.planar_input import PlanarInput
from rovid.export.planar_result import PlanarExportResult
from rovid.export.planar_tables import own_equation
from rovid.export.python_vehicle_simulator import STEP, vehicle_in, vehicle_module
from rovid.export.resimulation import repeat_held
from rovid.export.thruster_curves import thruster_lag

_COUPLED = {"sway_yaw_damping", "sway_yaw_damping:lift", "speed_dependent_damping:planar"}
# Further terms of the force in Python: (X, Y, N) of u, v, r.
_TERMS = {
    "speed_dependent_damping:planar_quadratic": "(0.0, -{sway!r} * u * u * v, -{yaw!r} * u * u * r)",
    "bias_torque:planar": "({surge!r}, {sway!r}, {yaw!r})",
    "cross_flow_drag": "self.strips({coefficient!r}, {length!r}, 0.0, v, r)",
    "cross_flow_drag:off_centre": "self.strips({coefficient!r}, {length!r}, {centre!r}, v, r)",
}
_NUMBERS = """        self.M = np.array({mass!r})  # kg, kg m, kg m^2
        self.Minv = np.linalg.inv(self.M)
        self.DL = np.array({linear!r})  # linear damping
        self.DA = np.array({absolute!r})  # damping nu_j*|nu_k|
        self.V_c = {speed!r}  # m/s, speed of the current
        self.beta_c = {direction!r}  # rad, towards this direction from north"""
_METHODS = """    def strips(self, c, length, centre, v, r):
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
_ADVANCE = """        nu = np.array(nu, float)
        x, psi = nu[[0, 1, 5]], eta[5]
        k1 = self.acceleration(psi, x, tau)
        k2 = self.acceleration(psi + 0.5 * h * x[2], x + 0.5 * h * k1, tau)
        k3 = self.acceleration(psi + 0.5 * h * (x[2] + 0.5 * h * k1[2]), x + 0.5 * h * k2, tau)
        k4 = self.acceleration(psi + h * (x[2] + 0.5 * h * k2[2]), x + h * k3, tau)
        nu[[0, 1, 5]] = x + h * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0"""


def export(subject: PlanarInput) -> PlanarExportResult:
    """A module with the class RovidVehicle."""
    columns = [one.name for one in subject.vehicle.thrusters]
    linear, absolute, _ = subject.damping
    lag = thruster_lag(subject.thrusters)
    terms = [_TERMS[key].format(**values) for key, values in subject.effects.items() if key in _TERMS]
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
        numbers=_NUMBERS.format(
            mass=subject.model.mass_matrix.tolist(),
            linear=linear.tolist(),
            absolute=absolute.tolist(),
            speed=float(np.hypot(north, east)),
            direction=float(np.arctan2(east, north)),
        ),
        methods=_METHODS.format(terms="".join(f"        force += np.array({term})\n" for term in terms)),
        advance=_ADVANCE,
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

    kept = {key for key in subject.effects if key in _COUPLED or key in _TERMS or key in {lag.key, "current"}}
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
