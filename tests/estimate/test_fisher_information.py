"""What an innovation costs."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
from scipy.stats import norm

from rovid.estimate.fisher_information import OUTLIER, negative_log_likelihoods


def test_costs_are_those_of_a_normal_distribution_but_for_outliers() -> None:
    error, variance = np.array([0.0, 0.5, -1.0]), np.array([1.0, 4.0, 0.25])
    assert negative_log_likelihoods(error, variance) == pytest.approx(-norm.logpdf(error, scale=np.sqrt(variance)))
    # Beyond the limit in proportion, and without a jump in value or slope.
    near, far, farther = negative_log_likelihoods(OUTLIER + np.array([0.0, 1.0, 2.0]), np.ones(3))
    assert far - near == pytest.approx(OUTLIER)
    assert farther - far == pytest.approx(OUTLIER)


def test_an_innovation_that_ran_away_costs_no_infinity() -> None:
    assert np.isfinite(negative_log_likelihoods(np.array([1e200]), np.ones(1))).all()


def test_a_filter_that_ran_away_has_no_likelihood_and_warns_of_nothing() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        runaway, sound = negative_log_likelihoods(np.ones(2), np.array([-1.0, 1.0]))
    assert math.isnan(runaway)
    assert math.isfinite(sound)
