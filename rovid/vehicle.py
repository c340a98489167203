"""The vehicle: from thruster commands to yaw torque."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rovid.errors import ConfigError
from rovid.trial import FloatArray, Trial, read_only

# A bench curve ends at the last command tried on the bench; rounding of the log may step just outside.
_ROUNDING = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class ThrustCurve:
    """Thrust against command, linear between the bench points.

    Attributes
    ----------
    command
        (m,) strictly increasing, in the unit of the log's command.
    thrust
        (m,) N.
    """

    command: FloatArray
    thrust: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "command", read_only(self.command))
        object.__setattr__(self, "thrust", read_only(self.thrust))

    def __call__(self, command: ArrayLike) -> FloatArray:
        """Thrust in N at ``command``; the end values outside the curve."""
        return np.interp(np.asarray(command, dtype=np.float64), self.command, self.thrust)

    @property
    def span(self) -> float:
        """Width of the tested commands."""
        return float(self.command[-1] - self.command[0])

    def outside(self, command: FloatArray) -> float:
        """How far the farthest of ``command`` lies outside the curve; 0 when all are inside or missing."""
        finite = command[np.isfinite(command)]
        if not finite.size:
            return 0.0
        beyond = max(self.command[0] - finite.min(), finite.max() - self.command[-1])
        return float(beyond) if beyond > _ROUNDING * self.span else 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Thruster:
    """One actuator: ``torque = yaw_arm * curve(command)``; positive torque turns the heading up.

    A logged torque is an actuator whose ``curve`` is None: its command is the torque in N m, its arm 1.
    ``clamp`` allows commands outside the curve, at the curve's end values.
    """

    name: str
    yaw_arm: float
    curve: ThrustCurve | None
    clamp: bool = False

    def torque(self, command: FloatArray) -> FloatArray:
        """(n,) N m for (n,) commands."""
        return self.yaw_arm * (command if self.curve is None else self.curve(command))

    def command_range(self) -> float:
        """Width of the commands that the curve knows; NaN for a logged torque."""
        return float("nan") if self.curve is None else self.curve.span


@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """What rovid.toml says of the vehicle.

    Attributes
    ----------
    rigid_body_inertia
        kg m^2 about the vertical axis, or None where neither it nor mass and size are given.
    thrusters
        In the order of the columns of ``Trial.commands``.
    """

    name: str
    thrusters: tuple[Thruster, ...]
    mass: float | None = None
    length: float | None = None
    width: float | None = None
    rigid_body_inertia: float | None = None

    def __post_init__(self) -> None:
        box = (self.mass, self.length, self.width)
        if self.rigid_body_inertia is None and None not in box:
            inertia = box_inertia(*(float(value) for value in box if value is not None))
            object.__setattr__(self, "rigid_body_inertia", inertia)

    def thrust(self, commands: FloatArray) -> FloatArray:
        """(n, k) thrust in N for (n, k) commands; the torque itself for a logged torque."""
        columns = zip(self.thrusters, commands.T, strict=True)
        return np.column_stack([u if thruster.curve is None else thruster.curve(u) for thruster, u in columns])

    def torque(self, trial: Trial) -> FloatArray:
        """(n,) yaw torque in N m, held until the next instant of ``trial.time``.

        Raises
        ------
        ConfigError
            A command lies outside its thruster's bench curve.
        """
        total = np.zeros(len(trial.time))
        for thruster, command in zip(self.thrusters, trial.commands.T, strict=True):
            if thruster.curve is not None and not thruster.clamp and thruster.curve.outside(command):
                raise _outside(trial, thruster, thruster.curve, command)
            total += thruster.torque(command)
        return total


def box_inertia(mass: float, length: float, width: float) -> float:
    """Yaw inertia in kg m^2 of a uniform box of ``mass`` kg, ``length`` and ``width`` m."""
    return mass * (length**2 + width**2) / 12.0


def _outside(trial: Trial, thruster: Thruster, curve: ThrustCurve, command: FloatArray) -> ConfigError:
    low, high = curve.command[[0, -1]]
    excess = np.maximum(low - command, command - high)
    at = int(np.nanargmax(excess))
    count = int(np.nansum(excess > _ROUNDING * curve.span))
    return ConfigError(
        f"thruster {thruster.name!r} is commanded {command[at]:g} at {trial.time[at]:.2f} s "
        f"({count} samples in all), outside its bench curve, which ends at {low:g} and {high:g}; "
        "the thrust there is not known.",
        where=trial.name,
        mend=f'Extend the curve, or set outside = "clamp" in [[thrusters]] {thruster.name!r} '
        "to hold the curve's end value.",
    )
