"""What stands inside a message, in whatever format it was logged: one number, or a quaternion, by its path."""

from __future__ import annotations

import operator
import re
from array import array
from collections.abc import Callable, Iterator
from itertools import islice
from typing import Any

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import LogError

Getter = Callable[[Any], Any]

_STEP = re.compile(r"\[(\d+)\]|([^.\[\]]+)")
_NAME = re.compile(r"[^.\[\]]+")
ABSENT = (KeyError, IndexError, TypeError, AttributeError)
_QUATERNION = operator.attrgetter("x", "y", "z", "w")
# Where messages that are mapped as a whole keep their orientation: a quaternion itself, Imu, Odometry,
# PoseStamped, TransformStamped, and common names of our own.
_ORIENTATIONS: tuple[tuple[str, ...], ...] = (
    (),
    ("orientation",),
    ("pose", "pose", "orientation"),
    ("pose", "orientation"),
    ("transform", "rotation"),
    ("rotation",),
    ("quaternion",),
)
ANGLES = ("heading", "roll", "pitch")
_STAMPS = (("header", "stamp"), ("stamp",), ("timestamp",))
_STAMP_PARTS = (("sec", "nanosec"), ("seconds", "nanos"), ("sec", "nsec"), ("secs", "nsecs"))
_SHOWN = 20


def split_path(path: str, topic: str) -> tuple[str, ...] | None:
    """Fields behind the topic in ``path``; None where ``path`` is not on ``topic``."""
    rest = path[len(topic) :]
    if not topic or not path.startswith(topic) or (rest and rest[0] not in ".["):
        return None
    return split_fields(rest)


def split_fields(text: str) -> tuple[str, ...]:
    """Steps of ``pose.position[2]`` or ``.data.0``."""
    return tuple(index or name for index, name in _STEP.findall(text))


def _get(value: Any, name: str) -> Any:
    if isinstance(value, dict):
        return value[name]
    if name.isdigit():
        return value[int(name)]
    return getattr(value, name)


