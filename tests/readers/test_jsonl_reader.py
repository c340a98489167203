"""JSON lines: keys, times, orientations, and damaged lines."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rovid.core.errors import LogError
from rovid.preflight.log_reading import read_columns
from rovid.preflight.log_survey import survey
from rovid.readers import jsonl_reader, read_log
from rovid.trial.trial import Trial
from tests.readers.logs import EPOCH, campaign, kinds, toml
from tests.readers.recordings import HEADING, TIME, iso, json_lines

Row = dict[str, Any]


def rows(make: Callable[[float, float], Row]) -> bytes:
    return json_lines({**make(t, h), "u": [1.0, 2.0]} for t, h in zip(TIME.tolist(), HEADING.tolist(), strict=True))


def read(folder: Path, data: bytes, *, time: str = "t", heading: str = "heading", command: str = "u[1]") -> Trial:
    form = f'heading = {{ jsonl = "{heading}", unit = "deg" }}'
    config = campaign(
        folder, toml(time=f'time = {{ jsonl = "{time}" }}', heading=form, command=f'{{ csv = "{command}" }}')
    )
    (folder / "a.jsonl").write_bytes(data)
    return read_log(folder / "a.jsonl", config)


def assert_run(trial: Trial) -> None:
    np.testing.assert_allclose(trial.time[trial.measured], TIME, atol=1e-6)
    np.testing.assert_allclose(np.rad2deg(trial.position[trial.measured]), HEADING, atol=1e-6)
    assert np.all(trial.commands == 2.0)


def stamp(t: float) -> Row:
    ns = EPOCH + round(t * 1e9)
    return {"secs": ns // 10**9, "nsecs": ns % 10**9}


CLOCKS: dict[str, tuple[str, Callable[[float], Row]]] = {
    "s": ("t", lambda t: {"t": t}),
    "ns": ("t", lambda t: {"t": EPOCH + round(t * 1e9)}),
    "ISO 8601": ("stamp", lambda t: {"stamp": iso(t)}),
    "nested": ("head.stamp_ms", lambda t: {"head": {"stamp_ms": 1e3 * t}}),
    "a key with a dot": ("head.t", lambda t: {"head.t": t}),
    "a stamp of two numbers": ("header.stamp", lambda t: {"header": {"stamp": stamp(t)}}),
    "seconds of a stamp": ("header.stamp.secs", lambda t: {"header": {"stamp": stamp(t)}}),
    "two keys": ("secs + nsecs", stamp),
}


@pytest.mark.parametrize("clock", CLOCKS)
def test_clocks(clock: str, tmp_path: Path) -> None:
    source, make = CLOCKS[clock]
    trial = read(tmp_path, rows(lambda t, h: {**make(t), "heading": h % 360.0}), time=source)
    assert_run(trial)
    assert trial.remarks == ()
    guessed = jsonl_reader.sources(tmp_path / "a.jsonl")
    assert guessed.clock.partition(" + ")[0].startswith(source.partition(" + ")[0])
    assert guessed.sources == ("heading", "u[0]", "u[1]")


def test_orientations(tmp_path: Path) -> None:
    def make(t: float, h: float) -> Row:
        z = np.deg2rad(h) / 2.0
        return {"t": t, "pose": {"orientation": {"x": 0.0, "y": 0.0, "z": np.sin(z), "w": np.cos(z)}}}

    assert_run(read(tmp_path, rows(make), heading="pose.orientation"))
    assert survey([tmp_path / "a.jsonl"]).mappings["jsonl"].signals["heading"].source == "pose.orientation"


def test_lines_that_are_no_objects_are_counted(tmp_path: Path) -> None:
    lines = rows(lambda t, h: {"t": t, "heading": h % 360.0}).splitlines(keepends=True)
    lines[7:7] = [b"\n", b"[1]\n", b"not json\n"]
    trial = read(tmp_path, b"".join(lines) + b'{"t": 15.0, "hea')
    assert_run(trial)
    assert kinds(trial) == {"truncated": 3}
    assert "3 lines are no JSON objects, first line 9" in trial.remarks[0].text


def test_objects_of_several_topics(tmp_path: Path) -> None:
    pairs = zip(TIME.tolist(), HEADING.tolist(), strict=True)
    lines = [{"topic": "thrust", "t": -0.001, "u": [0.0, 2.0]}]
    lines += [{"topic": "ins", "t": t, "heading": h % 360.0} for t, h in pairs]
    assert_run(read(tmp_path, json_lines(lines)))


def test_a_command_that_is_left_out_where_it_is_zero(tmp_path: Path) -> None:
    """The command begins after the objects from which the contents are first listed."""
    time, command = 0.1 * np.arange(600), np.where(np.arange(600) % 500 < 400, 0.0, 30.0)
    lines = [
        {"t": t, "heading": t, "motors": {"aft": 5.0} | ({"port_cmd": u} if u else {})}
        for t, u in zip(time.tolist(), command.tolist(), strict=True)
    ]
    (tmp_path / "a.jsonl").write_bytes(json_lines(lines))
    _, columns, _ = read_columns(tmp_path / "a.jsonl")
    np.testing.assert_array_equal(columns["motors.port_cmd"].values, command)


@pytest.mark.parametrize(
    ("data", "heading", "words"),
    [
        (b"", "heading", "is not JSON, one object a line: it is empty"),
        (b"a,b\n1,2\n", "heading", "is not JSON, one object a line"),
        (rows(lambda t, h: {"t": t, "heading": h}), "hading", "never holds 'hading' .* Nearest: 'heading'"),
        (rows(lambda t, h: {"t": t, "heading": "north"}), "heading", "heading .* is 'north'; a number"),
        (rows(lambda t, h: {"t": "noon", "heading": h}), "heading", "a.jsonl:1: t is 'noon'; seconds"),
        (rows(lambda t, h: {"heading": h}), "heading", "holds no time"),
    ],
)
def test_what_it_cannot_give(data: bytes, heading: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(LogError, match=words):
        read(tmp_path, data, heading=heading)
