"""ArduPilot's DataFlash logs: the wanted fields of the wanted messages.

A log describes itself: FMT messages say how long each kind of message is and what stands in it. The walk from
message to message only notes where the wanted ones begin; numpy then takes them out all at once.
"""

from __future__ import annotations

import struct
from array import array
from collections.abc import Callable
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rovid.readers.message_columns import (
    Columns,
    channels_of,
    missing_topic,
    numeric_sources,
    of_sensor,
    parameters_of,
    raw_log,
    split_sensor,
)
from rovid.readers.raw_log import LogContents, RawLog, foreign, mapped
from rovid.trial.config import Config
from rovid.trial.trial import Remark

KIND = "bin"
_NAME = "an ArduPilot DataFlash log"
# Messages that `rovid init` looks into; most others are the autopilot's own affairs.
_TELLING = ("ATT", "RATE", "RCOU", "RCO2", "BAT")
_PARAMETERS = "PARM"
_MARK = b"\xa3\x95"
_FMT = 128
_DESCRIPTION = struct.Struct("<BB4s16s64s")  # type, length, name, letters, labels
_FMT_LENGTH = 3 + _DESCRIPTION.size
# Type in numpy -> the letters of FMT that stand for it: ArduPilot's page "Adding a new log message".
_INTEGERS = {"i1": "b", "u1": "BM", "<i2": "hc", "<u2": "HC", "<i4": "ieL", "<u4": "IE", "<i8": "q", "<u8": "Q"}
_OTHERS = {"<f2": "g", "<f4": "f", "<f8": "d", "V64": "a", "S4": "n", "S16": "N", "S64": "Z"}
_TYPES = {letter: kind for kind, letters in (_INTEGERS | _OTHERS).items() for letter in letters}
_FACTORS = {**dict.fromkeys("cCeE", 0.01), "L": 1e-7}
# Messages of several sensors of one kind say which one in a byte; FMTU marks that field, and these are its usual names.
_INSTANCES = (("I", "B"), ("Inst", "B"), ("Instance", "B"), ("C", "B"))


def read(path: Path, config: Config) -> RawLog:
    """Wanted fields of ``path``; ``IMU[1].GyrZ`` is of the second sensor, ``IMU.GyrZ`` of the first.

    Raises
    ------
    LogError
        It is no DataFlash log, or a message or field is missing or no number.
    ConfigError
        rovid.toml does not map a command for it.
    """
    signals = mapped(config, KIND, path)
    sources = [signal.sources[KIND].partition(".")[0] for signal in signals.values()]
    with path.open("rb") as file:
        if file.read(2) != _MARK:
            raise foreign(path, _NAME)
        with mmap(file.fileno(), 0, access=ACCESS_READ) as data:
            log = DataFlashLog(path, data, {split_sensor(source)[0] for source in sources})
            channels = channels_of(path, KIND, signals, log.columns, config.time.sources.get(KIND, "TimeUS"))
    return raw_log(channels, tuple(log.remarks))


def sources(path: Path) -> LogContents:
    """What tells of motion, thrusters and supply.

    Raises
    ------
    LogError
        It is no DataFlash log.
    """
    with path.open("rb") as file:
        if file.read(2) != _MARK:
            raise foreign(path, _NAME)
        with mmap(file.fileno(), 0, access=ACCESS_READ) as data:
            log = DataFlashLog(path, data, {*_TELLING, _PARAMETERS})
            present = [name for name in _TELLING if log.holds(name)]
            topics = {name: log.columns(name) for name in present}
            parameters = parameters_of(log.columns(_PARAMETERS), "Name", "Value") if log.holds(_PARAMETERS) else {}
    sources = tuple(source for source in numeric_sources(topics) if ".Des" not in source)
    return LogContents(sources=sources, parameters=parameters)


