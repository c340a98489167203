"""A log with thrust and no motion: on deck, moored, held, or with a sensor that stands still.

A log counts where its torque, through the time constant of the other logs, is a good share of theirs. Then its rate
over that torque is compared with the other logs' median. Quadratic drag alone lets that ratio vary by the square root
of the torques' ratio, at most twofold here.

A stretch of a log, as on the ground, counts by the same rule with standard deviations in windows: a constant torque may
balance a tether, a current or friction.

While the command is held, the torque by the motion, I rdot + DQ |r| r + DL r, over the torque by the command is near
one. A log in which this ratio is near zero in every hold does not respond, whatever waves do to it. A ratio that falls
to zero and returns during one hold is a supply that was interrupted: a wall, a tether or the wind does not let go. So
is one that falls at once and stays to the end of the hold: a tether turns the vehicle back bit by bit, a wall stops it.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.faults.base import Detection, Detectors, RunsData, without
from rovid.faults.common_causes import dead_thrusters
from rovid.faults.log_regressors import first_order, held_torque
from rovid.faults.quick_model import QuickModel, fit_quick_model, log_parts
from rovid.trial.fault import Fault
from rovid.trial.preprocessing import Run

# Share of the other logs' median torque (through the time constant) that a log needs to count.
_FULL = 0.3
# Rate per torque as a share of the median, below which a log does not respond: the vehicle would have 400 times the
# quadratic drag, or 20 times the linear drag and inertia.
_NONE = 0.05
# The same share, above which another stretch of the log responds.
_RESPONDS = 0.5
# RMS rate as a share of the log's largest, below which the vehicle coasts to rest: by quadratic drag it takes long.
_COASTS = 0.25
# Torque by the motion over the held torque: below, the vehicle does not respond; above, it does. Standard deviations of
# the ratio in the other windows between response and none: 3e-7 by chance. Windows that determine it.
_SILENT, _ANSWERS, _DEVIATIONS, _MIN_WINDOWS = 0.25, 0.75, 5.0, 10
# Torque of a window over the largest, and its largest variation: the command is held at full thrust.
_FULL_HOLD, _HELD = 0.5, 0.1
# Shortest interruption in windows, each a quarter of a time constant after the one before; longest fall to none, where
# the response does not return: one of the windows, each a time constant long, and two for the filter of the rates.
_INTERRUPTED, _FALL = 5, 6
# Length of a window in time constants, and its smallest number of samples.
_WINDOW, _MIN_SAMPLES = 5.0, 20
# Equal readings in succession that a vehicle under thrust hardly has.
_FROZEN = 50


def _detect(data: RunsData) -> Iterator[Detection[RunsData]]:
    parts = log_parts(run for run in data.runs if run.valid.any())
    rates = {name: _rms([_motion(run) for run in runs]) for name, runs in parts.items()}
    usual = float(np.median(list(rates.values()))) if rates else 0.0
    moving = [run for name, runs in parts.items() if rates[name] > _NONE * usual for run in runs]
    model = fit_quick_model(moving, data.vehicle)
    if model is None:
        # The other logs show no response to compare with.
        return
    tau = model.time_constant
    torques = {name: _rms([_torque(run, tau) for run in runs]) for name, runs in parts.items()}
    pushed = {name: torque for name, torque in torques.items() if torque > 0.0}
    dead = set[str]().union(*dead_thrusters(data.runs, data.vehicle).values())
    still = set[str]()
    for name, torque in pushed.items():
        others = [other for other in pushed if other != name]
        enough = others and torque > _FULL * float(np.median([pushed[other] for other in others]))
        response = rates[name] / torque
        if enough and response < _NONE * float(np.median([rates[other] / pushed[other] for other in others])):
            still.add(name)
            if name not in dead:
                yield _found(name, parts[name], rates[name])
    # The torque of a rudder of the coupled model is its angle alone: at rest it turns nothing.
    if any(thruster.rudder is not None for thruster in data.vehicle.thrusters):
        return
    rest = {name: runs for name, runs in parts.items() if name not in still}
    interrupted = dict(_interruptions(rest, model))
    for name, pause in interrupted.items():
        if pause or name not in dead:
            yield _found(name, parts[name], rates[name], *pause)
    yield from _stretches({name: runs for name, runs in rest.items() if name not in interrupted}, tau)


def _interruptions(parts: Mapping[str, Sequence[Run]], model: QuickModel) -> Iterator[tuple[str, tuple[float, ...]]]:
    """Logs that do not respond in any hold, or for a while during one, with its begin and end in s."""
    largest = max((float(np.abs(held_torque(run)).max()) for runs in parts.values() for run in runs), default=0.0)
    holds = {name: [one for run in runs for one in _hold_ratios(run, model, largest)] for name, runs in parts.items()}
    ratios = np.array([ratio for own in holds.values() for hold in own for _, ratio in hold])
    if len(ratios) < _MIN_WINDOWS:
        return
    usual = float(np.median(ratios))
    # 1.48 median absolute deviations are a standard deviation of a normal distribution.
    silent = min(_SILENT, usual - _DEVIATIONS * 1.48 * float(np.median(np.abs(ratios - usual))))
    if usual < _ANSWERS:
        return
    for name, own in holds.items():
        own_ratios = np.array([ratio for hold in own for _, ratio in hold])
        if len(own_ratios) and np.abs(own_ratios).max() < silent and abs(own_ratios.mean()) < _NONE:
            yield name, ()
            continue
        for hold in own:
            states = "".join(_state(one, silent) for _, one in hold)
            none = f"(0{{{_INTERRUPTED},}})"
            if pause := re.search(f"1[-<]*{none}[-<]*1", states) or re.search(f"1-{{0,{_FALL}}}{none}$", states):
                yield name, (hold[pause.start(1)][0], hold[pause.end(1) - 1][0] + model.time_constant)
                break


def _state(ratio: float, silent: float) -> str:
    """1 where the vehicle responds, 0 where it does not, "<" where it is turned back, "-" between."""
    if abs(ratio) < silent:
        return "0"
    return "1" if ratio > _ANSWERS else "<" if ratio < 0.0 else "-"


def _hold_ratios(run: Run, model: QuickModel, largest: float) -> Iterator[list[tuple[float, float]]]:
    """For each hold at full thrust: start in s of each window, and torque by the motion over held torque there."""
    rates, held = run.rates, held_torque(run)
    motion = np.column_stack((rates.acceleration, np.abs(rates.rate) * rates.rate, rates.rate)) @ model.values
    length = max(_MIN_SAMPLES, round(model.time_constant / rates.kernel.period))
    hold, level = list[tuple[float, float]](), 0.0
    for first in range(0, len(held) - length + 1, max(1, length // 4)):
        rows = slice(first, first + length)
        mean = float(np.mean(held[rows]))
        is_held = bool(run.valid[rows].all()) and np.abs(held[rows] - mean).max() < _HELD * abs(mean)
        if hold and not (is_held and abs(mean - level) < _HELD * abs(level)):
            yield hold
            hold = []
        if is_held and abs(mean) > _FULL_HOLD * largest:
            level = mean
            hold.append((float(rates.time[first]), float(np.mean(motion[rows])) / mean))
    if hold:
        yield hold


def _stretches(parts: Mapping[str, Sequence[Run]], tau: float) -> Iterator[Detection[RunsData]]:
    """Logs in which the vehicle does not respond for a while."""
    windows = {name: [window for run in runs for window in _windows(run, tau)] for name, runs in parts.items()}
    for name, own in windows.items():
        others = [window for other in windows if other != name for window in windows[other]]
        # Windows of a constant torque, and its fading past, show motion by waves or noise alone.
        enough = _FULL * max((window.torque for window in others), default=0.0)
        if not enough > 0.0:
            continue
        usual = float(np.median([window.rate / window.torque for window in others if window.torque > enough]))
        pushed = [window for window in own if window.torque > enough]
        # A vehicle that turns at a steady rate in a hold is not at rest.
        slow = _COASTS * max((window.level for window in pushed), default=0.0)
        silent = [one for one in pushed if one.rate < _NONE * usual * one.torque and one.level < slow]
        # A log that responds nowhere is another vehicle's.
        if silent and any(window.rate > _RESPONDS * usual * window.torque for window in pushed):
            yield _found(name, parts[name], float(np.median([window.rate for window in silent])), silent[0].start)


class _Window(NamedTuple):
    """Part of a run: its start in s, standard deviations of rate (rad/s or m/s) and torque (N m or N), and RMS rate."""

    start: float
    rate: float
    torque: float
    level: float


def _windows(run: Run, tau: float) -> Iterator[_Window]:
    """Overlapping windows of some time constants of the vehicle, in which the rate is known."""
    held, period = held_torque(run), run.rates.kernel.period
    # A slow first-order response still moves in a hold, where quadratic drag has settled the rate long before.
    late = first_order(held, tau, period)
    length = max(_MIN_SAMPLES, round(_WINDOW * tau / period))
    for first in range(0, len(held) - length + 1, length // 8):
        rows = slice(first, first + length)
        if run.valid[rows].all():
            rate = float(np.sqrt(max(float(np.var(run.rates.rate[rows])) - run.rates.rate_noise**2, 0.0)))
            torque = float(min(np.std(late[rows]), np.std(held[rows])))
            yield _Window(float(run.rates.time[first]), rate, torque, _rms(run.rates.rate[rows]))


def _found(
    name: str, runs: Sequence[Run], rate: float, at: float | None = None, end: float | None = None
) -> Detection[RunsData]:
    axis = runs[0].trial.axis
    largest, unit = max(float(np.abs(run.torque).max()) for run in runs), "N m" if axis.angular else "N"
    since = "" if at is None else f" from {at:.1f} s on, for some time or to the end"
    text = (
        f"{name}: the vehicle does not respond{since}. Its {axis.force_name} reaches {largest:.3g} {unit}, its "
        f"{axis.rate_words} stays at {rate:.2g} {axis.rate_unit} RMS."
    )
    if end is not None:
        text = (
            f"{name}: the vehicle does not respond from {at:.1f} to {end:.1f} s. The command is held there, but its "
            f"{axis.force_name} was absent, as after a breaker opened."
        )
    equal = []
    for run in runs:
        changes = np.diff(run.trial.position[run.trial.measured], prepend=np.nan, append=np.nan) != 0.0
        equal.append(int(np.diff(np.flatnonzero(changes)).max(initial=0)))
    if (count := max(equal)) >= _FROZEN:
        text += f" {count} successive readings of the {axis.position_words} are equal: "
        text += "its sensor or topic may be frozen."
    begin = () if at is None else (at,)
    fault = Fault(
        fault="no_response", logs=(name,), at=begin, text=text, size=rate, unit=axis.rate_unit, remedy="set_aside"
    )
    done = "It was set aside."
    if at is not None:
        done = "The log was set aside. To use its other part, leave that stretch out under [[leave_out]] in rovid.toml."
    return Detection(fault=fault, done=done, repair=partial(without, log=name))


def _motion(run: Run) -> float:
    """RMS rate without the sensor noise; rad/s or m/s."""
    rate = run.rates.rate[run.valid]
    return float(np.sqrt(max(float(np.mean(rate**2)) - run.rates.rate_noise**2, 0.0)))


def _torque(run: Run, tau: float) -> float:
    """RMS torque through the time constant ``tau`` in s."""
    return _rms(first_order(held_torque(run), tau, run.rates.kernel.period)[run.valid])


def _rms(values: Sequence[float] | FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


DETECTORS: Detectors = {"runs": (_detect,)}
