"""Logs of messages by topic (MCAP, ROS bags): the mapped fields of the mapped topics, on a clock of the messages."""

from __future__ import annotations

import re
from array import array
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rovid.core.errors import LogError, suggestion
from rovid.readers import message_fields
from rovid.readers.raw_log import Channel, LogContents, RawLog
from rovid.readers.timestamps import EPOCH_FROM, to_seconds
from rovid.trial.axis import Signal
from rovid.trial.trial import Remark

Decoder = Callable[[bytes], Any]
Handler = Callable[[bytes, int, int], None]  # payload, log time ns, publish time ns

_SEPARATOR = re.compile(r"^={3,}\s*$", re.MULTILINE)
# Clocks in ns; any other is a field of each message.
_CLOCKS = ("log", "publish", "header")
# ns, in the year 2262; a single later stamp comes from damage and counts as this one, far from its neighbours.
_LAST_NS = 2**63 - 1


@lru_cache(64)  # Compiling a definition takes longer than reading a short log.
def ros_decoder(kind: str, definition: str, encoding: str) -> Decoder:
    """Function that decodes messages of the type ``kind`` by rosbags; of ROS 2's own types without a ``definition``.

    Raises KeyError if the type, or one inside it, is not defined; ValueError if ``encoding`` is neither "cdr" nor
    "ros1". rosbags raises further exceptions for a definition that cannot be parsed.
    """
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    if encoding not in {"cdr", "ros1"}:
        raise ValueError(f"the encoding {encoding!r} is neither cdr nor ros1")
    store = get_typestore(Stores.EMPTY if definition else Stores.LATEST)
    if definition:
        # rosbags expects separators of 80 signs, and a definition after each.
        types = get_types_from_msg(_SEPARATOR.sub("=" * 80, definition.rstrip("= \n")), kind)
        store.register(types)
        kind = next(iter(types))
    store.get_msgdef(kind)  # Raises for types inside it that are not defined.
    decode = store.deserialize_cdr if encoding == "cdr" else store.deserialize_ros1
    return lambda payload: decode(payload, kind)


class TopicCollector:
    """Collects the signals of one topic, message by message."""

    def __init__(
        self, name: str, kind: str, clock: str, collectors: list[message_fields.FieldCollector], where: str
    ) -> None:
        self.name, self.kind, self.clock, self.collectors, self.where = name, kind, clock, collectors, where
        # Time of each message: ns, or the value of the chosen field.
        self.times: array[int] | list[Any] = array("q") if clock in _CLOCKS else []
        self.last: Any = None  # The latest message; error messages list its fields.
        self.error: LogError | None = None  # Why reading an optional topic ended early.
        self._get_stamp: message_fields.Getter | None = None
        self.in_ns = clock in _CLOCKS

    def handler(self, make_decoder: Callable[[], Decoder], *, mapping: bool) -> Handler | None:
        """Function that takes the messages of one channel; None for an optional topic that cannot be decoded."""
        optional = all(collector.signal.optional for collector in self.collectors)
        try:
            decode = make_decoder()
        except LogError as error:
            if not optional:
                raise
            self.error = error
            return None
        # Local names are fast: there may be a million messages.
        collectors, by_log, by_publish = self.collectors, self.clock == "log", self.clock == "publish"

        def take(payload: bytes, log: int, publish: int) -> None:
            try:
                message = self.last = decode(payload)
            except Exception as error:  # Libraries raise any exception on damaged payloads.
                text = f"cannot be decoded ({type(error).__name__}: {str(error)[:100]})"
                raise self._message_error(text, "Record the log again, or leave it out.") from error
            try:
                if by_log:
                    self.times.append(log)
                elif by_publish:
                    self.times.append(publish)
                else:
                    self.times.append(self._stamp(message, mapping=mapping))
            except OverflowError as error:
                if self.times and self.times[-1] == _LAST_NS:
                    raise self._message_error("has a time beyond the year 2262") from error
                self.times.append(_LAST_NS)
            for collector in collectors:
                collector.take(message)

        def attempt(payload: bytes, log: int, publish: int) -> None:
            try:
                if self.error is None:
                    take(payload, log, publish)
            except LogError as error:
                self.error = error

        return attempt if optional else take

    def _stamp(self, message: Any, *, mapping: bool) -> Any:
        """Time inside a message: ns of its own stamp, or the chosen field."""
        if self._get_stamp is None:
            if self.clock == "header":
                self._get_stamp = message_fields.stamp_getter(message, mapping=mapping) or (lambda _: None)
            else:
                fields = message_fields.split_fields(self.clock)
                stamp = message_fields.stamp_getter(message, mapping=mapping, clock=fields)
                self.in_ns = stamp is not None
                self._get_stamp = stamp or message_fields.getter(fields, mapping=mapping)
        try:
            time = self._get_stamp(message)
        except (*message_fields.ABSENT, ValueError, OverflowError):
            time = None
        if isinstance(time, int | float) and not isinstance(time, bool):
            return time
        wanted = "header.stamp" if self.clock == "header" else repr(self.clock)
        mend = f'Set time = {{ {self.kind} = "log" }} in [signals] to use the time of recording.'
        listed = message_fields.listed_fields(message)
        text = f"has no time {wanted}, which time in rovid.toml names; its fields: {listed}"
        raise self._message_error(text, mend)

    def _message_error(self, problem: str, mend: str = "") -> LogError:
        text = f"message {len(self.times) + 1} of topic {self.name!r} {problem}."
        return LogError(text, where=self.where, mend=mend)


