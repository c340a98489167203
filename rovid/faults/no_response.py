"""A log with thrust and no motion: on deck, moored, held, or with a sensor that stands still.

A log counts where its torque, through the time constant of the other logs, is a good share of theirs. Then its rate
over that torque is compared with the other logs' median. Quadratic drag alone lets that ratio vary by the square root
of the torques' ratio, at most twofold here.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

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
    for name, torque in pushed.items():
        others = [other for other in pushed if other != name]
        enough = others and torque > _FULL * float(np.median([pushed[other] for other in others]))
        response = rates[name] / torque
        if enough and response < _NONE * float(np.median([rates[other] / pushed[other] for other in others])):
            yield _found(name, parts[name], rates[name])


def _found(name: str, runs: list[Run], rate: float) -> Detection[RunsData]:
    axis = runs[0].trial.axis
    largest = max(float(np.abs(run.torque).max()) for run in runs)
    unit = "N m" if axis.angular else "N"
    text = (
        f"{name}: the vehicle does not respond. Its {axis.force_name} reaches {largest:.3g} {unit}, its "
        f"{axis.rate_words} stays at {rate:.2g} {axis.rate_unit} RMS."
    )
    fault = Fault(fault="no_response", logs=(name,), text=text, size=rate, unit=axis.rate_unit, remedy="set_aside")
    return Detection(fault=fault, done="It was set aside.", repair=partial(without, log=name))


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
