"""Fields of decoded messages by path, whatever the log format: single numbers, quaternions and time stamps."""

import operator
import re
from array import array
from collections.abc import Callable, Iterator
from itertools import islice
from typing import Any

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import LogError
from rovid.readers.raw_log import ANGLES, euler
from rovid.trial.axis import Signal

Getter = Callable[[Any], Any]

# Errors of a getter where a message lacks the field.
ABSENT = (KeyError, IndexError, TypeError, AttributeError)
_STEP = re.compile(r"\[(\d+)\]|([^.\[\]]+)")
_NAME = re.compile(r"[^.\[\]]+")
_QUATERNION = operator.attrgetter("x", "y", "z", "w")
# Paths of the orientation in messages mapped as a whole: a quaternion itself, Imu, Odometry, PoseStamped,
# TransformStamped, and common names of users.
_ORIENTATIONS: tuple[tuple[str, ...], ...] = ((), ("orientation",), ("pose", "pose", "orientation"))
_ORIENTATIONS += (("pose", "orientation"), ("transform", "rotation"), ("rotation",), ("quaternion",))
_STAMPS = (("header", "stamp"), ("stamp",), ("timestamp",))
_STAMP_PARTS = (("sec", "nanosec"), ("seconds", "nanos"), ("sec", "nsec"), ("secs", "nsecs"))
# Names of fields that are no sources of signals, or that hold an orientation.
_STAMP_NAMES = {"header", "stamp", "timestamp"}
_ORIENTATION_NAMES = {"orientation", "quaternion", "rotation"}
# Number of fields in an error message, and of those that may be signals.
_MAX_LISTED, _MAX_FIELDS = 20, 400
# Number of elements of an array that may be signals; longer ones are images, scans or covariances.
_MAX_ELEMENTS = 32


def split_path(path: str, topic: str) -> tuple[str, ...] | None:
    """Fields after the topic in ``path``; None if ``path`` does not begin with ``topic``."""
    rest = path[len(topic) :]
    if not topic or not path.startswith(topic) or (rest and rest[0] not in ".["):
        return None
    return split_fields(rest)


def split_fields(text: str) -> tuple[str, ...]:
    """Steps of ``pose.position[2]`` or ``.data.0``."""
    return tuple(index or name for index, name in _STEP.findall(text))


def getter(fields: tuple[str, ...], *, mapping: bool) -> Getter:
    """Function that returns the field of a message, and raises one of `ABSENT` where it is missing.

    ``mapping``: the messages are dictionaries (JSON), not objects.
    """
    if not fields:
        return lambda message: message
    if mapping and len(fields) == 1:
        return operator.itemgetter(fields[0])
    if mapping or any(name.isdigit() for name in fields):
        return lambda message: _descend(message, fields)
    return operator.attrgetter(".".join(fields))


def _descend(value: Any, fields: tuple[str, ...]) -> Any:
    for name in fields:
        if isinstance(value, dict):
            value = value[name]
        elif name.isdigit():
            value = value[int(name)]
        else:
            value = getattr(value, name)
    return value


def stamp_getter(message: Any, *, mapping: bool, clock: tuple[str, ...] = ()) -> Getter | None:
    """Function that returns the ns of a message's own time stamp, or of the fields ``clock``; None if it has none.

    ``clock`` may lead to a stamp, or to its seconds.
    """
    for fields in (clock, clock[:-1]) if clock else _STAMPS:
        if clock and fields != clock and clock[-1] not in {part for part, _ in _STAMP_PARTS}:
            continue
        for parts in _STAMP_PARTS:
            try:
                for part in parts:
                    _descend(message, (*fields, part))
            except ABSENT:
                continue
            seconds, fraction = (getter((*fields, part), mapping=mapping) for part in parts)
            return lambda message: int(seconds(message)) * 1_000_000_000 + int(fraction(message))
    return None


def listed_fields(message: Any) -> str:
    """Paths of the first fields of ``message``, for error messages."""
    return ", ".join(name for name, _ in islice(_fields(message), _MAX_LISTED)) or "none"


def numeric_fields(message: Any, topic: str, *, stamps: bool = False) -> Iterator[str]:
    """Sources of every number and orientation in ``message``, without time stamps unless ``stamps``."""
    topic = topic and f"{topic}."
    for name, value in islice(_fields(message), _MAX_FIELDS):
        *parents, last = name.split(".")
        if _STAMP_NAMES & {*parents, last} and not stamps:
            continue
        is_array = isinstance(value, list | tuple | array | np.ndarray) and 0 < len(value) <= _MAX_ELEMENTS
        if last in "xyzw" and parents and parents[-1] in _ORIENTATION_NAMES:
            yield f"{topic}{'.'.join(parents)}"
        elif _is_number(value):
            yield f"{topic}{name}"
        elif is_array and "covariance" not in last and all(map(_is_number, value)):
            yield from (f"{topic}{name}[{at}]" for at in range(len(value)))


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float | np.number) and not isinstance(value, bool)


