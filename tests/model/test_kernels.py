"""The compiled filter and simulation against closed forms, grids and plain sums."""

from __future__ import annotations

import math
import secrets
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import expm

from rovid.core.array_types import FloatArray
from rovid.effects import TERM_EFFECTS, Effect, effect_named
from rovid.effects.base import TERM_STATES
from rovid.model.bound_effects import BoundEffect, Equation, pack_terms
from rovid.model.kernels import (
    effects_along,
    ekf3_innovations,
    ekf5_innovations,
    predict_multi_step,
    simulate,
    simulate_effects,
)
from rovid.model.model import Model
from rovid.model.ode import evaluate_along
from rovid.model.torque_input import TorqueInput
from tests import synthetic
from tests.filters import Log, filter_one
from tests.predictions import records

ROSUB = synthetic.ROSUB


def random_run(count: int) -> tuple[FloatArray, FloatArray]:
    """Irregular instants and a torque held between them."""
    rng = np.random.default_rng()
    return np.cumsum(rng.uniform(0.01, 0.4, count)), rng.normal(0.0, 100.0, count)


def test_without_disturbance_innovations_are_the_output_error() -> None:
    time, torque = random_run(400)
    rate, angle = simulate(time, torque, ROSUB.body, 0.02)
    measured = angle + np.random.default_rng().normal(0.0, 1e-3, len(time))
    measured[0] = 0.0
    log = Log(time=time, angle=measured, first=(0.02, 1e-9))
    error, variance = filter_one(ekf3_innovations, log, TorqueInput.held(torque), ROSUB, (1e-6, 4.0, 1e-3, 1.0))
    # What the filter learns from the first heading alone, a few parts in a hundred of the noise, is left.
    assert np.max(np.abs(error[1:, 0] - (measured - angle)[1:])) < 1.1e-3
    assert variance[-1, 0] == pytest.approx(1e-6, rel=0.05)
    assert np.isfinite(rate).all()


def test_filter_variance_against_a_fine_grid() -> None:
    # The same filter fed every instant and every hundredth part of it, where nothing is measured.
    time, torque = random_run(200)
    fine = np.unique(np.concatenate([np.linspace(a, b, 100, endpoint=False) for a, b in pairwise(time)] + [time[-1:]]))
    at = np.searchsorted(fine, time)
    held = torque[np.clip(np.searchsorted(time, fine, side="right") - 1, 0, len(time) - 1)]
    small = Model(inertia=2.5, quadratic_drag=1.5, linear_drag=5.0)
    _, angle = simulate(time, torque, small.body, 0.0)
    sparse = np.full(len(fine), np.nan)
    sparse[at] = angle
    noise, first = (5.0, 1.0, 1e-3, 1.0), (0.0, 0.1)
    here, there = Log(time=time, angle=angle, first=first), Log(time=fine, angle=sparse, first=first)
    coarse, coarse_variance = filter_one(ekf3_innovations, here, TorqueInput.held(torque), small, noise)
    exact, exact_variance = filter_one(ekf3_innovations, there, TorqueInput.held(held), small, noise)
    # Sub-steps of a twentieth of the shortest time constant leave the second-order transition a few percent off.
    assert coarse_variance[1:, 0] == pytest.approx(exact_variance[at, 0][1:], rel=0.05)
    assert coarse[1:, 0] == pytest.approx(exact[at, 0][1:], abs=0.05 * float(np.sqrt(exact_variance[at, 0].max())))


def test_an_uncertain_impulse_increases_the_variance() -> None:
    time = np.arange(0.0, 4.0, 0.5)
    none, scatter = np.zeros(len(time)), np.where(time == 2.0, 3.0**2, 0.0)
    angle = np.where(time == 0.0, 0.0, np.nan)
    angle[time == 2.5] = 0.0
    drive = TorqueInput(none, none, np.zeros((len(time), 3)), scatter, np.array([0, len(time)]))
    coasting = Model(inertia=2.0, quadratic_drag=0.0, linear_drag=0.0)
    log = Log(time=time, angle=angle, first=(0.0, 1e-6))
    _, variance = filter_one(ekf3_innovations, log, drive, coasting, (1e-6, 4.0, 1e-3, 1.0))
    # A kick at any instant of the half second, (3 / 2) rad/s in all, has a third of the angle's square.
    assert variance[time == 2.5, 0] == pytest.approx((3.0 / 2.0 * 0.5) ** 2 / 3.0, rel=1e-3)


