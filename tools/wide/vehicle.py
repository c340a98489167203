"""Random vehicles: inertia over eight decades, time constants of 0.1 to 60 s, one to six thrusters in any unit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tools.wide.motion import Floats

# Unit of the commands -> (command at rest, smallest and largest span to full command, decimals in the log).
UNITS: Mapping[str, tuple[float, float, float, int]] = {
    "V": (0.0, 5.0, 24.0, 3),
    "percent": (0.0, 100.0, 100.0, 1),
    "us": (1500.0, 300.0, 500.0, 0),
    "1": (0.0, 1.0, 1.0, 4),
    "rpm": (0.0, 400.0, 4000.0, 0),
}
SHAPES = ("linear", "square", "power", "saturating", "dead zone")
_NAMES = ("bow", "stern", "port", "starboard", "aft_port", "aft_starboard")


@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """A vehicle with its bench tables.

    ``time_constant`` = inertia / (2 quadratic_drag full_rate + linear_drag), in s. ``torque`` in N m keeps
    ``full_rate`` in rad/s. ``commands`` (shares of full command, the same for all thrusters, (m,)) and ``thrusts`` (n,
    m) in N are the bench tables, ``arms`` (n,) in m. A command in the log is rest + span * share.
    """

    inertia: float
    quadratic_drag: float
    linear_drag: float
    time_constant: float
    full_rate: float
    torque: float
    mass: float
    length: float
    width: float
    rigid_inertia: float
    unit: str
    rest: float
    span: float
    decimals: int
    shape: str
    names: tuple[str, ...]
    arms: Floats
    zones: Floats  # (n, 2): shares of full command without thrust, ahead and astern
    commands: Floats
    thrusts: Floats

    @property
    def full_thrusts(self) -> Floats:
        """Largest thrust of each thruster (n,) in N."""
        largest: Floats = np.abs(self.thrusts).max(axis=1)
        return largest

    def rounded(self, shares: Floats) -> Floats:
        """Commands as shares, as the log's resolution has them."""
        raw = np.round(self.rest + self.span * shares, self.decimals)
        result: Floats = (raw - self.rest) / self.span
        return result


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw of a number with a uniform logarithm."""
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def draw_vehicle(rng: np.random.Generator, *, least_thrusters: int, turns: bool, quadratic: bool) -> Vehicle:
    """Draw a vehicle.

    Parameters
    ----------
    turns
        It has to turn through large angles within a time constant, because the cause depends on the heading.
    quadratic
        At least half of its drag at the full rate is quadratic, because the cause changes this part.
    """
    inertia = log_uniform(rng, 0.01, 1e6)
    tau = log_uniform(rng, 0.1, 60.0)
    swing = log_uniform(rng, 0.6 if turns else 0.1, 1.5)  # rad in a time constant at the full rate
    full_rate = min(swing / tau, 4.0)
    share = float(rng.uniform(0.5 if quadratic else 0.1, 1.0))  # of the torque at the full rate
    torque = inertia * full_rate / ((1.0 + share) * tau)
    slimness, filling = float(rng.uniform(0.35, 0.9)), log_uniform(rng, 60.0, 300.0)  # width/length, mass/length^3
    rigid = float(rng.uniform(0.4, 0.95)) * inertia
    length = (12.0 * rigid / (filling * (1.0 + slimness**2))) ** 0.2
    unit = str(rng.choice(list(UNITS)))
    rest, least, most, decimals = UNITS[unit]
    count = max(int(rng.choice([1, 2, 2, 3, 4, 4, 5, 6])), least_thrusters)
    arms = np.round(rng.uniform(0.2, 0.5, count) * length * rng.choice([-1.0, 1.0], count), 6)
    shape = str(rng.choice(SHAPES))
    commands, thrusts, zones = _bench(rng, shape, count)
    # Ahead or astern, whichever turns the heading up, the thrusters together have the full torque.
    up = np.where(arms > 0.0, thrusts[:, -1], -thrusts[:, 0])
    thrusts *= torque / float(np.abs(arms) @ up)
    return Vehicle(
        inertia=inertia,
        quadratic_drag=share * torque / full_rate**2,
        linear_drag=(1.0 - share) * torque / full_rate,
        time_constant=tau,
        full_rate=full_rate,
        torque=torque,
        mass=filling * length**3,
        length=length,
        width=slimness * length,
        rigid_inertia=rigid,
        unit=unit,
        rest=rest,
        span=float(f"{log_uniform(rng, least, most):.2g}"),
        decimals=decimals,
        shape=shape,
        names=_NAMES[:count],
        arms=arms,
        zones=zones,
        commands=commands,
        thrusts=thrusts,
    )


def _bench(rng: np.random.Generator, shape: str, count: int) -> tuple[Floats, Floats, Floats]:
    """Shares of full command (m,), relative thrusts (count, m) and zones without thrust (count, 2)."""
    zone = float(rng.uniform(0.02, 0.1)) if shape == "dead zone" else 0.0
    power = {"linear": 1.0, "square": 2.0, "saturating": 1.0}.get(shape) or float(rng.uniform(1.1, 1.9))
    reverse = float(rng.choice([1.0, rng.uniform(0.5, 0.95)]))
    bend = float(rng.uniform(0.5, 1.5))
    commands = np.unique(np.concatenate([np.linspace(-1.0, 1.0, 41), [-zone, zone]]).round(9))
    if zone:
        commands = np.unique(np.concatenate([commands, zone + 0.02 * np.arange(1, 6), -zone - 0.02 * np.arange(1, 6)]))
    size = (np.maximum(np.abs(commands) - zone, 0.0) / (1.0 - zone)) ** power
    if shape == "saturating":
        size = np.tanh(bend * size) / math.tanh(bend)
    size = np.where(commands < 0.0, -reverse, 1.0) * size
    thrusts = rng.uniform(0.6, 1.0, count)[:, np.newaxis] * size
    return commands, thrusts, np.full((count, 2), zone)
