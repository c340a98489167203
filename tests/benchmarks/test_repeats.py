"""The F test of repeats against their stated errors."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.repeats import scatter, table
from rovid.estimate.estimate import Estimate
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fit_result import fit
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from tests import synthetic
from tests.predictions import TIME, TORQUE

REPEATS, COUNT = 10, 1500


def test_scatter_of_a_worked_example() -> None:
    # Weighted mean 2 and errors of 1: deviations 1, 0 and 1, sum of squares 2, two degrees of freedom.
    found = scatter([1.0, 2.0, 3.0], [1.0, 1.0, 1.0])
    assert found.ratio == pytest.approx(1.0)
    assert found.probability == pytest.approx(np.exp(-1.0))
    # A third of the errors: nine times the ratio.
    assert scatter([1.0, 2.0, 3.0], [1 / 3, 1 / 3, 1 / 3]).ratio == pytest.approx(9.0)


def test_the_scatter_between_repeats_agrees_with_the_stated_errors() -> None:
    rng, estimates = np.random.default_rng(11), []
    for _ in range(REPEATS):
        disturbance = synthetic.gauss_markov(COUNT, 0.2, 3.0, 4.0, rng)
        run = synthetic.run(TIME[:COUNT], TORQUE[:COUNT], disturbance=disturbance, noise=1e-4 * rng.normal(size=COUNT))
        objective = InnovationLikelihood(InnovationData([run], synthetic.LOGGED, synthetic.ROSUB), 0.05)
        one = fit(objective, objective.parametrization.initial())
        covariance = one.covariance(sandwich=not one.is_white)
        estimates.append(
            Estimate(names=one.model.names, values=one.model.values, covariance=covariance, method="", samples=COUNT)
        )
    values, errors = table(estimates)
    for at in range(3):
        found = scatter(values[:, at].tolist(), errors[:, at].tolist())
        # Of nine degrees of freedom, both bounds have a probability of a thousandth.
        assert 0.12 < found.ratio < 3.1
