"""Fossen's simulators: PythonVehicleSimulator, and the Marine Systems Simulator (MSS) for MATLAB and Octave.

PythonVehicleSimulator: a vehicle class, for its vehicles have no parameter files and no free |r|*r term.

MSS: a function, [xdot, M, C, D] = rovid_vehicle(x, tau), as its vehicles are; the caller integrates it, here by the
classical Runge-Kutta method. Axes are NED and names of SNAME (1950), as in Fossen 2021, chapter 6. The verification
runs the text of the file, line by line.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.formatting import TextTemplates, python_docstring
from rovid.core.output_files import export_mark
from rovid.export.interface import PERIOD, ExportInput, ExportResult, Simulate, repeat_held, unit_forces
from rovid.export.planar_input import PlanarInput
from rovid.export.thruster_curves import THRUST_LAG, ThrusterCurve, number_list

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


def _simulation(content: str, columns: Sequence[int], shown: Sequence[int], newest: float) -> Simulate:
    """Simulation by the written class: commands in ``columns``, velocities ``shown`` of nu.

    The heading grows by the mean of the yaw rates before and after each step, the ``newest`` with this weight.
    """

    def simulate(commands: FloatArray) -> FloatArray:
        simulated = vehicle_in(content)
        nu, actual, eta, rows = simulated.nu, simulated.u_actual, np.zeros(6), []
        for control in repeat_held(commands[:, columns], STEP):
            rows.append(nu[shown])
            before = nu[5]
            nu, actual = simulated.dynamics(eta, nu, actual, control, STEP)
            eta[5] += STEP * ((1.0 - newest) * before + newest * nu[5])
        return np.array(rows[:: round(PERIOD / STEP)])

    return simulate


def export_module(subject: ExportInput) -> ExportResult:
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
        end="-1 if arm >= 0.0 else 0",  # All thrusters turn the vehicle the same way.
        force="torque",
        numbers=_TEXTS["numbers"].format(
            inertia=model.inertia, quadratic_drag=model.quadratic_drag, linear_drag=model.linear_drag
        ),
        methods=_TEXTS["methods"].format(terms="".join(terms)),
        advance=_TEXTS["advance"],
    )
    return ExportResult(
        content=content,
        simulate=_simulation(content, range(len(subject.curves)), [5], 1.0),
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


def export_planar_module(subject: PlanarInput) -> ExportResult:
    """A module with the class RovidVehicle."""
    names = [one.name for one in subject.vehicle.thrusters]
    columns = [names.index(curve.name) for curve in subject.curves]
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
        end="-1",
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
    kept = subject.effects.keys() & {*_COUPLED, *_PLANAR_TERMS, subject.lag.key, "current"}
    return ExportResult(
        content=content,
        equation=subject.own_equation(STEP),
        simulate=_simulation(content, columns, [0, 1, 5], 0.5),
        kept_effects=subject.curve_keys | kept,
        notes=(_NOTES[0], "Surge, sway and yaw move: heave, roll and pitch keep their velocity.", _NOTES[1]),
    )


# s, step of the verification, and of the verdict on stability.
MSS_STEP = 0.05
# Further terms of yaw: part of the damping D in N m s/rad, and of the torque in N m.
_YAW_DAMPING = {"drag_curvature": "{cubic!r}*r*r"}
_YAW_FACTORS = {"drag_asymmetry": "(1 + ({ratio!r} - 1)*(r < 0))"}
_YAW_TORQUES = {"bias_torque": "{torque!r}", "tether_torsion": "-{stiffness!r}*psi"}
_MSS_TEXTS = TextTemplates(__file__, "mss")
# Forms of the strip integral.
_STRIP_FORMS = {"cross_flow_drag", "cross_flow_drag:off_centre"}
_LETTERS, _SPEEDS = "XYN", "uvr"
_MSS_NOTES = (
    "Axes are NED and names of SNAME, as in MSS: no sign changes.",
    "The function takes the forces of the thrusters: turn commands into thrust by the curves in its comments.",
    f"The caller integrates: the verification and the verdict on stability are for rk4 with a step of {MSS_STEP:g} s.",
)


def _head(title: str, curves: Sequence[ThrusterCurve], levers: Sequence[str], **texts: str) -> str:
    lines = [
        f"%   {python_docstring(curve.name)}, {lever}: command {number_list(curve.command)} | thrust "
        f"{number_list(curve.thrust)}"
        for curve, lever in zip(curves, levers, strict=True)
    ]
    mark = export_mark("mss")
    title = python_docstring(title)
    return _MSS_TEXTS["head"].format(title=title, mark=mark, step=MSS_STEP, thrusters="\n".join(lines), **texts)


def export_mss(subject: ExportInput) -> ExportResult:
    """The function for yaw: x = (r, psi), tau = N."""
    model, curves = subject.model, subject.curves
    damping = " + ".join(["-Nr - Nrr*abs(r)", *_given(_YAW_DAMPING, subject.effects)])
    content = _head(
        subject.vehicle.name,
        curves,
        [f"yaw arm {curve.arm:.10g} m" for curve in curves],
        axes="yaw",
        equation="M*r_dot + C*r + D*r = N + tau_0",
        states="%   x   = [r psi]', yaw rate in rad/s and heading in rad\n%   tau = N, moment of the thrusters in N m",
    ) + _MSS_TEXTS["yaw"].format(
        rigid=subject.rigid_inertia,
        added=-subject.added_inertia,
        linear=-model.linear_drag,
        quadratic=-model.quadratic_drag,
        damping="*".join([f"({damping})", *_given(_YAW_FACTORS, subject.effects)]),
        torque=" + ".join(_given(_YAW_TORQUES, subject.effects)) or "0",
    )

    return ExportResult(
        content=content,
        simulate=lambda commands: _integrate(content, unit_forces(subject, commands, MSS_STEP)[:, 2:], np.zeros(2))[
            :, :1
        ],
        equation=subject.equation(MSS_STEP, **subject.drag_terms),
        kept_effects=subject.curve_keys | (subject.effects.keys() & {*_YAW_DAMPING, *_YAW_FACTORS, *_YAW_TORQUES}),
        notes=_MSS_NOTES,
    )


def export_planar_mss(subject: PlanarInput) -> ExportResult:
    """The function for surge, sway and yaw: x = (u, v, r, north, east, psi), tau = (X, Y, N)."""
    base, (linear, absolute, damped) = subject.model.base, subject.damping
    squared = subject.effects.get("speed_dependent_damping:planar_quadratic", {})
    numbers = {
        "Xudot": subject.mass - float(base[0]),
        "Yvdot": subject.mass - float(base[1]),
        "Yrdot": -float(base[3]),
        "Nrdot": subject.rigid_inertia - float(base[2]),
    }
    rows = []
    for i, force in enumerate(_LETTERS):
        cells = []
        for j, speed in enumerate(_SPEEDS):
            terms = []
            if linear[i, j]:
                numbers[force + speed] = -float(linear[i, j])
                terms.append(f"-{force}{speed}")
            for k, other in enumerate(_SPEEDS):
                if absolute[i, j, k]:
                    numbers[force + speed + other] = -float(absolute[i, j, k])
                    terms.append(f"-{force}{speed}{other}*abs({other})")
            if i == j > 0 and squared:
                numbers[f"{force}{speed}uu"] = -squared[("", "sway", "yaw")[i]]
                terms.append(f"-{force}{speed}uu*u*u")
            cells.append(" ".join(terms).replace(" -", " - ") or "0")
        rows.append(", ".join(cells))
    north, east = subject.model.current
    strips = [
        _MSS_TEXTS["strips"].format(**({"centre": 0.0} | dict(values)))
        for key, values in subject.effects.items()
        if key in _STRIP_FORMS
    ]
    arms = [
        f"levers {one.surge_share:.10g} ahead, {one.sway_share:.10g} to starboard, {one.arm:.10g} m in yaw"
        for one in subject.actuators.thrusters.thrusters
    ]
    content = _head(
        subject.vehicle.name,
        subject.curves,
        arms,
        axes="surge, sway and yaw",
        equation="M*nu_r_dot + C(nu_r)*nu_r + D(nu_r)*nu_r = tau + tau_0, nu_r through the water",
        states="%   x   = [u v r north east psi]', over ground: m/s, m/s, rad/s, m, m, rad\n"
        "%   tau = [X Y N]', forces of the thrusters in N, N and N m\n"
        "% Xuu and the like are derivatives by u*abs(u), Nvu by v*abs(u), Yvuu by v*u*u. Yrdot holds m*xg too.",
    ) + _MSS_TEXTS["planar"].format(
        mass=subject.mass,
        rigid=subject.rigid_inertia,
        derivatives="".join(f"{name} = {value!r};\n" for name, value in numbers.items()),
        speed=float(np.hypot(north, east)),
        direction=float(np.arctan2(east, north)),
        damping="; ".join(rows),
        constant="; ".join(map(repr, subject.bias.tolist())),
        strips="".join(strips),
    )

    others = {"current", "bias_torque:planar", "speed_dependent_damping:planar_quadratic", *_STRIP_FORMS}
    return ExportResult(
        content=content,
        equation=subject.own_equation(MSS_STEP),
        simulate=lambda commands: _integrate(content, unit_forces(subject, commands, MSS_STEP), np.zeros(6))[:, :3],
        kept_effects=subject.curve_keys | damped | (subject.effects.keys() & others),
        notes=_MSS_NOTES,
    )


def _given(texts: Mapping[str, str], effects: Mapping[str, Mapping[str, float]]) -> list[str]:
    """``texts`` of the effects of the model, with their numbers."""
    return [texts[key].format(**values) for key, values in effects.items() if key in texts]


def _integrate(content: str, forces: FloatArray, state: FloatArray) -> FloatArray:
    """(n, k) states at the beginning of each `PERIOD` by the file's text; (m, j) ``forces`` act for `MSS_STEP` each."""
    slope, states = derivative(content), []
    for tau in forces:
        states.append(state)
        a = slope(state, tau)
        b = slope(state + 0.5 * MSS_STEP * a, tau)
        c = slope(state + 0.5 * MSS_STEP * b, tau)
        d = slope(state + MSS_STEP * c, tau)
        state = state + MSS_STEP * (a + 2.0 * b + 2.0 * c + d) / 6.0
    return np.array(states[:: round(PERIOD / MSS_STEP)])