class TopicExtractor:
    """Opens the mapped topics of a log and builds raw channels from their messages.

    The source of ``time`` for the format ``kind`` is the clock: "log" (time of recording; the default), "publish",
    "header" (the message's own stamp), or a field of each message.
    """

    def __init__(self, path: Path, kind: str, signals: Mapping[str, Signal], time: Signal) -> None:
        self.path, self.kind, self.signals, self.time = path, kind, signals, time
        self.clock = time.sources.get(kind, "log")
        self.topics: dict[str, TopicCollector | None] = {}  # None: no signal is mapped to the topic.
        self.damage = ""

    def handler(self, name: str, make_decoder: Callable[[], Decoder], *, mapping: bool) -> Handler | None:
        """Function that takes the messages of a channel of the topic ``name``; None where no signal is mapped to it.

        ``mapping``: the messages are dictionaries (JSON), not objects.
        """
        if name not in self.topics:
            where, collectors = str(self.path), []
            for signal in self.signals.values():
                source = signal.sources[self.kind]
                if (fields := message_fields.split_path(source, name)) is not None:
                    one = message_fields.FieldCollector(signal, source, fields, mapping=mapping, where=where)
                    collectors.append(one)
            topic = TopicCollector(name, self.kind, self.clock, collectors, where)
            self.topics[name] = topic if collectors else None
        found = self.topics[name]
        return None if found is None else found.handler(make_decoder, mapping=mapping)

    def result(self, remarks: Callable[[float], tuple[Remark, ...]], damage: str = "") -> RawLog:
        """Raw channels; `LogError` if a topic is missing or empty, or its messages lack the field.

        ``remarks`` maps the last time read, in s, to remarks on the file; errors quote ``damage``, a sentence on unread
        parts.
        """
        self.damage = damage
        chosen: dict[str, tuple[TopicCollector, message_fields.FieldCollector]] = {}
        lacking: dict[str, None] = {}
        for signal, mapped_to in self.signals.items():
            try:
                chosen[signal] = self._choose(signal, mapped_to.sources[self.kind])
            except LogError as error:
                if not mapped_to.optional:
                    raise
                lacking[str(error)] = None
        if not chosen:
            raise LogError("holds nothing that can be read.", where=self.path, mend=next(iter(lacking), ""))
        times, origin = self._times({topic.name: topic for topic, _ in chosen.values()})
        channels = {}
        for signal, (topic, collector) in chosen.items():
            channels[signal] = Channel(
                source=collector.source,
                clock=f"{self.clock} time of {topic.name}",
                time=times[topic.name],
                values=collector.column(),
                radians=collector.quaternion,
            )
        epoch = origin * 1e-9
        last = max(float(np.max(time)) for time in times.values())
        skipped = [Remark(kind="skipped", count=1, text=text) for text in lacking]
        return RawLog(
            channels=channels,
            place=lambda signal, index: f"message {index + 1} of {chosen[signal][0].name}",
            remarks=(*remarks(last), *skipped),
            sparse=any(collector.comes_and_goes for _, collector in chosen.values()),
            sortable=True,
            epoch=epoch if all(topic.in_ns for topic, _ in chosen.values()) and epoch > EPOCH_FROM else None,
        )

    def _choose(self, signal: str, source: str) -> tuple[TopicCollector, message_fields.FieldCollector]:
        """The longest topic that ``source`` begins with, and its field."""
        matching = [name for name in self.topics if message_fields.split_path(source, name) is not None]
        topic = self.topics.get(max(matching, key=len, default=""))
        if topic is None:
            text = f"has no topic for {source!r}, which rovid.toml maps to {signal}. {suggestion(source, self.topics)}"
            raise self._missing(text, f'Write {signal} = {{ {self.kind} = "<topic>.<field>" }} in rovid.toml.')
        if topic.error is not None:
            raise topic.error
        if not len(topic.times):
            raise self._missing(f"holds no message on topic {topic.name!r} ({signal}).", "Leave this log out.")
        collector = next(one for one in topic.collectors if one.signal.name == signal)
        siblings = any(other.seen and other.comes_and_goes for other in topic.collectors)
        if not collector.seen and not (siblings and collector.comes_and_goes):
            field = ".".join(collector.fields) or "of a quaternion"
            text = f"topic {topic.name!r} never holds the field {field!r} ({signal})."
            text += f" Its fields: {message_fields.listed_fields(topic.last)}."
            raise self._missing(text, f"Correct {signal} in rovid.toml.")
        return topic, collector

    def _missing(self, problem: str, mend: str) -> LogError:
        return LogError(problem + self.damage, where=self.path, mend=mend)

    def _times(self, topics: Mapping[str, TopicCollector]) -> tuple[dict[str, NDArray[np.float64]], int]:
        """(n,) s of each topic, from one common origin, and the origin as logged."""
        logged, origin = dict[str, NDArray[Any]](), 0
        for name, topic in topics.items():
            if isinstance(topic.times, array):
                logged[name] = np.frombuffer(topic.times, dtype=np.int64)
            elif all(isinstance(time, int) and abs(time) < _LAST_NS for time in topic.times):
                logged[name] = np.array(topic.times, dtype=np.int64)
            else:
                logged[name] = np.array(list(map(message_fields.as_float, topic.times)))
        if any(times.dtype.kind == "f" for times in logged.values()):
            logged = {name: times.astype(np.float64) for name, times in logged.items()}
        else:
            # Integers: floats would lose digits of the ns since 1970.
            origin = min(int(times[0]) for times in logged.values())
        units = {name: "ns" if topic.in_ns else self.time.unit for name, topic in topics.items()}
        return {name: to_seconds(times, self.clock, units[name], origin) for name, times in logged.items()}, origin


