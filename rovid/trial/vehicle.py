"""The vehicle: from thruster commands to the torque, or the force, along one axis; inertia and drag by its size."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from rovid.core.array_types import FloatArray
from rovid.core.errors import ConfigError
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import YAW, Axis
from rovid.trial.trial import Trial, read_only

# Half widths of a curve from its middle; farther commands are not of the curve's unit. A tested range is exceeded by
# overdrive of some tens of percent, but units differ by factors of 5 and more.
FAR_OUTSIDE = 1.5
# Share of the curve's width by which rounding in the log may exceed the bench curve.
_ROUNDING = 1e-3
# Points of a quadratic curve on each side of zero. Between them the line departs from the parabola by 2.5e-5 of the
# largest thrust at most.
_POINTS = 101


@dataclass(frozen=True, kw_only=True, eq=False)
class ThrustCurve:
    """Thrust against command, linear between the bench points."""

    command: FloatArray  #: (m,) strictly increasing, in the unit of the log's command.
    thrust: FloatArray  #: (m,) N.

    def __post_init__(self) -> None:
        object.__setattr__(self, "command", read_only(self.command))
        object.__setattr__(self, "thrust", read_only(self.thrust))

    @classmethod
    def proportional(cls, constant: float, most: float, power: int) -> Self:
        """Thrust ``constant`` * |command|^``power`` with the sign of the command, up to ``most`` in both directions."""
        half = np.linspace(0.0, most, _POINTS if power > 1 else 2)
        command = np.concatenate((-half[:0:-1], half))
        return cls(command=command, thrust=constant * np.sign(command) * np.abs(command) ** power)

    def __call__(self, command: ArrayLike) -> FloatArray:
        """Thrust in N at ``command``; the end values outside the curve."""
        return np.interp(np.asarray(command, dtype=np.float64), self.command, self.thrust)

    @property
    def span(self) -> float:
        """Width of the tested commands."""
        return float(self.command[-1] - self.command[0])

    @property
    def neutral(self) -> float:
        """Command without thrust: the middle of the commands at which the curve has the least thrust."""
        size = np.abs(self.thrust)
        least = np.flatnonzero(size <= size.min() + _ROUNDING * size.max())
        if size.min() > _ROUNDING * size.max():  # The line crosses zero between two points.
            signs = np.flatnonzero(self.thrust[1:] * self.thrust[:-1] < 0.0)
            if signs.size:
                at = int(signs[0])
                share = self.thrust[at] / (self.thrust[at] - self.thrust[at + 1])
                return float(self.command[at] + share * (self.command[at + 1] - self.command[at]))
        return float(0.5 * (self.command[least[0]] + self.command[least[-1]]))

    def reach(self, command: FloatArray) -> FloatArray:
        """Distance of ``command`` from the middle of the curve, in half widths of the curve: at most 1 inside."""
        middle = 0.5 * (self.command[0] + self.command[-1])
        return np.asarray(np.abs(command - middle) / (0.5 * self.span))

    def excess(self, command: FloatArray) -> float:
        """Largest distance of ``command`` outside the curve; 0 when all are inside or missing."""
        finite = command[np.isfinite(command)]
        if not finite.size:
            return 0.0
        beyond = float(max(self.command[0] - finite.min(), finite.max() - self.command[-1]))
        return beyond if beyond > _ROUNDING * self.span else 0.0


# m^2/s^2; least squared speed of a rudder: without flow, the torque would not contain the angle.
_LEAST_FLOW = 1e-9


@dataclass(frozen=True, kw_only=True)
class Steering:
    """Conversion of a steering angle to the command of a drive without a curve.

    Rudder (Fossen 2011, sect. 9.5, at small angles): torque = size * U|U| * angle, size in N m s^2/(m^2 rad). Steered
    wheels (kinematic bicycle model): ordered yaw rate = U * tan(angle) / size, size in m, the wheelbase.
    """

    speed: str  #: Signal of the speed U, in m/s.
    size: float
    wheels: bool

    def command(self, angle: FloatArray, speed: FloatArray) -> FloatArray:
        """(n,) torque in N m, or yaw rate in rad/s, at (n,) angles in rad and speeds in m/s."""
        if self.wheels:
            return np.asarray(speed * np.tan(angle) / self.size)
        return np.asarray(self.gain(speed) * angle)

    def gain(self, speed: FloatArray) -> FloatArray:
        """(n,) command at a rudder's angle of 1 rad; never zero, and 1 for wheels."""
        if self.wheels:
            return np.ones(len(speed))
        return np.asarray(self.size * np.copysign(np.maximum(speed**2, _LEAST_FLOW), speed))


