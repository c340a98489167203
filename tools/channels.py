"""Extra signals that a log may carry, slow and irregular, each made afresh for every run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tools.hidden import DRIVERS, OUTSIDE, acting
from tools.truth import FloatArray, Truth


@dataclass(frozen=True)
class Channel:
    """One signal: ``mean``, ``swing`` about it and logging ``noise``, all in ``unit``; ``periods`` in s, on ROSUB.

    A ``stepwise`` one stands still and moves in turn, as a manipulator does.
    """

    unit: str
    mean: float
    swing: float
    periods: tuple[float, ...]
    noise: float
    decimals: int
    stepwise: bool = False


# Name in rovid.toml -> signal. The supply has a column of its own already: what stands here wanders on top.
SUPPLY = "supply_voltage"
CHANNELS: Mapping[str, Channel] = {
    "manipulator_angle": Channel("deg", 0.0, 40.0, (25.0,), 0.05, 2, stepwise=True),
    "tether_tension": Channel("N", 120.0, 40.0, (7.0, 13.0, 29.0, 61.0), 0.5, 1),
    "surge_speed": Channel("m_s", 0.0, 0.10, (11.0, 23.0, 37.0), 0.001, 4),
    "depth": Channel("m", 4.0, 1.0, (43.0, 71.0, 113.0), 0.002, 3),
    SUPPLY: Channel("V", 0.0, 2.0, (31.0, 67.0, 131.0), 0.0, 2),
    # A vehicle that is under way, now and then astern.
    "surge_velocity": Channel("m_s", 0.5, 0.4, (41.0, 73.0, 151.0), 0.002, 4),
    "sway_velocity": Channel("m_s", 0.0, 0.2, (37.0, 59.0, 127.0), 0.002, 4),
}
SPEEDS = ("surge_velocity", "sway_velocity")
EXTRA: tuple[str, ...] = tuple(name for name in CHANNELS if name not in (SUPPLY, *SPEEDS))
# (effect, form) -> speeds on which it depends.
_MOVED: Mapping[tuple[str, str], tuple[str, ...]] = {
    ("advance_speed_loss", "measured"): SPEEDS[:1],
    ("speed_dependent_damping", "linear"): SPEEDS[:1],
    ("speed_dependent_damping", "quadratic"): SPEEDS[:1],
    ("sideslip_moment", "drift"): SPEEDS[1:],
    ("sideslip_moment", "munk"): SPEEDS,
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Signal:
    """A channel's course in one run, less its mean, as points joined by straight lines or as a sum of sines."""

    time: FloatArray | None
    value: FloatArray
    frequency: FloatArray
    phase: FloatArray

    def at(self, time: FloatArray) -> FloatArray:
        """Deviation from the mean at ``time`` in s."""
        if self.time is not None:
            return np.asarray(np.interp(time, self.time, self.value))
        return np.asarray((np.sin(np.outer(time, self.frequency) + self.phase) * self.value).sum(axis=1))


def column(name: str) -> str:
    """Name of the channel's column in a CSV log."""
    return f"{name}_{CHANNELS[name].unit}"


def needed(truth: Truth) -> tuple[str, ...]:
    """Channels, the supply included, that this truth logs or that something hidden depends on."""
    hidden = acting(truth.hidden)
    driver = DRIVERS[hidden[OUTSIDE].form] if OUTSIDE in hidden else ""
    wanders = "supply_sag" in hidden and hidden["supply_sag"].form == "voltage"
    speeds = {name for one in hidden.values() for name in _MOVED.get((one.effect, one.form), ())}
    wanted = {*truth.channels, driver, *([SUPPLY] if wanders else []), *speeds}
    return tuple(name for name in CHANNELS if name in wanted)


def courses(truth: Truth, duration: float, rng: np.random.Generator) -> dict[str, Signal]:
    """Course through ``duration`` in s of each channel that is needed."""
    pace = truth.pace or 1.0
    # A separate generator for each channel: the values of a channel do not depend on the other logged channels.
    generators = dict(zip(CHANNELS, rng.spawn(len(CHANNELS)), strict=True))
    return {name: _course(_of(name, truth), duration, pace, generators[name]) for name in needed(truth)}


def _of(name: str, truth: Truth) -> Channel:
    channel = CHANNELS[name]
    if name != SUPPLY:
        return channel
    swing = _wander(truth)
    return Channel(channel.unit, 0.0, swing, channel.periods, 0.0, channel.decimals)


def _wander(truth: Truth) -> float:
    """Swing in V of the supply: what is hidden says so, or a twentieth of the supply."""
    sag = acting(truth.hidden).get("supply_sag")
    return sag.parameters["wander"] if sag and sag.form == "voltage" else truth.instruments.supply / 20.0


def _course(channel: Channel, duration: float, pace: float, rng: np.random.Generator) -> Signal:
    periods = np.array(channel.periods) * pace
    if channel.stepwise:
        return _moves(channel.swing, float(periods[0]), duration, rng)
    return Signal(
        time=None,
        value=np.full(len(periods), channel.swing * np.sqrt(2.0 / len(periods)) / 1.5),
        frequency=2.0 * np.pi / (periods * rng.uniform(0.85, 1.15, len(periods))),
        phase=rng.uniform(0.0, 2.0 * np.pi, len(periods)),
    )


def _moves(swing: float, period: float, duration: float, rng: np.random.Generator) -> Signal:
    """Rests of about ``period`` in s with moves of a tenth of it between them."""
    count = int(duration / period) + 3
    starts = np.cumsum(rng.uniform(0.6, 1.4, count)) * period - period
    levels = rng.uniform(-swing, swing, count + 1)
    time = np.ravel(np.column_stack([starts, starts + 0.1 * period]))
    value = np.ravel(np.column_stack([levels[:-1], levels[1:]]))
    return Signal(time=time, value=value, frequency=np.empty(0), phase=np.empty(0))
