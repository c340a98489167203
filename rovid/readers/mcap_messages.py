"""The encodings of MCAP messages."""

from __future__ import annotations

import json
from typing import Any

from mcap.records import Channel, Schema

from rovid.core.errors import LogError
from rovid.readers.topic_extractor import Decoder


def decoder(channel: Channel, schema: Schema | None, where: str) -> Decoder:
    """What turns the channel's payloads into objects.

    Raises
    ------
    LogError
        The encoding is not supported, or its schema makes no sense.
    """
    encodings = channel.message_encoding, schema.encoding if schema else ""
    if encodings[0] == "json":
        return _json
    made: Decoder | None
    try:
        if schema is not None and encodings == ("cdr", "ros2msg"):
            from rovid.readers.ros2_cdr import decoder as ros2

            made = ros2(schema.name, schema.data.decode())
        elif schema is not None and encodings == ("protobuf", "protobuf"):
            from mcap_protobuf.decoder import DecoderFactory as Protobuf

            made = Protobuf().decoder_for("protobuf", schema)
        else:
            raise _unsupported(channel, encodings, where)
    except LogError:
        raise
    except Exception as error:  # a damaged schema makes the libraries raise anything
        raise LogError(
            f"the schema of topic {channel.topic!r} cannot be parsed ({_brief(error)}).",
            where=where,
            mend="Record the log again, or leave it out.",
        ) from error
    if made is None:
        raise _unsupported(channel, encodings, where)
    return made


def _unsupported(channel: Channel, encodings: tuple[str, str], where: str) -> LogError:
    schema = f" with schema {encodings[1]!r}" if encodings[1] else " without a schema"
    return LogError(
        f"topic {channel.topic!r} is encoded as {encodings[0]!r}{schema}; json, cdr with ros2msg, or protobuf "
        "with protobuf was expected.",
        where=where,
        mend="Convert the recording (`mcap convert`), or map a topic in one of these.",
    )


def _json(payload: bytes) -> Any:
    return json.loads(str(payload, "utf-8"))


def _brief(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}"[:120].split("\n", 1)[0]
