"""What a trial day says at a terminal."""

from __future__ import annotations

import io

import pytest

from rovid.core.console import Screen
from rovid.present.terminal.watch_text import show_event
from rovid.watch.folder_monitor import Trouble
from rovid.watch.session import Stop
from rovid.watch.stop_criteria import Condition, Standing

INERTIA = Condition(name="inertia", share=0.02, of_cause=False)


def printed(event: Trouble | Stop) -> str:
    stream = io.StringIO()
    show_event(Screen(file=stream, width=60), event)
    return stream.getvalue()


def test_a_trouble_names_its_place_once() -> None:
    text = printed(Trouble(where="day/a.csv", text="day/a.csv: has no heading."))
    assert text == "Note: day/a.csv: has no heading.\n"
    assert printed(Trouble(where="rovid.toml", text="can be used now.", over=True)).startswith("Mended: rovid.toml")


@pytest.mark.parametrize(("why", "first"), [("reached", "Stop: enough is known"), ("interrupted", "Ended: 0 logs.")])
def test_the_end_begins_with_its_reason(why: str, first: str) -> None:
    standing = Standing(condition=INERTIA, now=0.0131, met=why == "reached")
    text = printed(Stop(why=why, standings=(standing,), logs=(), study=None, fit=None, diagnosis=None))
    assert text.strip().startswith(first)
    assert "1.3 % now" in text
