"""Regression by instrumental variables and the output-error fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.estimate.output_error import fit_output_error, fit_regression
from rovid.model.model import Model
from rovid.trial.preprocessing import Run
from tests.synthetic import ROSUB, clock, gauss_markov, run

SMALL = Model(inertia=0.6, quadratic_drag=1.5, linear_drag=1.0)
HEADING_NOISE = np.radians(0.01)


def levels(seconds: float, count: int, size: float, rng: np.random.Generator, rate: float = 20.0) -> FloatArray:
    return np.append(np.repeat(size * rng.uniform(-1.0, 1.0, count), round(seconds * rate)), 0.0)


def day(model: Model, rng: np.random.Generator, *, size: float, disturbance: float, noise: float) -> list[Run]:
    """Four logs of random levels, 100 s each."""
    runs = []
    for _ in range(4):
        torque = levels(10.0, 10, size, rng)
        time = clock((len(torque) - 1) / 20.0)
        runs.append(
            run(
                time,
                torque,
                model,
                disturbance=gauss_markov(len(time), 0.05, disturbance, 2.0, rng),
                noise=rng.normal(0.0, noise, len(time)),
            )
        )
    return runs


@pytest.mark.parametrize(
    ("model", "cutoff", "rate", "tolerance"),
    [
        # The correction for the square behind the filter rests on the last estimate; the cruder the grid, the worse.
        (ROSUB, 0.5, 20.0, 5e-4),
        (ROSUB, 1.0, 20.0, 5e-4),
        (ROSUB, 0.5, 5.0, 5e-3),
        (SMALL, 2.0, 50.0, 5e-3),  # the rate bends within a sample at each step of the command
    ],
)
def test_exact_data_give_the_truth(model: Model, cutoff: float, rate: float, tolerance: float) -> None:
    rng = np.random.default_rng(1)
    torque = levels(10.0, 20, 200.0 if model is ROSUB else 6.0, rng, rate)
    found = fit_regression([run(clock((len(torque) - 1) / rate, rate), torque, model, cutoff=cutoff)]).estimate.values
    assert found == pytest.approx([model.inertia, model.quadratic_drag, model.linear_drag], rel=tolerance)


def test_standard_errors_hold_in_repetition_and_least_squares_is_worse() -> None:
    rng = np.random.default_rng(seed := int(np.random.default_rng().integers(10**6)))
    print(f"seed {seed}")
    truth = np.array([ROSUB.inertia, ROSUB.quadratic_drag, ROSUB.linear_drag])
    z, plain = [], []
    for _ in range(25):
        fit = fit_regression(day(ROSUB, rng, size=150.0, disturbance=4.0, noise=HEADING_NOISE))
        z.append((fit.estimate.values - truth) / np.sqrt(np.diag(fit.estimate.covariance)))
        plain.append(fit.least_squares)
    # A jackknife over 12 blocks knows its error to a quarter, and a spread from 25 days has 15 % of its own.
    assert ((np.std(z, axis=0) > 0.45) & (np.std(z, axis=0) < 1.8)).all()
    assert (np.abs(np.mean(z, axis=0)) < 4.0 * 1.2 / np.sqrt(25)).all()
    # The disturbance moves the vehicle too, and least squares underestimates the inertia.
    assert np.mean(plain, axis=0)[0] < truth[0]


def test_a_drag_at_its_bound_leaves_the_other_one_uncertain() -> None:
    rng = np.random.default_rng(seed := int(np.random.default_rng().integers(10**6)))
    print(f"seed {seed}")
    truth = Model(inertia=5057.0, quadratic_drag=3532.0, linear_drag=1.0)
    z = []
    for _ in range(20):
        estimate = fit_regression(day(truth, rng, size=150.0, disturbance=4.0, noise=HEADING_NOISE)).estimate
        if estimate.value("linear_drag") == 0.0:
            assert estimate.standard_error("linear_drag") > 0.0
            assert any("linear_drag" in text for text in estimate.warnings)
        z.append((estimate.value("quadratic_drag") - 3532.0) / estimate.standard_error("quadratic_drag"))
    # To take the zero for certain left 13 % of such days within two errors.
    assert np.mean(np.abs(z) < 2.5) > 0.7


def late(log: Run, start: float) -> Run:
    """The same, as if the rate were known from ``start`` s on."""
    rates = replace(log.rates, rate=np.where(log.rates.time < start, np.nan, log.rates.rate))
    return replace(log, rates=rates)


def test_too_little_motion_is_refused() -> None:
    rng = np.random.default_rng(2)
    time = clock(100.0)
    unrest = gauss_markov(len(time), 0.05, 20.0, 4.0, rng)
    noise = rng.normal(0.0, HEADING_NOISE, len(time))
    held = run(time, np.full(2001, 100.0), disturbance=unrest, noise=noise)
    for log, words in (
        (run(time, np.zeros(2001), disturbance=unrest, noise=noise), "never push"),
        (late(held, 40.0), "inertia"),  # settled by then: only the disturbance moves it
        (late(held, 200.0), "no stretch is long enough"),
    ):
        with pytest.raises(DataError, match=words):
            fit_regression([log])


def test_a_torque_that_was_logged_without_its_sign_is_named() -> None:
    """The current of a motor that turns both ways."""
    torque = 100.0 + 50.0 * np.sign(np.sin(0.1 * clock(200.0)))
    log = run(clock(200.0), np.where(np.sin(0.031 * clock(200.0)) < 0.0, -torque, torque))
    sizes = replace(log, torque=torque, filtered_torque=log.rates.filter_held(log.trial, torque))
    with pytest.raises(DataError, match="the torque has one sign, but the vehicle moves both ways"):
        fit_regression([sizes])


def test_a_rate_of_noise_alone_is_no_motion() -> None:
    time = clock(100.0)
    steady = run(time, np.full(2001, 164.68), noise=np.random.default_rng(7).normal(0.0, HEADING_NOISE, 2001))
    settled = late(steady, 60.0)
    assert np.ptp(settled.rates.rate[settled.valid]) > 0.0
    logged = np.where(np.isfinite(steady.rates.rate), 0.1396, np.nan)  # its mean is off by a rounding
    exact = replace(steady, rates=replace(steady.rates, rate=logged, rate_noise=0.0))
    for log in (settled, exact):
        with pytest.raises(DataError, match="the rate hardly changes by more than its noise"):
            fit_regression([log])


def test_r_squared_of_a_constant_torque_is_nan() -> None:
    """One step from rest: it tells the inertia, and no share of the torque's changes, for there are none."""
    time = clock(100.0)
    rng = np.random.default_rng(11)
    log = run(time, np.full(2001, 100.0), disturbance=gauss_markov(len(time), 0.05, 1.0, 2.0, rng))
    found = fit_regression([log])
    assert found.estimate.value("inertia") == pytest.approx(ROSUB.inertia, rel=0.1)
    assert np.isnan(found.r_squared)
    sure = replace(log, filtered_torque=np.where(np.isfinite(log.filtered_torque), 100.0, np.nan))
    assert np.isnan(fit_regression([sure]).r_squared)


