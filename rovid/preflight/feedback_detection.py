"""Feedback in logs: whether commands answer to how the vehicle moved, by an autopilot or by a hand.

A vehicle's motion goes with the commands before it, so that their going together tells nothing. What tells is commands
that go with motion before them. Three questions are asked of each log, and each answer is held against chance:

flow
    Where commands flow, their changes that do not follow from the commands before are regressed on motion that had not
    followed from the commands: on the innovations of a model of how the vehicle answers (Haugh 1976; Ljung, System
    Identification, 1999, 16.6). An F test, its chance measured on the log itself: with the innovations slid along the
    commands.
steps
    Where commands step, what of each new level does not follow from the levels before is regressed on how far the
    vehicle has turned since the step before, and how fast it turns. An F test; only what pushes back counts.
reversals
    Where commands go from one side to the other and back, as in a zigzag: the places of the reversals scatter less than
    the durations between them would make them. An F test of two variances.

A log by itself may be too short to tell. So the answers of all logs to one question are taken together too (Fisher).
How often the tests are right and wrong stands in docs/method.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray, IntArray
from rovid.core.stats import chi2_sf, f_cdf, f_sf
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Thruster, Vehicle

# What chance gives more seldom is feedback; with all logs together, a log that agrees that well is named.
SIGNIFICANCE_LEVEL, _AGREES = 1e-3, 0.02
# Readings without which nothing is asked.
_FEWEST = 60
# A flow is looked at no finer than that, s, and in no more rows; it moves in so many rows in a row. What a row knows
# before it begins after some.
_FINEST, _MOST_ROWS, _FLOWS, _WARM = 0.1, 20_000, 4, 8
# Windows before a row, first and last, over which commands and innovations are summed.
_WINDOWS = ((1, 1), (2, 2), (3, 4), (5, 8), (9, 16), (17, 32), (33, 64), (65, 128))
# The innovations are slid so often, by so many rows at least. F is to be larger than all of those, and this share of
# the changes to follow.
_SLIDES, _SLID, _SHARE = 99, 40, 0.05
# A step is a change of this share of the range, of all thrusters within so many periods; it takes so many.
_STEP, _TOGETHER, _FEWEST_STEPS = 0.05, 2.5, 10
# Of half the range: where one side begins, and how flat the command there is for most of the time.
_SIDE, _FLAT, _MOSTLY = 0.7, 0.01, 0.6
# Places of reversals agree where they scatter less than this share of how far those of both senses are apart.
_NEAR = 0.15


@dataclass(frozen=True, kw_only=True)
class Feedback:
    """What a log answers to one of the questions.

    Attributes
    ----------
    name
        Of the log.
    seen_in
        "flow", "steps" or "reversals"; see the head of this module.
    chance
        How often chance alone gives as much, 0 to 1.
    share
        Of the commands' own changes, what follows the motion, 0 to 1; 0 of reversals.
    scatter, by_duration
        rad or m; of reversals, the scatter of their places, and that which their durations would give; 0 of others.
    """

    name: str
    seen_in: str
    chance: float
    share: float = 0.0
    scatter: float = 0.0
    by_duration: float = 0.0


def detect_feedback(trials: Sequence[Trial], vehicle: Vehicle) -> list[Feedback]:
    """What the commands of each log answer to, one entry a log, where chance gives it more seldom than `LEVEL`.

    Reversals at one place which chance, or a clock, gives more often are listed too: they may be of a zigzag test.
    """
    answers: dict[str, list[Feedback]] = {}
    for trial in trials:
        effort = _effort(trial, vehicle)
        # A command that is missing somewhere makes the first condition false.
        if np.ptp(effort) > 0.0 and trial.measured.sum() >= _FEWEST:
            for answer in _answers(trial, effort):
                answers.setdefault(answer.seen_in, []).append(answer)
    found = [each for same in answers.values() for each in map(_judged(same), same) if each.chance < SIGNIFICANCE_LEVEL]
    open_ = [answer for answer in answers.get("reversals", []) if answer.chance < 1.0]
    first = {each.name: each for each in reversed([*found, *open_])}
    return [first[trial.name] for trial in trials if trial.name in first]


def _judged(same: Sequence[Feedback]) -> Callable[[Feedback], Feedback]:
    """Of the answers to one question: what chance each has, by itself or as one of all (Fisher)."""
    logarithms = [math.log(max(answer.chance, 1e-300)) for answer in same]
    together = chi2_sf(2 * len(same), -2.0 * sum(logarithms))

    def judged(answer: Feedback) -> Feedback:
        agrees = answer.chance < _AGREES
        return replace(answer, chance=min(answer.chance, together)) if agrees else answer

    return judged


def _answers(trial: Trial, effort: FloatArray) -> Iterator[Feedback]:
    for ask in (_flow, _steps, _reversals):
        answer = ask(trial, effort)
        if answer is not None:
            yield answer


def _effort(trial: Trial, vehicle: Vehicle) -> FloatArray:
    """(n,) N m or N that the commands ask for, held, as if every thrust curve were straight.

    A dead zone would hide what an autopilot asks for within it.
    """
    slopes = np.array([thruster.arm * _slope(thruster) for thruster in vehicle.thrusters])
    return np.asarray(trial.commands @ slopes)


def _slope(thruster: Thruster) -> float:
    if thruster.curve is None:
        return 1.0
    return float(np.ptp(thruster.curve.thrust)) / thruster.curve.span


# ---- commands that flow


def _flow(trial: Trial, effort: FloatArray) -> Feedback | None:
    known = np.flatnonzero(trial.measured)
    each = max(round(_FINEST / trial.sampling_interval), len(known) // _MOST_ROWS + 1)
    time, position = trial.time[known[::each]], trial.position[known[::each]]
    interval = np.diff(time)
    rate = np.diff(position) / interval
    pushed = _held_mean(trial.time, effort, time)
    if not np.ptp(pushed) > 0.0:
        return None
    mean, size = pushed.mean(), pushed.std()
    pushed = (pushed - mean) / size
    rows = _flowing(pushed)
    for gap in np.flatnonzero(interval > 3.0 * np.median(interval)):
        rows[gap : gap + _WARM] = False
    if rows.sum() < _FEWEST:
        return None
    # Of a mean the motion tells its beginning from its end: what was commanded last stands beside it.
    last = np.maximum(np.searchsorted(trial.time, time[:-1]) - 1, 1)
    ends = (effort[np.column_stack((last, last - 1))] - mean) / size
    own = (np.ones(len(rate)), ends, _windows(pushed), np.abs(_late(pushed, 1)), _late(pushed, 3))
    before = np.column_stack(own)[rows]
    # A set point that steps is an outlier to all that an autopilot does besides.
    change = _clipped(_robust_rest(before, pushed[rows]), 2.5)
    moved = _windows(_clipped(_innovations(rate, pushed), 4.0))
    chance, share = _against_slides(before, change, moved, rows)
    return Feedback(name=trial.name, seen_in="flow", chance=chance, share=share)


def _against_slides(before: FloatArray, change: FloatArray, moved: FloatArray, rows: BoolArray) -> tuple[float, float]:
    """How often chance tells as much of ``change`` as ``moved`` does beyond ``before``, and what share that is."""
    own = _basis(before)
    change = change - own @ (own.T @ change)
    columns = moved.shape[1]
    freedom = len(change) - own.shape[1] - columns
    total = float(change @ change)
    if not total > 1e-12 * len(change):
        # It all follows from the commands before, as a sine does.
        return 1.0, 0.0

    def share_of(x: FloatArray) -> float:
        left = _rest(x - own @ (own.T @ x), change)
        return 1.0 - float(left @ left) / total

    def f_of(share: float) -> float:
        return share / max(1.0 - share, 1e-300) * float(freedom / columns)

    spare = min(_SLID, len(moved) // 4)
    slides = np.unique(np.linspace(spare, len(moved) - spare, _SLIDES).astype(int))
    slid = np.array([f_of(share_of(np.roll(moved, slide, axis=0)[rows])) for slide in slides])
    share = share_of(moved[rows])
    if share < _SHARE or f_of(share) < slid.max():
        return 1.0, share
    return f_sf(columns, freedom, f_of(share) / max(1.0, slid.mean())), share


def _basis(x: FloatArray) -> FloatArray:
    """(n, k) orthonormal columns that span those of ``x``, of which some may be the same."""
    left, sizes, _ = np.linalg.svd(x / np.maximum(np.linalg.norm(x, axis=0), 1e-300), full_matrices=False)
    return np.asarray(left[:, sizes > 1e-9 * sizes[0]])


def _held_mean(time: FloatArray, held: FloatArray, edges: FloatArray) -> FloatArray:
    """(m,) means of the (n,) ``held`` values between (m + 1,) ``edges``."""
    integral = np.concatenate(([0.0], np.cumsum(held[:-1] * np.diff(time))))
    return np.asarray(np.diff(np.interp(edges, time, integral)) / np.diff(edges))


def _flowing(values: FloatArray) -> BoolArray:
    """(n,) where ``values`` change, row after row."""
    moves = np.abs(np.diff(values, prepend=values[0])) > 1e-9
    bounds = np.flatnonzero(np.diff(np.concatenate(([False], moves, [False])).astype(int)))
    flows = np.zeros(len(values), dtype=bool)
    for begin, end in bounds.reshape(-1, 2):
        flows[begin:end] = end - begin >= _FLOWS
    flows[:_WARM] = False
    return flows


def _windows(values: FloatArray) -> FloatArray:
    """(n, k) sums of ``values`` over the windows before each row, over the roots of their lengths."""
    total = np.concatenate(([0.0], np.cumsum(values)))
    row = np.arange(len(values))
    columns = []
    for first, last in _WINDOWS:
        low, high = np.maximum(row - last, 0), np.maximum(row - first + 1, 0)
        columns.append((total[high] - total[low]) / np.sqrt(last - first + 1))
    return np.column_stack(columns)


def _late(values: FloatArray, rows: int) -> FloatArray:
    """``values`` so many ``rows`` later."""
    return np.concatenate((np.full(rows, values[0]), values[: len(values) - rows]))


def _innovations(rate: FloatArray, pushed: FloatArray) -> FloatArray:
    """(n,) what of each rate does not follow from the rates and commands before, and the command of the row."""
    pushes = [_late(pushed, rows) for rows in range(7)]
    last = _late(rate, 1)
    bent = [np.abs(last) * last, np.abs(pushes[0]), np.abs(pushes[1])]
    rates = (_windows(rate), _late(rate, 3))
    x = np.column_stack((np.ones(len(rate)), *rates, *pushes, _windows(pushed)[:, 3:], *bent))
    return _rest(x / np.maximum(np.linalg.norm(x, axis=0), 1e-300), rate)


# ---- commands that step


def _steps(trial: Trial, effort: FloatArray) -> Feedback | None:
    at = _step_rows(trial, effort)
    if len(at) < _FEWEST_STEPS:
        return None
    instants = trial.time[at]
    lasted = np.diff(instants, prepend=trial.time[0])
    usual = float(np.median(lasted))
    place, rate = _motion(trial, instants, max(4.0 * trial.sampling_interval, 0.25 * usual))
    turned = np.diff(place, prepend=np.nan)
    rows = np.flatnonzero(np.isfinite(rate) & np.isfinite(turned))
    rows = rows[rows >= 2]
    levels = np.concatenate((effort[:1], effort[at])) / effort.std()
    after, held, earlier = levels[rows + 1], levels[rows], levels[rows - 1]
    lasted = np.minimum(lasted[rows] / usual, 3.0)
    own = np.column_stack((np.ones(len(rows)), held, earlier, held**2, held * earlier, lasted))
    motion = np.column_stack((turned[rows], rate[rows]))
    if len(rows) < own.shape[1] + motion.shape[1] + 4 or not np.ptp(motion, axis=0).all():
        return None
    chance, share = _pushes_back(own, motion / np.std(motion, axis=0), after)
    return Feedback(name=trial.name, seen_in="steps", chance=chance, share=share)


def _step_rows(trial: Trial, effort: FloatArray) -> IntArray:
    """Rows of ``trial.time`` from which a new level holds."""
    span = float(np.ptp(effort))
    changes = np.flatnonzero(np.abs(np.diff(effort)) > 1e-6 * span) + 1
    # Thrusters follow on each other within a moment; what goes on changing is no step.
    apart = np.flatnonzero(np.diff(trial.time[changes]) > _TOGETHER * trial.sampling_interval) + 1
    bursts = [burst for burst in np.split(changes, apart) if 0 < len(burst) <= 3]
    steps = [burst[-1] for burst in bursts if abs(effort[burst[-1]] - effort[burst[0] - 1]) > _STEP * span]
    return np.array(steps, dtype=np.intp)


def _motion(trial: Trial, instants: FloatArray, over: float) -> tuple[FloatArray, FloatArray]:
    """Position and rate at ``instants`` by what was measured in the ``over`` s before; NaN where that is too little."""
    time, position = trial.time[trial.measured], trial.position[trial.measured]
    firsts = np.searchsorted(time, instants - over)
    ends = np.searchsorted(time, instants, side="right")
    found = np.full((2, len(instants)), np.nan)
    for number, (first, end) in enumerate(zip(firsts, ends, strict=True)):
        if end - first >= 3:
            found[::-1, number] = np.polyfit(time[first:end] - instants[number], position[first:end], 1)
    place, rate = found
    return place, rate


def _pushes_back(own: FloatArray, motion: FloatArray, level: FloatArray) -> tuple[float, float]:
    """How often chance tells as much of ``level`` as ``motion`` does beyond ``own``, and what share that is."""
    both = np.column_stack((own, motion))
    left = _robust_rest(both, level)
    if not _usual(left) > 1e-6:
        # Each level follows from the one before, as of two that take turns.
        return 1.0, 0.0
    weight = _weights(left)
    own, both, level = own * weight[:, None], both * weight[:, None], level * weight
    freedom = len(level) - both.shape[1]
    total, rest = (float(np.sum(_rest(x, level) ** 2)) for x in (own, both))
    share = 1.0 - rest / total
    values, *_ = np.linalg.lstsq(both, level, rcond=1e-9)
    spread = np.sqrt(np.abs(np.diag(np.linalg.pinv(both.T @ both))) * rest / freedom)
    sure = (values / np.maximum(spread, 1e-300))[own.shape[1] :]
    if sure.max() > 2.0 or sure.min() > -2.0:
        return 1.0, share
    f = share / (1.0 - share) * freedom / motion.shape[1]
    return f_sf(motion.shape[1], freedom, f), share


# ---- commands that reverse


def _reversals(trial: Trial, effort: FloatArray) -> Feedback | None:
    at, senses = _reversal_rows(effort)
    if trial.axis.self_righting or len(at) < 3:
        # What rights itself comes back to the same places by itself.
        return None
    instants = trial.time[at]
    lasted = np.diff(instants, prepend=np.nan)
    place, rate = _motion(trial, instants, max(4.0 * trial.sampling_interval, 0.15 * float(np.median(lasted[1:]))))
    known = np.isfinite(place)
    lasted, place, rate, senses = lasted[known], place[known], rate[known], senses[known]
    places, freedom = _scatter(place, senses)
    durations, late_freedom = _scatter(lasted, senses)
    if not freedom or not late_freedom or abs(int(senses.sum())) == len(senses):
        return None
    # A clock ticks. About the middle of a swing half of what it lasts longer shows at its end.
    durations = max(durations, trial.sampling_interval / np.sqrt(12.0))
    by_duration = float(0.5 * np.median(np.abs(rate)) * durations)
    apart = float(place[senses < 0].mean() - place[senses > 0].mean())
    chance = 1.0
    if places < _NEAR * apart and by_duration > 0.0:
        chance = f_cdf(freedom, late_freedom, (places / by_duration) ** 2)
    return Feedback(name=trial.name, seen_in="reversals", chance=chance, scatter=places, by_duration=by_duration)


def _reversal_rows(effort: FloatArray) -> tuple[IntArray, IntArray]:
    """Rows from which the command leaves one side for the other, both of them held, and the side that it goes to."""
    low, high = np.percentile(effort, (5.0, 95.0))
    if not high > low:
        return np.empty(0, np.intp), np.empty(0, np.intp)
    swing = (effort - 0.5 * (low + high)) / (0.5 * (high - low))
    sides = np.where(np.abs(swing) > _SIDE, np.sign(swing), 0.0)
    known = np.flatnonzero(sides)
    legs = np.split(known, np.flatnonzero(np.diff(sides[known])) + 1)
    held = [bool(np.mean(np.abs(swing[leg] - np.median(swing[leg])) < _FLAT) > _MOSTLY) for leg in legs]
    pairs = zip(pairwise(legs), pairwise(held), strict=True)
    turns = [(int(leg[-1]) + 1, int(sides[then[0]])) for (leg, then), both in pairs if all(both)]
    return np.array([row for row, _ in turns], dtype=np.intp), np.array([sense for _, sense in turns], dtype=np.intp)


def _scatter(values: FloatArray, senses: IntArray) -> tuple[float, int]:
    """Standard deviation of ``values`` within each sense, and its degrees of freedom."""
    total, freedom = 0.0, 0
    for sense in (-1, 1):
        same = values[(senses == sense) & np.isfinite(values)]
        if len(same) > 1:
            total += float(np.sum((same - same.mean()) ** 2))
            freedom += len(same) - 1
    return float(np.sqrt(total / max(freedom, 1))), freedom


# ---- regressions


def _rest(x: FloatArray, y: FloatArray) -> FloatArray:
    """(n,) what is left of ``y``."""
    values, *_ = np.linalg.lstsq(x, y, rcond=1e-9)
    return np.asarray(y - x @ values)


def _robust_rest(x: FloatArray, y: FloatArray) -> FloatArray:
    """(n,) what is left of ``y`` by weights that outliers do not draw (Huber)."""
    left = _rest(x, y)
    for _ in range(15):
        if not _usual(left) > 0.0:
            break
        weight = _weights(left)
        values, *_ = np.linalg.lstsq(x * weight[:, None], y * weight, rcond=1e-9)
        left = y - x @ values
    return left


def _weights(left: FloatArray) -> FloatArray:
    return np.sqrt(np.minimum(1.0, 1.5 * _usual(left) / np.maximum(np.abs(left), 1e-300)))


def _usual(values: FloatArray) -> float:
    """Standard deviation of most of ``values``."""
    return 1.4826 * float(np.median(np.abs(values)))


def _clipped(values: FloatArray, most: float) -> FloatArray:
    """``values`` no larger than so many times the usual."""
    size = _usual(values)
    return np.clip(values, -most * size, most * size) if size > 0.0 else values
