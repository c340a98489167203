"""What may be opened, and what a folder holds."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from rovid.core.errors import ConfigError, LogError
from rovid.core.input_files import list_files, require_exists, require_regular, special_kind

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
