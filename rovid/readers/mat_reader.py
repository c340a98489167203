"""MATLAB files up to 7.3: vectors and matrices of numbers, in structures by dots. Sources for CSV apply by default.

Version 7.3 is HDF5 and needs h5py. Tables, timetables, datetimes and objects of classes cannot be read.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import LogError, suggestion
from rovid.readers import raw_log
from rovid.readers.timestamps import EPOCH_FROM, SCALES, guess_clock, time_unit, to_seconds
from rovid.trial.axis import CLOCK_WORDS, name_words
from rovid.trial.config import Config

KIND = "mat"
EXTRA = "mat73"
_MARK, _FORMAT = b"MATLAB ", "a MATLAB file"
_MEND = "Save it again, or leave it out."
_ORDERS: tuple[Literal["little", "big"], ...] = ("little", "big")
# Number of bytes before the first matrix of version 4, and largest number there.
_HEAD, _LARGEST_TYPE = 20, 4052
# Number of columns of a matrix that may be signals.
_MAX_COLUMNS = 64
_MIN_LENGTH = 2


def read(path: Path, config: Config) -> raw_log.RawLog:
    """Mapped variables of ``path``; ``log.pose[2]`` is the third column of a matrix in a structure."""
    time = raw_log.required_time(config, KIND)
    signals = raw_log.required_signals(config, KIND, path)
    columns = _columns(path)
    clocks: dict[str, FloatArray] = {}
    clock = time.sources[KIND]
    channels = {}
    for name, signal in signals.items():
        source = signal.sources[KIND]
        if source not in columns:
            if signal.optional:
                continue
            text = f"has no variable {source!r}, which rovid.toml maps to {name}. {suggestion(source, columns)}"
            raise LogError(text, where=path, mend=f"Correct the name in rovid.toml ({name}), or leave this log out.")
        own = _clock_of(path, source, clock, columns)
        if own not in clocks:
            clocks[own] = to_seconds(columns[own], own, time.unit)
        values = columns[source]
        channels[name] = raw_log.Channel(source=source, clock=own, time=clocks[own], values=values)
    first = float(columns[clock][0]) if clock in columns else 0.0
    is_absolute = first * SCALES[time_unit(clock, abs(first), time.unit)] > EPOCH_FROM
    epoch = 0.0 if is_absolute else None
    return raw_log.RawLog(channels=channels, place=lambda _, row: f"element {row + 1}", epoch=epoch)


def sources(path: Path) -> raw_log.LogContents:
    """The time, and every other vector or column of a matrix."""
    columns = _columns(path)
    clock = guess_clock(columns, [])
    unreadable = () if columns else (f"{path}: holds no vectors; save tables, timetables and objects as structures.",)
    found = tuple(name for name in columns if name != clock)
    return raw_log.LogContents(clock=clock, sources=found, unreadable=unreadable)


def _clock_of(path: Path, source: str, clock: str, columns: Mapping[str, FloatArray]) -> str:
    """Time of the column ``source``: ``clock`` if it is as long, else one in the same structure."""
    if clock in columns and len(columns[clock]) == len(columns[source]):
        return clock
    structure = source
    while "." in structure:
        structure = structure.rpartition(".")[0]
        for name, values in columns.items():
            inside = name.rpartition(".")[0] == structure
            if inside and name_words(name.rpartition(".")[2]) & CLOCK_WORDS and len(values) == len(columns[source]):
                return name
    if clock not in columns:
        text = f"has no variable {clock!r}, which rovid.toml maps to time. {suggestion(clock, columns)}"
        raise LogError(text, where=path, mend="Correct the name in rovid.toml (time), or leave this log out.")
    text = f"{source} has {len(columns[source])} elements, but the time {clock} has {len(columns[clock])}."
    raise LogError(text, where=path, mend="Save both in one structure with their own time.")


def _columns(path: Path) -> dict[str, FloatArray]:
    """(n,) numbers of each vector, and of each column of a matrix, by name; matrices run along their longer side."""
    columns: dict[str, FloatArray] = {}
    for variable, value in _variables(path).items():
        columns |= {name: column for name, column in _flat(variable, value) if len(column) >= _MIN_LENGTH}
    return columns


def _flat(name: str, value: Any) -> Iterator[tuple[str, FloatArray]]:
    if isinstance(value, dict):
        for key, member in value.items():
            yield from _flat(f"{name}.{key}", member)
    elif isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype == object):
        for at, member in enumerate(list(value)[:_MAX_COLUMNS]):
            yield from _flat(f"{name}[{at}]", member)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        matrix = np.squeeze(value)
        if matrix.ndim == 1:
            yield name, matrix.astype(np.float64)
        elif matrix.ndim == 2:
            rows = matrix if matrix.shape[0] >= matrix.shape[1] else matrix.T
            for at in range(min(rows.shape[1], _MAX_COLUMNS)):
                yield f"{name}[{at}]", rows[:, at].astype(np.float64)


def _variables(path: Path) -> dict[str, Any]:
    """Variables by name; structures are dictionaries."""
    from scipy.io import loadmat

    with path.open("rb") as file:
        head = file.read(_HEAD)
    # Version 4 begins with a number that describes the first matrix, and with its size.
    described = [int.from_bytes(head[:4], order) for order in _ORDERS]
    if not head.startswith(_MARK) and not (min(described) <= _LARGEST_TYPE and any(head) and len(head) == _HEAD):
        raise raw_log.wrong_format(path, _FORMAT)
    try:
        loaded = loadmat(path, simplify_cells=True)
    except NotImplementedError:
        return _variables_73(path)
    except Exception as error:  # The library raises any exception on damaged files.
        raise raw_log.damaged(path, f"{_FORMAT} that is cut or damaged", error, _MEND) from error
    return {name: value for name, value in loaded.items() if not name.startswith("__")}


def _variables_73(path: Path) -> dict[str, Any]:
    h5py = raw_log.require_library("h5py", EXTRA, path)

    def members(group: Any) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for name, item in group.items():
            if name.startswith("#"):
                continue
            if isinstance(item, h5py.Group):
                found[name] = members(item)
            elif item.dtype.kind in "biuf" and item.attrs.get("MATLAB_class", b"") != b"char":
                found[name] = np.asarray(item).T  # HDF5 stores rows first, MATLAB columns.
        return found

    try:
        with h5py.File(path, "r") as file:
            return members(file)
    except Exception as error:  # The library raises any exception on damaged files.
        raise raw_log.damaged(path, f"{_FORMAT} that is cut or damaged", error, _MEND) from error
