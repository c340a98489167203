"""Integrates a truth through held commands; every command acts from the very instant at which it was given.

Instants are integer microseconds, so that instants of different clocks which coincide are equal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np

from tools.truth import Attitude, Disturbance, FloatArray, IntArray, Truth

MICRO = 1_000_000
SUBSTEP = 5_000  # us; ten substeps between two headings at 20 Hz

# Compiled at first use; the result is kept on disk.
_compiled = numba.njit(cache=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class Held:
    """A command: each ``value`` in V holds from its ``instant`` in us to the next; zero before the first."""

    instant: IntArray
    value: FloatArray

    def at(self, instant: IntArray) -> FloatArray:
        """Command in V at each ``instant`` in us."""
        return np.concatenate(([0.0], self.value))[np.searchsorted(self.instant, instant, side="right")]


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """The truth: ``instant`` in us; angles in rad, ``heading`` unwrapped; ``rate`` of yaw in rad/s."""

    instant: IntArray
    heading: FloatArray
    rate: FloatArray
    roll: FloatArray
    pitch: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class _Wander:
    """One slow angle: ``mean`` and ``amplitude`` in rad, ``frequency`` in rad/s, ``phase`` in rad."""

    mean: float
    amplitude: float
    frequency: FloatArray
    phase: FloatArray

    def angle(self, time: FloatArray) -> FloatArray:
        waves = np.sin(np.outer(time, self.frequency) + self.phase)
        return self.mean + self.amplitude * np.asarray(waves.sum(axis=1))

    def rate(self, time: FloatArray) -> FloatArray:
        waves = self.frequency * np.cos(np.outer(time, self.frequency) + self.phase)
        return self.amplitude * np.asarray(waves.sum(axis=1))


def simulate(
    truth: Truth,
    commands: Sequence[Held],
    sample: IntArray,
    rng: np.random.Generator,
    *,
    substep: int = SUBSTEP,
) -> Motion:
    """Motion from rest at time 0 and a random heading, at each ``sample`` in us.

    ``commands`` are in the order of the truth's thrusters. A step ends at every change of a command, at every
    sample and after ``substep`` us at the latest.
    """
    regular = np.arange(0, sample[-1] + 1, substep, dtype=np.int64)
    knots = np.unique(np.concatenate([regular, sample, *(held.instant for held in commands)]))
    knots = knots[knots <= sample[-1]]
    roll, pitch = _wanders(truth.attitude, rng)
    heading = rng.uniform(-np.pi, np.pi)
    torque = actuator_torque(truth, commands, knots) + disturbance_torque(truth.disturbance, knots, rng)
    scale, drift = _euler_terms(roll, pitch, knots)
    dynamics = truth.dynamics
    states = _integrate(
        knots / MICRO,
        torque,
        scale,
        drift,
        np.array([dynamics.inertia, dynamics.quadratic_drag, dynamics.linear_drag]),
        heading,
    )
    wanted = np.searchsorted(knots, sample)
    time = sample / MICRO
    return Motion(
        instant=sample,
        heading=states[wanted, 0],
        rate=states[wanted, 1],
        roll=roll.angle(time),
        pitch=pitch.angle(time),
    )


def actuator_torque(truth: Truth, commands: Sequence[Held], knots: IntArray) -> FloatArray:
    """Torque of the thrusters in N m, held from each of ``knots`` in us to the next.

    The whole path from the given command to torque is here: what an actuator hides belongs in this function.
    """
    total = np.zeros(len(knots))
    for thruster, held in zip(truth.thrusters, commands, strict=True):
        total += thruster.yaw_arm * thruster.curve.thrust(held.at(knots))
    return total


def disturbance_torque(disturbance: Disturbance, knots: IntArray, rng: np.random.Generator) -> FloatArray:
    """Stationary first-order Gauss-Markov torque in N m, exact at each of ``knots`` in us."""
    decay = np.exp(-np.diff(knots) / MICRO / disturbance.correlation_time)
    kicks = rng.standard_normal(len(knots)) * disturbance.standard_deviation
    return np.asarray(_gauss_markov(decay, kicks))


def _wanders(attitude: Attitude, rng: np.random.Generator) -> tuple[_Wander, _Wander]:
    """Roll and pitch, with random phases."""
    frequency = 2.0 * np.pi / np.array(attitude.periods)
    amplitude = np.radians(attitude.wander) / len(attitude.periods)
    roll, pitch = (
        _Wander(
            mean=np.radians(mean),
            amplitude=amplitude,
            frequency=frequency,
            phase=rng.uniform(0.0, 2.0 * np.pi, len(frequency)),
        )
        for mean in (attitude.roll, attitude.pitch)
    )
    return roll, pitch


def _euler_terms(roll: _Wander, pitch: _Wander, knots: IntArray) -> tuple[FloatArray, FloatArray]:
    """``scale`` and ``drift`` of psidot = scale*r + drift, in the middle of each step.

    Roll and pitch change so slowly that the midpoint is exact to 1e-12 of the rate.
    """
    middle = (knots[:-1] + knots[1:]) / (2.0 * MICRO)
    phi = roll.angle(middle)
    scale = 1.0 / (np.cos(phi) * np.cos(pitch.angle(middle)))
    return scale, scale * pitch.rate(middle) * np.sin(phi)


@_compiled
def _gauss_markov(decay: FloatArray, kicks: FloatArray) -> FloatArray:
    """Exact first-order Gauss-Markov path; ``kicks`` have its stationary standard deviation."""
    path = kicks.copy()
    for k in range(len(decay)):
        path[k + 1] = decay[k] * path[k] + np.sqrt(1.0 - decay[k] ** 2) * kicks[k + 1]
    return path


@_compiled
def _acceleration(rate: float, torque: float, vehicle: FloatArray) -> float:
    """Yaw acceleration in rad/s^2; ``vehicle`` holds inertia, quadratic and linear drag."""
    return float((torque - (vehicle[1] * abs(rate) + vehicle[2]) * rate) / vehicle[0])


@_compiled
def _integrate(
    time: FloatArray,
    torque: FloatArray,
    scale: FloatArray,
    drift: FloatArray,
    vehicle: FloatArray,
    heading: float,
) -> FloatArray:
    """(n, 2) heading in rad and yaw rate in rad/s, from rest: classical fourth-order Runge-Kutta."""
    states = np.empty((len(time), 2))
    states[0, 0] = heading
    states[0, 1] = 0.0
    for k in range(len(time) - 1):
        h = time[k + 1] - time[k]
        r1 = states[k, 1]
        a1 = _acceleration(r1, torque[k], vehicle)
        r2 = r1 + 0.5 * h * a1
        a2 = _acceleration(r2, torque[k], vehicle)
        r3 = r1 + 0.5 * h * a2
        a3 = _acceleration(r3, torque[k], vehicle)
        r4 = r1 + h * a3
        a4 = _acceleration(r4, torque[k], vehicle)
        turned = h * (r1 + 2.0 * r2 + 2.0 * r3 + r4) / 6.0
        states[k + 1, 0] = states[k, 0] + scale[k] * turned + drift[k] * h
        states[k + 1, 1] = r1 + h * (a1 + 2.0 * a2 + 2.0 * a3 + a4) / 6.0
    return states
