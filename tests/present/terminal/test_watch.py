"""What a trial day says at a terminal."""

from __future__ import annotations

import io

import pytest

from rovid.core.formatting import SafeConsole
from rovid.present.terminal.watch import show_watch_event
from rovid.store.folder_monitor import Problem
from rovid.store.watch_session import CriterionStatus, SessionEnded, StopCriterion

INERTIA = StopCriterion(name="inertia", share=0.02, is_effect=False)


def printed(event: Problem | SessionEnded) -> str:
    stream = io.StringIO()
    show_watch_event(SafeConsole(file=stream, width=60), event)
    return stream.getvalue()


def test_a_trouble_names_its_place_once() -> None:
    text = printed(Problem(where="day/a.csv", text="day/a.csv: has no heading."))
    assert text == "Note: day/a.csv: has no heading.\n"
    assert printed(Problem(where="rovid.toml", text="can be used now.", resolved=True)).startswith("Mended: rovid.toml")


@pytest.mark.parametrize(("why", "first"), [("reached", "Stop: enough is known"), ("interrupted", "Ended: 0 logs.")])
def test_the_end_begins_with_its_reason(why: str, first: str) -> None:
    standing = CriterionStatus(criterion=INERTIA, current=0.0131, met=why == "reached")
    text = printed(SessionEnded(reason=why, criteria=(standing,), logs=(), study=None, fit=None, diagnosis=None))
    assert text.strip().startswith(first)
    assert "1.3 % now" in text
