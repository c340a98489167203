"""Runs of simulated vehicles with readings of one clock, and the detectors of the clock's faults."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.faults.base import ClockData, detectors_at, examine
from rovid.trial.fault import Fault, FaultOverrides

# Time constants of the vehicles in s, from a toy to a ship.
TIME_CONSTANTS = (0.3, 1.5, 8.0)
COMMANDS = ("steps", "sine", "telegraph", "feedback", "coast")


def command_of(kind: str, time: FloatArray, lag: float, rng: np.random.Generator) -> FloatArray:
    """(n,) command between -1 and 1 of a vehicle with the time constant ``lag`` in s; feedback is added elsewhere."""
    if kind == "sine":
        return np.sin(2.0 * np.pi * time / (rng.uniform(4.0, 8.0) * lag))
    if kind == "coast":
        return np.where(time < 0.3 * time[-1], 1.0, 0.0)
    hold = (12.0 if kind == "steps" else 3.0) * lag
    switches = np.cumsum(rng.uniform(0.5, 1.5, int(2.0 * time[-1] / hold) + 2) * hold)
    levels = rng.choice([-1.0, -0.6, 0.7, 1.0], len(switches) + 1)
    return levels[np.searchsorted(switches, time, side="right")]


def motion(
    seed: int,
    *,
    kind: str = "telegraph",
    lag: float = 1.5,
    interval: float = 0.1,
    count: int = 1200,
    noise: float = 0.05,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(time in s, heading in deg, command) of r' = (30/lag u - r)/lag in deg/s, stepped ten times a reading."""
    rng = np.random.default_rng(seed)
    time = interval * np.arange(float(count))
    command = command_of(kind, time, lag, rng)
    heading, rate, angle = np.zeros(count), 0.0, 0.0
    target = 60.0 * np.sign(np.sin(2.0 * np.pi * time / (30.0 * lag)))
    decay = np.exp(-interval / lag)
    for k in range(count):
        heading[k] = angle
        if kind == "feedback":
            command[k] = np.clip(0.02 * (target[k] - angle) - 0.02 * lag * rate, -1.0, 1.0)
        final = 30.0 / lag * command[k]
        angle += final * interval + (rate - final) * lag * (1.0 - decay)
        rate = final + (rate - final) * decay
    return time, (40.0 + heading + rng.normal(0.0, noise, count)) % 360.0, command


def clock(time: FloatArray, *, log: str = "run.csv", **values: FloatArray) -> ClockData:
    """The readings of a clock; ``fore`` is a command."""
    named = {"command.fore" if name == "fore" else name: column for name, column in values.items()}
    periods = {"heading": 360.0} if "heading" in named else {}
    return ClockData(log=log, clock="time", time=time, rows=np.arange(len(time)), values=named, periods=periods)


def examined(data: ClockData) -> tuple[ClockData, tuple[Fault, ...]]:
    """The repaired readings and all faults of the clock."""
    return examine(detectors_at("clock"), data, FaultOverrides())


def undamaged(seed: int, lag: float, kind: str, change: Callable[[FloatArray], FloatArray]) -> tuple[Fault, ...]:
    """Faults found on a clock whose regular stamps ``change`` turns into those of another undamaged clock."""
    time, heading, command = motion(seed, kind=kind, lag=lag)
    return examined(clock(change(time), heading=heading, fore=command))[1]
