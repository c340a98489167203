"""A campaign from a seed and an index: a vehicle, its runs, what is logged of them, and what is hidden in them."""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from tools.wide.causes import FORMS, NEEDS_QUADRATIC, NEEDS_SPEED, NEEDS_TURNS, Cause, Scene, make
from tools.wide.motion import ARRIVE, N_SERIES, SAMPLE, SEND, Floats, Ints, Physics, Pilot, simulate
from tools.wide.programme import KINDS, demand
from tools.wide.vehicle import Vehicle, draw_vehicle, log_uniform

FORMATS = ("csv", "csv_pair", "mcap")
STARTS = ("rest", "under_way", "step")
CLOCKS = ("relative", "day", "epoch", "iso")
NOTHING = "none"
RATES = (1.0, 2.0, 2.5, 4.0, 5.0, 8.0, 10.0, 12.5, 16.0, 20.0, 25.0, 40.0, 50.0, 62.5, 80.0, 100.0)  # Hz
_SHARE_NOTHING = 0.25
_MOST_SAMPLES = 40_000  # readings of the heading in a campaign
_LEAST_SAMPLES = 8.0  # in a time constant
VISIBLE = 0.03  # change of the yaw rate (root mean square) from which a cause counts as visible
_TOO_MUCH = 1.5  # change above which a weaker cause is drawn
_SUBSTEPS = 50.0  # in a time constant
_SHORTEST = 10.0  # steps in the shortest time of the cause


@dataclass(frozen=True, kw_only=True)
class Run:
    """One run.

    ``sent`` (k,) s and ``commands`` (k, n) as shares are all commands, also those before the log began at 0. ``time``
    (m,) s are the instants of the heading. ``logged`` marks the commands that are in the log. ``series`` (p, N_SERIES)
    begins at ``series_begin`` and has a step of ``series_step``, in s. ``truth`` (m, 4) is the record of the
    simulation.
    """

    kind: str
    start: str
    day: float  # s since the first log began
    heading: float  # rad, before the first command
    time: Floats
    sent: Floats
    delays: Floats  # of each command, as multiples of the cause's delay
    commands: Floats
    pilot: Pilot
    mix: Floats
    series_begin: float
    series_step: float
    series: Floats
    wave_seed: int
    truth: Floats

    @property
    def logged(self) -> slice:
        """The commands from the last one that is not after the log's begin."""
        return slice(max(int(np.searchsorted(self.sent, 1e-9, side="right")) - 1, 0), None)


@dataclass(frozen=True, kw_only=True)
class Campaign:
    """All of a campaign; a user has of it what `write_campaign` writes."""

    seed: int
    index: int
    vehicle: Vehicle
    cause: Cause | None
    physics: Physics
    plain: Physics
    runs: tuple[Run, ...]
    heading_hz: float
    command_hz: float
    format: str
    clock: str
    noise: float  # rad, of the heading
    rate_noise: float  # rad/s; 0: no rate in the log
    speed: float  # m/s, typical ahead; 0: not logged
    sway: float
    voltage: float  # V; 0: not logged
    disturbance: float  # N m
    memory: float  # s, of the disturbance
    scale: float  # s

    @property
    def longest(self) -> float:
        """Longest step of the integration in s."""
        shortest = self.cause.shortest if self.cause else math.inf
        return min(self.vehicle.time_constant / _SUBSTEPS, shortest / _SHORTEST)


