"""The compiled simulation against an independent solver, and the measures of fit against the contract."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import odeint

from rovid.core.array_types import FloatArray
from rovid.effects import effect_named
from rovid.model.kernels import simulate
from rovid.model.model import Model
from rovid.model.simulation import filtered_input, fit_measures, pooled_fit, simulate_runs, terms_along
from rovid.model.torque_input import TorqueInput
from rovid.trial.preprocessing import Run
from rovid.trial.rates import compute_rates
from tests.synthetic import LOGGED, ROSUB, clock, run, trial


def exact(time: FloatArray, torque: FloatArray, model: Model, start: float) -> tuple[FloatArray, FloatArray]:
    """Rate and angle by LSODA at tight tolerance, restarted at each change of the torque."""
    state, out = np.array([start, 0.0]), []
    for (first, last), push in zip(itertools.pairwise(time), torque, strict=False):
        out.append(state)

        def slope(_: float, y: FloatArray, push: float = push) -> list[float]:
            return [(push - model.drag(y[:1])[0]) / model.inertia, y[0]]

        state = odeint(slope, state, (first, last), rtol=1e-10, atol=1e-12, tfirst=True)[-1]
    rate, angle = np.array([*out, state]).T
    return rate, angle


@pytest.mark.parametrize(
    ("model", "step", "push", "start"),
    [
        (ROSUB, 0.05, 200.0, 0.0),
        (ROSUB, 7.0, 200.0, -0.2),
        (Model(inertia=0.6, quadratic_drag=1.5, linear_drag=5.0), 0.1, 20.0, 3.0),  # 0.04 s
        (Model(inertia=0.012, quadratic_drag=0.45, linear_drag=0.023), 0.2, 5.0, -8.0),  # 2 ms
        (Model(inertia=0.6, quadratic_drag=1.5, linear_drag=0.0), 0.5, 0.0, 10.0),
        (Model(inertia=5057.0, quadratic_drag=0.0, linear_drag=800.0), 1.0, 200.0, 0.1),
        (Model(inertia=5057.0, quadratic_drag=0.0, linear_drag=0.0), 1.0, 200.0, 0.1),
    ],
    ids=["work class", "long steps", "small, stiff", "tiny, very stiff", "coasting", "linear", "no drag"],
)
def test_simulation_agrees_with_an_implicit_solver(model: Model, step: float, push: float, start: float) -> None:
    rng = np.random.default_rng(seed := int(np.random.default_rng().integers(10**6)))
    print(f"seed {seed}")
    time = np.concatenate(([0.0], np.cumsum(step * rng.uniform(0.1, 2.0, 30))))
    torque = push * rng.uniform(-1.0, 1.0, len(time))
    rate, angle = simulate(time, torque, model.body, start)
    wanted_rate, wanted_angle = exact(time, torque, model, start)
    # A step is a fifth of the time constant: Runge-Kutta's error is 0.2^5/120 of a rate a step.
    assert rate == pytest.approx(wanted_rate, abs=3e-5 * np.abs(wanted_rate).max())
    # Turns forth and back cancel; what they are wrong by does not.
    way = np.abs(np.diff(wanted_angle)).sum()
    assert angle == pytest.approx(wanted_angle, abs=3e-5 * max(way, 1e-3))


@pytest.mark.parametrize("pause", [100.0, 3600.0, 1e6])
@pytest.mark.parametrize("push", [0.0, 3.0])
def test_a_long_gap_ends_at_the_steady_rate(pause: float, push: float) -> None:
    small = Model(inertia=0.3, quadratic_drag=1.5, linear_drag=1.0)
    time = np.array([0.0, pause])
    rate, angle = simulate(time, np.full(2, push), small.body, 2.0)
    steady = (-1.0 + np.sqrt(1.0 + 4.0 * 1.5 * push)) / (2.0 * 1.5)
    assert rate[1] == pytest.approx(steady, rel=1e-6, abs=1e-9)
    # In closed form the way there is shorter than one rate times a few time constants of 0.3 s.
    assert angle[1] == pytest.approx(steady * pause, abs=1.0, rel=1e-6)


def test_fit_measures_by_their_definitions() -> None:
    y, yhat = np.array([1.0, 2.0, 3.0, np.nan, 6.0]), np.array([1.5, 2.0, 2.0, 9.0, 6.0])
    fit = fit_measures(y, yhat)
    sse, sst = 0.25 + 1.0, 4.0 + 1.0 + 0.0 + 9.0
    assert fit.samples == 4
    assert fit.r2 == pytest.approx(1.0 - sse / sst)
    assert fit.fit_percent == pytest.approx(100.0 * (1.0 - np.sqrt(sse) / np.sqrt(sst)))
    assert fit.rmse == pytest.approx(np.sqrt(sse / 4.0))


@pytest.mark.parametrize(("y", "samples"), [([np.nan, np.nan], 0), ([2.0, 2.0], 2)], ids=["nothing", "constant"])
def test_undefined_fit_measures_are_nan(y: list[float], samples: int) -> None:
    fit = fit_measures(np.array(y), np.array([1.0, 2.0]))
    assert fit.samples == samples
    assert np.isnan(fit.r2)
    assert np.isnan(fit.fit_percent)


def swaying(*, tilt: float) -> Run:
    """Two minutes of steps, rolling and pitching by ``tilt`` deg, the heading turned by an independent Euler sum."""
    time = clock(120.0)
    torque = np.repeat([150.0, -100.0, 200.0, 0.0], 600)
    torque = np.append(torque, 0.0)
    rate, _ = exact_rate(time, torque)
    roll = np.radians(tilt) * np.sin(0.9 * time)
    pitch = np.radians(tilt) * np.cos(0.57 * time)
    slope = (rate + np.gradient(pitch, time) * np.sin(roll)) / (np.cos(roll) * np.cos(pitch))
    heading = 1.0 + np.concatenate(([0.0], np.cumsum(0.5 * (slope[1:] + slope[:-1]) * np.diff(time))))
    log = trial(time, torque, heading, roll=roll, pitch=pitch)
    rates = compute_rates(log, cutoff=1.0)
    return Run(trial=log, torque=torque, rates=rates, filtered_torque=rates.filter_held(log, torque))


def exact_rate(time: FloatArray, torque: FloatArray) -> tuple[FloatArray, FloatArray]:
    return simulate(time, torque, ROSUB.body, 0.0)


@pytest.mark.parametrize("tilt", [0.0, 5.0, 20.0])
def test_a_tilted_vehicle_turns_about_its_body_axis(tilt: float) -> None:
    (result,) = simulate_runs([swaying(tilt=tilt)], ROSUB, LOGGED)
    assert result.fit.r2 > 0.99999
    # The first rate, read from two seconds of heading under a step, is 6e-4 rad/s off and forgotten in some seconds.
    assert np.abs(result.position - result.run.trial.position).max() < 6e-3
    for horizon in (10.0, 60.0):
        error = result.position_errors[horizon]
        assert error is not None
        assert error < 0.02  # a restart from the smoothed rate beside a step; untransformed 20 deg would add 0.7


def test_a_level_vehicle_has_its_heading_as_body_position() -> None:
    log = swaying(tilt=0.0).trial
    assert log.body_position == pytest.approx(log.position, abs=1e-12)


def test_heading_errors_need_a_horizon_without_a_gap() -> None:
    (short,) = simulate_runs([run(clock(30.0), np.full(601, 100.0))], ROSUB, LOGGED)
    assert short.position_errors[10.0] == pytest.approx(0.0, abs=1e-4)
    assert short.position_errors[60.0] is None
    time = clock(70.0)
    whole = run(time, np.full(1401, 100.0))
    heading = np.where((time > 30.0) & (time < 36.0), np.nan, whole.trial.position)
    # The turns made inside the gap are unknown: twenty more of them may not show as an error.
    log = trial(time, whole.torque, heading + 40.0 * np.pi * (time >= 36.0))
    rates = compute_rates(log, cutoff=1.0)
    (gapped,) = simulate_runs(
        [Run(trial=log, torque=whole.torque, rates=rates, filtered_torque=whole.filtered_torque)], ROSUB, LOGGED
    )
    assert gapped.position_errors[60.0] is None
    error = gapped.position_errors[10.0]
    assert error is not None
    assert error < 1e-3


def test_the_pooled_fit_is_over_all_samples() -> None:
    runs = [run(clock(60.0), np.full(1201, 100.0)), run(clock(90.0), np.full(1801, -50.0))]
    wrong = Model(inertia=6000.0, quadratic_drag=3000.0, linear_drag=132.0)
    results = simulate_runs(runs, wrong, LOGGED)
    y = np.concatenate([item.measured for item in results])
    error = y - np.concatenate([item.simulated for item in results])
    known = np.isfinite(y) & np.isfinite(error)
    total = pooled_fit(results)
    assert total.samples == known.sum()
    assert total.r2 == pytest.approx(1.0 - np.sum(error[known] ** 2) / np.sum((y[known] - y[known].mean()) ** 2))


def test_without_gyro_samples_the_rate_comes_from_the_heading() -> None:
    time = clock(60.0)
    rate = 0.2 * np.sin(0.3 * time)
    angle = 0.2 / 0.3 * (1.0 - np.cos(0.3 * time))
    rates = compute_rates(trial(time, np.zeros(len(time)), angle, rate=np.where(time < 20.0, rate, np.nan)), cutoff=1.0)
    known = np.isfinite(rates.rate)
    assert rates.time[known][-1] > 58.0
    np.testing.assert_allclose(rates.rate[known], 0.2 * np.sin(0.3 * rates.time[known]), atol=2e-3)


in_water_that_moves = pytest.mark.parametrize(
    ("key", "values"),
    [("entrained_swirl", (0.3, 60.0)), ("tank_seiche", (0.3, 1.3, 0.03)), ("added_mass_memory", (2000.0, 20.0))],
)


def moving_model(key: str, values: tuple[float, ...]) -> Model:
    return replace(ROSUB, effects=(effect_named(key),), effect_values=values)


def run_of(model: Model, seconds: float, begin: float = 0.0) -> Run:
    """A run of two sines from rest, logged from ``begin`` s on."""
    time = clock(seconds)
    whole = run(time, 200.0 * np.sin(2.0 * np.pi * time / 80.0) + 200.0 * np.sin(2.0 * np.pi * time / 5.0))
    heading = model.simulate(whole.trial, TorqueInput.held(whole.torque))[1]
    own = time >= begin
    log = trial(time[own] - begin, whole.torque[own], heading[own])
    rates = compute_rates(log, cutoff=1.0)
    return Run(trial=log, torque=whole.torque[own], rates=rates, filtered_torque=whole.filtered_torque[own])


@in_water_that_moves
def test_a_restart_has_the_states_along_the_trajectory(key: str, values: tuple[float, ...]) -> None:
    moving = moving_model(key, values)
    made = run_of(moving, 400.0)
    (own,), (without,) = (simulate_runs([made], model, LOGGED) for model in (moving, ROSUB))
    for horizon in (10.0, 60.0):
        error, worse = own.position_errors[horizon], without.position_errors[horizon]
        assert error is not None
        assert worse is not None
        assert error < 0.1 * worse


@in_water_that_moves
def test_a_log_that_begins_in_motion_begins_with_moving_water(key: str, values: tuple[float, ...]) -> None:
    moving = moving_model(key, values)
    cut = run_of(moving, 160.0, begin=80.0)
    from_rest = cut.rates.smooth_samples(cut.trial, moving.simulate(cut.trial, TorqueInput.held(cut.torque))[0])
    (made,) = simulate_runs([cut], moving, LOGGED)
    # What is left is due to the initial rate, which comes from the first headings.
    assert made.fit.rmse < 0.25 * fit_measures(cut.rates.rate, from_rest).rmse
    held = filtered_input(cut, moving, LOGGED)
    torque, states = terms_along(cut, moving, LOGGED, held)
    missing = moving.inertia * cut.rates.acceleration + moving.drag(cut.rates.rate) - held.torque
    assert states.any()
    assert np.nanstd(missing - torque) < 0.05 * np.nanstd(missing)
    # Of a log that begins at rest nothing is estimated, and a model without such states has none.
    rested = run_of(moving, 160.0)
    assert not terms_along(rested, moving, LOGGED, filtered_input(rested, moving, LOGGED))[1].any()
    assert not len(terms_along(cut, ROSUB, LOGGED, held)[1])
