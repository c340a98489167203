"""rovid.toml: the vehicle, and the column or topic of each signal."""

import contextlib
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

from rovid.core.errors import ConfigError
from rovid.core.input_files import read_toml, require_exists, special_kind
from rovid.core.transaction import recover
from rovid.trial.assumptions import ConfigFingerprint, config_fingerprint, prior_digest
from rovid.trial.axis import (
    ANGLE_UNITS,
    AXES,
    DEFAULT_UNIT,
    PLANAR,
    SIGNAL_UNITS,
    STANDARD_SOURCES,
    YAW,
    Axis,
    Signal,
    meant_signal,
    other_axes,
)
from rovid.trial.config_values import GUESSED, ConfigValues
from rovid.trial.fault import FAULT_IDS, FaultOverrides
from rovid.trial.log_files import Join, files_in, is_log, nothing_to_read
from rovid.trial.preprocessing import Exclusion
from rovid.trial.vehicle import Thruster, Vehicle

FILE_NAME = "rovid.toml"
_NUMBERS = ("mass", "length", "width", "height", "rigid_body_inertia", "thrust_scale", "thrust_scale_error")
_VEHICLE_KEYS = ("name", *_NUMBERS)
# First bytes of a rovid.toml of rovid 0.2, which did not mark guesses.
_UNMARKED_GUESSES = b"# Written by `rovid init`, which looked at "
_JOIN_KEYS = ("parts", "offset", "drift", "time")
_EXCLUSION_KEYS = ("log", "from", "to", "reason")
_TABLES = ("vehicle", "thrusters", "rudders", "signals", "leave_out", "join", "faults", "planar")


@dataclass(frozen=True, kw_only=True)
class Config:
    """A checked rovid.toml."""

    path: Path
    vehicle: Vehicle
    time: Signal
    signals: Mapping[str, Signal]
    commands: tuple[Signal, ...]
    #: Signal that measures the position along the axis, or else the rate; the first of ``Axis.fix_signals`` where they
    #: determine the position together; empty where another log holds it.
    measured_signal: str = "heading"
    exclusions: tuple[Exclusion, ...] = ()
    join: Join | None = None
    faults: FaultOverrides = field(default_factory=FaultOverrides)  #: Faults of logs whose remedy the user rejects.
    prior: Mapping[str, Any] = field(default_factory=dict)  #: [planar.prior]; empty for one axis.

    @property
    def axis(self) -> Axis:
        """The degree of freedom."""
        return self.vehicle.axis

    @property
    def required_signals(self) -> tuple[str, ...]:
        """Names of the signals that each log must hold."""
        commands = [signal.name for signal in self.commands]
        driven = zip(self.commands, self.vehicle.thrusters, strict=False)  # A part of a joined log has no commands.
        commands += [thruster.steering.speed for _, thruster in driven if thruster.steering]
        if self.measured_signal in self.axis.fix_signals:
            return (*self.axis.fix_signals, *commands)
        return (*filter(None, [self.measured_signal]), *commands)

    @property
    def fingerprint(self) -> ConfigFingerprint:
        """Settings that results depend on."""
        signals, further = dict[str, str](), dict[str, str]()
        for name, signal in self.signals.items():
            (signals if name in SIGNAL_UNITS else further)[name] = str(signal)
        commands = {signal.name.replace(".", " of ", 1): str(signal) for signal in self.commands}
        if self.join is not None:
            signals["joined files"] = str(self.join)
        if self.faults.kept:
            signals["faults kept"] = str(self.faults)
        for exclusion in self.exclusions:
            earlier = signals.get(f"left out of {exclusion.log}")
            signals[f"left out of {exclusion.log}"] = f"{earlier}, {exclusion}" if earlier else str(exclusion)
        if self.prior:
            signals["prior"] = prior_digest(self.prior, self.vehicle, self.path.parent)
        return config_fingerprint(self.vehicle, {"time": str(self.time), **signals, **commands}, further)

    def maps_format(self, kind: str) -> bool:
        """Whether any signal is mapped to logs of the format ``kind``."""
        return any(kind in signal.for_format(kind).sources for signal in (*self.signals.values(), *self.commands))

    def for_format(self, kind: str) -> Self:
        """The configuration for logs of the format ``kind``, with its standard and shared sources."""
        signals = {}
        for name, (source, unit) in STANDARD_SOURCES.get(kind, {}).items():
            optional = name not in self.required_signals
            factor = ANGLE_UNITS[unit]
            signals[name] = Signal(name=name, sources={kind: source}, unit=unit, factor=factor, optional=optional)
        signals |= {name: signal.for_format(kind) for name, signal in self.signals.items()}
        commands = tuple(signal.for_format(kind) for signal in self.commands)
        return replace(self, time=self.time.for_format(kind), signals=signals, commands=commands)

    def mapped_signals(self, kind: str) -> dict[str, Signal]:
        """Every signal, except the time, that is mapped to logs of the format ``kind``."""
        signals = {**self.signals, **{command.name: command for command in self.commands}}
        return {name: signal for name, signal in signals.items() if kind in signal.sources}


