"""Dialect of a CSV file: encoding, delimiter, header, notation of numbers, and the end of its last whole line."""

import codecs
import csv
import re
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import zip_longest
from pathlib import Path
from typing import IO, NamedTuple, Self

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import LogError
from rovid.readers.raw_log import orientations
from rovid.trial.tables import suggest_columns

# Bytes read at the beginning of the file, and in blocks from its end.
_HEAD = _TAIL = 1 << 16
_DELIMITERS = (",", ";", "\t")
# Delimiter of a table whose cells are aligned by spaces.
SPACES = " "
# The mark of UTF-32 begins as that of UTF-16.
_BOMS = {codecs.BOM_UTF8: "utf-8-sig", codecs.BOM_UTF32_LE: "utf-32", codecs.BOM_UTF32_BE: "utf-32"}
_BOMS |= {codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}
_WIDE = ("utf-16", "utf-32")  # Every character takes two bytes or more.
_LINE_END = re.compile("\r\n|\n|\r")
_CONTROL_CHARACTER = re.compile("[\x00-\x08\x0e-\x1f]")
_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d*,\d+([eE][+-]?\d+)?\s*")
_SPACED_QUOTE = re.compile(r"[,;\t] +\"")
_SAMPLE_ROWS = 200
# A number or a time: a row without one is a header (names, units, short names), or stands before it.
_DATUM = re.compile(r"(?i)[+-]?(?:\d[\d.,'’ ]*|[.,]\d+)(?:e[+-]?\d+)?|[+-]?(?:nan|inf)|\d{4}-\d\d-\d\d.*|\d\d?:\d\d.*")
# Words of programs for a missing value: databases, spreadsheets, C and Fortran. People's words are asked about.
MISSING = (
    *("", "nan", "NaN", "NAN", "-nan", "nan(ind)", "-nan(ind)", "1.#QNAN", "-1.#QNAN", "1.#IND", "-1.#IND"),
    *("NA", "#N/A", "null", "NULL", "None", "none", "#NUM!", "#VALUE!", "#DIV/0!"),
)
# Signs that begin a comment.
_COMMENTS = ("#", "%", "//")
# Number of rows of data in succession that end the header.
_DATA_ROWS = 3
# A unit, in brackets or not, with any prefix and power.
_UNIT = re.compile(
    r"\W*(?:-|1|%|°|°/s|°C|(?:(?:[kmcuµn]?(?:s|sec|m|g|N|A|V|W|Hz|Pa|bar|rad|Nm|Ah|Wh)|min|h|deg|dps|rpm|kn|K|C|"
    r"ticks?|counts?|us)[\^0-9]*[ */·_]?)+)\W*"
)


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Facts about a CSV file that its numbers are read by."""

    path: Path
    encoding: str  # utf-8 (also for ASCII), utf-8-sig, utf-16, utf-16-le, utf-16-be, utf-32 or cp1252.
    delimiter: str
    names: tuple[str, ...]  # Of the columns; with the unit from a row of units: "speed [m/s]".
    titles: tuple[str, ...]  # The same without that unit.
    lines: int  # Number of lines up to the end of the header.
    before: int  # Number of lines before the header that are not empty.
    plain: bool  # pandas counts the lines before the header in the same way.
    spaced: bool  # Quotes follow a space.
    offset: int  # Characters up to the end of the header (bytes, except in UTF-16 and UTF-32).
    rows: tuple[tuple[str, ...], ...]  # Cells of the first rows.

    @property
    def written_names(self) -> set[str]:
        """Names by which rovid.toml may refer to the columns."""
        return {*self.names, *self.titles}

    @property
    def sources(self) -> set[str]:
        """The same, and the orientations whose components are columns."""
        return self.written_names | orientations(self.titles).keys()

    @property
    def wide(self) -> bool:
        """Whether every character takes two bytes or more."""
        return self.encoding.startswith(_WIDE)

    @property
    def width(self) -> int:
        """Number of columns, with the empty ones of delimiters at line ends."""
        return max(len(self.names), *map(len, self.rows[:5]), 0)

    def is_stray(self, row: Sequence[str]) -> bool:
        """Whether a row holds no data: a comment, the header once more, or two lines that were written as one."""
        cells = [cell.strip() for cell in row]
        is_comment = bool(cells) and cells[0].startswith(_COMMENTS)
        return is_comment or tuple(cells) == self.titles or any(cells[len(self.names) :])

    def without_stray_rows(self) -> Self:
        """The layout without stray rows; `LogError` if most rows have too many cells, as decimal commas produce."""
        kept = tuple(row for row in self.rows if not self.is_stray(row))
        for number, row in enumerate(self.rows):
            if 2 * len(kept) < len(self.rows) and any(cell.strip() for cell in row[len(self.names) :]):
                text = f"row {number + 1} holds {len(row)} cells, but the header names {len(self.names)} columns."
                mend = "Name every column; where the decimal sign is a comma, separate the cells by semicolons."
                raise LogError(text, where=self.path, mend=mend)
        return replace(self, rows=kept)

    def decimal(self, columns: Collection[int]) -> str:
        """Decimal sign of the first rows in ``columns``."""
        cells = (row[at] for row in self.rows for at in columns if at < len(row))
        return "," if any(map(_DECIMAL_COMMA.fullmatch, cells)) else "."

    def column(self, name: str, signal: str) -> int:
        """Index of the one column ``name``; `LogError` if there is none, or more than one."""
        every = enumerate(zip(self.names, self.titles, strict=True))
        places = [index for index, written in every if name in written]
        if not places:
            places = [index for index, written in enumerate(self.names) if plain_name(written) == plain_name(name)]
        if len(places) == 1:
            return places[0]
        if places:
            text = f"has {len(places)} columns named {name!r}, which is mapped to {signal}; one was expected."
            raise LogError(text, where=self.path, mend="Rename the others in the header.")
        near = suggest_columns(name, self.names, self.rows)
        text = f"has no column {name!r}, which rovid.toml maps to {signal}. {near}"
        raise LogError(text, where=self.path, mend=f"Correct the name in rovid.toml ({signal}), or leave this log out.")


def is_datum(cell: str) -> bool:
    """Whether a cell is a number or a time."""
    return bool(_DATUM.fullmatch(cell.strip()))


def plain_name(name: str) -> str:
    """A column's name without capitals and without spaces around it."""
    return name.strip().casefold()


