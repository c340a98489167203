"""Logs that name their commands differently: equal commands are one thruster's, and one set of thrusters stays."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer
from scipy.signal import lfilter

from rovid.app.access import RootFolder
from rovid.app.api import Api
from rovid.core.array_types import FloatArray
from rovid.preflight.check import check_logs
from rovid.preflight.config_writer import config_text, write_config
from rovid.preflight.log_survey import LogSurvey, survey
from rovid.trial.config import load_config
from tests.conftest import Rovid
from tests.readers.logs import csv_text, finished

TIME = np.arange(0.0, 120.0, 0.1)
Table = dict[str, FloatArray]


def run(seed: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Heading in deg and pulse widths in us of two thrusters, which turn the vehicle up and down."""
    random = np.random.default_rng(seed)
    up, down = (1500.0 + random.choice([-150.0, 0.0, 150.0], 60).repeat(20) for _ in range(2))
    heading = np.rad2deg(np.cumsum(lfilter([5e-6], [1.0, -0.95], up - down)))
    return heading + 0.05 * random.standard_normal(len(TIME)), up, down


def table(path: Path, seed: int, names: tuple[str, str] = ("pwm1_us", "pwm2_us")) -> None:
    heading, *commands = run(seed)
    path.write_text(
        csv_text({"time_s": TIME, "heading_deg": heading % 360.0, **dict(zip(names, commands, strict=True))})
    )


def recording(path: Path, seed: int, fields: tuple[str, ...] = ("C1", "C2")) -> None:
    """A log in another format; further ``fields`` are commands that do not turn the vehicle."""
    heading, *commands = run(seed)
    commands += [run(seed + at)[1] for at in range(2, len(fields))]
    output = io.BytesIO()
    writer = Writer(output)
    writer.start()
    plain = writer.register_schema("plain", "jsonschema", b"{}")
    channels = [writer.register_channel(topic, "json", plain) for topic in ("/ATT", "/RCOU")]
    for at, ns in enumerate((1e9 * (1_714_558_830.0 + TIME)).astype(int).tolist()):
        values = {one: float(command[at]) for one, command in zip(fields, commands, strict=True)}
        for channel, message in zip(channels, ({"Yaw": float(heading[at] % 360.0)}, values), strict=True):
            writer.add_message(channel, ns, json.dumps(message).encode(), ns)
    path.write_bytes(finished(writer, output))


def commands_of(found: LogSurvey) -> dict[str, list[tuple[str, str]]]:
    return {kind: [(one.name, one.source) for one in each.commands] for kind, each in found.mappings.items()}


@pytest.mark.parametrize("fields", [("C1", "C2"), ("C2", "C1"), ("C4", "C3")])
def test_equal_commands_are_one_thruster_and_the_run_counts_once(tmp_path: Path, fields: tuple[str, str]) -> None:
    table(tmp_path / "dive.csv", 1)
    recording(tmp_path / "dive.mcap", 1, fields)
    found = survey([tmp_path])
    assert sorted(commands_of(found)["mcap"]) == [("pwm1", f"/RCOU.{fields[0]}"), ("pwm2", f"/RCOU.{fields[1]}")]
    assert not found.left_out.text
    assert f'command = {{ csv = "pwm1_us", mcap = "/RCOU.{fields[0]}" }}' in config_text(found)
    write_config(found, [tmp_path], force=False)
    checked = check_logs([tmp_path], load_config(tmp_path / "rovid.toml"))
    assert not checked.problems
    assert [fault.fault for fault in checked.faults] == ["same_run_twice"]


def test_further_logs_of_other_runs_do_not_hinder_the_match(tmp_path: Path) -> None:
    table(tmp_path / "dive.csv", 1)
    recording(tmp_path / "dive.mcap", 1)
    table(tmp_path / "other.csv", 2)
    assert {name for name, _ in commands_of(survey([tmp_path]))["mcap"]} == {"pwm1", "pwm2"}


def test_a_table_may_hold_a_part_of_the_commands(tmp_path: Path) -> None:
    table(tmp_path / "dive.csv", 1)
    recording(tmp_path / "dive.mcap", 1, ("C1", "C2", "C3"))
    found, _ = write_config(survey([tmp_path]), [tmp_path], force=False)
    assert [name for name, _ in commands_of(found)["mcap"]] == ["pwm1", "pwm2", "c3"]
    checked = check_logs([tmp_path], load_config(tmp_path / "rovid.toml"))
    assert (checked.problems, [fault.fault for fault in checked.faults]) == ({}, ["same_run_twice"])


def test_a_log_whose_command_is_empty_is_no_error(tmp_path: Path) -> None:
    for name, seed in (("dive", 1), ("other", 2)):
        table(tmp_path / f"{name}.csv", seed)
    lines = (tmp_path / "other.csv").read_text().splitlines()
    emptied = [lines[0], *(",".join([*line.split(",")[:-1], ""]) for line in lines[1:])]
    (tmp_path / "other.csv").write_text("\n".join(emptied) + "\n")
    recording(tmp_path / "dive.mcap", 1)
    assert {name for name, _ in commands_of(survey([tmp_path]))["mcap"]} == {"pwm1", "pwm2"}


