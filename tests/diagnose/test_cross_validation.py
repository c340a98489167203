"""Cross-validation: required data, pieces, held-out scores, noise floor."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.core.budget import Budget
from rovid.diagnose import cross_validation
from rovid.diagnose.cross_validation import (
    CvPiece,
    cross_validate,
    cv_pieces,
    held_out_log_likelihood,
    horizon_errors,
    horizon_squares,
    missing_data,
    position_std_after,
    rate_floor,
    simulate_folds,
    split_runs,
)
from rovid.diagnose.objectives import pose
from rovid.diagnose.selection import Selection
from rovid.effects import effect_named
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.multi_step import MultiStepData, MultiStepLikelihood
from rovid.estimate.output_error import fit_output_error
from rovid.model.model import Model
from rovid.trial.preprocessing import PreparedRuns, Run
from rovid.trial.rates import compute_rates
from tests import synthetic
from tests.predictions import BIAS, NOISE, TIME, TORQUE, biased, weakened

MINUTES = synthetic.clock(120.0)
CUTOFF = 1.0
PUSHED = np.where(MINUTES < 60.0, 100.0, -100.0)


def runs_of(torque: FloatArray, disturbance: FloatArray | None = None) -> list[Run]:
    noise = 1e-4 * np.random.default_rng(1).normal(size=len(MINUTES))
    return [synthetic.run(MINUTES, torque, disturbance=disturbance, noise=noise) for _ in range(4)]


@pytest.mark.parametrize("pause", [0.0, 1500.0])
def test_few_logs_are_searched_whole_unless_one_has_a_pause(pause: float) -> None:
    """A part begins anew: what the water did before its start is unknown to the filter. So it is after a pause."""
    time = synthetic.clock(400.0)
    time = np.where(time > 200.0, time + pause, time)
    noise = np.random.default_rng(2).normal(0.0, 1e-4, len(time))
    run = synthetic.run(time, 100.0 * np.sign(np.sin(0.1 * time)), noise=noise)
    run = replace(run, trial=replace(run.trial, commands=run.torque[:, None] / 100.0))  # in V
    vehicle = synthetic.VEHICLE
    prepared = PreparedRuns(items=(run,), cutoff=0.5, chosen=True, remarks=())
    parts = split_runs(prepared.items, vehicle, 0.5)
    assert parts is not None
    problem = pose(prepared, parts.items, vehicle, Budget())
    searched = problem.innovations
    assert (searched.data is problem.data) == (not pause)
    assert len(searched.data.runs) == (len(parts.items) if pause else 1)
    assert len(searched.pieces) == len(parts.items)
    # The first model is that of the whole logs: in short parts a constant torque leaves no drag.
    assert problem.data.initial_model == fit_output_error(prepared.items, min_sigmas=0.0)
    assert problem.data.initial_model != fit_output_error(parts.items, min_sigmas=0.0)


def test_three_logs_of_five_time_constants_are_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    """Under a large constant torque the plain model has little drag, and a long time constant."""
    monkeypatch.setattr(cross_validation, "time_constant", lambda *_: 25.0)
    parts = split_runs(runs_of(PUSHED)[:3], synthetic.LOGGED, CUTOFF)
    assert parts is not None
    assert len(parts.items) == 6


def test_driven_and_moving_runs_are_enough_data() -> None:
    assert missing_data(runs_of(PUSHED), CUTOFF) == ""


def test_two_short_trials_are_too_few() -> None:
    said = missing_data(runs_of(PUSHED)[:2], CUTOFF)
    assert "too few trials (2, 240 s in all)" in said
    assert "Record more runs" in said


def test_runs_without_thrust_are_refused() -> None:
    drift = runs_of(np.zeros(len(MINUTES)), disturbance=PUSHED)
    assert "no thruster ever runs" in missing_data(drift, CUTOFF)


def test_runs_without_motion_are_refused() -> None:
    stuck = runs_of(PUSHED, disturbance=-PUSHED)
    assert "the vehicle never turns" in missing_data(stuck, CUTOFF)


def test_short_runs_are_whole_pieces() -> None:
    short = [synthetic.run(TIME[:80], TORQUE[85:165], noise=NOISE[:80]) for _ in range(12)]
    pieces = cv_pieces(short, synthetic.LOGGED, 1.0)
    assert [piece.run_index for piece in pieces] == list(range(12))
    assert all(isinstance(piece, CvPiece) for piece in pieces)


def test_long_runs_have_two_pieces() -> None:
    runs = [synthetic.run(TIME[:600], TORQUE[:600], noise=NOISE[:600]) for _ in range(12)]
    pieces = cv_pieces(runs, synthetic.LOGGED, 1.0)
    assert [piece.run_index for piece in pieces] == [number for number in range(12) for _ in range(2)]


@pytest.mark.parametrize("seed", range(12))
def test_gaps_of_any_length_leave_pieces_with_runs(seed: int) -> None:
    """Parts without readings, shorter than the filter, or of one sample have no piece."""
    rng = np.random.default_rng(seed)
    broken = []
    for run in runs_of(PUSHED):
        position = run.trial.position.copy()
        for _ in range(int(rng.integers(1, 30))):
            begin = int(rng.integers(len(position)))
            position[begin : begin + int(20.0 * 10.0 ** rng.uniform(-1.0, 1.7))] = np.nan
        log = replace(run.trial, position=position)
        rates = compute_rates(log, cutoff=CUTOFF)
        broken.append(replace(run, trial=log, rates=rates, filtered_torque=rates.filter_held(log, run.torque)))
    pieces = cv_pieces(broken, synthetic.LOGGED, CUTOFF)
    assert pieces
    for piece in pieces:
        assert piece.run.trial.duration == pytest.approx(piece.end - piece.begin)
        assert broken[piece.run_index].trial.name == piece.run.trial.parent


def test_cross_validation_shows_the_gain_of_a_cause() -> None:
    ahead = biased()
    plain = MultiStepLikelihood(ahead)
    fitted = fit(plain, plain.parametrization.initial())
    pieces = cv_pieces(ahead.runs, synthetic.LOGGED, 1.0)
    assert len(pieces) == 8
    folds = cross_validate(fitted, pieces)
    assert sum(len(fold.pieces) for fold in folds) == 8
    with_bias = fit(plain.with_effects((BIAS,)), np.concatenate((fitted.x, [0.01])))
    gained = cross_validate(with_bias, pieces)
    assert held_out_log_likelihood(gained) > held_out_log_likelihood(folds) + 10.0
    before, after = horizon_errors(fitted, folds, pieces), horizon_errors(with_bias, gained, pieces)
    assert (after[2:] < 0.5 * before[2:]).all()
    squares, single = horizon_squares(fitted, folds, pieces), simulate_folds(fitted, folds)
    assert squares.shape == (8, len(before))
    # Pieces are about as long as each other, so that the pooled error is close to the mean over pieces.
    assert np.sqrt(np.nanmean(squares, axis=0)) == pytest.approx(before, rel=0.2, nan_ok=True)
    assert math.sqrt(float(np.mean(single.rate_squares))) == pytest.approx(single.rate_rmse, rel=0.2)


def test_a_parameter_that_the_training_data_do_not_determine_is_neutral() -> None:
    """Thrust of one trial, with that trial held out whole: its size must not come from the held-out data."""
    named = weakened((0.0, 0.0, 0.1, 0.0))
    ahead = MultiStepData.from_data(InnovationData(named, synthetic.LOGGED, synthetic.ROSUB), synthetic.ROSUB)
    objective = MultiStepLikelihood(ahead, effects=(effect_named("supply_sag:trial run_2"),))
    begin = objective.parametrization.initial()
    begin[-1] = 0.8
    pieces = [CvPiece(number, -math.inf, math.inf, run) for number, run in enumerate(named)]
    folds = cross_validate(FitResult.at(objective, begin), pieces)
    (without,) = [fold.x[-1] for fold in folds if fold.pieces == [pieces[2]]]
    assert without == 1.0
    others = [fold.x[-1] for fold in folds if fold.pieces != [pieces[2]]]
    assert others == pytest.approx([0.9] * 3, abs=0.02)


def test_a_threshold_without_a_slope_keeps_its_value() -> None:
    runs = [synthetic.run(TIME[:900], TORQUE[:900], noise=NOISE[:900]) for _ in range(4)]
    ahead = MultiStepData.from_data(InnovationData(runs, synthetic.LOGGED, synthetic.ROSUB), synthetic.ROSUB)
    objective = MultiStepLikelihood(ahead, effects=(effect_named("thruster_deadband:jump"),))
    at = objective.parametrization.effects_begin
    begin = objective.parametrization.initial()
    begin[at] = objective.parametrization.high[at]
    assert not any(piece.matrix[:, at].any() for piece in objective.jacobian(begin))
    pieces = [CvPiece(number, -math.inf, math.inf, run) for number, run in enumerate(runs)]
    folds = cross_validate(FitResult.at(objective, begin), pieces)
    assert [fold.x[at] for fold in folds] == [objective.parametrization.high[at]] * 4


MODEL = Model(inertia=5000.0, quadratic_drag=3500.0, linear_drag=130.0)
DISTURBANCE, MEMORY, RATE = 2.5, 4.0, 0.15


def drawn(seconds: float, begun: tuple[float, float], count: int = 4000, step: float = 0.02) -> float:
    """Standard deviation of the position of many motions, simulated by Euler steps."""
    rng = np.random.default_rng(7)
    slope = 2.0 * MODEL.quadratic_drag * RATE + MODEL.linear_drag
    position, rate = (np.sqrt(variance) * rng.normal(size=count) for variance in begun)
    torque = DISTURBANCE * rng.normal(size=count)
    kept = np.exp(-step / MEMORY)
    for _ in range(round(seconds / step)):
        position = position + step * rate
        rate = rate + step * (torque - slope * rate) / MODEL.inertia
        torque = kept * torque + DISTURBANCE * np.sqrt(1.0 - kept**2) * rng.normal(size=count)
    return float(np.std(position))


@pytest.mark.parametrize("seconds", [10.0, 60.0])
def test_the_position_error_is_the_scatter_of_many_simulations(seconds: float) -> None:
    begun = (1e-6, 1e-6)
    expected = position_std_after(MODEL, RATE, (DISTURBANCE, MEMORY), begun, seconds)
    # 4000 motions determine their scatter within 1.1 %.
    assert drawn(seconds, begun) == pytest.approx(expected, rel=0.05)


def test_a_fast_vehicle_causes_no_overflow() -> None:
    quick = Model(inertia=0.01, quadratic_drag=1.0, linear_drag=5.0)
    off = position_std_after(quick, 1.0, (0.1, 0.2), (0.0, 0.0), 60.0)
    # Long after its correlation time, the torque acts as white noise: T sqrt(2 memory t) / slope.
    assert off == pytest.approx(0.1 * np.sqrt(2.0 * 0.2 * 60.0) / 7.0, rel=0.01)


def test_without_disturbance_and_noise_the_position_is_exact() -> None:
    assert position_std_after(MODEL, RATE, (0.0, MEMORY), (0.0, 0.0), 60.0) == 0.0


def test_the_floor_of_multi_step_predictions_includes_the_torque_that_is_unexplained(selection: Selection) -> None:
    """Equation (20); without the constant torque, which acts, more is unexplained."""
    floors = []
    for fitted in (selection.model, selection.search.without(selection.model, BIAS)):
        (size, memory), model = fitted.disturbance, fitted.model
        slope = 2.0 * model.quadratic_drag * fitted.data.rms_rate + model.linear_drag
        noise = np.median([run.rates.rate_noise for run in fitted.data.runs])
        driven = size * math.sqrt(memory / (slope * (model.inertia + slope * memory)))
        floors.append(rate_floor(fitted))
        assert floors[-1] == pytest.approx(math.hypot(driven, noise))
    assert floors[0] < 0.5 * floors[1]
