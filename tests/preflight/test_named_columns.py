"""Survey of logs whose columns only the user knows, of arrays, and of a rate without a heading."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from scipy.signal import lfilter

from rovid.preflight.config_writer import write_config
from rovid.preflight.log_survey import SurveyOptions, survey
from rovid.readers import read_log
from rovid.trial.config import load_config
from tests.conftest import Rovid
from tests.readers.logs import csv_text
from tests.readers.recordings import HEADING, TIME, Said, bag


def arrays() -> list[Said]:
    """A planar pose and commands in an array, as of Float32MultiArray."""
    layout = get_typestore(Stores.ROS2_HUMBLE).types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    rows: list[Said] = []
    for at, heading in zip(TIME.tolist(), HEADING.tolist(), strict=True):
        angle = float(np.radians((heading + 180.0) % 360.0 - 180.0))
        rows.append(("/pose", "geometry_msgs/msg/Pose2D", at, {"x": 1.0, "y": 2.0 + at, "theta": angle}))
        drives = np.array([np.sin(at), 0.0, np.cos(at)], dtype=np.float32)
        rows.append(("/cmd", "std_msgs/msg/Float32MultiArray", at, {"layout": layout, "data": drives}))
    return rows


@pytest.mark.parametrize("command", ["", "/cmd.data.0,/cmd.data[2]"])
@pytest.mark.parametrize("heading", ["", "/pose.theta"])
def test_array_elements_and_planar_poses(heading: str, command: str, tmp_path: Path) -> None:
    (tmp_path / "a.db3").write_bytes(bag(arrays(), ros=2))
    commands = tuple(filter(None, command.split(",")))
    found = survey([tmp_path], SurveyOptions(headings=(heading,) if heading else (), commands=commands))
    mapping = found.mappings["bag"]
    assert mapping.measured.source == "/pose.theta"
    assert mapping.measured.unit == "rad"
    assert [one.source for one in mapping.commands] == ["/cmd.data[0]", "/cmd.data[2]"]
    assert "pitch" not in mapping.signals
    write_config(found, [tmp_path], force=True)
    trial = read_log(tmp_path / "a.db3", load_config(tmp_path / "rovid.toml"))
    np.testing.assert_allclose(np.rad2deg(trial.position[trial.measured]), HEADING, atol=1e-4)
    np.testing.assert_allclose(trial.commands[:, 0], np.sin(TIME), atol=1e-6)


def test_two_files_are_joined_by_columns_that_only_the_user_knows(tmp_path: Path) -> None:
    time = np.arange(0.0, 120.0, 0.1)
    for number in (1, 2):
        drive = np.random.default_rng(number).choice([-1.0, 0.0, 1.0], 40).repeat(30)
        rate = lfilter([0.05], [1.0, -0.95], drive)
        noise = np.random.default_rng(number + 9).normal(0.0, 0.02, len(time))
        turned = {"time_s": time, "q1": (np.cumsum(rate) + noise) % 360.0, "q2": np.zeros(len(time))}
        (tmp_path / f"run{number}_a.csv").write_text(csv_text(turned))
        (tmp_path / f"run{number}_b.csv").write_text(csv_text({"time_s": time, "w1": drive, "w2": -drive[::-1]}))
    found = survey([tmp_path], SurveyOptions(headings=("Q1",), commands=("w1", "w2")))
    assert found.join is not None
    assert set(found.join.parts) == {"a", "b"}
    assert found.mappings["csv"].measured.source == "q1"
    assert [one.source for one in found.mappings["csv"].commands] == ["w1", "w2"]
    write_config(found, [tmp_path], force=True)
    config = load_config(tmp_path / "rovid.toml")
    assert read_log(tmp_path / "run1_a.csv", config).companion_files == (tmp_path / "run1_b.csv",)


def test_a_log_with_a_yaw_rate_and_no_heading(tmp_path: Path, rovid: Rovid) -> None:
    rate = 8.0 * np.sin(0.5 * TIME)
    text = csv_text({"time_s": TIME, "yaw_rate_dps": rate, "fore_cmd": np.sin(0.5 * TIME + 0.2)})
    (tmp_path / "a.csv").write_text(text)
    found = survey([tmp_path])
    assert list(found.mappings["csv"].signals) == ["yaw_rate"]
    assert rovid("init", tmp_path).code == 0
    trial = read_log(tmp_path / "a.csv", load_config(tmp_path / "rovid.toml"))
    assert trial.rate_only
