"""Whether fits reach the likelihood of a climb that starts at the truth, on random vehicles with hidden effects.

Run ``python -m benchmarks.starts --campaigns 60``. Each campaign is one vehicle (time constant 0.15 to 40 s, torques of
1 to 1e5 N m), with a form of the catalogue or two hidden, of random size. Three fits of the true structure are compared
to a fit from the truth, all of the same objective: that of ``rovid fit --effect``, that of a candidate of ``rovid
diagnose``, and the plain model, which is contained in all of them. A fit that ends lower by more than 0.1 nats fails.
With ``--every-form``, each form is added to the plain model, hidden or not, and must not end below it.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.diagnose.candidate_fits import fit_candidates, refine_fit
from rovid.diagnose.screening import score_tests
from rovid.effects import Effect, EffectParameter, forms_for
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.maximum_likelihood import INNOVATIONS_R2, add_effects, fit_innovations
from rovid.estimate.multi_step import MultiStepData, MultiStepLikelihood
from rovid.estimate.nested_fits import fit_with_effects
from rovid.estimate.output_error import fit_output_error
from rovid.model.model import Model
from rovid.trial.preprocessing import Run, prepare_trials
from rovid.trial.trial import Trial
from rovid.trial.vehicle import ThrustCurve, Thruster, Vehicle

TRIALS, SAMPLES = 4, 1500
# rad; a vehicle that turns farther in one trial diverges.
LARGEST_TURN = 1e5
# Nats by which a fit may end below the climb from the truth.
ALLOWED = 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class Campaign:
    """A random vehicle with its commands, and what is hidden."""

    vehicle: Vehicle
    model: Model  #: The truth.
    time_constant: float  #: s
    runs: Sequence[Run]
    disturbance: float  #: N m
    noise: float  #: rad

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The hidden effects."""
        return self.model.effects


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """Nats by which each fit ends below the climb from the truth; of the candidate None with several effects."""

    fit: float
    candidate: float | None
    contained: float  #: Nats by which the fit ends below the plain model.
    visible: float  #: Nats that the truth gains over the plain model.
    seconds: float


def random_campaign(rng: np.random.Generator, count: int = 1, form: Effect | None = None) -> Campaign:
    """A vehicle with ``count`` hidden effects, or with ``form``, of random size; drawn again where it diverges."""
    while True:
        campaign = _drawn(rng, count, form)
        if all(float(np.ptp(run.trial.position)) < LARGEST_TURN for run in campaign.runs):
            return campaign


def _drawn(rng: np.random.Generator, count: int, form: Effect | None) -> Campaign:
    constant, torque = 10.0 ** rng.uniform(-0.8, 1.6), 10.0 ** rng.uniform(0.0, 5.0)
    rate, linear = 10.0 ** rng.uniform(-1.0, 0.3), rng.uniform(0.05, 0.9)
    drags = (1.0 - linear) * torque / rate**2, linear * torque / rate
    slope = drags[1] + drags[0] * rate  # 2 DQ r at half the largest rate
    plain = Model(inertia=constant * slope, quadratic_drag=drags[0], linear_drag=drags[1])
    vehicle = two_thrusters(torque)
    period = constant / rng.uniform(5.0, 30.0)
    noise = 10.0 ** rng.uniform(-4.0, -2.5)
    disturbance = torque * 10.0 ** rng.uniform(-3.5, -2.0)
    trials = [commands(rng, number, constant, period) for number in range(TRIALS)]
    bare = measured(vehicle, plain, trials, rng, 0.0, noise)
    forms = [one for one in forms_for(vehicle) if not one.is_wave]
    hidden = [form] if form is not None else [forms[at] for at in rng.choice(len(forms), 3 * count, replace=False)]
    chosen = list({one.id: one for one in hidden}.values())[:count]
    scales = InnovationData(bare, vehicle, plain).scales
    values = [
        _random_value(rng, parameter, constant, scales.unit_size(parameter)) * scales.unit_size(parameter)
        for effect in chosen
        for parameter in effect.parameters
    ]
    model = replace(plain, effects=tuple(chosen), effect_values=tuple(values))
    runs = measured(vehicle, model, trials, rng, disturbance, noise)
    return Campaign(
        vehicle=vehicle, model=model, time_constant=constant, runs=runs, disturbance=disturbance, noise=noise
    )


def two_thrusters(torque: float) -> Vehicle:
    """A vehicle with this largest torque in N m."""
    curve = ThrustCurve.proportional(0.5 * torque / 100.0**2, 100.0, 2)
    return Vehicle(name="random", thrusters=tuple(Thruster(name=name, arm=1.0, curve=curve) for name in "ab"))


def commands(rng: np.random.Generator, number: int, constant: float, period: float) -> Trial:
    """A trial that begins at rest, of random levels or of a growing sine; the position is simulated later."""
    instants: FloatArray = np.arange(SAMPLES, dtype=np.float64) * period
    changes = np.cumsum(constant * 10.0 ** rng.uniform(-0.5, 1.2, SAMPLES)) + 2.0 * constant
    levels = np.append(0.0, rng.choice([-100.0, -60.0, -30.0, 0.0, 30.0, 60.0, 100.0], SAMPLES))
    command = levels[np.searchsorted(changes, instants, side="right")]
    if number == TRIALS - 1:
        command = np.round(80.0 * np.sin(2.0 * math.pi * instants / (8.0 * constant)), 1)
    return Trial(
        name=f"run_{number}.csv",
        path=Path(f"run_{number}.csv"),
        time=instants,
        position=np.zeros(SAMPLES),
        commands=np.column_stack((command, command)),
    )


