"""Random vehicles over decades of size, and their motion by Runge and Kutta's fourth-order method."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

# Unit of the commands -> (command at rest, full command minus the command at rest, decimals in the log).
UNITS: Mapping[str, tuple[float, float, int]] = {
    "V": (0.0, 10.0, 3),
    "percent": (0.0, 100.0, 1),
    "us": (1500.0, 400.0, 0),
    "1": (0.0, 1.0, 4),
}
HIDDEN = ("thruster_lag", "bias_torque", "reverse_gain")
_NAMES = ("port", "starboard", "fore", "aft", "port_aft", "starboard_aft")
_SUBSTEP = 0.05  # longest integration step, in time constants; the error of RK4 is below 1e-7 of the rate


@dataclass(frozen=True, kw_only=True)
class Thruster:
    """A thruster: arm in m, and its curve from command (in the unit of the logs) to thrust in N."""

    name: str
    arm: float
    command: FloatArray
    thrust: FloatArray


@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """Inertia in kg m2, drags in N m s2 and N m s, mass in kg, lengths in m, full rate in rad/s, torque in N m.

    ``time_constant`` is inertia / (2 quadratic_drag full_rate + linear_drag), in s. ``lag`` in s, ``bias`` in N m and
    ``reverse_gain`` are the hidden effects; 0, 0 and 1 where they are absent.
    """

    inertia: float
    quadratic_drag: float
    linear_drag: float
    time_constant: float
    full_rate: float
    full_torque: float
    mass: float
    length: float
    width: float
    unit: str
    thrusters: tuple[Thruster, ...]
    lag: float = 0.0
    bias: float = 0.0
    reverse_gain: float = 1.0

    def torque(self, commands: FloatArray) -> FloatArray:
        """Torque (m,) in N m of ``commands`` (m, thrusters)."""
        total = np.zeros(len(commands))
        for column, thruster in enumerate(self.thrusters):
            thrust = np.interp(commands[:, column], thruster.command, thruster.thrust)
            total += thruster.arm * np.where(thrust < 0.0, self.reverse_gain, 1.0) * thrust
        return total


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw of a number with a uniform logarithm."""
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def draw_vehicle(rng: np.random.Generator, unit: str, hidden: str | None = None) -> Vehicle:
    """Draw a vehicle; ``hidden`` is an effect of HIDDEN, or None."""
    inertia = log_uniform(rng, 0.4, 1e5)
    time_constant = log_uniform(rng, 0.2, 20.0)
    full_rate = math.radians(log_uniform(rng, 8.0, 60.0))
    quadratic_share = rng.uniform(0.35, 0.95)  # of the torque at the full rate
    torque = inertia * full_rate / ((1.0 + quadratic_share) * time_constant)
    slimness, filling = rng.uniform(0.35, 0.9), log_uniform(rng, 60.0, 300.0)  # width/length, mass/length^3
    rigid = rng.uniform(0.5, 0.9) * inertia
    length = (12.0 * rigid / (filling * (1.0 + slimness**2))) ** 0.2
    effects: dict[str, float] = {}
    if hidden == "thruster_lag":
        effects["lag"] = time_constant * log_uniform(rng, 0.2, 1.0)
    elif hidden == "bias_torque":
        effects["bias"] = float(rng.choice([-1.0, 1.0])) * torque * rng.uniform(0.03, 0.1)
    elif hidden == "reverse_gain":
        effects["reverse_gain"] = rng.uniform(0.7, 0.9)
    return Vehicle(
        inertia=inertia,
        quadratic_drag=quadratic_share * torque / full_rate**2,
        linear_drag=(1.0 - quadratic_share) * torque / full_rate,
        time_constant=time_constant,
        full_rate=full_rate,
        full_torque=torque,
        mass=filling * length**3,
        length=length,
        width=slimness * length,
        unit=unit,
        thrusters=_draw_thrusters(rng, unit, torque, length),
        **effects,
    )


