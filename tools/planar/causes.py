"""Hidden causes, by the names of the catalogue, each in one or more forms."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tools.planar.motion import FIXED, RUDDER, Floats
from tools.planar.vehicles import Vehicle

NOTHING = "none"


@dataclass(frozen=True, kw_only=True)
class Cause:
    """What is hidden: changes of the hull and of the actuators' rows, a delay (s) or a current.

    ``parameters`` are the true values by the catalogue's names, where our law is the catalogue's.
    """

    effect: str
    form: str
    strength: float
    hull: Mapping[str, float] = field(default_factory=dict)
    rows: Mapping[tuple[int, int], float] = field(default_factory=dict)
    delay: float = 0.0
    current: float = 0.0  # m/s
    direction: float = 0.0  # rad, towards which the current flows
    memory: float = 0.0  # s, of a current that wanders; 0: constant
    parameters: Mapping[str, float] = field(default_factory=dict)
    thruster: str = ""
    in_catalogue: bool = True  # whether a form of the catalogue has this equation


FORMS: Mapping[str, tuple[str, ...]] = {
    "current": ("constant", "wandering"),
    "sway_yaw_damping": ("linear", "lift"),
    "cross_flow_drag": ("strips", "offset"),
    "speed_dependent_damping": ("linear", "quadratic"),
    "thruster_lag": ("thrust",),
    "command_delay": ("constant",),
    "thrust_asymmetry": ("gain",),
    "thruster_deadband": ("hard",),
    "thruster_imbalance": ("gain",),
    "bias_torque": ("yaw", "sway", "surge"),
}
OF_SHIPS = ("current",)  # what can be hidden in an MMG ship


def forces(vehicle: Vehicle) -> tuple[float, float, float]:
    """Damping (N, N, N m) at the full speeds."""
    h, (u, v, r) = vehicle.hull, vehicle.full
    return (
        (h.surge_linear + h.surge_quadratic * u) * u,
        (h.sway_linear + h.sway_quadratic * v) * v,
        (h.yaw_linear + h.yaw_quadratic * r) * r,
    )


@dataclass(frozen=True, kw_only=True)
class Scene:
    """What a cause is made for: vehicle, form, strength from 0 to 1 and beyond, sign, chance."""

    vehicle: Vehicle
    form: str
    k: float
    sign: float
    rng: np.random.Generator

    @property
    def thrusters(self) -> list[int]:
        """Places of all actuators but rudders."""
        return [i for i, one in enumerate(self.vehicle.actuators) if one.kind != RUDDER]

    @property
    def fast(self) -> float:
        """Shortest time constant of surge and yaw in s."""
        taus = self.vehicle.time_constants
        return min(taus[0], taus[2])


def _current(s: Scene) -> dict[str, Any]:
    speed = s.vehicle.full[0] * (0.08 + 0.3 * s.k)
    way = float(s.rng.uniform(-math.pi, math.pi))
    longest = max(s.vehicle.time_constants)
    memory = longest * float(s.rng.uniform(60.0, 200.0)) if s.form == "wandering" else 0.0
    named = {} if memory else {"speed": speed, "direction": way}
    return {"current": speed, "direction": way, "memory": memory, "parameters": named}


def _sway_yaw_damping(s: Scene) -> dict[str, Any]:
    hull = s.vehicle.hull
    largest = math.sqrt(hull.sway_linear * hull.yaw_linear)
    if s.form == "linear":
        # The symmetric part stays positive semidefinite: (Y_r + N_v)^2 <= 4 Y_v N_r.
        size = s.sign * min(0.15 + 0.65 * s.k, 1.0) * largest
        values = {"Y_r": size, "N_v": size * float(s.rng.uniform(0.5, 1.0))}
    else:
        size = s.sign * (0.1 + 0.6 * s.k) * 2.0 * largest / s.vehicle.full[0]
        values = {"Y_ur": size, "N_uv": size * float(s.rng.uniform(0.5, 1.0))}
    resisting = {"yaw_by_sway": -values.get("N_v", values.get("N_uv", 0.0)),
                 "sway_by_yaw": -values.get("Y_r", values.get("Y_ur", 0.0))}  # fmt: skip
    return {"hull": values, "parameters": resisting}


def _cross_flow_drag(s: Scene) -> dict[str, Any]:
    # Most of the quadratic damping of sway and yaw moves into the strips, which may lie unevenly about the origin.
    hull, length = s.vehicle.hull, s.vehicle.length
    share = 0.5 + 0.4 * min(s.k, 1.0)
    strip = share * hull.sway_quadratic / length * float(s.rng.uniform(0.8, 1.25))
    values = {
        "strip": strip, "strip_length": length, "sway_quadratic": (1.0 - share) * hull.sway_quadratic,
        "yaw_quadratic": (1.0 - share) * hull.yaw_quadratic,
    }  # fmt: skip
    if s.form == "offset":
        values["strip_centre"] = s.sign * (0.05 + 0.2 * s.k) * length
        return {"hull": values, "in_catalogue": False}
    return {"hull": values, "parameters": {"coefficient": strip, "length": length}}


def _speed_dependent_damping(s: Scene) -> dict[str, Any]:
    u, v, r = s.vehicle.full
    _, y_force, n_force = forces(s.vehicle)
    size = (0.2 + 1.5 * s.k) * float(s.rng.uniform(0.8, 1.25))
    if s.form == "quadratic":
        value = size * n_force / r / u**2
        return {"hull": {"N_uur": value}, "parameters": {"yaw": value, "sway": 0.0}}
    values = {"N_ur": size * n_force / r / u}
    if s.rng.random() < 0.5:
        values["Y_uv"] = size * y_force / v / u
    return {"hull": values, "parameters": {"yaw": values["N_ur"], "sway": values.get("Y_uv", 0.0)}}


def _thruster_lag(s: Scene) -> dict[str, Any]:
    lag = (0.1 + 0.5 * s.k) * s.fast
    return {"rows": {(i, 6): lag for i in s.thrusters}, "parameters": {"time_constant": lag}}


def _command_delay(s: Scene) -> dict[str, Any]:
    delay = (0.08 + 0.4 * s.k) * s.fast
    return {"delay": delay, "parameters": {"delay": delay}}


def _thrust_asymmetry(s: Scene) -> dict[str, Any]:
    gain = 0.98 - 0.45 * min(s.k, 1.0)
    return {"rows": {(i, 8): gain for i in s.thrusters}, "parameters": {"reverse_gain": gain}}


def _thruster_deadband(s: Scene) -> dict[str, Any]:
    zone = (0.03 + 0.15 * s.k) * s.vehicle.span
    return {"rows": {(i, 7): zone for i in s.thrusters}, "parameters": {"deadband": zone}}


def _thruster_imbalance(s: Scene) -> dict[str, Any]:
    fixed = [i for i in s.thrusters if s.vehicle.actuators[i].kind == FIXED] or s.thrusters
    weak = int(s.rng.choice(fixed))
    gain = 0.98 - 0.5 * min(s.k, 1.0)
    name = s.vehicle.actuators[weak].name
    return {"rows": {(weak, 9): gain}, "parameters": {"gain": gain}, "thruster": name}


def _bias(s: Scene) -> dict[str, Any]:
    x_force, y_force, n_force = forces(s.vehicle)
    attribute, size = {"yaw": ("bias_n", n_force), "sway": ("bias_y", 0.5 * y_force),
                       "surge": ("bias_x", 0.5 * x_force)}[s.form]  # fmt: skip
    value = s.sign * (0.02 + 0.25 * s.k) * size
    others = dict.fromkeys(("surge", "sway", "yaw"), 0.0)
    return {"hull": {attribute: value}, "parameters": others | {s.form: value}}


_MAKERS: Mapping[str, Callable[[Scene], dict[str, Any]]] = {
    "current": _current,
    "sway_yaw_damping": _sway_yaw_damping,
    "cross_flow_drag": _cross_flow_drag,
    "speed_dependent_damping": _speed_dependent_damping,
    "thruster_lag": _thruster_lag,
    "command_delay": _command_delay,
    "thrust_asymmetry": _thrust_asymmetry,
    "thruster_deadband": _thruster_deadband,
    "thruster_imbalance": _thruster_imbalance,
    "bias_torque": _bias,
}


def make(vehicle: Vehicle, effect: str, form: str, k: float, rng: np.random.Generator) -> Cause:
    """The cause of strength ``k`` from 0 to 1 and beyond."""
    scene = Scene(vehicle=vehicle, form=form, k=k, sign=float(rng.choice([-1.0, 1.0])), rng=rng)
    return Cause(effect=effect, form=form, strength=k, **_MAKERS[effect](scene))


def rows_with(vehicle: Vehicle, cause: Cause | None) -> Floats:
    """Rows of the actuators as they act."""
    rows = vehicle.rows()
    for place, value in (cause.rows if cause else {}).items():
        rows[place] = value
    return rows


def suits(vehicle: Vehicle, effect: str) -> bool:
    """Whether the cause can be hidden in this vehicle."""
    if vehicle.ship.length:
        return effect in OF_SHIPS
    count = sum(one.kind != RUDDER for one in vehicle.actuators)
    reverses = vehicle.family in {"rov", "usv", "auv_lateral"}
    return not (effect == "thruster_imbalance" and count < 2) and (effect != "thrust_asymmetry" or reverses)
