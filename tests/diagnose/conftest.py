"""A selected model in which a constant torque acts."""

from __future__ import annotations

from dataclasses import replace

import pytest

from rovid.diagnose.candidate_fits import FitCache
from rovid.diagnose.cross_validation import cv_pieces
from rovid.diagnose.selection import Selection
from rovid.diagnose.stepwise import StepwiseSearch
from rovid.effects import effect_named
from rovid.estimate.fit_result import fit
from rovid.estimate.multi_step import MultiStepLikelihood
from tests import synthetic
from tests.predictions import BIAS, biased


@pytest.fixture(scope="module")
def searched() -> Selection:
    """A constant torque that acts, as selected by multi-step predictions."""
    data = biased()
    objective = MultiStepLikelihood(data)
    base = fit(objective, objective.parametrization.initial())
    search = StepwiseSearch([BIAS, effect_named("drag_curvature"), effect_named("thrust_asymmetry")])
    pieces = cv_pieces(data.runs, synthetic.LOGGED, 1.0)
    model = search.run(base)
    assert model.effects == (BIAS,)
    return Selection(search=search, data=data, base=base, model=model, pieces=pieces, multi_step=True)


@pytest.fixture
def selection(searched: Selection) -> Selection:
    """The same with caches of its own, since tests put made-up fits into them."""
    cache = searched.search.cache
    own = FitCache(score_tests=dict(cache.score_tests), extensions=dict(cache.extensions), fits=dict(cache.fits))
    return replace(searched, search=replace(searched.search, cache=own))
