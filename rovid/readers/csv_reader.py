"""CSV tables: one row an instant, any names, any of the usual spellings of numbers and times."""

from __future__ import annotations

import csv
import io
import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import IO, Any

import numpy as np
import pandas as pd

from rovid.core.array_types import FloatArray
from rovid.core.errors import LogError
from rovid.readers.csv_dialect import Layout, last_whole_line, read_layout, refuse_long_lines
from rovid.readers.raw_log import Channel, LogContents, RawLog, mapped, time_signal
from rovid.readers.timestamps import column_to_seconds, epoch_of
from rovid.trial.config import Config
from rovid.trial.signal_names import CLOCK_WORDS, NOT_CLOCK, Signal, name_words
from rovid.trial.trial import Remark

KIND = "csv"
# How a date, or a date and a time of day, begins.
_ISO = re.compile(r"\d{4}-\d{2}-\d{2}([T ]\d{2}:\d{2}|$)")
_MISSING = ("", "nan", "NaN", "NAN", "-nan")
# A whole number this long does not fit a float64 without loss: nanoseconds since 1970.
_LONG_INTEGER = 16
# Columns that are left out for what they hold; each costs another look at the file.
_MOST_LEFT_OUT = 8


def read(path: Path, config: Config) -> RawLog:
    """Wanted columns of ``path``.

    Raises
    ------
    LogError
        It is no such table, lacks a column, or holds text in the place of a number.
    ConfigError
        rovid.toml does not map the time, the heading or a command for CSV.
    """
    signals = {"time": time_signal(config, KIND), **mapped(config, KIND, path)}
    layout = read_layout(path, {signal.sources[KIND] for signal in signals.values()})
    layout.refuse_long_rows()
    columns = {name: layout.column(signal.sources[KIND], name) for name, signal in signals.items()}
    with path.open("rb") as file:
        size = file.seek(0, io.SEEK_END)
        end, nul = (size, 0) if layout.wide else last_whole_line(file, size)
    refuse_long_lines(path, end)
    table = _Table(layout=layout, columns=columns, signals=signals, end=end, size=size)
    frame, left_out = _read(table)
    if not len(frame):
        raise LogError("has a header but no rows.", where=path, mend="Leave it out.")
    time = table.time(frame)
    clock = signals["time"].sources[KIND]
    channels = {}
    for name, signal in signals.items():
        at = columns[name]
        if name == "time" or at not in frame:
            continue
        values = time if at == columns["time"] else frame[at].to_numpy(dtype=np.float64)
        channels[name] = Channel(source=signal.sources[KIND], clock=clock, time=time, values=values)
    return RawLog(
        channels=channels,
        place=lambda _, row: f"line {table.line(row)}",
        remarks=(*_cut(size - nul - end, nul), *left_out),
        epoch=table.epoch(frame, time),
    )


def _read(table: _Table) -> tuple[pd.DataFrame, list[Remark]]:
    """The wanted columns, and what is said of those that hold text and that a log may lack."""
    left_out: list[Remark] = []
    while True:
        try:
            return table.read(), left_out
        except _NoNumberError as error:
            if not table.signals[error.signal].optional or len(left_out) == _MOST_LEFT_OUT:
                raise
            left_out.append(Remark(kind="skipped", count=1, text=str(error)))
            columns = {name: at for name, at in table.columns.items() if at != table.columns[error.signal]}
            table = replace(table, columns=columns)


class _NoNumberError(LogError):
    """A cell that holds no number; ``signal`` is what it would be of."""

    signal = ""


def _cut(line: int, nul: int) -> tuple[Remark, ...]:
    if not line and not nul:
        return ()
    parts = []
    if line:
        parts.append(f"a last line of {line} bytes without an end")
    if nul:
        parts.append(f"{nul} NUL bytes")
    text = f"The file ends in {' and '.join(parts)}, as a crash leaves it; that was left out."
    return (Remark(kind="truncated", count=line + nul, text=text),)