def derivative(content: str) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """The function of the file in Python, from state and forces to xdot.

    Of the language it knows what the exporters write: one assignment in a line, matrices in brackets on one line,
    products of C or D with spaces around the star, and the solution of linear equations with M at the end of a line.
    """
    lines = ["def run(x, tau):"]
    for line in content.splitlines():
        text = line.partition("%")[0].strip().rstrip(";")
        if not text or text == "end" or text.startswith("function "):
            continue
        text = re.sub(r"\b(x|tau|nu_r_dot|M)\(([\d,]+)\)", _element, text)
        text = re.sub(r"\[([^\[\]]*;[^\[\]]*)\](?!\w)", _matrix, text)
        text = re.sub(r"\b([CD]) \* ", r"\1 @ ", text.replace(".*", "*"))
        text = re.sub(r"M \\ \((.*)\)$", r"solve(M, \1)", text)
        lines.append(f"    {text}")
    space: dict[str, Any] = {name: getattr(np, name) for name in ("abs", "array", "cos", "linspace", "sin", "sum")}
    space["solve"] = np.linalg.solve
    exec("\n".join([*lines, "    return xdot"]), space)  # noqa: S102 - our own text, as its user runs it
    run: Callable[[FloatArray, FloatArray], FloatArray] = space["run"]
    return run


def _element(found: re.Match[str]) -> str:
    """An element by Python's indices, in marks that `_matrix` does not take for a matrix."""
    indices = ", ".join(str(int(one) - 1) for one in found[2].split(","))
    return f"{found[1]}.item({indices})"


def _matrix(found: re.Match[str]) -> str:
    rows = []
    for row in found[1].split(";"):
        several = "," in re.sub(r"\.item\([^)]*\)", "", row)
        rows.append(f"({row.strip()})" if several else row.strip())
    return f"array(({', '.join(rows)}))"
