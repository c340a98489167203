"""Equations of motion of the planar model, compiled: Runge-Kutta steps and free-running simulation.

The functions at the end are their reference, in plain numpy. State: heading; u, v, r through the water; disturbances X,
Y, N; change of the current to north and to east; position to north and to east. Arrays have room for all of them. Rows
that are not in use stay zero.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.base import Coupling
from rovid.effects.bias_torque import planar_forces
from rovid.effects.cross_flow_drag import off_centre_forces, ship_forces, strip_forces
from rovid.effects.speed_dependent_damping import coupled_forces, coupled_quadratic_forces
from rovid.effects.sway_yaw_damping import lift_forces, linear_forces
from rovid.jit.decorators import compiled
from rovid.planar.model import (
    BASE_COUNT,
    COUPLING_INDEX,
    CURRENT_INDEX,
    INPUT_COUNT,
    RUDDER_COUNT,
    RUDDER_INDEX,
    RUDDER_INPUTS,
    PlanarModel,
)

_LINEAR = COUPLING_INDEX["sway_yaw_damping"]
_LIFT = COUPLING_INDEX["sway_yaw_damping:lift"]
_STRIPS = COUPLING_INDEX["cross_flow_drag"]
_OFF_CENTRE = COUPLING_INDEX["cross_flow_drag:off_centre"]
_SHIP = COUPLING_INDEX["cross_flow_drag:ship"]
_SPEED = COUPLING_INDEX["speed_dependent_damping:planar"]
_SPEED_SQUARED = COUPLING_INDEX["speed_dependent_damping:planar_quadratic"]
_BIAS = COUPLING_INDEX["bias_torque:planar"]
# Step of the difference quotients of forces without an analytic derivative, in shares of typical speeds.
_DIFFERENCE = 1e-6
# Room for the states, a whole number of SIMD vectors.
STATES = 12
HEADING, SURGE, YAW, FORCE, CURRENT, NORTH = 0, 1, 3, 4, 7, 9
# Step in shares of the shortest time constant; the transition matrix is a series of fourth order.
STEP_SHARE = 0.4
MAX_SUBSTEPS = 50


@compiled
def has_couplings(c: Any) -> bool:
    """Whether forces beyond the base model act, with the coefficients ``c``."""
    if len(c) > RUDDER_INDEX:
        return True
    found = False
    for at in range(BASE_COUNT, CURRENT_INDEX):
        found = found or c[at] != 0.0
    return found


@compiled
def coupling_forces(c: Any, held: Any, u: float, v: float, r: float) -> tuple[float, float, float]:
    """X, Y, N of all couplings and rudders, at speeds through the water; ``held`` are the inputs."""
    x, y, n = 0.0, 0.0, 0.0
    if c[_LINEAR] != 0.0 or c[_LINEAR + 1] != 0.0:
        fx, fy, fn = linear_forces(u, v, r, c[_LINEAR : _LINEAR + 2])
        x, y, n = x + fx, y + fy, n + fn
    if c[_LIFT] != 0.0 or c[_LIFT + 1] != 0.0:
        fx, fy, fn = lift_forces(u, v, r, c[_LIFT : _LIFT + 2])
        x, y, n = x + fx, y + fy, n + fn
    if c[_STRIPS] != 0.0:
        fx, fy, fn = strip_forces(u, v, r, c[_STRIPS : _STRIPS + 2])
        x, y, n = x + fx, y + fy, n + fn
    if c[_OFF_CENTRE] != 0.0:
        fx, fy, fn = off_centre_forces(u, v, r, c[_OFF_CENTRE : _OFF_CENTRE + 3])
        x, y, n = x + fx, y + fy, n + fn
    if c[_SHIP] != 0.0:
        fx, fy, fn = ship_forces(u, v, r, c[_SHIP : _SHIP + 2])
        x, y, n = x + fx, y + fy, n + fn
    if c[_SPEED] != 0.0 or c[_SPEED + 1] != 0.0:
        fx, fy, fn = coupled_forces(u, v, r, c[_SPEED : _SPEED + 2])
        x, y, n = x + fx, y + fy, n + fn
    if c[_SPEED_SQUARED] != 0.0 or c[_SPEED_SQUARED + 1] != 0.0:
        fx, fy, fn = coupled_quadratic_forces(u, v, r, c[_SPEED_SQUARED : _SPEED_SQUARED + 2])
        x, y, n = x + fx, y + fy, n + fn
    if c[_BIAS] != 0.0 or c[_BIAS + 1] != 0.0 or c[_BIAS + 2] != 0.0:
        fx, fy, fn = planar_forces(u, v, r, c[_BIAS : _BIAS + 3])
        x, y, n = x + fx, y + fy, n + fn
    for number in range((len(c) - RUDDER_INDEX) // RUDDER_COUNT):
        first, column = RUDDER_INDEX + RUDDER_COUNT * number, INPUT_COUNT + RUDDER_INPUTS * number
        fx, fy, fn = _rudder_forces(c[first : first + RUDDER_COUNT], held[column], held[column + 1], u, v, r)
        x, y, n = x + fx, y + fy, n + fn
    return x, y, n


@compiled
def _rudder_forces(p: Any, angle: float, thrust: float, u: float, v: float, r: float) -> tuple[float, float, float]:
    """Forces of a rudder at ``angle`` in rad behind ``thrust`` in N (Fossen 2011, section 9.5)."""
    along, across = u - p[1] * r, v + p[0] * r
    across *= p[5] * (1.0 + p[6] if across > 0.0 else 1.0 - p[6])
    ahead = along * abs(along) + p[4] * max(thrust, 0.0)
    sign = 1.0 if ahead >= 0.0 else -1.0
    # Sine and cosine of the angle of attack, times the speed of the flow.
    sine, cosine, root = math.sin(angle), math.cos(angle), math.sqrt(abs(ahead))
    across_blade, along_blade = sign * sine * root + cosine * across, cosine * root - sign * sine * across
    speed = math.sqrt(abs(ahead) + across * across)
    if along_blade < speed * math.cos(p[3]):  # stalled
        across_blade = math.copysign(speed * math.sin(p[3]), across_blade)
    normal = p[2] * speed * across_blade
    # Normal to the blade, whatever the stream.
    x, y = -p[7] * normal * sine, -normal * cosine
    return x, y, p[0] * y - p[1] * x


@compiled
def slopes(
    c: Any, coupled: bool, held: Any, u: float, v: float, r: float, x: float, y: float, n: float
) -> tuple[float, float, float]:
    """Derivatives of u, v, r through the water under the disturbances ``x``, ``y``, ``n``."""
    across = c[1] * v + c[3] * r
    fx = held[0] + x + across * r - (c[4] + c[7] * abs(u)) * u
    fy = held[1] + y - c[0] * u * r - (c[5] + c[8] * abs(v)) * v
    fn = held[2] + n - across * u + c[0] * u * v - (c[6] + c[9] * abs(r)) * r
    if coupled:
        cx, cy, cn = coupling_forces(c, held, u, v, r)
        fx, fy, fn = fx + cx, fy + cy, fn + cn
    scale = 1.0 / (c[1] * c[2] - c[3] * c[3])
    return fx / c[0], (c[2] * fy - c[3] * fn) * scale, (c[1] * fn - c[3] * fy) * scale


@compiled
def speed_jacobian(
    c: Any, coupled: bool, held: Any, speed_scale: Any, u: float, v: float, r: float, jacobian: Any
) -> None:
    """Write the (3, 3) derivatives of `slopes` by u, v, r."""
    across = c[1] * v + c[3] * r
    xu, xv, xr = -c[4] - 2.0 * c[7] * abs(u), c[1] * r, across + c[3] * r
    yu, yv, yr = -c[0] * r, -c[5] - 2.0 * c[8] * abs(v), -c[0] * u
    nu, nv, nr = c[0] * v - across, (c[0] - c[1]) * u, -c[3] * u - c[6] - 2.0 * c[9] * abs(r)
    if coupled:
        x0, y0, n0 = coupling_forces(c, held, u, v, r)
        h = _DIFFERENCE * speed_scale[0]
        x1, y1, n1 = coupling_forces(c, held, u + h, v, r)
        xu, yu, nu = xu + (x1 - x0) / h, yu + (y1 - y0) / h, nu + (n1 - n0) / h
        h = _DIFFERENCE * speed_scale[1]
        x1, y1, n1 = coupling_forces(c, held, u, v + h, r)
        xv, yv, nv = xv + (x1 - x0) / h, yv + (y1 - y0) / h, nv + (n1 - n0) / h
        h = _DIFFERENCE * speed_scale[2]
        x1, y1, n1 = coupling_forces(c, held, u, v, r + h)
        xr, yr, nr = xr + (x1 - x0) / h, yr + (y1 - y0) / h, nr + (n1 - n0) / h
    scale = 1.0 / (c[1] * c[2] - c[3] * c[3])
    jacobian[0, 0], jacobian[0, 1], jacobian[0, 2] = xu / c[0], xv / c[0], xr / c[0]
    jacobian[1, 0], jacobian[2, 0] = (c[2] * yu - c[3] * nu) * scale, (c[1] * nu - c[3] * yu) * scale
    jacobian[1, 1], jacobian[2, 1] = (c[2] * yv - c[3] * nv) * scale, (c[1] * nv - c[3] * yv) * scale
    jacobian[1, 2], jacobian[2, 2] = (c[2] * yr - c[3] * nr) * scale, (c[1] * nr - c[3] * yr) * scale


@compiled
def fastest(c: Any, jacobian: Any, yaw_only: bool) -> float:
    """1/s; largest absolute row sum of the (3, 3) ``jacobian`` in speeds scaled to equal momenta."""
    if yaw_only:
        return float(abs(jacobian[2, 2]))
    # m/s per rad/s.
    radius = math.sqrt(c[2] / c[1])
    first = abs(jacobian[0, 0]) + abs(jacobian[0, 1]) + abs(jacobian[0, 2]) / radius
    second = abs(jacobian[1, 0]) + abs(jacobian[1, 1]) + abs(jacobian[1, 2]) / radius
    third = (abs(jacobian[2, 0]) + abs(jacobian[2, 1])) * radius + abs(jacobian[2, 2])
    return float(max(first, second, third))


@compiled
def advance_state(
    c: Any,
    coupled: bool,
    yaw_only: bool,
    located: bool,
    held: Any,
    decays: Any,
    h: float,
    north: float,
    east: float,
    x: Any,
) -> None:
    """Runge-Kutta step of heading, speeds and, if ``located``, position of ``x`` over ``h`` s in a current."""
    psi, u, v, r = x[0], x[1], x[2], x[3]
    dx, dy, dn = x[FORCE], x[FORCE + 1], x[FORCE + 2]
    if yaw_only:
        inverse, linear, quadratic, torque = 1.0 / c[2], c[6], c[9], held[2]
        a1 = (torque + dn - (linear + quadratic * abs(r)) * r) * inverse
        r2 = r + 0.5 * h * a1
        a2 = (torque + dn * decays[0, 2] - (linear + quadratic * abs(r2)) * r2) * inverse
        r3 = r + 0.5 * h * a2
        a3 = (torque + dn * decays[0, 2] - (linear + quadratic * abs(r3)) * r3) * inverse
        r4 = r + h * a3
        a4 = (torque + dn * decays[1, 2] - (linear + quadratic * abs(r4)) * r4) * inverse
        x[0] = psi + h / 6.0 * (r + 2.0 * r2 + 2.0 * r3 + r4)
        x[3] = r + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        return
    mx, my, mn = dx * decays[0, 0], dy * decays[0, 1], dn * decays[0, 2]
    au1, av1, ar1 = slopes(c, coupled, held, u, v, r, dx, dy, dn)
    u2, v2, r2 = u + 0.5 * h * au1, v + 0.5 * h * av1, r + 0.5 * h * ar1
    au2, av2, ar2 = slopes(c, coupled, held, u2, v2, r2, mx, my, mn)
    u3, v3, r3 = u + 0.5 * h * au2, v + 0.5 * h * av2, r + 0.5 * h * ar2
    au3, av3, ar3 = slopes(c, coupled, held, u3, v3, r3, mx, my, mn)
    u4, v4, r4 = u + h * au3, v + h * av3, r + h * ar3
    au4, av4, ar4 = slopes(c, coupled, held, u4, v4, r4, dx * decays[1, 0], dy * decays[1, 1], dn * decays[1, 2])
    x[0] = psi + h / 6.0 * (r + 2.0 * r2 + 2.0 * r3 + r4)
    x[1] = u + h / 6.0 * (au1 + 2.0 * au2 + 2.0 * au3 + au4)
    x[2] = v + h / 6.0 * (av1 + 2.0 * av2 + 2.0 * av3 + av4)
    x[3] = r + h / 6.0 * (ar1 + 2.0 * ar2 + 2.0 * ar3 + ar4)
    if not located:
        return
    # Simpson's rule for the position; heading and speeds in the middle of the step are those of the cubic through both
    # ends.
    um = 0.5 * (u + x[1]) + h / 8.0 * (au1 - au4)
    vm = 0.5 * (v + x[2]) + h / 8.0 * (av1 - av4)
    pm = 0.5 * (psi + x[0]) + h / 8.0 * (r - x[3])
    c0, s0, c1, s1, c2, s2 = math.cos(psi), math.sin(psi), math.cos(pm), math.sin(pm), math.cos(x[0]), math.sin(x[0])
    x[NORTH] += h * north + h / 6.0 * (u * c0 - v * s0 + 4.0 * (um * c1 - vm * s1) + x[1] * c2 - x[2] * s2)
    x[NORTH + 1] += h * east + h / 6.0 * (u * s0 + v * c0 + 4.0 * (um * s1 + vm * c1) + x[1] * s2 + x[2] * c2)


@compiled
def simulate_runs(
    offsets: Any, time: Any, inputs: Any, starts: Any, speed_scale: Any, yaw_only: bool, c: Any, states: Any
) -> None:
    """Free-running simulation of one run after the other, from (runs, 6) ``starts`` as of the filter.

    Writes (n, 12) ``states``; the forces of the disturbance stay zero.
    """
    x, decays, jacobian = np.zeros(STATES), np.ones((2, 4)), np.zeros((3, 3))
    coupled = has_couplings(c)
    north, east = c[CURRENT_INDEX], c[CURRENT_INDEX + 1]
    for run in range(len(offsets) - 1):
        x[:] = 0.0
        cosine, sine = math.cos(starts[run, 0]), math.sin(starts[run, 0])
        x[HEADING], x[YAW] = starts[run, 0], starts[run, 3]
        if not yaw_only:
            x[SURGE] = starts[run, 1] - north * cosine - east * sine
            x[SURGE + 1] = starts[run, 2] + north * sine - east * cosine
            x[NORTH], x[NORTH + 1] = starts[run, 4], starts[run, 5]
        for k in range(offsets[run], offsets[run + 1]):
            if k > offsets[run]:
                interval, held = time[k] - time[k - 1], inputs[k - 1]
                speed_jacobian(c, coupled, held, speed_scale, x[1], x[2], x[3], jacobian)
                steps = min(int(interval * fastest(c, jacobian, yaw_only) / STEP_SHARE) + 1, MAX_SUBSTEPS)
                for _ in range(steps):
                    advance_state(c, coupled, yaw_only, True, held, decays, interval / steps, north, east, x)
            for j in range(STATES):
                states[k, j] = x[j]


# ---- reference in plain numpy


def forces(model: PlanarModel, speeds: FloatArray, inputs: FloatArray) -> FloatArray:
    """(3,) forces X, Y in N and torque N in N m without inertia terms, at (3,) ``speeds`` through the water."""
    u, v, r = speeds.tolist()
    linear, quadratic = model.base[4:7], model.base[7:10]
    total = inputs[:INPUT_COUNT] - linear * speeds - quadratic * np.abs(speeds) * speeds
    for one in model.effects:
        if isinstance(one.effect.acts, Coupling):
            total = total + np.array(one.effect.acts.forces(u, v, r, tuple(one.parameters.tolist())))
    for at, rudder in enumerate(model.rudders):
        angle, thrust = inputs[INPUT_COUNT + RUDDER_INPUTS * at :][:RUDDER_INPUTS]
        x, y = rudder.position
        along, across = u - y * r, v + x * r
        if rudder.straightening is not None:
            across *= rudder.straightening * (1.0 + np.sign(across) * rudder.asymmetry)
        ahead = along * abs(along) + rudder.slipstream * max(thrust, 0.0)
        # A rudder in a stream from astern works the other way round.
        attack = np.sign(ahead) * angle + np.arctan2(across, np.sqrt(abs(ahead)))
        attack = np.clip(attack, -rudder.stall, rudder.stall)
        normal = rudder.lift * (abs(ahead) + across * across) * np.sin(attack)
        resistance = 1.0 if rudder.resistance is None else rudder.resistance
        force = np.array([-resistance * normal * np.sin(angle), -normal * np.cos(angle)])
        total = total + np.array([*force, x * force[1] - y * force[0]])
    return np.asarray(total)


def accelerations(model: PlanarModel, speeds: FloatArray, inputs: FloatArray, disturbance: FloatArray) -> FloatArray:
    """(3,) derivatives of the speeds through the water, (Fossen 2011, equation 8.8)."""
    right = forces(model, speeds, inputs) + disturbance - model.coriolis_matrix(speeds.tolist()) @ speeds
    return np.asarray(np.linalg.solve(model.mass_matrix, right))


def simulate(
    model: PlanarModel, time: FloatArray, inputs: FloatArray, start: FloatArray, substeps: int = 1
) -> FloatArray:
    """(n, 6) heading, speeds through the water u, v, r, north and east at (n,) ``time``, by Runge-Kutta steps.

    ``inputs`` (n, k) are held until the next instant; ``start`` is the first row.
    """
    current = np.array(model.current)

    def slope(state: FloatArray, held: FloatArray) -> FloatArray:
        heading, u, v, r = state[:4]
        cosine, sine = np.cos(heading), np.sin(heading)
        over_ground = np.array([u * cosine - v * sine, u * sine + v * cosine]) + current
        return np.concatenate(([r], accelerations(model, state[1:4], held, np.zeros(3)), over_ground))

    states = np.empty((len(time), 6))
    states[0] = start
    for k in range(1, len(time)):
        state, held = states[k - 1], inputs[k - 1]
        h = (time[k] - time[k - 1]) / substeps
        for _ in range(substeps):
            k1 = slope(state, held)
            k2 = slope(state + 0.5 * h * k1, held)
            k3 = slope(state + 0.5 * h * k2, held)
            k4 = slope(state + h * k3, held)
            state = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        states[k] = state
    return states


def filter_innovations(
    model: PlanarModel,
    time: FloatArray,
    inputs: FloatArray,
    events: list[list[tuple[str, float]]],
    start: FloatArray,
    start_std: FloatArray,
    disturbance: FloatArray,
    sensor_noise: dict[str, float],
    substeps: int,
) -> FloatArray:
    """(m, 2) innovations and their variances by an extended Kalman filter with dense matrices (Gelb 1974, table 6.1-1).

    ``events`` lists sensors and values at each instant; ``disturbance`` (2, 3) standard deviations and correlation
    times. ``start`` is as in `rovid.planar.kernels.filter_runs`. The state is heading, u, v, r, X, Y, N, change of the
    current to north and east, north, east.
    """
    constant, wander = np.array(model.current), model.coefficients[CURRENT_INDEX + 2 : CURRENT_INDEX + 4]
    leak = np.concatenate((1.0 / disturbance[1], np.full(2, 1.0 / wander[1])))
    white = 2.0 * leak * np.concatenate((disturbance[0], np.full(2, wander[0]))) ** 2

    def slope(x: FloatArray, held: FloatArray) -> FloatArray:
        cosine, sine = np.cos(x[0]), np.sin(x[0])
        over_ground = np.array([x[1] * cosine - x[2] * sine, x[1] * sine + x[2] * cosine]) + constant + x[7:9]
        return np.concatenate(([x[3]], accelerations(model, x[1:4], held, x[4:7]), -leak * x[4:9], over_ground))

    def reading(x: FloatArray, sensor: str) -> float:
        cosine, sine = np.cos(x[0]), np.sin(x[0])
        north, east = constant + x[7:9]
        ahead, across = north * cosine + east * sine, east * cosine - north * sine
        known = {"heading": x[0], "yaw_rate": x[3], "north": x[9], "east": x[10]}
        known |= {"surge_velocity": x[1] + ahead, "sway_velocity": x[2] + across}
        (lx, ly), (ax, ay) = map(model.place_of, ("surge_velocity", "north"))
        known["surge_velocity"] -= ly * x[3]
        known["sway_velocity"] += lx * x[3]
        known["north"] += ax * cosine - ay * sine
        known["east"] += ax * sine + ay * cosine
        return float(known[sensor])

    def derivative(function: Callable[[FloatArray], FloatArray], x: FloatArray) -> FloatArray:
        steps = 1e-5 * np.eye(len(x))
        return np.column_stack([(function(x + step) - function(x - step)) / 2e-5 for step in steps])

    x, p = np.zeros(11), np.zeros((11, 11))
    cosine, sine = np.cos(start[0]), np.sin(start[0])
    x[[0, 3, 9, 10]] = start[[0, 3, 4, 5]]
    x[1] = start[1] - constant[0] * cosine - constant[1] * sine
    x[2] = start[2] + constant[0] * sine - constant[1] * cosine
    lx, ly = model.place_of("north")
    x[9:11] -= lx * cosine - ly * sine, lx * sine + ly * cosine
    stds = [sensor_noise["heading"], *start_std, *disturbance[0], wander[0], wander[0]]
    p[np.diag_indices(11)] = np.square([*stds, sensor_noise["north"], sensor_noise["east"]])
    found = []
    for k in range(len(time)):
        for _ in range(substeps if k else 0):
            h, held = (time[k] - time[k - 1]) / substeps, inputs[k - 1]
            k1 = slope(x, held)
            ahead = x + h * slope(x + 0.5 * h * k1, held)
            a = derivative(lambda at, held=held: slope(at, held), 0.5 * (x + ahead))  # type: ignore[misc]
            f = np.eye(11) + h * a + h * h / 2.0 * a @ a
            noise = np.zeros((11, 11))
            noise[range(4, 9), range(4, 9)] = white
            q = 0.5 * h * (f @ noise @ f.T + noise)
            x, p = ahead, f @ p @ f.T + q
        for sensor, value in events[k]:
            row = derivative(lambda at, sensor=sensor: np.array([reading(at, sensor)]), x)  # type: ignore[misc]
            variance = float((row @ p @ row.T)[0, 0]) + sensor_noise[sensor] ** 2
            error, gain = value - reading(x, sensor), (p @ row.T)[:, 0] / variance
            x, p = x + gain * error, p - np.outer(gain, gain) * variance
            found.append((error, variance))
    return np.array(found)
