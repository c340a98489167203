"""The catalogue of log faults, and how a detection becomes a fault with its remedy."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import get_args

import pytest

from rovid.core.errors import ConfigError
from rovid.faults.base import Detection, Stage, detectors_at, examine
from rovid.trial.config import load_config
from rovid.trial.fault import FAULT_IDS, Fault, FaultOverrides, fault_texts
from tests.conftest import ROOT

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


def test_each_fault_of_the_list_has_a_detector_and_a_page_with_its_false_alarms() -> None:
    detectors = [detect for stage in get_args(Stage) for detect in detectors_at(stage)]
    assert {detect.__module__.rpartition(".")[2] for detect in detectors} == set(FAULT_IDS)
    pages = {path.stem: path.read_text() for path in (ROOT / "docs" / "faults").glob("*.md") if path.stem != "README"}
    assert set(pages) == set(FAULT_IDS)
    assert not [name for name, text in pages.items() if "false alarm" not in text.lower()]


def twice(number: int) -> list[Detection[int]]:
    fault = Fault(fault="clock_step", logs=("a.csv",), text="a.csv: found.", remedy="cut", stops=True)
    return [Detection(fault=fault, done="Doubled.", repair=lambda value: 2 * value)] * (number > 0)


def test_a_remedy_is_applied_and_said() -> None:
    data, (fault,) = examine([twice], 3, FaultOverrides())
    assert (data, fault.text, fault.remedy, fault.stops) == (6, "a.csv: found. Doubled.", "cut", True)
    assert examine([twice], 0, FaultOverrides()) == (0, ())


@pytest.mark.parametrize(("log", "kept"), [("a.csv", True), ("*.csv", True), ("b.csv", False)])
def test_a_fault_that_the_user_keeps_changes_nothing(log: str, *, kept: bool) -> None:
    data, (fault,) = examine([twice], 3, FaultOverrides(kept={"clock_step": (log,)}))
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
