"""Faults of whole runs: other vehicles, no motion, copies, several tests, rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tools.dirty.campaign import MILLI, Campaign, Damage, Log, Stream, demand_of, set_origins
from tools.dirty.vehicle import FloatArray, log_uniform


def foreign_log(campaign: Campaign) -> Damage:
    """One or two logs are of another vehicle, or every second log has another payload."""
    rng, vehicle = campaign.rng, campaign.vehicle
    while len(campaign.logs) < 5:
        number = len(campaign.logs) + 1
        kind = str(rng.choice(["steps", "random"]))
        campaign.logs.append(campaign.run(f"run_{number:02d}", demand_of(campaign, kind), kind, vehicle))
    groups = bool(rng.random() < 0.4)
    if groups:
        factor = rng.uniform(1.2, 1.8)
        other = replace(
            vehicle, quadratic_drag=factor * vehicle.quadratic_drag, linear_drag=factor * vehicle.linear_drag
        )
        numbers = list(range(1, len(campaign.logs), 2))
    else:
        factor = log_uniform(rng, 1.6, 6.0) ** float(rng.choice([-1.0, 1.0]))
        drag = factor * rng.uniform(0.7, 1.4)
        other = replace(
            vehicle,
            inertia=factor * vehicle.inertia,
            quadratic_drag=drag * vehicle.quadratic_drag,
            linear_drag=drag * vehicle.linear_drag,
            time_constant=factor / drag * vehicle.time_constant,
        )
        count = 1 if len(campaign.logs) < 6 else int(rng.integers(1, 3))
        numbers = sorted(rng.permutation(len(campaign.logs))[:count].tolist())
    for number in numbers:
        kind = str(rng.choice(["steps", "random"]))
        campaign.logs[number] = campaign.run(campaign.logs[number].name, demand_of(campaign, kind), kind, other)
    set_origins(campaign, campaign.logs)
    names = tuple(campaign.logs[number].name for number in numbers)
    note = "drags of every second log" if groups else "inertia, with other drags"
    return Damage(logs=names, size=float(factor), unit="1", note=note)


def no_response(campaign: Campaign) -> Damage:
    """Thrust as in the other runs, but the vehicle stands on deck."""
    torques = np.array([np.ptp(log.truth["torque"]) for log in campaign.logs])
    strong = np.flatnonzero(torques >= 0.5 * torques.max())
    log = campaign.logs[int(campaign.rng.choice(strong))]
    count = len(log.motion.stamps)
    columns = {"heading": campaign.measured(np.full(count, log.truth["heading"][0]))}
    if campaign.with_rate:
        columns["rate"] = campaign.rng.normal(0.0, 0.02, count)
    log.motion = log.motion.changed(**columns)
    return Damage(logs=(log.name,), size=0.0, unit="1", note="on deck")


def same_run_twice(campaign: Campaign) -> Damage:
    """One run stands in two logs: a copy cut differently, an overlap, or a second compass."""
    rng = campaign.rng
    log = max(campaign.logs, key=lambda one: len(one.motion.stamps))
    last = float(log.motion.instants[-1])
    kind = str(rng.choice(["copy", "overlap", "second compass"]))
    if kind == "overlap":
        shared = float(rng.uniform(0.3, 0.6))
        first, second = (
            _between(log, 0.0, 0.5 * (1.0 + shared) * last),
            _between(log, 0.5 * (1.0 - shared) * last, last),
        )
    elif kind == "copy":
        shared = float(rng.uniform(0.85, 1.0))
        first, second = log, _between(log, (1.0 - shared) * last, last)
    else:
        shared, turned = 1.0, float(rng.uniform(2.0, 30.0))
        heading = campaign.measured(log.truth["heading"] + np.radians(turned))
        first, second = log, replace(log, motion=log.motion.changed(heading=heading))
    second.name = f"{log.name}_b"
    place = campaign.logs.index(log)
    campaign.logs[place : place + 1] = [first, second]
    return Damage(logs=(first.name, second.name), size=shared, unit="1", note=kind)


def _between(log: Log, start: float, end: float) -> Log:
    """The run from ``start`` to ``end`` in s; the time of the day is kept, a clock of the log's own begins anew."""
    shift = 0.0 if log.origin > 1e6 or not start else round(start, MILLI)

    def cut(stream: Stream) -> Stream:
        part = stream.kept((stream.instants >= start) & (stream.instants <= end))
        return replace(part, stamps=np.round(part.stamps - shift, MILLI))

    return replace(log, motion=cut(log.motion), thrust=cut(log.thrust))


