"""Every format: the same run in each, and what is no such log gets one message, in bounded time."""

from __future__ import annotations

import functools
import io
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from PIL import Image

from rovid.core.errors import LogError
from rovid.readers import READERS, read_log
from rovid.trial.config import Config, load_config
from tests.conftest import ROOT, Rovid
from tests.readers.logs import campaign, kinds, toml
from tests.readers.recordings import CHANGES, HEADING, RECORDINGS, TIME
from tests.readers.test_fuzz import EDITS, FUZZ, Edits, edited, survive
from tests.whole.test_bad_input import assert_one_message

FORMATS = pytest.mark.parametrize("suffix", RECORDINGS)


@functools.cache
def recording(suffix: str) -> bytes:
    return RECORDINGS[suffix].write()


def configured(suffix: str, folder: Path) -> Config:
    one = RECORDINGS[suffix]
    folder.mkdir(exist_ok=True)
    for other, text in one.beside.items():
        for name in "ae":
            (folder / f"{name}{other}").write_text(text)
    return campaign(folder, toml(heading=one.heading, command=one.command))


def test_every_format_is_here_and_on_the_page() -> None:
    assert {suffix.lower() for suffix in RECORDINGS} == set(READERS) - {".csv", ".mcap"}
    page = (ROOT / "docs" / "logs.md").read_text()
    assert all(f"| `{suffix}` |" in page for suffix in READERS)


@FORMATS
def test_the_run_is_the_same_in_each(suffix: str, tmp_path: Path) -> None:
    config = configured(suffix, tmp_path)
    (tmp_path / f"a{suffix}").write_bytes(recording(suffix))
    trial = read_log(tmp_path / f"a{suffix}", config)
    rows = np.searchsorted(trial.time, TIME + 1e-6) - 1  # a float holds seconds since 1970 to 0.2 us
    np.testing.assert_allclose(trial.time[rows], TIME, atol=1e-6)
    np.testing.assert_allclose(np.rad2deg(trial.position[rows]), HEADING, atol=RECORDINGS[suffix].tolerance)
    for at, value in CHANGES:  # a table knows of a change at its next row
        assert trial.commands[np.searchsorted(trial.time, at + 0.05) - 1, 0] == value
    assert trial.remarks == ()


def png() -> bytes:
    out = io.BytesIO()
    Image.new("RGB", (40, 30)).save(out, "PNG")
    return out.getvalue()


FOREIGN = {
    "empty": b"",
    "random": np.random.default_rng(3).bytes(5000),
    "a picture": png(),
    "text": b"time_s,heading_deg\n0,1\n",
    "zeros": bytes(5000),
}


@FORMATS
@pytest.mark.parametrize("content", FOREIGN)
def test_what_is_no_such_log_gets_one_message(suffix: str, content: str, tmp_path: Path, rovid: Rovid) -> None:
    config = configured(suffix, tmp_path / "logs")
    path = config.path.parent / f"a{suffix}"
    path.write_bytes(FOREIGN[content])
    done = rovid("fit-drag", path)
    assert done.code == 2
    assert done.err.count("\n") == 1, done.err
    assert done.err.startswith(f"rovid: {path}: {'is empty' if content == 'empty' else 'is not '}") or (
        content == "empty" and "is empty" in done.err
    ), done.err


@FORMATS
@pytest.mark.parametrize("share", [0.001, 0.02, 0.3, 0.5, 0.9, 0.999])
def test_a_cut_log_is_read_or_refused(suffix: str, share: float, tmp_path: Path) -> None:
    config = configured(suffix, tmp_path)
    data = recording(suffix)
    (tmp_path / f"a{suffix}").write_bytes(data[: int(share * len(data))])
    try:
        trial = read_log(tmp_path / f"a{suffix}", config)
    except LogError as error:
        assert "\n" not in str(error)  # noqa: PT017
    else:  # a format without an end may be cut between two messages, and one with an index behind all of them
        assert kinds(trial).get("truncated", 0) > 0 or trial.time[-1] < TIME[-1] or share > 0.99


@pytest.mark.parametrize("suffix", sorted(set(RECORDINGS) - {".nmea"}))
def test_a_first_configuration_is_guessed_from_each(suffix: str, tmp_path: Path, rovid: Rovid) -> None:
    (tmp_path / f"a{suffix}").write_bytes(recording(suffix))
    assert rovid("init", tmp_path).code == 0
    trial = read_log(tmp_path / f"a{suffix}", load_config(tmp_path / "rovid.toml"))
    assert np.rad2deg(trial.position[-1] - trial.position[0]) == pytest.approx(HEADING[-1] - HEADING[0], abs=1e-3)
    assert len(trial.commands.T) >= 1


@FORMATS
@pytest.mark.parametrize("content", FOREIGN)
def test_nothing_is_guessed_from_what_is_no_such_log(suffix: str, content: str, tmp_path: Path, rovid: Rovid) -> None:
    (tmp_path / f"a{suffix}").write_bytes(FOREIGN[content])
    assert_one_message(rovid("init", tmp_path), f"a{suffix}: is ")


@FORMATS
@settings(FUZZ, max_examples=60)
@given(edits=EDITS)
def test_edited_logs_do_no_harm(suffix: str, edits: Edits, tmp_path: Path) -> None:
    path = tmp_path / f"e{suffix}"
    survive(path, edited(recording(suffix), edits), configured(suffix, tmp_path))
