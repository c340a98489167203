"""The manual: every page is whole, fits a terminal, and its examples are true."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import pytest
import typer
from typer.core import TyperGroup

from rovid.campaign.axis import axis_named
from rovid.commands import cli
from rovid.commands.cli import MANUAL
from rovid.effects import effect_named
from rovid.export import FORMATS
from tests.conftest import ROOT, SAMPLES, Rovid, run_rovid

GROUP = typer.main.get_command(cli.app)
EXAMPLES = [(command, line) for command, page in MANUAL.items() for _, line in page.examples]
# The rest takes seconds each, or needs what takes seconds; the tests of the sample logs run the like.
QUICK = [
    line
    for command, line in EXAMPLES
    if command in {"init", "convert", "fit-thruster"} or ("paper.toml" in line and command != "diagnose")
]


def test_every_command_has_a_page() -> None:
    assert isinstance(GROUP, TyperGroup)
    assert list(GROUP.commands) == list(MANUAL)


@pytest.mark.parametrize("width", [80, 120])
@pytest.mark.parametrize("command", MANUAL)
def test_a_page_is_whole_and_fits(command: str, width: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    text = run_rovid(command, "--help").out
    lines = text.splitlines()
    assert max(map(len, lines)) <= width
    assert "\x1b" not in text
    assert "\b" not in text
    at = [lines.index(f"{heading}:") for heading in ("Options", "Examples", "Exit status", "See also")]
    assert at == sorted(at)
    assert 2 <= len(MANUAL[command].examples) <= 4
    for what, line in MANUAL[command].examples:
        assert f"  # {what}\n  {line}\n" in text
    for code in (0, 2):
        assert any(line.startswith(f"  {code}  ") for line in lines)


def test_every_option_and_argument_says_what_it_is() -> None:
    assert isinstance(GROUP, TyperGroup)
    for name, command in GROUP.commands.items():
        for parameter in command.params:
            help_ = getattr(parameter, "help", "")
            assert re.fullmatch(r"[A-Z].*\.", help_ or ""), f"{name} {parameter.name}: {help_!r}"


def test_the_list_of_commands_says_what_each_does_in_full(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    text = run_rovid("--help").out
    assert "..." not in text.partition("Commands:")[2]


def test_what_is_to_be_seen_also_is_there() -> None:
    for page in MANUAL.values():
        for other in page.see:
            kind, _, name = other.partition(" ")
            assert name.split()[0] in MANUAL if kind == "rovid" else (ROOT / kind).exists(), other


@pytest.mark.parametrize(("command", "line"), EXAMPLES)
def test_an_example_is_a_command_line(command: str, line: str) -> None:
    assert isinstance(GROUP, TyperGroup)
    program, own, *words = shlex.split(line)
    assert (program, own) == ("rovid", command)
    given = GROUP.commands[command].make_context(command, words).params
    for word in words:
        assert (ROOT / word).exists() or not word.startswith("sample_logs")
    for effect in (*(given.get("effect") or ()), *(given.get("between") or ())):
        effect_named(effect)
    if given.get("axis"):
        axis_named(given["axis"])
    assert given.get("format", "json") in FORMATS


def test_quick_examples_run(rovid: Rovid, tmp_path: Path) -> None:
    (tmp_path / "sample_logs").symlink_to(SAMPLES, target_is_directory=True)
    (tmp_path / "my_logs").mkdir()
    for name in ("hold_01.csv", "hold_02.csv", "thrust_curve.csv"):
        shutil.copy(SAMPLES / "rosub_tank" / name, tmp_path / "my_logs")
    for line in QUICK:
        done = rovid(*shlex.split(line)[1:])
        assert (line, done.code, done.err) == (line, 0, "")
    assert len(QUICK) >= 10
