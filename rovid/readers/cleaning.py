"""Faults of a heading, or of another position or rate, as logged: repeats, spikes, frozen stretches, whole turns.

Nothing is interpolated or smoothed. A value that is no measurement becomes NaN and is counted in a remark.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray, IntArray
from rovid.trial.segments import gap_limit, subsampled_median
from rovid.trial.trial import Remark

TURN = 2.0 * np.pi
_DEG = np.pi / 180.0
# A spike deviates by this many robust standard deviations, over at most this many samples; close spikes hide each
# other, so the search is repeated this often.
_SPIKE_SIGMAS, _MAX_SPIKE_LENGTH, _MORE_ROUNDS = 6.0, 3, 2
# Number of spikes of one value, at least half of all, from which on that value means "no reading".
_MIN_DROPOUTS = 3
# Share of a spike's height that its edges must have: a smooth swing out and back is motion.
_EDGE_SHARE = 0.6
# A frozen stretch has this many identical values, and ends in a jump this many times larger than the steps around it.
_FROZEN_SAMPLES, _FROZEN_RATIO = 10, 4.0
# Number of identical values of a frozen stretch that has an implausible jump at both ends, or begins or ends the log.
_STUCK_SAMPLES = 4
# Held repeats: smallest number of runs to decide, and ratio up to which a step equals one quantum of the log.
_MIN_RUNS, _QUANTUM_RATIO = 20, 1.02
# Intervals over which the rates at the ends of a gap are taken.
_RATE_INTERVALS = 10


@dataclass(frozen=True, kw_only=True)
class Kind:
    """Limits for one kind of measurement, in rad, m, rad/s or m/s."""

    turn: float  # Period of the value; infinite unless an angle.
    spike: float  # Smallest step of a spike.
    # Largest step that a vehicle can make and reverse between samples 1 s apart, and the power of the interval
    # that it is proportional to: logs of 1 Hz show true jerks of many degrees.
    swing: tuple[float, int]
    jump: float  # Step that no vehicle makes, whatever the noise.

    def wrap(self, step: FloatArray) -> FloatArray:
        """``step`` within half a turn."""
        return step if np.isinf(self.turn) else step - self.turn * np.rint(step / self.turn)


# An alternating acceleration of 160 deg/s^2 (4 * 40), or of 4 m/s^2.
ANGLE = Kind(turn=TURN, spike=0.5 * _DEG, swing=(40.0 * _DEG, 2), jump=20.0 * _DEG)
DISTANCE = Kind(turn=np.inf, spike=0.03, swing=(1.0, 2), jump=1.0)
TURNING = Kind(turn=np.inf, spike=1.0 * _DEG, swing=(160.0 * _DEG, 1), jump=60.0 * _DEG)
SPEED_KIND = Kind(turn=np.inf, spike=0.03, swing=(4.0, 1), jump=1.0)


class _Samples:
    """Measured samples and their steps, for the tests below."""

    def __init__(self, time: FloatArray, angle: FloatArray, kind: Kind, name: str) -> None:
        self.time, self.angle, self.kind, self.name = time, angle, kind, name
        self.steps = np.diff(angle)
        self.wraps = np.flatnonzero(np.abs(self.steps) > kind.turn / 2.0)  # Steps of more than half a turn.

    @cached_property
    def wrapped_steps(self) -> FloatArray:
        """(n-1,) rad, each step within half a turn."""
        if not self.wraps.size:
            return self.steps
        steps = self.steps.copy()
        steps[self.wraps] = self.kind.wrap(steps[self.wraps])
        return steps

    @cached_property
    def sigma(self) -> float:
        """Robust standard deviation of a sample from the mean of its neighbours."""
        bend = np.diff(self.wrapped_steps)
        return 1.4826 * subsampled_median(np.abs(bend)) / 2.0

    @cached_property
    def max_swing(self) -> float:
        """Largest step that a vehicle can make and reverse between samples."""
        size, power = self.kind.swing
        return float(size * subsampled_median(np.diff(self.time[:10_000])) ** power)

    @cached_property
    def min_jump(self) -> float:
        """Smallest step that no vehicle makes."""
        return max(self.kind.jump, self.max_swing)

    @cached_property
    def quantum(self) -> float:
        """Smallest step in rad: the resolution of the log, or the step of a steady noise-free turn."""
        sizes = np.abs(self.wrapped_steps)
        return float(sizes[sizes > 1e-9].min(initial=np.pi))

    @cached_property
    def flicker(self) -> float:
        """Resolution in rad of a log that alternates between adjacent values; 0 for a finer log."""
        steps = self.wrapped_steps[np.abs(self.wrapped_steps) > 1e-9]
        smallest = steps[np.abs(steps) <= _QUANTUM_RATIO * self.quantum]
        if smallest.size > 0.3 * steps.size and smallest.min() < 0.0 < smallest.max():
            return self.quantum
        return 0.0

    def without(self, bad: BoolArray) -> Self:
        return type(self)(self.time[~bad], self.angle[~bad], self.kind, self.name)


def clean(
    time: FloatArray, angle: FloatArray, kind: Kind = ANGLE, name: str = "heading"
) -> tuple[FloatArray, list[Remark]]:
    """(n,) unwrapped, NaN where not measured; and remarks on the removed values and on uncertain turns in gaps.

    ``time``: (n,) s, strictly increasing. ``angle``: (n,) in SI, finite, wrapped in any way or not at all. ``name`` is
    that of the signal in remarks.
    """
    remarks: list[Remark] = []
    good = np.arange(len(angle))
    samples = _Samples(time, angle, kind, name)
    for find, fault, text in _TESTS:
        bad = find(samples)
        if bad is None or not bad.any():
            continue
        count = int(np.count_nonzero(bad))
        remarks.append(Remark(kind=fault, count=count, text=text.format(name, count)))
        good = good[~bad]
        samples = samples.without(bad)
    unwrapped = _unwrap(samples, remarks)
    if len(good) == len(angle):
        return unwrapped, remarks
    position = np.full(len(angle), np.nan)
    position[good] = unwrapped
    return position, remarks


def _find_repeats(samples: _Samples) -> BoolArray | None:
    """Rows that repeat an older reading because the logger is faster than the sensor."""
    steps, count = samples.steps, len(samples.angle)
    if np.count_nonzero(steps) > 0.75 * len(steps):
        return None
    edges = np.flatnonzero(steps) + 1
    if len(edges) <= _MIN_RUNS:
        return None
    # Rows of each reading while the vehicle moves, without steps of one quantum, which occur at rest.
    fast = np.abs(samples.wrapped_steps[edges - 1]) > _QUANTUM_RATIO * samples.quantum
    runs = np.diff(edges)[fast[:-1] & fast[1:]]
    if len(runs) < _MIN_RUNS:
        return None
    period = round(float(np.median(runs)))
    if period < 2:
        return None
    starts = np.concatenate(([0], edges))
    lengths = np.diff(np.append(starts, count))
    phase = np.arange(count) - np.repeat(starts, lengths)
    remaining = np.repeat(lengths, lengths) - phase
    # A long run is a vehicle at rest: the sensor measured the same value every ``period`` rows.
    return np.asarray((phase > 0) & ((phase % period > 0) | (remaining < 0.75 * period)))


def _find_spikes(samples: _Samples) -> BoolArray | None:
    """Samples that leave a smooth path and return within three samples, or begin or end the log."""
    bad = _spikes_once(samples)
    if bad is None or not bad.any():
        return None
    for _ in range(_MORE_ROUNDS):
        more = _spikes_once(samples.without(bad))
        if more is None or not more.any():
            break
        bad[np.flatnonzero(~bad)[more]] = True
    return bad | _dropouts(samples, bad)


def _dropouts(samples: _Samples, bad: BoolArray) -> BoolArray:
    """(n,) further samples with the value that most spikes have: a sensor's "no reading", near the path by chance."""
    values, counts = np.unique(samples.angle[bad], return_counts=True)
    common = int(np.argmax(counts))
    if counts[common] < max(_MIN_DROPOUTS, 0.5 * counts.sum()):
        return np.zeros_like(bad)
    silent: BoolArray = (samples.angle == values[common]) & ~bad
    known = np.flatnonzero(~silent & ~bad)
    after = np.clip(np.searchsorted(known, np.flatnonzero(silent)), 1, len(known) - 1)
    first, last = known[after - 1], known[after]
    time, angle, wrap = samples.time, samples.angle, samples.kind.wrap
    share = (time[silent] - time[first]) / (time[last] - time[first])
    deviation = wrap(values[common] - angle[first] - share * wrap(angle[last] - angle[first]))
    silent[silent] = np.abs(deviation) > max(_SPIKE_SIGMAS * samples.sigma, samples.kind.spike)
    return silent


