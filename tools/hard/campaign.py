"""A campaign from a seed: a vehicle, its weather, its instruments, its runs, and what is hidden in them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tools.hard import layout as at
from tools.hard.causes import ALONE, COUPLES, EFFECTS, MAKERS, NEEDS_RUNS, NOT_WITH_COUPLES, NOT_WITH_PODS, Cause, Scene
from tools.hard.drives import Drive, draw_drive
from tools.hard.layout import Floats, Ints, no_cause
from tools.hard.motion import run as simulate
from tools.hard.sea import Sea, draw_sea
from tools.hard.sensors import Instruments, Log, draw_instruments, read
from tools.hard.thrust import rotor_step
from tools.hard.vehicles import VEHICLES, Vehicle

# What needs way on to show at all.
FAST = frozenset({"speed_dependent_damping", "advance_speed_loss", "sideslip_moment"})
CLOCK = 1_751_600_000.0  # s, when the first day of all began


@dataclass(frozen=True)
class Run:
    """One run: how it was driven, what was true, what was logged."""

    drive: Drive
    start: float  # s since the first run's start
    step: float
    record: Floats
    commands: Floats
    cause: Floats
    series: Floats
    log: Log


@dataclass(frozen=True)
class Campaign:
    """All of a campaign; what a user would have of it goes through `write_campaign`."""

    seed: int
    vehicle: Vehicle
    sea: Sea
    instruments: Instruments
    runs: tuple[Run, ...]
    cause: Cause | None
    one_way: bool
    format: str  # "csv", "mcap" or "mixed"
    clock: str  # of CSV: "relative", "epoch" or "iso"
    facts: dict[str, Any] = field(default_factory=dict)

    def truth(self) -> dict[str, Any]:
        """What is true of it, for JSON."""
        linear, quadratic = self.vehicle.yaw_drag
        hidden = None
        if self.cause:
            hidden = {"effect": self.cause.effect, "form": self.cause.form, "strength": self.cause.strength,
                      "sizes": self.cause.sizes}  # fmt: skip
        return {
            "seed": self.seed,
            "vehicle": self.vehicle.key,
            "time_constant": self.vehicle.time_constant,
            "parameters": {
                "inertia": self.vehicle.total_inertia, "quadratic_drag": quadratic, "linear_drag": linear,
            },
            "rotor_seconds": self.vehicle.rotor_share * self.vehicle.time_constant,
            "advance_loss": self.vehicle.loss,
            "hidden": hidden,
            "one_way": self.one_way,
            "drives": [run.drive.kind for run in self.runs],
            "samples": sum(run.log.time.size for run in self.runs),
            "seconds": sum(float(run.log.time[-1]) for run in self.runs),
            "waves": self.sea.waves,
            "speed_logged": self.instruments.speed,
            "rate_logged": self.instruments.gyro,
            "format": self.format,
            **self.facts,
        }  # fmt: skip


@dataclass(frozen=True)
class _Plan:
    """A run before its simulation. All random numbers are drawn: the run can be simulated with and without a cause."""

    drive: Drive
    start: float
    heading: float
    steps: int
    every: int
    step: float
    series_seed: int
    noise: Floats
    rate_noise: Floats
    jitter: Floats
    alone: int  # the one thruster that turns the vehicle in this run, or -1


def draw(
    seed: int, vehicle: str | Vehicle | None = None, effect: str | None = None, share_without: float = 1 / 3
) -> Campaign:
    """Draw a campaign, of a kind of ``vehicle`` or that very one; ``effect`` is what is hidden, "none" for nothing."""
    rng = np.random.default_rng([seed, 18])
    if isinstance(vehicle, Vehicle):
        key, chosen = vehicle.key, vehicle
    else:
        key = vehicle or str(rng.choice(list(VEHICLES)))
        chosen = VEHICLES[key].varied(rng)
    nothing = rng.random() < share_without
    pods = any(one.pod_angle for one in chosen.thrusters)
    runs = int(rng.choice([1, 1, 2, 2, 3, 4, 5, 6, 8]))
    barred = (NOT_WITH_PODS if pods else frozenset()) | (NEEDS_RUNS if runs == 1 else frozenset())
    barred |= NOT_WITH_COUPLES if key in COUPLES else frozenset()
    able = [name for name in EFFECTS if name not in barred]
    hidden = effect or ("none" if nothing else str(rng.choice(able)))
    if hidden in NEEDS_RUNS | ALONE:
        runs = max(runs, 3)
    sea = draw_sea(chosen, rng)
    tau = chosen.time_constant
    lengths = np.exp(rng.uniform(np.log(40.0), np.log(180.0), runs)) * tau
    rate = float(np.clip(2000.0 / lengths.sum(), *chosen.sample_rate))
    if lengths.sum() * rate < 2000.0:
        rate = float(min(2000.0 / lengths.sum(), 20.0))
    rate = float(np.clip(rate, None, 30000.0 / lengths.sum()))
    instruments = draw_instruments(chosen, rate, rng)
    plans, one_way = _plans(chosen, hidden, lengths, 1.0 / rate, instruments, rng)
    first = _simulated(chosen, sea, plans[0], None, 0)
    usual = np.sqrt(np.mean(first[0] ** 2, axis=0))
    cause = None
    if hidden != "none":
        scene = Scene(
            vehicle=chosen, rng=rng, runs=runs, span=plans[-1].start + plans[-1].steps * plans[-1].step,
            command=max(float(np.sqrt(np.mean(first[1][:, 0] ** 2))), 0.02),
            speed=max(float(usual[at.R_SURGE]), 0.05 * chosen.length / tau),
            sway=max(float(usual[at.R_SWAY]), 0.01 * chosen.length / tau),
        )  # fmt: skip
        cause = MAKERS[hidden](scene, float(rng.beta(1.7, 1.0)))
    done = []
    for index, plan in enumerate(plans):
        record, commands, law, series = _simulated(chosen, sea, plan, cause, index)
        log = read(record, commands, plan.step, plan.every, law, chosen, sea, instruments, plan.noise, plan.rate_noise,
                   plan.jitter, np.random.default_rng([seed, 19, index]))  # fmt: skip
        done.append(Run(plan.drive, plan.start, plan.step, record, commands, law, series, log))
    form = str(rng.choice(["csv", "csv", "csv", "mcap", "mixed"])) if runs > 1 else str(rng.choice(["csv", "mcap"]))
    clock = str(rng.choice(["relative", "relative", "epoch", "iso"]))
    return Campaign(seed, chosen, sea, instruments, tuple(done), cause, one_way, form, clock)


def _plans(vehicle: Vehicle, hidden: str, lengths: Floats, tick: float, instruments: Instruments,
           rng: np.random.Generator) -> tuple[list[_Plan], bool]:  # fmt: skip
    tau = vehicle.time_constant
    main = str(rng.choice(["open", "autopilot", "zigzag", "stick"], p=[0.5, 0.17, 0.13, 0.2]))
    if hidden in ALONE:
        main = "open"
    one_way = main == "open" and bool(rng.random() < 0.2)
    every = max(1, int(np.ceil(tick / (tau / 60.0))))
    least, most = vehicle.cruise
    wide = hidden in FAST or bool(rng.random() < 0.2)
    if wide:
        least, most = 0.8 * most, 1.8 * most
    turning = [index for index, one in enumerate(vehicle.thrusters) if one.yaw]
    often = 0.6 if hidden in ALONE else 0.1
    start = 0.0
    plans = []
    for seconds in lengths.tolist():
        ticks = int(seconds / tick)
        mode = main if rng.random() < 0.75 else str(rng.choice(["open", "autopilot", "zigzag", "stick"]))
        heading = float(rng.uniform(-np.pi, np.pi))
        cruise = float(rng.uniform(least, most))
        drive = draw_drive(vehicle, "open" if one_way else mode, ticks, tick, heading, cruise, one_way, wide, rng)
        alone = int(rng.choice(turning)) if drive.mode == at.OPEN_LOOP and rng.random() < often else -1
        noise, rate_noise, jitter = instruments.noise(ticks, tick, tau, rng)
        plans.append(
            _Plan(drive, start, heading, ticks * every, every, tick / every, int(rng.integers(2**31)), noise,
                  rate_noise, jitter, alone)
        )  # fmt: skip
        start += seconds + float(rng.uniform(20.0, 200.0)) * tau
    return plans, one_way


def _simulated(
    vehicle: Vehicle, sea: Sea, plan: _Plan, cause: Cause | None, index: int
) -> tuple[Floats, Floats, Floats, Floats]:
    """Record, commands, the cause's array and the weather's series of a run."""
    rng = np.random.default_rng(plan.series_seed)
    series = sea.series(plan.step / 2, 2 * plan.steps + 3, cause.swell_frequency if cause else 0.0, rng)
    ticks = plan.steps // plan.every
    law = cause.array(index, plan.start) if cause else no_cause()
    delays: Ints = np.zeros(ticks, dtype=np.int64)
    if cause and cause.delay:
        jitter = cause.jitter * rng.uniform(-1.0, 1.0, ticks)
        delays = np.round(cause.delay * (1.0 + jitter) / plan.step).astype(np.int64)
    nominal = rotor_step(vehicle.rotor_share * vehicle.time_constant, 0.0, plan.step / 2)
    slow = rotor_step(cause.rotor, cause.rotor_damping, plan.step / 2) if cause and cause.rotor else nominal
    count = len(vehicle.thrusters)
    rotors = np.stack([np.stack([slow] * count), np.stack([nominal] * count)])
    thrusters = np.stack([one.row(vehicle.loss) for one in vehicle.thrusters])
    record = np.zeros((plan.steps, at.N_RECORD))
    commands = np.zeros((ticks, count))
    start = np.array([0.0, 0.0, 0.0, plan.heading, 0.0, 0.0])
    drive = plan.drive
    yaw = np.array([one.yaw if plan.alone in {-1, index} else 0.0 for index, one in enumerate(vehicle.thrusters)])
    simulate(
        start, plan.step, plan.every, vehicle.hull(), thrusters, sea.weather(vehicle), series, law, no_cause(), rotors,
        delays, yaw, np.array([one.surge for one in vehicle.thrusters]),
        vehicle.fineness, drive.mode, drive.pilot, drive.wanted, drive.surge, drive.decide, plan.noise, plan.rate_noise,
        record, commands,
    )  # fmt: skip
    return record, commands, law, series
