"""Objectives of the search: when a disturbance above the usual limit counts as real."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.diagnose.objectives import has_no_dominant_cause, missing_log_likelihood, with_real_disturbance
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.estimate.maximum_likelihood import DISTURBANCE_LIMITS, REAL_DISTURBANCE_LIMIT
from tests import synthetic

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
