"""MATLAB files: vectors, matrices and structures of every version."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from rovid.core.errors import LogError
from rovid.preflight.log_survey import SurveyOptions, survey
from rovid.readers import mat_reader, read_log
from rovid.trial.trial import Trial
from tests.readers.logs import campaign, toml
from tests.readers.recordings import HEADING, TIME, mat, table

COLUMNS = {"t": TIME, "heading_deg": HEADING % 360.0, "fore_V": np.ones(len(TIME))}
MATRIX = np.column_stack([TIME, HEADING % 360.0, np.ones(len(TIME))])


def read(folder: Path, data: bytes, time: str = "t", heading: str = "heading_deg", command: str = "fore_V") -> Trial:
    form = f'heading = {{ mat = "{heading}", unit = "deg" }}'
    clock, drive = f'time = {{ mat = "{time}" }}', f'{{ mat = "{command}" }}'
    config = campaign(folder, toml(time=clock, heading=form, command=drive))
    (folder / "a.mat").write_bytes(data)
    return read_log(folder / "a.mat", config)


def assert_run(trial: Trial) -> None:
    np.testing.assert_allclose(trial.time, TIME, atol=1e-9)
    np.testing.assert_allclose(np.rad2deg(trial.position), HEADING, atol=1e-9)
    assert trial.remarks == ()


def test_version_4(tmp_path: Path) -> None:
    savemat(tmp_path / "b.mat", COLUMNS, format="4")
    assert_run(read(tmp_path, (tmp_path / "b.mat").read_bytes()))


def hdf5(path: Path, variables: dict[str, Any]) -> bytes:
    """Version 7.3, whose arrays are transposed, behind MATLAB's header."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in variables.items():
            file[name.replace(".", "/")] = np.atleast_2d(value)
        file["label"] = np.frombuffer(b"ab", dtype=np.uint8).astype(np.uint16)
        file["label"].attrs["MATLAB_class"] = np.bytes_("char")
    data = path.read_bytes()
    return b"MATLAB 7.3 MAT-file".ljust(124, b" ") + b"\x00\x02IM" + data[128:]


def test_version_7_3(tmp_path: Path) -> None:
    data = hdf5(tmp_path / "b.mat", {"log.t": TIME, "log.heading_deg": HEADING % 360.0, "m": MATRIX.T})
    assert_run(read(tmp_path, data, "log.t", "log.heading_deg", "m[2]"))
    assert mat_reader.sources(tmp_path / "a.mat").clock == "log.t"
    assert mat_reader.sources(tmp_path / "a.mat").sources == ("log.heading_deg", "m[0]", "m[1]", "m[2]")


def test_without_h5py_the_message_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data = hdf5(tmp_path / "b.mat", COLUMNS)
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(LogError, match=r"needs the package h5py. Install it with `pip install 'rovid\[mat73\]'`"):
        read(tmp_path, data)


@pytest.mark.parametrize("matrix", [MATRIX, MATRIX.T])
def test_columns_of_a_matrix(matrix: Any, tmp_path: Path) -> None:
    assert_run(read(tmp_path, mat({"log": matrix}), "log[0]", "log[1]", "log[2]"))
    options = SurveyOptions(headings=("log.1",), commands=("log[2]",))
    found = survey([tmp_path / "a.mat"], options)
    assert found.clock_sources == {"mat": "log[0]"}
    assert found.mappings["mat"].measured.source == "log[1]"


def test_structures_with_their_own_times(tmp_path: Path) -> None:
    late = np.array([0.0, 5.0, 10.0])
    thrust = {"time": late, "signals": {"values": np.ones((3, 2))}}
    data = mat({"ins": {"t": TIME, "psi": HEADING % 360.0}, "out": thrust})
    trial = read(tmp_path, data, "ins.t", "ins.psi", "out.signals.values[0]")
    assert_run(trial)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "is not a MATLAB file: it is empty"),
        (b"time,heading\n0,1\n" * 9, "is not a MATLAB file"),
        (mat(COLUMNS)[:900], "is a MATLAB file that is cut or damaged"),
        (mat({**COLUMNS, "heading_deg": HEADING[:99]}), "heading_deg has 99 elements, but the time t has 300"),
        (mat({"t": TIME, "hading_deg": HEADING}), "no variable 'heading_deg'.* Nearest: 'hading_deg'"),
        (mat({"heading_deg": HEADING, "fore_V": HEADING}), "no variable 't', which rovid.toml maps to time"),
    ],
)
def test_what_it_cannot_give(data: bytes, words: str, tmp_path: Path) -> None:
    with pytest.raises(LogError, match=words):
        read(tmp_path, data)


def test_sources_for_csv_apply(tmp_path: Path) -> None:
    (tmp_path / "a.mat").write_bytes(mat(table()))
    form = 'heading = { csv = "heading_deg" }'
    trial = read_log(tmp_path / "a.mat", campaign(tmp_path, toml(heading=form, command='{ csv = "fore_V" }')))
    assert_run(trial)
