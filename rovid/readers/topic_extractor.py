"""Logs of messages by topic: what the wanted topics hold of the wanted signals, each on one of the messages' clocks."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rovid.core.array_types import FloatArray
from rovid.core.errors import LogError, suggestion
from rovid.readers.field_access import (
    ABSENT,
    Getter,
    Pick,
    as_float,
    field_names,
    fields_of,
    getter,
    split_fields,
    split_path,
    stamp_getter,
)
from rovid.readers.raw_log import Channel, LogContents, RawLog
from rovid.readers.timestamps import EPOCH_FROM, to_seconds
from rovid.trial.signal_names import Signal
from rovid.trial.trial import Remark

Decoder = Callable[[bytes], Any]
Handler = Callable[[bytes, int, int], None]  # payload, log time ns, publish time ns

_CLOCKS = ("log", "publish", "header")
_LATEST = 2**63 - 1
_STAMPED = {"header", "stamp", "timestamp"}
_QUATERNIONS = {"orientation", "quaternion", "rotation"}


class TopicCollector:
    """Collects the signals of one topic, message by message.

    Attributes
    ----------
    times
        The clock's reading at each message: ns, or what the chosen field holds.
    last
        The latest message, to name its fields in errors.
    trouble
        Why reading ended early, of a topic that a log may lack.
    """

    def __init__(self, name: str, kind: str, clock: str, picks: list[Pick], where: str) -> None:
        self.name, self.kind, self.clock, self.picks, self.where = name, kind, clock, picks, where
        self.times: array[int] | list[Any] = array("q") if clock in _CLOCKS else []
        self.last: Any = None
        self.trouble: LogError | None = None
        self._own: Getter | None = None

    @property
    def optional(self) -> bool:
        """Whether a log may lack it."""
        return all(pick.optional for pick in self.picks)

    def handler(self, decoder: Callable[[], Decoder], *, mapping: bool) -> Handler | None:
        """What takes the messages of one channel of this topic; None where an optional one cannot be decoded."""
        try:
            decode = decoder()
        except LogError as error:
            if not self.optional:
                raise
            self.trouble = error
            return None
        # Looked up once, not at each of a million messages.
        picks, by_log, by_publish = self.picks, self.clock == "log", self.clock == "publish"

        def take(payload: bytes, log: int, publish: int) -> None:
            try:
                message = self.last = decode(payload)
            except Exception as error:  # damaged payloads make the libraries raise anything
                raise self._undecodable(error) from error
            try:
                if by_log:
                    self.times.append(log)
                elif by_publish:
                    self.times.append(publish)
                else:
                    self.times.append(self._time_inside(message, mapping=mapping))
            except OverflowError as error:
                raise self._complaint("has a time beyond the year 2262") from error
            for pick in picks:
                pick.take(message)

        def attempt(payload: bytes, log: int, publish: int) -> None:
            try:
                if self.trouble is None:
                    take(payload, log, publish)
            except LogError as error:
                self.trouble = error

        return attempt if self.optional else take

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
        stamp_of = stamp_getter(message, mapping=mapping)
        if stamp_of is None:
            raise self._no_stamp(message)
        return stamp_of

    def _no_stamp(self, message: Any) -> LogError:
        wanted = "header.stamp" if self.clock == "header" else repr(self.clock)
        names = ", ".join(field_names(message)) or "none"
        mend = f'Set time = {{ {self.kind} = "log" }} in [signals] to go by the time of recording.'
        return self._complaint(f"has no time {wanted}, which time in rovid.toml asks for; its fields: {names}", mend)

    def _undecodable(self, error: Exception) -> LogError:
        return self._complaint(
            f"cannot be decoded ({type(error).__name__}: {str(error)[:100]})",
            "Record the log again, or leave it out.",
        )

    def _complaint(self, what: str, mend: str = "") -> LogError:
        return LogError(f"message {len(self.times) + 1} of topic {self.name!r} {what}.", where=self.where, mend=mend)


class Topics:
    """Opens the topics that are wanted, and makes raw channels of what they gave.

    Parameters
    ----------
    kind
        The format's key in the sources of rovid.toml.
    time
        Its source chooses the clock: "log" (when it was recorded; the default), "publish", "header" (the message's
        own stamp), or a field of each message.
    """

    def __init__(self, path: Path, kind: str, signals: Mapping[str, Signal], time: Signal) -> None:
        self.path, self.kind, self.signals, self.time = path, kind, signals, time
        self.clock = time.sources.get(kind, "log")
        self.topics: dict[str, TopicCollector | None] = {}  # None: nobody wants it
        self.damage = ""

    def open(self, name: str, *, mapping: bool) -> TopicCollector | None:
        """The topic ``name``, whose messages are dictionaries where ``mapping``; None where nobody wants it."""
        if name not in self.topics:
            self.topics[name] = self._topic(name, mapping=mapping)
        return self.topics[name]

    def _topic(self, name: str, *, mapping: bool) -> TopicCollector | None:
        picks = []
        where = str(self.path)
        for signal, mapped_to in self.signals.items():
            source = mapped_to.sources[self.kind]
            fields = split_path(source, name)
            if fields is not None:
                pick = Pick(signal, source, fields, mapping=mapping, where=where, optional=mapped_to.optional)
                picks.append(pick)
        if not picks:
            return None
        return TopicCollector(name, self.kind, self.clock, picks, where)

    def result(self, remarks: Callable[[float], tuple[Remark, ...]], damage: str = "") -> RawLog:
        """Raw channels.

        Parameters
        ----------
        remarks
            What there is to say of the file, by the last time in s that was read of it.
        damage
            Sentence on what of the file was not read, for errors.

        Raises
        ------
        LogError
            A topic is missing or empty, or its messages lack the field.
        """
        self.damage = damage
        chosen: dict[str, tuple[TopicCollector, Pick]] = {}
        lacking: dict[str, None] = {}
        for signal, one in self.signals.items():
            try:
                chosen[signal] = self._choose(signal, one.sources[self.kind])
            except LogError as error:
                if not one.optional:
                    raise
                lacking[str(error)] = None
        if not chosen:
            raise LogError("holds nothing that can be read.", where=self.path, mend=next(iter(lacking), ""))
        times, origin = self._times({topic.name: topic for topic, _ in chosen.values()})
        channels = {}
        for signal, (topic, pick) in chosen.items():
            channels[signal] = Channel(
                source=pick.source,
                clock=f"{self.clock} time of {topic.name}",
                time=times[topic.name],
                values=pick.column(),
                radians=pick.quaternion,
            )
        last = max(float(np.max(time)) for time in times.values())
        skipped = [Remark(kind="skipped", count=1, text=text) for text in lacking]
        return RawLog(
            channels=channels,
            place=lambda signal, index: f"message {index + 1} of {chosen[signal][0].name}",
            remarks=(*remarks(last), *skipped),
            sortable=True,
            epoch=self._epoch(origin),
        )

    def _epoch(self, origin: int) -> float | None:
        """Seconds since 1970 of time zero; None where the clock does not count from then."""
        if self.clock not in _CLOCKS:
            return None
        epoch = origin * 1e-9
        return epoch if epoch > EPOCH_FROM else None

    def _choose(self, signal: str, source: str) -> tuple[TopicCollector, Pick]:
        """The longest topic that ``source`` begins with, and what it gave."""
        fitting = [name for name in self.topics if split_path(source, name) is not None]
        longest = max(fitting, key=len, default="")
        topic = self.topics.get(longest)
        if topic is None:
            raise self._missing(
                f"has no topic for {source!r}, which rovid.toml maps to {signal}. {suggestion(source, self.topics)}",
                f'Write {signal} = {{ {self.kind} = "<topic>.<field>" }} in rovid.toml.',
            )
        if topic.trouble is not None:
            raise topic.trouble
        if not len(topic.times):
            raise self._missing(f"holds no message on topic {topic.name!r} ({signal}).", "Leave this log out.")
        pick = next(pick for pick in topic.picks if pick.signal == signal)
        if not pick.seen:
            raise self._never_seen(topic, pick)
        return topic, pick

    def _never_seen(self, topic: TopicCollector, pick: Pick) -> LogError:
        field = ".".join(pick.fields) or "of a quaternion"
        names = ", ".join(field_names(topic.last)) or "none"
        text = f"topic {topic.name!r} never holds the field {field!r} ({pick.signal}). Its fields: {names}."
        return self._missing(text, f"Correct {pick.signal} in rovid.toml.")

    def _missing(self, what: str, mend: str) -> LogError:
        return LogError(what + self.damage, where=self.path, mend=mend)

    def _times(self, topics: Mapping[str, TopicCollector]) -> tuple[dict[str, FloatArray], int]:
        """(n,) s for each topic, from one common beginning, and that as logged."""
        logged = {name: _numbers(topic.times) for name, topic in topics.items()}
        origin = 0
        if any(times.dtype.kind == "f" for times in logged.values()):
            logged = {name: times.astype(np.float64) for name, times in logged.items()}
        else:
            # As whole numbers, before they become floats, which would lose digits of the ns since 1970.
            origin = min(int(times[0]) for times in logged.values())
        unit = "ns" if self.clock in _CLOCKS else self.time.unit
        since = {name: to_seconds(times, self.clock, unit, origin) for name, times in logged.items()}
        return since, origin


def _numbers(times: array[int] | list[Any]) -> NDArray[Any]:
    """int64 where all are integers that fit, else float64."""
    if isinstance(times, array):
        return np.frombuffer(times, dtype=np.int64)
    if all(isinstance(time, int) and abs(time) < _LATEST for time in times):
        return np.array(times, dtype=np.int64)
    return np.array([as_float(time) for time in times])


class Listing:
    """What the topics of a log hold, by the first message of each; one that cannot be read hides no other."""

    def __init__(self, path: Path, kind: str) -> None:
        self.path, self.kind = path, kind
        self._topics: list[TopicCollector] = []

    def handler(self, name: str, decoder: Callable[[], Decoder], *, mapping: bool) -> Handler | None:
        """What takes the messages of a channel of the topic ``name``; None where ``decoder`` finds no way to."""
        topic = TopicCollector(name, self.kind, "log", [], str(self.path))
        self._topics.append(topic)
        take = topic.handler(decoder, mapping=mapping)
        if take is None:
            return None

        def first(payload: bytes, log: int, publish: int) -> None:
            if topic.last is None:
                take(payload, log, publish)

        return first

    def contents(self, damage: Iterable[str] = ()) -> LogContents:
        """Every number and orientation; ``damage`` is what is known to be lacking."""
        # In the order of the log, each once.
        fields: dict[str, None] = {}
        trouble = []
        for topic in self._topics:
            fields |= dict.fromkeys(numeric_fields(topic.last, topic.name))
            if topic.trouble:
                trouble.append(str(topic.trouble))
        lost = [f"{self.path}: {text}" for text in damage]
        return LogContents(sources=tuple(fields), unreadable=(*trouble, *lost))


def numeric_fields(message: Any, topic: str) -> Iterator[str]:
    """Sources of every number and orientation in ``message``, stamps left out."""
    for name, value in fields_of(message):
        *inside, last = name.split(".")
        if _STAMPED & {*inside, last}:
            continue
        if last in "xyzw" and inside and inside[-1] in _QUATERNIONS:
            yield f"{topic}.{'.'.join(inside)}"
        elif isinstance(value, int | float | np.number) and not isinstance(value, bool):
            yield f"{topic}.{name}"
