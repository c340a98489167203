"""Folders and files -> the trials of one campaign: which files are logs, what they are called, which are doubles."""

from __future__ import annotations

import filecmp
import sys
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import LogError, suggestion
from rovid.core.paths import list_files, require_exists
from rovid.core.signatures import PLAN
from rovid.readers.formats import READERS, read_log, trial_files
from rovid.trial.config import Config
from rovid.trial.tables import CURVE_COLUMNS, SINE_COLUMNS, STEADY_COLUMNS
from rovid.trial.trial import Campaign, Remark, Trial, apply_exclusions

# Progress is worth a bar from here on.
_LARGE = 20_000_000
# Tables that stand beside logs and are none; each lacks the time column.
_TABLES = (
    frozenset(CURVE_COLUMNS),
    frozenset(STEADY_COLUMNS),
    frozenset(SINE_COLUMNS) - {"torque_amplitude_Nm"},
)

Progress = Callable[[Path, int], None]
# As `trials_of`, which reads a log anew each time.
TrialReader = Callable[[Path, Config, str, list[Remark]], list[Trial]]


@dataclass(frozen=True, kw_only=True)
class _File:
    """A file to read: where it is and what to call it; ``asked`` for by name rather than found in a folder."""

    path: Path
    name: str
    asked: bool


def read_campaign(
    paths: Sequence[Path],
    config: Config,
    progress: Progress | None = None,
    *,
    reading: TrialReader | None = None,
    without: Collection[Path] = (),
) -> Campaign:
    """Every log in ``paths``.

    Parameters
    ----------
    paths
        Files, and folders that are searched with their subfolders, hidden ones left out. In a folder, CSV
        files that are no logs (thrust curves, tables of results, files without any mapped column) are left
        out; the last kind is remarked upon, as are files of a format for which rovid.toml maps nothing.
    progress
        Called with each file and its size in bytes after it is read. Without it, a bar is shown on stderr where
        that is a terminal and the logs are large.
    reading
        What reads a log; `trials_of` where none is given.
    without
        Files that are taken not to be there.

    Raises
    ------
    LogError
        A path does not exist, there are no logs, or one of them cannot be read.
    ConfigError
        rovid.toml does not map a format that is there.
    """
    logs, remarks = find_logs(paths, config, without)
    trials = []
    with _shown(logs, progress) as advance:
        for name, path in logs:
            trials += (reading or read_trials)(path, config, name, remarks)
            advance(path, _size(path))
    if not trials:
        raise LogError("nothing is left of these logs.", where=config.path, mend="Correct [[leave_out]].")
    from rovid.readers.duplicates import without_duplicates

    own = without_duplicates(trials, remarks)
    medians = _medians(own)
    pairs = zip(own, _since(own), strict=True)
    together = tuple(replace(trial, reference=medians, campaign_time=since) for trial, since in pairs)
    return Campaign(trials=together, sources=tuple(paths), remarks=tuple(remarks))


def _since(trials: Sequence[Trial]) -> list[float]:
    """When each trial began, in s from the first; where a log does not tell, one after the other by name."""
    told = [trial.start_epoch for trial in trials if trial.start_epoch is not None]
    if len(told) == len(trials):
        first = min(told, default=0.0)
        return [began - first for began in told]
    durations = [trial.duration for trial in trials[:-1]]
    return [0.0, *np.cumsum(durations).tolist()]


def _medians(trials: Sequence[Trial]) -> dict[str, float]:
    """Median of each further channel over all trials that have readings of it."""
    readings: dict[str, list[FloatArray]] = {}
    for trial in trials:
        for name, values in trial.extras.items():
            readings.setdefault(name, []).append(values)
    medians = {}
    for name in sorted(readings):
        values = np.concatenate(readings[name])
        if np.isfinite(values).any():
            medians[name] = float(np.nanmedian(values))
    return medians