@pytest.mark.parametrize("gain", [0.1, 0.3])
@pytest.mark.parametrize("frequency", [1.3, 2.5, 4.0])
@pytest.mark.parametrize("blind", [False, True])
def test_the_filter_with_a_tank_agrees_with_matrix_exponentials(frequency: float, gain: float, blind: bool) -> None:
    inertia, drag, damping, white, sigma, tau = 500.0, 60.0, 0.03, 5e-4, 3.0, 4.0
    rng = np.random.default_rng(seed := secrets.randbelow(10**6))
    print(f"seed {seed}")
    time = np.arange(0.0, 120.0, 0.2)
    torque = 60.0 * np.sign(np.sin(2.0 * np.pi * time / 23.0))
    # Angle, rate, disturbance, q integrated, q.
    a, noise = np.zeros((5, 5)), np.zeros((5, 5))
    swing, leak = frequency**2, 2.0 * damping * frequency
    a[0, 1], a[2, 2], a[3, 4], a[4] = 1.0, -1.0 / tau, 1.0, (0.0, 1.0, 0.0, -swing, -leak)
    a[1] = np.array([0.0, -drag / inertia, 1.0 / inertia, 0.0, 0.0]) - gain * frequency * a[4]
    noise[2, 2] = 2.0 * sigma**2 / tau
    both = expm(np.block([[-a, noise], [np.zeros((5, 5)), a.T]]) * 0.2)
    step = both[5:, 5:].T
    grown, push = step @ both[:5, 5:], np.array([[0.0], [1.0 / inertia], [0.0], [0.0], [0.0]])
    pushed = expm(np.block([[a, push], [np.zeros((1, 6))]]) * 0.2)[:5, 5]
    truth = np.zeros(5)
    angle = np.zeros(len(time))
    for k in range(1, len(time)):
        truth = step @ truth + pushed * torque[k - 1] + rng.multivariate_normal(np.zeros(5), grown, method="svd")
        angle[k] = truth[0] + rng.normal(0.0, white)
    if blind:
        angle[200:300] = np.nan
    state, p = np.zeros(5), np.diag([white**2, 1e-8, sigma**2, 0.0, 0.0])
    wanted = np.full((len(time), 2), np.nan)
    for k, reading in enumerate(angle):
        if k > 0:
            state, p = step @ state + pushed * torque[k - 1], step @ p @ step.T + grown
        if np.isfinite(reading):
            wanted[k] = reading - state[0], p[0, 0] + white**2
            use = p[:, 0] / wanted[k, 1]
            state, p = state + use * wanted[k, 0], p - np.outer(use, p[0])

    tank, log = in_a_tank(inertia, drag, (gain, frequency, damping)), Log(time=time, angle=angle, first=(0.0, 1e-4))
    error, variance = filter_one(ekf5_innovations, log, TorqueInput.held(torque), tank, (sigma, tau, white, 1.0))
    known = np.isfinite(wanted[:, 0])
    assert variance[known, 0] == pytest.approx(wanted[known, 1], rel=0.005)
    assert (error[known, 0] - wanted[known, 0]) / np.sqrt(wanted[known, 1]) == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize(("name", "values"), [("wave_torque", (40.0, 0.9, 0.1)), ("tank_seiche", (0.2, 2.5, 0.03))])
