"""Text from elsewhere as a terminal gets it."""

from __future__ import annotations

import io

from rich.table import Table

from rovid.core.formatting import SafeConsole, labelled_text


def printed(thing: object) -> str:
    stream = io.StringIO()
    SafeConsole(file=stream, width=60, force_terminal=False).print(thing)
    return stream.getvalue().rstrip()


def test_nothing_is_taken_for_markup_or_for_a_picture() -> None:
    assert printed("[red]a[/red] :smile:") == "[red]a[/red] :smile:"


def test_what_is_not_seen_is_printed_as_an_escape() -> None:
    assert printed("a\x1b[31mb") == "a\\x1b[31mb"
    rows = Table("a\x07b")
    rows.add_row("c\x9bd")
    assert "a\\x07b" in printed(rows)
    assert "c\\x9bd" in printed(rows)


def test_a_lead_stands_before_its_text() -> None:
    assert printed(labelled_text("Next:", "a run\x1b")) == "Next: a run\\x1b"
    assert printed(labelled_text("Alone")) == "Alone"
