"""A larger model never ends below a smaller one, for every form of every effect."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.starts import Campaign, random_campaign
from rovid.diagnose.candidate_fits import fit_from_best_start
from rovid.effects import Effect, effect_named, forms_for
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.estimate.multi_step_data import MultiStepData
from rovid.estimate.multi_step_likelihood import MultiStepLikelihood
from rovid.estimate.nested_fits import (
    fit_with_effects,
    neutral_start,
    scaled_start,
)

LAG, DELAY = effect_named("thruster_lag"), effect_named("command_delay")
# Nats: the filter takes its steps by the fastest state, so that equal models differ by what the steps cost.
ROUNDING = 0.2
# The largest value of a parameter whose neutral value is infinite: a slew rate of ten thousand full commands a second.
NOT_INFINITE = 0.1


@pytest.fixture(scope="module")
def lagged() -> Campaign:
    return random_campaign(np.random.default_rng(4), form=LAG)


@pytest.fixture(scope="module")
def short(lagged: Campaign) -> FitResult:
    """Plain model of the first run alone, by one-step predictions."""
    data = InnovationData(lagged.runs[:1], lagged.vehicle, replace(lagged.model, effects=(), effect_values=()))
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


@pytest.mark.parametrize("name", ["short", "short_multi_step"])
def test_every_form_at_its_neutral_value_is_the_smaller_model(name: str, request: pytest.FixtureRequest) -> None:
    base: FitResult = request.getfixturevalue(name)
    for form in forms(base):
        objective = base.objective.with_effects((form,))
        allowed = NOT_INFINITE if form.parameters[0].neutral_at_infinity else ROUNDING
        assert objective.value(neutral_start(objective, base)) == pytest.approx(base.value, abs=allowed), form.key


@pytest.mark.parametrize("name", ["short", "short_multi_step"])
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
