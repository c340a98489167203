"""Commands that end before the log, are silent for many of their usual intervals, or repeat their last value.

The last command is known for one usual interval. After it the vehicle may have got any command, or none. Commands that
are published only on change are silent while they stay the same; that is no fault. They are recognised by their
intervals, which are irregular, and by their values, which never repeat.

A logger that repeats the last value shows constant commands, as a hold does. Under a constant torque the vehicle
settles. Commands are frozen where they stand still for longer than elsewhere in the log, while the model of all other
data leaves a torque unexplained that moves the vehicle both ways, by far more than in any other stretch of this length.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.faults.base import CommandData, Detection, Detectors, RunsData
from rovid.faults.log_regressors import first_order
from rovid.faults.quick_model import QuickModel, fit_quick_model, log_name
from rovid.faults.several_releases import cut_out, free_motion, log_starts, moving_torque
from rovid.trial.fault import Fault
from rovid.trial.preprocessing import Run
from rovid.trial.segments import subsampled_median

_MIN_COMMANDS = 10
# A silence is longer than this many usual intervals, and than this many times the longest of the other intervals but
# one in a hundred: loggers and radio links lose single messages.
_SILENT_INTERVALS, _SILENT_RATIO = 10.0, 3.0
# Commands are logged regularly if the 90th percentile of their intervals is within this many medians.
_REGULAR, _STRICT = 3.0, 1.2
# Smallest share of equal successive commands that shows that commands are published without change, too.
_REPEATED = 0.05
# Share of the commanded range within which a command is neutral.
_NEUTRAL = 0.02
# Share of a silence in which motion must have been measured: in a pause of the whole log, no command is missing.
_MIN_MEASURED = 0.5
# Frozen commands stand still for this many times as long as any other commands of the log, but for as many freezes as
# this, and for this many time constants: a hold settles within them.
_LONGER, _MOST_FREEZES, _SETTLED = 1.5, 3, 1.0
# Standard deviation of the unexplained torque of a stretch: over the largest of at least so many other stretches of the
# same length (1.1 at most in 40 undamaged campaigns, most of them in hard water), over that of the torque that moves
# the vehicle elsewhere in the log, and share of the latter that the model may leave unexplained there.
_EXCESS, _MIN_STRETCHES, _MOVES, _UNEXPLAINED = 2.0, 4, 0.3, 0.5
# The same excess where the model includes the stretch.
_LEAST_EXCESS = 1.0
# Least number of times that the unexplained torque passes from one side of its mean to the other, by half a standard
# deviation on each side: a thruster that fails in a hold changes the torque once.
_PASSES, _SIDE = 2, 0.5
# Time constant of the low pass of the unexplained torque, which suppresses noise, in lengths of the stretch at most.
_SMOOTHED = 0.05


def _detect(data: CommandData) -> Iterator[Detection[CommandData]]:
    known = np.isfinite(data.values)
    time, values = data.time[known], data.values[known]
    if len(time) < _MIN_COMMANDS:
        return
    usual, silences = _silences(time, values, data)
    reading = subsampled_median(np.diff(data.measured))
    counts = [int(np.ptp(np.searchsorted(data.measured, pair))) for pair in silences]
    pairs = zip(silences, counts, strict=True)
    silences = [pair for pair, count in pairs if count * reading >= _MIN_MEASURED * (pair[1] - pair[0])]
    if not silences:
        return
    start, end = data.measured[[0, -1]].tolist()
    unknown = tuple((begin + usual, np.inf if stop >= end else stop) for begin, stop in silences)
    begins = [begin - start for begin, _ in silences]
    size = max(stop - begin for begin, stop in silences)
    if len(silences) == 1 and silences[0][1] >= end:
        what = f"end at {begins[0]:.1f} s, {size:.1f} s before the log"
    else:
        count = len(silences)
        what = f"are silent for {size:.1f} s from {begins[int(np.argmax(np.diff(silences)))]:.1f} s on"
        what += f", and {count - 1} times more" if count > 1 else ""
    fault = Fault(
        fault="stale_commands",
        logs=(data.log,),
        at=tuple(begins),
        size=size,
        unit="s",
        text=f"{data.log}: the commands of {data.name} {what}; their usual interval is {usual:.3g} s.",
        remedy="unknown",
    )
    done = "The command is unknown after one more usual interval, and the log is left out where it matters."
    yield Detection(fault=fault, done=done, repair=lambda data: replace(data, unknown=(*data.unknown, *unknown)))


def _silences(time: FloatArray, values: FloatArray, data: CommandData) -> tuple[float, list[tuple[float, float]]]:
    """Usual interval in s, and (begin, end) in s of each silence of commands that are published regularly."""
    intervals = np.diff(time)
    usual, upper, longest = np.percentile(intervals, (50.0, 90.0, 99.0), method="lower").tolist()
    if upper > _REGULAR * usual:
        return usual, []
    limit = max(_SILENT_INTERVALS * usual, _SILENT_RATIO * longest)
    end = float(data.measured[-1])
    ends = np.append(time[1:], max(end, time[-1]))
    silent = ends - time > limit
    if not np.mean(np.diff(values) == 0.0) >= _REPEATED:
        # Each command differs from the one before: perhaps only changes are published, and a silence is a held value.
        # At a constant rate, a held value that is not neutral is unlikely to be meant.
        neutral = data.thruster.curve.neutral if data.thruster and data.thruster.curve else 0.0
        silent &= bool(upper <= _STRICT * usual) & (np.abs(values - neutral) > _NEUTRAL * np.ptp(values))
    return usual, list(zip(time[silent].tolist(), ends[silent].tolist(), strict=True))


def _detect_frozen(data: RunsData) -> Iterator[Detection[RunsData]]:
    starts, first = log_starts(data.runs), fit_quick_model(data.runs, data.vehicle)
    for run in data.runs:
        stretches = [pair for pair in _still(run) if first and _moves(data, run, pair, first)]
        others = cut_out(data, run, stretches) if stretches else data
        # A fit takes long, so the model of all data comes first. It is drawn towards frozen commands.
        stretches = [pair for pair in stretches if first and _is_driven(others, run, pair, first, _LEAST_EXCESS)]
        if not stretches:
            continue
        model = fit_quick_model(others.runs, data.vehicle)
        stretches = [pair for pair in stretches if model and _is_driven(others, run, pair, model, _EXCESS)]
        if not stretches:
            continue
        begins = tuple(run.trial.campaign_time - starts[log_name(run)] + begin for begin, _ in stretches)
        size = max(end - begin for begin, end in stretches)
        more = f", and {len(stretches) - 1} times more" if len(stretches) > 1 else ""
        text = (
            f"{log_name(run)}: the commands repeat one value for {size:.1f} s from "
            f"{begins[int(np.argmax(np.diff(stretches)))]:.1f} s on{more}, and the vehicle goes on manoeuvring, which "
            "a constant torque does not explain."
        )
        fault = Fault(
            fault="stale_commands", logs=(log_name(run),), at=begins, size=size, unit="s", text=text, remedy="unknown"
        )
        done = "The commands are unknown there, and the log was cut."
        yield Detection(fault=fault, done=done, repair=partial(cut_out, run=run, intervals=stretches))


def _still(run: Run) -> list[tuple[float, float]]:
    """(begin, end) in s of each stretch in which a command of ``run`` stands still for longer than elsewhere."""
    time, found = run.trial.time, set[tuple[float, float]]()
    for column in run.trial.commands.T:
        edges = np.concatenate(([0], np.flatnonzero(np.diff(column)) + 1, [len(time) - 1]))
        lengths = np.diff(time[edges])
        order = np.argsort(lengths)[::-1]
        for count in range(min(_MOST_FREEZES, len(order) - 1), 0, -1):
            if lengths[order[count - 1]] > _LONGER * lengths[order[count]]:
                found |= {(float(time[edges[at]]), float(time[edges[at + 1]])) for at in order[:count].tolist()}
                break
    return sorted(found)


def _moves(data: RunsData, run: Run, stretch: tuple[float, float], model: QuickModel) -> bool:
    """Whether thrust and torques that ``model`` does not explain move the vehicle in a ``stretch`` of ``run``."""
    within, moving = (run.rates.time > stretch[0]) & (run.rates.time < stretch[1]), moving_torque(run, model)
    inside = run.valid & within
    if stretch[1] - stretch[0] < _SETTLED * model.time_constant or np.count_nonzero(inside) < _MIN_COMMANDS:
        return False
    if free_motion(tuple(data.runs), data.vehicle).is_free(run)[within].all():
        return False
    return bool(np.std((moving - run.filtered_torque)[inside]) > 0.5 * _MOVES * np.std(moving[run.valid]))


def _is_driven(others: RunsData, run: Run, stretch: tuple[float, float], model: QuickModel, excess: float) -> bool:
    """Whether torques that ``model`` does not explain move the vehicle both ways in a stretch, unlike in ``others``."""
    if not others.runs:
        return False
    # Half of a log at most: several stretches of the others are as long.
    length = min(stretch[1] - stretch[0], 0.5 * max(one.trial.duration for one in others.runs))
    inside = run.valid & (run.rates.time > stretch[0]) & (run.rates.time < stretch[1])
    period, tau = run.rates.kernel.period, min(model.time_constant, _SMOOTHED * length)
    rest = _smooth((moving_torque(run, model) - run.filtered_torque)[inside], tau, period)
    size = max((float(np.std(rest[rows])) for rows in _stretches(run.rates.time[inside], length)), default=0.0)
    levels, moved, unexplained = list[float](), list[FloatArray](), list[FloatArray]()
    for one in others.runs:
        own = moving_torque(one, model)
        parts = [_smooth(each[one.valid], tau, period) for each in (own, own - one.filtered_torque)]
        if log_name(one) == log_name(run):
            moved.append(parts[0])
            unexplained.append(parts[1])
        levels += [float(np.std(parts[1][rows])) for rows in _stretches(one.rates.time[one.valid], length)]
    if len(levels) < _MIN_STRETCHES or not moved or size < excess * max(levels):
        return False
    usual, left = (float(np.std(np.concatenate(each))) for each in (moved, unexplained))
    if size < _MOVES * usual or left > _UNEXPLAINED * usual:
        return False
    side = rest / (_SIDE * size)
    return int(np.count_nonzero(np.diff(np.sign(side[np.abs(side) > 1.0])))) >= _PASSES


def _smooth(torque: FloatArray, tau: float, period: float) -> FloatArray:
    """(n,) ``torque`` about its mean, through a low pass."""
    return first_order(torque - torque.mean(), tau, period) if torque.size else torque


def _stretches(time: FloatArray, length: float) -> Iterator[slice]:
    """Rows of stretches of a ``length`` in s that overlap by half, without those that are measured for less."""
    starts = np.arange(time[0], time[-1] - 0.7 * length, 0.5 * length) if time.size else time
    for first, last in np.searchsorted(time, np.stack((starts, starts + length), axis=1)).tolist():
        if last - first > _MIN_COMMANDS and time[last - 1] - time[first] > 0.5 * length:
            yield slice(first, last)


DETECTORS: Detectors = {"command": (_detect,), "runs": (_detect_frozen,)}
