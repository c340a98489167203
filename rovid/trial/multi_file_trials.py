"""Trials that were logged in several files, one a sensor: which files belong together, and how their clocks stand."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import PurePath

# Words of a file's name: letters, or a number.
_WORD = re.compile(r"[^\W\d_]+|\d+")


@dataclass(frozen=True, kw_only=True)
class Join:
    """How the files of one trial are known.

    Attributes
    ----------
    parts
        The words in which the names of one trial's files differ, as "ins" and "thr" in run1_ins.csv and run1_thr.csv,
        or in run1/ins.csv and run1/thr.csv. The first is the one that the trial is called by.
    offset, drift
        Part, or name of a file or pattern of such -> s to be added to that clock; and s more for each million s from
        the beginning of the file on (ppm).
    time
        Part -> its column of time and the unit of that, where those are others.
    """

    parts: tuple[str, ...]
    offset: Mapping[str, float] = field(default_factory=dict)
    drift: Mapping[str, float] = field(default_factory=dict)
    time: Mapping[str, tuple[str, str]] = field(default_factory=dict)

    def __str__(self) -> str:
        """All of it that results rest on."""
        offsets = [f"{part} {value:g} s late" for part, value in self.offset.items()]
        drifts = [f"{part} slow by {value:g} ppm" for part, value in self.drift.items()]
        clocks = [f"{part} by {column} {unit}" for part, (column, unit) in self.time.items()]
        return ", ".join([" and ".join(self.parts), *offsets, *drifts, *clocks])

    def clock_correction(self, name: str) -> tuple[float, float]:
        """S to be added to the clock of the file of that name, and ppm; zeros where nothing is said of it."""
        return self._of(name, self.offset), self._of(name, self.drift)

    def is_of_part(self, name: str) -> bool:
        """Whether what is given of that file's clock is given of its part alone, in all trials alike."""
        own = {key for key in (*self.offset, *self.drift) if key not in self.parts}
        return not any(is_called(name, key) for key in own)

    def _of(self, name: str, given: Mapping[str, float]) -> float:
        """What is given of that file, or else of its part."""
        own = (value for key, value in given.items() if key not in self.parts and is_called(name, key))
        return next(own, given.get(self.part(name), 0.0))

    def part(self, name: str) -> str:
        """The part that a file of that name is; empty if it is none."""
        words = {word.lower() for word in _WORD.findall(str(PurePath(name).with_suffix("")))}
        return next((part for part in self.parts if part.lower() in words), "")

    def trial(self, name: str) -> str:
        """What the files of one trial have in common."""
        part = self.part(name).lower()
        words = _WORD.findall(str(PurePath(name).with_suffix("")))
        return "/".join(word.lower() for word in words if word.lower() != part)

    def of_trial(self, name: str, others: Iterable[str]) -> list[str]:
        """Of ``others`` the names of the files of the same trial as ``name``, in the order of the parts."""
        mine = [other for other in others if self.part(other) and self.trial(other) == self.trial(name)]
        return sorted(mine, key=lambda other: self.parts.index(self.part(other)))


def is_called(name: str, pattern: str) -> bool:
    """Whether a log of that ``name``, which may stand in a subfolder, is one that ``pattern`` means."""
    return fnmatchcase(name, pattern) or fnmatchcase(name.rpartition("/")[2], pattern)


def guess_parts(names: Sequence[str]) -> tuple[str, ...]:
    """Words in which files seem to be parts of trials: the names of each trial differ in one of them; else none."""
    counts: Counter[frozenset[str]] = Counter()
    split = [[word.lower() for word in _WORD.findall(str(PurePath(name).with_suffix("")))] for name in names]
    groups: dict[tuple[int, tuple[str, ...]], set[str]] = {}
    for words in split:
        for at, word in enumerate(words):
            if not word.isdigit():
                groups.setdefault((at, (*words[:at], "", *words[at + 1 :])), set()).add(word)
    for found in groups.values():
        if len(found) > 1:
            counts[frozenset(found)] += 1
    best = max(counts, key=lambda parts: (counts[parts] * len(parts), len(parts)), default=frozenset())
    return tuple(sorted(best))
