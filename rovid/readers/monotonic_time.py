"""Puts the samples of a clock in order and says what that cost."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.core.errors import LogError
from rovid.readers.raw_log import is_plausible
from rovid.trial.trial import Remark

# Recorders write messages a little out of order; more than this is a clock that was set back.
_SHUFFLE = 1.0
_MOST_BACKWARD = 0.05
_MOST_DUPLICATE = 0.5
# A clock that is set while recording (GPS fix, NTP) jumps by far more than the log lasts.
_LEAP, _LEAP_RATIO = 3600.0, 10.0
# Stamps closer than this are one; runs longer than this (35 days) are none: floats keep ticks apart until then.
_TICK, _LONGEST = 1e-9, 3e6


@dataclass(frozen=True, kw_only=True, eq=False)
class Ordered:
    """Samples in strictly increasing time.

    Attributes
    ----------
    time
        (n,) s.
    values
        Signal -> (n,) as logged.
    remarks
        What was left out.
    """

    time: FloatArray
    values: Mapping[str, FloatArray]
    remarks: tuple[Remark, ...] = ()


def order(
    time: FloatArray,
    values: Mapping[str, FloatArray],
    *,
    clock: str,
    place: Callable[[int], str],
    sortable: bool,
    where: str,
) -> Ordered:
    """Samples of one clock in strictly increasing time.

    Of samples with one time stamp, each signal keeps the first value that is not missing. A sample earlier
    than the latest before it is left out, unless the format is ``sortable`` and the clock was not set back.

    Raises
    ------
    LogError
        More than 5 % of the samples run backwards, most stamps repeat, or the clock leaps.
    """
    remarks: list[Remark] = []
    with np.errstate(over="ignore", invalid="ignore"):  # of what is no time at all
        steps = np.diff(time)
    if not _only_grows(time, steps):
        time, values, remarks = _mend(time, values, clock, place, sortable=sortable, where=where)
        steps = np.diff(time)
    _refuse_leap(time, steps, clock, where)
    return Ordered(time=time, values=values, remarks=tuple(remarks))


def _only_grows(time: FloatArray, steps: FloatArray) -> bool:
    """Whether (n,) sensible times, (n-1,) ``steps`` apart, all come later than the one before."""
    # A NaN makes this false; between sensible ends, increasing values are sensible.
    grows = bool(steps.min(initial=np.inf) > _TICK)
    return grows and bool(is_plausible(time[:1]).all() and is_plausible(time[-1:]).all())


def _mend(
    time: FloatArray,
    values: Mapping[str, FloatArray],
    clock: str,
    place: Callable[[int], str],
    *,
    sortable: bool,
    where: str,
) -> tuple[FloatArray, Mapping[str, FloatArray], list[Remark]]:
    remarks: list[Remark] = []
    rows = np.flatnonzero(is_plausible(time))
    if len(time) and not len(rows):
        text = f"{clock} holds no time in any of its {len(time)} samples."
        raise LogError(text, where=where, mend="Map the column or field that holds the time in [signals] time.")
    if lost := len(time) - len(rows):
        remarks.append(_remark("missing", lost, f"{clock} is missing in {lost} samples; they were left out."))
    if sortable:
        rows = _sorted(rows, time, clock, remarks)
    rows = _forward(rows, time, clock, place, remarks, where)
    kept, merged = _merge(rows, time, values)
    if doubled := len(rows) - len(kept):
        _refuse_coarse(doubled, len(rows), clock, where)
        text = f"{clock} repeats the stamp before it {doubled} times; the first of each was kept."
        remarks.append(_remark("duplicate", doubled, text))
    return kept, merged, remarks


def _remark(kind: str, count: int, text: str) -> Remark:
    return Remark(kind=kind, count=int(count), text=text)


def _sorted(rows: IntArray, time: FloatArray, clock: str, remarks: list[Remark]) -> IntArray:
    steps = np.diff(time[rows])
    if not steps.size or steps.min() >= 0 or steps.min() < -_SHUFFLE:
        return rows
    count = int(np.count_nonzero(steps < 0))
    remarks.append(_remark("backward", count, f"{clock}: {count} messages are stored out of order; they were sorted."))
    return rows[np.argsort(time[rows], kind="stable")]


def _forward(
    rows: IntArray,
    time: FloatArray,
    clock: str,
    place: Callable[[int], str],
    remarks: list[Remark],
    where: str,
) -> IntArray:
    stamps = time[rows]
    backward = stamps < np.maximum.accumulate(stamps)
    count = int(np.count_nonzero(backward))
    if not count:
        return rows
    at = int(np.argmax(backward))
    if count > _MOST_BACKWARD * len(rows):
        raise LogError(
            f"{clock} runs backwards at {place(int(rows[at]))}, from {stamps[at - 1]:.10g} s to "
            f"{stamps[at]:.10g} s; {count} of {len(rows)} samples are not later than those before them.",
            where=where,
            mend="Split the log where its clock was set back, or map another time.",
        )
    text = f"{clock} runs backwards, first at {place(int(rows[at]))}; {count} samples were left out."
    remarks.append(_remark("backward", count, text))
    return rows[~backward]


def _merge(
    rows: IntArray, time: FloatArray, values: Mapping[str, FloatArray]
) -> tuple[FloatArray, dict[str, FloatArray]]:
    """One row a stamp; each signal's first value there that is not missing."""
    stamps = time[rows]
    fresh = np.concatenate(([True], np.diff(stamps) > _TICK))[: len(stamps)]
    group = np.cumsum(fresh) - 1
    merged = {}
    for name, column in values.items():
        known = np.flatnonzero(is_plausible(column[rows]))[::-1]
        merged[name] = np.full(int(fresh.sum()), np.nan)
        merged[name][group[known]] = column[rows[known]]  # backwards: the first of a group is written last
    return stamps[fresh], merged


def _refuse_coarse(doubled: int, total: int, clock: str, where: str) -> None:
    if doubled > _MOST_DUPLICATE * total:
        text = f"{clock} repeats the stamp before it in {doubled} of {total} samples; most should differ."
        raise LogError(text, where=where, mend="Log the time with more decimals, or map another time.")


def _refuse_leap(time: FloatArray, steps: FloatArray, clock: str, where: str) -> None:
    whole = float(time[-1] - time[0]) if time.size else 0.0
    if whole <= _LEAP:
        return
    at = int(np.argmax(steps))
    rest = float(steps[steps <= _LEAP].sum())
    if steps[at] > max(_LEAP, _LEAP_RATIO * rest):
        raise LogError(
            f"{clock} leaps by {steps[at]:.6g} s after sample {at + 1}, while all between such leaps lasts "
            f"{rest:.6g} s.",
            where=where,
            mend="Cut the log where its clock was set.",
        )
    if whole > _LONGEST:
        raise LogError(
            f"{clock} runs over {whole / 86400.0:.4g} days; a run of at most {_LONGEST / 86400.0:.0f} was expected.",
            where=where,
            mend="Check the unit of time in rovid.toml, or cut the log.",
        )
