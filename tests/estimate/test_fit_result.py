"""A fit with its covariance, and the normal equations behind it."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal
from scipy.stats import norm

from rovid.core.array_types import FloatArray
from rovid.effects import effect_named
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fisher_information import (
    OUTLIER,
    inverse_information,
    inverse_of_triangle,
    is_white,
    negative_log_likelihoods,
    sandwich_covariance,
    whitening_gain,
)
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


def test_a_fit_whose_coordinates_are_tidy_is_its_own_canonical_fit(plain: FitResult) -> None:
    """What was computed of it is then known."""
    biased = FitResult.at(plain.objective.with_effects((BIAS,)), np.append(plain.x, -0.1))
    assert biased.canonical() is biased


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


@pytest.mark.parametrize(("share", "physical"), [(0.9, True), (1.1, False)])
def test_water_that_drives_the_vehicle_is_not_physical(plain: FitResult, share: float, physical: bool) -> None:
    memory, time_constant = effect_named("added_mass_memory"), 2.0
    slope = plain.model.damping(plain.data.scales.rate)
    objective = plain.objective.with_effects((memory,))
    scales = [plain.data.scales.unit_size(parameter) for parameter in memory.parameters]
    added = [-share * slope * time_constant / scales[0], time_constant / scales[1]]
    fitted = FitResult.at(objective, np.concatenate((plain.x, added)))
    assert fitted.model.values[-2:] == pytest.approx([-share * slope * time_constant, time_constant])
    assert fitted.is_physical == physical


def test_covariance_is_infinite_where_a_neighbour_diverges(plain: FitResult, monkeypatch: pytest.MonkeyPatch) -> None:
    first, *others = plain.objective.jacobian(plain.x)
    first.matrix[7, 1] = np.nan
    monkeypatch.setattr(InnovationLikelihood, "robust_jacobian", lambda *_: [first, *others])
    for sandwich in (False, True):
        assert np.isinf(np.diag(plain.covariance(sandwich=sandwich))).all()


def test_a_threshold_between_two_commands_has_the_error_of_the_gap_between_them() -> None:
    """The likelihood has no slope there, and loses much at the nearest commands: 20 N m starts nothing, 60 does."""
    switch = effect_named("command_hysteresis:schmitt")
    time = synthetic.clock(400.0, 5.0)
    levels = np.tile([20.0, 0.0, 60.0, 0.0, -20.0, 0.0, -60.0, 0.0, 160.0, 0.0, -160.0, 0.0], 4)
    commanded = np.repeat(levels, 50)[: len(time)]
    commanded = np.append(commanded, np.zeros(len(time) - len(commanded)))
    acting = np.where(np.abs(commanded) > 35.0, commanded, 0.0)
    noise = np.random.default_rng(3).normal(0.0, 3e-4, len(time))
    run = synthetic.run(time, commanded, disturbance=acting - commanded, noise=noise)
    run = replace(run, trial=replace(run.trial, commands=commanded[:, None] / 100.0))  # in V
    objective = InnovationLikelihood(InnovationData([run], synthetic.VEHICLE, synthetic.ROSUB), 0.05, (switch,))
    start = objective.parametrization.initial()
    start[-1] = 0.4 / objective.parametrization.units[-1]
    found = fit(objective, start)
    assert 0.2 < found.model.values[-1] < 0.6
    error, wider = (float(np.sqrt(found.covariance(sandwich=one)[-1, -1])) for one in (False, True))
    unit = objective.parametrization.units[-1]
    tried = [np.append(found.x[:-1], width / unit) for width in np.arange(0.15, 0.65, 0.005)]
    weight = np.exp(found.value - np.array([objective.value(x) for x in tried]))
    distance = np.array([x[-1] for x in tried]) * unit - found.model.values[-1]
    expected = math.sqrt(float(weight @ distance**2 / weight.sum()))
    assert error == pytest.approx(expected, rel=0.25)
    assert 0.02 < error < 0.2
    assert error <= wider < 10.0 * error


def test_likelihood_is_normal_except_for_outliers() -> None:
    error, variance = np.array([0.0, 0.5, -1.0]), np.array([1.0, 4.0, 0.25])
    assert negative_log_likelihoods(error, variance) == pytest.approx(-norm.logpdf(error, scale=np.sqrt(variance)))
    # Beyond the limit in proportion, and without a jump in value or slope.
    near, far, farther = negative_log_likelihoods(OUTLIER + np.array([0.0, 1.0, 2.0]), np.ones(3))
    assert far - near == pytest.approx(OUTLIER)
    assert farther - far == pytest.approx(OUTLIER)


def test_a_diverged_innovation_has_a_finite_likelihood() -> None:
    assert np.isfinite(negative_log_likelihoods(np.array([1e200]), np.ones(1))).all()


def test_a_negative_variance_gives_nan_without_a_warning() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        runaway, sound = negative_log_likelihoods(np.ones(2), np.array([-1.0, 1.0]))
    assert math.isnan(runaway)
    assert math.isfinite(sound)


UNITS = np.diag((1e6, 1e-3))
SHAPE = np.array([[2.0, 0.5], [0.5, 1.0]])


def test_the_inverse_does_not_depend_on_units() -> None:
    inverse = pytest.approx(np.linalg.inv(UNITS @ SHAPE @ UNITS), rel=1e-6)
    assert inverse_information(UNITS @ SHAPE @ UNITS) == inverse
    assert inverse_of_triangle(np.linalg.cholesky(SHAPE).T @ UNITS) == inverse


@pytest.mark.parametrize("flat", [inverse_information(np.ones((2, 2))), inverse_of_triangle(np.ones((1, 2)))])
def test_a_flat_direction_gets_a_large_finite_variance(flat: FloatArray) -> None:
    assert np.isfinite(flat).all()
    # The sum of both is known, their difference is not.
    along, across = np.array([1.0, 1.0]), np.array([1.0, -1.0])
    assert along @ flat @ along == pytest.approx(1.0, rel=1e-6)
    assert across @ flat @ across > 1e6


def test_the_sandwich_equals_the_inverse_information_for_consistent_scores() -> None:
    rng = np.random.default_rng(1)
    scores = rng.multivariate_normal([0.0, 0.0], SHAPE, 20_000)
    bread = np.linalg.inv(SHAPE * len(scores))
    # Scatter of so many is known to one percent.
    assert sandwich_covariance(bread, scores) == pytest.approx(bread, rel=0.05)
    assert sandwich_covariance(bread, 2.0 * scores) == pytest.approx(4.0 * sandwich_covariance(bread, scores))


@pytest.mark.parametrize("count", [0, 1])
def test_the_sandwich_of_fewer_than_two_groups_is_the_inverse_information(count: int) -> None:
    bread = np.linalg.inv(SHAPE)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_array_equal(sandwich_covariance(bread, np.ones((count, 2))), bread)


@pytest.mark.parametrize("name", ["coloured", "spiky"])
def test_coloured_and_spiky_series_are_not_white(name: str) -> None:
    rng = np.random.default_rng()
    white = rng.normal(size=20_000)
    series = {
        "coloured": white[1:] + 0.1 * white[:-1],
        "spiky": np.where(rng.random(20_000) < 0.005, 20.0, 1.0) * white,
    }[name]
    assert not is_white([series])


def test_white_series_are_seldom_rejected() -> None:
    rng = np.random.default_rng()
    trials = rng.normal(size=(200, 25, 200))
    # One in a thousand expected: more than three of 200 happens once in 15 000 runs.
    assert sum(not is_white(list(series)) for series in trials) <= 3


def test_the_whitening_gain_of_a_first_order_autoregression() -> None:
    """Of a first-order autoregression of unit variance: half the count times -log(1 - a^2)."""
    rng, memory, count = np.random.default_rng(3), 0.6, 20000
    noise = rng.normal(size=count) * math.sqrt(1.0 - memory**2)
    series = signal.lfilter([1.0], [1.0, -memory], noise)
    assert whitening_gain([series]) == pytest.approx(-0.5 * count * math.log(1.0 - memory**2), rel=0.03)
    assert whitening_gain([rng.normal(size=count)]) < 30.0
    assert whitening_gain([np.zeros(50)]) == 0.0
    assert whitening_gain([np.array([1.0] + 60 * [np.nan])]) == 0.0
    assert math.isfinite(whitening_gain([np.ones(50)]))
