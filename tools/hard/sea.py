"""Waves by a spectrum, gusts and eddies: their series at half steps, and how hard they push."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tools.hard import layout as at
from tools.hard.layout import Floats
from tools.hard.vehicles import Vehicle

COMPONENTS = 24


@dataclass(frozen=True)
class Sea:
    """Weather of a campaign. Shares are rms moments, of the vehicle's torque in use."""

    spectrum: str  # "JONSWAP" or "Pierson-Moskowitz"
    peak: float  # rad/s, of encounter
    direction: float
    waves: float
    drift: float  # of the slow second-order moment
    gusts: float
    gust_memory: float  # s
    wind_direction: float
    eddies: float
    eddy_memory: float  # s
    current: float  # m/s
    current_direction: float

    def weather(self, vehicle: Vehicle) -> Floats:
        """What the compiled code takes."""
        weather = np.zeros(at.N_WEATHER)
        torque = vehicle.torque_in_use
        force = torque / (0.3 * vehicle.length)
        weather[at.WAVE_DIRECTION] = self.direction
        # Sines and cosines of the heading in the moment: divided by their rms over all headings.
        weather[at.WAVE_YAW] = self.waves * torque / np.sqrt(0.5 + 0.125)
        weather[at.WAVE_SURGE] = weather[at.WAVE_SWAY] = 0.7 * self.waves * force
        weather[at.WAVE_DRIFT] = 0.1 * self.waves * force
        weather[at.WAVE_DRIFT_YAW] = self.drift * torque
        weather[at.WIND_DIRECTION] = self.wind_direction
        weather[at.WIND_YAW] = self.gusts * torque * np.sqrt(2.0)
        weather[at.WIND_SURGE] = 0.3 * self.gusts * force
        weather[at.WIND_SWAY] = 0.7 * self.gusts * force
        weather[at.EDDY_YAW] = self.eddies * torque
        return weather

    def series(self, half_step: float, count: int, swell: float, rng: np.random.Generator) -> Floats:
        """Each of unit variance: wave and its quadrature, gust, eddy, and a narrow swell where there is one."""
        series = np.zeros((count, at.N_SERIES))
        series[:, at.WAVE], series[:, at.WAVE_QUADRATURE] = irregular(self.peak, self.spectrum, half_step, count, rng)
        series[:, at.GUST] = coloured(self.gust_memory, half_step, count, rng)
        series[:, at.EDDY] = coloured(self.eddy_memory, half_step, count, rng)
        if swell:
            phase = swell * half_step * np.arange(count) + rng.uniform(0, 2 * np.pi)
            # A swell whose height and phase wander slowly: a band of 3 % or so.
            slow = 1.0 + 0.2 * coloured(15.0 / swell, half_step, count, rng)
            series[:, at.SWELL_MOMENT] = slow * np.sin(phase + 0.4 * coloured(30.0 / swell, half_step, count, rng))
        return series


def spectrum(frequency: Floats, peak: float, name: str) -> Floats:
    """Variance density of the elevation, without its scale."""
    ratio = peak / frequency
    density = ratio**5 * np.exp(-1.25 * ratio**4)
    if name == "JONSWAP":
        width = np.where(frequency <= peak, 0.07, 0.09)
        density = density * 3.3 ** np.exp(-((frequency / peak - 1.0) ** 2) / (2.0 * width**2))
    return np.asarray(density, dtype=float)


def irregular(peak: float, name: str, step: float, count: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Elevation of unit variance at a place, and the same a quarter of a period later: a sum of random components."""
    edges = peak * np.geomspace(0.6, 2.6, COMPONENTS + 1)
    frequency = rng.uniform(edges[:-1], edges[1:])
    amplitude = np.sqrt(2.0 * spectrum(frequency, peak, name) * np.diff(edges))
    amplitude *= np.sqrt(2.0 / np.sum(amplitude**2))
    turning = amplitude * np.exp(1j * rng.uniform(0, 2 * np.pi, COMPONENTS))
    coarse_step = min(0.05 * 2 * np.pi / edges[-1], step * count)
    grid = np.arange(0.0, step * count + 4 * coarse_step, coarse_step)
    coarse = np.exp(1j * np.outer(grid, frequency)) @ turning
    time = step * np.arange(count)
    return np.interp(time, grid, coarse.real), np.interp(time, grid, coarse.imag)


def coloured(memory: float, step: float, count: int, rng: np.random.Generator) -> Floats:
    """Ornstein-Uhlenbeck noise of unit variance."""
    every = max(1, int(0.05 * memory / step))
    keep = np.exp(-every * step / memory)
    steps = count // every + 2
    kicks = rng.normal(0.0, np.sqrt(1.0 - keep * keep), steps)
    kicks[0] = rng.normal()
    values = np.empty(steps)
    held = 0.0
    for index, kick in enumerate(kicks.tolist()):
        held = keep * held + kick
        values[index] = held
    return np.interp(np.arange(count), every * np.arange(steps), values)


def draw_sea(vehicle: Vehicle, rng: np.random.Generator) -> Sea:
    """Weather for a campaign: from nearly calm to waves of half of the torque."""
    tau = vehicle.time_constant
    calm = float(np.exp(rng.uniform(np.log(0.2), 0.0)))
    rough = calm * (float(rng.uniform(0.1, 0.5)) if vehicle.surface else float(rng.uniform(0.02, 0.25)))
    return Sea(
        spectrum=str(rng.choice(["JONSWAP", "Pierson-Moskowitz"])),
        peak=float(rng.uniform(0.8, 4.5)) / tau,
        direction=float(rng.uniform(-np.pi, np.pi)),
        waves=rough,
        drift=0.06 * rough,
        gusts=calm * float(rng.uniform(0.0, 0.2)) if vehicle.wind else 0.0,
        gust_memory=float(rng.uniform(1.5, 6.0)) * tau,
        wind_direction=float(rng.uniform(-np.pi, np.pi)),
        eddies=calm * float(np.exp(rng.uniform(np.log(0.03), np.log(0.3)))),
        eddy_memory=float(rng.uniform(0.5, 5.0)) * tau,
        current=float(rng.uniform(0.0, 0.2)) * vehicle.length**0.5 * 0.3,
        current_direction=float(rng.uniform(-np.pi, np.pi)),
    )
