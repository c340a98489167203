"""ArduPilot DataFlash logs: the mapped fields of the mapped messages.

A log describes itself: FMT messages hold the length and the fields of each kind of message. The reader notes the
positions of the mapped messages; numpy then decodes them all at once.
"""

import re
import struct
from array import array
from collections.abc import Callable
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rovid.readers import raw_log
from rovid.trial.config import Config
from rovid.trial.trial import Remark

KIND = "bin"
_FORMAT = "an ArduPilot DataFlash log"
# Messages on motion, thrusters and supply, for `rovid init`; most others concern the autopilot itself.
_INTERESTING = ("ATT", "RATE", "RCOU", "RCO2", "BAT")
_PARAMETERS = "PARM"
_MARK = b"\xa3\x95"
_FMT = 128
_DESCRIPTION = struct.Struct("<BB4s16s64s")  # type, length, name, letters, labels
_FMT_LENGTH = 3 + _DESCRIPTION.size
# numpy type -> letters of FMT, from ArduPilot's page "Adding a new log message".
_INTEGERS = {"i1": "b", "u1": "BM", "<i2": "hc", "<u2": "HC", "<i4": "ieL", "<u4": "IE", "<i8": "q", "<u8": "Q"}
_OTHERS = {"<f2": "g", "<f4": "f", "<f8": "d", "V64": "a", "S4": "n", "S16": "N", "S64": "Z"}
_TYPES = {letter: kind for kind, letters in (_INTEGERS | _OTHERS).items() for letter in letters}
_FACTORS = {**dict.fromkeys("cCeE", 0.01), "L": 1e-7}
_OLD_CHANNEL = re.compile(r"Ch\d+$")
# Usual (name, letter) of the field that holds the sensor's number; FMTU marks it in newer logs.
_INSTANCES = (("I", "B"), ("Inst", "B"), ("Instance", "B"), ("C", "B"))


def read(path: Path, config: Config) -> raw_log.RawLog:
    """Mapped fields of ``path``; ``IMU[1].GyrZ`` is of the second sensor, ``IMU.GyrZ`` of the first."""
    signals = raw_log.required_signals(config, KIND, path)
    topics = [signal.sources[KIND].partition(".")[0] for signal in signals.values()]
    with _mapped(path) as data:
        log = DataFlashLog(path, data, {raw_log.split_instance(topic)[0] for topic in topics})
        clock = config.time.sources.get(KIND, "TimeUS")
        return raw_log.raw_log_of_topics(path, KIND, signals, log.columns, clock, log.remarks)


def sources(path: Path) -> raw_log.LogContents:
    """Sources on motion, thrusters and supply."""
    with _mapped(path) as data:
        log = DataFlashLog(path, data, {*_INTERESTING, _PARAMETERS})
        topics = {name: log.columns(name) for name in _INTERESTING if log.holds(name)}
        parameters = {}
        if log.holds(_PARAMETERS):
            parameters = raw_log.autopilot_parameters(log.columns(_PARAMETERS), "Name", "Value")
    found = [source for source in raw_log.numeric_sources(topics) if ".Des" not in source and ".Ch" not in source]
    return raw_log.LogContents(sources=tuple(found), parameters=parameters)


def _mapped(path: Path) -> mmap:
    raw_log.require_mark(path, _MARK, _FORMAT)
    with path.open("rb") as file:
        return mmap(file.fileno(), 0, access=ACCESS_READ)


class _MessageType:
    """Fields of one message type, and the positions of its messages if it is wanted."""

    def __init__(self, letters: str, labels: list[str]) -> None:
        fields = list(zip(labels, letters, strict=True))
        self.labels = labels
        self.instance_field = next((label for label, letter in _INSTANCES if (label, letter) in fields), "")
        self.offsets = array("q")
        self.factors = {label: _FACTORS[letter] for label, letter in fields if letter in _FACTORS}
        self.layout = np.dtype([("", "V3"), *((label, _TYPES[letter]) for label, letter in fields)])

    def columns(self, data: mmap | bytes) -> dict[str, NDArray[Any]]:
        """Every field of the messages, (n,) each, scaled."""
        size = self.layout.itemsize
        packed = bytearray()
        for at in self.offsets:
            packed += data[at : at + size]
        rows = np.frombuffer(packed, dtype=self.layout)
        columns = {label: rows[label] for label in self.labels}
        for label, factor in self.factors.items():
            columns[label] = columns[label] * factor
        return columns


class DataFlashLog:
    """Positions of the ``wanted`` messages in a log."""

    def __init__(self, path: Path, data: mmap | bytes, wanted: set[str]) -> None:
        self.path, self.data = path, data
        self.wanted = {*wanted, "FMTU"}
        self.types: dict[str, _MessageType] = {}
        self.remarks: list[Remark] = []
        self._lengths = [0] * 256
        self._takers: list[Callable[[int], None] | None] = [None] * 256
        self._names: dict[int, str] = {}
        self._lengths[_FMT], self._takers[_FMT] = _FMT_LENGTH, self._take_description
        self._scan()
        # FMTU marks the field of the sensor's number.
        units = self.types.get("FMTU")
        if units is None or not {"FmtType", "UnitIds"} <= set(units.labels):
            return
        columns = units.columns(self.data)
        for number, letters in zip(columns["FmtType"].tolist(), columns["UnitIds"].tolist(), strict=True):
            kind = self.types.get(self._names.get(number, ""))
            at = letters.find(b"#") if isinstance(letters, bytes) else -1
            if kind is not None and 0 <= at < len(kind.labels):
                kind.instance_field = kind.labels[at]

    def _scan(self) -> None:
        # Local names are fast: there may be a million messages.
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
        if not self.types:
            raise raw_log.wrong_format(self.path, _FORMAT)
        if lost:
            text = f"{lost} of {size} bytes belong to no whole message, as a loss of power or of data leaves them."
            self.remarks.append(Remark(kind="truncated", count=lost, text=text))

    def _take_description(self, at: int) -> None:
        """Register the message type that an FMT message describes."""
        number, length, *texts = _DESCRIPTION.unpack_from(self.data, at + 3)
        name, letters, labels = (text.partition(b"\0")[0].decode("ascii", errors="replace") for text in texts)
        names = labels.split(",") if labels else []
        if number == _FMT or number in self._names:
            return
        # A damaged description would mislead the scan.
        are_unique = all(names) and len(names) == len(set(names)) == len(letters)
        if not are_unique or not set(letters) <= set(_TYPES):
            return
        kind = _MessageType(letters, names)
        if kind.layout.itemsize != length:
            return
        self._lengths[number] = length
        self._names[number] = name
        self.types[name] = kind
        if name in self.wanted:
            self._takers[number] = kind.offsets.append

    def holds(self, name: str) -> bool:
        """Whether the log has messages ``name``, which must be wanted."""
        return name in self.types and len(self.types[name].offsets) > 0

    def columns(self, topic: str) -> raw_log.Columns:
        """Fields of the messages ``topic`` of one sensor."""
        kind = self.types.get(raw_log.split_instance(topic)[0])
        if kind is None or not kind.offsets:
            raise raw_log.missing_topic(self.path, KIND, topic, self.types)
        columns = kind.columns(self.data)
        # Names before 2015: a time in ms, and Ch1 for C1.
        if "TimeMS" in columns:
            columns.setdefault("TimeUS", columns["TimeMS"].astype(np.int64) * 1000)
        for label in kind.labels:
            if _OLD_CHANNEL.match(label):
                columns.setdefault(label.replace("Ch", "C"), columns[label])
        return raw_log.select_instance(self.path, KIND, topic, columns, kind.instance_field, self.remarks)