def draw(seed: int, index: int, effect: str | None = None, form: str | None = None) -> Campaign:
    """Draw a campaign; ``effect`` is what is hidden, "none" for nothing, by default a random one or nothing."""
    rng = np.random.default_rng([seed, index, zlib.crc32(b"wide")])
    if effect is None:
        effect = NOTHING if rng.random() < _SHARE_NOTHING else str(rng.choice(list(FORMS)))
    if effect != NOTHING and form is None:
        form = str(rng.choice(FORMS[effect]))
    strength = float(rng.uniform())
    vehicle = draw_vehicle(
        rng,
        least_thrusters=2 if effect == "thruster_imbalance" else 1,
        turns=effect in NEEDS_TURNS,
        quadratic=effect in NEEDS_QUADRATIC,
    )
    needs_speed = (effect, form) in NEEDS_SPEED
    with_speed = needs_speed or bool(rng.random() < 0.15)
    with_voltage = (effect, form) == ("supply_sag", "voltage") or bool(rng.random() < 0.1)
    speed = 0.5 * vehicle.length * vehicle.full_rate * log_uniform(rng, 0.5, 3.0)
    sway = speed * float(rng.uniform(0.1, 0.4))
    cause_seed = int(rng.integers(2**31))
    tau = vehicle.time_constant

    def cause_of(strength: float, longest_run: float, day: float, fastest: float) -> Cause | None:
        if effect == NOTHING or form is None:
            return None
        scene = Scene(vehicle, np.random.default_rng(cause_seed), longest_run, day, speed, sway, fastest)
        return make(scene, effect, form, strength)

    cause = cause_of(strength, 1.0, 1.0, 1.0)
    scale = tau + (cause.slow if cause else 0.0)
    least = next((rate for rate in RATES if rate >= _LEAST_SAMPLES / tau - 1e-9), RATES[-1])
    count = int(rng.choice([2, 2, 3, 4, 5, 6, 8, 10, 12]))
    if form == "day":
        count = max(count, 4)
    total = min(log_uniform(rng, 120.0, 400.0) * scale, _MOST_SAMPLES / least)
    lengths = total / count * rng.uniform(0.8, 1.2, count)
    fit = [rate for rate in RATES if least <= rate <= _MOST_SAMPLES / lengths.sum()] or [least]
    heading_hz = float(rng.choice(fit))
    log_format = str(rng.choice(FORMATS, p=[0.5, 0.35, 0.15]))
    command_hz = _command_rate(rng, log_format, heading_hz, tau)
    days = np.concatenate([[0.0], np.cumsum(lengths[:-1] + rng.uniform(5.0, 60.0, count - 1) * scale)])
    starts = _starts(rng, count, settled=effect == "tether_torsion")
    one_way = bool(rng.random() < 0.08)
    disturbance = vehicle.torque * log_uniform(rng, 0.003, 0.03)
    memory = tau * log_uniform(rng, 0.3, 10.0)
    runs = [
        _planned(
            rng, vehicle, scale=scale, length=float(lengths[k]), day=float(days[k]), start=starts[k],
            heading_hz=heading_hz, command_hz=command_hz, aligned=log_format == "csv", one_way=one_way,
            alone=0.6 if effect == "thruster_imbalance" else 0.2, first=k == 0,
            exogenous=(disturbance, memory, speed if with_speed else 0.0, sway if with_speed else 0.0,
                       with_voltage, float(days[-1] + lengths[-1])),
        )
        for k in range(count)
    ]  # fmt: skip
    fastest = 2.0 * math.pi * heading_hz / 10.0
    plain = Physics(
        inertia=vehicle.inertia, quadratic=vehicle.quadratic_drag, linear=vehicle.linear_drag,
        sway_time=tau * float(rng.uniform(0.5, 3.0)),
        sway_gain=float(rng.uniform(0.1, 0.5)) * sway / (speed * vehicle.full_rate),
    )  # fmt: skip
    settings = {
        "seed": seed, "index": index, "vehicle": vehicle, "plain": plain, "heading_hz": heading_hz,
        "command_hz": command_hz, "format": log_format,
        "clock": str(rng.choice(CLOCKS if form != "day" else CLOCKS[1:])),
        "noise": vehicle.full_rate * tau * log_uniform(rng, 3e-4, 1e-2),
        "rate_noise": vehicle.full_rate * log_uniform(rng, 0.003, 0.03) if rng.random() < 0.25 else 0.0,
        "speed": speed if with_speed else 0.0, "sway": sway if with_speed else 0.0,
        "voltage": float(rng.choice([12.0, 24.0, 48.0, 400.0])) if with_voltage else 0.0,
        "disturbance": disturbance, "memory": memory, "scale": scale,
    }  # fmt: skip
    for _ in range(6):
        cause = cause_of(strength, float(lengths.max()), float(days[-1] + lengths[-1]), fastest)
        physics = plain._replace(**cause.physics) if cause else plain
        campaign = simulated(Campaign(cause=cause, physics=physics, runs=tuple(runs), **settings))  # type: ignore[arg-type]
        shown = rate_change(campaign)
        if cause is None or VISIBLE <= shown <= _TOO_MUCH:
            break
        strength = 0.5 * (strength + 1.0) if shown < VISIBLE else 0.6 * strength
    return campaign


def _command_rate(rng: np.random.Generator, log_format: str, heading_hz: float, tau: float) -> float:
    """Commands a second: of the heading's grid in one table, any elsewhere; at least one in a time constant."""
    if log_format == "csv":
        ratios = [ratio for ratio in (0.1, 0.2, 0.5, 1.0, 1.0, 2.0) if heading_hz * ratio >= 1.0 / tau]
        return heading_hz * float(rng.choice(ratios))
    return float(rng.choice([rate for rate in RATES if 1.0 / tau <= rate <= 4.0 * heading_hz] or [heading_hz]))


def _starts(rng: np.random.Generator, count: int, *, settled: bool) -> list[str]:
    """How each log begins: all in one way, or mixed. ``settled``: no log begins under way."""
    odds = [0.6, 0.0, 0.4] if settled else [0.45, 0.3, 0.25]
    if rng.random() < 0.7:
        return [str(rng.choice(STARTS, p=odds))] * count
    return [str(start) for start in rng.choice(STARTS, count, p=odds)]


