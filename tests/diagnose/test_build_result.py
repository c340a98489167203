"""Result of a diagnosis: averaged estimates, nested models."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.diagnose.build_result import subsets
from rovid.diagnose.candidate_fits import Alternative
from rovid.diagnose.stated_selection import average_over_suspects
from rovid.diagnose.validation import Suspected
from rovid.effects import CATALOGUE
from rovid.estimate.estimate import Estimate
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fit_result import FitResult
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from tests import synthetic
from tests.predictions import BIAS, NOISE, TIME, TORQUE

FEW = 200
NAMES = ("inertia", "quadratic_drag", "linear_drag")
VALUES = np.array([3000.0, 900.0, 40.0])


def estimate() -> Estimate:
    return Estimate(
        names=NAMES, axis=synthetic.ROSUB.axis, values=VALUES, covariance=np.eye(3), method="", samples=FEW, warnings=()
    )


@pytest.fixture(scope="module")
def rival() -> Alternative:
    runs = [synthetic.run(TIME[:FEW], TORQUE[:FEW], noise=NOISE[:FEW])]
    objective = InnovationLikelihood(InnovationData(runs, synthetic.LOGGED, synthetic.ROSUB), 0.05, (BIAS,))
    return Alternative(BIAS, 10.0, FitResult.at(objective, objective.parametrization.initial()))


def test_a_suspect_adds_its_deviation_to_the_covariance_by_its_probability(rival: Alternative) -> None:
    suspected = Suspected(rival, 0.5, 10.0, ())
    off = rival.fitted.model.values[:3] - VALUES
    told = average_over_suspects(estimate(), [suspected])
    assert told.covariance == pytest.approx(np.eye(3) + 0.5 * np.outer(off, off))
    assert told.values.tolist() == VALUES.tolist()
    assert told.warnings == ("The standard errors include what constant torque would change, if it acts.",)


def test_probabilities_of_suspects_add_up_to_one_at_most(rival: Alternative) -> None:
    one, two = (
        average_over_suspects(estimate(), [Suspected(rival, 1.0, 10.0, ())]),
        [Suspected(rival, 0.8, 10.0, ())] * 2,
    )
    assert average_over_suspects(estimate(), two).covariance == pytest.approx(one.covariance)


def test_without_suspects_the_covariance_stays() -> None:
    assert average_over_suspects(estimate(), []).covariance.tolist() == np.eye(3).tolist()


def keys(count: int) -> list[tuple[str, ...]]:
    return [tuple(effect.key for effect in chosen) for chosen in subsets(CATALOGUE[:count])]


def test_up_to_three_causes_give_all_subsets() -> None:
    one, two, three = (effect.key for effect in CATALOGUE[:3])
    assert keys(0) == keys(1) == []
    assert keys(2) == [(one,), (two,)]
    assert keys(3) == [(one,), (two,), (three,), (one, two), (one, three), (two, three)]


def test_more_causes_are_added_one_by_one() -> None:
    names = tuple(effect.key for effect in CATALOGUE[:5])
    assert keys(5) == [names[:1], names[:2], names[:3], names[:4]]
