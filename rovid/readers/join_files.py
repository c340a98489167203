"""One trial of several files: what each of them holds, on clocks that are brought together; nothing is resampled."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from rovid.core.errors import LogError
from rovid.readers.formats import READERS
from rovid.readers.raw_log import Channel, RawLog
from rovid.trial.config import Config
from rovid.trial.log_files import Join
from rovid.trial.signal_names import Signal
from rovid.trial.trial import Remark


def companions(path: Path, config: Config) -> list[Path]:
    """The files of the trial that ``path`` is one of, itself among them, in the order of the parts; none if alone."""
    root, join = config.path.parent.resolve(), config.join
    here = path.resolve()
    if join is None or not here.is_relative_to(root) or not join.part(here.relative_to(root).as_posix()):
        return []
    # The part stands in the file's own name, or in that of its folder.
    if join.part(here.name) or here.parent == root:
        near = path.parent.glob("*")
    else:
        near = (path.parent.parent if path.parent.name else here.parent.parent).glob("*/*")
    # Names are compared before any file is looked at: a folder may hold many.
    logs = [file for file in near if file.suffix.lower() in READERS and join.part(f"{file.parent.name}/{file.name}")]
    names = {file.resolve().relative_to(root).as_posix(): file for file in logs if file.is_file()}
    return [names[name] for name in join.files_of_trial(here.relative_to(root).as_posix(), names)]


def read_joined(path: Path, config: Config) -> RawLog:
    """Channels of all files of a trial, in the time of the first.

    Raises
    ------
    LogError
        A file cannot be read, or one tells the time of day and another does not.
    ConfigError
        A signal is mapped to none of them.
    """
    join = config.join
    if join is None:
        raise ValueError("there is no [join]")
    read: list[tuple[Path, RawLog]] = []
    channels: dict[str, Channel] = {}
    remarks: list[Remark] = []
    owners: dict[str, RawLog] = {}
    for file in companions(path, config):
        own = _own(file, config, join)
        if not own.signals:
            remarks.append(Remark(kind="skipped", count=1, text=f"{file.name} holds nothing that is mapped."))
            continue
        raw = READERS[file.suffix.lower()].read(file, own)
        for name, channel in _together(file, raw, read, config).items():
            if name not in channels:
                channels[name] = channel
                owners[name] = raw
        read.append((file, raw))
        remarks += [replace(remark, text=f"{file.name}: {remark.text}") for remark in raw.remarks]
    remarks += _said(read, config)
    first = read[0][1] if read else None
    return RawLog(
        channels=channels,
        place=lambda name, index: owners[name].place(name, index),
        remarks=tuple(remarks),
        sortable=all(raw.sortable for _, raw in read),
        epoch=first.epoch if first else None,
        beside=tuple(file for file, _ in read if file != path),
    )


def all_channels(path: Path, config: Config) -> dict[Path, dict[str, Channel]]:
    """All that the files of a trial hold, by source, mapped or not, on the clocks that `read_joined` gives them.

    Raises
    ------
    LogError
        As `read_joined`.
    """
    join = config.join
    if join is None:
        return {}
    read: list[tuple[Path, RawLog]] = []
    found: dict[Path, dict[str, Channel]] = {}
    for file in companions(path, config):
        form = READERS[file.suffix.lower()]
        own = _own(file, config, join)
        every = {
            name: Signal(name=name, sources={form.kind: name}, optional=True) for name in form.sources(file).sources
        }
        if not every:
            continue
        raw = form.read(file, replace(own, signals=every))
        found[file] = _together(file, raw, read, config)
        read.append((file, raw))
    return found


def _together(file: Path, raw: RawLog, before: list[tuple[Path, RawLog]], config: Config) -> dict[str, Channel]:
    """Channels of ``file`` in the time of the first, its clock put right as [join] says."""
    shift = _shift(file, raw, before)
    offset, drift = config.join.clock_correction(relative_name(file, config)) if config.join else (0.0, 0.0)
    starts = [float(channel.time[np.isfinite(channel.time)].min(initial=np.inf)) for channel in raw.channels.values()]
    begin = min(starts, default=0.0)
    moved = {}
    for channel in raw.channels.values():
        since = channel.time - begin if np.isfinite(begin) else 0.0
        moved[id(channel.time)] = channel.time + (shift + offset + 1e-6 * drift * since)
    return {name: replace(channel, time=moved[id(channel.time)]) for name, channel in raw.channels.items()}


def relative_name(file: Path, config: Config) -> str:
    """What a file is called in [join]: its way from rovid.toml on."""
    return file.resolve().relative_to(config.path.parent.resolve()).as_posix()


def _own(file: Path, config: Config, join: Join) -> Config:
    """What of ``config`` is mapped to ``file``."""
    form = READERS[file.suffix.lower()]
    config = config.for_format(form.kind)
    part = join.part(relative_name(file, config))
    time = config.time
    if part in join.time:
        column, unit = join.time[part]
        time = replace(time, sources={**time.sources, form.kind: column}, unit=unit)
    there = _columns(file, form.kind)
    wanted = {name: replace(signal, optional=True) for name, signal in config.mapped_signals(form.kind).items()}
    signals = {name: signal for name, signal in wanted.items() if there is None or signal.sources[form.kind] in there}
    return replace(config, signals=signals, time=time, commands=(), measured_signal="")


def _columns(file: Path, kind: str) -> set[str] | None:
    """The columns of a table; None of what holds messages, which the reader looks up itself."""
    if kind != "csv":
        return None
    from rovid.readers.csv_dialect import read_layout

    return set(read_layout(file, ()).names)


def _shift(file: Path, raw: RawLog, before: list[tuple[Path, RawLog]]) -> float:
    """Time of the first file at which that of ``file`` begins, s."""
    if not before:
        return 0.0
    first, log = before[0]
    if (log.epoch is None) is not (raw.epoch is None):
        told, other = (file, first) if log.epoch is None else (first, file)
        raise LogError(
            f"tells no time of day, and {told.name} does: their clocks cannot be brought together.",
            where=other,
            mend="Log ISO 8601 or epoch times in both, or seconds from the same moment.",
        )
    if log.epoch is None or raw.epoch is None:
        return 0.0
    return raw.epoch - log.epoch


def _said(read: list[tuple[Path, RawLog]], config: Config) -> Iterator[Remark]:
    """How the clocks were put together, and what is taken for granted of them."""
    join = config.join
    if len(read) < 2 or join is None:
        return
    given = False
    for file, _ in read:
        name = relative_name(file, config)
        offset, drift = join.clock_correction(name)
        if offset or drift:
            given = True
            # What is said of a part is the same in all trials, and then said once.
            clock = join.part(name) if join.is_corrected_by_part(name) else file.name
            more = f" and {drift:g} ppm more as it goes" if drift else ""
            text = f"The clock of {clock} was put {offset:+g} s on{more}, as [join] in rovid.toml says."
            yield Remark(kind="clock", count=1, text=text)
    if not given:
        text = (
            "Read from files whose clocks are taken for one. How far they are apart cannot be told from a delay of the "
            "thrusters: a command_delay that is found may be theirs. Give what is known in [join] offset."
        )
        yield Remark(kind="joined", count=len(read), text=text)