def find_logs(
    paths: Sequence[Path], config: Config, without: Collection[Path] = ()
) -> tuple[list[tuple[str, Path]], list[Remark]]:
    """(name, file) of every log in ``paths`` by name, copies left out, and what was noticed; nothing is read yet.

    Files in ``without`` are taken not to be there.

    Raises
    ------
    LogError
        A path does not exist, or there are no logs.
    """
    remarks: list[Remark] = []
    there = [one for one in _search_all(paths, remarks) if one.path not in without]
    files = _named(_once(there, remarks))
    if config.maps_format("nmea"):
        files = _without_companions(files)
    if config.join is not None:
        files = _first_of_each(files, config)
    logs = [one for one in files if _is_log(one, config, remarks)]
    # A table alone is read as the log that it was given for, which says what it lacks.
    logs = logs or [one for one in files if one.asked]
    if not logs:
        raise _no_logs(paths, files)
    remarks += _unknown_stretches(logs, config)
    once = _without_copies(logs, remarks)
    return [(one.name, one.path) for one in once], remarks


def _without_companions(files: Sequence[_File]) -> list[_File]:
    """Without the logs beside an NMEA text, which are read with it."""
    texts = {one.path for one in files if one.path.suffix.lower() == ".nmea"}
    stems = {text.with_suffix("") for text in texts}
    return [one for one in files if one.path in texts or one.path.with_suffix("") not in stems]


def _first_of_each(files: Sequence[_File], config: Config) -> list[_File]:
    """Without the files that are read with another one of their trial."""
    firsts: dict[Path, _File] = {}
    read: set[Path] = set()
    for one in files:
        if one.path.resolve() in read:
            continue
        beside = trial_files(one.path, config) or [one.path]
        read |= {path.resolve() for path in beside}
        firsts[beside[0]] = replace(one, path=beside[0])
    by_path = {one.path: one for one in files}
    return [by_path.get(path, one) for path, one in firsts.items()]


def candidate_files(paths: Sequence[Path]) -> list[Path]:
    """Every file in ``paths`` that may be a log or a table, whatever is in it."""
    there = [path for path in paths if path.exists()]
    return [one.path for one in _search_all(there, [])]


def _search_all(paths: Sequence[Path], remarks: list[Remark]) -> list[_File]:
    return [one for path in paths for one in _search(path, remarks)]


def _search(path: Path, remarks: list[Remark]) -> Iterator[_File]:
    """The file itself, or what the folder holds, by name."""
    require_exists(path, LogError)
    if not path.is_dir():
        yield _File(path=path, name=path.name, asked=True)
        return
    inside = list_files(path, _unreadable)
    for item, what in inside.special_files.items():
        text = f"{item.relative_to(path).as_posix()} was left out: it is {what}."
        remarks.append(Remark(kind="skipped", count=1, text=text))
    readable = [item for item in inside.files if item.suffix.lower() in READERS]
    for name, item in sorted((item.relative_to(path).as_posix(), item) for item in readable):
        yield _File(path=item, name=name, asked=False)


def _unreadable(error: OSError) -> None:
    raise LogError(f"cannot be read ({error.strerror}).", where=error.filename) from error


def _once(files: Sequence[_File], remarks: list[Remark]) -> list[_File]:
    """Each file once, though two of the paths lead to it."""
    first: dict[Path, _File] = {}
    for one in files:
        known = first.setdefault(one.path.resolve(), one)
        if known is not one:
            remarks.append(_left_out(one.name, f"it is the same file as {known.name}"))
    return list(first.values())


def _left_out(name: str, why: str) -> Remark:
    return Remark(kind="repeated", count=1, text=f"{name} was left out: {why}.")


def _named(files: Sequence[_File]) -> list[_File]:
    """Files with names that differ: with more of their path where two folders hold the same name."""
    counts = Counter(one.name for one in files)
    named = [one if counts[one.name] == 1 else replace(one, name=one.path.as_posix()) for one in files]
    return sorted(named, key=lambda one: one.name)


def _is_log(one: _File, config: Config, remarks: list[Remark]) -> bool:
    """Whether a file is a log; tables may stand beside them, and in a folder files of any use."""
    form = READERS.get(one.path.suffix.lower())
    kind = form.kind if form else ""
    if kind == "csv":
        return _is_csv_log(one, config, remarks)
    if one.asked or kind == "mcap" or config.maps_format(kind):
        return True
    remarks.append(_skipped(one.name, f"rovid.toml maps nothing for {kind} logs"))
    return False


