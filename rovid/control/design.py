"""One controller for one identified vehicle: its gains, its margins, and its closed-loop runs."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rovid.control.actuator_response import ActuatorProbe, one_way_only
from rovid.control.allocation import Allocation, allocate
from rovid.control.closed_loop import ClosedLoop, ClosedLoopRun, Plant, simulate_loops
from rovid.control.control_law import ControlLaw, static_terms_of
from rovid.control.specs import WAVE_PERIOD, ControllerOptions, HeadingManoeuvre, LoopConditions, standard_manoeuvres
from rovid.control.step_metrics import StepMetrics, step_metrics
from rovid.control.tuning import (
    BANDWIDTHS,
    Margins,
    OpenLoop,
    damping_ratio,
    largest_bandwidth,
    linearise,
    pd_gains,
    sample_models,
)
from rovid.core.array_types import FloatArray
from rovid.model.model import Model
from rovid.store.parameter_file import Parameters
from rovid.trial.vehicle import Thruster, Vehicle

# Of the torque in use: of the disturbance that every run has.
_DISTURBANCE = 0.02
# The rate's filter, as a share of one over the bandwidth and in periods of the controller.
_FILTER_SHARE, _FILTER_PERIODS = 0.05, 2.0
# rad of heading error that may ask for all the torque there is; share of the torque in use that the noise may ask for.
_FULL_TORQUE_ERROR, _NOISE_SHARE = 0.2, 0.1
_DRAWS = 60
# A run lasts so many time constants of the slower closed-loop mode, and s at least.
_LENGTHS, _SHORTEST = 15.0, 60.0


@dataclass(frozen=True, kw_only=True)
class ClosedLoopResult:
    """One manoeuvre with the ``effects`` in the plant, with or without the aid, which knows of the effects or not.

    ``quiet`` is the run without noise, disturbance and waves.
    """

    name: str
    effects: tuple[str, ...]
    model_aid: bool
    effects_known: bool
    metrics: StepMetrics
    noise_free_run: ClosedLoopRun


@dataclass(frozen=True, kw_only=True)
class MarginSpread:
    """Margins over the parameters' uncertainty: share of stable loops, and the bound that 95 % keep."""

    draws: int
    stable: float
    gain_db: float
    phase_deg: float
    delay_s: float
    sensitivity_peak: float


@dataclass(frozen=True, kw_only=True, eq=False)
class ControllerDesign:
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

    law: ControlLaw
    model: Model
    conditions: LoopConditions
    allocation: Allocation
    damping: float
    bandwidth: float
    lag: float
    margins: Margins
    spread: MarginSpread | None
    runs: tuple[ClosedLoopResult, ...]


def control_law(model: Model, allocation: Allocation, setting: LoopConditions, kp: float, kd: float) -> ControlLaw:
    """The controller of these gains with all the aid that ``model`` gives."""
    bandwidth = math.sqrt(kp / model.inertia)
    own = max(_FILTER_SHARE / bandwidth, _FILTER_PERIODS * setting.period)
    return ControlLaw(
        kp=kp,
        kd=kd,
        period=setting.period,
        rate_filter=own if setting.rate_filter is None else setting.rate_filter,
        inertia=model.inertia,
        quadratic_drag=model.quadratic_drag,
        linear_drag=model.linear_drag,
        static_terms=static_terms_of(model),
        lowest=allocation.lowest,
        highest=allocation.highest,
    )


def without_model_aid(law: ControlLaw) -> ControlLaw:
    """PD alone."""
    return ControlLaw(
        kp=law.kp,
        kd=law.kd,
        period=law.period,
        rate_filter=law.rate_filter,
        lowest=law.lowest,
        highest=law.highest,
    )


def open_loop(
    law: ControlLaw, model: Model, vehicle: Vehicle, allocation: Allocation, setting: LoopConditions
) -> OpenLoop:
    """The loop of ``law`` about rest, at the amplitude of the torque in use."""
    return OpenLoop(
        law=law,
        motion=linearise(model, model.steady_rate(setting.torque_in_use)),
        actuators=_probes_for(model, vehicle, allocation, setting).frequency_response(model),
        delay=setting.delay,
    )


