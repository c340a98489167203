"""The planar equations in plain numpy, step by step: the reference of the compiled loops."""

from __future__ import annotations

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.base import Coupling
from rovid.planar.model import INPUT_COUNT, RUDDER_INPUTS, PlanarModel


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
        ahead = u * abs(u) + rudder.slipstream * max(thrust, 0.0)
        across = v + rudder.position * r
        inflow = np.sqrt(abs(ahead))
        # A rudder in a stream from astern works the other way round.
        attack = angle + np.arctan2(across, inflow) if ahead >= 0.0 else -angle + np.arctan2(across, inflow)
        attack = np.clip(attack, -rudder.stall, rudder.stall)
        normal = rudder.lift * (abs(ahead) + across * across) * np.sin(attack)
        side = -normal * np.cos(angle)
        total = total + np.array([-abs(normal * np.sin(angle)) * np.sign(ahead), side, rudder.position * side])
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
