"""MCAP recordings: the mapped fields of the mapped topics, decoded from JSON, protobuf or ROS 2 messages."""

import io
import json
from collections.abc import Callable
from pathlib import Path

from mcap.records import Channel, Schema

from rovid.core.errors import LogError
from rovid.readers.mcap_container import MAX_MESSAGE, McapFile
from rovid.readers.message_topics import Decoder, Handler, TopicExtractor, TopicListing, ros_decoder
from rovid.readers.raw_log import LogContents, RawLog, required_signals
from rovid.trial.config import Config
from rovid.trial.trial import Remark

KIND = "mcap"


def read(path: Path, config: Config) -> RawLog:
    """Mapped fields of ``path``.

    ``time = { mcap = … }`` selects the clock: "log" (time of recording; the default), "publish", "header" (the
    message's own stamp), or a field of each message.
    """
    signals = required_signals(config, KIND, path)
    topics = TopicExtractor(path, KIND, signals, config.time)
    recording = _read_messages(path, topics.handler)
    if recording.missed > 0 and not recording.too_large:  # Messages outside the index are rare, but legal.
        topics = TopicExtractor(path, KIND, signals, config.time)
        recording = _read_messages(path, topics.handler, by_index=False)
    for topic, size in recording.too_large.items():
        text = f"topic {topic!r} has a message of {size / 1e6:.1f} MB; at most {MAX_MESSAGE / 1e6:.1f} MB was expected."
        raise LogError(text, where=path, mend="Map a topic of smaller messages.")
    unread = recording.size - recording.end
    damage = f" The recording is cut: {recording.damage}, {unread} bytes were not read." if recording.damage else ""
    damage += f" {_left_out(recording)}" if recording.chunks else ""
    return topics.result(lambda last: _damage_remarks(recording, last), damage)


def sources(path: Path) -> LogContents:
    """Every field that holds a number or an orientation."""
    listing = TopicListing(path, KIND)
    _read_messages(path, listing.handler)
    return listing.contents()


def _read_messages(path: Path, make_handler: Callable[..., Handler | None], *, by_index: bool = True) -> McapFile:
    """Read a file whose channels get their handlers from ``make_handler(topic, make_decoder, mapping=...)``."""

    def open_channel(channel: Channel, schema: Schema | None) -> Handler | None:
        is_json = channel.message_encoding == "json"
        return make_handler(channel.topic, lambda: _decoder(channel, schema, str(path)), mapping=is_json)

    with path.open("rb", buffering=1 << 16) as file:
        recording = McapFile(path=path, size=file.seek(0, io.SEEK_END), file=file, open_channel=open_channel)
        recording.read(by_index=by_index)
    return recording


def _damage_remarks(recording: McapFile, last: float) -> tuple[Remark, ...]:
    lost = (Remark(kind="damaged", count=recording.left_out, text=_left_out(recording)),) if recording.chunks else ()
    if not recording.damage:
        return lost
    unread = recording.size - recording.end
    text = (
        f"The recording is cut or damaged: {recording.damage}. The first {last:.1f} s were read; the last {unread} of "
        f"{recording.size} bytes are damaged."
    )
    if recording.rescued:
        text += f" {recording.rescued} messages were read from the damaged part."
    return (*lost, Remark(kind="truncated", count=unread, text=text))


def _left_out(recording: McapFile) -> str:
    chunks = "A chunk is" if recording.chunks == 1 else f"{recording.chunks} chunks are"
    return (
        f"{chunks} damaged: {recording.reason}. The messages in these {recording.left_out} of {recording.size} bytes "
        "are lost, and those after them were read."
    )


def _decoder(channel: Channel, schema: Schema | None, where: str) -> Decoder:
    """Function that turns payloads into objects; `LogError` if encoding or schema cannot be read."""
    encodings = channel.message_encoding, schema.encoding if schema else ""
    try:
        if encodings[0] == "json":
            return lambda payload: json.loads(str(payload, "utf-8"))
        if schema is not None and encodings == ("cdr", "ros2msg"):
            return ros_decoder(schema.name, schema.data.decode(), "cdr")
        if schema is not None and encodings == ("protobuf", "protobuf"):
            from mcap_protobuf.decoder import DecoderFactory

            if decoder := DecoderFactory().decoder_for("protobuf", schema):
                return decoder
    except Exception as error:  # Libraries raise any exception on damaged schemas.
        reason = f"{type(error).__name__}: {error}"[:120].split("\n", 1)[0]
        text = f"the schema of topic {channel.topic!r} cannot be parsed ({reason})."
        raise LogError(text, where=where, mend="Record the log again, or leave it out.") from error
    of_schema = f" with schema {encodings[1]!r}" if encodings[1] else " without a schema"
    text = f"topic {channel.topic!r} is encoded as {encodings[0]!r}{of_schema}; json, cdr with ros2msg, or protobuf "
    text += "with protobuf was expected."
    raise LogError(text, where=where, mend="Convert the recording (`mcap convert`), or map a topic in one of these.")
