"""Runs of a plain vehicle, driven open loop in many ways or steered by how it moves: what a test for feedback is for.

Work class and small vehicles, in more or less disturbed water, with headings noisy and rounded to various degrees, and
thrusters that may do other than the bench curve says: a lag, a delay, a dead zone, a weak reverse.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
_NONE, _PILOT, _ZIGZAG, _BANG, _STICK = range(5)


@dataclass(frozen=True, kw_only=True)
class Steered:
    """A run: (n,) s, heading in rad, torque in N m that was commanded."""

    kind: str
    time: Floats
    heading: Floats
    torque: Floats


@dataclass(frozen=True)
class _Scene:
    """What a run is drawn for: ``count`` instants ``step`` s apart; the vehicle's time constant in s, torque in N m."""

    rng: np.random.Generator
    count: int
    step: float
    tau: float
    torque: float

    def level(self) -> float:
        """A size of command, N m."""
        return float(self.rng.uniform(0.4, 1.5)) * self.torque

    def rows(self, least: float, most: float) -> int:
        """How many instants so many time constants take, drawn between the two."""
        return max(1, int(self.rng.uniform(least, most) * self.tau / self.step))

    def levels(self, least: float, most: float, value: Callable[[int], float]) -> Floats:
        """Consecutive levels ``value(number)``, each ``least`` to ``most`` time constants long."""
        parts: list[Floats] = []
        held = 0
        while held < self.count:
            rows = self.rows(least, most)
            parts.append(np.full(rows, value(len(parts))))
            held += rows
        return np.concatenate(parts)[: self.count]

    def rounded(self, torque: Floats, parts: int) -> Floats:
        """Torque with the resolution of a converter."""
        return np.asarray(np.round(torque / self.torque * parts) / parts * self.torque)

    @property
    def time(self) -> Floats:
        return self.step * np.arange(self.count, dtype=np.float64)


def _random_binary(scene: _Scene) -> Floats:
    size = scene.level()
    return scene.levels(0.5, 3.0, lambda _: size * float(scene.rng.choice([-1.0, 1.0])))


