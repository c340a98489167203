"""Families of vehicles, drawn over sizes: box ROV, torpedo AUV, twin-hull USV, azimuth vessel, ship models."""

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
    # Full turn with one hull ahead and the other astern.
    torque = y * 0.5 * push * (1.0 + weak)
    turn = _rate(hull, torque)
    return _finished(
        rng, "usv", size, mass, hull, rigid, actuators, (True, False, True), (speed, 0.2 * speed, turn)
    )  # fmt: skip


def _rate(hull: Hull, torque: float) -> float:
    """Rate in rad/s that a torque keeps up against the yaw damping alone."""
    a, b = hull.yaw_quadratic, hull.yaw_linear
    return (-b + math.sqrt(b * b + 4.0 * a * torque)) / (2.0 * a)


def lateral_auv(rng: np.random.Generator) -> Vehicle:
    """Torpedo with a stern propeller and two tunnel thrusters, without fins."""
    size, mass, speed = _torpedo(rng)
    hull, rigid = _hull(rng, size, mass, _TORPEDO, speed)
    push = _drag(hull.surge_linear, hull.surge_quadratic, speed)
    sway = 0.15 * speed
    aside = 0.5 * _drag(hull.sway_linear, hull.sway_quadratic, sway)
    x = float(rng.uniform(0.25, 0.4)) * size[0]
    weak = float(rng.uniform(0.6, 0.9))
    actuators = (
        Actuator(name="propeller", kind=FIXED, x=-0.5 * size[0], forward=push, backward=weak * push),
        Actuator(name="bow_tunnel", kind=FIXED, x=x, direction=0.5 * math.pi, forward=aside, backward=aside),
        Actuator(name="stern_tunnel", kind=FIXED, x=-x, direction=0.5 * math.pi, forward=aside, backward=aside),
    )
    full = (speed, sway, _rate(hull, 2.0 * x * aside))
    return _finished(rng, "auv_lateral", size, mass, hull, rigid, actuators, (True, True, True), full)


_TORPEDO = {"added_surge": 0.06, "added_sway": 0.95, "added_yaw": 0.8, "surge_drag": 0.3, "sway_drag": 1.0,
            "sway_share": 0.2, "coupling": 0.1}  # fmt: skip


def _torpedo(rng: np.random.Generator) -> tuple[tuple[float, float, float], float, float]:
    """Length, diameter twice (m), mass (kg) and full speed (m/s) of a neutrally buoyant torpedo."""
    length = log_uniform(rng, 1.0, 5.0)
    diameter = length / float(rng.uniform(6.0, 10.0))
    return (length, diameter, diameter), RHO * math.pi / 4.0 * diameter**2 * length * 0.85, float(rng.uniform(0.8, 2.0))


def rudder_auv(rng: np.random.Generator) -> Vehicle:
    """Torpedo with fixed fins and a rudder behind its propeller; the base model lacks the lift of the fins."""
    size, mass, speed = _torpedo(rng)
    hull, rigid = _hull(rng, size, mass, _TORPEDO, speed)
    push = _drag(hull.surge_linear, hull.surge_quadratic, speed)
    length, diameter, _ = size
    area = float(rng.uniform(0.04, 0.08)) * length * diameter
    x, fin = -0.47 * length, 0.5 * RHO * float(rng.uniform(0.08, 0.14)) * length * diameter * 3.0
    # Fins far aft: a force against the flow aside there (Fossen 2011, section 7.3: lift).
    hull = hull._replace(Y_uv=fin, Y_ur=-fin * x, N_uv=-fin * x, N_ur=fin * x * x)
    disk = math.pi / 4.0 * (0.8 * diameter) ** 2
    actuators = (
        Actuator(name="propeller", kind=FIXED, x=-0.45 * length, forward=push, backward=0.7 * push),
        Actuator(name="rudder", kind=RUDDER, x=x, behind="propeller", area=area, slipstream=2.0 / (RHO * disk)),
    )
    # At 25 deg, against the lift of the fins in the turn.
    torque = 0.5 * RHO * area * 2.6 * math.sin(math.radians(25.0)) * 1.5 * speed**2 * -x
    turn = torque / (hull.yaw_linear + hull.N_ur * speed)
    hull_turn = min(turn, 1.2 * speed / length)
    return _finished(
        rng, "auv_rudder", size, mass, hull, rigid, actuators, (True, False, True),
        (speed, 0.15 * speed, hull_turn), rudder_rate=float(rng.uniform(20.0, 60.0)),
    )  # fmt: skip


