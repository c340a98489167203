"""Sensors of a campaign: rate, noise, latency, gaps and outliers of each, and what they log of a motion."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tools.planar.motion import Floats
from tools.planar.vehicles import Vehicle, log_uniform

RATES = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)  # Hz
SETS = (
    ("compass", "dvl"),
    ("compass", "gps"),
    ("compass", "gyro", "dvl"),
    ("compass", "gyro", "gps"),
    ("compass", "dvl", "gps"),
    ("compass", "mocap"),
    ("compass", "usbl", "dvl"),
    ("compass", "usbl"),
    ("compass",),
    ("compass", "gyro"),
    ("compass", "log"),
)
_ODDS = (0.25, 0.17, 0.12, 0.08, 0.1, 0.07, 0.06, 0.03, 0.05, 0.03, 0.04)
SIGNALS = {
    "compass": ("heading",),
    "gyro": ("yaw_rate",),
    "dvl": ("surge_velocity", "sway_velocity"),
    "log": ("surge_velocity",),  # speed over ground ahead alone
    "gps": ("north", "east"),
    "usbl": ("north", "east"),
    "mocap": ("north", "east"),
}


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """One instrument. ``noise`` in rad, rad/s, m/s or m; ``latency`` in s: a stamp is that much too late."""

    kind: str
    rate: float
    phase: float
    noise: float
    decimals: int
    latency: float = 0.0
    gaps: float = 0.0  # share of the time without readings
    gap_length: float = 0.0  # s
    outliers: float = 0.0  # share of the readings

    @property
    def signals(self) -> tuple[str, ...]:
        """Names of the signals."""
        return SIGNALS[self.kind]

    def stamps(self, length: float, rng: np.random.Generator) -> Floats:
        """Stamps in s from the log's start, without those in gaps."""
        time = np.round(self.phase + np.arange(int((length - self.phase) * self.rate) + 1) / self.rate, 5)
        keep = np.ones(time.size, dtype=bool)
        for _ in range(int(rng.poisson(self.gaps * length / self.gap_length)) if self.gaps else 0):
            begin = float(rng.uniform(0.0, length))
            keep &= ~((time >= begin) & (time < begin + self.gap_length * float(rng.uniform(0.5, 1.5))))
        return time[keep]


def draw_sensors(rng: np.random.Generator, vehicle: Vehicle, wanted: tuple[str, ...] | None) -> tuple[Sensor, ...]:
    """The instruments of a campaign: a set, the rates suit the time constants."""
    kinds = wanted or SETS[int(rng.choice(len(SETS), p=np.array(_ODDS) / sum(_ODDS)))]
    taus = vehicle.time_constants
    short, long = min(taus[0], taus[2]), max(taus[0], taus[2])
    speed, rate = vehicle.full[0], vehicle.full[2]

    def at_least(per_constant: float, *, more: int) -> float:
        fit = [one for one in RATES if one * short >= per_constant] or [RATES[-1]]
        return float(fit[min(int(rng.integers(0, more + 1)), len(fit) - 1)])

    found = []
    for kind in kinds:
        if kind == "compass":
            noise = max(rate * taus[2] * log_uniform(rng, 3e-4, 5e-3), math.radians(0.005))
            found.append((kind, at_least(8.0, more=1), noise, 0.0))
        elif kind == "gyro":
            found.append((kind, at_least(8.0, more=1), rate * log_uniform(rng, 0.003, 0.03), 0.0))
        elif kind in {"dvl", "log"}:
            found.append((kind, at_least(3.0, more=2), speed * log_uniform(rng, 0.002, 0.02), 0.25))
        elif kind == "gps":
            found.append((kind, at_least(2.0, more=1), speed * long * log_uniform(rng, 0.005, 0.1), 0.15))
        elif kind == "usbl":
            found.append((kind, at_least(0.7, more=0), speed * long * log_uniform(rng, 0.03, 0.2), 0.2))
        else:
            found.append((kind, at_least(8.0, more=1), speed * long * log_uniform(rng, 0.0005, 0.003), 0.0))
    sensors = []
    for kind, hertz, noise, gap_odds in found:
        in_log = math.degrees(noise) if kind in {"compass", "gyro"} else noise
        gappy = bool(rng.random() < gap_odds)
        late = kind in {"dvl", "gps", "usbl"} and bool(rng.random() < 0.2)
        sensors.append(
            Sensor(
                kind=kind, rate=hertz,
                phase=0.0 if kind == "compass" else round(float(rng.uniform(0.0, 1.0 / hertz)), 3),
                noise=noise, decimals=max(math.ceil(-math.log10(in_log)), 0) + 1,
                latency=round(short * float(rng.uniform(0.05, 0.3)), 4) if late else 0.0,
                gaps=float(rng.uniform(0.03, 0.15)) if gappy else 0.0,
                gap_length=max(long, 3.0 / hertz) if gappy else 0.0,
                outliers=float(rng.uniform(0.005, 0.03)) if kind == "usbl" else 0.0,
            )
        )  # fmt: skip
    return tuple(sensors)


def readings(sensor: Sensor, truth: Floats, current: Floats, rng: np.random.Generator) -> Floats:
    """Logged values (m, signals) in SI units of true states (m, 6) in a current (m, 2)."""
    psi = truth[:, 2]
    if sensor.kind == "compass":
        clean = psi[:, np.newaxis]
    elif sensor.kind == "gyro":
        clean = truth[:, 5:6]
    elif sensor.kind in {"dvl", "log"}:
        surge = truth[:, 3] + np.cos(psi) * current[:, 0] + np.sin(psi) * current[:, 1]
        sway = truth[:, 4] - np.sin(psi) * current[:, 0] + np.cos(psi) * current[:, 1]
        clean = np.column_stack((surge, sway))[:, : len(sensor.signals)]
    else:
        clean = truth[:, :2]
    noisy: Floats = clean + rng.normal(0.0, sensor.noise, clean.shape)
    wild = np.flatnonzero(rng.random(clean.shape[0]) < sensor.outliers)
    noisy[wild] += rng.normal(0.0, 15.0 * sensor.noise, (wild.size, clean.shape[1]))
    return noisy
