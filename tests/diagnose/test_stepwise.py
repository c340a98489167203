"""Stepwise search: its end, its continuation, and the choice of forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rovid.diagnose.candidate_fits import bic_score, simplest_form
from rovid.diagnose.stepwise import SearchStop, StepwiseSearch
from rovid.effects import effect_named
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.multi_step import MultiStepLikelihood
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


def test_a_simpler_form_with_nearly_the_gain_is_preferred_while_a_cause_is_missing(
    base: FitResult,
) -> None:
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
