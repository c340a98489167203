"""Tables of results, in every dialect."""

from __future__ import annotations

from pathlib import Path

import pytest

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
