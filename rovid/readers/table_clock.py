"""The time of a table: which column it is, and times in two columns, whole seconds and the rest."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import LogError
from rovid.trial.signal_names import CLOCK_WORDS, NOT_CLOCK, name_words

# Name of whole seconds -> names of the rest beside it; the prefix of both is the same.
SECOND_PARTS: Mapping[str, tuple[str, ...]] = {
    "sec": ("nanosec", "nsec", "nsecs", "usec"),
    "secs": ("nsecs", "nanosecs", "usecs"),
    "seconds": ("nanoseconds", "nanos", "microseconds"),
    "s": ("ns", "us"),
}
_SECONDS = re.compile(rf"(?i)(?:.*[^a-z])?({'|'.join(SECOND_PARTS)})$")
# Between the columns of whole seconds and of the rest in rovid.toml: "s + ns".
SPLIT = " + "


class ClockParts(NamedTuple):
    """Columns of whole seconds and of the rest, and the unit of the rest in s."""

    seconds: str
    rest: str
    unit: float
    is_named: bool = True  #: rovid.toml names both.

    def __str__(self) -> str:
        return f"{self.seconds}{SPLIT}{self.rest}"

    def joined(
        self, seconds: FloatArray, rest: FloatArray, epoch: float | None, where: Path
    ) -> tuple[FloatArray, float | None]:
        """(n,) s and the epoch of their zero; ``epoch`` is that of the zero of ``seconds``.

        Raises `LogError` for other numbers, where rovid.toml names both columns.
        """
        known = np.flatnonzero(np.isfinite(seconds) & np.isfinite(rest))
        whole, part = seconds[known], self.unit * rest[known]
        if known.size and np.all(whole == np.rint(whole)) and part.min() >= 0.0 and part.max() < 1.0:
            time: FloatArray = (seconds - whole[0]) + self.unit * (rest - rest[known[0]])
            return time, None if epoch is None else float(epoch + whole[0] + part[0])
        if self.is_named:
            text = f"{self.seconds} and {self.rest} hold no whole seconds and the rest of each."
            raise LogError(text, where=where, mend="Correct time in rovid.toml.")
        return seconds, epoch


def clock_parts(clock: str, present: Collection[str]) -> ClockParts | None:
    """Columns of the time ``clock``: "s + ns", or whole seconds with the rest ``present`` beside them; None for one."""
    seconds, is_named, rest = clock.partition(SPLIT)
    if clock in present:
        seconds, is_named, rest = clock, "", ""
    if (found := _SECONDS.match(seconds)) is None and not is_named:
        return None
    unit = 1e-6 if rest.rpartition(".")[2].lower().endswith(("us", "usec", "usecs", "microseconds")) else 1e-9
    if is_named:
        return ClockParts(seconds, rest, unit)
    stem = seconds[: found.start(1)].lower() if found else ""
    lower = {one.lower(): one for one in present}
    for part in SECOND_PARTS[found[1].lower()] if found else ():
        if stem + part in lower:
            return ClockParts(seconds, lower[stem + part], 1e-9 if part.startswith("n") else 1e-6, is_named=False)
    return None


def guess_clock(numbers: Mapping[str, FloatArray], dated: Sequence[str], texts: Sequence[str] = ()) -> str:
    """The most likely time among columns of ``numbers``, of dates, and of ``texts``; empty if there is none.

    The order of preference: seconds in two columns; by its name; dates and times of day; the first column of numbers
    that does not count rows.
    """
    splits = [parts for name in numbers if (parts := clock_parts(name, numbers)) is not None]
    joined = [str(parts) for parts in splits if _is_split(parts, numbers)]
    rests = {parts.rest for parts in splits}
    numeric = [name for name, values in numbers.items() if name not in rests and _is_increasing(values)]
    increasing = [*numeric, *dated, *texts]
    named = [name for name in increasing if name_words(name) & CLOCK_WORDS]
    likely = [name for name in named if not name_words(name) & NOT_CLOCK]
    uneven = [name for name in numeric if not _counts_rows(numbers[name])]
    plain = [name for name in likely or named if name in numbers or name in dated]
    return next(iter(joined or plain or list(dated) or likely or named or uneven or numeric), "")


def _is_split(parts: ClockParts, numbers: Mapping[str, FloatArray]) -> bool:
    seconds, rest = numbers[parts.seconds], numbers[parts.rest]
    if len(seconds) != len(rest):
        return False
    time, _ = parts.joined(seconds, rest, None, Path())
    return time is not seconds and _is_increasing(time)


def _counts_rows(values: FloatArray) -> bool:
    known = values[np.isfinite(values)]
    return bool(np.all(np.diff(known) == 1.0) and np.all(known == np.round(known)))


def _is_increasing(values: FloatArray) -> bool:
    known = values[np.isfinite(values)]
    return len(known) > 1 and bool(np.all(known[1:] > known[:-1]))
