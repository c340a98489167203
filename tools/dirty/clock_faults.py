"""Faults of stamps and rows: what a logger does to the time of its readings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from tools.dirty.campaign import MILLI, Campaign, Damage, Log, Stream
from tools.dirty.vehicle import FloatArray, log_uniform

BoolArray = NDArray[np.bool_]
Restamp = Callable[[Stream], FloatArray]


def some(campaign: Campaign, logs: Sequence[Log] | None = None) -> list[Log]:
    """One log in half of the cases, else a random number of logs, in their order."""
    chosen = campaign.logs if logs is None else logs
    count = 1 if campaign.rng.random() < 0.5 else int(campaign.rng.integers(1, len(chosen) + 1))
    return [chosen[k] for k in sorted(campaign.rng.permutation(len(chosen))[:count].tolist())]


def restamp(campaign: Campaign, log: Log, stamp: Restamp, *, thrust: bool = True) -> None:
    """Give the rows of a table, or the messages of both streams (``thrust``), other stamps."""
    stamps = stamp(log.motion)
    log.motion = replace(log.motion, stamps=np.round(stamps, MILLI))
    if campaign.one_table:
        log.thrust = replace(log.thrust, stamps=log.motion.stamps)
    elif thrust:
        log.thrust = replace(log.thrust, stamps=np.round(stamp(log.thrust), MILLI))


def moving(campaign: Campaign, log: Log) -> float:
    """Instant at which the vehicle turns at no less than half of its rate in this log, away from both ends."""
    time, rate = log.truth["time"], np.abs(log.truth["rate"])
    inside = (time > time[-1] * 0.1) & (time < time[-1] * 0.9) & (rate >= 0.5 * rate.max())
    return float(campaign.rng.choice(time[inside] if inside.any() else time[1:-1]))


def lost_rows(campaign: Campaign) -> Damage:
    """3 to 30 % of the rows or messages are gone."""
    rng, share = campaign.rng, log_uniform(campaign.rng, 0.03, 0.3)
    logs = some(campaign)
    length = int(rng.integers(1, 4))  # rows lost at a time
    lost, total = 0, 0

    def mask(count: int) -> BoolArray:
        starts = rng.random(count) < share / length
        kept: BoolArray = np.convolve(starts, np.ones(length))[:count] == 0
        return kept

    for log in logs:
        kept = mask(len(log.motion.stamps))
        kept[0] = True
        lost, total = lost + int(np.count_nonzero(~kept)), total + len(kept)
        other = kept if campaign.one_table else mask(len(log.thrust.stamps))
        other[0] = True
        log.motion, log.thrust = log.motion.kept(kept), log.thrust.kept(other)
    return Damage(logs=tuple(log.name for log in logs), size=lost / total, unit="1", note=f"{length} at a time")


def repeated_stamps(campaign: Campaign) -> Damage:
    """Some rows bear the stamp of the row before, or the clock has coarse ticks."""
    rng, logs = campaign.rng, some(campaign)
    coarse = bool(rng.random() < 0.5)
    tick = float(rng.choice([2.0, 3.0, 5.0])) / campaign.rate_hz
    share = log_uniform(rng, 0.05, 0.3)

    def stamp(stream: Stream) -> FloatArray:
        stamps = stream.stamps.copy()
        if coarse:
            return np.asarray(np.floor(stamps / tick + 1e-6) * tick)
        late = np.flatnonzero(rng.random(len(stamps)) < share)
        stamps[late[late > 0]] = stream.stamps[late[late > 0] - 1]
        return stamps

    equal = total = 0
    for log in logs:
        restamp(campaign, log, stamp)
        equal += int(np.count_nonzero(np.diff(log.motion.stamps) == 0.0))
        total += len(log.motion.stamps)
    note = f"ticks of {tick:.3f} s" if coarse else "single rows"
    return Damage(logs=tuple(log.name for log in logs), size=equal / total, unit="1", note=note)


def clock_step(campaign: Campaign) -> Damage:
    """From one row on the clock is set back or ahead."""
    rng, logs = campaign.rng, some(campaign)
    least = max(0.3, 4.0 / campaign.rate_hz)
    size = float(np.round(rng.choice([-1.0, 1.0]) * log_uniform(rng, least, 20.0), MILLI))
    at = []
    for log in logs:
        instant = moving(campaign, log)
        at.append(round(instant - log.start, MILLI))
        restamp(campaign, log, partial(_stepped, instant, size))
    return Damage(logs=tuple(log.name for log in logs), at=tuple(at), size=size, unit="s")


def _stepped(instant: float, size: float, stream: Stream) -> FloatArray:
    """Stamps of a stream whose clock is stepped by ``size`` s at ``instant``."""
    return stream.stamps + size * (stream.instants >= instant)


def wild_stamp(campaign: Campaign) -> Damage:
    """One to three stamps of a log are far off: zero, years ahead, or hours ahead."""
    rng, log = campaign.rng, some(campaign)[0]
    kinds = {"zero": -log.origin if log.origin else -1000.0, "years": 3e8, "hours": log_uniform(rng, 300.0, 3e4)}
    kind = str(rng.choice(list(kinds)))
    first = kind == "zero" and rng.random() < 0.5
    count = 1 if first else int(rng.integers(1, 4))
    rows = (
        np.array([0]) if first else np.sort(rng.choice(np.arange(1, len(log.motion.stamps) - 1), count, replace=False))
    )
    stamps = log.motion.stamps.copy()
    at = tuple(np.round(log.motion.instants[rows] - log.start, MILLI).tolist())
    stamps[rows] = kinds[kind] if kind == "zero" else stamps[rows] + kinds[kind]
    log.motion = replace(log.motion, stamps=stamps)
    if campaign.one_table:
        log.thrust = replace(log.thrust, stamps=stamps)
    return Damage(logs=(log.name,), at=at, size=kinds[kind], unit="s", note=kind)


def arrival_bursts(campaign: Campaign) -> Damage:
    """Readings arrive in packs of 3 to 20 and bear the time of arrival."""
    rng, logs = campaign.rng, some(campaign)
    most = int(min(20.0, max(4.0, 1.5 * campaign.rate_hz)))
    pack = int(rng.integers(3, most + 1))
    apart = float(rng.choice([0.001, 0.002]))  # s between the stamps of one pack
    thrust = bool(rng.random() < 0.3)

    def stamp(stream: Stream) -> FloatArray:
        number = np.arange(len(stream.stamps))
        ends = np.minimum(number // pack * pack + pack - 1, number[-1])
        stamps: FloatArray = stream.stamps[ends] + apart * (number % pack)
        return stamps

    for log in logs:
        restamp(campaign, log, stamp, thrust=thrust)
    note = "rows" if campaign.one_table else "both streams" if thrust else "motion alone"
    return Damage(logs=tuple(log.name for log in logs), size=float(pack), unit="readings", note=note)


def clocks_apart(campaign: Campaign) -> Damage:
    """The clock of the commands differs from that of the motion by an offset, in half of the cases with a drift."""
    rng, tau = campaign.rng, campaign.vehicle.time_constant
    least = max(0.1, 0.3 * tau, 1.5 / campaign.rate_hz)
    size = float(
        np.round(rng.choice([-1.0, 1.0]) * log_uniform(rng, least, max(2.0 * least, min(5.0, 2.0 * tau))), MILLI)
    )
    drift = 0.0 if rng.random() < 0.5 else float(rng.uniform(50.0, 400.0) * rng.choice([-1.0, 1.0]))
    for log in campaign.logs:
        stamps = log.thrust.stamps + size + 1e-6 * drift * log.thrust.stamps
        log.thrust = replace(log.thrust, stamps=np.round(stamps, MILLI))
    return Damage(logs=tuple(log.name for log in campaign.logs), size=size, unit="s", note=f"drift {drift:.0f} ppm")


def heading_gaps(campaign: Campaign) -> Damage:
    """The heading is absent in bursts, 10 to 50 % of the time."""
    rng, logs, tau = campaign.rng, some(campaign), campaign.vehicle.time_constant
    share = rng.uniform(0.1, 0.5)
    absent = total = 0
    at = []
    for log in logs:
        instants = log.motion.instants
        span = max(0.3 * tau, 6.0 / campaign.rate_hz)
        gone = np.zeros(len(instants), dtype=bool)
        while gone.mean() < share:
            start = rng.uniform(instants[0] + 0.5, instants[-1])
            gone |= (instants >= start) & (instants < start + span * log_uniform(rng, 1.0, 6.0))
        at.append(round(float(instants[np.argmax(gone)]) - log.start, MILLI))
        absent, total = absent + int(gone.sum()), total + len(gone)
        if campaign.format in {"csv", "csv_pair"}:
            log.motion = log.motion.changed(heading=np.where(gone, np.nan, log.motion.columns["heading"]))
        else:
            log.motion = log.motion.kept(~gone)
    return Damage(logs=tuple(log.name for log in logs), at=tuple(at), size=absent / total, unit="1")


def stale_commands(campaign: Campaign) -> Damage:
    """Commands end early, or fall silent for a while, though the thrusters went on and changed."""
    rng, tau, hz = campaign.rng, campaign.vehicle.time_constant, campaign.command_hz
    torque = campaign.vehicle.full_torque
    best: tuple[float, Log, float, float] | None = None
    for _ in range(60):
        log = campaign.logs[int(rng.integers(len(campaign.logs)))]
        time, drive = log.truth["command_time"], log.truth["torque"]
        last = float(time[-1])
        span = max(12.0 / hz, rng.uniform(2.0, 6.0) * tau)
        start = rng.uniform(0.3 * last, 0.9 * last)
        end = last + 1.0 if rng.random() < 0.5 else start + span
        silent = (time > start) & (time < end)
        if np.count_nonzero(silent) < 12 or silent.mean() > 0.6:
            continue
        error = np.sqrt(np.mean((drive[silent] - drive[np.argmax(silent) - 1]) ** 2)) / torque
        if best is None or error > best[0]:
            best = (float(error), log, start, end)
        if error > 0.25:
            break
    if best is None:
        msg = "no run is long enough for silent commands"
        raise RuntimeError(msg)
    _, log, start, end = best
    silent = (log.thrust.instants > start) & (log.thrust.instants < end)
    size = float(np.ptp(log.thrust.instants[silent]))
    if campaign.one_table:
        log.thrust = log.thrust.changed(**{n: np.where(silent, np.nan, v) for n, v in log.thrust.columns.items()})
    else:
        log.thrust = log.thrust.kept(~silent)
    note = "ends early" if end > log.truth["command_time"][-1] else "silent"
    return Damage(logs=(log.name,), at=(round(start - log.start, MILLI),), size=size, unit="s", note=note)
