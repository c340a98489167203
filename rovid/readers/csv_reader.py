"""CSV tables: one row an instant, any column names, any usual notation of numbers and times."""

from __future__ import annotations

import csv
import io
import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from itertools import islice, product
from pathlib import Path
from typing import IO

import numpy as np
import pandas as pd

from rovid.core.array_types import FloatArray
from rovid.core.errors import LogError
from rovid.readers.csv_dialect import Layout, last_whole_line, read_layout
from rovid.readers.raw_log import Channel, FilePart, LogContents, RawLog, required_signals, required_time
from rovid.readers.timestamps import column_to_seconds, start_epoch
from rovid.trial.config import Config
from rovid.trial.signal_names import CLOCK_WORDS, NOT_CLOCK, Signal, name_words
from rovid.trial.trial import Remark

KIND = "csv"
# Beginning of a date, or of a date and a time of day.
_ISO = re.compile(r"\d{4}-\d{2}-\d{2}([T ]\d{2}:\d{2}|$)")
_MISSING = ("", "nan", "NaN", "NAN", "-nan")
# Digits from which on a float64 cannot hold an integer: nanoseconds since 1970.
_LONG_INTEGER = 16
# Number of optional columns with text that are left out; each costs another pass over the file.
_MAX_LEFT_OUT = 8
# Between the columns of seconds and of nanoseconds of one clock: "s + ns"; endings of their names; name of the second.
_SPLIT, _FRACTION = " + ", "time of nanoseconds"
_SECONDS, _NANOSECONDS = ("s", "sec", "secs", "seconds"), ("ns", "nsec", "nsecs", "nanosec", "nanosecs", "nanoseconds")


def read(path: Path, config: Config) -> RawLog:
    """Mapped columns of ``path``."""
    signals = {"time": required_time(config, KIND), **required_signals(config, KIND, path)}
    clock, unit = signals["time"].sources[KIND], signals["time"].unit
    layout = read_layout(path, {signal.sources[KIND] for signal in signals.values()})
    layout.refuse_long_rows()
    whole, split, fraction = clock.partition(_SPLIT)
    if split and clock not in layout.titles:
        signals["time"] = replace(signals["time"], sources={KIND: whole})
        signals[_FRACTION] = replace(signals["time"], sources={KIND: fraction}, optional=False)
    columns = {name: layout.column(signal.sources[KIND], name) for name, signal in signals.items()}
    with path.open("rb") as file:
        size = file.seek(0, io.SEEK_END)
        end, nul = (size, 0) if layout.wide else last_whole_line(file, size)
    table = _Table(layout=layout, columns=columns, signals=signals, end=end, size=size)
    frame, skipped = _read_columns(table)
    if not len(frame):
        raise LogError("has a header but no rows.", where=path, mend="Leave it out.")
    column = frame[columns["time"]]
    if _FRACTION in columns:
        # Nanoseconds since 1970 do not fit a float.
        whole_seconds, nanoseconds = (frame[columns[name]].astype("Int64") for name in ("time", _FRACTION))
        column, unit = whole_seconds * 10**9 + nanoseconds, "ns"
    time = column_to_seconds(column, clock, unit, lambda row: f"{path}:{table.line(row)}")
    channels = {}
    for name, signal in signals.items():
        at = columns[name]
        if name in {"time", _FRACTION} or at not in frame:
            continue
        values = time if at == columns["time"] else frame[at].to_numpy(dtype=np.float64)
        channels[name] = Channel(source=signal.sources[KIND], clock=clock, time=time, values=values)
    return RawLog(
        channels=channels,
        place=lambda _, row: f"line {table.line(row)}",
        remarks=(*_cut_remarks(size - nul - end, nul), *skipped),
        epoch=start_epoch(column, time, clock, unit),
    )


def _read_columns(table: _Table) -> tuple[pd.DataFrame, list[Remark]]:
    """The mapped columns without optional ones that hold text, and remarks on these."""
    skipped: list[Remark] = []
    while True:
        try:
            return table.read(), skipped
        except _NoNumberError as error:
            if not table.signals[error.signal].optional or len(skipped) == _MAX_LEFT_OUT:
                raise
            skipped.append(Remark(kind="skipped", count=1, text=str(error)))
            columns = {name: at for name, at in table.columns.items() if at != table.columns[error.signal]}
            table = replace(table, columns=columns)


