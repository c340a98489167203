"""One trial on the way from command to torque: what the effects that act there are told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from rovid.campaign.trial import Trial
from rovid.campaign.vehicle import ThrustCurve, Thruster, Vehicle
from rovid.ground.arrays import FloatArray

# Channels of the log that say how fast the vehicle goes ahead and to starboard, m/s.
SPEEDS = ("surge_velocity", "sway_velocity")
# Of the bench's largest thrust; the same for thrust. Trials seldom use much more in yaw, and away from the thrust in
# use a change of shape would be one of scale, which inertia and drag would have to follow.
_REFERENCE_SHARE = 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class Actuation:
    """One trial on the way from command to torque.

    Attributes
    ----------
    time
        (n,) s.
    neutral
        (k,) command of no thrust of each actuator.
    arms
        (k,) yaw arm of each actuator.
    full_thrust
        (k,) N; largest thrust of each actuator's bench curve, or largest torque or force of a campaign that logs it.
    names
        (k,) of the thrusters.
    ahead
        (k,) share of each thrust that drives the vehicle ahead; 0 where that is not known.
    ends
        (k, 2) the least and the largest command of the bench curve.
    dead_zone
        (k, 2) commands between which the bench curve gives no thrust; both ``neutral`` where there is no such zone.
    extras
        Further channels of the log, (n,), held.
    reference
        The median of each further channel over the whole campaign.
    trial
        Its name.
    whole
        Name of the trial that it is a part of; its own where it is none.
    since
        s from the beginning of the campaign's first trial to that of this one.
    parts
        How many each interval between two of the log's instants is cut into.
    """

    time: FloatArray
    neutral: FloatArray
    arms: FloatArray
    full_thrust: FloatArray
    names: tuple[str, ...]
    ahead: FloatArray
    ends: FloatArray
    dead_zone: FloatArray
    extras: Mapping[str, FloatArray]
    reference: Mapping[str, float] = field(default_factory=dict)
    trial: str = ""
    whole: str = ""
    since: float = 0.0
    parts: int = 1

    @property
    def reference_thrust(self) -> FloatArray:
        """(k,) N; a tenth of the full thrust, at which forms of the thrust curve agree with the bench."""
        return _REFERENCE_SHARE * self.full_thrust

    def speed(self, name: str) -> FloatArray:
        """(n,) m/s, the mean until the next instant of one of `SPEEDS`; that of the campaign where it is not logged."""
        logged = self.extras.get(name)
        if logged is None or not np.isfinite(logged).any():
            return np.full(len(self.time), self.reference.get(name, 0.0))
        known = bridged(logged)
        return np.asarray(0.5 * (known + np.append(known[1:], known[-1])))

    def beyond(self, command: FloatArray) -> FloatArray:
        """(n, k) how far each command is beyond the bench's dead zone, with its sign; 0 inside."""
        low, high = self.dead_zone.T
        return np.asarray(np.maximum(command - high, 0.0) + np.minimum(command - low, 0.0))

    def from_beyond(self, excess: FloatArray) -> FloatArray:
        """(n, k) commands that are so far beyond the dead zone; neutral where that is 0."""
        low, high = self.dead_zone.T
        return np.where(excess > 0.0, high + excess, np.where(excess < 0.0, low + excess, self.neutral))


def finer(held: FloatArray, parts: int) -> FloatArray:
    """(m, ...) of (n, ...) values that are held, with each interval between two instants cut into ``parts``."""
    return np.repeat(held, parts, axis=0)[: (len(held) - 1) * parts + 1]


def bridged(values: FloatArray) -> FloatArray:
    """(n,) ``values`` with straight lines through their gaps; zeros where none is known."""
    known = np.flatnonzero(np.isfinite(values))
    if known.size == len(values):
        return values
    return np.interp(np.arange(len(values)), known, values[known]) if known.size else np.zeros(len(values))


def _instants(time: FloatArray, parts: int) -> FloatArray:
    steps = np.arange((len(time) - 1) * parts + 1) / parts
    return np.asarray(np.interp(steps, np.arange(len(time)), time))


def actuation(vehicle: Vehicle, trial: Trial, parts: int = 1) -> Actuation:
    """What the effects between command and torque need to know of ``vehicle`` and ``trial``.

    ``parts`` is how many each interval between two instants is cut into.
    """
    return Actuation(
        time=trial.time if parts == 1 else _instants(trial.time, parts),
        names=tuple(thruster.name for thruster in vehicle.thrusters),
        ahead=vehicle.ahead,
        ends=np.array([_ends(thruster) for thruster in vehicle.thrusters]),
        dead_zone=np.array([_dead_zone(thruster.curve) for thruster in vehicle.thrusters]),
        extras={name: finer(values, parts) for name, values in trial.extras.items()},
        reference=trial.reference,
        trial=trial.name,
        whole=trial.whole or trial.name,
        since=trial.since,
        parts=parts,
        neutral=neutral_commands(vehicle),
        arms=np.array([thruster.arm for thruster in vehicle.thrusters]),
        full_thrust=np.array([thruster.full_thrust for thruster in vehicle.thrusters]),
    )


def race(thrust: FloatArray, arms: FloatArray) -> FloatArray:
    """(n,) N^0.5 m^2; sum over the thrusters of the root of their (n, k) thrust in N times their arm squared."""
    return np.asarray(np.sqrt(np.abs(thrust)) @ arms**2)


def neutral_commands(vehicle: Vehicle) -> FloatArray:
    """(k,) the command of no thrust: the middle of the bench curve's zeros, or where it crosses zero."""
    return np.array([0.0 if t.curve is None else sum(_dead_zone(t.curve)) / 2.0 for t in vehicle.thrusters])


def _ends(thruster: Thruster) -> tuple[float, float]:
    """Lowest and highest command."""
    if thruster.curve is None:
        return -thruster.most, thruster.most
    return float(thruster.curve.command[0]), float(thruster.curve.command[-1])


def _dead_zone(curve: ThrustCurve | None) -> tuple[float, float]:
    if curve is None:
        return 0.0, 0.0
    zeros = curve.command[curve.thrust == 0.0]
    if zeros.size:
        return float(zeros[0]), float(zeros[-1])
    rising = np.argsort(curve.thrust, kind="stable")
    crossing = float(np.interp(0.0, curve.thrust[rising], curve.command[rising]))
    return crossing, crossing
