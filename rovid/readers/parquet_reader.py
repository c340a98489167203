"""Tables by columns: Parquet files, and a pandas DataFrame or arrays in memory. Sources for CSV apply by default."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from rovid.core.array_types import BoolArray, FloatArray
from rovid.core.errors import ConfigError, LogError, suggestion
from rovid.readers import raw_log
from rovid.readers.build_trial import build
from rovid.readers.timestamps import column_to_seconds, start_epoch, to_datetimes
from rovid.trial.axis import CLOCK_WORDS, name_words
from rovid.trial.config import Config
from rovid.trial.tables import CURVE_COLUMNS, curve_of
from rovid.trial.trial import NO_FILE, Trial
from rovid.trial.vehicle import ThrustCurve

KIND = "parquet"
EXTRA = "parquet"
_MARK, _FORMAT = b"PAR1", "a Parquet file"
# MB that the mapped columns of one log may take.
_MAX_SIZE = 512
# Rows in one batch, and bytes of the read buffer.
_ROWS, _BUFFER = 1 << 16, 1 << 18
# Logical types of byte columns that hold text or numbers.
_READABLE = {"STRING", "ENUM", "DECIMAL", "FLOAT16"}


def read(path: Path, config: Config) -> raw_log.RawLog:
    """Mapped columns of ``path``; ``pose.heading`` is a column inside another."""
    signals = {"time": raw_log.required_time(config, KIND), **raw_log.required_signals(config, KIND, path)}
    raw_log.require_mark(path, _MARK, _FORMAT)
    sources = {name: signal.sources[KIND] for name, signal in signals.items()}
    clock, unit = sources["time"], signals["time"].unit
    times, columns = _columns(path, sources)
    time = column_to_seconds(times, clock, unit, lambda row: f"{path}: row {row + 1}")
    channels = {}
    for name, column in sources.items():
        if name != "time":
            channels[name] = raw_log.Channel(source=column, clock=clock, time=time, values=columns[column])
    epoch = start_epoch(times, time, clock, unit)
    return raw_log.RawLog(channels=channels, place=lambda _, row: f"row {row + 1}", epoch=epoch)


def _columns(path: Path, sources: Mapping[str, str]) -> tuple[pd.Series[Any], dict[str, FloatArray]]:
    """The time, and the other mapped columns by name; read in batches of rows, which takes little memory."""
    parquet = raw_log.require_library("pyarrow.parquet", EXTRA, path)
    clock = sources["time"]
    signals = {column: name for name, column in sources.items() if name != "time"}
    with _reading(path):
        footer = parquet.read_metadata(path)
    texts = _check_columns(path, footer, sources)
    if footer.num_rows < 1:
        raise LogError("has columns but no rows.", where=path, mend="Leave it out.")
    columns = {column: np.empty(footer.num_rows) for column in signals}
    times: list[pd.Series[Any]] = []
    at = 0
    for batch in _batches(path, list({clock: None, **signals}), texts):
        times.append(_times(path, batch[clock], clock, at))
        after = at + len(times[-1])
        if after > footer.num_rows:
            break
        for column, numbers in columns.items():
            numbers[at:after] = _numbers(path, batch[column], column, signals[column], at)
        at = after
    if at != footer.num_rows:
        raise _damaged(path, ValueError(f"its footer counts {footer.num_rows} rows"))
    # Else the pool keeps more than was read.
    raw_log.require_library("pyarrow", EXTRA, path).default_memory_pool().release_unused()
    return pd.concat(times, ignore_index=True), columns


def _check_columns(path: Path, footer: Any, sources: Mapping[str, str]) -> list[str]:
    """Mapped columns that hold text; `LogError` if one is missing, repeated or of bytes, or all are too large."""
    leaves = list(map(footer.schema.column, range(len(footer.schema.names))))
    present = [leaf.path for leaf in leaves if leaf.max_repetition_level == 0]  # Without lists.
    for name, column in sources.items():
        if column not in present:
            text = f"has no column {column!r}, which rovid.toml maps to {name}. {suggestion(column, present)}"
            raise LogError(text, where=path, mend=f"Correct the name in rovid.toml ({name}), or leave this log out.")
        if present.count(column) > 1:
            raise LogError(f"has {present.count(column)} columns {column!r} ({name}).", where=path, mend="Rename one.")
    count = sum(leaf.path in sources.values() for leaf in leaves)
    size = 8 * footer.num_rows * count >> 20
    if size > _MAX_SIZE:
        text = f"holds {footer.num_rows} rows, of which {count} columns are mapped: {size} MB unpacked; "
        text += f"at most {_MAX_SIZE} MB were expected."
        raise LogError(text, where=path, mend="Split the log, or keep every tenth row.")
    texts = []
    # Statistics of columns in the footer are not read: if they are damaged, pyarrow ends the whole process.
    for leaf in leaves:
        if leaf.path not in sources.values() or not leaf.physical_type.endswith("BYTE_ARRAY"):
            continue
        if leaf.logical_type.type not in _READABLE:
            mend = "Map another column in rovid.toml, or leave this log out."
            raise LogError(f"{leaf.path} holds bytes; numbers were expected.", where=path, mend=mend)
        if leaf.logical_type.type in {"STRING", "ENUM"}:
            texts.append(leaf.path)
    return texts


def _batches(path: Path, columns: list[str], texts: list[str]) -> Iterator[dict[str, Any]]:
    """Name -> values of ``columns``, in batches of rows; equal ``texts`` are decoded once."""
    parquet, arrow = (raw_log.require_library(one, EXTRA, path) for one in ("pyarrow.parquet", "pyarrow"))
    with _reading(path), parquet.ParquetFile(path, read_dictionary=texts, buffer_size=_BUFFER) as file:
        for batch in file.iter_batches(_ROWS, columns=columns, use_threads=False):
            table = arrow.Table.from_batches([batch])
            while any(arrow.types.is_struct(field.type) for field in table.schema):
                table = table.flatten()
            found = {}
            for name in columns:
                values = table.column(name).combine_chunks()
                found[name] = values.cast(arrow.float64()) if arrow.types.is_decimal(values.type) else values
            yield found


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Convert the exceptions of pyarrow on damaged files."""
    error = raw_log.require_library("pyarrow", EXTRA, path).ArrowException
    try:
        yield
    except (error, OSError, ValueError, LookupError, RuntimeError, MemoryError) as reason:
        raise _damaged(path, reason) from reason


