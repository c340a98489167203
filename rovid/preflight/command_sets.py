"""Logs that name their commands differently: one thruster for equal commands, or one set of thrusters for all logs."""

import itertools
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import shortened_list
from rovid.preflight.log_reading import LogsRead
from rovid.preflight.raw_columns import MIN_SAMPLES, SIDE, Log, held_mean
from rovid.preflight.signal_guess import ColumnMapping
from rovid.preflight.thruster_guess import ThrusterCommand
from rovid.trial.axis import name_words
from rovid.trial.preprocessing import Exclusion

# Minimum share of the variance of one command that another explains without a scale: both are then one recording.
# Share of the shorter log that both must cover; largest number of samples that are compared. Decisions.
_SAME, _COVER, _MAX_SAMPLES = 0.8, 0.5, 5000
# Worth of an equal number in both names, as a share; half of it is the least distance to the next best. A decision.
_MARGIN = 0.04
_NUMBER = re.compile(r"\d+")


def match_commands(read: LogsRead, mappings: Mapping[str, ColumnMapping]) -> dict[str, ColumnMapping]:
    """The mappings with one name for each thruster whose commands are equal in logs of one run in two formats."""
    matched = dict(mappings)
    for first, second in itertools.combinations(mappings, 2):
        ours, theirs = matched[first].commands, matched[second].commands
        own = _without_names(ours, {one.name for one in theirs})
        others = _without_names(theirs, {one.name for one in ours})
        if not (own and others):
            continue
        logs = itertools.product(read.logs[first], read.logs[second])
        shares = [found for one, other in logs if (found := _shares(one, own, other, others)) is not None]
        twins = _pairs(np.mean(shares, axis=0), own, others) if shares else {}
        commands = {command.source: command for command in theirs}
        for source, twin in twins.items():
            reason = f"{commands[source].reason}; the same values as {twin.source}"
            commands[source] = replace(commands[source], name=twin.name, reason=reason)
        matched[second] = replace(matched[second], commands=tuple(commands.values()))
    return matched


def _without_names(commands: Collection[ThrusterCommand], names: Collection[str]) -> list[ThrusterCommand]:
    return [one for one in commands if one.name not in names]


def _pairs(
    shares: FloatArray, own: Sequence[ThrusterCommand], others: Sequence[ThrusterCommand]
) -> dict[str, ThrusterCommand]:
    """Source of the ``others`` -> its twin among ``own``; empty unless each of the smaller set has a certain twin.

    The numbers in the names distinguish thrusters that had the same command throughout.
    """
    ranks = np.zeros(shares.shape)
    for place, share in np.ndenumerate(shares):
        names = own[place[0]].source, others[place[1]].source
        number = _agree(*(set(_NUMBER.findall(name)[-1:]) for name in names))
        side = _agree(*(name_words(name) & SIDE for name in names))
        # Two thrusters may have run by one programme: a side contradicts, and a number where there is no other command.
        if side >= 0 and (number >= 0 or min(shares.shape) > 1):
            ranks[place] = share + _MARGIN * (number == 1)
    is_wide = len(own) <= len(others)
    ranks = ranks if is_wide else ranks.T
    rows, best = np.arange(len(ranks)), np.argmax(ranks, axis=1)
    rivals = ranks.copy()
    rivals[rows, best] = 0.0
    certain = ranks[rows, best] - np.maximum(rivals.max(axis=1), _SAME) >= 0.5 * _MARGIN
    if len(set(best.tolist())) < len(rows) or not certain.all():
        return {}
    found = zip(rows, best, strict=True) if is_wide else zip(best, rows, strict=True)
    return {others[int(column)].source: own[int(row)] for row, column in found}


def _agree(one: Collection[str], other: Collection[str]) -> int:
    """1 if both are equal, -1 if they differ, 0 if one of them is empty."""
    return 0 if not (one and other) else 1 if one == other else -1


