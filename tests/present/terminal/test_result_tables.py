"""What is printed for a person."""

from __future__ import annotations

import io
import os
import re

import pytest

from rovid.core.console import SafeConsole, labelled_text
from rovid.core.errors import display_text
from tests.hostile import NAMES, STEERING


@pytest.mark.parametrize("name", [*NAMES, os.fsdecode(b"\xff"), "y" * 100_000])
def test_nothing_that_is_printed_steers_a_terminal(name: str) -> None:
    from rovid.present.terminal.result_tables import show_warnings
    from rovid.present.terminal.table import table

    out = io.StringIO()
    screen = SafeConsole(file=out, force_terminal=True, color_system=None, width=4000, legacy_windows=False)
    rows = table(name, name, "b")
    rows.add_row(name, labelled_text("lead", name, "red"))
    screen.print(rows)
    screen.print(name)
    show_warnings(screen, [name])
    text = re.sub("\x1b\\[\\d*(;\\d+)*m", "", out.getvalue()) if "\x1b[31m" not in name else out.getvalue()
    assert not STEERING.search(text)
    assert display_text(name, 2000)[:100] in text, "as it is: neither markup nor an emoji"
    assert len(text) < 40_000
