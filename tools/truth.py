"""What is true of a simulated vehicle, its thrusters, the water and the instruments.

Yaw, body axes z down, positive in the sense in which a compass heading grows:

    I*rdot + DQ*|r|*r + DL*r = T(u) + d        T(u) = sum of arm * thrust(command)

and whatever is hidden on top (tools/hidden.py). Surge, heave and pitch have the same equation, with mass and force in
place of inertia and torque where they are straight, a restoring moment in pitch and weight less buoyancy in heave
(tools/axis_truth.py). What is said below of yaw, in rad, N m and kg m^2, holds for them in m, N and kg.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tools.hidden import Hidden

MICRO = 1_000_000  # us in a second

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

Unit = Literal["V", "us", "1"]
Axis = Literal["yaw", "surge", "heave", "pitch"]

NEWTON_PER_KGF = 9.80665


@dataclass(frozen=True, kw_only=True)
class BenchCurve:
    """Thrust of one thruster at rest: a square law beyond a dead zone, weaker in reverse.

    Commands are in V, us, or -1 to 1: what is said of V below holds for any of them.

    Attributes
    ----------
    forward, reverse
        kgf/V^2, of the voltage beyond the dead zone.
    dead_zone
        V, on either side of neutral.
    limit
        V, largest command of either sign, from neutral.
    neutral
        V, the command that stops the thruster.
    step
        V, between the points of the table that is written of it.
    """

    forward: float = 9.4
    reverse: float = 5.3
    dead_zone: float = 0.3
    limit: float = 5.0
    neutral: float = 0.0
    step: float = 0.01  # linear interpolation of the square law is then off by 0.0024 N at most

    def thrust(self, command: FloatArray) -> FloatArray:
        """Thrust in N at ``command`` in V."""
        offset = command - self.neutral
        beyond = np.maximum(np.abs(offset) - self.dead_zone, 0.0)
        coefficient = np.where(offset > 0.0, self.forward, -self.reverse)
        thrust: FloatArray = coefficient * beyond**2 * NEWTON_PER_KGF
        return thrust

    def offset_for(self, thrust: float) -> float:
        """V from neutral at which the thrust is ``thrust`` in N; zero for none."""
        if thrust == 0.0:
            return 0.0
        coefficient = self.forward if thrust > 0.0 else self.reverse
        return math.copysign(self.dead_zone + math.sqrt(abs(thrust) / NEWTON_PER_KGF / coefficient), thrust)


@dataclass(frozen=True, kw_only=True)
class Thruster:
    """A thruster.

    Attributes
    ----------
    name
        As in rovid.toml.
    arm
        m, positive where forward thrust turns the heading, or the pitch, up; on a straight axis the share of the
        thrust along it.
    curve
        Of thrust at rest.
    """

    name: str
    arm: float
    curve: BenchCurve = BenchCurve()

    @property
    def yaw_arm(self) -> float:
        """The arm, by the name that it has in a yaw day's rovid.toml."""
        return self.arm


