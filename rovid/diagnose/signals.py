"""Logged signals as causes that have no name: what is left over may follow one of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from rovid.effects import Effect, EffectParameter
from rovid.effects.base import Actuation, Values
from rovid.model import Model
from rovid.runs import Run
from rovid.trial import FloatArray, Trial

PREFIX = "signal "
# How a signal may act: a torque in proportion to it, or drag or thrust that change with it.
_WAYS = ("torque", "drag", "thrust")
# A catalogued effect acts through the same channel in the same way.
_CATALOGUED = {("supply_voltage", "thrust")}
_PLAIN = Effect(
    id="",
    title="",
    parameters=(EffectParameter(name="share", unit="1", null=0.0, low=-2.0, high=2.0, starts=(0.05,)),),
    equation="",
    fingerprint="residual torque that follows the signal",
    experiment="the same run with the signal held at two values",
)
_TORQUE = EffectParameter(name="torque", unit="N m", null=0.0, low=-2.0, high=2.0, starts=(0.03,), scale="torque")


def drivers(runs: Sequence[Run], model: Model) -> tuple[Effect, ...]:
    """Every logged signal as a cause, in each way in which it may act.

    Signals are taken less their mean, over their standard deviation: sizes are those of one standard deviation.

    Parameters
    ----------
    model
        For the drag that a signal may change, at the measured rate.
    """
    brakes = {run.trial.name: model.drag(_rate(run)) for run in runs}
    courses = {name: _standardised(runs, name) for name in signal_names(runs)}
    return tuple(
        _driver(name, way, course, brakes)
        for name, course in courses.items()
        if course is not None
        for way in _WAYS
        if (name, way) not in _CATALOGUED
    )


def signal_names(runs: Sequence[Run]) -> list[str]:
    """Further channels and tilts that every run has."""
    names = set.intersection(*(_logged(run.trial) for run in runs)) if runs else set()
    return sorted(names)


def is_driver(effect: Effect) -> bool:
    """Whether ``effect`` is a logged signal and none of the catalogue."""
    return effect.id.startswith(PREFIX)


def signal_of(effect: Effect) -> str:
    """Name of the signal of a driver."""
    return effect.id.removeprefix(PREFIX)


def _logged(trial: Trial) -> set[str]:
    tilts = {name for name in ("roll", "pitch") if getattr(trial, name) is not None}
    return tilts | set(trial.extras)


def _values(trial: Trial, name: str) -> FloatArray:
    return np.asarray(getattr(trial, name) if name in ("roll", "pitch") else trial.extras[name])


def _standardised(runs: Sequence[Run], name: str) -> dict[str, FloatArray] | None:
    every = np.concatenate([_values(run.trial, name) for run in runs])
    if not np.isfinite(every).any():
        return None
    mean, spread = float(np.nanmean(every)), float(np.nanstd(every))
    if not spread > 1e-9 * (abs(mean) + 1e-300):
        return None
    return {run.trial.name: np.nan_to_num((_values(run.trial, name) - mean) / spread) for run in runs}


def _rate(run: Run) -> FloatArray:
    known = np.isfinite(run.rates.yaw_rate)
    if not known.any():
        return np.zeros(len(run.trial.time))
    return np.interp(run.trial.time, run.rates.time[known], run.rates.yaw_rate[known])


def _driver(name: str, way: str, course: Mapping[str, FloatArray], brakes: Mapping[str, FloatArray]) -> Effect:
    laws: dict[str, Callable[[Actuation, FloatArray, float], FloatArray]] = {
        "torque": lambda where, torque, size: torque + size * course[where.trial],
        "drag": lambda where, torque, size: torque - size * course[where.trial] * brakes[where.trial],
        "thrust": lambda where, torque, size: torque * (1.0 + size * course[where.trial]),
    }
    law = laws[way]

    def on_torque(where: Actuation, torque: FloatArray, values: Values) -> FloatArray:
        return law(where, torque, next(iter(values.values())))

    parameters = (_TORQUE,) if way == "torque" else _PLAIN.parameters
    title = {"torque": f"a torque that follows {name}", "drag": f"drag that changes with {name}"}
    return replace(
        _PLAIN,
        id=PREFIX + name,
        form=way,
        title=title.get(way, f"thrust that changes with {name}"),
        parameters=parameters,
        on_torque=on_torque,
    )
