"""A first rovid.toml from the logs alone: read all that is there, guess, and write each guess with its reason."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rovid.campaign.config import FILE_NAME, Config, Signal
from rovid.campaign.guesswork import Guesswork
from rovid.campaign.tables import CURVE_COLUMNS, curve_text, read_curve
from rovid.campaign.vehicle import ThrustCurve, Vehicle
from rovid.ground.errors import LINE_LENGTH, DataError, RovidError, shown
from rovid.ground.files import Output
from rovid.ground.files.form import CONFIG
from rovid.ground.files.form import GUESSED_CURVE as GUESSED
from rovid.ground.places import require, search
from rovid.ground.quoting import toml_text
from rovid.inspect.signals import Guess, Guesses, Seen, Thrusting, guess
from rovid.readers.csv_header import read_layout
from rovid.readers.formats import READERS
from rovid.readers.raw import Channel, Contents, sensible

GUESSED_CURVE = "thrust_guess.csv"
# Logs are many and alike: so many of each format tell enough.
_LOGS = 12
# What cannot be read of one log is told in so many lines.
_SHOWN = 3
# Of the guessed curve, N at its ends; a constant scale of all thrust never shows in yaw data.
_FULL_THRUST = 100.0
_PULSES = np.array([1100.0, 1500.0, 1900.0])
# Commands seen leave this much room to the end of a guessed curve.
_ROOM = 1.1
_ORIENTATIONS = ("orientation", "quaternion", "rotation", ".q")


@dataclass(frozen=True, kw_only=True)
class Survey:
    """What `rovid init` found.

    Attributes
    ----------
    guesses
        Format -> what its sources are.
    clocks
        Format -> source of the clock, empty where it has one of its own.
    curve
        Name of the thrust curve beside the logs, and whether that is a guess, still to be written.
    logs
        How many were looked at.
    lacking
        What was not looked at: files that are no logs or cannot be read, what of a log cannot be, and what
        `rovid check` will say of some: that they lack what is mapped.
    """

    folder: Path
    guesses: Mapping[str, Guesses]
    clocks: Mapping[str, str]
    curve: str
    curve_guessed: ThrustCurve | None
    logs: int
    lacking: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class _Looked:
    """What was read, by format, and what was in the way."""

    logs: dict[str, list[Mapping[str, Seen]]] = field(default_factory=dict)
    names: dict[str, list[str]] = field(default_factory=dict)
    clocks: dict[str, str] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)

    def add(self, path: Path) -> None:
        """Read one log more, where its format has not been seen often enough."""
        kind = READERS[path.suffix.lower()].kind
        logs = self.logs.setdefault(kind, [])
        if len(logs) >= _LOGS or _is_table(path):
            return
        try:
            clock, seen, left_out = _seen(path)
        except RovidError as error:
            self.problems.append(str(error))
            return
        self.problems.extend(left_out)
        self.clocks.setdefault(kind, clock)
        self.names.setdefault(kind, []).append(path.name)
        logs.append(seen)


def survey(paths: Sequence[Path]) -> Survey:
    """Look at the logs in ``paths``.

    Raises
    ------
    RovidError
        There are no logs, none can be read, or none holds a heading or a command.
    """
    folder = _folder(paths)
    looked = _Looked()
    for path in _files(paths, looked.problems):
        looked.add(path)
    guesses = _recognised(looked, folder)
    commands = list(_commands(guesses))
    curve, guessed = _curve(folder, commands, looked.problems)
    return Survey(
        folder=folder,
        guesses=guesses,
        clocks=looked.clocks,
        curve=curve,
        curve_guessed=guessed,
        logs=sum(map(len, looked.logs.values())),
        lacking=(*looked.problems, *_lacking(looked, guesses)),
    )


def _folder(paths: Sequence[Path]) -> Path:
    first = paths[0]
    if first.is_dir():
        return first
    return first.parent


def _recognised(looked: _Looked, folder: Path) -> dict[str, Guesses]:
    """What the sources are, of each format in which a heading and a command were found."""
    every = {kind: guess(logs) for kind, logs in looked.logs.items() if logs}
    if not every and looked.problems:
        raise DataError(looked.problems[0], where="")
    if not every:
        raise DataError("holds no logs.", where=folder)
    guesses, unknown = {}, []
    for kind, sources in every.items():
        if sources.lacking:
            unknown.append(_not_recognised(sources, looked.logs[kind], folder, looked.problems))
        else:
            guesses[kind] = sources
    if not guesses:
        raise unknown[0]
    looked.problems.extend(map(str, unknown))
    return guesses


def _commands(guesses: Mapping[str, Guesses]) -> Iterator[Thrusting]:
    """Those of every format."""
    for one in guesses.values():
        yield from one.commands


def _lacking(looked: _Looked, guesses: Mapping[str, Guesses]) -> Iterator[str]:
    """What `rovid check` will say of each log without a signal that is mapped."""
    for kind, own in guesses.items():
        mapped = [guessed.source for guessed in own.signals.values()]
        mapped += _turning(own.commands)
        for name, log in zip(looked.names[kind], looked.logs[kind], strict=True):
            missing = [source for source in mapped if source not in log]
            if missing:
                yield f"{name}: holds no {', '.join(missing)}; is it of another vehicle?"


def _turning(commands: Sequence[Thrusting]) -> list[str]:
    """Sources of the commands that turn the vehicle; of all where none is known to."""
    turning = [command.source for command in commands if command.way]
    return turning or [command.source for command in commands]


def _files(paths: Sequence[Path], problems: list[str]) -> Iterator[Path]:
    def unreadable(error: OSError) -> None:
        problems.append(f"{error.filename}: cannot be read ({error.strerror}).")

    for path in paths:
        inside = search(path, unreadable)
        problems += [f"{odd}: is {what}." for odd, what in inside.odd.items()]
        for file in inside.files:
            if file.suffix.lower() in READERS:
                yield file


def _is_table(path: Path) -> bool:
    """Whether this is a thrust curve rather than a log."""
    if path.suffix.lower() != ".csv":
        return False
    try:
        # Its head alone: a log beside it may be long.
        return set(CURVE_COLUMNS) <= set(read_layout(path, CURVE_COLUMNS).names)
    except (OSError, RovidError):
        return False  # reading it says what is wrong


def _seen(path: Path) -> tuple[str, dict[str, Seen], list[str]]:
    """The clock, everything in one log by source, and what of it cannot be read."""
    form = READERS[path.suffix.lower()]
    contents = form.sources(path)
    if not contents.sources:
        raise DataError("holds no column of numbers.", where=path, mend=next(iter(contents.left_out), ""))
    raw = form.read(path, _config_of_all(path, form.kind, contents))
    timed = [channel for channel in raw.channels.values() if sensible(channel.time).any()]
    seen = {channel.source: _sane(channel) for channel in timed}
    skipped = [remark.text for remark in raw.remarks if remark.kind == "skipped"]
    left_out = dict.fromkeys((*contents.left_out, *skipped))
    return contents.clock, seen, _few(path, left_out)


def _config_of_all(path: Path, kind: str, contents: Contents) -> Config:
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
        measured=next(iter(signals)),
    )


def _sane(one: Channel) -> Seen:
    """What was measured of a channel, at the times that are known."""
    known = sensible(one.time)
    values = np.where(sensible(one.values), one.values, np.nan)
    return Seen(source=one.source, time=one.time[known], values=values[known], radians=one.radians)


def _few(path: Path, texts: Iterable[str]) -> list[str]:
    """The first of ``texts``, and how many more there are."""
    every = list(texts)
    more = len(every) - _SHOWN
    if more <= 0:
        return every
    return [*every[:_SHOWN], f"{path}: {more} more cannot be read."]


def _not_recognised(
    guesses: Guesses, logs: Sequence[Mapping[str, Seen]], folder: Path, problems: Sequence[str]
) -> DataError:
    there = sorted(set().union(*logs))
    missing = " and no ".join(guesses.lacking)
    unread = f" What could not be read: {problems[0]}" if problems else ""
    return DataError(
        f"no {missing} was recognised among {', '.join(there[:20])}.{unread}",
        where=folder,
        mend=f"Write {FILE_NAME} by hand: `rovid help files` has an example, and `rovid help axes` those of other axes "
        "than yaw, which alone is guessed.",
    )


def _curve(folder: Path, commands: Sequence[Thrusting], problems: list[str]) -> tuple[str, ThrustCurve | None]:
    """A curve beside the logs that knows these commands, or a straight line."""
    lowest = min(command.lowest for command in commands)
    highest = max(command.highest for command in commands)
    for path in search(folder, lambda _: None).files:
        if path.parent != folder or path.name == GUESSED_CURVE or not _is_table(path):
            continue
        try:
            curve = read_curve(path)
        except RovidError as error:
            problems.append(str(error))
            continue
        room = 0.01 * curve.span
        if curve.command[0] <= lowest + room and highest - room <= curve.command[-1]:
            return path.name, None
    return GUESSED_CURVE, _straight(lowest, highest, commands[0].neutral)


def _straight(lowest: float, highest: float, neutral: float) -> ThrustCurve:
    """Thrust in proportion to the command, from below the lowest to above the highest."""
    if neutral:
        ends = np.array([min(_PULSES[0], lowest), neutral, max(_PULSES[-1], highest)])
    else:
        most = _ROOM * max(abs(lowest), abs(highest))
        ends = np.array([-most, 0.0, most])
    above = ends - neutral
    thrust = _FULL_THRUST * above / np.max(np.abs(above))
    return ThrustCurve(command=ends, thrust=thrust)


def outputs_beside(paths: Sequence[Path]) -> tuple[Output, Output]:
    """Where rovid.toml and a guessed curve for the logs in ``paths`` go.

    Raises
    ------
    RovidError
        There is nothing at one of ``paths``, or what is neither file nor folder.
    """
    for path in paths:
        require(path)
    folder = _folder(paths)
    return Output(folder / FILE_NAME, CONFIG), Output(folder / GUESSED_CURVE, GUESSED)


def files_of(survey: Survey) -> dict[Output, str]:
    """What to write where: rovid.toml, and the guessed curve where there is no other."""
    config, curve = outputs_beside([survey.folder])
    files = {config: toml_of(survey)}
    if survey.curve_guessed is not None:
        files[curve] = curve_text(survey.curve_guessed.command, survey.curve_guessed.thrust)
    return files


def toml_of(survey: Survey) -> str:
    """The text of rovid.toml; each guess with its reason."""
    return "\n".join([*_head(survey), *_thrusters(survey), *_signals(survey)]) + "\n"


def logs_in_words(survey: Survey) -> str:
    """How many logs were looked at."""
    if survey.logs == 1:
        return "one log"
    return f"{survey.logs} logs"


def _head(survey: Survey) -> Iterator[str]:
    yield f"# Written by `rovid init` from {logs_in_words(survey)}. Each guess says why: correct what is wrong. A line"
    yield "# *_guessed marks what no log can tell, and every number that hangs on it."
    yield ""
    yield "[vehicle]"
    yield f"name = {toml_text(survey.folder.resolve().name)}"
    yield "# Mass and size are not in the logs; with them rovid tells the added inertia."
    yield "# mass =       # kg"
    yield "# length =     # m"
    yield "# width =      # m"


def _thrusters(survey: Survey) -> Iterator[str]:
    if survey.curve_guessed is not None:
        yield from _guessed_curve(survey)
    turning = {command.name for command in _commands(survey.guesses) if command.way}
    for name, ones in _by_name(survey).items():
        # Where some are known to turn the vehicle, the others wait for the user to say so.
        mark = "# " if turning and name not in turning else ""
        way = next((one.way for one in ones.values() if one.way), 1)
        yield ""
        yield from _why(ones)
        yield f"{mark}[[thrusters]]"
        yield f"{mark}name = {toml_text(name)}"
        yield f"{mark}yaw_arm = {way:.1f}            # m: the sense is that of the logs, the distance is not in them"
        yield f"{mark}yaw_arm_guessed = {way:.1f}    # as long as both are the same; put the distance into yaw_arm"
        yield f"{mark}curve = {toml_text(survey.curve)}"
        if survey.curve_guessed is not None:
            yield f"{mark}curve_guessed = {toml_text(survey.curve)}   # as above; put a bench curve into curve"
        sources = {kind: one.source for kind, one in ones.items()}
        yield f"{mark}command = {_sources(sources)}"


def guess_of(survey: Survey) -> Guesswork:
    """What of the file that is written is no measurement: every arm, and a curve that was not there."""
    turning = {command.name for command in _commands(survey.guesses) if command.way}
    names = [name for name in _by_name(survey) if not turning or name in turning]
    what = ["yaw_arm"] if survey.curve_guessed is None else ["yaw_arm", "curve"]
    return Guesswork(items=tuple(f"{one} of {name}" for name in names for one in what), thrusters=len(names))


def _guessed_curve(survey: Survey) -> Iterator[str]:
    proportion = f"thrust in proportion to the command, {_FULL_THRUST:g} N at its end"
    yield ""
    yield f"# {survey.curve} is a guess: {proportion}. Until a"
    yield "# bench curve takes its place no number holds that was fitted through it, and the diagnosis finds what"
    yield "# the guess lacks, as the drive's own dead band."


def _by_name(survey: Survey) -> dict[str, dict[str, Thrusting]]:
    """Each thruster by the formats in which its command was found."""
    named: dict[str, dict[str, Thrusting]] = {}
    for kind, guesses in survey.guesses.items():
        for command in guesses.commands:
            named.setdefault(command.name, {})[kind] = command
    return named


def _signals(survey: Survey) -> Iterator[str]:
    yield ""
    yield "[signals]"
    clocks = {kind: clock for kind, clock in survey.clocks.items() if clock and kind in survey.guesses}
    if clocks:
        yield f"time = {_sources(clocks)}"
    named: dict[str, dict[str, Guess]] = {}
    for kind, guesses in survey.guesses.items():
        for name, signal in guesses.signals.items():
            named.setdefault(name, {})[kind] = signal
    for name, ones in named.items():
        yield from _why(ones)
        yield f"{name} = {_signal(ones)}"


def _signal(ones: Mapping[str, Guess]) -> str:
    first = next(iter(ones.values()))
    parts = [f"{kind} = {toml_text(one.source)}" for kind, one in ones.items()]
    if first.unit:
        parts.append(f"unit = {toml_text(first.unit)}")
    if first.sign < 0:
        parts.append("sign = -1")
    return "{ " + ", ".join(parts) + " }"


def _sources(sources: Mapping[str, str]) -> str:
    parts = [f"{kind} = {toml_text(source)}" for kind, source in sources.items()]
    return "{ " + ", ".join(parts) + " }"


def _why(ones: Mapping[str, Guess] | Mapping[str, Thrusting]) -> Iterator[str]:
    for kind, one in ones.items():
        yield f"# {kind}: {shown(one.why, LINE_LENGTH)}"
