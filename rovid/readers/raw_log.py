"""Raw channels with their own clocks, which every reader returns, and helpers of the readers."""

import io
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from rovid.core.array_types import FloatArray
from rovid.core.errors import ConfigError, LogError, suggestion
from rovid.readers.timestamps import to_seconds
from rovid.trial.axis import Signal
from rovid.trial.config import Config
from rovid.trial.trial import Remark

# Signals that a quaternion can provide.
ANGLES = ("heading", "roll", "pitch")


@dataclass(frozen=True, kw_only=True, eq=False)
class Channel:
    """One signal as logged.

    Channels of one clock share the array ``time`` itself, so that it is sorted once.
    """

    source: str  #: Column, or topic and field, for messages.
    clock: str  #: Time column or topic, for messages.
    time: FloatArray  #: (n,) s from an origin of the reader's choice, in the order logged; NaN where missing.
    values: FloatArray  #: (n,) as logged; NaN where missing.
    radians: bool = False  #: The reader computed the angle from a quaternion: the unit in rovid.toml does not apply.


@dataclass(frozen=True, kw_only=True, eq=False)
class RawLog:
    """All mapped channels of one file."""

    channels: Mapping[str, Channel]  #: Signal name -> channel.
    place: Callable[[str, int], str]  #: (signal, index of a sample) -> "line 17" or "message 16", for messages.
    remarks: tuple[Remark, ...] = ()  #: Remarks on the file itself.
    #: (s on the channels' clock, rad) of each reset of the heading that the file itself states.
    resets: tuple[tuple[float, float], ...] = ()
    sparse: bool = False  #: Fields of a command are absent from some messages, as JSON writers leave out zeros.
    sortable: bool = False  #: The format may store messages slightly out of order: they are sorted.
    epoch: float | None = None  #: s since 1970 at the channels' time zero; None where unknown.
    companion_files: tuple[Path, ...] = ()  #: Further files that channels come from.


@dataclass(frozen=True, kw_only=True)
class LogContents:
    """Readable contents of a log."""

    clock: str = ""  #: Source of the time; empty where the format has its own clock.
    time_unit: str = "auto"  #: Unit of the clock; "auto": by its name or size.
    unit_reason: str = ""  #: Reason of a guessed unit.
    sources: tuple[str, ...]  #: All other sources.
    orientations: tuple[str, ...] = ()  #: Those of orientations, of which an angle is computed.
    unreadable: tuple[str, ...] = ()  #: Contents that cannot be read, each with the reason.
    parameters: Mapping[str, float] = field(default_factory=dict)  #: Parameters of the autopilot that wrote the log.


def required_signals(config: Config, kind: str, path: Path) -> dict[str, Signal]:
    """Signals mapped for logs of the format ``kind``; `ConfigError` if a required one has no source."""
    signals = config.mapped_signals(kind)
    for name in config.required_signals:
        if name not in signals:
            text = f"{name} names no {kind} source, but {path.name} is a {kind} log."
            raise ConfigError(text, where=config.path, mend=f'Add {kind} = "…" to its sources, or leave this log out.')
    return signals


def required_time(config: Config, kind: str) -> Signal:
    """The time column of tables; `ConfigError` if rovid.toml names none for the format ``kind``."""
    if kind not in config.time.sources:
        text = f"time names no {kind} column, but there is a {kind} log."
        raise ConfigError(text, where=config.path, mend=f'Add time = {{ {kind} = "<column>" }} to [signals].')
    return config.time


def require_library(module: str, extra: str, path: Path) -> ModuleType:
    """Import an optional package that one format needs; `LogError` if it is not installed."""
    try:
        return import_module(module)
    except ImportError as error:
        text = f"needs the package {module.partition('.')[0]}."
        raise LogError(text, where=path, mend=f"Install it with `pip install 'rovid[{extra}]'`.") from error


def wrong_format(path: Path, expected: str) -> LogError:
    """Error for a file that does not begin as ``expected`` by its suffix."""
    found = "does not begin as one" if path.stat().st_size else "is empty"
    mend = "Fetch the log again, or give it the suffix of its format."
    return LogError(f"is not {expected}: it {found}.", where=path, mend=mend)


def require_mark(path: Path, mark: bytes, expected: str) -> None:
    """Raise `LogError` for a file that does not begin with the ``mark`` of its format, ``expected`` by its suffix."""
    with path.open("rb") as file:
        if file.read(len(mark)) != mark:
            raise wrong_format(path, expected)


