"""How a CSV file is written: its encoding, delimiter, decimal sign, header, and where its last whole line ends."""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import IO

from rovid.core.errors import LogError
from rovid.trial.tables import suggest_columns

_HEAD = 1 << 16
_TAIL = 1 << 16
_LONGEST = 1 << 20
_DELIMITERS = (",", ";", "\t")
_BOMS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_LINE_END = re.compile("\r\n|\n|\r")
_ENDS = re.compile(b"[\r\n]")
_NOT_TEXT = re.compile("[\x00-\x08\x0e-\x1f]")
_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d*,\d+([eE][+-]?\d+)?\s*")
_SPACED_QUOTE = re.compile(r"[,;\t] +\"")
_SAMPLE_ROWS = 200


@dataclass(frozen=True, kw_only=True)
class Layout:
    """What has to be known of a CSV file before its numbers are read.

    Attributes
    ----------
    encoding
        utf-8 (also for pure ASCII), utf-8-sig, utf-16, utf-32 or cp1252.
    names
        Of the columns, without spaces around them.
    lines
        Of the file up to the end of the header.
    before
        Those of them in front of the header that are not empty.
    plain
        They cannot confuse pandas' own count of lines.
    spaced
        Quotes follow a space.
    offset
        Characters up to the end of the header (bytes, except in UTF-16 and UTF-32).
    rows
        The first rows of cells.
    """

    path: Path
    encoding: str
    delimiter: str
    names: tuple[str, ...]
    lines: int
    before: int
    plain: bool
    spaced: bool
    offset: int
    rows: tuple[tuple[str, ...], ...]

    @property
    def wide(self) -> bool:
        """Whether a character takes more than one byte, NUL bytes among them."""
        return self.encoding in {"utf-16", "utf-16-le", "utf-16-be", "utf-32"}

    @property
    def width(self) -> int:
        """Number of columns, with empty ones that a delimiter at the end of each line makes."""
        return max(len(self.names), *(len(row) for row in self.rows[:5]), 0)

    def refuse_long_rows(self) -> None:
        """Complain of the first row that holds more than the header names, as commas within numbers make it.

        Raises
        ------
        LogError
            With its line.
        """
        for number, row in enumerate(self.rows):
            if any(cell.strip() for cell in row[len(self.names) :]):
                raise LogError(
                    f"row {number + 1} holds {len(row)} cells, but the header names {len(self.names)} columns.",
                    where=self.path,
                    mend="Name every column; where the decimal sign is a comma, separate the cells by semicolons.",
                )

    def decimal(self, columns: Collection[int]) -> str:
        """The decimal sign that the first rows use in ``columns``."""
        cells = (row[at] for row in self.rows for at in columns if at < len(row))
        return "," if any(map(_DECIMAL_COMMA.fullmatch, cells)) else "."

    def column(self, name: str, signal: str) -> int:
        """Index of the column ``name``.

        Raises
        ------
        LogError
            There is none, or more than one.
        """
        places = [index for index, present in enumerate(self.names) if present == name]
        if len(places) == 1:
            return places[0]
        if places:
            text = f"has {len(places)} columns named {name!r}, which is mapped to {signal}; one was expected."
            raise LogError(text, where=self.path, mend="Rename the others in the header.")
        raise LogError(
            f"has no column {name!r}, which rovid.toml maps to {signal}. {suggest_columns(name, self.names, self.rows)}",
            where=self.path,
            mend=f"Correct the name in rovid.toml ({signal}), or leave this log out.",
        )


def read_layout(path: Path, wanted: Collection[str]) -> Layout:
    """Look at the beginning of ``path``.

    Parameters
    ----------
    wanted
        Column names that rovid.toml maps; they settle which delimiter and which line is the header's.

    Raises
    ------
    LogError
        The file is empty, is no text, or has no header.
    """
    with path.open("rb") as file:
        head = file.read(_HEAD)
    if not head.rstrip(b"\0 \t\r\n"):
        what = "holds only NUL bytes; the recorder never wrote to it" if head.strip() else "is empty"
        raise LogError(f"{what}.", where=path, mend="Delete it.")
    encoding = _encoding(path, head)
    text = _decode(head, encoding)
    lines = _beginning(text)
    at = _header_line([line for line, _ in lines], wanted, path)
    line, end = lines[at]
    delimiter = max(_DELIMITERS, key=lambda sign: _score(_split(line, sign), wanted))
    if _is_comment(line):
        line = line.lstrip("#")
    before = [line for line, _ in lines[:at] if line]
    # Of a longer file the last line of its head may be cut.
    whole = lines if len(head) < _HEAD or lines[-1][1] < len(text) else lines[:-1]
    sample = [line for line, _ in whole[at + 1 :]][:_SAMPLE_ROWS]
    rows = [tuple(_cells(text, delimiter)) for text in sample if text.strip()]
    return Layout(
        path=path,
        encoding=encoding,
        delimiter=delimiter,
        names=tuple(_split(line, delimiter)),
        lines=at + 1,
        before=len(before),
        plain=all(text.strip() and text.count('"') % 2 == 0 for text in before),
        spaced=any(map(_SPACED_QUOTE.search, sample)),
        offset=end if encoding.startswith(("utf-16", "utf-32")) else len(_encode(text[:end], encoding)),
        rows=tuple(rows),
    )


