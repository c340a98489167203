"""Terminal output, in which text from files can neither be markup nor steer the terminal."""

from __future__ import annotations

from typing import Any

from rich.console import Console
from rich.text import Text

from rovid.core.errors import LINE_LENGTH, display_text


class SafeConsole(Console):
    """A console without markup, which prints invisible characters as escapes.

    Names of files, columns and thrusters come from anywhere, and are printed by it like all other text.
    """

    def __init__(self, **options: Any) -> None:  # those of Console
        super().__init__(markup=False, emoji=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:  # those of Console
        """Text of every printed string and table cell."""
        return super().render_str(display_text(text, LINE_LENGTH), **options)


def labelled_text(label: str, text: str = "", style: str = "bold") -> Text:
    """``text`` after a ``label`` in that style."""
    return Text.assemble(
        (display_text(label, LINE_LENGTH), style), f" {display_text(text, LINE_LENGTH)}" if text else ""
    )
