"""A larger model never ends below a smaller one, for every form of every effect."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.starts import Campaign, base_fit, climb_from_truth, commands, measured, random_campaign, two_thrusters
from rovid.diagnose.candidate_fits import fit_from_best_start
from rovid.effects import Effect, effect_named, forms_for
from rovid.estimate import maximum_likelihood
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.estimate.maximum_likelihood import add_effects
from rovid.estimate.multi_step import MultiStepData, MultiStepLikelihood
from rovid.estimate.nested_fits import (
    DISTINGUISHABLE,
    covariance_of_optima,
    exchanged_or_same,
    fit_with_effects,
    neutral_start,
    scaled_start,
    with_exchanged_time_constants,
)
from rovid.model.model import Model
from rovid.trial.preprocessing import prepare_trials
from tests.conftest import slow
from tests.synthetic import LOGGED, ROSUB, clock, gauss_markov, run

LAG = effect_named("thruster_lag")
# Nats: the filter takes its steps by the fastest state, so that equal models differ by what the steps cost.
ROUNDING = 0.2
# The largest value of a parameter whose neutral value is infinite: a slew rate of ten thousand full commands a second.
NOT_INFINITE = 0.1


@pytest.fixture(scope="module")
def lagged() -> Campaign:
    return random_campaign(np.random.default_rng(4), form=LAG)


@pytest.fixture(scope="module")
def short(lagged: Campaign) -> FitResult:
    """Plain model of the first few hundred samples, by one-step predictions."""
    trial = lagged.runs[0].trial
    runs = prepare_trials([trial.part(slice(0, 400), trial.name)], lagged.vehicle).items
    data = InnovationData(runs, lagged.vehicle, replace(lagged.model, effects=(), effect_values=()))
    objective = InnovationLikelihood(data, 0.05)
    return fit(objective, objective.parametrization.initial())


@pytest.fixture(scope="module")
def short_multi_step(short: FitResult) -> FitResult:
    """The same by multi-step predictions."""
    objective = MultiStepLikelihood(MultiStepData.from_data(short.data, short.model))
    return fit(objective, objective.parametrization.initial())


def forms(base: FitResult) -> list[Effect]:
    assert base.data.vehicle is not None
    return [*forms_for(base.data.vehicle)]


@pytest.mark.parametrize("name", ["short", slow("short_multi_step")])
def test_every_form_at_its_neutral_value_is_the_smaller_model(name: str, request: pytest.FixtureRequest) -> None:
    base: FitResult = request.getfixturevalue(name)
    for form in forms(base):
        objective = base.objective.with_effects((form,))
        allowed = NOT_INFINITE if form.parameters[0].neutral_at_infinity else ROUNDING
        assert objective.value(neutral_start(objective, base)) == pytest.approx(base.value, abs=allowed), form.key


@pytest.mark.slow
@pytest.mark.parametrize("name", ["short", slow("short_multi_step")])
def test_no_form_ends_below_the_smaller_model(name: str, request: pytest.FixtureRequest) -> None:
    base: FitResult = request.getfixturevalue(name)
    for form in forms(base):
        fitted = fit_with_effects(base, [form])
        assert fitted.value <= base.value + ROUNDING, form.key
        objective = base.objective.with_effects((form,))
        # Even from one start that is far away.
        count = len(form.parameters)
        low, high = (bound[-count:] for bound in objective.parametrization.bounds)
        far = np.clip(scaled_start(form, form.initial_values[-1], 10.0), low, high)
        candidate = fit_from_best_start(objective, base, [far], 8)
        assert candidate.value <= base.value + ROUNDING, form.key


def linear_campaign(seed: int, lag: float, linear: float, *, inertia_known: bool = False) -> Campaign:
    """A vehicle with a time constant of 1 s, a lag in s, and a share of linear drag."""
    rng = np.random.default_rng(seed)
    drags = (1.0 - linear) * 100.0, linear * 100.0
    plain = Model(inertia=drags[1] + drags[0], quadratic_drag=drags[0], linear_drag=drags[1])
    vehicle = two_thrusters(100.0)
    if inertia_known:
        vehicle = replace(vehicle, mass=6.0 * 0.8 * plain.inertia, length=1.0, width=1.0)
    model = replace(plain, effects=(LAG,), effect_values=(lag,))
    trials = [commands(rng, number, 1.0, 0.1) for number in range(2)]
    runs = measured(vehicle, model, trials, rng, 0.3, 1e-3)
    return Campaign(vehicle=vehicle, model=model, time_constant=1.0, runs=runs, disturbance=0.3, noise=1e-3)


@pytest.mark.parametrize("lag", [0.2, 4.0])
def test_exchanged_time_constants_are_tried(lag: float, monkeypatch: pytest.MonkeyPatch) -> None:
    campaign = linear_campaign(1, lag, 0.97)
    base = base_fit(campaign)
    right = add_effects(base, (LAG,))
    assert right.model.inertia == pytest.approx(campaign.model.inertia, rel=0.05)
    # The other order is an optimum of its own, from which a fit does not return.
    exchanged = with_exchanged_time_constants(right)
    assert exchanged is not None
    wrong = fit(right.objective, exchanged)
    assert wrong.value > right.value + DISTINGUISHABLE
    assert wrong.model.inertia == pytest.approx(lag * campaign.model.inertia, rel=0.1)
    assert exchanged_or_same(wrong).value == pytest.approx(right.value, abs=0.1)
    assert covariance_of_optima(right)[1] == []
    # They are tried again under the last limit of the disturbance.
    monkeypatch.setattr(maximum_likelihood, "loosen_limit", lambda _: wrong)
    assert add_effects(base, (LAG,)).value == pytest.approx(right.value, abs=0.1)


def test_two_optima_that_the_data_do_not_distinguish_are_told() -> None:
    campaign = linear_campaign(2, 1.6, 1.0)
    base = base_fit(campaign)
    fitted = add_effects(base, (LAG,))
    added, (warning,) = covariance_of_optima(fitted)
    assert "can change places" in warning
    own = fitted.covariance(sandwich=False)
    away = abs(fitted.model.inertia / campaign.model.inertia - 1.0)
    far = 0.6 * campaign.model.inertia
    assert np.sqrt(own[0, 0]) < 0.1 * far
    assert np.sqrt(own[0, 0] + added[0, 0]) > 0.45 * far
    assert away < 0.1 or abs(away - 0.6) < 0.1


def test_the_rigid_body_decides_between_two_optima() -> None:
    # The lag is shorter: exchanged, the inertia would be half of the rigid body's.
    campaign = linear_campaign(3, 0.4, 1.0, inertia_known=True)
    fitted = add_effects(base_fit(campaign), (LAG,))
    exchanged = with_exchanged_time_constants(fitted)
    assert exchanged is not None
    wrong = fit(fitted.objective, exchanged)
    assert abs(wrong.value - fitted.value) < DISTINGUISHABLE
    for start in (wrong, fitted):
        found = exchanged_or_same(start)
        assert found.model.inertia == pytest.approx(campaign.model.inertia, rel=0.05)
        assert covariance_of_optima(found)[1] == []


@pytest.mark.parametrize(("after", "until"), [(37.0, None), slow(61.5, None), (37.0, 2040.0)])
def test_the_instants_of_a_loss_of_thrust_are_found_in_any_log(after: float, until: float | None) -> None:
    rng, time, runs = np.random.default_rng(6), clock(120.0, 5.0), []
    for number in range(3):
        torque = 230.0 * np.repeat(rng.choice([-1.0, 0.0, 1.0], 25), 25)[: len(time)]
        instant = number * 1000.0 + time
        lost = np.where((instant >= 1000.0 + after) & (instant < (until or np.inf)), 0.6, 1.0)
        noise, disturbance = rng.normal(0.0, 1e-3, len(time)), gauss_markov(len(time), 0.2, 3.0, 20.0, rng)
        log = run(time, lost * torque, disturbance=disturbance, noise=noise)
        # What was commanded is the torque without the loss.
        commanded = replace(log.trial, commands=torque[:, np.newaxis], campaign_time=1000.0 * number)
        runs.append(replace(log, trial=commanded, torque=torque))
    objective = InnovationLikelihood(InnovationData(runs, LOGGED, ROSUB), 0.05)
    base = FitResult.at(objective, objective.parametrization.initial())
    form = "supply_sag:instant" if until is None else "thruster_imbalance:torque between instants"
    fitted = fit_with_effects(base, [effect_named(form)])
    gain, *instants = fitted.model.values[3:]
    assert gain == pytest.approx(0.6, abs=3.0 * float(np.sqrt(fitted.covariance(sandwich=False)[3, 3])))
    # The torque at an instant decides within how many samples it shows.
    expected = [1000.0 + after] if until is None else [1000.0 + after, until]
    assert 3600.0 * np.array(instants) == pytest.approx(expected, abs=5.0)
    assert covariance_of_optima(fitted)[1] == []


def test_a_parameter_at_the_end_of_its_range_has_no_tight_error(lagged: Campaign) -> None:
    base = base_fit(lagged)
    # The bound is a tenth of the true lag.
    (lag,) = lagged.model.effect_values
    size = replace(LAG.parameters[0], high=0.1 * lag / base.data.scales.unit_size(LAG.parameters[0]))
    fitted = add_effects(base, (replace(LAG, parameters=(size,)),))
    added, warnings = covariance_of_optima(fitted)
    assert any("the bound of its range" in one for one in warnings)
    assert np.sqrt(added[3, 3]) > 0.2 * 0.1 * lag


@pytest.mark.slow
def test_several_effects_never_end_below_any_of_them() -> None:
    campaign = random_campaign(np.random.default_rng(11), count=2)
    base = base_fit(campaign)
    one, other = campaign.effects
    both, reverse = fit_with_effects(base, (one, other)), fit_with_effects(base, (other, one))
    assert both.effects == (one, other)
    assert both.value == pytest.approx(reverse.value, abs=0.1)
    for single in (one, other):
        assert both.value <= fit_with_effects(base, (single,)).value + ROUNDING
    truth = climb_from_truth(campaign, both)
    assert both.value <= truth.value + 0.1
