"""The catalogue of log faults, and how a detection becomes a fault with its remedy."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import get_args

import pytest

import rovid.faults
from rovid.core.errors import ConfigError
from rovid.faults.base import Detection, FaultKind, Stage, examine
from rovid.faults.catalogue import fault_kinds
from rovid.trial.config import load_config
from rovid.trial.fault import FAULT_IDS, Fault, FaultOverrides, fault_texts

CONFIG = """
[[thrusters]]
name = "fore"
yaw_arm = 0.4
curve = "curve.csv"
command = "u"
[signals]
time = "t"
heading = "h"
[faults]
"""


def test_each_file_of_the_room_is_a_fault_of_the_list() -> None:
    files = {path.stem for path in Path(rovid.faults.__file__).parent.glob("*.py")}
    kinds = [kind for stage in get_args(Stage) for kind in fault_kinds(stage)]
    assert {kind.id for kind in kinds} == set(FAULT_IDS) <= files
    assert all(kind.title and kind.false_alarms for kind in kinds)


def twice(number: int) -> list[Detection[int]]:
    fault = Fault(fault="clock_step", logs=("a.csv",), text="a.csv: found.", remedy="cut", stops=True)
    return [Detection(fault=fault, done="Doubled.", repair=lambda value: 2 * value)] * (number > 0)


KIND = FaultKind(id="clock_step", title="", stage="clock", detect=twice, false_alarms="")


def test_a_remedy_is_applied_and_said() -> None:
    data, (fault,) = examine([KIND, KIND][:1], 3, FaultOverrides())
    assert (data, fault.text, fault.remedy, fault.stops) == (6, "a.csv: found. Doubled.", "cut", True)
    assert examine([KIND], 0, FaultOverrides()) == (0, ())


@pytest.mark.parametrize(("log", "kept"), [("a.csv", True), ("*.csv", True), ("b.csv", False)])
def test_a_fault_that_the_user_keeps_changes_nothing(log: str, *, kept: bool) -> None:
    data, (fault,) = examine([KIND], 3, FaultOverrides(kept={"clock_step": (log,)}))
    assert data == (3 if kept else 6)
    assert fault.stops is not kept
    assert fault.text.endswith("It was kept, as rovid.toml says." if kept else "Doubled.")


def test_the_table_of_rovid_toml(tmp_path: Path) -> None:
    (tmp_path / "curve.csv").write_text("command,thrust_N\n-1,-2\n1,2\n")
    path = tmp_path / "rovid.toml"
    plain = CONFIG.replace("[faults]", "")
    path.write_text(plain)
    before = load_config(path)
    path.write_text(CONFIG + 'clock_step = "keep"\nforeign_log = ["b.csv", "c*"]\n')
    config = load_config(path)
    assert config.faults.kept == {"clock_step": ("*",), "foreign_log": ("b.csv", "c*")}
    assert before.fingerprint.changes(config.fingerprint) == ["faults kept is new"]
    assert replace(before, faults=config.faults).fingerprint == config.fingerprint
    for wrong in ("clock_stepp = 1", "clock_step = 1", "clock_step = [1]"):
        path.write_text(CONFIG + wrong)
        with pytest.raises(ConfigError, match="clock_step"):
            load_config(path)


def test_logs_with_the_same_fault_share_a_sentence() -> None:
    def lost(log: str, share: float) -> Fault:
        return Fault(fault="lost_rows", logs=(log,), text=f"{log}: {share} % of the rows are missing.")

    stop = Fault(fault="thrust_unit", logs=(), text="The inertia is impossible.", stops=True)
    assert fault_texts([lost("run_1.csv", 14.5), lost("run_2.csv", 3.0), stop, lost("run_2.csv", 4.0)]) == [
        "The inertia is impossible.",
        "run_1.csv: 14.5 % of the rows are missing. Likewise in run_2.csv.",
    ]


def test_each_fault_has_a_page() -> None:
    pages = {path.stem for path in (Path(__file__).parents[2] / "docs" / "faults").glob("*.md")}
    assert pages == {*FAULT_IDS, "README"}
