"""Heading, or another position or rate, as logged -> as measured: repeats, spikes, frozen stretches, whole turns.

Nothing is interpolated and nothing is smoothed. A value that is no measurement becomes NaN and is counted.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray, IntArray
from rovid.readers.raw_log import subsampled_median
from rovid.trial.trial import Remark

TURN = 2.0 * np.pi
_DEG = np.pi / 180.0

# A gap: no heading for longer than five usual intervals, and than half a second.
_GAP_INTERVALS, _GAP_SECONDS = 5.0, 0.5

# A spike is wrong by six robust sigmas.
_SIGMAS = 6.0
_LONGEST_SPIKE = 3
_MORE_ROUNDS = 2
# Its edges are steep: a smooth swing out and back within a few samples is motion.
_EDGE_SHARE = 0.6

# A frozen sensor: this many identical values over this time, ended by a jump that its neighbours do not know.
_FROZEN_SAMPLES, _FROZEN_SECONDS, _FROZEN_RATIO = 10, 1.0, 4.0
# With a jump of this size at both ends (or at the start of the log), shorter stretches count too.
_STUCK_SAMPLES = 4

# Held repeats: between steps that are not one quantum of the log, each row of a true measurement differs.
_FEWEST_RUNS, _SAME_STEP = 20, 1.02

# Rates at the ends of a gap are taken over this time.
_RATE_SECONDS = 1.0


@dataclass(frozen=True, kw_only=True)
class Kind:
    """What is measured, in rad, m, rad/s or m/s.

    Attributes
    ----------
    turn
        After which it is the same again; infinite for what is no angle.
    spike
        A smaller step is no spike.
    swing
        Step that a vehicle could make and take back between samples a second apart, and the power of the interval
        with which it grows: logs of 1 Hz show honest jerks of many degrees.
    jump
        A step so large is none of the vehicle's, whatever the noise.
    """

    turn: float
    spike: float
    swing: tuple[float, int]
    jump: float

    def wrap(self, step: FloatArray) -> FloatArray:
        """``step`` the short way round."""
        if np.isinf(self.turn):
            return step
        return step - self.turn * np.rint(step / self.turn)


# An acceleration to and fro of 160 deg/s^2 (4 * 40), or of 4 m/s^2.
ANGLE = Kind(turn=TURN, spike=0.5 * _DEG, swing=(40.0 * _DEG, 2), jump=20.0 * _DEG)
DISTANCE = Kind(turn=np.inf, spike=0.03, swing=(1.0, 2), jump=1.0)
TURNING = Kind(turn=np.inf, spike=1.0 * _DEG, swing=(160.0 * _DEG, 1), jump=60.0 * _DEG)
SPEED_KIND = Kind(turn=np.inf, spike=0.03, swing=(4.0, 1), jump=1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Cleaned:
    """What was measured, on the clock it was logged with.

    Attributes
    ----------
    position
        (n,) in SI, unwrapped, NaN where not measured.
    remarks
        What was taken out.
    """

    position: FloatArray
    remarks: tuple[Remark, ...]


def gap_limit(intervals: FloatArray) -> float:
    """Longest interval in s that is still no gap, for samples ``intervals`` apart."""
    return max(_GAP_INTERVALS * subsampled_median(intervals), _GAP_SECONDS)


class _Path:
    """Measured samples with their steps, which each of the tests below looks at."""

    def __init__(self, time: FloatArray, angle: FloatArray, kind: Kind, name: str) -> None:
        self.time, self.angle, self.kind, self.name = time, angle, kind, name
        self.steps = np.diff(angle)
        self.far = np.arange(0)
        if self.steps.size and max(self.steps.max(), -self.steps.min()) > kind.turn / 2.0:
            self.far = np.flatnonzero(np.abs(self.steps) > kind.turn / 2.0)

    @cached_property
    def short(self) -> FloatArray:
        """(n-1,) rad, each step the short way round."""
        if not self.far.size:
            return self.steps
        short = self.steps.copy()
        short[self.far] = self.kind.wrap(short[self.far])
        return short

    @cached_property
    def jerk(self) -> float:
        """Largest step that a vehicle could make and take back between samples."""
        size, power = self.kind.swing
        return float(size * subsampled_median(np.diff(self.time[:10_000])) ** power)

    @cached_property
    def least(self) -> float:
        """Smallest step in rad: the resolution of the log, or the step of a steady noise-free turn."""
        sizes = np.abs(self.short)
        return float(sizes[sizes > 1e-9].min(initial=np.pi))

    @cached_property
    def flicker(self) -> float:
        """Resolution in rad of a log that flickers between neighbouring values; 0 for a finer one."""
        steps = self.short[np.abs(self.short) > 1e-9]
        smallest = steps[np.abs(steps) <= _SAME_STEP * self.least]
        both_ways = smallest.size > 0.3 * steps.size and smallest.min() < 0.0 < smallest.max()
        return self.least if both_ways else 0.0

    def without(self, bad: BoolArray) -> _Path:
        return _Path(self.time[~bad], self.angle[~bad], self.kind, self.name)


def clean(time: FloatArray, angle: FloatArray, kind: Kind = ANGLE, name: str = "heading") -> Cleaned:
    """Take out what is no measurement and unwrap the rest.

    Parameters
    ----------
    time
        (n,) s, strictly increasing.
    angle
        (n,) in SI, finite; an angle may be wrapped in whatever way or not at all.
    name
        What it is called in remarks.
    """
    remarks: list[Remark] = []
    good: IntArray | None = None
    path = _Path(time, angle, kind, name)
    for find, what, text in _TESTS:
        bad = find(path)
        if bad is None:
            continue
        count = int(np.count_nonzero(bad))
        remarks.append(Remark(kind=what, count=count, text=text.format(name, count)))
        good = np.flatnonzero(~bad) if good is None else good[~bad]
        path = path.without(bad)
    unwrapped = _unwrap(path, remarks)
    if good is None:
        return Cleaned(position=unwrapped, remarks=tuple(remarks))
    position = np.full(len(angle), np.nan)
    position[good] = unwrapped
    return Cleaned(position=position, remarks=tuple(remarks))


def _repeats(path: _Path) -> BoolArray | None:
    """Rows that hold an older reading because the logger is faster than the sensor."""
    steps, count = path.steps, len(path.angle)
    if np.count_nonzero(steps) > 0.75 * len(steps):
        return None
    edges = np.flatnonzero(steps) + 1
    if len(edges) <= _FEWEST_RUNS:
        return None
    held = _rows_a_reading(path, edges)
    if held < 2:
        return None
    starts = np.concatenate(([0], edges))
    lengths = np.diff(np.append(starts, count))
    phase = np.arange(count) - np.repeat(starts, lengths)
    left = np.repeat(lengths, lengths) - phase
    # A long run is a vehicle at rest: the sensor measured the same again every ``held`` rows.
    bad = (phase > 0) & ((phase % held > 0) | (left < 0.75 * held))
    return bad if bad.any() else None


def _rows_a_reading(path: _Path, edges: IntArray) -> int:
    """For how many rows a reading stays while the vehicle moves; 1 where too few of them tell."""
    fast = np.abs(path.short[edges - 1]) > _SAME_STEP * path.least  # not one quantum, which rest can make
    runs = np.diff(edges)[fast[:-1] & fast[1:]]
    return round(float(np.median(runs))) if len(runs) >= _FEWEST_RUNS else 1


def _spikes(path: _Path) -> BoolArray | None:
    """Samples that leave a smooth path and come back to it within three, or begin or end the log."""
    first = _spikes_once(path)
    if first is None:
        return None
    bad = first
    for _ in range(_MORE_ROUNDS):  # spikes close together hide each other
        more = _spikes_once(path.without(bad))
        if more is None:
            break
        bad[np.flatnonzero(~bad)[more]] = True
    return bad


def _spikes_once(path: _Path) -> BoolArray | None:
    count = len(path.angle)
    if count < 6:
        return None
    bend = np.diff(path.short)
    limit = _spike_limit(path, bend)
    if bend.max() <= limit and bend.min() >= -limit:
        return None
    limit = max(limit, 2.5 * path.flicker)
    bad = np.zeros(count, dtype=bool)
    starts = np.flatnonzero((bend > limit) | (bend < -limit)) + 2
    for length in range(_LONGEST_SPIKE, 0, -1):  # or the good samples between two long spikes would pass for one
        inside = starts[starts + length + 1 < count]
        for first in inside[_leaves_path(path, inside, length, limit)].tolist():
            _mark(bad, path, first, length, limit)
    _ends(bad, path)
    return bad if bad.any() else None


def _spike_limit(path: _Path, bend: FloatArray) -> float:
    few = bend[:: len(bend) // 10_000 + 1]
    sigma = 1.4826 * float(np.median(np.abs(few))) / 2.0  # of a sample against the mean of its neighbours
    return max(_SIGMAS * sigma, path.kind.spike, path.jerk)


def _leaves_path(path: _Path, first: IntArray, length: int, limit: float) -> BoolArray:
    """(m,) whether the ``length`` samples from ``first`` on are off a path that goes on behind them."""
    time, angle, wrap = path.time, path.angle, path.kind.wrap
    before, after = first - 1, first + length
    span = time[after] - time[before]
    slope = wrap(angle[after] - angle[before]) / span
    # Where the slopes on both sides disagree with the bridge, the vehicle itself was changing its rate.
    left = wrap(angle[before] - angle[before - 1]) / (time[before] - time[before - 1])
    right = wrap(angle[after + 1] - angle[after]) / (time[after + 1] - time[after])
    bent = np.maximum(np.abs(left - slope), np.abs(right - slope))
    off = np.stack(
        [
            np.abs(wrap(angle[first + k] - angle[before] - slope * (time[first + k] - time[before])))
            for k in range(length)
        ]
    )
    edge = np.minimum(off[0], off[-1])
    steep = (edge >= _EDGE_SHARE * off.max(axis=0)) | (edge > path.kind.jump)
    return np.asarray((edge > limit + bent * span) & steep)


def _mark(bad: BoolArray, path: _Path, first: int, length: int, limit: float) -> None:
    """Mark the spike, without the samples inside it that lie on the bridge; not where one is known already."""
    before, after = first - 1, first + length
    if bad[before : after + 1].any():
        return
    time, angle, wrap = path.time, path.angle, path.kind.wrap
    slope = wrap(angle[after] - angle[before]) / (time[after] - time[before])
    inside = slice(first, after)
    bad[inside] = np.abs(wrap(angle[inside] - angle[before] - slope * (time[inside] - time[before]))) > limit


def _ends(bad: BoolArray, path: _Path) -> None:
    """A first or last value that the rest of the log knows nothing of, such as 0 before the first fix."""
    sizes = np.abs(path.short)
    ends = np.concatenate((sizes[:_LONGEST_SPIKE], sizes[-_LONGEST_SPIKE:]))
    if ends.max() <= path.kind.jump:
        return
    rank = max(0, len(sizes) - 1 - max(_LONGEST_SPIKE, len(sizes) // 1000))
    limit = max(path.kind.jump, path.jerk, 10.0 * float(np.partition(sizes, rank)[rank]))
    for length in range(1, _LONGEST_SPIKE + 1):
        if sizes[length - 1] > limit:
            bad[:length] = True
        if sizes[-length] > limit:
            bad[-length:] = True


def _frozen(path: _Path) -> BoolArray | None:
    """Stretches in which the sensor repeated one value and then jumped to where the vehicle had gone."""
    still = path.steps == 0.0
    if not still.size or not (still[0] or (still[:-2] & still[1:-1] & still[2:]).any()):
        return None
    bad = np.zeros(len(path.angle), dtype=bool)
    moves = np.flatnonzero(~still)
    end = int(moves[-1]) + 1 if moves.size else 0
    bad[end:] = _stuck_to_the_end(path, end)
    for first, last in _still_runs(path, moves):
        around = _FROZEN_RATIO * _neighbours(path.short, first, last)
        out = abs(path.short[last])
        into = out if first == 0 else abs(path.short[first - 1])
        length, seconds = last - first + 1, path.time[last] - path.time[first]
        if min(into, out) > max(path.kind.jump, path.jerk, around):
            bad[first : last + 1] = True
        elif length >= _FROZEN_SAMPLES and seconds >= _FROZEN_SECONDS and out > around:
            bad[first + 1 : last + 1] = True  # its first value was measured
    return bad if bad.any() else None


def _stuck_to_the_end(path: _Path, last: int) -> bool:
    """Whether the value that came at row ``last`` and stayed stands behind a jump."""
    if not last or len(path.angle) - last < _STUCK_SAMPLES:
        return False
    around = _FROZEN_RATIO * _neighbours(path.short, last, len(path.short))
    return bool(abs(path.short[last - 1]) > max(path.kind.jump, path.jerk, around))


def _still_runs(path: _Path, moves: IntArray) -> Iterator[tuple[int, int]]:
    """(first, last) index of each run of identical values that a jump ends."""
    starts = np.concatenate(([0], moves + 1))[: len(moves)]
    lengths = moves - starts + 1
    jump = np.abs(path.short[moves]) > max(path.kind.spike, path.jerk, 3.0 * path.least)
    chosen = jump & ((lengths >= _STUCK_SAMPLES) | ((starts == 0) & (lengths > 1)))
    return zip(starts[chosen].tolist(), moves[chosen].tolist(), strict=True)


def _neighbours(steps: FloatArray, first: int, last: int) -> float:
    """Largest of the five steps before the run (not the one into it) and after it (not the one out)."""
    around = np.concatenate((steps[max(0, first - 6) : max(0, first - 1)], steps[last + 1 : last + 6]))
    return float(np.abs(around).max(initial=0.0))


_TESTS = (
    (_repeats, "repeated", "The {} is refreshed less often than it is logged; {} held repeats left out."),
    (_spikes, "outlier", "The {} has {} samples off its path by more than noise allows; left out."),
    (_frozen, "frozen", "The {} sensor was frozen for {} samples and then jumped; left out."),
)


def _unwrap(path: _Path, remarks: list[Remark]) -> FloatArray:
    """(n,) rad without jumps of whole turns; what the gaps cost is added to ``remarks``."""
    if len(path.angle) < 2:
        return path.angle
    intervals = np.diff(path.time)
    limit = gap_limit(intervals)
    gaps = np.flatnonzero(intervals > limit) if intervals.max() > limit else np.arange(0)
    angle, doubtful = path.angle, 0
    if np.isfinite(path.kind.turn) and not _continuous(path, gaps):
        angle = _add_turns(angle, path.far, -np.rint(path.steps[path.far] / TURN))
        if gaps.size:
            turns, doubtful = _turns_in_gaps(path.time, angle, gaps)
            angle = _add_turns(angle, gaps, turns)
    if gaps.size:
        remarks.append(_gap_remark(path.name, float(intervals[gaps].sum()), len(gaps), doubtful))
    return angle


def _continuous(path: _Path, gaps: IntArray) -> bool:
    """Whether the log is unwrapped already: it exceeds a turn and steps far only across gaps."""
    if not path.far.size and not gaps.size:
        return True
    return bool(np.ptp(path.angle) > TURN + _DEG) and not np.setdiff1d(path.far, gaps).size


def _add_turns(angle: FloatArray, steps: IntArray, turns: FloatArray) -> FloatArray:
    """``angle`` with ``turns`` added behind each of ``steps``."""
    if not turns.any():
        return angle
    lengths = np.diff(np.concatenate(([0], steps + 1, [len(angle)])))
    return angle + TURN * np.repeat(np.concatenate(([0.0], np.cumsum(turns))), lengths)


def _turns_in_gaps(time: FloatArray, angle: FloatArray, gaps: IntArray) -> tuple[FloatArray, int]:
    """Whole turns made in each gap beyond the short way, by the rates at its ends; how many are doubtful."""
    reach = int(np.clip(_RATE_SECONDS / subsampled_median(np.diff(time)), 3, 100))
    begins = np.concatenate(([0], gaps[:-1] + 1))
    ends = np.concatenate((gaps[1:], [len(time) - 1]))
    before = _rates(time, angle, np.maximum(gaps - reach, begins), gaps)
    after = _rates(time, angle, gaps + 1, np.minimum(gaps + 1 + reach, ends))
    seconds = time[gaps + 1] - time[gaps]
    ahead, spread = 0.5 * (before + after) * seconds, 0.5 * np.abs(before - after) * seconds
    sure = spread < np.pi / 2.0
    turns = np.where(sure, np.rint((ahead - (angle[gaps + 1] - angle[gaps])) / TURN), 0.0)
    return turns, int(np.count_nonzero(~sure & (np.abs(ahead) + spread > np.pi)))


def _rates(time: FloatArray, angle: FloatArray, first: IntArray, last: IntArray) -> FloatArray:
    seconds = time[last] - time[first]
    return np.where(seconds > 0, (angle[last] - angle[first]) / np.where(seconds > 0, seconds, 1.0), 0.0)


def _gap_remark(name: str, seconds: float, count: int, doubtful: int) -> Remark:
    text = f"The {name} has gaps ({count}, of {seconds:.1f} s in all); nothing was put in them."
    if doubtful:
        text += f" How many whole turns the vehicle made in {doubtful} of them is not certain."
    return Remark(kind="gap", count=count, text=text)
