"""MCAP recordings: the wanted fields of the wanted topics, from whole and from cut files."""

from __future__ import annotations

import io
from array import array
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from mcap.records import Channel as McapChannel
from mcap.records import Schema
from numpy.typing import NDArray

from rovid.config import Config, Signal
from rovid.errors import LogError, nearest
from rovid.readers.instants import seconds
from rovid.readers.mcap_container import Handler, Recording
from rovid.readers.mcap_messages import Decoder, decoder
from rovid.readers.messages import (
    ABSENT,
    Getter,
    Pick,
    as_float,
    field_names,
    getter,
    split_fields,
    split_path,
    stamp_getter,
)
from rovid.readers.raw import Channel, RawLog, mapped
from rovid.trial import FloatArray, Remark

KIND = "mcap"
_CLOCKS = ("log", "publish", "header")
_LATEST = 2**63 - 1


def read(path: Path, config: Config) -> RawLog:
    """Wanted fields of ``path``.

    ``time = { mcap = … }`` chooses the clock: "log" (when it was recorded; the default), "publish", "header"
    (the message's own stamp), or a field of each message.

    Raises
    ------
    LogError
        It is no MCAP file, a topic or field is missing or not a number, or an encoding is not supported.
    ConfigError
        rovid.toml does not map the heading or a command for MCAP.
    """
    signals = mapped(config, KIND, path)
    with path.open("rb", buffering=1 << 16) as file:
        collector = _collect(path, file, signals, config.time, by_index=True)
        if collector.recording.missed > 0:  # messages outside the index: rare, legal
            collector = _collect(path, file, signals, config.time, by_index=False)
    return collector.result()


def _collect(path: Path, file: IO[bytes], signals: Mapping[str, Signal], time: Signal, *, by_index: bool) -> _Collector:
    collector = _Collector(path=path, file=file, signals=signals, time=time)
    collector.recording.read(by_index=by_index)
    return collector


class _Topic:
    """Collects the signals of one topic, message by message.

    Attributes
    ----------
    times
        The clock's reading at each message: ns, or what the chosen field holds.
    last
        The latest message, to name its fields in errors.
    """

    def __init__(self, name: str, clock: str, picks: list[Pick], where: str) -> None:
        self.name, self.clock, self.picks, self.where = name, clock, picks, where
        self.times: array[int] | list[Any] = array("q") if clock in _CLOCKS else []
        self.last: Any = None
        self._own: Getter | None = None

    def handler(self, decode: Decoder, *, mapping: bool) -> Handler:
        """What takes the messages of one channel of this topic."""
        picks, by_log, by_publish = self.picks, self.clock == "log", self.clock == "publish"

        def take(payload: bytes, log: int, publish: int) -> None:
            try:
                message = self.last = decode(payload)
            except Exception as error:  # damaged payloads make the libraries raise anything
                raise self._undecodable(error) from error
            try:
                self.times.append(
                    log if by_log else publish if by_publish else self._time_inside(message, mapping=mapping)
                )
            except OverflowError as error:
                raise self._complaint("has a time beyond the year 2262") from error
            for pick in picks:
                pick.take(message)

        return take

    def _time_inside(self, message: Any, *, mapping: bool) -> Any:
        if self._own is None:
            self._own = self._find_stamp(message, mapping=mapping)
        try:
            time = self._own(message)
        except (*ABSENT, ValueError, OverflowError) as error:
            raise self._no_stamp(message) from error
        if isinstance(time, bool) or not isinstance(time, int | float):
            raise self._no_stamp(message)
        return time

    def _find_stamp(self, message: Any, *, mapping: bool) -> Getter:
        if self.clock != "header":
            return getter(split_fields(self.clock), mapping=mapping)
        found = stamp_getter(message, mapping=mapping)
        if found is None:
            raise self._no_stamp(message)
        return found

    def _no_stamp(self, message: Any) -> LogError:
        wanted = "header.stamp" if self.clock == "header" else repr(self.clock)
        names = ", ".join(field_names(message)) or "none"
        return self._complaint(
            f"has no time {wanted}, which time in rovid.toml asks for; its fields: {names}",
            'Set time = { mcap = "log" } in [signals] to go by the time of recording.',
        )

    def _undecodable(self, error: Exception) -> LogError:
        return self._complaint(
            f"cannot be decoded ({type(error).__name__}: {str(error)[:100]})",
            "Record the log again, or leave it out.",
        )

    def _complaint(self, what: str, mend: str = "") -> LogError:
        return LogError(f"message {len(self.times) + 1} of topic {self.name!r} {what}.", where=self.where, mend=mend)


