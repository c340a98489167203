"""NMEA text of an INS: $xxHDT, $xxROT and $PIXSE,ATITUD, beside the log of the same name that holds the commands.

Time stands in front of each sentence (ISO 8601 or epoch), or comes from ZDA and GGA sentences: what follows one of
these was measured then, several of one kind spread evenly up to the next.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from functools import reduce
from glob import escape
from operator import xor
from pathlib import Path

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.core.errors import ConfigError, LogError, suggestion
from rovid.core.paths import special_kind
from rovid.readers.formats import READERS
from rovid.readers.raw_log import Channel, LogContents, RawLog, foreign
from rovid.readers.timestamps import EPOCH_FROM, to_seconds
from rovid.trial.config import Config
from rovid.trial.trial import Remark

KIND = "nmea"
_DAY = 86400.0
_SENTENCE = re.compile(rb"[A-Z]{4,6},")
# Bytes of the longest line that is taken for one.
_LONGEST = 1 << 16
# Name in rovid.toml -> sentence, which of its cells, factor to deg or deg/s: ROT is in deg/min.
_CHANNELS = {
    "heading": ("HDT", 1, 1.0),
    "yaw_rate": ("ROT", 1, 1.0 / 60.0),
    "roll": ("ATITUD", 2, 1.0),
    "pitch": ("ATITUD", 3, 1.0),
}
# Sentences that are kept, and of how many cells.
_TAKEN = {kind for kind, _, _ in _CHANNELS.values()} | {"ZDA", "GGA"}
_CELLS = 5


def read(path: Path, config: Config) -> RawLog:
    """Wanted channels of ``path``, heading, yaw_rate (deg/s), roll or pitch, and all others from the log beside it.

    Raises
    ------
    LogError
        It holds no NMEA sentences, none of those wanted, or no time; or there is no log beside it, or not one with
        an absolute time.
    ConfigError
        rovid.toml maps a command to it, or what is measured to neither.
    """
    for signal in config.commands:
        if KIND in signal.sources:
            raise ConfigError(
                f"{signal.name} is mapped to nmea, whose sentences hold no commands.",
                where=config.path,
                mend=f"Map it in another format, and put that log beside the text: {path.stem}.csv, for instance.",
            )
    text = _Text(path)
    own, others = {}, {}
    for name, signal in config.signals.items():
        if KIND in signal.sources:
            own[name] = text.channel(name, signal.sources[KIND])
        else:
            others[name] = signal
    beside, log = _beside(path, replace(config, signals=others, measured_signal=""))
    moved = _moved(path, text, beside, log)
    everything = dict(log.channels)
    for name, channel in own.items():
        everything[name] = replace(channel, time=moved[id(channel.time)])
    for name in config.required_signals:
        if name not in everything:
            raise ConfigError(
                f"{name} names neither an nmea source nor one of {beside.name}.",
                where=config.path,
                mend=f'Add nmea = "{name}" to its sources.' if name in _CHANNELS else "Add one.",
            )

    def place(name: str, index: int) -> str:
        if name not in own:
            return log.place(name, index)
        return f"sentence {index + 1} of {everything[name].clock}"

    remarks = (*text.remarks, *log.remarks)
    return RawLog(channels=everything, place=place, remarks=remarks, sortable=log.sortable, beside=(beside,))


def sources(path: Path) -> LogContents:
    """None: what it holds says something only beside another log.

    Raises
    ------
    LogError
        Always.
    """
    raise LogError(
        "is no log by itself, so nothing is guessed from it.",
        where=path,
        mend='Write heading = { nmea = "heading" } in [signals] by hand.',
    )


def _beside(path: Path, config: Config) -> tuple[Path, RawLog]:
    """The log that holds the commands."""
    logs = []
    for near in sorted(path.parent.glob(f"{escape(path.stem)}.*")):
        form = READERS.get(near.suffix.lower())
        if form is not None and form.kind != KIND and not special_kind(near):
            logs.append((near, form))
    if len(logs) != 1:
        there = f"{len(logs)} logs of its name stand beside it" if logs else "no log of its name stands beside it"
        raise LogError(
            f"holds no commands, and {there}; one was expected.",
            where=path,
            mend=f"Put the log that holds the commands there, as {path.stem}.csv, for instance.",
        )
    [(log, form)] = logs
    return log, form.read(log, config.for_format(form.kind))


def _moved(path: Path, text: _Text, beside: Path, log: RawLog) -> dict[int, FloatArray]:
    """The text's clocks, by identity, in the time of the log beside it."""
    if log.epoch is None:
        raise LogError(
            f"gives no absolute time, so what stands in {path.name} cannot be put beside it.",
            where=beside,
            mend="Log ISO 8601 or epoch times.",
        )
    shift = text.origin - log.epoch
    if not text.dated:  # a time of day: of the nearest day
        shift -= _DAY * np.rint(shift / _DAY)
    return {id(time): time + shift for time in text.clocks.values()}


