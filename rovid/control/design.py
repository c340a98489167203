"""One controller for one identified vehicle: its gains, its margins, and its closed-loop runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rovid.campaign.vehicle import Thruster, Vehicle
from rovid.control.allocation import Allocation, allocate
from rovid.control.law import Law, holds
from rovid.control.loop import Course, Plant, run_closed
from rovid.control.measures import Measures, measure
from rovid.control.tuning import (
    BANDWIDTHS,
    Loop,
    Margins,
    actuators,
    damping_ratio,
    drawn,
    gains,
    largest_bandwidth,
    linearised,
)
from rovid.ground.arrays import FloatArray
from rovid.ground.errors import ConfigError, DataError
from rovid.model.model import Model
from rovid.parameters.parameters import Parameters

# Of the torque in use: of the disturbance that every run has, and of a current or waves where a run is about them.
_DISTURBANCE, _PUSH = 0.02, 0.1
_WAVE_PERIOD = 8.0  # s
# The rate's filter, as a share of one over the bandwidth and in periods of the controller.
_FILTER_SHARE, _FILTER_PERIODS = 0.05, 2.0
# rad of heading error that may ask for all the torque there is; share of the torque in use that the noise may ask for.
_FULL_TORQUE_ERROR, _NOISE_SHARE = 0.2, 0.1
# Of the paper's instrument, and of a vehicle that is known by its parameters alone.
_HEADING_NOISE, _MIDDLING_RATE = math.radians(0.01), 0.15
_DRAWS = 60
# A run lasts so many time constants of the slower closed-loop mode, and s at least.
_LENGTHS, _SHORTEST = 15.0, 60.0


@dataclass(frozen=True, kw_only=True)
class Options:
    """What the user asks for; see `rovid control --help`.

    Raises
    ------
    ConfigError
        A number is not what it has to be.
    """

    kp: float | None = None
    kd: float | None = None
    damping: float = 0.7
    bandwidth: float | None = None
    period: float = 0.1
    delay: float = 0.0
    rate_filter: float | None = None
    steps: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        positive = {"--kp": self.kp, "--damping": self.damping, "--bandwidth": self.bandwidth, "--period": self.period}
        for name, value in positive.items():
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"is {value:g}; a number above zero was expected.", where=name)
        for name, value in {"--kd": self.kd, "--delay": self.delay, "--rate-filter": self.rate_filter}.items():
            if value is not None and not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"is {value:g}; zero or a number above it was expected.", where=name)
        if (self.kp is None) != (self.kd is None):
            raise ConfigError("needs the other gain too.", where="--kp" if self.kd is None else "--kd")
        if self.kp is not None and self.bandwidth is not None:
            raise ConfigError("says what --kp and --kd say already.", where="--bandwidth", mend="Leave one out.")
        self.parsed_steps()

    def parsed_steps(self) -> list[tuple[float, float]]:
        """(from, to) in deg of each of ``steps``; to the nearest turn, as the controller takes the shorter way."""
        found = []
        for text in self.steps:
            first, _, last = text.partition(":")
            try:
                found.append((float(first), float(first) + math.remainder(float(last) - float(first), 360.0)))
            except ValueError as error:
                raise ConfigError(
                    f"is {text!r}; two headings in deg were expected, as in 20:120.", where="--step"
                ) from error
        return found


def setting_of(options: Options, model: Model, heading_noise: float | None, torque_in_use: float | None) -> Setting:
    """The loop's setting; a heading noise of 0.01 deg and the drag of a middling rate where no log says."""
    return Setting(
        period=options.period,
        delay=options.delay,
        rate_filter=options.rate_filter,
        heading_noise=_HEADING_NOISE if heading_noise is None else heading_noise,
        torque_in_use=model.drag(np.array(_MIDDLING_RATE)).item() if torque_in_use is None else torque_in_use,
    )


@dataclass(frozen=True, kw_only=True)
class Setting:
    """What the user and the logs say of the loop.

    Attributes
    ----------
    period, delay
        s; of the controller, and from a heading to the command that it leads to.
    rate_filter
        s, time constant of the low pass of the rate; None: chosen with the bandwidth.
    heading_noise, torque_in_use
        rad and N m.
    """

    period: float = 0.1
    delay: float = 0.0
    rate_filter: float | None = None
    heading_noise: float = 0.0
    torque_in_use: float


@dataclass(frozen=True, kw_only=True)
class Manoeuvre:
    """One run: from rest at ``start`` to ``wanted``, in deg; ``current`` and ``waves`` in N m."""

    name: str
    start: float
    wanted: float
    current: float = 0.0
    waves: float = 0.0


@dataclass(frozen=True, kw_only=True)
class RunResult:
    """One manoeuvre with the ``effects`` in the plant, with or without the aid, which knows of the effects or not.

    ``quiet`` is the run without noise, disturbance and waves.
    """

    name: str
    effects: tuple[str, ...]
    model_aid: bool
    effects_known: bool
    measures: Measures
    quiet: Course


