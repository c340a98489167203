"""Write columns of numbers as an MCAP recording with JSON messages, for Foxglove, PlotJuggler and rovid."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rovid.core.array_types import FloatArray

# Unit -> end of a name with this unit.
SUFFIXES: Mapping[str, str] = {
    "rad": "rad",
    "deg": "deg",
    "m": "m",
    "rad/s": "rad_s",
    "m/s": "m_s",
    "N m": "Nm",
    "N": "N",
}


def name_with_unit(name: str, unit: str) -> str:
    """``name`` with its ``unit`` at the end, if the unit is known."""
    if unit not in SUFFIXES:
        return name
    return f"{name}_{SUFFIXES[unit]}"


@dataclass(frozen=True, kw_only=True, eq=False)
class OutputTopic:
    """One topic of a recording."""

    name: str
    time: FloatArray  #: (n,) s from the beginning of the recording.
    fields: Mapping[str, FloatArray]  #: Name -> (n,) numbers; messages leave out numbers that are not finite.
    units: Mapping[str, str]  #: Name -> unit for the schema; "" where unknown.

    def schema(self) -> dict[str, object]:
        """JSON schema of the messages."""
        fields = {}
        for name in self.fields:
            field = {"type": "number"}
            if self.units.get(name):
                field["description"] = self.units[name]
            fields[name] = field
        return {
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            "title": self.name.strip("/"),
            "type": "object",
            "properties": fields,
            "additionalProperties": False,
        }

    def messages(self) -> Iterator[tuple[int, bytes]]:
        """(ns, text) of every message that is not empty."""
        # Single numbers are read much faster from lists than from arrays.
        columns = [(name, values.tolist(), np.isfinite(values).tolist()) for name, values in self.fields.items()]
        for at, ns in enumerate(np.rint(self.time * 1e9).astype(np.int64).tolist()):
            message = {name: values[at] for name, values, known in columns if known[at]}
            if message:
                yield ns, json.dumps(message, separators=(",", ":")).encode()


def mcap_bytes(topics: Sequence[OutputTopic], library: str = "rovid") -> bytes:
    """A whole recording, in order of time; ``library`` is its writer."""
    from mcap.writer import CompressionType, Writer

    out = io.BytesIO()
    writer = Writer(out, compression=CompressionType.ZSTD)
    writer.start(profile="", library=library)
    messages = []
    for topic in topics:
        text = json.dumps(topic.schema()).encode()
        schema = writer.register_schema(f"rovid.{topic.name.strip('/')}", "jsonschema", text)
        channel = writer.register_channel(topic.name, "json", schema)
        messages += [(ns, channel, data) for ns, data in topic.messages()]
    for ns, channel, data in sorted(messages, key=lambda message: message[:2]):
        writer.add_message(channel, ns, data, ns)
    writer.finish()  # type: ignore[no-untyped-call]  # the library leaves its annotation out
    return out.getvalue()
