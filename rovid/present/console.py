"""Text and tables on a terminal: lines end between words, and never between a number and its unit."""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from rich import box
from rich.cells import cell_len, chop_cells
from rich.console import Console, ConsoleOptions, RenderableType
from rich.table import Table
from rich.text import Text

from rovid.core.errors import LINE_LENGTH, display_text
from rovid.core.formatting import labelled_text
from rovid.present.number_format import align_decimal_points
from rovid.trial.assumptions import Assumptions
from rovid.trial.fault import Fault, fault_texts

_NUMBER = r"[-+−(]*\d+(?:\.\d+)?(?:e[-+]\d+)?"
# First words of units that have several, such as kg m².
_UNIT_START = r"(?:kg|√?\(?N|m)\s+(?=[ms](?:\b|[²³^/)]))"
_WORD = re.compile(rf"(?:{_NUMBER}\s+(?:±\s+{_NUMBER}\s+)?(?![-+−(]*\d)(?:{_UNIT_START})*)?\S+\s*|\s+")
_BARE_WORD = re.compile(r"\S+\s*|\s+")
# Parts of a long name, which may be broken after punctuation.
_NAME_PART = re.compile(r"\s+|[^\s_./:,-]*[_./:,-]*")
# Kind of a verdict -> its style on a terminal; NO_COLOR leaves bold type.
VERDICT_STYLES = {"pass": "bold green", "warn": "bold yellow", "fail": "bold red"}


def bind_units(text: str) -> str:
    """``text`` with no-break spaces between numbers and their units, for a page that wraps lines itself."""
    return _WORD.sub(lambda word: re.sub(r"\s+(?=\S)", "\u00a0", word[0]), text)


def wrap_text(text: Text, width: int, indent: int = 0) -> Text:
    """``text`` in lines of at most ``width`` cells, all but the first indented.

    Lines end at blanks that do not precede a unit, else at any blank, else after punctuation, else anywhere.
    """
    if cell_len(text.plain) <= width:
        return text
    ends, used, position = [], 0, 0
    for piece in _pieces(text.plain, width - indent):
        if used and used + cell_len(piece.rstrip()) > width:
            ends.append(position)
            used = indent
        position += len(piece)
        used += cell_len(piece)
    lines = text.divide(ends)
    for line in lines:
        line.rstrip()
    return Text("\n" + " " * indent).join(lines)


def _pieces(text: str, width: int) -> Iterator[str]:
    """Words with the blanks after them; parts of words that are longer than ``width``."""

    def fits(word: str) -> bool:
        return cell_len(word.rstrip()) <= width

    for bound in _WORD.findall(text):
        for word in [bound] if fits(bound) else _BARE_WORD.findall(bound):
            if fits(word):
                yield word
                continue
            for part in filter(None, _NAME_PART.findall(word)):
                yield from chop_cells(part, width) if cell_len(part) > width else (part,)


def print_text(console: Console, text: str | Text, indent: int = 0) -> None:
    """Print a paragraph without colours for numbers; lines after the first are indented."""
    if isinstance(text, str):
        text = Text(display_text(text, LINE_LENGTH))
    console.print(wrap_text(text, console.width, indent), highlight=False)


def print_labelled(console: Console, label: str, text: str = "", style: str = "bold", indent: int = 0) -> None:
    """Print a paragraph with a label in the given style before it."""
    print_text(console, labelled_text(label, text, style), indent)


def print_path(console: Console, text: str) -> None:
    """Print a line with a path, which is never wrapped."""
    console.print(text, highlight=False, soft_wrap=True)


def show_warnings(console: Console, warnings: Sequence[str]) -> None:
    """Print each warning as its own paragraph."""
    for text in warnings:
        print_labelled(console, "Note:", text, "yellow")


