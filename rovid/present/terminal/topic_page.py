"""A page of the documentation on a terminal."""

from typing import Any, ClassVar

from rich.console import Console, ConsoleOptions, RenderResult
from rich.markdown import Markdown, Paragraph, TableElement

from rovid.present.console import print_text, wrap_text
from rovid.present.tables.table import ResultTable, text_column
from rovid.present.terminal.topics import TOPICS, catalogue_pages, topic_text, topic_title

# Largest line length in characters, for readability.
_WIDEST = 100


def show_topic(console: Console, topic: str) -> None:
    """Print a page."""
    page = _Page(topic_text(topic), code_theme="bw", hyperlinks=False)
    console.print(page, width=min(console.width, _WIDEST))


def show_topics(console: Console) -> None:
    """Print the list of pages."""
    print_text(console, "`rovid help TOPIC` prints one of these pages, `rovid help COMMAND` the manual of a command.")
    console.print()
    effects, faults = catalogue_pages("effects"), catalogue_pages("faults")
    for caption, topics in (("Pages", TOPICS), ("Effects", effects), ("Faults of logs", faults)):
        titles = [text_column("topic", topics), text_column("title", map(topic_title, topics))]
        console.print(ResultTable(caption, *titles))


class _MarkdownTable(TableElement):
    """A table with wrapped cells, none of which is cut off."""

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield the table."""
        headings = self.header.row.cells if self.header and self.header.row else []
        table = ResultTable("", *(text_column(cell.content.plain) for cell in headings))
        for row in self.body.rows if self.body else ():
            table.add_row(*(cell.content for cell in row.cells))
        yield table


class _WrappedParagraph(Paragraph):
    """A paragraph in which numbers stay with their units."""

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield the wrapped text."""
        yield wrap_text(self.text, options.max_width)


class _Page(Markdown):
    elements: ClassVar[dict[str, Any]] = {
        **Markdown.elements,
        "paragraph_open": _WrappedParagraph,
        "table_open": _MarkdownTable,
    }