@dataclass(frozen=True, kw_only=True)
class Dynamics:
    """Of one degree of freedom.

    Attributes
    ----------
    inertia
        kg m^2, added mass included.
    quadratic_drag
        N m s^2/rad^2.
    linear_drag
        N m s/rad.
    restoring
        N m, of a restoring torque restoring*sin(angle - level).
    level
        rad, the angle at which nothing is restored.
    net_force
        N or N m, constant: weight less buoyancy in heave.
    """

    inertia: float
    quadratic_drag: float
    linear_drag: float
    restoring: float = 0.0
    level: float = 0.0
    net_force: float = 0.0

    def steady_rate(self, torque: float) -> float:
        """Yaw rate in rad/s at which drag alone balances ``torque`` in N m."""
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
    """Inertial navigation, command output and supply meter; commands in V or in whatever the curve takes.

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
    """A whole truth; ``mass`` in kg, ``length`` and ``width`` in m.

    Attributes
    ----------
    command_unit
        Of all thrusters' commands; "1" is -1 to 1.
    middle
        Command, from neutral, that turns the vehicle at a middling rate.
    pace
        Ratio of the times of this vehicle's programme to ROSUB's; None: ROSUB's programme without change.
    hidden
        What acts besides the plain model.
    channels
        Extra signals that are logged whether or not anything depends on them; names as in tools/channels.py.
    axis
        The degree of freedom that moves.
    start
        Angle in rad, or place in m, at which each run begins; None: a random heading.
    height
        m; None: not told.
    """

    name: str
    mass: float
    length: float
    width: float
    dynamics: Dynamics
    thrusters: tuple[Thruster, ...]
    disturbance: Disturbance
    attitude: Attitude = Attitude()
    instruments: Instruments = Instruments()
    command_unit: Unit = "V"
    middle: float = 1.55
    pace: float | None = None
    hidden: tuple[Hidden, ...] = ()
    channels: tuple[str, ...] = ()
    axis: Axis = "yaw"
    start: float | None = None
    height: float | None = None

    def yaw_torque(self, command: float) -> float:
        """Torque in N m with ``command`` in V on every thruster."""
        return sum(t.arm * float(t.curve.thrust(np.array([command]))[0]) for t in self.thrusters)

    @property
    def middle_torque(self) -> float:
        """Torque in N m with the middling thrust on every thruster, each in the sense of its arm."""
        return sum(abs(thruster.arm) * self.middle_thrust for thruster in self.thrusters)

    @property
    def middle_thrust(self) -> float:
        """Thrust in N of the first thruster at the middling command."""
        curve = self.thrusters[0].curve
        return float(curve.thrust(np.array([curve.neutral + self.middle]))[0])

    @property
    def middle_rate(self) -> float:
        """Yaw rate in rad/s of the middling command; in pitch a scale of rates, not one that is held."""
        return self.dynamics.steady_rate(self.middle_torque)

    @property
    def time_constant(self) -> float:
        """Of the motion about the middling rate, in s."""
        dynamics = self.dynamics
        return dynamics.inertia / (2.0 * dynamics.quadratic_drag * self.middle_rate + dynamics.linear_drag)


ROSUB = Truth(
    name="ROSUB 6000, tank configuration (synthetic)",
    mass=2604.0,
    length=2.6,
    width=2.0,
    dynamics=Dynamics(inertia=5057.0, quadratic_drag=3532.0, linear_drag=132.0),
    thrusters=(Thruster(name="fore", arm=0.43), Thruster(name="aft", arm=0.43)),
    disturbance=Disturbance(standard_deviation=2.5),
)

# Between Minerva and the BlueROV2 of EFFECTS.md section 2; half the added inertia, drag of a box with Cd 1.9.
# 5.3 N m and 0.5 rad/s in the middle, time constant 0.7 s there. Commands from -1 to 1.
_MEDIUM_CURVE = BenchCurve(forward=5.3, reverse=4.0, dead_zone=0.05, limit=1.0, step=0.002)
OBSERVATION = Truth(
    name="observation-class ROV (synthetic)",
    mass=60.0,
    length=1.0,
    width=0.6,
    dynamics=Dynamics(inertia=12.0, quadratic_drag=15.0, linear_drag=3.0),
    thrusters=(
        Thruster(name="fore", arm=0.25, curve=_MEDIUM_CURVE),
        Thruster(name="aft", arm=0.25, curve=_MEDIUM_CURVE),
    ),
    disturbance=Disturbance(standard_deviation=0.105, correlation_time=2.0),
    instruments=Instruments(command_span=4.0, supply_drop=1.0),
    command_unit="1",
    middle=0.5,
    pace=0.4,
)

# BlueROV2 as von Benzon 2022 has it, with the linear drag of others (EFFECTS.md section 2), and T200 thrusters:
# neutral 1500 us, none within 28 us of it, 5.2 and 4.1 kgf at 400 us. 0.95 N m and 0.7 rad/s in the middle, time
# constant 0.25 s there.
_SMALL_CURVE = BenchCurve(forward=3.76e-5, reverse=2.95e-5, dead_zone=28.0, limit=400.0, neutral=1500.0, step=2.0)
SMALL = Truth(
    name="small ROV (synthetic)",
    mass=11.5,
    length=0.46,
    width=0.44,
    dynamics=Dynamics(inertia=0.6, quadratic_drag=1.5, linear_drag=0.3),
    thrusters=(Thruster(name="fore", arm=0.16, curve=_SMALL_CURVE), Thruster(name="aft", arm=0.16, curve=_SMALL_CURVE)),
    disturbance=Disturbance(standard_deviation=0.019, correlation_time=1.0),
    instruments=Instruments(command_span=4096.0, supply=16.0, supply_drop=0.002),
    command_unit="us",
    middle=118.0,
    pace=0.25,
)

VEHICLES: tuple[Truth, ...] = (ROSUB, OBSERVATION, SMALL)
