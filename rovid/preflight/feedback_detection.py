"""Detection of feedback in logs: whether the commands respond to the motion, by an autopilot or by a pilot.

Motion follows commands in open loop too. Feedback shows in commands that depend on earlier motion. Three tests are run
on each log:

flow
    Of commands that change continuously, the part that earlier commands do not predict is regressed on the innovations
    of a model of the response (Haugh 1976; Ljung, System Identification, 1999, 16.6). F test, calibrated on the log
    itself with innovations that are shifted against the commands.
steps
    Of commands that change in steps, the part of each new level that earlier levels do not predict is regressed on the
    turn since the step before and on the rate. F test; only coefficients against the motion count.
reversals
    Of commands that alternate between two sides, as in a zigzag test, the scatter of the positions at the reversals is
    compared with the scatter that their durations would cause. F test of two variances.

A single log may be too short: the p values of all logs are combined by Fisher's method in addition. docs/method.md
has the error rates of the tests.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray, IntArray
from rovid.core.stats import chi2_sf, f_cdf, f_sf
from rovid.preflight.raw_columns import held_mean
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle

# Significance level of feedback, and of a log that counts towards the combined test.
SIGNIFICANCE_LEVEL, _LOG_LEVEL = 1e-3, 0.02
# Minimum number of samples of a test.
_MIN_SAMPLES = 60
# Flow: s, shortest interval; maximum number of rows; rows in a row that change; rows without a complete past.
_INTERVAL, _MAX_ROWS, _MIN_RUN, _WARM_UP = 0.1, 20_000, 4, 8
# Flow: windows before a row, first and last row, over which commands and innovations are summed.
_WINDOWS = ((1, 1), (2, 2), (3, 4), (5, 8), (9, 16), (17, 32), (33, 64), (65, 128))
# Flow, commands at a slow clock: share of the levels that differ, their number that is always enough, minimum number of
# rows.
_LEVELS, _MANY_LEVELS, _MIN_SLOW = 0.3, 30, 240
# Flow: spacing of rows that most do not exceed, relative to the median, above which rows are irregular. Least share of
# the changes in rows that change several times in succession.
_IRREGULAR, _COVERED = 1.3, 0.6
# Flow: number of shifts for the calibration, shortest shift in rows, and minimum share of the variance of the changes.
_SHIFTS, _MIN_SHIFT, _MIN_SHARE = 99, 40, 0.05
# Steps: minimum size as a share of the range, sampling intervals within which all thrusters change, minimum number,
# longest interval in a ramp relative to the mean of all, maximum number of changes in a step.
_STEP_SIZE, _SIMULTANEOUS, _MIN_STEPS, _RAMP, _LONGEST = 0.05, 2.5, 10, 0.3, 8
# Reversals, as shares of half the range: where a side begins, the tolerance of a constant command, and the minimum
# share of the samples within that tolerance.
_SIDE, _CONSTANT, _MOSTLY = 0.7, 0.01, 0.6
# Reversals: maximum scatter relative to the distance between reversals of both senses.
_MAX_SCATTER = 0.15


@dataclass(frozen=True, kw_only=True)
class Feedback:
    """Result of one test on one log."""

    name: str  #: Of the log.
    seen_in: str  #: "flow", "steps" or "reversals".
    chance: float  #: p value, 0 to 1.
    share: float = 0.0  #: Share of the commands' own changes that follows the motion, 0 to 1; 0 for reversals.
    #: ``scatter``, ``by_duration``: for reversals, scatter of the positions, and that which the durations would cause,
    #: rad or m; 0 for other tests.
    scatter: float = 0.0
    by_duration: float = 0.0


def detect_feedback(trials: Sequence[Trial], vehicle: Vehicle) -> list[Feedback]:
    """Significant feedback, one entry a log, and reversals at one position that may be those of a zigzag test."""
    results: dict[str, list[Feedback]] = {}
    for trial in trials:
        # (n,) commanded torque in N m or force in N by linear thrust curves: a dead zone would hide small commands.
        gains = []
        for thruster in vehicle.thrusters:
            curve = thruster.curve
            gains.append(thruster.arm * (1.0 if curve is None else float(np.ptp(curve.thrust)) / curve.span))
        effort = np.asarray(trial.commands @ np.array(gains))
        # A missing command makes the range NaN, and this condition false.
        if np.ptp(effort) > 0.0 and trial.measured.sum() >= _MIN_SAMPLES:
            sent = _command_interval(trial, effort)
            flow = _test_flow(trial, effort, sent)
            # A stream of commands has no steps, also if it is too short for a test.
            steps = None if flow is not None or sent > 0.0 else _test_steps(trial, effort)
            for result in (flow, steps, _test_reversals(trial, effort)):
                if result is not None:
                    results.setdefault(result.seen_in, []).append(result)
    found = []
    for same in results.values():
        # The combined p value (Fisher) counts where a log agrees with it.
        logarithms = [math.log(max(result.chance, 1e-300)) for result in same]
        together = chi2_sf(2 * len(same), -2.0 * sum(logarithms))
        for result in same:
            chance = min(result.chance, together) if result.chance < _LOG_LEVEL else result.chance
            if chance < SIGNIFICANCE_LEVEL:
                found.append(replace(result, chance=chance))
    found += [result for result in results.get("reversals", []) if result.chance < 1.0]
    first = {result.name: result for result in reversed(found)}
    return [first[trial.name] for trial in trials if trial.name in first]


# ---- commands that change continuously


def _test_flow(trial: Trial, effort: FloatArray, sent: float) -> Feedback | None:
    """The test of a stream of commands; ``sent``: s, their interval by `_command_interval`."""
    known = np.flatnonzero(trial.measured)
    measured, spacing = trial.time[known], np.diff(trial.time[known])
    most = float(np.percentile(spacing, 90.0))
    stride = max(round(max(_INTERVAL, sent) / trial.sampling_interval), len(known) // _MAX_ROWS + 1)
    time, position = measured[::stride], trial.position[known[::stride]]
    irregular = most > _IRREGULAR * float(np.median(spacing))
    if irregular:
        # Equal intervals, none shorter than most of those between readings.
        time = np.arange(measured[0], measured[-1], max(_INTERVAL, sent, most))
        position = np.interp(time, measured, trial.position[known])
    if len(time) <= _MIN_SAMPLES:
        return None
    rate = np.diff(position) / np.diff(time)
    command = held_mean(trial.time, effort, time)
    if not np.ptp(command) > 0.0:
        return None
    mean, size = command.mean(), command.std()
    command = (command - mean) / size
    rows = _continuous_rows(command)
    gaps = np.flatnonzero(spacing > 3.0 * np.median(np.diff(time)))
    for first, last in zip(*np.searchsorted(time, (measured[gaps], measured[gaps + 1])), strict=True):
        rows[max(first - 1, 0) : last + _WARM_UP] = False
    changes = np.abs(np.diff(command, prepend=command[0]))
    if rows.sum() < (_MIN_SLOW if sent > _INTERVAL else _MIN_SAMPLES) or changes[rows].sum() < _COVERED * changes.sum():
        return None
    # The motion depends on when within an interval the command changed: the last two commands are regressors too.
    last = np.maximum(np.searchsorted(trial.time, time[:-1] - 0.01 * trial.sampling_interval) - 1, 1)
    ends = (effort[np.column_stack((last, last - 1))] - mean) / size
    own = (np.ones(len(rate)), ends, _window_sums(command), np.abs(_lag(command, 1)), _lag(command, 3))
    before = np.column_stack(own)[rows]
    # Steps of the set point are outliers.
    change = _clip(_robust_residual(before, command[rows]), 2.5)
    innovations = _window_sums(_clip(_innovations(rate, command), 4.0))
    if irregular:
        # Between distant rows a command may have changed, and the vehicle moved, before the row that shows it.
        innovations = innovations[:, 1:]
    chance, share = _calibrated_f_test(before, change, innovations, rows)
    return Feedback(name=trial.name, seen_in="flow", chance=chance, share=share)


def _command_interval(trial: Trial, effort: FloatArray) -> float:
    """Interval between commands of many levels that are sent at a clock slower than the rows, s; 0 for others."""
    changes = np.flatnonzero(np.diff(effort))
    levels = np.unique(np.round(effort[changes] / np.ptp(effort), 6))
    if len(changes) < 2 or len(levels) < min(_LEVELS * len(changes), _MANY_LEVELS):
        return 0.0
    low, high = np.percentile(np.diff(trial.time[changes]), (25.0, 75.0))
    return float(low) if 1.5 * trial.sampling_interval < low and high < 2.1 * low else 0.0


def _calibrated_f_test(
    before: FloatArray, change: FloatArray, innovations: FloatArray, rows: BoolArray
) -> tuple[float, float]:
    """P value of ``change`` given ``innovations`` beyond ``before``, and the share of its variance."""
    basis = _orthonormal(before)
    change = change - basis @ (basis.T @ change)
    columns = innovations.shape[1]
    freedom = len(change) - basis.shape[1] - columns
    total = float(change @ change)
    if not total > 1e-12 * len(change):
        # Earlier commands predict the command, as in a sine.
        return 1.0, 0.0

    def explained_share(x: FloatArray) -> float:
        # Normal equations of the columns beyond the basis, to which the change is orthogonal.
        along, moments = basis.T @ x, change @ x
        inverse = np.linalg.pinv(x.T @ x - along.T @ along, rcond=1e-10, hermitian=True)
        return float(moments @ inverse @ moments) / total

    def f_statistic(share: float) -> float:
        return share / max(1.0 - share, 1e-300) * float(freedom / columns)

    shortest = min(_MIN_SHIFT, len(innovations) // 4)
    shifts = np.unique(np.linspace(shortest, len(innovations) - shortest, _SHIFTS).astype(int))
    shifted = np.array([f_statistic(explained_share(np.roll(innovations, shift, axis=0)[rows])) for shift in shifts])
    share = explained_share(innovations[rows])
    if share < _MIN_SHARE or f_statistic(share) < shifted.max():
        return 1.0, share
    return f_sf(columns, freedom, f_statistic(share) / max(1.0, shifted.mean())), share


def _continuous_rows(values: FloatArray) -> BoolArray:
    """(n,) rows in which ``values`` change several times in succession."""
    moves = np.abs(np.diff(values, prepend=values[0])) > 1e-9
    bounds = np.flatnonzero(np.diff(np.concatenate(([False], moves, [False])).astype(int)))
    rows = np.zeros(len(values), dtype=bool)
    for begin, end in bounds.reshape(-1, 2):
        rows[begin:end] = end - begin >= _MIN_RUN
    rows[:_WARM_UP] = False
    return rows


def _window_sums(values: FloatArray) -> FloatArray:
    """(n, k) sums of ``values`` over the windows before each row, divided by the roots of their lengths."""
    total = np.concatenate(([0.0], np.cumsum(values)))
    row = np.arange(len(values))
    columns = []
    for first, last in _WINDOWS:
        low, high = np.maximum(row - last, 0), np.maximum(row - first + 1, 0)
        columns.append((total[high] - total[low]) / np.sqrt(last - first + 1))
    return np.column_stack(columns)


def _lag(values: FloatArray, rows: int) -> FloatArray:
    return np.concatenate((np.full(rows, values[0]), values[: len(values) - rows]))


def _innovations(rate: FloatArray, command: FloatArray) -> FloatArray:
    """(n,) residuals of each rate on earlier rates, earlier commands and the command of its row."""
    commands = [_lag(command, rows) for rows in range(7)]
    last = _lag(rate, 1)
    nonlinear = [np.abs(last) * last, np.abs(commands[0]), np.abs(commands[1])]
    rates = (_window_sums(rate), _lag(rate, 3))
    x = np.column_stack((np.ones(len(rate)), *rates, *commands, _window_sums(command)[:, 3:], *nonlinear))
    return _residual(x / np.maximum(np.linalg.norm(x, axis=0), 1e-300), rate)


# ---- commands that change in steps


def _test_steps(trial: Trial, effort: FloatArray) -> Feedback | None:
    # Rows of `trial.time` at which a new level begins.
    span = float(np.ptp(effort))
    changes = np.flatnonzero(np.abs(np.diff(effort)) > 1e-6 * span) + 1
    if len(changes) < _MIN_STEPS:
        return None
    # Thrusters change within a few samples. Longer sequences of changes are no step, unless they are a ramp of a few
    # updates to one side.
    gaps, sides = np.diff(trial.time[changes]), np.sign(np.diff(effort)[changes - 1])
    ramp = (np.diff(sides) == 0.0) & (gaps < _RAMP * gaps.mean())
    apart = np.flatnonzero(~ramp & (gaps > _SIMULTANEOUS * trial.sampling_interval)) + 1
    bursts = [burst for burst in np.split(changes, apart) if len(burst) <= _LONGEST]
    bursts = [burst for burst in bursts if abs(effort[burst[-1]] - effort[burst[0] - 1]) > _STEP_SIZE * span]
    if len(bursts) < _MIN_STEPS:
        return None
    at = np.array([burst[-1] for burst in bursts], dtype=np.intp)
    instants = trial.time[np.array([burst[0] for burst in bursts], dtype=np.intp)]
    duration = np.diff(instants, prepend=trial.time[0])
    median = float(np.median(duration))
    position, rate = _motion_before(trial, instants, max(4.0 * trial.sampling_interval, 0.25 * median))
    turn = np.diff(position, prepend=np.nan)
    rows = np.flatnonzero(np.isfinite(rate) & np.isfinite(turn))
    rows = rows[rows >= 2]
    levels = np.concatenate((effort[:1], effort[at])) / effort.std()
    after, held, earlier = levels[rows + 1], levels[rows], levels[rows - 1]
    pairs = np.round(np.column_stack((held, earlier, after)) / np.ptp(levels), 6)
    kinds = len(np.unique(pairs[:, :2], axis=0))
    if kinds < 0.5 * len(rows) and len(np.unique(pairs, axis=0)) == kinds:
        # Each level follows from the two before it, as in a sequence that repeats itself.
        return Feedback(name=trial.name, seen_in="steps", chance=1.0)
    duration = np.minimum(duration[rows] / median, 3.0)
    own = np.column_stack((np.ones(len(rows)), held, earlier, held**2, held * earlier, duration))
    motion = np.column_stack((turn[rows], rate[rows]))
    if len(rows) < own.shape[1] + motion.shape[1] + 4 or not np.ptp(motion, axis=0).all():
        return None
    chance, share = _one_sided_f_test(own, motion / np.std(motion, axis=0), after)
    return Feedback(name=trial.name, seen_in="steps", chance=chance, share=share)


def _motion_before(trial: Trial, instants: FloatArray, window: float) -> tuple[FloatArray, FloatArray]:
    """Position and rate at ``instants`` by lines over the ``window`` s before; NaN for fewer than 3 samples."""
    time, position = trial.time[trial.measured], trial.position[trial.measured]
    firsts = np.searchsorted(time, instants - window)
    ends = np.searchsorted(time, instants, side="right")
    found = np.full((2, len(instants)), np.nan)
    for number, (first, end) in enumerate(zip(firsts, ends, strict=True)):
        if end - first >= 3:
            found[::-1, number] = np.polyfit(time[first:end] - instants[number], position[first:end], 1)
    return found[0], found[1]


def _one_sided_f_test(own: FloatArray, motion: FloatArray, level: FloatArray) -> tuple[float, float]:
    """P value of ``level`` given ``motion`` beyond ``own``, 1 unless it opposes the motion; share of the variance."""
    both = np.column_stack((own, motion))
    residual = _robust_residual(both, level)
    if not _robust_std(residual) > 1e-6:
        # Each level follows from the one before, as in an alternating sequence.
        return 1.0, 0.0
    weight = _huber_weights(residual)
    own, both, level = own * weight[:, None], both * weight[:, None], level * weight
    freedom = len(level) - both.shape[1]
    total, rest = (float(np.sum(_residual(x, level) ** 2)) for x in (own, both))
    share = 1.0 - rest / total
    values, *_ = np.linalg.lstsq(both, level, rcond=1e-9)
    errors = np.sqrt(np.abs(np.diag(np.linalg.pinv(both.T @ both))) * rest / freedom)
    t_statistics = (values / np.maximum(errors, 1e-300))[own.shape[1] :]
    if t_statistics.max() > 2.0 or t_statistics.min() > -2.0:
        return 1.0, share
    return f_sf(motion.shape[1], freedom, share / (1.0 - share) * freedom / motion.shape[1]), share


# ---- commands that reverse


def _test_reversals(trial: Trial, effort: FloatArray) -> Feedback | None:
    at, senses = _reversal_rows(effort)
    if trial.axis.self_righting or len(at) < 3:
        # A vehicle that rights itself returns to the same positions without feedback.
        return None
    instants = trial.time[at]
    duration = np.diff(instants, prepend=np.nan)
    window = max(4.0 * trial.sampling_interval, 0.15 * float(np.median(duration[1:])))
    position, rate = _motion_before(trial, instants, window)
    known = np.isfinite(position)
    duration, position, rate, senses = duration[known], position[known], rate[known], senses[known]
    scatter, freedom = _pooled_std(position, senses)
    duration_scatter, duration_freedom = _pooled_std(duration, senses)
    if not freedom or not duration_freedom or abs(int(senses.sum())) == len(senses):
        return None
    # Durations have the resolution of the clock. Half of a longer swing shows at its end, relative to its middle.
    duration_scatter = max(duration_scatter, trial.sampling_interval / np.sqrt(12.0))
    by_duration = float(0.5 * np.median(np.abs(rate)) * duration_scatter)
    distance = float(position[senses < 0].mean() - position[senses > 0].mean())
    chance = 1.0
    if scatter < _MAX_SCATTER * distance and by_duration > 0.0:
        chance = f_cdf(freedom, duration_freedom, (scatter / by_duration) ** 2)
    return Feedback(name=trial.name, seen_in="reversals", chance=chance, scatter=scatter, by_duration=by_duration)


def _reversal_rows(effort: FloatArray) -> tuple[IntArray, IntArray]:
    """Rows at which the command leaves one constant level for one on the other side, and the sign of the new side."""
    rows: list[int] = []
    signs: list[int] = []
    low, high = np.percentile(effort, (5.0, 95.0))
    if high > low:
        swing = (effort - 0.5 * (low + high)) / (0.5 * (high - low))
        sides = np.where(np.abs(swing) > _SIDE, np.sign(swing), 0.0)
        known = np.flatnonzero(sides)
        legs = np.split(known, np.flatnonzero(np.diff(sides[known])) + 1)
        constant = [bool(np.mean(np.abs(swing[leg] - np.median(swing[leg])) < _CONSTANT) > _MOSTLY) for leg in legs]
        for (leg, following), both in zip(pairwise(legs), pairwise(constant), strict=True):
            if all(both):
                rows.append(int(leg[-1]) + 1)
                signs.append(int(sides[following[0]]))
    return np.array(rows, dtype=np.intp), np.array(signs, dtype=np.intp)


def _pooled_std(values: FloatArray, senses: IntArray) -> tuple[float, int]:
    """Standard deviation of ``values`` within each sense, and its degrees of freedom."""
    total, freedom = 0.0, 0
    for sense in (-1, 1):
        same = values[(senses == sense) & np.isfinite(values)]
        if len(same) > 1:
            total += float(np.sum((same - same.mean()) ** 2))
            freedom += len(same) - 1
    return float(np.sqrt(total / max(freedom, 1))), freedom


# ---- regressions


def _residual(x: FloatArray, y: FloatArray) -> FloatArray:
    values, *_ = np.linalg.lstsq(x, y, rcond=1e-9)
    return np.asarray(y - x @ values)


def _robust_residual(x: FloatArray, y: FloatArray) -> FloatArray:
    """(n,) residuals of an M-estimate with Huber weights."""
    x = _orthonormal(x)
    residual = y - x @ (x.T @ y)
    for _ in range(15):
        if not _robust_std(residual) > 0.0:
            break
        weighted = x * _huber_weights(residual)[:, None] ** 2
        residual = y - x @ (np.linalg.pinv(weighted.T @ x, rcond=1e-10, hermitian=True) @ (weighted.T @ y))
    return residual


def _orthonormal(x: FloatArray) -> FloatArray:
    """(n, q) orthonormal basis of the columns of ``x``, some of which may be equal."""
    left, sizes, _ = np.linalg.svd(x / np.maximum(np.linalg.norm(x, axis=0), 1e-300), full_matrices=False)
    return np.asarray(left[:, sizes > 1e-9 * sizes[0]])


def _huber_weights(residual: FloatArray) -> FloatArray:
    return np.sqrt(np.minimum(1.0, 1.5 * _robust_std(residual) / np.maximum(np.abs(residual), 1e-300)))


def _robust_std(values: FloatArray) -> float:
    """Standard deviation by the median absolute value."""
    return 1.4826 * float(np.median(np.abs(values)))


def _clip(values: FloatArray, limit: float) -> FloatArray:
    """``values`` within plus and minus ``limit`` robust standard deviations."""
    size = _robust_std(values)
    return np.clip(values, -limit * size, limit * size) if size > 0.0 else values
