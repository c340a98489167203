"""What a cause gains on pieces that the fit never saw."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rovid.diagnose.fitted import Fitted
from rovid.diagnose.heldout import cross_validate, errors_ahead, log_likelihood
from rovid.diagnose.parts import Piece, pieces_of
from rovid.effects import effect_named
from rovid.identify.horizons import HorizonLikelihood, HorizonRecords
from rovid.identify.records import Records
from tests import synthetic
from tests.predictions import BIAS, NOISE, TIME, TORQUE, biased, weakened


def test_what_reaches_into_another_piece_is_held_out_of_neither() -> None:
    ahead = biased()
    plain = HorizonLikelihood(ahead)
    fitted = Fitted(plain, *plain.climb(plain.first()))
    pieces = pieces_of(ahead.runs, synthetic.LOGGED, 1.0)
    assert len(pieces) == 8
    folds = cross_validate(fitted, pieces)
    assert sum(len(fold.pieces) for fold in folds) == 8
    likelihood = plain.like((BIAS,))
    with_bias = Fitted(likelihood, *likelihood.climb(np.concatenate((fitted.x, [0.01]))))
    gained = cross_validate(with_bias, pieces)
    assert log_likelihood(gained) > log_likelihood(folds) + 10.0
    before, after = errors_ahead(fitted, folds, pieces), errors_ahead(with_bias, gained, pieces)
    assert (after[2:] < 0.5 * before[2:]).all()


def test_what_the_other_pieces_do_not_tell_is_held_out_as_nothing() -> None:
    """Thrust of one trial alone, with that trial held out whole: its size must not come from what is held out."""
    named = weakened((0.0, 0.0, 0.1, 0.0))
    ahead = HorizonRecords.of(Records(named, synthetic.LOGGED, synthetic.ROSUB), synthetic.ROSUB)
    likelihood = HorizonLikelihood(ahead, effects=(effect_named("supply_sag:trial run_2"),))
    begin = likelihood.first()
    begin[-1] = 0.8
    pieces = [Piece(number, -math.inf, math.inf, run) for number, run in enumerate(named)]
    folds = cross_validate(Fitted(likelihood, begin, likelihood.cost(begin)), pieces)
    (without,) = [fold.x[-1] for fold in folds if fold.pieces == [pieces[2]]]
    assert without == 1.0
    others = [fold.x[-1] for fold in folds if fold.pieces != [pieces[2]]]
    assert others == pytest.approx([0.9] * 3, abs=0.02)


def test_a_threshold_between_two_levels_is_told_though_it_has_no_slope() -> None:
    runs = [synthetic.run(TIME[:900], TORQUE[:900], noise=NOISE[:900]) for _ in range(4)]
    ahead = HorizonRecords.of(Records(runs, synthetic.LOGGED, synthetic.ROSUB), synthetic.ROSUB)
    likelihood = HorizonLikelihood(ahead, effects=(effect_named("thruster_deadband:jump"),))
    at = likelihood.base
    begin = likelihood.first()
    begin[at] = likelihood.high[at]
    assert not likelihood.slopes(begin).matrix[:, at].any()
    pieces = [Piece(number, -math.inf, math.inf, run) for number, run in enumerate(runs)]
    folds = cross_validate(Fitted(likelihood, begin, likelihood.cost(begin)), pieces)
    assert [fold.x[at] for fold in folds] == [likelihood.high[at]] * 4
