"""Parquet tables: one row an instant, as in CSV, whose names of columns count where none are given for Parquet."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from rovid.config import Config
from rovid.errors import LogError, nearest
from rovid.guess import CLOCK, words
from rovid.readers.instants import epoch_of, stamps
from rovid.readers.raw import Channel, RawLog, foreign, library, mapped, time_signal
from rovid.trial import FloatArray

KIND = "parquet"
EXTRA = "parquet"
_MARK = b"PAR1"


def read(path: Path, config: Config) -> RawLog:
    """Wanted columns of ``path``; ``pose.heading`` is a column inside another.

    Raises
    ------
    LogError
        It is no Parquet file or is cut, pyarrow is not installed, or a column is missing or no number.
    ConfigError
        rovid.toml does not map the time, the heading or a command for it.
    """
    signals = {"time": time_signal(config, KIND), **mapped(config, KIND, path)}
    _check(path)
    wanted = {name: signal.sources[KIND] for name, signal in signals.items()}
    frame = _frame(path, wanted)
    if not len(frame):
        raise LogError("has columns but no rows.", where=path, mend="Leave it out.")
    time = stamps(frame[wanted["time"]], wanted["time"], signals["time"].unit, lambda row: f"{path}: row {row + 1}")
    channels = {
        name: Channel(source=column, clock=wanted["time"], time=time, values=_numbers(path, frame[column], name))
        for name, column in wanted.items()
        if name != "time"
    }
    epoch = epoch_of(frame[wanted["time"]], time, wanted["time"], signals["time"].unit)
    return RawLog(channels=channels, place=lambda _, row: f"row {row + 1}", epoch=epoch)


def _frame(path: Path, wanted: dict[str, str]) -> pd.DataFrame:
    """The wanted columns; integers of 64 bit stay such where some are missing."""
    parquet, arrow = library("pyarrow.parquet", EXTRA, path), library("pyarrow", EXTRA, path)
    try:
        with parquet.ParquetFile(path) as file:
            leaves = [file.schema.column(at) for at in range(len(file.schema.names))]
            present = [leaf.path for leaf in leaves if leaf.max_repetition_level == 0]  # no lists
            for name, column in wanted.items():
                if column not in present:
                    raise _no_column(path, column, name, present)
            table = file.read(columns=list(dict.fromkeys(wanted.values())), use_threads=False)
        while any(arrow.types.is_struct(field.type) for field in table.schema):
            table = table.flatten()
        frame = table.to_pandas(types_mapper={arrow.int64(): pd.Int64Dtype()}.get, ignore_metadata=True)
    except LogError:
        raise
    except Exception as error:  # damaged files make the library raise anything
        raise _damaged(path, error) from error
    if not isinstance(frame, pd.DataFrame):  # for the type checker: pyarrow tells it nothing
        raise TypeError(type(frame))
    return frame


def sources(path: Path) -> tuple[str, list[str]]:
    """The column of the clock, empty if none is named like one, and every other column of numbers.

    Raises
    ------
    LogError
        It is no Parquet file, or pyarrow is not installed.
    """
    _check(path)
    parquet, types = library("pyarrow.parquet", EXTRA, path), library("pyarrow.types", EXTRA, path)
    try:
        schema = parquet.read_schema(path)
    except Exception as error:
        raise _damaged(path, error) from error
    numbers = [one.name for one in schema if types.is_integer(one.type) or types.is_floating(one.type)]
    clock = next((name for name in schema.names if words(name) & CLOCK), "")
    return clock, [name for name in numbers if name != clock]


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
        f"has no column {column!r}, which rovid.toml maps to {name}. {nearest(column, present)}",
        where=path,
        mend=f"Correct the name in rovid.toml ({name}), or leave this log out.",
    )


def _numbers(path: Path, column: pd.Series[Any], name: str) -> FloatArray:
    if column.dtype.kind in "biuf":  # 64-bit integers with gaps among them
        return np.asarray(column.to_numpy(dtype=np.float64, na_value=np.nan))
    cells = column.astype(object)
    try:
        numbers = pd.to_numeric(cells, errors="coerce")
        wrong = numbers.isna() & cells.notna() & (cells.astype(str).str.lower() != "nan")
    except (TypeError, ValueError):  # bytes
        numbers, wrong = cells, cells.notna()
    if wrong.any():
        row = int(np.argmax(wrong.to_numpy()))
        raise LogError(
            f"{column.name} ({name}) is {str(cells.iloc[row])[:40]!r}; a number was expected.",
            where=f"{path}: row {row + 1}",
            mend="Delete the row or leave the cell empty.",
        )
    return numbers.to_numpy(dtype=np.float64, na_value=np.nan)