def _spikes_once(samples: _Samples) -> BoolArray | None:
    count = len(samples.angle)
    if count < 6:
        return None
    bend = np.diff(samples.wrapped_steps)
    limit = max(_SPIKE_SIGMAS * samples.sigma, samples.kind.spike, samples.max_swing)
    if bend.max() <= limit and bend.min() >= -limit:
        return None
    limit = max(limit, 2.5 * samples.flicker)
    time, angle, wrap = samples.time, samples.angle, samples.kind.wrap
    bad = np.zeros(count, dtype=bool)
    starts = np.flatnonzero((bend > limit) | (bend < -limit)) + 2
    # Longest first: otherwise the good samples between two long spikes would pass for a spike.
    for length in range(_MAX_SPIKE_LENGTH, 0, -1):
        inside = starts[starts + length + 1 < count]
        for first in inside[_is_spike(samples, inside, length, limit)].tolist():
            before, after, spike = first - 1, first + length, slice(first, first + length)
            if bad[before : after + 1].any():  # One is marked here already.
                continue
            # Samples on the bridge stay.
            slope = wrap(angle[after] - angle[before]) / (time[after] - time[before])
            bad[spike] = np.abs(wrap(angle[spike] - angle[before] - slope * (time[spike] - time[before]))) > limit
    _mark_ends(bad, samples)
    return bad


