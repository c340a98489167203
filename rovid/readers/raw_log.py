"""What a reader hands over: channels as logged, each on the clock that it was logged with."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray
from rovid.core.errors import ConfigError, LogError
from rovid.trial.config import Config
from rovid.trial.signal_names import Signal
from rovid.trial.trial import Remark

# Bytes that the numbers of one log may take.
_ROOM = 512 << 20
# No time in s, angle or command is this large; a damaged log is.
_ABSURD = 1e15


@dataclass(frozen=True, kw_only=True, eq=False)
class Channel:
    """One signal as it stands in the log.

    Channels that share a clock share the array ``time`` itself, so that it is put in order once.

    Attributes
    ----------
    source
        The column, or the topic and field, for messages.
    clock
        The time column or the topic, for messages.
    time
        (n,) s since a moment of the reader's choice, in the order logged; NaN where it is missing.
    values
        (n,) as logged; NaN where missing.
    radians
        The reader made an angle of it (from a quaternion), so the unit of rovid.toml does not apply.
    """

    source: str
    clock: str
    time: FloatArray
    values: FloatArray
    radians: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class RawLog:
    """All wanted channels of one file.

    Attributes
    ----------
    channels
        Signal name -> channel.
    remarks
        What the reader noticed about the file itself.
    sortable
        The format stores messages slightly out of order by nature: sort them before complaining.
    place
        (signal, index of a sample) -> "line 17" or "message 16", for messages.
    epoch
        s since 1970 of the channels' time zero; None where nobody knows.
    beside
        Further files that channels come from.
    """

    channels: Mapping[str, Channel]
    place: Callable[[str, int], str]
    remarks: tuple[Remark, ...] = ()
    sortable: bool = False
    epoch: float | None = None
    beside: tuple[Path, ...] = ()


@dataclass(frozen=True, kw_only=True)
class LogContents:
    """What a log holds that can be read.

    Attributes
    ----------
    clock
        The source of the clock; empty where the format has one of its own.
    sources
        Of everything else.
    left_out
        What is there and cannot be read, each with the reason.
    parameters
        Of the autopilot that wrote it, by their own names.
    """

    clock: str = ""
    sources: tuple[str, ...]
    unreadable: tuple[str, ...] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)


def mapped(config: Config, kind: str, path: Path) -> dict[str, Signal]:
    """Signals that rovid.toml maps for logs of the format ``kind``.

    Raises
    ------
    ConfigError
        What is measured, or a command, is not mapped for this format.
    """
    wanted = config.mapped_signals(kind)
    for name in config.required_signals:
        if name not in wanted:
            raise ConfigError(
                f"{name} names no {kind} source, but {path.name} is a {kind} log.",
                where=config.path,
                mend=f'Add {kind} = "…" beside its other sources, or leave this log out.',
            )
    return wanted


def time_signal(config: Config, kind: str) -> Signal:
    """The time column.

    Raises
    ------
    ConfigError
        rovid.toml names none for the format ``kind``.
    """
    if kind not in config.time.sources:
        raise ConfigError(
            f"time names no {kind} column, but there is a {kind} log.",
            where=config.path,
            mend=f'Add time = {{ {kind} = "<column>" }} to [signals].',
        )
    return config.time


def require_library(module: str, extra: str, path: Path) -> ModuleType:
    """A package that one format needs and rovid as a whole does not.

    Raises
    ------
    LogError
        It is not installed.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise LogError(
            f"needs the package {module.partition('.')[0]}.",
            where=path,
            mend=f"Install it with `pip install 'rovid[{extra}]'`.",
        ) from error


def require_room(path: Path, rows: int, columns: int) -> None:
    """Refuse a table that is too large, before it is unpacked.

    Raises
    ------
    LogError
        Its numbers take more than rovid reads of one log.
    """
    needed = 8 * rows * columns
    if needed > _ROOM:
        raise LogError(
            f"holds {rows} rows, of which {columns} columns are wanted: {needed >> 20} MB unpacked; "
            f"at most {_ROOM >> 20} MB were expected.",
            where=path,
            mend="Split the log, or keep every tenth row.",
        )


def foreign(path: Path, what: str) -> LogError:
    """That ``path`` is not ``what`` its suffix says."""
    found = "does not begin as one" if path.stat().st_size else "is empty"
    mend = "Fetch the log again, or give it the suffix of its format."
    return LogError(f"is not {what}: it {found}.", where=path, mend=mend)


def is_plausible(values: FloatArray) -> BoolArray:
    """(n,) where a number was measured: neither missing, nor infinite, nor beyond all units."""
    return np.abs(values) < _ABSURD


def subsampled_median(values: FloatArray) -> float:
    """Median of at most some ten thousand ``values``, evenly picked: near enough for a threshold, and fast."""
    return float(np.median(values[:: len(values) // 10_000 + 1])) if values.size else float("nan")
