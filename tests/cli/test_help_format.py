"""The manual: every page is complete, fits the terminal, and has valid examples."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import pytest
import typer
from typer.core import TyperGroup

from rovid.cli import cli
from rovid.cli.cli import MANUAL
from rovid.effects import effect_named
from rovid.export import FORMATS
from rovid.present.terminal.topics import topic_names
from rovid.trial.axis import axis_named
from tests.conftest import SAMPLES, Rovid, run_rovid

GROUP = typer.main.get_command(cli.app)
EXAMPLES = [(command, line) for command, page in MANUAL.items() for _, line in page.examples]
# The other examples take seconds; the tests of the sample logs run similar commands.
QUICK = [
    line
    for command, line in EXAMPLES
    if command in {"convert", "fit-thruster", "help"} or ("tables.toml" in line and command != "diagnose")
]
# Samples that replace a reader's files.
STAND_INS = {
    "my_logs": "rosub_tank",
    "surge_logs": "surge_tank",
    "planar_logs": "planar_rov",
    "rov_logs": "bluerov2_pier59",
    "ardupilot_logs": "bluerov2_dataflash",
    "my_tables/steady_turns.csv": "rosub_paper/table3.csv",
    "my_tables/sine_trials.csv": "rosub_paper/sine_trials.csv",
    "my_tables/rovid.toml": "rosub_paper/rovid.toml",
    "bench.csv": "thruster_bench/kaxan_540.csv",
    "t200_bench.csv": "bluerov2_pier59/t200_16V_bench.csv",
}


def test_every_command_has_a_page() -> None:
    assert isinstance(GROUP, TyperGroup)
    assert list(GROUP.commands) == list(MANUAL)


@pytest.mark.parametrize("width", [60, 80, 120])
@pytest.mark.parametrize("command", MANUAL)
def test_a_page_is_complete_and_fits_the_terminal(command: str, width: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    text = run_rovid(command, "--help").out
    lines = text.splitlines()
    assert max(map(len, lines)) <= width
    assert "\x1b" not in text
    assert "\b" not in text
    at = [lines.index(f"{heading}:") for heading in ("Options", "Examples", "Exit status", "See also")]
    assert at == sorted(at)
    # A server without options has one use.
    assert 1 + (command != "mcp") <= len(MANUAL[command].examples) <= 4
    # A line that is too long for the terminal continues after a backslash.
    whole = " ".join(text.replace(" \\\n", " ").split())
    for what, line in MANUAL[command].examples:
        assert f"# {what} {line} " in whole
    for code in (0, 2):
        assert any(line.startswith(f"  {code}  ") for line in lines)


def test_every_option_and_argument_has_help() -> None:
    assert isinstance(GROUP, TyperGroup)
    for name, command in GROUP.commands.items():
        for parameter in command.params:
            help_ = getattr(parameter, "help", "")
            assert re.fullmatch(r"[A-Z].*\.", help_ or ""), f"{name} {parameter.name}: {help_!r}"


def test_the_list_of_commands_has_full_first_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    text = run_rovid("--help").out
    assert "..." not in text.partition("Commands:")[2]


def test_related_commands_and_pages_exist() -> None:
    for page in MANUAL.values():
        for other in page.see:
            rovid, name, *more = other.split()
            assert rovid == "rovid"
            assert name in {*MANUAL, "COMMAND"}, other
            if name == "help":
                assert more[0] in topic_names(), other


def test_no_page_refers_to_files_of_the_repository() -> None:
    texts = [run_rovid(command, "--help").out for command in MANUAL] + [run_rovid("--help").out]
    for text in texts:
        assert not re.search(r"docs/|sample_logs|README|\.md\b", text), text


@pytest.mark.parametrize(("command", "line"), EXAMPLES)
def test_an_example_is_a_command_line(command: str, line: str) -> None:
    assert isinstance(GROUP, TyperGroup)
    program, own, *words = shlex.split(line)
    assert (program, own) == ("rovid", command)
    given = GROUP.commands[command].make_context(command, words).params
    for path in (*(given.get("logs") or ()), *filter(None, (given.get("log"), given.get("bench")))):
        assert stood_in(path).exists(), path
    for effect in (*(given.get("effect") or ()), *(given.get("between") or ())):
        effect_named(effect)
    if given.get("axis"):
        axis_named(given["axis"])
    assert given.get("format", "json") in FORMATS


def stood_in(path: Path) -> Path:
    """The sample that replaces a reader's file, or a file in the reader's folder."""
    for part in (path, *path.parents):
        if str(part) in STAND_INS:
            return SAMPLES / STAND_INS[str(part)] / path.relative_to(part)
    # A folder with some replaced files.
    assert any(name.startswith(f"{path}/") for name in STAND_INS), path
    return SAMPLES


def test_quick_examples_run(rovid: Rovid, tmp_path: Path) -> None:
    for name, sample in STAND_INS.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).symlink_to(SAMPLES / sample)
    for line in QUICK:
        done = rovid(*shlex.split(line)[1:])
        assert (line, done.code, done.err) == (line, 0, "")
    assert len(QUICK) >= 10


def test_examples_of_init_run(rovid: Rovid, tmp_path: Path) -> None:
    (tmp_path / "my_logs").mkdir()
    for name in ("hold_01.csv", "hold_02.csv", "thrust_curve.csv"):
        shutil.copy(SAMPLES / "rosub_tank" / name, tmp_path / "my_logs")
    for line in (line for command, line in EXAMPLES if command == "init"):
        done = rovid(*shlex.split(line)[1:])
        assert (line, done.code, done.err) == (line, 0, "")
