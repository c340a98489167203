"""Small tables of numbers: thrust curves, bench readings, steady states, sine trials."""

import csv
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import ConfigError, LogError, close_matches, quoted_list, suggestion
from rovid.core.input_files import LARGEST, list_files, read_bytes, require_exists, require_regular
from rovid.trial.log_files import is_log
from rovid.trial.vehicle import ThrustCurve

# Smallest resolution of a column, as a share of its largest number; digits beyond were printed, not read.
_FINEST = 1e-3
# Bytes; a table of a day's bench readings is smaller, a log is larger.
_MAX_SIZE = 64_000_000
# Number of first rows, one of which must hold a number in a table.
_SAMPLE_ROWS = 50
CURVE_COLUMNS = ("command", "thrust_N")
STEADY_COLUMNS = ("yaw_rate_rad_s", "torque_Nm")
# Readings of `rovid fit-thrust-scale`, next to the commands: one of them.
PULL_COLUMNS = ("force_N", "weight_N", "torque_Nm")
SINE_COLUMNS = ("period_s", "torque_amplitude_Nm", "peak_yaw_rate_rad_s")


@dataclass(frozen=True, kw_only=True)
class CsvTable:
    """A table as text, with the line number of each row."""

    path: Path
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]

    def text(self, column: str) -> list[str]:
        """Cells of ``column``; `LogError` with similar names if there is none."""
        if column not in self.header:
            mend = suggest_columns(column, self.header, self.rows)
            raise LogError(f"has no column {column!r}. {mend}", where=self.path)
        at = self.header.index(column)
        return [row[at] if at < len(row) else "" for row in self.rows]

    def numbers(self, column: str, *, empty_allowed: bool = False) -> FloatArray:
        """(n,) numbers of ``column``; NaN for empty cells if those are allowed, `LogError` for other text."""
        values = np.empty(len(self.rows))
        for k, cell in enumerate(self.text(column)):
            values[k] = float(cell) if _is_number(cell) else math.nan
            if not (empty_allowed and not cell) and not abs(values[k]) <= LARGEST:
                text = f"{column} is {cell!r}, a number was expected."
                raise LogError(text, where=f"{self.path}:{self.lines[k]}", mend="Correct the cell or delete the row.")
        return values

    def resolution(self, column: str) -> FloatArray:
        """(n,) size of the last printed digit of ``column``, at least a thousandth of its largest number."""
        finest = _FINEST * float(np.max(np.abs(self.numbers(column))))
        exponents = [int(Decimal(cell).as_tuple().exponent) for cell in self.text(column)]
        # Higher powers of ten exceed the largest float.
        return np.array([max(10.0 ** min(exponent, 300), finest) for exponent in exponents])


def read_table(path: Path, *, headerless: tuple[str, ...] = ()) -> CsvTable:
    """Read a CSV with a header row; comma, semicolon or tab.

    A file whose first row is all numbers has no header: it takes the names in ``headerless``, if any. Raises `LogError`
    if the file cannot be read or holds no rows.
    """
    content = read_bytes(path, _MAX_SIZE, "a table of results", LogError)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:  # Vendors' sheets have a micro sign in cp1252.
        text = content.decode("cp1252", errors="replace")
    numbered = [(number, line) for number, line in enumerate(text.splitlines(), 1) if _has_content(line)]
    if not numbered:
        raise LogError("is empty.", where=path)
    lines = [number for number, _ in numbered]
    separator = _separator(numbered[0][1])
    try:
        cells = csv.reader([line for _, line in numbered], delimiter=separator)
        rows = [tuple(map(str.strip, row)) for row in cells]
    except csv.Error as error:
        raise LogError(f"is no table: {error}.", where=path) from error
    if separator == ";":
        # Semicolons separate the cells where the comma is the decimal sign.
        rows = [tuple(cell.replace(",", ".") for cell in row) for row in rows]
    if headerless and len(rows[0]) == len(headerless) and all(map(_is_number, rows[0])):
        rows.insert(0, headerless)
        lines.insert(0, 0)
    if len(rows) < 2:
        raise LogError("holds a header and no rows.", where=path)
    return CsvTable(path=path, header=rows[0], rows=tuple(rows[1:]), lines=tuple(lines[1:]))


def _has_content(line: str) -> bool:
    """Whether a line is neither blank nor a comment."""
    return bool(line.strip()) and line[0] != "#"