class _Collector:
    """Opens the channels that are wanted, and makes raw channels of what they gave."""

    def __init__(self, path: Path, file: IO[bytes], signals: Mapping[str, Signal], time: Signal) -> None:
        self.path, self.signals, self.time = path, signals, time
        self.clock = time.sources.get(KIND, "log")
        self.topics: dict[str, _Topic | None] = {}  # None: nobody wants it
        size = file.seek(0, io.SEEK_END)
        self.recording = Recording(path=path, size=size, file=file, open_channel=self._open)

    def _open(self, channel: McapChannel, schema: Schema | None) -> Handler | None:
        mapping = channel.message_encoding == "json"
        if channel.topic not in self.topics:
            self.topics[channel.topic] = self._topic(channel.topic, mapping=mapping)
        topic = self.topics[channel.topic]
        if topic is None:
            return None
        return topic.handler(decoder(channel, schema, str(self.path)), mapping=mapping)

    def _topic(self, name: str, *, mapping: bool) -> _Topic | None:
        picks = []
        for signal, mapped_to in self.signals.items():
            source = mapped_to.sources[KIND]
            fields = split_path(source, name)
            if fields is not None:
                picks.append(Pick(signal, source, fields, mapping=mapping, where=str(self.path)))
        return _Topic(name, self.clock, picks, str(self.path)) if picks else None

    def result(self) -> RawLog:
        """Raw channels.

        Raises
        ------
        LogError
            A topic is missing or empty, or its messages lack the field.
        """
        chosen = {signal: self._choose(signal, one.sources[KIND]) for signal, one in self.signals.items()}
        times = self._times({topic.name: topic for topic, _ in chosen.values()})
        channels = {
            signal: Channel(
                source=pick.source,
                clock=f"{self.clock} time of {topic.name}",
                time=times[topic.name],
                values=pick.column(),
                radians=pick.quaternion,
            )
            for signal, (topic, pick) in chosen.items()
        }
        return RawLog(
            channels=channels,
            place=lambda signal, index: f"message {index + 1} of {chosen[signal][0].name}",
            remarks=self._cut(max(float(np.max(time)) for time in times.values())),
            sortable=True,
        )

    def _choose(self, signal: str, source: str) -> tuple[_Topic, Pick]:
        """The longest topic that ``source`` begins with, and what it gave."""
        found = [name for name in self.topics if split_path(source, name) is not None]
        topic = self.topics[max(found, key=len)] if found else None
        if topic is None:
            raise self._missing(
                f"has no topic for {source!r}, which rovid.toml maps to {signal}. {nearest(source, self.topics)}",
                f'Write {signal} = {{ mcap = "<topic>.<field>" }} in rovid.toml.',
            )
        if not len(topic.times):
            raise self._missing(f"holds no message on topic {topic.name!r} ({signal}).", "Leave this log out.")
        pick = next(pick for pick in topic.picks if pick.signal == signal)
        if not pick.seen:
            names = ", ".join(field_names(topic.last)) or "none"
            raise self._missing(
                f"topic {topic.name!r} never holds the field {'.'.join(pick.fields) or 'of a quaternion'!r} "
                f"({signal}). Its fields: {names}.",
                f"Correct {signal} in rovid.toml.",
            )
        return topic, pick

    def _missing(self, what: str, mend: str) -> LogError:
        damage = self.recording.damage
        unread = self.recording.size - self.recording.end
        also = f" The recording is cut: {damage}, {unread} bytes were not read." if damage else ""
        return LogError(what + also, where=self.path, mend=mend)

    def _times(self, topics: Mapping[str, _Topic]) -> dict[str, FloatArray]:
        """(n,) s for each topic, from one common beginning."""
        logged = {name: _numbers(topic.times) for name, topic in topics.items()}
        if any(times.dtype.kind == "f" for times in logged.values()):
            logged = {name: times.astype(np.float64) for name, times in logged.items()}
        origin = min(int(times[0]) if times.dtype.kind == "i" else 0 for times in logged.values())
        unit = "ns" if self.clock in _CLOCKS else self.time.unit
        return {name: seconds(times, self.clock, unit, origin) for name, times in logged.items()}

    def _cut(self, last: float) -> tuple[Remark, ...]:
        recording = self.recording
        if not recording.damage:
            return ()
        unread = recording.size - recording.end
        text = (
            f"The recording is cut or damaged: {recording.damage}. {unread} of {recording.size} bytes were not "
            f"read; the last time read is {last:.1f} s after the first."
        )
        if recording.rescued:
            text += f" {recording.rescued} messages were rescued from its last chunk."
        return (Remark(kind="truncated", count=unread, text=text),)


def _numbers(times: array[int] | list[Any]) -> NDArray[Any]:
    """int64 where all are integers that fit, else float64."""
    if isinstance(times, array):
        return np.frombuffer(times, dtype=np.int64)
    whole = all(isinstance(time, int) and abs(time) < _LATEST for time in times)
    return np.array(times, dtype=np.int64) if whole else np.array([as_float(time) for time in times])
