"""Logs in another format, and MCAP recordings of columns."""

from __future__ import annotations

import json
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from jsonschema import Draft202012Validator
from mcap.reader import make_reader

from rovid.core.formatting import field_names
from rovid.readers import convert, read_log
from rovid.trial.axis import axis_named
from rovid.trial.config import Config, load_config
from rovid.trial.trial import Trial
from tests.conftest import SAMPLES, Rovid
from tests.hostile import NAMES
from tests.readers.logs import campaign, csv_text, dive, mcap_bytes, standard, toml
from tests.whole.test_bad_input import assert_one_message

TARGETS = pytest.mark.parametrize("suffix", [".csv", ".mcap", ".parquet"])
LOGS = {
    "dataflash": ("bluerov2_dataflash/dive.BIN", "yaw"),
    "MCAP with several clocks": ("bluerov2_pier59/dive.mcap", "yaw"),
    "MCAP of ROS 2": ("rosub_tank/steps.mcap", "yaw"),
    "CSV": ("bluerov2_pier59/dive.csv", "yaw"),
    "surge": ("surge_tank/steps.csv", "surge"),
    "pitch": ("pitch_tank/steps.csv", "pitch"),
}


def again(folder: Path, original: Path, mapping: str, made: Path, axis: str) -> Trial:
    """``made`` read by the configuration ``original`` with the lines that the command printed."""
    said = tomllib.loads(mapping)
    document = tomllib.loads(original.read_text())
    thrusters = {one["name"]: one for one in document.get("thrusters", [])}
    for one in said.get("thrusters", []):
        thrusters[one["name"]].update(one)
    lines: list[str] = []
    for key, value in document.get("vehicle", {}).items():
        lines += ["[vehicle]"] * (not lines) + [f"{key} = {json.dumps(value)}"]
    for one in thrusters.values():
        command = one.pop("command")
        one["curve"] = str((original.parent / one["curve"]).resolve())
        lines += ["[[thrusters]]", *(f"{key} = {json.dumps(value)}" for key, value in one.items())]
        lines.append(f"command = {inline(command)}")
    lines += ["[signals]", *(f'"{key}" = {inline(value)}' for key, value in said["signals"].items())]
    (folder / "rovid.toml").write_text("\n".join(lines))
    return read_log(made, load_config(folder / "rovid.toml", axis_named(axis)))


def inline(table: Mapping[str, Any]) -> str:
    return "{ " + ", ".join(f"{key} = {json.dumps(value)}" for key, value in table.items()) + " }"


def assert_same(first: Trial, second: Trial) -> None:
    np.testing.assert_allclose(second.time, first.time, atol=2e-9)  # a recording counts in ns
    turns = np.nanmedian(np.rint((second.position - first.position) / (2.0 * np.pi)))
    shift = 2.0 * np.pi * turns if first.axis.name == "yaw" else 0.0
    np.testing.assert_allclose(second.position, first.position + shift, atol=1e-11)
    np.testing.assert_array_equal(second.commands, first.commands)
    for name in ("rate", "roll", "pitch"):
        one, other = getattr(first, name), getattr(second, name)
        assert (one is None) == (other is None), name
        if one is not None:
            np.testing.assert_allclose(other, one, rtol=1e-12, atol=1e-13)
    assert first.rate_only == second.rate_only
    assert set(first.extras) == set(second.extras)
    for name in first.extras:
        np.testing.assert_allclose(second.extras[name], first.extras[name], rtol=1e-12, atol=1e-13)


@TARGETS
@pytest.mark.parametrize("log", LOGS)
def test_round_trip(log: str, suffix: str, tmp_path: Path, rovid: Rovid) -> None:
    place, axis = LOGS[log]
    path, made = SAMPLES / place, tmp_path / f"made{suffix}"
    document = rovid("convert", path, "-o", made, "--axis", axis, "--json").document
    assert document["file"] == str(made)
    original = path.parent / "rovid.toml"
    first = read_log(path, load_config(original, axis_named(axis)))
    assert_same(first, again(tmp_path, original, document["configuration"], made, axis))


