"""Content of the parameter file that later commands use."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from rovid.cli.context import stored_logs, write_outputs
from rovid.core.errors import ConfigError
from rovid.core.output_files import PLAN, OutputFile, OutputSet
from rovid.store.load import read_parameters
from rovid.store.parameter_file import Parameters
from rovid.trial.axis import YAW
from tests.conftest import Rovid


def test_later_commands_find_the_logs_from_any_folder(
    day: Path, rovid: Rovid, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert rovid("fit-drag", day, "-p", "süb dir/p.toml").code == 0
    inertia = rovid("fit-inertia", "-p", "süb dir/p.toml", "--json").document
    monkeypatch.chdir(tmp_path / "süb dir")
    assert rovid("simulate", "-p", "p.toml", "--json").document["overall"]["yaw_rate_r2"] > 0.99
    assert inertia["chosen"] == "orbit_integral"


def test_a_file_of_an_earlier_run_is_not_replaced_without_a_word(tmp_path: Path) -> None:
    first, other = OutputFile(tmp_path / "plan.csv", PLAN), OutputFile(tmp_path / "other.csv", PLAN)
    outputs = OutputSet([first, other])
    one, two = '"time_s",aft\n0,1\n', '"time_s",aft\n0,2\n'
    assert write_outputs(outputs, {first: one}) == []
    assert write_outputs(outputs, {first: one}) == []
    (said,) = write_outputs(outputs, {first: two, other: one})
    assert said.startswith(f"Replaced the earlier {first.path}.")


def test_a_folder_moved_with_its_parameter_file_still_works(day: Path, rovid: Rovid, tmp_path: Path) -> None:
    shutil.copytree(day, tmp_path / "here" / "logs")
    assert rovid("fit-drag", "here/logs", "-p", "here/p.toml").code == 0
    (tmp_path / "here").rename(tmp_path / "there")
    assert rovid("fit-inertia", "-p", "there/p.toml").code == 0


def test_logs_that_are_gone_are_named_with_the_parameter_file(tmp_path: Path) -> None:
    stored = Parameters(path=tmp_path / "p.toml", axis=YAW, logs=(tmp_path / "unk",))
    with pytest.raises(ConfigError, match=r"p\.toml: names logs that cannot be read: .*unk: there is no such file"):
        stored_logs(stored)


@pytest.mark.usefixtures("blank")
@pytest.mark.slow
def test_options_are_stored_and_changed_options_refit(day: Path, rovid: Rovid, tmp_path: Path) -> None:
    quick = ("--no-diagnosis", "--no-control", "--no-export")
    assert rovid("fit-drag", day).code == 0
    assert rovid("fit-inertia", "--cutoff", "1").code == 0
    entries = read_parameters(tmp_path / "parameters.toml").entries
    assert {name: entry.options for name, entry in entries.items()} == {
        "inertia": "--cutoff=1",
        "quadratic_drag": "",
        "linear_drag": "",
    }
    # A report without this option does not change the option of an earlier fit.
    assert rovid("report", *quick, "--json").document["warnings"] == []
    (note,) = rovid("report", *quick, "--cutoff", "0.5", "--json").document["warnings"]
    assert note.endswith("was fitted again: it was fitted without --cutoff=0.5.")
    entries = read_parameters(tmp_path / "parameters.toml").entries
    assert {entry.options for entry in entries.values()} == {"--cutoff=0.5"}


@pytest.mark.usefixtures("blank")
@pytest.mark.slow
def test_a_report_on_other_logs_fits_those(day: Path, rovid: Rovid, tmp_path: Path) -> None:
    quick = ("--no-diagnosis", "--no-control", "--no-export")
    more = shutil.copytree(day, tmp_path / "more")
    (more / "holds dówn.csv").unlink()
    assert rovid("report", more, *quick).code == 0
    before = read_parameters(tmp_path / "parameters.toml")
    assert [source.name for source in before.sources] == ["holds up.csv", "sine.csv"]
    # A subset of the logs, or the same logs elsewhere, are not other logs.
    assert rovid("report", day / "sine.csv", *quick, "--json").document["warnings"] == []
    assert read_parameters(tmp_path / "parameters.toml").entries == before.entries
    # A later log is named, and the next report fits it too.
    shutil.copy(day / "holds dówn.csv", more)
    (said,) = [text for text in rovid("simulate", "--json").document["warnings"] if "added after" in text]
    assert said.startswith("holds dówn.csv")
    (note,) = rovid("report", *quick, "--json").document["warnings"]
    assert "these are other logs" in note
    now = read_parameters(tmp_path / "parameters.toml")
    assert now.entries["quadratic_drag"].value != before.entries["quadratic_drag"].value
    assert len(now.sources) == 3


@pytest.mark.usefixtures("blank")
def test_a_joint_fit_is_repeated_as_a_joint_fit(day: Path, rovid: Rovid, tmp_path: Path) -> None:
    folder = shutil.copytree(day, tmp_path / "day")
    assert rovid("fit", folder, "--effect", "bias_torque").code == 0
    toml = (folder / "rovid.toml").read_text()
    (folder / "rovid.toml").write_text(toml.replace("yaw_arm = 0.43", "yaw_arm = 0.86"))
    assert rovid("report", "--no-diagnosis", "--no-control", "--no-export").code == 0
    found = read_parameters(tmp_path / "parameters.toml")
    assert found.effects == ["bias_torque"]
    assert found.entries["inertia"].value == pytest.approx(2.0 * 5057.0, rel=0.02)


def test_drag_of_other_arms_is_removed_before_a_new_inertia(day: Path, rovid: Rovid, tmp_path: Path) -> None:
    folder = shutil.copytree(day, tmp_path / "day")
    assert rovid("fit-drag", folder).code == 0
    toml = (folder / "rovid.toml").read_text()
    assert "yaw_arm = 0.43" in toml
    (folder / "rovid.toml").write_text(toml.replace("yaw_arm = 0.43", "yaw_arm = 0.86"))
    (note,) = [text for text in rovid("fit-inertia", "--json").document["warnings"] if "started again" in text]
    assert "without quadratic_drag, linear_drag: yaw_arm of" in note
    assert "was 0.43 and is 0.86" in note
    found = read_parameters(tmp_path / "parameters.toml")
    # The old drag of the steady turns, half of the new one, is gone.
    assert found.entries["quadratic_drag"].value == pytest.approx(2.0 * 3532.0, rel=0.05)
    assert found.entries["quadratic_drag"].method == found.entries["inertia"].method


def test_logs_may_be_given_one_by_one_and_twice(day: Path, rovid: Rovid) -> None:
    whole = rovid("fit-drag", day, "--json").document["parameters"]
    single = rovid("fit-drag", day / "holds up.csv", day / "holds dówn.csv", day / "sine.csv", "--json").document
    assert single["parameters"] == whole
    twice = rovid("fit-drag", day, day / "holds up.csv", "--json").document
    assert twice["parameters"] == whole
    assert any("same file" in text for text in twice["warnings"])


def test_opening_logs_starts_the_background_compilation(
    day: Path, rovid: Rovid, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[str] = []
    monkeypatch.setattr("rovid.model.kernels.start_compiling", lambda: begun.append("begun"))
    assert rovid("fit-inertia", day).code == 0
    assert begun == ["begun"]