def read_layout(path: Path, wanted: Collection[str]) -> Layout:
    """Layout of ``path``, from its beginning; `LogError` if it is empty, is no text, or has no header.

    ``wanted`` are the column names in rovid.toml, which decide on the delimiter and on the line of the header.
    """
    with path.open("rb") as file:
        head = file.read(_HEAD)
    if not head.rstrip(b"\0 \t\r\n"):
        problem = "holds only NUL bytes; the recorder never wrote to it" if head.strip() else "is empty"
        raise LogError(f"{problem}.", where=path, mend="Delete it.")
    encoding = _encoding(path, head)
    text = codecs.getincrementaldecoder(encoding)(errors="replace").decode(head)
    lines = _first_lines(text)
    texts = [line for line, _ in lines]
    at, start, units_at = _header_lines(texts, wanted, path)
    line = texts[at]
    delimiter = max(_DELIMITERS, key=lambda sign: (_count_known(line, sign, wanted), len(_split(line, sign))))
    if start < len(texts) and _has_spaced_numbers(texts[start]) and not _split(line, delimiter)[1:]:
        delimiter, line = SPACES, line.lstrip("#%/")
    titles = _split(line.lstrip("#") if _is_comment(line) else line, delimiter)
    titles = _told_apart(titles, [_split(above, delimiter) for above in reversed(texts[:at])])
    units = [cell.strip("[]() -") for cell in _split(texts[units_at], delimiter)] if units_at is not None else []
    names = [f"{title} [{unit}]" if unit else title for title, unit in zip_longest(titles, units[: len(titles)])]
    before = [line for line in texts[:at] if line]
    # The last line is cut unless the whole file was read.
    whole = lines if len(head) < _HEAD or lines[-1][1] < len(text) else lines[:-1]
    sample = [line for line, _ in whole[start:]][:_SAMPLE_ROWS]
    end = lines[start - 1][1]
    # cp1252 decodes unknown bytes to one character each.
    offset = end if encoding.startswith(_WIDE) else len(text[:end].encode(encoding, errors="replace"))
    return Layout(
        path=path,
        encoding=encoding,
        delimiter=delimiter,
        names=tuple(names),
        titles=tuple(titles),
        lines=start,
        before=len(before),
        plain=start == at + 1 and all(text.strip() and text.count('"') % 2 == 0 for text in before),
        spaced=any(map(_SPACED_QUOTE.search, sample)),
        offset=offset,
        rows=tuple(tuple(_cells(line, delimiter)) for line in sample if line.strip()),
    )