def getter(fields: tuple[str, ...], *, mapping: bool) -> Getter:
    """What takes the field out of a message; raises one of the usual errors where it is absent.

    Parameters
    ----------
    mapping
        The messages are dictionaries (JSON), not objects.
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
        value = _get(value, name)
    return value


def field_names(message: Any, depth: int = 3) -> list[str]:
    """Paths of the fields of ``message``, as one would write them in rovid.toml."""
    return [name for name, _ in fields_of(message, depth)]


def fields_of(message: Any, depth: int = 3) -> Iterator[tuple[str, Any]]:
    """The first fields of ``message``: path, as one would write it in rovid.toml, and value."""
    return islice(_fields_of(message, "", depth), _SHOWN)


def _fields_of(value: Any, prefix: str, depth: int) -> Iterator[tuple[str, Any]]:
    inside = _members(value) if depth else {}
    if not inside:
        if prefix:
            yield prefix[1:], value
        return
    for name, member in inside.items():
        if _NAME.fullmatch(name):  # no path leads to any other
            yield from _fields_of(member, f"{prefix}.{name}", depth - 1)


def _members(value: Any) -> dict[str, Any]:
    if isinstance(value, dict):
        return {str(name): member for name, member in value.items()}
    if hasattr(value, "DESCRIPTOR"):
        return {item.name: getattr(value, item.name) for item in value.DESCRIPTOR.fields}
    if not _is_object(value):
        return {}
    names = getattr(value, "__slots__", None) or getattr(value, "__dict__", None) or ()
    return {str(name): getattr(value, name, None) for name in names}


def _is_object(value: Any) -> bool:
    return not isinstance(value, str | bytes | int | float | list | tuple) and value is not None


class Pick:
    """Collects one signal from the messages of one topic.

    Attributes
    ----------
    take
        Called with each message.
    seen
        Whether the field was ever there.
    optional
        A log may lack it: what is no number is missing.
    """

    def __init__(
        self, signal: str, source: str, fields: tuple[str, ...], *, mapping: bool, where: str, optional: bool = False
    ) -> None:
        self.signal, self.source, self.where, self.optional = signal, source, where, optional
        self.fields, self.mapping, self.seen = fields, mapping, False
        self.quaternion = False
        self.values = array("d")
        self._get = getter(fields, mapping=mapping)
        self.take: Callable[[Any], None] = self._number

    def _number(self, message: Any) -> None:
        try:
            value = self._get(message)
        except ABSENT:
            value = None
        if type(value) is float:
            self.seen = True
            self.values.append(value)
        else:
            self._other(value, message)

    def _other(self, value: Any, message: Any) -> None:
        if value is None:
            self.values.append(float("nan"))
        elif isinstance(value, int | float | np.number):
            self.seen = True
            self.values.append(as_float(value))
        elif self._orientation(value):
            self.values = array("d", [float("nan")] * (4 * len(self.values)))
            self.take = self._rotation
            self._rotation(message)
        elif self.optional:
            self.values.append(float("nan"))
        else:
            raise self._refuse(value, message)

    def _orientation(self, value: Any) -> bool:
        """Find the quaternion in ``value`` and prepare to read it from now on."""
        if self.signal not in ANGLES or self.seen:
            return False
        for inner in _ORIENTATIONS:
            try:
                parts = _parts(_descend(value, inner))
            except ABSENT:
                continue
            if all(isinstance(part, int | float) for part in parts):
                self.seen = self.quaternion = True
                self._get = getter(self.fields + inner, mapping=self.mapping)
                return True
        return False

    def _rotation(self, message: Any) -> None:
        try:
            self.values.extend(map(as_float, _parts(self._get(message))))
        except (*ABSENT, ValueError):
            # Of a quaternion that broke off the first numbers are there already.
            whole = len(self.values) // 4 * 4
            del self.values[whole:]
            self.values.extend((float("nan"),) * 4)

    def _refuse(self, value: Any, message: Any) -> LogError:
        found = repr(value) if isinstance(value, str | bytes) else f"a {type(value).__name__}"
        wanted = "a number or a quaternion" if self.signal in ANGLES else "a number"
        names = ", ".join(field_names(message)) or "none"
        text = f"{self.source} ({self.signal}) is {found[:60]}; {wanted} was expected. The message's fields: {names}."
        return LogError(text, where=self.where, mend=f"Name one field for {self.signal} in rovid.toml.")

    def column(self) -> FloatArray:
        """(n,) values as logged; rad where they come from a quaternion; NaN where missing."""
        values = np.frombuffer(self.values, dtype=np.float64) if self.values else np.empty(0)
        if self.quaternion:
            return euler(values.reshape(-1, 4), self.signal)
        return values


def as_float(value: Any) -> float:
    """``value`` as a float; infinite where no float is that large."""
    try:
        return float(value)
    except OverflowError:  # an integer beyond any float
        return float("inf")


def _parts(value: Any) -> tuple[Any, ...]:
    if isinstance(value, dict):
        return tuple(value[name] for name in "xyzw")
    parts: tuple[Any, ...] = _QUATERNION(value)
    return parts


def euler(quaternions: FloatArray, signal: str) -> FloatArray:
    """(n,) rad of (n, 4) x, y, z, w of any length but zero, which is how a sensor says that it has none."""
    x, y, z, w = quaternions.T
    with np.errstate(invalid="ignore", over="ignore"):
        norm = x * x + y * y + z * z + w * w
        if signal == "heading":
            angle = np.arctan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
        elif signal == "roll":
            angle = np.arctan2(2.0 * (w * x + y * z), w * w - x * x - y * y + z * z)
        else:
            sine = 2.0 * (w * y - z * x) / np.where(norm > 0, norm, 1.0)
            angle = np.arcsin(np.clip(sine, -1.0, 1.0))
        return np.where((norm > 0.0) & np.isfinite(norm), angle, np.nan)


def stamp_getter(message: Any, *, mapping: bool) -> Getter | None:
    """What reads the nanoseconds of a message's own stamp; None where it has none."""
    for fields in _STAMPS:
        try:
            stamp = _descend(message, fields)
        except ABSENT:
            continue
        for seconds, fraction in _STAMP_PARTS:
            try:
                _get(stamp, seconds), _get(stamp, fraction)
            except ABSENT:
                continue
            whole = getter((*fields, seconds), mapping=mapping)
            part = getter((*fields, fraction), mapping=mapping)
            return _whole_and_fraction(whole, part)
    return None


def _whole_and_fraction(seconds: Getter, fraction: Getter) -> Getter:
    return lambda message: int(seconds(message)) * 1_000_000_000 + int(fraction(message))