def test_a_coarse_heading_is_named_before_signs() -> None:
    """A slow turn in steps of 20 deg shows neither inertia nor signs."""
    log = run(clock(200.0), levels(10.0, 20, 2.0, np.random.default_rng(3)))
    step = np.deg2rad(20.0)
    coarse = run(log.trial.time, log.torque, noise=step * np.round(log.trial.position / step) - log.trial.position)
    with pytest.raises(DataError, match="the heading of log is rounded to steps of 20 deg"):
        fit_regression([coarse])


def test_thrust_of_the_wrong_sign_is_refused() -> None:
    good = run(clock(200.0), levels(10.0, 20, 200.0, np.random.default_rng(3)))
    with pytest.raises(DataError, match="signs of yaw_arm"):
        fit_regression([replace(good, torque=-good.torque, filtered_torque=-good.filtered_torque)])


def test_the_output_error_fit_starts_where_a_delay_makes_both_drags_negative() -> None:
    time = clock(240.0)
    model = replace(ROSUB, inertia=200.0, quadratic_drag=10.0, linear_drag=100.0)
    torque = 100.0 * np.sign(np.sin(2.0 * np.pi * time / 4.0))
    log = run(time, np.roll(torque, 8), model)
    told = replace(log, torque=torque, filtered_torque=log.rates.filter_held(log.trial, torque))
    assert fit_regression([told]).estimate.values[1:].tolist() == [0.0, 0.0]
    fitted = fit_output_error([told])
    assert np.isfinite(fitted.values).all()
    assert fitted.inertia > 0.0
