"""A campaign: runs of one vehicle, each as streams of stamped readings, before they are written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tools.dirty.vehicle import UNITS, FloatArray, Vehicle, coloured, log_uniform, move

MILLI = 3  # decimals of a stamp in s
KINDS = ("steps", "hold", "coast", "sine", "random")


@dataclass(frozen=True, kw_only=True)
class Stream:
    """Readings in the order of their arrival: ``stamps`` (n,) and true ``instants`` (n,) in s, and columns (n,)."""

    stamps: FloatArray
    instants: FloatArray
    columns: dict[str, FloatArray]

    def kept(self, chosen: NDArray[np.bool_] | NDArray[np.intp]) -> Stream:
        """Stream of the ``chosen`` readings."""
        columns = {name: values[chosen] for name, values in self.columns.items()}
        return Stream(stamps=self.stamps[chosen], instants=self.instants[chosen], columns=columns)

    def changed(self, **columns: FloatArray) -> Stream:
        """Stream with other values of ``columns``."""
        return replace(self, columns={**self.columns, **columns})


@dataclass(kw_only=True)
class Log:
    """One run: ``motion`` and ``thrust`` are its streams; ``origin`` is the clock's reading at the run's start, in s.

    ``truth`` holds the run before any damage: time, heading (rad), rate, command_time, torque, disturbance.
    """

    name: str
    kind: str
    origin: float
    motion: Stream
    thrust: Stream
    truth: dict[str, FloatArray] = field(default_factory=dict)

    @property
    def start(self) -> float:
        """First instant with heading and commands, in s after ``origin``."""
        return max(float(self.motion.instants[0]), float(self.thrust.instants[0]))


@dataclass(frozen=True, kw_only=True)
class Damage:
    """What is wrong with the logs: the run names concerned, instants in s from the start of each, and the size."""

    logs: tuple[str, ...]
    at: tuple[float, ...] = ()
    size: float = 0.0
    unit: str = ""
    note: str = ""


@dataclass(kw_only=True)
class Campaign:
    """Vehicle, format, and logs; ``curves`` are the thrust curves as they will be written."""

    rng: np.random.Generator
    vehicle: Vehicle
    format: str
    rate_hz: float
    command_hz: float
    noise: float  # deg
    memory: float  # s, of the disturbance
    signed: bool  # heading of -180 to 180 deg; else 0 to 360
    with_rate: bool  # whether a yaw rate is logged
    logs: list[Log] = field(default_factory=list)
    curves: list[tuple[FloatArray, FloatArray]] = field(default_factory=list)
    heading_unit: str = "deg"
    absent_command: str = ""  # text of a command that is not a number, in CSV
    zeros_absent: bool = False  # whether JSON leaves out fields that are zero

    @property
    def one_table(self) -> bool:
        """Whether heading and commands stand in the same rows."""
        return self.format == "csv"

    def named(self, name: str) -> Log:
        """Log of the run ``name``."""
        return next(log for log in self.logs if log.name == name)

    def run(self, name: str, demand: FloatArray, kind: str, vehicle: Vehicle, extra: FloatArray | None = None) -> Log:
        """One run: ``demand`` (m,) of -1 to 1 at the instants of the commands; ``extra`` (m,) N m by other hands."""
        rng = self.rng
        count = len(demand)
        command_time = np.arange(count) / self.command_hz
        span = float(command_time[-1])
        every = np.arange(0.0, span, 1.0 / self.rate_hz)
        jitter = rng.choice([0.0, 0.03]) / self.rate_hz
        time = np.unique(
            np.round(every + jitter * rng.uniform(-1.0, 1.0, len(every)).clip(-every * self.rate_hz), MILLI)
        )
        command_time = time if self.one_table else np.round(command_time, MILLI)
        if self.one_table:
            demand = demand[np.searchsorted(np.arange(count) / self.command_hz, time + 1e-9, side="right") - 1]
        commands = self.allotted(demand)
        disturbance = coloured(rng, time, 0.01 * vehicle.full_torque, self.memory)
        if extra is not None:
            disturbance += np.interp(time, np.arange(count) / self.command_hz, extra)
        heading, rate = move(vehicle, time, command_time, commands, disturbance, rng.uniform(0.0, 2.0 * np.pi))
        columns = {"heading": self.measured(heading)}
        if self.with_rate:
            columns["rate"] = np.degrees(rate) + rng.normal(0.0, 0.005 * np.degrees(vehicle.full_rate), len(time))
        names = [thruster.name for thruster in vehicle.thrusters]
        truth = {"time": time, "heading": heading, "rate": rate, "command_time": command_time}
        truth |= {"torque": vehicle.torque(commands), "disturbance": disturbance}
        return Log(
            name=name,
            kind=kind,
            origin=0.0,
            motion=Stream(stamps=time, instants=time, columns=columns),
            thrust=Stream(
                stamps=command_time, instants=command_time, columns=dict(zip(names, commands.T, strict=True))
            ),
            truth=truth,
        )

    def measured(self, heading: FloatArray) -> FloatArray:
        """Heading (n,) in deg as a compass gives it, from the true heading in rad."""
        return self.wrapped(np.degrees(heading) + self.rng.normal(0.0, self.noise, len(heading)))

    def wrapped(self, heading: FloatArray) -> FloatArray:
        """Heading (n,) in deg, in the range of this logger."""
        return (heading + 180.0) % 360.0 - 180.0 if self.signed else heading % 360.0

    def allotted(self, demand: FloatArray) -> FloatArray:
        """Commands (m, thrusters) of a demand (m,) of -1 to 1 for torque, rounded as they are logged."""
        rest, span, decimals = UNITS[self.vehicle.unit]
        signs = np.array([np.sign(thruster.arm) for thruster in self.vehicle.thrusters])
        if len(signs) > 1 and self.rng.random() < 0.3:  # a part of the thrusters drives this run
            signs = signs * (self.rng.permutation(len(signs)) < len(signs) - len(signs) // 2)
        commands: FloatArray = np.round(rest + span * demand[:, np.newaxis] * signs, decimals)
        return commands


def draw_campaign(rng: np.random.Generator, form: str, vehicle: Vehicle) -> Campaign:
    """Draw rates, noise and runs for a vehicle."""
    tau = vehicle.time_constant
    rates = [hz for hz in (5.0, 10.0, 20.0, 25.0, 50.0) if 2.5 / tau <= hz <= max(10.0, 60.0 / tau)] or [50.0]
    rate_hz = float(rng.choice(rates))
    slower = [hz for hz in (rate_hz, rate_hz / 2.0, rate_hz / 4.0) if hz >= max(1.0, 1.2 / tau)] or [rate_hz]
    most = 0.02 * np.degrees(vehicle.full_rate) * tau  # noise that leaves the inertia visible
    campaign = Campaign(
        rng=rng,
        vehicle=vehicle,
        format=form,
        rate_hz=rate_hz,
        command_hz=rate_hz if form == "csv" else float(rng.choice(slower)),
        noise=min(log_uniform(rng, 0.01, 0.2), max(0.01, most)),
        memory=tau * log_uniform(rng, 0.5, 5.0),
        signed=bool(rng.random() < 0.4),
        with_rate=bool(rng.random() < 0.3),
        curves=[(thruster.command.copy(), thruster.thrust.copy()) for thruster in vehicle.thrusters],
    )
    count = int(rng.integers(3, 11))
    kinds = ["steps", "hold", "coast", *rng.choice(KINDS, count)][:count]
    for number, kind in enumerate(rng.permutation(kinds).tolist(), start=1):
        log = campaign.run(f"run_{number:02d}", demand_of(campaign, kind), kind, vehicle)
        campaign.logs.append(log)
    set_origins(campaign, campaign.logs)
    return campaign


def set_origins(campaign: Campaign, logs: Sequence[Log]) -> None:
    """Give each log the clock's reading at its start: seconds of the day, or since the computer's start."""
    epoch = campaign.format in {"json", "ros2", "db3"} or campaign.rng.random() < 0.5
    day = 1_767_600_000.0 if epoch else 0.0  # s since the epoch: 5 January 2026, 08:00 UTC
    for number, log in enumerate(logs):
        apart = 900.0 * number if epoch else 0.0
        boot = 35.0 if campaign.format in {"bin", "ulg"} else 0.0
        log.origin = day + apart + boot


def demand_of(campaign: Campaign, kind: str) -> FloatArray:
    """Demand (m,) of -1 to 1 of a run of ``kind``, at the instants of the commands."""
    rng, hz, tau = campaign.rng, campaign.command_hz, campaign.vehicle.time_constant
    span = float(np.clip(rng.uniform(16.0, 30.0) * tau, 15.0, 300.0))
    time = np.arange(0.0, span, 1.0 / hz)
    rest = max(1.0, 0.5 * tau)
    level = rng.uniform(0.55, 1.0) * rng.choice([-1.0, 1.0])
    if kind == "hold":
        demand = np.full(len(time), level)
    elif kind == "coast":
        quarter = np.floor(4.0 * (time - rest) / (span - rest))
        demand = np.select([quarter == 0, quarter == 2], [level, -level], 0.0)
    elif kind == "sine":
        period = max(rng.uniform(4.0, 12.0) * tau, 10.0 / hz)
        demand = level * np.sin(2.0 * np.pi * (time - rest) / period)
    else:
        dwell = (rng.uniform(2.0, 5.0) if kind == "steps" else rng.uniform(0.8, 2.0)) * tau
        count = int(np.ceil(span / max(dwell, 2.0 / hz))) + 1
        values = rng.uniform(-1.0, 1.0, count) if kind == "steps" else abs(level) * rng.choice([-1.0, 1.0], count)
        values[0] = level
        demand = values[np.minimum((time / span * (count - 1)).astype(int), count - 1)]
    return np.where(time < rest, 0.0, demand)