def damaged(path: Path, what: str, error: Exception, mend: str) -> LogError:
    """Error for a file that a library cannot read; ``what`` it is, "a bag that is damaged", for instance."""
    text = f"is {what} ({type(error).__name__}: {str(error)[:100]})."
    return LogError(text.replace("\n", " "), where=path, mend=mend)


class FilePart(io.RawIOBase):
    """``size`` bytes of a file from ``start`` on, independent of the position of the file."""

    def __init__(self, file: IO[bytes], start: int, size: int) -> None:
        self._file, self._at, self._end = file, start, start + size

    def readable(self) -> bool:
        """True."""
        return True

    def readinto(self, buffer: Any) -> int:
        """Fill ``buffer``, and return the number of bytes."""
        self._file.seek(self._at)
        data = self._file.read(max(0, min(len(buffer), self._end - self._at)))
        self._at += len(data)
        buffer[: len(data)] = data
        return len(data)


def euler(quaternions: FloatArray, signal: str) -> FloatArray:
    """(n,) heading, roll or pitch in rad of (n, 4) x, y, z, w of any length; NaN for length zero, a missing value."""
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


# --- orientations in tables: a heading, roll or pitch from the four columns of a quaternion --------------------

# A component: "orientation.x", "qx", "Rotation X", ".../orientation/x", and "q[0]" of PX4, where w is the first.
_COMPONENT = re.compile(r"(?i)(?:(.*?)[ ./_\[]?([xyzw])\]?|(.*q)\[([0-3])\])")
_WORDS = {"attitude", "ori", "orientation", "q", "quat", "quaternion", "rot", "rotation"}
_PX4 = {"0": "w", "1": "x", "2": "y", "3": "z"}


def orientations(names: Sequence[str]) -> dict[str, dict[str, str]]:
    """Source of each orientation -> column of its components x, y, z and w."""
    found: dict[str, dict[str, str]] = {}
    for name in names:
        if match := _COMPONENT.fullmatch(name):
            stem = match[1] if match[2] else match[3]
            found.setdefault(stem, {})[match[2].lower() if match[2] else _PX4[match[4]]] = name
    whole = {stem: parts for stem, parts in found.items() if len(parts) == len("xyzw")}
    return {stem: parts for stem, parts in whole.items() if set(re.findall(r"[a-z]+", stem.lower())[-1:]) & _WORDS}


def split_orientations(signals: Mapping[str, Signal], names: Collection[str], kind: str) -> dict[str, Signal]:
    """``signals`` with a signal for each component of an orientation among the columns ``names``."""
    known = orientations(tuple(names))
    split: dict[str, Signal] = {}
    for name, signal in signals.items():
        source = signal.sources[kind]
        if name in ANGLES and source not in names and source in known:
            split |= {f"{name}.{part}": replace(signal, sources={kind: known[source][part]}) for part in "xyzw"}
        else:
            split[name] = signal
    return split


def join_orientations(channels: Mapping[str, Channel], signals: Mapping[str, Signal], kind: str) -> dict[str, Channel]:
    """Channels of ``signals``, with angles in rad in place of the components of `split_orientations`."""
    joined: dict[str, Channel] = {}
    for name, signal in signals.items():
        parts = [channels[f"{name}.{part}"] for part in "xyzw" if f"{name}.{part}" in channels]
        if len(parts) == len("xyzw"):
            angle = euler(np.column_stack([part.values for part in parts]), name)
            joined[name] = replace(parts[0], source=signal.sources[kind], values=angle, radians=True)
        elif name in channels:
            joined[name] = channels[name]
    return joined


# --- topics stored as columns: DataFlash, MAVLink telemetry, ULog -------------------------------------------

# Field -> (n,) as logged; the clock, in us, is one of the fields.
Columns = Mapping[str, NDArray[Any]]
_INSTANCE = re.compile(r"(.*)\[(\d+)\]$")


