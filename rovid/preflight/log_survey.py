"""Survey of logs for `rovid init`: mapping of the columns, type of vehicle, thrust curve, and the user's overrides."""

import itertools
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from rovid.core.errors import DataError, RovidError, suggestion
from rovid.core.input_files import list_files, require_exists
from rovid.core.output_files import CONFIG, OutputFile
from rovid.preflight.axis_guess import COUPLED, PlanarGuess, further_thrusters, guess_planar
from rovid.preflight.clock_alignment import ClockOffsets
from rovid.preflight.command_sets import LeftOut, incomplete_logs, leave_out, match_commands
from rovid.preflight.log_reading import LogsRead, folder_of, is_thrust_curve, read_logs, resolve_source
from rovid.preflight.raw_columns import SignalGuess
from rovid.preflight.signal_guess import UNNAMED, ColumnMapping, map_columns
from rovid.preflight.thruster_guess import GuessHints, ThrusterCommand, thruster_outputs, vehicle_type
from rovid.trial.axis import AXES, YAW, Axis
from rovid.trial.config import FILE_NAME
from rovid.trial.log_files import Join, nothing_to_read
from rovid.trial.preprocessing import Exclusion
from rovid.trial.tables import read_curve
from rovid.trial.vehicle import ThrustCurve
from rovid.trial.vehicle_presets import VehiclePreset, load_preset

# Reason of a signal that the user chose.
CHOSEN = "chosen by hand"
# Prefix of ArduPilot's outputs.
_OUTPUT = "RCOU.C"
GUESSED_CURVE = "thrust_guess.csv"
# N, thrust at the end of a guessed curve. Yaw data do not determine a common scale of all thrusts.
FULL_THRUST = 100.0
# us, lowest and highest pulse width of a guessed curve.
_PULSES = (1100.0, 1900.0)
# Ratio of the end of a guessed curve to the largest command in the logs.
_HEADROOM = 1.1


@dataclass(frozen=True, kw_only=True)
class UserOverrides:
    """Choices of the user that replace guesses."""

    name: str = ""  #: Name of the vehicle; empty if not given.
    size: Mapping[str, float] = field(default_factory=dict)  #: mass in kg, length and width in m, as far as given.
    #: Format -> name in rovid.toml -> source; None keeps all guesses.
    signals: Mapping[str, Mapping[str, SignalGuess]] | None = None
    commands: frozenset[str] | None = None  #: Sources of the commands to use; None keeps all that were found.
    #: Source of a command -> measured yaw arm of its thruster in m.
    arms: Mapping[str, float] = field(default_factory=dict)
    #: Source of a command -> direction of its thrust in rad from the bow to starboard.
    directions: Mapping[str, float] = field(default_factory=dict)
    names: Mapping[str, str] = field(default_factory=dict)  #: Source of a command -> name of its thruster.
    #: Name of a rudder -> its coefficient in N m s^2/(m^2 rad), or the wheelbase of steered wheels in m.
    rudders: Mapping[str, float] = field(default_factory=dict)
    exclusions: tuple[Exclusion, ...] = ()

    def apply_to(self, mappings: Mapping[str, ColumnMapping]) -> dict[str, ColumnMapping]:
        """``mappings``, by format, with these choices."""
        applied = {}
        for kind, guessed in mappings.items():
            signals = dict(guessed.signals)
            if self.signals is not None:
                signals = {}
                for name, one in self.signals.get(kind, {}).items():
                    # The reason of the guess stays if the user chose the same.
                    signals[name] = replace(one, reason=CHOSEN)
                    if name in guessed.signals and replace(guessed.signals[name], reason=CHOSEN) == signals[name]:
                        signals[name] = guessed.signals[name]
            taken = {signal.source for signal in signals.values()}
            commands = []
            for command in guessed.commands:
                source = command.source
                if source in taken or (self.commands is not None and source not in self.commands):
                    continue
                own = replace(command, name=self.names.get(source) or command.name)
                if source in self.arms:
                    size, direction = abs(self.arms[source]), int(np.sign(self.arms[source]))
                    own = replace(own, arm=size, direction=direction, direction_known=True, arm_measured=True)
                commands.append(own)
            steered = (one for one in guessed.rudders if one.speed in signals and one.angle.source not in taken)
            rudders = tuple(replace(one, given=self.rudders.get(one.name)) for one in steered)
            mapping = replace(guessed, signals=signals, commands=tuple(commands), rudders=rudders)
            missing = [] if {"heading", "yaw_rate"} & {*signals} else ["heading"]
            missing += [] if mapping.actuation else ["command"]
            unused = tuple(one for one in (*guessed.sources, *guessed.unused) if one not in mapping.sources)
            applied[kind] = replace(mapping, missing=tuple(missing), unused=unused)
        return applied


