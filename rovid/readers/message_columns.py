"""Logs that keep the messages of one name as columns: ``TOPIC.field`` -> channel, from one beginning."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rovid.core.array_types import FloatArray
from rovid.core.errors import LogError, suggestion
from rovid.readers.field_access import ANGLES, euler
from rovid.readers.raw_log import Channel, RawLog
from rovid.readers.timestamps import to_seconds
from rovid.trial.signal_names import Signal
from rovid.trial.trial import Remark

_SENSOR = re.compile(r"(.*)\[(\d+)\]$")

# Field -> (n,) as logged; the clock is one of them, in us.
Columns = Mapping[str, NDArray[Any]]


def channels_of(
    path: Path, kind: str, signals: Mapping[str, Signal], topic: Callable[[str], Columns], clock: str
) -> dict[str, Channel]:
    """Every one of ``signals``.

    Parameters
    ----------
    topic
        Its name -> what it holds; raises `LogError` where there is no such topic.
    clock
        The field of each topic that holds the time, in us.

    Raises
    ------
    LogError
        A topic or field is missing, or is no number.
    """
    topics: dict[str, Columns] = {}
    mapped: dict[str, tuple[str, NDArray[Any], bool]] = {}
    for name, signal in signals.items():
        one, _, field = signal.sources[kind].partition(".")
        try:
            columns = topics.get(one) or topics.setdefault(one, topic(one))
            mapped[name] = (one, *_values(path, field, one, columns, name))
        except LogError:
            if not signal.optional:
                raise
    stamps = {one: _whole(_field(path, clock, one, topics[one], "time")) for one, _, _ in mapped.values()}
    first = [int(values[0]) for values in stamps.values() if values.dtype.kind == "i"]
    origin = min(first, default=0)
    times = {one: to_seconds(values, clock, "us", origin) for one, values in stamps.items()}
    channels = {}
    for name, (one, values, turned) in mapped.items():
        source = signals[name].sources[kind]
        channels[name] = Channel(source=source, clock=one, time=times[one], values=_float64(values), radians=turned)
    return channels


def numeric_sources(topics: Mapping[str, Columns]) -> list[str]:
    """Sources of every number in ``topics``, a quaternion as one, clocks left out."""
    every = (_numeric_in(topic, columns) for topic, columns in topics.items())
    return list(dict.fromkeys(chain.from_iterable(every)))


def _numeric_in(topic: str, columns: Columns) -> Iterator[str]:
    for field, values in columns.items():
        name = field.partition("[")[0] if field.startswith("q[") else field
        if values.dtype.kind in "iuf" and not field.lower().startswith("time"):
            yield f"{topic}.{name}"


def parameters_of(columns: Columns, name: str, value: str) -> dict[str, float]:
    """Parameters that messages with the fields ``name`` and ``value`` tell, the last of each; none without them."""
    if name not in columns or value not in columns or columns[name].dtype.kind != "S":
        return {}
    names = [text.decode("ascii", errors="replace") for text in columns[name].tolist()]
    return dict(zip(names, _float64(columns[value]).tolist(), strict=True))


def raw_log(channels: Mapping[str, Channel], remarks: tuple[Remark, ...]) -> RawLog:
    """Channels of messages, which loggers store slightly out of order."""
    return RawLog(
        channels=channels,
        place=lambda signal, index: f"message {index + 1} of {channels[signal].clock}",
        remarks=remarks,
        sortable=True,
    )


def missing_topic(path: Path, kind: str, name: str, present: Mapping[str, Any]) -> LogError:
    """That there is no topic ``name``, and which of those that are there come near."""
    mend = f'Write {kind} = "<message>.<field>" in rovid.toml.'
    return LogError(f"holds no message {name!r}. {suggestion(name, present)}", where=path, mend=mend)


def split_sensor(topic: str) -> tuple[str, int | None]:
    """Name of a message, and which of several sensors it is asked of: ``IMU[1]``."""
    match = _SENSOR.match(topic)
    if match is None:
        return topic, None
    return match[1], int(match[2])


def of_sensor(path: Path, kind: str, topic: str, columns: Columns, marker: str, remarks: list[Remark]) -> Columns:
    """What one sensor said, of messages in which the field ``marker`` tells several apart.

    The first, with a remark, where ``topic`` does not say which; everything where there is no such field.

    Raises
    ------
    LogError
        There is no such sensor.
    """
    name, wanted = split_sensor(topic)
    if marker not in columns:
        return columns
    numbers = columns[marker]
    present = np.unique(numbers).tolist()
    if wanted is None and len(present) > 1:
        text = f"{name} comes from several sensors, {present}; the first was taken. {name}[{present[1]}] is another."
        remarks.append(Remark(kind="chosen", count=len(numbers), text=text))
    chosen = present[0] if wanted is None else wanted
    if chosen not in present:
        raise missing_topic(path, kind, topic, {f"{name}[{one}]": None for one in present})
    return {field: values[numbers == chosen] for field, values in columns.items()}


def _values(path: Path, field: str, topic: str, columns: Columns, name: str) -> tuple[NDArray[Any], bool]:
    """(n,) of the field, and whether they are rad because it is a quaternion."""
    # PX4 writes w first.
    parts = [f"{field}[{at}]" for at in (1, 2, 3, 0)]
    if name in ANGLES and field not in columns and columns.keys() >= set(parts):
        quaternion = [_float64(columns[part]) for part in parts]
        return euler(np.column_stack(quaternion), name), True
    return _field(path, field, topic, columns, name), False


def _whole(values: NDArray[Any]) -> NDArray[Any]:
    """Whole numbers with a sign, so that every difference is one too; a stamp that does not fit is damaged."""
    if values.dtype.kind == "u":
        return values.astype(np.int64)
    return values


def _float64(values: NDArray[Any]) -> FloatArray:
    with np.errstate(invalid="ignore"):  # a damaged number may be a NaN that signals
        return values.astype(np.float64)


def _field(path: Path, field: str, topic: str, columns: Columns, name: str) -> NDArray[Any]:
    values = columns.get(field)
    if values is None:
        raise LogError(
            f"{topic} has no field {field!r} ({name}). {suggestion(field, columns)}",
            where=path,
            mend=f"Correct {name} in rovid.toml.",
        )
    if values.dtype.kind not in "iuf":
        raise LogError(
            f"{topic}.{field} ({name}) is text; a number was expected.",
            where=path,
            mend=f"Name another field for {name} in rovid.toml.",
        )
    return values
