"""CSV tables: one row an instant, any column names, any usual notation of numbers and times."""

import csv
import io
import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import IO

import numpy as np
import pandas as pd

from rovid.core.array_types import FloatArray
from rovid.core.errors import LogError
from rovid.readers import csv_dialect, raw_log
from rovid.readers.csv_dialect import MISSING, NOTATIONS, SPACES, Layout
from rovid.readers.timestamps import SPLIT, clock_parts, column_to_seconds, counts_rows, guess_clock, start_epoch
from rovid.trial.axis import Signal
from rovid.trial.config import Config
from rovid.trial.trial import Remark

KIND = "csv"
# Signal of the column that holds the rest of the seconds.
_REST = "time.rest"
# Beginning of a date, or of a date and a time of day.
_ISO = re.compile(r"\d{4}-\d{2}-\d{2}([T ]\d{2}:\d{2}|$)")
# Largest share of rows that hold no data, as comments.
_MOST_STRAY = 0.1
# Digits from which on a float64 cannot hold an integer: nanoseconds since 1970.
_LONG_INTEGER = 16
# Number of optional columns with text that are left out; each costs another pass over the file.
_MAX_LEFT_OUT = 8


def read(path: Path, config: Config) -> raw_log.RawLog:
    """Mapped columns of ``path``."""
    mapped = raw_log.required_signals(config, KIND, path)
    signals = {"time": raw_log.required_time(config, KIND), **mapped}
    layout = csv_dialect.read_layout(path, {signal.sources[KIND] for signal in signals.values()})
    layout = layout.without_stray_rows()
    signals = raw_log.split_orientations(signals, layout.written_names, KIND)
    clock, unit = signals["time"].sources[KIND], signals["time"].unit
    parts = clock_parts(clock, layout.written_names)
    if parts is not None:
        signals["time"] = replace(signals["time"], sources={KIND: parts.seconds})
        signals[_REST] = replace(signals["time"], sources={KIND: parts.rest}, optional=not parts.is_named)
    columns = {name: layout.column(signal.sources[KIND], name) for name, signal in signals.items()}
    with path.open("rb") as file:
        size = file.seek(0, io.SEEK_END)
        end, nul = (size, 0) if layout.wide else csv_dialect.last_whole_line(file, size)
    table = _Table(layout=layout, columns=columns, signals=signals, end=end, size=size)
    frame, skipped = _read_columns(table)
    if not len(frame):
        raise LogError("has a header but no rows.", where=path, mend="Leave it out.")
    column = frame[columns["time"]]
    named, unit = layout.names[columns["time"]], unit if parts is None else "s"
    time = column_to_seconds(column, named, unit, lambda row: f"{path}:{table.line(row)}")
    epoch = start_epoch(column, time, named, unit)
    if parts is not None and columns[_REST] in frame:
        time, epoch = parts.joined(time, frame[columns[_REST]].to_numpy(dtype=np.float64), epoch, path)
    channels = {}
    for name, signal in signals.items():
        at = columns[name]
        if name in {"time", _REST} or at not in frame:
            continue
        values = time if at == columns["time"] else frame[at].to_numpy(dtype=np.float64)
        channels[name] = raw_log.Channel(source=signal.sources[KIND], clock=clock, time=time, values=values)
    channels = raw_log.join_orientations(channels, mapped, KIND)
    cut = size - nul - end
    if cut or nul:
        ends = [f"a last line of {cut} bytes without an end"] * bool(cut) + [f"{nul} NUL bytes"] * bool(nul)
        text = f"The file ends in {' and '.join(ends)}, as a crash leaves it; that part was left out."
        skipped.insert(0, Remark(kind="truncated", count=cut + nul, text=text))
    return raw_log.RawLog(
        channels=channels, place=lambda _, row: f"line {table.line(row)}", remarks=tuple(skipped), epoch=epoch
    )


def _read_columns(table: "_Table") -> tuple[pd.DataFrame, list[Remark]]:
    """The mapped columns without optional ones that hold text, and remarks on these."""
    skipped: list[Remark] = []
    if table.has_surplus_cells():
        table = _without_stray_rows(table, skipped)
    while True:
        try:
            return table.read(), skipped
        except LogError as error:
            if (rest := _without_stray_rows(table, skipped)) is not table:
                table = rest
                continue
            if not isinstance(error, _NoNumberError):
                raise
            if not table.signals[error.signal].optional or len(skipped) == _MAX_LEFT_OUT:
                raise
            skipped.append(Remark(kind="skipped", count=1, text=str(error)))
            columns = {name: at for name, at in table.columns.items() if at != table.columns[error.signal]}
            table = replace(table, columns=columns)


def _without_stray_rows(table: "_Table", skipped: list[Remark]) -> "_Table":
    """The table without rows that hold no data, with a remark on them; the table itself if there are none."""
    if table.has_stray_rows or not (stray := table.stray_rows()):
        return table
    number, shown = stray[0][0], table.layout.delimiter.join(stray[0][1])[:40]
    text = f"{len(stray)} rows hold a comment, a header or more cells than the header, as by a decimal comma or by two "
    text += f"rows in one; left out. The first, line {number}: {shown}."
    skipped.append(Remark(kind="skipped", count=len(stray), text=text))
    return replace(table, has_stray_rows=True)


