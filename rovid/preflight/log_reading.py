"""Read all columns of logs without a rovid.toml, and join files that form one trial."""

import re
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from rovid.core.errors import DataError, RovidError
from rovid.core.input_files import list_files
from rovid.core.output_files import own_output
from rovid.faults.absent_zero import is_zero
from rovid.preflight.clock_alignment import align_clocks
from rovid.preflight.command_effects import response_delay
from rovid.preflight.raw_columns import Log, RawColumn, is_thruster_command, word_list
from rovid.preflight.signal_guess import ColumnMapping, map_columns
from rovid.preflight.thruster_guess import GuessHints
from rovid.readers.build_trial import MAX_INTERVAL
from rovid.readers.csv_dialect import read_layout
from rovid.readers.formats import READERS
from rovid.readers.message_fields import split_fields
from rovid.readers.raw_log import LogContents
from rovid.readers.timestamps import is_plausible
from rovid.trial.axis import CLOCK_WORDS, YAW, Axis, Signal, name_words
from rovid.trial.config import Config
from rovid.trial.log_files import QUALIFIER, Join, guess_parts, is_log
from rovid.trial.tables import CURVE_COLUMNS, column_names
from rovid.trial.vehicle import Vehicle

# Maximum number of logs of each format that are read; decision: the logs of one campaign are alike.
_MAX_LOGS = 12
# The name of a clock that counts seconds.
_SECONDS = re.compile(r"(?i)(?:^|[^a-z])(?:s|secs?|seconds?|sekunden)\W*$")
# Units of time in s, other than s.
_FINER = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
# Maximum number of lines about unreadable parts of one log.
_MAX_PROBLEMS = 3
_THRUST = word_list("thruster", "thrust")
# Endings of the sources of orientations, from which a reader computes a heading.
_ORIENTATIONS = ("orientation", "quaternion", "rotation", ".q")
# Number of successive words in which the names of the files of a trial may differ: of sensors, and of topics.
_PART_WORDS = (1, 4)
# Number of ways that are tried for each.
_MAX_GUESSES = 2


@dataclass(frozen=True, kw_only=True)
class LogsRead:
    """Columns of all logs, by format, and the problems met."""

    folder: Path
    #: ``logs``, ``names``: format -> columns of each log by source, and name of each log in the folder.
    logs: dict[str, list[Log]] = field(default_factory=dict)
    names: dict[str, list[str]] = field(default_factory=dict)
    #: ``clocks``, ``file_clocks``: format -> source of the clock in most logs, empty if the format has a clock of its
    #: own; name of a log -> the same.
    clocks: dict[str, str] = field(default_factory=dict)
    time_units: dict[str, str] = field(default_factory=dict)  #: Units of the clocks, each with the reason of a guess.
    file_clocks: dict[str, str] = field(default_factory=dict)
    parameters: dict[str, dict[str, float]] = field(default_factory=dict)  #: Format -> parameters of the autopilot.
    problems: list[str] = field(default_factory=list)
    unread: Counter[str] = field(default_factory=Counter)  #: Format -> number of further files, which were not read.
    join: Join | None = None  #: How files form trials, if no file holds both the motion and the commands.


def read_logs(
    paths: Sequence[Path],
    axis: Axis = YAW,
    headings: Sequence[str] = (),
    commands: Sequence[str] = (),
    time_unit: str = "auto",
) -> LogsRead:
    """Read the first dozen logs of each format in ``paths``, and join their files for motion along ``axis``.

    ``headings`` and ``commands`` are sources that the user named, ``time_unit`` the unit of the time.
    """
    read = LogsRead(folder=folder_of(paths))
    for path in log_files(paths, read.problems):
        kind = READERS[path.suffix.lower()].kind
        logs = read.logs.setdefault(kind, [])
        if is_thrust_curve(path):
            continue
        if len(logs) >= _MAX_LOGS:
            read.unread[kind] += 1
            continue
        pair = column_names(path) if path.suffix.lower() == ".csv" else ()
        if len(pair) == 2 and name_words(pair[1]) & _THRUST and not name_words(pair[0]) & CLOCK_WORDS:
            wanted = " and ".join(CURVE_COLUMNS)
            text = f"has the columns {' and '.join(pair)}, as a thrust curve has. Name them {wanted} to use it."
            read.problems.append(f"{path}: {text}")
            continue
        try:
            contents, columns, unreadable = read_columns(path, time_unit)
        except RovidError as error:
            read.problems.append(str(error))
            continue
        read.problems.extend(unreadable)
        read.parameters.setdefault(kind, {}).update(contents.parameters)
        name = path.relative_to(read.folder).as_posix() if path.is_relative_to(read.folder) else path.name
        read.names.setdefault(kind, []).append(name)
        read.file_clocks[name] = contents.clock
        if contents.clock:
            read.time_units[contents.time_unit] = contents.unit_reason
        logs.append(columns)
    for kind, names in read.names.items():
        [(read.clocks[kind], _)] = Counter(read.file_clocks[name] for name in names).most_common(1)
    return _join_files(read, axis, headings, commands)


