"""Trials simulated with none, some and all of what was found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rovid.diagnose.cross_validation import HeldOutScores
from rovid.diagnose.result import Diagnosis, ModelAssessment
from rovid.effects import effect_named
from rovid.estimate.estimate import Estimate
from rovid.model.model import Model
from rovid.model.simulation import simulation_errors
from rovid.present.report_data import ReportData, effects_of, simulate_nested_models, worst_first
from tests.present.conftest import staged, study_of


def side(day: ReportData, model: Model) -> ModelAssessment:
    """A side of which the model alone matters."""
    held = HeldOutScores(log_likelihood=0.0, rate_r2=1.0, rate_rmse=0.0, rate_squares=np.zeros(0), position_errors={})
    none = np.empty(0)
    estimate = Estimate(
        names=(), axis=day.axis, values=none, covariance=none.reshape(0, 0), method="", samples=0, warnings=()
    )
    return ModelAssessment(model=model, estimate=estimate, held_out=held)


def test_each_model_of_the_diagnosis_simulates_every_trial(day: ReportData) -> None:
    plain = day.parameters.model()
    lag, bias = effect_named("thruster_lag"), effect_named("bias_torque")
    one = replace(plain, effects=(lag,), effect_values=(0.4,))
    both = replace(plain, effects=(lag, bias), effect_values=(0.4, 1.0))
    diagnosis = Diagnosis(verdict="found", base=side(day, plain), extended=side(day, both), nested_models=(one,))
    stages = simulate_nested_models(study_of(day), diagnosis)
    assert [stage.model for stage in stages] == [plain, one, both]
    assert {len(stage.simulations) for stage in stages} == {len(day.simulations)}
    assert stages[0].simulations[0].fit == day.simulations[0].fit
    assert stages[2].simulations[0].fit.rmse != stages[1].simulations[0].fit.rmse
    assert effects_of(stages) == (lag, bias)


def test_where_nothing_was_found_there_is_one_stage(day: ReportData) -> None:
    plain = side(day, day.parameters.model())
    assert (
        len(simulate_nested_models(study_of(day), Diagnosis(verdict="nothing_found", base=plain, extended=plain))) == 1
    )
    assert simulate_nested_models(study_of(day), Diagnosis(verdict="too_little_data")) == ()


def test_the_worst_comes_first_and_what_has_no_error_last(day: ReportData) -> None:
    errors = (0.2, float("nan"), 0.5)
    items = [replace(day.simulations[0], fit=replace(day.simulations[0].fit, rmse=error)) for error in errors]
    assert worst_first(items) == [2, 0, 1]


def test_positions_count_as_root_mean_squares_of_the_trials_that_are_long_enough(day: ReportData) -> None:
    sizes = (0.3, 0.4, None)
    items = [replace(day.simulations[0], position_errors={10.0: size, 60.0: None}) for size in sizes]
    off = simulation_errors(items)
    assert off.position[10.0] == pytest.approx(np.sqrt((0.09 + 0.16) / 2.0))
    assert off.position[60.0] is None
    assert off.rate == pytest.approx(day.simulations[0].fit.rmse)


def test_before_and_after_are_the_first_stage_and_the_last(day: ReportData) -> None:
    evidence = staged(day)
    assert evidence.simulations_without is evidence.nested[0].simulations
    assert evidence.simulations_with is evidence.nested[-1].simulations
    assert day.simulations_without is day.simulations_with is day.simulations
