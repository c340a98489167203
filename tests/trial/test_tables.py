"""Tables of results, in every dialect."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from rovid.core.errors import RovidError
from rovid.trial.tables import read_curve
from tests.tables import table


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a;b\n1,5;2\n", [1.5]),
        ("a\tb\n1.5\t2\n", [1.5]),
        ("\ufeffa,b\n1.5,2\n", [1.5]),
        ("# note\na,b\n\n1.5,2\n", [1.5]),
    ],
)
def test_tables_of_every_dialect(text: str, expected: list[float], tmp_path: Path) -> None:
    assert table(text, tmp_path).numbers("a").tolist() == expected


@pytest.mark.parametrize(
    ("curve", "words"),
    [
        ("command,thrust_N\n", "no rows"),
        ("command,thrust_N\n1,2\n", "1 points"),
        ("command,thrust_N\n1,2\n1,3\n", "at one command"),
        ("command,thrust\n1,2\n2,3\n", "Nearest: 'thrust'"),
        ("command,thrust_N\n1,2\n2,many\n", ":3: thrust_N is 'many'"),
        ("command,thrust_N\n1,2\n2,inf\n", ":3: thrust_N is 'inf'"),
        ("", "is empty"),
    ],
)
def test_curves_that_are_none(curve: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "curve.csv"
    path.write_text(curve)
    with pytest.raises(RovidError, match=re.escape(words)):
        read_curve(path)


def test_a_curve_may_stand_in_any_order(tmp_path: Path) -> None:
    path = tmp_path / "curve.csv"
    path.write_text("thrust_N;command\n200;5\n-100,5;-5\n0;0\n")
    assert read_curve(path).thrust.tolist() == [-100.5, 0.0, 200.0]