def _shares(
    one: Log, own: Collection[ThrusterCommand], other: Log, others: Collection[ThrusterCommand]
) -> FloatArray | None:
    """(own, others) shares of the variance of one command that another one explains, both logs on one clock.

    None where a log lacks a command, or the logs are not of one run.
    """
    if not (all(command.source in one for command in own) and all(command.source in other for command in others)):
        return None
    step = max(_interval(one, own), _interval(other, others))
    a, b = _on_grid(one, own, step), _on_grid(other, others, step)
    if min(a.shape[1], b.shape[1]) < MIN_SAMPLES:
        return None
    # The sum of the sizes of all commands does not depend on their names.
    first, second = np.abs(a).sum(axis=0), np.abs(b).sum(axis=0)
    first, second = first - first.mean(), second - second.mean()
    count = len(first) + len(second)
    products = np.fft.irfft(np.fft.rfft(first, count) * np.conj(np.fft.rfft(second, count)), count)
    lag = int(np.argmax(products))
    lag = lag - count if lag >= len(first) else lag
    begin, end = max(lag, 0), min(len(first), lag + len(second))
    if end - begin < max(MIN_SAMPLES, _COVER * min(len(first), len(second))):
        return None
    a, b = a[:, begin:end], b[:, begin - lag : end - lag]
    spread = np.minimum(a.var(axis=1)[:, None], b.var(axis=1)[None, :])
    error = np.mean((a[:, None, :] - b[None, :, :]) ** 2, axis=2)
    shares = np.where(spread > 0.0, 1.0 - error / np.where(spread > 0.0, spread, 1.0), 0.0).clip(0.0)
    return shares if (shares.max(axis=int(len(own) <= len(others))) >= _SAME).all() else None


def _interval(log: Log, commands: Collection[ThrusterCommand]) -> float:
    """Longest median interval in s of the ``commands``; longer where a log has too many samples."""
    times = [log[one.source].time for one in commands]
    return max(
        max(float(np.median(np.diff(time))), float(np.ptp(time)) / _MAX_SAMPLES) if len(time) > 1 else np.inf
        for time in times
    )


def _on_grid(log: Log, commands: Collection[ThrusterCommand], step: float) -> FloatArray:
    """(commands, n) means over intervals of ``step`` s, without the value of no thrust; empty for too short a log."""
    begin = max(float(log[one.source].time.min(initial=np.inf)) for one in commands)
    end = min(float(log[one.source].time.max(initial=-np.inf)) for one in commands)
    if not (step > 0.0 and np.isfinite([step, begin, end]).all() and end - begin > MIN_SAMPLES * step):
        return np.empty((len(commands), 0))
    edges, rows = np.arange(begin, end, step), []
    for one in commands:
        column = log[one.source]
        known = np.isfinite(column.values)
        if not known.any():
            return np.empty((len(commands), 0))
        rows.append(held_mean(column.time[known], column.values[known] - one.neutral, edges))
    return np.array(rows)


@dataclass(frozen=True, kw_only=True)
class LeftOut:
    """Logs of other commands than the thrusters in rovid.toml have."""

    exclusions: tuple[Exclusion, ...] = ()
    names: tuple[str, ...] = ()  #: Names of these logs.
    commands: tuple[str, ...] = ()  #: Sources of their commands.
    text: str = ""  #: Message for people.