def show_faults(console: Console, faults: Sequence[Fault]) -> None:
    """Print each fault of the logs with its remedy, those that stop a fit first."""
    for text in fault_texts(faults):
        print_labelled(console, "Logs:", text, "bold red" if any(fault.stops for fault in faults) else "bold yellow")


def show_caution(console: Console, guess: Assumptions) -> None:
    """Print the assumptions about the vehicle and their consequence."""
    if guess:
        first, _, rest = guess.caution.partition(". ")
        print_labelled(console, f"{first}.", rest, "bold red")


# Blanks between two columns on a terminal.
_GAP = 2
# Cells. Words up to the first width are not broken; text is wrapped to no less than the second.
_UNBROKEN, _NARROWEST_TEXT = 24, 14


@dataclass(frozen=True, kw_only=True)
class Column:
    """A heading, its unit, and the cells; ``aligned`` numbers share the place of their decimal points."""

    title: str
    unit: str = ""
    cells: tuple[str, ...] = ()
    numeric: bool = True
    aligned: bool = True


def text_column(title: str, cells: Iterable[str] = ()) -> Column:
    """A column of text."""
    return Column(title=title, cells=tuple(cells), numeric=False, aligned=False)


def number_column(title: str, unit: str = "", cells: Iterable[str] = ()) -> Column:
    """A column of numbers of one kind, aligned at their decimal points."""
    return Column(title=title, unit=unit, cells=tuple(cells))


def mixed_number_column(title: str, unit: str = "") -> Column:
    """A column of numbers with different units or sizes, which cannot be aligned."""
    return Column(title=title, unit=unit, aligned=False)


@dataclass(frozen=True, kw_only=True)
class _Row:
    cells: tuple[str | Text, ...]
    style: str = ""
    begins_section: bool = False


