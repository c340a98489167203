"""The command line's contract: help, documents and exit codes."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from rovid import __version__
from rovid.cli import cli
from tests.conftest import SAMPLES, Rovid, run_rovid

COMMANDS = [command.name or command.callback.__name__.replace("_", "-") for command in cli.app.registered_commands]  # type: ignore[union-attr]
PARAMETER = {"value", "standard_error", "unit"}


def assert_parameters(found: dict[str, Any], names: set[str]) -> None:
    assert set(found) == names
    for entry in found.values():
        assert set(entry) >= PARAMETER
        assert isinstance(entry["value"], float)
        assert entry["standard_error"] > 0.0
    units = {"inertia": "kg m^2", "quadratic_drag": "N m s^2/rad^2", "linear_drag": "N m s/rad"}
    assert {name: entry["unit"] for name, entry in found.items()} == {name: units[name] for name in found}


@pytest.mark.parametrize("flag", ["-h", "--help"])
@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_with_an_example(command: str, flag: str) -> None:
    done = run_rovid(command, flag)
    assert (done.code, done.err) == (0, "")
    text = re.sub(r"\s+", " ", done.out)
    assert f"Usage: rovid {command}" in text
    assert f" rovid {command}" in text.partition("Examples:")[2]
    assert "--json" in text


def test_version_and_no_arguments(rovid: Rovid) -> None:
    assert rovid("--version").out == f"rovid {__version__}\n"
    bare = rovid()
    assert "Usage: rovid" in bare.out + bare.err
    for command in COMMANDS:
        assert command in bare.out + bare.err


@pytest.mark.parametrize("command", ["fit-drag", "fit-inertia", "fit"])
def test_fit_documents(command: str, day: Path, rovid: Rovid) -> None:
    document = rovid(command, day, "--json").document
    assert document["schema"] == "rovid-fit/1"
    assert set(document) >= {"schema", "parameters", "effects", "log_likelihood", "samples", "warnings"}
    drag = {"quadratic_drag", "linear_drag"}
    # Without a steady drag `fit-inertia` also fits the drag.
    assert_parameters(document["parameters"], drag if command == "fit-drag" else {"inertia", *drag})
    assert document["effects"] == []
    assert isinstance(document["warnings"], list)
    assert (document["log_likelihood"] is None) == (command != "fit")


def test_simulation_document(day: Path, rovid: Rovid) -> None:
    assert rovid("fit-inertia", day).code == 0
    document = rovid("simulate", "--json").document
    assert document["schema"] == "rovid-simulation/1"
    assert set(document) >= {"schema", "parameters", "effects", "trials", "overall"}
    fit = {"yaw_rate_r2", "yaw_rate_fit_percent", "yaw_rate_rmse"}
    assert set(document["overall"]) >= fit
    assert [trial["name"] for trial in document["trials"]] == ["holds dówn.csv", "holds up.csv", "sine.csv"]
    for trial in document["trials"]:
        assert set(trial) >= {"name", "samples", "heading_error_10s", "heading_error_60s", *fit}
        assert trial["yaw_rate_fit_percent"] == pytest.approx(100.0 * (1.0 - (1.0 - trial["yaw_rate_r2"]) ** 0.5))
    assert_parameters(document["parameters"], {"inertia", "quadratic_drag", "linear_drag"})


def test_check_document(day: Path, rovid: Rovid) -> None:
    document = rovid("check", day, "--json").document
    assert document["schema"] == "rovid-check/1"
    assert {log["name"]: (log["held_commands"], log["sine_runs"]) for log in document["logs"]} == {
        "holds up.csv": (3, 0),
        "holds dówn.csv": (2, 0),
        "sine.csv": (0, 1),
    }
    assert document["unreadable"] == []


@pytest.mark.parametrize("first", [[], ["fit-drag"]], ids=["without steady drag", "with steady drag"])
def test_a_repeated_command_gives_the_same_result(first: list[str], day: Path, rovid: Rovid) -> None:
    for command in first:
        assert rovid(command, day).code == 0
    once, twice = (rovid("fit-inertia", day, "--json").document for _ in range(2))
    assert once == twice


def wrong_sign(day: Path, folder: Path) -> Path:
    shutil.copytree(day, folder / "wrong")
    path = folder / "wrong" / "rovid.toml"
    path.write_text(path.read_text(encoding="utf-8").replace("yaw_arm = 0.43", "yaw_arm = -0.43"), encoding="utf-8")
    return folder / "wrong"


@pytest.mark.parametrize("command", ["fit-drag", "fit-inertia", "fit"])
def test_thrust_of_the_wrong_sign_is_an_error(command: str, day: Path, rovid: Rovid, tmp_path: Path) -> None:
    done = rovid(command, wrong_sign(day, tmp_path))
    assert done.code == 2
    assert "turn each yaw_arm around" in done.err
    assert not (tmp_path / "parameters.toml").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["fit-drag", "gone"], "no such file or folder"),
        (["fit-inertia"], "no such parameter file"),
        (["simulate"], "no such parameter file"),
        (["simulate", "-p", "."], "is a folder"),
        (["fit-drag", "DAY", "--cutoff", "50"], "up to 4 Hz"),
        (["fit-drag", "DAY", "--cutoff", "inf"], "up to 4 Hz"),
        (["fit-drag", "DAY", "--cutoff", "nan"], "cutoff"),
        (["fit-drag", "DAY", "-p", "file/p.toml"], "cannot be written"),
        (["bogus"], "bogus"),
    ],
)
def test_user_errors_end_with_status_2_and_one_message(
    arguments: list[str], words: str, day: Path, rovid: Rovid, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    done = rovid(*(str(day) if argument == "DAY" else argument for argument in arguments))
    assert (done.code, done.out) == (2, "")
    assert words in done.err
    assert "Traceback" not in done.err


@pytest.mark.parametrize(
    ("rows", "code", "words"),
    [
        ("1,0,0\n2,0,0\n3,0,0\n", 2, "no held command"),
        ("1,.1,-42\n2,.2,-160\n3,.3,-300\n", 2, "signs of yaw_arm"),
        ("1,.1,42\n", 0, "nearly the same rate"),
        ("1,.1,42\n2,.2,160\n", 0, "two rows|2 rows"),
        ("1,.1,42\n2,.1,43\n3,.1,44\n", 0, "nearly the same rate"),
        ("1,.1,10\n2,.2,20\n3,.3,30\n", 0, "linear_drag"),
    ],
    ids=["at rest", "backwards", "one row", "two rows", "one rate", "linear"],
)
def test_poor_tables_give_messages(rows: str, code: int, words: str, rovid: Rovid, tmp_path: Path) -> None:
    # Warnings are errors here: no traceback and no warning of numpy may reach the user.
    (tmp_path / "table.csv").write_text("command,yaw_rate_rad_s,torque_Nm\n" + rows)
    for extra in ([], ["--json"]):
        done = rovid("fit-drag", "table.csv", *extra)
        assert done.code == code
        assert re.search(words, re.sub(r"\s+", " ", done.out + done.err))


def test_tables_are_only_of_yaw(rovid: Rovid) -> None:
    done = rovid("fit-drag", SAMPLES / "rosub_paper", "--axis", "surge")
    assert done.code == 2
    assert "is a table of yaw" in re.sub(r"\s+", " ", done.err)


def test_a_pipe_gets_plain_text_or_only_json(day: Path, tmp_path: Path) -> None:
    rovid = [sys.executable, "-W", "error", "-c", "from rovid.cli.cli import main; main()"]
    plain = subprocess.run([*rovid, "fit-drag", day], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert "\x1b" not in plain.stdout
    assert plain.stderr == ""
    done = subprocess.run([*rovid, "fit-drag", day, "--json"], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert json.loads(done.stdout)["schema"] == "rovid-fit/1"
    assert done.stderr == ""
