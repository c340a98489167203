"""Log formats by file suffix, and the files that belong to one trial."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from itertools import combinations
from pathlib import Path, PurePath

from rovid.core.errors import LogError, RovidError
from rovid.core.input_files import list_files

# Suffix -> format. The format is the key of its sources in rovid.toml and names its reader: "bag" is `bag_reader`.
FORMATS: Mapping[str, str] = {
    ".csv": "csv",
    ".mcap": "mcap",
    ".parquet": "parquet",
    ".bag": "bag",
    ".db3": "bag",
    ".bin": "bin",
    ".tlog": "tlog",
    ".nmea": "nmea",
    ".ulg": "ulg",
    ".jsonl": "jsonl",
    ".ndjson": "jsonl",
    ".mat": "mat",
    **dict.fromkeys((".tsv", ".txt", ".dat", ".lvm"), "csv"),
}
# Suffixes of tables and of other files too, and the number of rows of numbers that show a table.
_PERHAPS, _TABLE_ROWS, _HEAD = (".txt", ".dat"), 10, 1 << 16
_PUT_LOGS = "Put the logs into this folder, or give the folder that holds them."
# Number of suffixes in a message.
_MAX_SUFFIXES = 3
_NUMBER = re.compile(r"[+-]?[\d.,:+-]*\d[\d.,:eE+-]*")
KINDS = tuple(dict.fromkeys(FORMATS.values()))
# Between the part of a file and a column of it.
QUALIFIER = ":"
_TOKEN = re.compile(r"[^\W\d_]+|\d+")  # letters, or one number


def _tokens(name: str) -> list[str]:
    """Lower-case tokens of a path without its suffix."""
    return _words(str(PurePath(name).with_suffix("")))


def _words(part: str) -> list[str]:
    """Lower-case tokens of a part."""
    return [token.lower() for token in _TOKEN.findall(part)]


def _without(tokens: list[str], part: str) -> list[str]:
    """``tokens`` without the words of ``part`` in succession."""
    words, left, at = _words(part), [], 0
    while words and at < len(tokens):
        if tokens[at : at + len(words)] == words:
            at += len(words)
        else:
            left.append(tokens[at])
            at += 1
    return left if words else tokens


def is_log(path: Path) -> bool:
    """Whether a file is a log by its suffix; a text or data file only if it begins with a table of numbers."""
    suffix = path.suffix.lower()
    if suffix not in _PERHAPS:
        return suffix in FORMATS
    try:
        with path.open("rb") as file:
            lines = file.read(_HEAD).decode("latin-1").splitlines()
    except OSError:
        return False
    count = 0
    for line in lines:
        row = re.split(r"[,;\t ]+", line.strip())
        count += len(row) > 1 and 2 * sum(map(bool, map(_NUMBER.fullmatch, row))) > len(row)
    return count >= _TABLE_ROWS


def files_in(paths: Iterable[Path]) -> list[Path]:
    """All files in ``paths``, those in inner folders too; folders that cannot be read are left out."""
    return [file for path in paths for file in list_files(path, lambda _: None).files]


def nothing_to_read(paths: Sequence[Path], error: type[RovidError] = LogError) -> RovidError:
    """The ``error`` for ``paths`` without a file that rovid reads, with the suffixes of the files that are there."""
    counts = Counter(file.suffix.lower() for file in files_in(paths) if file.suffix and not is_log(file))
    text = f"holds no logs: no {', '.join(suffix for suffix in FORMATS if suffix not in _PERHAPS)} file"
    text, mend = f"{text}, and no {' or '.join(_PERHAPS)} file with a table of numbers.", _PUT_LOGS
    if counts:
        found = ", ".join(f"{count} {suffix}" for suffix, count in counts.most_common(_MAX_SUFFIXES))
        text, mend = f"{text} It holds {found}.", f"{mend} Export logs of another format as CSV."
    return error(text, where=", ".join(map(str, paths)) or "logs", mend=mend)


def is_called(name: str, pattern: str) -> bool:
    """Whether ``pattern`` matches the log ``name``, with or without its folder."""
    return fnmatchcase(name, pattern) or fnmatchcase(name.rpartition("/")[2], pattern)


@dataclass(frozen=True, kw_only=True)
class Join:
    """The [join] table: which files form one trial, and how their clocks are corrected."""

    #: Words that distinguish the files of one trial, as "ins" and "thr" in run1_ins.csv and run1_thr.csv, or "odom" and
    #: "left_thrust" in run1/odom.csv and run1/left_thrust.csv. The file of the first part names the trial.
    parts: tuple[str, ...]
    #: ``offset``, ``drift``: part, file name or pattern -> seconds added to that clock; and ppm added from the
    #: beginning of the file on.
    offset: Mapping[str, float] = field(default_factory=dict)
    drift: Mapping[str, float] = field(default_factory=dict)
    #: Part -> its time column and unit, where they differ.
    time: Mapping[str, tuple[str, str]] = field(default_factory=dict)

    def __str__(self) -> str:
        """All settings that results depend on."""
        offsets = [f"{part} {value:g} s late" for part, value in self.offset.items()]
        drifts = [f"{part} slow by {value:g} ppm" for part, value in self.drift.items()]
        clocks = [f"{part} by {column} {unit}" for part, (column, unit) in self.time.items()]
        return ", ".join([" and ".join(self.parts), *offsets, *drifts, *clocks])

    def clock_correction(self, name: str) -> tuple[float, float]:
        """Offset in s and drift in ppm to add to the clock of the file ``name``; zeros by default."""
        return self._value_for(name, self.offset), self._value_for(name, self.drift)

    def is_corrected_by_part(self, name: str) -> bool:
        """Whether the clock correction of the file ``name`` is that of its part, the same in all trials."""
        own = {key for key in (*self.offset, *self.drift) if key not in self.parts}
        return not any(is_called(name, key) for key in own)

    def _value_for(self, name: str, values: Mapping[str, float]) -> float:
        """Value for the file ``name``, or else for its part."""
        own = (value for key, value in values.items() if key not in self.parts and is_called(name, key))
        return next(own, values.get(self.part(name), 0.0))

    def part(self, name: str) -> str:
        """Part of the file ``name``, that of most words; empty where the name holds none."""
        tokens = _tokens(name)
        held = (part for part in self.parts if _without(tokens, part) != tokens)
        return max(held, key=lambda part: len(_words(part)), default="")

    def trial_key(self, name: str) -> str:
        """Tokens that all files of one trial have in common."""
        return "/".join(_without(_tokens(name), self.part(name)))

    def column_of(self, source: str, name: str) -> str:
        """Column of the file ``name`` that ``source`` refers to; empty if it names the part of another file.

        The column of one part may be written as "part:column", where several parts have columns of the same name.
        """
        part, colon, column = source.partition(QUALIFIER)
        if not colon or part not in self.parts:
            return source
        return column if part == self.part(name) else ""

    def files_of_trial(self, name: str, others: Iterable[str]) -> list[str]:
        """Names among ``others`` of the files of the same trial as ``name``, in the order of the parts."""
        same = [other for other in others if self.part(other) and self.trial_key(other) == self.trial_key(name)]
        return sorted(same, key=lambda other: self.parts.index(self.part(other)))


def guess_parts(names: Sequence[str], most: int = 1) -> list[tuple[str, ...]]:
    """Sets of words that may distinguish the files of one trial, the most likely first.

    Names differ in one word, or in up to ``most`` words in succession, as files of one topic each do.
    """
    groups: dict[tuple[tuple[str, ...], tuple[str, ...]], set[str]] = {}
    for tokens in map(_tokens, names):
        for at, end in combinations(range(len(tokens) + 1), 2):
            if end - at <= most and not "".join(tokens[at:end]).isdigit():
                groups.setdefault((tuple(tokens[:at]), tuple(tokens[end:])), set()).add("_".join(tokens[at:end]))
    counts = Counter(frozenset(found) for found in groups.values() if len(found) > 1)

    def rank(parts: frozenset[str]) -> tuple[int, ...]:
        files = counts[parts] * len(parts)
        if most == 1:
            return files, len(parts)
        # Many words may hold the name of the trial too. Words with a number at an end do so.
        worded = all((one[0] + one[-1]).isalpha() for one in parts)
        return files, worded, counts[parts], -sum(map(len, parts))

    return [tuple(sorted(parts)) for parts in sorted(counts, key=rank, reverse=True)]
