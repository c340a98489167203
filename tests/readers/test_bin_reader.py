"""ArduPilot's DataFlash: a real dive against pymavlink and against its MCAP, and what is wrong with logs."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from rovid.core.errors import ConfigError, LogError
from rovid.readers import READERS, bin_reader, read_campaign, read_log
from rovid.trial.config import Config, load_config
from rovid.trial.trial import Trial
from tests.conftest import SAMPLES, Rovid
from tests.readers.logs import campaign, csv_text, kinds, standard, toml
from tests.readers.recordings import OLD_MESSAGES, Row, dataflash

DATAFLASH = SAMPLES / "bluerov2_dataflash"
DIVE = DATAFLASH / "dive.BIN"
COMMAND = '{ csv = "fore_V", bin = "RCOU.C1" }'


@pytest.fixture(scope="module")
def config() -> Config:
    return load_config(DATAFLASH / "rovid.toml")


def small(extra: list[Row] | None = None) -> bytes:
    found: list[Row] = [("RCOU", (0, 1))]
    found += [("ATT", (1000 + 50_000 * k, (10.0 + 0.4 * k) % 360.0)) for k in range(200)]
    return dataflash(found + (extra or []))


def read_small(folder: Path, data: bytes, *signals: str) -> Trial:
    config = campaign(folder, toml(*signals, heading="", time="", command=COMMAND))
    (folder / "a.bin").write_bytes(data)
    return read_log(folder / "a.bin", config)


@pytest.mark.parametrize("labels", [b"TimeUS,", b",Yaw"])
def test_a_field_without_a_name_is_no_description(labels: bytes, tmp_path: Path) -> None:
    data = small().replace(b"TimeUS,Yaw", labels.ljust(10, b"\0"), 1)
    with pytest.raises(LogError, match=r"holds no message 'ATT'"):
        read_small(tmp_path, data)
    assert READERS[".bin"].sources(tmp_path / "a.bin").sources == ("RCOU.C1",)


def test_the_dive_needs_no_signals(config: Config) -> None:
    trial = read_log(DIVE, config)
    other = read_log(SAMPLES / "bluerov2_pier59" / "dive.mcap", load_config(SAMPLES / "bluerov2_pier59" / "rovid.toml"))
    assert trial.duration == pytest.approx(other.duration, abs=1e-6)
    # The recordings differ by the ninth digit of a 32-bit float.
    np.testing.assert_allclose(trial.position[trial.measured], other.position[other.measured], atol=1e-8)
    np.testing.assert_array_equal(trial.commands, other.commands)
    assert trial.roll is not None
    assert other.roll is not None
    np.testing.assert_allclose(trial.roll, other.roll, atol=1e-7, equal_nan=True)


def test_every_number_is_pymavlinks() -> None:
    reader = pytest.importorskip("pymavlink.DFReader").DFReader_binary(str(DIVE))
    messages = {name: [] for name in ("ATT", "RCOU", "BAT", "RATE", "PARM")}  # type: ignore[var-annotated]
    while (message := reader.recv_match(type=list(messages))) is not None:
        messages[message.get_type()].append(message.to_dict())
    reader.data_map.close()
    reader.filehandle.close()
    with DIVE.open("rb") as file:
        ours = bin_reader.DataFlashLog(DIVE, file.read(), set(messages))
    for name, theirs in messages.items():
        columns = ours.columns(name)
        for label in columns:
            expected = [one[label] for one in theirs]
            if not isinstance(expected[0], str):
                np.testing.assert_array_equal(columns[label], expected)


def test_a_first_configuration_knows_thrusters_and_signs(tmp_path: Path, rovid: Rovid) -> None:
    shutil.copy(DIVE, tmp_path)
    commands = {one["source"]: one["turns"] for one in rovid("init", tmp_path, "--json").document["commands"]["bin"]}
    # Thrusters 1 to 4 turn this vehicle, with these signs.
    assert [commands[f"RCOU.C{k}"] for k in range(1, 5)] == [-1, 1, -1, 1]
    assert rovid("check", tmp_path).code == 0


def test_a_map_of_signals_goes_before(tmp_path: Path) -> None:
    trial = read_small(tmp_path, small(), 'heading = { bin = "ATT.Yaw", sign = -1 }')
    assert np.rad2deg(trial.position[5] - trial.position[4]) == pytest.approx(-0.4, abs=1e-4)
    assert trial.roll is None


def test_sensors_of_one_kind_are_told_apart(tmp_path: Path) -> None:
    batteries: list[Row] = [
        ("BAT", (50_000 * k, instance, volt)) for k in range(199) for instance, volt in ((0, 1600), (1, 1200))
    ]
    first = read_small(tmp_path, small(batteries), 'supply = { bin = "BAT.Volt" }')
    assert set(first.extras["supply"][2:]) == {16.0}
    assert "BAT[1] is another" in first.remarks[0].text
    second = read_small(tmp_path, small(batteries), 'supply = { bin = "BAT[1].Volt" }')
    assert set(second.extras["supply"][2:]) == {12.0}
    assert second.remarks == ()
    with pytest.raises(LogError, match=r"no message 'BAT\[2\]'. Nearest: 'BAT\[1\]'"):
        read_small(tmp_path, small(batteries), 'supply = { bin = "BAT[2].Volt" }')


@pytest.mark.parametrize(
    ("signal", "words"),
    [
        ('heading = { bin = "AT.Yaw" }', "no message 'AT'. Nearest: .*'ATT'"),
        ('heading = { bin = "ATT.Yew" }', r"ATT has no field 'Yew' \(heading\). Nearest: 'Yaw'"),
        ('heading = { bin = "ATT" }', "ATT has no field ''"),
        ('supply = { bin = "BAT.Volt" }', "no message 'BAT'"),
    ],
)
def test_wrong_names(signal: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(LogError, match=words):
        read_small(tmp_path, small(), signal)


def test_commands_have_to_be_named(tmp_path: Path) -> None:
    config = campaign(tmp_path, toml(heading='heading = { csv = "h", bin = "ATT.Yaw" }'))
    (tmp_path / "a.BIN").write_bytes(small())
    with pytest.raises(ConfigError, match=r"command.fore names no bin source, but a.BIN is a bin log. Add bin = "):
        read_log(tmp_path / "a.BIN", config)


def test_files_of_a_format_that_is_not_mapped_are_left_out_of_folders(tmp_path: Path) -> None:
    config = campaign(tmp_path)
    (tmp_path / "firmware.bin").write_bytes(bytes(100))
    with pytest.raises(LogError, match=r"rovid\.toml maps nothing for bin logs"):
        read_campaign([tmp_path], config)
    (tmp_path / "hold.csv").write_text(csv_text(standard()))
    found = read_campaign([tmp_path], config)
    assert [trial.name for trial in found.trials] == ["hold.csv"]
    assert "firmware.bin was left out" in found.remarks[0].text


@pytest.mark.parametrize("share", [0.999, 0.7, 0.31])
def test_a_cut_log_is_read_up_to_its_last_message(share: float, config: Config, tmp_path: Path) -> None:
    data = DIVE.read_bytes()
    (tmp_path / "cut.BIN").write_bytes(data[: int(share * len(data))])
    trial = read_log(tmp_path / "cut.BIN", config)
    assert trial.duration == pytest.approx(199.8 * share, abs=10.0)
    assert kinds(trial).get("truncated", 0) < 100


def test_a_hole_is_stepped_over(config: Config, tmp_path: Path) -> None:
    data = DIVE.read_bytes()
    (tmp_path / "holed.BIN").write_bytes(data[:200_000] + bytes(3000) + data[203_000:])
    trial = read_log(tmp_path / "holed.BIN", config)
    assert 2900 <= kinds(trial)["truncated"] < 3200
    assert trial.duration == pytest.approx(199.8, abs=0.2)


@pytest.mark.parametrize("time", [2**63, 2**64 - 1])
def test_a_damaged_time_is_left_out(time: int, tmp_path: Path) -> None:
    trial = read_small(tmp_path, small([("ATT", (time, 1.0))]))
    assert trial.duration == pytest.approx(199 * 0.05, abs=0.1)
    assert trial.faults or trial.remarks


@pytest.mark.parametrize("command", ["RCOU.C2", "RCOU.Ch2"])
def test_logs_before_2015_have_ms_and_other_names(command: str, tmp_path: Path) -> None:
    rows: list[Row] = [("RCOU", (0, 1500, 1600)), ("RCOU", (3020, 1500, 1700))]
    rows += [("ATT", (50 * k, (10.0 + 0.4 * k) % 360.0)) for k in range(200)]
    data = dataflash(sorted(rows, key=lambda row: row[1][0]), OLD_MESSAGES)  # type: ignore[arg-type, return-value]
    config = campaign(tmp_path, toml(heading="", time="", command=f'{{ bin = "{command}" }}'))
    (tmp_path / "a.bin").write_bytes(data)
    trial = read_log(tmp_path / "a.bin", config)
    np.testing.assert_allclose(trial.time[trial.measured], 0.05 * np.arange(200), atol=1e-9)
    np.testing.assert_array_equal(trial.commands[np.searchsorted(trial.time, [3.0, 3.02]), 0], [1600.0, 1700.0])
    assert bin_reader.sources(tmp_path / "a.bin").sources == ("ATT.Yaw", "RCOU.C1", "RCOU.C2")