def converted(folder: Path, config: Config, log: Path, suffix: str, rovid: Rovid) -> tuple[Trial, Trial]:
    made = folder / "out" / f"made{suffix}"
    mapping = rovid("convert", log, "-o", made).out
    return read_log(log, config), again(made.parent, config.path, mapping, made, "yaw")


@TARGETS
def test_gaps_and_other_signals_survive(suffix: str, tmp_path: Path, rovid: Rovid) -> None:
    config = campaign(tmp_path, toml('"depth, m" = { csv = "z" }', 'yaw_rate = { csv = "r", unit = "deg/s" }'))
    heading = np.array(standard()["heading_deg"])
    heading[[20, 40, 41, 42]] = np.nan
    heading[200:300] = np.nan
    z = np.linspace(0.0, 5.0, 400)
    z[7] = np.nan
    (tmp_path / "a.csv").write_text(csv_text(standard(heading_deg=heading, z=z, r=np.full(400, 8.0))))
    assert_same(*converted(tmp_path, config, tmp_path / "a.csv", suffix, rovid))


@TARGETS
def test_a_logged_torque(suffix: str, tmp_path: Path, rovid: Rovid) -> None:
    lines = ["[signals]", 'time = "time_s"', 'heading = "heading_deg"', 'torque = { csv = "fore_V", unit = "kN m" }']
    config = campaign(tmp_path, "\n".join(lines))
    (tmp_path / "a.csv").write_text(csv_text(standard()))
    assert_same(*converted(tmp_path, config, tmp_path / "a.csv", suffix, rovid))


@TARGETS
def test_a_command_between_headings_keeps_its_instant(suffix: str, tmp_path: Path, rovid: Rovid) -> None:
    config = campaign(tmp_path)
    (tmp_path / "a.mcap").write_bytes(mcap_bytes(dive()))
    first, second = converted(tmp_path, config, tmp_path / "a.mcap", suffix, rovid)
    assert 3.017 in np.round(second.time, 6)
    assert_same(first, second)


def test_the_recording_is_as_its_schema_says(tmp_path: Path, rovid: Rovid) -> None:
    made = tmp_path / "made.mcap"
    assert rovid("convert", SAMPLES / "bluerov2_dataflash" / "dive.BIN", "-o", made).code == 0
    with made.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            Draft202012Validator(json.loads(schema.data)).validate(json.loads(message.data))


def test_notes_do_not_stand_among_the_lines(tmp_path: Path, rovid: Rovid) -> None:
    campaign(tmp_path)
    heading = np.array(standard()["heading_deg"])
    heading[20] = np.nan
    (tmp_path / "a.csv").write_text(csv_text(standard(heading_deg=heading)))
    done = rovid("convert", tmp_path / "a.csv", "-o", tmp_path / "b.csv")
    assert tomllib.loads(done.out)["signals"]["heading"] == {"csv": "heading_deg", "unit": "deg"}
    assert done.err == "Note: heading_deg (heading) is missing in 1 samples.\n"
    assert list(pd.read_csv(tmp_path / "b.csv").columns) == ["time_s", "heading_deg", "command_fore"]


def test_what_cannot_be_written_is_told_first(tmp_path: Path, rovid: Rovid, monkeypatch: pytest.MonkeyPatch) -> None:
    campaign(tmp_path)
    log = tmp_path / "a.csv"
    log.write_text(csv_text(standard()))
    assert_one_message(rovid("convert", log, "-o", "b.xlsx"), "-o b.xlsx", ".csv, .mcap, .parquet")
    assert_one_message(rovid("convert", log, "-o", log), "is the log itself")
    assert_one_message(rovid("convert", tmp_path, "-o", "b.csv"), "is a folder")
    assert_one_message(rovid("convert", tmp_path / "none.csv", "-o", log), "no such file")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert_one_message(rovid("convert", log, "-o", "b.parquet"), "pip install 'rovid[parquet]'")


def test_a_recording_keeps_the_commands_of_thrusters_with_names_alike() -> None:
    fields = dict(zip(field_names(NAMES), np.ones((len(NAMES), 3)), strict=True))
    assert len(fields) == len(NAMES)
    assert convert.mcap_bytes(
        [convert.OutputTopic(name="/commands", time=np.arange(3.0), fields=fields, units=dict.fromkeys(fields, ""))]
    )