@pytest.mark.parametrize("drag", [60.0, 2000.0])
def test_series_for_even_sampling_are_accurate(name: str, values: tuple[float, ...], drag: float) -> None:
    rng = np.random.default_rng(seed := secrets.randbelow(10**6))
    print(f"seed {seed}")
    time = np.arange(0.0, 60.0, 0.2)
    torque = 300.0 * np.sign(np.sin(2.0 * np.pi * time / 23.0))
    model = Model(
        inertia=500.0, quadratic_drag=drag, linear_drag=drag, effects=(effect_named(name),), effect_values=values
    )
    angle = np.cumsum(rng.normal(0.0, 0.01, len(time)))
    # Each interval of another length, if by next to nothing: no series then.
    uneven = np.asarray(time + 1e-7 * rng.uniform(size=len(time)))
    noise = (3.0, 4.0, 5e-4, 1.0)
    found, wanted = (
        filter_one(
            ekf5_innovations, Log(time=clock, angle=angle, first=(0.0, 0.1)), TorqueInput.held(torque), model, noise
        )
        for clock in (time, uneven)
    )
    assert found[1][1:, 0] == pytest.approx(wanted[1][1:, 0], rel=1e-5)
    assert (found[0] - wanted[0])[1:, 0] / np.sqrt(wanted[1][1:, 0]) == pytest.approx(0.0, abs=3e-4)


def in_a_tank(inertia: float, drag: float, values: tuple[float, ...]) -> Model:
    return Model(
        inertia=inertia,
        quadratic_drag=0.0,
        linear_drag=drag,
        effects=(effect_named("tank_seiche"),),
        effect_values=values,
    )


def test_a_tank_decays_along_a_trajectory() -> None:
    frequency, damping, period = 5.0, 0.01, 0.1
    time = np.arange(0.0, 100.0, period)
    rate = np.where(time < 5.0, 0.2 * np.sin(0.2 * np.pi * time), 0.0)
    nothing, tank = np.zeros(len(time)), in_a_tank(500.0, 60.0, (0.2, frequency, damping)).equation(0.0)
    torque, _ = evaluate_along(tank, period, (rate, nothing, nothing), np.zeros((len(time), 3)))
    first, last = (np.abs(torque[(time > at) & (time < at + 10.0)]).max() for at in (6.0, 86.0))
    assert last / first == pytest.approx(math.exp(-damping * frequency * 80.0), rel=0.3)


@pytest.mark.parametrize("periods", [(0.2, 0.2), (0.2, 0.5)])
@pytest.mark.parametrize("effect", TERM_EFFECTS, ids=lambda effect: effect.key)
def test_trajectories_are_independent(effect: Effect, periods: tuple[float, float]) -> None:
    rng, count, first = np.random.default_rng(2), 90, 40
    course, beside = rng.normal(size=(count, 3)) * (0.1, 1.0, 100.0), rng.random((count, 3))
    terms = pack_terms(
        [BoundEffect(effect, np.array([parameter.initial_values[0] for parameter in effect.parameters]))], 0.0
    )
    begins, starts = np.array([0, first, count]), np.array([0.3, -0.1])
    torque, states = effects_along(begins, np.array(periods), course, beside, starts, ROSUB.body, terms)
    for number, own in enumerate((slice(0, first), slice(first, count))):
        series = tuple(course[own].T)
        alone = evaluate_along(Equation(ROSUB.body, terms, starts[number]), periods[number], series, beside[own])
        for found, wanted in zip((torque[own], states[own]), alone, strict=True):
            # Side by side with one that has to, a course takes finer steps than by itself: what changes is what coarse
            # ones cost on so wild a course.
            share = 0.02 if periods[number] < max(periods) else 0.0
            np.testing.assert_allclose(found, wanted, rtol=0.0, atol=share * np.abs(wanted).max(initial=0.0))


