"""What is known of models need not be worked out again."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from rovid.diagnose import bic, fit_cache
from rovid.diagnose.fit_cache import Known
from rovid.effects import Effect, effect_named
from rovid.estimate.fit_result import Fitted, climbed
from rovid.estimate.multi_step_likelihood import HorizonMisfit
from tests.predictions import BIAS, biased

BEND, UNEQUAL = effect_named("drag_curvature"), effect_named("thrust_asymmetry")


@pytest.fixture(scope="module")
def base() -> Fitted:
    plain = HorizonMisfit(biased())
    return climbed(plain, plain.coordinates.first())


def with_effects(base: Fitted, *effects: Effect) -> Fitted:
    """As they start, as if that were the end of a climb."""
    x = np.concatenate((base.x, *(effect.starts[0] for effect in effects)))
    return replace(Fitted.at(base.misfit.like(effects), x), left=0.0)


def test_a_model_without_several_of_its_effects_is_fitted_once(base: Fitted, monkeypatch: pytest.MonkeyPatch) -> None:
    models, whole = Known(), with_effects(base, BIAS, BEND, UNEQUAL)
    rest = models.without(whole, BEND, UNEQUAL)
    assert rest.effects == (BIAS,)
    assert rest.cost < with_effects(base, BIAS).cost
    # Nothing is fitted on the way, and it is known from then on.
    assert [*models.fits] == [rest.key]
    monkeypatch.setattr(fit_cache, "quickly_climbed", None)
    assert models.without(whole, UNEQUAL, BEND) is rest
    assert models.without(whole) is whole


def test_what_was_left_behind_is_followed_to_its_end_before_it_stands_for_a_model_without_an_effect(
    base: Fitted,
) -> None:
    models, left = Known(), replace(with_effects(base, BIAS), left=math.inf)
    models.fits[left.key] = left
    ended = models.without(with_effects(base, BIAS, BEND), BEND)
    assert ended.cost < left.cost
    assert models.fits[left.key] is ended
    assert models.ended(ended) is ended


def test_ends_beside_a_model_have_one_effect_more_which_stands_last(base: Fitted) -> None:
    models, here = Known(), with_effects(base, BIAS)
    ended, unfinished = with_effects(base, BEND, BIAS), replace(with_effects(base, BIAS, UNEQUAL), left=math.inf)
    every = with_effects(base, BIAS, BEND, UNEQUAL)
    looser = replace(ended, misfit=replace(ended.misfit, limit=0.5))
    models.fits.update({fit.key: fit for fit in (here, ended, unfinished, every, looser)})
    ((key, found),) = models.ends_beside(here).items()
    assert key == BEND.key
    assert found.effects == (BIAS, BEND)
    assert found.cost == ended.cost
    assert found.model.values == pytest.approx(with_effects(base, BIAS, BEND).model.values)


def test_a_fit_worse_than_one_with_an_effect_less_is_begun_anew_from_there(
    base: Fitted, monkeypatch: pytest.MonkeyPatch
) -> None:
    models, plain = Known(), replace(base, left=0.0)
    models.fits[plain.key] = plain
    astray = replace(with_effects(base, BEND), cost=plain.cost + 5.0)
    climb, climbs = bic.quickly_climbed, [astray]
    monkeypatch.setattr(fit_cache, "quickly_climbed", lambda *told: climbs.pop() if climbs else climb(*told))
    models.fit(base.misfit, [((BEND,), astray.x)])
    assert models.fits[astray.key].cost <= plain.cost
    assert climbs == []