def _clocked_binary(scene: _Scene) -> Floats:
    """Levels by a clock; the sequence may repeat itself."""
    clock = scene.rows(0.4, 1.5)
    bits = scene.rng.choice([-1.0, 1.0], size=scene.count // clock + 1)
    if scene.rng.random() < 0.5:
        bits = np.resize(bits[: int(scene.rng.choice([15, 31, 63]))], len(bits))
    return np.repeat(bits, clock)[: scene.count] * scene.level()


def _random_levels(scene: _Scene) -> Floats:
    return scene.levels(1.0, 6.0, lambda _: float(scene.rng.uniform(-1.5, 1.5)) * scene.torque)


def _holds(scene: _Scene) -> Floats:
    signs = [-1.0, 0.0, 1.0]
    return scene.levels(6.0, 16.0, lambda _: scene.level() * float(scene.rng.choice(signs, p=[0.4, 0.2, 0.4])))


def _repeated_steps(scene: _Scene) -> Floats:
    values = scene.rng.uniform(-1.5, 1.5, int(scene.rng.integers(3, 7))) * scene.torque
    return np.resize(np.concatenate([np.full(scene.rows(1.0, 8.0), value) for value in values]), scene.count)


def _staircase(scene: _Scene) -> Floats:
    up = np.array([0.0, 0.3, 0.6, 0.9, 1.2, 0.9, 0.6, 0.3])
    return np.resize(np.repeat(np.concatenate((up, -up)) * scene.torque, scene.rows(3.0, 8.0)), scene.count)


def _zigzag_by_time(scene: _Scene) -> Floats:
    """Reversed by the clock, after half as long at first; a hand at the switch is late by a share of it."""
    clock, size, late = scene.rows(1.5, 8.0), scene.level(), float(scene.rng.choice([0.0, 0.05, 0.3]))
    parts = [np.full(max(clock // 2, 1), size)]
    while sum(len(part) for part in parts) < scene.count:
        rows = max(2, int(clock * (1.0 + late * scene.rng.uniform(-1.0, 1.0))))
        parts.append(np.full(rows, -np.sign(parts[-1][-1]) * size))
    return np.concatenate(parts)[: scene.count]


def _sines(scene: _Scene) -> Floats:
    parts: list[Floats] = []
    while sum(len(part) for part in parts) < scene.count:
        period = scene.rng.uniform(3.0, 14.0) * scene.tau
        time = scene.step * np.arange(int(scene.rng.integers(4, 9) * period / scene.step))
        parts.append(np.sin(2.0 * np.pi * time / period) * scene.level())
    return scene.rounded(np.concatenate(parts)[: scene.count], 200)


def _sweep(scene: _Scene) -> Floats:
    slow, fast = 1.0 / (30.0 * scene.tau), 1.0 / (2.0 * scene.tau)
    phase = 2.0 * np.pi * (slow * scene.time + (fast - slow) * scene.time**2 / (2.0 * scene.time[-1]))
    wave = np.sin(phase)
    return np.asarray((np.sign(wave) if scene.rng.random() < 0.5 else wave) * scene.level())


def _multisine(scene: _Scene) -> Floats:
    frequencies = scene.rng.uniform(1.0 / 25.0, 1.0 / 1.5, int(scene.rng.integers(3, 12))) / scene.tau
    phases = scene.rng.uniform(0.0, 2.0 * np.pi, len(frequencies))
    wave = np.sin(2.0 * np.pi * np.outer(scene.time, frequencies) + phases).sum(axis=1)
    return scene.rounded(np.clip(wave / wave.std() * 0.7 * scene.level(), -scene.torque, scene.torque), 200)


def _noise(scene: _Scene) -> Floats:
    memory = float(scene.rng.uniform(0.3, 3.0)) * scene.tau
    wave = _coloured(scene.count, scene.step, memory, scene.rng) * scene.level()
    return scene.rounded(np.clip(wave, -1.6 * scene.torque, 1.6 * scene.torque), 100)


def _ramps(scene: _Scene) -> Floats:
    at, values = [0], [0.0]
    while at[-1] < scene.count:
        held, risen = scene.rows(0.5, 6.0), scene.rows(1.0, 6.0)
        at += [at[-1] + held, at[-1] + held + risen]
        values += [values[-1], float(scene.rng.uniform(-1.5, 1.5)) * scene.torque]
    return scene.rounded(np.interp(np.arange(scene.count), at, values), 200)


def _slewed_levels(scene: _Scene) -> Floats:
    """Random levels, each reached in a few steps at a clock, as a stick whose commands are limited in rate."""
    goal = scene.levels(1.0, 6.0, lambda _: float(scene.rng.uniform(-1.5, 1.5)) * scene.torque)
    clock, most = scene.rows(0.05, 0.3), float(scene.rng.uniform(0.3, 1.0)) * scene.torque
    torque, last = np.empty(scene.count), 0.0
    for row in range(scene.count):
        if row % clock == 0:
            last += float(np.clip(goal[row] - last, -most, most))
        torque[row] = last
    return torque


# Kind -> torque in N m.
OPEN: dict[str, Callable[[_Scene], Floats]] = {
    "random binary": _random_binary,
    "clocked binary": _clocked_binary,
    "random levels": _random_levels,
    "holds": _holds,
    "repeated steps": _repeated_steps,
    "staircase": _staircase,
    "zigzag by time": _zigzag_by_time,
    "sines": _sines,
    "sweep": _sweep,
    "multisine": _multisine,
    "noise": _noise,
    "ramps": _ramps,
    "slewed levels": _slewed_levels,
}
CLOSED = {
    "autopilot": _PILOT,
    "slow autopilot": _PILOT,
    "heading hold": _PILOT,
    "zigzag by heading": _ZIGZAG,
    "switching autopilot": _BANG,
    "stick": _STICK,
}


def steered(kind: str, seed: int) -> Steered:
    """A run of one of ``OPEN`` or ``CLOSED``; the same seed makes the same run."""
    rng = np.random.default_rng([seed, zlib.crc32(kind.encode())])
    small = rng.random() < 0.5
    inertia, quadratic, linear, torque = (0.5, 0.4, 0.6, 1.5) if small else (5057.0, 3532.0, 132.0, 126.0)
    tau = inertia / (linear + quadratic * float(np.sqrt(torque / quadratic)))
    step = float(rng.choice([0.05, 0.1] if small else [0.05, 0.1, 0.2]))
    scene = _Scene(rng, int(rng.uniform(25.0, 150.0) * tau / step), step, tau, torque)
    size = float(np.exp(rng.uniform(np.log(0.002), np.log(0.08)))) * torque
    disturbance = size * _coloured(scene.count, step, float(rng.uniform(0.3, 6.0)) * tau, rng)
    noise = float(np.radians(np.exp(rng.uniform(np.log(0.005), np.log(0.2))))) * rng.normal(size=scene.count)
    # Commands may be sent at a slower clock than the rows of the log.
    clock = int(rng.choice([1, 1, 1, 2, 3, 4, 6]))
    commanded = np.zeros(scene.count)
    if kind in OPEN:
        clock = clock if kind != "slewed levels" else 1
        commanded = np.repeat(OPEN[kind](scene)[::clock], clock)[: scene.count]
    heading, commanded = _moved(
        commanded, step, np.array([inertia, quadratic, linear]), _odd(rng, scene), disturbance, noise,
        CLOSED.get(kind, _NONE), _law(kind, scene, inertia), _wanted(kind, scene), _looks(kind, scene, clock),
    )  # fmt: skip
    finest = float(np.radians(rng.choice([0.0, 0.01, 0.1])))
    if finest:
        heading = np.round(heading / finest) * finest
    heading += float(rng.uniform(-3.0, 3.0))
    # Some loggers write rows at irregular intervals.
    rows = np.flatnonzero(rng.random(scene.count) >= float(rng.choice([0.0, 0.0, 0.0, 0.6])))
    return Steered(kind=kind, time=scene.time[rows], heading=heading[rows], torque=commanded[rows])


def _coloured(count: int, step: float, memory: float, rng: np.random.Generator) -> Floats:
    """Of unit size, with that memory in s."""
    fade = float(np.exp(-step / memory))
    kicks = np.sqrt(1.0 - fade**2) * rng.normal(size=count)
    values = np.empty(count)
    last = float(rng.normal())
    for at, kick in enumerate(kicks):
        last = fade * last + kick
        values[at] = last
    return values


def _odd(rng: np.random.Generator, scene: _Scene) -> Floats:
    """Lag in s, delay in s, dead zone in N m and share of the thrust in reverse, at most one with an effect."""
    odd = np.array([0.0, 0.0, 0.0, 1.0])
    sizes = (
        rng.uniform(0.1, 0.6) * scene.tau,
        rng.uniform(0.1, 0.4) * scene.tau,
        rng.uniform(0.05, 0.2) * scene.torque,
        rng.uniform(0.6, 0.9),
    )
    which = int(rng.integers(0, 5))
    if which < len(sizes):
        odd[which] = sizes[which]
    return odd


def _law(kind: str, scene: _Scene, inertia: float) -> Floats:
    """Gains on heading, rate and the heading's sum; largest torque, angle, instants that it is late, levels."""
    rng = scene.rng
    bandwidth = float(rng.uniform(0.4, 0.9)) / scene.tau * (0.35 if kind == "slow autopilot" else 1.0)
    gain, brake = inertia * bandwidth**2, 0.7 * inertia * bandwidth
    most = scene.torque * float(rng.uniform(0.9, 1.5))
    late = float(rng.integers(0, 3))
    if kind == "zigzag by heading":
        return np.array([gain, brake, 0.0, most, np.radians(rng.uniform(8.0, 35.0)), late, 1.0])
    if kind == "switching autopilot":
        return np.array([gain, brake, 0.0, 0.5 * scene.torque, np.radians(rng.uniform(1.0, 6.0)), late, 1.0])
    if kind == "stick":
        fast = inertia / scene.tau
        late = float(scene.rows(0.15, 0.5))
        return np.array([most * rng.uniform(1.2, 2.5), fast * rng.uniform(0.4, 0.9), 0.0, most, 0.0, late,
                         float(rng.integers(2, 6))])  # fmt: skip
    return np.array([gain, brake, 0.05 * gain * bandwidth * scene.step, most, 0.0, late, 1.0])


def _wanted(kind: str, scene: _Scene) -> Floats:
    """(n,) heading that is steered for, rad."""
    if kind in OPEN or kind in {"heading hold", "zigzag by heading"}:
        return np.zeros(scene.count)
    steps = np.radians(scene.rng.uniform(10.0, 100.0, scene.count)) * scene.rng.choice([-1.0, 1.0], scene.count)
    return scene.levels(8.0, 22.0, lambda number: float(steps[:number].sum()))


def _looks(kind: str, scene: _Scene, clock: int) -> NDArray[np.bool_]:
    """(n,) when a person looks and decides; a machine does at its clock."""
    looks: NDArray[np.bool_] = np.arange(scene.count) % clock == 0
    if kind == "stick":
        looks[:] = False
        at = 0
        while at < scene.count:
            looks[at] = True
            at += max(1, int((0.4 + scene.rng.exponential()) * scene.tau / scene.step))
    return looks


@numba.njit(cache=True)
def _moved(
    commanded: Floats, step: float, plant: Floats, odd: Floats, disturbance: Floats, noise: Floats, mode: int,
    law: Floats, wanted: Floats, looks: NDArray[np.bool_],
) -> tuple[Floats, Floats]:  # fmt: skip
    """(n,) heading as measured, and (n,) torque as commanded."""
    count, parts = commanded.size, 20
    heading, rates, torque = np.zeros(count), np.zeros(count), commanded.copy()
    angle = rate = thrust = total = last = 0.0
    side = 1.0
    for k in range(count):
        heading[k], rates[k] = angle + noise[k], rate
        seen = max(k - int(law[5]), 0)
        away = wanted[k] - heading[seen]
        asked = law[0] * away - law[1] * rates[seen] + total
        if mode == _PILOT:
            if looks[k]:
                last = min(max(asked, -law[3]), law[3])
                if last == asked:
                    total += law[2] * away
            torque[k] = last
        elif mode == _ZIGZAG:
            if -away * side > law[4]:
                side = -side
            torque[k] = side * law[3]
        elif mode == _BANG:
            lead = away - law[1] / law[0] * rates[seen]
            torque[k] = law[3] * np.sign(lead) if abs(lead) > law[4] else 0.0
        elif mode == _STICK:
            if looks[k]:
                last = np.round(min(max(asked / law[3], -1.0), 1.0) * law[6]) / law[6] * law[3]
            torque[k] = last
        acting = torque[max(k - int(odd[1] / step), 0)]
        acting = 0.0 if abs(acting) <= odd[2] else acting * (odd[3] if acting < 0.0 else 1.0)
        for _ in range(parts):
            thrust = thrust + step / parts / odd[0] * (acting - thrust) if odd[0] > 0.0 else acting
            rate += step / parts * (thrust + disturbance[k] - plant[1] * abs(rate) * rate - plant[2] * rate) / plant[0]
            angle += step / parts * rate
    return heading, torque
