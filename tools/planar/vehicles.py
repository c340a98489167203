"""Families of vehicles, drawn over sizes: box ROV, torpedo AUV, twin-hull USV, azimuth vessel, tanker model."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from tools.planar.motion import AZIMUTH, FIXED, RHO, RUDDER, Floats, Hull, Ints, Ship

# Unit of thruster commands -> (at rest, span to full command, decimals in the log).
_UNITS: Mapping[str, tuple[float, float, int]] = {
    "V": (0.0, 12.0, 3),
    "percent": (0.0, 100.0, 1),
    "us": (1500.0, 400.0, 0),
    "1": (0.0, 1.0, 4),
    "rpm": (0.0, 1500.0, 0),
}
_ROW = 16


@dataclass(frozen=True, kw_only=True)
class Actuator:
    """A thruster, azimuth thruster or rudder. ``x``, ``y`` in m, ``direction`` in rad, shares of the thrust."""

    name: str
    kind: int
    x: float
    y: float = 0.0
    direction: float = 0.0
    forward: float = 0.0  # N, at full command
    backward: float = 0.0
    behind: str = ""  # of a rudder: the propeller ahead
    area: float = 0.0  # m^2, of a rudder
    slipstream: float = 0.0  # m^2/s^2 for each N, at a rudder: 2 / (rho A of the propeller)

    @property
    def surge(self) -> float:
        """Share of the thrust ahead."""
        return round(math.cos(self.direction), 12)

    @property
    def sway(self) -> float:
        """Share of the thrust to starboard."""
        return round(math.sin(self.direction), 12)

    @property
    def arm(self) -> float:
        """Arm of the thrust about the vertical axis in m."""
        return self.x * math.sin(self.direction) - self.y * math.cos(self.direction)


@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """A vehicle with actuators, bench curves (n, m) and full speeds (m/s, m/s, rad/s).

    ``allocation`` (n, 6) maps demands (surge, sway, yaw; shares of full) to shares of thrust (for an azimuth thruster
    ahead and to starboard) or of the largest rudder angle. ``limits`` (channels, 2) are largest command and largest
    slope in 1/s, 0 for none. ``axes`` tells which demands have an effect.
    """

    family: str
    length: float
    width: float
    mass: float
    rigid_inertia: float
    hull: Hull
    ship: Ship = field(default_factory=Ship)
    actuators: tuple[Actuator, ...]
    channels: tuple[str, ...]
    unit: str
    rest: float
    span: float
    commands: Floats
    thrusts: Floats
    allocation: Floats
    limits: Floats
    decimals: Ints
    full: tuple[float, float, float]
    axes: tuple[bool, bool, bool]

    def rows(self) -> Floats:
        """Rows (n, 16) of `motion.simulate`, without causes."""
        table = np.zeros((len(self.actuators), _ROW))
        names = [one.name for one in self.actuators]
        for i, one in enumerate(self.actuators):
            table[i, :6] = (one.kind, one.surge, one.sway, one.arm, one.x, one.y)
            table[i, 8:10] = 1.0
            table[i, 10] = self.channels.index(one.name)
            if one.kind == AZIMUTH:
                table[i, 11] = self.channels.index(f"{one.name}_angle")
            if one.kind == RUDDER:
                table[i, 12] = names.index(one.behind)
                # Lift slope of a low-aspect rudder in its slipstream: 2.6 for each rad.
                table[i, 13:16] = (one.slipstream, 0.5 * RHO * one.area * 2.6, math.radians(35.0))
        return table

    def rests(self) -> Floats:
        """Commands at rest (n,)."""
        return np.array([0.0 if one.kind == RUDDER else self.rest for one in self.actuators])

    @property
    def time_constants(self) -> tuple[float, float, float]:
        """Time constants of surge, sway and yaw at full speed in s."""
        h, (u, v, r) = self.hull, self.full
        return (
            h.surge_inertia / (h.surge_linear + 2.0 * h.surge_quadratic * u),
            h.sway_inertia / (h.sway_linear + 2.0 * h.sway_quadratic * v),
            h.yaw_inertia / (h.yaw_linear + 2.0 * h.yaw_quadratic * r),
        )


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw of a number with a uniform logarithm."""
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def _hull(
    rng: np.random.Generator, size: tuple[float, float, float], mass: float, shape: Mapping[str, float],
    speed: float,
) -> tuple[Hull, float]:  # fmt: skip
    """Hull of length, width and draught in m, with the rigid inertia; ``speed`` is the full speed ahead in m/s.

    Drags are those of the frontal area, of the lateral area and of the strips in a turn; a linear part is added.
    """
    length, width, draught = size
    rigid = mass * (length**2 + width**2) / 12.0 * float(rng.uniform(0.7, 1.0))
    m_u = mass * (1.0 + shape["added_surge"] * float(rng.uniform(0.7, 1.3)))
    m_v = mass * (1.0 + shape["added_sway"] * float(rng.uniform(0.7, 1.3)))
    inertia = rigid * (1.0 + shape["added_yaw"] * float(rng.uniform(0.7, 1.3)))
    surge = 0.5 * RHO * shape["surge_drag"] * float(rng.uniform(0.7, 1.4)) * width * draught
    sway = 0.5 * RHO * shape["sway_drag"] * float(rng.uniform(0.7, 1.4)) * length * draught
    yaw = 0.5 * RHO * shape["sway_drag"] * float(rng.uniform(0.7, 1.4)) * draught * length**4 / 32.0
    slow = speed * shape["sway_share"]
    turn = 2.0 * slow / length
    hull = Hull(
        surge_inertia=m_u, sway_inertia=m_v,
        sway_yaw_inertia=float(rng.uniform(-1.0, 1.0)) * shape["coupling"] * math.sqrt(m_v * inertia),
        yaw_inertia=inertia,
        surge_linear=log_uniform(rng, 0.1, 1.0) * surge * speed, surge_quadratic=surge,
        sway_linear=log_uniform(rng, 0.1, 1.0) * sway * slow, sway_quadratic=sway,
        yaw_linear=log_uniform(rng, 0.2, 2.0) * yaw * turn, yaw_quadratic=yaw,
    )  # fmt: skip
    return hull, rigid