def resolve_source(name: str, present: Collection[str]) -> str:
    """Source that the user means by ``name``: as written, or the only one of ``present`` that differs in notation.

    Notations: data.0 for data[0], a column without its unit in brackets, and another case.
    """
    if name in present:
        return name

    def tidy(source: str) -> tuple[str, ...]:
        return split_fields(re.sub(r" \[[^\]]*\]$", "", source).lower())

    found = [source for source in present if tidy(source) == tidy(name)]
    return found[0] if len(found) == 1 else name


def folder_of(paths: Sequence[Path]) -> Path:
    """Folder of the logs: the first of ``paths``, or the folder that it lies in."""
    return paths[0] if paths[0].is_dir() else paths[0].parent


def log_files(paths: Sequence[Path], problems: list[str]) -> Iterator[Path]:
    """Files in ``paths`` with the suffix of a log; unreadable folders and special files are added to ``problems``."""

    def unreadable(error: OSError) -> None:
        problems.append(f"{error.filename}: cannot be read ({error.strerror}).")

    for path in paths:
        inside = list_files(path, unreadable)
        problems += [f"{special}: is {kind}." for special, kind in inside.special_files.items()]
        for file in inside.files:
            if is_log(file) and (file == path or not own_output(file)):
                yield file


def is_thrust_curve(path: Path) -> bool:
    """Whether the header of a file is that of a thrust curve."""
    if path.suffix.lower() != ".csv":
        return False
    try:
        return set(CURVE_COLUMNS) <= set(read_layout(path, CURVE_COLUMNS).names)
    except (OSError, RovidError):
        return False  # reading the log reports the error


def _interval(columns: Log) -> float:
    """Median interval in s of the fastest of ``columns``."""
    intervals = [float(np.median(np.diff(column.time))) for column in columns.values() if len(column.time) > 1]
    return min(intervals, default=0.0)


def read_columns(path: Path, time_unit: str = "auto") -> tuple[LogContents, dict[str, RawColumn], list[str]]:
    """Contents of a log, all of its columns by source, and texts on its unreadable parts.

    If the readings are too far apart by ``time_unit`` auto, and the clock names no unit, the contents name the unit in
    which they come at 2 to 200 Hz.

    Raises RovidError if the log cannot be read, or holds no numbers.
    """
    form = READERS[path.suffix.lower()]
    contents = form.sources(path)
    if not contents.sources:
        raise DataError("holds no column of numbers.", where=path, mend=next(iter(contents.unreadable), ""))
    # A configuration that maps every source of a log to a signal of the same name.
    signals = {}
    for source in contents.sources:
        # Readers compute a heading from an orientation only for the signal "heading".
        is_orientation = source.lower().endswith(_ORIENTATIONS) or source in contents.orientations
        name = "heading" if is_orientation else source
        signals[name] = Signal(name=name, sources={form.kind: source}, optional=True)
    clock = {form.kind: contents.clock} if contents.clock else {}
    complete_config = Config(
        path=path,
        vehicle=Vehicle(name="", thrusters=()),
        time=Signal(name="time", sources=clock, unit=time_unit),
        signals=signals,
        commands=(),
        measured_signal=next(iter(signals)),
    )
    raw = form.read(path, complete_config)
    columns = {}
    for channel in raw.channels.values():
        known = is_plausible(channel.time)
        if known.any():
            values = np.where(is_plausible(channel.values), channel.values, np.nan)
            if raw.sparse and is_thruster_command(channel.source) and is_zero(values):
                values = np.nan_to_num(values)
            columns[channel.source] = RawColumn(
                source=channel.source,
                # Files of one trial have their own zeros of time.
                time=channel.time[known] + (raw.epoch or 0.0),
                values=values[known],
                radians=channel.radians,
            )
    contents = replace(contents, time_unit=time_unit)
    if contents.clock and time_unit == "auto" and raw.epoch is None and not _SECONDS.search(contents.clock):
        interval = _interval(columns)
        units = [unit for unit, size in _FINER.items() if interval > MAX_INTERVAL and 5e-3 <= interval * size <= 0.5]
        again = read_columns(path, units[0]) if units else (contents, columns, [])
        # A time in words has a unit of its own, and does not change.
        if _interval(again[1]) < MAX_INTERVAL < interval:
            text = f"readings are {interval:.4g} apart, {_interval(again[1]):.4g} s in {units[0]}; please check"
            return replace(again[0], unit_reason=f"unit guessed: {text}"), again[1], again[2]
    skipped = [remark.text for remark in raw.remarks if remark.kind == "skipped"]
    texts = list(dict.fromkeys((*contents.unreadable, *skipped)))
    more = len(texts) - _MAX_PROBLEMS
    if more > 0:
        texts[_MAX_PROBLEMS:] = [f"{path}: {more} more cannot be read."]
    return contents, columns, texts


