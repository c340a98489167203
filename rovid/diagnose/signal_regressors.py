"""Logged signals as causes that have no name: what is left over may follow one of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects import Effect, EffectParameter
from rovid.effects.actuator_inputs import ActuatorInputs
from rovid.effects.base import OnTorque, Values
from rovid.signals.preprocessing import Run
from rovid.trial.trial import Trial

_PREFIX = "signal "
_TILTS = ("roll", "pitch")
# A catalogued effect acts through the same channel in the same way.
_CATALOGUED = {("supply_voltage", "thrust"), ("surge_velocity", "drag")}
_SHARE = EffectParameter(name="share", unit="1", neutral=0.0, low=-2.0, high=2.0, initial_values=(0.05,))
_TORQUE = EffectParameter(
    name="torque", unit="N m", neutral=0.0, low=-2.0, high=2.0, initial_values=(0.03,), scale="torque"
)
# A torque's own zero is not the signal's mean; how drag divides is not what the model without the signal says.
_PARAMETERS = {
    "torque": (_TORQUE, replace(_TORQUE, name="level", initial_values=(0.001,))),
    "drag": (replace(_TORQUE, name="quadratic"), replace(_TORQUE, name="linear", initial_values=(0.001,))),
    "thrust": (_SHARE,),
}
_TITLES = {
    "torque": "a torque that follows",
    "drag": "drag that changes with",
    "thrust": "thrust that changes with",
}


def signal_regressors(runs: Sequence[Run]) -> tuple[Effect, ...]:
    """Every logged signal as a cause, in each way in which it may act.

    Signals are taken less their mean, over their standard deviation: sizes are those of one standard deviation, and
    of drag at the usual rate.
    """
    usual = float(np.sqrt(np.nanmean(np.concatenate([run.rates.rate for run in runs]) ** 2)))
    rates = {run.trial.name: _rate(run) / max(usual, 1e-12) for run in runs}
    causes: list[Effect] = []
    for name in signal_names(runs):
        signal = _signal(runs, name)
        if signal is None:
            continue
        ways = [way for way in _PARAMETERS if (name, way) not in _CATALOGUED]
        causes += [_cause(signal, way, rates) for way in ways]
    return tuple(causes)


def signal_names(runs: Sequence[Run]) -> list[str]:
    """Further channels and tilts that every run has."""
    if not runs:
        return []
    names = [_logged(run.trial) for run in runs]
    return sorted(set.intersection(*names))


def is_signal(effect: Effect) -> bool:
    """Whether ``effect`` is a logged signal and none of the catalogue."""
    return effect.id.startswith(_PREFIX)


def signal_name(effect: Effect) -> str:
    """Name of the signal that ``effect`` is."""
    return effect.id.removeprefix(_PREFIX)


def _logged(trial: Trial) -> set[str]:
    """Names of all signals beside heading and commands."""
    tilts = {name for name in _TILTS if getattr(trial, name) is not None}
    return tilts | set(trial.extras)


def _values(trial: Trial, name: str) -> FloatArray:
    """(n,) of the signal ``name``, in its own unit."""
    values = getattr(trial, name) if name in _TILTS else trial.extras[name]
    return np.asarray(values)


@dataclass(frozen=True, eq=False)
class _Signal:
    """A signal: (n,) for each trial, in its own unit, its mean and its standard deviation over all."""

    name: str
    values: Mapping[str, FloatArray]
    mean: float
    spread: float

    def standardised(self, where: ActuatorInputs) -> FloatArray:
        """(m,) in standard deviations from its mean; where it has no reading it is taken to be as usual."""
        return np.nan_to_num((where.from_trials(self.values) - self.mean) / self.spread)


def _signal(runs: Sequence[Run], name: str) -> _Signal | None:
    """The signal ``name``; None where it is not known or constant."""
    every = np.concatenate([_values(run.trial, name) for run in runs])
    if not np.isfinite(every).any():
        return None
    mean, spread = float(np.nanmean(every)), float(np.nanstd(every))
    if not spread > 1e-9 * (abs(mean) + 1e-300):
        return None
    return _Signal(name, {run.trial.name: _values(run.trial, name) for run in runs}, mean, spread)


def _rate(run: Run) -> FloatArray:
    """(n,) measured rate in rad/s in the middle of each interval, for all of which it stands."""
    known, time = np.isfinite(run.rates.rate), run.trial.time
    if not known.any():
        return np.zeros(len(time))
    middle = time + 0.5 * np.diff(time, append=time[-1])
    return np.interp(middle, run.rates.time[known], run.rates.rate[known])


def _cause(signal: _Signal, way: str, rates: Mapping[str, FloatArray]) -> Effect:
    def driven(where: ActuatorInputs, torque: FloatArray, values: Values) -> FloatArray:
        course = signal.standardised(where)
        size, *other = values.values()
        if way == "torque":
            return torque + size * course + other[0]
        if way == "drag":
            rate = where.from_trials(rates)
            return torque - course * rate * (size * np.abs(rate) + other[0])
        return torque * (1.0 + size * course)

    return Effect(
        id=_PREFIX + signal.name,
        form=way,
        title=f"{_TITLES[way]} {signal.name}",
        parameters=_PARAMETERS[way],
        equation="",
        fingerprint="residual torque that follows the signal",
        experiment="the same run with the signal held at two values",
        acts=OnTorque(driven),
    )
