"""What is true of a simulated vehicle, its thrusters, the water and the instruments.

Yaw, body axes z down, positive in the sense in which a compass heading grows:

    I*rdot + DQ*|r|*r + DL*r = T(u) + d        T(u) = sum of yaw_arm * thrust(command)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

NEWTON_PER_KGF = 9.80665


@dataclass(frozen=True, kw_only=True)
class BenchCurve:
    """Thrust of one thruster at rest: a square law beyond a dead zone, weaker in reverse.

    Attributes
    ----------
    forward, reverse
        kgf/V^2, of the voltage beyond the dead zone.
    dead_zone
        V, on either side of zero.
    limit
        V, largest command of either sign.
    """

    forward: float = 9.4
    reverse: float = 5.3
    dead_zone: float = 0.3
    limit: float = 5.0

    def thrust(self, command: FloatArray) -> FloatArray:
        """Thrust in N at ``command`` in V."""
        beyond = np.maximum(np.abs(command) - self.dead_zone, 0.0)
        coefficient = np.where(command > 0.0, self.forward, -self.reverse)
        thrust: FloatArray = coefficient * beyond**2 * NEWTON_PER_KGF
        return thrust


@dataclass(frozen=True, kw_only=True)
class Thruster:
    """A thruster; ``yaw_arm`` in m, positive where forward thrust turns the heading up."""

    name: str
    yaw_arm: float
    curve: BenchCurve = BenchCurve()


@dataclass(frozen=True, kw_only=True)
class Dynamics:
    """Of yaw.

    Attributes
    ----------
    inertia
        kg m^2, added mass included.
    quadratic_drag
        N m s^2/rad^2.
    linear_drag
        N m s/rad.
    """

    inertia: float
    quadratic_drag: float
    linear_drag: float

    def steady_rate(self, torque: float) -> float:
        """Yaw rate in rad/s at which drag balances ``torque`` in N m."""
        root = math.sqrt(self.linear_drag**2 + 4.0 * self.quadratic_drag * abs(torque))
        # This form of the root loses no digits at small torque and holds without quadratic drag.
        return 2.0 * torque / (self.linear_drag + root) if torque else 0.0


@dataclass(frozen=True, kw_only=True)
class Disturbance:
    """First-order Gauss-Markov torque: ``standard_deviation`` in N m, ``correlation_time`` in s."""

    standard_deviation: float
    correlation_time: float = 4.0


@dataclass(frozen=True, kw_only=True)
class Attitude:
    """Roll and pitch about which the vehicle wanders slowly, in deg; ``periods`` in s."""

    roll: float = 0.4
    pitch: float = -0.7
    wander: float = 0.3
    periods: tuple[float, ...] = (11.0, 17.0, 31.0)


@dataclass(frozen=True, kw_only=True)
class Instruments:
    """Inertial navigation, command output and supply meter.

    Attributes
    ----------
    rate
        Hz, of heading, roll and pitch; a CSV log has time for whole hundredths of a second.
    angle_noise
        deg, standard deviation, white, on each angle.
    angle_decimals
        Decimals of a degree that are logged.
    command_bits, command_span
        Resolution of the command output and the V that it spans, half of them negative.
    supply, supply_drop, supply_noise
        V; V for each V of command on each thruster; V, standard deviation.
    """

    rate: float = 20.0
    angle_noise: float = 0.01
    angle_decimals: int = 3
    command_bits: int = 12
    command_span: float = 20.0
    supply: float = 48.0
    supply_drop: float = 0.1
    supply_noise: float = 0.02


@dataclass(frozen=True, kw_only=True)
class Truth:
    """A whole truth; ``mass`` in kg, ``length`` and ``width`` in m."""

    name: str
    mass: float
    length: float
    width: float
    dynamics: Dynamics
    thrusters: tuple[Thruster, ...]
    disturbance: Disturbance
    attitude: Attitude = Attitude()
    instruments: Instruments = Instruments()

    def yaw_torque(self, command: float) -> float:
        """Torque in N m with ``command`` in V on every thruster."""
        return sum(t.yaw_arm * float(t.curve.thrust(np.array([command]))[0]) for t in self.thrusters)


ROSUB = Truth(
    name="ROSUB 6000, tank configuration (synthetic)",
    mass=2604.0,
    length=2.6,
    width=2.0,
    dynamics=Dynamics(inertia=5057.0, quadratic_drag=3532.0, linear_drag=132.0),
    thrusters=(Thruster(name="fore", yaw_arm=0.43), Thruster(name="aft", yaw_arm=0.43)),
    disturbance=Disturbance(standard_deviation=2.5),
)

_SMALL_CURVE = BenchCurve(forward=0.55, reverse=0.40)
OBSERVATION = Truth(
    name="observation-class ROV (synthetic)",
    mass=11.5,
    length=0.46,
    width=0.44,
    dynamics=Dynamics(inertia=1.4, quadratic_drag=1.5, linear_drag=1.2),
    thrusters=(
        Thruster(name="fore", yaw_arm=0.2, curve=_SMALL_CURVE),
        Thruster(name="aft", yaw_arm=0.2, curve=_SMALL_CURVE),
    ),
    disturbance=Disturbance(standard_deviation=0.07, correlation_time=2.0),
    instruments=Instruments(angle_noise=0.05, supply=16.0),
)