def azimuth_vessel(rng: np.random.Generator) -> Vehicle:
    """Workboat with two azimuth thrusters astern, or with one and a tunnel thruster in the bow."""
    length = log_uniform(rng, 1.5, 12.0)
    size = (length, length * float(rng.uniform(0.25, 0.4)), length * float(rng.uniform(0.08, 0.14)))
    mass = RHO * size[0] * size[1] * size[2] * float(rng.uniform(0.55, 0.8))
    shape = {"added_surge": 0.1, "added_sway": 0.8, "added_yaw": 0.7, "surge_drag": 0.3, "sway_drag": 0.9,
             "sway_share": 0.3, "coupling": 0.25}  # fmt: skip
    speed = float(rng.uniform(0.7, 1.1)) * math.sqrt(length)
    hull, rigid = _hull(rng, size, mass, shape, speed)
    push = _drag(hull.surge_linear, hull.surge_quadratic, speed)
    sway = 0.15 * speed
    x = -0.42 * length
    weak = float(rng.uniform(0.5, 0.8))
    if rng.random() < 0.5:
        y = 0.25 * size[1]
        actuators = tuple(
            Actuator(name=name, kind=AZIMUTH, x=x, y=py, forward=0.5 * push, backward=0.5 * weak * push)
            for name, py in (("port", -y), ("starboard", y))
        )
    else:
        aside = 0.5 * push
        actuators = (
            Actuator(name="pod", kind=AZIMUTH, x=x, forward=push, backward=weak * push),
            Actuator(name="tunnel", kind=FIXED, x=0.38 * length, direction=0.5 * math.pi, forward=aside,
                     backward=aside),
        )  # fmt: skip
    turn = min(_rate(hull, 0.35 * length * push), 0.8 * speed / length)
    tau = hull.yaw_inertia / (hull.yaw_linear + 2.0 * hull.yaw_quadratic * turn)
    return _finished(
        rng, "azimuth", size, mass, hull, rigid, actuators, (True, True, True), (speed, sway, turn),
        azimuth_rate=180.0 / tau,
    )  # fmt: skip


def tanker(rng: np.random.Generator) -> Vehicle:
    """Free-running model, or the ship itself, like KVLCC2: derivatives of Yasukawa and Yoshimura (2015), varied."""
    length = log_uniform(rng, 2.0, 8.0) if rng.random() < 0.8 else 320.0
    return _ship_of("tanker", *kvlcc2(length, rng), 1.179 * math.sqrt(length / 7.0), 0.181 * length)


def merchant(rng: np.random.Generator) -> Vehicle:
    """Free-running model of a finer ship, from a container ship like S175 or KCS to a bulk carrier."""
    length = log_uniform(rng, 2.0, 8.0)
    block, slender, beam_to_draught = float(rng.uniform(0.55, 0.78)), float(rng.uniform(6.0, 7.3)), 2.85
    speed = float(rng.uniform(0.15, 0.24)) * math.sqrt(9.81 * length)
    beam = length / slender
    ship, revolutions = hull_of_dimensions(rng, length, beam, beam / beam_to_draught, block, speed)
    return _ship_of("merchant", ship, revolutions, speed, beam)


