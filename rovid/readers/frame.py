"""Tables in memory: a pandas DataFrame, or arrays by name, whose columns the description of a vehicle maps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from rovid.core.array_types import FloatArray
from rovid.core.errors import ConfigError, LogError, suggestion
from rovid.readers.build_trial import build
from rovid.readers.parquet_reader import to_numbers
from rovid.readers.raw_log import Channel, RawLog
from rovid.readers.timestamps import column_to_seconds, start_epoch
from rovid.trial.config import Config
from rovid.trial.tables import CURVE_COLUMNS, curve_of
from rovid.trial.trial import NO_FILE, Trial
from rovid.trial.vehicle import ThrustCurve

# Format whose sources name the columns.
_KIND = "csv"

Table = pd.DataFrame | Mapping[str, ArrayLike]


def trials_of(table: Table, config: Config, run: str | None = None) -> list[Trial]:
    """One trial, or one for each value of the column ``run``, in the order of the rows.

    Raises
    ------
    ConfigError
        A column is missing, or the arrays differ in length.
    LogError
        The columns hold no usable measurement.
    """
    try:
        frame = table if isinstance(table, pd.DataFrame) else pd.DataFrame({**table})
    except ValueError as error:
        raise ConfigError(
            f"{error}.", where="data", mend="Give arrays of one length, one element an instant."
        ) from None
    return [_trial(rows, config, name) for name, rows in _runs(frame, run)]


def _runs(frame: pd.DataFrame, run: str | None) -> Iterator[tuple[str, pd.DataFrame]]:
    if run is None:
        yield "data", frame
        return
    _require_column(frame, run, "run")
    for name, rows in frame.groupby(run, sort=False):
        yield str(name), rows


def _trial(frame: pd.DataFrame, config: Config, name: str) -> Trial:
    signals = {"time": config.time, **config.mapped_signals(_KIND)}
    for signal in ("time", *config.required_signals):
        if signal not in signals or _KIND not in signals[signal].sources:
            raise ConfigError("names no column.", where=f"[signals] {signal}", mend="Give its column.")
    sources = {signal: mapped.sources[_KIND] for signal, mapped in signals.items()}
    for signal, column in sources.items():
        _require_column(frame, column, signal)
    clock, unit = sources.pop("time"), config.time.unit
    stamps = frame[clock].reset_index(drop=True)
    time = column_to_seconds(stamps, clock, unit, lambda row: f"{name}: row {row + 1}")
    channels = {
        signal: Channel(source=column, clock=clock, time=time, values=_numbers(frame[column], column, name))
        for signal, column in sources.items()
    }
    epoch = start_epoch(stamps, time, clock, unit)
    raw = RawLog(channels=channels, place=lambda _, row: f"row {row + 1}", epoch=epoch)
    return build(raw, config, NO_FILE, name)


def _require_column(frame: pd.DataFrame, column: str, signal: str) -> None:
    if column not in frame.columns:
        present = list(map(str, frame.columns))
        raise ConfigError(f"is {column!r}, which is no column of the data. {suggestion(column, present)}", where=signal)


def _numbers(column: pd.Series[Any], title: str, name: str) -> FloatArray:
    numbers, wrong = to_numbers(column)
    if wrong.any():
        row = int(np.argmax(wrong))
        text = f"{title} is {str(column.iloc[row])[:40]!r}; a number was expected."
        raise LogError(text, where=f"{name}: row {row + 1}", mend="Delete the row, or set the cell to NaN.")
    return numbers


def thrust_curve(value: Any, where: str) -> ThrustCurve:
    """Thrust curve of a table with the columns command and thrust_N, or of a pair of arrays.

    Raises
    ------
    ConfigError
        ``value`` is something else, or its commands are not all different.
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
