"""A log with thrust and no motion: on deck, moored, held, or with a sensor that stands still.

A log counts where its torque, through the time constant of the other logs, is a good share of theirs. Then its rate
over that torque is compared with the other logs' median. Quadratic drag alone lets that ratio vary by the square root
of the torques' ratio, at most twofold here.

A stretch of a log, as on the ground, counts by the same rule with standard deviations in
windows: a constant torque may balance a tether, a current or friction.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.faults.base import Detection, FaultKind, RunsData
from rovid.faults.foreign_log import without
from rovid.faults.quick_model import first_order, fit_quick_model, held_torque, log_name
from rovid.signals.preprocessing import Run
from rovid.trial.fault import Fault

# Share of the other logs' median torque (through the time constant) that a log needs to count.
_FULL = 0.3
# Rate per torque as a share of the median, below which a log does not respond: the vehicle would have 400 times the
# quadratic drag, or 20 times the linear drag and inertia.
_NONE = 0.05
# The same share, above which another stretch of the log responds.
_RESPONDS = 0.5
# RMS rate as a share of the log's largest, below which the vehicle coasts to rest: by quadratic drag it takes long.
_COASTS = 0.25
# Length of a window in time constants, and its smallest number of samples.
_WINDOW, _MIN_SAMPLES = 5.0, 20


def _detect(data: RunsData) -> Iterator[Detection[RunsData]]:
    parts: dict[str, list[Run]] = {}
    for run in data.runs:
        if run.valid.any():
            parts.setdefault(log_name(run), []).append(run)
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
    still = set[str]()
    for name, torque in pushed.items():
        others = [other for other in pushed if other != name]
        enough = others and torque > _FULL * float(np.median([pushed[other] for other in others]))
        response = rates[name] / torque
        if enough and response < _NONE * float(np.median([rates[other] / pushed[other] for other in others])):
            still.add(name)
            yield _found(name, parts[name], rates[name])
    yield from _stretches({name: runs for name, runs in parts.items() if name not in still}, tau)


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


def _found(name: str, runs: Sequence[Run], rate: float, at: float | None = None) -> Detection[RunsData]:
    axis = runs[0].trial.axis
    largest = max(float(np.abs(run.torque).max()) for run in runs)
    unit = "N m" if axis.angular else "N"
    since = "" if at is None else f" from {at:.1f} s on, for some time or to the end"
    text = (
        f"{name}: the vehicle does not respond{since}. Its {axis.force_name} reaches {largest:.3g} {unit}, its "
        f"{axis.rate_words} stays at {rate:.2g} {axis.rate_unit} RMS."
    )
    fault = Fault(
        fault="no_response",
        logs=(name,),
        at=() if at is None else (at,),
        text=text,
        size=rate,
        unit=axis.rate_unit,
        remedy="set_aside",
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


FAULT = FaultKind(
    id="no_response",
    title="Thrust and no motion",
    stage="runs",
    detect=_detect,
    false_alarms="none: a vehicle that moves has not 20 times the inertia or the drag of its other logs.",
)