class TopicListing:
    """Contents of all topics, by the first message of each; an unreadable topic does not hide the others."""

    def __init__(self, path: Path, kind: str) -> None:
        self.path, self.kind = path, kind
        self._topics: list[TopicCollector] = []

    def handler(self, name: str, make_decoder: Callable[[], Decoder], *, mapping: bool) -> Handler | None:
        """Function that takes the messages of a channel of the topic ``name``; None if they cannot be decoded."""
        topic = TopicCollector(name, self.kind, "log", [], str(self.path))
        self._topics.append(topic)
        take = topic.handler(make_decoder, mapping=mapping)
        if take is None:
            return None

        def take_first(payload: bytes, log: int, publish: int) -> None:
            if topic.last is None:
                take(payload, log, publish)

        return take_first

    def contents(self, damage: Iterable[str] = ()) -> LogContents:
        """Every number and orientation, in the order of the log; ``damage`` describes unread parts."""
        sources: dict[str, None] = {}
        unreadable = []
        for topic in self._topics:
            sources |= dict.fromkeys(message_fields.numeric_fields(topic.last, topic.name))
            if topic.error:
                unreadable.append(str(topic.error))
        unreadable += [f"{self.path}: {text}" for text in damage]
        return LogContents(sources=tuple(sources), unreadable=tuple(unreadable))