def _drag(linear: float, quadratic: float, speed: float) -> float:
    return (linear + quadratic * speed) * speed


def _bench(
    rng: np.random.Generator, actuators: tuple[Actuator, ...], rest: float, span: float
) -> tuple[Floats, Floats]:
    """Bench curves (n, m): commands and thrusts, the same law for all with each thruster's full thrusts."""
    power = float(rng.choice([1.0, 1.5, 2.0]))
    zone = float(rng.choice([0.0, rng.uniform(0.02, 0.08)]))
    shares = np.unique(np.round(np.concatenate([np.linspace(-1.0, 1.0, 61), [zone, -zone]]), 9))
    size = np.maximum(np.abs(shares) - zone, 0.0) / (1.0 - zone)
    law = np.sign(shares) * size**power
    thrusts = [np.where(law > 0.0, one.forward, one.backward or 1e-9) * law for one in actuators]
    return np.tile(rest + span * shares, (len(actuators), 1)), np.array(thrusts)


def _finished(
    rng: np.random.Generator, family: str, size: tuple[float, float, float], mass: float, hull: Hull, rigid: float,
    actuators: tuple[Actuator, ...], axes: tuple[bool, bool, bool], full: tuple[float, float, float],
    *, unit: str = "", rudder_rate: float = 0.0, azimuth_rate: float = 0.0,
) -> Vehicle:  # fmt: skip
    unit = unit or str(rng.choice(list(_UNITS)))
    rest, span, decimals = _UNITS[unit]
    xs, ys = _bench(rng, actuators, rest, span)
    channels, limits, places = [], [], []
    for one in actuators:
        channels.append(one.name)
        limits.append((35.0, rudder_rate) if one.kind == RUDDER else (rest + span, 0.0))
        places.append(2 if one.kind == RUDDER else decimals)
        if one.kind == AZIMUTH:
            channels.append(f"{one.name}_angle")
            limits.append((0.0, azimuth_rate))
            places.append(1)
    return Vehicle(
        family=family, length=size[0], width=size[1], mass=mass, rigid_inertia=rigid, hull=hull, actuators=actuators,
        channels=tuple(channels), unit=unit, rest=rest, span=span, commands=xs, thrusts=ys,
        allocation=_allocation(actuators, axes), limits=np.array(limits), decimals=np.array(places, dtype=np.int64),
        full=full, axes=axes,
    )  # fmt: skip


def _allocation(actuators: tuple[Actuator, ...], axes: tuple[bool, bool, bool]) -> Floats:
    """Shares of each actuator (n, 6) for full demands: the pseudo-inverse, each demand alone uses full thrust."""
    columns: list[tuple[int, int, tuple[float, float, float]]] = []
    table = np.zeros((len(actuators), 6))
    for i, one in enumerate(actuators):
        if one.kind == FIXED:
            columns.append((i, 0, (one.surge, one.sway, one.arm)))
        elif one.kind == AZIMUTH:
            columns += [(i, 0, (1.0, 0.0, -one.y)), (i, 3, (0.0, 1.0, one.x))]
        else:
            table[i, 2] = 1.0
    scale = np.array([1.0, 1.0, max(abs(column[2][2]) for column in columns) or 1.0])
    matrix = np.array([column[2] for column in columns]).T / scale[:, np.newaxis]
    used = [k for k in range(3) if axes[k] and np.abs(matrix[k]).max() > 1e-6]
    inverse = np.linalg.pinv(matrix[used])
    for k, axis in enumerate(used):
        shares = inverse[:, k] / np.abs(inverse[:, k]).max()
        for (i, offset, _), share in zip(columns, shares, strict=True):
            table[i, offset + axis] = share
    return table


