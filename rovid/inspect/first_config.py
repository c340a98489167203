"""A first rovid.toml from the logs alone: read all that is there, guess, and write each guess with its reason."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rovid.campaign.config import FILE_NAME, Config, Signal, read_curve
from rovid.campaign.tables import CURVE_COLUMNS, curve_text
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
from rovid.readers.raw import Channel, sensible

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


def survey(paths: Sequence[Path]) -> Survey:
    """Look at the logs in ``paths``.

    Raises
    ------
    RovidError
        There are no logs, none can be read, or none holds a heading or a command.
    """
    folder = _folder(paths)
    logs: dict[str, list[Mapping[str, Seen]]] = {}
    clocks: dict[str, str] = {}
    names: dict[str, list[str]] = {}
    problems: list[str] = []
    for path in _files(paths, problems):
        kind = READERS[path.suffix.lower()].kind
        if len(logs.setdefault(kind, [])) >= _LOGS or _is_table(path):
            continue
        try:
            clock, seen, left_out = _seen(path)
        except RovidError as error:
            problems.append(str(error))
            continue
        problems += left_out
        clocks.setdefault(kind, clock)
        logs[kind].append(seen)
        names.setdefault(kind, []).append(path.name)
    every = {kind: guess(found) for kind, found in logs.items() if found}
    if not every:
        raise DataError(problems[0] if problems else "holds no logs.", where="" if problems else folder)
    unknown = [_not_recognised(found, logs[kind], folder, problems) for kind, found in every.items() if found.lacking]
    guesses = {kind: found for kind, found in every.items() if not found.lacking}
    if not guesses:
        raise unknown[0]
    problems += map(str, unknown)
    curve, guessed = _curve(folder, [one for found in guesses.values() for one in found.commands], problems)
    lacking = [
        text
        for kind, found in guesses.items()
        for name, log in zip(names[kind], logs[kind], strict=True)
        if (text := _lacks(name, log, found))
    ]
    return Survey(
        folder=folder,
        guesses=guesses,
        clocks=clocks,
        curve=curve,
        curve_guessed=guessed,
        logs=sum(map(len, logs.values())),
        lacking=(*problems, *lacking),
    )


def _folder(paths: Sequence[Path]) -> Path:
    return paths[0] if paths[0].is_dir() else paths[0].parent


def _lacks(name: str, log: Mapping[str, Seen], found: Guesses) -> str:
    turning = [one.source for one in found.commands if one.way] or [one.source for one in found.commands]
    missing = [source for source in (*(one.source for one in found.signals.values()), *turning) if source not in log]
    return f"{name}: holds no {', '.join(missing)}; is it of another vehicle?" if missing else ""


def _files(paths: Sequence[Path], problems: list[str]) -> Iterator[Path]:
    def unreadable(error: OSError) -> None:
        problems.append(f"{error.filename}: cannot be read ({error.strerror}).")

    for path in paths:
        inside = search(path, unreadable)
        problems += [f"{one}: is {what}." for one, what in inside.odd.items()]
        yield from (one for one in inside.files if one.suffix.lower() in READERS)


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
    found = form.sources(path)
    if not found.sources:
        raise DataError("holds no column of numbers.", where=path, mend=next(iter(found.left_out), ""))
    # An orientation is made into a heading where that is asked for.
    names = {source: "heading" if source.endswith(_ORIENTATIONS) else source for source in found.sources}
    signals = {name: Signal(name=name, sources={form.kind: source}, optional=True) for source, name in names.items()}
    time = Signal(name="time", sources={form.kind: found.clock} if found.clock else {}, unit="auto")
    config = Config(
        path=path,
        vehicle=Vehicle(name="", thrusters=()),
        time=time,
        signals=signals,
        commands=(),
        measured=next(iter(signals)),
    )
    raw = form.read(path, config)
    skipped = (remark.text for remark in raw.remarks if remark.kind == "skipped")
    seen = {one.source: _sane(one) for one in raw.channels.values() if sensible(one.time).any()}
    return found.clock, seen, _few(path, dict.fromkeys((*found.left_out, *skipped)))


def _sane(one: Channel) -> Seen:
    """What was measured of a channel, at the times that are known."""
    known = sensible(one.time)
    values = np.where(sensible(one.values), one.values, np.nan)
    return Seen(source=one.source, time=one.time[known], values=values[known], radians=one.radians)


def _few(path: Path, texts: Iterable[str]) -> list[str]:
    """The first of ``texts``, and how many more there are."""
    every = list(texts)
    more = [f"{path}: {len(every) - _SHOWN} more cannot be read."] if len(every) > _SHOWN else []
    return every[:_SHOWN] + more


def _not_recognised(
    found: Guesses, logs: Sequence[Mapping[str, Seen]], folder: Path, problems: Sequence[str]
) -> DataError:
    there = sorted({source for log in logs for source in log})
    unread = f" What could not be read: {problems[0]}" if problems else ""
    return DataError(
        f"no {' and no '.join(found.lacking)} was recognised among {', '.join(there[:20])}.{unread}",
        where=folder,
        mend=f"Write {FILE_NAME} by hand: see the README, sample_logs for examples, and docs/axes.md where the runs "
        "are along another axis than yaw, which alone is guessed.",
    )


def _curve(folder: Path, commands: Sequence[Thrusting], problems: list[str]) -> tuple[str, ThrustCurve | None]:
    """A curve beside the logs that knows these commands, or a straight line."""
    lowest, highest = min(one.lowest for one in commands), max(one.highest for one in commands)
    for path in search(folder, lambda _: None).files:
        if path.parent == folder and path.name != GUESSED_CURVE and _is_table(path):
            try:
                curve = read_curve(path)
            except RovidError as error:
                problems.append(str(error))
                continue
            room = 0.01 * curve.span
            if curve.command[0] <= lowest + room and highest - room <= curve.command[-1]:
                return path.name, None
    neutral = commands[0].neutral
    if neutral:
        ends = np.array([min(_PULSES[0], lowest), neutral, max(_PULSES[-1], highest)])
    else:
        most = _ROOM * max(abs(lowest), abs(highest))
        ends = np.array([-most, 0.0, most])
    thrust = _FULL_THRUST * (ends - neutral) / np.max(np.abs(ends - neutral))
    return GUESSED_CURVE, ThrustCurve(command=ends, thrust=thrust)


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


def files_of(found: Survey) -> dict[Output, str]:
    """What to write where: rovid.toml, and the guessed curve where there is no other."""
    config, curve = outputs_beside([found.folder])
    files = {config: toml_of(found)}
    if found.curve_guessed is not None:
        files[curve] = curve_text(found.curve_guessed.command, found.curve_guessed.thrust)
    return files


def toml_of(found: Survey) -> str:
    """The text of rovid.toml; each guess with its reason."""
    return "\n".join([*_head(found), *_thrusters(found), *_signals(found)]) + "\n"


def logs_in_words(found: Survey) -> str:
    """How many logs were looked at."""
    return "one log" if found.logs == 1 else f"{found.logs} logs"


def _head(found: Survey) -> Iterator[str]:
    yield f"# Written by `rovid init`, which looked at {logs_in_words(found)}. Each guess says why: correct what is"
    yield "# wrong."
    yield ""
    yield "[vehicle]"
    yield f"name = {toml_text(found.folder.resolve().name)}"
    yield "# Mass and size are not in the logs; with them rovid tells the added inertia."
    yield "# mass = 100.0     # kg; length and width in m"
    yield "# length = 1.0"
    yield "# width = 0.6"


def _thrusters(found: Survey) -> Iterator[str]:
    turning = {one.name for guesses in found.guesses.values() for one in guesses.commands if one.way}
    names = list(dict.fromkeys(one.name for guesses in found.guesses.values() for one in guesses.commands))
    if found.curve_guessed is not None:
        yield ""
        yield f"# {found.curve} is a guess: thrust in proportion to the command, {_FULL_THRUST:g} N at its end. Until a"
        yield "# bench curve takes its place, inertia and drag are right among themselves, not in size, and the"
        yield "# diagnosis finds the drive's dead band as one."
    for name in names:
        ones = {kind: one for kind, g in found.guesses.items() for one in g.commands if one.name == name}
        mark = "" if name in turning or not turning else "# "
        way = next((one.way for one in ones.values() if one.way), 1)
        yield ""
        yield from _why(ones)
        yield f"{mark}[[thrusters]]"
        yield f"{mark}name = {toml_text(name)}"
        yield f"{mark}yaw_arm = {way:.1f}     # m: the sense is that of the logs, the distance is not in them"
        yield f"{mark}curve = {toml_text(found.curve)}"
        yield f"{mark}command = {_sources({kind: one.source for kind, one in ones.items()})}"


def _signals(found: Survey) -> Iterator[str]:
    yield ""
    yield "[signals]"
    clocks = {kind: clock for kind, clock in found.clocks.items() if clock and kind in found.guesses}
    if clocks:
        yield f"time = {_sources(clocks)}"
    names = list(dict.fromkeys(name for guesses in found.guesses.values() for name in guesses.signals))
    for name in names:
        ones = {kind: g.signals[name] for kind, g in found.guesses.items() if name in g.signals}
        yield from _why(ones)
        yield f"{name} = {_signal(ones)}"


def _signal(ones: Mapping[str, Guess]) -> str:
    first = next(iter(ones.values()))
    parts = [f"{kind} = {toml_text(one.source)}" for kind, one in ones.items()]
    parts += [f"unit = {toml_text(first.unit)}"] if first.unit else []
    parts += ["sign = -1"] if first.sign < 0 else []
    return "{ " + ", ".join(parts) + " }"


def _sources(sources: Mapping[str, str]) -> str:
    return "{ " + ", ".join(f"{kind} = {toml_text(source)}" for kind, source in sources.items()) + " }"


def _why(ones: Mapping[str, Guess] | Mapping[str, Thrusting]) -> Iterator[str]:
    for kind, one in ones.items():
        yield f"# {kind}: {shown(one.why, LINE_LENGTH)}"
