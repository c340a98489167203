"""PX4's ULog, read by pyulog: the wanted fields of the wanted topics; ``topic#1.field`` is of its second instance."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rovid.core.errors import LogError
from rovid.readers.message_columns import Columns, channels_of, missing_topic, numeric_sources, raw_log
from rovid.readers.raw_log import LogContents, RawLog, foreign, mapped, require_library
from rovid.trial.config import Config
from rovid.trial.trial import Remark

KIND = "ulg"
# Topics that `rovid init` looks into.
_TELLING = ("vehicle_attitude", "vehicle_angular_velocity", "actuator_motors", "actuator_outputs", "battery_status")
_MARK = b"ULog\x01\x12\x35"
# The size of a message is told in 16 bits; all topics together have no more fields than that many times a few.
_LONGEST, _MOST_FIELDS = 1 << 16, 1 << 18
_HEAD = 3
# Bytes that pyulog may read for each byte of the file: damage makes it go back and read again.
_READINGS = 16


def read(path: Path, config: Config) -> RawLog:
    """Wanted fields of ``path``.

    Raises
    ------
    LogError
        It is no ULog, pyulog is not installed, or a topic or field is missing or no number.
    ConfigError
        rovid.toml does not map a command for it.
    """
    signals = mapped(config, KIND, path)
    names = {signal.sources[KIND].partition(".")[0].partition("#")[0] for signal in signals.values()}
    _check(path)
    log = _Log(path, names)
    channels = channels_of(path, KIND, signals, log.columns, config.time.sources.get(KIND, "timestamp"))
    return raw_log(channels, log.remarks)


def sources(path: Path) -> LogContents:
    """What tells of motion, thrusters and supply.

    Raises
    ------
    LogError
        It is no ULog, or pyulog is not installed.
    """
    _check(path)
    log = _Log(path, set(_TELLING))
    return LogContents(sources=tuple(numeric_sources(log.topics)), parameters=log.parameters)


def _check(path: Path) -> None:
    with path.open("rb") as file:
        if file.read(len(_MARK)) != _MARK:
            raise foreign(path, "a ULog of PX4")


def _called(name: str, instance: int) -> str:
    return f"{name}#{instance}" if instance else name


class _Log:
    """The wanted topics of a log.

    Attributes
    ----------
    topics
        By name and instance: what they hold.
    present
        All that there are, wanted or not.
    parameters
        Of the autopilot, as the log began.
    """

    def __init__(self, path: Path, wanted: set[str]) -> None:
        self.present: dict[str, None] = {}
        core = require_library("pyulog.core", "px4", path)
        parser = _parser(core, wanted, self.present)
        # What pyulog prints of damage would stand among our own output.
        with _Source(path) as file, contextlib.redirect_stdout(io.StringIO()):
            try:
                log = parser(file, sorted(wanted))
            except Exception as error:  # damaged files make the library raise anything
                raise LogError(
                    f"is a ULog that is damaged ({type(error).__name__}: {str(error)[:100]}).".replace("\n", " "),
                    where=path,
                    mend="Download the log again, or leave it out.",
                ) from error
        self.topics: dict[str, Columns] = {_called(data.name, data.multi_id): data.data for data in log.data_list}
        self.parameters = {name: float(value) for name, value in log.initial_parameters.items()}
        self.remarks = _remarks(log, cut=file.cut)
        self._path = path

    def columns(self, topic: str) -> Columns:
        """What ``topic`` holds, with its instance behind a # or of the only one."""
        base, _, instance = topic.partition("#")
        columns = self.topics.get(base if instance == "0" else topic)
        if columns is None:
            raise missing_topic(self._path, KIND, topic, self.present)
        return columns


class _Source(io.BufferedReader):
    """A file that notes whether more was asked of it than it holds; it ends where it is read over and over."""

    def __init__(self, path: Path) -> None:
        super().__init__(io.FileIO(path))
        self.cut = False
        self._left = _READINGS * (path.stat().st_size + _LONGEST)
        self._before = 0

    def read(self, size: int | None = -1, /) -> bytes:
        """As of any file."""
        count = size or 0
        data = io.BufferedReader.read(self, size)  # called twice a message: super() takes its time
        self._left -= count
        if len(data) < count or self._left < 0:
            # A message begins with three bytes; where there is none the file may end.
            self.cut |= bool(data) or count != _HEAD or self._before == _HEAD
            return data if self._left >= 0 else b""
        self._before = count
        return data


def _parser(core: Any, wanted: set[str], present: dict[str, None]) -> Any:
    """The parser of pyulog, which keeps to topics of a possible size and notes all that are ``present``."""
    added = core.ULog._MessageAddLogged  # noqa: SLF001  # the only place at which it can be kept from unrolling
    left = _MOST_FIELDS

    class Added(added):  # type: ignore[misc, valid-type]  # pyulog ships no types
        def __init__(self, data: bytes, header: Any, formats: Mapping[str, Any]) -> None:
            nonlocal left
            name = core.ULog.parse_string(data[3:])
            present[_called(name, data[0])] = None
            if name not in wanted:
                self.message_name, self.msg_id = name, int.from_bytes(data[1:3], "little")
                return
            left -= _size(core, name, formats, {})
            if left < 0:
                raise ValueError("more fields than any log has")
            super().__init__(data, header, formats)

    return type("Parser", (core.ULog,), {"_MessageAddLogged": Added})


def _size(core: Any, name: str, formats: Mapping[str, Any], known: dict[str, int]) -> int:
    """Bytes of a message; the formats in ``known`` have been measured.

    Raises
    ------
    ValueError
        They are more than its length can say, or without end: a format holds itself.
    """
    if name in core.ULog._UNPACK_TYPES:  # noqa: SLF001  # the library's list of types has no other name
        return 1
    if name not in known:
        known[name] = _LONGEST  # until it is measured: a format that holds itself is too large
        known[name] = sum(max(1, count) * _size(core, kind, formats, known) for kind, count, _ in formats[name].fields)
        if known[name] >= _LONGEST:
            raise ValueError(f"{name} is longer than a message can be")
    return known[name]


def _remarks(log: Any, *, cut: bool) -> tuple[Remark, ...]:
    remarks = []
    if log.file_corruption or cut:
        text = "The file is cut or damaged; what could not be read of it was left out."
        remarks.append(Remark(kind="truncated", count=1, text=text))
    if log.dropouts:
        lost = sum(dropout.duration for dropout in log.dropouts)
        text = f"The logger fell behind {len(log.dropouts)} times and lost {lost / 1000.0:.1f} s in all."
        remarks.append(Remark(kind="gap", count=len(log.dropouts), text=text))
    return tuple(remarks)
