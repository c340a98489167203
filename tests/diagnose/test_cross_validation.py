"""What a cause gains on pieces that the fit never saw."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rovid.diagnose.cross_validation import cross_validate, held_out_log_likelihood, horizon_errors
from rovid.diagnose.splitting import CvPiece, cv_pieces
from rovid.effects import effect_named
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.multi_step_data import MultiStepData
from rovid.estimate.multi_step_likelihood import MultiStepLikelihood
from tests import synthetic
from tests.predictions import BIAS, NOISE, TIME, TORQUE, biased, weakened


def test_what_reaches_into_another_piece_is_held_out_of_neither() -> None:
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


def test_what_the_other_pieces_do_not_tell_is_held_out_as_nothing() -> None:
    """Thrust of one trial alone, with that trial held out whole: its size must not come from what is held out."""
    named = weakened((0.0, 0.0, 0.1, 0.0))
    ahead = MultiStepData.from_data(InnovationData(named, synthetic.LOGGED, synthetic.ROSUB), synthetic.ROSUB)
    misfit = MultiStepLikelihood(ahead, effects=(effect_named("supply_sag:trial run_2"),))
    begin = misfit.parametrization.initial()
    begin[-1] = 0.8
    pieces = [CvPiece(number, -math.inf, math.inf, run) for number, run in enumerate(named)]
    folds = cross_validate(FitResult.at(misfit, begin), pieces)
    (without,) = [fold.x[-1] for fold in folds if fold.pieces == [pieces[2]]]
    assert without == 1.0
    others = [fold.x[-1] for fold in folds if fold.pieces != [pieces[2]]]
    assert others == pytest.approx([0.9] * 3, abs=0.02)


def test_a_threshold_between_two_levels_is_told_though_it_has_no_slope() -> None:
    runs = [synthetic.run(TIME[:900], TORQUE[:900], noise=NOISE[:900]) for _ in range(4)]
    ahead = MultiStepData.from_data(InnovationData(runs, synthetic.LOGGED, synthetic.ROSUB), synthetic.ROSUB)
    misfit = MultiStepLikelihood(ahead, effects=(effect_named("thruster_deadband:jump"),))
    at = misfit.parametrization.effects_begin
    begin = misfit.parametrization.initial()
    begin[at] = misfit.parametrization.high[at]
    assert not any(piece.matrix[:, at].any() for piece in misfit.jacobian(begin))
    pieces = [CvPiece(number, -math.inf, math.inf, run) for number, run in enumerate(runs)]
    folds = cross_validate(FitResult.at(misfit, begin), pieces)
    assert [fold.x[at] for fold in folds] == [misfit.parametrization.high[at]] * 4