@dataclass(frozen=True, kw_only=True)
class Rudder:
    """A rudder of the coupled model: its command is its angle in rad, its force a function of the motion.

    The angle is positive with the trailing edge to starboard, which turns the bow of a vehicle to starboard if it moves
    ahead and its rudder is aft. `rovid.planar.model` holds the equation.
    """

    position: tuple[float, float]  #: m, x ahead and y to starboard of the origin.
    #: N s^2/(m^2 rad); slope of the normal force at small angles over the square of the inflow speed; None where it is
    #: to be estimated from nothing.
    lift: float | None = None
    behind: str = ""  #: Name of the thruster in whose slipstream the rudder stands; empty for a free rudder.
    #: m^2/(s^2 N); square of the speed that the slipstream adds, over its thrust; None where it is unknown.
    slipstream: float | None = None
    stall: float | None = None  #: rad, angle of attack beyond which the lift no longer grows; None where unknown.


@dataclass(frozen=True, kw_only=True, eq=False)
class Thruster:
    """One actuator: ``torque = arm * curve(command)``; a positive torque increases the position.

    In the coupled model the three of ``surge_share``, ``sway_share`` and ``arm`` are known: force ahead, force to
    starboard and torque of 1 N of thrust. An azimuth angle a, the command of an actuator that ``turns`` this one, turns
    the force by a, positive to starboard, at the ``position``.
    """

    name: str
    arm: float  #: m; along a linear axis the share of the thrust, and the torque is a force.
    curve: ThrustCurve | None  #: None for a logged torque: its command is the torque in N m, and its arm is 1.
    clamp: bool = False  #: Whether commands outside the curve are allowed, at the curve's end values.
    max_logged_torque: float = 1.0  #: N m, largest magnitude of a logged torque.
    surge_share: float = 0.0  #: Share of the thrust that drives the vehicle ahead; 0 where unknown.
    sway_share: float = 0.0  #: Share of the thrust that drives the vehicle to starboard; read for the coupled model.
    position: tuple[float, float] | None = None  #: m, x ahead and y to starboard of the origin; None where not given.
    turns: str = ""  #: Of an azimuth angle in rad: name of the thruster that it turns.
    rudder: Rudder | None = None  #: Of a rudder in the coupled model, with the angle in rad as its command.
    #: ``arm_guessed``, ``curve_guessed``: whether the value is an unconfirmed guess of `rovid init`.
    arm_guessed: bool = False
    curve_guessed: bool = False
    scale_key: str = ""  #: Key of rovid.toml that scales the torque in place of the arm.
    steering: Steering | None = None  #: Of a rudder or of steered wheels: its command is computed from an angle.
    is_rate_order: bool = False  #: Whether the command is the rate that a controller is ordered to keep, in SI.

    @property
    def is_rudder(self) -> bool:
        """Whether the command is the torque of a rudder's angle at the logged speed."""
        return self.steering is not None and not self.steering.wheels

    @property
    def is_angle(self) -> bool:
        """Whether the command is an angle in rad that turns a force, rather than a thrust."""
        return bool(self.turns) or self.rudder is not None

    @property
    def full_thrust(self) -> float:
        """Largest thrust of the curve in N, or largest logged torque in N m."""
        return self.max_logged_torque if self.curve is None else float(np.max(np.abs(self.curve.thrust)))

    def scaled(self, factor: float) -> Self:
        """The thruster with ``factor`` times the thrust of its curve."""
        if self.curve is None or factor == 1.0:
            return self
        return replace(self, curve=ThrustCurve(command=self.curve.command, thrust=factor * self.curve.thrust))

    def torque(self, command: FloatArray) -> FloatArray:
        """(n,) N m for (n,) commands."""
        return self.arm * (command if self.curve is None else self.curve(command))

    def command_range(self) -> float:
        """Width of the tested commands; NaN for a logged torque."""
        return float("nan") if self.curve is None else self.curve.span


# Plausible total over rigid-body yaw inertia. Published vehicles: 1.1 to 2.5; a closed hull full of water: 4.
PLAUSIBLE_INERTIA_RATIO = (0.9, 8.0)
# The usual ratio: the geometric mean of the published ones.
USUAL_INERTIA_RATIO = 1.66