def leave_out(
    read: LogsRead, guessed: Mapping[str, ColumnMapping], mappings: Mapping[str, ColumnMapping], *, planar: bool
) -> tuple[dict[str, ColumnMapping], LeftOut]:
    """The mappings with commands that go together, and the logs that hold other commands of those ``guessed``.

    If no log holds the commands of all thrusters, those of most logs stay, or of most samples.
    """
    drives = any(one.actuation - {command.source for command in one.commands} for one in mappings.values())
    names = list(itertools.chain(*read.names.values()))
    if read.join is not None or drives or len(set(names)) < len(names):
        return dict(mappings), LeftOut()
    every = [command for mapping in mappings.values() for command in mapping.commands]
    turning = {command.name for command in every if command.direction}
    needed = {command.name for command in every if planar or not turning or command.name in turning}
    held: dict[str, frozenset[str]] = {}
    # Set of thrusters -> number of logs, and of samples.
    sizes: dict[frozenset[str], tuple[int, int]] = {}
    for kind, name, log in _logs(read, mappings):
        held[name] = frozenset(one.name for one in mappings[kind].commands if one.source in log) & needed
        count, samples = sizes.get(held[name], (0, 0))
        sizes[held[name]] = count + 1, samples + max((len(column.time) for column in log.values()), default=0)
    best = max(filter(None, sizes), key=lambda names: (names >= needed, sizes[names]), default=frozenset[str]())
    # Commands of no use -> names of their logs; and sources in the other logs, by format.
    others: dict[tuple[str, ...], list[str]] = {}
    stay: dict[str, set[str]] = {kind: set() for kind in mappings}
    for kind, name, log in _logs(read, mappings) if best else ():
        used = {one.source for one in mappings[kind].commands if one.name in best}
        foreign = tuple(one.source for one in guessed[kind].commands if one.source in log and one.source not in used)
        if foreign and (held[name].isdisjoint(best) or not (best >= needed or held[name] >= best)):
            others.setdefault(foreign, []).append(name)
        else:
            stay[kind].update(log)
    if not others:
        return dict(mappings), LeftOut()
    fitting = {}
    for kind, mapping in mappings.items():
        commands = tuple(one for one in mapping.commands if one.source in stay[kind])
        missing = tuple(what for what in mapping.missing if what != "command")
        sources = (*mapping.sources, *mapping.unused)
        fitting[kind] = replace(mapping, commands=commands, missing=missing).of(sources)
    return fitting, _left_out(read, others, [name for name in held if name not in {*itertools.chain(*others.values())}])


def _left_out(read: LogsRead, others: Mapping[tuple[str, ...], list[str]], stay: Collection[str]) -> LeftOut:
    """The logs of ``others``, by their commands, with the reason; the logs that ``stay`` have the thrusters."""
    exclusions, texts = [], []
    for commands, names in others.items():
        reason = f"other commands: {', '.join(commands)}"
        patterns = _patterns(read, names)
        exclusions += [Exclusion(log=pattern, reason=f"holds {reason}") for pattern in patterns]
        are, hold, them = ("is", "holds", "it") if len(names) == 1 else ("are", "hold", "them")
        texts.append(
            f"{shortened_list(names)} {are} left out by [[leave_out]]: {hold} {reason}. To use {them} instead of "
            f"{shortened_list(stay)}: `rovid init LOGS --command {','.join(commands)} --force`."
        )
    return LeftOut(
        exclusions=tuple(exclusions),
        names=tuple(itertools.chain(*others.values())),
        commands=tuple(itertools.chain(*others)),
        text=" ".join(texts),
    )


def _logs(read: LogsRead, mappings: Mapping[str, ColumnMapping]) -> Iterator[tuple[str, str, Log]]:
    """Format, name and columns of each log of a mapped format."""
    for kind in mappings:
        for name, log in zip(read.names[kind], read.logs[kind], strict=True):
            yield kind, name, log


def _patterns(read: LogsRead, names: Collection[str]) -> Iterator[str]:
    """``names`` for [[leave_out]]; a pattern for all logs of a format of which only the first ones were read."""
    for kind, own in read.names.items():
        chosen = [name for name in own if name in names]
        if read.unread[kind] and len(chosen) == len(own):
            yield from sorted({f"*{Path(name).suffix}" for name in chosen})
        else:
            yield from chosen


def incomplete_logs(read: LogsRead, mappings: Mapping[str, ColumnMapping], without: Collection[str]) -> Iterator[str]:
    """Warning for each log without a mapped signal or command, except for those of the names in ``without``."""
    for kind, mapping in mappings.items():
        turning = [command for command in mapping.commands if command.direction]
        mapped = [one.source for one in (*mapping.signals.values(), *(turning or mapping.commands))]
        mapped += [rudder.angle.source for rudder in mapping.rudders]
        lacks: dict[str, list[str]] = {}
        for name, log in zip(read.names[kind], read.logs[kind], strict=True):
            if name not in without and (lacking := ", ".join(source for source in mapped if source not in log)):
                lacks.setdefault(lacking, []).append(name)
        for lacking, names in lacks.items():
            verbs = ("holds", "is it") if len(names) == 1 else ("hold", "are they")
            yield f"{shortened_list(names)}: {verbs[0]} no {lacking}; {verbs[1]} of another vehicle?"
