"""What a person at a terminal sees: text from elsewhere steers nothing there."""

from __future__ import annotations

from typing import Any

from rich.console import Console
from rich.text import Text

from rovid.core.errors import LINE_LENGTH, display_text


class SafeConsole(Console):
    """A console that prints every string as it is, without markup and with what is not seen as an escape.

    Names of files, columns and thrusters come from anywhere and are printed here like everything else.
    """

    def __init__(self, **options: Any) -> None:  # those of Console
        super().__init__(markup=False, emoji=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:  # those of Console
        """Every string that is printed, or stands in a table, comes through here."""
        return super().render_str(display_text(text, LINE_LENGTH), **options)


def labelled_text(lead: str, text: str = "", style: str = "bold") -> Text:
    """``text`` behind a ``lead`` in that style."""
    return Text.assemble(
        (display_text(lead, LINE_LENGTH), style), f" {display_text(text, LINE_LENGTH)}" if text else ""
    )
