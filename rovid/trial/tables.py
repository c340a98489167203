"""Small tables of numbers: thrust curves, bench readings, steady states, sine trials."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from itertools import chain
from pathlib import Path

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import ConfigError, LogError, suggestion
from rovid.core.paths import list_files, require_exists, require_regular
from rovid.core.toml import LARGEST
from rovid.trial.log_formats import FORMATS
from rovid.trial.vehicle import ThrustCurve

_FINEST = 1e-3
# Bytes: a day of bench readings, and no log.
_SIZE = 64_000_000
_LOOKED_AT = 50  # rows, of which one has to hold a number
CURVE_COLUMNS = ("command", "thrust_N")
STEADY_COLUMNS = ("yaw_rate_rad_s", "torque_Nm")
SINE_COLUMNS = ("period_s", "torque_amplitude_Nm", "peak_yaw_rate_rad_s")


@dataclass(frozen=True, kw_only=True)
class CsvTable:
    """A table as text, with the line in the file of each row."""

    path: Path
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]

    def text(self, column: str) -> list[str]:
        """Every row of ``column``.

        Raises
        ------
        LogError
            There is no such column; the nearest names are offered.
        """
        if column not in self.header:
            raise LogError(
                f"has no column {column!r}. {suggest_columns(column, self.header, self.rows)}", where=self.path
            )
        at = self.header.index(column)
        return [row[at] if at < len(row) else "" for row in self.rows]

    def numbers(self, column: str, *, empty_allowed: bool = False) -> FloatArray:
        """(n,) numbers of ``column``; NaN for empty cells where those are allowed.

        Raises
        ------
        LogError
            There is no such column, or a cell is not a number.
        """
        values = np.empty(len(self.rows))
        for k, cell in enumerate(self.text(column)):
            values[k] = _number(cell)
            may_lack = empty_allowed and not cell
            if not may_lack and not abs(values[k]) <= LARGEST:
                raise LogError(
                    f"{column} is {cell!r}, a number was expected.",
                    where=f"{self.path}:{self.lines[k]}",
                    mend="Correct the cell or delete the row.",
                )
        return values

    def resolution(self, column: str) -> FloatArray:
        """(n,) size of the last printed digit of ``column``; no smaller than a thousandth of its largest number.

        Digits beyond were printed, not read.
        """
        finest = _FINEST * float(np.max(np.abs(self.numbers(column))))
        sizes = []
        for cell in self.text(column):
            exponent = int(Decimal(cell).as_tuple().exponent)
            # Of 10 to a higher power no float is left.
            size = 10.0 ** min(exponent, 300)
            sizes.append(max(size, finest))
        return np.array(sizes)


def read_table(path: Path, *, headerless: tuple[str, ...] = ()) -> CsvTable:
    """Read a CSV with a header row; comma, semicolon or tab.

    A file whose first row is all numbers has no header: it takes the names in ``headerless``, if any.

    Raises
    ------
    LogError
        The file cannot be read or holds no rows.
    """
    require_regular(path, LogError)
    lines, texts = _telling_lines(path)
    rows = _rows(path, texts)
    if headerless and len(rows[0]) == len(headerless) and all(map(_is_number, rows[0])):
        rows.insert(0, headerless)
        lines.insert(0, 0)
    if len(rows) < 2:
        raise LogError("holds a header and no rows.", where=path)
    return CsvTable(path=path, header=rows[0], rows=tuple(rows[1:]), lines=tuple(lines[1:]))


def _telling_lines(path: Path) -> tuple[list[int], list[str]]:
    """Numbers and texts of the lines that say something."""
    telling = [(number, line) for number, line in enumerate(_content(path).splitlines(), 1) if _says_something(line)]
    if not telling:
        raise LogError("is empty.", where=path)
    return [number for number, _ in telling], [line for _, line in telling]


def _content(path: Path) -> str:
    try:
        with path.open("rb") as file:
            content = file.read(_SIZE + 1)
    except OSError as error:
        raise LogError(f"cannot be read ({error.strerror}).", where=path) from error
    if len(content) > _SIZE:
        raise LogError(f"is larger than {_SIZE / 1e6:g} MB; a table of results was expected.", where=path)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        # Vendors' sheets write the micro sign in their own code page.
        return content.decode("cp1252", errors="replace")


def _says_something(line: str) -> bool:
    """Whether a line is neither blank nor a comment."""
    return bool(line.strip()) and line[0] != "#"


def _rows(path: Path, lines: Sequence[str]) -> list[tuple[str, ...]]:
    """Cells of each line; the separator is the one that the first line has most of."""
    separator = _separator(lines[0])
    rows = []
    try:
        for cells in csv.reader(lines, delimiter=separator):
            stripped = map(str.strip, cells)
            rows.append(tuple(stripped))
    except csv.Error as error:
        raise LogError(f"is no table: {error}.", where=path) from error
    if separator == ";":
        # Where the comma does not part the cells it is the decimal sign.
        return [tuple(cell.replace(",", ".") for cell in row) for row in rows]
    return rows


def _separator(line: str) -> str:
    return max(",;\t", key=line.count)


def suggest_columns(wanted: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Which columns come near ``wanted``, or what stands in place of a table.

    A file that is no table of numbers may be anybody's: a password file that rovid.toml names for a thrust curve. What
    it holds is not repeated.
    """
    numbers = any(_is_number(cell.replace(",", ".")) for row in rows[:_LOOKED_AT] for cell in row)
    if len(header) < 2 or not numbers:
        return "It is no table of numbers under the names of two columns or more."
    return suggestion(wanted, header)


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return math.nan


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def column_names(path: Path) -> tuple[str, ...]:
    """Column names of a CSV; empty where it cannot be read as text."""
    try:
        with path.open("rb") as stream:
            start = stream.read(4096).decode("utf-8-sig", errors="replace")
    except OSError:
        return ()
    first = next(filter(_says_something, start.splitlines()), "")
    if not first:
        return ()
    return tuple(cell.strip().strip('"') for cell in first.split(_separator(first)))