def sources(path: Path) -> raw_log.LogContents:
    """The column with a clock's name, if any, and every other column of numbers."""
    raw_log.require_mark(path, _MARK, _FORMAT)
    parquet, types = (raw_log.require_library(one, EXTRA, path) for one in ("pyarrow.parquet", "pyarrow.types"))
    with _reading(path):
        schema = parquet.read_schema(path)
    counts = Counter(schema.names)
    clock = next((name for name in counts if counts[name] == 1 and name_words(name) & CLOCK_WORDS), "")
    numbers = [column.name for column in schema if types.is_integer(column.type) or types.is_floating(column.type)]
    unique = tuple(name for name in numbers if counts[name] == 1 and name != clock)
    return raw_log.LogContents(clock=clock, sources=unique)


def _damaged(path: Path, error: Exception) -> LogError:
    text = f"is a Parquet file that is cut or damaged ({str(error)[:100]}).".replace("\n", " ")
    mend = "Write it again; its index is at its end, so a part of the file cannot be read."
    return LogError(text, where=path, mend=mend)


def _times(path: Path, values: Any, name: str, before: int) -> pd.Series[Any]:
    """Time of each row; text is converted to dates. ``before``: number of rows before these."""
    column = _series(path, values.dictionary_decode() if hasattr(values, "dictionary") else values)
    if column.dtype == object:
        return to_datetimes(column, name, lambda row: f"{path}: row {before + row + 1}")
    return column


def _numbers(path: Path, values: Any, column: str, name: str, before: int) -> FloatArray:
    """(n,) numbers of a column. ``before``: number of rows before these."""
    if hasattr(values, "dictionary"):
        numbers, wrong = _to_numbers(_series(path, values.dictionary))
        # A missing cell gets the index after the last.
        codes = values.indices.fill_null(len(numbers)).to_numpy()
        numbers, wrong = np.append(numbers, np.nan)[codes], np.append(wrong, False)[codes]
    else:
        numbers, wrong = _to_numbers(_series(path, values))
    if wrong.any():
        row = int(np.argmax(wrong))
        text = f"{column} ({name}) is {str(values[row].as_py())[:40]!r}; a number was expected."
        raise LogError(text, where=f"{path}: row {before + row + 1}", mend="Delete the row or leave the cell empty.")
    return numbers


