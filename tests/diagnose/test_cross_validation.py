"""What a cause gains on pieces that the fit never saw."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rovid.diagnose.cross_validation import cross_validate, errors_ahead, log_likelihood
from rovid.diagnose.splitting import Piece, pieces_of
from rovid.effects import effect_named
from rovid.estimate.filter_data import Readings
from rovid.estimate.fit_result import Fitted, climbed
from rovid.estimate.multi_step_data import HorizonRecords
from rovid.estimate.multi_step_likelihood import HorizonMisfit
from tests import synthetic
from tests.predictions import BIAS, NOISE, TIME, TORQUE, biased, weakened


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


def test_a_threshold_between_two_levels_is_told_though_it_has_no_slope() -> None:
    runs = [synthetic.run(TIME[:900], TORQUE[:900], noise=NOISE[:900]) for _ in range(4)]
    ahead = HorizonRecords.of(Readings(runs, synthetic.LOGGED, synthetic.ROSUB), synthetic.ROSUB)
    misfit = HorizonMisfit(ahead, effects=(effect_named("thruster_deadband:jump"),))
    at = misfit.coordinates.before_effects
    begin = misfit.coordinates.first()
    begin[at] = misfit.coordinates.high[at]
    assert not any(piece.matrix[:, at].any() for piece in misfit.slopes(begin))
    pieces = [Piece(number, -math.inf, math.inf, run) for number, run in enumerate(runs)]
    folds = cross_validate(Fitted.at(misfit, begin), pieces)
    assert [fold.x[at] for fold in folds] == [misfit.coordinates.high[at]] * 4
