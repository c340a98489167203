"""JSON lines: one object a line. Sources are keys, nested ones by dots; sources for CSV apply by default."""

import json
from collections.abc import Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from rovid.core.errors import LogError, suggestion
from rovid.readers import message_fields
from rovid.readers.raw_log import Channel, LogContents, RawLog, required_signals, required_time, wrong_format
from rovid.readers.timestamps import SPLIT, clock_parts, column_to_seconds, guess_clock, start_epoch
from rovid.trial.config import Config
from rovid.trial.trial import Remark

KIND = "jsonl"
# Number of objects from which the contents are listed.
_SAMPLE = 200
_MAX_INTEGER = 2**63 - 1


def read(path: Path, config: Config) -> RawLog:
    """Mapped keys of ``path``."""
    time = required_time(config, KIND)
    signals = required_signals(config, KIND, path)
    lost: list[int] = []
    objects = _objects(path, lost)
    first = next(objects, None)
    if first is None:
        raise wrong_format(path, "JSON, one object a line")
    clock = time.sources[KIND]
    get_time, in_ns = _clock(first[1], clock)
    collectors = {}
    for name, signal in signals.items():
        source = signal.sources[KIND]
        steps = _steps(first[1], source)
        collectors[name] = message_fields.FieldCollector(signal, source, steps, mapping=True, where=str(path))
    stamps: list[Any] = []
    lines: list[int] = []
    topics: set[str] = set()
    for number, one in (first, *objects):
        lines.append(number)
        stamps.append(_value(get_time, one))
        topics.add(str(one.get("topic", "")))
        for collector in collectors.values():
            collector.take(one)
    for name, collector in collectors.items():
        if not (collector.seen or collector.signal.optional):
            near = suggestion(collector.source, [*message_fields.numeric_fields(first[1], "")])
            keys = message_fields.listed_fields(first[1])
            text = f"never holds {collector.source!r} ({name}). {near} Its first keys: {keys}."
            raise LogError(text, where=path, mend=f"Correct {name} in rovid.toml, or leave this log out.")
    # Integers, as ns since 1970, lose digits in floats.
    whole = all(stamp is None or (isinstance(stamp, int) and abs(stamp) < _MAX_INTEGER) for stamp in stamps)
    column = pd.Series(stamps, dtype="Int64") if whole else pd.Series(stamps)
    unit = "ns" if in_ns else time.unit
    seconds = column_to_seconds(column, clock, unit, lambda row: f"{path}:{lines[row]}")
    channels = {
        name: Channel(source=one.source, clock=clock, time=seconds, values=one.column(), radians=one.quaternion)
        for name, one in collectors.items()
        if one.seen
    }
    text = f"{len(lost)} lines are no JSON objects, first line {lost[0] if lost else 0}; they were left out."
    return RawLog(
        channels=channels,
        place=lambda _, row: f"line {lines[row]}",
        remarks=(Remark(kind="truncated", count=len(lost), text=text),) * bool(lost),
        sparse=len(topics) == 1,
        epoch=start_epoch(column, seconds, clock, unit),
    )


def sources(path: Path) -> LogContents:
    """The time, and every other key of numbers or orientations in the first objects and in some later ones."""
    sample = [one for _, one in islice(_objects(path, []), _SAMPLE)]
    if not sample:
        raise wrong_format(path, "JSON, one object a line")
    # A field may be absent at first, as a command of zero.
    every = [*sample, *_later_objects(path)]
    names: dict[str, None] = {}
    for one in every:
        names |= dict.fromkeys([*message_fields.numeric_fields(one, "", stamps=True), *one])
    numbers = {}
    for name in names:
        get = message_fields.getter(_steps(sample[0], name), mapping=True)
        values = [_value(get, one) for one in every]
        if any(isinstance(value, int | float) for value in values) and not any(isinstance(v, str) for v in values):
            numbers[name] = np.array([np.nan if value is None else float(value) for value in values[: len(sample)]])
    dated = [name for name, value in sample[0].items() if isinstance(value, str) and value[:4].isdigit()]
    clock = guess_clock(numbers, dated)
    # Orientations have no single number.
    listed = [name for name in names if name in numbers or name not in sample[0]]
    own = {clock, *clock.split(SPLIT)}
    return LogContents(clock=clock, sources=tuple(name for name in listed if name not in own))


def _later_objects(path: Path) -> Iterator[dict[str, Any]]:
    """Objects at even distances over the file."""
    with path.open("rb") as file:
        for place in np.linspace(0.0, path.stat().st_size, _SAMPLE, endpoint=False).astype(int).tolist():
            file.seek(place)
            file.readline()  # The rest of a line.
            with suppress(ValueError, RecursionError):
                if isinstance(one := json.loads(file.readline()), dict):
                    yield one


def _objects(path: Path, lost: list[int]) -> Iterator[tuple[int, dict[str, Any]]]:
    """(line number, object) of each line; the numbers of lines that hold none are added to ``lost``."""
    with path.open("rb") as file:
        for number, line in enumerate(file, start=1):
            if not line.strip():
                continue
            try:
                one = json.loads(line)
            except (ValueError, RecursionError):
                one = None
            if isinstance(one, dict):
                yield number, one
            else:
                lost.append(number)


def _steps(sample: dict[str, Any], source: str) -> tuple[str, ...]:
    """Steps to ``source``, which may be one key with dots."""
    return (source,) if source in sample else message_fields.split_fields(source)


def _clock(sample: dict[str, Any], clock: str) -> tuple[message_fields.Getter, bool]:
    """Function that returns the time of an object, and whether it is in ns, from seconds and the rest of them."""
    parts = clock_parts(clock, [*message_fields.numeric_fields(sample, "", stamps=True)])
    if parts is None:
        steps = _steps(sample, clock)
        split = message_fields.stamp_getter(sample, mapping=True, clock=steps)
        return (message_fields.getter(steps, mapping=True), False) if split is None else (split, True)
    seconds, rest = (message_fields.getter(_steps(sample, name), mapping=True) for name in (parts.seconds, parts.rest))
    scale = round(1e9 * parts.unit)
    return lambda one: int(seconds(one)) * 1_000_000_000 + int(rest(one)) * scale, True


def _value(get: message_fields.Getter, one: dict[str, Any]) -> Any:
    """A number or text; None where missing."""
    try:
        value = get(one)
    except (*message_fields.ABSENT, ValueError, OverflowError):
        return None
    return value if isinstance(value, int | float | str) and not isinstance(value, bool) else None