@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """The vehicle of a rovid.toml."""

    name: str
    thrusters: tuple[Thruster, ...]  #: In the order of the columns of ``Trial.commands``.
    mass: float | None = None
    length: float | None = None
    width: float | None = None
    height: float | None = None
    #: kg m^2 about the axis, or kg along it; None where unknown. A given value is that of yaw; otherwise the inertia of
    #: a uniform box of the vehicle's mass and size.
    rigid_body_inertia: float | None = None
    #: True thrust over that of the curves as given, which ``thrusters`` contain, and its standard error; 0 if unknown.
    thrust_scale: float = 1.0
    thrust_scale_error: float = 0.0
    axis: Axis = YAW  #: The degree of freedom.
    #: Whether surge, sway and yaw are coupled: ``thrusters`` are all that act on any of the three. ``axis`` is yaw.
    planar: bool = False

    def __post_init__(self) -> None:
        if self.axis is not YAW or self.rigid_body_inertia is None:
            inertia = self.mass  # Along a linear axis.
            if self.axis.angular:
                sides = {"yaw": (self.length, self.width), "pitch": (self.length, self.height)}
                first, second = sides.get(self.axis.name, (self.width, self.height))
                inertia = None
                if self.mass is not None and first is not None and second is not None:
                    inertia = box_inertia(self.mass, first, second)
            object.__setattr__(self, "rigid_body_inertia", inertia)

    @property
    def relative_scale_error(self) -> float:
        """Standard error of the thrust scale over the scale; 0 where unknown."""
        return self.thrust_scale_error / self.thrust_scale

    @property
    def has_rudders_alone(self) -> bool:
        """Whether rudders, and no thruster, drive the vehicle along this axis."""
        return bool(self.thrusters) and all(thruster.is_rudder for thruster in self.thrusters)

    @property
    def surge_shares(self) -> FloatArray:
        """(k,) share of each thrust that drives the vehicle ahead; zeros where unknown.

        Yaw thrusters on both sides of the middle, without a given share, are taken as twin screws: all push ahead.
        """
        given = np.array([thruster.surge_share for thruster in self.thrusters])
        arms = np.array([thruster.arm for thruster in self.thrusters])
        on_both_sides = self.axis is YAW and np.any(arms > 0.0) and np.any(arms < 0.0)
        return np.ones(len(given)) if on_both_sides and not given.any() else given

    @property
    def assumptions(self) -> Assumptions:
        """Guessed values of the thrusters."""
        items: list[str] = []
        for thruster in self.thrusters:
            if thruster.rudder is not None:  # The fit estimates its lift.
                continue
            key = thruster.scale_key or self.axis.arm_key
            items += [f"{key} of {thruster.name}"] * thruster.arm_guessed
            items += [f"curve of {thruster.name}"] * thruster.curve_guessed
        return Assumptions(items=tuple(items), thrusters=len(self.thrusters))

    @property
    def is_steered(self) -> bool:
        """Whether a rudder or steered wheels act along one axis: `plan`, `control` and `export` refuse the vehicle."""
        return any(thruster.steering is not None for thruster in self.thrusters)

    def require_no_rudder(self, purpose: str) -> None:
        """Refuse a ``purpose`` that needs the torque of each command alone.

        Raises ConfigError if there is a rudder, whose torque depends on the speed.
        """
        if self.is_steered:
            name = next(thruster.name for thruster in self.thrusters if thruster.steering is not None)
            text = f"{name} is a rudder: its torque depends on the speed of the vehicle, which {purpose} does not know."
            mend = (
                "`rovid fit`, `simulate` and `diagnose` take rudders. With speeds ahead and sideways in the logs, "
                "`--axes planar` of `fit`, `plan` and `export` takes them, too."
            )
            raise ConfigError(text, where="[[rudders]]", mend=mend)

    @property
    def reference_inertia(self) -> float | None:
        """Rigid-body inertia to compare a fitted inertia with; None where arms, curves or a rudder are guessed."""
        if self.assumptions or any(thruster.rudder is not None for thruster in self.thrusters):
            return None
        return self.rigid_body_inertia

    def with_logged_torque(self, trials: Sequence[Trial]) -> Self:
        """The vehicle with the largest torque that is logged in ``trials``."""
        largest = np.max([np.max(np.abs(trial.commands), axis=0) for trial in trials], axis=0).tolist()
        thrusters = []
        for thruster, torque in zip(self.thrusters, largest, strict=True):
            known = thruster.curve is not None
            thrusters.append(thruster if known else replace(thruster, max_logged_torque=torque or 1.0))
        return replace(self, thrusters=tuple(thrusters))

    def clamped(self) -> Self:
        """The vehicle whose commands outside the bench curves give the curves' end values."""
        return replace(self, thrusters=tuple(replace(thruster, clamp=True) for thruster in self.thrusters))

    def thrust(self, commands: FloatArray) -> FloatArray:
        """(n, k) thrust in N for (n, k) commands; the torque itself for a logged torque."""
        thrust = np.empty_like(commands)
        for at, (thruster, command) in enumerate(zip(self.thrusters, commands.T, strict=True)):
            thrust[:, at] = command if thruster.curve is None else thruster.curve(command)
        return thrust

    def torque(self, trial: Trial) -> FloatArray:
        """(n,) torque in N m, held until the next instant; `ConfigError` for a command outside its bench curve."""
        total = np.zeros(len(trial.time))
        for thruster, command in zip(self.thrusters, trial.commands.T, strict=True):
            if thruster.curve is not None and not thruster.clamp and thruster.curve.excess(command):
                raise _outside(trial, thruster, thruster.curve, command)
            turned = (one for one, by in enumerate(self.thrusters) if by.turns and by.turns == thruster.name)
            if (at := next(turned, None)) is None:
                total += thruster.torque(command)
            else:
                azimuth = trial.commands[:, at]
                ahead, starboard = thruster.surge_share, thruster.sway_share
                x, y = thruster.position or (0.0, 0.0)
                cos, sin = np.cos(azimuth), np.sin(azimuth)
                arm = x * (starboard * cos + ahead * sin) - y * (ahead * cos - starboard * sin)
                total += arm * self.thrust(trial.commands)[:, self.thrusters.index(thruster)]
        return total


