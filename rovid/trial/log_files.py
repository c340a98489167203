"""Log formats by file suffix, and the files that belong to one trial."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import PurePath

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
}
KINDS = tuple(dict.fromkeys(FORMATS.values()))
_TOKEN = re.compile(r"[^\W\d_]+|\d+")  # letters, or one number


def _tokens(name: str) -> list[str]:
    """Lower-case tokens of a path without its suffix."""
    return [token.lower() for token in _TOKEN.findall(str(PurePath(name).with_suffix("")))]


def is_called(name: str, pattern: str) -> bool:
    """Whether ``pattern`` matches the log ``name``, with or without its folder."""
    return fnmatchcase(name, pattern) or fnmatchcase(name.rpartition("/")[2], pattern)


@dataclass(frozen=True, kw_only=True)
class Join:
    """The [join] table: which files form one trial, and how their clocks are corrected."""

    #: Words that distinguish the files of one trial, as "ins" and "thr" in run1_ins.csv and run1_thr.csv, or in
    #: run1/ins.csv and run1/thr.csv. The file of the first part names the trial.
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
        """Part of the file ``name``; empty where the name holds none."""
        tokens = _tokens(name)
        return next((part for part in self.parts if part.lower() in tokens), "")

    def trial_key(self, name: str) -> str:
        """Tokens that all files of one trial have in common."""
        part = self.part(name).lower()
        return "/".join(token for token in _tokens(name) if token != part)

    def files_of_trial(self, name: str, others: Iterable[str]) -> list[str]:
        """Names among ``others`` of the files of the same trial as ``name``, in the order of the parts."""
        same = [other for other in others if self.part(other) and self.trial_key(other) == self.trial_key(name)]
        return sorted(same, key=lambda other: self.parts.index(self.part(other)))


def guess_parts(names: Sequence[str]) -> tuple[str, ...]:
    """Words that seem to distinguish the files of one trial: names that differ in one word; empty if there are none."""
    groups: dict[tuple[int, tuple[str, ...]], set[str]] = {}
    for tokens in map(_tokens, names):
        for at, token in enumerate(tokens):
            if not token.isdigit():
                groups.setdefault((at, (*tokens[:at], "", *tokens[at + 1 :])), set()).add(token)
    counts = Counter(frozenset(found) for found in groups.values() if len(found) > 1)
    best = max(counts, key=lambda parts: (counts[parts] * len(parts), len(parts)), default=frozenset())
    return tuple(sorted(best))
