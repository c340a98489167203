"""What the logs alone tell for a first rovid.toml: all that is there is read, and guessed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from rovid.core.atomic_write import OutputFile
from rovid.core.errors import DataError, RovidError, suggestion
from rovid.core.paths import list_files, require_exists
from rovid.core.signatures import CONFIG
from rovid.core.signatures import GUESSED_CURVE as GUESSED
from rovid.preflight.autopilot import thruster_outputs, vehicle_type
from rovid.preflight.clock_alignment import align_clocks
from rovid.preflight.clock_report import ClockOffsets
from rovid.preflight.raw_columns import RawColumn
from rovid.preflight.signal_guess import UNNAMED, ColumnMapping, map_columns
from rovid.preflight.thruster_guess import GuessHints, ThrusterCommand, response_delay
from rovid.preflight.user_overrides import UserOverrides
from rovid.readers.csv_dialect import read_layout
from rovid.readers.formats import READERS
from rovid.readers.raw_log import Channel, LogContents, is_plausible
from rovid.trial.axis import YAW, Axis
from rovid.trial.config import FILE_NAME, Config
from rovid.trial.log_files import Join, guess_parts
from rovid.trial.signal_names import Signal
from rovid.trial.tables import CURVE_COLUMNS, read_curve
from rovid.trial.vehicle import ThrustCurve, Vehicle
from rovid.trial.vehicle_presets import VehiclePreset, load_preset

GUESSED_CURVE = "thrust_guess.csv"
# Logs are many and alike: so many of each format tell enough.
_LOGS = 12
# What cannot be read of one log is told in so many lines.
_SHOWN = 3
# Sources of ArduPilot's outputs.
_OUTPUT = "RCOU.C"
# Of the guessed curve, N at its ends; a constant scale of all thrust never shows in yaw data.
FULL_THRUST = 100.0
_PULSES = np.array([1100.0, 1500.0, 1900.0])
# Commands seen leave this much room to the end of a guessed curve.
_ROOM = 1.1
_ORIENTATIONS = ("orientation", "quaternion", "rotation", ".q")


@dataclass(frozen=True, kw_only=True)
class LogSurvey:
    """What `rovid init` found.

    Attributes
    ----------
    axis
        The degree of freedom that was looked at.
    guesses
        Format -> what its sources are.
    clocks
        Format -> source of the clock, empty where it has one of its own.
    curve
        Name of the thrust curve beside the logs; empty where no command is known.
    new_curve
        What is to be written under that name; None where it is there.
    curve_guessed
        Whether it is a guess.
    profile
        The type of vehicle; None where nobody knows.
    recognised
        Whether that is a guess, from the outputs that turn the vehicle.
    join
        How the files of one trial are known, where no file holds both heading and commands.
    apart
        How far their clocks are apart.
    logs
        How many were looked at.
    lacking
        What was not looked at: files that are no logs or cannot be read, what of a log cannot be, and what
        `rovid check` will say of some: that they lack what is mapped.
    hand
        What somebody put in that no log tells.
    """

    folder: Path
    mappings: Mapping[str, ColumnMapping]
    clock_sources: Mapping[str, str]
    curve: str
    new_curve: ThrustCurve | None
    curve_guessed: bool
    logs: int
    axis: Axis = YAW
    profile: VehiclePreset | None = None
    profile_guessed: bool = False
    join: Join | None = None
    clock_offsets: ClockOffsets = field(default_factory=ClockOffsets)
    warnings: tuple[str, ...] = ()
    overrides: UserOverrides = field(default_factory=UserOverrides)

    @property
    def unrecognised(self) -> tuple[str, ...]:
        """What was not recognised in any log: "heading", or what another axis wants, "command"; the user names it."""
        return tuple(dict.fromkeys(what for one in self.mappings.values() for what in one.missing))

    @property
    def unknown_directions(self) -> tuple[str, ...]:
        """Sources of commands of which the logs do not tell whether, and which way, they turn the vehicle."""
        return tuple(command.source for command in all_commands(self.mappings) if not command.direction_known)


@dataclass(frozen=True, kw_only=True)
class SurveyOptions:
    """What the user told of the logs.

    Attributes
    ----------
    axis
        Along which the vehicle moves.
    headings, commands
        Columns of what is measured and of commands: where the logs are of several formats, those of each.
    vehicle
        Its type.
    patient
        Whether somebody stands by to name the columns, so that logs of which none was recognised are not refused.
    """

    axis: Axis = YAW
    headings: tuple[str, ...] = ()
    commands: tuple[str, ...] = ()
    vehicle: str = ""
    interactive: bool = False


@dataclass(frozen=True, kw_only=True)
class LogsRead:
    """What was read, by format, and what was in the way."""

    folder: Path
    logs: dict[str, list[Mapping[str, RawColumn]]] = field(default_factory=dict)
    names: dict[str, list[str]] = field(default_factory=dict)
    clocks: dict[str, str] = field(default_factory=dict)
    own_clocks: dict[str, str] = field(default_factory=dict)
    parameters: dict[str, dict[str, float]] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    joins: list[Join] = field(default_factory=list)

    def add(self, path: Path) -> None:
        """Read one log more, where its format has not been seen often enough; it is called by its way in the folder."""
        kind = READERS[path.suffix.lower()].kind
        logs = self.logs.setdefault(kind, [])
        if len(logs) >= _LOGS or is_thrust_curve(path):
            return
        try:
            contents, seen, left_out = read_columns(path)
        except RovidError as error:
            self.problems.append(str(error))
            return
        self.problems.extend(left_out)
        self.clocks.setdefault(kind, contents.clock)
        self.parameters.setdefault(kind, {}).update(contents.parameters)
        name = path.relative_to(self.folder).as_posix() if path.is_relative_to(self.folder) else path.name
        self.names.setdefault(kind, []).append(name)
        self.own_clocks[name] = contents.clock
        logs.append(seen)


def survey(paths: Sequence[Path], asked: SurveyOptions | None = None) -> LogSurvey:
    """Look at the logs in ``paths``.

    Raises
    ------
    RovidError
        There are no logs, none can be read, none holds a heading or a command, or what was asked for is not there.
    """
    asked = asked or SurveyOptions()
    return survey_read_logs(read_logs(paths, asked.axis), asked)


def read_logs(paths: Sequence[Path], axis: Axis = YAW) -> LogsRead:
    """Read the logs in ``paths``, the first dozen of each format; for what moves along ``axis``."""
    looked = LogsRead(folder=_folder(paths))
    for path in log_files(paths, looked.problems):
        looked.add(path)
    if (join := _joined(looked, axis)) is not None:
        looked.joins.append(join)
    return looked


def survey_read_logs(
    looked: LogsRead, asked: SurveyOptions | None = None, hand: UserOverrides | None = None
) -> LogSurvey:
    """What was read, with what the user told of it, and with what was put in by hand.

    Raises
    ------
    RovidError
        As for `survey`.
    """
    asked = asked or SurveyOptions()
    named = load_preset(asked.vehicle) if asked.vehicle else None
    # What is read stays as it is: somebody may ask again.
    looked = replace(looked, problems=list(looked.problems))
    _require(asked, looked)
    told = named or _told(looked)
    guesses = _recognised(looked, asked, told)
    alike = None if told or asked.axis is not YAW else _alike(list(all_commands(guesses)))
    if alike:
        told, guesses = alike, _recognised(looked, asked, alike)
    if hand is not None:
        guesses = hand.apply_to(guesses)
    headings = [one.measured for one in guesses.values() if one.signals]
    curve = _Curve.of(looked.folder, list(all_commands(guesses)), told, looked.problems)
    return LogSurvey(
        folder=looked.folder,
        axis=asked.axis,
        mappings=guesses,
        clock_sources=looked.clocks,
        curve=curve.name,
        new_curve=curve.new,
        curve_guessed=curve.guessed or (alike is not None and curve.new is not None),
        profile=told,
        profile_guessed=alike is not None,
        join=next(iter(looked.joins), None),
        logs=sum(map(len, looked.logs.values())),
        warnings=(
            *dict.fromkeys(looked.problems),
            *(f"{one.source} is taken for the heading: {one.reason}." for one in headings if UNNAMED in one.reason),
            *(command.contradiction for command in all_commands(guesses) if command.contradiction),
            *_lacking(looked, guesses),
        ),
        overrides=hand or UserOverrides(),
    )


def _folder(paths: Sequence[Path]) -> Path:
    first = paths[0]
    if first.is_dir():
        return first
    return first.parent


def _joined(looked: LogsRead, axis: Axis) -> Join | None:
    """How files are parts of trials, where no file holds both heading and commands; they are put together."""
    for kind, logs in looked.logs.items():
        found = map_columns(logs, GuessHints(axis=axis))
        if found.missing or not found.has_actuation or any(_holds(log, found) for log in logs):
            continue
        names = looked.names[kind]
        join = Join(parts=guess_parts(names))
        files: dict[str, list[Mapping[str, RawColumn]]] = {}
        for name, log in zip(names, logs, strict=True):
            if join.part(name):
                files.setdefault(join.trial_key(name), []).append(log)
        trials = {name: _one_clock(parts, found) for name, parts in files.items()}
        whole = [name for name, log in trials.items() if _holds(log, found)]
        if not whole:
            continue
        looked.logs[kind], looked.names[kind] = [trials[name] for name in whole], whole
        return replace(join, time=_clocks(looked, kind, join))
    return None


def _one_clock(parts: Sequence[Mapping[str, RawColumn]], found: ColumnMapping) -> Mapping[str, RawColumn]:
    """What the files of a trial hold, on the clock of the heading as far as they tell how that stands."""
    heading = found.measured
    home = next((part for part in parts if heading.source in part), {})
    whole = dict(home)
    for part in parts:
        if part is home:
            continue
        alike = align_clocks(home, part)
        commands = {one.source: one.neutral for one in found.commands if one.source in part}
        late = alike.offset if alike else response_delay(commands, dict(part) | dict(home), heading) if home else 0.0
        whole = {source: replace(seen, time=seen.time + late) for source, seen in part.items()} | whole
    return whole


def _holds(log: Mapping[str, RawColumn], found: ColumnMapping) -> bool:
    """Whether a log holds the heading and a command."""
    commands = {command.source for command in found.commands}
    commands |= {found.signals["torque"].source} if "torque" in found.signals else set()
    return found.measured.source in log and bool(commands & log.keys())


def _clocks(looked: LogsRead, kind: str, join: Join) -> dict[str, tuple[str, str]]:
    """Columns of time that are not called as the first."""
    own = {join.part(name): clock for name, clock in looked.own_clocks.items() if join.part(name)}
    return {part: (clock, "") for part, clock in own.items() if clock != looked.clocks[kind]}


def _require(asked: SurveyOptions, looked: LogsRead) -> None:
    """That what the user named is there."""
    present = sorted(set().union(*(log for logs in looked.logs.values() for log in logs)))
    for option, sources in (("--heading", asked.headings), ("--command", asked.commands)):
        for source in sources:
            if source not in present:
                raise DataError(
                    f"{option}: no log has a column {source!r}. {suggestion(source, present)}", where=looked.folder
                )


def _told(looked: LogsRead) -> VehiclePreset | None:
    """The type of vehicle that the parameters of an autopilot tell."""
    names = filter(None, map(vehicle_type, looked.parameters.values()))
    return next(map(load_preset, names), None)


def _alike(commands: Sequence[ThrusterCommand]) -> VehiclePreset | None:
    """The type of vehicle of which the outputs that turn it are those of these logs."""
    outputs = {int(command.source.removeprefix(_OUTPUT)): command for command in commands if _is_output(command)}
    turning = {number for number, command in outputs.items() if command.direction}
    if turning != {1, 2, 3, 4} or not {5, 6} <= outputs.keys():
        return None
    return load_preset("bluerov2-heavy" if {7, 8} <= outputs.keys() else "bluerov2")


def _is_output(command: ThrusterCommand) -> bool:
    return command.source.startswith(_OUTPUT) and command.source.removeprefix(_OUTPUT).isdigit()


def _recognised(looked: LogsRead, asked: SurveyOptions, told: VehiclePreset | None) -> dict[str, ColumnMapping]:
    """What the sources are, of each format in which a heading and a command were found, or else one of both."""
    every: dict[str, ColumnMapping] = {}
    for kind, logs in looked.logs.items():
        if logs:
            outputs = thruster_outputs(looked.parameters.get(kind, {}))
            there = set().union(*logs)
            heading = next((one for one in asked.headings if one in there), next(iter(asked.headings), ""))
            wanted = GuessHints(
                axis=asked.axis, heading=heading, commands=asked.commands, outputs=outputs, profile=told
            )
            every[kind] = map_columns(logs, wanted)
    if not every and looked.problems:
        raise DataError(looked.problems[0], where="")
    if not every:
        raise DataError("holds no logs.", where=looked.folder)
    guesses = {kind: sources for kind, sources in every.items() if not sources.missing}
    # Without a drive, what swings by itself is all that there could be.
    half = {kind: one for kind, one in every.items() if len(one.missing) == 1 and not asked.axis.self_righting}
    # What is open the user can fill in; where nothing is known this is no log of a vehicle.
    chosen = guesses or half or (every if asked.interactive else {})
    unknown = {kind: sources for kind, sources in every.items() if kind not in chosen}
    problems = [
        _not_recognised(one, looked.logs[kind], looked.folder, looked.problems) for kind, one in unknown.items()
    ]
    if not chosen:
        raise problems[0]
    looked.problems.extend(map(str, problems))
    return chosen


def all_commands(guesses: Mapping[str, ColumnMapping]) -> Iterator[ThrusterCommand]:
    """Those of every format."""
    for one in guesses.values():
        yield from one.commands


def _lacking(looked: LogsRead, guesses: Mapping[str, ColumnMapping]) -> Iterator[str]:
    """What `rovid check` will say of each log without a signal that is mapped."""
    for kind, own in guesses.items():
        mapped = [guessed.source for guessed in own.signals.values()]
        mapped += _turning(own.commands)
        for name, log in zip(looked.names[kind], looked.logs[kind], strict=True):
            missing = [source for source in mapped if source not in log]
            if missing:
                yield f"{name}: holds no {', '.join(missing)}; is it of another vehicle?"


def _turning(commands: Sequence[ThrusterCommand]) -> list[str]:
    """Sources of the commands that turn the vehicle; of all where none is known to."""
    turning = [command.source for command in commands if command.direction]
    return turning or [command.source for command in commands]


def log_files(paths: Sequence[Path], problems: list[str]) -> Iterator[Path]:
    """What may be a log in ``paths``; what is in the way is added to ``problems``."""

    def unreadable(error: OSError) -> None:
        problems.append(f"{error.filename}: cannot be read ({error.strerror}).")

    for path in paths:
        inside = list_files(path, unreadable)
        problems += [f"{odd}: is {what}." for odd, what in inside.special_files.items()]
        for file in inside.files:
            if file.suffix.lower() in READERS:
                yield file


def is_thrust_curve(path: Path) -> bool:
    """Whether this is a thrust curve rather than a log."""
    if path.suffix.lower() != ".csv":
        return False
    try:
        # Its head alone: a log beside it may be long.
        return set(CURVE_COLUMNS) <= set(read_layout(path, CURVE_COLUMNS).names)
    except (OSError, RovidError):
        return False  # reading it says what is wrong


def read_columns(path: Path) -> tuple[LogContents, dict[str, RawColumn], list[str]]:
    """What a log holds, everything in it by source, and what of it cannot be read."""
    form = READERS[path.suffix.lower()]
    contents = form.sources(path)
    if not contents.sources:
        raise DataError("holds no column of numbers.", where=path, mend=next(iter(contents.unreadable), ""))
    raw = form.read(path, _config_of_all(path, form.kind, contents))
    timed = [channel for channel in raw.channels.values() if is_plausible(channel.time).any()]
    seen = {channel.source: _sane(channel) for channel in timed}
    skipped = [remark.text for remark in raw.remarks if remark.kind == "skipped"]
    left_out = dict.fromkeys((*contents.unreadable, *skipped))
    return contents, seen, _few(path, left_out)


def _config_of_all(path: Path, kind: str, contents: LogContents) -> Config:
    """A configuration that maps every source of a log, each under its own name."""
    signals = {}
    for source in contents.sources:
        # An orientation is made into a heading where that is asked for.
        name = "heading" if source.endswith(_ORIENTATIONS) else source
        signals[name] = Signal(name=name, sources={kind: source}, optional=True)
    clock = {kind: contents.clock} if contents.clock else {}
    return Config(
        path=path,
        vehicle=Vehicle(name="", thrusters=()),
        time=Signal(name="time", sources=clock, unit="auto"),
        signals=signals,
        commands=(),
        measured_signal=next(iter(signals)),
    )


def _sane(one: Channel) -> RawColumn:
    """What was measured of a channel, at the times that are known."""
    known = is_plausible(one.time)
    values = np.where(is_plausible(one.values), one.values, np.nan)
    return RawColumn(source=one.source, time=one.time[known], values=values[known], radians=one.radians)


def _few(path: Path, texts: Iterable[str]) -> list[str]:
    """The first of ``texts``, and how many more there are."""
    every = list(texts)
    more = len(every) - _SHOWN
    if more <= 0:
        return every
    return [*every[:_SHOWN], f"{path}: {more} more cannot be read."]


def _not_recognised(
    guesses: ColumnMapping, logs: Sequence[Mapping[str, RawColumn]], folder: Path, problems: Sequence[str]
) -> DataError:
    there = sorted(set().union(*logs))
    missing = " and no ".join(guesses.missing)
    unread = f" What could not be read: {problems[0]}" if problems else ""
    return DataError(
        f"no {missing} was recognised among {', '.join(there[:20])}.{unread}",
        where=folder,
        mend=f"Name them with --heading and --command, or write {FILE_NAME} by hand: `rovid help files` has an "
        "example. For motion along another axis than yaw give --axis.",
    )


@dataclass(frozen=True, kw_only=True)
class _Curve:
    """The thrust curve of a first rovid.toml: its name, what is to be written there, whether that is a guess."""

    name: str
    new: ThrustCurve | None = None
    guessed: bool = False

    @classmethod
    def of(
        cls, folder: Path, commands: Sequence[ThrusterCommand], told: VehiclePreset | None, problems: list[str]
    ) -> _Curve:
        """One beside the logs that knows these commands, that of the type of vehicle, or a straight line."""
        if not commands:
            return cls(name="")
        lowest = min(command.lowest for command in commands)
        highest = max(command.highest for command in commands)
        for path in list_files(folder, lambda _: None).files:
            if path.parent != folder or path.name == GUESSED_CURVE or not is_thrust_curve(path):
                continue
            try:
                curve = read_curve(path)
            except RovidError as error:
                problems.append(str(error))
                continue
            if _covers(curve, lowest, highest):
                return cls(name=path.name)
        if told is not None and told.curve is not None and commands[0].neutral:
            published = read_curve(told.curve)
            if _covers(published, lowest, highest):
                return cls(name=told.curve.name, new=published)
        percent = any(command.in_percent for command in commands)
        line = _straight(lowest, highest, commands[0].neutral, percent=percent)
        return cls(name=GUESSED_CURVE, new=line, guessed=True)


def _covers(curve: ThrustCurve, lowest: float, highest: float) -> bool:
    room = 0.01 * curve.span
    return bool(curve.command[0] <= lowest + room and highest - room <= curve.command[-1])


def _straight(lowest: float, highest: float, neutral: float, *, percent: bool) -> ThrustCurve:
    """Thrust in proportion to the command, from below the lowest to above the highest."""
    if neutral:
        ends = np.array([min(_PULSES[0], lowest), neutral, max(_PULSES[-1], highest)])
    else:
        seen = max(abs(lowest), abs(highest))
        # A share of one or of a hundred has its end there.
        whole = next((end for end in (1.0, 100.0) if 0.3 * end < seen <= end), 0.0)
        most = 100.0 if percent and seen <= 100.0 else whole or _ROOM * seen
        ends = np.array([-most, 0.0, most])
    above = ends - neutral
    thrust = FULL_THRUST * above / np.max(np.abs(above))
    return ThrustCurve(command=ends, thrust=thrust)


def output_files(paths: Sequence[Path]) -> tuple[OutputFile, OutputFile]:
    """Where rovid.toml and a guessed curve for the logs in ``paths`` go.

    Raises
    ------
    RovidError
        There is nothing at one of ``paths``, or what is neither file nor folder.
    """
    for path in paths:
        require_exists(path)
    folder = _folder(paths)
    return OutputFile(folder / FILE_NAME, CONFIG), OutputFile(folder / GUESSED_CURVE, GUESSED)
