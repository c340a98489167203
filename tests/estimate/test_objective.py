"""Value, gradient, scores and Fisher information of an objective agree with each other."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.diagnose.screening import score_tests
from rovid.effects import effect_named
from rovid.estimate import fisher_information
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fisher_information import NormalEquations, grouped_scores, jacobian_chunks
from rovid.estimate.fit_result import fit
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.estimate.multi_step import MultiStepData, MultiStepLikelihood
from tests import synthetic
from tests.predictions import NOISE, TIME, TORQUE

RUNS = [synthetic.run(TIME[:600], TORQUE[:600], noise=NOISE[:600])]


@pytest.fixture(scope="module")
def objective() -> InnovationLikelihood:
    return InnovationLikelihood(InnovationData(RUNS, synthetic.LOGGED, synthetic.ROSUB), 0.05)


def test_the_value_is_the_sum_of_the_contributions(objective: InnovationLikelihood) -> None:
    x = objective.parametrization.initial()
    assert objective.value(x) == pytest.approx(float(np.sum(objective.contributions(x))))


def test_the_gradient_is_the_derivative_of_the_value(objective: InnovationLikelihood) -> None:
    x = objective.parametrization.initial()
    # Away from the optimum the gradient is not zero.
    x[0] += 0.2
    gradient = NormalEquations.from_jacobians(objective.jacobian(x)).gradient
    for at in range(3):
        aside = np.zeros(len(x))
        aside[at] = 1e-4
        central = (objective.value(x + aside) - objective.value(x - aside)) / 2e-4
        assert gradient[at] == pytest.approx(central, rel=0.02, abs=0.02 * np.abs(gradient[:3]).max())


def test_scores_of_all_blocks_add_up_to_the_gradient(objective: InnovationLikelihood) -> None:
    x, groups = objective.parametrization.initial(), objective.data.block_index
    here = NormalEquations.from_jacobians(objective.jacobian(x))
    triangle, (scores,) = grouped_scores(objective.robust_jacobian(x), [groups])
    assert len(scores) == len(np.unique(groups))
    assert scores.sum(axis=0) == pytest.approx(here.gradient)
    assert triangle.T @ triangle == pytest.approx(here.information)
    (whole,) = objective.jacobian(x)
    assert scores[0] == pytest.approx(whole.scores[groups == groups[0]].sum(axis=0))


@pytest.mark.parametrize("at_once", [1, 7, 599])
def test_sums_do_not_depend_on_the_chunk_size(
    objective: InnovationLikelihood, at_once: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    x, step = objective.parametrization.initial(), np.full(6, 1e-3)
    centre, *sides = objective.evaluate_nearby(x, list(x + np.diag(step)))
    whole = NormalEquations.from_jacobians(jacobian_chunks(centre, sides, step, objective.weight))
    monkeypatch.setattr(fisher_information, "_CHUNK", at_once)
    sums = NormalEquations.from_jacobians(jacobian_chunks(centre, sides, step, objective.weight))
    assert sums.gradient == pytest.approx(whole.gradient)
    assert sums.information == pytest.approx(whole.information)


def test_an_objective_with_an_effect_shares_the_data(objective: InnovationLikelihood) -> None:
    with_bias = objective.with_effects((effect_named("bias_torque"),))
    assert with_bias.data is objective.data
    assert len(with_bias.parametrization.initial()) == len(objective.parametrization.initial()) + 1
    # An effect at its neutral value changes nothing.
    nothing = np.append(objective.parametrization.initial(), 0.0)
    assert with_bias.value(nothing) == pytest.approx(objective.value(objective.parametrization.initial()))


def test_the_score_test_predicts_the_gain_of_a_refit_of_multi_step_predictions() -> None:
    """To second order both are v'z squared over twice v'v; docs/method.md, (19)."""
    slow = synthetic.gauss_markov(len(TIME), 0.2, 4.0, 3.0, np.random.default_rng(1))
    disturbance = (slow - 0.01 * np.minimum(TORQUE, 0.0))[:3000]
    run = synthetic.run(TIME[:3000], TORQUE[:3000], disturbance=disturbance, noise=NOISE[:3000])
    data = MultiStepData.from_data(InnovationData([run], synthetic.LOGGED, synthetic.ROSUB), synthetic.ROSUB)
    objective, form = MultiStepLikelihood(data), effect_named("thrust_asymmetry")
    plain = fit(objective, objective.parametrization.initial(), tolerance=1e-6)
    (test,) = score_tests(plain, [form])
    refit = fit(objective.with_effects((form,)), np.concatenate((plain.x, test.start)), tolerance=1e-6)
    gain = plain.value - refit.value
    assert gain > 1.0
    # The estimated variances add terms of third order, below 10 % here. Fixed seeds.
    assert test.gain == pytest.approx(gain, rel=0.1)
