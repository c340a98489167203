"""Any log that rovid reads -> CSV, MCAP or Parquet, and what rovid.toml has to say to read it again."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from rovid.core.array_types import FloatArray
from rovid.core.atomic_write import OutputFile
from rovid.core.errors import ConfigError
from rovid.core.escaping import field_names, toml_text
from rovid.core.paths import require_exists
from rovid.core.signatures import LOG
from rovid.readers import read_log
from rovid.readers.mcap_writer import OutputTopic, mcap_bytes, name_with_unit
from rovid.readers.raw_log import require_library
from rovid.trial.config import Config
from rovid.trial.signal_names import ANGLE_UNITS, SIGNAL_UNITS
from rovid.trial.trial import Trial

_TOPIC = "/trial"
_TIME = "time_s"
_COMMAND = "command."
_BARE = re.compile(r"[A-Za-z0-9_-]+")


@dataclass(frozen=True, kw_only=True, eq=False)
class Converted:
    """A log in another format.

    Attributes
    ----------
    content
        Of the file.
    mapping
        Lines for rovid.toml: where the new log holds what.
    """

    trial: Trial
    content: bytes
    mapping: str


@dataclass(frozen=True, kw_only=True, eq=False)
class _Column:
    """(n,) of one signal in ``unit``; "" where the user alone knows it."""

    signal: str
    name: str
    numbers: FloatArray
    unit: str


def output_at(target: Path, log: Path) -> OutputFile:
    """The output at ``target``; refuse what cannot be written, before ``log`` is read.

    Raises
    ------
    ConfigError
        ``log`` is a folder or no file; ``target`` has no suffix of a format that can be written, or is the log itself.
    """
    require_exists(log)
    if log.is_dir():
        raise ConfigError("is a folder; one log was expected.", where=log)
    if target.suffix.lower() not in _WRITERS:
        raise ConfigError(
            f"has the suffix {target.suffix!r}; one of {', '.join(_WRITERS)} was expected.", where=f"-o {target}"
        )
    if target.exists() and target.samefile(log):
        raise ConfigError("is the log itself.", where=f"-o {target}", mend="Choose another name.")
    return OutputFile(target, LOG)


def convert(log: Path, config: Config, target: Path) -> Converted:
    """``log`` as rovid reads it: in order of time, what is no measurement left out, in the format of ``target``.

    Raises
    ------
    LogError
        The log cannot be read, or pyarrow is missing where Parquet is wanted.
    """
    trial = read_log(log, config)
    columns = _columns(trial, config)
    suffix = target.suffix.lower()
    content = _WRITERS[suffix](trial, columns, target)
    return Converted(trial=trial, content=content, mapping=_mapping(columns, suffix.removeprefix(".")))


def _columns(trial: Trial, config: Config) -> list[_Column]:
    axis = trial.axis
    signals: dict[str, FloatArray | None] = {}
    if not trial.rate_only:
        signals[axis.position_signal] = trial.position
    signals[axis.rate_signal] = trial.rate
    # Along roll or pitch the position is one of these already.
    signals.setdefault("roll", trial.roll)
    signals.setdefault("pitch", trial.pitch)
    for command, values in zip(config.commands, trial.commands.T, strict=True):
        signals[command.name] = values
    columns: dict[str, _Column] = {}
    for name, found in {**signals, **trial.extras}.items():
        if found is not None and np.isfinite(found).any():
            column = _column(name, found, set(columns))
            columns[column.name] = column
    return list(columns.values())


def _column(signal: str, values: FloatArray, taken: set[str]) -> _Column:
    unit = _unit(signal)
    [name] = field_names([name_with_unit(re.sub(r"\W+", "_", signal), unit)], taken={*taken, _TIME})
    return _Column(signal=signal, name=name, numbers=_in_unit(values, signal, unit), unit=unit)


def _in_unit(values: FloatArray, signal: str, unit: str) -> FloatArray:
    """(n,) of a signal in SI in ``unit``; a heading within one turn."""
    if unit == "deg":
        values = np.rad2deg(values)
    return np.remainder(values, 360.0) if signal == "heading" else values


def _unit(signal: str) -> str:
    """SI's, but for angles, which people read in degrees; empty where only the user knows it."""
    units = SIGNAL_UNITS.get(signal, {})
    if units is ANGLE_UNITS:
        return "deg"
    return next((unit for unit, factor in units.items() if factor == 1.0), "")


def _frame(trial: Trial, columns: list[_Column]) -> pd.DataFrame:
    return pd.DataFrame({_TIME: trial.time, **{column.name: column.numbers for column in columns}})


def _csv(trial: Trial, columns: list[_Column], _target: Path) -> bytes:
    # Digits beyond a nanosecond in a day and a nanodegree are noise of the arithmetic.
    return _frame(trial, columns).to_csv(index=False, float_format="%.14g", lineterminator="\n").encode()


def _parquet(trial: Trial, columns: list[_Column], target: Path) -> bytes:
    require_library("pyarrow", "parquet", target)
    content: bytes = _frame(trial, columns).to_parquet(index=False)
    return content


def _mcap(trial: Trial, columns: list[_Column], _target: Path) -> bytes:
    fields = {column.name: column.numbers for column in columns}
    units = {column.name: column.unit for column in columns}
    return mcap_bytes([OutputTopic(name=_TOPIC, time=trial.time, fields=fields, units=units)])


_WRITERS: Mapping[str, Callable[[Trial, list[_Column], Path], bytes]] = {
    ".csv": _csv,
    ".mcap": _mcap,
    ".parquet": _parquet,
}


def _mapping(columns: list[_Column], kind: str) -> str:
    lines = []
    for column in columns:
        if column.signal.startswith(_COMMAND):
            name = toml_text(column.signal.removeprefix(_COMMAND))
            lines += ["[[thrusters]]", f"name = {name}", f"command = {_source(column, kind)}", ""]
    # Messages bring a clock with them, tables have a column of it.
    clock = "log" if kind == "mcap" else _TIME
    lines += ["[signals]", f'time = {{ {kind} = "{clock}" }}']
    for column in columns:
        if not column.signal.startswith(_COMMAND):
            key = column.signal if _BARE.fullmatch(column.signal) else toml_text(column.signal)
            lines.append(f"{key} = {_source(column, kind)}")
    return "\n".join(lines) + "\n"


def _source(column: _Column, kind: str) -> str:
    place = f"{_TOPIC}.{column.name}" if kind == "mcap" else column.name
    unit = f', unit = "{column.unit}"' if column.unit else ""
    return f"{{ {kind} = {toml_text(place)}{unit} }}"
