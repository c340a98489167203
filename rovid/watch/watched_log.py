"""A log in a watched folder as it was read, and the changes of such a folder."""

from __future__ import annotations

import contextlib
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from rovid.core.errors import ConfigError, RovidError
from rovid.readers import READERS, read_trials
from rovid.readers.formats import trial_files
from rovid.trial.config import Config
from rovid.trial.config_fingerprint import ConfigFingerprint
from rovid.trial.trial import Remark, Trial

# Size in bytes and modification time in ns. Stamps are only compared for equality: another machine may write the files.
Stamp = tuple[int, int]
FileStamps = tuple[tuple[Path, Stamp], ...]
# Fault of a log that the system could not read for now, as on a network share that is away.
UNAVAILABLE = "unavailable"


@dataclass(frozen=True, kw_only=True, eq=False)
class WatchedLog:
    """A log as it was read."""

    name: str
    file_stamps: FileStamps  # Its files with their stamps, the main file first
    settings: ConfigFingerprint  # Fingerprint of the rovid.toml it was read with
    # trials, remarks: its content and remarks on the whole log; no trials if the log cannot be used
    trials: tuple[Trial, ...] = ()
    remarks: tuple[Remark, ...] = ()
    fault: str = ""  # Reason why the log cannot be used; else empty
    cut: str = ""  # The reader's remark on a missing end; else empty

    @property
    def path(self) -> Path:
        """The main file."""
        return self.file_stamps[0][0]

    @property
    def files(self) -> frozenset[Path]:
        """All files."""
        return frozenset(path for path, _ in self.file_stamps)

    @property
    def stamps(self) -> tuple[Stamp, ...]:
        """Stamps of its files."""
        return tuple(stamp for _, stamp in self.file_stamps)

    @property
    def written(self) -> int:
        """Latest modification time of its files in ns."""
        return max(written for _, written in self.stamps)

    @property
    def seconds(self) -> float:
        """Duration of its trials in s."""
        return sum(trial.duration for trial in self.trials)

    @property
    def samples(self) -> int:
        """Number of measured positions."""
        return sum(int(trial.measured.sum()) for trial in self.trials)


@dataclass(frozen=True, kw_only=True, eq=False)
class FolderChange:
    """A change of the folder since the last accepted state."""

    logs: Mapping[Path, WatchedLog]  # All usable logs, by their main file
    excluded: frozenset[Path]  # Files in the folder that are not used for now
    settings_files: FileStamps  # rovid.toml and thrust curves with their stamps
    # added, replaced, removed: new logs, logs with new content, and logs that are gone
    added: tuple[WatchedLog, ...] = ()
    replaced: tuple[WatchedLog, ...] = ()
    removed: tuple[WatchedLog, ...] = ()
    renamed: tuple[tuple[WatchedLog, WatchedLog], ...] = ()  # Pairs of a log under its old and its new name
    settings: bool = False  # Whether rovid.toml or a thrust curve changed

    def reading(self, path: Path, config: Config, name: str, remarks: list[Remark]) -> list[Trial]:
        """Trials of a log as it was read; none if the log came later or has another name."""
        log = self.logs.get(path)
        if log is None or log.name != name:
            return []
        if log.settings != config.fingerprint:
            raise ConfigError("is being edited.", where=config.path, mend="rovid reads it again after the edit.")
        remarks += log.remarks
        return list(log.trials)


def read_watched_log(name: str, file_stamps: FileStamps, config: Config) -> WatchedLog:
    """Read a log and check its commands against the thrust curves."""
    path, remarks = file_stamps[0][0], list[Remark]()
    try:
        trials = read_trials(path, config, name, remarks)
        for trial in trials:
            config.vehicle.with_logged_torque([trial]).torque(trial)
    except RovidError as error:
        fault = UNAVAILABLE if isinstance(error.__cause__, OSError) else str(error)
        return WatchedLog(name=name, file_stamps=file_stamps, settings=config.fingerprint, fault=fault)
    cut = [remark.text for trial in trials for remark in trial.remarks if remark.kind == "truncated"]
    return WatchedLog(
        name=name,
        file_stamps=file_stamps,
        settings=config.fingerprint,
        trials=tuple(trials),
        remarks=tuple(remarks),
        cut=next(iter(cut), ""),
    )


def files_with(path: Path, config: Config, present: Collection[Path]) -> list[Path]:
    """Files that are read as one log with ``path``, which comes first."""
    if path.suffix.lower() == ".nmea":
        others = [file for file in present if file.with_suffix("") == path.with_suffix("")]
    else:
        others = trial_files(path, config)
    return [path, *(file for file in others if file != path)]


def is_log(path: Path) -> bool:
    """Whether the suffix is that of a log."""
    return path.suffix.lower() in READERS


def files_of(logs: Iterable[WatchedLog]) -> frozenset[Path]:
    """Files of all logs."""
    return frozenset().union(*(log.files for log in logs))


def stamps_of(files: Iterable[Path]) -> FileStamps:
    """Stamps of the files that exist."""
    stamps = []
    for path in files:
        with contextlib.suppress(OSError):
            status = path.stat()
            stamps.append((path, (status.st_size, status.st_mtime_ns)))
    return tuple(stamps)
