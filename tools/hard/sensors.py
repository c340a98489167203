"""Compass, gyro and DVL with their faults, and the log that holds what they said."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tools.hard import layout as at
from tools.hard.layout import Floats
from tools.hard.motion import deviation
from tools.hard.sea import Sea, coloured
from tools.hard.vehicles import Vehicle


@dataclass(frozen=True)
class Instruments:
    """What is on board, and how good it is."""

    rate: float  # Hz of the log
    heading_noise: float  # rad
    heading_step: float  # deg, to which the heading is rounded
    gyro: bool
    gyro_noise: float  # rad/s
    gyro_bias: float
    speed: bool
    speed_noise: float  # m/s
    speed_dropouts: float  # share of readings
    lost: float  # share of rows
    gaps: bool
    jitter: float  # of the sampling interval

    def noise(self, ticks: int, tick: float, tau: float, rng: np.random.Generator) -> tuple[Floats, Floats, Floats]:
        """Of heading and rate, as the autopilot sees them too, and of the instants."""
        white = rng.normal(0.0, self.heading_noise, ticks)
        slow = 0.5 * self.heading_noise * coloured(5.0 * tau, tick, ticks, rng)
        rate = self.gyro_bias + rng.normal(0.0, self.gyro_noise, ticks)
        return white + slow, rate, np.abs(rng.normal(0.0, self.jitter * tick, ticks))


@dataclass(frozen=True)
class Log:
    """A run as logged: angles in rad, unwrapped and unrounded where the writer has yet to do it."""

    time: Floats
    heading: Floats
    yaw_rate: Floats | None
    surge: Floats | None
    sway: Floats | None
    commands: Floats


def draw_instruments(vehicle: Vehicle, rate: float, rng: np.random.Generator) -> Instruments:
    """From a good INS to a cheap compass."""
    noise = float(np.radians(np.exp(rng.uniform(np.log(0.01), np.log(0.4)))))
    steps = [0.01, 0.1] if noise < np.radians(0.1) else [0.01, 0.1, 0.1, 0.5]
    return Instruments(
        rate=rate, heading_noise=noise, heading_step=float(rng.choice(steps)), gyro=bool(rng.random() < 0.5),
        gyro_noise=float(rng.uniform(0.002, 0.03)) * vehicle.rate_in_use,
        gyro_bias=float(rng.normal(0.0, 0.002)) * vehicle.rate_in_use, speed=bool(rng.random() < 0.5),
        speed_noise=float(rng.uniform(0.005, 0.03)), speed_dropouts=float(rng.choice([0.0, 0.01, 0.08])),
        lost=float(rng.choice([0.0, 0.005, 0.02])), gaps=bool(rng.random() < 0.1),
        jitter=float(rng.choice([0.0, 0.02, 0.1])),
    )  # fmt: skip


def read(
    record: Floats, commands: Floats, step: float, every: int, cause: Floats, vehicle: Vehicle, sea: Sea,
    instruments: Instruments, noise: Floats, rate_noise: Floats, jitter: Floats, rng: np.random.Generator,
) -> Log:  # fmt: skip
    """Rows are written as each command goes out, or a moment later."""
    grid = step * np.arange(record.shape[0])
    time = grid[::every] + jitter
    time = np.minimum(np.maximum.accumulate(time), grid[-1])
    keep = rng.random(time.size) >= instruments.lost
    keep[1:] &= np.diff(time) > 0.1 * step
    keep[0] = True
    if instruments.gaps:
        begin = int(rng.integers(time.size // 4, time.size // 2))
        keep[begin : begin + int(float(rng.uniform(1.0, 4.0)) * vehicle.time_constant * instruments.rate)] = False

    def at_rows(values: Floats) -> Floats:
        return np.asarray(np.interp(time, grid, values))

    heading = at_rows(record[:, at.R_PSI])
    measured = heading + np.array([deviation(float(psi), cause) for psi in heading]) + noise
    surge = sway = None
    if instruments.speed:  # over the ground: the water's own way is in it
        away = sea.current_direction - heading
        slow = sea.current * (1.0 + 0.2 * np.sin(2 * np.pi * time / (60.0 * vehicle.time_constant)))
        faults = rng.normal(0.0, instruments.speed_noise, (2, time.size))
        faults[:, rng.random(time.size) < instruments.speed_dropouts] = np.nan
        surge = (at_rows(record[:, at.R_SURGE]) + slow * np.cos(away) + faults[0])[keep]
        sway = (at_rows(record[:, at.R_SWAY]) + slow * np.sin(away) + faults[1])[keep]
    rate = (at_rows(record[:, at.R_RATE]) + rate_noise)[keep] if instruments.gyro else None
    return Log(time[keep], measured[keep], rate, surge, sway, commands[keep])