def _ship_of(family: str, ship: Ship, revolutions: float, speed: float, width: float) -> Vehicle:
    """An MMG ship as a vehicle, with its ``revolutions`` (1/s) at full ``speed`` in m/s."""
    length = ship.length
    area = 0.5 * RHO * length * ship.draught
    total_n = ship.i_z + ship.x_g**2 * ship.mass + ship.j_z
    # Of the linear derivatives: what sets time constants and the size of the disturbance.
    hull = Hull(
        ship.mass + ship.m_x, ship.mass + ship.m_y, ship.x_g * ship.mass, total_n, 0.0, area * ship.R0,
        -area * speed * ship.Y_v, 0.0, -area * length**2 * speed * ship.N_r, 0.0,
    )  # fmt: skip
    thrust = area * ship.R0 * speed**2
    actuators = (
        Actuator(name="propeller", kind=FIXED, x=ship.x_p * length, forward=thrust, backward=thrust),
        Actuator(name="rudder", kind=RUDDER, x=ship.x_r * length, behind="propeller", area=ship.rudder_area,
                 slipstream=8.0 / (RHO * math.pi * ship.propeller**2)),
    )  # fmt: skip
    shares = np.linspace(-1.0, 1.0, 41) * 1.3
    return Vehicle(
        family=family, length=length, width=width, mass=ship.mass, rigid_inertia=ship.i_z, hull=hull,
        ship=ship, actuators=actuators, channels=("propeller", "rudder"), unit="rpm", rest=0.0,
        span=60.0 * revolutions, commands=np.tile(60.0 * revolutions * shares, (2, 1)),
        thrusts=np.tile(thrust * shares * np.abs(shares), (2, 1)),
        allocation=np.array([[1.0 / 1.69, 0, 0, 0, 0, 0], [0, 0, 1.0, 0, 0, 0]]),
        limits=np.array([[0.0, 0.0], [35.0, 2.34 * math.sqrt(320.0 / length)]]),
        decimals=np.array([2, 2], dtype=np.int64), full=(speed, 0.25 * speed, 0.35 * speed / length),
        axes=(True, False, True),
    )  # fmt: skip


def kvlcc2(length: float, rng: np.random.Generator | None = None) -> tuple[Ship, float]:
    """KVLCC2 of a length between perpendiculars in m, and the revolutions (1/s) at 15.5 kn of the ship.

    The L-7 model of Yasukawa and Yoshimura (2015), tables 1 to 5; with ``rng`` each derivative within 10 %.
    """

    def near(value: float) -> float:
        return value * (float(rng.uniform(0.9, 1.1)) if rng else 1.0)

    scale = length / 7.0
    draught, mass = 0.46 * scale, RHO * 3.27 * scale**3
    force = 0.5 * RHO * length**2 * draught
    ship = Ship(
        length=length, draught=draught, mass=mass, x_g=0.25 * scale, m_x=near(0.022) * force, m_y=near(0.223) * force,
        j_z=near(0.011) * force * length**2, i_z=mass * (0.25 * length) ** 2, R0=near(0.022), X_vv=near(-0.040),
        X_vr=near(0.002), X_rr=near(0.011), X_vvvv=near(0.771), Y_v=near(-0.315), Y_r=near(0.083), Y_vvv=near(-1.607),
        Y_vvr=near(0.379), Y_vrr=near(-0.391), Y_rrr=near(0.008), N_v=near(-0.137), N_r=near(-0.049),
        N_vvv=near(-0.030), N_vvr=near(-0.294), N_vrr=near(0.055), N_rrr=near(-0.013), propeller=0.216 * scale,
        t_p=0.220, w_p0=0.40, x_p=-0.48, k0=0.2931, k1=-0.2753, k2=-0.1385, c1=2.0, c2_plus=1.6, c2_minus=1.1,
        rudder_area=near(0.0539) * scale**2, rudder_slope=near(2.747), t_r=0.387, a_h=near(0.312), x_h=-0.464,
        x_r=-0.5, gamma_minus=0.395, gamma_plus=0.640, l_r=-0.710, epsilon=1.09, kappa=0.50, eta=0.626,
    )  # fmt: skip
    return ship, _revolutions(ship, 1.179 * math.sqrt(scale))


