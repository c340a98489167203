"""A table that fits whatever it is printed on: no number is ever cut in two."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

from rich import box
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderableType
from rich.table import Table
from rich.text import Text

from rovid.core.errors import LINE_LENGTH, display_text
from rovid.present.terminal.wrapping import wrap_text

# Blanks between two columns.
_GAP = 2
# A name longer than this may be folded, and prose is not set any narrower.
_NAME, _PROSE = 24, 14


class Columns:
    """Rows under headings, set when they are printed, in the width that there is then.

    The columns of ``text`` are folded where they have to be; the others are numbers, which are not. Where not all
    columns fit, the last gives way, then the one before it, and a line below the table says which; so they stand in
    the order of what they are worth. Where all are text none gives way: they are folded as far as it takes.
    """

    def __init__(self, title: str, headings: Sequence[str | Text], text: Collection[int]) -> None:
        self._title = title
        self._headings = [_text(heading) for heading in headings]
        self._text = text
        self._rows: list[list[Text]] = []
        self._styles: list[str] = []
        self._sections: set[int] = set()

    def add_row(self, *cells: str | Text, style: str = "") -> None:
        """A cell for each column, the last may be left out."""
        given = [_text(cell) for cell in cells]
        self._rows.append(given + [Text()] * (len(self._headings) - len(given)))
        self._styles.append(style)

    def add_section(self) -> None:
        """A line below the rows that are there."""
        self._sections.add(len(self._rows))

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        """What rich prints."""
        widths = self._widths(options.max_width)
        made = Table(
            title=_text(self._title) if self._title else None,
            title_justify="left",
            title_style="bold",
            box=box.SIMPLE_HEAD,
            show_edge=False,
            pad_edge=False,
            collapse_padding=True,
            padding=(0, _GAP - 1, 0, 0),
        )
        headings = [wrap_text(heading, width) for heading, width in zip(self._headings, widths, strict=False)]
        most = max(heading.plain.count("\n") for heading in headings)
        for at, (heading, width) in enumerate(zip(headings, widths, strict=True)):
            # The last words of all stand on the line.
            above = Text("\n" * (most - heading.plain.count("\n")))
            made.add_column(above + heading, width=width, justify="left" if at in self._text else "right")
        for number, (row, style) in enumerate(zip(self._rows, self._styles, strict=True)):
            if number in self._sections:
                made.add_section()
            made.add_row(*(wrap_text(cell, width) for cell, width in zip(row, widths, strict=False)), style=style)
        yield made
        if gone := [heading.plain for heading in self._headings[len(widths) :]]:
            them = "them" if len(gone) > 1 else "it"
            said = f"No room in {options.max_width} columns: {', '.join(gone)}. A wider terminal has {them}, or --json."
            yield wrap_text(Text(said), options.max_width)
        yield Text()

    def _widths(self, most: int) -> list[int]:
        """Of the columns that fit, the first of all that there are."""
        widths = [self._least(at) for at in range(len(self._headings))]
        numbers = len(self._text) < len(widths)
        while _room(widths, most) < 0 and max(widths) > 1:
            if numbers and len(widths) > 1:
                widths.pop()
            else:
                widths[widths.index(max(widths))] -= 1
        # Folded text makes rows longer; a folded heading does not.
        cells = [max(self._cells(at), default=0) for at in range(len(widths))]
        _grow(widths, cells, most)
        _grow(widths, [max(pair) for pair in zip(cells, map(_long, self._headings), strict=False)], most)
        return widths

    def _cells(self, at: int) -> Iterator[int]:
        return (_long(row[at]) for row in self._rows)

    def _least(self, at: int) -> int:
        """The narrowest that column number ``at`` can be."""
        words = max((len(word) for word in self._headings[at].plain.split()), default=0)
        longest = max(self._cells(at), default=0)
        if at not in self._text:
            return max(words, longest)
        cells = [word for row in self._rows for word in row[at].plain.split()]
        names = max((min(cell_len(word), _NAME) for word in cells), default=0)
        return max(words, names, min(longest, _PROSE))


def table(title: str, *columns: str, left: int = 1, prose: bool = False) -> Columns:
    """A table with columns in the order of what they are worth.

    The first ``left`` of them are text, the last too where it is ``prose``; the rest are numbers.
    """
    last = [len(columns) - 1] if prose else []
    return Columns(title, columns, {*range(left), *last})


def _room(widths: Sequence[int], most: int) -> int:
    return most - sum(widths) - _GAP * (len(widths) - 1)


def _grow(widths: list[int], wanted: Sequence[int], most: int) -> None:
    """Widen ``widths`` up to what is ``wanted``, the one that lacks most first."""
    for _ in range(_room(widths, most)):
        lacking = max(range(len(widths)), key=lambda at: wanted[at] / max(widths[at], 1))
        if wanted[lacking] <= widths[lacking]:
            return
        widths[lacking] += 1


def _text(cell: str | Text) -> Text:
    return cell if isinstance(cell, Text) else Text(display_text(cell, LINE_LENGTH))


def _long(text: Text) -> int:
    return cell_len(text.plain)
