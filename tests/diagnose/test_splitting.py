"""Pieces of runs, each told by the others."""

from __future__ import annotations

from rovid.diagnose.splitting import CvPiece, cv_pieces
from tests import synthetic
from tests.predictions import NOISE, TIME, TORQUE


def test_pieces_are_as_many_as_runs_where_those_are_short() -> None:
    short = [synthetic.run(TIME[:80], TORQUE[85:165], noise=NOISE[:80]) for _ in range(12)]
    pieces = cv_pieces(short, synthetic.LOGGED, 1.0)
    assert [piece.run_index for piece in pieces] == list(range(12))
    assert all(isinstance(piece, CvPiece) for piece in pieces)


def test_a_run_that_is_long_enough_is_told_by_one_piece_and_tried_on_another() -> None:
    runs = [synthetic.run(TIME[:600], TORQUE[:600], noise=NOISE[:600]) for _ in range(12)]
    pieces = cv_pieces(runs, synthetic.LOGGED, 1.0)
    assert [piece.run_index for piece in pieces] == [number for number in range(12) for _ in range(2)]
