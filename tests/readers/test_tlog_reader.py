"""MAVLink telemetry: both versions, several systems and sensors, checksums, and what is wrong with logs."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from rovid.core.errors import LogError
from rovid.readers import read_log
from rovid.readers.tlog_reader import TelemetryLog
from rovid.trial.trial import Trial
from tests.readers.logs import campaign, kinds, toml
from tests.readers.recordings import HEADING, TIME, Sent, attitude_sent, servos_sent, tlog

COMMAND = '{ tlog = "SERVO_OUTPUT_RAW.servo4_raw" }'
PAIRS = list(zip(TIME.tolist(), HEADING.tolist(), strict=True))
ROWS: list[Sent] = [servos_sent(0.0, 1600), *(attitude_sent(t, h) for t, h in PAIRS)]


def read(folder: Path, data: bytes, command: str = COMMAND) -> Trial:
    config = campaign(folder, toml(heading="", time="", command=command))
    (folder / "a.tlog").write_bytes(data)
    return read_log(folder / "a.tlog", config)


@pytest.mark.parametrize("version", [1, 2])
def test_both_versions(version: int, tmp_path: Path) -> None:
    trial = read(tmp_path, tlog(ROWS, version=version))
    np.testing.assert_allclose(np.rad2deg(trial.position), HEADING, atol=1e-4)
    assert set(trial.commands[:, 0]) == {1600.0}


def test_every_number_is_pymavlinks(tmp_path: Path) -> None:
    battery = mavlink.MAVLink_battery_status_message(
        0, 1, 2, 2950, [16000, 1, *[65535] * 8], -1, 100, 2**31 - 1, -1, time_remaining=7, voltages_ext=[1, 2, 3, 0]
    )
    text = mavlink.MAVLink_statustext_message(6, b"hello")
    (tmp_path / "a.tlog").write_bytes(tlog([*ROWS, (1.0, 1, battery), (1.0, 1, text)]))
    log = TelemetryLog(tmp_path / "a.tlog", {"BATTERY_STATUS", "STATUSTEXT"})
    columns = log.columns("BATTERY_STATUS")
    for field, value in battery.to_dict().items():
        if isinstance(value, list):
            assert [columns[f"{field}[{at}]"][0] for at in range(len(value))] == value
        elif field != "mavpackettype":
            assert columns[field][0] == value
    assert log.columns("STATUSTEXT")["text"][0] == b"hello"


def test_a_ground_station_is_no_vehicle(tmp_path: Path) -> None:
    rows = [ROWS[0], *(servos_sent(t, 1000, system=255) for t in TIME[:50].tolist()), *ROWS[1:]]
    trial = read(tmp_path, tlog(rows))
    assert set(trial.commands[:, 0]) == {1600.0}
    assert trial.remarks == ()


def test_two_vehicles_are_said(tmp_path: Path) -> None:
    other = [attitude_sent(t, -h, system=2) for t, h in PAIRS[:100]]
    trial = read(tmp_path, tlog(sorted([*ROWS, *other], key=lambda row: row[0])))
    np.testing.assert_allclose(np.rad2deg(trial.position), HEADING, atol=1e-4)
    assert "Systems [1, 2] send an attitude; 1, which does so most often, was taken" in trial.remarks[0].text


def test_ports_are_told_apart(tmp_path: Path) -> None:
    rows = [ROWS[0], servos_sent(0.0, 1234, port=1), *ROWS[1:]]
    trial = read(tmp_path, tlog(rows))
    assert set(trial.commands[:, 0]) == {1600.0}
    assert "SERVO_OUTPUT_RAW[1] is another" in trial.remarks[0].text
    other = read(tmp_path, tlog(rows), '{ tlog = "SERVO_OUTPUT_RAW[1].servo4_raw" }')
    assert set(other.commands[:, 0]) == {1234.0}


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("SERVO_OUTPUT_RAW.servo44_raw", "has no field 'servo44_raw'.* Nearest: 'servo4_raw'"),
        ("SERVO_OUTPUTS.servo4_raw", "no message 'SERVO_OUTPUTS'. Nearest: 'SERVO_OUTPUT_RAW'"),
        ("RC_CHANNELS.chan1_raw", "no message 'RC_CHANNELS'"),
    ],
)
def test_wrong_names(source: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(LogError, match=words):
        read(tmp_path, tlog(ROWS), f'{{ tlog = "{source}" }}')


def test_a_wrong_checksum_is_counted(tmp_path: Path) -> None:
    data = bytearray(tlog(ROWS))
    data[len(tlog(ROWS[:50])) + 20] ^= 0x10  # inside the payload of one attitude
    trial = read(tmp_path, bytes(data))
    assert kinds(trial) == {"truncated": 1}
    assert trial.measured.sum() == len(TIME) - 1


def test_a_hole_is_stepped_over(tmp_path: Path) -> None:
    data = tlog(ROWS)
    trial = read(tmp_path, data[:3000] + bytes(range(256)) * 2 + data[3512:])
    assert trial.duration == pytest.approx(TIME[-1])
    assert 200 < kinds(trial)["truncated"] < 700
    assert trial.measured.sum() > len(TIME) - 20


def test_without_pymavlink_the_message_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pymavlink.dialects.v20.ardupilotmega", None)
    with pytest.raises(
        LogError, match=r"needs the package pymavlink. Install it with `pip install 'rovid\[ardupilot\]'`"
    ):
        read(tmp_path, tlog(ROWS))
