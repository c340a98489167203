"""Stepwise search, objectives and thresholds."""

from __future__ import annotations

import ast
import inspect
from dataclasses import fields, replace

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.diagnose import thresholds
from rovid.diagnose.candidate_fits import bic_score, simplest_form
from rovid.diagnose.objectives import has_no_dominant_cause, missing_log_likelihood, with_real_disturbance
from rovid.diagnose.stepwise import SearchStop, StepwiseSearch
from rovid.diagnose.thresholds import THRESHOLDS, Thresholds
from rovid.effects import effect_named
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.estimate.maximum_likelihood import DISTURBANCE_LIMITS, REAL_DISTURBANCE_LIMIT
from rovid.estimate.multi_step import MultiStepLikelihood
from tests import synthetic
from tests.predictions import BIAS, biased

CANDIDATES = [BIAS, effect_named("drag_curvature"), effect_named("thrust_asymmetry")]


@pytest.fixture(scope="module")
def base() -> FitResult:
    plain = MultiStepLikelihood(biased())
    return fit(plain, plain.parametrization.initial())


def test_a_search_ends_at_an_adequate_model_and_another_continues_there(base: FitResult) -> None:
    search = StepwiseSearch(CANDIDATES, is_adequate=lambda found: bool(found.effects))
    early = search.run(base)
    assert search.progress.stops == {SearchStop.ADEQUATE}
    assert early.effects == (BIAS,)
    # Further effects were not screened.
    assert early.key not in search.cache.score_tests
    further = StepwiseSearch(CANDIDATES)
    later, whole = further.run(early), StepwiseSearch(CANDIDATES).run(base)
    assert early.key in further.cache.score_tests
    assert later.effects == whole.effects == (BIAS,)
    assert later.x == pytest.approx(whole.x, rel=1e-6)


def test_an_adequate_base_model_is_not_screened(base: FitResult) -> None:
    search = StepwiseSearch(CANDIDATES, is_adequate=lambda _: True)
    assert search.run(base) is base
    assert search.cache.score_tests == {}


def test_a_model_that_fits_poorly_is_never_adequate(base: FitResult) -> None:
    search = StepwiseSearch(CANDIDATES, is_adequate=lambda _: True, fits_poorly=lambda found: not found.effects)
    assert search.run(base).effects == (BIAS,)


def test_a_stop_rule_that_never_holds_changes_nothing(base: FitResult) -> None:
    asked: list[tuple[str, ...]] = []

    def enough(found: FitResult) -> bool:
        asked.append(tuple(effect.id for effect in found.effects))
        return False

    found, plain = StepwiseSearch(CANDIDATES, is_adequate=enough).run(base), StepwiseSearch(CANDIDATES).run(base)
    assert found.effects == plain.effects == (BIAS,)
    assert np.array_equal(found.x, plain.x)
    assert {*asked} == {(), ("bias_torque",)}


def with_form(current: FitResult, key: str, gains: float) -> FitResult:
    """``current`` with one form more and the BIC gain ``gains``."""
    effect = effect_named(key)
    objective = current.objective.with_effects((*current.effects, effect))
    fitted = FitResult(objective, np.concatenate((current.x, effect.initial_values[0])), 0.0)
    return replace(fitted, value=bic_score(fitted) - bic_score(current) - gains)


def test_a_simpler_form_with_nearly_the_gain_is_preferred_while_a_cause_is_missing(base: FitResult) -> None:
    smooth, scattered = with_form(base, "command_delay", 97.0), with_form(base, "command_delay:scattered", 100.0)
    other = with_form(base, "thruster_lag", 98.0)
    assert bic_score(scattered) - bic_score(base) == pytest.approx(100.0)
    assert not scattered.is_white
    assert simplest_form(scattered, [other, smooth, scattered], base) is smooth
    assert simplest_form(scattered, [other, with_form(base, "command_delay", 95.0), scattered], base) is scattered
    assert simplest_form(smooth, [other, smooth, scattered], base) is smooth


def test_with_white_innovations_the_form_with_the_largest_gain_is_preferred(
    base: FitResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    smooth, scattered = with_form(base, "command_delay", 97.0), with_form(base, "command_delay:scattered", 100.0)
    monkeypatch.setattr(FitResult, "is_white", True)
    assert simplest_form(scattered, [smooth, scattered], base) is scattered


TIME = synthetic.clock(400.0, 5.0)
TORQUE = 250.0 * np.sin(TIME / 9.0) + 150.0 * np.sign(np.sin(TIME / 31.0))
(WIDEST, *_) = DISTURBANCE_LIMITS


def plain(share: float, missed: FloatArray) -> FitResult:
    """The plain model under the widest limit, with a disturbance of that share of the RMS torque, and a missed one."""
    size = share * float(np.sqrt(np.mean(TORQUE**2)))
    water = synthetic.gauss_markov(len(TIME), 0.2, size, 2.0, np.random.default_rng(9)) + missed
    noise = np.random.default_rng(5).normal(0.0, 1e-3, len(TIME))
    runs = [synthetic.run(TIME, TORQUE, disturbance=water, noise=noise)]
    objective = InnovationLikelihood(InnovationData(runs, synthetic.LOGGED, synthetic.ROSUB), WIDEST)
    return fit(objective, objective.parametrization.initial())


def test_a_disturbance_just_above_the_limit_is_real() -> None:
    """No cause can remove it, so it must not end the search for one."""
    fitted = plain(1.2 * WIDEST, np.zeros(len(TIME)))
    assert fitted.at_limit
    assert fitted.is_white
    assert missing_log_likelihood(fitted)[0] < THRESHOLDS.bic_margin
    assert has_no_dominant_cause(fitted, list)
    found = with_real_disturbance(fitted)
    assert found.objective.limit == REAL_DISTURBANCE_LIMIT
    assert found.is_adequate
    assert not has_no_dominant_cause(found, list)


@pytest.mark.parametrize("kind", ["within the limit", "far above it", "coloured"])
def test_any_other_plain_model_keeps_its_limit(kind: str) -> None:
    lag = np.where(np.sin(TIME / 31.0) > 0.0, 150.0, -150.0)
    shares = {"within the limit": 0.5, "far above it": 3.0, "coloured": 1.0}
    fitted = plain(shares[kind] * WIDEST, (np.roll(lag, 6) - lag) * (kind == "coloured"))
    assert with_real_disturbance(fitted) is fitted


def texts() -> dict[str, str]:
    """Name of each field and the text below it."""
    (record,) = [node for node in ast.parse(inspect.getsource(thresholds)).body if isinstance(node, ast.ClassDef)]
    found = {}
    for node, below in zip(record.body, record.body[1:], strict=False):
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            assert isinstance(below, ast.Expr)
            assert isinstance(below.value, ast.Constant)
            found[node.target.id] = " ".join(str(below.value.value).split())
    return found


@pytest.mark.parametrize("name", [field.name for field in fields(Thresholds)])
def test_a_threshold_states_its_unit_origin_and_sensitivity(name: str) -> None:
    text = texts()[name]
    assert ("Set: " in text and "alved" in text) or text.startswith(("As ", "The same")), text


def test_probabilities_are_ordered() -> None:
    assert 0.0 < THRESHOLDS.possible < THRESHOLDS.likely < THRESHOLDS.established < THRESHOLDS.max_probability < 1.0