@dataclass(frozen=True, kw_only=True)
class Spread:
    """Margins over the parameters' uncertainty: share of stable loops, and the bound that 95 % keep."""

    draws: int
    stable: float
    gain_db: float
    phase_deg: float
    delay_s: float
    sensitivity_peak: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Control:
    """A controller and what is known of its loop.

    Attributes
    ----------
    law
        With the full aid.
    damping, bandwidth
        Damping ratio and natural frequency in rad/s of gains and yaw inertia.
    lag
        s; all that delays the loop, at the crossover.
    """

    law: Law
    model: Model
    setting: Setting
    allocation: Allocation
    damping: float
    bandwidth: float
    lag: float
    margins: Margins
    spread: Spread | None
    runs: tuple[RunResult, ...]


def paper_runs() -> tuple[Manoeuvre, ...]:
    """The three closed-loop runs of Ramesh et al. 2013."""
    return (
        Manoeuvre(name="90 to 200 deg", start=90.0, wanted=200.0),
        Manoeuvre(name="20 to 120 deg", start=20.0, wanted=120.0),
        Manoeuvre(name="hold 120 deg, pushed to 100", start=100.0, wanted=120.0),
    )


def manoeuvres(steps: Sequence[tuple[float, float]], torque_in_use: float) -> tuple[Manoeuvre, ...]:
    """The paper's runs, the user's ``steps`` in deg, and a hold against current and waves."""
    push = _PUSH * torque_in_use
    return (
        *paper_runs(),
        *(Manoeuvre(name=f"{a:g} to {b % 360.0:g} deg", start=a, wanted=b) for a, b in steps),
        Manoeuvre(name="hold 120 deg, current sets in", start=120.0, wanted=120.0, current=push),
        Manoeuvre(name="hold 120 deg, waves", start=120.0, wanted=120.0, waves=push),
    )


def law_for(model: Model, allocation: Allocation, setting: Setting, kp: float, kd: float) -> Law:
    """The controller of these gains with all the aid that ``model`` gives."""
    bandwidth = math.sqrt(kp / model.inertia)
    own = max(_FILTER_SHARE / bandwidth, _FILTER_PERIODS * setting.period)
    return Law(
        kp=kp,
        kd=kd,
        period=setting.period,
        rate_filter=own if setting.rate_filter is None else setting.rate_filter,
        inertia=model.inertia,
        quadratic_drag=model.quadratic_drag,
        linear_drag=model.linear_drag,
        hold=holds(model),
        lowest=allocation.lowest,
        highest=allocation.highest,
    )


def unaided(law: Law) -> Law:
    """PD alone."""
    return Law(
        kp=law.kp,
        kd=law.kd,
        period=law.period,
        rate_filter=law.rate_filter,
        lowest=law.lowest,
        highest=law.highest,
    )


def loop_of(law: Law, model: Model, vehicle: Vehicle, allocation: Allocation, setting: Setting) -> Loop:
    """The loop of ``law`` about rest, at the amplitude of the torque in use."""
    return Loop(
        law=law,
        motion=linearised(model),
        actuators=actuators(model, vehicle, allocation, law.period, _amplitude(allocation, setting)),
        delay=setting.delay,
    )


def choose_bandwidth(model: Model, vehicle: Vehicle, allocation: Allocation, setting: Setting, damping: float) -> float:
    """The largest bandwidth in rad/s with comfortable margins that neither noise nor the actuators' limits forbid.

    Raises
    ------
    DataError
        There is none.
    """
    capacity = min(allocation.highest, -allocation.lowest)
    if not capacity > 0.0:
        raise DataError("the thrusters turn the vehicle one way only.", mend="Look at yaw_arm and curve in rovid.toml.")
    limit = math.sqrt(capacity / _FULL_TORQUE_ERROR / model.inertia)
    for bandwidth in BANDWIDTHS:
        law = law_for(model, allocation, setting, *gains(model.inertia, damping, float(bandwidth)))
        if law.kd * noise_of_rate(law, setting.heading_noise) > _NOISE_SHARE * setting.torque_in_use:
            limit = min(limit, float(bandwidth))
            break
    first = law_for(model, allocation, setting, *gains(model.inertia, damping, 1.0))
    template = loop_of(first, model, vehicle, allocation, setting)

    def tried(bandwidth: float) -> Loop:
        return replace(template, law=law_for(model, allocation, setting, *gains(model.inertia, damping, bandwidth)))

    return largest_bandwidth(tried, limit)


def noise_of_rate(law: Law, heading_noise: float) -> float:
    """Standard deviation in rad/s that white ``heading_noise`` in rad leaves in the filtered rate."""
    return heading_noise * law.blend / law.period * math.sqrt(2.0 / (2.0 - law.blend))