def _series(path: Path, values: Any) -> pd.Series[Any]:
    """A pandas column; 64-bit integers with missing values stay integers."""
    int64 = raw_log.require_library("pyarrow", EXTRA, path).int64()
    column = values.to_pandas(types_mapper={int64: pd.Int64Dtype()}.get)
    if not isinstance(column, pd.Series):  # pyarrow has no types.
        raise TypeError(type(column))
    return column


def _to_numbers(column: pd.Series[Any]) -> tuple[FloatArray, BoolArray]:
    """(n,) numbers, NaN where missing; and (n,) whether a cell is no number."""
    if column.dtype.kind in "biuf":  # 64-bit integers with missing values among them.
        return np.asarray(column.to_numpy(dtype=np.float64, na_value=np.nan)), np.zeros(len(column), dtype=np.bool_)
    cells = column.astype(object)
    numbers = pd.to_numeric(cells, errors="coerce")
    wrong = numbers.isna() & cells.notna() & (cells.astype(str).str.lower() != "nan")
    return numbers.to_numpy(dtype=np.float64, na_value=np.nan), wrong.to_numpy(dtype=np.bool_)


Table = pd.DataFrame | Mapping[str, ArrayLike]


def trials_of(table: Table, config: Config, run: str | None = None) -> list[Trial]:
    """One trial, or one for each value of the column ``run``, in the order of the rows.

    Raises ConfigError if a column is missing, or the arrays differ in length. Raises LogError if the columns hold no
    usable measurement.
    """
    try:
        frame = table if isinstance(table, pd.DataFrame) else pd.DataFrame({**table})
    except ValueError as error:
        text = f"{error}."
        raise ConfigError(text, where="data", mend="Give arrays of one length, one element an instant.") from None
    if run is None:
        return [_trial(frame, config, "data")]
    _require_column(frame, run, "run")
    return [_trial(rows, config, str(name)) for name, rows in frame.groupby(run, sort=False)]


def _trial(frame: pd.DataFrame, config: Config, name: str) -> Trial:
    # The sources of CSV name the columns.
    signals = {"time": config.time, **config.mapped_signals("csv")}
    for signal in ("time", *config.required_signals):
        if signal not in signals or "csv" not in signals[signal].sources:
            raise ConfigError("names no column.", where=f"[signals] {signal}", mend="Give its column.")
    sources = {signal: mapped.sources["csv"] for signal, mapped in signals.items()}
    for signal, column in sources.items():
        _require_column(frame, column, signal)
    clock, unit = sources.pop("time"), config.time.unit
    stamps = frame[clock].reset_index(drop=True)
    time = column_to_seconds(stamps, clock, unit, lambda row: f"{name}: row {row + 1}")
    channels = {}
    for signal, column in sources.items():
        values, wrong = _to_numbers(frame[column])
        if wrong.any():
            row = int(np.argmax(wrong))
            text = f"{column} is {str(frame[column].iloc[row])[:40]!r}; a number was expected."
            raise LogError(text, where=f"{name}: row {row + 1}", mend="Delete the row, or set the cell to NaN.")
        channels[signal] = raw_log.Channel(source=column, clock=clock, time=time, values=values)
    epoch = start_epoch(stamps, time, clock, unit)
    raw = raw_log.RawLog(channels=channels, place=lambda _, row: f"row {row + 1}", epoch=epoch)
    return build(raw, config, NO_FILE, name)


def _require_column(frame: pd.DataFrame, column: str, signal: str) -> None:
    if column not in frame.columns:
        present = list(map(str, frame.columns))
        raise ConfigError(f"is {column!r}, which is no column of the data. {suggestion(column, present)}", where=signal)


def thrust_curve(value: Any, where: str) -> ThrustCurve:
    """Thrust curve of a table with the columns command and thrust_N, or of a pair of arrays.

    Raises ConfigError if ``value`` is something else, or its commands are not all different.
    """
    if isinstance(value, ThrustCurve):
        return value
    try:
        parts = [value[name] for name in CURVE_COLUMNS] if isinstance(value, pd.DataFrame | Mapping) else value
        command, thrust = (np.asarray(part, dtype=np.float64) for part in parts)
    except (KeyError, TypeError, ValueError):
        command, thrust = np.empty(0), np.empty(1)
    if command.ndim != 1 or command.shape != thrust.shape or not np.isfinite([command, thrust]).all():
        text = f"is of the type {type(value).__name__}; two arrays of finite numbers of one length were expected."
        mend = f"Give (commands, thrusts in N), or a table with the columns {' and '.join(CURVE_COLUMNS)}."
        raise ConfigError(text, where=where, mend=mend)
    return curve_of(command, thrust, where=where)
