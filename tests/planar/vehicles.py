"""Vehicles in surge, sway and yaw, simulated by scipy for tests: the equations are written out once more."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

from rovid.core.array_types import FloatArray
from rovid.planar.dataset import PlanarData, planar_data
from rovid.trial.trial import Campaign, Readings, Trial
from rovid.trial.vehicle import Rudder, ThrustCurve, Thruster, Vehicle


@dataclass(frozen=True, kw_only=True)
class Truth:
    """True parameters: as `rovid.planar.model.BASE_NAMES`, current to north and east, and rudder lift."""

    base: tuple[float, ...]
    #: (k, 3) forces along surge and sway in N and torque in N m at a command of 1.
    levers: tuple[tuple[float, float, float], ...]
    current: tuple[float, float] = (0.0, 0.0)
    couplings: tuple[float, float] = (0.0, 0.0)  #: N_v and Y_r with opposite signs.
    rudder: tuple[float, float] | None = None  #: Position ahead in m, lift.
    stall: float = np.inf  #: rad, of the rudder.
    resistance: float = 1.0  #: Of the rudder, over that of a force normal to the blade.
    noise: dict[str, tuple[float, float]] = field(default_factory=dict)  #: Sensor -> noise, interval in s.
    disturbance: tuple[float, float, float] = (0.0, 0.0, 0.0)  #: N, N, N m.
    memory: float = 3.0  #: s.
    place: tuple[float, float] = (0.0, 0.0)  #: m; of the velocity log and the antenna.

    def vehicle(self) -> Vehicle:
        curve = ThrustCurve(command=np.array([-1.0, 1.0]), thrust=np.array([-1.0, 1.0]))
        thrusters = [
            Thruster(name=f"t{k}", arm=arm, surge_share=surge, sway_share=sway, curve=curve)
            for k, (surge, sway, arm) in enumerate(self.levers)
        ]
        if self.rudder is not None:
            rudder = Rudder(position=(self.rudder[0], 0.0))
            thrusters.append(Thruster(name="rudder", arm=0.0, curve=None, rudder=rudder))
        return Vehicle(name="test", thrusters=tuple(thrusters), planar=True)


def simulate(truth: Truth, commands: FloatArray, hold: float, start: FloatArray, seed: int) -> FloatArray:
    """(n, 6) heading, u, v through the water, r, north, east every 0.05 s; commands of ``hold`` s each."""
    m_u, m_v, inertia, m_vr, *drags = truth.base
    linear, quadratic = np.array(drags[:3]), np.array(drags[3:])
    mass = np.array([[m_u, 0.0, 0.0], [0.0, m_v, m_vr], [0.0, m_vr, inertia]])
    inverse, levers = np.linalg.inv(mass), np.array(truth.levers)
    rng, step = np.random.default_rng(seed), 0.05
    per = round(hold / step)
    decay = np.exp(-step / truth.memory)
    pushes = np.zeros((per * len(commands), 3))
    state = np.array(truth.disturbance) * rng.normal(size=3)
    for k in range(len(pushes)):
        pushes[k] = state
        state = decay * state + np.sqrt(1.0 - decay**2) * np.array(truth.disturbance) * rng.normal(size=3)

    def slope(_: float, x: FloatArray, command: FloatArray, push: FloatArray) -> FloatArray:
        psi, u, v, r = x[:4]
        nu = x[1:4]
        # Coriolis matrix by rows, from the momenta.
        p, q = m_u * u, m_v * v + m_vr * r
        coriolis = np.array([-q * r, p * r, q * u - p * v])
        total = levers.T @ command[: len(levers)] + push - coriolis - linear * nu - quadratic * np.abs(nu) * nu
        total -= np.array([0.0, truth.couplings[1] * r, truth.couplings[0] * v])
        if truth.rudder is not None:
            at, lift = truth.rudder
            delta, across = command[-1], v + at * r
            attack = np.clip(delta + np.arctan2(across, abs(u)), -truth.stall, truth.stall)
            side = lift * (u * u + across**2) * np.sin(attack)
            total -= np.array(
                [truth.resistance * side * np.sin(delta), side * np.cos(delta), at * side * np.cos(delta)]
            )
        cosine, sine = np.cos(psi), np.sin(psi)
        ground = u * cosine - v * sine + truth.current[0], u * sine + v * cosine + truth.current[1]
        return np.concatenate(([r], inverse @ total, ground))

    states = np.zeros((len(pushes) + 1, 6))
    states[0] = start
    many = any(truth.disturbance)
    for k, command in enumerate(commands):
        rows = slice(k * per, (k + 1) * per + 1)
        if many:
            for at in range(rows.start, rows.stop - 1):
                # Two Runge-Kutta steps while the push is held.
                x, h = states[at], step / 2.0
                for _ in range(2):
                    k1 = slope(0.0, x, command, pushes[at])
                    k2 = slope(0.0, x + h / 2.0 * k1, command, pushes[at])
                    k3 = slope(0.0, x + h / 2.0 * k2, command, pushes[at])
                    k4 = slope(0.0, x + h * k3, command, pushes[at])
                    x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
                states[at + 1] = x
            continue
        instants = np.arange(per + 1) * step
        solved = solve_ivp(
            slope, (0.0, hold), states[k * per], t_eval=instants, args=(command, np.zeros(3)), rtol=1e-8, atol=1e-10
        )
        states[rows] = solved.y.T
    return states


def campaign(truth: Truth, *, runs: int, levels: int, hold: float, seed: int) -> PlanarData:
    """Runs of random commands with the readings of the sensors."""
    rng = np.random.default_rng(seed)
    trials = []
    for number in range(runs):
        commands = rng.uniform(-1.0, 1.0, (levels, len(truth.levers)))
        if truth.rudder is not None:
            commands[:, 0] = rng.uniform(0.3, 1.0, levels)
            commands = np.column_stack((commands, rng.uniform(-0.5, 0.5, levels)))
        start = np.array([rng.uniform(-3.0, 3.0), 0.0, 0.0, 0.0, 0.0, 0.0])
        states = simulate(truth, commands, hold, start, seed * 100 + number)
        time = 0.05 * np.arange(len(states), dtype=np.float64)
        psi = states[:, 0]
        north, east = truth.current
        values = {
            "heading": psi,
            "yaw_rate": states[:, 3],
            "surge_velocity": states[:, 1] + north * np.cos(psi) + east * np.sin(psi) - truth.place[1] * states[:, 3],
            "sway_velocity": states[:, 2] - north * np.sin(psi) + east * np.cos(psi) + truth.place[0] * states[:, 3],
            "north": states[:, 4] + truth.place[0] * np.cos(psi) - truth.place[1] * np.sin(psi),
            "east": states[:, 5] + truth.place[0] * np.sin(psi) + truth.place[1] * np.cos(psi),
        }
        readings = {}
        position = np.full(len(time), np.nan)
        for name, (noise, interval) in truth.noise.items():
            every = round(interval / 0.05)
            read = values[name][::every] + noise * rng.normal(size=len(time[::every]))
            if name == "heading":
                position[::every] = read
            else:
                readings[name] = Readings(time=time[::every], values=read)
        held = np.repeat(commands, round(hold / 0.05), axis=0)
        name = f"run_{number}"
        trials.append(
            Trial(
                name=name,
                path=Path(name),
                time=time,
                position=position,
                commands=np.vstack((held, held[-1:])),
                readings=readings,
            )
        )
    vehicle = truth.vehicle()
    return planar_data(Campaign(trials=tuple(trials), sources=()), vehicle)


def box_rov(seed: int, **changes: object) -> Truth:
    """Box ROV with four vectored thrusters, in heading and DVL."""
    rng = np.random.default_rng(seed)
    size = rng.uniform(0.7, 1.4)
    mass = 12.0 * size**3
    base = (
        1.5 * mass,
        2.2 * mass,
        0.3 * mass * size**2,
        0.05 * mass * size,
        *(np.array([6.0, 9.0, 0.6, 20.0, 35.0, 1.5]) * size**2 * rng.uniform(0.7, 1.4, 6)).tolist(),
    )
    push = 12.0 * size**2
    levers = tuple(
        (push * 0.7 * a, push * 0.7 * b, push * 0.25 * size * c)
        for a, b, c in ((1, -1, -1), (1, 1, 1), (1, 1, -1), (1, -1, 1))
    )
    noise = {"heading": (0.005, 0.05), "surge_velocity": (0.01, 0.2), "sway_velocity": (0.01, 0.2)}
    given: dict[str, object] = {
        "base": base,
        "levers": levers,
        "noise": noise,
        "disturbance": (0.02 * push, 0.02 * push, 0.004 * push),
    }
    return Truth(**(given | changes))  # type: ignore[arg-type]


def usv(seed: int, **changes: object) -> Truth:
    """Twin-screw vessel without side thrust, with GPS and compass."""
    rng = np.random.default_rng(seed)
    mass, length = 180.0, 4.0
    base = (
        1.1 * mass,
        1.6 * mass,
        0.09 * mass * length**2,
        0.05 * mass * length,
        *(np.array([30.0, 90.0, 120.0, 40.0, 220.0, 300.0]) * rng.uniform(0.7, 1.4, 6)).tolist(),
    )
    levers = ((90.0, 0.0, 70.0), (90.0, 0.0, -70.0))
    noise = {"heading": (0.01, 0.1), "north": (0.05, 0.2), "east": (0.05, 0.2)}
    given: dict[str, object] = {"base": base, "levers": levers, "noise": noise, "disturbance": (2.0, 0.8, 2.0)}
    return Truth(**(given | changes))  # type: ignore[arg-type]


def torpedo(seed: int, **changes: object) -> Truth:
    """Torpedo with a propeller and a free rudder, with heading and DVL."""
    rng = np.random.default_rng(seed)
    base = (35.0, 62.0, 9.0, 3.0, *(np.array([2.0, 20.0, 8.0, 5.0, 90.0, 20.0]) * rng.uniform(0.7, 1.4, 6)).tolist())
    noise = {"heading": (0.003, 0.05), "surge_velocity": (0.01, 0.2), "sway_velocity": (0.01, 0.2)}
    given: dict[str, object] = {
        "base": base,
        "levers": ((14.0, 0.0, 0.0),),
        "noise": noise,
        "rudder": (-0.9, 25.0),
        "disturbance": (0.2, 0.2, 0.1),
    }
    return Truth(**(given | changes))  # type: ignore[arg-type]
