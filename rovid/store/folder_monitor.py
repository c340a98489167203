"""Monitor of a folder that receives logs: which logs are complete, each as it was read, once."""

import contextlib
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from rovid.core.errors import ConfigError, LogError, RovidError
from rovid.core.input_files import list_files
from rovid.readers import find_logs, read_trials
from rovid.readers.formats import trial_files
from rovid.store.study import config_files
from rovid.trial.assumptions import ConfigFingerprint
from rovid.trial.axis import Axis
from rovid.trial.config import FILE_NAME, Config, find_config, load_config
from rovid.trial.log_files import is_log
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


Clock = Callable[[], float]
# Stability of a file: it may be read, or it counts as finished even if its end is missing.
_READABLE, _FINAL = 1, 2


@dataclass(frozen=True, kw_only=True)
class Problem:
    """A problem in one sentence, or the message that it is ``resolved``."""

    where: str
    text: str
    resolved: bool = False


class ProblemLog:
    """Current problems. A problem is reported once, and again when its text changes."""

    def __init__(self) -> None:
        self._current: dict[str, str] = {}
        self._new: list[Problem] = []

    def report(self, where: object, text: str) -> None:
        """Add a problem."""
        if self._current.get(str(where)) != text:
            self._current[str(where)] = text
            self._new.append(Problem(where=str(where), text=text))

    def resolve(self, where: object, text: str = "") -> None:
        """Remove a problem; ``text`` reports the end of a known problem."""
        if self._current.pop(str(where), None) is not None and text:
            self._new.append(Problem(where=str(where), text=text, resolved=True))

    def take_new(self) -> Iterator[Problem]:
        """Unreported problems, each once."""
        while self._new:
            yield self._new.pop(0)


