"""TOML within limits."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from rovid.core.errors import ConfigError
from rovid.core.input_files import LARGEST, expected_number, read_toml


def written(folder: Path, text: str | bytes) -> Path:
    path = folder / "a.toml"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def test_a_document_is_read_whatever_stands_at_its_beginning(tmp_path: Path) -> None:
    assert read_toml(written(tmp_path, "\ufeff[a]\nb = [1, 2.5]\n")) == {"a": {"b": [1, 2.5]}}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a = ", "is not valid TOML"),
        (b"a = '\xff'", "is not UTF-8 text"),
        ("a = " + "[" * 40 + "]" * 40, "nested deeper than 32 levels"),
        ("a = " + "[" * 5000 + "]" * 5000, "nested deeper than 32 levels"),
        (".".join("a" * 40) + " = 1", "nested deeper than 32 levels"),
        ("[a]\nb = [0, 9223372036854775808]", "a.b.2: is an integer of more than 64 bits"),
        ("a = " + "9" * 5000, "is not valid TOML"),
        (b"#" * 4_000_001, "is larger than 4 MB"),
    ],
)
def test_what_is_none_is_refused_in_one_message(text: str | bytes, words: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=words):
        read_toml(written(tmp_path, text))


def test_a_file_that_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read"):
        read_toml(tmp_path / "gone.toml")


@pytest.mark.parametrize(
    ("value", "positive", "wanted"),
    [
        (1, True, ""),
        (-1.5, False, ""),
        (True, False, "a number"),
        ("1", False, "a number"),
        (math.nan, False, "a number"),
        (0.0, True, "a positive number"),
        (1e-13, True, "a number between 1e-12 and 1e+18"),
        (2.0 * LARGEST, False, "a number up to 1e+18 in size"),
    ],
)
def test_a_number_has_a_size_that_something_has(value: object, positive: bool, wanted: str) -> None:
    assert expected_number(value, positive=positive) == wanted
