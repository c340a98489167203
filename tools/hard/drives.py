"""How a run is driven: a programme, an autopilot with steps of the heading, a zigzag, or a person at the stick."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tools.hard import layout as at
from tools.hard.layout import Floats, Ints
from tools.hard.thrust import bench
from tools.hard.vehicles import Vehicle

MODES = {"open": at.OPEN_LOOP, "autopilot": at.AUTOPILOT, "zigzag": at.ZIGZAG, "stick": at.STICK}


@dataclass(frozen=True)
class Drive:
    """What drives one run, by ticks of the control."""

    mode: int
    kind: str
    pilot: Floats
    wanted: Floats  # demand from -1 to 1 of a programme, else heading, rad
    surge: Floats
    decide: Ints


def torque_of(vehicle: Vehicle, demand: float, surge: float) -> float:
    """Bench torque of a demand in yaw beside one ahead, N m."""
    total = 0.0
    for one in vehicle.thrusters:
        command = min(max(one.yaw * demand + one.surge * surge, -1.0), 1.0)
        total += one.arm * bench(command, one.row(0.0))
    return total


def sense(vehicle: Vehicle) -> float:
    """+1 where a positive demand turns the heading up."""
    return 1.0 if torque_of(vehicle, 0.9, 0.0) > 0.0 else -1.0


def demand_of(vehicle: Vehicle, torque: float, surge: float) -> float:
    """Demand that makes a torque, by bisection."""
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        if abs(torque_of(vehicle, middle, surge)) < torque:
            low = middle
        else:
            high = middle
    return high


def _programme(vehicle: Vehicle, kind: str, ticks: int, tick: float, surge: float, one_way: bool,
               rng: np.random.Generator) -> Floats:  # fmt: skip
    """Demand of an open-loop run."""
    tau = vehicle.time_constant
    wanted = np.zeros(ticks)
    time = tick * np.arange(ticks)

    def level() -> float:
        torque = float(rng.uniform(0.4, 2.0)) * vehicle.torque_in_use
        return demand_of(vehicle, torque, surge) * (1.0 if one_way else float(rng.choice([-1.0, 1.0])))

    if kind == "sines":
        begin = 0
        while begin < ticks:
            period = float(rng.uniform(3.0, 14.0)) * tau
            end = begin + int(rng.integers(4, 8) * period / tick)
            part = np.sin(2 * np.pi * (time[begin:end] - time[begin]) / period) * abs(level())
            wanted[begin:end] = np.abs(part) if one_way else part
            begin = end
        return wanted
    begin = 0
    least, most = {"holds": (6.0, 16.0), "prbs": (0.7, 3.0), "steps": (1.5, 9.0)}[kind]
    size = abs(level())
    while begin < ticks:
        end = begin + max(1, int(float(rng.uniform(least, most)) * tau / tick))
        if kind == "prbs":
            value = size * float(rng.choice([0.35, 0.7, 1.0])) * (1.0 if one_way else float(rng.choice([-1.0, 1.0])))
        else:
            value = 0.0 if rng.random() < 0.15 else level()
        wanted[begin:end] = value
        begin = end
    return wanted


def _headings(ticks: int, tick: float, tau: float, start: float, rng: np.random.Generator) -> Floats:
    """Set points that step now and then."""
    wanted = np.zeros(ticks)
    begin, heading = 0, start
    while begin < ticks:
        end = begin + max(1, int(float(rng.uniform(8.0, 22.0)) * tau / tick))
        wanted[begin:end] = heading
        heading += float(rng.choice([-1.0, 1.0])) * float(np.radians(rng.uniform(25.0, 130.0)))
        begin = end
    return wanted


def draw_drive(vehicle: Vehicle, mode: str, ticks: int, tick: float, start: float, cruise: float, one_way: bool,
               wide: bool, rng: np.random.Generator) -> Drive:  # fmt: skip
    """How one run is driven."""
    tau = vehicle.time_constant
    in_use = demand_of(vehicle, vehicle.torque_in_use, cruise)
    sign = sense(vehicle)
    pilot = np.zeros(at.N_PILOT)
    decide = np.zeros(ticks, dtype=np.int64)
    surge = np.full(ticks, cruise)
    changes = wide or rng.random() < 0.6
    least, most = (0.1, 1.6) if wide else (0.4, 1.4)
    begin = 0
    while begin < ticks and cruise:
        end = begin + max(1, int(float(rng.uniform(10.0, 30.0)) * tau / tick))
        surge[begin:end] = cruise * (float(rng.uniform(least, most)) if changes else 1.0)
        begin = end
    kind = mode
    if mode == "open":
        kind = str(rng.choice(["holds", "sines", "prbs", "steps"]))
        wanted = sign * _programme(vehicle, kind, ticks, tick, cruise, one_way, rng)
        return Drive(MODES[mode], kind, pilot, wanted, surge, decide)
    per_demand = sign * vehicle.torque_in_use / in_use
    if mode == "zigzag":
        pilot[at.ZIGZAG_ANGLE] = np.radians(rng.uniform(10.0, 35.0))
        pilot[at.DEMAND_LIMIT] = sign * in_use * rng.uniform(0.7, 1.2)
        return Drive(MODES[mode], kind, pilot, np.full(ticks, start), surge, decide)
    wanted = _headings(ticks, tick, tau, start, rng)
    if mode == "autopilot":
        bandwidth = float(rng.uniform(0.4, 0.9)) / tau
        inertia = vehicle.total_inertia
        pilot[at.GAIN_P] = inertia * bandwidth**2 / per_demand
        pilot[at.GAIN_D] = 0.5 * inertia * bandwidth / per_demand
        pilot[at.GAIN_I] = 0.05 * pilot[at.GAIN_P] * bandwidth * tick
        pilot[at.DEMAND_LIMIT] = in_use * rng.uniform(0.9, 1.5)
        return Drive(MODES[mode], kind, pilot, wanted, surge, decide)
    pilot[at.GAIN_P] = sign * rng.uniform(1.2, 2.5)
    pilot[at.GAIN_D] = sign * rng.uniform(0.4, 0.9) / vehicle.rate_in_use
    pilot[at.STICK_DELAY] = max(1, int(float(rng.uniform(0.15, 0.5)) * tau / tick))
    pilot[at.STICK_LEVELS] = float(rng.integers(2, 6))
    pilot[at.DEMAND_LIMIT] = in_use * rng.uniform(0.9, 1.5)
    here = 0
    while here < ticks:
        decide[here] = 1
        here += max(1, int(float(0.4 + rng.exponential(1.0)) * tau / tick))
    return Drive(MODES[mode], kind, pilot, wanted, surge, decide)
