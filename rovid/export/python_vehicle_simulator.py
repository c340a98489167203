"""PythonVehicleSimulator: a vehicle class, for its vehicles have no parameter files and no free |r|*r term."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.formatting import TextTemplates, python_docstring
from rovid.core.output_files import export_mark
from rovid.export.interface import PERIOD, ExportInput, ExportResult
from rovid.export.planar_input import PlanarInput
from rovid.export.resimulation import repeat_held
from rovid.export.thruster_curves import THRUST_LAG

STEP = 0.02  # s, of the simulator's main.py
# Further terms of the equation of motion in Python, torque in N m.
_TERMS = {
    "bias_torque": " + {torque!r}",
    "drag_curvature": " - {cubic!r} * r**3",
    "drag_asymmetry": " - ({ratio!r} - 1.0) * (self.DQ * abs(r) + self.DL) * r * (r < 0.0)",
    "tether_torsion": " - {stiffness!r} * psi",
}
_TEXTS = TextTemplates(__file__, "python_vehicle_simulator")
_NOTES = (
    "Axes are NED, as rovid's: no sign changes.",
    "The simulator's vehicles share no base class: the class has what its main loop calls.",
)


def _module(subject: ExportInput | PlanarInput, levers: Sequence[object], push: Mapping[str, str], **texts: str) -> str:
    """The module with the class.

    ``levers``: Lever, or levers, of the thrust of each thruster.
    ``push``: Expression of the forces, of the commands and of the thrusts ``u``.
    ``texts``: Places of the template that depend on the axes.
    """
    vehicle, curves, lag = subject.vehicle, subject.curves, subject.lag
    tables = ""
    for lever, curve in zip(levers, curves, strict=True):
        command, thrust = curve.command.tolist(), curve.thrust.tolist()
        tables += f"            ({lever!r}, {curve.neutral!r}, {command!r}, {thrust!r}),\n"
    # The lag acts on the thrust, behind the curves, or on the command.
    acting, goal, start = "command", "u_control", [curve.neutral for curve in curves]
    if lag.key == THRUST_LAG:
        acting, goal, start = "thrust", "self.thrusts(u_control)", [0.0] * len(curves)
    return _TEXTS["module"].format(
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
    model = subject.model
    terms = [_TERMS[key].format(**values) for key, values in subject.effects.items() if key in _TERMS]
    content = _module(
        subject,
        [curve.arm for curve in subject.curves],
        {"command": "self.torque(u)", "thrust": "float(np.dot(self.arms, u))"},
        axes="Yaw",
        frame="the yaw rate nu[5] in rad/s and the heading eta[5] in rad are positive clockwise from above",
        equation="I*rdot + DQ*|r|*r + DL*r = T",
        arms_text="Yaw arm in m",
        arms="arms",
        arm="arm",
        force="torque",
        numbers=_TEXTS["numbers"].format(
            inertia=model.inertia, quadratic_drag=model.quadratic_drag, linear_drag=model.linear_drag
        ),
        methods=_TEXTS["methods"].format(terms="".join(terms)),
        advance=_TEXTS["advance"],
    )

    def simulate(commands: FloatArray) -> FloatArray:
        simulated = vehicle_in(content)
        nu, actual, eta, rates = simulated.nu, simulated.u_actual, np.zeros(6), []
        for control in repeat_held(commands, STEP):
            rates.append(nu[5:])
            nu, actual = simulated.dynamics(eta, nu, actual, control, STEP)
            eta[5] += STEP * nu[5]
        return np.array(rates[:: round(PERIOD / STEP)])

    return ExportResult(
        content=content,
        simulate=simulate,
        equation=subject.equation(STEP, **subject.drag_terms),
        kept_effects=subject.curve_keys | (subject.effects.keys() & {*_TERMS, subject.lag.key}),
        notes=(_NOTES[0], "Yaw alone moves: surge to pitch keep their velocity.", _NOTES[1]),
    )


_COUPLED = {"sway_yaw_damping", "sway_yaw_damping:lift", "speed_dependent_damping:planar"}
# Further terms of the force in Python: (X, Y, N) of u, v, r.
_PLANAR_TERMS = {
    "speed_dependent_damping:planar_quadratic": "(0.0, -{sway!r} * u * u * v, -{yaw!r} * u * u * r)",
    "bias_torque:planar": "({surge!r}, {sway!r}, {yaw!r})",
    "cross_flow_drag": "self.strips({coefficient!r}, {length!r}, 0.0, v, r)",
    "cross_flow_drag:off_centre": "self.strips({coefficient!r}, {length!r}, {centre!r}, v, r)",
}


def export_planar(subject: PlanarInput) -> ExportResult:
    """A module with the class RovidVehicle."""
    columns = [one.name for one in subject.vehicle.thrusters]
    linear, absolute, _ = subject.damping
    terms = [_PLANAR_TERMS[key].format(**values) for key, values in subject.effects.items() if key in _PLANAR_TERMS]
    north, east = subject.model.current
    content = _module(
        subject,
        [(one.surge_share, one.sway_share, one.arm) for one in subject.actuators.thrusters.thrusters],
        {"command": "self.thrusts(u) @ self.levers", "thrust": "u @ self.levers"},
        axes="Surge, sway and yaw",
        frame="nu = (u, v, w, p, q, r) over ground, eta = (north, east, down, roll, pitch, heading)",
        equation="M*nu' + C(nu)*nu + D(nu)*nu = tau for (u, v, r) through the water",
        arms_text="Levers ahead, to starboard and in turn",
        arms="levers",
        arm="levers",
        force="tau",
        numbers=_TEXTS["planar_numbers"].format(
            mass=subject.model.mass_matrix.tolist(),
            linear=linear.tolist(),
            absolute=absolute.tolist(),
            speed=float(np.hypot(north, east)),
            direction=float(np.arctan2(east, north)),
        ),
        methods=_TEXTS["planar_methods"].format(
            terms="".join(f"        force += np.array({term})\n" for term in terms)
        ),
        advance=_TEXTS["planar_advance"],
    )

    def simulate(commands: FloatArray) -> FloatArray:
        simulated = vehicle_in(content)
        nu, actual, eta, rows = simulated.nu, simulated.u_actual, np.zeros(6), []
        chosen = commands[:, [columns.index(curve.name) for curve in subject.curves]]
        for control in repeat_held(chosen, STEP):
            rows.append(nu[[0, 1, 5]])
            before = nu[5]
            nu, actual = simulated.dynamics(eta, nu, actual, control, STEP)
            eta[5] += 0.5 * STEP * (before + nu[5])
        return np.array(rows[:: round(PERIOD / STEP)])

    kept = subject.effects.keys() & {*_COUPLED, *_PLANAR_TERMS, subject.lag.key, "current"}
    return ExportResult(
        content=content,
        equation=subject.own_equation(STEP),
        simulate=simulate,
        kept_effects=subject.curve_keys | kept,
        notes=(_NOTES[0], "Surge, sway and yaw move: heave, roll and pitch keep their velocity.", _NOTES[1]),
    )