def find_table(paths: Sequence[Path], columns: Sequence[str]) -> Path | None:
    """The first table with all ``columns`` among ``paths`` and in their folders; None where there is a log too.

    Raises
    ------
    LogError
        One of ``paths`` is neither file nor folder.
    """
    for path in paths:
        require_exists(path, LogError)
    inside = {path: list_files(path, lambda _: None).files for path in paths}
    if any(map(_is_log, chain.from_iterable(inside.values()))):
        return None
    for path, files in inside.items():
        for file in files:
            near = path in (file, file.parent)
            if near and file.suffix.lower() == ".csv" and set(columns) <= set(column_names(file)) and _is_table(file):
                return file
    return None


def _is_log(path: Path) -> bool:
    """Whether it makes a folder one of logs and not of tables; a CSV may be either."""
    suffix = path.suffix.lower()
    return suffix in FORMATS and not (suffix == ".csv" and _is_table(path))


def _is_table(path: Path) -> bool:
    """Whether a CSV is one of the tables rovid knows, which a time column would make a log."""
    names = column_names(path)
    if any(name.lower().startswith(("time", "t_s", "stamp")) for name in names):
        return False
    return any(set(columns) <= set(names) for columns in (CURVE_COLUMNS, STEADY_COLUMNS, SINE_COLUMNS))


def curve_csv(command: FloatArray, thrust: FloatArray) -> str:
    """A thrust curve as CSV; the quotes in its header are the mark of what rovid wrote."""
    rows = [f"{c:.10g},{t:.7g}" for c, t in zip(command, thrust, strict=True)]
    first, second = CURVE_COLUMNS
    return "\n".join([f'"{first}",{second}', *rows]) + "\n"


def read_curve(path: Path) -> ThrustCurve:
    """Thrust curve from a CSV with the columns command and thrust_N.

    Raises
    ------
    RovidError
        The file is missing, has other columns, text in a number, fewer than two points or a repeated command.
    """
    _require_curve(path)
    table = read_table(path)
    command, thrust = map(table.numbers, CURVE_COLUMNS)
    order = np.argsort(command, kind="stable")
    command, thrust = command[order], thrust[order]
    if len(command) < 2 or np.any(np.diff(command) <= 0):
        text = f"has {len(command)} points, some at one command; two or more different commands were expected."
        mend = "`rovid fit-thruster` turns repeated bench readings into a curve."
        raise ConfigError(text, where=path, mend=mend)
    return ThrustCurve(command=command, thrust=thrust)


def _require_curve(path: Path) -> None:
    require_regular(path)
    if not path.is_file():
        mend = f"Make one from bench readings with `rovid fit-thruster BENCH.csv -o {path.name}`."
        raise ConfigError("there is no such thrust curve.", where=path, mend=mend)
