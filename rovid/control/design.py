"""Controller design for one identified vehicle: gains, margins, and closed-loop runs."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from rovid.control import actuators, tuning
from rovid.control.closed_loop import ClosedLoop, ClosedLoopRun, Plant, StepMetrics, simulate_loops, step_metrics
from rovid.control.control_law import (
    NO_STATIC_TERMS,
    WAVE_PERIOD,
    ControlLaw,
    ControllerOptions,
    HeadingManoeuvre,
    LoopConditions,
    standard_manoeuvres,
    static_terms_of,
)
from rovid.core.errors import DataError
from rovid.model.model import Model
from rovid.store.parameter_file import Parameters
from rovid.trial.vehicle import Thruster, Vehicle

# Disturbance in every run, relative to the torque in use.
_DISTURBANCE = 0.02
# Time constant of the rate filter: product with the bandwidth, and minimum in sampling periods.
_FILTER_SHARE, _FILTER_PERIODS = 0.05, 2.0
# Number of models drawn from the covariance.
_DRAWS = 60
# Length of a run in time constants of the slower closed-loop mode, and at least in s.
_TIME_CONSTANTS, _SHORTEST = 15.0, 60.0
# Largest number of sampling periods of a run, some 100 MB. Longer runs follow from gains near zero.
_MOST_STEPS = 200_000


@dataclass(frozen=True, kw_only=True)
class ClosedLoopResult:
    """One manoeuvre with ``effects`` in the plant, with or without model aid; ``effects_known`` to the aid or not."""

    name: str
    effects: tuple[str, ...]
    model_aid: bool
    effects_known: bool
    metrics: StepMetrics
    noise_free_run: ClosedLoopRun


@dataclass(frozen=True, kw_only=True)
class MarginSpread:
    """Share of stable loops over the uncertainty of the parameters, and margins that 95 % of the loops exceed."""

    draws: int
    stable: float
    gain_db: float
    phase_deg: float
    delay_s: float
    sensitivity_peak: float


@dataclass(frozen=True, kw_only=True, eq=False)
class ControllerDesign:
    """A controller with the properties of its loop."""

    law: ControlLaw | actuators.AutopilotLaw  #: With full model aid, or of an autopilot.
    model: Model
    conditions: LoopConditions
    allocation: actuators.Allocation
    #: ``damping``, ``bandwidth``: damping ratio, and natural frequency in rad/s, of the gains and the yaw inertia.
    damping: float
    bandwidth: float
    lag: float  #: s, total delay of the loop at the crossover frequency.
    margins: tuning.Margins
    spread: MarginSpread | None
    runs: tuple[ClosedLoopResult, ...]  #: Empty for an autopilot.
    autopilot: str = ""  #: One of `AUTOPILOTS`; empty for the model-aided law.

    @property
    def autopilot_parameters(self) -> dict[str, float]:
        """Parameters of the autopilot by its names; empty for the model-aided law."""
        if not isinstance(self.law, actuators.AutopilotLaw):
            return {}
        return actuators.autopilot_parameters(actuators.AUTOPILOTS[self.autopilot], self.law)


def design_controller(
    parameters: Parameters, vehicle: Vehicle, conditions: LoopConditions, options: ControllerOptions
) -> ControllerDesign:
    """Design a controller, and simulate it.

    Raises DataError if no bandwidth has sufficient margins, or the thrusters turn the vehicle one way only.
    """
    model, autopilot = parameters.model(), actuators.AUTOPILOTS.get(options.law)
    if not vehicle.thrusters and autopilot is not None:
        text = "without thrusters the torque of an autopilot's full output is not known."
        raise DataError(text, where="--law", mend="Give logs with thrusters and their curves, or leave --law out.")
    if not vehicle.thrusters:
        # Results from tables know no thrusters: the torque itself is commanded.
        vehicle = replace(vehicle, thrusters=(Thruster(name="torque", arm=1.0, curve=None),))
    kp, kd, bandwidth = options.kp, options.kd, options.bandwidth
    runs: list[ClosedLoopResult] = []
    law: ControlLaw | actuators.AutopilotLaw
    if autopilot is not None:
        gains_of = actuators.default_gains(model, options.damping)
        if kp is not None and kd is not None:
            fixed = kp, kd
            gains_of, bandwidth = (lambda _: fixed), math.sqrt(kp / model.inertia)
        law, loop, probe = actuators.autopilot_loop(model, vehicle, conditions, autopilot, gains_of, bandwidth)
        allocation = probe.allocation
    else:
        allocation = actuators.allocate(vehicle, model)
        if kp is None or kd is None:
            bandwidth = bandwidth or choose_bandwidth(model, vehicle, allocation, conditions, options.damping)
            kp, kd = tuning.pd_gains(model.inertia, options.damping, bandwidth)
        law = control_law(model, allocation, conditions, kp, kd)
        loop = open_loop(law, model, vehicle, allocation, conditions)
        probe = _probe(model, vehicle, allocation, conditions)
        manoeuvres = standard_manoeuvres(options.parsed_steps(), conditions.torque_in_use)
        runs = closed_runs(law, model, vehicle, allocation, conditions, manoeuvres)
    margins = loop.margins()
    return ControllerDesign(
        law=law,
        autopilot="" if autopilot is None else options.law,
        model=model,
        conditions=conditions,
        allocation=allocation,
        damping=tuning.damping_ratio(law.kp, law.kd, model.inertia),
        bandwidth=math.sqrt(law.kp / model.inertia),
        lag=loop.total_lag(margins.crossover),
        margins=margins,
        spread=_margin_spread(loop, parameters, probe, model.steady_rate(conditions.torque_in_use)),
        runs=tuple(runs),
    )


def control_law(
    model: Model, allocation: actuators.Allocation, conditions: LoopConditions, kp: float, kd: float
) -> ControlLaw:
    """Controller with these gains and the full aid of ``model``."""
    rate_filter = conditions.rate_filter
    if rate_filter is None:
        rate_filter = max(_FILTER_SHARE / math.sqrt(kp / model.inertia), _FILTER_PERIODS * conditions.period)
    return ControlLaw(
        kp=kp,
        kd=kd,
        period=conditions.period,
        rate_filter=rate_filter,
        inertia=model.inertia,
        quadratic_drag=model.quadratic_drag,
        linear_drag=model.linear_drag,
        static_terms=static_terms_of(model),
        lowest=allocation.lowest,
        highest=allocation.highest,
    )


def without_model_aid(law: ControlLaw) -> ControlLaw:
    """The same gains without model aid."""
    return replace(law, inertia=0.0, quadratic_drag=0.0, linear_drag=0.0, static_terms=NO_STATIC_TERMS)


def open_loop(
    law: ControlLaw, model: Model, vehicle: Vehicle, allocation: actuators.Allocation, conditions: LoopConditions
) -> tuning.OpenLoop:
    """Loop of ``law`` about rest, at the amplitude of the torque in use."""
    return tuning.OpenLoop(
        law=law,
        motion=tuning.linearise(model, model.steady_rate(conditions.torque_in_use)),
        actuators=_probe(model, vehicle, allocation, conditions).frequency_response(model),
        delay=conditions.delay,
    )


def _probe(
    model: Model, vehicle: Vehicle, allocation: actuators.Allocation, conditions: LoopConditions
) -> actuators.ActuatorProbe:
    """Probe with the amplitude of the torque in use, but at most half of the torque limits."""
    return actuators.ActuatorProbe(
        vehicle=vehicle,
        parts=model.actuators.subdivision,
        allocation=allocation,
        period=conditions.period,
        amplitude=min(conditions.torque_in_use, 0.5 * allocation.highest, -0.5 * allocation.lowest),
    )


def choose_bandwidth(
    model: Model, vehicle: Vehicle, allocation: actuators.Allocation, conditions: LoopConditions, damping: float
) -> float:
    """Largest bandwidth in rad/s with sufficient margins, within the limits of noise and actuators."""
    capacity = min(allocation.highest, -allocation.lowest)
    if not capacity > 0.0:
        raise actuators.one_way_only()

    def law_at(bandwidth: float) -> ControlLaw:
        kp, kd = tuning.pd_gains(model.inertia, damping, bandwidth)
        return control_law(model, allocation, conditions, kp, kd)

    limit = math.sqrt(capacity / actuators.SATURATING_ERROR / model.inertia)
    for bandwidth in tuning.BANDWIDTHS.tolist():
        if law_at(bandwidth).noise(conditions.heading_noise) > actuators.NOISE_SHARE * conditions.torque_in_use:
            limit = min(limit, bandwidth)
            break
    # Motion and actuators do not depend on the gains.
    template = open_loop(law_at(1.0), model, vehicle, allocation, conditions)
    return tuning.largest_bandwidth(lambda bandwidth: replace(template, law=law_at(bandwidth)), limit)


def _margin_spread(
    loop: tuning.OpenLoop, parameters: Parameters, probe: actuators.ActuatorProbe, fastest: float
) -> MarginSpread | None:
    """Monte Carlo over the covariance of the parameters with the controller fixed; None without a covariance."""
    if not any(value > 0.0 for value in parameters.covariance.values()):
        return None
    margins = []
    for model in tuning.sample_models(parameters, _DRAWS, seed=0):
        drawn = replace(loop, motion=tuning.linearise(model, fastest), actuators=probe.frequency_response(model))
        margins.append(drawn.margins())
    bounds = {}
    for name, share in (("gain_db", 0.05), ("phase_deg", 0.05), ("delay_s", 0.05), ("sensitivity_peak", 0.95)):
        values = np.array([getattr(one, name) for one in margins])
        # Between two infinite margins there is nothing to interpolate.
        method: Literal["linear", "lower"] = "linear" if np.all(np.isfinite(values)) else "lower"
        bounds[name] = float(np.quantile(values, share, method=method))
    return MarginSpread(draws=len(margins), stable=float(np.mean([one.stable for one in margins])), **bounds)


def closed_runs(
    law: ControlLaw,
    model: Model,
    vehicle: Vehicle,
    allocation: actuators.Allocation,
    conditions: LoopConditions,
    manoeuvres: Sequence[HeadingManoeuvre],
) -> list[ClosedLoopResult]:
    """Each manoeuvre with and without model aid; with effects also before and after the aid knows of them."""
    bare = model.with_effects()
    bench = actuators.allocate(vehicle, bare)
    plain = replace(law, static_terms=NO_STATIC_TERMS, lowest=bench.lowest, highest=bench.highest)
    # Controller, its allocation, model aid, and effects known.
    variants = [(plain, bench, True, False), (without_model_aid(plain), bench, False, False)]
    plants = [(bare, variants)]
    if model.effects:
        plants.append((model, [(law, allocation, True, True), *variants]))
    results: list[list[ClosedLoopResult]] = [[] for _ in manoeuvres]
    for acting, controllers in plants:
        plant = Plant(
            model=acting,
            vehicle=vehicle,
            delay=conditions.delay,
            heading_noise=conditions.heading_noise,
            disturbance=_DISTURBANCE * conditions.torque_in_use,
        )
        loops = [noisy_and_noise_free(controller, own, plant, manoeuvres) for controller, own, _, _ in controllers]
        runs = iter(simulate_pairs([*itertools.chain(*loops)]))
        effects = tuple(effect.key for effect in acting.effects)
        for _, _, aided, known in controllers:
            for manoeuvre, own in zip(manoeuvres, results, strict=True):
                metrics, noise_free = next(runs)
                result = ClosedLoopResult(
                    name=manoeuvre.name,
                    effects=effects,
                    model_aid=aided,
                    effects_known=known,
                    metrics=metrics,
                    noise_free_run=noise_free,
                )
                own.append(result)
    return [*itertools.chain(*results)]


def noisy_and_noise_free(
    law: ControlLaw,
    allocation: actuators.Allocation,
    plant: Plant,
    manoeuvres: Sequence[HeadingManoeuvre],
    seed: int = 0,
) -> list[ClosedLoop]:
    """Loop of each manoeuvre, each followed by the same without noise, disturbance and waves."""
    duration = run_duration(law, plant.model)
    if not duration <= _MOST_STEPS * law.period:
        raise DataError(
            f"the loop takes {duration:.2g} s to settle, more than {_MOST_STEPS} sampling periods: "
            f"with a yaw inertia of {plant.model.inertia:.3g} kg m^2 these gains are too small to simulate.",
            mend="Give a larger --bandwidth, or --kp and --kd; check the inertia in the parameter file.",
        )
    count = math.ceil(duration / law.period)
    time = law.period * np.arange(count)
    loops = []
    for manoeuvre in manoeuvres:
        current = np.where(time >= 0.25 * time[-1], manoeuvre.current, 0.0)
        loop = ClosedLoop(
            law=law,
            allocation=allocation,
            plant=plant,
            setpoint=np.full(count, math.radians(manoeuvre.target)),
            initial_heading=math.radians(manoeuvre.start),
            external_torque=current + manoeuvre.waves * np.sin(2.0 * math.pi / WAVE_PERIOD * time),
            seed=seed,
        )
        loops += [loop, replace(loop, plant=plant.noise_free(), external_torque=current, seed=0)]
    return loops


def simulate_pairs(loops: Sequence[ClosedLoop]) -> list[tuple[StepMetrics, ClosedLoopRun]]:
    """Metrics of each noisy loop in ``loops``, and the noise-free run that follows it."""
    runs = iter(simulate_loops(loops))
    return [(step_metrics(run, noise_free), noise_free) for run, noise_free in zip(runs, runs, strict=True)]


def run_duration(law: ControlLaw, model: Model) -> float:
    """Length of a run in s, about twice its settling time."""
    frequency = math.sqrt(law.kp / model.inertia)
    ratio = tuning.damping_ratio(law.kp, law.kd, model.inertia)
    # Decay rate of the slower mode, relative to the natural frequency.
    decay = ratio if ratio < 1.0 else ratio - math.sqrt(ratio**2 - 1.0)
    return max(_TIME_CONSTANTS / (frequency * decay), _SHORTEST)