def _separator(line: str) -> str:
    """The most frequent separator of a line."""
    return max(",;\t", key=line.count)


def suggest_columns(wanted: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Names of columns similar to ``wanted``, or that the file is no table.

    A file without numbers may hold anything, such as passwords. Its content is not repeated.
    """
    has_number = any(_is_number(cell.replace(",", ".")) for row in rows[:_SAMPLE_ROWS] for cell in row)
    if len(header) < 2 or not has_number:
        return "It is no table of numbers with a header of two or more columns."
    return suggestion(wanted, header)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def column_names(path: Path) -> tuple[str, ...]:
    """Column names of a CSV; empty where the file cannot be read as text."""
    try:
        with path.open("rb") as stream:
            start = stream.read(4096).decode("utf-8-sig", errors="replace")
    except OSError:
        return ()
    first = next(filter(_has_content, start.splitlines()), "")
    return tuple(cell.strip().strip('"') for cell in first.split(_separator(first))) if first else ()


def find_table(paths: Sequence[Path], columns: Sequence[str]) -> Path | None:
    """First table with all ``columns`` among ``paths`` and in their folders; None where there is a log, too."""
    for path in paths:
        require_exists(path, LogError)
    contents = {path: list_files(path, lambda _: None).files for path in paths}
    for file in (file for files in contents.values() for file in files):
        if is_log(file) and not (file.suffix.lower() == ".csv" and _is_known_table(file)):
            return None
    for path, files in contents.items():
        for file in files:
            is_near = path in (file, file.parent) and file.suffix.lower() == ".csv"
            if is_near and set(columns) <= set(column_names(file)) and _is_known_table(file):
                return file
    return None


def _is_known_table(path: Path) -> bool:
    """Whether a CSV has the columns of one of rovid's tables, and no time column, which a log has."""
    names = column_names(path)
    known = (CURVE_COLUMNS, STEADY_COLUMNS, SINE_COLUMNS)
    return not has_time(names) and any(set(columns) <= set(names) for columns in known)


def has_time(names: Iterable[str]) -> bool:
    """Whether one of these columns is a time by its name."""
    return any(name.lower().startswith(("time", "t_s", "stamp")) for name in names)


def curve_csv(command: FloatArray, thrust: FloatArray) -> str:
    """A thrust curve as CSV; the quotes in its header mark files written by rovid."""
    rows = [f"{c:.10g},{t:.7g}" for c, t in zip(command, thrust, strict=True)]
    first, second = CURVE_COLUMNS
    return "\n".join([f'"{first}",{second}', *rows]) + "\n"


def read_curve(path: Path) -> ThrustCurve:
    """Thrust curve from a CSV with the columns command and thrust_N, and two or more different commands."""
    require_regular(path)
    if not path.is_file():
        mend = f"Make one from bench readings with `rovid fit-thruster BENCH.csv -o {path.name}`."
        if close := close_matches(path.name, sorted(other.name for other in path.parent.glob("*.csv"))):
            mend = f"Nearest: {quoted_list(close)}. {mend}"
        raise ConfigError("there is no such thrust curve.", where=path, mend=mend)
    table = read_table(path)
    for name in CURVE_COLUMNS:
        if name not in table.header:
            text = f"has no column {name!r}. {suggest_columns(name, table.header, table.rows)}"
            mend = f"`rovid fit-thruster {path.name}` converts a table in kgf, lbf or kN to a curve in N; name its "
            raise ConfigError(text, where=path, mend=f"{mend}output as `curve` in rovid.toml.")
    return curve_of(*map(table.numbers, CURVE_COLUMNS), where=path)


def curve_of(command: FloatArray, thrust: FloatArray, *, where: Path | str) -> ThrustCurve:
    """Thrust curve through (m,) commands and thrusts in N, in any order; ``where`` they are from, for `ConfigError`."""
    order = np.argsort(command, kind="stable")
    command, thrust = command[order], thrust[order]
    if len(command) < 2 or np.any(np.diff(command) <= 0):
        text = f"has {len(command)} points, some at one command; two or more different commands were expected."
        mend = "`rovid fit-thruster` turns repeated bench readings into a curve."
        raise ConfigError(text, where=where, mend=mend)
    return ThrustCurve(command=command, thrust=thrust)
