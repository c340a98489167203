"""Convert a log to CSV, MCAP or Parquet, with the lines of rovid.toml that map the new log."""

import io
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from rovid.core.array_types import FloatArray
from rovid.core.errors import ConfigError
from rovid.core.formatting import field_names, toml_text
from rovid.core.input_files import require_exists
from rovid.core.output_files import LOG, OutputFile
from rovid.readers import read_log
from rovid.readers.raw_log import require_library
from rovid.trial.axis import ANGLE_UNITS, SIGNAL_UNITS
from rovid.trial.config import Config
from rovid.trial.trial import Trial

# Unit -> end of a name with this unit.
SUFFIXES: Mapping[str, str] = {
    unit: unit.replace("/", "_").replace(" ", "") for unit in ("rad", "deg", "m", "rad/s", "m/s", "N m", "N")
}


def name_with_unit(name: str, unit: str) -> str:
    """``name`` with its ``unit`` at the end, if the unit is known."""
    return f"{name}_{SUFFIXES[unit]}" if unit in SUFFIXES else name


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
            unit = self.units.get(name)
            fields[name] = {"type": "number", "description": unit} if unit else {"type": "number"}
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


_SUFFIXES = (".csv", ".mcap", ".parquet")
_TOPIC, _TIME, _COMMAND = "/trial", "time_s", "command."
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


@dataclass(frozen=True, kw_only=True, eq=False)
class Converted:
    """A trial, the content of its new file, and the ``mapping``: lines for rovid.toml."""

    trial: Trial
    content: bytes
    mapping: str


@dataclass(frozen=True, kw_only=True, eq=False)
class _Column:
    """(n,) numbers of one signal in ``unit``; "" if only the user knows it."""

    signal: str
    name: str
    numbers: FloatArray
    unit: str


def output_at(target: Path, log: Path) -> OutputFile:
    """The output at ``target``, checked before ``log`` is read."""
    require_exists(log)
    if log.is_dir():
        raise ConfigError("is a folder; one log was expected.", where=log)
    if target.suffix.lower() not in _SUFFIXES:
        text = f"has the suffix {target.suffix!r}; one of {', '.join(_SUFFIXES)} was expected."
        raise ConfigError(text, where=f"-o {target}")
    if target.exists() and target.samefile(log):
        raise ConfigError("is the log itself.", where=f"-o {target}", mend="Choose another name.")
    return OutputFile(target, LOG)


def convert(log: Path, config: Config, target: Path) -> Converted:
    """``log`` as read by rovid, in order of time and without faulty values, in the format of ``target``."""
    # The new log holds the angle of a rudder, not the torque that follows from it.
    thrusters = tuple(replace(thruster, steering=None) for thruster in config.vehicle.thrusters)
    trial = read_log(log, replace(config, vehicle=replace(config.vehicle, thrusters=thrusters)))
    columns = _columns(trial, config)
    kind = target.suffix.lower().removeprefix(".")
    if kind == "mcap":
        fields = {column.name: column.numbers for column in columns}
        units = {column.name: column.unit for column in columns}
        content = mcap_bytes([OutputTopic(name=_TOPIC, time=trial.time, fields=fields, units=units)])
    else:
        frame = pd.DataFrame({_TIME: trial.time, **{column.name: column.numbers for column in columns}})
        if kind == "parquet":
            require_library("pyarrow", "parquet", target)
            content = frame.to_parquet(index=False)
        else:
            # 14 digits: further digits, beyond 1 ns in a day and 1 ndeg, are rounding errors.
            content = frame.to_csv(index=False, float_format="%.14g", lineterminator="\n").encode()
    return Converted(trial=trial, content=content, mapping=_mapping(columns, kind, config))


def _columns(trial: Trial, config: Config) -> list[_Column]:
    axis = trial.axis
    signals: dict[str, FloatArray | None] = {}
    if not trial.rate_only:
        signals[axis.position_signal] = trial.position
    signals[axis.rate_signal] = trial.rate
    # In roll or pitch the position is one of these already.
    signals.setdefault("roll", trial.roll)
    signals.setdefault("pitch", trial.pitch)
    for command, values in zip(config.commands, trial.commands.T, strict=True):
        signals[command.name] = values
    columns: dict[str, _Column] = {}
    steered = {
        command.name for command, one in zip(config.commands, config.vehicle.thrusters, strict=True) if one.steering
    }
    for signal, found in {**signals, **trial.extras}.items():
        if found is None or not np.isfinite(found).any():
            continue
        # SI, but degrees for angles; a user's own signal keeps its unknown unit.
        units = ANGLE_UNITS if signal in steered else SIGNAL_UNITS.get(signal, {})
        unit = "deg" if units is ANGLE_UNITS else next((unit for unit, factor in units.items() if factor == 1.0), "")
        values = np.rad2deg(found) if unit == "deg" else found
        if signal == "heading":
            values = np.remainder(values, 360.0)
        text = name_with_unit(re.sub(r"\W+", "_", signal), unit)
        [name] = field_names([text], taken={*columns, _TIME})
        columns[name] = _Column(signal=signal, name=name, numbers=values, unit=unit)
    return list(columns.values())


def _mapping(columns: list[_Column], kind: str, config: Config) -> str:
    """[[thrusters]], [[rudders]] and [signals] for the new log."""
    rudders = {one.name: (one, one.steering) for one in config.vehicle.thrusters if one.steering is not None}

    def source(column: _Column) -> str:
        place = f"{_TOPIC}.{column.name}" if kind == "mcap" else column.name
        unit = f', unit = "{column.unit}"' if column.unit else ""
        return f"{{ {kind} = {toml_text(place)}{unit} }}"

    # Messages have their own clock, tables have a time column.
    clock = {"mcap": "log"}.get(kind, _TIME)
    lines, signals = [], ["[signals]", f'time = {{ {kind} = "{clock}" }}']
    for column in columns:
        if column.signal.startswith(_COMMAND):
            name = column.signal.removeprefix(_COMMAND)
            block, key = ("[[rudders]]", "angle") if name in rudders else ("[[thrusters]]", "command")
            lines += [block, f"name = {toml_text(name)}", f"{key} = {source(column)}"]
            if name in rudders:
                rudder, steering = rudders[name]
                lines.append(f"speed = {toml_text(steering.speed)}")
                if steering.wheels or not rudder.arm_guessed:
                    lines.append(f"{rudder.scale_key} = {steering.size:.10g}")
                if steering.wheels and rudder.arm_guessed:  # A guess remains one.
                    lines.append(f"{rudder.scale_key}_guessed = {steering.size:.10g}")
            lines.append("")
        else:
            key = column.signal if _BARE_KEY.fullmatch(column.signal) else toml_text(column.signal)
            signals.append(f"{key} = {source(column)}")
    return "\n".join([*lines, *signals]) + "\n"