def box_rov(rng: np.random.Generator) -> Vehicle:
    """ROV of four vectored thrusters; one or two more push ahead or aside."""
    length = log_uniform(rng, 0.4, 3.0)
    size = (length, length * float(rng.uniform(0.6, 0.9)), length * float(rng.uniform(0.4, 0.7)))
    mass = RHO * size[0] * size[1] * size[2] * float(rng.uniform(0.4, 0.9))
    shape = {"added_surge": 0.5, "added_sway": 0.8, "added_yaw": 0.6, "surge_drag": 0.9, "sway_drag": 1.1,
             "sway_share": 0.6, "coupling": 0.25}  # fmt: skip
    speed = float(rng.uniform(0.5, 1.2)) * math.sqrt(length)
    hull, rigid = _hull(rng, size, mass, shape, speed)
    push = _drag(hull.surge_linear, hull.surge_quadratic, speed)
    turn = math.radians(float(rng.uniform(40.0, 90.0))) / math.sqrt(length)
    twist = _drag(hull.yaw_linear, hull.yaw_quadratic, turn)
    angle = math.radians(float(rng.uniform(25.0, 50.0)))
    x, y = 0.4 * length, 0.4 * size[1]
    # Full thrust of the four keeps the full speed, or the full rate, whichever needs more.
    arm = x * math.sin(angle) + y * math.cos(angle)
    each = max(push / (4.0 * math.cos(angle)), 0.5 * twist / (4.0 * arm))
    weak = float(rng.uniform(0.6, 1.0))
    # The bow pair points inward, the stern pair outward: all four have the same arm.
    corners = (
        ("bow_port", x, -y, angle), ("bow_starboard", x, y, -angle),
        ("stern_port", -x, -y, -angle), ("stern_starboard", -x, y, angle),
    )  # fmt: skip
    actuators = [
        Actuator(name=name, kind=FIXED, x=px, y=py, direction=way, forward=each, backward=weak * each)
        for name, px, py, way in corners
    ]
    extra = int(rng.integers(0, 3))
    if extra >= 1:
        actuators.append(
            Actuator(name="lateral", kind=FIXED, x=float(rng.uniform(-0.1, 0.1)) * length, direction=0.5 * math.pi,
                     forward=each, backward=weak * each)
        )  # fmt: skip
    if extra == 2:
        actuators.append(Actuator(name="main", kind=FIXED, x=-x, forward=each, backward=weak * each))
    sway = float(rng.uniform(0.4, 0.7)) * speed
    return _finished(
        rng, "rov", size, mass, hull, rigid, tuple(actuators), (True, True, True), (speed, sway, turn)
    )  # fmt: skip


def twin_usv(rng: np.random.Generator) -> Vehicle:
    """Twin-hull surface vessel: two stern thrusters, no force aside."""
    length = log_uniform(rng, 1.0, 8.0)
    size = (length, length * float(rng.uniform(0.35, 0.6)), length * float(rng.uniform(0.05, 0.09)))
    mass = RHO * 2.0 * length * 0.12 * size[1] * 2.0 * size[2] * float(rng.uniform(0.5, 0.8))
    shape = {"added_surge": 0.1, "added_sway": 0.9, "added_yaw": 0.8, "surge_drag": 0.25, "sway_drag": 1.2,
             "sway_share": 0.3, "coupling": 0.25}  # fmt: skip
    speed = float(rng.uniform(0.8, 1.3)) * math.sqrt(length)
    hull, rigid = _hull(rng, size, mass, shape, speed)
    push = _drag(hull.surge_linear, hull.surge_quadratic, speed)
    weak = float(rng.uniform(0.5, 0.9))
    y = float(rng.uniform(0.35, 0.5)) * size[1]
    actuators = tuple(
        Actuator(name=name, kind=FIXED, x=-0.48 * length, y=py, forward=0.5 * push, backward=0.5 * weak * push)
        for name, py in (("port", -y), ("starboard", y))
    )
    # Full turn: one hull ahead, one astern.
    torque = y * 0.5 * push * (1.0 + weak)
    turn = _rate(hull, torque)
    return _finished(
        rng, "usv", size, mass, hull, rigid, actuators, (True, False, True), (speed, 0.2 * speed, turn)
    )  # fmt: skip


def _rate(hull: Hull, torque: float) -> float:
    """Rate in rad/s that a torque keeps up against the yaw damping alone."""
    a, b = hull.yaw_quadratic, hull.yaw_linear
    return (-b + math.sqrt(b * b + 4.0 * a * torque)) / (2.0 * a)


FAMILIES: Mapping[str, Callable[[np.random.Generator], Vehicle]] = {"rov": box_rov, "usv": twin_usv}