class NoConfigError(ConfigError):
    """There is no rovid.toml for the logs."""


def find_config(paths: Sequence[Path]) -> Path:
    """Nearest rovid.toml at or above the first of ``paths``; `NoConfigError` if there is none."""
    for path in paths:
        require_exists(path)
    first = paths[0].resolve()
    folder = first if first.is_dir() else first.parent
    recover(folder)  # Finishes the work of a `rovid init` that was killed.
    for candidate in (folder, *folder.parents):
        if (candidate / FILE_NAME).is_file() or special_kind(candidate / FILE_NAME):
            return candidate / FILE_NAME
    if not any(map(is_log, files_in(paths))):
        raise nothing_to_read(paths, NoConfigError)
    text = f"no {FILE_NAME} here or in any folder above it; it maps columns to signals and describes the thrusters."
    raise NoConfigError(text, where=paths[0], mend="Run `rovid init LOGS`, which writes one from the logs.")


def load_config(path: Path, axis: Axis = YAW) -> Config:
    """Read and check the rovid.toml at ``path``, for ``axis``; a `ConfigError` names the place in the file."""
    document = read_toml(path)
    if path.read_bytes().startswith(_UNMARKED_GUESSES):  # Unchanged guesses of `rovid init` before 0.3 are marked.
        blocks = document.get("thrusters", [])
        for block in filter(lambda one: isinstance(one, dict), blocks if isinstance(blocks, list) else ()):
            if block.get(YAW.arm_key) in {1.0, -1.0}:
                block.setdefault(YAW.arm_key + GUESSED, True)
            if block.get("curve") == "thrust_guess.csv":
                block.setdefault("curve" + GUESSED, True)
    return _Parser(path, axis).config(document)


def config_from(document: Mapping[str, Any], axis: Axis = YAW) -> Config:
    """Check a description with the tables of a rovid.toml, as `load_config`; a curve may be a `ThrustCurve`."""
    return _Parser(Path("description"), axis).config(document)


def load_config_of_any_axis(path: Path) -> Config:
    """`load_config` for yaw, or for the first axis that the file describes if it does not describe yaw."""
    try:
        return load_config(path)
    except ConfigError:
        for axis in AXES.values():
            with contextlib.suppress(ConfigError):
                return load_config(path, axis)
        raise


def load_planar_config(path: Path) -> Config:
    """`load_config` for surge, sway and yaw together, with each actuator of any of them; needs heading or yaw rate."""
    return load_config(path, PLANAR)


def vehicle_without_thrusters(paths: Sequence[Path]) -> Vehicle:
    """The vehicle's name and size; a nameless vehicle where there is no rovid.toml, which tables do not need."""
    try:
        path = find_config(paths)
    except ConfigError:
        return Vehicle(name="vehicle", thrusters=())
    parser = _Parser(path, YAW)
    return parser.vehicle(parser.table(read_toml(path), "vehicle"), ())


