"""The vehicle in the water: the torque balance with every state that something hidden can add, compiled.

One Runge-Kutta step from knot to knot; nothing given (thrust, torques, factors) jumps inside a step.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numba
import numpy as np

from tools.hidden import Hidden
from tools.truth import Dynamics, FloatArray, Truth

_compiled = numba.njit(cache=True)
_inlined = numba.njit(cache=True, forceinline=True)

# Places in the state; those of the thrusters' lags follow.
HEADING, RATE, LOAD, SWEPT, MEMORY, SWIRL, MODE, MODE_RATE, LAGS = range(9)

_KT = (0.24, -0.25, -0.66, 0.50)  # Minerva's KT(J), EFFECTS.md E07


class Water(NamedTuple):
    """Parameters of the torque balance, in SI units; the defaults leave the plain model.

    A ``*_form`` chooses among the forms of an effect; 0 is none of them.
    """

    inertia: float
    quadratic: float
    linear: float
    sag: float = 0.0
    sag_time: float = 1.0
    sag_thrust: float = 1.0
    lag_form: float = 0.0  # 1: first order, 2: quadratic, 3: before the curve
    lag_time: float = 1.0
    lag_thrust: float = 1.0
    advance_form: float = 0.0  # 1: bilinear, 2: open water
    advance: float = 0.0
    cubic: float = 0.0
    exponent: float = 2.0
    exponent_rate: float = 1.0
    astern_quadratic: float = 1.0  # factors on the drag where r < 0
    astern_linear: float = 1.0
    coulomb: float = 0.0
    coulomb_rate: float = 1.0
    coulomb_excess: float = 0.0
    coulomb_back: float = 1.0  # factor where r < 0
    viscous_back: float = 0.0  # N m s/rad where r < 0
    swept_form: float = 0.0  # 1: exponential, 2: algebraic
    swept_gain: float = 0.0
    swept_angle: float = 1.0
    memory_form: float = 0.0  # 1: trapped water, 2: Cummins, 3: porous
    memory_inertia: float = 0.0
    memory_time: float = 1.0
    memory_rate: float = 1.0
    swirl_form: float = 0.0  # 1: first order, 2: annulus
    swirl_coupling: float = 0.0
    swirl_time: float = 1.0
    swirl_inertia: float = 1.0
    swirl_friction: float = 0.0
    torsion: float = 0.0
    torsion_cubic: float = 0.0  # N m/rad^3
    once: float = 0.0  # N m, of sin(psi + once_phase)
    once_phase: float = 0.0
    twice: float = 0.0  # N m, of sin(2 psi + twice_phase)
    twice_phase: float = 0.0
    mode_form: float = 0.0  # 1: driven by acceleration, 2: by thrust
    mode_gain: float = 0.0
    mode_frequency: float = 1.0
    mode_damping: float = 0.0
    restoring: float = 0.0  # N m, of sin(angle - level)
    restoring_cubic: float = 0.0  # its bend, 1/rad^2 and 1/rad^4
    restoring_quintic: float = 0.0
    level: float = 0.0
    net_force: float = 0.0  # N, constant


_Values = Mapping[str, float]
Fields = dict[str, float]

# (effect, form) -> fields of Water.
_FIELDS: Mapping[tuple[str, str], Callable[[_Values], Fields]] = {
    ("supply_sag", "load"): lambda p: {"sag": p["sag"], "sag_time": p["time_constant"], "sag_thrust": p["thrust"]},
    ("thruster_lag", "first_order"): lambda p: {"lag_form": 1.0, "lag_time": p["time_constant"]},
    # This one has acted before the curve; here it only keeps the steps short.
    ("thruster_lag", "command"): lambda p: {"lag_form": 3.0, "lag_time": p["time_constant"]},
    ("thruster_lag", "quadratic"): lambda p: {
        "lag_form": 2.0,
        "lag_time": p["time_constant"],
        "lag_thrust": p["thrust"],
    },
    ("advance_speed_loss", "bilinear"): lambda p: {"advance_form": 1.0, "advance": p["coefficient"]},
    ("advance_speed_loss", "open_water"): lambda p: {"advance_form": 2.0, "advance": p["coefficient"]},
    ("drag_curvature", "cubic"): lambda p: {"cubic": p["cubic"]},
    ("drag_curvature", "exponent"): lambda p: {"exponent": p["exponent"], "exponent_rate": p["rate"]},
    ("drag_asymmetry", "quadratic"): lambda p: {"astern_quadratic": p["ratio"]},
    ("drag_asymmetry", "whole"): lambda p: {"astern_quadratic": p["ratio"], "astern_linear": p["ratio"]},
    ("coulomb_resistance", "smooth"): lambda p: {"coulomb": p["torque"], "coulomb_rate": p["rate"]},
    ("coulomb_resistance", "stiction"): lambda p: {
        "coulomb": p["torque"],
        "coulomb_rate": p["rate"],
        "coulomb_excess": 0.5,
    },
    ("coulomb_resistance", "unequal"): lambda p: {
        "coulomb": p["torque"],
        "coulomb_rate": p["rate"],
        "coulomb_back": p["back"],
        "viscous_back": p["viscous"] * p["torque"],
    },
    ("restoring_curve", "cubic"): lambda p: {"restoring_cubic": p["cubic"]},
    ("restoring_curve", "quintic"): lambda p: {"restoring_quintic": p["quintic"]},
    ("oscillatory_drag", "exponential"): lambda p: {
        "swept_form": 1.0,
        "swept_gain": p["gain"],
        "swept_angle": p["angle"],
    },
    ("oscillatory_drag", "algebraic"): lambda p: {
        "swept_form": 2.0,
        "swept_gain": p["gain"],
        "swept_angle": p["angle"],
    },
    ("added_mass_memory", "trapped_water"): lambda p: {
        "memory_form": 1.0,
        "memory_inertia": p["inertia"],
        "memory_time": p["time_constant"],
    },
    ("added_mass_memory", "cummins"): lambda p: {
        "memory_form": 2.0,
        "memory_inertia": p["inertia"],
        "memory_time": p["time_constant"],
    },
    ("added_mass_memory", "porous"): lambda p: {
        "memory_form": 3.0,
        "memory_inertia": p["inertia"],
        "memory_time": p["time_constant"],
        "memory_rate": p["rate"],
    },
    ("entrained_swirl", "first_order"): lambda p: {
        "swirl_form": 1.0,
        "swirl_coupling": p["coupling"],
        "swirl_time": p["time_constant"],
    },
    ("tether_torsion", "linear"): lambda p: {"torsion": p["stiffness"]},
    ("tether_torsion", "stiffening"): lambda p: {
        "torsion": p["stiffness"],
        "torsion_cubic": p["stiffness"] / p["angle"] ** 2,
    },
    ("heading_dependent_torque", "one_cycle"): lambda p: {"once": p["amplitude"], "once_phase": p["phase"]},
    ("heading_dependent_torque", "two_cycles"): lambda p: {"twice": p["amplitude"], "twice_phase": p["phase"]},
    ("heading_dependent_torque", "current"): lambda p: {
        "once": p["amplitude"],
        "once_phase": p["phase"],
        "twice": 0.6 * p["amplitude"],
        "twice_phase": 2.0 * p["phase"],
    },
    ("tank_seiche", "acceleration"): lambda p: _mode(1.0, p),
    ("tank_seiche", "thrust"): lambda p: _mode(2.0, p),
}


def _mode(form: float, p: _Values) -> Fields:
    return {"mode_form": form, "mode_gain": p["gain"], "mode_frequency": p["frequency"], "mode_damping": p["damping"]}


def water(truth: Truth, hidden: Mapping[str, Hidden]) -> Water:
    """Parameters of the torque balance of ``truth`` with what acts of ``hidden``."""
    dynamics = truth.dynamics
    fields: Fields = {
        "inertia": dynamics.inertia,
        "quadratic": dynamics.quadratic_drag,
        "linear": dynamics.linear_drag,
        "restoring": dynamics.restoring,
        "level": dynamics.level,
        "net_force": dynamics.net_force,
    }
    for one in hidden.values():
        if (one.effect, one.form) == ("entrained_swirl", "annulus"):
            fields |= _annulus(dynamics, one.parameters)
        elif (one.effect, one.form) in _FIELDS:
            fields |= _FIELDS[one.effect, one.form](one.parameters)
    return Water(**fields)


def shortest(w: Water) -> float:
    """Shortest time constant in s of the states that something hidden adds; infinite without any."""
    times = [
        w.sag_time if w.sag else math.inf,
        w.lag_time if w.lag_form else math.inf,
        w.memory_time if w.memory_form else math.inf,
        w.swirl_time if w.swirl_form == 1.0 else math.inf,
        1.0 / w.mode_frequency if w.mode_form else math.inf,
        w.coulomb_rate * w.inertia / abs(w.coulomb) if w.coulomb else math.inf,
    ]
    return min(times)


def _annulus(dynamics: Dynamics, p: _Values) -> Fields:
    """Inertia and wall friction by which a steady ``rate`` carries the annulus along at ``coupling`` times it.

    Near there I_f d(w)/dt = drag - C w^2 relaxes in I_f/(2 C w + drag's slope).
    """
    along = p["coupling"] * p["rate"]
    slip = p["rate"] - along
    drag = dynamics.quadratic_drag * slip**2 + dynamics.linear_drag * slip
    friction = drag / along**2
    slope = 2.0 * dynamics.quadratic_drag * slip + dynamics.linear_drag
    inertia = p["time_constant"] * (2.0 * friction * along + slope)
    return {"swirl_form": 2.0, "swirl_inertia": inertia, "swirl_friction": friction}


@_inlined
def _drag(rate: float, swept: float, w: Water) -> float:
    """Torque in N m of the water on a hull that turns through it at ``rate`` in rad/s."""
    square = w.quadratic
    line = w.linear
    if rate < 0.0:
        square *= w.astern_quadratic
        line *= w.astern_linear
    if w.exponent != 2.0 and rate != 0.0:
        square *= (abs(rate) / w.exponent_rate) ** (w.exponent - 2.0)
    if w.swept_form == 1.0:
        square *= 1.0 + w.swept_gain * math.exp(-swept / w.swept_angle)
    elif w.swept_form == 2.0:
        square *= 1.0 + w.swept_gain / (1.0 + swept / w.swept_angle)
    return (square * abs(rate) + line) * rate + w.cubic * rate**3


@_inlined
def _moving_thrust(thrust: float, arm: float, rate: float, w: Water) -> float:
    """Thrust in N of a thruster that the turning vehicle carries through the water."""
    if w.advance_form == 0.0 or thrust == 0.0:
        return thrust
    root = math.sqrt(abs(thrust))
    if w.advance_form == 1.0:
        return thrust - w.advance * root * arm * rate
    j = w.advance * arm * rate / root * math.copysign(1.0, thrust)
    j = min(max(j, -0.6), 0.6)  # beyond, the polynomial means nothing
    return thrust * (_KT[0] + j * (_KT[1] + j * (_KT[2] + j * _KT[3]))) / _KT[0]


@_inlined
def _holding(heading: float, rate: float, start: float, w: Water) -> float:
    """Torque in N m that depends on where the vehicle points and which way it moves, and the constant one."""
    turned = heading - start
    torque = -w.torsion * turned - w.torsion_cubic * turned**3
    if w.restoring != 0.0:
        tilt = heading - w.level
        bend = 1.0 + w.restoring_cubic * tilt**2 + w.restoring_quintic * tilt**4
        torque -= w.restoring * bend * math.sin(tilt)
    if w.net_force != 0.0:
        torque += w.net_force
    if w.once != 0.0:
        torque += w.once * math.sin(heading + w.once_phase)
    if w.twice != 0.0:
        torque += w.twice * math.sin(2.0 * heading + w.twice_phase)
    if w.coulomb != 0.0:
        excess = w.coulomb_excess * math.exp(-((rate / (5.0 * w.coulomb_rate)) ** 2))
        friction = w.coulomb * (1.0 + excess) * math.tanh(rate / w.coulomb_rate)
        torque -= friction if rate > 0.0 else w.coulomb_back * friction + w.viscous_back * rate
    return torque


@_inlined
def _thrusters(y: FloatArray, out: FloatArray, commanded: FloatArray, arms: FloatArray, w: Water) -> float:
    """Torque in N m of the thrusters; writes the slopes of load and lags into ``out``."""
    load = 0.0
    for i in range(len(arms)):
        load += abs(commanded[i])
    out[LOAD] = (load / w.sag_thrust - y[LOAD]) / w.sag_time if w.sag != 0.0 else 0.0
    torque = 0.0
    for i in range(len(arms)):
        thrust = commanded[i]
        if w.sag != 0.0:
            thrust *= 1.0 - w.sag * y[LOAD]
        state = y[LAGS + i]
        out[LAGS + i] = 0.0
        if w.lag_form == 1.0:
            out[LAGS + i] = (thrust - state) / w.lag_time
            thrust = state
        elif w.lag_form == 2.0:
            # The state is the speed, scaled so that its signed square is the thrust.
            out[LAGS + i] = (thrust - state * abs(state)) / (2.0 * w.lag_time * math.sqrt(w.lag_thrust))
            thrust = state * abs(state)
        torque += arms[i] * _moving_thrust(thrust, arms[i], y[RATE], w)
    return torque


@_inlined
def _memory(rate: float, state: float, w: Water) -> tuple[float, float]:
    """Torque in N m of water that remembers, and the slope of its state."""
    if w.memory_form == 1.0:
        slope = (rate - state) / w.memory_time
        return -w.memory_inertia * slope, slope
    if w.memory_form == 2.0:
        return -state, -state / w.memory_time + w.memory_inertia * rate / w.memory_time**2
    if w.memory_form == 3.0:
        slip = rate - state
        slope = slip * abs(slip) / (w.memory_time * w.memory_rate)
        return -w.memory_inertia * slope, slope
    return 0.0, 0.0


@_inlined
def _slope(
    y: FloatArray,
    out: FloatArray,
    commanded: FloatArray,
    arms: FloatArray,
    outer: float,
    drag_factor: float,
    damping: float,
    scale: float,
    drift: float,
    start: float,
    w: Water,
) -> None:
    """Slope of the state ``y`` into ``out``; ``scale`` and ``drift`` are those of psidot = scale*r + drift."""
    rate = y[RATE]
    thrusters = _thrusters(y, out, commanded, arms, w)
    drag = drag_factor * _drag(rate - y[SWIRL], y[SWEPT], w)
    memory, out[MEMORY] = _memory(rate, y[MEMORY], w)
    torque = thrusters + outer - drag - damping * rate + _holding(y[HEADING], rate, start, w) + memory
    if w.mode_form != 0.0:
        torque -= w.mode_gain * w.inertia * w.mode_frequency * y[MODE_RATE]
    out[HEADING] = scale * rate + drift
    out[RATE] = torque / w.inertia
    out[SWEPT] = abs(rate)
    out[SWIRL] = 0.0
    if w.swirl_form == 1.0:
        out[SWIRL] = (w.swirl_coupling * rate - y[SWIRL]) / w.swirl_time
    elif w.swirl_form == 2.0:
        out[SWIRL] = (drag - w.swirl_friction * abs(y[SWIRL]) * y[SWIRL]) / w.swirl_inertia
    out[MODE] = y[MODE_RATE]
    out[MODE_RATE] = 0.0
    if w.mode_form != 0.0:
        drive = out[RATE] if w.mode_form == 1.0 else thrusters / w.inertia
        own = 2.0 * w.mode_damping * w.mode_frequency * y[MODE_RATE] + w.mode_frequency**2 * y[MODE]
        out[MODE_RATE] = drive - own


@_inlined
def _along(y: FloatArray, length: float, slope: FloatArray, out: FloatArray) -> None:
    """The state so far along ``slope`` from ``y`` into ``out``."""
    for i in range(len(y)):
        out[i] = y[i] + length * slope[i]


@_compiled
def integrate(
    length: FloatArray,
    commanded: FloatArray,
    arms: FloatArray,
    outer: FloatArray,
    drag_factor: FloatArray,
    damping: FloatArray,
    scale: FloatArray,
    drift: FloatArray,
    heading: float,
    w: Water,
) -> FloatArray:
    """(steps + 1, states) from rest at ``heading`` in rad: classical fourth-order Runge-Kutta.

    ``length`` of the steps is in s; ``commanded`` thrust in N is (3, steps, thrusters), ``outer`` torque in N m,
    ``drag_factor`` and ``damping`` in N m s/rad are (3, steps), at the start, the middle and the end of each step.
    """
    states = np.zeros((len(length) + 1, LAGS + len(arms)))
    states[0, HEADING] = heading
    k1, k2, k3, k4, between = np.zeros((5, states.shape[1]))
    for k in range(len(length)):
        h = length[k]
        y, after = states[k], states[k + 1]
        u, o, f, d = commanded[:, k], outer[:, k], drag_factor[:, k], damping[:, k]
        _slope(y, k1, u[0], arms, o[0], f[0], d[0], scale[k], drift[k], heading, w)
        _along(y, 0.5 * h, k1, between)
        _slope(between, k2, u[1], arms, o[1], f[1], d[1], scale[k], drift[k], heading, w)
        _along(y, 0.5 * h, k2, between)
        _slope(between, k3, u[1], arms, o[1], f[1], d[1], scale[k], drift[k], heading, w)
        _along(y, h, k3, between)
        _slope(between, k4, u[2], arms, o[2], f[2], d[2], scale[k], drift[k], heading, w)
        for i in range(len(y)):
            after[i] = y[i] + h * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]) / 6.0
        if y[RATE] * after[RATE] < 0.0:
            # Reversed inside the step: what has been swept since is the part of it after the zero.
            after[SWEPT] = 0.5 * after[RATE] ** 2 / abs(after[RATE] - y[RATE]) * h
    return states
