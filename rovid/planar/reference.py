"""The planar equations in plain numpy, step by step: the reference of the compiled loops."""

from collections.abc import Callable

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.base import Coupling
from rovid.planar.model import CURRENT_INDEX, INPUT_COUNT, RUDDER_INPUTS, PlanarModel


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
        force = np.array([-normal * np.sin(angle), -normal * np.cos(angle)])
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