def _encoding(path: Path, head: bytes) -> str:
    for mark, name in _BOMS:
        if head.startswith(mark):
            return name
    body = head.rstrip(b"\0")
    if b"\0" in body:
        sides = {"utf-16-le": body[1::2], "utf-16-be": body[::2]}
        for name, side in sides.items():
            if side.count(0) > 0.9 * len(side):
                return name
        raise _binary(path, "NUL bytes")
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8"


def _decode(head: bytes, encoding: str) -> str:
    return codecs.getincrementaldecoder(encoding)(errors="replace").decode(head)


def _encode(text: str, encoding: str) -> bytes:
    # Only its length matters; a byte that cp1252 does not know was decoded to one character.
    return text.encode(encoding, errors="replace")


def _binary(path: Path, what: str) -> LogError:
    return LogError(
        f"is no text: it holds {what}; a table with a header row was expected.",
        where=path,
        mend="Export it as CSV, or give it the suffix of its format.",
    )


def _beginning(text: str) -> list[tuple[str, int]]:
    """(line, where its end-of-line ends) up to the first that is no comment, and the rows after it."""
    lines = _lines(text)
    found = list[tuple[str, int]]()
    for line in lines:
        found.append(line)
        if _is_plain(line[0]):
            break
    return [*found, *islice(lines, _SAMPLE_ROWS)]


def _lines(text: str) -> Iterator[tuple[str, int]]:
    """(line, where its end-of-line ends) of each line; the last may be cut."""
    start = 0
    for match in _LINE_END.finditer(text):
        yield text[start : match.start()], match.end()
        start = match.end()
    if start < len(text):
        yield text[start:], len(text)


def _header_line(lines: list[str], wanted: Collection[str], path: Path) -> int:
    """Index of the first line that is no comment, or of a comment just before it that names columns."""
    number = next((at for at, line in enumerate(lines) if _is_plain(line)), None)
    least = 0 if number is None else _hits(lines[number], wanted)
    before = [at for at, line in enumerate(lines[:number]) if line]
    if before and _is_comment(lines[before[-1]]):
        inside = lines[before[-1]].lstrip().lstrip("#")
        if _hits(inside, wanted) > least:
            number = before[-1]
    if number is None:
        raise LogError("has no header row, only comments.", where=path)
    match = _NOT_TEXT.search(lines[number])
    if match:
        raise _binary(path, f"the control character {match[0]!r}")
    return number


def _is_plain(line: str) -> bool:
    return bool(line.strip()) and not _is_comment(line)


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith("#")


def _hits(line: str, wanted: Collection[str]) -> int:
    return max(len(set(_split(line, sign)) & set(wanted)) for sign in _DELIMITERS)


def _score(names: list[str], wanted: Collection[str]) -> tuple[int, int]:
    return len(set(names) & set(wanted)), len(names)


def _split(line: str, delimiter: str) -> list[str]:
    return [name.strip() for name in _cells(line, delimiter)]


def _cells(line: str, delimiter: str) -> list[str]:
    try:
        return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])
    except csv.Error:  # a field beyond the module's limit: no header has that
        return [line]


def refuse_long_lines(path: Path, end: int) -> None:
    """Complain of a line that no table has, before all of it is taken apart.

    Parameters
    ----------
    end
        Bytes of the file that are to be read.

    Raises
    ------
    LogError
        With the place.
    """
    with path.open("rb") as file:
        for start in range(0, end - _LONGEST, _LONGEST):
            # Most blocks have a line's end close to theirs.
            for back in (_TAIL, _LONGEST):
                file.seek(start + _LONGEST - back)
                if _ENDS.search(file.read(back)):
                    break
            else:
                raise LogError(
                    f"has a line of more than {_LONGEST >> 20} MB; a table with a row a line was expected.",
                    where=f"{path}: byte {start + 1}",
                    mend="Export the log again, or leave it out.",
                )


def last_whole_line(file: IO[bytes], size: int) -> tuple[int, int]:
    """(where the last whole line ends, how many NUL bytes stand at the end of the file), in bytes.

    A recorder that loses power leaves a line without an end, or a tail of NUL bytes.
    """
    whole = _end_of_text(file, size)
    nul = size - whole
    while whole:
        start, block = _block_before(file, whole)
        at = max(block.rfind(b"\n"), block.rfind(b"\r"))
        if at >= 0:
            return start + at + 1, nul
        whole = start
    return 0, nul


def _end_of_text(file: IO[bytes], size: int) -> int:
    """Where the NUL bytes begin that stand at the end of the file."""
    text, end = b"", size
    while end and not text:
        start, block = _block_before(file, end)
        text = block.rstrip(b"\0")
        end = start + len(text)
    return end


def _block_before(file: IO[bytes], end: int) -> tuple[int, bytes]:
    """Where the last block before ``end`` begins, and what it holds."""
    start = max(0, end - _TAIL)
    file.seek(start)
    return start, file.read(end - start)
