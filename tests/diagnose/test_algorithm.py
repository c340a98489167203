"""The algorithm of the diagnosis, and its budget."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.core.budget import Budget, ProgressCallback
from rovid.diagnose import algorithm
from rovid.diagnose.algorithm import diagnose, select_by_innovations, select_by_predictions, select_directly
from rovid.diagnose.cross_validation import cv_pieces
from rovid.diagnose.evidence import Evidence
from rovid.diagnose.objectives import InnovationObjective, SearchProblem, cannot_whiten, screening_data, thin_for_waves
from rovid.diagnose.result import Diagnosis
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.diagnose.validation import Rejection, first_rejection
from rovid.diagnose.wave_test import WaveTest
from rovid.effects import Effect, effect_named
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fit_result import FitResult
from rovid.estimate.output_error import fit_output_error
from rovid.trial.preprocessing import PreparedRuns
from tests import synthetic
from tests.core.test_budget import Clock
from tests.predictions import NOISE, TIME, TORQUE

LAG, WAVES = effect_named("thruster_lag"), effect_named("wave_torque")
CANDIDATES = [LAG, effect_named("drag_curvature"), effect_named("thrust_asymmetry")]
LONG, PERIOD = 1500, 0.2


def late(torque: FloatArray, lag: float) -> FloatArray:
    """Mean over each interval of a torque that passes a first-order lag, settled at the start."""
    if not lag:
        return torque
    fade, state, means = math.exp(-PERIOD / lag), float(torque[0]), []
    for wanted in torque.tolist():
        means.append(wanted + (state - wanted) * (1.0 - fade) * lag / PERIOD)
        state = wanted + (state - wanted) * fade
    return np.array(means)


def readings(lag: float, unknown: float = 0.0) -> InnovationData:
    """Four runs with a lag in s and a disturbance; an ``unknown`` torque in N m changes its sign every minute."""
    rng = np.random.default_rng(1)
    runs = []
    for first in range(0, 4 * LONG, LONG):
        rows = slice(first, first + LONG)
        water = synthetic.gauss_markov(LONG, PERIOD, 2.0, 4.0, rng)
        off = late(TORQUE[rows], lag) - TORQUE[rows] + water + unknown * (-1.0) ** (TIME[:LONG] // 60.0)
        runs.append(synthetic.run(TIME[:LONG], TORQUE[rows], disturbance=off, noise=NOISE[rows]))
    return InnovationData(runs, synthetic.LOGGED, fit_output_error(runs, min_sigmas=0.0))


def without_waves(beside: FitResult) -> WaveTest:
    return WaveTest(beside, ())


def problem_of(
    data: InnovationData,
    report: ProgressCallback = lambda _: None,
    wave_test: Callable[[FitResult], WaveTest] = without_waves,
) -> SearchProblem:
    budget = Budget(report=report)
    pieces = cv_pieces(data.runs, synthetic.LOGGED, 1.0)
    innovations = InnovationObjective(
        data=data, pieces=pieces, wave_data=thin_for_waves(data), candidates=CANDIDATES, budget=budget
    )
    return SearchProblem(
        data=data, pieces=pieces, candidates=CANDIDATES, innovations=innovations, wave_test=wave_test, budget=budget
    )


@pytest.mark.parametrize(("lag", "found"), [(0.0, ()), (1.5, (LAG,))])
def test_a_cause_that_whitens_the_innovations_is_selected_directly(lag: float, found: tuple[Effect, ...]) -> None:
    selection = select_directly(problem_of(readings(lag)))
    assert selection is not None
    assert selection.is_adequate
    assert selection.model.effects == found
    assert not selection.multi_step
    # Further causes have been screened.
    assert selection.model.key in selection.search.cache.score_tests


@pytest.mark.slow
def test_the_search_continues_next_to_established_waves(monkeypatch: pytest.MonkeyPatch) -> None:
    said = list[str]()

    def look(beside: FitResult) -> WaveTest:
        assert beside.effects == (LAG,)
        objective = beside.objective.with_effects((*beside.effects, WAVES))
        begins = [np.concatenate((beside.x, start)) for start in objective.parametrization.initial_values()]
        return WaveTest(beside, (), FitResult.at(objective, objective.most_likely(begins, 1)[0]))

    monkeypatch.setattr(WaveTest, "established", property(lambda waves: waves.fitted))
    selection = select_directly(problem_of(readings(1.5), said.append, look))
    assert said.count("Searching by one-step predictions …") == 2
    assert selection is not None
    # There are no waves: the search eliminates them.
    assert selection.model.effects == (LAG,)


def test_nothing_is_selected_directly_where_no_cause_dominates() -> None:
    tested = list[FitResult]()

    def look(beside: FitResult) -> WaveTest:
        tested.append(beside)
        return WaveTest(beside, ())

    assert select_directly(problem_of(readings(1.5, unknown=60.0), wave_test=look)) is None
    # The waves may dominate: they are tested next to the model without effects.
    (beside,) = tested
    assert not beside.effects


def test_the_search_begins_next_to_waves_that_dominate(monkeypatch: pytest.MonkeyPatch) -> None:
    said, begun = list[str](), list[FitResult]()

    def look(beside: FitResult) -> WaveTest:
        objective = beside.objective.with_effects((WAVES,))
        begins = [np.concatenate((beside.x, start)) for start in objective.parametrization.initial_values()]
        begun.append(FitResult.at(objective, objective.most_likely(begins, 1)[0]))
        return WaveTest(beside, (), begun[-1])

    monkeypatch.setattr(WaveTest, "established", property(lambda waves: waves.fitted))
    monkeypatch.setattr(algorithm, "is_worth_searching", lambda _, start, *__: begun.append(start))
    assert select_directly(problem_of(readings(1.5, unknown=60.0), said.append, look)) is None
    plain, waves, second = begun
    assert not plain.effects
    assert second is waves


def test_nothing_is_searched_directly_where_the_simulation_fits_poorly_with_any_cause() -> None:
    said = list[str]()
    assert select_directly(problem_of(readings(3.0, unknown=300.0), said.append)) is None
    assert "Searching by one-step predictions …" not in said


def test_a_poor_plain_model_does_not_choose_the_predictions(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(algorithm, "fits_poorly", lambda fitted: not fitted.effects)
    selection = select_directly(problem_of(readings(1.5)))
    assert selection is not None
    assert selection.model.effects == (LAG,)


@pytest.mark.parametrize(("lag", "found"), [(0.0, ()), (1.5, (LAG,))])
def test_multi_step_selection_pauses_where_the_innovations_are_white(
    monkeypatch: pytest.MonkeyPatch, lag: float, found: tuple[Effect, ...]
) -> None:
    problem = problem_of(readings(lag))
    selections = select_by_predictions(problem)
    early = next(selections)
    assert early.model.effects == found
    assert early.model.key not in early.search.cache.score_tests
    assert problem.innovations.is_adequate(early.model)
    assert problem.innovations.is_adequate(early.base) is not bool(found)
    selection = select_by_innovations(problem, early.model, early.model, cannot_whiten)
    assert selection is not None
    assert selection.is_adequate
    assert selection.model.effects == found
    # Bans of the first selection do not affect the complete one.
    early.ban(*CANDIDATES)
    (whole,) = selections
    monkeypatch.setattr(InnovationObjective, "is_adequate", lambda *_: False)
    (alone,) = select_by_predictions(problem)
    assert whole.model.effects == alone.model.effects == found
    assert whole.model.x == pytest.approx(alone.model.x, abs=0.0)
    assert whole.model.key in whole.search.cache.score_tests


def test_multi_step_selection_is_complete_where_no_model_whitens(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(InnovationObjective, "is_adequate", lambda *_: False)
    (selection,) = select_by_predictions(problem_of(readings(1.5)))
    assert selection.model.effects == (LAG,)
    assert selection.model.key in selection.search.cache.score_tests
    # A search after a rejection does not end early.
    assert selection.search.is_adequate is None


@pytest.mark.parametrize(("seconds", "thinned"), [(PERIOD, False), (3.0 * PERIOD, False), (6.0 * PERIOD, True)])
def test_screening_uses_thinned_data_where_these_are_many_times_fewer(seconds: float, *, thinned: bool) -> None:
    search_data = readings(0.0)
    wave_data = replace(search_data, interval=seconds)
    # An interval of 0 stands for all samples.
    assert search_data.interval == 0.0
    assert screening_data(wave_data, search_data) is (wave_data if thinned else search_data)


def prepared() -> PreparedRuns:
    return PreparedRuns(items=tuple(readings(1.5).runs), cutoff=1.0, chosen=False, remarks=())


def by_predictions(monkeypatch: pytest.MonkeyPatch, *, is_adequate: bool) -> tuple[Diagnosis, list[str]]:
    """Diagnosis without one-step selections; the multi-step search ends early or not."""
    monkeypatch.setattr(algorithm, "select_directly", lambda *_: None)
    monkeypatch.setattr(algorithm, "select_by_innovations", lambda *_: None)
    monkeypatch.setattr(InnovationObjective, "is_adequate", lambda *_: is_adequate)
    said: list[str] = []
    return diagnose(prepared(), synthetic.LOGGED, said.append), said


@pytest.mark.slow
def test_an_early_end_of_the_multi_step_search_changes_no_result(monkeypatch: pytest.MonkeyPatch) -> None:
    (early, twice), (whole, once) = (by_predictions(monkeypatch, is_adequate=adequate) for adequate in (True, False))
    assert [finding.effect.id for finding in early.findings] == ["thruster_lag"]
    assert early.verdict == whole.verdict
    assert early.warnings == whole.warnings
    for one, other in ((early.base, whole.base), (early.extended, whole.extended)):
        assert one is not None
        assert other is not None
        assert np.array_equal(one.estimate.values, other.estimate.values)
    assert twice.count("Testing for waves …") == 2
    assert once.count("Testing for waves …") == 1


@pytest.mark.slow
def test_a_direct_selection_that_fails_validation_is_searched_by_predictions(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    direct = diagnose(prepared(), synthetic.LOGGED, said.append)
    count = len(said)
    rejections = [Rejection(effect=LAG, reason="is rejected here")]

    def reject_once(*args: Any) -> Rejection | None:
        return rejections.pop() if rejections else first_rejection(*args)

    monkeypatch.setattr(algorithm, "first_rejection", reject_once)
    rejected = diagnose(prepared(), synthetic.LOGGED, said.append)
    assert [finding.effect.id for finding in direct.findings] == ["thruster_lag"]
    assert [finding.effect.id for finding in rejected.findings] == ["thruster_lag"]
    assert len(said) - count > count
    assert direct.extended is not None
    assert rejected.extended is not None
    np.testing.assert_allclose(direct.extended.estimate.values, rejected.extended.estimate.values, rtol=1e-3)


def diagnosed_until(looks: float) -> tuple[Diagnosis, Budget]:
    """Diagnosis of a lag of 1.5 s that may look ``looks`` times at the clock."""
    budget = Budget(looks, share=1.0, clock=Clock(tick=1.0))
    return diagnose(prepared(), synthetic.LOGGED, budget=budget), budget


@pytest.fixture(scope="module")
def looks_in_all() -> int:
    """Looks of a diagnosis that comes to its end."""
    diagnosis, budget = diagnosed_until(1e9)
    assert [finding.effect.id for finding in diagnosis.findings] == ["thruster_lag"]
    assert not budget.not_tried
    assert not any("budget" in warning for warning in diagnosis.warnings)
    return int(budget.used)


def assert_nothing_is_established(diagnosis: Diagnosis, budget: Budget) -> None:
    assert budget.not_tried
    assert diagnosis.findings == ()
    for suspect in diagnosis.suspects:
        assert suspect.evidence is not Evidence.CONFIRMED
        assert suspect.probability < THRESHOLDS.established
    if diagnosis.verdict != "too_little_data":
        assert any("budget" in warning for warning in diagnosis.warnings)


def test_a_budget_that_ends_early_establishes_nothing() -> None:
    diagnosis, budget = diagnosed_until(20.0)
    assert_nothing_is_established(diagnosis, budget)
    assert budget.used < 200.0


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.1, 0.3, 0.6])
def test_what_is_found_in_part_of_the_time_is_likely_at_most(looks_in_all: int, share: float) -> None:
    diagnosis, budget = diagnosed_until(1.0 + share * looks_in_all)
    assert_nothing_is_established(diagnosis, budget)
    # After the end the clock is looked at a few times more, not by each of many fits.
    assert budget.used < 1.0 + share * looks_in_all + 0.6 * looks_in_all


@pytest.mark.slow
def test_a_cause_that_was_fitted_before_the_end_is_a_suspect(looks_in_all: int) -> None:
    diagnosis, _ = diagnosed_until(0.6 * looks_in_all)
    assert [suspect.effect.id for suspect in diagnosis.suspects][:1] == ["thruster_lag"]
    assert diagnosis.verdict == "suspected"