@dataclass(kw_only=True, eq=False)
class FolderMonitor:
    """A folder that is polled.

    Sizes and modification times are compared, which works on any network share. Notifications of the operating system
    do not report files that another machine writes. The age of a state is measured by this machine's monotonic clock.
    """

    path: Path
    axis: Axis
    # settled, abandoned: times in s without changes before a file is read, or is used without a proper end
    settled: float = 5.0
    abandoned: float = 60.0
    once: bool = False  # Whether the first poll takes all logs as they are
    clock: Clock = time.monotonic
    problems: ProblemLog = field(default_factory=ProblemLog)
    logs: Mapping[Path, WatchedLog] = field(default_factory=dict)  # The accepted logs
    # Stamp of each file, None if it is gone, and the time in s since when the stamp is the same
    _states: dict[Path, tuple[Stamp | None, float]] = field(default_factory=dict)
    _read: dict[Path, WatchedLog] = field(default_factory=dict)
    _settings: FileStamps = ()
    _previous: tuple[Mapping[Path, WatchedLog], FileStamps] = field(default_factory=lambda: ({}, ()))
    _snapshot: object = None
    _change: FolderChange | None = None

    def poll(self) -> FolderChange | None:
        """The change since `accept`; None if there is none."""
        try:
            # Stamps of all possible logs and of the settings.
            if not self.path.is_dir():
                raise FileNotFoundError
            files = [file for file in list_files(self.path, _reraise).files if is_log(file)]
            stamps = dict(stamps_of([*files, *config_files([self.path])]))
            now = self.clock()
            for path in {**self._states, **stamps}:
                stamp = stamps.get(path)
                if path not in self._states or self._states[path][0] != stamp:
                    self._states[path] = stamp, now
            # A file that is gone is remembered as long as its log is in use.
            gone = [path for path, (stamp, _) in self._states.items() if stamp is None and self._stability(path)]
            for path in set(gone) - files_of(self.logs.values()):
                del self._states[path]
            snapshot = [(path, stamp, self._stability(path)) for path, (stamp, _) in self._states.items()]
            if snapshot != self._snapshot:
                self._snapshot = snapshot
                self._change = self._compare()
        except OSError as error:
            is_missing = isinstance(error, FileNotFoundError)
            fault = "is not there" if is_missing else f"cannot be read ({error.strerror or error})"
            self.problems.report(self.path, f"{fault}; waiting for it.")
            self._snapshot = None
            return None
        return self._change

    def accept(self, change: FolderChange) -> None:
        """Make the changed state the reference."""
        self._previous = self.logs, self._settings
        self.logs, self._settings = change.logs, change.settings_files
        self._snapshot = None

    def revert(self) -> None:
        """Return to the state before the last `accept`, which will be tried again."""
        self.logs, self._settings = self._previous
        self._snapshot = None

    def _stability(self, path: Path) -> int:
        """0 if the file changed recently, else `_READABLE` or `_FINAL`."""
        if self.once:
            return _FINAL
        if path not in self._states:
            return 0
        age = self.clock() - self._states[path][1]
        return (age >= self.settled) + (age >= max(self.abandoned, self.settled))

    def _compare(self) -> FolderChange | None:
        """Change of the folder; logs that are being written or have a fault are excluded."""
        # A dictionary keeps the order of the files.
        present = dict.fromkeys(path for path, (stamp, _) in self._states.items() if stamp is not None)
        if any(path not in present and not self._stability(path) for path in files_of(self.logs.values())):
            return None
        lost = bool(self.logs) and not any(path in present for path in self.logs)
        if lost:
            self.problems.report(self.path, "holds none of its logs any more. The results so far stay valid.")
        if not self.logs and not any(map(is_log, present)):
            self.problems.report(self.path, "holds no log yet; waiting.")
            return None
        config = self._load_config(lost=lost)
        if config is None:
            return None
        unstable = frozenset(path for path in present if is_log(path) and not self._stability(path))
        try:
            found, _ = find_logs([self.path], config, unstable - self.logs.keys())
        except LogError as error:
            if isinstance(error.__cause__, OSError):
                self._snapshot = None
            if not self.logs:
                text = "holds no complete log yet; waiting." if unstable else f"{error} Waiting."
                self.problems.report(self.path, text)
            return None
        self.problems.resolve(self.path, "is there again." if self.logs else "")
        logs, excluded = self._usable_logs(found, config, present)
        self._read = {path: log for path, log in self._read.items() if path in excluded or path in logs}
        return self._difference(logs, unstable.union(*excluded.values()) - files_of(logs.values()))

    def _load_config(self, *, lost: bool) -> Config | None:
        """The rovid.toml; None if it is missing, being edited or invalid."""
        files = config_files([self.path])
        if self.logs and not any(file.name == FILE_NAME for file in files):
            # If the logs are gone as well, that is reported already.
            if not lost:
                self.problems.report(FILE_NAME, "is gone; waiting for it.")
            return None
        if not all(map(self._stability, files)):
            return None
        try:
            config = load_config(find_config([self.path]), self.axis)
        except ConfigError as error:
            self.problems.report(FILE_NAME, str(error))
            return None
        self.problems.resolve(FILE_NAME, "can be used now.")
        return config

    def _usable_logs(
        self, found: Sequence[tuple[str, Path]], config: Config, present: Collection[Path]
    ) -> tuple[dict[Path, WatchedLog], dict[Path, list[Path]]]:
        """Usable logs, and the files of each excluded log."""
        logs: dict[Path, WatchedLog] = {}
        excluded: dict[Path, list[Path]] = {}
        for name, path in found:
            # Files that are read as one log.
            others = trial_files(path, config)
            if path.suffix.lower() == ".nmea":
                others = [file for file in present if file.with_suffix("") == path.with_suffix("")]
            files = [path, *(file for file in others if file != path)]
            known = self.logs.get(path)
            if stability := min(map(self._stability, files)):
                log = self._read_once(name, stamps_of(files), config)
                if log is not None and (stability == _FINAL or not (log.cut or log.fault)):
                    if not log.fault:
                        self.problems.resolve(log.path, "can be used now.")
                        logs[path] = log
                        continue
                    self.problems.report(log.path, f"{log.fault} The log is left out until it changes.")
                    known = None
            # While a log is being rewritten its previous content is used.
            if known is not None and known.settings == config.fingerprint:
                logs[path] = known
            else:
                excluded[path] = files
        return logs, excluded

    def _read_once(self, name: str, file_stamps: FileStamps, config: Config) -> WatchedLog | None:
        """A log, read if it changed; None if the system cannot read it for now."""
        if not file_stamps:
            return None
        path = file_stamps[0][0]
        known, key = self._read.get(path), (name, file_stamps, config.fingerprint)
        if known is not None and (known.name, known.file_stamps, known.settings) == key:
            return known
        self._read[path] = log = read_watched_log(name, file_stamps, config)
        if log.fault == UNAVAILABLE:
            del self._read[path]
            self._snapshot = None
            return None
        return log

    def _difference(self, logs: dict[Path, WatchedLog], excluded: frozenset[Path]) -> FolderChange | None:
        """Difference to the accepted state; after the first poll new logs are added one at a time."""
        new = sorted((logs[path] for path in logs.keys() - self.logs.keys()), key=lambda log: (log.written, log.name))
        removed = [self.logs[path] for path in self.logs.keys() - logs.keys()]
        renamed = []
        for before in removed.copy():
            after = next((log for log in new if log.stamps == before.stamps), None)
            if after is not None:
                removed.remove(before)
                new.remove(after)
                renamed.append((before, after))
        later = new[1:] if self.logs and not self.once else []
        del new[len(new) - len(later) :]
        for log in later:
            del logs[log.path]
        replaced = [log for path, log in logs.items() if path in self.logs and self.logs[path] is not log]
        settings_files = stamps_of(config_files([self.path]))
        settings = bool(self.logs) and settings_files != self._settings
        if not (new or removed or renamed or replaced or settings):
            return None
        return FolderChange(
            logs=logs,
            excluded=excluded | files_of(later),
            settings_files=settings_files,
            added=tuple(new),
            replaced=tuple(replaced),
            removed=tuple(sorted(removed, key=lambda log: log.name)),
            renamed=tuple(renamed),
            settings=settings,
        )


def _reraise(error: OSError) -> None:
    raise error
