"""Survey of recordings that were exported to tables, one file a topic."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from rovid.core.array_types import FloatArray
from rovid.preflight.config_writer import write_config
from rovid.preflight.log_survey import survey
from rovid.readers import read_log
from rovid.trial.config import load_config
from tests.readers.logs import csv_text

TIME = np.arange(0.0, 120.0, 0.1)
START = 1_714_558_830.0


def turned(number: int) -> tuple[FloatArray, FloatArray]:
    """Command of a trial, and the heading in rad that follows it."""
    drive = np.random.default_rng(number).choice([-1.0, 0.0, 1.0], 40).repeat(30)
    return drive, np.cumsum(lfilter([0.005], [1.0, -0.95], drive))


def quaternion(heading: FloatArray, names: tuple[str, str, str, str]) -> dict[str, FloatArray]:
    """Columns x, y, z and w of a rotation about the vertical."""
    zero = np.zeros(len(heading))
    return dict(zip(names, (zero, zero, np.sin(heading / 2.0), np.cos(heading / 2.0)), strict=True))


def rostopic(folder: Path, number: int) -> Path:
    """``rostopic echo -p``: stamps in ns, and a column field.data for each thruster."""
    drive, heading = turned(number)
    stamps = [f"{stamp:.0f}" for stamp in 1e9 * (START + TIME)]
    names = ("field.orientation.x", "field.orientation.y", "field.orientation.z", "field.orientation.w")
    (folder / f"run{number}").mkdir()
    for name, columns in {
        "imu": quaternion(heading, names),
        "left_thrust_cmd": {"field.data": drive},
        "right_thrust_cmd": {"field.data": -drive},
    }.items():
        header, *rows = csv_text(columns).splitlines()
        lines = [f"%time,{header}", *(f"{stamp},{row}" for stamp, row in zip(stamps, rows, strict=True))]
        (folder / f"run{number}/{name}.csv").write_text("\n".join(lines) + "\n")
    return folder / f"run{number}/imu.csv"


def ulog(folder: Path, number: int) -> Path:
    """``ulog2csv``: us since the start of the autopilot, and w first in a quaternion."""
    drive, heading = turned(number)
    clock = {"timestamp": np.rint(1e6 * TIME) + 51_234_567.0}
    x, y, z, w = quaternion(heading, ("x", "y", "z", "w")).values()
    quaternions = {f"q[{at}]": part for at, part in enumerate((w, x, y, z))}
    motors = {"control[0]": drive, "control[1]": -drive}
    supply = {"voltage_v": 24.0 - 0.3 * np.abs(drive), "voltage_filtered_v": 24.0 - 0.3 * np.abs(drive)}
    for topic, columns in {"vehicle_attitude": quaternions, "actuator_motors": motors, "battery": supply}.items():
        (folder / f"log_{number}_{topic}_0.csv").write_text(csv_text(clock | columns))
    return folder / f"log_{number}_vehicle_attitude_0.csv"


def bagpy(folder: Path, number: int) -> Path:
    """``bagpy``: seconds in two columns in one file, and in one column in the other."""
    drive, heading = turned(number)
    (folder / f"day-{number}").mkdir()
    stamps = {"header.stamp.secs": START + np.floor(TIME), "header.stamp.nsecs": np.rint(1e9 * (TIME % 1.0))}
    names = ("orientation.x", "orientation.y", "orientation.z", "orientation.w")
    (folder / f"day-{number}/imu-data.csv").write_text(csv_text(stamps | quaternion(heading, names)))
    (folder / f"day-{number}/cmd_drive.csv").write_text(
        csv_text({"Time": START + TIME, "left": drive, "right": -drive})
    )
    return folder / f"day-{number}/imu-data.csv"


def sides(folder: Path, number: int) -> Path:
    """Files that differ in one word, with a column of the same name for each thruster."""
    drive, heading = turned(number)
    columns = {"imu": {"yaw_rad": heading}, "left": {"thrust": drive}, "right": {"thrust": -drive}}
    for name, column in columns.items():
        (folder / f"run{number}_{name}.csv").write_text(csv_text({"time_s": TIME} | column, form=".6f"))
    return folder / f"run{number}_imu.csv"


@pytest.mark.parametrize("export", [rostopic, ulog, bagpy, sides])
def test_files_of_one_topic_form_trials(export: object, tmp_path: Path) -> None:
    assert callable(export)
    first, _ = export(tmp_path, 1), export(tmp_path, 2)
    found = survey([tmp_path])
    assert found.join is not None
    assert not found.unrecognised
    mapping = found.mappings["csv"]
    assert len({command.source for command in mapping.commands}) == 2
    assert sum(command.direction for command in mapping.commands) == 0
    assert all(command.direction for command in mapping.commands)
    write_config(found, [tmp_path], force=True)
    trial = read_log(first, load_config(tmp_path / "rovid.toml"))
    drive, heading = turned(1)
    np.testing.assert_allclose(np.unwrap(trial.position[trial.measured]), heading, atol=2e-4)  # 4 decimals
    np.testing.assert_allclose(np.abs(trial.commands[-len(drive) // 2 :, 0]), np.abs(drive[-len(drive) // 2 :]))


def test_the_same_gap_in_several_files_is_one_note(tmp_path: Path) -> None:
    drive, heading = turned(1)
    table = {"time_s": TIME, "yaw_deg": np.degrees(heading)}
    for number in (1, 2):
        (tmp_path / f"a{number}.csv").write_text(csv_text(table))
    (tmp_path / "b.csv").write_text(csv_text(table | {"fore_cmd": drive}))
    notes = [note for note in survey([tmp_path]).warnings if "another vehicle" in note]
    assert notes == ["a1.csv, a2.csv: hold no fore_cmd; are they of another vehicle?"]
