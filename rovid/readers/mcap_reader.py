"""MCAP recordings: the wanted fields of the wanted topics, from whole and from cut files."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import BinaryIO

from mcap.records import Channel, Schema

from rovid.core.errors import LogError
from rovid.readers.mcap_container import LARGEST, Recording
from rovid.readers.mcap_messages import decoder
from rovid.readers.raw_log import LogContents, RawLog, mapped
from rovid.readers.topic_extractor import Handler, Listing, Topics
from rovid.trial.config import Config
from rovid.trial.signal_names import Signal
from rovid.trial.trial import Remark

KIND = "mcap"


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
        topics, recording = _collect(path, file, signals, config.time, by_index=True)
        if recording.missed > 0 and not recording.too_large:  # messages outside the index: rare, legal
            topics, recording = _collect(path, file, signals, config.time, by_index=False)
    for topic, size in recording.too_large.items():
        raise LogError(
            f"topic {topic!r} has a message of {size / 1e6:.1f} MB; at most {LARGEST / 1e6:.1f} MB was expected.",
            where=path,
            mend="Map a topic of smaller messages.",
        )
    unread = recording.size - recording.end
    damage = f" The recording is cut: {recording.damage}, {unread} bytes were not read." if recording.damage else ""
    return topics.result(lambda last: _cut(recording, last), damage)


def _collect(
    path: Path, file: BinaryIO, signals: Mapping[str, Signal], time: Signal, *, by_index: bool
) -> tuple[Topics, Recording]:
    topics = Topics(path, KIND, signals, time)

    def opened(channel: Channel, schema: Schema | None) -> Handler | None:
        mapping = channel.message_encoding == "json"
        topic = topics.open(channel.topic, mapping=mapping)
        return topic.handler(lambda: decoder(channel, schema, str(path)), mapping=mapping) if topic else None

    recording = Recording(path=path, size=file.seek(0, io.SEEK_END), file=file, open_channel=opened)
    recording.read(by_index=by_index)
    return topics, recording


def _cut(recording: Recording, last: float) -> tuple[Remark, ...]:
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


def sources(path: Path) -> LogContents:
    """Every field that holds a number or an orientation.

    Raises
    ------
    LogError
        It is no MCAP file.
    """
    listing = Listing(path, KIND)

    def opened(channel: Channel, schema: Schema | None) -> Handler | None:
        mapping = channel.message_encoding == "json"
        return listing.handler(channel.topic, lambda: decoder(channel, schema, str(path)), mapping=mapping)

    with path.open("rb", buffering=1 << 16) as file:
        size = file.seek(0, io.SEEK_END)
        Recording(path=path, size=size, file=file, open_channel=opened).read(by_index=True)
    return listing.contents()