def _fields(value: Any, prefix: str = "", depth: int = 3) -> Iterator[tuple[str, Any]]:
    """(path, value) of each field."""
    members = _members(value) if depth else {}
    if not members and prefix:
        yield prefix[1:], value
    for name, member in members.items():
        if _NAME.fullmatch(name):  # No path leads to other names.
            yield from _fields(member, f"{prefix}.{name}", depth - 1)


def _members(value: Any) -> dict[str, Any]:
    if isinstance(value, dict):
        return {str(name): member for name, member in value.items()}
    if hasattr(value, "DESCRIPTOR"):
        return {item.name: getattr(value, item.name) for item in value.DESCRIPTOR.fields}
    if value is None or isinstance(value, str | bytes | int | float | list | tuple):
        return {}
    names = getattr(value, "__slots__", None) or getattr(value, "__dict__", None) or ()
    return {str(name): getattr(value, name, None) for name in names}


def as_float(value: Any) -> float:
    """``value`` as a float; infinite for integers beyond the largest float."""
    try:
        return float(value)
    except OverflowError:
        return float("inf")


class FieldCollector:
    """Collects the values of one signal from the messages of one topic; ``take`` is called with each message.

    A log may lack an optional signal: values that are no numbers are then missing.
    """

    def __init__(self, signal: Signal, source: str, fields: tuple[str, ...], *, mapping: bool, where: str) -> None:
        self.signal, self.source, self.where = signal, source, where
        self.fields, self.mapping = fields, mapping
        self.seen = False  # Whether the field was present in any message.
        self.absent = self.empty = 0  # Messages without the field, and with an empty one (null).
        self.quaternion = False  # Whether the field is a quaternion.
        self._values = array("d")
        self._get = getter(fields, mapping=mapping)
        self.take: Callable[[Any], None] = self._take_number

    def _take_number(self, message: Any) -> None:
        try:
            value = self._get(message)
        except ABSENT:
            value = None
            self.absent += 1
            self.empty -= 1
        if type(value) is float:
            self.seen = True
            self._values.append(value)
        elif isinstance(value, int | float | np.number):
            self.seen = True
            self._values.append(as_float(value))
        elif value is not None and self._find_quaternion(value):
            self._values = array("d", [float("nan")] * (4 * len(self._values)))
            self.take = self._take_quaternion
            self._take_quaternion(message)
        elif value is None or self.signal.optional:
            self.empty += 1
            self._values.append(float("nan"))
        else:
            found = repr(value) if isinstance(value, str | bytes) else f"a {type(value).__name__}"
            wanted = "a number or a quaternion" if self.signal.name in ANGLES else "a number"
            text = f"{self.source} ({self.signal.name}) is {found[:60]}; {wanted} was expected."
            text += f" The message's fields: {listed_fields(message)}."
            raise LogError(text, where=self.where, mend=f"Name one field for {self.signal.name} in rovid.toml.")

    def _find_quaternion(self, value: Any) -> bool:
        """Find the quaternion in ``value``, for all further messages."""
        if self.signal.name not in ANGLES or self.seen:
            return False
        for inner in _ORIENTATIONS:
            try:
                parts = _quaternion_parts(_descend(value, inner))
            except ABSENT:
                continue
            if all(isinstance(part, int | float) for part in parts):
                self.seen = self.quaternion = True
                self._get = getter(self.fields + inner, mapping=self.mapping)
                return True
        return False

    def _take_quaternion(self, message: Any) -> None:
        count = len(self._values)
        try:
            self._values.extend(map(as_float, _quaternion_parts(self._get(message))))
        except (*ABSENT, ValueError):
            del self._values[count:]  # An incomplete quaternion left its first numbers.
            self._values.extend((float("nan"),) * 4)

    @property
    def comes_and_goes(self) -> bool:
        """Whether this is a command that is left out of some messages, and never empty."""
        return self.mapping and self.absent > 0 and not self.empty and self.signal.name.startswith("command.")

    def column(self) -> FloatArray:
        """(n,) values as logged, in rad from a quaternion; NaN where missing."""
        values = np.frombuffer(self._values, dtype=np.float64) if self._values else np.empty(0)
        return euler(values.reshape(-1, 4), self.signal.name) if self.quaternion else values


def _quaternion_parts(value: Any) -> tuple[Any, ...]:
    if isinstance(value, dict):
        return tuple(value[name] for name in "xyzw")
    parts: tuple[Any, ...] = _QUATERNION(value)
    return parts