@dataclass(frozen=True, kw_only=True)
class LogSurvey:
    """Findings of `rovid init`."""

    folder: Path
    mappings: Mapping[str, ColumnMapping]  #: Format -> contents of its columns.
    clock_sources: Mapping[str, str]  #: Format -> source of the clock, empty if the format has a clock of its own.
    #: ``time_unit``, ``unit_reason``: unit of the clocks, auto if it follows from the column; reason of a guess.
    time_unit: str
    unit_reason: str
    curves: tuple[str, ...]  #: Names of the thrust curves in the folder; empty without commands.
    new_curve: ThrustCurve | None  #: Curve to write under that name; None if the file exists.
    curve_guessed: bool  #: Whether the curve is a guess.
    #: ``logs``, ``unread``: number of logs read, and of further files of the same formats.
    logs: int
    unread: int = 0
    axis: Axis = YAW  #: Degree of freedom.
    #: ``profile``, ``profile_guessed``: type of vehicle, None if not known; whether it was guessed from the outputs
    #: that turn the vehicle.
    profile: VehiclePreset | None = None
    profile_guessed: bool = False
    #: ``join``, ``clock_offsets``: how files form trials, where no file holds both heading and commands; offsets of
    #: their clocks.
    join: Join | None = None
    clock_offsets: ClockOffsets = field(default_factory=ClockOffsets)
    #: Files that are no logs or cannot be read, contradictions, and logs without a mapped signal.
    warnings: tuple[str, ...] = ()
    left_out: LeftOut = field(default_factory=LeftOut)  #: Logs of other commands.
    overrides: UserOverrides = field(default_factory=UserOverrides)
    #: Format -> what surge and sway together with yaw need besides.
    planar: Mapping[str, PlanarGuess] = field(default_factory=dict)
    with_planar: bool = False  #: Whether the file is to be written for surge, sway and yaw together.

    @property
    def curve(self) -> str:
        """Name of the first thrust curve; empty without commands."""
        return next(iter(self.curves), "")

    def curve_of(self, thruster: str) -> str:
        """Name of the curve whose file name has the words of the ``thruster``'s name, or else of the first one."""
        words = set(re.findall(r"[^\W_]+", thruster.lower()))
        named = (one for one in self.curves if words <= set(re.findall(r"[^\W_]+", Path(one).stem.lower())))
        return next(named, self.curve)

    @property
    def unrecognised(self) -> tuple[str, ...]:
        """Kinds of columns that the user has to name: the position along the axis, "command"."""
        return tuple(dict.fromkeys(kind for mapping in self.mappings.values() for kind in mapping.missing))

    @property
    def unknown_directions(self) -> tuple[str, ...]:
        """Sources of commands with an unknown direction, one for each thruster."""
        rudders = (rudder for mapping in self.mappings.values() for rudder in mapping.rudders)
        unknown = [rudder.angle.source for rudder in rudders if not rudder.direction_known]
        known = {one.name for one in all_commands(self.mappings) if one.direction_known}
        commands = {one.name: one.source for one in reversed([*all_commands(self.mappings)]) if one.name not in known}
        return (*reversed(commands.values()), *unknown)


@dataclass(frozen=True, kw_only=True)
class SurveyOptions:
    """Facts about the logs that the user gave."""

    axis: Axis = YAW
    #: ``headings``, ``commands``: sources of the measured motion and of commands, for logs of several formats those of
    #: each.
    headings: tuple[str, ...] = ()
    commands: tuple[str, ...] = ()
    vehicle: str = ""  #: Type of vehicle.
    #: Whether the user can still name columns: logs without a recognised column are then accepted.
    interactive: bool = False
    planar: bool = False  #: Whether surge, sway and yaw are wanted together.


def survey(paths: Sequence[Path], options: SurveyOptions | None = None) -> LogSurvey:
    """Survey the logs in ``paths``.

    Raises RovidError if there are no logs, none can be read, none holds a heading or a command, or a named column is
    missing.
    """
    options = options or SurveyOptions()
    return survey_read_logs(read_logs(paths, options.axis, options.headings, options.commands), options)


