"""Log formats by suffix, files of one trial, and small tables."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from rovid.core.errors import RovidError
from rovid.trial.log_files import Join, guess_parts
from rovid.trial.tables import read_curve
from tests.tables import table


@pytest.mark.parametrize(
    ("names", "parts"),
    [
        (["run1_ins.csv", "run1_thr.csv", "run2_ins.csv", "run2_thr.csv"], ("ins", "thr")),
        (["run1/ins.csv", "run1/thr.csv", "run2/ins.csv", "run2/thr.csv"], ("ins", "thr")),
        (["imu-07.csv", "motors-07.csv", "imu-08.csv", "motors-08.csv", "thrust_curve.csv"], ("imu", "motors")),
        (["hold_1.csv", "hold_2.csv"], ()),
        (["a.csv"], ()),
    ],
)
def test_parts_are_words_in_which_files_differ(names: list[str], parts: tuple[str, ...]) -> None:
    assert guess_parts(names)[:1] == [parts][: bool(parts)]


@pytest.mark.parametrize(
    ("names", "parts"),
    [
        (["run1/odom.csv", "run1/left_thrust_cmd.csv", "run2/odom.csv", "run2/left_thrust_cmd.csv"],
         ("left_thrust_cmd", "odom")),
        (["log_1_vehicle_attitude_0.csv", "log_1_actuator_motors_0.csv", "log_2_vehicle_attitude_0.csv",
          "log_2_actuator_motors_0.csv"], ("actuator_motors", "vehicle_attitude")),
        (["run1_6D.csv", "run1_cmd.csv", "run2_6D.csv", "run2_cmd.csv"], ("6_d", "cmd")),
        (["odom.csv", "thruster_1_cmd.csv", "thruster_2_cmd.csv"], ("odom", "thruster_1_cmd", "thruster_2_cmd")),
    ],
)  # fmt: skip
def test_files_of_one_topic_differ_in_several_words(names: list[str], parts: tuple[str, ...]) -> None:
    assert parts in guess_parts(names, 4)[:2]
    join = Join(parts=parts)
    assert {join.part(name) for name in names} == set(parts)
    assert len(join.files_of_trial(names[0], names)) == len(parts)


def test_a_column_may_be_that_of_one_part() -> None:
    join = Join(parts=("odom", "left_cmd"))
    assert join.column_of("left_cmd:data", "run1/left_cmd.csv") == "data"
    assert join.column_of("left_cmd:data", "run1/odom.csv") == ""
    assert join.column_of("boat:x", "run1/odom.csv") == "boat:x"


def test_files_of_a_trial_have_all_else_in_common() -> None:
    join = Join(parts=("ins", "thr"))
    names = ["run2_thr.csv", "run1_thr.csv", "run1_ins.csv", "run1_gps.csv"]
    assert join.files_of_trial("run1_thr.csv", names) == ["run1_ins.csv", "run1_thr.csv"]
    assert not join.part("run1_gps.csv")


def test_a_clock_is_given_for_a_part_or_for_a_file() -> None:
    join = Join(parts=("ins", "thr"), offset={"thr": 0.5, "run2_*.csv": -1.0}, drift={"day/run3_thr.csv": 40.0})
    assert join.clock_correction("run1_thr.csv") == (0.5, 0.0)
    assert join.clock_correction("day/run2_thr.csv") == (-1.0, 0.0)
    assert join.clock_correction("day/run3_thr.csv") == (0.5, 40.0)
    assert join.clock_correction("run1_ins.csv") == (0.0, 0.0)
    assert join.is_corrected_by_part("run1_thr.csv")
    assert not join.is_corrected_by_part("run2_thr.csv")
    assert str(join) == "ins and thr, thr 0.5 s late, run2_*.csv -1 s late, day/run3_thr.csv slow by 40 ppm"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a;b\n1,5;2\n", [1.5]),
        ("a\tb\n1.5\t2\n", [1.5]),
        ("\ufeffa,b\n1.5,2\n", [1.5]),
        ("# note\na,b\n\n1.5,2\n", [1.5]),
    ],
)
def test_tables_of_every_dialect(text: str, expected: list[float], tmp_path: Path) -> None:
    assert table(text, tmp_path).numbers("a").tolist() == expected


@pytest.mark.parametrize(
    ("curve", "words"),
    [
        ("command,thrust_N\n", "no rows"),
        ("command,thrust_N\n1,2\n", "1 points"),
        ("command,thrust_N\n1,2\n1,3\n", "at one command"),
        ("command,thrust\n1,2\n2,3\n", "Nearest: 'thrust'. `rovid fit-thruster curve.csv` converts"),
        ("command,thrust_kgf\n1,2\n2,3\n", "Nearest: 'thrust_kgf'. `rovid fit-thruster curve.csv` converts"),
        ("command,thrust_N\n1,2\n2,many\n", ":3: thrust_N is 'many'"),
        ("command,thrust_N\n1,2\n2,inf\n", ":3: thrust_N is 'inf'"),
        ("", "is empty"),
    ],
)
def test_curves_that_are_none(curve: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "curve.csv"
    path.write_text(curve)
    with pytest.raises(RovidError, match=re.escape(words)):
        read_curve(path)


def test_a_curve_may_stand_in_any_order(tmp_path: Path) -> None:
    path = tmp_path / "curve.csv"
    path.write_text("thrust_N;command\n200;5\n-100,5;-5\n0;0\n")
    assert read_curve(path).thrust.tolist() == [-100.5, 0.0, 200.0]


def test_a_missing_curve_names_the_nearest_file(tmp_path: Path) -> None:
    (tmp_path / "thrust_curve.csv").write_text("command,thrust_N\n-1,-1\n1,1\n")
    with pytest.raises(RovidError, match=r"trust_curve\.csv: there is no such .* Nearest: 'thrust_curve\.csv'"):
        read_curve(tmp_path / "trust_curve.csv")
