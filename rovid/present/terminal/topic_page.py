"""A page of the documentation on a terminal."""

from __future__ import annotations

from typing import Any, ClassVar

from rich.console import Console, ConsoleOptions, RenderResult
from rich.markdown import Markdown, Paragraph, TableElement

from rovid.present.terminal.result_tables import print_text
from rovid.present.terminal.table import Columns
from rovid.present.terminal.topics import TOPICS, topic_names, topic_text, topic_title
from rovid.present.terminal.wrapping import wrap_text

# Longer lines are hard to read.
_WIDEST = 100


def show_topic(console: Console, topic: str) -> None:
    """Print a page."""
    page = _Page(topic_text(topic), code_theme="bw", hyperlinks=False)
    console.print(page, width=min(console.width, _WIDEST))


def show_topics(console: Console) -> None:
    """Print what there is to read."""
    print_text(console, "`rovid help TOPIC` prints one of these pages, `rovid help COMMAND` the manual of a command.")
    console.print()
    pages = topic_names()
    for heading, chosen in (("Pages", pages[: len(TOPICS)]), ("Effects", pages[len(TOPICS) :])):
        rows = Columns(heading, ("topic", "title"), {0, 1})
        for topic in chosen:
            rows.add_row(topic, topic_title(topic))
        console.print(rows)


class _Table(TableElement):
    """A table whose words are never cut off."""

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """What rich prints."""
        headings = [cell.content for cell in self.header.row.cells] if self.header and self.header.row else []
        rows = Columns("", headings, {*range(len(headings))})
        for row in self.body.rows if self.body else ():
            rows.add_row(*(cell.content for cell in row.cells))
        yield rows


class _Paragraph(Paragraph):
    """One whose numbers keep their units."""

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """What rich prints."""
        yield wrap_text(self.text, options.max_width)


class _Page(Markdown):
    elements: ClassVar[dict[str, Any]] = {**Markdown.elements, "paragraph_open": _Paragraph, "table_open": _Table}