def _planned(
    rng: np.random.Generator, vehicle: Vehicle, *, scale: float, length: float, day: float, start: str,
    heading_hz: float, command_hz: float, aligned: bool, one_way: bool, alone: float, first: bool,
    exogenous: tuple[float, float, float, float, bool, float],
) -> Run:  # fmt: skip
    """A run with all its chance drawn, before it is simulated."""
    time = np.round(np.arange(int(length * heading_hz) + 1) / heading_hz, 6)
    kind = "holds" if first else str(rng.choice(KINDS, p=[0.2, 0.2, 0.2, 0.2, 0.1, 0.1]))
    before = scale * float(rng.uniform(5.0, 15.0)) if start == "under_way" else 0.0
    phase = 0.0 if aligned or start == "step" else round(float(rng.uniform(0.0, 1.0 / command_hz)), 4)
    early = math.ceil(before * command_hz) + (1 if phase else 0)
    sent = np.round(phase + np.arange(-early, int((length - phase) * command_hz) + 1) / command_hz, 6)
    rest = scale * float(rng.uniform(1.0, 4.0)) if start == "rest" else -before
    wanted = demand(rng, kind if kind != "zigzag" else "steps", sent - rest, scale, one_way)
    signs = np.sign(vehicle.arms)
    if signs.size > 1 and rng.random() < alone:
        kept = rng.permutation(signs.size) < int(rng.integers(1, signs.size))
        signs = signs * kept
    commands = vehicle.rounded(wanted[:, np.newaxis] * signs)
    share = float(rng.uniform(0.4, 1.0))
    mix = vehicle.rounded(share * signs)
    angle = vehicle.full_rate * share * scale * float(rng.uniform(0.8, 2.5)) if kind == "zigzag" else 0.0
    begin = float(min(sent[0], 0.0))
    step, series = _series(rng, vehicle.time_constant, scale, length - begin, exogenous, day + begin)
    return Run(
        kind=kind, start=start, day=day, heading=float(rng.uniform(-np.pi, np.pi)), time=time, sent=sent,
        delays=rng.uniform(0.0, 2.0, sent.size), commands=commands, pilot=Pilot(angle=angle, demand=1.0),
        mix=mix, series_begin=begin, series_step=step, series=series, wave_seed=int(rng.integers(2**31)),
        truth=np.zeros((time.size, 4)),
    )  # fmt: skip


def _series(
    rng: np.random.Generator, tau: float, scale: float, length: float,
    exogenous: tuple[float, float, float, float, bool, float], since: float,
) -> tuple[float, Floats]:  # fmt: skip
    """Step in s and series of the disturbance in N m, speeds in m/s and relative voltage."""
    size, memory, speed, sway, with_voltage, day = exogenous
    step = min(tau, memory) / 12.0
    count = math.ceil(length / step) + 3
    series = np.zeros((count, N_SERIES))
    series[:, 0] = size * _coloured(rng, count, step, memory)
    series[:, 3] = 1.0
    if speed:
        series[:, 1] = _levels(rng, count, step, 5.0 * scale, tau, (0.0, 0.4 * speed, speed, 1.5 * speed, -0.5 * speed))
        series[:, 2] = _levels(rng, count, step, 5.0 * scale, tau, (0.0, sway, -sway, 1.5 * sway, -1.5 * sway))
    if with_voltage:
        levels = _levels(rng, count, step, 8.0 * scale, tau, (1.08, 1.03, 0.97, 0.9))
        series[:, 3] = levels * (1.0 - 0.1 * (since + step * np.arange(count)) / day)
    return step, series


def _coloured(rng: np.random.Generator, count: int, step: float, memory: float) -> Floats:
    """First-order Gauss-Markov noise (count,) of unit variance."""
    keep = math.exp(-step / memory)
    drive = rng.normal(0.0, math.sqrt(1.0 - keep * keep), count)
    drive[0] = rng.normal()
    result: Floats = lfilter([1.0], [1.0, -keep], drive)
    return result


