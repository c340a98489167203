"""Motion of a vehicle in the horizontal plane, integrated by the classical Runge-Kutta method.

Written from Fossen (2011), sections 6.3 to 6.7 and 8.1: the state is the velocity relative to the water,

    M nu_r_dot + C(nu_r) nu_r + D(nu_r) nu_r = tau + d.

With a current that is uniform in space this form is exact for a neutrally buoyant vehicle, also while the current
changes. A tanker has the hull of the MMG model instead: Yasukawa and Yoshimura (2015), equations 3 to 24.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SEND, ARRIVE, RECORD, STEP = 0, 1, 2, 3  # kinds of events
FIXED, AZIMUTH, RUDDER = 0, 1, 2  # kinds of actuators
N_STATE = 6  # north, east, heading, surge, sway (through the water), yaw rate; the thrusts follow
RHO = 1000.0  # kg/m^3


class Hull(NamedTuple):
    """Coefficients of the hull in SI units. Dampings that resist are positive; Y_r to N_v are SNAME derivatives."""

    surge_inertia: float
    sway_inertia: float
    sway_yaw_inertia: float
    yaw_inertia: float
    surge_linear: float
    surge_quadratic: float
    sway_linear: float
    sway_quadratic: float
    yaw_linear: float
    yaw_quadratic: float
    Y_r: float = 0.0  # N s/rad
    N_v: float = 0.0  # N s
    Y_ur: float = 0.0  # kg, of abs(u) r
    N_uv: float = 0.0  # kg, of abs(u) v
    strip: float = 0.0  # N s^2/m^3, 0.5 rho Cd T of the cross-flow integral
    strip_length: float = 0.0  # m
    strip_centre: float = 0.0  # m
    Y_uv: float = 0.0  # kg/m, resists: of abs(u) v
    N_ur: float = 0.0  # kg m, resists: of abs(u) r
    N_uur: float = 0.0  # kg s, resists: of u^2 r
    bias_x: float = 0.0  # N
    bias_y: float = 0.0  # N
    bias_n: float = 0.0  # N m


class Ship(NamedTuple):
    """An MMG ship (Yasukawa and Yoshimura 2015): dimensions in m and kg, dimensionless derivatives."""

    length: float = 0.0  # 0: no ship
    draught: float = 0.0
    mass: float = 0.0
    x_g: float = 0.0
    m_x: float = 0.0  # added masses, kg and kg m^2
    m_y: float = 0.0
    j_z: float = 0.0
    i_z: float = 0.0  # about the centre of gravity
    R0: float = 0.0
    X_vv: float = 0.0
    X_vr: float = 0.0
    X_rr: float = 0.0
    X_vvvv: float = 0.0
    Y_v: float = 0.0
    Y_r: float = 0.0
    Y_vvv: float = 0.0
    Y_vvr: float = 0.0
    Y_vrr: float = 0.0
    Y_rrr: float = 0.0
    N_v: float = 0.0
    N_r: float = 0.0
    N_vvv: float = 0.0
    N_vvr: float = 0.0
    N_vrr: float = 0.0
    N_rrr: float = 0.0
    propeller: float = 0.0  # diameter
    t_p: float = 0.0
    w_p0: float = 0.0
    x_p: float = 0.0  # over the length
    k0: float = 0.0
    k1: float = 0.0
    k2: float = 0.0
    c1: float = 0.0
    c2_plus: float = 0.0
    c2_minus: float = 0.0
    rudder_area: float = 0.0
    rudder_slope: float = 0.0  # f_alpha
    t_r: float = 0.0
    a_h: float = 0.0
    x_h: float = 0.0  # over the length
    x_r: float = 0.0
    gamma_minus: float = 0.0
    gamma_plus: float = 0.0
    l_r: float = 0.0  # over the length
    epsilon: float = 0.0
    kappa: float = 0.0
    eta: float = 0.0  # propeller's diameter over the rudder's height


class Pilot(NamedTuple):
    """Heading feedback: kind 0 none, 1 a controller of the heading, 2 a zigzag by ``angle``."""

    kind: int = 0
    gain: float = 0.0  # share of full yaw demand for each rad
    damping: float = 0.0  # share for each rad/s
    angle: float = 0.0  # rad
    demand: float = 0.0  # share of full yaw demand in a zigzag
    first: float = 1.0  # a zigzag's first turn: 1 to starboard, -1 to port


@numba.njit(cache=True)
def _mmg(s: Ship, u: float, v: float, r: float, revolutions: float, angle: float, rates: Floats) -> None:
    """Accelerations of an MMG ship; a positive rudder angle turns it to starboard."""
    length, speed = s.length, math.sqrt(u * u + v * v) + 1e-9
    v_, r_ = v / speed, r * length / speed
    beta = math.atan2(-v, u)
    # Hull, equation 8.
    x_h = -s.R0 + s.X_vv * v_ * v_ + s.X_vr * v_ * r_ + s.X_rr * r_ * r_ + s.X_vvvv * v_**4
    y_h = s.Y_v * v_ + s.Y_r * r_ + s.Y_vvv * v_**3 + s.Y_vvr * v_ * v_ * r_ + s.Y_vrr * v_ * r_ * r_
    y_h += s.Y_rrr * r_**3
    n_h = s.N_v * v_ + s.N_r * r_ + s.N_vvv * v_**3 + s.N_vvr * v_ * v_ * r_ + s.N_vrr * v_ * r_ * r_
    n_h += s.N_rrr * r_**3
    force = 0.5 * RHO * length * s.draught * speed * speed
    # Propeller, equations 9 to 16.
    beta_p = beta - s.x_p * r_
    c2 = s.c2_plus if beta_p > 0.0 else s.c2_minus
    wake = 1.0 - (1.0 - s.w_p0) * (1.0 + (1.0 - math.exp(-s.c1 * abs(beta_p))) * (c2 - 1.0))
    advance = u * (1.0 - wake) / (revolutions * s.propeller)
    k_t = s.k0 + s.k1 * advance + s.k2 * advance * advance
    thrust = (1.0 - s.t_p) * RHO * revolutions**2 * s.propeller**4 * k_t
    # Rudder, equations 17 to 24.
    beta_r = beta - s.l_r * r_
    gamma = s.gamma_minus if beta_r < 0.0 else s.gamma_plus
    v_r = speed * gamma * beta_r
    load = math.sqrt(max(1.0 + 8.0 * k_t / (math.pi * max(advance, 0.05) ** 2), 0.0))
    inner = s.eta * (1.0 + s.kappa * (load - 1.0)) ** 2 + (1.0 - s.eta)
    u_r = s.epsilon * u * (1.0 - wake) * math.sqrt(inner)
    alpha = angle - math.atan2(v_r, u_r)
    normal = 0.5 * RHO * s.rudder_area * (u_r * u_r + v_r * v_r) * s.rudder_slope * math.sin(alpha)
    x = force * x_h + thrust - (1.0 - s.t_r) * normal * math.sin(angle) + rates[3]
    y = force * y_h - (1.0 + s.a_h) * normal * math.cos(angle) + rates[4]
    n = force * length * n_h - (s.x_r + s.a_h * s.x_h) * length * normal * math.cos(angle) + rates[5]
    # Equation 4.
    x += (s.mass + s.m_y) * v * r + s.x_g * s.mass * r * r
    y -= (s.mass + s.m_x) * u * r
    n -= s.x_g * s.mass * u * r
    a, b = s.mass + s.m_y, s.x_g * s.mass
    c = s.i_z + s.x_g * s.x_g * s.mass + s.j_z
    rates[3] = x / (s.mass + s.m_x)
    rates[4] = (c * y - b * n) / (a * c - b * b)
    rates[5] = (a * n - b * y) / (a * c - b * b)


@numba.njit(cache=True)
def _cross_flow(h: Hull, v: float, r: float) -> tuple[float, float]:
    """Force and moment of the strips, Fossen (2011), equations 6.91 and 6.92; exact for a quadratic integrand."""
    low = h.strip_centre - 0.5 * h.strip_length
    high = h.strip_centre + 0.5 * h.strip_length
    middle = high
    if r != 0.0:
        middle = min(max(-v / r, low), high)
    y, n = 0.0, 0.0
    for a, b in ((low, middle), (middle, high)):
        centre = 0.5 * (a + b)
        sign = 1.0 if v + centre * r > 0.0 else -1.0
        half = 0.5 * (b - a) * math.sqrt(0.6)  # three points of Gauss: exact up to the fifth power
        for at, weight in ((centre - half, 5.0), (centre, 8.0), (centre + half, 5.0)):
            share = weight / 18.0 * (b - a) * sign * (v + at * r) ** 2
            y += share
            n += at * share
    return -h.strip * y, -h.strip * n


@numba.njit(cache=True)
def _hull(h: Hull, u: float, v: float, r: float, rates: Floats) -> None:
    """Accelerations from the forces in ``rates`` [3:6], Fossen (2011), equations 6.37, 6.43 and 6.57."""
    y_strip, n_strip = _cross_flow(h, v, r) if h.strip else (0.0, 0.0)
    momentum = h.sway_inertia * v + h.sway_yaw_inertia * r
    x = rates[3] + h.bias_x + momentum * r - (h.surge_linear + h.surge_quadratic * abs(u)) * u
    y = rates[4] + h.bias_y - h.surge_inertia * u * r - (h.sway_linear + h.sway_quadratic * abs(v)) * v
    y += h.Y_r * r + h.Y_ur * abs(u) * r - h.Y_uv * abs(u) * v + y_strip
    n = rates[5] + h.bias_n - momentum * u + h.surge_inertia * u * v
    n -= (h.yaw_linear + h.yaw_quadratic * abs(r)) * r
    n += h.N_v * v + h.N_uv * abs(u) * v - h.N_ur * abs(u) * r - h.N_uur * u * u * r + n_strip
    a, b, c = h.sway_inertia, h.sway_yaw_inertia, h.yaw_inertia
    rates[3] = x / h.surge_inertia
    rates[4] = (c * y - b * n) / (a * c - b * b)
    rates[5] = (a * n - b * y) / (a * c - b * b)


@numba.njit(cache=True)
def _bench(command: float, rest: float, row: Floats, xs: Floats, ys: Floats) -> float:
    """Thrust (N) of a held command: dead band beyond the curve, curve, weaker astern, gain."""
    zone, reverse, gain = row[7], row[8], row[9]
    away = command - rest
    away = math.copysign(max(abs(away) - zone, 0.0), away)
    thrust = np.interp(rest + away, xs, ys)
    return float(gain * (thrust * reverse if thrust < 0.0 else thrust))


@numba.njit(cache=True)
def slopes(
    state: Floats, hull: Hull, ship: Ship, rows: Floats, rests: Floats, curves_x: Floats, curves_y: Floats,
    commands: Floats, water: Floats, rates: Floats,
) -> None:  # fmt: skip
    """Time derivatives (6 + n,) of the state; ``water`` has the forces and the current of the instant (5,)."""
    psi, u, v, r = state[2], state[3], state[4], state[5]
    cosine, sine = math.cos(psi), math.sin(psi)
    rates[0] = u * cosine - v * sine + water[3]
    rates[1] = u * sine + v * cosine + water[4]
    rates[2] = r
    rates[3], rates[4], rates[5] = water[0], water[1], water[2]
    if ship.length > 0.0:
        _mmg(ship, u, v, r, max(commands[0], 1e-3) / 60.0, math.radians(commands[1]), rates)
        return
    for i in range(rows.shape[0]):
        row = rows[i]
        if row[0] == RUDDER:
            continue
        thrust = _bench(commands[int(row[10])], rests[i], row, curves_x[i], curves_y[i])
        if row[6] > 0.0:
            rates[N_STATE + i] = (thrust - state[N_STATE + i]) / row[6]
            thrust = state[N_STATE + i]
        else:
            rates[N_STATE + i] = 0.0
        if row[0] == FIXED:
            rates[3] += row[1] * thrust
            rates[4] += row[2] * thrust
            rates[5] += row[3] * thrust
        else:
            angle = math.radians(commands[int(row[11])])
            rates[3] += math.cos(angle) * thrust
            rates[4] += math.sin(angle) * thrust
            rates[5] += (row[4] * math.sin(angle) - row[5] * math.cos(angle)) * thrust
    for i in range(rows.shape[0]):
        row = rows[i]
        if row[0] == RUDDER:
            # Flow at the rudder by momentum theory: the slipstream of the propeller ahead adds 2 T / (rho A).
            behind = int(row[12])
            push = (
                state[N_STATE + behind]
                if rows[behind, 6] > 0.0
                else _bench(
                    commands[int(rows[behind, 10])], rests[behind], rows[behind], curves_x[behind], curves_y[behind]
                )
            )
            ahead = math.sqrt(max(u, 0.0) ** 2 + row[13] * max(push, 0.0))
            across = v + row[4] * r
            angle = math.radians(commands[int(row[10])])
            # A positive angle turns the heading up: the rudder at the stern pushes to port.
            alpha = angle + math.atan2(across, ahead) if ahead > 0.0 else angle
            normal = row[14] * (ahead * ahead + across * across) * math.sin(min(max(alpha, -row[15]), row[15]))
            rates[3] -= normal * math.sin(angle)
            rates[4] -= normal * math.cos(angle)
            rates[5] -= row[4] * normal * math.cos(angle)
            rates[N_STATE + i] = 0.0
    _hull(hull, u, v, r, rates)


@numba.njit(cache=True)
def _water(series: Floats, step: float, t: float, out: Floats) -> None:
    """Forces and current at an instant, linear between the points of the series."""
    place = min(max(t / step, 0.0), series.shape[0] - 1.001)
    k = int(place)
    share = place - k
    for j in range(5):
        out[j] = (1.0 - share) * series[k, j] + share * series[k + 1, j]


@numba.njit(cache=True)
def _send(
    k: int, state: Floats, demands: Floats, setpoints: Floats, errors: Floats, pilot: Pilot, sense: Floats,
    allocation: Floats, limits: Floats, decimals: Ints, rests: Floats, interval: float, rows: Floats,
    curves_x: Floats, curves_y: Floats, commands: Floats,
) -> None:  # fmt: skip
    """Commands (n,) of one instant: demand and feedback, allocation, inverse bench curve, limits and rounding."""
    yaw = demands[k, 2]
    if pilot.kind == 1:
        off = setpoints[k] - state[2] - errors[k, 0]
        yaw = min(max(pilot.gain * off - pilot.damping * (state[5] + errors[k, 1]), -1.0), 1.0)
    elif pilot.kind == 2:
        off = state[2] + errors[k, 0] - setpoints[k]
        if off * sense[0] > pilot.angle:
            sense[0] = -sense[0]
        yaw = sense[0] * pilot.demand
    for i in range(rows.shape[0]):
        channel = int(rows[i, 10])
        a = allocation[i]
        along = a[0] * demands[k, 0] + a[1] * demands[k, 1] + a[2] * yaw
        if rows[i, 0] == RUDDER:
            commands[k, channel] = along * limits[channel, 0]
        elif rows[i, 0] == AZIMUTH:
            across = a[3] * demands[k, 0] + a[4] * demands[k, 1] + a[5] * yaw
            turn = int(rows[i, 11])
            last = commands[k - 1, turn] if k > 0 else 0.0
            wanted = math.degrees(math.atan2(across, along)) if along * along + across * across > 1e-6 else last
            # The shorter way round.
            commands[k, turn] = last + (wanted - last + 180.0) % 360.0 - 180.0
            along = math.sqrt(along * along + across * across)
        if rows[i, 0] != RUDDER:
            share = min(max(along, -1.0), 1.0)
            top = curves_y[i, -1] if share > 0.0 else -curves_y[i, 0]
            commands[k, channel] = np.interp(share * top, curves_y[i], curves_x[i]) if share != 0.0 else rests[i]
    for j in range(commands.shape[1]):
        if limits[j, 1] > 0.0 and k > 0:  # limit of the slope
            most = limits[j, 1] * interval
            commands[k, j] = min(max(commands[k, j], commands[k - 1, j] - most), commands[k - 1, j] + most)
        scale = 10.0 ** decimals[j]
        commands[k, j] = np.round(commands[k, j] * scale) / scale


@numba.njit(cache=True)
def _fill(target: Floats, source: Floats) -> None:
    """The first numbers of ``source`` into ``target``; numba takes a second to compile a slice."""
    for j in range(target.size):
        target[j] = source[j]


@numba.njit(cache=True)
def simulate(
    hull: Hull, ship: Ship, pilot: Pilot, rows: Floats, rests: Floats, curves_x: Floats, curves_y: Floats,
    allocation: Floats, limits: Floats, decimals: Ints, times: Floats, kinds: Ints, places: Ints, demands: Floats,
    setpoints: Floats, errors: Floats, replay: bool, commands: Floats, series: Floats, step: float, longest: float,
    state: Floats, record: Floats,
) -> None:  # fmt: skip
    """Integrate from event to event; ``commands`` (k, n) and ``record`` (m, 6) are filled, ``state`` is moved on.

    ``rows`` (n, 16) are kind, surge, sway, arm, x, y, lag, dead band, gain astern, gain, channel, channel of the angle,
    place of the propeller ahead, slipstream, rudder coefficient, largest incidence. Of a replay the commands are taken.
    """
    n = state.size
    k1, k2, k3, k4 = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    trial, water = np.empty(n), np.empty(5)
    sense = np.array([pilot.first])
    active = np.zeros(commands.shape[1])
    interval = 0.0
    now, previous, begun = times[0], times[0], False
    for e in range(times.size):
        span = times[e] - now
        count = max(math.ceil(span / longest - 1e-9), 1) if span > 0.0 else 0
        dt = span / count if count else 0.0
        for j in range(count):
            t = now + j * dt
            _water(series, step, t, water)
            slopes(state, hull, ship, rows, rests, curves_x, curves_y, active, water, k1)
            _water(series, step, t + 0.5 * dt, water)
            for i in range(n):
                trial[i] = state[i] + 0.5 * dt * k1[i]
            slopes(trial, hull, ship, rows, rests, curves_x, curves_y, active, water, k2)
            for i in range(n):
                trial[i] = state[i] + 0.5 * dt * k2[i]
            slopes(trial, hull, ship, rows, rests, curves_x, curves_y, active, water, k3)
            _water(series, step, t + dt, water)
            for i in range(n):
                trial[i] = state[i] + dt * k3[i]
            slopes(trial, hull, ship, rows, rests, curves_x, curves_y, active, water, k4)
            for i in range(n):
                state[i] += dt / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])
        now = times[e]
        place = places[e]
        if kinds[e] == SEND:
            if begun:
                interval = now - previous
            previous, begun = now, True
            if not replay:
                _send(
                    place, state, demands, setpoints, errors, pilot, sense, allocation, limits, decimals, rests,
                    interval, rows, curves_x, curves_y, commands,
                )  # fmt: skip
        elif kinds[e] == ARRIVE:
            _fill(active, commands[place])
        elif kinds[e] == RECORD:
            _fill(record[place], state)
