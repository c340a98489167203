"""Progress of a command on standard error."""

from __future__ import annotations

import io
import sys
import time

import pytest
from rich.console import Console

from rovid.cli.streams import Progress, lines_at_intervals, progress
from tests.core.test_budget import Clock


def test_the_time_so_far_and_the_time_allowed_are_told() -> None:
    clock = Clock()
    shown = Progress("Diagnosing …", 60.0, clock)
    clock.now += 12.0
    assert str(shown) == "Diagnosing … (12 of at most 60 s)"
    screen = Console(file=io.StringIO(), width=80)
    shown.set("Model [bold]x\x1b[0m …")
    screen.print(shown)
    assert isinstance(screen.file, io.StringIO)
    # The step at hand is completed after the time allowed.
    clock.now += 60.0
    assert str(shown).endswith("(72 s)")
    # Text from files is neither markup nor an escape sequence.
    assert screen.file.getvalue().strip() == "Model [bold]x\\x1b[0m … (12 of at most 60 s)"


def test_without_a_terminal_lines_are_printed_whatever_the_command_does(capsys: pytest.CaptureFixture[str]) -> None:
    """Also while one step takes long and says nothing."""
    shown = Progress("Fitting …")
    with lines_at_intervals(shown, 0.05, 0.1):
        stop = time.monotonic() + 20.0
        said: list[str] = []
        while len(said) < 2:
            assert time.monotonic() < stop
            time.sleep(0.01)
            said += capsys.readouterr().err.splitlines()
    assert said[:2] == ["Fitting … (0 s)", "Fitting … (0 s)"]


def test_a_short_command_prints_nothing_without_a_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("ROVID_PROGRESS", raising=False)
    with progress("Fitting …") as report:
        report("Searching …")
    assert capsys.readouterr().err == ""


def test_nothing_is_printed_for_a_program_that_asks(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROVID_PROGRESS", "none")
    with progress("Fitting …", first=0.01) as report:
        report("Searching …")
        time.sleep(0.1)
    assert capsys.readouterr().err == ""


def test_steps_within_a_step_are_shown_in_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """A terminal has one line for them."""
    monkeypatch.delenv("ROVID_PROGRESS", raising=False)
    terminal = io.StringIO()
    monkeypatch.setattr(terminal, "isatty", lambda: True)
    monkeypatch.setattr(sys, "stderr", terminal)
    with progress("Comparing …"), progress("Reading the logs …") as report:
        report("Reading the logs: log 2 of 3, about 1 s …")
        time.sleep(0.3)
    assert "log 2 of 3" in terminal.getvalue()


def test_a_closed_standard_error_does_not_end_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    closed = io.StringIO()
    closed.close()
    monkeypatch.setattr(sys, "stderr", closed)
    monkeypatch.setenv("ROVID_PROGRESS", "lines")
    with progress("Fitting …") as report:
        report("Searching …")
    assert closed.closed


def test_each_line_is_printed_for_a_program_that_asks(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROVID_PROGRESS", "lines")
    with progress("Fitting …") as report:
        report("Searching …")
    assert capsys.readouterr().err.splitlines() == ["Fitting …", "Searching …"]
