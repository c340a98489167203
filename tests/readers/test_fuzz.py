"""Whatever the bytes are: a Trial and a guess or one RovidError, in bounded time; never a traceback or a warning."""

from __future__ import annotations

import contextlib
import itertools
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rovid.core.errors import RovidError
from rovid.preflight.config_writer import config_text
from rovid.preflight.log_survey import survey
from rovid.readers import read_campaign, read_log
from rovid.trial.config import Config
from tests.readers.logs import COMPRESSIONS, ENCODERS, campaign, csv_text, dive, mcap_bytes, standard, toml

# Each example may take ten seconds; real ones take milliseconds, even on a loaded machine a hang or an explosion shows.
FUZZ = settings(
    max_examples=60,
    deadline=10_000,
    derandomize=True,  # the same examples each time: a test that fails at random helps nobody
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
SIGNALS = (
    'yaw_rate = { csv = "yaw_rate", mcap = "/imu.angular_velocity.z" }',
    'roll = { csv = "roll", mcap = "/imu" }',
)
CSV = csv_text(
    {
        name: np.asarray(values)[:60]
        for name, values in standard(yaw_rate=np.full(400, 0.14), roll=np.full(400, 0.5)).items()
    }
).encode()
RECORDINGS = [
    mcap_bytes(
        dive(60), encoding=encoding, compression=packing, chunked=chunked, chunk_size=1500, indexed=full, summary=full
    )
    for encoding, packing, chunked, full in itertools.product(ENCODERS, COMPRESSIONS, (True, False), (True, False))
    if chunked or packing == "none"
]


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Config:
    return campaign(tmp_path_factory.mktemp("fuzz"))


def survive(path: Path, data: bytes, config: Config) -> None:
    path.write_bytes(data)
    with contextlib.suppress(RovidError):
        trial = read_log(path, config)
        assert np.all(np.diff(trial.time) > 0)
        assert np.isfinite(trial.commands).all()
        assert trial.measured.sum() >= 10
    with contextlib.suppress(RovidError):
        config_text(survey([path]))


Edits = list[tuple[str, float, bytes]]
EDITS = st.lists(
    st.tuples(
        st.sampled_from(["put", "insert", "cut", "repeat", "flip"]),
        st.floats(0.0, 1.0),
        st.one_of(
            st.binary(min_size=1, max_size=16),
            st.sampled_from([b"\0" * 8, b"\xff" * 8, b'"', b"\n", b",", b";", b"nan", b"1e999", b"-", b"\r", b"#"]),
        ),
    ),
    min_size=1,
    max_size=4,
)


def edited(data: bytes, edits: Edits) -> bytes:
    for how, share, part in edits:
        at = int(share * len(data))
        if how == "put":
            data = data[:at] + part + data[at + len(part) :]
        elif how == "insert":
            data = data[:at] + part + data[at:]
        elif how == "cut":
            data = data[:at] + data[at + 7 * len(part) :]
        elif how == "repeat":
            data = data[:at] + data[at : at + 40] * 3 + data[at + 40 :]
        else:
            data = data[:at] + bytes(byte ^ part[0] for byte in data[at : at + 1]) + data[at + 1 :]
    return data


@FUZZ
@given(data=st.binary(max_size=3000))
def test_random_bytes_as_csv(data: bytes, config: Config) -> None:
    survive(config.path.parent / "a.csv", data, config)


@FUZZ
@given(data=st.binary(max_size=3000))
def test_random_bytes_as_mcap(data: bytes, config: Config) -> None:
    survive(config.path.parent / "a.mcap", b"\x89MCAP0\r\n" + data, config)


@FUZZ
@given(
    rows=st.lists(
        st.lists(
            st.one_of(
                st.floats().map(repr),
                st.integers(-(2**70), 2**70).map(str),
                st.text(max_size=6),
                st.sampled_from(["", "nan", "2026-01-07", "2026-01-07T12:00:00Z", "0001-01-01", "9999-12-31", "1,5"]),
            ),
            min_size=1,
            max_size=5,
        ),
        min_size=1,
        max_size=30,
    ),
    separator=st.sampled_from([",", ";", "\t"]),
)
def test_random_cells(rows: list[list[str]], separator: str, config: Config) -> None:
    text = separator.join(["time_s", "heading_deg", "fore_V"]) + "\n"
    text += "\n".join(separator.join(row) for row in rows) + "\n"
    survive(config.path.parent / "b.csv", text.encode("utf-8", errors="replace"), config)


@FUZZ
@given(edits=EDITS)
def test_edited_csv(edits: Edits, config: Config) -> None:
    survive(config.path.parent / "c.csv", edited(CSV, edits), config)


@FUZZ
@given(
    values=st.lists(
        st.tuples(
            st.one_of(st.floats(allow_nan=True), st.floats(0, 100)),
            st.one_of(st.floats(allow_nan=True), st.floats(-720, 720)),
            st.floats(-5, 5),
            st.floats(allow_nan=True),
            st.floats(-180, 180),
        ),
        min_size=10,
        max_size=80,
    ),
    ordered=st.booleans(),
)
def test_any_numbers(values: list[tuple[float, ...]], ordered: bool, config: Config) -> None:
    """Numbers of any size, in any order, with a gyro and a roll angle beside them."""
    rows = sorted(values) if ordered else values
    full = campaign(config.path.parent / "numbers", toml(*SIGNALS))
    columns = dict(zip(("time_s", "heading_deg", "fore_V", "yaw_rate", "roll"), np.array(rows).T, strict=True))
    survive(full.path.parent / "d.csv", csv_text(columns, form=".17g").encode(), full)


@settings(FUZZ, max_examples=120)
@given(number=st.integers(0, len(RECORDINGS) - 1), edits=EDITS)
def test_edited_mcap(number: int, edits: Edits, config: Config) -> None:
    survive(config.path.parent / "e.mcap", edited(RECORDINGS[number], edits), config)


@settings(FUZZ, max_examples=50)
@given(
    number=st.integers(0, len(RECORDINGS) - 1),
    length=st.floats(0, 1),
    tail=st.sampled_from([b"", bytes(4000), b"\x05" * 500]),
)
def test_cut_mcap(number: int, length: float, tail: bytes, config: Config) -> None:
    data = RECORDINGS[number]
    survive(config.path.parent / "f.mcap", data[: int(length * len(data))] + tail, config)


@settings(FUZZ, max_examples=40)
@given(edits=EDITS)
def test_edited_folders(edits: Edits, config: Config) -> None:
    folder = config.path.parent / "folder"
    full = campaign(folder)
    (folder / "a.csv").write_bytes(CSV)
    (folder / "b.csv").write_bytes(edited(CSV, edits))
    with contextlib.suppress(RovidError):
        read_campaign([folder], full)