@dataclass(frozen=True, kw_only=True)
class _Table:
    """The file, and where in it the wanted numbers are."""

    layout: Layout
    columns: Mapping[str, int]
    signals: Mapping[str, Signal]
    end: int
    size: int

    def read(self) -> pd.DataFrame:
        """The wanted columns as float64; time as int64 or text where a float would lose digits."""
        for kind, decimal, spaces in self._attempts():
            kinds = {**dict.fromkeys(self.columns.values(), "float64"), self.columns["time"]: kind}
            try:
                return self._parse(kinds, decimal, spaces=spaces)
            except (ValueError, TypeError, OverflowError) as error:  # pandas' own errors are among them
                reason = error
        raise self._complaint(str(reason)) from reason

    def _attempts(self) -> Iterator[tuple[str, str, bool]]:
        """(type of the time, decimal sign, whether to drop spaces before cells), the likely first.

        Dropping spaces costs pandas 40 % more time, and numbers do not need it; empty cells and quotes do.
        """
        kind, decimal = self._time_kind(), self.decimal
        yield kind, decimal, self.layout.spaced
        yield kind, decimal, True
        if decimal == "." and self.layout.delimiter != ",":
            yield kind, ",", True
        if kind == "int64":
            yield "Int64", decimal, True
            yield "float64", decimal, True

    @property
    def decimal(self) -> str:
        return self.layout.decimal(self.columns.values())

    def _time_kind(self) -> str:
        at = self.columns["time"]
        cells = [row[at].strip() for row in self.layout.rows if at < len(row)]
        cell = next((cell for cell in cells if cell not in _MISSING), "0")
        if self.signals["time"].unit == "iso8601" or not _is_number(cell, self.decimal):
            return "str"
        if cell.isdigit() and len(cell) >= _LONG_INTEGER:
            return "int64"
        return "float64"

    def _parse(self, kinds: Mapping[int, str], decimal: str, *, spaces: bool) -> pd.DataFrame:
        direct = self.layout.plain and not self.layout.wide and self.end == self.size
        opened = _nothing() if direct else self._body()
        with np.errstate(all="ignore"), opened as body:
            frame = pd.read_csv(
                body or str(self.layout.path),  # pandas reads a path in bytes, faster than a file in text
                engine="c",
                sep=self.layout.delimiter,
                decimal=decimal,
                header=self.layout.before if direct else None,
                # Not numbers: where there are no rows pandas takes those for places among the columns that it keeps.
                names=list(map(str, range(self.layout.width))),
                index_col=False,
                usecols=list(map(str, sorted(set(kinds)))),
                dtype={str(at): kind for at, kind in kinds.items()},
                keep_default_na=False,
                na_values=[word + space for word in _MISSING for space in ("", " ")],
                skipinitialspace=spaces,
                encoding="utf-8",
                encoding_errors="replace",
            )
            frame.columns = pd.Index(map(int, frame.columns))
            return frame

    @contextmanager
    def _body(self) -> Iterator[IO[str]]:
        """The rows between the header and the end of the last whole line."""
        if self.layout.wide:
            text = self.layout.path.read_bytes().decode(self.layout.encoding, errors="replace")
            yield io.StringIO(text[self.layout.offset : _last_end(text)])
            return
        with self.layout.path.open("rb") as file:
            rows = _Slice(file, self.layout.offset, self.end)
            yield io.TextIOWrapper(io.BufferedReader(rows, 1 << 18), encoding="utf-8", errors="replace", newline="")

    def time(self, frame: pd.DataFrame) -> FloatArray:
        """(n,) s; NaN where missing."""
        signal = self.signals["time"]
        column = frame[self.columns["time"]]
        return column_to_seconds(
            column, signal.sources[KIND], signal.unit, lambda row: f"{self.layout.path}:{self.line(row)}"
        )

    def epoch(self, frame: pd.DataFrame, time: FloatArray) -> float | None:
        """Seconds since 1970 of time zero; None where nobody knows."""
        signal = self.signals["time"]
        return epoch_of(frame[self.columns["time"]], time, signal.sources[KIND], signal.unit)

    def line(self, row: int) -> int:
        """Number, from 1, of the line in the file that holds the data row ``row``; slow, for messages only."""
        number, _ = next(islice(self._rows(), row, None), (0, []))
        return number

    def _rows(self) -> Iterator[tuple[int, list[str]]]:
        """(line number, cells) of each data row."""
        first = self.layout.lines + 1
        with self._body() as body:
            reader = csv.reader(body, delimiter=self.layout.delimiter, skipinitialspace=True)
            while True:
                number = first + reader.line_num
                try:
                    cells = next(reader)
                except StopIteration:
                    return
                except csv.Error as error:  # a cell beyond the module's limit
                    raise LogError(
                        "has a cell of more than 100 000 characters; a number was expected.",
                        where=f"{self.layout.path}:{number}",
                        mend="Look for a quotation mark that is opened in this row and never closed.",
                    ) from error
                if len(cells) > 1 or any(cell.strip() for cell in cells):
                    yield number, cells

    def _complaint(self, reason: str) -> LogError:
        """The first wanted cell that is no number, found by a slow second look."""
        numeric = {at: name for name, at in self.columns.items()}
        if self._time_kind() == "str":
            numeric = {at: name for name, at in self.columns.items() if name != "time"}
        decimal = self.decimal
        for number, cells in self._rows():
            for at, name in numeric.items():
                cell = cells[at].strip() if at < len(cells) else ""
                if cell not in _MISSING and not _is_number(cell, decimal):
                    error = _NoNumberError(
                        f"{self.signals[name].sources[KIND]} is {_short(cell)}, a number was expected.",
                        where=f"{self.layout.path}:{number}",
                        mend="Delete the row or leave the cell empty.",
                    )
                    error.signal = name
                    return error
        return LogError(f"cannot be read as a table ({reason.strip()}).", where=self.layout.path)