# ---- files that form one trial


def _join_files(read: LogsRead, axis: Axis, headings: Sequence[str], commands: Sequence[str]) -> LogsRead:
    """Join the files of each trial, if no file holds both the motion and the commands."""

    def mapped(logs: Sequence[Log]) -> ColumnMapping:
        present = set().union(*logs)
        named = [resolve_source(heading, present) for heading in headings]
        hints = GuessHints(
            axis=axis,
            heading=next((heading for heading in named if heading in present), ""),
            commands=tuple(resolve_source(command, present) for command in commands),
        )
        return map_columns(logs, hints)

    for kind, names in read.names.items():
        logs = read.logs[kind]
        mapping = mapped(logs)
        if any(_is_complete(log, mapping) for log in logs):
            continue
        for join, own in _joins(names, logs):
            mapping = mapped(own)
            if trials := _trials(join, names, own, mapping):
                # The file of the motion names the trial.
                moving = {
                    join.part(name) for name, log in zip(names, own, strict=True) if mapping.measured.source in log
                }
                clocks = {join.part(name): clock for name, clock in read.file_clocks.items() if join.part(name)}
                times = {part: (clock, "") for part, clock in clocks.items() if clock != read.clocks[kind]}
                read.logs[kind], read.names[kind] = list(trials.values()), list(trials)
                parts = tuple(sorted(join.parts, key=lambda part: part not in moving))
                return replace(read, join=replace(join, parts=parts, time=times))
    return read


def _joins(names: Sequence[str], logs: Sequence[Log]) -> Iterator[tuple[Join, list[Log]]]:
    """Ways in which files may form trials, each with the logs as that way names their columns.

    Columns of the same name in several parts are told apart by the part. Its name may be that of a thruster too.
    """
    for parts in (parts for most in _PART_WORDS for parts in guess_parts(names, most)[:_MAX_GUESSES]):
        join = Join(parts=parts)
        owner = [join.part(name) for name in names]
        columns: set[tuple[str, str]] = set()
        for part, log in zip(owner, logs, strict=True):
            columns.update((part, one) for one in log)
        held = Counter(source for _, source in columns)
        for fewest in (len(names) + 1, 2, 1):
            shared = {source for source, count in held.items() if count >= fewest}
            qualified: list[Log] = []
            for part, log in zip(owner, logs, strict=True):
                names_of = {one: f"{part}{QUALIFIER}{one}" if part and one in shared else one for one in log}
                qualified.append({names_of[one]: replace(column, source=names_of[one]) for one, column in log.items()})
            yield join, qualified


def _trials(join: Join, names: Sequence[str], logs: Sequence[Log], mapping: ColumnMapping) -> dict[str, Log]:
    """Columns of each trial that is complete, by its key; empty if a signal or the commands were not recognised."""
    if mapping.missing or not mapping.actuation:
        return {}
    files: dict[str, list[Log]] = {}
    for name, log in zip(names, logs, strict=True):
        if join.part(name):
            files.setdefault(join.trial_key(name), []).append(log)
    column = mapping.measured.source.rpartition(QUALIFIER)[2]
    moving = sum(source.rpartition(QUALIFIER)[2] == column for log in logs for source in log)
    if len(files) == 1 and moving > 1 and any("_" in part for part in join.parts):
        return {}  # The parts hold the names of several trials.
    for source in mapping.actuation:
        if len({join.part(name) for name, log in zip(names, logs, strict=True) if source in log}) > 1:
            return {}  # Commands of several thrusters have one name.
    joined = {name: _on_one_clock(parts, mapping) for name, parts in files.items()}
    return {name: log for name, log in joined.items() if _is_complete(log, mapping)}


def _on_one_clock(parts: Sequence[Log], mapping: ColumnMapping) -> Log:
    """Columns of all files of a trial, on the clock of the motion where the offsets can be estimated."""
    position = mapping.measured
    home = next((part for part in parts if position.source in part), {})
    whole = dict(home)
    for part in parts:
        if part is home:
            continue
        neutral = {command.source: command.neutral for command in mapping.commands if command.source in part}
        offset = 0.0
        if alignment := align_clocks(home, part):
            offset = alignment.offset
        elif home:
            offset = response_delay(neutral, {**part, **home}, position)
        whole = {source: replace(column, time=column.time + offset) for source, column in part.items()} | whole
    return whole


def _is_complete(log: Log, mapping: ColumnMapping) -> bool:
    """Whether a log holds the motion and a command or a torque."""
    return not mapping.missing and mapping.measured.source in log and not mapping.actuation.isdisjoint(log)
