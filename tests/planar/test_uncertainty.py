"""Errors of a planar fit contain the uncertainty of its disturbance, and a disturbance that hardly shows has a size."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.planar.coordinates import PlanarCoordinates
from rovid.planar.dataset import PlanarData
from rovid.planar.effect_fits import with_hull_lift
from rovid.planar.fit import fit_base
from rovid.planar.likelihood import PlanarLikelihood
from rovid.planar.model import PlanarModel
from rovid.planar.optimum import PlanarOptimum
from rovid.planar.start_values import planar_grid, planar_sizes, start_values
from rovid.planar.uncertainty import _text, growth, misfit_variance, total_covariance
from tests.planar.vehicles import Truth, campaign, torpedo


@pytest.fixture(scope="module")
def calm() -> tuple[PlanarData, PlanarOptimum]:
    """Headings of one short run, and their fit; the disturbance is smaller than the noise."""
    truth = Truth(
        base=(30.0, 40.0, 4.0, 0.0, 8.0, 12.0, 1.0, 20.0, 30.0, 2.0),
        levers=((0.0, 0.0, 3.0),),
        noise={"heading": (0.01, 0.1)},
        disturbance=(0.0, 0.0, 0.01),
        memory=8.0,
    )
    data = campaign(truth, runs=1, levels=8, hold=5.0, seed=21)
    return data, fit_base(data)


def test_what_is_known_stays_known_next_to_what_is_not() -> None:
    """Two parameters of which the logs determine the sum, and a spread of their difference."""
    flat, tight = np.array([1.0, -1.0]), np.array([1.0, 1.0])
    centre = np.outer(flat, flat) + 1e-8 * np.outer(tight, tight)
    spread = 3.0 * np.outer(flat, flat) - 1e-9 * np.outer(tight, tight)
    grown = growth(centre, spread)
    total = grown @ centre @ grown.T
    np.testing.assert_allclose(total, centre + 3.0 * np.outer(flat, flat), rtol=1e-6)
    # The difference has twice the error; that of the sum stays, by 1e-4 of the difference's.
    assert tight @ total @ tight == pytest.approx(4e-8, rel=1e-3)


def test_gradient_information_and_covariance_take_one_jacobian(
    calm: tuple[PlanarData, PlanarOptimum], monkeypatch: pytest.MonkeyPatch
) -> None:
    best, taken, jacobian = replace(calm[1]), list[Any](), PlanarLikelihood.jacobian

    def counted(likelihood: PlanarLikelihood, x: FloatArray) -> Any:
        taken.append(x)
        return jacobian(likelihood, x)

    expected = best.likelihood.equations(best.x)
    monkeypatch.setattr(PlanarLikelihood, "jacobian", counted)
    np.testing.assert_array_equal(best.equations.information, expected.information)
    assert np.isfinite(best.coordinate_covariance).all()
    assert len(taken) == 1


def test_axes_that_miss_a_force_have_the_errors_of_a_specification_error() -> None:
    """A regression that lacks a force of any correlation is as far from the truth as the error says."""
    names = ("surge.inertia", "sway.inertia", "yaw.inertia", "sway_yaw.inertia", "rudder.r.lift")
    best: Any = SimpleNamespace(
        limited=np.array([True, True, False]), coordinates=SimpleNamespace(base_names=names), model=None
    )
    found = misfit_variance(best, {"surge": 0.64, "sway": 0.97, "yaw": 0.5}, np.full(6, 2.0))
    rng, count = np.random.default_rng(3), 4000
    known = rng.normal(size=count)
    errors = []
    for correlation in rng.uniform(-1.0, 1.0, 2000):
        # The missing force has the share 0.6 of the forces, whose squares are 1 - 0.64.
        missing = 0.6 * (correlation * known + np.sqrt(1.0 - correlation**2) * rng.normal(size=count))
        errors.append(2.0 * float(known @ missing / (known @ known)))
    assert np.sqrt(found[0]) == pytest.approx(np.std(errors), rel=0.05)  # 3 sigma of 2000 draws
    # Sway simulates well, and the disturbance of yaw is within its limit.
    assert found[1:].tolist() == [0.0] * 5


def test_a_disturbance_that_hardly_shows_stays_within_its_bounds(calm: tuple[PlanarData, PlanarOptimum]) -> None:
    best = calm[1]
    own = best.coordinates.noise_begin + np.array([2, 5])  # Size and correlation time of the disturbance of yaw.
    assert np.all(best.x[own] > best.coordinates.low[own] + 0.5)
    assert np.all(best.x[own] < best.coordinates.high[own] - 0.5)


def test_errors_contain_the_scatter_over_likely_disturbances(calm: tuple[PlanarData, PlanarOptimum]) -> None:
    best = calm[1]
    coordinates, at = best.coordinates, best.coordinates.noise_begin + 2
    error = float(np.sqrt(best.coordinate_covariance[at, at]))
    inertias, variances = [], []
    # Sizes with the weights of their normal density; each has a complete fit of the parameters.
    steps = np.linspace(-2.5, 2.5, 11)
    for step in steps.tolist():
        x = best.x.copy()
        x[at:] = coordinates.projected(best.x + step * error * (np.arange(len(x)) == at))[at:]
        held = coordinates.bounded({number: (x[number], x[number]) for number in range(at - 2, len(x))})
        fitted = PlanarOptimum.fit(best.likelihood.with_coordinates(held), x)
        inertias.append(fitted.model.base[2])
        variances.append(np.linalg.inv(fitted.equations.information[np.ix_((2, 6, 9), (2, 6, 9))])[0, 0])
    weights = np.exp(-0.5 * steps**2) / np.exp(-0.5 * steps**2).sum()
    scales = np.array(variances) * (2.0 * best.model.base[2]) ** 2  # The coordinate is half a logarithm.
    mean = float(weights @ inertias)
    by_size = float(weights @ (scales + (np.array(inertias) - mean) ** 2))
    found, plain = total_covariance(best)[2, 2], best.covariance[2, 2]
    # The correlation time adds more; three points stand for eleven.
    assert by_size > 1.1 * plain
    assert found > 0.9 * by_size


def test_a_disturbance_at_its_limit_adds_the_change_under_a_looser_one() -> None:
    truth = Truth(
        base=(30.0, 40.0, 4.0, 0.0, 8.0, 12.0, 1.0, 20.0, 30.0, 2.0),
        levers=((0.0, 0.0, 3.0),),
        noise={"heading": (0.005, 0.1)},
        disturbance=(0.0, 0.0, 0.6),
    )
    best = fit_base(campaign(truth, runs=1, levels=12, hold=5.0, seed=5))
    assert best.limited.tolist() == [False, False, True]
    # A fifth of the torque is ten times the limit: the errors by the curvature are far too small.
    assert total_covariance(best)[2, 2] > 1.2 * best.covariance[2, 2]


def test_a_hull_without_lift_is_not_fitted_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    truth = torpedo(3)
    assert truth.rudder is not None
    data = campaign(truth, runs=1, levels=8, hold=8.0, seed=3)
    start = start_values(data, with_current=False)[1]
    sizes = planar_sizes(data, start)
    rudders = tuple(replace(one, lift=truth.rudder[1], stall=3.0) for one in start.model.rudders)
    model = PlanarModel(base=np.array(truth.base), rudders=rudders)
    coordinates = PlanarCoordinates.of(model, sizes, data.sensors, yaw_only=False)
    likelihood = PlanarLikelihood(planar_grid(data, sizes, yaw_only=False, interval=0.0), coordinates)
    x = coordinates.initial(model, ())
    x[coordinates.noise_begin :][:6] = np.log([*truth.disturbance, *[truth.memory] * 3])
    best = PlanarOptimum.fit(likelihood, x, iterations=3)
    assert best.is_white
    monkeypatch.setattr(PlanarOptimum, "fit", None)
    assert with_hull_lift(best, data) is best


def test_a_combination_says_which_parameter_grows_and_which_falls() -> None:
    text = _text({"a": 1.0, "b": -0.7, "c": 0.5, "d": 0.3, "e": 0.2})
    assert text.endswith(
        "hardly change if a grows, b falls, c grows, d grows and another one changes, each by a share of its own."
    )
    assert text.startswith("These runs do not determine each of these parameters")
