"""Clocks: time as logged to seconds, the time columns of a table, and samples in strictly increasing time."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rovid.core.array_types import BoolArray, FloatArray, IntArray
from rovid.core.errors import LogError
from rovid.trial.axis import CLOCK_WORDS, NOT_CLOCK, name_words
from rovid.trial.segments import find_leap, subsampled_median
from rovid.trial.trial import Remark

if TYPE_CHECKING:  # pandas takes long to import.
    import pandas as pd

SCALES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
# Serial days of spreadsheets since 1899-12-30: days of the years 1954 to 2119, s in a day, steps of 0.2 ms to 9 s.
_DAYS, _DAY, _DAY_STEP = (2e4, 8e4), 86400.0, (2.3e-9, 1e-4)
# Unit at the end of a column's name: "time_ms", "t [us]", "stamp(ns)", "millis", "t_usec", "TimeUS".
_UNIT_AT_END = re.compile(
    r"(?:^|[^a-z]|(?-i:(?<=[a-z])(?=[A-Z])))(?:(m|u|µ|μ|n)s(?:ec)?s?|(milli|micro|nano)s?(?:ec(?:ond)?s?)?)\W*$",
    re.IGNORECASE,
)
# A date as 7.1.2026 before a time, a time of day, and the least step back of such a clock at midnight.
_DOTTED_DATE, _TIME_OF_DAY = re.compile(r"^(\d{1,2})\.(\d{1,2})\.(\d{4})"), r"\d{1,2}:\d\d:\d\d(\.\d+)?"
_HALF_A_DAY = np.timedelta64(12, "h")
# Largest magnitude of a plausible time, angle or command; larger numbers come from damage.
_IMPLAUSIBLE = 1e15
# s; a time from here on (1973) counts from 1970.
EPOCH_FROM = 1e8
# s; recorders store messages out of order by less than this.
_MAX_DISORDER = 1.0
# Intervals by which single rows of a table are out of order, and fewest rows of a block that may stand anywhere; a
# larger disorder is another fault, and is refused.
_MAX_PLACES = _MIN_BLOCK = 10
# Share of samples with the stamp of the sample before, above which a log is refused.
_MAX_DUPLICATE = 0.5
# s; closer time stamps are equal; a longer run (35 days) is refused, because floats lose ticks beyond.
_TICK, _MAX_DURATION = 1e-9, 3e6
# Stamps that show whether their clock is regular.
_MIN_REGULAR = 20
# s; decimals to which stamps are rounded. Finer ones move a reading by less than its noise.
_ROUNDED_TO = (0.1, 0.01, 1e-3, 1e-4)


def is_plausible(values: FloatArray) -> BoolArray:
    """(n,) whether each number is a measurement: neither missing, nor infinite, nor implausibly large."""
    return np.abs(values) < _IMPLAUSIBLE


def time_unit(name: str, magnitude: float, declared: str) -> str:
    """s, ms, us or ns: as ``declared``, else by the column's name, else by the magnitude of an epoch time.

    Seconds since 1970 are near 1.7e9, so that factors of a thousand are unambiguous; times below 1e11 are seconds.
    """
    if declared in SCALES:
        return declared
    if named := _UNIT_AT_END.search(name):
        prefix = (named[1] or named[2]).lower()
        return {"milli": "ms", "micro": "us", "nano": "ns", "µ": "us", "μ": "us"}.get(prefix, prefix + "s")
    for unit, lowest in (("ns", 1e17), ("us", 1e14), ("ms", 1e11)):
        if magnitude >= lowest:
            return unit
    return "s"


def to_seconds(values: NDArray[Any], name: str, declared: str, origin: int | None = None) -> FloatArray:
    """(n,) s of (n,) numbers; integers are made relative before they become floats, so that no digit is lost.

    ``name`` is the column or field, ``declared`` the unit in rovid.toml. ``origin`` is subtracted from integers; it is
    the first of them by default. Floats are NaN where missing.
    """
    if not values.size:
        return values.astype(np.float64)
    if values.dtype.kind == "u":
        values = values.astype(np.int64)
    sample = np.abs(values[:: len(values) // 1000 + 1].astype(np.float64))
    sample = sample[sample < 1e30]  # Larger numbers are no times.
    magnitude = float(np.median(sample)) if sample.size else 0.0
    scale = SCALES[time_unit(name, magnitude, declared)]
    if scale == 1.0 and declared != "s" and _DAYS[0] < magnitude < _DAYS[1] and values.dtype.kind == "f":
        step = subsampled_median((steps := np.abs(np.diff(values)))[steps > 0.0])
        if _DAY_STEP[0] < step < _DAY_STEP[1]:  # A float of such a day is exact to a microsecond.
            return np.asarray(np.round((values - np.nanmin(values)) * _DAY, 5), dtype=np.float64)
    relative: FloatArray = values
    if values.dtype.kind == "i":
        relative = (values - (values[0] if origin is None else origin)).astype(np.float64)
    return relative if scale == 1.0 else relative * scale


def column_to_seconds(column: pd.Series[Any], name: str, declared: str, where: Callable[[int], str]) -> FloatArray:
    """(n,) s of a column of numbers, dates or text, as in `to_seconds`; ``where``: row -> its place in the file."""
    import pandas as pd

    if isinstance(column.dtype, np.dtype) and column.dtype.kind in "iuf":
        return to_seconds(column.to_numpy(), name, declared)
    if column.dtype == "Int64":
        known = column.notna().to_numpy()
        time = np.full(len(column), np.nan)
        time[known] = to_seconds(column[known].to_numpy(dtype=np.int64), name, declared)
        return time
    if column.dtype.kind == "m":
        return np.asarray(column.dt.total_seconds(), dtype=np.float64)
    dates = to_datetimes(column, name, where)
    if dates.isna().all():
        return np.full(len(dates), np.nan)
    return np.asarray((dates - dates.min()) / pd.Timedelta(seconds=1), dtype=np.float64)


def to_datetimes(column: pd.Series[Any], name: str, where: Callable[[int], str]) -> pd.Series[Any]:
    """Dates of a column of dates or text; NaT where missing, `LogError` for text that is no time.

    Text may be an ISO 8601 time, a date as 7.1.2026 with a time, or the time of day alone (from 1970-01-01 on, past
    midnight on the next day).
    """
    import pandas as pd

    dates = pd.to_datetime(column, format="ISO8601", utc=True, errors="coerce")
    known = column.notna()
    if dates.notna().sum() < known.sum():
        # ISO 8601 allows a decimal comma, pandas does not.
        tidy = column.astype("string").str.strip().str.replace(",", ".", regex=False)
        tidy = tidy.str.replace(_DOTTED_DATE, lambda date: f"{date[3]}-{date[2]:0>2}-{date[1]:0>2}", regex=True)
        if tidy[known].str.fullmatch(_TIME_OF_DAY).all():
            clock = pd.to_timedelta(tidy)
            midnights = (clock.ffill().diff() < -_HALF_A_DAY).cumsum()
            dates = pd.Timestamp(0, tz="UTC") + clock + pd.to_timedelta(midnights, unit="D")
        else:
            dates = pd.to_datetime(tidy, format="ISO8601", utc=True, errors="coerce")
    if lost := int((dates.isna() & known).sum()):
        row = int(np.argmax((dates.isna() & known).to_numpy()))
        text = f"{name} is {column.iloc[row]!r}; seconds, an ISO 8601 time (2026-01-07T12:00:00.05Z), a time of day "
        text += f"(12:00:00.05) or an epoch time was expected. So are {lost} of {int(known.sum())} rows."
        mend = "Delete these rows, or write their times so." if lost < known.sum() else "Write the column so."
        raise LogError(text, where=where(row), mend=mend)
    return dates


def start_epoch(column: pd.Series[Any], time: FloatArray, name: str, declared: str) -> float | None:
    """Epoch in s of time zero, where ``time`` in s is `column_to_seconds` of ``column``; None where unknown."""
    import pandas as pd

    known = np.flatnonzero(np.isfinite(time))
    if not known.size:
        return None
    first = column.iloc[int(known[0])]
    if isinstance(first, pd.Timedelta):
        return None
    if isinstance(first, str | pd.Timestamp):
        moment = to_datetimes(pd.Series([first]), name, str).iloc[0].timestamp()
    else:
        moment = float(first) * SCALES[time_unit(name, abs(float(first)), declared)]
    return float(moment - time[known[0]]) if moment > EPOCH_FROM else None


# --- order ---------------------------------------------------------------------------------------------------

Samples = Mapping[str, FloatArray]


def timed_rows(time: FloatArray, clock: str, where: str, remarks: list[Remark]) -> IntArray:
    """Numbers of the readings with a time, in time order where only their places changed; `LogError` for no time."""
    rows = np.flatnonzero(is_plausible(time))
    if len(time) and not len(rows):
        text = f"{clock} holds no time in any of its {len(time)} samples."
        raise LogError(text, where=where, mend="Map the column or field that holds the time in [signals] time.")
    if lost := len(time) - len(rows):
        text = f"{clock} is missing in {lost} samples; they were left out."
        remarks.append(Remark(kind="missing", count=lost, text=text))
    return _sorted_rows(time, rows, clock, remarks) if _are_shuffled(time[rows]) else rows


def make_monotonic(
    time: FloatArray, values: Samples, *, clock: str, place: Callable[[int], str], sortable: bool, where: str
) -> tuple[FloatArray, Samples, list[Remark]]:
    """Time and values of one clock in strictly increasing time, with remarks on order and duplicates.

    The faults of the clock have been remedied before. Samples with one time stamp are merged: each signal keeps its
    first value that is not missing. Messages are sorted where the format is ``sortable``. Raises `LogError` if time
    still runs backwards or leaps, or most time stamps repeat.
    """
    steps = np.diff(time)
    remarks: list[Remark] = []
    if steps.size and not steps.min() > _TICK:
        rows = np.arange(len(time))
        if sortable and -_MAX_DISORDER <= steps.min() < 0.0:
            rows = _sorted_rows(time, rows, clock, remarks)
        stamps = time[rows]
        backward = stamps < np.maximum.accumulate(stamps)
        if count := int(np.count_nonzero(backward)):
            row = int(np.argmax(backward))
            text = f"{clock} runs backwards at {place(row)}, from {stamps[row - 1]:.10g} s to {stamps[row]:.10g} s; "
            text += f"{count} of {len(stamps)} samples are not later than those before them."
            mend = "Split the log where its clock was set back, or map another time."
            if np.all(np.diff(stamps) <= 0.0):
                mend = "The newest row comes first: turn the order of the rows around."
            raise LogError(text, where=where, mend=mend)
        time, values = _merge_duplicates(rows, time, values, clock, where, remarks)
        steps = np.diff(time)
    if (at := find_leap(time)) is not None:
        text = f"{clock} leaps by {steps[at]:.6g} s after sample {at + 1}."
        raise LogError(text, where=where, mend="Cut the log where its clock was set.")
    duration = float(time[-1] - time[0]) if time.size else 0.0
    if duration > _MAX_DURATION:
        days, limit = duration / 86400.0, _MAX_DURATION / 86400.0
        text = f"{clock} runs over {days:.4g} days; a run of at most {limit:.0f} was expected."
        raise LogError(text, where=where, mend="Check the unit of time in rovid.toml, or cut the log.")
    return time, values, remarks


def without_rounding(time: FloatArray) -> FloatArray:
    """(n,) s of a regular clock with rounded stamps, as 7 Hz in ms; ``time`` itself if its stamps are not of this kind.

    Rounding beats with the interval, and the error of the angle is then a wave of one frequency. Stamps are of this
    kind if all are whole multiples of a decimal and a straight line through the number of intervals misses none of them
    by more than rounding does. Rows may be missing. The line replaces the stamps.
    """
    steps = np.diff(time)
    interval = subsampled_median(steps)
    if len(time) < _MIN_REGULAR:
        return time
    interval = float(np.mean(steps[np.abs(steps - interval) < 0.5 * interval]))
    decimals = (one for one in _ROUNDED_TO if np.all(np.abs(np.remainder(steps / one + 0.5, 1.0) - 0.5) < 0.01))
    resolution = next(decimals, 0.0)
    if not 0.0 < resolution < 0.5 * interval:
        return time
    number = np.concatenate(([0.0], np.cumsum(np.rint(steps / interval))))
    # The line of least squares; np.polyfit takes the memory of six more columns.
    about, since = number - number.mean(), time - time[0]
    slope = about @ since / (about @ about)
    line = slope * about + since.mean()
    scatter = np.ptp(since - line)
    # The fitted line is off by 0.6 resolution / sqrt(n) at its ends, one standard deviation of uniform rounding errors.
    is_rounded = 0.5 * resolution < scatter <= resolution * (1.0 + 4.0 / math.sqrt(len(time)))
    return time[0] + line if is_rounded and np.all(np.diff(number) > 0.0) else time


def _sorted_rows(time: FloatArray, rows: IntArray, clock: str, remarks: list[Remark]) -> IntArray:
    count = int(np.count_nonzero(np.diff(time[rows]) < 0.0))
    text = f"{clock} steps back {count} times: readings are stored out of order; they were sorted."
    remarks.append(Remark(kind="backward", count=count, text=text))
    return rows[np.argsort(time[rows], kind="stable")]


def _are_shuffled(time: FloatArray) -> bool:
    """Whether rows, or whole blocks of them, only left their places. A clock that was set back interleaves its rows.

    Sorted rows then follow each other at even intervals, and no row is missing where two blocks meet.
    """
    if np.all(np.diff(time) >= 0.0):
        return False
    order = np.argsort(time, kind="stable")
    steps, moved = np.diff(time[order]), np.diff(order) != 1
    interval = subsampled_median(steps)
    disorder = float(np.max(np.maximum.accumulate(time) - time))
    are_blocks = _MIN_BLOCK * moved.sum() < len(time) and steps[moved].max() < 1.5 * interval
    return bool(steps.min() > 0.5 * interval and (disorder < _MAX_PLACES * interval or are_blocks))


def _merge_duplicates(
    rows: IntArray, time: FloatArray, values: Samples, clock: str, where: str, remarks: list[Remark]
) -> tuple[FloatArray, Samples]:
    stamps = time[rows]
    fresh = np.concatenate(([True], np.diff(stamps) > _TICK))[: len(stamps)]
    group = np.cumsum(fresh) - 1
    merged = {}
    for name, column in values.items():
        known = np.flatnonzero(is_plausible(column[rows]))[::-1]
        merged[name] = np.full(int(fresh.sum()), np.nan)
        merged[name][group[known]] = column[rows[known]]  # In reverse: the first of a group is written last.
    if repeated := int(len(rows) - fresh.sum()):
        if repeated > _MAX_DUPLICATE * len(rows):
            text = f"{clock} repeats the stamp before it in {repeated} of {len(rows)} samples; most should differ."
            raise LogError(text, where=where, mend="Log the time with more decimals, or map another time.")
        text = f"{clock} repeats the stamp before it {repeated} times; the first of each was kept."
        remarks.append(Remark(kind="duplicate", count=repeated, text=text))
    return stamps[fresh], merged


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

    The order of preference: seconds in two columns; by name; dates and times of day; by name, where stamps
    repeat or step back, which is a fault to report; the first column of numbers that does not count rows. A count
    of rows without the name of a time, as the frame of a camera, is no time.
    """
    splits = [parts for name in numbers if (parts := clock_parts(name, numbers)) is not None]
    joined = [str(parts) for parts in splits if _is_split(parts, numbers)]
    rests = {parts.rest for parts in splits}
    numeric = [name for name, values in numbers.items() if name not in rests and _is_increasing(values)]
    increasing = [*numeric, *dated, *texts]
    named = [name for name in increasing if name_words(name) & CLOCK_WORDS]
    likely = [name for name in named if _is_named_clock(name)]
    uneven = [name for name in numeric if not counts_rows(numbers[name])]
    plain = [name for name in likely or named if name in numbers or name in dated]
    faulty = [name for name, values in numbers.items() if _is_named_clock(name) and _mostly_grows(values)]
    return next(iter(joined or plain or list(dated) or likely or named or faulty or uneven), "")


def _is_named_clock(name: str) -> bool:
    words = name_words(name)
    return bool(words & CLOCK_WORDS) and not words & NOT_CLOCK


def _mostly_grows(values: FloatArray) -> bool:
    """Whether more than half of the steps that are not zero are forward."""
    steps = np.diff(values[np.isfinite(values)])
    return bool(np.count_nonzero(steps > 0.0) > 0.5 * np.count_nonzero(steps))


def _is_split(parts: ClockParts, numbers: Mapping[str, FloatArray]) -> bool:
    seconds, rest = numbers[parts.seconds], numbers[parts.rest]
    if len(seconds) != len(rest):
        return False
    time, _ = parts.joined(seconds, rest, None, Path())
    return time is not seconds and _is_increasing(time)


def counts_rows(values: FloatArray) -> bool:
    """Whether numbers are whole and grow by 1."""
    known = values[np.isfinite(values)]
    return known.size > 1 and bool(np.all(np.diff(known) == 1.0) and np.all(known == np.round(known)))


def _is_increasing(values: FloatArray) -> bool:
    known = values[np.isfinite(values)]
    return len(known) > 1 and bool(np.all(known[1:] > known[:-1]))
