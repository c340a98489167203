"""Intervals between samples, and segments of a trial: held commands, sine-shaped torque, free swings."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import shortened_list
from rovid.trial.rates import white_noise
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle

# A gap is longer than this many median intervals.
_GAP_INTERVALS = 5.0
# s and multiples of the rest of the log; a clock set while recording (GPS fix, NTP) leaps by more than both. Clocks are
# set by hours, whatever the vehicle.
_LEAP, _LEAP_RATIO = 3600.0, 10.0
# s; intervals that overlap by less only touch.
_TOUCH = 1e-6


def subsampled_median(values: FloatArray) -> float:
    """Median of at most about ten thousand evenly picked ``values``, for thresholds; NaN for none."""
    if not values.size:
        return float("nan")
    return float(np.median(values[:: len(values) // 10_000 + 1]))


def gap_limit(intervals: FloatArray) -> float:
    """Longest interval in s that is no gap, for samples ``intervals`` apart."""
    return _GAP_INTERVALS * subsampled_median(intervals)


def find_leap(time: FloatArray) -> int | None:
    """Number of the reading after which the (n,) ``time`` in s leaps: over an hour and ten times the rest of the log.

    None where it leaps nowhere.
    """
    if len(time) < 2 or time[-1] - time[0] <= _LEAP:
        return None
    steps = np.diff(time)
    at = int(np.argmax(steps))
    rest = float(steps[(steps <= _LEAP) & (steps > 0.0)].sum())
    return at if steps[at] > max(_LEAP, _LEAP_RATIO * rest) else None


def merged_intervals(intervals: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    """The union of ``intervals`` that overlap, in order; a sample lies between two that touch."""
    union: list[tuple[float, float]] = []
    for begin, end in sorted(intervals):
        if union and begin < union[-1][1] - _TOUCH:
            union[-1] = union[-1][0], max(end, union[-1][1])
        else:
            union.append((begin, end))
    return tuple(union)


# Tolerance of a held command, as a share of its bench range. A 12-bit output flickers by less.
_HELD_SHARE = 0.005
# Tolerance of a held logged torque, which has no bench range, as a share of the largest torque of the trial.
_HELD_TORQUE_SHARE = 0.02
# Shortest hold in periods of the cut-off of the rates: some vehicle time constants, as the cut-off follows the motion.
MIN_HOLD = 6.0

# Relative differences of period and amplitude below which two waves belong to the same sine.
_SAME_PERIOD, _SAME_AMPLITUDE = 0.06, 0.1
# Minimum share of the torque's variance in the fundamental of a sine. A sine squared with its sign kept and a dead zone
# reaches 0.93, with equal volts on a thruster half as strong in reverse 0.85 to 0.91, a square wave 0.81.
_SINE_SHARE = 0.83
MIN_CYCLES = 2

# A half swing this many times as large as both before was pushed. A ratio below this share of the median ratio of the
# half swings before was held up.
_GROWS, _CUT_SHORT = 1.1, 0.6
# Readings that are rounded: least step in rad or m, largest distance of a step from a multiple of the smallest one in
# units of it, and share of the steps that are as near.
_NO_STEP, _OFF_GRID, _ON_GRID = 1e-9, 0.01, 0.99
# Steps in rad or m, above which readings are called coarse: compasses give whole degrees. A decision.
_COARSE = {True: np.deg2rad(1.5), False: 0.1}
# Share of the largest tilt below which the vehicle counts as at rest.
_AT_REST = 0.05
_MIN_HALF_SWINGS = 4
# Smallest swing from peak to peak: in steps of coarse readings, which toggle at rest by one step to each side, and in
# standard deviations of the noise, of which 100 000 readings reach 8.8. In shares of the log's range: releases of one
# log have similar tilts, and the swings of waves after a decay are smaller. Decision.
_TOGGLED, _NOISY, _SMALLEST = 2.5, 9.0, 0.2
# Share of the largest tilt that a tilt held by hand exceeds. A free cosine falls to it in 0.4 of the time that it takes
# from there to the middle, a swing of 90 deg in 0.5: with more than this ratio the vehicle was held. Decisions.
_LET_GO, _HELD = 0.9, 0.55


@dataclass(frozen=True, kw_only=True, eq=False)
class Hold:
    """A segment of constant ``command`` and ``torque`` in N m, from ``start`` to ``stop`` in s."""

    start: float
    stop: float
    command: FloatArray
    torque: float

    @property
    def duration(self) -> float:
        """Length in s."""
        return self.stop - self.start


@dataclass(frozen=True, kw_only=True, eq=False)
class SineRun:
    """Whole periods of a sine-shaped torque: ``start``, ``stop``, ``period`` in s, ``amplitude`` in N m."""

    start: float
    stop: float
    period: float
    cycles: int
    amplitude: float


def find_holds(trial: Trial, vehicle: Vehicle, torque: FloatArray, cutoff: float) -> list[Hold]:
    """Segments of at least `MIN_HOLD` periods of the ``cutoff`` (Hz) in which no command moves beyond its tolerance."""
    # Imported here because commands that find no holds must not load compiled code.
    from rovid.trial.numba_loops import find_constant_runs

    ranges = np.array([thruster.command_range() for thruster in vehicle.thrusters])
    logged = _HELD_TORQUE_SHARE / _HELD_SHARE * float(np.max(np.abs(torque), initial=0.0))
    tolerance = _HELD_SHARE * np.where(np.isfinite(ranges), ranges, logged)
    starts = find_constant_runs(np.ascontiguousarray(trial.commands), tolerance).astype(np.intp)
    stops = np.append(starts[1:], len(trial.time) - 1)
    # Half an interval less: rounding decides nothing.
    shortest = MIN_HOLD / cutoff - 0.5 * trial.sampling_interval
    holds = []
    for start, stop in zip(starts, stops, strict=True):
        if trial.time[stop] - trial.time[start] < shortest:
            continue
        rows = slice(start, max(stop, start + 1))
        command, median_torque = np.median(trial.commands[rows], axis=0), float(np.median(torque[rows]))
        begin, end = float(trial.time[start]), float(trial.time[stop])
        holds.append(Hold(start=begin, stop=end, command=command, torque=median_torque))
    return holds


def find_sines(trial: Trial, torque: FloatArray) -> list[SineRun]:
    """Segments of at least ``MIN_CYCLES`` equal sine-like waves of torque, cut to whole periods."""
    crossings = _rising_crossings(trial.time, torque)
    if len(crossings) < MIN_CYCLES:
        return []
    periods = np.diff(crossings)
    amplitudes = np.array([np.ptp(torque[_rows(trial, a, b)]) / 2.0 for a, b in pairwise(crossings)])
    runs, first = [], 0
    for last in range(1, len(periods) + 1):
        if last < len(periods) and _continues(periods, amplitudes, first, last):
            continue
        start, stop, cycles = crossings[first], crossings[last], last - first
        period = (stop - start) / cycles
        # The first and the last wave begin or end at rest, and so have no rising crossing.
        if _repeats(trial, torque, start, -period, period):
            start, cycles = start - period, cycles + 1
        if _repeats(trial, torque, stop - period, period, period):
            stop, cycles = stop + period, cycles + 1
        run = _fit_sine(trial, torque, start, stop, cycles) if cycles >= MIN_CYCLES else None
        if run is not None:
            runs.append(run)
        first = last
    return runs


def _rising_crossings(time: FloatArray, torque: FloatArray) -> FloatArray:
    """Instants in s at which the torque turns positive, with a hysteresis of a fifth of its 90th percentile."""
    level = 0.2 * float(np.percentile(np.abs(torque), 90))
    state = (torque > level).astype(int) - (torque < -level)
    known = np.flatnonzero(state)
    # From the negative side straight to the positive one.
    rises = np.diff(state[known]) == 2
    turns, before = known[1:][rises], known[:-1][rises]
    # The crossing lies midway between leaving the negative and entering the positive side. A dead zone then stays in
    # the middle of the crossing, and periods stay whole.
    found = []
    for first, last in zip(before, turns, strict=True):
        wave = torque[first : last + 1]
        negative = first + np.flatnonzero(wave < 0.0)[-1]
        positive = first + np.flatnonzero(wave > 0.0)[0]
        found.append(0.5 * (time[negative + 1] + time[positive]))
    return np.array(found, dtype=np.float64)


def _continues(periods: FloatArray, amplitudes: FloatArray, first: int, last: int) -> bool:
    """Whether wave ``last`` has the period and amplitude of the up to ten waves before it."""
    recent = slice(max(first, last - 10), last)
    period, amplitude = np.median(periods[recent]), np.median(amplitudes[recent])
    same_period = abs(periods[last] - period) < _SAME_PERIOD * period
    same_amplitude = abs(amplitudes[last] - amplitude) < _SAME_AMPLITUDE * amplitude
    return bool(same_period and same_amplitude)


def _repeats(trial: Trial, torque: FloatArray, start: float, shift: float, period: float) -> bool:
    """Whether the wave that begins at ``start`` is there ``shift`` s away too."""
    # A crossing may be found one sample late, and the last sample is held for one.
    if start + shift < trial.time[0] or start + shift + period > trial.time[-1] + 2.5 * trial.sampling_interval:
        return False
    instants = start + np.linspace(0.0, period, 200, endpoint=False)
    wave = _held_at(trial, torque, instants)
    other = _held_at(trial, torque, instants + shift)
    apart = float(np.sqrt(np.mean((wave - other) ** 2)))
    return apart < _SAME_AMPLITUDE * float(np.ptp(wave)) / 2.0


def _held_at(trial: Trial, torque: FloatArray, instants: FloatArray) -> FloatArray:
    """The held ``torque`` at ``instants`` in s, with a margin for rounding."""
    at = np.searchsorted(trial.time, instants + 1e-6 * trial.sampling_interval, side="right") - 1
    return torque[np.clip(at, 0, len(torque) - 1)]


def _rows(trial: Trial, start: float, stop: float) -> slice:
    # A margin of half a sample: rounding decides nothing.
    margin = 0.5 * trial.sampling_interval
    first, last = np.searchsorted(trial.time, (start - margin, stop - margin))
    return slice(int(first), max(int(last), int(first) + 1))


def _fit_sine(trial: Trial, torque: FloatArray, start: float, stop: float, cycles: int) -> SineRun | None:
    """The segment as a sine run, or None where its fundamental holds too little of the variance."""
    rows = _rows(trial, start, stop)
    period = (stop - start) / cycles
    phase = 2.0 * np.pi * (trial.time[rows] - start) / period
    wave = torque[rows] - np.mean(torque[rows])
    basis = np.column_stack((np.sin(phase), np.cos(phase)))
    coefficients = np.linalg.lstsq(basis, wave, rcond=None)[0]
    variance = float(wave @ wave)
    if variance <= 0.0 or float(np.sum((basis @ coefficients) ** 2)) < _SINE_SHARE * variance:
        return None
    amplitude = float(np.ptp(torque[rows])) / 2.0
    return SineRun(start=float(start), stop=float(stop), period=float(period), cycles=cycles, amplitude=amplitude)


def resolution(values: FloatArray) -> float:
    """Step to which (n,) ``values`` are rounded; 0 if their steps are no multiples of the smallest one."""
    steps = np.abs(np.diff(values))
    steps = steps[steps > _NO_STEP]
    counts = steps / steps.min(initial=np.inf)
    on_grid = np.abs(counts - np.rint(counts)) < _OFF_GRID
    return float(steps.min()) if steps.size and np.mean(on_grid) > _ON_GRID else 0.0


def coarse_text(trials: Sequence[Trial]) -> str:
    """Words on the trials whose position has coarse steps, without a logged rate; empty where there are none."""
    steps = {one.name: resolution(one.position[one.measured]) for one in trials if one.rate is None}
    coarse = {name: step for name, step in steps.items() if step > _COARSE[trials[0].axis.angular]}
    if not coarse:
        return ""
    axis = trials[0].axis
    unit, factor = axis.display_unit
    step = f"{factor * max(coarse.values()):.3g} {unit}"
    return f"the {axis.position_words} of {shortened_list([*coarse])} is rounded to steps of {step}"


def find_releases(trial: Trial) -> list[slice]:
    """Rows of each free swing: from a largest tilt until the swings grow again or are cut short by hand.

    A tilt that is held before the release is left out. So are swings of noise, steps of the readings, and waves.
    """
    known = np.flatnonzero(trial.measured)
    position = trial.position[known]
    tilt = position - np.median(position)
    least = max(_TOGGLED * resolution(position), _NOISY * white_noise(position), _SMALLEST * float(np.ptp(tilt)))
    swings = _half_swings(tilt)
    peaks = [begin + int(np.argmax(np.abs(tilt[begin:end]))) for begin, end in swings]
    # A wrong level makes one side larger than the other, so each half swing is compared with those on its own side.
    sizes = np.concatenate(([0.0, 0.0], np.abs(tilt[peaks])))
    found = list[slice]()
    k = 0
    while k < len(peaks):
        first, k = k, _end_of_decay(sizes, k)
        if k - first >= _MIN_HALF_SWINGS and np.ptp(tilt[peaks[first:k]]) > least:
            begin = _let_go(trial.time[known], np.abs(tilt), peaks[first], swings[first][1])
            found.append(slice(int(known[begin]), int(known[peaks[k - 1]]) + 1))
    return found


def swing_level(position: FloatArray) -> tuple[float, float]:
    """Angle in rad about which (n,) ``position`` of a decay swings, and the largest swing from it; NaN without swings.

    The mean of (p0 + 2 p1 + p2)/4 over extremes p in succession: swings that shrink by a constant ratio cancel.
    """
    tilt = position - np.median(position)
    swings = _half_swings(tilt)
    extremes = np.array([position[begin + int(np.argmax(np.abs(tilt[begin:end])))] for begin, end in swings])
    if len(extremes) < 3:
        return np.nan, np.nan
    level = float(np.mean(0.25 * (extremes[:-2] + 2.0 * extremes[1:-1] + extremes[2:])))
    return level, float(np.abs(extremes - level).max())


def swing_period(trial: Trial) -> float:
    """Median period in s of the first free swing of ``trial``; NaN without one."""
    rows = next(iter(find_releases(trial)), slice(0))
    known = trial.measured[rows]
    time, position = trial.time[rows][known], trial.position[rows][known]
    swings = _half_swings(position - np.median(position)) if len(position) else []
    starts = time[[begin for begin, _ in swings]]
    return float(2.0 * np.median(np.diff(starts))) if len(starts) > 1 else np.nan


def _let_go(time: FloatArray, size: FloatArray, peak: int, end: int) -> int:
    """Row of the peak of the half swing before row ``end``; if its tilt was held, the last row before it falls."""
    high, last = (peak + int(np.flatnonzero(size[peak:end] > s * size[peak])[-1]) for s in (_LET_GO, _AT_REST))
    is_held = time[high] - time[peak] > _HELD * (time[last] - time[high])
    return high if is_held else peak


def _end_of_decay(sizes: FloatArray, first: int) -> int:
    """Number of the peak after a decay that begins with peak ``first``; (m + 2,) ``sizes`` begin with two zeros."""
    k, ratios = first + 1, list[float]()
    while k + 2 < len(sizes) and sizes[k + 2] <= _GROWS * sizes[k : k + 2].max():
        ratio = sizes[k + 2] / max(sizes[k], sizes[k + 1])
        if ratios and ratio < _CUT_SHORT * float(np.median(ratios)):
            break
        ratios.append(ratio)
        k += 1
    return k


def _half_swings(tilt: FloatArray) -> list[tuple[int, int]]:
    """First row and end of each stretch on one side whose ``tilt`` exceeds the rest level."""
    size = np.abs(tilt)
    side = np.where(size > _AT_REST * np.max(size), np.sign(tilt), 0.0)
    beyond = np.flatnonzero(side)
    starts = beyond[np.flatnonzero(np.diff(side[beyond], prepend=0.0))]
    return list(pairwise([*starts.tolist(), len(tilt)]))
