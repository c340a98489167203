"""A prior decides what the logs leave open, is contradicted by name, and counts the same in every model."""

import math
from dataclasses import replace

import numpy as np
import pytest

from rovid.effects import effect_named
from rovid.planar.dataset import PlanarData
from rovid.planar.fit import PlanarFit, fit_base, fit_planar
from rovid.planar.held_out import Parts
from rovid.planar.likelihood import PlanarPrior, PriorValue
from rovid.planar.uncertainty import PriorUse
from rovid.trial.vehicle import hull_parameters
from tests.planar.vehicles import Truth, campaign

BASE = (30.0, 40.0, 4.0, 0.0, 8.0, 12.0, 1.0, 20.0, 30.0, 2.0)


def prior(**values: tuple[float, float]) -> PlanarPrior:
    """Values and standard errors of parameters of yaw."""
    known = {f"yaw.{name}": PriorValue(value=one, standard_error=se, source="x") for name, (one, se) in values.items()}
    return PlanarPrior(known)


@pytest.fixture(scope="module")
def short_turns() -> PlanarData:
    """Headings of half a minute at one speed, which linear and quadratic drag explain alike."""
    levers, noise = ((0.0, 0.0, 0.3),), {"heading": (0.05, 0.2)}
    truth = Truth(base=BASE, levers=levers, noise=noise, disturbance=(0.0, 0.0, 0.01))
    return campaign(truth, runs=2, levels=6, hold=3.0, seed=5)


@pytest.fixture(scope="module")
def alone(short_turns: PlanarData) -> PlanarFit:
    """The fit without a prior."""
    return fit_planar(short_turns)


def test_a_right_prior_decides_what_the_logs_leave_open(short_turns: PlanarData, alone: PlanarFit) -> None:
    both = ("yaw.linear_drag", "yaw.quadratic_drag")
    assert set(both) <= set(alone.estimate.refused)
    assert alone.prior == PriorUse()
    assert alone.estimate.from_prior == ()
    fitted = fit_planar(replace(short_turns, prior=prior(quadratic_drag=(2.4, 0.5), inertia=(5.0, 1.5))))
    # The linear drag has no prior, but it is known only with that of the quadratic one.
    assert fitted.prior.decided == fitted.estimate.from_prior == both
    assert set(both) <= set(fitted.prior.only_by_prior[0].combination)
    assert not fitted.prior.contradictions
    for name in ("yaw.inertia", *both):
        truth = BASE[fitted.estimate.names.index(name)]
        # 3 sigma, fixed seed. The prior of the drag is 0.8 standard errors off, the one of the inertia 0.7.
        assert fitted.estimate.value(name) == pytest.approx(truth, abs=3.0 * fitted.estimate.standard_error(name))
    # The prior is no part of the log-likelihood, which is below its largest value by what the prior changes.
    assert 0.0 <= alone.log_likelihood - fitted.log_likelihood < 2.0


def test_a_contradiction_is_named_with_both_values(short_turns: PlanarData, alone: PlanarFit) -> None:
    fitted = fit_planar(replace(short_turns, prior=prior(inertia=(9.0, 0.9))))
    (sentence,) = fitted.prior.contradictions
    assert sentence in fitted.warnings
    assert "9.00 ± 0.90 kg m^2 by x" in sentence
    by_logs = float(sentence.partition("by x, ")[2].split()[0])
    # The fit without the prior is extrapolated as if the likelihood was normal.
    assert by_logs == pytest.approx(
        alone.estimate.value("yaw.inertia"), abs=2.0 * alone.estimate.standard_error("yaw.inertia")
    )


def test_the_penalty_is_the_same_in_every_model_and_in_every_fold(short_turns: PlanarData) -> None:
    base = fit_base(replace(short_turns, prior=prior(linear_drag=(0.5, 0.1))))
    lag = effect_named("thruster_lag")
    coordinates, at = base.coordinates.with_effect(lag), base.coordinates.noise_begin
    own = lag.initial_values[0]
    larger = base.likelihood.with_coordinates(coordinates)
    x = np.concatenate((base.x[:at], own, base.x[at:]))
    penalties = [one.value(point) - one.of_logs.value(point) for one, point in ((base.likelihood, base.x), (larger, x))]
    assert penalties[0] == pytest.approx(penalties[1], abs=1e-6)  # Rounding of sums of some hundred nats.
    parts = Parts(short_turns, base).of_innovations
    # Six of the disturbance, and that of the drag.
    assert np.flatnonzero(parts < 0).tolist() == list(range(len(parts) - 7, len(parts)))


def test_a_prior_without_weight_leaves_the_errors_of_correlated_innovations() -> None:
    truth = Truth(base=BASE, levers=((0.0, 0.0, 0.5),), noise={"heading": (0.01, 0.2)}, disturbance=(0.0, 0.0, 0.03))
    best = fit_base(campaign(truth, runs=3, levels=5, hold=6.0, seed=5))
    assert not best.is_white
    weak = prior(inertia=(8.0, 1e6), linear_drag=(5.0, 1e6))
    other = replace(best, likelihood=replace(best.likelihood, grid=replace(best.likelihood.grid, prior=weak)))
    assert other.covariance == pytest.approx(best.covariance, rel=1e-6)  # Finite differences.


def test_a_hull_has_the_added_mass_of_the_textbook() -> None:
    ball = hull_parameters(2.0, 2.0, 2.0, submerged=True)
    mass = 4000.0 / 3.0 * math.pi
    assert ball["surge.inertia"] == pytest.approx(1.5 * mass)
    assert ball["yaw.inertia"] == pytest.approx(0.4 * mass)  # A ball turns no water.
    # k1, k2 and k' of a spheroid of 5 to 1 in elementary functions (Lamb 1932, articles 105, 115, 373).
    long = hull_parameters(5.0, 1.0, 1.0, submerged=True)
    e = math.sqrt(1.0 - 0.2**2)
    log = math.log((1.0 + e) / (1.0 - e))
    alpha, beta = 2.0 * (1.0 - e * e) / e**3 * (0.5 * log - e), 1.0 / e**2 - (1.0 - e * e) / (2.0 * e**3) * log
    turning = e**4 * (beta - alpha) / ((2.0 - e * e) * (2.0 * e * e - (2.0 - e * e) * (beta - alpha)))
    mass, inertia = 1000.0 * math.pi / 6.0 * 5.0, 1000.0 * math.pi / 6.0 * 5.0 * (25.0 + 1.0) / 20.0
    assert long["surge.inertia"] == pytest.approx(mass * (1.0 + alpha / (2.0 - alpha)))
    assert long["sway.inertia"] == pytest.approx(mass * (1.0 + beta / (2.0 - beta)))
    assert long["yaw.inertia"] == pytest.approx(inertia * (1.0 + turning))
    # Half of it at the surface.
    ship = hull_parameters(5.0, 1.0, 0.5, submerged=False)
    assert ship["sway.inertia"] == pytest.approx(0.5 * long["sway.inertia"])