class ResultTable:
    """A captioned table; cells may be missing at the end of a row.

    A narrow terminal drops columns of numbers from the right, so the most important columns come first.
    """

    def __init__(self, caption: str, *columns: Column) -> None:
        self.caption = caption
        self._headings = columns
        cells = zip(*(column.cells for column in columns), strict=True)
        self._rows = [_Row(cells=row) for row in cells]

    def add_row(self, *cells: str | Text, style: str = "", begins_section: bool = False) -> None:
        """Add a row; a line is printed above a row that begins a section."""
        if len(cells) > len(self._headings):
            raise ValueError(f"{len(cells)} cells for {len(self._headings)} columns")
        self._rows.append(_Row(cells=cells, style=style, begins_section=begins_section))

    def without(self, title: str) -> "ResultTable":
        """The table without one of its columns."""
        place = [column.title for column in self._headings].index(title)
        table = ResultTable(self.caption, *self._headings[:place], *self._headings[place + 1 :])
        table._rows = [replace(row, cells=row.cells[:place] + row.cells[place + 1 :]) for row in self._rows]
        return table

    @property
    def columns(self) -> tuple[Column, ...]:
        """The columns with their cells, aligned where they are numbers."""
        columns = []
        for place, heading in enumerate(self._headings):
            cells = []
            for row in self._rows:
                cell = row.cells[place] if place < len(row.cells) else ""
                cells.append(cell.plain if isinstance(cell, Text) else cell)
            if heading.aligned:
                cells = align_decimal_points(cells)
            columns.append(replace(heading, cells=tuple(cells)))
        return tuple(columns)

    @property
    def rows(self) -> list[tuple[tuple[Column, str], ...]]:
        """Each row as pairs of column and cell."""
        columns = self.columns
        cells = zip(*(column.cells for column in columns), strict=True)
        return [tuple(zip(columns, row, strict=True)) for row in cells]

    def is_placeholder(self, guess: Assumptions) -> bool:
        """Whether a number in the table depends on an assumption, by its unit or its word "guessed"."""
        if any(column.numeric and guess.is_placeholder(column.unit) for column in self._headings):
            return True
        return any(cell.startswith("guessed ") for column in self.columns for cell in column.cells)

    def print(self, console: Console, guess: Assumptions) -> None:
        """Print the table; its caption names the assumptions that numbers in it depend on."""
        table = self
        if self.is_placeholder(guess):
            table = ResultTable(f"{self.caption}, by guessed {guess.quantities}".removeprefix(", "), *self._headings)
            table._rows = self._rows
        console.print(table)

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        """Yield the parts that rich prints."""
        rows = [list(map(_text, row.cells)) for row in self._rows]
        headings = [_text(f"{column.title} {column.unit}".strip()) for column in self._headings]
        widths = self._widths(headings, rows, options.max_width)
        table = Table(
            title=_text(self.caption) if self.caption else None,
            title_justify="left",
            title_style="bold",
            box=box.SIMPLE_HEAD,
            show_edge=False,
            pad_edge=False,
            collapse_padding=True,
            padding=(0, _GAP - 1, 0, 0),
        )
        wrapped = [wrap_text(heading, width) for heading, width in zip(headings, widths, strict=False)]
        lines = [heading.plain.count("\n") for heading in wrapped]
        for column, heading, width, extra in zip(self._headings, wrapped, widths, lines, strict=False):
            # Empty lines above let all headings end on the same line.
            above = Text("\n" * (max(lines) - extra))
            table.add_column(above + heading, width=width, justify="right" if column.numeric else "left")
        for row, cells in zip(self._rows, rows, strict=True):
            if row.begins_section:
                table.add_section()
            table.add_row(*map(wrap_text, cells, widths), style=row.style)
        yield table
        if dropped := [heading.plain for heading in headings[len(widths) :]]:
            note = f"Not shown in {options.max_width} columns: {', '.join(dropped)}. Widen the terminal, or use --json."
            yield wrap_text(Text(note), options.max_width)
        yield Text()

    def _widths(self, headings: Sequence[Text], rows: Sequence[Sequence[Text]], available: int) -> list[int]:
        """Widths of the columns that fit, from the first on."""
        cells = [[row[place] for row in rows if place < len(row)] for place in range(len(headings))]
        widths = list(map(_least_width, self._headings, headings, cells))
        has_numbers = any(column.numeric for column in self._headings)
        while _spare(widths, available) < 0 and max(widths) > 1:
            if has_numbers and len(widths) > 1:
                widths.pop()
            else:
                widths[widths.index(max(widths))] -= 1
        # Wrapped cells lengthen the table, a wrapped heading does not: cells are widened first.
        wanted = [max(map(_length, column), default=0) for column in cells[: len(widths)]]
        _widen(widths, wanted, available)
        _widen(widths, list(map(max, wanted, map(_length, headings))), available)
        return widths


def _least_width(column: Column, heading: Text, cells: Sequence[Text]) -> int:
    """The least width of a column in terminal cells."""
    heading_word = max(map(len, heading.plain.split()), default=0)
    longest = max(map(_length, cells), default=0)
    if column.numeric:
        return max(heading_word, longest)
    words = [cell_len(word) for cell in cells for word in cell.plain.split()]
    return max(heading_word, min(max(words, default=0), _UNBROKEN), min(longest, _NARROWEST_TEXT))


def _spare(widths: Sequence[int], available: int) -> int:
    return available - sum(widths) - _GAP * (len(widths) - 1)


def _widen(widths: list[int], wanted: Sequence[int], available: int) -> None:
    """Distribute the spare width among columns below their ``wanted`` width, first to the relatively narrowest."""
    for _ in range(_spare(widths, available)):
        narrowest = max(range(len(widths)), key=lambda place: wanted[place] / max(widths[place], 1))
        if wanted[narrowest] <= widths[narrowest]:
            return
        widths[narrowest] += 1


def _text(cell: str | Text) -> Text:
    return cell if isinstance(cell, Text) else Text(display_text(cell, LINE_LENGTH))


def _length(text: Text) -> int:
    return cell_len(text.plain)