def _encoding(path: Path, head: bytes) -> str:
    for mark, name in _BOMS.items():
        if head.startswith(mark):
            return name
    body = head.rstrip(b"\0")
    if b"\0" in body:
        for name, half in {"utf-16-le": body[1::2], "utf-16-be": body[::2]}.items():
            if half.count(0) > 0.9 * len(half):
                return name
        raise _no_text(path, "NUL bytes")
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8"


def _no_text(path: Path, found: str) -> LogError:
    text = f"is no text: it holds {found}; a table with a header row was expected."
    return LogError(text, where=path, mend="Export it as CSV, or give it the suffix of its format.")


def _first_lines(text: str) -> list[tuple[str, int]]:
    """(line, end of its line end) up to the first line that is no comment, and the sample rows after it."""
    found: list[tuple[str, int]] = []
    header = None
    start = 0
    while start < len(text) and (header is None or len(found) <= header + _SAMPLE_ROWS):
        match = _LINE_END.search(text, start)
        stop, end = match.span() if match else (len(text), len(text))
        found.append((text[start:stop], end))
        if header is None and _has_content(text[start:stop]):
            header = len(found) - 1
        start = end
    return found


def _header_lines(lines: list[str], wanted: Collection[str], path: Path) -> tuple[int, int, int | None]:
    """Indices of the line of names, of the first row, and of the line of units, if there is one.

    The names are in the line with most names in ``wanted``, else with most cells, else in the first line that is no
    comment; or in a comment just before it with more names in ``wanted``. Lines of text below it belong to the header
    if one of them holds units.
    """

    def known(line: str) -> int:
        return max(_count_known(line, sign, wanted) for sign in (*_DELIMITERS, SPACES))

    filled = [at for at, line in enumerate(lines) if _has_content(line)]
    number = filled[0] if filled else None
    least = 0 if number is None else known(lines[number])
    before = [at for at, line in enumerate(lines[:number]) if line]
    if before and _is_comment(lines[before[-1]]) and known(lines[before[-1]].lstrip().lstrip("#")) > least:
        number = before[-1]
    if number is None:
        raise LogError("has no header row, only comments.", where=path)
    if match := _CONTROL_CHARACTER.search(lines[number]):
        raise _no_text(path, f"the control character {match[0]!r}")

    @cache  # Most lines are data below the header, and are not split.
    def cells(at: int) -> list[str]:
        if _has_spaced_numbers(lines[at]):
            return lines[at].split()
        return max((_split(lines[at], sign) for sign in _DELIMITERS), key=len)

    # Lines of a keyword and its value above the table have fewer cells.
    usual = max((len(cells(at)) for at in filled[-_DATA_ROWS:]), default=0)

    def have_data(rows: list[int]) -> bool:
        return all(_has_data(cells(at)) and 2 * len(cells(at)) > usual for at in rows)

    first = next((row for row in range(len(filled)) if have_data(filled[row : row + _DATA_ROWS])), 0)
    above = next((row for row in range(first, 0, -1) if have_data(filled[row - 1 : row])), 0)
    headers = filled[above:first]
    units = next((at for at in headers if _are_units(cells(at))), None)
    texts = [at for at in headers if at != units]
    # Names between spaces are as many as the numbers below, and may follow the sign of a comment.
    width = len(cells(filled[first])) if filled and _has_spaced_numbers(lines[filled[first]]) else 0

    def named(at: int) -> int:
        words = lines[at].lstrip("#%/").split()
        return len(words) if len(words) == width else sum(map(bool, cells(at)))

    if not texts and before and named(before[-1]) == len(cells(filled[first])) > 1:
        number = before[-1]
    if number in filled and texts:
        number = max(texts, key=lambda at: (known(lines[at]), named(at), at if width else -at))
    start = number + 1 if units is None else filled[first]
    return number, start, units


def _told_apart(titles: list[str], above: Sequence[list[str]]) -> list[str]:
    """``titles`` with the cells of the rows ``above`` in front where some repeat, the nearest row first.

    Programs of motion capture name body, quantity and axis in a row each; a cell may span the empty ones after it.
    """
    for row in above:
        repeated = {name for name, count in Counter(titles).items() if name and count > 1}
        if not repeated:
            break
        cells: list[str] = []
        for cell in row:
            cells.append(cell or "".join(cells[-1:]))
        if len(cells) == len(titles) and len({cells[at] for at, name in enumerate(titles) if name in repeated}) > 1:
            titles = [f"{cell} {name}".strip() for cell, name in zip(cells, titles, strict=True)]
    return titles


