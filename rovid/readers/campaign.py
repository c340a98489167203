"""The logs in files and folders, and all of them as trials: read, without duplicates, in order of time."""

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from collections.abc import Set as AbstractSet
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.budget import Budget, ProgressCallback
from rovid.core.errors import LogError, RovidError, quoted_list, shortened_list, suggestion
from rovid.core.input_files import file_parts, list_files, require_exists
from rovid.core.output_files import own_output
from rovid.core.spmd import ForkedCall
from rovid.faults.base import CampaignData, detectors_at, examine
from rovid.readers.formats import read_log, trial_files
from rovid.trial.axis import Axis
from rovid.trial.config import Config, find_config, load_config
from rovid.trial.fault import Fault
from rovid.trial.log_files import FORMATS, QUALIFIER, is_log, nothing_to_read
from rovid.trial.preprocessing import split
from rovid.trial.tables import CURVE_COLUMNS, PULL_COLUMNS, SINE_COLUMNS, STEADY_COLUMNS, has_time
from rovid.trial.trial import Campaign, Remark, Trial

# Columns of tables that may lie among logs; a log has a time column, too.
_TABLES = (frozenset(CURVE_COLUMNS), frozenset(STEADY_COLUMNS), frozenset(SINE_COLUMNS) - {"torque_amplitude_Nm"})
_MAX_NAMES_IN_MESSAGE = 5


@dataclass(frozen=True, kw_only=True)
class _File:
    """A candidate log; ``asked`` if the user named the file itself rather than its folder."""

    path: Path
    name: str
    asked: bool

    @property
    def kind(self) -> str:
        """Format; empty if unknown."""
        return FORMATS.get(self.path.suffix.lower(), "")


def find_logs(
    paths: Sequence[Path], config: Config, without: Collection[Path] = ()
) -> tuple[list[tuple[str, Path]], list[Remark]]:
    """(name, file) of every log in ``paths``, ordered by name; and remarks. No log is read.

    Files in ``without`` are ignored. Raises `LogError` if a path does not exist, or there are no logs.
    """
    remarks: list[Remark] = []
    files = [one for one in _files_in(paths, remarks) if one.path not in without]
    # Each file once, even if two of the paths lead to it.
    unique: dict[Path, _File] = {}
    for one in files:
        known = unique.setdefault(one.path.resolve(), one)
        if known is not one:
            remarks.append(left_out(one.name, f"it is the same file as {known.name}", "repeated"))
    # Files ordered by name; files of the same name in two folders are named by their paths.
    counts = Counter(one.name for one in unique.values())
    named = [one if counts[one.name] == 1 else replace(one, name=one.path.as_posix()) for one in unique.values()]
    files = sorted(named, key=lambda one: one.name)
    if config.maps_format("nmea"):
        # Without the logs of the same name as an NMEA text, which are read together with it.
        stems = {one.path.with_suffix("") for one in files if one.kind == "nmea"}
        files = [one for one in files if one.kind == "nmea" or one.path.with_suffix("") not in stems]
    if config.join is not None:
        files = _first_files_of_trials(files, config)
    # A table given alone is read as a log: the error then names what it lacks.
    logs = [one for one in files if _is_log(one, config, remarks)] or [one for one in files if one.asked]
    if not logs:
        raise _no_logs(paths, files, config)
    remarks += _unmatched_exclusions(logs, config)
    return [(one.name, one.path) for one in logs], remarks


def config_without_logs(paths: Sequence[Path], axis: Axis) -> Config | None:
    """The rovid.toml of ``paths`` if these hold no log yet, nothing but tables; otherwise None."""
    config = load_config(find_config(paths), axis)
    files = _files_in(paths, [])
    return config if all(one.kind == "csv" and _is_table(_column_names(one, config), config) for one in files) else None


def candidate_files(paths: Sequence[Path]) -> list[Path]:
    """Every file in ``paths`` that may be a log or a table, by its suffix."""
    return [one.path for one in _files_in(list(filter(Path.exists, paths)), [])]


def left_out(name: str, reason: str, kind: str = "skipped") -> Remark:
    """Remark on a file that was left out."""
    return Remark(kind=kind, count=1, text=f"{name} was left out: {reason}.")


def _files_in(paths: Sequence[Path], remarks: list[Remark]) -> list[_File]:
    """The files themselves, and those in folders, by name."""
    found = []
    for path in paths:
        require_exists(path, LogError)
        if not path.is_dir():
            found.append(_File(path=path, name=path.name, asked=True))
            continue
        inside = list_files(path, _unreadable)
        remarks += [
            left_out(item.relative_to(path).as_posix(), f"it is {what}") for item, what in inside.special_files.items()
        ]
        names = {item.relative_to(path).as_posix(): item for item in inside.files if is_log(item)}
        written: dict[str, list[str]] = {}
        for name, item in sorted(names.items()):
            if kind := own_output(item):
                written.setdefault(kind, []).append(name)
            else:
                found.append(_File(path=item, name=name, asked=False))
        for kind, own in written.items():
            were = "was left out: it" if len(own) == 1 else "were left out: each"
            text = f"{shortened_list(own)} {were} is {kind}, no log."
            remarks.append(Remark(kind="skipped", count=len(own), text=text))
    return found


