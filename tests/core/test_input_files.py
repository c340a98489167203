"""Paths of input files, and TOML within limits."""

from __future__ import annotations

import math
import os
from pathlib import Path

import pytest

from rovid.core.errors import ConfigError, LogError
from rovid.core.input_files import (
    LARGEST,
    expected_number,
    list_files,
    read_toml,
    require_exists,
    require_regular,
    special_kind,
)

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pipes and links are POSIX")


def test_files_and_folders_are_opened_and_a_pipe_is_not(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "file").write_text("")
    assert [special_kind(path) for path in (tmp_path, tmp_path / "file", tmp_path / "gone")] == ["", "", ""]
    assert special_kind(Path("/dev/null")) == "a device"
    with pytest.raises(LogError, match="is a pipe; a file was expected"):
        require_regular(tmp_path / "pipe", LogError)


def test_links_in_a_loop_are_odd(tmp_path: Path) -> None:
    (tmp_path / "a").symlink_to(tmp_path / "b")
    (tmp_path / "b").symlink_to(tmp_path / "a")
    assert special_kind(tmp_path / "a") == "a link in a loop"


def test_what_is_not_there_is_refused(tmp_path: Path) -> None:
    require_exists(tmp_path)
    with pytest.raises(ConfigError, match="no such file or folder"):
        require_exists(tmp_path / "gone")
    (tmp_path / "rosub_tank").mkdir()
    with pytest.raises(ConfigError, match=r"Nearest: 'rosub_tank'\. Give a log or the folder"):
        require_exists(tmp_path / "rosub_tnk")
    with pytest.raises(ConfigError, match=r"cannot be read \("):
        require_exists(tmp_path / ("x" * 5000))


def test_a_folder_is_searched_but_for_what_is_hidden_or_leads_up(tmp_path: Path) -> None:
    inside = tmp_path / "logs" / "deep"
    inside.mkdir(parents=True)
    for name in ("b.csv", "a.csv", ".hidden"):
        (inside / name).write_text("")
    (inside / "up").symlink_to(tmp_path)
    os.mkfifo(inside / "pipe")
    found = list_files(tmp_path / "logs", lambda _: None)
    assert [path.name for path in found.files] == ["a.csv", "b.csv"]
    assert {path.name: what for path, what in found.special_files.items()} == {
        "pipe": "a pipe",
        "up": "a link to a folder that it lies in",
    }
    assert list_files(inside / "a.csv", lambda _: None).files == (inside / "a.csv",)


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
        ("[a]\nb = 0,43", "at line 2, .*: b = 0,43 .a decimal number needs a point"),
        ("a = 1\nb = curve.csv", "at line 2, .*: b = curve.csv .text needs quotes"),
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