def _draw_thrusters(rng: np.random.Generator, unit: str, torque: float, length: float) -> tuple[Thruster, ...]:
    """Thrusters that give ``torque`` together at full command ahead."""
    count = int(rng.integers(1, 7))
    arms = rng.uniform(0.2, 0.5, count) * length * rng.choice([-1.0, 1.0], count)
    rest, span, decimals = UNITS[unit]
    weights = rng.uniform(0.7, 1.0, count)
    thrusters = []
    for k in range(count):
        forward = weights[k] * torque / float(np.abs(arms) @ weights)
        dead_zone, power, reverse = rng.choice([0.0, 0.03, 0.08]), rng.uniform(1.0, 2.0), rng.uniform(0.7, 1.0)
        share = np.unique(np.concatenate([np.linspace(-1.0, 1.0, 21), [-dead_zone, 0.0, dead_zone]]).round(9))
        size = (np.maximum(np.abs(share) - dead_zone, 0.0) / (1.0 - dead_zone)) ** power
        thrust = forward * np.where(share < 0.0, -reverse, 1.0) * size
        command = np.round(rest + span * share, decimals + 2)
        thrusters.append(Thruster(name=_NAMES[k], arm=float(f"{arms[k]:.6g}"), command=command, thrust=thrust))
    return tuple(thrusters)


def move(
    vehicle: Vehicle,
    time: FloatArray,
    command_time: FloatArray,
    commands: FloatArray,
    disturbance: FloatArray,
    heading: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Heading (n,) in rad and rate (n,) in rad/s at ``time`` (n,) in s, from rest.

    Parameters
    ----------
    command_time, commands
        (m,) s and (m, thrusters). A command holds until the next one. The first is not after ``time[0]``.
    disturbance
        (n,) N m. Each value holds until the next instant of ``time``.
    """
    torque = vehicle.torque(commands)
    instants = np.unique(np.concatenate([time, command_time[(command_time > time[0]) & (command_time < time[-1])]]))
    drive = torque[np.searchsorted(command_time, instants, side="right") - 1]
    extra = disturbance[np.searchsorted(time, instants, side="right") - 1] + vehicle.bias
    spans = np.diff(instants)
    counts = np.maximum(1, np.ceil(spans / (_SUBSTEP * min(vehicle.time_constant, vehicle.lag or math.inf)))).astype(
        int
    )
    state = (heading, 0.0, float(drive[0]))
    headings, rates = [state[0]], [state[1]]
    for span, count, wanted, other in zip(
        spans.tolist(), counts.tolist(), drive.tolist(), extra.tolist(), strict=False
    ):
        for _ in range(count):
            state = _step(vehicle, state, wanted, other, span / count)
        headings.append(state[0])
        rates.append(state[1])
    at = np.searchsorted(instants, time)
    return np.array(headings)[at], np.array(rates)[at]


def _step(
    vehicle: Vehicle, state: tuple[float, float, float], wanted: float, other: float, step: float
) -> tuple[float, float, float]:
    """Heading, rate and thrusters' torque after ``step`` s of constant commands."""
    heading, rate, drive = state
    inertia, quadratic, linear = vehicle.inertia, vehicle.quadratic_drag, vehicle.linear_drag
    if vehicle.lag:
        middle = wanted + (drive - wanted) * math.exp(-0.5 * step / vehicle.lag)
        last = wanted + (drive - wanted) * math.exp(-step / vehicle.lag)
    else:
        drive = middle = last = wanted

    def slope(r: float, torque: float) -> float:
        return (torque + other - quadratic * abs(r) * r - linear * r) / inertia

    first = slope(rate, drive)
    second = slope(rate + 0.5 * step * first, middle)
    third = slope(rate + 0.5 * step * second, middle)
    fourth = slope(rate + step * third, last)
    heading += step * (rate + step * (first + second + third) / 6.0)
    rate += step * (first + 2.0 * second + 2.0 * third + fourth) / 6.0
    return heading, rate, last


def coloured(rng: np.random.Generator, time: FloatArray, size: float, memory: float) -> FloatArray:
    """First-order Gauss-Markov process (n,) of standard deviation ``size`` and correlation time ``memory`` in s."""
    decay = np.exp(-np.diff(time, prepend=time[0] - 10.0 * memory) / memory)
    kicks = size * np.sqrt(1.0 - decay**2) * rng.standard_normal(len(time))
    values = np.empty(len(time))
    value = 0.0
    for k in range(len(time)):
        value = decay[k] * value + kicks[k]
        values[k] = value
    return values