def _unreadable(error: OSError) -> None:
    raise LogError(f"cannot be read ({error.strerror}).", where=error.filename) from error


def _first_files_of_trials(files: Sequence[_File], config: Config) -> list[_File]:
    """The first file of each trial; its other files are read together with it."""
    firsts: dict[Path, _File] = {}
    read: set[Path] = set()
    for one in files:
        if one.path.resolve() in read:
            continue
        together = trial_files(one.path, config) or [one.path]
        read |= {path.resolve() for path in together}
        firsts[together[0]] = replace(one, path=together[0])
    for one in files:
        if one.path in firsts:
            firsts[one.path] = one
    return list(firsts.values())


def _is_log(one: _File, config: Config, remarks: list[Remark]) -> bool:
    """Whether a file is a log; a folder may hold tables and other files, too."""
    from rovid.readers.csv_dialect import is_datum, plain_name

    if one.kind != "csv":
        is_mapped = one.asked or one.kind == "mcap" or config.maps_format(one.kind)
        if not is_mapped:
            remarks.append(left_out(one.name, f"rovid.toml maps nothing for {one.kind} logs"))
        return is_mapped
    names = _column_names(one, config)
    if names is None:
        return True  # Reading reports the error.
    if _is_table(names, config):
        if one.asked:
            remarks.append(left_out(one.name, "it is a table, no log"))
        return False
    if one.asked or set(map(plain_name, names)) & set(map(plain_name, _mapped_columns(config))):
        return True
    why = "it holds none of the columns that rovid.toml maps, so it is no log"
    if names and all(map(is_datum, names)):
        why = "its first line holds numbers and no names. If it is a log, give it the header of the others"
    remarks.append(left_out(one.name, why))
    return False


def _mapped_columns(config: Config) -> set[str]:
    """Columns of the time and of the signals in CSV files."""
    columns = {config.time.sources.get("csv", "")}
    columns |= {signal.sources["csv"] for signal in config.mapped_signals("csv").values()}
    return columns | {column.partition(QUALIFIER)[2] for column in columns if QUALIFIER in column}


def _column_names(one: _File, config: Config) -> AbstractSet[str] | None:
    """Names of the columns of a CSV file; None where it cannot be read."""
    from rovid.readers.csv_dialect import read_layout

    try:
        return read_layout(one.path, _mapped_columns(config)).sources
    except (OSError, LogError):
        return None


def _is_table(names: AbstractSet[str] | None, config: Config) -> bool:
    """Whether these columns are those of a table, which has no time."""
    if names is None or config.time.sources.get("csv", "") in names:
        return False
    return any(columns <= names for columns in _TABLES) or (not names.isdisjoint(PULL_COLUMNS) and not has_time(names))


def _unmatched_exclusions(logs: Sequence[_File], config: Config) -> Iterator[Remark]:
    """Remarks on exclusions that match no log, here or near rovid.toml."""
    names = [one.name for one in logs]
    for exclusion in config.exclusions:
        if any(map(exclusion.applies_to, names)):
            continue
        folder = config.path.parent
        others = [path.relative_to(folder).as_posix() for path in list_files(folder, _unreadable).files]
        if not any(map(exclusion.applies_to, others)):
            text = f"[[leave_out]] of {exclusion.log!r} was ignored: no log has this name."
            yield Remark(kind="skipped", count=1, text=f"{text} {suggestion(exclusion.log, names)}")


def _no_logs(paths: Sequence[Path], files: Sequence[_File], config: Config) -> RovidError:
    if not files:
        return nothing_to_read(paths)
    names = [one.name for one in files]
    if len(names) > _MAX_NAMES_IN_MESSAGE:
        names[_MAX_NAMES_IN_MESSAGE:] = ["…"]
    others = sorted({one.kind for one in files} - {"csv"})
    noun = ("file" if others else "table") + "s" * (len(files) > 1)
    unmapped = f", and rovid.toml maps nothing for {' or '.join(others)} logs" if others else ""
    mapped = quoted_list(sorted(_mapped_columns(config) - {""})[:_MAX_NAMES_IN_MESSAGE])
    text = f"holds {len(files)} {noun} ({', '.join(names)}) but no log: "
    text += f"none has a column that rovid.toml maps ({mapped}){unmapped}."
    mend = "Correct [signals] in rovid.toml, or give the folder that holds the logs."
    return LogError(text, where=", ".join(map(str, paths)), mend=mend)


# Bytes; larger logs are not prefetched.
_LARGE = 20_000_000

# Signature of `read_trials`.
TrialReader = Callable[[Path, Config, str, list[Remark]], list[Trial]]