@pytest.mark.parametrize("effect", TERM_EFFECTS, ids=lambda effect: effect.key)
def test_restarts_are_independent(effect: Effect) -> None:
    count, period = 120, 0.4
    rate, angle = 0.1 * np.sin(0.05 * np.arange(count)), np.linspace(0.0, 2.4, count)
    torque = np.where(np.arange(count) % 40 < 20, 150.0, -90.0)
    beside = np.column_stack((0.2 * np.ones(count), 0.8 + 0.1 * np.sin(np.arange(count)), 0.05 * np.ones(count)))
    scales = records().scales
    begin = zip(effect.initial_values[0], effect.parameters, strict=True)
    own = np.array([value * scales.unit_size(parameter) for value, parameter in begin])
    terms = pack_terms([BoundEffect(effect, own)], 0.0)
    body = ROSUB.body._replace(stiffness=50.0, trim=0.02)
    first = np.array([3, 50, 20, 64])
    reach, states = np.array([40, 12, 0, 55]), 0.01 * np.random.default_rng(0).normal(size=(count, TERM_STATES))
    moved = predict_multi_step(
        np.full(4, period), torque, beside, rate, angle, states, first, reach, np.full(4, 0.4), body, terms
    )
    for lane, (at, steps) in enumerate(zip(first, reach, strict=True)):
        held = slice(at, at + steps + 1)
        driven = torque[held], np.zeros(steps + 1), beside[held]
        there = np.full(1, 0.4), np.array([(rate[at], angle[at])]), states[at : at + 1]
        _, alone = simulate_effects(
            np.array([0, steps + 1]), np.arange(steps + 1) * period, driven, *there, body, terms
        )
        assert moved[lane, : steps + 1] == pytest.approx(alone - angle[at], rel=1e-9, abs=1e-12)
        assert np.isnan(moved[lane, steps + 1 :]).all()


@pytest.mark.parametrize("key", ["oscillatory_drag", "tank_seiche:thrust"])
def test_simulated_runs_are_independent(key: str) -> None:
    effect = effect_named(key)
    scales, begin = records().scales, zip(effect.initial_values[0], effect.parameters, strict=True)
    terms = pack_terms([BoundEffect(effect, np.array([value * scales.unit_size(one) for value, one in begin]))], 0.0)
    # More than there are lanes, of all lengths; those behind an end begin at another time of the day.
    lengths, rng = [160, 2, 90, 300, 1, 211], np.random.default_rng(4)
    begins = np.cumsum([0, *lengths])
    time = np.concatenate([1e7 * (number % 2) + 0.2 * np.arange(length) for number, length in enumerate(lengths)])
    torque, moment = np.repeat(rng.normal(0.0, 90.0, begins[-1] // 4), 4), np.full(begins[-1], 0.4)
    beside = np.column_stack((np.sqrt(np.abs(torque)), np.full((begins[-1], 2), 0.3)))
    starts, first = rng.uniform(-3.0, 3.0, 6), rng.normal(0.0, 0.05, (6, 2))
    states = rng.normal(0.0, 0.01, (6, TERM_STATES))
    together = simulate_effects(begins, time, (torque, moment, beside), starts, first, states, ROSUB.body, terms)
    for number, (begin, end) in enumerate(pairwise(begins)):
        own, alone = slice(begin, end), slice(number, number + 1)
        drive = torque[own], moment[own], beside[own]
        here = starts[alone], first[alone], states[alone], ROSUB.body, terms
        wanted = simulate_effects(np.array([0, end - begin]), time[own], drive, *here)
        # Those side by side take as many steps as the one that asks for most.
        np.testing.assert_allclose([series[own] for series in together], wanted, rtol=1e-4, atol=1e-5)


def test_a_diverging_prediction_is_nan() -> None:
    curvature = effect_named("drag_curvature")
    wild = replace(ROSUB, quadratic_drag=0.0, effects=(curvature,), effect_values=(-0.99,))
    count = 200
    states = np.zeros((count, TERM_STATES))
    flat = (np.full(1, 2.0), np.full(count, 1e6), np.zeros((count, 3)), np.full(count, 0.1), np.zeros(count), states)
    moved = predict_multi_step(*flat, np.array([0]), np.array([count - 1]), np.zeros(1), wild.body, wild.terms)
    assert np.isnan(moved[0, -1])
