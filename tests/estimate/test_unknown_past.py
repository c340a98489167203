"""Logs that begin in an unknown state of the drives."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_lyapunov

from rovid.core.array_types import FloatArray
from rovid.effects import Effect, effect_named
from rovid.effects.base import Term
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.estimate.parametrization import COMMON, DISTURBANCE, MEMORY, NOISE
from rovid.estimate.unknown_past import water_warning
from rovid.model.ode import with_moved_past
from rovid.model.reference import ExtendedKalmanFilter
from rovid.model.reference import Noise as FilterNoise
from rovid.trial.preprocessing import Run
from rovid.trial.rates import compute_rates
from tests import synthetic

LAG, DELAY, SWIRL = map(effect_named, ("thruster_lag", "command_delay", "entrained_swirl"))
PERIOD, SECONDS, TIME_CONSTANT = 0.1, 60.0, 2.5
TIME = synthetic.clock(SECONDS, 1.0 / PERIOD)
MOTION = synthetic.ROSUB


def levels(seed: int) -> FloatArray:
    """A torque in N m that changes its level every 4 s, and does not begin at zero."""
    rng = np.random.default_rng(seed)
    sizes = rng.uniform(80.0, 300.0, 20) * rng.choice([-1.0, 1.0], 20)
    return np.asarray(np.repeat(sizes, 40)[: len(TIME)])


def behind_a_lag(torque: FloatArray, before: float) -> FloatArray:
    """Mean over each interval of a torque behind a lag, which stood at ``before`` N m at first."""
    fade, state, means = math.exp(-PERIOD / TIME_CONSTANT), before, []
    for wanted in torque.tolist():
        means.append(wanted + (state - wanted) * (1.0 - fade) * TIME_CONSTANT / PERIOD)
        state = wanted + (state - wanted) * fade
    return np.array(means)


def runs(before: tuple[float, ...]) -> list[Run]:
    """Runs from rest whose thrust is that much in N m at the first sample."""
    rng, found = np.random.default_rng(5), []
    for seed, first in enumerate(before):
        torque, noise = levels(seed), 2e-4 * rng.normal(size=len(TIME))
        water = synthetic.gauss_markov(len(TIME), PERIOD, 1.0, 4.0, rng)
        off = behind_a_lag(torque, first) - torque + water
        found.append(synthetic.run(TIME, torque, MOTION, disturbance=off, noise=noise))
    return found


def data(before: tuple[float, ...], interval: float = 0.0) -> InnovationData:
    return InnovationData(runs(before), synthetic.LOGGED, MOTION, interval=interval)


def at(given: InnovationData, effect: Effect, *values: float) -> tuple[InnovationLikelihood, FloatArray]:
    objective = InnovationLikelihood(given, 0.05, (effect,))
    x = objective.parametrization.initial()
    x[COMMON:] = np.array(values) / objective.parametrization.units
    x[DISTURBANCE], x[MEMORY], x[NOISE] = math.log(2.0), math.log(4.0), math.log(3e-4)
    return objective, x


@pytest.mark.parametrize(("effect", "values"), [(LAG, (TIME_CONSTANT,)), (DELAY, (0.8,))])
@pytest.mark.parametrize("interval", [0.0, 0.4])
def test_the_unknown_torque_is_one_more_state(effect: Effect, values: tuple[float, ...], interval: float) -> None:
    """The two filters of the likelihood give what one filter with a further state gives."""
    given = data((0.0,), interval)
    objective, x = at(given, effect, *values)
    found = objective.innovations(x)
    (chunk,) = given.chunks
    unknown = chunk.unknown_pasts
    assert unknown is not None
    model = objective.parametrization.model(x)
    moved, change = with_moved_past(given.driven_runs[0].trial, synthetic.LOGGED)
    assert change == unknown.changes[0]
    torque = chunk.inputs.between_steps(model)
    response = (unknown.inputs.between_steps(model).torque - torque.torque) / change
    noise = FilterNoise(disturbance=2.0, correlation_time=4.0, angle=3e-4, rate=1.0)
    measured = np.column_stack((given.angles[0], np.full(len(given.angles[0]), np.nan)))
    first = tuple(chunk.filter_data.initial_rate[0].tolist())
    innovation, variance = ExtendedKalmanFilter(model, noise, chunk.filter_data.start_position[0]).innovations(
        given.times[0], torque, measured, first, (response, unknown.std)
    )
    assert moved.past is not None
    # Drag is quadratic, and the unknown torque is large: linearised around the mean without it, or with it.
    np.testing.assert_allclose(found.error, innovation[1:, 0], rtol=0.0, atol=0.02 * np.sqrt(found.variance).max())
    np.testing.assert_allclose(found.variance, variance[1:, 0], rtol=0.02)


MEMORY_TIME, ADDED = 6.0, 600.0
GAIN, FREQUENCY, DAMPING = 0.1, 0.8, 0.05
RINGING = np.array([[0.0, 1.0], [-(FREQUENCY**2), -2.0 * DAMPING * FREQUENCY]])


def left_by_memory(time: FloatArray) -> FloatArray:
    """N m that water with the rate 1 rad/s at first exerts after it, beside what the motion does to it."""
    return np.asarray(ADDED / MEMORY_TIME * np.exp(-time / MEMORY_TIME))


def left_by_seiche(time: FloatArray) -> FloatArray:
    """N m of a mode whose second state was 1 at first."""
    states = np.array([expm(RINGING * t)[:, 1] for t in time])
    return np.asarray(-GAIN * MOTION.inertia * FREQUENCY * (states @ RINGING[1]))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "values", "left", "state"),
    [
        (effect_named("added_mass_memory"), (ADDED, MEMORY_TIME), left_by_memory, 0),
        (effect_named("tank_seiche"), (GAIN, FREQUENCY, DAMPING), left_by_seiche, 1),
    ],
    ids=["three states", "five states"],
)
def test_the_unknown_water_is_one_more_state(
    effect: Effect, values: tuple[float, ...], left: Callable[[FloatArray], FloatArray], state: int
) -> None:
    """Water is linear: what it was at first acts as a torque beside the motion."""
    term, std = effect.acts, 0.05
    assert isinstance(term, Term)
    usual = term.unknown_start
    # The reference has one unknown state.
    object.__setattr__(term, "unknown_start", lambda *_: tuple(std * (at == state) for at in range(term.states)))
    try:
        given = data((60.0,))
        objective, x = at(given, effect, *values)
        found = objective.innovations(x)
    finally:
        object.__setattr__(term, "unknown_start", usual)
    (chunk,) = given.chunks
    model = objective.parametrization.model(x)
    middle = given.times[0] + 0.5 * PERIOD
    noise = FilterNoise(disturbance=2.0, correlation_time=4.0, angle=3e-4, rate=1.0)
    measured = np.column_stack((given.angles[0], np.full(len(given.angles[0]), np.nan)))
    first = tuple(chunk.filter_data.initial_rate[0].tolist())
    innovation, variance = ExtendedKalmanFilter(model, noise, chunk.filter_data.start_position[0]).innovations(
        given.times[0], chunk.inputs.between_steps(model), measured, first, (left(middle), std)
    )
    unknown = chunk.unknown_pasts
    object.__setattr__(chunk, "unknown_pasts", None)
    at_rest = objective.innovations(x)
    object.__setattr__(chunk, "unknown_pasts", unknown)
    changed = np.abs(at_rest.error - found.error).max()
    assert changed > 0.2 * np.sqrt(found.variance).max()
    np.testing.assert_allclose(found.error, innovation[1:, 0], rtol=0.0, atol=0.1 * changed)
    np.testing.assert_allclose(found.variance, variance[1:, 0], rtol=0.02)


@pytest.mark.parametrize("form", ["", ":following", ":thrust"])
def test_a_seiche_rings_before_a_log_as_after_a_broad_excitation(form: str) -> None:
    """A mode under white noise of the intensity of a rate that varies as fast as the mode: eq. of Lyapunov."""
    term = effect_named(f"tank_seiche{form}").acts
    assert isinstance(term, Term)
    assert term.unknown_start is not None
    values = {"gain": GAIN, "frequency": FREQUENCY, "damping": DAMPING}
    found = term.unknown_start(values, 0.3, 0.7)
    size = 0.7 if form == ":thrust" else 0.3
    # Intensity of a process of that size with the correlation time 1/(2ω), as white noise at the frequency of the mode.
    intensity = size**2 / FREQUENCY
    covariance = solve_continuous_lyapunov(RINGING, -np.diag([0.0, intensity]))
    assert found == pytest.approx(np.sqrt(np.diag(covariance)))


def in_a_turn(seed: int, gain: float, angle: float) -> Run:
    """A run that begins 25 s after a reversal, with drag that fell meanwhile."""
    rng, step = np.random.default_rng(seed), 0.05
    levels = np.repeat([200.0, -200.0, 120.0, -250.0, 250.0, -90.0], 700)
    rate = place = swept = 0.0
    places = np.empty(len(levels))
    for k, torque in enumerate(levels.tolist()):
        places[k] = place
        drag = MOTION.quadratic_drag * (1.0 + gain * math.exp(-abs(swept) / angle)) * abs(rate) * rate
        rate += step * (torque - drag - MOTION.linear_drag * rate) / MOTION.inertia
        swept = swept + step * rate if swept * rate >= 0.0 else step * rate
        place += step * rate
    kept = np.arange(700, len(levels), 2)
    time, torque = synthetic.clock((len(kept) - 1) * PERIOD, 1.0 / PERIOD), levels[kept]
    log = synthetic.trial(time, torque, places[kept] + 2e-4 * rng.normal(size=len(kept)))
    rates = compute_rates(log, cutoff=1.0)
    return Run(trial=log, torque=torque, rates=rates, filtered_torque=rates.filter_held(log, torque))


def test_drag_after_a_reversal_is_estimated_from_logs_that_begin_in_a_turn() -> None:
    """The angle swept before the first sample is unknown. Taken as none, the drag is far too large at first."""
    gain, angle = 2.0, 1.2
    given = InnovationData([in_a_turn(seed, gain, angle) for seed in range(3)], synthetic.LOGGED, MOTION)
    objective, x = at(given, effect_named("oscillatory_drag"), gain, angle)
    found = fit(objective, x)
    errors = np.sqrt(np.diag(found.covariance(sandwich=False)))[-2:]
    assert np.all(np.abs(found.model.values[-2:] - (gain, angle)) < 4.0 * errors)
    assert np.all(errors < 0.1 * np.array([gain, angle]))


def test_water_is_at_rest_where_the_vehicle_is() -> None:
    still = [synthetic.run(TIME, torque * (TIME > 2.0), MOTION) for torque in (levels(1),)]
    given = InnovationData(still, synthetic.LOGGED, MOTION)
    (chunk,) = given.chunks
    assert chunk.unknown_pasts is None


def test_a_model_without_memory_is_not_affected() -> None:
    given = data((0.0,))
    objective, x = at(given, effect_named("drag_curvature"), 10.0)
    (chunk,) = given.chunks
    assert chunk.unknown_pasts is not None
    with_state = objective.innovations(x)
    object.__setattr__(chunk, "unknown_pasts", None)
    np.testing.assert_array_equal(objective.innovations(x), with_state)


def fitted(given: InnovationData) -> FitResult:
    objective = InnovationLikelihood(given, 0.02, (LAG,))
    return fit(objective, objective.parametrization.initial())


@pytest.mark.parametrize(
    "before",
    [
        # Off; on for long, which a vehicle at rest does not show; between.
        (0.0, 0.0, 0.0, 0.0),
        (60.0, -40.0, 30.0, 90.0),
    ],
)
def test_a_lag_is_estimated_whatever_acted_before(before: tuple[float, ...]) -> None:
    found = fitted(data(before))
    errors = np.sqrt(np.diag(found.covariance(sandwich=False)))
    truth = np.array([MOTION.inertia, MOTION.quadratic_drag, MOTION.linear_drag, TIME_CONSTANT])
    # Eight comparisons: one in 2000 is beyond four standard errors by chance.
    assert np.all(np.abs(found.model.values - truth) < 4.0 * errors)
    assert errors[3] < 0.02 * TIME_CONSTANT
    assert found.is_white


def test_drives_that_are_taken_as_settled_are_wrong() -> None:
    """The same logs without the unknown state, with the first command held before."""
    given = data((0.0, 0.0, 0.0, 0.0))
    object.__setattr__(given, "driven_runs", given.runs)
    found = fitted(given)
    assert not found.is_white
    assert abs(found.model.values[3] - TIME_CONSTANT) > 0.03 * TIME_CONSTANT


def test_simulations_from_resting_water_are_told() -> None:
    """The warning names the logs that begin in motion, and appears for effects of the water alone."""
    given = data((0.0, 100.0))
    names = [run.trial.name for run in given.driven_runs if run.trial.past is not None]
    swirl, lag = (
        objective.parametrization.model(x) for objective, x in (at(given, SWIRL, 0.1, 10.0), at(given, LAG, 1.0))
    )
    (words,) = water_warning(swirl, given)
    assert words.startswith(f"The water may already move, or the tether be stretched, at the start of {names[0]}")
    assert water_warning(lag, given) == []
