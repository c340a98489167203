"""The logs in files and folders: which files are logs, and their names."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rovid.core.errors import LogError, suggestion
from rovid.core.paths import file_parts, list_files, require_exists
from rovid.core.signatures import PLAN
from rovid.readers.formats import READERS, trial_files
from rovid.trial.config import Config
from rovid.trial.log_files import FORMATS
from rovid.trial.tables import CURVE_COLUMNS, SINE_COLUMNS, STEADY_COLUMNS
from rovid.trial.trial import Remark

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
    files = _with_unique_names(_without_repeats(files, remarks))
    if config.maps_format("nmea"):
        files = _without_nmea_companions(files)
    if config.join is not None:
        files = _first_files_of_trials(files, config)
    # A table given alone is read as a log: the error then names what it lacks.
    logs = [one for one in files if _is_log(one, config, remarks)] or [one for one in files if one.asked]
    if not logs:
        raise _no_logs(paths, files)
    remarks += _unmatched_exclusions(logs, config)
    return [(one.name, one.path) for one in logs], remarks


def candidate_files(paths: Sequence[Path]) -> list[Path]:
    """Every file in ``paths`` that may be a log or a table, by its suffix."""
    return [one.path for one in _files_in(list(filter(Path.exists, paths)), [])]


def left_out(name: str, reason: str, kind: str = "skipped") -> Remark:
    """Remark on a file that was left out."""
    return Remark(kind=kind, count=1, text=f"{name} was left out: {reason}.")


def file_size(path: Path) -> int:
    """Size in bytes; 0 for a broken link, which reading reports."""
    try:
        return sum(part.stat().st_size for part in file_parts(path))
    except OSError:
        return 0


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
        names = {item.relative_to(path).as_posix(): item for item in inside.files if item.suffix.lower() in READERS}
        found += [_File(path=item, name=name, asked=False) for name, item in sorted(names.items())]
    return found


def _unreadable(error: OSError) -> None:
    raise LogError(f"cannot be read ({error.strerror}).", where=error.filename) from error


def _without_repeats(files: Sequence[_File], remarks: list[Remark]) -> list[_File]:
    """Each file once, even if two of the paths lead to it."""
    unique: dict[Path, _File] = {}
    for one in files:
        known = unique.setdefault(one.path.resolve(), one)
        if known is not one:
            remarks.append(left_out(one.name, f"it is the same file as {known.name}", "repeated"))
    return list(unique.values())


def _with_unique_names(files: Sequence[_File]) -> list[_File]:
    """Files ordered by name; files of the same name in two folders are named by their paths."""
    counts = Counter(one.name for one in files)
    named = [one if counts[one.name] == 1 else replace(one, name=one.path.as_posix()) for one in files]
    return sorted(named, key=lambda one: one.name)


def _without_nmea_companions(files: Sequence[_File]) -> list[_File]:
    """Without the logs of the same name as an NMEA text, which are read together with it."""
    stems = {one.path.with_suffix("") for one in files if one.kind == "nmea"}
    return [one for one in files if one.kind == "nmea" or one.path.with_suffix("") not in stems]


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
    if one.kind == "csv":
        return _is_csv_log(one, config, remarks)
    if one.asked or one.kind == "mcap" or config.maps_format(one.kind):
        return True
    remarks.append(left_out(one.name, f"rovid.toml maps nothing for {one.kind} logs"))
    return False


def _is_csv_log(one: _File, config: Config, remarks: list[Remark]) -> bool:
    from rovid.readers.csv_dialect import read_layout

    time = config.time.sources.get("csv", "")
    mapped = {time, *(signal.sources["csv"] for signal in config.mapped_signals("csv").values())}
    try:
        names = read_layout(one.path, mapped).written_names
    except (OSError, LogError):
        return True  # Reading reports the error.
    if time not in names and any(columns <= names for columns in _TABLES):
        if one.asked:
            remarks.append(left_out(one.name, "it is a table, no log"))
        return False
    if not one.asked and PLAN.matches(one.path):
        remarks.append(left_out(one.name, "it is a command file of rovid plan, no log"))
        return False
    if one.asked or names & mapped:
        return True
    remarks.append(left_out(one.name, "it holds none of the columns that rovid.toml maps, so it is no log"))
    return False


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


def _no_logs(paths: Sequence[Path], files: Sequence[_File]) -> LogError:
    where = ", ".join(map(str, paths))
    if not files:
        text = f"holds no logs: no {', '.join(READERS)} file."
        return LogError(text, where=where or "logs", mend="Give the folder that holds the logs.")
    names = [one.name for one in files]
    if len(names) > _MAX_NAMES_IN_MESSAGE:
        names[_MAX_NAMES_IN_MESSAGE:] = ["…"]
    noun, unmapped = "tables", ""
    others = sorted({one.kind for one in files} - {"csv"})
    if others:
        noun, unmapped = "files", f", and rovid.toml maps nothing for {' or '.join(others)} logs"
    text = (
        f"holds {len(files)} {noun} ({', '.join(names)}) but no log: "
        f"none has the mapped time and heading columns{unmapped}."
    )
    return LogError(text, where=where, mend="Correct [signals] in rovid.toml, or give the folder that holds the logs.")
