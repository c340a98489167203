"""Parquet tables: one row an instant, as in CSV, whose names of columns count where none are given for Parquet."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from rovid.core.array_types import BoolArray, FloatArray
from rovid.core.errors import LogError, suggestion
from rovid.readers.raw_log import (
    Channel,
    LogContents,
    RawLog,
    foreign,
    mapped,
    require_library,
    require_room,
    time_signal,
)
from rovid.readers.timestamps import column_to_seconds, epoch_of, to_datetimes
from rovid.trial.config import Config
from rovid.trial.signal_names import CLOCK_WORDS, name_words

KIND = "parquet"
EXTRA = "parquet"
_MARK = b"PAR1"
# Rows that are unpacked at a time, and bytes that are read.
_ROWS, _BUFFER = 1 << 16, 1 << 18
# How a column of bytes says that they are text or numbers.
_READABLE = {"STRING", "ENUM", "DECIMAL", "FLOAT16"}


def read(path: Path, config: Config) -> RawLog:
    """Wanted columns of ``path``; ``pose.heading`` is a column inside another.

    Raises
    ------
    LogError
        It is no Parquet file or is cut, pyarrow is not installed, or a column is missing, no number or too large.
    ConfigError
        rovid.toml does not map the time, the heading or a command for it.
    """
    signals = {"time": time_signal(config, KIND), **mapped(config, KIND, path)}
    _check(path)
    wanted = {name: signal.sources[KIND] for name, signal in signals.items()}
    moments, columns = _columns(path, wanted)
    time = column_to_seconds(moments, wanted["time"], signals["time"].unit, lambda row: f"{path}: row {row + 1}")
    epoch = epoch_of(moments, time, wanted["time"], signals["time"].unit)
    clock = wanted.pop("time")
    channels = {}
    for name, column in wanted.items():
        channels[name] = Channel(source=column, clock=clock, time=time, values=columns[column])
    return RawLog(channels=channels, place=lambda _, row: f"row {row + 1}", epoch=epoch)


def _columns(path: Path, wanted: Mapping[str, str]) -> tuple[pd.Series[Any], dict[str, FloatArray]]:
    """The time, and the other wanted columns by their names; a batch of rows at a time, so that little is unpacked."""
    parquet = require_library("pyarrow.parquet", EXTRA, path)
    clock = wanted["time"]
    names = {column: name for name, column in wanted.items() if name != "time"}
    with _reading(path):
        footer = parquet.read_metadata(path)
    texts = _require(path, footer, wanted)
    if footer.num_rows < 1:
        raise LogError("has columns but no rows.", where=path, mend="Leave it out.")
    columns = {column: np.empty(footer.num_rows) for column in names}
    times: list[pd.Series[Any]] = []
    at = 0
    for batch in _batches(path, list({clock: None, **names}), texts):
        times.append(_moments(path, batch[clock], clock, at))
        after = at + len(times[-1])
        if after > footer.num_rows:
            break
        for column, numbers in columns.items():
            numbers[at:after] = _numbers(path, batch[column], column, names[column], at)
        at = after
    if at != footer.num_rows:
        raise _damaged(path, ValueError(f"it does not hold the {footer.num_rows} rows that it tells of"))
    return pd.concat(times, ignore_index=True), columns


def _require(path: Path, footer: Any, wanted: Mapping[str, str]) -> list[str]:
    """Which of the wanted columns hold text.

    Raises
    ------
    LogError
        One is missing, there twice, or holds neither numbers nor text; or they are too large.
    """
    leaves = [footer.schema.column(at) for at in range(len(footer.schema.names))]
    present = [leaf.path for leaf in leaves if leaf.max_repetition_level == 0]  # no lists
    for name, column in wanted.items():
        _require_one(path, column, name, present)
    chosen = [leaf for leaf in leaves if leaf.path in wanted.values()]
    # What the footer says of single columns is not asked for: where it is damaged, pyarrow ends the whole process.
    require_room(path, footer.num_rows, len(chosen))
    blobs = [leaf for leaf in chosen if leaf.physical_type.endswith("BYTE_ARRAY")]
    _refuse_bytes(path, blobs)
    return [leaf.path for leaf in blobs if leaf.logical_type.type in {"STRING", "ENUM"}]


def _require_one(path: Path, column: str, name: str, present: list[str]) -> None:
    if column not in present:
        raise _no_column(path, column, name, present)
    if present.count(column) > 1:
        raise LogError(f"has {present.count(column)} columns {column!r} ({name}).", where=path, mend="Rename one.")


def _refuse_bytes(path: Path, leaves: Iterable[Any]) -> None:
    mend = "Map another column in rovid.toml, or leave this log out."
    for leaf in leaves:
        if leaf.logical_type.type not in _READABLE:
            raise LogError(f"{leaf.path} holds bytes; numbers were expected.", where=path, mend=mend)


def _batches(path: Path, columns: list[str], texts: list[str]) -> Iterator[dict[str, Any]]:
    """Name -> values of ``columns``, some thousand rows at a time; of ``texts`` each one but once."""
    parquet, arrow = require_library("pyarrow.parquet", EXTRA, path), require_library("pyarrow", EXTRA, path)
    with _reading(path), parquet.ParquetFile(path, read_dictionary=texts, buffer_size=_BUFFER) as file:
        for batch in file.iter_batches(_ROWS, columns=columns, use_threads=False):
            table = arrow.Table.from_batches([batch])
            while any(arrow.types.is_struct(field.type) for field in table.schema):
                table = table.flatten()
            found = {name: table.column(name).combine_chunks() for name in columns}
            yield {name: _plain(values, arrow) for name, values in found.items()}


def _plain(values: Any, arrow: Any) -> Any:
    """Decimals as floats; everything else as it is."""
    if arrow.types.is_decimal(values.type):
        return values.cast(arrow.float64())
    return values


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Say what a damaged file makes the library raise."""
    error = require_library("pyarrow", EXTRA, path).ArrowException
    try:
        yield
    except (error, OSError, ValueError, LookupError, RuntimeError, MemoryError) as reason:
        raise _damaged(path, reason) from reason