def _is_spike(samples: _Samples, first: IntArray, length: int, limit: float) -> BoolArray:
    """(m,) whether the ``length`` samples from ``first`` on deviate from a path that continues after them."""
    time, angle, wrap = samples.time, samples.angle, samples.kind.wrap
    before, after = first - 1, first + length
    span = time[after] - time[before]
    slope = wrap(angle[after] - angle[before]) / span
    # The slopes on both sides differ from that of the bridge where the vehicle itself changes its rate.
    left = wrap(angle[before] - angle[before - 1]) / (time[before] - time[before - 1])
    right = wrap(angle[after + 1] - angle[after]) / (time[after + 1] - time[after])
    bent = np.maximum(np.abs(left - slope), np.abs(right - slope))
    inside = [angle[first + k] - angle[before] - slope * (time[first + k] - time[before]) for k in range(length)]
    deviation = np.abs(np.stack(list(map(wrap, inside))))
    edge = np.minimum(deviation[0], deviation[-1])
    steep = (edge >= _EDGE_SHARE * deviation.max(axis=0)) | (edge > samples.kind.jump)
    return np.asarray((edge > limit + bent * span) & steep)


def _mark_ends(bad: BoolArray, samples: _Samples) -> None:
    """Mark first or last values far from the rest of the log, such as 0 before the first fix."""
    sizes = np.abs(samples.wrapped_steps)
    ends = np.concatenate((sizes[:_MAX_SPIKE_LENGTH], sizes[-_MAX_SPIKE_LENGTH:]))
    if ends.max() <= samples.kind.jump:
        return
    rank = max(0, len(sizes) - 1 - max(_MAX_SPIKE_LENGTH, len(sizes) // 1000))
    limit = max(samples.min_jump, 10.0 * float(np.partition(sizes, rank)[rank]))
    for length in range(1, _MAX_SPIKE_LENGTH + 1):
        if sizes[length - 1] > limit:
            bad[:length] = True
        if sizes[-length] > limit:
            bad[-length:] = True


def _find_frozen(samples: _Samples) -> BoolArray | None:
    """Stretches in which the sensor repeated one value and then jumped to the vehicle's position."""
    still = samples.steps == 0.0
    if not still.size or not (still[0] or (still[:-2] & still[1:-1] & still[2:]).any()):
        return None
    steps = samples.wrapped_steps
    bad = np.zeros(len(samples.angle), dtype=bool)
    moves = np.flatnonzero(~still)
    end = int(moves[-1]) + 1 if moves.size else 0
    if end and len(samples.angle) - end >= _STUCK_SAMPLES:
        around = _FROZEN_RATIO * _max_step_around(steps, end, len(steps))
        bad[end:] = abs(steps[end - 1]) > max(samples.min_jump, around)
    # (first, last) index of each run of identical values that ends in a jump.
    starts = np.concatenate(([0], moves + 1))[: len(moves)]
    lengths = moves - starts + 1
    limit = max(samples.kind.spike, samples.max_swing, 3.0 * samples.quantum)
    jump = np.abs(samples.wrapped_steps[moves]) > limit
    chosen = jump & ((lengths >= _STUCK_SAMPLES) | ((starts == 0) & (lengths > 1)))
    for first, last in zip(starts[chosen].tolist(), moves[chosen].tolist(), strict=True):
        around = _FROZEN_RATIO * _max_step_around(steps, first, last)
        jump_out = abs(steps[last])
        jump_in = jump_out if first == 0 else abs(steps[first - 1])
        length = last - first + 1
        if min(jump_in, jump_out) > max(samples.min_jump, around):
            bad[first : last + 1] = True
        elif length >= _FROZEN_SAMPLES and jump_out > around:
            bad[first + 1 : last + 1] = True  # The first value was measured.
    return bad


def _max_step_around(steps: FloatArray, first: int, last: int) -> float:
    """Largest of the five steps before the run and after it, without the steps into it and out of it."""
    around = np.concatenate((steps[max(0, first - 6) : max(0, first - 1)], steps[last + 1 : last + 6]))
    return float(np.abs(around).max(initial=0.0))


_TESTS = (
    (_find_repeats, "repeated", "The {} is refreshed less often than it is logged; {} held repeats left out."),
    (_find_spikes, "outlier", "The {} has {} samples off its path by more than noise allows; left out."),
    (_find_frozen, "frozen", "The {} sensor was frozen for {} samples and then jumped; left out."),
)


def _unwrap(samples: _Samples, remarks: list[Remark]) -> FloatArray:
    """(n,) rad without jumps of whole turns; uncertain gaps are added to ``remarks``."""
    if len(samples.angle) < 2:
        return samples.angle
    intervals = np.diff(samples.time)
    limit = gap_limit(intervals)
    gaps = np.flatnonzero(intervals > limit)
    angle, uncertain = samples.angle, 0
    # A log that is unwrapped already exceeds a turn, and steps by half a turn only in gaps.
    is_wrapped = np.ptp(angle) <= TURN + _DEG or bool(np.setdiff1d(samples.wraps, gaps).size)
    if np.isfinite(samples.kind.turn) and (samples.wraps.size or gaps.size) and is_wrapped:
        angle = _add_turns(angle, samples.wraps, -np.rint(samples.steps[samples.wraps] / TURN))
        if gaps.size:
            turns, uncertain = _turns_in_gaps(samples.time, angle, gaps)
            angle = _add_turns(angle, gaps, turns)
    if uncertain:
        text = f"The number of whole turns in {uncertain} gaps of the {samples.name} is not certain."
        remarks.append(Remark(kind="gap", count=uncertain, text=text))
    return angle


def _add_turns(angle: FloatArray, steps: IntArray, turns: FloatArray) -> FloatArray:
    """``angle`` with ``turns`` added after each of ``steps``."""
    if not turns.any():
        return angle
    lengths = np.diff(np.concatenate(([0], steps + 1, [len(angle)])))
    return angle + TURN * np.repeat(np.concatenate(([0.0], np.cumsum(turns))), lengths)


def _turns_in_gaps(time: FloatArray, angle: FloatArray, gaps: IntArray) -> tuple[FloatArray, int]:
    """Whole turns in each gap beyond the shorter arc, by the rates at its ends; and the number of uncertain gaps."""
    reach = _RATE_INTERVALS
    begins = np.concatenate(([0], gaps[:-1] + 1))
    ends = np.concatenate((gaps[1:], [len(time) - 1]))
    before = _mean_rates(time, angle, np.maximum(gaps - reach, begins), gaps)
    after = _mean_rates(time, angle, gaps + 1, np.minimum(gaps + 1 + reach, ends))
    seconds = time[gaps + 1] - time[gaps]
    predicted, spread = 0.5 * (before + after) * seconds, 0.5 * np.abs(before - after) * seconds
    certain = spread < np.pi / 2.0
    turns = np.where(certain, np.rint((predicted - (angle[gaps + 1] - angle[gaps])) / TURN), 0.0)
    return turns, int(np.count_nonzero(~certain & (np.abs(predicted) + spread > np.pi)))


def _mean_rates(time: FloatArray, angle: FloatArray, first: IntArray, last: IntArray) -> FloatArray:
    seconds = time[last] - time[first]
    return np.where(seconds > 0, (angle[last] - angle[first]) / np.where(seconds > 0, seconds, 1.0), 0.0)