@pytest.mark.parametrize(
    ("columns", "fields", "same"),
    [
        (("port_us", "starboard_us"), ("port_out", "starboard_out"), True),
        (("port_us", "starboard_us"), ("starboard_out", "port_out"), False),
        (("pwm1_us", "x"), ("C1", "x"), True),
        (("pwm1_us", "x"), ("C2", "x"), False),
    ],
)
def test_names_may_contradict_equal_commands(
    tmp_path: Path, columns: tuple[str, str], fields: tuple[str, str], *, same: bool
) -> None:
    table(tmp_path / "dive.csv", 1, columns)
    recording(tmp_path / "dive.mcap", 1, fields)
    found = survey([tmp_path])
    names = [{name for name, _ in each} for each in commands_of(found).values()]
    assert (names[0] <= names[1], bool(found.left_out.text)) == (same, not same)


def test_the_commands_of_most_logs_stay_where_the_runs_differ(tmp_path: Path, rovid: Rovid) -> None:
    for seed in (1, 2):
        table(tmp_path / f"dive_{seed}.csv", seed)
    recording(tmp_path / "dive.mcap", 3)
    done = rovid("init", tmp_path)
    message = " ".join(done.out.split())
    assert "dive.mcap is left out by [[leave_out]]: holds other commands: /RCOU.C1, /RCOU.C2." in message
    assert "instead of dive_1.csv, dive_2.csv: `rovid init LOGS --command /RCOU.C1,/RCOU.C2 --force`" in message
    config = load_config(tmp_path / "rovid.toml")
    assert [one.name for one in config.vehicle.thrusters] == ["pwm1", "pwm2"]
    assert [one.log for one in config.exclusions] == ["dive.mcap"]
    checked = check_logs([tmp_path], config)
    assert (checked.problems, [one.name for one in checked.trials]) == ({}, ["dive_1.csv", "dive_2.csv"])
    assert any("holds other commands" in remark.text for remark in checked.remarks)
    # The command of the message takes the other logs.
    assert rovid("init", tmp_path, "--command", "/RCOU.C1,/RCOU.C2", "--force").code == 0
    checked = check_logs([tmp_path], load_config(tmp_path / "rovid.toml"))
    assert (checked.problems, [one.name for one in checked.trials]) == ({}, ["dive.mcap"])


def test_tables_with_other_commands_are_left_out(tmp_path: Path) -> None:
    for seed in (1, 2):
        table(tmp_path / f"a_{seed}.csv", seed)
    table(tmp_path / "b.csv", 3, ("port_us", "starboard_us"))
    found, _ = write_config(survey([tmp_path]), [tmp_path], force=False)
    assert [one.log for one in found.left_out.exclusions] == ["b.csv"]
    assert found.warnings[-1].startswith("b.csv is left out")
    checked = check_logs([tmp_path], load_config(tmp_path / "rovid.toml"))
    assert (checked.problems, len(checked.trials)) == ({}, 2)


COMMANDS = {"csv": ("pwm1_us", "pwm2_us"), "mcap": ("/RCOU.C1", "/RCOU.C2")}


@pytest.mark.parametrize(("kept", "refused"), [("csv", "mcap"), ("mcap", "csv")])
def test_the_page_goes_on_without_the_commands_that_the_user_refused(tmp_path: Path, kept: str, refused: str) -> None:
    (tmp_path / "day").mkdir()
    table(tmp_path / "day" / "dive.csv", 1)
    recording(tmp_path / "day" / "dive.mcap", 2)
    api = Api(root=RootFolder(folder=tmp_path))
    signals = {
        kind: {name: {"source": one["source"], "unit": one["unit"]} for name, one in each.items()}
        for kind, each in api.draft({"logs": ["day"]})["survey"]["signals"].items()
    }
    commands = {kept: [{"source": source} for source in COMMANDS[kept]]}
    document = {"logs": ["day"], "signals": signals, "commands": commands}
    draft = api.draft(document)
    assert (draft["survey"]["open"], draft["survey"]["commands"][refused]) == ([], [])
    assert f'log = "dive.{refused}"' in draft["text"]
    checked = api.check(document)
    assert [one["name"] for one in checked["document"]["logs"]] == [f"dive.{kept}"]
    assert not any("cannot be used" in task for task in checked["tasks"])


def test_the_page_says_why_logs_cannot_be_used(tmp_path: Path) -> None:
    (tmp_path / "day").mkdir()
    for seed in (1, 2, 3):
        table(tmp_path / "day" / f"{seed}.csv", seed)
    text = (tmp_path / "day" / "2.csv").read_text()
    (tmp_path / "day" / "2.csv").write_text(text.replace("heading_deg", "h"))
    (tmp_path / "day" / "3.csv").write_text(text.replace("pwm1_us", "p"))
    tasks = Api(root=RootFolder(folder=tmp_path)).check({"logs": ["day"]})["tasks"]
    assert "2 of 3 logs cannot be used (reasons below): 2.csv, 3.csv." in tasks
    assert sum("has no column" in task for task in tasks) == 2


def test_the_file_says_how_many_logs_were_not_read(tmp_path: Path) -> None:
    for number in range(14):
        table(tmp_path / f"{number:02}.csv", 1)
    assert "from 12 logs (2 more not read)" in config_text(survey([tmp_path]))