def hull_of_dimensions(
    rng: np.random.Generator, length: float, beam: float, draught: float, block: float, speed: float
) -> tuple[Ship, float]:
    """A ship of these dimensions in m and this block coefficient, and its revolutions (1/s) at ``speed`` in m/s.

    Hull derivatives by the regressions of Yoshimura and Masumoto (2012), each within 10 %; rudder, wake and propeller
    as usual for such ships.
    """

    def near(value: float) -> float:
        return value * float(rng.uniform(0.9, 1.1))

    full, aspect = block * beam / length, 2.0 * draught / length
    mass, force = RHO * block * length * beam * draught, 0.5 * RHO * length**2 * draught
    own, side = 2.0 * block * beam / length, near(0.5 * math.pi * aspect + 0.35 * full)
    ship = Ship(
        length=length, draught=draught, mass=mass, x_g=-0.012 * length, m_x=near(0.05 * own) * force, m_y=side * force,
        j_z=near(0.009) * force * length**2, i_z=mass * (0.25 * length) ** 2, R0=near(0.017),
        X_vv=near(1.15 * full - 0.18), X_vr=near(-0.5 * side), X_rr=near(-0.085 * full + 0.008),
        X_vvvv=near(1.10 - 6.68 * full), Y_v=near(-0.5 * math.pi * aspect - 1.4 * full), Y_r=near(0.5 * full),
        Y_vvv=near(-0.185 * length / beam - 0.48), Y_vvr=near(-0.75),
        Y_vrr=near(-0.26 * (1.0 - block) * length / beam - 0.11), Y_rrr=near(-0.051), N_v=near(-aspect),
        N_r=near(-0.54 * aspect + aspect**2), N_vvv=near(0.69 * block - 0.66), N_vvr=near(1.55 * full - 0.76),
        N_vrr=near(-0.075 * (1.0 - block) * length / beam + 0.098), N_rrr=near(0.25 * full - 0.056),
        propeller=near(0.70) * draught, t_p=near(0.18), w_p0=near(0.30), x_p=-0.48, k0=0.50, k1=-0.42, k2=-0.10,
        c1=2.0, c2_plus=1.3, c2_minus=1.1, rudder_area=near(0.020) * length * draught, rudder_slope=near(2.6),
        t_r=near(0.30), a_h=near(3.6 * full), x_h=-0.40, x_r=-0.5, gamma_minus=near(2.06 * full + 0.14),
        gamma_plus=near(2.06 * full + 0.24), l_r=-0.90, epsilon=near(1.05), kappa=near(0.55), eta=0.85,
    )  # fmt: skip
    return ship, _revolutions(ship, speed)


def _revolutions(ship: Ship, speed: float) -> float:
    """Revolutions (1/s) at which the propeller overcomes the resistance on a straight course at ``speed`` in m/s."""
    need = 0.5 * RHO * ship.length * ship.draught * ship.R0 * speed**2 / (1.0 - ship.t_p)
    low, high = 0.01 * speed / ship.propeller, 50.0 * speed / ship.propeller
    for _ in range(80):
        middle = 0.5 * (low + high)
        advance = speed * (1.0 - ship.w_p0) / (middle * ship.propeller)
        k_t = ship.k0 + ship.k1 * advance + ship.k2 * advance**2
        if RHO * middle**2 * ship.propeller**4 * k_t < need:
            low = middle
        else:
            high = middle
    return high


FAMILIES: Mapping[str, Callable[[np.random.Generator], Vehicle]] = {
    "rov": box_rov,
    "usv": twin_usv,
    "auv_lateral": lateral_auv,
    "auv_rudder": rudder_auv,
    "azimuth": azimuth_vessel,
    "tanker": tanker,
    "merchant": merchant,
}