class _NoNumberError(LogError):
    """A cell of ``signal`` holds no number."""

    signal = ""


@dataclass(frozen=True, kw_only=True)
class _Table:
    """The rows of a file up to the byte ``end`` of ``size``, and the index of each signal's column."""

    layout: Layout
    columns: Mapping[str, int]
    signals: Mapping[str, Signal]
    end: int
    size: int
    has_stray_rows: bool = False  #: Whether rows without data are left out, which takes another pass.

    def read(self) -> pd.DataFrame:
        """The columns as float64; the time as int64 or text where a float would lose digits."""
        for time_type, decimal, skip_spaces in self._attempts():
            types = {**dict.fromkeys(self.columns.values(), "float64"), self.columns["time"]: time_type}
            try:
                return self._parse(types, decimal, skip_spaces=skip_spaces)
            except (ValueError, TypeError, OverflowError) as error:  # pandas' errors are subclasses.
                reason = error
        if (frame := self._grouped()) is not None:
            return frame
        raise self._error(str(reason)) from reason

    def _attempts(self) -> Iterator[tuple[str, str, bool]]:
        """(type of the time, decimal sign, whether to skip spaces before cells), the most likely first.

        Skipping spaces costs pandas 40 % more time. Empty cells and quotes need it, numbers do not.
        """
        time_type, decimal = self._time_type(), self.layout.decimal(self.columns.values())
        yield time_type, decimal, self.layout.spaced
        yield time_type, decimal, True
        if decimal == "." and self.layout.delimiter != ",":
            yield time_type, ",", True
        if time_type == "int64":
            yield "Int64", decimal, True
            yield "float64", decimal, True

    def _time_type(self) -> str:
        at = self.columns["time"]
        cells = [row[at].strip() for row in self.layout.rows if at < len(row)]
        cell = next((cell for cell in cells if cell not in MISSING), "0")
        is_numeric = any(_is_number(cell, sign) for sign in ".,") or csv_dialect.has_thousands(cell)
        if self.signals["time"].unit == "iso8601" or not is_numeric:
            return "str"
        if cell.isdigit() and len(cell) >= _LONG_INTEGER:
            return "int64"
        return "float64"

    def _parse(self, types: Mapping[int, str], decimal: str, *, skip_spaces: bool) -> pd.DataFrame:
        # pandas reads a path in bytes, which is faster than a text file.
        direct = self.layout.plain and not self.layout.wide and self.end == self.size and not self.has_stray_rows
        opened: AbstractContextManager[str | IO[str]] = nullcontext(str(self.layout.path)) if direct else self._body()
        if self.has_stray_rows:
            opened, rows = (text := io.StringIO()), (row for _, row in self._rows())
            csv.writer(text, delimiter=self.layout.delimiter, lineterminator="\n").writerows(rows)
            text.seek(0)
        with np.errstate(all="ignore"), opened as source:
            frame = pd.read_csv(
                source,
                engine="c",
                sep=r"\s+" if self.layout.delimiter == SPACES else self.layout.delimiter,
                decimal=decimal,
                header=self.layout.before if direct else None,
                # Texts, because pandas takes integers for positions among the used columns if there are no rows.
                names=list(map(str, range(self.layout.width))),
                index_col=False,
                usecols=list(map(str, sorted(set(types)))),
                dtype={str(at): kind for at, kind in types.items()},
                keep_default_na=False,
                na_values=[word + space for word in MISSING for space in ("", " ")],
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
            rows = raw_log.FilePart(file, self.layout.offset, self.end - self.layout.offset)
            yield io.TextIOWrapper(io.BufferedReader(rows, 1 << 18), encoding="utf-8", errors="replace", newline="")

    def has_surplus_cells(self) -> bool:
        """Whether there are more delimiters than the columns need, in quotes included."""
        if self.layout.wide or self.layout.delimiter == SPACES:
            return False
        delimiters, lines, block = 0, 0, b""
        with self.layout.path.open("rb") as file:
            rows = raw_log.FilePart(file, self.layout.offset, self.end - self.layout.offset)
            while more := rows.read(1 << 20):
                block = more
                delimiters += block.count(self.layout.delimiter.encode())
                lines += block.count(b"\n")
        lines += not block.endswith(b"\n")
        return delimiters > (self.layout.width - 1) * lines

    def stray_rows(self) -> list[tuple[int, list[str]]]:
        """Line number and cells of each row without data; empty if there are so many that the table is none."""
        every = list(self._rows())
        stray = [each for each in every if self.layout.is_stray(each[1])]
        return stray if len(stray) <= _MOST_STRAY * len(every) else []

    def _grouped(self) -> pd.DataFrame | None:
        """The columns, from numbers with thousands separators; None if there are none, or their notation is open."""
        places = sorted(set(self.columns.values()))
        cells: dict[int, list[str]] = {at: [] for at in places}
        for _, row in self._rows():
            for at, column in cells.items():
                cell = row[at].strip() if at < len(row) else ""
                column.append("" if cell in MISSING else cell)
        clock = self.columns["time"]
        numeric = [at for at in places if at != clock or self._time_type() != "str"]
        if not any(csv_dialect.has_thousands(cell) for at in numeric for cell in cells[at]):
            return None
        numbers = csv_dialect.read_grouped(
            [cells[at] for at in numeric], numeric.index(clock) if clock in numeric else None
        )
        if numbers is None:
            return None
        return pd.DataFrame({**cells, **dict(zip(numeric, numbers, strict=True))})

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
                is_row = len(cells) > 1 or any(cell.strip() for cell in cells)
                if is_row and not (self.has_stray_rows and self.layout.is_stray(cells)):
                    yield number, cells

    def _error(self, reason: str) -> LogError:
        """Error for the first cell that is no number, found by a second, slow pass."""
        numeric = {at: name for name, at in self.columns.items()}
        if self._time_type() == "str":
            numeric = {at: name for name, at in self.columns.items() if name != "time"}
        decimal = self.layout.decimal(self.columns.values())
        filled: set[str] = set()
        for number, cells in self._rows():
            for at, name in numeric.items():
                cell = cells[at].strip() if at < len(cells) else ""
                if cell not in MISSING and not _is_number(cell, decimal):
                    shown = cell[:40] + "…" if len(cell) > 40 else cell
                    expected, mend = "a number", "Delete the row or leave the cell empty."
                    if name not in filled:
                        text = "If the column holds text, map another one in rovid.toml."
                        mend = f"{text} Otherwise leave the cell empty."
                    if _is_number(cell, "."):
                        expected = f"a number with the decimal sign {decimal!r} of other cells"
                    elif cell == self.layout.titles[at]:
                        expected, mend = "a number, no second header", "Split the file there: each part is a log."
                    elif csv_dialect.has_thousands(cell):
                        expected = "a number without thousands separators"
                        mend = "Which sign is the decimal one does not follow from the table: export it without them."
                    text = f"{self.signals[name].sources[KIND]} is {shown!r}, {expected} was expected."
                    error = _NoNumberError(text, where=f"{self.layout.path}:{number}", mend=mend)
                    error.signal = name
                    return error
                filled |= {name} if cell else set()
        return LogError(f"cannot be read as a table ({reason.strip()}).", where=self.layout.path)


def _is_number(cell: str, decimal: str) -> bool:
    if "_" in cell or (decimal != "." and "." in cell):
        return False
    try:
        return not math.isnan(float(cell.replace(decimal, ".")))
    except ValueError:
        return False


def sources(path: Path) -> raw_log.LogContents:
    """The time column, empty if none looks like a time, and every other column that begins with numbers."""
    layout = csv_dialect.read_layout(path, ())
    repeated = {name for name, count in Counter(layout.names).items() if count > 1}
    numbers: dict[str, FloatArray] = {}
    texts: list[str] = []
    dated: list[str] = []
    for at, name in enumerate(layout.names):
        if not name or name in repeated:
            continue
        cells = [row[at].strip() for row in layout.rows if at < len(row)]
        values = _numbers(cells, layout)
        if values is not None:
            numbers[name] = values
        elif any(cells) and all(_ISO.match(cell) for cell in cells if cell):
            dated.append(name)
        else:
            texts.append(name)  # Perhaps a time of day.
    if 2 * sum(map(csv_dialect.is_datum, layout.names)) > len(layout.names):
        text = "begins with numbers, where the names of the columns were expected."
        raise LogError(text, where=path, mend="Put a row of names in front, with one for each column.")
    clock = guess_clock(numbers, dated, texts)
    if numbers and not clock:
        text, mend = "none only grows", "Export the log with a column of times, or leave it out."
        if counts := [name for name, values in numbers.items() if counts_rows(values)]:
            text, mend = f"{counts[0]} counts rows", "Add a column of times: the count divided by the sampling rate."
        raise LogError(f"holds no column that could be the time: {text}.", where=path, mend=mend)
    whole = raw_log.orientations(tuple(numbers))
    parts = {name for each in whole.values() for name in each.values()}
    return raw_log.LogContents(
        clock=clock,
        sources=(*(name for name in numbers if name not in {clock, *clock.split(SPLIT), *parts}), *whole),
        orientations=tuple(whole),
        unreadable=tuple(f"{path}: several columns are named {name!r}; none was used." for name in sorted(repeated)),
    )


def _numbers(cells: Sequence[str], layout: Layout) -> FloatArray | None:
    """(n,) numbers, NaN where empty; None if a cell holds text, or all are empty."""
    if any(map(csv_dialect.has_thousands, cells)):
        known = ["" if cell in MISSING else cell for cell in cells]
        fitting = [one for one in (notation.numbers(known) for notation in NOTATIONS) if one is not None]
        return fitting[0] if fitting else None
    values = np.full(len(cells), np.nan)
    for row, cell in enumerate(cells):
        text = cell.replace(",", ".") if layout.delimiter != "," else cell
        if text in MISSING:
            continue
        try:
            values[row] = float(text)
        except ValueError:
            return None
    return values if np.isfinite(values).any() else None