def read_campaign(
    paths: Sequence[Path],
    config: Config,
    report: ProgressCallback = lambda _: None,
    *,
    reading: TrialReader | None = None,
    without: Collection[Path] = (),
) -> Campaign:
    """Every log in ``paths``: files, and folders, searched with their subfolders except hidden ones.

    In a folder, CSV files that are no logs (thrust curves, tables of results, files without a mapped column) are left
    out; the last kind is remarked upon, and so are files of a format for which rovid.toml maps nothing. A missing path,
    an unreadable log or no log raises `LogError`, an unmapped format `ConfigError`.

    ``report``: Called with progress messages.
    ``reading``: Function that reads a log; `read_trials` by default.
    ``without``: Files to ignore.
    """
    logs, remarks = find_logs(paths, config, without)
    trials, budget = list[Trial](), Budget(report=report)
    began = budget.clock()
    for done, (name, path) in enumerate(logs):
        budget.tell("Reading the logs", done, len(logs), began, "log")
        trials += (reading or read_trials)(path, config, name, remarks)
    return campaign_of(trials, config, paths, remarks)


def campaign_of(
    trials: Sequence[Trial], config: Config, sources: Sequence[Path] = (), remarks: Sequence[Remark] = ()
) -> Campaign:
    """The ``trials`` as one campaign: without duplicates, and with what all of them together show.

    Raises LogError if there are no trials.
    """
    if not trials:
        raise LogError("nothing is left of these logs.", where=config.path, mend="Correct [[leave_out]].")
    kept, faults = examine_campaign(trials, config)
    # Median of each further channel over all trials.
    readings: dict[str, list[FloatArray]] = {}
    for trial in kept:
        for name, values in trial.extras.items():
            readings.setdefault(name, []).append(values)
    channels = {name: np.concatenate(readings[name]) for name in sorted(readings)}
    medians = {name: float(np.nanmedian(values)) for name, values in channels.items() if np.isfinite(values).any()}
    # Start in s after the first trial; one after the other by name unless all logs have absolute times.
    starts = [trial.start_epoch for trial in kept if trial.start_epoch is not None]
    times = np.cumsum([0.0, *(trial.duration for trial in kept[:-1])]).tolist()
    if len(starts) == len(kept):
        first = min(starts)
        times = [start - first for start in starts]
    placed = zip(kept, times, strict=True)
    together = tuple(replace(trial, reference=medians, campaign_time=time) for trial, time in placed)
    return Campaign(trials=together, sources=tuple(sources), remarks=tuple(remarks), faults=faults)


def examine_campaign(trials: Sequence[Trial], config: Config) -> tuple[Sequence[Trial], tuple[Fault, ...]]:
    """The trials that stay after the remedies, and the faults of single logs and of all logs together."""
    own = [fault for trial in trials for fault in trial.faults]
    if any(fault.fault == "scaled_heading" for fault in own):
        # Where such a heading wraps only once in a log, the wrap looks like a step.
        own = [fault for fault in own if fault.fault != "heading_step"]
    data = CampaignData(trials=trials, vehicle=config.vehicle)
    data, faults = examine(detectors_at("campaign"), data, config.faults)
    return data.trials, (*own, *faults)


def read_trials(path: Path, config: Config, name: str, remarks: list[Remark]) -> list[Trial]:
    """The used parts of a log: one trial, or several with exclusions between them."""
    # A log that is not used need not hold what rovid.toml maps.
    unused = next((one for one in config.exclusions if one.applies_to(name) and one.is_whole), None)
    parts = [] if unused else split(read_log(path, config, name), config.exclusions)
    if not parts:
        reason = f" ({unused.reason})" if unused and unused.reason else ""
        remarks.append(left_out(name, f"rovid.toml excludes all of it{reason}"))
    return parts


# --- logs read by a forked child while this process imports the estimators --------------------------------------

# (path, name) -> trials, and remarks on the log.
_TrialsRead = dict[tuple[Path, str], tuple[list[Trial], list[Remark]]]


class PrefetchedReader(ForkedCall[_TrialsRead]):
    """A `TrialReader` that takes trials from a forked child, and reads the remaining logs itself.

    The child calls ``asked`` for the paths to read and the axis. This process calls ``meanwhile`` before it waits.
    """

    def __init__(self, asked: Callable[[], tuple[Sequence[Path], Axis]], meanwhile: Callable[[], object]) -> None:
        super().__init__(lambda: _read_small_logs(*asked()))
        self._meanwhile = meanwhile
        self._known: _TrialsRead | None = None

    def __call__(self, path: Path, config: Config, name: str, remarks: list[Remark]) -> list[Trial]:
        """Trials of a log; remarks on the log are appended to ``remarks``."""
        if self._known is None:
            if self.is_running:
                self._meanwhile()
            self._known = self.result() or {}
        # Removed, so that only the caller keeps the trials in memory.
        trials, found = self._known.pop((path, name), (None, []))
        if trials is None:
            return read_trials(path, config, name, remarks)
        remarks += found
        return trials


def _read_small_logs(paths: Sequence[Path], axis: Axis) -> _TrialsRead:
    config, read = load_config(find_config(paths), axis), _TrialsRead()
    logs, _ = find_logs(paths, config)
    size = _LARGE
    with suppress(OSError):  # Reading reports a broken link.
        size = sum(part.stat().st_size for _, path in logs for part in file_parts(path))
    if size < _LARGE:
        for name, path in logs:
            remarks: list[Remark] = []
            read[path, name] = read_trials(path, config, name, remarks), remarks
    return read
