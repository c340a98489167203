"""PX4 ULog, read by pyulog: the mapped fields of the mapped topics; ``topic#1.field`` is of its second instance."""

import contextlib
import io
from dataclasses import replace
from pathlib import Path

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.readers import raw_log
from rovid.trial.config import Config
from rovid.trial.trial import Remark

KIND = "ulg"
# Topics on motion, thrusters and supply, for `rovid init`.
_INTERESTING = {"vehicle_attitude", "vehicle_angular_velocity", "actuator_motors", "actuator_outputs", "battery_status"}
_MARK = b"ULog\x01\x12\x35"
_HEADER = 3
# Bytes that pyulog may read for each byte of the file, and in addition: damage makes it go back and read again.
_MAX_READS, _EXTRA_READS = 16, 1 << 16


def read(path: Path, config: Config) -> raw_log.RawLog:
    """Mapped fields of ``path``."""
    signals = raw_log.required_signals(config, KIND, path)
    names = {signal.sources[KIND].partition(".")[0].partition("#")[0] for signal in signals.values()}
    log = _ULog(path, names)
    clock = config.time.sources.get(KIND, "timestamp")
    raw = raw_log.raw_log_of_topics(path, KIND, signals, log.columns, clock, log.remarks)
    if "heading" not in signals:
        return raw
    topic, heading = signals["heading"].sources[KIND].partition(".")[0], raw.channels["heading"]
    return replace(raw, resets=_resets(log.columns(topic), heading.time, float(np.sign(signals["heading"].factor))))


def sources(path: Path) -> raw_log.LogContents:
    """Sources on motion, thrusters and supply."""
    log = _ULog(path, _INTERESTING)
    topics = {name: log.columns(name) for name in log.topics}
    return raw_log.LogContents(sources=tuple(raw_log.numeric_sources(topics)), parameters=log.parameters)


def _resets(columns: raw_log.Columns, time: FloatArray, sense: float) -> tuple[tuple[float, float], ...]:
    """(s, rad) of each reset of the heading that vehicle_attitude states; ``sense``: -1 for a reversed heading.

    delta_q_reset (w, x, y, z) is the rotation of the last reset.
    """
    counter, parts = columns.get("quat_reset_counter"), [f"delta_q_reset[{at}]" for at in (1, 2, 3, 0)]
    if counter is None or not columns.keys() >= set(parts):
        return ()
    at = np.flatnonzero(np.diff(counter.astype(np.int64))) + 1
    turns = sense * raw_log.euler(np.column_stack([columns[part][at].astype(np.float64) for part in parts]), "heading")
    return tuple(zip(time[at].tolist(), turns.tolist(), strict=True))


class _ULog:
    """The ``wanted`` topics of a log, by name and instance, and the autopilot's parameters at its beginning."""

    def __init__(self, path: Path, wanted: set[str]) -> None:
        raw_log.require_mark(path, _MARK, "a ULog of PX4")
        self._path = path
        core = raw_log.require_library("pyulog.core", "px4", path)
        # pyulog prints messages on damage to stdout, which holds rovid's own output.
        with _WatchedFile(path) as file, contextlib.redirect_stdout(io.StringIO()):
            try:
                log = core.ULog(file, sorted(wanted))
            except Exception as error:  # The library raises any exception on damaged files.
                mend = "Download the log again, or leave it out."
                raise raw_log.damaged(path, "a ULog that is damaged", error, mend) from error
        self.topics: dict[str, raw_log.Columns] = {}
        for data in log.data_list:
            self.topics[f"{data.name}#{data.multi_id}" if data.multi_id else data.name] = data.data
        self._present = {*self.topics, *log.message_formats}
        self.parameters = {name: float(value) for name, value in log.initial_parameters.items()}
        self.remarks: list[Remark] = []
        if log.file_corruption or file.is_cut:
            text = "The file is cut or damaged; its unreadable parts were left out."
            self.remarks.append(Remark(kind="truncated", count=1, text=text))
        if log.dropouts:
            lost = sum(dropout.duration for dropout in log.dropouts)
            text = f"The logger fell behind {len(log.dropouts)} times and lost {lost / 1000.0:.1f} s in all."
            self.remarks.append(Remark(kind="gap", count=len(log.dropouts), text=text))

    def columns(self, topic: str) -> raw_log.Columns:
        """Fields of ``topic``; its instance follows a #."""
        base, _, instance = topic.partition("#")
        columns = self.topics.get(base if instance == "0" else topic)
        if columns is None:
            raise raw_log.missing_topic(self._path, KIND, topic, dict.fromkeys(sorted(self._present)))
        return columns


class _WatchedFile(io.BufferedReader):
    """A file that notes whether it ended inside a message, and ends after too many repeated reads."""

    def __init__(self, path: Path) -> None:
        super().__init__(io.FileIO(path))
        self.is_cut = False
        self._left = _MAX_READS * (path.stat().st_size + _EXTRA_READS)
        self._before = 0

    def read(self, size: int | None = -1, /) -> bytes:
        """Up to ``size`` bytes."""
        count = size or 0
        data = io.BufferedReader.read(self, size)  # Called twice a message: super() is slower.
        self._left -= count
        if len(data) < count or self._left < 0:
            # A message begins with a header of three bytes; the file may end before one.
            self.is_cut |= bool(data) or count != _HEADER or self._before == _HEADER
            return data if self._left >= 0 else b""
        self._before = count
        return data
