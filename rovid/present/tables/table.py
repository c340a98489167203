"""A captioned table of text: column by column, or written row by row."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from rovid.present.number_text import align_decimal_points
from rovid.trial.assumptions import Assumptions


@dataclass(frozen=True, kw_only=True)
class Column:
    """A heading, the unit under it, and whether numbers stand below, which are aligned at their points."""

    title: str
    unit: str = ""
    cells: tuple[str, ...]
    numeric: bool = True


@dataclass(frozen=True, kw_only=True)
class ResultTable:
    """A captioned table."""

    caption: str
    columns: tuple[Column, ...]

    def hangs_on(self, guess: Assumptions) -> bool:
        """Whether a number in it is a placeholder, by its unit or by its own word."""
        if any(guess.is_placeholder(column.unit) for column in self.columns if column.numeric):
            return True
        return any(cell.startswith("guessed ") for column in self.columns for cell in column.cells)

    @property
    def rows(self) -> list[tuple[tuple[Column, str], ...]]:
        """Row by row, each cell with its column."""
        rows = zip(*(column.cells for column in self.columns), strict=True)
        return [tuple(zip(self.columns, row, strict=True)) for row in rows]


def words(heading: str, cells: Iterable[str]) -> Column:
    """A column of text."""
    return Column(title=heading, cells=tuple(cells), numeric=False)


def numbers(heading: str, unit_text: str, cells: Sequence[str]) -> Column:
    """A column of numbers that are already rounded."""
    return Column(title=heading, unit=unit_text, cells=tuple(align_decimal_points(cells)))


@dataclass(frozen=True, kw_only=True)
class Heading:
    """What stands over a column to come: of numbers or of text, the numbers in line at their points or not."""

    title: str
    unit: str = ""
    numeric: bool = True
    in_line: bool = True

    def over(self, cells: Sequence[str]) -> Column:
        """The column of ``cells``."""
        if not self.numeric:
            return words(self.title, cells)
        if not self.in_line:
            return Column(title=self.title, unit=self.unit, cells=tuple(cells))
        return numbers(self.title, self.unit, cells)


def text_column(title: str) -> Heading:
    """Over text."""
    return Heading(title=title, numeric=False)


def number_column(title: str, unit: str = "") -> Heading:
    """Over numbers of one kind, whose points stand in line."""
    return Heading(title=title, unit=unit)


def mixed_number_column(title: str, unit: str = "") -> Heading:
    """Over numbers of different units or sizes, which share no decimal point."""
    return Heading(title=title, unit=unit, in_line=False)


class TableBuilder:
    """A grid in the making: its headings first, then row after row."""

    def __init__(self, caption: str, *headings: Heading) -> None:
        self._caption = caption
        self._headings = headings
        self._rows: list[tuple[str, ...]] = []

    def add(self, *cells: str) -> None:
        """One more row, a cell for each heading."""
        self._rows.append(cells)

    def grid(self) -> ResultTable:
        """What was written so far."""
        columns = []
        for place, heading in enumerate(self._headings):
            cells = [row[place] for row in self._rows]
            columns.append(heading.over(cells))
        return ResultTable(caption=self._caption, columns=tuple(columns))