def survey_read_logs(
    read: LogsRead, options: SurveyOptions | None = None, overrides: UserOverrides | None = None
) -> LogSurvey:
    """Survey logs that were read; see `survey`."""
    options = options or SurveyOptions()
    # The logs may be surveyed again: problems are added to a copy.
    read = replace(read, problems=list(read.problems))
    profile = load_preset(options.vehicle) if options.vehicle else None
    present = sorted(set().union(*itertools.chain(*read.logs.values())))
    resolved = {}
    for option, sources in (("--heading", options.headings), ("--command", options.commands)):
        resolved[option] = tuple(resolve_source(source, present) for source in sources)
        for source in resolved[option]:
            if source not in present:
                message = f"{option}: no log has a column {source!r}. {suggestion(source, present)}"
                raise DataError(message, where=read.folder)
    options = replace(options, headings=resolved["--heading"], commands=resolved["--command"])
    if profile is None:
        types = filter(None, map(vehicle_type, read.parameters.values()))
        profile = next(map(load_preset, types), None)
    mappings = _map_formats(read, options, profile)
    guessed = _profile_of_outputs(all_commands(mappings)) if profile is None and options.axis is YAW else None
    if guessed is not None:
        profile, mappings = guessed, _map_formats(read, options, guessed)
    if options.planar:
        # Thrusters that do not turn the vehicle.
        for kind, mapping in mappings.items():
            further = further_thrusters(read.logs[kind], set(mapping.sources), mapping.commands)
            mappings[kind] = replace(mapping, commands=(*mapping.commands, *further)).of(mapping.unused)
    found = mappings = match_commands(read, mappings)
    if overrides is not None:
        mappings = overrides.apply_to(found)
    mappings, left_out = leave_out(read, found, mappings, planar=options.planar)
    commands = list(all_commands(mappings))
    driven = [command for command in commands if not command.is_motor]
    curves, new_curve, is_guess = thrust_curves(read.folder, driven, profile, read.problems)
    planar = {}
    for kind, mapping in mappings.items() if options.axis is YAW else ():
        guess = guess_planar(read.logs[kind], set(mapping.sources), mapping.commands, mapping.signals.get("heading"))
        further_signals = {name: one for name, one in guess.signals.items() if name not in mapping.signals}
        planar[kind] = replace(guess, signals=further_signals)
    if not commands and options.planar and (largest := max((one.propeller[1] for one in planar.values()), default=0.0)):
        curves = measured_curves(read.folder, largest, largest, read.problems)
    [(unit, reason)] = read.time_units.items() if len(read.time_units) == 1 else [("auto", "")]
    measured = [mapping.measured for mapping in mappings.values() if mapping.signals]
    acts = any(mapping.commands or mapping.rudders for mapping in mappings.values())
    return LogSurvey(
        folder=read.folder,
        axis=options.axis,
        mappings=mappings,
        clock_sources=read.clocks,
        time_unit=unit,
        unit_reason=reason,
        curves=tuple(curves),
        new_curve=new_curve,
        curve_guessed=is_guess or (guessed is not None and new_curve is not None),
        profile=profile,
        profile_guessed=guessed is not None,
        join=read.join,
        logs=sum(map(len, read.logs.values())),
        unread=read.unread.total(),
        warnings=(
            *dict.fromkeys(read.problems),
            *([f"time: {reason}."] * bool(reason)),
            *(f"{one.source} is taken for the heading: {one.reason}." for one in measured if UNNAMED in one.reason),
            *(command.contradiction for command in commands if command.contradiction),
            *(remark for mapping in mappings.values() for remark in mapping.remarks),
            *incomplete_logs(read, mappings, left_out.names),
            *([left_out.text] * bool(left_out.text)),
            *([COUPLED] * (acts and not options.planar and any(one.suits for one in planar.values()))),
        ),
        left_out=left_out,
        overrides=overrides or UserOverrides(),
        planar=planar,
        with_planar=options.planar,
    )


def _map_formats(read: LogsRead, options: SurveyOptions, profile: VehiclePreset | None) -> dict[str, ColumnMapping]:
    """Mapping of each format with motion and commands; without such a format, of each format with one of both."""
    every: dict[str, ColumnMapping] = {}
    for kind, logs in read.logs.items():
        if logs:
            present = set().union(*logs)
            default = next(iter(options.headings), "")
            hints = GuessHints(
                axis=options.axis,
                heading=next((source for source in options.headings if source in present), default),
                commands=options.commands,
                outputs=thruster_outputs(read.parameters.get(kind, {})),
                profile=profile,
            )
            every[kind] = map_columns(logs, hints)
    if not every and read.problems:
        raise DataError(read.problems[0], where="")
    if not every:
        raise nothing_to_read([read.folder])
    chosen = {kind: mapping for kind, mapping in every.items() if not mapping.missing}
    if not chosen and not options.axis.self_righting:
        chosen = {kind: mapping for kind, mapping in every.items() if len(mapping.missing) == 1}
    if not chosen and options.interactive:
        chosen = every
    errors = [_not_recognised(read, kind, mapping) for kind, mapping in every.items() if kind not in chosen]
    if not chosen:
        raise errors[0]
    read.problems.extend([*map(str, errors), *unit_conflicts(chosen)])
    return chosen


