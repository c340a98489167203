"""Predictions some time ahead, what counts of them, and the odds that come of it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy import signal

from rovid.diagnose.heldout import cross_validate, errors_ahead, log_likelihood
from rovid.diagnose.odd_trial import stands_out
from rovid.diagnose.odds import ESTABLISHED, confidence
from rovid.diagnose.parts import Piece, pieces_of
from rovid.diagnose.rivals import quickly_climbed
from rovid.diagnose.size import one_size
from rovid.effects import MOTION, Effect, effect_named
from rovid.effects.base import STIFFNESS, TERM_PARAMETERS, TERM_STATES, TRIM
from rovid.identify.certainty import form_doubt
from rovid.identify.courses import HORIZONS
from rovid.identify.fitted import Fitted, climbed
from rovid.identify.horizon_misfit import HorizonMisfit
from rovid.identify.horizons import HorizonRecords, predictions, time_constant
from rovid.identify.innovations import InnovationMisfit
from rovid.identify.readings import Readings
from rovid.identify.whiteness import whitening_gain
from rovid.model.kernels import predict, simulate_effects
from rovid.model.model import Model
from rovid.motion.rates import rates_of
from tests import synthetic

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rovid.ground.arrays import FloatArray
    from rovid.motion.runs import Run

TIME = synthetic.clock(1500.0, rate=5.0)
RNG = np.random.default_rng(0)
TORQUE = np.repeat(RNG.choice([-300.0, -120.0, 0.0, 120.0, 300.0], 60), 125)[: len(TIME)]
TORQUE = np.append(TORQUE, np.zeros(max(len(TIME) - len(TORQUE), 0)))
NOISE = 1e-4 * RNG.normal(size=len(TIME))


def records(torque: FloatArray = TORQUE, disturbance: FloatArray | None = None, runs: int = 1) -> HorizonRecords:
    made = [synthetic.run(TIME, torque, disturbance=disturbance, noise=NOISE) for _ in range(runs)]
    whole = Readings(made, synthetic.LOGGED, synthetic.ROSUB)
    return HorizonRecords.of(whole, synthetic.ROSUB)


def rms(ahead: HorizonRecords, model: Model) -> FloatArray:
    errors = predictions(ahead, model, ahead.drives(model))
    return np.array([np.sqrt(np.mean(errors[ahead.horizon == number] ** 2)) for number in range(len(HORIZONS))])


def test_the_true_model_predicts_and_a_wrong_one_does_not() -> None:
    ahead = records()
    right = rms(ahead, synthetic.ROSUB)
    wrong = rms(ahead, replace(synthetic.ROSUB, quadratic_drag=1.3 * synthetic.ROSUB.quadratic_drag))
    assert (right[2:] < 0.25 * wrong[2:]).all()
    assert (np.diff(wrong) > 0.0).all()


def test_restarts_take_away_what_drifts() -> None:
    """A constant torque turns a free run away without end, and a prediction only for as long as its horizon."""
    ahead = records(disturbance=np.full(len(TIME), 5.0))
    constant = time_constant(synthetic.ROSUB, ahead.rate)
    most = 5.0 / synthetic.ROSUB.inertia * (HORIZONS[-1] * constant) ** 2 / 2.0
    assert rms(ahead, synthetic.ROSUB)[-1] < most


def test_nothing_is_predicted_across_a_gap() -> None:
    run = synthetic.run(TIME, TORQUE, noise=NOISE)
    position = run.trial.position.copy()
    gap = (TIME > 700.0) & (TIME < 760.0)
    position[gap] = np.nan
    trial = replace(run.trial, position=position)
    cut = replace(run, trial=trial, rates=rates_of(trial, cutoff=1.0))
    ahead = HorizonRecords.of(Readings([cut], synthetic.LOGGED, synthetic.ROSUB), synthetic.ROSUB)
    ((begin, end),) = ahead.spans
    assert not ((begin < 701.0) & (end > 759.0)).any()
    assert (end < 700.0).any()
    assert (begin > 760.0).any()


def test_errors_that_are_alike_count_as_few() -> None:
    """White errors count for themselves; what lasts makes one of many."""
    slow = synthetic.gauss_markov(len(TIME), 0.2, 20.0, 200.0, np.random.default_rng(1))
    assert records(disturbance=slow).readings < 0.5 * records().readings


def test_a_long_log_costs_no_more_predictions() -> None:
    few, many = records(), records(runs=6)
    assert sum(len(course.grid.restarts) for course in many.courses) <= 700
    assert len(many.horizon) < 3 * len(few.horizon)


BIAS = effect_named("bias_torque")
WITH_BIAS = replace(synthetic.ROSUB, effects=(BIAS,), effect_values=(12.0,))


def biased() -> HorizonRecords:
    """With as many predictions as count once the constant torque is known."""
    return records(disturbance=np.full(len(TIME), 12.0)).counting(WITH_BIAS)


def test_what_is_missing_makes_all_errors_alike() -> None:
    unknown = records(disturbance=np.full(len(TIME), 12.0))
    assert unknown.readings < 0.2 * biased().readings


def test_a_constant_torque_is_found_with_its_size() -> None:
    ahead = biased()
    misfit = HorizonMisfit(ahead)
    plain = climbed(misfit, misfit.coordinates.first())
    with_bias = climbed(misfit.like((BIAS,)), np.concatenate((plain.x, [0.01])))
    assert plain.cost - with_bias.cost > 20.0
    assert with_bias.model.effect_values[0] == pytest.approx(12.0, rel=0.03)


def test_what_reaches_into_another_piece_is_held_out_of_neither() -> None:
    ahead = biased()
    plain = HorizonMisfit(ahead)
    fitted = climbed(plain, plain.coordinates.first())
    pieces = pieces_of(ahead.runs, synthetic.LOGGED, 1.0)
    assert len(pieces) == 8
    folds = cross_validate(fitted, pieces)
    assert sum(len(fold.pieces) for fold in folds) == 8
    with_bias = climbed(plain.like((BIAS,)), np.concatenate((fitted.x, [0.01])))
    gained = cross_validate(with_bias, pieces)
    assert log_likelihood(gained) > log_likelihood(folds) + 10.0
    before, after = errors_ahead(fitted, folds, pieces), errors_ahead(with_bias, gained, pieces)
    assert (after[2:] < 0.5 * before[2:]).all()


def test_pieces_are_as_many_as_runs_where_those_are_short() -> None:
    short = [synthetic.run(TIME[:80], TORQUE[85:165], noise=NOISE[:80]) for _ in range(12)]
    pieces = pieces_of(short, synthetic.LOGGED, 1.0)
    assert [piece.whole for piece in pieces] == list(range(12))
    assert all(isinstance(piece, Piece) for piece in pieces)


def test_a_run_that_is_long_enough_is_told_by_one_piece_and_tried_on_another() -> None:
    runs = [synthetic.run(TIME[:600], TORQUE[:600], noise=NOISE[:600]) for _ in range(12)]
    pieces = pieces_of(runs, synthetic.LOGGED, 1.0)
    assert [piece.whole for piece in pieces] == [number for number in range(12) for _ in range(2)]


def weakened(shares: Sequence[float]) -> list[Run]:
    """As many runs of a minute, each with its share of the thrust gone."""
    runs = [
        synthetic.run(TIME[:600], TORQUE[:600], noise=NOISE[:600], disturbance=-share * TORQUE[:600])
        for share in shares
    ]
    return [replace(run, trial=replace(run.trial, name=f"run_{number}")) for number, run in enumerate(runs)]


@pytest.mark.parametrize(
    ("shares", "stands"),
    [
        ((0.0, 0.0, 0.4, 0.0), True),
        ((0.0, 0.01, 0.4, -0.01, 0.0), True),
        # No more than others differ by, or than any battery does.
        ((0.2, -0.2, 0.4, 0.0), False),
        ((0.0, 0.0, 0.05, 0.0), False),
        # One of three.
        ((0.0, 0.0, 0.15), False),
    ],
)
def test_a_trial_has_to_stand_out_from_the_others(shares: Sequence[float], stands: bool) -> None:
    ahead = HorizonRecords.of(Readings(weakened(shares), synthetic.LOGGED, synthetic.ROSUB), synthetic.ROSUB)
    odd = effect_named("supply_sag:trial run_2")
    misfit = HorizonMisfit(ahead, effects=(odd,))
    begin = misfit.coordinates.first()
    begin[-1] = 0.8
    fitted = quickly_climbed(misfit, begin, 20)
    assert fitted.x[-1] < 0.99
    assert (stands_out(fitted, odd) >= ESTABLISHED) is stands


def test_what_the_other_pieces_do_not_tell_is_held_out_as_nothing() -> None:
    """Thrust of one trial alone, with that trial held out whole: its size must not come from what is held out."""
    named = weakened((0.0, 0.0, 0.1, 0.0))
    ahead = HorizonRecords.of(Readings(named, synthetic.LOGGED, synthetic.ROSUB), synthetic.ROSUB)
    misfit = HorizonMisfit(ahead, effects=(effect_named("supply_sag:trial run_2"),))
    begin = misfit.coordinates.first()
    begin[-1] = 0.8
    pieces = [Piece(number, -math.inf, math.inf, run) for number, run in enumerate(named)]
    folds = cross_validate(Fitted.at(misfit, begin), pieces)
    (without,) = [fold.x[-1] for fold in folds if fold.pieces == [pieces[2]]]
    assert without == 1.0
    others = [fold.x[-1] for fold in folds if fold.pieces != [pieces[2]]]
    assert others == pytest.approx([0.9] * 3, abs=0.02)


@pytest.mark.parametrize(
    ("worths", "alike", "least", "most"),
    [
        ({}, (), 0.0, 0.0),
        ({"a": math.log(2.0)}, ("a",), 0.49, 0.51),
        ({"a": 10.0, "b": 10.0}, ("a",), 0.49, 0.51),
        ({"a": 10.0, "b": 10.0}, ("a", "b"), 0.95, 0.98),
        ({"a": 3.0} | {f"other {k}": -2.0 for k in range(20)}, ("a",), 0.27, 0.32),
        ({"a": 1e4}, ("a",), 0.95, 0.98),
        ({"a": -1e4}, ("a",), 0.0, 1e-9),
    ],
)
def test_odds(worths: dict[str, float], alike: tuple[str, ...], least: float, most: float) -> None:
    found = confidence(worths, alike, len(worths))
    assert least <= found <= most
    assert math.isfinite(found)


def near_of(ahead: HorizonRecords) -> Readings:
    return Readings(ahead.runs, ahead.vehicle, ahead.start)


def fitted(key: str, ahead: HorizonRecords) -> tuple[Fitted, Fitted]:
    """A model with an effect by predictions, and one without any by each next reading."""
    effect = effect_named(key)
    misfit, near = HorizonMisfit(ahead, effects=(effect,)), InnovationMisfit(near_of(ahead), 1.0)
    first = near.coordinates.first()
    begin = np.concatenate((first, effect.starts[0]))
    return climbed(misfit, begin), climbed(near, first)


def test_a_cause_that_acts_has_one_size() -> None:
    found, near = fitted("bias_torque", records(disturbance=np.full(len(TIME), 8.0)))
    assert one_size(found, near, found.effects[0])


def test_a_size_that_only_predictions_show_is_told() -> None:
    found, near = fitted("bias_torque", records(disturbance=np.full(len(TIME), 8.0)))
    at = len(found.shared)
    twice = found.x.copy()
    twice[at] *= 2.0
    assert not one_size(replace(found, x=twice), near, found.effects[0])
    turned = found.x.copy()
    turned[at] *= -1.0
    assert not one_size(replace(found, x=turned), near, found.effects[0])


def test_whitening_gains_what_an_autoregression_does() -> None:
    """Of a first-order autoregression of unit variance: half the count times -log(1 - a^2)."""
    rng, memory, count = np.random.default_rng(3), 0.6, 20000
    noise = rng.normal(size=count) * math.sqrt(1.0 - memory**2)
    series = signal.lfilter([1.0], [1.0, -memory], noise)
    assert whitening_gain([series]) == pytest.approx(-0.5 * count * math.log(1.0 - memory**2), rel=0.03)
    assert whitening_gain([rng.normal(size=count)]) < 30.0
    assert whitening_gain([np.zeros(50)]) == 0.0
    assert math.isfinite(whitening_gain([np.ones(50)]))


@pytest.mark.parametrize("effect", MOTION, ids=lambda effect: effect.key)
def test_all_restarts_together_go_where_each_would_alone(effect: Effect) -> None:
    count, period = 120, 0.4
    rate, angle = 0.1 * np.sin(0.05 * np.arange(count)), np.linspace(0.0, 2.4, count)
    torque = np.where(np.arange(count) % 40 < 20, 150.0, -90.0)
    beside = np.column_stack((0.2 * np.ones(count), 0.8 + 0.1 * np.sin(np.arange(count)), 0.05 * np.ones(count)))
    scales = records().scales
    begin = zip(effect.starts[0], effect.parameters, strict=True)
    own = np.array([value * scales.of(parameter) for value, parameter in begin])
    terms, kinds = np.zeros((1, TERM_PARAMETERS)), np.array([MOTION.index(effect)])
    terms[0, : len(own)] = own
    base = synthetic.ROSUB.base_from(0.4)
    base[STIFFNESS - 1 : TRIM + 1] = effect.fastest(effect.values(own)) if effect.fastest else 0.0, 50.0, 0.02
    first = np.array([3, 50, 20, 64])
    reach, states = np.array([40, 12, 0, 55]), 0.01 * RNG.normal(size=(count, len(terms), TERM_STATES))
    bases = np.tile(base, (4, 1))
    moved = predict(np.full(4, period), torque, beside, rate, angle, states, first, reach, bases, terms, kinds)
    for lane, (at, steps) in enumerate(zip(first, reach, strict=True)):
        held = slice(at, at + steps + 1)
        here = (np.arange(steps + 1) * period, torque[held], np.zeros(steps + 1), beside[held])
        _, alone = simulate_effects(*here, base, terms, kinds, (rate[at], angle[at]), states[at])
        assert moved[lane, : steps + 1] == pytest.approx(alone - angle[at], rel=1e-9, abs=1e-12)
        assert np.isnan(moved[lane, steps + 1 :]).all()


def test_a_model_that_runs_away_predicts_nothing() -> None:
    curvature = effect_named("drag_curvature")
    wild = replace(synthetic.ROSUB, quadratic_drag=0.0, effects=(curvature,), effect_values=(-0.99,))
    count = 200
    terms, kinds = wild.terms()
    states = np.zeros((count, len(terms), TERM_STATES))
    flat = (np.full(1, 2.0), np.full(count, 1e6), np.zeros((count, 3)), np.full(count, 0.1), np.zeros(count), states)
    moved = predict(*flat, np.array([0]), np.array([count - 1]), wild.base_from(0.0)[np.newaxis], terms, kinds)
    assert np.isnan(moved[0, -1])


def test_a_threshold_between_two_levels_is_told_though_it_has_no_slope() -> None:
    runs = [synthetic.run(TIME[:900], TORQUE[:900], noise=NOISE[:900]) for _ in range(4)]
    ahead = HorizonRecords.of(Readings(runs, synthetic.LOGGED, synthetic.ROSUB), synthetic.ROSUB)
    misfit = HorizonMisfit(ahead, effects=(effect_named("thruster_deadband:jump"),))
    at = misfit.coordinates.before_effects
    begin = misfit.coordinates.first()
    begin[at] = misfit.coordinates.high[at]
    assert not misfit.slopes(begin).matrix[:, at].any()
    pieces = [Piece(number, -math.inf, math.inf, run) for number, run in enumerate(runs)]
    folds = cross_validate(Fitted.at(misfit, begin), pieces)
    assert [fold.x[at] for fold in folds] == [misfit.coordinates.high[at]] * 4


def test_nothing_swings_faster_than_readings_show() -> None:
    records = Readings([synthetic.run(TIME, TORQUE)], synthetic.LOGGED, synthetic.ROSUB, interval=1.0)
    coordinates = InnovationMisfit(records, 0.05, (effect_named("wave_torque"),)).coordinates
    highest = coordinates.high[coordinates.before_effects + 1]
    assert highest == pytest.approx(math.pi)
    starts = coordinates.starts()
    assert all(start[1] <= highest for start in starts)
    assert len({tuple(start) for start in starts}) == len(starts) < len(effect_named("wave_torque").starts)


def test_horizons_that_disagree_widen_the_errors_and_are_named() -> None:
    """A torque that comes late shows to short predictions as another drag than to long ones."""
    right = _fitted_ahead([synthetic.run(TIME[:900], TORQUE[:900], noise=NOISE[:900]) for _ in range(4)])
    doubt, said = form_doubt(right)
    assert not said
    assert np.sqrt(doubt[0, 0]) < 2.0 * np.sqrt(right.covariance(sandwich=True)[0, 0])
    late = 0.1 * np.convolve(TORQUE, np.ones(60) / 60.0)[: len(TORQUE)]
    cuts = [slice(start, start + 2000) for start in (0, 2000, 4000)]
    runs = [synthetic.run(TIME[:2000], TORQUE[cut], noise=NOISE[:2000], disturbance=late[cut]) for cut in cuts]
    wrong = _fitted_ahead(runs)
    doubt, said = form_doubt(wrong)
    assert len(said) == 1
    assert "half of the difference" in said[0]
    assert np.diag(doubt)[:3].max() > 0.0


def _fitted_ahead(runs: list[Run]) -> Fitted:
    misfit = HorizonMisfit(HorizonRecords.of(Readings(runs, synthetic.LOGGED, synthetic.ROSUB), synthetic.ROSUB))
    return climbed(misfit, misfit.coordinates.first())
