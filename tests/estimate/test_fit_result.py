"""A fitted model: coordinates and covariance."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.effects import effect_named
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from tests import synthetic
from tests.predictions import BIAS, NOISE, TIME, TORQUE

LAG = effect_named("thruster_lag")


@pytest.fixture(scope="module")
def plain() -> FitResult:
    runs = [synthetic.run(TIME[:1500], TORQUE[:1500], noise=NOISE[:1500])]
    objective = InnovationLikelihood(InnovationData(runs, synthetic.LOGGED, synthetic.ROSUB), 0.05)
    return fit(objective, objective.parametrization.initial())


def test_coordinates_of_an_effect_and_of_the_rest(plain: FitResult) -> None:
    x = np.concatenate((plain.x, [0.25, 0.5]))
    both = FitResult.at(plain.objective.with_effects((BIAS, LAG)), x)
    assert both.effect_coordinates(BIAS).tolist() == [0.25]
    assert both.effect_coordinates(LAG).tolist() == [0.5]
    assert (both.common_coordinates == plain.x).all()
    effects, rest = both.without(BIAS)
    assert effects == (LAG,)
    assert rest.tolist() == [*plain.x, 0.5]


def test_the_fit_is_physical_white_and_near_the_truth(plain: FitResult) -> None:
    assert plain.is_physical
    assert plain.is_white
    assert plain.simulated_r2 > 0.999
    error = np.sqrt(plain.covariance(sandwich=False)[0, 0])
    # Four standard errors, of a fixed seed.
    assert abs(plain.model.inertia - synthetic.ROSUB.inertia) < 4.0 * error


def test_covariance_is_infinite_where_a_neighbour_diverges(plain: FitResult, monkeypatch: pytest.MonkeyPatch) -> None:
    first, *others = plain.objective.jacobian(plain.x)
    first.matrix[7, 1] = np.nan
    monkeypatch.setattr(InnovationLikelihood, "robust_jacobian", lambda *_: [first, *others])
    for sandwich in (False, True):
        assert np.isinf(np.diag(plain.covariance(sandwich=sandwich))).all()


def test_a_threshold_between_two_commands_has_the_error_of_the_gap_between_them() -> None:
    """The likelihood has no slope there, and loses much at the nearest commands: 20 N m starts nothing, 100 does."""
    switch = effect_named("command_hysteresis:schmitt")
    time = synthetic.clock(400.0, 5.0)
    levels = np.tile([20.0, 0.0, 100.0, 0.0, -20.0, 0.0, -160.0, 0.0, 160.0, 0.0], 4)
    commanded = np.repeat(levels, 50)[: len(time)]
    commanded = np.append(commanded, np.zeros(len(time) - len(commanded)))
    acting = np.where(np.abs(commanded) > 50.0, commanded, 0.0)
    noise = np.random.default_rng(3).normal(0.0, 3e-4, len(time))
    runs = [synthetic.run(time, commanded, disturbance=acting - commanded, noise=noise)]
    objective = InnovationLikelihood(InnovationData(runs, synthetic.LOGGED, synthetic.ROSUB), 0.05, (switch,))
    start = objective.parametrization.initial()
    width = 60.0
    start[-1] = width / objective.parametrization.units[-1]
    found = fit(objective, start)
    assert found.model.values[-1] == pytest.approx(width)
    error, wider = (float(np.sqrt(found.covariance(sandwich=one)[-1, -1])) for one in (False, True))
    # Up to the ramp of the switch the gap is 20 to 100 N m; errors grow by a factor until the likelihood falls.
    assert 0.2 * (width - 20.0) < error < 2.0 * (100.0 - width)
    assert error <= wider < 10.0 * error