def _levels(
    rng: np.random.Generator, count: int, step: float, held: float, smooth: float, levels: Sequence[float]
) -> Floats:
    """Random levels (count,), each held for about ``held`` s, behind a first-order lag of ``smooth`` s."""
    each = max(int(held / step), 1)
    values = np.repeat(rng.choice(levels, count // each + 2), each)[int(rng.integers(each)) :][:count]
    keep = math.exp(-step / smooth)
    result: Floats = lfilter([1.0 - keep], [1.0, -keep], values, zi=[keep * values[0]])[0]
    return result


def simulated(
    campaign: Campaign, physics: Physics | None = None, *, replay: bool = False, refine: float = 1.0
) -> Campaign:
    """The campaign with its runs simulated.

    Parameters
    ----------
    physics
        Instead of the campaign's own. The cause's delay and wave do not act with it, and steps suit the vehicle alone.
    replay
        Send the recorded commands again, whatever a zigzag's pilot would see.
    refine
        Steps of the integration are shorter by this factor.
    """
    cause = campaign.cause if physics is None else None
    used = campaign.physics if physics is None else physics
    longest = (campaign.longest if physics is None else campaign.vehicle.time_constant / _SUBSTEPS) / refine
    vehicle = campaign.vehicle
    thrusters = np.column_stack([vehicle.full_thrusts, vehicle.zones, vehicle.arms])
    x = np.ascontiguousarray(np.broadcast_to(vehicle.commands, vehicle.thrusts.shape))
    middle = float(np.median(np.concatenate([run.series[:, 3] for run in campaign.runs])))
    done = []
    for run in campaign.runs:
        times, kinds, places = _events(run, cause)
        begin, step, series = run.series_begin, run.series_step, run.series.copy()
        if cause and cause.wave:
            step, series = _with_waves(cause, run)
        series[:, 3] /= middle
        commands, record = run.commands.copy(), np.zeros((run.time.size, 4))
        simulate(
            used, Pilot() if replay else run.pilot, thrusters, x, vehicle.thrusts, times, kinds, places, commands,
            run.mix, begin, step, series, run.heading, run.day, longest, record,
        )  # fmt: skip
        done.append(replace(run, commands=commands, truth=record))
    return replace(campaign, runs=tuple(done))


def _events(run: Run, cause: Cause | None) -> tuple[Floats, Ints, Ints]:
    """Events of a run in order: instants in s, kinds and places."""
    arrive = run.sent
    if cause and cause.delay:
        wait = cause.delay * (1.0 + cause.jitter * (run.delays - 1.0))
        arrive = np.maximum.accumulate(run.sent + wait)
    times = np.concatenate([run.sent, arrive, run.time])
    kinds = np.repeat([SEND, ARRIVE, SAMPLE], [run.sent.size, run.sent.size, run.time.size])
    places = np.concatenate([np.arange(run.sent.size), np.arange(run.sent.size), np.arange(run.time.size)])
    order = np.lexsort((kinds, times))
    order = order[times[order] <= run.time[-1] + 1e-9]
    return times[order], kinds[order].astype(np.int64), places[order].astype(np.int64)


def _with_waves(cause: Cause, run: Run) -> tuple[float, Floats]:
    """Step in s and series on a finer grid, with a sine or a narrow band of waves in the torque."""
    rng = np.random.default_rng(run.wave_seed)
    length = run.series_step * (run.series.shape[0] - 1)
    step = min(run.series_step, 0.05 / cause.wave_frequency)
    grid = np.arange(math.ceil(length / step) + 1) * step
    old = np.arange(run.series.shape[0]) * run.series_step
    series = np.column_stack([np.interp(grid, old, run.series[:, j]) for j in range(N_SERIES)])
    phase = cause.wave_frequency * grid + float(rng.uniform(0.0, 2.0 * np.pi))
    if cause.wave_damping:
        memory = 1.0 / (cause.wave_damping * cause.wave_frequency)
        sine, cosine = (_coloured(rng, grid.size, step, memory) for _ in range(2))
        series[:, 0] += cause.wave / math.sqrt(2.0) * (sine * np.sin(phase) + cosine * np.cos(phase))
    else:
        series[:, 0] += cause.wave * np.sin(phase)
    return step, series


def deviation(cause: Cause | None, heading: Floats) -> Floats:
    """What the compass adds to the heading (m,), in rad."""
    if cause is None:
        return np.zeros(heading.size)
    first = cause.once * np.sin(heading + cause.once_phase)
    result: Floats = first + cause.twice * np.sin(2.0 * heading + cause.twice_phase)
    return result


def rate_change(campaign: Campaign) -> float:
    """Change of the yaw rate that the cause makes, root mean square over that of the rate without it.

    The same commands and the same disturbance act with and without the cause. A deviation of the compass counts by the
    rate that it shows.
    """
    if campaign.cause is None:
        return 0.0
    plain = simulated(campaign, campaign.plain, replay=True)
    change, size = 0.0, 0.0
    for run, without in zip(campaign.runs, plain.runs, strict=True):
        psi, rate = run.truth[:, 0], run.truth[:, 1]
        slope = campaign.cause.once * np.cos(psi + campaign.cause.once_phase)
        slope += 2.0 * campaign.cause.twice * np.cos(2.0 * psi + campaign.cause.twice_phase)
        change += float(np.sum((rate * (1.0 + slope) - without.truth[:, 1]) ** 2))
        size += float(np.sum(without.truth[:, 1] ** 2))
    return math.sqrt(change / size)
