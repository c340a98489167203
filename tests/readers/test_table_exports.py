"""Tables as programs export them: cells between spaces, lines of keywords, quaternions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.core.errors import LogError
from rovid.readers import read_campaign, read_log
from rovid.readers.csv_reader import sources
from rovid.trial.log_files import is_log
from tests.readers.logs import campaign, csv_text, toml, turning

TIME, HEADING = turning()
COMMAND = np.where(TIME < 10.0, 1.0, 2.0)
NAMES = ("time_s", "heading_deg", "fore_V")


def spaced(names: Sequence[str], *, sign: str = "") -> str:
    """Cells aligned by spaces, with the names behind the ``sign`` of a comment."""
    rows = zip(TIME.tolist(), HEADING.tolist(), COMMAND.tolist(), strict=True)
    lines = [f"{time:10.3f} {heading:14.6e}   {command:8.2f}" for time, heading, command in rows]
    return "\n".join([sign + "  ".join(names), *lines]) + "\n"


def moos() -> str:
    """A synchronous log of MOOS."""
    rule = "%" * 40 + "\n"
    text = f"{rule}%% LOG FILE:       ./LOG.slog\n%% LOGSTART   1714558830.25\n{rule}"
    return text + spaced(NAMES, sign="%% ")


def keywords() -> str:
    """Keywords with values above a table, as Qualisys writes them."""
    head = (
        f"NO_OF_FRAMES\t{len(TIME)}\nFREQUENCY\t10\nTIME_STAMP\t2024-05-01, 10:20:30.250\t406646.66\nBODY_NAMES\tboat\n"
    )
    columns = dict(zip(NAMES, (TIME, HEADING, COMMAND), strict=True))
    return head + csv_text(columns | {"X": 0.0 * TIME, "Y": 0.0 * TIME}, "\t")


TABLES = {
    "aligned.txt": spaced(NAMES),
    "matlab.dat": spaced(NAMES, sign="% "),
    "numpy.txt": spaced(NAMES, sign="# "),
    "commented.csv": "# " + csv_text(dict(zip(NAMES, (TIME, HEADING, COMMAND), strict=True))),
    "moos.txt": moos(),
    "qualisys.tsv": keywords(),
}


@pytest.mark.parametrize("name", TABLES)
def test_tables_of_other_programs(name: str, tmp_path: Path) -> None:
    config, path = campaign(tmp_path), tmp_path / name
    path.write_text(TABLES[name])
    assert is_log(path)
    found = sources(path)
    assert found.clock.endswith("time_s")
    assert set(found.sources) >= {"heading_deg", "fore_V"}
    trial = read_log(path, config)
    np.testing.assert_allclose(trial.time, TIME, atol=1e-6)
    np.testing.assert_allclose(trial.position, np.deg2rad(HEADING), atol=2e-6)  # four decimals of a degree
    np.testing.assert_array_equal(trial.commands[:, 0], COMMAND)


def test_texts_and_data_of_other_kinds_are_no_logs(tmp_path: Path) -> None:
    config, folder = campaign(tmp_path), tmp_path
    (folder / "run.txt").write_text(TABLES["aligned.txt"])
    (folder / "README.txt").write_text("Pool, 3 May 2024\n\n" + "Run 3 was cut short, see the notes.\n" * 20)
    (folder / "camera.dat").write_bytes(bytes(range(256)) * 40)
    found = read_campaign([folder], config)
    assert [trial.name for trial in found.trials] == ["run.txt"]
    assert not found.remarks


def quaternion(angle: FloatArray, names: Sequence[str]) -> dict[str, FloatArray]:
    """Columns x, y, z and w of a rotation about the vertical, in the order of ``names``."""
    zero = np.zeros(len(angle))
    return dict(zip(names, (zero, zero, np.sin(angle / 2.0), np.cos(angle / 2.0)), strict=True))


@pytest.mark.parametrize(
    ("names", "source"),
    [
        (("pose.orientation.x", "pose.orientation.y", "pose.orientation.z", "pose.orientation.w"), "pose.orientation"),
        (("/imu/orientation/x", "/imu/orientation/y", "/imu/orientation/z", "/imu/orientation/w"), "/imu/orientation"),
        (("qx", "qy", "qz", "qw"), "q"),
        (("Rotation X", "Rotation Y", "Rotation Z", "Rotation W"), "Rotation"),
        (("q[1]", "q[2]", "q[3]", "q[0]"), "q"),
    ],
)
def test_a_quaternion_in_four_columns_gives_the_heading(names: tuple[str, ...], source: str, tmp_path: Path) -> None:
    table = {"time_s": TIME} | quaternion(np.radians(HEADING), names) | {"fore_V": COMMAND}
    path = tmp_path / "run.csv"
    config = campaign(tmp_path, toml(heading=f'heading = {{ csv = "{source}", unit = "deg" }}'))
    path.write_text(csv_text(table, form=".9f"))
    assert sources(path).sources == ("fore_V", source)
    trial = read_log(path, config)
    np.testing.assert_allclose(trial.position - trial.position[0], np.radians(HEADING - HEADING[0]), atol=1e-7)


def test_rows_above_tell_repeated_names_apart(tmp_path: Path) -> None:
    body = {"time_s": TIME} | quaternion(np.radians(HEADING), tuple("XYZW")) | {" X": TIME, " Y": TIME, " Z": TIME}
    head = "Format Version,1.23,Take Name,run\n\n,Rotation,,,,Position,,,Motor\n"
    text = csv_text(body | {"fore_V": COMMAND}, form=".9f")
    (tmp_path / "run.csv").write_text(head + text.replace(" ", ""))
    config = campaign(tmp_path, toml(heading='heading = { csv = "Rotation" }', command='{ csv = "Motor fore_V" }'))
    found = sources(tmp_path / "run.csv")
    assert found.sources == ("Position X", "Position Y", "Position Z", "Motor fore_V", "Rotation")
    trial = read_log(tmp_path / "run.csv", config)
    np.testing.assert_allclose(trial.position - trial.position[0], np.radians(HEADING - HEADING[0]), atol=1e-7)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (
            "Frame,yaw,cmd\n" + "".join(f"{at},{at % 7}.5,1\n" for at in range(40)),
            "Frame counts rows. Add a column of times",
        ),
        ("".join(f"17145588{at},30000,imu_link,0.1,0.2\n" for at in range(10, 50)), "begins with numbers"),
    ],
)
def test_a_count_and_a_row_of_numbers_are_no_time_and_no_names(text: str, reason: str, tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text(text)
    with pytest.raises(LogError, match=reason):
        sources(tmp_path / "run.csv")


def test_four_columns_of_another_vector_are_no_orientation(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text(
        csv_text({"t": TIME, "force.x": TIME, "force.y": TIME, "force.z": TIME, "force.w": TIME})
    )
    assert len(sources(tmp_path / "run.csv").sources) == 4
