"""NMEA text of an INS, with a log of the same name that holds the commands.

Headings are in $xxHDT, THS, HDG or HDM, rates in $xxROT, tilts in $PIXSE,ATITUD. The time is in front of each sentence
(ISO 8601, epoch, time of day, or a tag block), or comes from ZDA or GGA sentences: the sentences after one of these
were measured at its time, and several of one kind are spread evenly up to the next one.
"""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from functools import reduce
from glob import escape
from operator import xor
from pathlib import Path

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import ConfigError, LogError, suggestion
from rovid.core.input_files import special_kind
from rovid.readers.formats import READERS
from rovid.readers.raw_log import Channel, LogContents, RawLog, wrong_format
from rovid.readers.timestamps import EPOCH_FROM, to_seconds
from rovid.trial.config import Config
from rovid.trial.trial import Remark

KIND = "nmea"
_DAY = 86400.0
_SENTENCE = re.compile(rb"[A-Z]{4,6},")
_CHECKSUM = re.compile(b"[0-9A-Fa-f]{2}")
# Bytes of the longest line.
_MAX_LINE = 1 << 16
# Name in rovid.toml -> sentences, the preferred one first, index of the cell, factor to deg or deg/s (ROT: deg/min).
# THS is a true heading with a status; HDG and HDM are magnetic, and stay so: a constant does not turn the vehicle.
_CHANNELS = {
    "heading": (("HDT", "THS", "HDG", "HDM"), 1, 1.0),
    "yaw_rate": (("ROT",), 1, 1.0 / 60.0),
    "roll": (("ATITUD",), 2, 1.0),
    "pitch": (("ATITUD",), 3, 1.0),
}
_MEASURING = {kind for kinds, _, _ in _CHANNELS.values() for kind in kinds}
_TIMING = ("ZDA", "GGA")
# Sentences whose second cell is V for an invalid value.
_WITH_STATUS = {"THS", "ROT"}
# Number of cells of each sentence that are kept; missing cells are empty.
_CELLS = 5
# Time in a tag block of NMEA 4: s or ms since 1970.
_TAG_TIME = re.compile(rb"\\(?:[^\\]*,)?c:(\d+)")
_CLOCK_TIME = re.compile(r"(\d\d):(\d\d):(\d\d(?:[.,]\d+)?)$")


def read(path: Path, config: Config) -> RawLog:
    """Mapped channels of ``path``: heading, yaw_rate (deg/s), roll, pitch; all others from the log of the same name."""
    for signal in config.commands:
        if KIND in signal.sources:
            text = f"{signal.name} is mapped to nmea, whose sentences hold no commands."
            mend = f"Map it in another format, and put that log next to the text: {path.stem}.csv, for instance."
            raise ConfigError(text, where=config.path, mend=mend)
    sentences = _Text(path)
    own, others = {}, {}
    for name, signal in config.signals.items():
        if KIND in signal.sources:
            own[name] = sentences.channel(name, signal.sources[KIND])
        else:
            others[name] = signal
    companion, log = _read_companion(path, replace(config, signals=others, measured_signal=""))
    if log.epoch is None:
        text = f"has no absolute time, so it cannot be synchronised with {path.name}."
        raise LogError(text, where=companion, mend="Log ISO 8601 or epoch times.")
    shift = sentences.origin - log.epoch
    if not sentences.is_dated:  # A time of day: of the nearest day.
        shift -= _DAY * np.rint(shift / _DAY)
    # Channels of one sentence share their clock.
    moved = {id(time): time + shift for time in sentences.clocks.values()}
    channels = dict(log.channels)
    for name, channel in own.items():
        channels[name] = replace(channel, time=moved[id(channel.time)])
    for name in config.required_signals:
        if name not in channels:
            text = f"{name} names neither an nmea source nor one of {companion.name}."
            mend = f'Add nmea = "{name}" to its sources.' if name in _CHANNELS else "Add one."
            raise ConfigError(text, where=config.path, mend=mend)

    def place(name: str, index: int) -> str:
        return f"sentence {index + 1} of {channels[name].clock}" if name in own else log.place(name, index)

    remarks = (*sentences.remarks, *log.remarks)
    return RawLog(channels=channels, place=place, remarks=remarks, sortable=log.sortable, companion_files=(companion,))


def sources(path: Path) -> LogContents:
    """Always raise `LogError`: NMEA text is a log only together with another."""
    text = "is no log by itself, so nothing is guessed from it."
    raise LogError(text, where=path, mend='Write heading = { nmea = "heading" } in [signals] by hand.')


def _read_companion(path: Path, config: Config) -> tuple[Path, RawLog]:
    """The log of the same name, which holds the commands."""
    logs = []
    for near in sorted(path.parent.glob(f"{escape(path.stem)}.*")):
        form = READERS.get(near.suffix.lower())
        if form is not None and form.kind != KIND and not special_kind(near):
            logs.append((near, form))
    if len(logs) != 1:
        found = f"{len(logs)} logs of its name are in its folder" if logs else "no log of its name is in its folder"
        text = f"holds no commands, and {found}; one was expected."
        mend = f"Put the log that holds the commands there, as {path.stem}.csv, for instance."
        raise LogError(text, where=path, mend=mend)
    [(log, form)] = logs
    return log, form.read(log, config.for_format(form.kind))