def _is_number(cell: str, decimal: str) -> bool:
    try:
        return "_" not in cell and not math.isnan(float(cell.replace(decimal, ".")))
    except ValueError:
        return False


def _short(cell: str) -> str:
    if len(cell) > 40:
        cell = cell[:40] + "…"
    return repr(cell)


def _last_end(text: str) -> int:
    return max(text.rfind("\n"), text.rfind("\r")) + 1


@contextmanager
def _nothing() -> Iterator[None]:
    yield None


class _Slice(io.RawIOBase):
    """Bytes ``start`` to ``end`` of a file."""

    def __init__(self, file: IO[bytes], start: int, end: int) -> None:
        self._file, self._left = file, max(0, end - start)
        file.seek(start)

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        count = self._file.readinto(memoryview(buffer)[: self._left])  # type: ignore[attr-defined]  # a raw file has it
        self._left -= count
        return int(count)


def sources(path: Path) -> LogContents:
    """The column of the clock, empty if none looks like one, and every other column that begins with numbers.

    Raises
    ------
    LogError
        It is no table, or none of its columns is a time.
    """
    layout = read_layout(path, ())
    twice = {name for name, count in Counter(layout.names).items() if count > 1}
    numbers: dict[str, FloatArray] = {}
    rising = []
    for at, name in enumerate(layout.names):
        if not name or name in twice:
            continue
        values = _numbers([row[at] for row in layout.rows if at < len(row)], layout)
        if values is not None:
            numbers[name] = values
        # What is no number may be a time in words.
        if values is None or _rises(values):
            rising.append(name)
    clock = _clock(rising, numbers, layout)
    if numbers and not clock:
        raise LogError(
            "holds no column that could be the time: none only grows.",
            where=path,
            mend="Export the log with a column of times, or leave it out.",
        )
    return LogContents(
        clock=clock,
        sources=tuple(name for name in numbers if name != clock),
        unreadable=tuple(f"{path}: several columns are named {name!r}; none was looked at." for name in sorted(twice)),
    )


def _clock(rising: Sequence[str], numbers: Mapping[str, FloatArray], layout: Layout) -> str:
    """The likeliest of the columns that only grow, empty if there is none.

    By its name, else one of dates and times of day, else the first of numbers that does not count rows.
    """
    called = [name for name in rising if name_words(name) & CLOCK_WORDS]
    likely = [name for name in called if not name_words(name) & NOT_CLOCK]
    texts = [name for name in rising if name not in numbers]
    dated = [name for name in texts if all(map(_ISO.match, _cells(layout, name)))]
    unnamed = [name for name in rising if name in numbers]
    lasting = [name for name in unnamed if not _counts(numbers[name])]
    plain = [name for name in likely or called if name in numbers or name in dated]
    return next(iter(plain or dated or likely or called or lasting or unnamed), "")


def _cells(layout: Layout, name: str) -> list[str]:
    """What stands in a column, where anything does."""
    at = layout.names.index(name)
    return [row[at].strip() for row in layout.rows if at < len(row) and row[at].strip()] or [""]


def _numbers(cells: Sequence[str], layout: Layout) -> FloatArray | None:
    """(n,) what the cells hold, NaN where empty; None where one holds something else, or all are empty."""
    values = np.full(len(cells), np.nan)
    for row, cell in enumerate(cells):
        text = cell.strip()
        if layout.delimiter != ",":
            text = text.replace(",", ".")
        if text in _MISSING:
            continue
        try:
            values[row] = float(text)
        except ValueError:
            return None
    if not np.isfinite(values).any():
        return None
    return values


def _counts(values: FloatArray) -> bool:
    """Whether they are the numbers of rows."""
    known = values[np.isfinite(values)]
    return bool(np.all(np.diff(known) == 1.0) and np.all(known == np.round(known)))


def _rises(values: FloatArray) -> bool:
    known = values[np.isfinite(values)]
    return len(known) > 1 and bool(np.all(known[1:] > known[:-1]))
