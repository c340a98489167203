"""Integrates a truth through held commands; every command acts from the very instant at which it was given.

Instants are integer microseconds, so that instants of different clocks which coincide are equal.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numba
import numpy as np

from tools.actuators import (
    Steps,
    drag_factor,
    moving_thrust,
    outer_torque,
    paths,
    speed_damping,
    static_thrust,
    thrust_factor,
)
from tools.channels import CHANNELS, SUPPLY, courses
from tools.hidden import acting
from tools.truth import MICRO, Attitude, Disturbance, FloatArray, IntArray, Truth
from tools.water import HEADING, RATE, integrate, shortest, water

__all__ = ["MICRO", "SUBSTEP", "Held", "Motion", "disturbance_torque", "simulate"]

SUBSTEP = 5_000  # us; ten substeps between two headings at 20 Hz
_SHORTEST = 100  # us, of the substep where something hidden is faster than that

# Compiled at first use; the result is kept on disk.
_compiled = numba.njit(cache=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class Held:
    """A command: each ``value`` in V holds from its ``instant`` in us to the next; ``neutral`` before the first."""

    instant: IntArray
    value: FloatArray
    neutral: float = 0.0

    def at(self, instant: IntArray) -> FloatArray:
        """Command in V at each ``instant`` in us."""
        return np.concatenate(([self.neutral], self.value))[np.searchsorted(self.instant, instant, side="right")]


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """The truth: ``instant`` in us; angles in rad, ``heading`` unwrapped; ``rate`` of yaw in rad/s.

    On another axis ``heading`` is the place in m, or the angle, along it, and ``rate`` its velocity.
    ``channels`` are the extra signals that are logged; ``supply`` in V is what the supply has besides the droop that
    the instruments know of.
    """

    instant: IntArray
    heading: FloatArray
    rate: FloatArray
    roll: FloatArray
    pitch: FloatArray
    channels: Mapping[str, FloatArray] = field(default_factory=dict)
    supply: FloatArray | float = 0.0


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
    truth: Truth, commands: Sequence[Held], sample: IntArray, rng: np.random.Generator, *, substep: int = SUBSTEP
) -> Motion:
    """Motion from rest at time 0 and a random heading or the truth's own start, at each ``sample`` in us.

    ``commands`` are in the order of the truth's thrusters. A step ends at every change of a command, where it is
    given and where it acts, at every sample and after ``substep`` us at the latest.
    """
    hidden = acting(truth.hidden)
    # Its own generator: what is hidden changes none of the other draws.
    (extra,) = rng.spawn(1)
    drawn, waves = extra.spawn(2)
    offsets = [(held.instant, held.value - held.neutral) for held in commands]
    acted = paths(truth, offsets, hidden)
    parameters = water(truth, hidden)
    substep = min(substep, max(int(min(shortest(parameters), 1.0) * MICRO / 2.0), _SHORTEST))
    steps = Steps(knots=_knots(sample, [*(h.instant for h in commands), *(path.instant for path in acted)], substep))
    roll, pitch = _wanders(truth.attitude, rng)
    heading = rng.uniform(-np.pi, np.pi) if truth.start is None else truth.start
    time = sample / MICRO
    signals = courses(truth, float(time[-1]), drawn)
    thrust = static_thrust(truth, acted, steps, hidden) * thrust_factor(truth, steps, signals, hidden)[..., np.newaxis]
    thrust = moving_thrust(thrust, steps, signals, hidden)
    outer = outer_torque(steps, signals, lambda at: pitch.angle(at) - pitch.mean, hidden, waves)
    scale, drift = _euler_terms(roll, pitch, steps.knots)
    states = integrate(
        np.diff(steps.knots / MICRO),
        thrust,
        np.array([thruster.arm for thruster in truth.thrusters]),
        outer + disturbance_torque(truth.disturbance, steps.knots, rng)[:-1],
        drag_factor(steps, signals, hidden),
        speed_damping(steps, signals, hidden),
        scale,
        drift,
        heading,
        parameters,
    )[np.searchsorted(steps.knots, sample)]
    return Motion(
        instant=sample,
        heading=states[:, HEADING],
        rate=states[:, RATE],
        roll=roll.angle(time),
        pitch=pitch.angle(time),
        channels={name: CHANNELS[name].mean + signals[name].at(time) for name in signals if name != SUPPLY},
        supply=signals[SUPPLY].at(time) if SUPPLY in signals else 0.0,
    )


def _knots(sample: IntArray, instants: Sequence[IntArray], substep: int) -> IntArray:
    """Ends of the steps in us: every ``substep``, every sample and each of ``instants``, through the last sample."""
    regular = np.arange(0, sample[-1] + 1, substep, dtype=np.int64)
    # Stable sorting takes each of these for the sorted stretch that it is.
    knots = np.sort(np.concatenate([regular, sample, *instants]), kind="stable")
    return np.asarray(knots[(knots >= 0) & (knots <= sample[-1]) & (np.diff(knots, prepend=-1) > 0)])


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