def measured(
    vehicle: Vehicle, model: Model, trials: Sequence[Trial], rng: np.random.Generator, disturbance: float, noise: float
) -> tuple[Run, ...]:
    """The trials with the simulated heading, through the filter."""
    found = []
    for trial in trials:
        torque_input = model.torque_input(vehicle, trial)
        fade = 0.95
        kicks = disturbance * math.sqrt(1.0 - fade**2) * rng.normal(size=len(trial.time))
        drift = np.zeros(len(kicks))
        for k in range(1, len(kicks)):
            drift[k] = fade * drift[k - 1] + kicks[k]
        _, position = model.simulate(trial, replace(torque_input, torque=torque_input.torque + drift))
        found.append(replace(trial, position=position + noise * rng.normal(size=len(position))))
    return prepare_trials(found, vehicle).items


def _random_value(rng: np.random.Generator, parameter: EffectParameter, constant: float, unit: float) -> float:
    """A value in units of the parameter's scale: times in vehicle time constants, others around an initial value."""
    low, high, start = parameter.low, parameter.high, float(rng.choice(parameter.initial_values))
    if parameter.unit == "s":
        return float(np.clip(constant / unit * 10.0 ** rng.uniform(-1.3, 0.5), low, high))
    if parameter.unit == "rad" and high > 6.0:
        return float(rng.uniform(-math.pi, math.pi))
    if parameter.neutral_at_infinity or parameter.neutral == 0.0:
        value = start * 10.0 ** rng.uniform(-0.5, 0.5)
    else:
        value = parameter.neutral + (start - parameter.neutral) * 10.0 ** rng.uniform(-0.3, 0.6)
    margin = 0.02 * (high - low) if math.isfinite(high - low) and high < 1e5 else 0.0
    return float(np.clip(value, low + margin, high - margin))


def base_fit(campaign: Campaign) -> FitResult:
    """The plain model by the criterion that ``rovid fit`` uses."""
    start = fit_output_error(campaign.runs, min_sigmas=0.0)
    data = InnovationData(campaign.runs, campaign.vehicle, start)
    r2 = data.free_run_r2(start)
    if r2 >= INNOVATIONS_R2:
        return fit_innovations(data, r2)
    objective = MultiStepLikelihood(MultiStepData.from_data(data, start))
    return fit(objective, objective.parametrization.initial())


def climb_from_truth(campaign: Campaign, like: FitResult) -> FitResult:
    """The fit of the objective of ``like`` from the truth."""
    parametrization = like.objective.parametrization
    memory = 20.0 * float(campaign.runs[0].trial.sampling_interval)
    x = parametrization.coordinates_of(campaign.model, campaign.disturbance, memory, campaign.noise)
    return fit(like.objective, np.clip(x, *parametrization.bounds))


def compare(campaign: Campaign) -> Outcome:
    """All fits of the true structure against the climb from the truth."""
    base = base_fit(campaign)
    begun = time.perf_counter()
    fitted = add_effects(base, campaign.effects)
    seconds = time.perf_counter() - begun
    truth = climb_from_truth(campaign, fitted)
    contained = fit(fitted.objective.with_effects(()), base.x)
    candidate = None
    if len(campaign.effects) == 1:
        ahead, behind = fit_candidates(base, score_tests(base, campaign.effects), lambda _: True, {})
        (found,) = (*ahead, *behind)
        candidate = refine_fit(found, 60).value - climb_from_truth(campaign, found).value
    return Outcome(
        fit=fitted.value - truth.value,
        candidate=candidate,
        contained=fitted.value - contained.value,
        visible=contained.value - truth.value,
        seconds=seconds,
    )


def lower_forms(campaign: Campaign) -> list[str]:
    """Forms with which the fit ends below the plain model, with the nats lost."""
    base = base_fit(campaign)
    losses = {form.key: fit_with_effects(base, [form]).value - base.value for form in forms_for(campaign.vehicle)}
    return [f"{key} {loss:.2f}" for key, loss in losses.items() if loss > ALLOWED]


def described(model: Model) -> str:
    """The hidden effects with their values."""
    names, values = model.names[3:], model.values[3:]
    return ", ".join(f"{name} {value:.4g}" for name, value in zip(names, values, strict=True))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print each campaign that fails, and the counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--campaigns", type=int, default=60)
    parser.add_argument("--effects", type=int, default=1)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--every-form", action="store_true")
    options = parser.parse_args(arguments)
    if options.every_form:
        for number in range(options.campaigns):
            campaign = random_campaign(np.random.default_rng([options.seed, number]), options.effects)
            print(f"{number}: {', '.join(lower_forms(campaign)) or 'no form ends lower'}", flush=True)
        return
    failed, lower, candidates, total = 0, 0, 0, 0
    for number in range(options.campaigns):
        campaign = random_campaign(np.random.default_rng([options.seed, number]), options.effects)
        outcome = compare(campaign)
        total += 1
        failed += outcome.fit > ALLOWED
        lower += outcome.contained > ALLOWED
        candidates += outcome.candidate is not None and outcome.candidate > ALLOWED
        worst = max(outcome.fit, outcome.candidate or 0.0, outcome.contained)
        mark = "FAILS" if worst > ALLOWED else "ok"
        print(
            f"{number} {mark}: fit {outcome.fit:+.2f}, candidate {outcome.candidate or 0.0:+.2f}, plain "
            f"{outcome.contained:+.1f}, visible {outcome.visible:.1f}, {outcome.seconds:.1f} s; time constant "
            f"{campaign.time_constant:.3g} s; {described(campaign.model)}",
            flush=True,
        )
    print(f"{total} campaigns: fits below the truth's climb {failed}, candidates {candidates}, below plain {lower}")


if __name__ == "__main__":
    main()
