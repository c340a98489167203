"""Multi-step predictions, their weights and their likelihood."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.estimate.dataset import NOISE_FLOOR, time_constant
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fit_result import fit
from rovid.estimate.multi_step import MultiStepData, MultiStepLikelihood, prediction_errors
from rovid.estimate.restart_grid import HORIZONS
from rovid.model.model import Model
from rovid.trial.rates import compute_rates
from tests import synthetic
from tests.predictions import BIAS, NOISE, TIME, TORQUE, biased, records


def rms(ahead: MultiStepData, model: Model) -> FloatArray:
    errors = prediction_errors(ahead, model)
    return np.array([np.sqrt(np.mean(errors[ahead.horizon == number] ** 2)) for number in range(len(HORIZONS))])


def test_the_true_model_predicts_and_a_wrong_one_does_not() -> None:
    ahead = records()
    right = rms(ahead, synthetic.ROSUB)
    wrong = rms(ahead, replace(synthetic.ROSUB, quadratic_drag=1.3 * synthetic.ROSUB.quadratic_drag))
    assert (right[2:] < 0.25 * wrong[2:]).all()
    assert (np.diff(wrong) > 0.0).all()


def test_restarts_remove_drift() -> None:
    """A constant torque turns a free run away without end, and a prediction only for as long as its horizon."""
    ahead = records(disturbance=np.full(len(TIME), 5.0))
    constant = time_constant(synthetic.ROSUB, ahead.rms_rate)
    most = 5.0 / synthetic.ROSUB.inertia * (HORIZONS[-1] * constant) ** 2 / 2.0
    assert rms(ahead, synthetic.ROSUB)[-1] < most


def test_nothing_is_predicted_across_a_gap() -> None:
    run = synthetic.run(TIME, TORQUE, noise=NOISE)
    position = run.trial.position.copy()
    gap = (TIME > 700.0) & (TIME < 760.0)
    position[gap] = np.nan
    trial = replace(run.trial, position=position)
    cut = replace(run, trial=trial, rates=compute_rates(trial, cutoff=1.0))
    ahead = MultiStepData.from_data(InnovationData([cut], synthetic.LOGGED, synthetic.ROSUB), synthetic.ROSUB)
    ((begin, end),) = ahead.innovation_spans
    assert not ((begin < 701.0) & (end > 759.0)).any()
    assert (end < 700.0).any()
    assert (begin > 760.0).any()


def test_correlated_errors_count_as_few() -> None:
    """White errors are independent; slow errors are correlated."""
    slow = synthetic.gauss_markov(len(TIME), 0.2, 20.0, 200.0, np.random.default_rng(1))
    assert records(disturbance=slow).effective_count < 0.5 * records().effective_count


def test_a_long_log_costs_no_more_predictions() -> None:
    few, many = records(), records(runs=6)
    assert sum(len(gridded.restarts[0]) for gridded in many.gridded_runs) <= 700
    assert len(many.horizon) < 3 * len(few.horizon)


def test_a_missing_effect_correlates_all_errors() -> None:
    unknown = records(disturbance=np.full(len(TIME), 12.0))
    assert unknown.effective_count < 0.2 * biased().effective_count


def test_a_constant_torque_is_found_with_its_size() -> None:
    ahead = biased()
    objective = MultiStepLikelihood(ahead)
    plain = fit(objective, objective.parametrization.initial())
    with_bias = fit(objective.with_effects((BIAS,)), np.concatenate((plain.x, [0.01])))
    assert plain.value - with_bias.value > 20.0
    assert with_bias.model.effect_values[0] == pytest.approx(12.0, rel=0.03)


def test_parameters_cannot_fit_all_predictions_over_a_horizon() -> None:
    """Three predictions over the longest horizon of a short log would make their variance, and all errors, vanish."""
    constant = time_constant(synthetic.ROSUB, records().rms_rate)
    count = int(1.1 * HORIZONS[-1] * constant / 0.2)
    weak = -0.5 * np.abs(TORQUE[:count])  # a torque that the model lacks
    run = synthetic.run(TIME[:count], TORQUE[:count], noise=NOISE[:count], disturbance=weak)
    whole = InnovationData([run], synthetic.LOGGED, synthetic.ROSUB)
    objective = MultiStepLikelihood(MultiStepData.from_data(whole, synthetic.ROSUB), effects=(BIAS,))
    start = np.append(MultiStepLikelihood(objective.data).parametrization.initial(), 0.01)
    error, variance = objective.innovations(fit(objective, start).x)
    assert len(error) > 20
    assert np.sqrt(variance.min()) > np.std(NOISE)
    assert set(records().horizon) == set(range(len(HORIZONS)))


def test_the_variance_of_a_single_prediction_has_a_floor() -> None:
    """Else the likelihood of a horizon with one alone would have no bounds, and rounding would tell the best model."""
    ahead = records()
    alone = np.arange(len(ahead.horizon)) == 5
    objective = MultiStepLikelihood(ahead, mask=alone)
    best = fit(objective, objective.parametrization.initial())
    error, variance = objective.innovations(best.x)
    least = 2.0 * NOISE_FLOOR**2
    assert np.abs(error).max() < np.sqrt(least)
    assert variance.tolist() == pytest.approx([least])
    (held_out,) = objective.held_out_values([objective], [best.x])
    assert held_out == pytest.approx(best.value)
