"""A clock offset is a fault of joined logs, not a cause."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rovid.diagnose.log_rivals import _without_offset
from rovid.diagnose.result import Diagnosis
from rovid.effects import command_delay
from rovid.effects.clock_offset import CLOCKS_APART, mean_shifted
from rovid.signals.preprocessing import shift_commands
from tests.diagnose.findings import finding
from tests.faults.days import day
from tests.synthetic import clock, trial


def test_commands_move_against_the_motion() -> None:
    time = clock(60.0)
    command = np.sign(np.random.default_rng(1).normal(size=61))[time.astype(int)]
    moved = shift_commands(trial(time, command, np.sin(0.3 * time)), 0.5)
    # The common time begins at 0.5 s, where the first command begins now.
    np.testing.assert_allclose(moved.position[moved.measured], np.sin(0.3 * (moved.time[moved.measured] + 0.5)))
    np.testing.assert_array_equal(moved.commands[:, 0], np.interp(moved.time + 0.01, time, command).round())
    assert abs(moved.duration - 59.5) < 1e-9


def test_a_held_value_is_moved_by_its_delay() -> None:
    time, values = np.arange(0.0, 10.0, 0.5), np.zeros(20)
    values[8:] = 2.0  # from 4 s on
    early, late = mean_shifted(time, values, -1.0), mean_shifted(time, values, 0.75)
    np.testing.assert_allclose(early, np.where(time >= 3.0, 2.0, 0.0))
    np.testing.assert_allclose(late[8:11], [0.0, 1.0, 2.0])


@pytest.mark.parametrize(("delay", "separate", "kept"), [(0.3, True, True), (0.8, True, False), (0.8, False, True)])
def test_a_long_delay_between_topics_may_be_an_offset(delay: float, separate: bool, kept: bool) -> None:
    runs = [replace(run, trial=replace(run.trial, separate_clocks=separate)) for run in day("small", 0)]
    found = Diagnosis(verdict="found", findings=(finding(command_delay.FORMS[0], [delay]),))
    result = _without_offset(found, runs)
    assert bool(result.findings) == kept
    assert [fault.fault for fault in result.faults] == ([] if kept else ["clocks_apart"])
    assert result.verdict == ("found" if kept else "suspected")


@pytest.mark.parametrize(("delay", "kept"), [(0.2, False), (0.41, False), (0.6, True)])
def test_stamps_that_are_late_by_chance_are_no_delay(delay: float, kept: bool) -> None:
    """A logger that reads the commands for its rows alone stamps them late, by up to an interval."""
    found = Diagnosis(verdict="found", findings=(finding(command_delay.FORMS[-1], [delay, 1.0]),))
    result = _without_offset(found, day("small", 0), finding(CLOCKS_APART, [0.4]), "The commands were moved by it.")
    assert bool(result.findings) == kept
    assert result.verdict == ("found" if kept else "nothing_found")
    (fault,) = result.faults
    assert fault.fault == "clocks_apart"
    assert ("scatters by" in fault.text) != kept