def _is_csv_log(one: _File, config: Config, remarks: list[Remark]) -> bool:
    from rovid.readers.csv_dialect import read_layout

    time = config.time.sources.get("csv", "")
    mapped = {signal.sources["csv"] for signal in config.mapped_signals("csv").values()} | {time}
    try:
        names = set(read_layout(one.path, mapped).names)
    except (OSError, LogError):
        return True  # reading it says what is wrong
    if time not in names and any(columns <= names for columns in _TABLES):
        if one.asked:
            remarks.append(_skipped(one.name, "it is a table, no log"))
        return False
    if not one.asked and PLAN.matches(one.path):
        remarks.append(_skipped(one.name, "it is a command file of rovid plan, no log"))
        return False
    if one.asked or names & mapped:
        return True
    remarks.append(_skipped(one.name, "it holds none of the columns that rovid.toml maps, so it is no log"))
    return False


def read_trials(path: Path, config: Config, name: str, remarks: list[Remark]) -> list[Trial]:
    """What is to be used of a log: one trial, or several where stretches between them are left out.

    Raises
    ------
    LogError
        It cannot be read.
    """
    parts = apply_exclusions(read_log(path, config, name), config.exclusions)
    if not parts:
        remarks.append(_skipped(name, "rovid.toml leaves all of it out"))
    return parts


def _unknown_stretches(logs: Sequence[_File], config: Config) -> Iterator[Remark]:
    """Stretches that are of no log, here or beside rovid.toml."""
    names = [one.name for one in logs]
    for stretch in config.exclusions:
        if any(map(stretch.applies_to, names)):
            continue
        folder = config.path.parent
        beside = [path.relative_to(folder).as_posix() for path in list_files(folder, _unreadable).files]
        if not any(map(stretch.applies_to, beside)):
            text = f"[[leave_out]] of {stretch.log!r} was left alone: no log is called so. {suggestion(stretch.log, names)}"
            yield Remark(kind="skipped", count=1, text=text)


def _skipped(name: str, why: str) -> Remark:
    return Remark(kind="skipped", count=1, text=f"{name} was left out: {why}.")


def _no_logs(paths: Sequence[Path], files: Sequence[_File]) -> LogError:
    where = ", ".join(map(str, paths))
    if not files:
        text = f"holds no logs: no {', '.join(READERS)} file."
        return LogError(text, where=where or "logs", mend="Give the folder that holds the logs.")
    names = [one.name for one in files]
    if len(names) > 5:
        names[5:] = ["…"]
    what, also = "tables", ""
    others = sorted({READERS[one.path.suffix.lower()].kind for one in files} - {"csv"})
    if others:
        what, also = "files", f", and rovid.toml maps nothing for {' or '.join(others)} logs"
    return LogError(
        f"holds {len(files)} {what} ({', '.join(names)}) but no log: "
        f"none has the mapped time and heading columns{also}.",
        where=where,
        mend="Correct [signals] in rovid.toml, or give the folder that holds the logs.",
    )


def _without_copies(logs: Sequence[_File], remarks: list[Remark]) -> list[_File]:
    """The first of files with the same bytes."""
    by_size: dict[int, list[_File]] = {}
    kept = []
    for one in logs:
        size = _size(one.path)
        alike = by_size.setdefault(size, [])
        twins = (other for other in alike if size and _same_bytes(other.path, one.path))
        twin = next(twins, None)
        if twin is None:
            alike.append(one)
            kept.append(one)
        else:
            remarks.append(_left_out(one.name, f"it is a copy of {twin.name}"))
    return kept


def _same_bytes(one: Path, other: Path) -> bool:
    try:
        return filecmp.cmp(one, other, shallow=False)
    except OSError:  # reading it says so
        return False


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:  # a link to nowhere: reading it says so
        return 0


def are_large(logs: Sequence[tuple[str, Path]]) -> bool:
    """Whether reading these files is what takes long."""
    return _total(logs) >= _LARGE


def _total(logs: Sequence[tuple[str, Path]]) -> int:
    return sum(_size(path) for _, path in logs)


@contextmanager
def _shown(logs: Sequence[tuple[str, Path]], progress: Progress | None) -> Iterator[Progress]:
    """What to call after each file."""
    if progress is not None:
        yield progress
    elif not are_large(logs) or not sys.stderr.isatty():
        yield lambda _path, _size: None
    else:
        from rich.console import Console
        from rich.progress import Progress as Bar

        with Bar(console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task("Reading logs", total=_total(logs))
            yield lambda _path, size: bar.advance(task, size)