def choose_bandwidth(
    model: Model, vehicle: Vehicle, allocation: Allocation, setting: LoopConditions, damping: float
) -> float:
    """The largest bandwidth in rad/s with comfortable margins that neither noise nor the actuators' limits forbid.

    Raises
    ------
    DataError
        There is none.
    """
    capacity = min(allocation.highest, -allocation.lowest)
    if not capacity > 0.0:
        raise one_way_only()

    def law_at(bandwidth: float) -> ControlLaw:
        kp, kd = pd_gains(model.inertia, damping, bandwidth)
        return control_law(model, allocation, setting, kp, kd)

    limit = math.sqrt(capacity / _FULL_TORQUE_ERROR / model.inertia)
    for bandwidth in BANDWIDTHS:
        law = law_at(float(bandwidth))
        noise = law.kd * rate_noise(law, setting.heading_noise)
        if noise > _NOISE_SHARE * setting.torque_in_use:
            limit = min(limit, float(bandwidth))
            break
    # Motion and actuators do not change with the gains: they are worked out once.
    template = open_loop(law_at(1.0), model, vehicle, allocation, setting)

    def tried(bandwidth: float) -> OpenLoop:
        return replace(template, law=law_at(bandwidth))

    return largest_bandwidth(tried, limit)


def rate_noise(law: ControlLaw, heading_noise: float) -> float:
    """Standard deviation in rad/s that white ``heading_noise`` in rad leaves in the filtered rate."""
    return heading_noise * law.blend / law.period * math.sqrt(2.0 / (2.0 - law.blend))


def design_controller(
    parameters: Parameters, vehicle: Vehicle, setting: LoopConditions, options: ControllerOptions
) -> ControllerDesign:
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
        kp, kd = options.kp, options.kd
    else:
        wanted = options.bandwidth
        if wanted is None:
            wanted = choose_bandwidth(model, vehicle, allocation, setting, options.damping)
        kp, kd = pd_gains(model.inertia, options.damping, wanted)
    law = control_law(model, allocation, setting, kp, kd)
    loop = open_loop(law, model, vehicle, allocation, setting)
    margins = loop.margins()
    asked = standard_manoeuvres(options.parsed_steps(), setting.torque_in_use)
    return ControllerDesign(
        law=law,
        model=model,
        conditions=setting,
        allocation=allocation,
        damping=damping_ratio(law.kp, law.kd, model.inertia),
        bandwidth=math.sqrt(law.kp / model.inertia),
        lag=loop.total_lag(margins.crossover),
        margins=margins,
        spread=margin_spread(loop, parameters, vehicle, allocation, setting),
        runs=tuple(closed_runs(law, model, vehicle, allocation, setting, asked)),
    )


def margin_spread(
    loop: OpenLoop, parameters: Parameters, vehicle: Vehicle, allocation: Allocation, setting: LoopConditions
) -> MarginSpread | None:
    """Monte Carlo over the covariance of the parameter file, the controller held; None where it has no covariance."""
    if not any(value > 0.0 for value in parameters.covariance.values()):
        return None
    best = parameters.model()
    probes, fastest = _probes_for(best, vehicle, allocation, setting), best.steady_rate(setting.torque_in_use)
    every = [
        replace(loop, motion=linearise(model, fastest), actuators=probes.frequency_response(model)).margins()
        for model in sample_models(parameters, _DRAWS, seed=0)
    ]
    low, high = 5.0, 95.0
    return MarginSpread(
        draws=len(every),
        stable=float(np.mean([margins.stable for margins in every])),
        gain_db=float(np.percentile([margins.gain_db for margins in every], low)),
        phase_deg=float(np.percentile([margins.phase_deg for margins in every], low)),
        delay_s=float(np.percentile([margins.delay_s for margins in every], low)),
        sensitivity_peak=float(np.percentile([margins.sensitivity_peak for margins in every], high)),
    )