class _Parser(ConfigValues):
    """Checks a document."""

    def config(self, document: Mapping[str, Any]) -> Config:
        self.require_known(document, _TABLES, "top level")
        signals = {}
        for name, value in self.table(document, "signals").items():
            if name not in SIGNAL_UNITS and (known := meant_signal(name)):
                mend = f"Nearest: {known!r}. Give a further channel a name of its own."
                raise self.error("[signals]", f"{name!r} is not known here.", mend)
            signals[self.name(name, f"[signals] {name}")] = self.signal(name, value, f"[signals] {name}")
        self.require_same_kind(signals)
        time = signals.pop("time", Signal(name="time", sources={}, unit="auto"))
        blocks, rudders = self.blocks(document, "thrusters"), self.blocks(document, "rudders")
        thrusters, commands = self.actuators(blocks, rudders, signals)
        measured_signal = self.measured_signal(signals, {kind for one in commands for kind in one.sources}, blocks)
        self.require_actuators(blocks, thrusters)
        coupled = self.table(document, "planar")
        self.require_known(coupled, ("prior",), "[planar]")
        return Config(
            path=self.path,
            vehicle=self.vehicle(self.table(document, "vehicle"), tuple(thrusters)),
            time=time,
            signals=signals,
            commands=tuple(commands),
            measured_signal=measured_signal,
            exclusions=tuple(self.exclusions(document)),
            join=self.join(document),
            faults=self.kept_faults(document),
            prior=self.table(coupled, "prior") if self.planar else {},
        )

    def vehicle(self, table: Mapping[str, Any], thrusters: tuple[Thruster, ...]) -> Vehicle:
        self.require_known(table, _VEHICLE_KEYS, "[vehicle]")
        numbers = {key: self.number(table[key], f"[vehicle] {key}", positive=True) for key in _NUMBERS if key in table}
        name = self.name(table.get("name", "vehicle"), "[vehicle] name")
        thrusters = tuple(one.scaled(numbers.get("thrust_scale", 1.0)) for one in thrusters)
        return Vehicle(name=name, thrusters=thrusters, axis=self.axis, planar=self.planar, **numbers)

    def require_same_kind(self, signals: Mapping[str, Signal]) -> None:
        """`ConfigError` where only one of north and east is an angle on the globe."""
        fix = [signals[name] for name in ("north", "east") if name in signals]
        if len({one.is_geodetic for one in fix}) > 1 or (len(fix) == 1 and fix[0].is_geodetic):
            units = ", ".join(f"{one.name} has the unit {one.unit!r}" for one in fix)
            raise self.error("[signals]", f"{units}; a latitude and a longitude are read together.", "Map both.")
        if len({one.position for one in fix}) > 1:
            raise self.error("[signals]", "north and east have different positions.", "Give both that of the antenna.")

    def measured_signal(self, signals: Mapping[str, Signal], kinds: Iterable[str], blocks: Sequence[Any]) -> str:
        """Signal that measures the position; logs of ``kinds`` may have a standard source of it."""
        axis = self.axis
        present = set(signals).union(*(STANDARD_SOURCES.get(kind, ()) for kind in kinds))
        measured = next((name for name in (*axis.position_signals, axis.rate_signal) if name in present), "")
        if not measured and axis.fix_signals and present.issuperset(axis.fix_signals):
            measured = axis.fix_signals[0]
        # An angular rate alone leaves the tilt unknown that rights the vehicle.
        if measured and not (axis.self_righting and measured == axis.rate_signal):
            return measured
        expected = axis.position_signal
        if not axis.angular:
            expected = f"{' or '.join(axis.position_signals)} and no {axis.rate_signal}"
        line = f'{axis.position_signal} = {{ csv = "<column>", unit = "{DEFAULT_UNIT[axis.position_signal]}" }}'
        others = other_axes(signals, {key for block in blocks if isinstance(block, dict) for key in block})
        if axis is YAW and others and not self.planar:  # Yaw is the default axis.
            mend = f"These logs describe {' and '.join(others)}: give --axis {others[0]}, or for yaw add {line}."
            raise self.error("[signals]", f"has no {expected}.", mend)
        raise self.error("[signals]", f"has no {expected}.", f"Add {line}.")

    def exclusions(self, document: Mapping[str, Any]) -> Iterator[Exclusion]:
        """The intervals of [[leave_out]]."""
        for index, block in enumerate(self.blocks(document, "leave_out")):
            place = f"[[leave_out]] number {index + 1}"
            self.require_block(block, "leave_out", place, _EXCLUSION_KEYS)
            if not isinstance(block.get("log"), str) or not isinstance(block.get("reason", ""), str):
                raise self.error(place, "has no log and reason that are text.", 'Add log = "hold_03.csv".')
            begin = self.number(block.get("from", 0.0), f"{place} from")
            end = self.number(block["to"], f"{place} to") if "to" in block else math.inf
            if not end > begin:
                raise self.error(place, f"ends at {end:g} s and begins at {begin:g} s.", "Give from and to in s.")
            log, reason = self.name(block["log"], f"{place} log"), self.name(block.get("reason", ""), f"{place} reason")
            yield Exclusion(log=log, begin=begin, end=end, reason=reason)

    def join(self, document: Mapping[str, Any]) -> Join | None:
        """The table [join]; None where there is none."""
        table = self.table(document, "join")
        if not table:
            return None
        self.require_known(table, _JOIN_KEYS, "[join]")
        parts = table.get("parts")
        if not isinstance(parts, list) or len(parts) < 2 or not all(isinstance(part, str) for part in parts):
            raise self.error("[join]", "has no parts: two words or more were expected.", 'Add parts = ["ins", "thr"].')
        times = self.table(table, "time")
        self.require_known(times, parts, "[join] time")
        clocks = {}
        for part, value in times.items():
            signal = self.signal("time", value, f"[join] time {part}")
            clocks[part] = next(iter(signal.sources.values()), ""), signal.unit
        corrections: dict[str, dict[str, float]] = {}
        for key in ("offset", "drift"):
            # By part, or by file name or pattern, which has a dot, a star or a slash in it.
            entries = self.table(table, key)
            self.require_known([name for name in entries if not {".", "*", "/"} & set(name)], parts, f"[join] {key}")
            corrections[key] = {name: self.number(value, f"[join] {key} {name}") for name, value in entries.items()}
        return Join(parts=tuple(parts), time=clocks, **corrections)

    def kept_faults(self, document: Mapping[str, Any]) -> FaultOverrides:
        """The table [faults]."""
        table = self.table(document, "faults")
        self.require_known(table, FAULT_IDS, "[faults]")
        kept = {}
        for fault, value in table.items():
            logs = ["*"] if value == "keep" else value
            if not isinstance(logs, list) or not all(isinstance(log, str) for log in logs):
                raise self.error(f"[faults] {fault}", f'is {value!r}; "keep" or a list of logs was expected.')
            kept[fault] = tuple(logs)
        return FaultOverrides(kept=kept)