def sources(path: Path) -> LogContents:
    """The column of the clock, if one is named like one, and every other column of numbers.

    Raises
    ------
    LogError
        It is no Parquet file, or pyarrow is not installed.
    """
    _check(path)
    parquet, types = require_library("pyarrow.parquet", EXTRA, path), require_library("pyarrow.types", EXTRA, path)
    with _reading(path):
        schema = parquet.read_schema(path)
    counts = Counter(schema.names)
    clock = next((name for name in counts if counts[name] == 1 and name_words(name) & CLOCK_WORDS), "")
    numbers = [column.name for column in schema if types.is_integer(column.type) or types.is_floating(column.type)]
    once = tuple(name for name in numbers if counts[name] == 1 and name != clock)
    return LogContents(clock=clock, sources=once)


def _check(path: Path) -> None:
    with path.open("rb") as file:
        if file.read(len(_MARK)) != _MARK:
            raise foreign(path, "a Parquet file")


def _damaged(path: Path, error: Exception) -> LogError:
    return LogError(
        f"is a Parquet file that is cut or damaged ({str(error)[:100]}).".replace("\n", " "),
        where=path,
        mend="Write it again; what it describes stands at its end, so a part of one cannot be read.",
    )


def _no_column(path: Path, column: str, name: str, present: list[str]) -> LogError:
    return LogError(
        f"has no column {column!r}, which rovid.toml maps to {name}. {suggestion(column, present)}",
        where=path,
        mend=f"Correct the name in rovid.toml ({name}), or leave this log out.",
    )


def _moments(path: Path, values: Any, name: str, before: int) -> pd.Series[Any]:
    """The time of each row; text as points in time."""
    if _is_dictionary(values):
        values = values.dictionary_decode()
    column = _series(path, values)
    if column.dtype == object:
        return to_datetimes(column, name, lambda row: f"{path}: row {before + row + 1}")
    return column


def _numbers(path: Path, values: Any, column: str, name: str, before: int) -> FloatArray:
    """Each row as a number; ``before`` rows stand in front of them."""
    if not _is_dictionary(values):
        numbers, wrong = _read_numbers(_series(path, values))
    else:
        each, none = _read_numbers(_series(path, values.dictionary))
        # A missing cell takes the place behind the last of them.
        codes = values.indices.fill_null(len(each)).to_numpy()
        numbers = np.append(each, np.nan)[codes]
        wrong = np.append(none, False)[codes]
    if wrong.any():
        row = int(np.argmax(wrong))
        raise LogError(
            f"{column} ({name}) is {str(values[row].as_py())[:40]!r}; a number was expected.",
            where=f"{path}: row {before + row + 1}",
            mend="Delete the row or leave the cell empty.",
        )
    return numbers


def _is_dictionary(values: Any) -> bool:
    return hasattr(values, "dictionary")


def _series(path: Path, values: Any) -> pd.Series[Any]:
    """As pandas has it; integers of 64 bit stay such where some are missing."""
    whole = require_library("pyarrow", EXTRA, path).int64()
    column = values.to_pandas(types_mapper={whole: pd.Int64Dtype()}.get)
    if not isinstance(column, pd.Series):  # for the type checker: pyarrow tells it nothing
        raise TypeError(type(column))
    return column


def _read_numbers(column: pd.Series[Any]) -> tuple[FloatArray, BoolArray]:
    """(n,) numbers, NaN where none is; and (n,) whether something else is there."""
    if column.dtype.kind in "biuf":  # 64-bit integers with gaps among them
        return np.asarray(column.to_numpy(dtype=np.float64, na_value=np.nan)), np.zeros(len(column), dtype=np.bool_)
    cells = column.astype(object)
    numbers = pd.to_numeric(cells, errors="coerce")
    wrong = numbers.isna() & cells.notna() & (cells.astype(str).str.lower() != "nan")
    return numbers.to_numpy(dtype=np.float64, na_value=np.nan), wrong.to_numpy(dtype=np.bool_)
