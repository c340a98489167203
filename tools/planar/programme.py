"""Demands of a run: shares of full surge, sway and yaw over time, and a pilot."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from tools.planar.motion import Floats, Pilot
from tools.planar.vehicles import Vehicle

# Poor programmes: turns on the spot, straight runs, turns at one thrust ahead.
POOR = ("turns", "ahead", "steady")
KINDS = ("steps", "sines", "zigzag", "circles", "random", "feedback")


@dataclass(frozen=True, kw_only=True)
class Programme:
    """Demands (k, 3) at the commands' instants, headings to keep (k,) in rad from the start, and who steers."""

    kind: str
    demands: Floats
    setpoints: Floats
    pilot: Pilot


def _levels(rng: np.random.Generator, time: Floats, hold: tuple[float, float], low: float, high: float) -> Floats:
    """Random levels, each held for ``hold`` s; one in six is zero."""
    values, at = np.zeros(time.size), float(time[0])
    while at <= time[-1]:
        until = at + float(rng.uniform(*hold))
        level = 0.0 if rng.random() < 1.0 / 6.0 else float(rng.uniform(low, high))
        values[(time >= at) & (time < until)] = level
        at = until
    return values


def _sines(rng: np.random.Generator, time: Floats, scale: float, middle: float, size: float) -> Floats:
    total = np.full(time.size, middle)
    for _ in range(int(rng.integers(1, 4))):
        period = scale * float(np.exp(rng.uniform(np.log(3.0), np.log(15.0))))
        phase = float(rng.uniform(0.0, 2.0 * np.pi))
        total += size * float(rng.uniform(0.3, 0.7)) * np.sin(2.0 * np.pi * time / period + phase)
    result: Floats = np.clip(total, -1.0, 1.0)
    return result


def _wander(rng: np.random.Generator, time: Floats, memory: float, middle: float, size: float) -> Floats:
    """First-order Gauss-Markov demand."""
    step = float(np.median(np.diff(time)))
    keep = float(np.exp(-step / memory))
    noise = rng.normal(0.0, np.sqrt(1.0 - keep * keep), time.size)
    noise[0] = rng.normal()
    result: Floats = np.clip(middle + size * lfilter([1.0], [1.0, -keep], noise), -1.0, 1.0)
    return result


def _ship(rng: np.random.Generator, kind: str, time: Floats) -> Programme:
    """Zigzag of a ship: "ship zigzag" or "ship zigzag 20" (deg), or "ship turn 35", with the propeller held."""
    demands, words = np.zeros((time.size, 3)), kind.split()
    demands[:, 0] = float(rng.uniform(0.6, 1.0))
    angle = float(words[2]) if len(words) > 2 else float(rng.choice([5.0, 10.0, 10.0]))
    first = float(rng.choice([-1.0, 1.0]))
    pilot = Pilot()
    if words[1] == "turn":
        demands[:, 2] = first * angle / 35.0
    else:
        pilot = Pilot(kind=2, angle=np.radians(angle), demand=angle / 35.0, first=first)
    return Programme(kind=kind, demands=demands, setpoints=np.zeros(time.size), pilot=pilot)


def plan(rng: np.random.Generator, vehicle: Vehicle, kind: str, time: Floats) -> Programme:
    """A programme of one kind; the size of everything is drawn."""
    if kind.startswith("ship "):
        return _ship(rng, kind, time)
    taus = vehicle.time_constants
    scale = max(taus[0], taus[2], taus[1] if vehicle.axes[1] else 0.0)
    ahead_only = not vehicle.axes[1]
    low = 0.15 if ahead_only and rng.random() < 0.7 else -0.8
    demands, setpoints = np.zeros((time.size, 3)), np.zeros(time.size)
    pilot = Pilot()
    hold = (1.0 * scale, 5.0 * scale)
    for axis, least in ((0, low), (1, -1.0), (2, -1.0)):
        if not vehicle.axes[axis] or (axis == 1 and rng.random() < 0.15):
            continue
        middle = 0.5 if axis == 0 and ahead_only else 0.0
        if kind in {"steps", "feedback", "zigzag"}:
            demands[:, axis] = _levels(rng, time, hold, least, 1.0)
        elif kind == "sines":
            demands[:, axis] = _sines(rng, time, scale, middle, 0.5 if middle else 0.8)
        elif kind == "circles":
            demands[:, axis] = _levels(rng, time, (6.0 * scale, 14.0 * scale), least, 1.0)
        else:
            demands[:, axis] = _wander(rng, time, scale * float(rng.uniform(0.5, 3.0)), middle, 0.4)
    fast = max(taus[2], 1e-3)
    if kind == "feedback":
        gain = float(rng.uniform(0.8, 2.5))
        # Damping ratio of about one of heading error to torque: a demand of one turns at the full rate.
        pilot = Pilot(kind=1, gain=gain, damping=gain * fast * float(rng.uniform(0.5, 1.5)))
        setpoints = np.cumsum(np.where(rng.random(time.size) < float(time[1] - time[0]) / (4.0 * scale),
                                       rng.uniform(-1.5, 1.5, time.size), 0.0))  # fmt: skip
    elif kind == "zigzag":
        angle = vehicle.full[2] * fast * float(rng.uniform(0.3, 1.2))
        pilot = Pilot(kind=2, angle=min(angle, 0.7), demand=float(rng.uniform(0.3, 1.0)))
        demands[:, 0] = _levels(rng, time, (15.0 * scale, 30.0 * scale), 0.3, 1.0)
    return Programme(kind=kind, demands=demands, setpoints=setpoints, pilot=pilot)


def limited(programme: Programme, limits: str) -> Programme:
    """A programme that moves the vehicle only as one of `POOR` says; "" changes nothing."""
    if not limits:
        return programme
    demands = (
        programme.demands * {"turns": (0.0, 0.0, 1.0), "ahead": (1.0, 0.0, 0.0), "steady": (0.0, 0.0, 1.0)}[limits]
    )
    if limits == "steady":
        demands[:, 0] = 0.6
    pilot = Pilot() if limits == "ahead" else programme.pilot
    return replace(programme, kind=f"{programme.kind}, {limits}", demands=demands, pilot=pilot)
