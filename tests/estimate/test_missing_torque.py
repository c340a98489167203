"""Errors by torques that a model lacks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.effects import Effect, effect_named
from rovid.estimate.estimate import Estimate
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.estimate.missing_torque import include_missing_torque, lacks_torque, missing_torque_covariance
from rovid.trial.preprocessing import Run
from rovid.trial.rates import compute_rates
from rovid.trial.vehicle import Thruster, Vehicle
from tests import synthetic
from tests.predictions import NOISE, TIME, TORQUE

SUBSTEPS = 10
# Instant, and heading, rate and sway -> their rates of change.
Slope = Callable[[int, FloatArray], FloatArray]


def fitted(runs: list[Run], *effects: Effect) -> FitResult:
    objective = InnovationLikelihood(InnovationData(runs, synthetic.LOGGED, synthetic.ROSUB), 0.05, effects)
    return fit(objective, objective.parametrization.initial())


def steered(count: int, alone: int, gain: float) -> FitResult:
    """Two thrusters driven alike, and for the last ``alone`` readings in turns; the second has this ``gain``."""
    thrusters = tuple(Thruster(name=name, arm=0.5, curve=synthetic.VOLTS) for name in ("a", "b"))
    command = np.tile(TORQUE[:count, np.newaxis] / 100.0, (1, 2))
    turn = np.arange(count) // 250 % 2 == 0
    command[-alone:] *= np.stack((turn, ~turn), axis=1)[-alone:]
    torque = 50.0 * command @ np.array([1.0, gain])
    run = synthetic.run(TIME[:count], torque, noise=NOISE[:count])
    assumed = 50.0 * command.sum(axis=1)
    run = replace(
        run,
        trial=replace(run.trial, commands=command),
        torque=assumed,
        filtered_torque=run.rates.filter_held(run.trial, assumed),
    )
    data = InnovationData([run], Vehicle(name="two", thrusters=thrusters), synthetic.ROSUB)
    objective = InnovationLikelihood(data, 0.05)
    return fit(objective, objective.parametrization.initial())


def estimate_of(one: FitResult) -> Estimate:
    covariance = one.covariance(sandwich=not one.is_white)
    return Estimate(names=one.model.names, values=one.model.values, covariance=covariance, method="", samples=1)


def driven(count: int, slope: Slope, extra: str = "", size: int = 3) -> Run:
    """A run of heading, rate, sway and other states by their ``slope``, with the sway in the log as ``extra``."""
    step, state, states = (TIME[1] - TIME[0]) / SUBSTEPS, np.zeros(size), np.zeros((count, size))
    for at in range(count):
        states[at] = state
        for _ in range(SUBSTEPS):
            state = state + step * slope(at, state + 0.5 * step * slope(at, state))
    rng = np.random.default_rng(5)
    log = synthetic.trial(TIME[:count], TORQUE[:count], states[:, 0] + NOISE[:count])
    if extra:
        log = replace(log, extras={extra: states[:, 2] + 0.001 * rng.normal(size=count)})
    rates, torque = compute_rates(log, cutoff=1.0), TORQUE[:count]
    return Run(trial=log, torque=torque, rates=rates, filtered_torque=rates.filter_held(log, torque))


def swaying(count: int, coefficient: float, memory: float, eddy: float) -> Run:
    """A vehicle that sways after its rate, with a time constant of its own, and is turned by that and by eddies."""
    eddies = synthetic.gauss_markov(count, 0.2, eddy, 2.0, np.random.default_rng(1))

    def slope(at: int, state: FloatArray) -> FloatArray:
        _, rate, sway = state
        torque = TORQUE[at] + eddies[at] - drag(rate) - coefficient * sway
        return np.array([rate, torque / synthetic.ROSUB.inertia, (rate - sway) / memory])

    return driven(count, slope)


def creeping(count: int, munk: float) -> Run:
    """A vehicle that begins to move ahead as it turns, and has this Munk moment in kg."""
    eddies = synthetic.gauss_markov(count, 0.2, 2.0, 2.0, np.random.default_rng(1))

    def slope(at: int, state: FloatArray) -> FloatArray:
        _, rate, sway, surge = state
        torque = TORQUE[at] + eddies[at] - drag(rate) - munk * surge * sway
        ahead = 3e-4 * abs(TORQUE[at]) + rate * sway - surge / 15.0
        return np.array([rate, torque / synthetic.ROSUB.inertia, -rate * surge - sway / 15.0, ahead])

    return driven(count, slope, size=4)


def coupled(count: int, share: float) -> Run:
    """A vehicle whose sway takes this ``share`` of the inertia away, with the sway velocity in the log."""
    mass, damping, inertia = 6800.0, 300.0, synthetic.ROSUB.inertia
    both = np.sqrt(share * inertia * mass)
    inverse = np.linalg.inv([[mass, both], [both, inertia]])
    rng = np.random.default_rng(5)
    gusts, eddies = (synthetic.gauss_markov(count, 0.2, size, 10.0, rng) for size in (20.0, 2.0))

    def slope(at: int, state: FloatArray) -> FloatArray:
        _, rate, sway = state
        faster = inverse @ np.array([gusts[at] - damping * sway, TORQUE[at] + eddies[at] - drag(rate)])
        return np.array([rate, faster[1], faster[0]])

    return driven(count, slope, "sway_velocity")


def drag(rate: float) -> float:
    return synthetic.ROSUB.quadratic_drag * abs(rate) * rate + synthetic.ROSUB.linear_drag * rate


def assert_nearly_unchanged(wider: Estimate, estimate: Estimate) -> None:
    """Many runs of every kind leave little room for a torque that the model lacks, and no reason for a warning."""
    growth = np.sqrt(np.diag(wider.covariance) / np.diag(estimate.covariance))
    assert (growth < 1.2).all()
    assert wider.warnings == estimate.warnings


@pytest.mark.parametrize("share", [0.0, 0.05])
def test_a_logged_sway_that_takes_inertia_away_widens_the_errors(share: float) -> None:
    one = fitted([coupled(4000, share)])
    estimate = estimate_of(one)
    wider = include_missing_torque(estimate, one)
    away = abs(estimate.value("inertia") - synthetic.ROSUB.inertia)
    assert away < 2.5 * wider.standard_error("inertia")
    if share:
        assert away > 5.0 * estimate.standard_error("inertia")
    else:
        assert_nearly_unchanged(wider, estimate)


@pytest.fixture(scope="module")
def incomplete() -> FitResult:
    return fitted([swaying(4000, 300.0, 6.0, 0.0)])


def test_a_complete_model_keeps_its_errors() -> None:
    rng = np.random.default_rng(3)
    count = 3000
    disturbance = synthetic.gauss_markov(count, 0.2, 2.0, 4.0, rng)
    noise = 1e-4 * rng.normal(size=count)
    one = fitted([synthetic.run(TIME[:count], TORQUE[:count], disturbance=disturbance, noise=noise)])
    assert one.is_white
    estimate = estimate_of(one)
    assert_nearly_unchanged(include_missing_torque(estimate, one), estimate)


@pytest.mark.parametrize("gain", [1.0, 0.7])
def test_errors_cover_a_weak_thruster_that_is_rarely_alone(gain: float) -> None:
    one = steered(4000, 1000, gain)
    estimate = estimate_of(one)
    wider = include_missing_torque(estimate, one)
    away = abs(estimate.value("inertia") - synthetic.ROSUB.inertia)
    assert away < 2.0 * wider.standard_error("inertia")
    if gain == 1.0:
        assert_nearly_unchanged(wider, estimate)
    else:
        assert away > 4.0 * estimate.standard_error("inertia")
        assert any("one thruster gives less thrust than its curve" in text for text in wider.warnings)


def test_errors_cover_the_drag_next_to_a_friction_of_another_law() -> None:
    """A friction that falls by half within a short rate: the named law bends, and the drag takes the difference."""

    def slope(at: int, state: FloatArray) -> FloatArray:
        rate = state[1]
        friction = 12.0 * np.tanh(rate / 5e-4) * (1.0 + np.exp(-((rate / 0.02) ** 2)))
        return np.array([rate, (TORQUE[at] - drag(rate) - friction) / synthetic.ROSUB.inertia, 0.0])

    one = fitted([driven(3000, slope)], effect_named("coulomb_resistance"))
    estimate = estimate_of(one)
    wider = include_missing_torque(estimate, one)
    away = abs(estimate.value("linear_drag") - synthetic.ROSUB.linear_drag)
    assert one.is_white
    assert away > 3.0 * estimate.standard_error("linear_drag")
    assert away < 2.5 * wider.standard_error("linear_drag")
    # Friction of any law leaves the inertia as it is.
    assert wider.standard_error("inertia") < 2.0 * estimate.standard_error("inertia")
    # The friction itself is certain.
    size = "coulomb_resistance.torque"
    assert wider.value(size) > 4.0 * wider.standard_error(size)


def test_errors_cover_the_inertia_of_a_vehicle_that_sways(incomplete: FitResult) -> None:
    estimate = estimate_of(incomplete)
    wider = include_missing_torque(estimate, incomplete)
    away = abs(estimate.value("inertia") - synthetic.ROSUB.inertia)
    assert away > 3.0 * estimate.standard_error("inertia")
    assert away < 2.0 * wider.standard_error("inertia")
    # They still say something: half of the inertia is none.
    assert wider.standard_error("inertia") < 0.25 * wider.value("inertia")
    assert any("sway that follows the motion is not modelled" in text for text in wider.warnings)


def test_errors_allow_for_a_sway_that_short_runs_hardly_show() -> None:
    one = fitted([swaying(600, 45.0, 8.0, 4.0)])
    estimate = estimate_of(one)
    wider = include_missing_torque(estimate, one)
    away = abs(estimate.value("linear_drag") - synthetic.ROSUB.linear_drag)
    assert one.is_white
    assert not lacks_torque(one)
    assert away > 4.0 * estimate.standard_error("linear_drag")
    assert away < 2.5 * wider.standard_error("linear_drag")
    assert any("these runs do not distinguish from inertia and drag" in text for text in wider.warnings)


@pytest.mark.parametrize(("tenths", "is_lacking"), [(1, False), (2, False), (30, True)])
def test_a_shift_of_the_commands_within_the_sampling_interval_is_no_torque(tenths: int, *, is_lacking: bool) -> None:
    """A logger stamps commands before or after it sends them."""
    early = np.roll(np.repeat(TORQUE, 10), -tenths).reshape(-1, 10).mean(axis=1)
    water = synthetic.gauss_markov(len(TIME), 0.2, 6.0, 4.0, np.random.default_rng(8))
    one = fitted([synthetic.run(TIME, TORQUE, disturbance=early - TORQUE + water, noise=3.0 * NOISE)])
    assert lacks_torque(one) == is_lacking


def test_errors_allow_for_the_munk_moment_of_a_vehicle_that_creeps_ahead() -> None:
    """No other torque shows in these runs."""
    one = fitted([creeping(1200, 60.0)])
    estimate = estimate_of(one)
    wider = include_missing_torque(estimate, one)
    away = abs(estimate.value("quadratic_drag") - synthetic.ROSUB.quadratic_drag)
    assert one.is_white
    assert lacks_torque(one)
    assert 2.0 * estimate.standard_error("quadratic_drag") < away < 2.0 * wider.standard_error("quadratic_drag")


def test_the_added_covariance_does_not_depend_on_the_unit_of_a_torque(
    incomplete: FitResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = missing_torque_covariance(incomplete)
    original = type(incomplete.objective).jacobian_between

    def scaled(self, centre, sides, step):  # type: ignore[no-untyped-def]
        return original(self, centre, sides, 7.0 * step if len(sides) > len(incomplete.x) else step)

    monkeypatch.setattr(type(incomplete.objective), "jacobian_between", scaled)
    assert missing_torque_covariance(incomplete) == pytest.approx(before, rel=1e-6, abs=1e-12)
