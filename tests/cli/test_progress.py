"""Progress of a command on standard error."""

from __future__ import annotations

import pytest

from rovid.cli.progress import at_intervals, progress
from tests.core.test_budget import Clock


def test_without_a_terminal_a_line_is_printed_every_ten_seconds() -> None:
    clock, lines = Clock(), list[str]()
    show = at_intervals(lines.append, clock=clock)
    for second in range(35):
        clock.now = 100.0 + second
        show(f"after {second} s")
    assert lines == ["after 10 s", "after 20 s", "after 30 s"]


def test_a_short_command_prints_nothing_without_a_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("ROVID_PROGRESS", raising=False)
    with progress("Fitting …") as report:
        report("Searching …")
    assert capsys.readouterr().err == ""


def test_each_line_is_printed_for_a_program_that_asks(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROVID_PROGRESS", "lines")
    with progress("Fitting …") as report:
        report("Searching …")
    assert capsys.readouterr().err.splitlines() == ["Fitting …", "Searching …"]