class _Text:
    """The sentences with a right checksum; ``clocks`` holds the (n,) s of each sentence."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.remarks: list[Remark] = []
        # Address (between $ and the first comma) -> cells, prefixes, and numbers of ZDA and GGA before each sentence.
        self.cells: dict[str, list[list[bytes]]] = {}
        self._prefixes: dict[str, list[bytes]] = {}
        self._counts: dict[str, list[tuple[int, int]]] = {}
        self._seen: Counter[str] = Counter()
        self._scan()
        self.is_dated = True
        measuring = [address for address in self.cells if _kind(address) in _MEASURING]
        if not measuring:
            text = f"holds no sentence {', '.join(sorted(_MEASURING))}, but {self._contents}."
            raise LogError(text, where=path, mend="Let the INS send HDT, or leave this log out.")
        stamped = any(map(any, self._prefixes.values()))
        times = self._prefix_times(measuring) if stamped else self._spread_times(measuring)
        known = [time for time in times.values() if np.isfinite(time).any()]
        # s since 1970 at time zero; since a midnight unless dated.
        self.origin = min((float(np.nanmin(time)) for time in known), default=0.0)
        self.clocks = {address: time - self.origin for address, time in times.items()}

    def channel(self, name: str, source: str) -> Channel:
        """One of `_CHANNELS`, from the preferred sentence, and of several talkers the one that sends most."""
        if source not in _CHANNELS:
            text = f"has no {source!r} ({name}). {suggestion(source, _CHANNELS)}"
            raise LogError(text, where=self.path, mend=f"Correct {name} in rovid.toml.")
        kinds, at, factor = _CHANNELS[source]
        found = [address for address in self.clocks if _kind(address) in kinds]
        if not found:
            text = f"holds no sentence {' or '.join(kinds)} ({name}), but {self._contents}."
            raise LogError(text, where=self.path, mend=f"Delete nmea from {name} in rovid.toml, or leave this log out.")
        found.sort(key=lambda address: (kinds.index(_kind(address)), -len(self.cells[address])))
        chosen, *others = found
        if others:
            also = ", ".join(f"{address} ({len(self.cells[address])})" for address in others)
            text = f"{name} was taken from {chosen} ({len(self.cells[chosen])} sentences); {also} was not used."
            self.remarks.append(Remark(kind="chosen", count=sum(len(self.cells[one]) for one in others), text=text))
        values = np.array([_number(cells[at]) for cells in self.cells[chosen]])
        if _kind(chosen) in _WITH_STATUS:
            values[[cells[at + 1] == b"V" for cells in self.cells[chosen]]] = np.nan
        return Channel(source=source, clock=chosen, time=self.clocks[chosen], values=values * factor)

    @property
    def _contents(self) -> str:
        """Numbers of sentences by address."""
        return ", ".join(f"{count} {address}" for address, count in self._seen.most_common(5))

    def _scan(self) -> None:
        bad, is_cut = 0, False
        clocks: dict[str, str] = {}  # Of several talkers, the first one sets the clock.
        counts = dict.fromkeys(_TIMING, 0)
        for line, has_end in _lines(self.path):
            is_cut = bool(line.strip()) and not has_end
            at = line.find(b"$")
            if at < 0:
                continue
            body, _, checksum = line[at + 1 :].strip().partition(b"*")
            if not _CHECKSUM.fullmatch(checksum) or reduce(xor, body, 0) != int(checksum, 16):
                if _SENTENCE.match(body):
                    bad += 1
                    is_cut = False
                continue
            is_cut = False
            cells = body.split(b",")
            # Address of a sentence, or the word that follows the address of iXblue's own sentences.
            own = cells[0] == b"PIXSE" and len(cells) > 1
            address = cells[own].decode("ascii", "replace")
            kind = _kind(address)
            self._seen[address] += 1
            if kind in _TIMING:
                if clocks.setdefault(kind, address) != address:
                    continue
                counts[kind] += 1
                address = kind
            elif kind not in _MEASURING:
                continue
            self.cells.setdefault(address, []).append([*cells, *[b""] * _CELLS][:_CELLS])
            tag = _TAG_TIME.search(line[:at])
            self._prefixes.setdefault(address, []).append(tag[1] if tag else line[:at].strip(b" \t,;[]>"))
            self._counts.setdefault(address, []).append((counts["ZDA"], counts["GGA"]))
        if not self._seen and not bad:
            raise wrong_format(self.path, "NMEA text")
        if not self._seen:
            text = f"holds {bad} sentences, none of them with a right checksum."
            raise LogError(text, where=self.path, mend="Log them as the INS sends them, with the *hh at the end.")
        bad += is_cut
        if bad:
            text = f"{bad} sentences are cut or have a wrong checksum, and were left out."
            self.remarks.append(Remark(kind="truncated", count=bad, text=text))

    def _prefix_times(self, addresses: list[str]) -> dict[str, FloatArray]:
        """(n,) s since 1970 of each sentence from its prefix; since a midnight where the prefixes hold no date."""
        prefixes = {one: [prefix.decode("ascii", "replace") for prefix in self._prefixes[one]] for one in addresses}
        first = [text for texts in prefixes.values() for text in texts[:10]]
        if any(re.search(r".[-/]", text) for text in first):
            times = {one: np.array(list(map(_iso_time, texts))) for one, texts in prefixes.items()}
        elif any(map(_CLOCK_TIME.match, first)):
            self.is_dated = False
            times = {one: _continuous(np.array(list(map(_clock_time, texts)))) for one, texts in prefixes.items()}
            if any(np.isfinite(time).any() for time in times.values()):
                return times
        else:
            numbers = {one: np.array(list(map(_number, texts))) for one, texts in prefixes.items()}
            times = {one: to_seconds(time, "", "auto") for one, time in numbers.items()}
        if not any((time > EPOCH_FROM).any() for time in times.values()):
            raise self._no_time()
        return times

    def _spread_times(self, addresses: list[str]) -> dict[str, FloatArray]:
        """(n,) s of each sentence, evenly between two sentences with a time; NaN before the first."""
        self.is_dated = "ZDA" in self.cells
        clock, parse = ("ZDA", _zda_time) if self.is_dated else ("GGA", _time_of_day)
        times = np.array(list(map(parse, self.cells.get(clock, []))))
        if not np.isfinite(times).any():
            raise self._no_time()
        if not self.is_dated:
            times = _continuous(times)
        # The interval after the last time equals the one before.
        last = times[-1] - times[-2] if len(times) > 1 else 0.0
        steps = np.diff(times, append=times[-1] + last)
        column = 0 if self.is_dated else 1
        spread = {}
        for address in addresses:
            marks = np.array(self._counts[address])[:, column] - 1  # Index of the last time; -1 before the first.
            early = marks < 0
            count = np.bincount(marks[~early], minlength=len(times))
            before = np.cumsum(count) - count
            rank = np.arange(len(marks)) - before[marks] - np.count_nonzero(early)
            share = rank / np.maximum(count[marks], 1)
            spread[address] = np.where(early, np.nan, times[marks] + steps[marks] * share)
        return spread

    def _no_time(self) -> LogError:
        text = "has no time: there is neither an ISO 8601 or epoch time in front of each sentence, nor ZDA, nor GGA."
        mend = "Let the INS send ZDA, or the logger write the time in front of each line."
        return LogError(text, where=self.path, mend=mend)


def _lines(path: Path) -> Iterator[tuple[bytes, bool]]:
    """Each line, and whether it ends with an end of line."""
    with path.open("rb") as file:
        while block := file.readline(_MAX_LINE):
            for line in block.splitlines(keepends=True):
                yield line.rstrip(b"\r\n"), line.endswith((b"\r", b"\n"))


def _kind(address: str) -> str:
    """Address without the talker."""
    return address if address in _MEASURING or address in _TIMING else address[2:]


def _continuous(times: FloatArray) -> FloatArray:
    """(n,) s of times of day, which go on over midnight."""
    known = np.isfinite(times)
    times[known] = np.unwrap(times[known], period=_DAY)
    return times


def _number(text: bytes | str) -> float:
    try:
        return float(text)
    except ValueError:
        return np.nan


def _iso_time(text: str) -> float:
    try:
        moment = datetime.fromisoformat(text.replace(",", ".").replace("/", "-"))
        if moment.tzinfo is None:
            moment = moment.replace(tzinfo=UTC)
        return moment.timestamp()
    except (ValueError, OverflowError):
        return np.nan


def _clock_time(text: str) -> float:
    """Seconds since midnight of hh:mm:ss.ss."""
    found = _CLOCK_TIME.match(text)
    return 3600.0 * float(found[1]) + 60.0 * float(found[2]) + float(found[3].replace(",", ".")) if found else np.nan


def _time_of_day(cells: list[bytes]) -> float:
    """Seconds since midnight of hhmmss.ss; NaN beyond the end of the day, with room for a leap second."""
    text = cells[1]
    hours, minutes, seconds = map(_number, (text[:2], text[2:4], text[4:]))
    time = 3600.0 * hours + 60.0 * minutes + seconds
    return time if 0.0 <= time <= _DAY + 1.0 else np.nan


def _zda_time(cells: list[bytes]) -> float:
    """Seconds since 1970 of hhmmss.ss,dd,mm,yyyy."""
    try:
        day, month, year = map(int, cells[2:5])
        return datetime(year, month, day, tzinfo=UTC).timestamp() + _time_of_day(cells)
    except (ValueError, OverflowError):
        return np.nan
