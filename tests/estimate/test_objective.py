"""What every misfit has in common: cost, slopes and scores belong together."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.effects import effect_named
from rovid.estimate.filter_data import Readings
from rovid.estimate.fisher_information import NormalEquations, Scatter, slopes_between
from rovid.estimate.innovation_likelihood import InnovationMisfit
from tests import synthetic
from tests.predictions import NOISE, TIME, TORQUE

RUNS = [synthetic.run(TIME[:600], TORQUE[:600], noise=NOISE[:600])]


@pytest.fixture(scope="module")
def misfit() -> InnovationMisfit:
    return InnovationMisfit(Readings(RUNS, synthetic.LOGGED, synthetic.ROSUB), 0.05)


def test_the_cost_is_the_sum_of_what_each_innovation_costs(misfit: InnovationMisfit) -> None:
    x = misfit.coordinates.first()
    assert misfit.cost(x) == pytest.approx(float(np.sum(misfit.costs(x))))


def test_the_gradient_is_the_slope_of_the_cost(misfit: InnovationMisfit) -> None:
    x = misfit.coordinates.first()
    # Away from the best, so that there is a slope.
    x[0] += 0.2
    gradient = NormalEquations.of(misfit.slopes(x)).gradient
    for at in range(3):
        aside = np.zeros(len(x))
        aside[at] = 1e-4
        central = (misfit.cost(x + aside) - misfit.cost(x - aside)) / 2e-4
        assert gradient[at] == pytest.approx(central, rel=0.02, abs=0.02 * np.abs(gradient[:3]).max())


def test_scores_of_all_stretches_add_up_to_the_gradient(misfit: InnovationMisfit) -> None:
    x, groups = misfit.coordinates.first(), misfit.records.block
    here = NormalEquations.of(misfit.slopes(x))
    scatter = Scatter.of(misfit.flatter_slopes(x), [groups])
    (scores,) = scatter.scores
    assert len(scores) == len(np.unique(groups))
    assert scores.sum(axis=0) == pytest.approx(here.gradient)
    assert scatter.information == pytest.approx(here.information)
    (whole,) = misfit.slopes(x)
    assert scores[0] == pytest.approx(whole.scores[groups == groups[0]].sum(axis=0))


@pytest.mark.parametrize("at_once", [1, 7, 599])
def test_sums_are_those_of_all_innovations_however_many_are_taken_at_once(
    misfit: InnovationMisfit, at_once: int
) -> None:
    x, step = misfit.coordinates.first(), np.full(6, 1e-3)
    centre, *sides = misfit.about(x, list(x + np.diag(step)))
    whole = NormalEquations.of(slopes_between(centre, sides, step, misfit.weight))
    sums = NormalEquations.of(slopes_between(centre, sides, step, misfit.weight, at_once))
    assert sums.gradient == pytest.approx(whole.gradient)
    assert sums.information == pytest.approx(whole.information)


def test_one_with_an_effect_looks_at_the_same_records(misfit: InnovationMisfit) -> None:
    with_bias = misfit.like((effect_named("bias_torque"),))
    assert with_bias.records is misfit.records
    assert len(with_bias.coordinates.first()) == len(misfit.coordinates.first()) + 1
    # At its null it changes nothing.
    nothing = np.append(misfit.coordinates.first(), 0.0)
    assert with_bias.cost(nothing) == pytest.approx(misfit.cost(misfit.coordinates.first()))