def control_of(parameters: Parameters, vehicle: Vehicle, setting: Setting, options: Options) -> Control:
    """Design the controller and run it.

    Raises
    ------
    DataError
        No bandwidth leaves comfortable margins, or the thrusters cannot turn the vehicle both ways.
    """
    model = parameters.model()
    if not vehicle.thrusters:
        # Tables know no thrusters: the torque itself is commanded.
        vehicle = replace(vehicle, thrusters=(Thruster(name="torque", arm=1.0, curve=None),))
    allocation = allocate(vehicle, model)
    if options.kp is not None and options.kd is not None:
        given = options.kp, options.kd
    else:
        wanted = options.bandwidth
        if wanted is None:
            wanted = choose_bandwidth(model, vehicle, allocation, setting, options.damping)
        given = gains(model.inertia, options.damping, wanted)
    law = law_for(model, allocation, setting, *given)
    loop = loop_of(law, model, vehicle, allocation, setting)
    margins = loop.margins()
    return Control(
        law=law,
        model=model,
        setting=setting,
        allocation=allocation,
        damping=damping_ratio(law.kp, law.kd, model.inertia),
        bandwidth=math.sqrt(law.kp / model.inertia),
        lag=loop.lag(margins.crossover),
        margins=margins,
        spread=spread_of(loop, parameters, vehicle, allocation, setting),
        runs=tuple(
            closed_runs(
                law, model, vehicle, allocation, setting, manoeuvres(options.parsed_steps(), setting.torque_in_use)
            )
        ),
    )


def spread_of(
    loop: Loop, parameters: Parameters, vehicle: Vehicle, allocation: Allocation, setting: Setting
) -> Spread | None:
    """Monte Carlo over the covariance of the parameter file, the controller held; None where it has no covariance."""
    if not any(value > 0.0 for value in parameters.covariance.values()):
        return None
    found = []
    for model in drawn(parameters, _DRAWS, seed=0):
        moved = replace(loop, motion=linearised(model))
        if model.acts_on_drive:
            amplitude = _amplitude(allocation, setting)
            moved = replace(moved, actuators=actuators(model, vehicle, allocation, setting.period, amplitude))
        found.append(moved.margins())
    low, high = 5.0, 95.0
    return Spread(
        draws=len(found),
        stable=float(np.mean([margins.stable for margins in found])),
        gain_db=float(np.percentile([margins.gain_db for margins in found], low)),
        phase_deg=float(np.percentile([margins.phase_deg for margins in found], low)),
        delay_s=float(np.percentile([margins.delay_s for margins in found], low)),
        sensitivity_peak=float(np.percentile([margins.sensitivity_peak for margins in found], high)),
    )


def closed_runs(
    law: Law,
    model: Model,
    vehicle: Vehicle,
    allocation: Allocation,
    setting: Setting,
    wanted: Sequence[Manoeuvre],
) -> list[RunResult]:
    """Every manoeuvre with and without the aid; with effects also before and after the aid knows of them."""
    bare = replace(model, effects=(), effect_values=())
    bench = allocate(vehicle, bare)
    limits = {"lowest": bench.lowest, "highest": bench.highest}
    plain = replace(law, hold=(0.0,) * len(law.hold), **limits)
    ways = [(bare, plain, bench, True, False), (bare, unaided(plain), bench, False, False)]
    if model.effects:
        ways += [
            (model, law, allocation, True, True),
            (model, plain, bench, True, False),
            (model, unaided(plain), bench, False, False),
        ]
    results = []
    for manoeuvre in wanted:
        for acting, controller, inverse, aided, known in ways:
            plant = Plant(
                model=acting,
                vehicle=vehicle,
                delay=setting.delay,
                heading_noise=setting.heading_noise,
                disturbance=_DISTURBANCE * setting.torque_in_use,
            )
            measures, quiet = run_manoeuvre(controller, inverse, plant, manoeuvre)
            results.append(
                RunResult(
                    name=manoeuvre.name,
                    effects=tuple(effect.key for effect in acting.effects),
                    model_aid=aided,
                    effects_known=known,
                    measures=measures,
                    quiet=quiet,
                )
            )
    return results


def run_manoeuvre(
    law: Law, allocation: Allocation, plant: Plant, manoeuvre: Manoeuvre, seed: int = 0
) -> tuple[Measures, Course]:
    """One closed-loop run, and the same without noise, disturbance and waves, which shows its limit cycle."""
    count = math.ceil(duration(law, plant.model) / law.period)
    wanted = np.full(count, math.radians(manoeuvre.wanted))
    time = law.period * np.arange(count)
    steady = np.where(time >= 0.25 * time[-1], manoeuvre.current, 0.0)
    push: FloatArray = steady + manoeuvre.waves * np.sin(2.0 * math.pi / _WAVE_PERIOD * time)
    start = math.radians(manoeuvre.start)
    course = run_closed(law, allocation, plant, wanted, start, push=push, seed=seed)
    quiet = run_closed(law, allocation, plant.quiet(), wanted, start, push=steady)
    return measure(course, quiet), quiet


def duration(law: Law, model: Model) -> float:
    """s, after which a run has settled and gone on for as long again."""
    natural = math.sqrt(law.kp / model.inertia)
    ratio = damping_ratio(law.kp, law.kd, model.inertia)
    slowest = natural * (ratio if ratio < 1.0 else ratio - math.sqrt(ratio**2 - 1.0))
    return max(_LENGTHS / slowest, _SHORTEST)


def _amplitude(allocation: Allocation, setting: Setting) -> float:
    return min(setting.torque_in_use, 0.5 * allocation.highest, -0.5 * allocation.lowest)