def unit_conflicts(mappings: Mapping[str, ColumnMapping]) -> list[str]:
    """Problem of signals that two formats hold in different units: a signal has one unit in rovid.toml."""
    units: dict[str, set[str]] = {}
    for name, signal in itertools.chain(*(mapping.signals.items() for mapping in mappings.values())):
        units.setdefault(name, set()).add(signal.unit)
    if not (names := [name for name, found in units.items() if len(found - {""}) > 1]):
        return []
    text = f"{', '.join(names)}: the units differ between {' and '.join(mappings)} logs; {FILE_NAME} has one for all."
    return [f"{text} Move the logs of one format to a folder of their own."]


def _not_recognised(read: LogsRead, kind: str, mapping: ColumnMapping) -> DataError:
    present = sorted(set().union(*read.logs[kind]))
    hints = [GuessHints(axis=axis) for axis in AXES.values() if axis is not YAW and "command" in mapping.missing]
    others = {hint.axis.name: other for hint in hints if not (other := map_columns(read.logs[kind], hint)).missing}
    found = ", ".join(f"{name} ({other.measured.source})" for name, other in others.items())
    along = f"Motion was recognised in {found}: `rovid init LOGS --axis {next(iter(others), '')}`."
    unreadable = f" What could not be read: {read.problems[0]}" if read.problems else ""
    return DataError(
        f"no {' and no '.join(mapping.missing)} was recognised among {', '.join(present[:20])}.{unreadable}",
        where=read.folder,
        mend=f"Name them with --heading and --command, or write {FILE_NAME} by hand: `rovid help files` has an "
        f"example. {along if found else 'For motion along another axis than yaw give --axis.'}",
    )


def _profile_of_outputs(commands: Iterable[ThrusterCommand]) -> VehiclePreset | None:
    """Type of vehicle whose turning outputs are those of the logs."""
    outputs = {}
    for command in commands:
        number = command.source.removeprefix(_OUTPUT)
        if command.source.startswith(_OUTPUT) and number.isdigit():
            outputs[int(number)] = command
    turning = {number for number, command in outputs.items() if command.direction}
    if turning != {1, 2, 3, 4} or not {5, 6} <= outputs.keys():
        return None
    return load_preset("bluerov2-heavy" if {7, 8} <= outputs.keys() else "bluerov2")


def all_commands(mappings: Mapping[str, ColumnMapping]) -> Iterator[ThrusterCommand]:
    """Commands of every format."""
    for mapping in mappings.values():
        yield from mapping.commands


def config_output(paths: Sequence[Path]) -> OutputFile:
    """The rovid.toml to write for the logs in ``paths``.

    Raises RovidError if one of ``paths`` does not exist, or is neither file nor folder.
    """
    for path in paths:
        require_exists(path)
    return OutputFile(folder_of(paths) / FILE_NAME, CONFIG)


def thrust_curves(
    folder: Path, commands: Sequence[ThrusterCommand], profile: VehiclePreset | None, problems: list[str]
) -> tuple[list[str], ThrustCurve | None, bool]:
    """File names of the thrust curves, the curve if the file is new, and whether it is a guess.

    Curves in the folder that cover the commands come first, then that of the type of vehicle, then a straight line.
    """
    if not commands:
        return [], None, False
    lowest = min(command.lowest for command in commands)
    highest = max(command.highest for command in commands)
    if found := measured_curves(folder, lowest, highest, problems):
        return found, None, False
    neutral = commands[0].neutral
    if profile is not None and profile.curve is not None and neutral:
        published = read_curve(profile.curve)
        if _covers(published, lowest, highest):
            return [profile.curve.name], published, False
    if neutral:
        ends = np.array([min(_PULSES[0], lowest), neutral, max(_PULSES[1], highest)])
    else:
        largest = max(abs(lowest), abs(highest))
        # Commands as shares of one or in percent end at 1 or 100.
        end = next((full for full in (1.0, 100.0) if 0.3 * full < largest <= full), _HEADROOM * largest)
        if largest <= 100.0 and any(command.in_percent for command in commands):
            end = 100.0
        ends = np.array([-end, 0.0, end])
    above = ends - neutral
    line = ThrustCurve(command=ends, thrust=FULL_THRUST * above / np.max(np.abs(above)))
    return [GUESSED_CURVE], line, True


def measured_curves(folder: Path, lowest: float, highest: float, problems: list[str]) -> list[str]:
    """Names of the thrust curves in the folder that cover the commands."""
    found = []
    for path in list_files(folder, lambda _: None).files:
        if path.parent != folder or path.name == GUESSED_CURVE or not is_thrust_curve(path):
            continue
        try:
            curve = read_curve(path)
        except RovidError as error:
            problems.append(str(error))
            continue
        if _covers(curve, lowest, highest):
            found.append(path.name)
    return found


def _covers(curve: ThrustCurve, lowest: float, highest: float) -> bool:
    margin = 0.01 * curve.span
    return bool(curve.command[0] <= lowest + margin and highest - margin <= curve.command[-1])
