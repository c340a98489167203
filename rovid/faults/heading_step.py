"""A heading that jumps between two readings and stays there: a reset of the filter, a disturbance, a new origin.

The step from one reading to the next is compared with the steps before and after it. A vehicle that starts to turn
between two readings steps by no more than it does afterwards. A fast vehicle that turns and stops between two readings
does so at other places of the log, too: a jump is several times larger than all other steps of this kind.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray, IntArray
from rovid.faults.base import Detection, Detectors, TrialData
from rovid.trial.fault import Fault
from rovid.trial.segments import subsampled_median
from rovid.trial.trial import Trial

# Steps on each side that a step is compared with; a jump hides other jumps as near.
_REACH = 4
# rad; smaller steps cannot be told from motion, and a cut costs the state of the vehicle.
_MIN_STEP, _MIN_STATED = np.deg2rad(2.0), np.deg2rad(0.5)
# Ratio to the largest other departure, and robust standard deviations. Among 1000 Gaussian departures the largest two
# have a ratio above 3 in fewer than one of 10^9 logs.
_RATIO, _SIGMAS = 3.0, 8.0
# Jumps in one log at most: more are noise, or motion.
_MAX_JUMPS = 20
# Steps across longer intervals, in medians, are gaps: the vehicle moved in them, and perhaps by half a turn.
_MAX_INTERVAL = 1.5
# A jump up to this many steps after a change of the commands may be motion, unless the commands change at least this
# often elsewhere, without a jump, and it is this many times larger than the steps of the motion elsewhere.
_COMMAND_STEPS, _MIN_CHANGES, _FASTER = 20, 5, 1.3
# Faults of the clock, with which a reading may have its neighbour's stamp. Its step is then off by the motion of one
# interval; half of that is for scatter.
_OF_CLOCK, _MISSTAMPED = frozenset({"repeated_stamps", "lost_rows", "arrival_bursts"}), 1.5
# A jump that is undone within this many readings, to this share of its size, is a wild reading.
_MAX_WILD, _RETURNED = 3, 0.5
# This many jumps of one size, within this share, are wraps.
_REPEATED, _SAME_SIZE = 3, 0.05
# Share of the commanded range that is a change of the commands.
_CHANGE = 0.05


@dataclass(frozen=True, kw_only=True, eq=False)
class Steps:
    """The measured readings of a trial and the step after each of them."""

    time: FloatArray  #: (n,) s.
    angle: FloatArray  #: (n,) rad; or a position in m.
    commands: FloatArray  #: (n, k) at the readings.

    @classmethod
    def of(cls, trial: Trial) -> Self:
        """The steps of the measured position of ``trial``."""
        rows = slice(None) if trial.measured.all() else trial.measured  # a slice copies nothing
        return cls(time=trial.time[rows], angle=trial.position[rows], commands=trial.commands[rows])

    @classmethod
    def of_readings(cls, trial: Trial, name: str) -> Self:
        """The steps of another sensor of ``trial``."""
        own = trial.readings[name]
        rows = np.maximum(np.searchsorted(trial.time, own.time, side="right") - 1, 0)
        return cls(time=own.time, angle=own.values, commands=trial.commands[rows])

    @cached_property
    def departures(self) -> FloatArray:
        """(n-1,) rad, or m, by which each step leaves the range of the steps around it; 0 in gaps and at the ends."""
        intervals = np.diff(self.time)
        rates = np.diff(self.angle) / intervals
        near = np.lib.stride_tricks.sliding_window_view(rates, _REACH)
        before, after = near[: -_REACH - 1], near[_REACH + 1 :]
        low = np.minimum(before.min(axis=1), after.min(axis=1))
        high = np.maximum(before.max(axis=1), after.max(axis=1))
        inner = slice(_REACH, len(rates) - _REACH)
        found = np.zeros(len(rates))
        found[inner] = (rates[inner] - np.clip(rates[inner], low, high)) * intervals[inner]
        found[intervals > _MAX_INTERVAL * subsampled_median(intervals)] = 0.0
        return found

    def motion(self, at: int) -> float:
        """Largest magnitude of the steps about the step ``at``."""
        near = np.abs(np.diff(self.angle[max(at - _REACH, 0) : at + _REACH + 2]))
        return float(np.max(np.delete(near, min(at, _REACH))))

    @cached_property
    def changes(self) -> BoolArray:
        """(n-1,) whether a command changed in each step."""
        change = np.abs(np.diff(self.commands, axis=0))
        changed: BoolArray = np.any(change > _CHANGE * np.ptp(self.commands, axis=0), axis=1)
        return changed


def _detect(data: TrialData) -> Iterator[Detection[TrialData]]:
    trial = data.trial
    if trial.rate_only or not trial.axis.angular or trial.measured.sum() < 4 * _REACH:
        return
    if data.known & {"scaled_heading", "saturated_sensor"}:
        return  # Such a heading jumps where it wraps.
    steps = Steps.of(trial)
    stated = [(at, size) for at, size in data.resets if abs(size) > _MIN_STATED and 0.0 < at < trial.time[-1]]
    found = {int(at) for at in jumps(steps, _MIN_STEP)}
    near = 2.0 * _REACH * trial.sampling_interval
    if data.known & _OF_CLOCK:
        found = {at for at in found if abs(steps.departures[at]) > _MISSTAMPED * steps.motion(at)}
    repaired = [*trial.cuts, *(at for at, _ in stated)]
    found = {at for at in found if np.min(np.abs(steps.time[at + 1] - repaired), initial=np.inf) > near}
    noise = 1.4826 * float(np.median(np.abs(steps.departures)))
    for at, size in stated:
        yield _detection(trial.name, at, size, None, "the log states a reset of the heading")
    sized = []
    for index in sorted(found):
        size, error = jump_size(steps, index, noise)
        sized.append((index, size - 2.0 * np.pi * round(size / (2.0 * np.pi)), error))
    sizes = np.abs([size for _, size, _ in sized])
    if len(sizes) >= _REPEATED and np.ptp(sizes) < _SAME_SIZE * np.median(sizes):
        return  # The heading wraps at another period than a turn: it is clipped, or of another scale.
    for index, size, error in sized:
        what = f"the {trial.axis.position_words} jumps and stays"
        yield _detection(trial.name, float(steps.time[index + 1]), size, error, what)


def _detection(log: str, at: float, size: float, error: float | None, what: str) -> Detection[TrialData]:
    fault = Fault(
        fault="heading_step",
        logs=(log,),
        at=(at,),
        size=size,
        standard_error=error,
        unit="rad",
        text=f"{log}: {what} at {at:.2f} s, by {np.rad2deg(size):+.1f} deg.",
        remedy="cut",
    )
    return Detection(fault=fault, done="The log was cut there.", repair=lambda data: data.cut_at(at))


def jumps(steps: Steps, least: float) -> IntArray:
    """Numbers of the steps that are jumps, each of ``least`` or more."""
    size = np.abs(steps.departures)
    order = np.argsort(size)[::-1]
    sigma = 1.4826 * float(np.median(size))
    left = size.copy()
    found: list[int] = []
    for _ in range(_MAX_JUMPS):
        at = int(np.argmax(left))
        found.append(at)
        left[max(at - _REACH, 0) : at + _REACH + 1] = 0.0
        # All that were taken so far are jumps if the smallest of them stands out from the rest.
        limit = max(_RATIO * float(left.max()), _SIGMAS * sigma, least)
        if size[found].min() > limit:
            staying = np.array([at for at in found if not _returns(steps, at)], dtype=int)
            return staying[~_are_commanded(steps, staying)]
        if size[order[0]] < least:
            break
    return np.array([], dtype=int)


def _returns(steps: Steps, at: int) -> bool:
    """Whether a step back follows or precedes the step ``at``, and the path continues without the readings between."""
    rates, count = np.diff(steps.angle) / np.diff(steps.time), len(steps.angle)
    for length in range(1, _MAX_WILD + 1):
        for back, first in ((at - length, at - length), (at + length, at)):
            last = first + length + 1
            if first < 0 or last >= count or -steps.departures[back] / steps.departures[at] < _RETURNED:
                continue
            near = np.concatenate((rates[max(first - _REACH, 0) : first], rates[last : last + _REACH]))
            seconds = steps.time[last] - steps.time[first]
            rate = (steps.angle[last] - steps.angle[first]) / seconds
            left = abs(rate - np.clip(rate, near.min(initial=rate), near.max(initial=rate))) * seconds
            if left < _RETURNED * abs(steps.departures[at]):
                return True
    return False


def _are_commanded(steps: Steps, staying: IntArray) -> BoolArray:
    """(m,) whether a change of the commands may explain each of the (m,) ``staying`` steps."""
    after = staying[:, None] - np.flatnonzero(steps.changes)
    near = (after >= -1) & (after <= _COMMAND_STEPS)
    others = np.count_nonzero(~near.any(axis=0))
    sizes = np.abs(np.diff(steps.angle))
    usual = float(np.max(np.delete(sizes, staying), initial=0.0))
    # After one change the rate goes to its new value: only a pulse, of two changes, moves it away and back.
    return np.asarray((near.sum(axis=1) > 1) & ((others < _MIN_CHANGES) | (sizes[staying] < _FASTER * usual)))


def jump_size(steps: Steps, at: int, noise: float) -> tuple[float, float]:
    """Size of a jump between the lines through the readings on both sides, and its standard error."""
    middle = 0.5 * (steps.time[at] + steps.time[at + 1])
    lines = [
        np.polyval(np.polyfit(steps.time[rows] - middle, steps.angle[rows], 1), 0.0)
        for rows in (slice(at - _REACH, at + 1), slice(at + 1, at + 2 + _REACH))
    ]
    # The value of a line through m readings, half an interval beyond its end, has about 4/m of a reading's variance.
    return float(lines[1] - lines[0]), noise * float(np.sqrt(8.0 / (_REACH + 1)))


DETECTORS: Detectors = {"trial": (_detect,)}
