"""Converts an ArduPilot DataFlash log (.BIN) to MCAP: chosen messages at their own rates.

Run ``python -m tools.bluerov2_to_mcap 00000029_filtered.BIN dive.mcap``; it needs pymavlink. The log time of
a message is its TimeUS since the first attitude, so that the log begins with an attitude at time 0; what was
logged before that is left out. Messages and fields keep ArduPilot's names and units.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping
from pathlib import Path

from mcap.writer import CompressionType, Writer

_DEGREES = "deg"
_PER_SECOND = "deg/s"
# Message -> field -> unit.
MESSAGES: Mapping[str, Mapping[str, str]] = {
    "ATT": dict.fromkeys(("Roll", "Pitch", "Yaw", "DesYaw"), _DEGREES),
    "RATE": {**dict.fromkeys(("R", "P", "Y", "YDes"), _PER_SECOND), "YOut": "share of full command"},
    "RCOU": {f"C{channel}": "us" for channel in range(1, 9)},
    "BAT": {"Volt": "V", "Curr": "A"},
    "IMU": dict.fromkeys(("GyrX", "GyrY", "GyrZ"), "rad/s"),
}

Entry = tuple[str, int, dict[str, float]]


def read_messages(log: Path) -> Iterator[Entry]:
    """(message, us since the first attitude, fields) of every chosen message of ``log``, in its order."""
    from pymavlink.DFReader import DFReader_binary  # needed by nothing else here

    reader = DFReader_binary(str(log))
    origin: int | None = None
    while (message := reader.recv_match(type=list(MESSAGES))) is not None:
        name = message.get_type()
        if origin is None and name == "ATT":
            origin = message.TimeUS
        if origin is not None and message.TimeUS >= origin:
            fields = {field: _shortest(getattr(message, field)) for field in MESSAGES[name]}
            yield name, message.TimeUS - origin, fields


def _shortest(value: float) -> float:
    """``value``, logged as a 32-bit float, with no more digits than that holds."""
    return value if isinstance(value, int) else float(f"{value:.9g}")


def write_mcap(entries: Iterator[Entry], out: Path) -> None:
    """Write ``entries`` as JSON messages on the topics /ATT, /RATE, ..., in zstd chunks."""
    with out.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD)
        writer.start()
        channels = {name: _channel(writer, name) for name in MESSAGES}
        for name, microseconds, fields in sorted(entries, key=lambda entry: entry[1]):
            time = microseconds * 1000
            text = json.dumps(fields, separators=(",", ":"), allow_nan=False)
            writer.add_message(channels[name], time, text.encode(), time)
        writer.finish()  # type: ignore[no-untyped-call]


def _channel(writer: Writer, name: str) -> int:
    units = MESSAGES[name].items()
    fields = {field: {"type": "number", "description": unit} for field, unit in units}
    schema = {"type": "object", "properties": fields}
    identifier = writer.register_schema(f"ardupilot/{name}", "jsonschema", json.dumps(schema).encode())
    return writer.register_channel(f"/{name}", "json", identifier)


def main() -> None:
    """Convert from the command line."""
    parser = argparse.ArgumentParser(description="Convert an ArduPilot DataFlash log to MCAP.")
    parser.add_argument("log", type=Path, help="the .BIN log")
    parser.add_argument("out", type=Path, help="the .mcap to write")
    arguments = parser.parse_args()
    write_mcap(read_messages(arguments.log), arguments.out)


if __name__ == "__main__":
    main()