def box_inertia(mass: float, length: float, width: float) -> float:
    """Inertia in kg m^2 of a uniform box of ``mass`` kg, ``length`` and ``width`` m across the axis."""
    return mass * (length**2 + width**2) / 12.0


def _outside(trial: Trial, thruster: Thruster, curve: ThrustCurve, command: FloatArray) -> ConfigError:
    low, high = curve.command[[0, -1]]
    excess = np.maximum(low - command, command - high)
    at = int(np.nanargmax(excess))
    count = int(np.nansum(excess > _ROUNDING * curve.span))
    mend = f'Extend the curve, or set outside = "clamp" in [[thrusters]] {thruster.name!r} to hold the curve\'s end '
    mend += "value."
    if curve.reach(command[at]) > FAR_OUTSIDE:  # The curve's end value would be full thrust.
        mend = "That is far outside: the command and the curve are of different units, or the value means no command. "
        mend += "Give the curve in the unit of the command, or leave these samples out."
    text = f"thruster {thruster.name!r} is commanded {command[at]:g} at {trial.time[at]:.2f} s "
    text += f"({count} samples in all), outside its bench curve, which ends at {low:g} and {high:g}; "
    text += "the thrust there is not known."
    return ConfigError(text, where=trial.name, mend=mend)


# --- a hull by its dimensions, with a wide error ----------------------------------------------------------------
#
# The added masses are those of an ellipsoid with the hull's dimensions in an ideal fluid (Lamb 1932, articles 114 and
# 115; Newman 1977, chapter 4). At the surface, and at low frequencies, the ellipsoid is the hull with its mirror image:
# the hull is half of it. The cross-flow drag is the strip integral of a constant section (Fossen 2011, section 6.4.3).

# kg/m^3 of fresh water; sea water is within the errors of what is computed with it.
WATER_DENSITY = 1000.0


def cross_flow_drags(length: float, depth: float, drag_coefficient: float) -> tuple[float, float]:
    """Quadratic drag in sway, N s^2/m^2, and in yaw, N m s^2, of a hull with sections of one ``depth`` in m.

    With the half density times depth and coefficient k: k times the ``length`` L in m in sway, and the integral of
    k |x|^3 over the length in yaw, k L^4/32.
    """
    sway = 0.5 * WATER_DENSITY * drag_coefficient * depth * length
    return sway, sway * length**3 / 32.0


def hull_parameters(
    length: float,
    beam: float,
    depth: float,
    drag_coefficient: float = 1.0,
    mass: float | None = None,
    yaw_inertia: float | None = None,
    *,
    submerged: bool,
) -> dict[str, float]:
    """Inertias with added mass, and the quadratic drags of sway and yaw, in SI.

    ``depth`` is the height in m of a ``submerged`` hull, or else the draught; the other dimensions are in m. ``mass``
    in kg and ``yaw_inertia`` in kg m^2 are those of the rigid body; None for those of the displaced ellipsoid.
    """
    from scipy.special import elliprd

    a, b, c = 0.5 * length, 0.5 * beam, 0.5 * depth if submerged else depth
    # Lamb's integrals alpha_0 and beta_0 by Carlson's.
    alpha = 2.0 / 3.0 * a * b * c * float(elliprd(b * b, c * c, a * a))
    beta = 2.0 / 3.0 * a * b * c * float(elliprd(a * a, c * c, b * b))
    displaced = mass or WATER_DENSITY * (4.0 if submerged else 2.0) / 3.0 * math.pi * a * b * c
    difference, total = a * a - b * b, a * a + b * b
    divisor = 2.0 * difference - total * (beta - alpha)
    turning = 0.2 * difference**2 * (beta - alpha) / divisor if difference else 0.0
    sway_drag, yaw_drag = cross_flow_drags(length, depth, drag_coefficient)
    return {
        "surge.inertia": displaced * (1.0 + alpha / (2.0 - alpha)),
        "sway.inertia": displaced * (1.0 + beta / (2.0 - beta)),
        "yaw.inertia": (yaw_inertia or 0.2 * displaced * total) + turning * displaced,
        "sway.quadratic_drag": sway_drag,
        "yaw.quadratic_drag": yaw_drag,
    }
