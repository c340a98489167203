"""A campaign: a vehicle, a hidden cause or none, instruments, water and runs, drawn from a seed and an index."""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.signal import lfilter

from tools.planar.causes import FORMS, NOTHING, Cause, forces, make, rows_with, suits
from tools.planar.motion import ARRIVE, N_STATE, RECORD, SEND, Floats, Hull, Ints, Pilot, simulate
from tools.planar.programme import KINDS, POOR, limited, plan
from tools.planar.sensors import RATES, Sensor, draw_sensors
from tools.planar.vehicles import FAMILIES, Vehicle, log_uniform

FORMATS = ("csv", "csv_parts", "mcap")
CLOCKS = ("relative", "epoch", "iso8601")
_SHARE_NOTHING = 0.3
_SHARE_POOR = 0.3
_LEAST, _MOST = 8.0, 45.0  # per cent: how far a hidden cause changes the velocities


@dataclass(frozen=True, kw_only=True)
class Run:
    """One log: what is commanded, what disturbs, and what really happened.

    The log starts ``before`` s after the simulation. ``sent`` (k,) are the instants of the commands in s of the
    simulation, ``stamps`` the instants of the readings of each sensor in s of the log, ``truth`` the states (m, 6) at
    each sensor's true instants. ``series`` (n, 5) are disturbance forces (N, N, N m) and current (m/s, north, east).
    """

    kind: str
    day: float
    length: float
    before: float
    heading: float
    sent: Floats
    demands: Floats
    setpoints: Floats
    errors: Floats
    pilot: Pilot
    commands: Floats
    stamps: tuple[Floats, ...]
    step: float
    series: Floats
    truth: tuple[Floats, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Campaign:
    """All that is true of a campaign. ``disturbance`` are root mean squares (N, N, N m)."""

    seed: int
    index: int
    vehicle: Vehicle
    cause: Cause | None
    sensors: tuple[Sensor, ...]
    runs: tuple[Run, ...]
    command_hz: float
    format: str
    clock: str
    disturbance: tuple[float, float, float]
    memory: float
    waves: float  # rad/s, frequency of narrow-band waves; 0: none
    changed: float = 0.0  # by the hidden cause, per cent


def draw(
    seed: int, index: int, hidden: str | None = None, family: str | None = None,
    *, sensors: tuple[str, ...] | None = None, log_format: str | None = None, kinds: tuple[str, ...] = (),
    samples: int = 20_000,
) -> Campaign:  # fmt: skip
    """Draw a campaign; ``hidden`` is "none", an effect or "effect:form", by default a random one or nothing.

    ``kinds`` are the programmes of the runs, as in `programme.plan`. ``samples`` bounds the readings of a sensor. The
    vehicle depends on seed, index and family.
    """
    rng = np.random.default_rng([seed, index, zlib.crc32(b"planar")])
    # Finer ships are drawn by their name alone.
    family = family or str(rng.choice([name for name in FAMILIES if name != "merchant"]))
    vehicle = FAMILIES[family](rng)
    fitting = [effect for effect in FORMS if suits(vehicle, effect)]
    if hidden is None:
        hidden = NOTHING if rng.random() < _SHARE_NOTHING else str(rng.choice(fitting))
    effect, _, form = hidden.partition(":")
    if effect != NOTHING and not form:
        form = str(rng.choice(FORMS[effect]))
    instruments = draw_sensors(rng, vehicle, sensors)
    taus = vehicle.time_constants
    used = [tau for tau, acts in zip(taus, vehicle.axes, strict=True) if acts]
    if vehicle.ship.length:  # lengths of the ship in a second
        used = [vehicle.length / vehicle.full[0]]
    scale, short = max(used), min(used)
    count = int(rng.integers(2, 9))
    count = len(kinds) or count
    fastest = max(sensor.rate for sensor in instruments)
    total = min(log_uniform(rng, 150.0, 400.0) * scale, samples / fastest)
    lengths = np.round(total / count * rng.uniform(0.7, 1.3, count), 2)
    if vehicle.ship.length:  # two to four periods of a zigzag
        lengths = np.round(scale * rng.uniform(25.0, 45.0, count), 2)
    rates = [rate for rate in RATES if 5.0 / short <= rate <= 60.0 / short] or [RATES[-1]]
    command_hz = float(rng.choice(rates))
    n_force = forces(vehicle)
    # In a basin, where ships' models are tested, the water is calmer.
    share = log_uniform(rng, 0.01, 0.1) * (0.15 if vehicle.ship.length else 1.0)
    each = rng.uniform(0.6, 1.4, 3)
    # The typical force of a programme is about 0.4 of the force at full speed; aside, where nothing pushes, half of it.
    size = (0.4 * share * n_force[0] * each[0], 0.3 * share * n_force[1] * each[1], 0.4 * share * n_force[2] * each[2])
    memory = scale * log_uniform(rng, 0.3, 5.0)
    waves = 2.0 * math.pi / (short * float(rng.uniform(0.4, 2.0))) if rng.random() < 0.25 else 0.0
    days = np.concatenate([[0.0], np.cumsum(lengths[:-1] + rng.uniform(5.0, 60.0, count - 1) * scale)])
    cause_seed, strength = int(rng.integers(2**31)), float(rng.uniform(0.2, 0.8))
    # A share of the campaigns without a cause has poor programmes, which leave parameters undetermined.
    poor = effect == NOTHING and not kinds and not vehicle.ship.length and rng.random() < _SHARE_POOR
    limits = str(rng.choice(POOR)) if poor else ""
    settings = {"seed": seed, "index": index, "vehicle": vehicle, "sensors": instruments, "command_hz": command_hz,
                "format": log_format or str(rng.choice(FORMATS, p=[0.6, 0.2, 0.2])), "clock": str(rng.choice(CLOCKS)),
                "disturbance": size, "memory": memory, "waves": waves}  # fmt: skip
    runs = tuple(
        _planned(
            np.random.default_rng([seed, index, number, 7]), vehicle, instruments, number,
            length=float(lengths[number]), day=float(days[number]), command_hz=command_hz, scale=scale, size=size,
            memory=memory, waves=waves, kind=kinds[number] if kinds else "", limits=limits,
        )
        for number in range(count)
    )  # fmt: skip
    if effect == NOTHING:
        return simulated(Campaign(cause=None, runs=runs, **settings))  # type: ignore[arg-type]  # of mixed values
    for _ in range(8):
        cause = make(vehicle, effect, form, strength, np.random.default_rng(cause_seed))
        campaign = simulated(with_current(Campaign(cause=cause, runs=runs, **settings)))  # type: ignore[arg-type]
        changed = change(campaign)
        if _LEAST <= changed <= _MOST:
            break
        strength = 0.6 * strength if changed > _MOST else 1.5 * strength + 0.05
    return replace(campaign, changed=changed)


def _planned(
    rng: np.random.Generator, vehicle: Vehicle, sensors: tuple[Sensor, ...], number: int, *, length: float, day: float,
    command_hz: float, scale: float, size: tuple[float, float, float], memory: float, waves: float,
    kind: str, limits: str,
) -> Run:  # fmt: skip
    """A run with all its chance drawn, before it is simulated."""
    before = round(scale * float(rng.uniform(3.0, 8.0)), 2) if rng.random() < 0.3 else 0.0
    late = max(sensor.latency for sensor in sensors)
    before = max(before, late)
    time = np.round(np.arange(int((before + length) * command_hz) + 1) / command_hz, 6)
    if vehicle.ship.length:
        kind = kind or "ship zigzag"
        before = late
    else:
        drawn = "steps" if number == 0 else str(rng.choice(KINDS, p=[0.25, 0.15, 0.15, 0.15, 0.15, 0.15]))
        kind = kind or drawn
    programme = limited(plan(rng, vehicle, kind, time), limits)
    heading_noise = sensors[0].noise
    errors = rng.normal(0.0, 1.0, (time.size, 2)) * (heading_noise, 0.02 * vehicle.full[2])
    start = float(rng.uniform(-np.pi, np.pi))
    step = min(*vehicle.time_constants, memory, 2.0 * np.pi / waves if waves else np.inf) / 16.0
    points = math.ceil((before + length) / step) + 3
    series = np.zeros((points, 5))
    for axis in range(3):
        series[:, axis] = size[axis] * _coloured(rng, points, step, memory)
    if waves:
        at = step * np.arange(points)
        for axis in range(3):
            parts = [_coloured(rng, points, step, 8.0 / waves) for _ in range(2)]
            series[:, axis] += size[axis] * (parts[0] * np.sin(waves * at) + parts[1] * np.cos(waves * at))
    return Run(
        kind=programme.kind, day=day, length=length, before=before, heading=start, sent=time, demands=programme.demands,
        setpoints=programme.setpoints + start, errors=errors, pilot=programme.pilot,
        commands=np.zeros((time.size, len(vehicle.channels))),
        stamps=tuple(sensor.stamps(length, rng) for sensor in sensors), step=step, series=series,
    )  # fmt: skip


def _coloured(rng: np.random.Generator, count: int, step: float, memory: float) -> Floats:
    """First-order Gauss-Markov noise (count,) of unit variance."""
    keep = math.exp(-step / memory)
    drive = rng.normal(0.0, math.sqrt(1.0 - keep * keep), count)
    drive[0] = rng.normal()
    result: Floats = lfilter([1.0], [1.0, -keep], drive)
    return result


def with_current(campaign: Campaign) -> Campaign:
    """Campaign with the cause's current in the series of its runs, constant or wandering."""
    cause = campaign.cause
    if cause is None or not cause.current:
        return campaign
    north, east = cause.current * math.cos(cause.direction), cause.current * math.sin(cause.direction)
    runs = []
    last = np.zeros(2)
    end = -math.inf
    for number, run in enumerate(campaign.runs):
        rng = np.random.default_rng([campaign.seed, campaign.index, number, 11])
        series = run.series.copy()
        series[:, 3], series[:, 4] = north, east
        if cause.memory:
            # Half as large as the mean; the wandering goes on between the runs.
            keep = math.exp(-run.step / cause.memory)
            between = math.exp(-max(run.day - end, 0.0) / cause.memory)
            last = between * last + rng.normal(0.0, 0.5 * cause.current * math.sqrt(1.0 - between**2), 2)
            noise = rng.normal(0.0, 0.5 * cause.current * math.sqrt(1.0 - keep * keep), (len(series), 2))
            noise[0] = last
            wander = lfilter([1.0], [1.0, -keep], noise, axis=0)
            series[:, 3:] += wander
            last, end = wander[-1], run.day + run.before + run.length
        runs.append(replace(run, series=series))
    return replace(campaign, runs=tuple(runs))


def hull_of(campaign: Campaign) -> Hull:
    """The hull with what the cause changes."""
    changes = dict(campaign.cause.hull) if campaign.cause else {}
    return campaign.vehicle.hull._replace(**changes)


def simulated(
    campaign: Campaign, *, hull: Hull | None = None, plain: bool = False, replay: bool = False, still: bool = False,
    offsets: Floats | None = None, refine: float = 1.0,
) -> Campaign:  # fmt: skip
    """The campaign with its runs simulated.

    Parameters
    ----------
    hull
        Instead of the campaign's own.
    plain
        Without the cause.
    replay
        Send the recorded commands again, whatever a pilot would see.
    still
        Without disturbances; the current stays.
    offsets
        Added to the first state of each run (6,).
    refine
        Steps of the integration are shorter by this factor.
    """
    cause = None if plain else campaign.cause
    vehicle = campaign.vehicle
    used = hull or (vehicle.hull if plain else hull_of(campaign))
    rows = rows_with(vehicle, cause)
    lags = [lag for lag in rows[:, 6] if lag > 0.0]
    longest = min([min(vehicle.time_constants) / 25.0, *(lag / 6.0 for lag in lags)]) / refine
    delay = cause.delay if cause else 0.0
    done = []
    for run in campaign.runs:
        times, kinds, places, spans = _events(run, campaign.sensors, delay)
        series = run.series
        if plain or still:
            series = series.copy()
            series[:, :3] *= 0.0 if still else 1.0
            series[:, 3:] *= 0.0 if plain else 1.0
        state = np.zeros(N_STATE + len(vehicle.actuators))
        state[2] = run.heading
        if vehicle.ship.length:
            # The thrust, and so the speed, of the programme's start on a straight course.
            state[3] = vehicle.full[0] * math.sqrt(run.demands[0, 0])
        if offsets is not None:
            state[:N_STATE] += offsets
        record = np.zeros((spans[-1], 6))
        commands = run.commands.copy()
        simulate(
            used, vehicle.ship, run.pilot, rows, vehicle.rests(), vehicle.commands, vehicle.thrusts,
            vehicle.allocation, vehicle.limits, vehicle.decimals, times, kinds, places, run.demands, run.setpoints,
            run.errors, replay, commands, series, run.step, longest, state, record,
        )  # fmt: skip
        truth = tuple(record[a:b] for a, b in pairwise(spans))
        done.append(replace(run, commands=commands, truth=truth))
    return replace(campaign, runs=tuple(done))


def _events(run: Run, sensors: tuple[Sensor, ...], delay: float) -> tuple[Floats, Ints, Ints, list[int]]:
    """Events of a run in order: instants in s of the simulation, kinds, places; where each sensor's records begin."""
    instants = [run.before + stamps - sensor.latency for stamps, sensor in zip(run.stamps, sensors, strict=True)]
    spans = [0, *np.cumsum([one.size for one in instants]).tolist()]
    times = np.concatenate([run.sent, run.sent + delay, *instants])
    kinds = np.repeat([SEND, ARRIVE, RECORD], [run.sent.size, run.sent.size, spans[-1]])
    places = np.concatenate([np.arange(run.sent.size), np.arange(run.sent.size), np.arange(spans[-1])])
    order = np.lexsort((kinds, times))
    return times[order], kinds[order].astype(np.int64), places[order].astype(np.int64), spans


def current_at(campaign: Campaign, run: Run, sensor: int) -> Floats:
    """Current (m, 2) at a sensor's true instants."""
    grid = run.step * np.arange(run.series.shape[0])
    at = run.before + run.stamps[sensor] - campaign.sensors[sensor].latency
    return np.column_stack([np.interp(at, grid, run.series[:, k]) for k in (3, 4)])


def change(campaign: Campaign) -> float:
    """Largest change of a velocity over ground by the hidden cause, per cent, in a free run of the same commands.

    Root mean square of the change over that of the velocity with the cause; the largest of surge, sway, yaw rate.
    """
    plain = simulated(campaign, plain=True, replay=True)
    away, size = np.zeros(3), np.zeros(3)
    for run, other in zip(campaign.runs, plain.runs, strict=True):
        a, b = run.truth[0], other.truth[0]
        psi, flow = a[:, 2], current_at(campaign, run, 0)
        over = a[:, 3:].copy()
        over[:, 0] += np.cos(psi) * flow[:, 0] + np.sin(psi) * flow[:, 1]
        over[:, 1] += -np.sin(psi) * flow[:, 0] + np.cos(psi) * flow[:, 1]
        away += np.sum((over - b[:, 3:]) ** 2, axis=0)
        size += np.sum(over**2, axis=0)
    return float(100.0 * np.sqrt(away / size).max())