class _Text:
    """The sentences whose checksum is right.

    Attributes
    ----------
    origin
        s since 1970 of time zero; since a midnight where not ``dated``.
    clocks
        Sentence -> (n,) s.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.remarks: list[Remark] = []
        # Sentence -> its cells, what stands in front of it, and how many ZDA and GGA have come.
        self.cells: dict[str, list[list[bytes]]] = {}
        self._fronts: dict[str, list[bytes]] = {}
        self._marks: dict[str, list[tuple[int, int]]] = {}
        self._scan()
        self.dated = True
        wanted = sorted({kind for kind, _, _ in _CHANNELS.values()} & set(self.cells))
        stamped = any(map(any, self._fronts.values()))
        times = self._stamped(wanted) if stamped else self._spread(wanted)
        known = [time for time in times.values() if np.isfinite(time).any()]
        self.origin = min((float(np.nanmin(time)) for time in known), default=0.0)
        self.clocks = {kind: time - self.origin for kind, time in times.items()}

    def channel(self, name: str, source: str) -> Channel:
        """One of `_CHANNELS`."""
        if source not in _CHANNELS:
            raise LogError(
                f"has no {source!r} ({name}). {suggestion(source, _CHANNELS)}",
                where=self.path,
                mend=f"Correct {name} in rovid.toml.",
            )
        kind, at, factor = _CHANNELS[source]
        if kind not in self.clocks:
            raise LogError(
                f"holds no sentence {kind} ({name}). {suggestion(kind, self.cells)}",
                where=self.path,
                mend=f"Delete nmea from {name} in rovid.toml, or leave this log out.",
            )
        values = np.array([_number(_cell(cells, at)) for cells in self.cells[kind]])
        return Channel(source=source, clock=kind, time=self.clocks[kind], values=values * factor)

    def _scan(self) -> None:
        bad = zda = gga = 0
        cut = b""
        for line, ended in _lines(self.path):
            cut = b"" if ended else line.strip()
            at = line.find(b"$")
            if at < 0:
                continue
            body, _, told = line[at + 1 :].strip().partition(b"*")
            if not _right(body, told):
                if _SENTENCE.match(body):
                    bad += 1
                    cut = b""
                continue
            cut = b""
            cells = body.split(b",")
            kind = _kind(cells)
            zda += kind == "ZDA"
            gga += kind == "GGA"
            of_kind = self.cells.setdefault(kind, [])
            if kind not in _TAKEN:
                continue
            of_kind.append(cells[:_CELLS])
            self._fronts.setdefault(kind, []).append(line[:at].strip(b" \t,;[]"))
            self._marks.setdefault(kind, []).append((zda, gga))
        if not self.cells and not bad:
            raise foreign(self.path, "NMEA text")
        if not self.cells:
            raise LogError(
                f"holds {bad} sentences, none of them with a right checksum.",
                where=self.path,
                mend="Log them as the INS sends them, *hh at the end included.",
            )
        bad += bool(cut)
        if bad:
            text = f"{bad} sentences are cut or have a wrong checksum, and were left out."
            self.remarks.append(Remark(kind="truncated", count=bad, text=text))

    def _stamped(self, kinds: list[str]) -> dict[str, FloatArray]:
        """(n,) s since 1970 of each sentence, from what stands in front of it."""
        fronts = {kind: [front.decode("ascii", "replace") for front in self._fronts[kind]] for kind in kinds}
        dates = any("-" in front[1:] for texts in fronts.values() for front in texts[:10])
        moment = _date if dates else _number
        times = {kind: np.array([moment(front) for front in texts]) for kind, texts in fronts.items()}
        if not dates:
            times = {kind: to_seconds(time, "", "auto") for kind, time in times.items()}
        if not any((time > EPOCH_FROM).any() for time in times.values()):
            raise self._timeless()
        return times

    def _spread(self, kinds: list[str]) -> dict[str, FloatArray]:
        """(n,) s of each sentence: those between two that tell the time, evenly; NaN before the first."""
        self.dated = "ZDA" in self.cells
        clock = "ZDA" if self.dated else "GGA"
        tell = _zda if self.dated else _time_of_day
        times = np.array([tell(cells) for cells in self.cells.get(clock, [])])
        if not np.isfinite(times).any():
            raise self._timeless()
        if not self.dated:
            known = np.isfinite(times)
            times[known] = np.unwrap(times[known], period=_DAY)
        # What follows the last of them is taken to last as long as what stood before it.
        last = times[-1] - times[-2] if len(times) > 1 else 0.0
        steps = np.diff(times, append=times[-1] + last)
        column = 0 if self.dated else 1
        spread = {}
        for kind in kinds:
            spread[kind] = _between(times, steps, np.array(self._marks[kind])[:, column] - 1)
        return spread

    def _timeless(self) -> LogError:
        return LogError(
            "tells no time: there is neither an ISO 8601 or epoch time in front of each sentence, nor ZDA, nor GGA.",
            where=self.path,
            mend="Let the INS send ZDA, or the logger write the time in front of each line.",
        )


def _between(times: FloatArray, steps: FloatArray, marks: IntArray) -> FloatArray:
    """(n,) s of sentences, evenly behind that of (m,) ``times`` that their ``marks`` name; NaN where it is below 0."""
    early = marks < 0
    of_mark = np.bincount(marks[~early], minlength=len(times))
    before = np.cumsum(of_mark) - of_mark
    turn = np.arange(len(marks)) - before[marks] - np.count_nonzero(early)
    share = turn / np.maximum(of_mark[marks], 1)
    return np.where(early, np.nan, times[marks] + steps[marks] * share)


def _lines(path: Path) -> Iterator[tuple[bytes, bool]]:
    """Each line, and whether it has an end."""
    with path.open("rb") as file:
        while block := file.readline(_LONGEST):
            for line in block.splitlines(keepends=True):
                yield line.rstrip(b"\r\n"), line.endswith((b"\r", b"\n"))


def _right(body: bytes, told: bytes) -> bool:
    """Whether the checksum that is told is that of the sentence."""
    if not re.fullmatch(b"[0-9A-Fa-f]{2}", told):
        return False
    return reduce(xor, body, 0) == int(told, 16)


def _kind(cells: list[bytes]) -> str:
    """What a sentence tells: its address without the talker, or the word behind that of iXblue's own."""
    if cells[0] == b"PIXSE" and len(cells) > 1:
        return cells[1].decode("ascii", "replace")
    return cells[0][2:].decode("ascii", "replace")


def _cell(cells: list[bytes], at: int) -> bytes:
    if at < len(cells):
        return cells[at]
    return b""


def _number(text: bytes | str) -> float:
    try:
        return float(text)
    except ValueError:
        return np.nan


def _date(text: str) -> float:
    try:
        moment = datetime.fromisoformat(text.replace(",", "."))
        if moment.tzinfo is None:
            moment = moment.replace(tzinfo=UTC)
        return moment.timestamp()
    except (ValueError, OverflowError):
        return np.nan


def _time_of_day(cells: list[bytes]) -> float:
    """S since midnight of hhmmss.ss; NaN beyond the day's end, a leap second allowed."""
    text = _cell(cells, 1)
    hours, minutes, rest = map(_number, (text[:2], text[2:4], text[4:]))
    time = 3600.0 * hours + 60.0 * minutes + rest
    return time if 0.0 <= time <= _DAY + 1.0 else np.nan


def _zda(cells: list[bytes]) -> float:
    """S since 1970 of hhmmss.ss,dd,mm,yyyy."""
    try:
        day, month, year = map(int, cells[2:5])
        return datetime(year, month, day, tzinfo=UTC).timestamp() + _time_of_day(cells)
    except (ValueError, OverflowError):  # a year of many digits
        return np.nan