def raw_log_of_topics(
    path: Path,
    kind: str,
    signals: Mapping[str, Signal],
    topic: Callable[[str], Columns],
    clock: str,
    remarks: list[Remark],
) -> RawLog:
    """The channels of ``signals``; `LogError` if a topic or field is missing or is no number.

    ``topic`` returns the columns of a name, raises `LogError` where there are none, and may add to ``remarks``.
    ``clock`` is the field of each topic that holds the time in us.
    """
    topics: dict[str, Columns] = {}
    found: dict[str, tuple[str, NDArray[Any], bool]] = {}
    for name, signal in signals.items():
        one, _, field_name = signal.sources[kind].partition(".")
        try:
            columns = topics.get(one) or topics.setdefault(one, topic(one))
            # PX4 stores quaternions as w, x, y, z.
            parts = [f"{field_name}[{at}]" for at in (1, 2, 3, 0)]
            if name in ANGLES and field_name not in columns and columns.keys() >= set(parts):
                angle = euler(np.column_stack([_float64(columns[part]) for part in parts]), name)
                found[name] = one, angle, True
            else:
                found[name] = one, _field(path, field_name, one, columns, name), False
        except LogError:
            if not signal.optional:
                raise
    stamps = {}
    for one, _, _ in found.values():
        stamp = _field(path, clock, one, topics[one], "time")
        # Signed integers have signed differences. A larger time stamp comes from damage.
        stamps[one] = stamp.astype(np.int64) if stamp.dtype.kind == "u" else stamp
    origin = min((int(stamp[0]) for stamp in stamps.values() if stamp.dtype.kind == "i"), default=0)
    times = {one: to_seconds(stamp, clock, "us", origin) for one, stamp in stamps.items()}
    channels = {}
    for name, (one, values, radians) in found.items():
        source = signals[name].sources[kind]
        channels[name] = Channel(source=source, clock=one, time=times[one], values=_float64(values), radians=radians)
    return RawLog(
        channels=channels,
        place=lambda signal, index: f"message {index + 1} of {channels[signal].clock}",
        remarks=tuple(remarks),
        sortable=True,
    )


def _float64(values: NDArray[Any]) -> FloatArray:
    with np.errstate(invalid="ignore"):  # A damaged number may be a signalling NaN.
        return values.astype(np.float64)


def _field(path: Path, name: str, topic: str, columns: Columns, signal: str) -> NDArray[Any]:
    values = columns.get(name)
    if values is None:
        text = f"{topic} has no field {name!r} ({signal}). {suggestion(name, columns)}"
        raise LogError(text, where=path, mend=f"Correct {signal} in rovid.toml.")
    if values.dtype.kind not in "iuf":
        text = f"{topic}.{name} ({signal}) is text; a number was expected."
        raise LogError(text, where=path, mend=f"Name another field for {signal} in rovid.toml.")
    return values


def numeric_sources(topics: Mapping[str, Columns]) -> list[str]:
    """Sources of all numbers in ``topics``, without clocks; a quaternion is one source."""
    sources: dict[str, None] = {}
    for topic, columns in topics.items():
        for name, values in columns.items():
            if values.dtype.kind in "iuf" and not name.lower().startswith("time"):
                sources[f"{topic}.{'q' if name.startswith('q[') else name}"] = None
    return list(sources)


def autopilot_parameters(columns: Columns, name: str, value: str) -> dict[str, float]:
    """Last value of each parameter, from the fields ``name`` and ``value`` of messages; empty without them."""
    if name not in columns or value not in columns or columns[name].dtype.kind != "S":
        return {}
    names = [text.decode("ascii", errors="replace") for text in columns[name].tolist()]
    return dict(zip(names, _float64(columns[value]).tolist(), strict=True))


def missing_topic(path: Path, kind: str, name: str, present: Mapping[str, Any]) -> LogError:
    """Error for a topic that the log lacks, with similar names among those ``present``."""
    mend = f'Write {kind} = "<message>.<field>" in rovid.toml.'
    return LogError(f"holds no message {name!r}. {suggestion(name, present)}", where=path, mend=mend)


def split_instance(topic: str) -> tuple[str, int | None]:
    """Message name and sensor number of a topic such as ``IMU[1]``."""
    match = _INSTANCE.match(topic)
    return (match[1], int(match[2])) if match else (topic, None)


def select_instance(
    path: Path, kind: str, topic: str, columns: Columns, instance_field: str, remarks: list[Remark]
) -> Columns:
    """Rows of the one sensor that ``topic`` names; of the first sensor, with a remark, where it names none."""
    if instance_field not in columns:
        return columns
    name, wanted = split_instance(topic)
    numbers = columns[instance_field]
    present = np.unique(numbers).tolist()
    if wanted is None and len(present) > 1:
        text = f"{name} comes from several sensors, {present}; the first was taken. {name}[{present[1]}] is another."
        remarks.append(Remark(kind="chosen", count=len(numbers), text=text))
    chosen = present[0] if wanted is None else wanted
    if chosen not in present:
        raise missing_topic(path, kind, topic, {f"{name}[{one}]": None for one in present})
    return {field_name: values[numbers == chosen] for field_name, values in columns.items()}