class _NoNumberError(LogError):
    """A cell of ``signal`` holds no number."""

    signal = ""


def _cut_remarks(line: int, nul: int) -> tuple[Remark, ...]:
    parts = [f"a last line of {line} bytes without an end"] * bool(line) + [f"{nul} NUL bytes"] * bool(nul)
    text = f"The file ends in {' and '.join(parts)}, as a crash leaves it; that part was left out."
    return (Remark(kind="truncated", count=line + nul, text=text),) * bool(parts)


@dataclass(frozen=True, kw_only=True)
class _Table:
    """The rows of a file up to the byte ``end`` of ``size``, and the index of each signal's column."""

    layout: Layout
    columns: Mapping[str, int]
    signals: Mapping[str, Signal]
    end: int
    size: int

    def read(self) -> pd.DataFrame:
        """The columns as float64; the time as int64 or text where a float would lose digits."""
        for time_type, decimal, skip_spaces in self._attempts():
            types = {**dict.fromkeys(self.columns.values(), "float64"), self.columns["time"]: time_type}
            try:
                return self._parse(types, decimal, skip_spaces=skip_spaces)
            except (ValueError, TypeError, OverflowError) as error:  # pandas' errors are subclasses.
                reason = error
        raise self._error(str(reason)) from reason

    def _attempts(self) -> Iterator[tuple[str, str, bool]]:
        """(type of the time, decimal sign, whether to skip spaces before cells), the most likely first.

        Skipping spaces costs pandas 40 % more time. Empty cells and quotes need it, numbers do not.
        """
        time_type, decimal = self._time_type(), self.decimal
        yield time_type, decimal, self.layout.spaced
        yield time_type, decimal, True
        if decimal == "." and self.layout.delimiter != ",":
            yield time_type, ",", True
        if time_type == "int64":
            yield "Int64", decimal, True
            yield "float64", decimal, True

    @property
    def decimal(self) -> str:
        """Decimal sign of the columns."""
        return self.layout.decimal(self.columns.values())

    def _time_type(self) -> str:
        at = self.columns["time"]
        cells = [row[at].strip() for row in self.layout.rows if at < len(row)]
        cell = next((cell for cell in cells if cell not in _MISSING), "0")
        if self.signals["time"].unit == "iso8601" or not _is_number(cell, self.decimal):
            return "str"
        if cell.isdigit() and len(cell) >= _LONG_INTEGER:
            return "int64"
        return "float64"

    def _parse(self, types: Mapping[int, str], decimal: str, *, skip_spaces: bool) -> pd.DataFrame:
        # pandas reads a path in bytes, which is faster than a text file.
        direct = self.layout.plain and not self.layout.wide and self.end == self.size
        opened = nullcontext(str(self.layout.path)) if direct else self._body()
        with np.errstate(all="ignore"), opened as body:
            frame = pd.read_csv(
                body,
                engine="c",
                sep=self.layout.delimiter,
                decimal=decimal,
                header=self.layout.before if direct else None,
                # Texts, because pandas takes integers for positions among the used columns if there are no rows.
                names=list(map(str, range(self.layout.width))),
                index_col=False,
                usecols=list(map(str, sorted(set(types)))),
                dtype={str(at): kind for at, kind in types.items()},
                keep_default_na=False,
                na_values=[word + space for word in _MISSING for space in ("", " ")],
                skipinitialspace=skip_spaces,
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
            yield io.StringIO(text[self.layout.offset : max(text.rfind("\n"), text.rfind("\r")) + 1])
            return
        with self.layout.path.open("rb") as file:
            rows = FilePart(file, self.layout.offset, self.end - self.layout.offset)
            yield io.TextIOWrapper(io.BufferedReader(rows, 1 << 18), encoding="utf-8", errors="replace", newline="")

    def line(self, row: int) -> int:
        """Line number, from 1, of a data row; slow, for messages."""
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
                except csv.Error as error:  # A cell beyond the module's limit.
                    text = "has a cell of more than 100 000 characters; a number was expected."
                    mend = "Look for a quotation mark that is opened in this row and never closed."
                    raise LogError(text, where=f"{self.layout.path}:{number}", mend=mend) from error
                if len(cells) > 1 or any(cell.strip() for cell in cells):
                    yield number, cells

    def _error(self, reason: str) -> LogError:
        """Error for the first cell that is no number, found by a second, slow pass."""
        numeric = {at: name for name, at in self.columns.items()}
        if self._time_type() == "str":
            numeric = {at: name for name, at in self.columns.items() if name != "time"}
        decimal = self.decimal
        for number, cells in self._rows():
            for at, name in numeric.items():
                cell = cells[at].strip() if at < len(cells) else ""
                if cell not in _MISSING and not _is_number(cell, decimal):
                    shown = cell[:40] + "…" if len(cell) > 40 else cell
                    error = _NoNumberError(
                        f"{self.signals[name].sources[KIND]} is {shown!r}, a number was expected.",
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


def sources(path: Path) -> LogContents:
    """The time column, empty if none looks like a time, and every other column that begins with numbers."""
    layout = read_layout(path, ())
    repeated = {name for name, count in Counter(layout.names).items() if count > 1}
    numbers: dict[str, FloatArray] = {}
    increasing = []
    for at, name in enumerate(layout.names):
        if not name or name in repeated:
            continue
        values = _numbers([row[at] for row in layout.rows if at < len(row)], layout)
        if values is not None:
            numbers[name] = values
        # A column of text may hold dates.
        if values is None or _is_increasing(values):
            increasing.append(name)
    clock = _split_clock(numbers) or _guess_clock(increasing, numbers, layout)
    if numbers and not clock:
        text = "holds no column that could be the time: none only grows."
        raise LogError(text, where=path, mend="Export the log with a column of times, or leave it out.")
    return LogContents(
        clock=clock,
        sources=tuple(name for name in numbers if name not in {clock, *clock.split(_SPLIT)}),
        unreadable=tuple(f"{path}: several columns are named {name!r}; none was used." for name in sorted(repeated)),
    )


def _split_clock(numbers: Mapping[str, FloatArray]) -> str:
    """Columns of whole seconds and of nanoseconds that form one clock, as "s + ns"; empty if there are none."""
    for name, seconds in numbers.items():
        for ending, nano in product(_SECONDS, _NANOSECONDS):
            other = name.removesuffix(ending) + nano
            if name.endswith(ending) and other in numbers and np.all(seconds == np.round(seconds)):
                nanoseconds = numbers[other]
                if nanoseconds.min() >= 0.0 and 1e6 < nanoseconds.max() < 1e9 and np.all(np.diff(seconds) >= 0.0):
                    return f"{name}{_SPLIT}{other}"
    return ""


def _guess_clock(increasing: Sequence[str], numbers: Mapping[str, FloatArray], layout: Layout) -> str:
    """The most likely time among ``increasing`` columns, empty if there is none.

    The order of preference: by its name; dates and times of day; the first column of numbers that does not count rows.
    """
    named = [name for name in increasing if name_words(name) & CLOCK_WORDS]
    likely = [name for name in named if not name_words(name) & NOT_CLOCK]
    dated = [name for name in increasing if name not in numbers and _holds_dates(layout, name)]
    numeric = [name for name in increasing if name in numbers]
    uneven = [name for name in numeric if not _counts_rows(numbers[name])]
    plain = [name for name in likely or named if name in numbers or name in dated]
    return next(iter(plain or dated or likely or named or uneven or numeric), "")


def _holds_dates(layout: Layout, name: str) -> bool:
    at = layout.names.index(name)
    cells = [row[at].strip() for row in layout.rows if at < len(row) and row[at].strip()]
    return bool(cells) and all(map(_ISO.match, cells))


def _numbers(cells: Sequence[str], layout: Layout) -> FloatArray | None:
    """(n,) numbers, NaN where empty; None if a cell holds text, or all are empty."""
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


def _counts_rows(values: FloatArray) -> bool:
    known = values[np.isfinite(values)]
    return bool(np.all(np.diff(known) == 1.0) and np.all(known == np.round(known)))


def _is_increasing(values: FloatArray) -> bool:
    known = values[np.isfinite(values)]
    return len(known) > 1 and bool(np.all(known[1:] > known[:-1]))