def several_releases(campaign: Campaign) -> Damage:
    """A log holds two to four tests; between them a hand turns the vehicle back, without thrust."""
    rng, tau, hz = campaign.rng, campaign.vehicle.time_constant, campaign.command_hz
    number = int(rng.integers(len(campaign.logs)))
    count = int(rng.integers(2, 5))
    demands: list[FloatArray] = []
    extras: list[FloatArray] = []
    at = []
    for test in range(count):
        if test:
            push = _push(campaign, max(8.0 * tau, 6.0))
            at.append(round(sum(map(len, demands)) / hz, MILLI))
            demands.append(np.zeros(len(push)))
            extras.append(push)
        demand = demand_of(campaign, str(rng.choice(["coast", "steps", "hold"])))
        demands.append(demand)
        extras.append(np.zeros(len(demand)))
    log = campaign.logs[number]
    origin = log.origin
    run = campaign.run(log.name, np.concatenate(demands), "several", campaign.vehicle, np.concatenate(extras))
    run.origin = origin
    campaign.logs[number] = run
    return Damage(logs=(run.name,), at=tuple(at), size=float(count), unit="tests")


def _push(campaign: Campaign, span: float) -> FloatArray:
    """Torque (m,) in N m of a hand that turns the vehicle, and then lets it rest."""
    time = np.arange(0.0, span, 1.0 / campaign.command_hz)
    begin, length = 0.3 * span, 0.3 * span
    size = campaign.rng.choice([-1.0, 1.0]) * campaign.rng.uniform(0.4, 0.9) * campaign.vehicle.full_torque
    inside = (time > begin) & (time < begin + length)
    return np.where(inside, size * np.sin(np.pi * (time - begin) / length), 0.0)


def idle_ends(campaign: Campaign) -> Damage:
    """A log begins, ends, or both, with minutes of rest, in which hands may turn the vehicle."""
    rng, hz = campaign.rng, campaign.command_hz
    number = int(rng.integers(len(campaign.logs)))
    kind = str(rng.choice(["before", "after", "both"]))
    handled = bool(rng.random() < 0.5)
    demand = demand_of(campaign, str(rng.choice(["coast", "steps", "random"])))
    idle = min(600.0, rng.uniform(1.5, 5.0) * len(demand) / hz)

    def rest() -> FloatArray:
        pieces = [_push(campaign, idle / 3.0) if handled else np.zeros(int(idle * hz / 3.0)) for _ in range(3)]
        return np.concatenate(pieces)

    before, after = rest() if kind != "after" else np.zeros(0), rest() if kind != "before" else np.zeros(0)
    log = campaign.logs[number]
    demand = np.concatenate([np.zeros(len(before)), demand, np.zeros(len(after))])
    extra = np.concatenate([before, np.zeros(len(demand) - len(before) - len(after)), after])
    run = campaign.run(log.name, demand, "idle", campaign.vehicle, extra)
    run.origin = log.origin
    campaign.logs[number] = run
    at = [0.0] * (kind != "after") + [round((len(demand) - len(after)) / hz, MILLI)] * (kind != "before")
    return Damage(
        logs=(run.name,), at=tuple(at), size=idle, unit="s", note=f"{kind}, {'handled' if handled else 'at rest'}"
    )
