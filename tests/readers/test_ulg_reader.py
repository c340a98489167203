"""PX4's ULog: quaternions, instances, and what is wrong with logs."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from rovid.core.errors import LogError
from rovid.preflight.log_survey import survey
from rovid.readers import read_log
from rovid.trial.trial import Trial
from tests.readers.logs import campaign, kinds, toml
from tests.readers.recordings import HEADING, TIME, Row, attitude, ulog

COMMAND = '{ ulg = "actuator_motors.control[0]" }'
ROWS: list[Row] = [("actuator_motors", (0, 1.0, 2.0)), ("actuator_motors#1", (0, 3.0, 4.0))]
ROWS += [attitude(1e6 * t, h, 5.0) for t, h in zip(TIME, HEADING, strict=True)]


def read(folder: Path, *signals: str, command: str = COMMAND, data: bytes | None = None) -> Trial:
    config = campaign(folder, toml(*signals, heading="", time="", command=command))
    (folder / "a.ulg").write_bytes(ulog(ROWS) if data is None else data)
    return read_log(folder / "a.ulg", config)


def test_a_first_stamp_beyond_every_clock_does_no_harm(tmp_path: Path) -> None:
    last = 2**64 - 1
    rows = [("actuator_motors", (last, 1.0, 2.0)), attitude(last, 0.0), *ROWS]
    trial = read(tmp_path, data=ulog(rows))
    assert len(trial.time) >= len(TIME)
    assert survey([tmp_path / "a.ulg"]).unrecognised == ("command",)


def test_attitude_needs_no_signals(tmp_path: Path) -> None:
    trial = read(tmp_path)
    np.testing.assert_allclose(np.rad2deg(trial.position), HEADING, atol=1e-4)
    assert trial.roll is not None
    np.testing.assert_allclose(np.rad2deg(trial.roll), 5.0, atol=1e-4)
    assert trial.pitch == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("source", "value"),
    [
        ("actuator_motors.control[0]", 1.0),
        ("actuator_motors.control[1]", 2.0),
        ("actuator_motors#0.control[0]", 1.0),
        ("actuator_motors#1.control[1]", 4.0),
    ],
)
def test_arrays_and_instances(source: str, value: float, tmp_path: Path) -> None:
    trial = read(tmp_path, command=f'{{ ulg = "{source}" }}')
    assert set(trial.commands[:, 0]) == {value}


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("actuator_motor.control[0]", "no message 'actuator_motor'. Nearest: 'actuator_motors'"),
        ("actuator_motors#2.control[0]", "no message 'actuator_motors#2'. Nearest: 'actuator_motors"),
        ("actuator_motors.control", r"no field 'control' \(command.fore\). Nearest: 'control\[0\]', 'control\[1\]'"),
        ("actuator_motors", "no field ''"),
    ],
)
def test_wrong_names(source: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(LogError, match=words):
        read(tmp_path, command=f'{{ ulg = "{source}" }}')


def test_damage_is_said_and_not_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = ulog(ROWS)
    trial = read(tmp_path, data=data[:4000] + bytes(50) + data[4050:])
    assert kinds(trial)["truncated"] == 1
    assert capsys.readouterr().out == ""


def test_without_pyulog_the_message_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyulog.core", None)
    with pytest.raises(LogError, match=r"needs the package pyulog. Install it with `pip install 'rovid\[px4\]'`"):
        read(tmp_path)


def test_a_number_that_damage_made_a_signalling_nan_is_missing(tmp_path: Path) -> None:
    data = bytearray(ulog(ROWS))
    at = len(ulog(ROWS[:102])) - 16  # the quaternion of the last message
    data[at : at + 4] = b"\x01\x00\x80\x7f"
    # Of heading, roll and pitch each.
    assert kinds(read(tmp_path, data=bytes(data)))["missing"] == 3


def test_nan_stops_a_motor(tmp_path: Path) -> None:
    """And one that is never commanded is stopped throughout."""
    nan = float("nan")
    rows = [*ROWS, ("actuator_motors", (int(2.01e6), nan, nan)), ("actuator_motors", (int(4.01e6), 3.0, nan))]
    trial = read(tmp_path, data=ulog(sorted(rows, key=lambda row: row[1][0])))  # type: ignore[arg-type, return-value]
    at = np.searchsorted(trial.time, [1.0, 3.0, 5.0])
    np.testing.assert_array_equal(trial.commands[at, 0], [1.0, 0.0, 3.0])
    (fault,) = trial.faults
    assert (fault.fault, fault.size, fault.remedy) == ("sentinel_command", 1.0, "zero")
    assert "commands of fore are nan in 1 samples, first at 2.01 s. NaN means no command." in fault.text
