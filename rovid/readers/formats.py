"""The reader of each file, and trials that were logged in several files."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import cast

import numpy as np

from rovid.core.errors import LogError, suggestion
from rovid.core.input_files import require_regular
from rovid.readers.raw_log import Channel, LogContents, RawLog
from rovid.trial.axis import Signal
from rovid.trial.config import Config
from rovid.trial.log_files import FORMATS, Join
from rovid.trial.tables import column_names
from rovid.trial.trial import Remark, Trial


@dataclass(frozen=True, kw_only=True)
class LogFormat:
    """A log format, with its reader: the module `rovid.readers.<kind>_reader`, imported on first use.

    The reader has two functions. ``read(path, config) -> RawLog`` returns the mapped channels of a file, and
    ``sources(path) -> LogContents`` its readable contents. Both raise `LogError` for a file that cannot be read: it is
    no such file, an optional package is missing, or a source is missing or no number. ``read`` raises `ConfigError` if
    rovid.toml does not map the time, the measured signal or a command for the format.
    """

    kind: str

    def read(self, path: Path, config: Config) -> RawLog:
        """Raw channels of ``path``."""
        with self._reader(path) as reader:
            return cast("RawLog", reader.read(path, config))

    def sources(self, path: Path) -> LogContents:
        """Readable contents of ``path``."""
        with self._reader(path) as reader:
            return cast("LogContents", reader.sources(path))

    @contextmanager
    def _reader(self, path: Path) -> Iterator[ModuleType]:
        """The reader; errors of the operating system on ``path`` become a `LogError`."""
        require_regular(path, LogError)
        try:
            yield import_module(f"rovid.readers.{self.kind}_reader")
        except OSError as error:
            raise LogError(f"cannot be read ({error.strerror or error}).", where=path) from error
        except MemoryError as error:
            raise LogError("needs more memory than there is.", where=path, mend="Split the log.") from error


READERS: Mapping[str, LogFormat] = {suffix: LogFormat(kind=kind) for suffix, kind in FORMATS.items()}


def read_log(path: Path, config: Config, name: str | None = None) -> Trial:
    """One trial from one file, or from the files of the same trial.

    ``name`` is that of the trial; by default the file's. Raises `LogError` if the file cannot be read in the format of
    its suffix or holds no usable measurement, `ConfigError` if rovid.toml does not map this format.
    """
    form = READERS.get(path.suffix.lower())
    if form is None:
        text = f"has the suffix {path.suffix!r}; {', '.join(READERS)} were expected."
        raise LogError(text, where=path, mend="Convert the log or name it by its format.")
    from rovid.readers.build_trial import build

    config = config.for_format(form.kind)
    files = trial_files(path, config)
    raw = _read_joined(path, files, config) if files else form.read(path, config)
    return build(raw, config, path, name or path.name)


# --- trials of several files -----------------------------------------------------------------------------------


def trial_files(path: Path, config: Config) -> list[Path]:
    """Files of the trial of ``path``, in the order of the parts; empty if [join] does not apply to ``path``."""
    root, join = config.path.parent.resolve(), config.join
    here = path.resolve()
    if join is None or not here.is_relative_to(root) or not join.part(here.relative_to(root).as_posix()):
        return []
    # The part is a word of the file's own name, or of its folder's.
    if join.part(here.name) or here.parent == root:
        near = path.parent.glob("*")
    else:
        near = (path.parent.parent if path.parent.name else here.parent.parent).glob("*/*")
    # Names are compared before files are opened: a folder may hold many.
    logs = [file for file in near if file.suffix.lower() in READERS and join.part(f"{file.parent.name}/{file.name}")]
    names = {file.resolve().relative_to(root).as_posix(): file for file in logs if file.is_file()}
    return [names[name] for name in join.files_of_trial(here.relative_to(root).as_posix(), names)]


def relative_name(file: Path, config: Config) -> str:
    """Name of a file in [join]: its path relative to rovid.toml."""
    return file.resolve().relative_to(config.path.parent.resolve()).as_posix()


def _read_joined(path: Path, files: list[Path], config: Config) -> RawLog:
    """Channels of all ``files`` of a trial, in the time of the first."""
    join = cast("Join", config.join)
    read: dict[Path, RawLog] = {}
    channels: dict[str, Channel] = {}
    owners: dict[str, RawLog] = {}
    remarks: list[Remark] = []
    for file in files:
        own = _own_config(file, config, join)
        if not own.signals:
            remarks.append(Remark(kind="skipped", count=1, text=f"{file.name} holds nothing that is mapped."))
            continue
        raw = READERS[file.suffix.lower()].read(file, own)
        for name, channel in _synchronised(file, raw, read, config).items():
            if name not in channels:
                channels[name] = channel
                owners[name] = raw
        read[file] = raw
        prefix = f"{file.name}: " if file != path else ""
        remarks += [replace(remark, text=prefix + remark.text) for remark in raw.remarks]
    for name in config.required_signals:
        if name in channels:
            continue
        kind = READERS[path.suffix.lower()].kind
        signal = config.mapped_signals(kind).get(name)
        wanted, near = f"the source of {name}", ""
        if signal is not None:
            wanted = f"{signal.sources[kind]!r}, which rovid.toml maps to {name}"
            if columns := [column for file in files if kind == "csv" for column in column_names(file)]:
                near = f" {suggestion(signal.sources[kind], columns)}"
        text = f"neither this nor the files joined with it hold {wanted}.{near}"
        raise LogError(text, where=path, mend="Correct the name, or parts in [join], in rovid.toml.")
    return RawLog(
        channels=channels,
        place=lambda name, index: owners[name].place(name, index),
        remarks=(*remarks, *_clock_remarks(list(read), config, join)),
        sortable=all(raw.sortable for raw in read.values()),
        epoch=next(iter(read.values())).epoch if read else None,
        companion_files=tuple(file for file in read if file != path),
    )


def all_channels(path: Path, config: Config) -> dict[Path, dict[str, Channel]]:
    """All channels of the files of a trial, by source, mapped or not, on the same clocks as in `read_log`."""
    read: dict[Path, RawLog] = {}
    found: dict[Path, dict[str, Channel]] = {}
    for file in trial_files(path, config):
        form = READERS[file.suffix.lower()]
        own = _own_config(file, config, cast("Join", config.join))
        sources = form.sources(file).sources
        signals = {name: Signal(name=name, sources={form.kind: name}, optional=True) for name in sources}
        if signals:
            raw = form.read(file, replace(own, signals=signals))
            found[file] = _synchronised(file, raw, read, config)
            read[file] = raw
    return found


def _own_config(file: Path, config: Config, join: Join) -> Config:
    """The part of ``config`` that is mapped to ``file``; all its signals are optional."""
    kind = READERS[file.suffix.lower()].kind
    config = config.for_format(kind)
    part = join.part(relative_name(file, config))
    time = config.time
    if part in join.time:
        column, unit = join.time[part]
        time = replace(time, sources={**time.sources, kind: column}, unit=unit)
    signals = {}
    for name, signal in config.mapped_signals(kind).items():
        if column := join.column_of(signal.sources[kind], relative_name(file, config)):
            signals[name] = replace(signal, sources={kind: column}, optional=True)
    if kind == "csv":  # Readers of messages skip missing sources themselves.
        from rovid.readers.csv_dialect import read_layout

        present = read_layout(file, ()).sources
        signals = {name: signal for name, signal in signals.items() if signal.sources[kind] in present}
    return replace(config, signals=signals, time=time, commands=(), measured_signal="")


def _synchronised(file: Path, raw: RawLog, before: Mapping[Path, RawLog], config: Config) -> dict[str, Channel]:
    """Channels of ``file`` in the time of the first file, with the clock correction of [join]."""
    shift = 0.0  # Time zero of the file in the time of the first one, s.
    if before:
        first, log = next(iter(before.items()))
        if (log.epoch is None) is not (raw.epoch is None):
            absolute, relative = (file, first) if log.epoch is None else (first, file)
            text = f"has no absolute time, and {absolute.name} has: their clocks cannot be synchronised."
            mend = "Log ISO 8601 or epoch times in both, or seconds from the same moment."
            raise LogError(text, where=relative, mend=mend)
        if log.epoch is not None and raw.epoch is not None:
            shift = raw.epoch - log.epoch
    offset, drift = cast("Join", config.join).clock_correction(relative_name(file, config))
    starts = [float(channel.time[np.isfinite(channel.time)].min(initial=np.inf)) for channel in raw.channels.values()]
    begin = min(starts, default=0.0)
    moved = {}
    for channel in raw.channels.values():
        since = channel.time - begin if np.isfinite(begin) else 0.0
        moved[id(channel.time)] = channel.time + (shift + offset + 1e-6 * drift * since)
    return {name: replace(channel, time=moved[id(channel.time)]) for name, channel in raw.channels.items()}


def _clock_remarks(files: list[Path], config: Config, join: Join) -> Iterator[Remark]:
    """Corrections of the clocks, or the assumption that they agree."""
    if len(files) < 2:
        return
    corrected = False
    for file in files:
        name = relative_name(file, config)
        offset, drift = join.clock_correction(name)
        if offset or drift:
            corrected = True
            # The correction of a part is the same in all trials; remarks on all trials are merged.
            clock = join.part(name) if join.is_corrected_by_part(name) else file.name
            more = f" and {drift:g} ppm more as it goes" if drift else ""
            text = f"The clock of {clock} was moved by {offset:+g} s{more}, as [join] in rovid.toml says."
            yield Remark(kind="clock", count=1, text=text)
    if not corrected:
        text = "Read from several files whose clocks are assumed to agree. An offset between them looks the same as a "
        text += "delay of the thrusters, so a command_delay found here may be an offset. Give a known offset in [join]."
        yield Remark(kind="joined", count=len(files), text=text)