def _has_spaced_numbers(line: str) -> bool:
    """Whether a line holds numbers between spaces, without another delimiter."""
    words = line.split()
    return len(words) > 1 and not set(line) & set(_DELIMITERS) and all(map(_DATUM.fullmatch, words))


def _are_units(cells: Sequence[str]) -> bool:
    known = list(filter(None, cells))
    return len(known) > 1 and all(map(_UNIT.fullmatch, known))


def _has_data(cells: Sequence[str]) -> bool:
    """Whether a row holds a number or a time; next to text, 1 is the unit of a number without one."""
    known = set(filter(None, cells))
    return any(map(_DATUM.fullmatch, known - {"1"})) or known <= {"1"}


def _has_content(line: str) -> bool:
    """Whether a line is neither blank nor a comment."""
    return bool(line.strip()) and not _is_comment(line)


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith("#")


def _count_known(line: str, delimiter: str, wanted: Collection[str]) -> int:
    return len(set(_split(line, delimiter)) & set(wanted))


def _split(line: str, delimiter: str) -> list[str]:
    return [name.strip() for name in _cells(line, delimiter)]


def _cells(line: str, delimiter: str) -> list[str]:
    try:
        return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])
    except csv.Error:  # A cell beyond the module's limit, which no header has.
        return [line]


def last_whole_line(file: IO[bytes], size: int) -> tuple[int, int]:
    """(end of the last whole line, number of NUL bytes at the end of the file), in bytes.

    A loss of power leaves a line without an end, or NUL bytes.
    """
    end, nul = size, 0
    while end:
        start = max(0, end - _TAIL)
        file.seek(start)
        block = file.read(end - start)
        if nul == size - end:  # Nothing else yet.
            block = block.rstrip(b"\0")
            nul = size - start - len(block)
        at = max(block.rfind(b"\n"), block.rfind(b"\r"))
        if at >= 0:
            return start + at + 1, nul
        end = start
    return 0, nul


# --- notation of numbers: decimal signs and thousands separators ------------------------------------------------

# Between groups of three digits: the sign that is not the decimal one, an apostrophe, a space, two narrow spaces.
_SEPARATORS = "'’ \u00a0\u202f"
_GROUPED = re.compile(rf"[+-]?\d{{1,3}}(?:[.,{_SEPARATORS}]\d{{3}})+(?:[.,]\d+)?")


class Notation(NamedTuple):
    """Decimal sign and thousands separators of a table."""

    decimal: str
    thousands: str

    def numbers(self, cells: Sequence[str]) -> FloatArray | None:
        """(n,) numbers of ``cells`` without outer spaces, NaN where empty; None if one is none in this notation."""
        whole, sign = rf"(?:\d{{1,3}}(?:[{self.thousands}]\d{{3}})+|\d+)", re.escape(self.decimal)
        number = re.compile(rf"[+-]?(?:{whole}(?:{sign}\d*)?|{sign}\d+)(?:[eE][+-]?\d+)?")
        signs = str.maketrans({**dict.fromkeys(self.thousands), self.decimal: "."})
        if not all(number.fullmatch(cell) for cell in cells if cell):
            return None
        return np.array([float(cell.translate(signs)) if cell else np.nan for cell in cells])


NOTATIONS = (Notation(".", f",{_SEPARATORS}"), Notation(",", f".{_SEPARATORS}"))


def has_thousands(cell: str) -> bool:
    """Whether a cell may be a number with thousands separators."""
    return bool(_GROUPED.fullmatch(cell))


def read_grouped(columns: Sequence[Sequence[str]], time: int | None) -> list[FloatArray] | None:
    """(n,) numbers of each of ``columns`` in the one notation that fits them all; None if no notation or both fit.

    Where both fit, that one is taken in which the column ``time`` goes back less often: 999, 1.000, 1.001 is a time in
    ms with thousands separators.
    """
    read = [list(map(notation.numbers, columns)) for notation in NOTATIONS]
    fitting = [[one for one in numbers if one is not None] for numbers in read]
    fitting = [numbers for numbers in fitting if len(numbers) == len(columns)]
    if len(fitting) > 1 and time is not None:
        clocks = [numbers[time] for numbers in fitting]
        backward = [int(np.sum(np.diff(clock[np.isfinite(clock)]) <= 0.0)) for clock in clocks]
        fitting = [numbers for numbers, steps in zip(fitting, backward, strict=True) if steps < max(backward)]
    return fitting[0] if len(fitting) == 1 else None