class _Kind:
    """One kind of message: its fields, and where in the file the wanted ones begin."""

    def __init__(self, letters: str, labels: list[str]) -> None:
        fields = list(zip(labels, letters, strict=True))
        self.labels = labels
        self.instance = next((label for label, kind in _INSTANCES if (label, kind) in fields), "")
        self.offsets = array("q")
        self.factors = {label: _FACTORS[letter] for label, letter in fields if letter in _FACTORS}
        self.layout = np.dtype([("", "V3"), *((label, _TYPES[letter]) for label, letter in fields)])

    def columns(self, data: mmap | bytes) -> dict[str, NDArray[Any]]:
        """Every field of the messages found, (n,) each, scaled."""
        size = self.layout.itemsize
        packed = bytearray()
        for at in self.offsets:
            packed += data[at : at + size]
        rows = np.frombuffer(packed, dtype=self.layout)
        columns = {label: rows[label] for label in self.labels}
        for label, factor in self.factors.items():
            columns[label] = columns[label] * factor
        return columns


def _text(padded: bytes) -> str:
    """What stands before the first zero."""
    return padded.split(b"\0", 1)[0].decode("ascii", errors="replace")


class DataFlashLog:
    """The walk through a file."""

    def __init__(self, path: Path, data: mmap | bytes, wanted: set[str]) -> None:
        self.path, self.data = path, data
        self.wanted = {*wanted, "FMTU"}
        self.kinds: dict[str, _Kind] = {}
        self.remarks: list[Remark] = []
        self._lengths = [0] * 256
        self._takers: list[Callable[[int], None] | None] = [None] * 256
        self._names: dict[int, str] = {}
        self._lengths[_FMT], self._takers[_FMT] = _FMT_LENGTH, self._describe
        self._walk()
        self._instances()

    def _walk(self) -> None:
        # Looked up once, not at each of a million messages.
        data, lengths, takers, size = self.data, self._lengths, self._takers, len(self.data)
        at = lost = 0
        while at + 3 <= size:
            head, mark, kind = data[at : at + 3]
            length = lengths[kind]
            if head != 0xA3 or mark != 0x95 or not length:
                after = data.find(_MARK, at + 1)
                if after < 0:
                    after = size
                lost += after - at
                at = after
                continue
            if at + length > size:
                break
            take = takers[kind]
            if take is not None:
                take(at)
            at += length
        lost += size - at
        if not self.kinds:
            raise foreign(self.path, _NAME)
        if lost:
            text = f"{lost} of {size} bytes belong to no whole message, as a loss of power or of data leaves them."
            self.remarks.append(Remark(kind="truncated", count=lost, text=text))

    def _describe(self, at: int) -> None:
        """Take a FMT message: the length of a kind, and its fields if it is wanted."""
        number, length, *texts = _DESCRIPTION.unpack_from(self.data, at + 3)
        name, letters, labels = map(_text, texts)
        names = labels.split(",") if labels else []
        if number == _FMT or number in self._names:
            return
        # A damaged description would lead the walk astray.
        each_once = all(names) and len(names) == len(set(names)) == len(letters)
        if not each_once or not set(letters) <= set(_TYPES):
            return
        kind = _Kind(letters, names)
        if kind.layout.itemsize != length:
            return
        self._lengths[number] = length
        self._names[number] = name
        self.kinds[name] = kind
        if name in self.wanted:
            self._takers[number] = kind.offsets.append

    def _instances(self) -> None:
        """Learn from FMTU which field tells sensors of one kind apart."""
        units = self.kinds.get("FMTU")
        if units is None or not {"FmtType", "UnitIds"} <= set(units.labels):
            return
        columns = units.columns(self.data)
        for number, letters in zip(columns["FmtType"].tolist(), columns["UnitIds"].tolist(), strict=True):
            kind = self.kinds.get(self._names.get(number, ""))
            at = letters.find(b"#") if isinstance(letters, bytes) else -1
            if kind is not None and 0 <= at < len(kind.labels):
                kind.instance = kind.labels[at]

    def holds(self, name: str) -> bool:
        """Whether there are messages ``name``, which were wanted."""
        return name in self.kinds and len(self.kinds[name].offsets) > 0

    def columns(self, topic: str) -> Columns:
        """What the messages ``topic`` hold, of one sensor."""
        kind = self.kinds.get(split_sensor(topic)[0])
        if kind is None or not kind.offsets:
            raise missing_topic(self.path, KIND, topic, self.kinds)
        return of_sensor(self.path, KIND, topic, kind.columns(self.data), kind.instance, self.remarks)
