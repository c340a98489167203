"""rovid.toml -> Vehicle and which column or topic holds which signal."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rovid.core.errors import NAME_LENGTH, ConfigError, suggestion
from rovid.core.transaction import recover
from rovid.core.paths import require_exists, special_kind
from rovid.core.toml import expected_number, read_toml
from rovid.trial.axis import AXES, YAW, Axis, other_axes
from rovid.trial.config_fingerprint import ConfigFingerprint, config_fingerprint
from rovid.trial.exclusions import Exclusion
from rovid.trial.log_formats import KINDS
from rovid.trial.multi_file_trials import Join
from rovid.trial.tables import read_curve
from rovid.trial.vehicle import Thruster, Vehicle

FILE_NAME = "rovid.toml"

# Factors to SI, by the kind of signal. A thruster command keeps the unit of its bench curve.
ANGLE_UNITS = {"deg": math.pi / 180.0, "rad": 1.0}
ANGULAR_RATE = {"deg/s": math.pi / 180.0, "rad/s": 1.0}
TORQUE_UNITS = {"N m": 1.0, "kN m": 1000.0}
FORCE = {"N": 1.0, "kN": 1000.0}
LENGTH = {"m": 1.0, "cm": 0.01, "mm": 0.001}
SPEED_UNITS = {"m/s": 1.0, "cm/s": 0.01, "mm/s": 0.001, "kn": 1852.0 / 3600.0}
TIME_UNITS = ("auto", "s", "ms", "us", "ns", "iso8601")


def _units_of_motion() -> dict[str, Mapping[str, float]]:
    positions: dict[str, Mapping[str, float]] = {}
    rates: dict[str, Mapping[str, float]] = {}
    for axis in AXES.values():
        position, rate = (ANGLE_UNITS, ANGULAR_RATE) if axis.angular else (LENGTH, SPEED_UNITS)
        positions |= dict.fromkeys(axis.position_signals, position)
        rates[axis.rate_signal] = rate
    return positions | rates


SIGNAL_UNITS: Mapping[str, Mapping[str, float]] = {
    **_units_of_motion(),
    "torque": TORQUE_UNITS,
    "force": FORCE,
    "north": LENGTH,
    "east": LENGTH,
}
_DEFAULT_UNIT = {name: list(units)[-1 if units is ANGULAR_RATE else 0] for name, units in SIGNAL_UNITS.items()}
_VEHICLE_NUMBERS = ("mass", "length", "width", "height", "rigid_body_inertia")
_VEHICLE_KEYS = ("name", *_VEHICLE_NUMBERS)
_ARMS = tuple(axis.arm_key for axis in AXES.values())
# Behind a key's name: whether its value is a guess of `rovid init`.
_GUESSED = "_guessed"
# How a file begins in which it did not say so.
_OLD_GUESSES = b"# Written by `rovid init`, which looked at "
_MARKS = tuple(f"{key}{_GUESSED}" for key in (*_ARMS, "curve"))
_THRUSTER_KEYS = ("name", *_ARMS, "curve", "command", "outside", *_MARKS)
_NOT_SOURCES = ("unit", "sign")
_JOIN_KEYS = ("parts", "offset", "drift", "time")
_STRETCH_KEYS = ("log", "from", "to", "reason")

_ATTITUDE = {"heading": "yaw", "roll": "roll", "pitch": "pitch"}
# Format -> signal -> (source, unit): what every log of the format calls by one name, so that [signals] need not.
STANDARD: Mapping[str, Mapping[str, tuple[str, str]]] = {
    "bin": {"heading": ("ATT.Yaw", "deg"), "roll": ("ATT.Roll", "deg"), "pitch": ("ATT.Pitch", "deg")},
    "tlog": {name: (f"ATTITUDE.{field}", "rad") for name, field in _ATTITUDE.items()},
    "ulg": dict.fromkeys(("heading", "roll", "pitch"), ("vehicle_attitude.q", "rad")),
}

# Format -> another, whose names it takes where it has none of its own.
SHARED: Mapping[str, str] = {"parquet": "csv", "bag": "mcap"}


@dataclass(frozen=True, kw_only=True)
class Signal:
    """Where a signal stands in each log format, and how to bring it to SI.

    Attributes
    ----------
    name
        One of ``UNITS``, time, ``command.<thruster>`` or the user's own name.
    sources
        Format (csv, mcap, …) -> column or topic path.
    unit
        As the user wrote it.
    factor
        Multiplies the logged value; holds the unit's factor and the sign.
    optional
        Nobody asked for it, so a log may lack it.
    """

    name: str
    sources: Mapping[str, str]
    unit: str = ""
    factor: float = 1.0
    optional: bool = False

    def __str__(self) -> str:
        """Where it stands, in what unit, of what sense."""
        places = [f"{kind} {source}" for kind, source in self.sources.items()]
        return ", ".join([*places, *filter(None, [self.unit]), *["turned around"] * (self.factor < 0.0)])

    def for_format(self, kind: str) -> Signal:
        """With a source for the format ``kind`` where one for its like is named."""
        other = SHARED.get(kind, kind)
        if other not in self.sources:
            return self
        return replace(self, sources={kind: self.sources[other], **self.sources})


@dataclass(frozen=True, kw_only=True)
class Config:
    """A read and checked rovid.toml.

    Attributes
    ----------
    measured
        Name of the signal that tells where the vehicle is along the axis, or how fast it goes where none does; the
        first of ``Axis.fixes`` where they do together; none where another log tells.
    """

    path: Path
    vehicle: Vehicle
    time: Signal
    signals: Mapping[str, Signal]
    commands: tuple[Signal, ...]
    measured_signal: str = "heading"
    exclusions: tuple[Exclusion, ...] = ()
    join: Join | None = None

    @property
    def axis(self) -> Axis:
        """The degree of freedom that is looked at."""
        return self.vehicle.axis

    @property
    def required_signals(self) -> tuple[str, ...]:
        """Names of the signals without which a log says nothing."""
        return (*self._placing, *(signal.name for signal in self.commands))

    @property
    def fingerprint(self) -> ConfigFingerprint:
        """What results rest on that come of it."""
        further = {name: str(signal) for name, signal in self.signals.items() if name not in SIGNAL_UNITS}
        signals = {name: str(signal) for name, signal in self.signals.items() if name in SIGNAL_UNITS}
        commands = {signal.name.replace(".", " of ", 1): str(signal) for signal in self.commands}
        if self.join is not None:
            signals["joined files"] = str(self.join)
        for stretch in self.exclusions:
            known = signals.get(f"left out of {stretch.log}")
            signals[f"left out of {stretch.log}"] = f"{known}, {stretch}" if known else str(stretch)
        return config_fingerprint(self.vehicle, {"time": str(self.time), **signals, **commands}, further)

    @property
    def _placing(self) -> tuple[str, ...]:
        """Names of the signals that tell together where the vehicle is."""
        if self.measured_signal in self.axis.fix_signals:
            return self.axis.fix_signals
        return (self.measured_signal,) if self.measured_signal else ()

    def maps_format(self, kind: str) -> bool:
        """Whether any signal is mapped to logs of the format ``kind``."""
        return any(kind in signal.for_format(kind).sources for signal in (*self.signals.values(), *self.commands))

    def for_format(self, kind: str) -> Config:
        """As it applies to logs of the format ``kind``, by `STANDARD` and `SHARED`."""
        signals = {}
        for name, (source, unit) in STANDARD.get(kind, {}).items():
            optional = name not in self.required_signals
            signals[name] = Signal(
                name=name, sources={kind: source}, unit=unit, factor=ANGLE_UNITS[unit], optional=optional
            )
        signals |= {name: signal.for_format(kind) for name, signal in self.signals.items()}
        return replace(
            self,
            time=self.time.for_format(kind),
            signals=signals,
            commands=tuple(signal.for_format(kind) for signal in self.commands),
        )

    def mapped_signals(self, kind: str) -> dict[str, Signal]:
        """Every signal that logs of the format ``kind`` are mapped to, time excepted."""
        everything = dict(self.signals)
        for command in self.commands:
            everything[command.name] = command
        return {name: signal for name, signal in everything.items() if kind in signal.sources}


def find_config(paths: Sequence[Path]) -> Path:
    """Nearest rovid.toml at or above the first of ``paths``.

    Raises
    ------
    NoConfigError
        There is none.
    ConfigError
        One of ``paths`` does not exist.
    """
    for path in paths:
        require_exists(path)
    folder = paths[0].resolve()
    if not folder.is_dir():
        folder = folder.parent
    recover(folder)  # a `rovid init` that was killed
    for candidate in (folder, *folder.parents):
        if (candidate / FILE_NAME).is_file() or special_kind(candidate / FILE_NAME):
            return candidate / FILE_NAME
    raise _no_config(paths[0])


class NoConfigError(ConfigError):
    """There is no rovid.toml for the logs."""


def _no_config(where: Path) -> NoConfigError:
    found = f"no {FILE_NAME} here or in any folder above it"
    tells = "it says which column holds which signal and what the thrusters are"
    mend = "Run `rovid init LOGS`, which writes one from the logs."
    return NoConfigError(f"{found}; {tells}.", where=where, mend=mend)


def load_config(path: Path, axis: Axis = YAW) -> Config:
    """Read and check ``path``, of which what concerns ``axis`` is taken.

    Raises
    ------
    ConfigError
        With the place inside the file, what was found and what was wanted.
    """
    document = read_toml(path)
    if path.read_bytes().startswith(_OLD_GUESSES):
        _mark_old_guesses(document)
    return _Reader(path, axis).config(document)


def _mark_old_guesses(document: Mapping[str, Any]) -> None:
    """Put in the marks that `rovid init` did not write before 0.3, where the values are still its own."""
    blocks = document.get("thrusters", [])
    for block in filter(lambda one: isinstance(one, dict), blocks if isinstance(blocks, list) else ()):
        if block.get(YAW.arm_key) in {1.0, -1.0}:
            block.setdefault(YAW.arm_key + _GUESSED, True)
        if block.get("curve") == "thrust_guess.csv":
            block.setdefault("curve" + _GUESSED, True)


def vehicle_without_thrusters(paths: Sequence[Path]) -> Vehicle:
    """The vehicle without its thrusters; a nameless one where there is no rovid.toml, for tables need none."""
    try:
        path = find_config(paths)
    except ConfigError:
        return Vehicle(name="vehicle", thrusters=())
    reader = _Reader(path, YAW)
    return reader.vehicle(reader.table(read_toml(path), "vehicle"), ())


class _Reader:
    """Walks the document; each complaint names the place inside the file."""

    def __init__(self, path: Path, axis: Axis) -> None:
        self.path = path
        self.axis = axis

    def complain(self, place: str, message: str, mend: str = "") -> ConfigError:
        return ConfigError(message, where=f"{self.path}: {place}", mend=mend)

    def config(self, document: Mapping[str, Any]) -> Config:
        self.known(document, ("vehicle", "thrusters", "signals", "leave_out", "join"), "top level")
        signals = self.signals(self.table(document, "signals"))
        time = signals.pop("time", Signal(name="time", sources={}, unit="auto"))
        blocks = document.get("thrusters", [])
        if not isinstance(blocks, list):
            raise self.complain("thrusters", "must be written [[thrusters]], one block each.")
        thrusters, commands = self.drive(blocks, signals)
        kinds: set[str] = set().union(*(command.sources for command in commands))
        measured = self.measured(signals, kinds, blocks)
        self.check_drive(blocks, thrusters)
        return Config(
            path=self.path,
            vehicle=self.vehicle(self.table(document, "vehicle"), tuple(thrusters)),
            time=time,
            signals=signals,
            commands=tuple(commands),
            measured_signal=measured,
            exclusions=tuple(self.stretches(document.get("leave_out", []))),
            join=self.join(self.table(document, "join")),
        )

    def join(self, table: Mapping[str, Any]) -> Join | None:
        if not table:
            return None
        self.known(table, _JOIN_KEYS, "[join]")
        parts = table.get("parts")
        if not isinstance(parts, list) or len(parts) < 2 or not all(isinstance(part, str) for part in parts):
            raise self.complain(
                "[join]", "has no parts: two words or more were expected.", 'Add parts = ["ins", "thr"].'
            )
        time = self.table(table, "time")
        self.known(time, parts, "[join] time")
        return Join(
            parts=tuple(parts),
            offset=self.of_clocks(table, "offset", parts),
            drift=self.of_clocks(table, "drift", parts),
            time={part: self.clock(value, f"[join] time {part}") for part, value in time.items()},
        )

    def of_clocks(self, table: Mapping[str, Any], key: str, parts: Sequence[str]) -> dict[str, float]:
        """Numbers by part, or by the name of a file, which has a dot or a star in it."""
        entries = self.table(table, key)
        self.known([name for name in entries if not {".", "*", "/"} & set(name)], parts, f"[join] {key}")
        return {name: self.number(value, f"[join] {key} {name}") for name, value in entries.items()}

    def clock(self, value: Any, place: str) -> tuple[str, str]:
        signal = self.signal("time", value, place)
        return next(iter(signal.sources.values()), ""), signal.unit

    def stretches(self, blocks: Any) -> Iterator[Exclusion]:
        if not isinstance(blocks, list):
            raise self.complain("leave_out", "must be written [[leave_out]], one block each.")
        for index, block in enumerate(blocks):
            place = f"[[leave_out]] number {index + 1}"
            if not isinstance(block, dict):
                raise self.complain(place, f"is {block!r}; a block [[leave_out]] was expected.")
            self.known(block, _STRETCH_KEYS, place)
            if not isinstance(block.get("log"), str) or not isinstance(block.get("reason", ""), str):
                raise self.complain(place, "has no log and reason that are text.", 'Add log = "hold_03.csv".')
            begin = self.number(block.get("from", 0.0), f"{place} from")
            end = self.number(block["to"], f"{place} to") if "to" in block else math.inf
            if not end > begin:
                raise self.complain(place, f"ends at {end:g} s and begins at {begin:g} s.", "Give from and to in s.")
            log, reason = self.name(block["log"], f"{place} log"), self.name(block.get("reason", ""), f"{place} reason")
            yield Exclusion(log=log, begin=begin, end=end, reason=reason)

    def drive(self, blocks: Sequence[Any], signals: dict[str, Signal]) -> tuple[list[Thruster], list[Signal]]:
        """What pushes along the axis, and its commands; a logged torque is taken out of ``signals``."""
        thrusters, commands = [], []
        for index, block in enumerate(blocks):
            pair = self.thruster(index, block)
            if pair is not None:
                thrusters.append(pair[0])
                commands.append(pair[1])
        push = self.axis.force_name
        if push not in signals:
            return thrusters, commands
        if thrusters:
            text = f"stands beside [[thrusters]]; the {push} comes from one of them."
            raise self.complain(f"[signals] {push}", text, "Delete one.")
        return [Thruster(name=push, arm=1.0, curve=None)], [signals.pop(push)]

    def check_drive(self, blocks: Sequence[Any], thrusters: Sequence[Thruster]) -> None:
        axis = self.axis
        # What rights itself swings when it is let go of, and tells of itself without a drive.
        wanting = not thrusters and not axis.self_righting
        if wanting and not blocks:
            raise self.complain("[[thrusters]]", f"there are none, and no {axis.force_name} is mapped in [signals].")
        if wanting:
            raise self.complain("[[thrusters]]", f"none has {axis.arm_key}.", f"Add {axis.arm_key} = {_example(axis)}.")
        names = [thruster.name for thruster in thrusters]
        if len(set(names)) < len(names):
            raise self.complain("[[thrusters]]", f"two have the same name among {names}.", "Name each differently.")

    def measured(self, signals: Mapping[str, Signal], kinds: Iterable[str], blocks: Sequence[Any]) -> str:
        """Name of the signal that tells where the vehicle is; logs of ``kinds`` may hold it by a standard name."""
        axis = self.axis
        there = set(signals).union(*(STANDARD.get(kind, ()) for kind in kinds))
        measured = next((name for name in (*axis.position_signals, axis.rate_signal) if name in there), "")
        if not measured and axis.fix_signals and there.issuperset(axis.fix_signals):
            measured = axis.fix_signals[0]
        # A rate alone would leave unknown where the vehicle points: the heading, or the tilt that rights it.
        if not measured or (axis.angular and measured == axis.rate_signal):
            wanted = (
                axis.position_signal
                if axis.angular
                else f"{' or '.join(axis.position_signals)} and no {axis.rate_signal}"
            )
            unit = _DEFAULT_UNIT[axis.position_signal]
            missing = f'{axis.position_signal} = {{ csv = "<column>", unit = "{unit}" }}'
            mend = f"Add {missing}."
            others = other_axes(signals, _keys(blocks))
            if axis is YAW and others:
                # Yaw is what is taken where no axis is named.
                mend = f"These logs are of {' and '.join(others)}: give --axis {others[0]}, or for yaw add {missing}."
            raise self.complain("[signals]", f"has no {wanted}.", mend)
        return measured

    def table(self, document: Mapping[str, Any], name: str) -> Mapping[str, Any]:
        value = document.get(name, {})
        if not isinstance(value, dict):
            raise self.complain(name, f"is {value!r}; a table [{name}] was expected.")
        return value

    def known(self, table: Iterable[str], keys: Sequence[str], place: str) -> None:
        for key in table:
            if key not in keys:
                raise self.complain(place, f"{key!r} is not known here.", suggestion(key, keys))

    def number(self, value: Any, place: str, *, positive: bool = False) -> float:
        wanted = expected_number(value, positive=positive)
        if wanted:
            raise self.complain(place, f"is {value!r}; {wanted} was expected.")
        return float(value)

    def name(self, value: Any, place: str) -> str:
        text = str(value)
        if len(text) > NAME_LENGTH:
            raise self.complain(place, f"is a name of {len(text)} characters; {NAME_LENGTH} at most were expected.")
        return text

    def vehicle(self, table: Mapping[str, Any], thrusters: tuple[Thruster, ...]) -> Vehicle:
        self.known(table, _VEHICLE_KEYS, "[vehicle]")
        given = [key for key in _VEHICLE_NUMBERS if key in table]
        numbers = {key: self.number(table[key], f"[vehicle] {key}", positive=True) for key in given}
        name = self.name(table.get("name", "vehicle"), "[vehicle] name")
        return Vehicle(name=name, thrusters=thrusters, axis=self.axis, **numbers)

    def thruster(self, index: int, block: Mapping[str, Any]) -> tuple[Thruster, Signal] | None:
        """The thruster and its command; None for one that does not push along the axis."""
        place = f"[[thrusters]] number {index + 1}"
        if not isinstance(block, dict):
            raise self.complain(place, f"is {block!r}; a block [[thrusters]] was expected.")
        self.known(block, _THRUSTER_KEYS, place)
        name = self.name(block.get("name", f"thruster_{index + 1}"), f"{place} name")
        place = f"[[thrusters]] {name!r}"
        if self._pushes_elsewhere(block):
            return None
        self._require_keys(block, place)
        thruster = Thruster(
            name=name,
            clamp=self._clamps(block, place),
            arm=self.number(block[self.axis.arm_key], f"{place} {self.axis.arm_key}"),
            curve=read_curve(self.path.parent / str(block["curve"])),
            surge_share=self.number(block.get("surge", 0.0), f"{place} surge"),
            arm_guessed=self._guessed(block, self.axis.arm_key, place),
            curve_guessed=self._guessed(block, "curve", place),
        )
        return thruster, self.signal(f"command.{name}", block["command"], f"{place} command")

    def _pushes_elsewhere(self, block: Mapping[str, Any]) -> bool:
        return self.axis.arm_key not in block and any(other in block for other in _ARMS)

    def _require_keys(self, block: Mapping[str, Any], place: str) -> None:
        examples = {self.axis.arm_key: _example(self.axis), "curve": '"thrust_curve.csv"', "command": '{ csv = "…" }'}
        for key, example in examples.items():
            if key not in block:
                raise self.complain(place, f"has no {key}.", f"Add {key} = {example}.")

    def _guessed(self, block: Mapping[str, Any], key: str, place: str) -> bool:
        """Whether the mark beside a value says so: as long as that is the one that was guessed, or in any case."""
        guessed = block.get(key + _GUESSED, False)
        if isinstance(guessed, bool):
            return guessed
        if isinstance(guessed, str) is not isinstance(block[key], str):
            wanted = f"the value of {key} that was guessed, true or false was expected."
            raise self.complain(f"{place} {key}{_GUESSED}", f"is {guessed!r}; {wanted}")
        return bool(guessed == block[key])

    def _clamps(self, block: Mapping[str, Any], place: str) -> bool:
        outside = block.get("outside", "refuse")
        if outside not in {"refuse", "clamp"}:
            raise self.complain(f"{place} outside", f'is {outside!r}; "refuse" or "clamp" was expected.')
        return bool(outside == "clamp")

    def signals(self, table: Mapping[str, Any]) -> dict[str, Signal]:
        for name in table:
            self.name(name, f"[signals] {name}")
        return {name: self.signal(name, value, f"[signals] {name}") for name, value in table.items()}

    def signal(self, name: str, value: Any, place: str) -> Signal:
        entry = {"csv": value} if isinstance(value, str) else value
        if not isinstance(entry, dict) or not entry:
            raise self.complain(place, f'is {value!r}; {{ csv = "<column>", mcap = "<topic.field>" }} was expected.')
        self.known(entry, (*KINDS, *_NOT_SOURCES), place)
        for key, text in entry.items():
            if key != "sign" and not isinstance(text, str):
                raise self.complain(f"{place} {key}", f"is {text!r}; text was expected.")
        sources = {key: text for key, text in entry.items() if key not in _NOT_SOURCES}
        units, default = _units_of(name)
        unit = entry.get("unit", default)
        sign = self.number(entry.get("sign", 1), f"{place} sign")
        if abs(sign) != 1:
            raise self.complain(f"{place} sign", f"is {sign:g}; 1 or -1 was expected.")
        if units is not None and unit not in units:
            raise self.complain(f"{place} unit", f"is {unit!r}; one of {', '.join(units)} was expected.")
        factor = 1.0 if units is None else units[unit]
        return Signal(name=name, sources=sources, unit=unit, factor=sign * factor)


def _keys(blocks: Sequence[Any]) -> set[str]:
    """All keys of the blocks that are such."""
    return {key for block in blocks if isinstance(block, dict) for key in block}


def _units_of(signal: str) -> tuple[Mapping[str, float] | None, str]:
    """What one of each unit is in SI, and the usual one; none where a signal is the user's own, and keeps its unit."""
    if signal == "time":
        return dict.fromkeys(TIME_UNITS, 1.0), "auto"
    return SIGNAL_UNITS.get(signal), _DEFAULT_UNIT.get(signal, "")


def _example(axis: Axis) -> str:
    return "0.43" if axis.angular else "1.0"