def closed_runs(
    law: ControlLaw,
    model: Model,
    vehicle: Vehicle,
    allocation: Allocation,
    setting: LoopConditions,
    wanted: Sequence[HeadingManoeuvre],
) -> list[ClosedLoopResult]:
    """Every manoeuvre with and without the aid; with effects also before and after the aid knows of them."""
    bare = replace(model, effects=(), effect_values=())
    bench = allocate(vehicle, bare)
    limits = {"lowest": bench.lowest, "highest": bench.highest}
    plain = replace(law, static_terms=(0.0,) * len(law.static_terms), **limits)
    with_and_without = [(plain, bench, True, False), (without_model_aid(plain), bench, False, False)]
    ways = [(bare, with_and_without)]
    if model.effects:
        ways.append((model, [(law, allocation, True, True), *with_and_without]))
    results = list[list[ClosedLoopResult]]()
    for acting, every in ways:
        plant = Plant(
            model=acting,
            vehicle=vehicle,
            delay=setting.delay,
            heading_noise=setting.heading_noise,
            disturbance=_DISTURBANCE * setting.torque_in_use,
        )
        loops = [noisy_and_noise_free(controller, inverse, plant, wanted) for controller, inverse, _, _ in every]
        runs = iter(simulate_pairs([*itertools.chain(*loops)]))
        results += [
            [
                ClosedLoopResult(
                    name=manoeuvre.name,
                    effects=tuple(effect.key for effect in acting.effects),
                    model_aid=aided,
                    effects_known=known,
                    metrics=measures,
                    noise_free_run=quiet,
                )
                for manoeuvre, (measures, quiet) in zip(wanted, itertools.islice(runs, len(wanted)), strict=True)
            ]
            for _, _, aided, known in every
        ]
    return [result for every_way in zip(*results, strict=True) for result in every_way]


def noisy_and_noise_free(
    law: ControlLaw, allocation: Allocation, plant: Plant, manoeuvres: Sequence[HeadingManoeuvre], seed: int = 0
) -> list[ClosedLoop]:
    """Each manoeuvre, and behind it the same without noise, disturbance and waves."""
    count = math.ceil(run_duration(law, plant.model) / law.period)
    time = law.period * np.arange(count)
    loops = []
    for manoeuvre in manoeuvres:
        steady = np.where(time >= 0.25 * time[-1], manoeuvre.current, 0.0)
        outside: FloatArray = steady + manoeuvre.waves * np.sin(2.0 * math.pi / WAVE_PERIOD * time)
        loop = ClosedLoop(
            law=law,
            allocation=allocation,
            plant=plant,
            setpoint=np.full(count, math.radians(manoeuvre.target)),
            initial_heading=math.radians(manoeuvre.start),
            external_torque=outside,
            seed=seed,
        )
        loops += [loop, replace(loop, plant=plant.noise_free(), external_torque=steady, seed=0)]
    return loops


def simulate_pairs(loops: Sequence[ClosedLoop]) -> list[tuple[StepMetrics, ClosedLoopRun]]:
    """Of each two of ``closed_loops`` the measures, and the quiet run, which shows its limit cycle."""
    courses = iter(simulate_loops(loops))
    return [(step_metrics(course, quiet), quiet) for course, quiet in zip(courses, courses, strict=True)]


def run_duration(law: ControlLaw, model: Model) -> float:
    """s, after which a run has settled and gone on for as long again."""
    natural = math.sqrt(law.kp / model.inertia)
    ratio = damping_ratio(law.kp, law.kd, model.inertia)
    return max(_LENGTHS / (natural * _decay(ratio)), _SHORTEST)


def _decay(ratio: float) -> float:
    """Rate at which a motion of this damping ``ratio`` dies out, of the natural frequency."""
    if ratio < 1.0:
        return ratio
    # Of two modes without a swing the slower.
    return ratio - math.sqrt(ratio**2 - 1.0)


def _probes_for(model: Model, vehicle: Vehicle, allocation: Allocation, setting: LoopConditions) -> ActuatorProbe:
    """Sines as large as the torque in use, but half of what there is at most."""
    amplitude = min(setting.torque_in_use, 0.5 * allocation.highest, -0.5 * allocation.lowest)
    parts = model.actuators.subdivision
    return ActuatorProbe(
        vehicle=vehicle, parts=parts, allocation=allocation, period=setting.period, amplitude=amplitude
    )
