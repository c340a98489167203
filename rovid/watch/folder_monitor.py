"""A folder that logs come into: which of them are whole by now, each read once, whatever else happens to the folder."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from rovid.core.errors import ConfigError, LogError, RovidError
from rovid.core.paths import list_files
from rovid.readers import READERS, find_logs, read_trials
from rovid.readers.formats import trial_files
from rovid.store.study import config_files
from rovid.trial.axis import Axis
from rovid.trial.config import FILE_NAME, Config, find_config, load_config
from rovid.trial.config_fingerprint import ConfigFingerprint
from rovid.trial.trial import Remark, Trial

Clock = Callable[[], float]
# Size in bytes, and when it was written by the clock of whoever wrote it: told from another one, never counted with.
Stamp = tuple[int, int]
FileStamps = tuple[tuple[Path, Stamp], ...]


@dataclass(frozen=True, kw_only=True)
class SettleTimes:
    """How long in s a file has to stay as it is: ``whole`` before it is read, ``cut`` where no end is found in it."""

    whole: float = 5.0
    cut: float = 60.0


@dataclass(frozen=True, kw_only=True, eq=False)
class WatchedLog:
    """A log as it was read.

    Attributes
    ----------
    family
        Its files, the one that it is called by first, and their stamps.
    settings
        What of rovid.toml it was read by.
    trials, remarks
        What it holds, and what was noticed of it as a whole; no trials where it cannot be used.
    fault
        Why not.
    cut
        What its reader says of an end that is missing; empty where it is whole.
    """

    name: str
    file_stamps: FileStamps
    settings: ConfigFingerprint
    trials: tuple[Trial, ...] = ()
    remarks: tuple[Remark, ...] = ()
    fault: str = ""
    cut: str = ""

    @property
    def path(self) -> Path:
        """The file that it is called by."""
        return self.file_stamps[0][0]

    @property
    def stamps(self) -> tuple[Stamp, ...]:
        """Of its files."""
        return tuple(stamp for _, stamp in self.file_stamps)

    @property
    def written(self) -> int:
        """When the last of its files was, in ns by the clock of whoever wrote it."""
        return max(stamp[1] for stamp in self.stamps)

    @property
    def seconds(self) -> float:
        """How long its trials are."""
        return sum(trial.duration for trial in self.trials)

    @property
    def samples(self) -> int:
        """How many positions were measured."""
        return sum(int(trial.measured.sum()) for trial in self.trials)


@dataclass(frozen=True, kw_only=True, eq=False)
class FolderChange:
    """What has become of the folder.

    Attributes
    ----------
    logs
        Those to go by from now on, by their files.
    without
        Files that are there and are to be left alone for now.
    added, replaced
        Logs that are new, and those whose content is another.
    removed
        Logs that are gone.
    renamed
        A log as it was called, and as it is.
    settings
        Whether rovid.toml, or a thrust curve, is another.
    settings_files
        Those, and their stamps.
    """

    logs: Mapping[Path, WatchedLog]
    excluded: frozenset[Path]
    settings_files: FileStamps
    added: tuple[WatchedLog, ...] = ()
    replaced: tuple[WatchedLog, ...] = ()
    removed: tuple[WatchedLog, ...] = ()
    renamed: tuple[tuple[WatchedLog, WatchedLog], ...] = ()
    settings: bool = False

    def reading(self, path: Path, config: Config, name: str, remarks: list[Remark]) -> list[Trial]:
        """What was read of a log; nothing of one that came since, or is called by another name."""
        log = self.logs.get(path)
        if log is None or log.name != name:
            return []
        if log.settings != config.fingerprint:
            raise ConfigError("is being edited.", where=config.path, mend="It is read again when that is done.")
        remarks += log.remarks
        return list(log.trials)


@dataclass(frozen=True, kw_only=True)
class Problem:
    """Something in the way, in a sentence; or, where it is ``over``, that it is not any more."""

    where: str
    text: str
    resolved: bool = False


class ProblemLog:
    """What is in the way, told when it is new or another."""

    def __init__(self) -> None:
        self._known: dict[str, str] = {}
        self._untold: list[Problem] = []

    def report(self, where: object, text: str) -> None:
        """There is this."""
        if self._known.get(str(where)) != text:
            self._known[str(where)] = text
            self._untold.append(Problem(where=str(where), text=text))

    def resolve(self, where: object, text: str = "") -> None:
        """There is nothing any more; ``text`` is told where there was."""
        if self._known.pop(str(where), None) is not None and text:
            self._untold.append(Problem(where=str(where), text=text, resolved=True))

    def take_new(self) -> Iterator[Problem]:
        """Each once."""
        while self._untold:
            yield self._untold.pop(0)


@dataclass(kw_only=True, eq=False)
class _Sight:
    """What was seen of a file: its stamp, None where it is gone, and since when that is so."""

    stamp: Stamp | None
    since: float


@dataclass(kw_only=True, eq=False)
class FolderMonitor:
    """A folder that is looked at again and again.

    Sizes and times of writing are compared, which works on any share; what the system tells of its own accord it does
    not tell of files that another machine writes. How long a file has been as it is goes by this machine's own
    steady clock: no clock that is set in between matters.

    Attributes
    ----------
    at_once
        Whether all is taken as it is at the first look.
    logs
        Those that were taken.
    """

    path: Path
    axis: Axis
    patience: SettleTimes = field(default_factory=SettleTimes)
    once: bool = False
    clock: Clock = time.monotonic
    problems: ProblemLog = field(default_factory=ProblemLog)
    logs: Mapping[Path, WatchedLog] = field(default_factory=dict)
    _sights: dict[Path, _Sight] = field(default_factory=dict)
    _read: dict[Path, WatchedLog] = field(default_factory=dict)
    _settings: FileStamps = ()
    _before: tuple[Mapping[Path, WatchedLog], FileStamps] = field(default_factory=lambda: ({}, ()))
    _picture: object = None
    _change: FolderChange | None = None

    def poll(self) -> FolderChange | None:
        """What has become of the folder since `take`; None where all is as it was."""
        try:
            self._see(self._stamps())
            picture = [(path, sight.stamp, self._rest(path)) for path, sight in self._sights.items()]
            if picture != self._picture:
                self._picture = picture
                self._change = self._compared()
        except OSError as error:
            self._lost(error)
            return None
        return self._change

    def accept(self, change: FolderChange) -> None:
        """Go by ``change`` from now on."""
        self._before = self.logs, self._settings
        self.logs, self._settings = change.logs, change.settings_files
        self._picture = None

    def revert(self) -> None:
        """Go by what was gone by before the last `take`, which is to be tried again."""
        self.logs, self._settings = self._before
        self._picture = None

    def _lost(self, error: OSError) -> None:
        what = "is not there" if isinstance(error, FileNotFoundError) else f"cannot be read ({error.strerror or error})"
        self.problems.report(self.path, f"{what}; waiting for it.")
        self._picture = None

    def _stamps(self) -> dict[Path, Stamp]:
        """Of every file that may be a log, and of what says how to read them."""
        if not self.path.is_dir():
            raise FileNotFoundError
        files = [file for file in list_files(self.path, _raised).files if file.suffix.lower() in READERS]
        return dict(self._family([*files, *config_files([self.path])]))

    def _family(self, files: Iterable[Path]) -> FileStamps:
        return tuple((path, stamp) for path in files if (stamp := _stamp(path)) is not None)

    def _see(self, stamps: Mapping[Path, Stamp]) -> None:
        now = self.clock()
        for path in {**self._sights, **stamps}:
            known, stamp = self._sights.get(path), stamps.get(path)
            if known is None or known.stamp != stamp:
                self._sights[path] = _Sight(stamp=stamp, since=now)
        gone = [path for path, sight in self._sights.items() if sight.stamp is None and self._rest(path)]
        # It is remembered until the logs that were taken of it are let go.
        taken = {path for log in self.logs.values() for path, _ in log.file_stamps}
        for path in gone:
            if path not in taken:
                del self._sights[path]

    def _rest(self, path: Path) -> int:
        """How long a file has been as it is: 1 for long enough to be read, 2 for long enough to be done for."""
        if self.once:
            return 2
        sight = self._sights.get(path)
        if sight is None:
            return 0
        age = self.clock() - sight.since
        return (age >= self.patience.whole) + (age >= max(self.patience.cut, self.patience.whole))

    def _compared(self) -> FolderChange | None:
        """The folder as it is beside what was taken; what is being written, or is not understood, is left alone."""
        there = {path: sight.stamp for path, sight in self._sights.items() if sight.stamp is not None}
        if any(path not in there and not self._rest(path) for log in self.logs.values() for path, _ in log.file_stamps):
            return None
        lost = bool(self.logs) and not any(path in there for path in self.logs)
        if lost:
            self.problems.report(self.path, "holds none of its logs any more: what was found so far stands.")
        if not self.logs and all(path.suffix.lower() not in READERS for path in there):
            self.problems.report(self.path, "holds no log yet; waiting.")
            return None
        config = self._config(lost=lost)
        if config is None:
            return None
        fresh = frozenset(path for path in there if path.suffix.lower() in READERS and not self._rest(path))
        try:
            found, _ = find_logs([self.path], config, fresh - self.logs.keys())
        except LogError as error:
            if isinstance(error.__cause__, OSError):
                self._picture = None
            if not self.logs:
                self.problems.report(self.path, "holds no whole log yet; waiting." if fresh else f"{error} Waiting.")
            return None
        self.problems.resolve(self.path, "is there again." if self.logs else "")
        logs, left = self._usable(found, config, there)
        for path in [path for path in self._read if path not in left and path not in logs]:
            del self._read[path]
        return self._difference(logs, fresh.union(*left.values()) - _files_of(logs.values()))

    def _config(self, *, lost: bool) -> Config | None:
        """What says how to read the logs; None where it is not there, is being edited, or is wrong."""
        files = config_files([self.path])
        if self.logs and not any(file.name == FILE_NAME for file in files):
            # With its logs it is gone for the same reason, which was said.
            if not lost:
                self.problems.report("rovid.toml", "is gone; waiting for it.")
            return None
        if not all(map(self._rest, files)):
            return None
        try:
            config = load_config(find_config([self.path]), self.axis)
        except ConfigError as error:
            self.problems.report("rovid.toml", str(error))
            return None
        self.problems.resolve("rovid.toml", "can be used now.")
        return config

    def _usable(
        self, found: Sequence[tuple[str, Path]], config: Config, there: Mapping[Path, Stamp]
    ) -> tuple[dict[Path, WatchedLog], dict[Path, list[Path]]]:
        """Logs that can be gone by, and the files of each other one."""
        logs: dict[Path, WatchedLog] = {}
        left: dict[Path, list[Path]] = {}
        for name, path in found:
            files = _together(path, config, there)
            rest = min(self._rest(file) for file in files)
            known = self.logs.get(path)
            if rest:
                log = self._once(name, self._family(files), config)
                if log is not None and _is_ready(log, rest):
                    self._tell(log)
                    if not log.fault:
                        logs[path] = log
                        continue
                    known = None
            if known is not None and known.settings == config.fingerprint:
                # It is being written anew: what it held is gone by until that is done.
                logs[path] = known
            else:
                left[path] = files
        return logs, left

    def _once(self, name: str, family: FileStamps, config: Config) -> WatchedLog | None:
        """A log, read if it is not as it was; None where the system is in the way, which may be over soon."""
        path = family[0][0] if family else None
        if path is None:
            return None
        known = self._read.get(path)
        if known is not None and (known.name, known.file_stamps, known.settings) == (name, family, config.fingerprint):
            return known
        self._read[path] = log = _read(name, family, config)
        if log.fault == _AWAY:
            del self._read[path]
            self._picture = None
            return None
        return log

    def _tell(self, log: WatchedLog) -> None:
        if log.fault:
            self.problems.report(log.path, f"{log.fault} It is left out until it changes.")
        else:
            self.problems.resolve(log.path, "can be used now.")

    def _difference(self, logs: dict[Path, WatchedLog], without: frozenset[Path]) -> FolderChange | None:
        """What is other than what was taken: of new logs one at a time, but for those of the first look."""
        new = sorted((logs[path] for path in logs.keys() - self.logs.keys()), key=lambda log: (log.written, log.name))
        gone = [self.logs[path] for path in self.logs.keys() - logs.keys()]
        renamed = []
        for before in gone.copy():
            after = next((log for log in new if log.stamps == before.stamps), None)
            if after is not None:
                gone.remove(before)
                new.remove(after)
                renamed.append((before, after))
        later = new[1:] if self.logs and not self.once else []
        new = new[: len(new) - len(later)]
        for log in later:
            del logs[log.path]
        replaced = [log for path, log in logs.items() if path in self.logs and self.logs[path] is not log]
        files = self._family(config_files([self.path]))
        settings = bool(self.logs) and files != self._settings
        if not (new or gone or renamed or replaced or settings):
            return None
        return FolderChange(
            logs=logs,
            excluded=without | _files_of(later),
            settings_files=files,
            added=tuple(new),
            replaced=tuple(replaced),
            removed=tuple(sorted(gone, key=lambda log: log.name)),
            renamed=tuple(renamed),
            settings=settings,
        )


# What the system had against reading a file; a share that comes back has it no more.
_AWAY = "away"


def _read(name: str, family: FileStamps, config: Config) -> WatchedLog:
    """Read a log, and see whether its commands are within the thrust curves."""
    path, remarks = family[0][0], list[Remark]()
    try:
        trials = read_trials(path, config, name, remarks)
        for trial in trials:
            config.vehicle.with_logged_torque([trial]).torque(trial)
    except RovidError as error:
        fault = _AWAY if isinstance(error.__cause__, OSError) else str(error)
        return WatchedLog(name=name, file_stamps=family, settings=config.fingerprint, fault=fault)
    cut = [remark.text for trial in trials for remark in trial.remarks if remark.kind == "truncated"]
    return WatchedLog(
        name=name,
        file_stamps=family,
        settings=config.fingerprint,
        trials=tuple(trials),
        remarks=tuple(remarks),
        cut=next(iter(cut), ""),
    )


def _is_ready(log: WatchedLog, rest: int) -> bool:
    """Whether to go by what was read, or to wait for the rest of it."""
    return rest > 1 or not (log.cut or log.fault)


def _together(path: Path, config: Config, there: Collection[Path]) -> list[Path]:
    """The files that are read as one log with ``path``, which comes first."""
    if path.suffix.lower() == ".nmea":
        others = [file for file in there if file.with_suffix("") == path.with_suffix("")]
    else:
        others = trial_files(path, config)
    return [path, *(file for file in others if file != path)]


def _files_of(logs: Iterable[WatchedLog]) -> frozenset[Path]:
    return frozenset(path for log in logs for path, _ in log.file_stamps)


def _stamp(path: Path) -> Stamp | None:
    with contextlib.suppress(OSError):
        found = path.stat()
        return found.st_size, found.st_mtime_ns
    return None


def _raised(error: OSError) -> None:
    raise error
