"""Logged signals as regressors: effects without a name, for errors that follow a signal."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects import Effect, EffectParameter
from rovid.effects.actuator_inputs import ActuatorInputs
from rovid.effects.base import OnTorque, Values
from rovid.trial.preprocessing import Run
from rovid.trial.trial import Trial

_PREFIX = "signal "
_TILTS = ("roll", "pitch")
# Pairs of signal and way that an effect of the catalogue has.
_CATALOGUED = {("supply_voltage", "thrust"), ("surge_velocity", "drag")}
_SHARE = EffectParameter(name="share", unit="1", neutral=0.0, low=-2.0, high=2.0, initial_values=(0.05,))
_TORQUE = EffectParameter(
    name="torque", unit="N m", neutral=0.0, low=-2.0, high=2.0, initial_values=(0.03,), scale="torque"
)
# The torque may vanish away from the signal's mean. Quadratic and linear drag may depend on the signal differently.
_PARAMETERS = {
    "torque": (_TORQUE, replace(_TORQUE, name="level", initial_values=(0.001,))),
    "drag": (replace(_TORQUE, name="quadratic"), replace(_TORQUE, name="linear", initial_values=(0.001,))),
    "thrust": (_SHARE,),
}
_TITLES = {"torque": "a torque that follows", "drag": "drag that changes with", "thrust": "thrust that changes with"}


def signal_regressors(runs: Sequence[Run]) -> tuple[Effect, ...]:
    """Each logged signal as an effect on torque, drag and thrust.

    Signals are standardised: sizes are for one standard deviation, and of drag at the RMS rate.
    """
    rms_rate = float(np.sqrt(np.nanmean(np.concatenate([run.rates.rate for run in runs]) ** 2)))
    rates = {run.trial.name: _rate(run) / max(rms_rate, 1e-12) for run in runs}
    effects: list[Effect] = []
    for name in signal_names(runs):
        signal = _signal(runs, name)
        if signal is None:
            continue
        ways = ("torque",) if name == runs[0].trial.axis.position_signal else _PARAMETERS
        effects += [_effect(signal, way, rates) for way in ways if (name, way) not in _CATALOGUED]
    return tuple(effects)


def signal_names(runs: Sequence[Run]) -> list[str]:
    """Channels and tilts that every run has, and the position along an axis; effects of the catalogue have an angle."""
    names = []
    for run in runs:
        axis = run.trial.axis
        own = set[str]() if axis.angular or run.trial.rate_only else {axis.position_signal}
        tilts = {name for name in _TILTS if getattr(run.trial, name) is not None}
        names.append(own | tilts | set(run.trial.extras))
    return sorted(set.intersection(*names)) if names else []


def is_signal(effect: Effect) -> bool:
    """Whether ``effect`` is a signal regressor, and none of the catalogue."""
    return effect.id.startswith(_PREFIX)


def signal_name(effect: Effect) -> str:
    """Name of the signal of a signal regressor."""
    return effect.id.removeprefix(_PREFIX)


def _values(trial: Trial, name: str) -> FloatArray:
    """(n,) signal in its own unit."""
    if name == trial.axis.position_signal:
        return np.interp(trial.time, trial.time[trial.measured], trial.position[trial.measured])
    return np.asarray(getattr(trial, name) if name in _TILTS else trial.extras[name])


class _Signal(NamedTuple):
    """A signal: (n,) values of each trial in its own unit, with mean and standard deviation over all trials."""

    name: str
    values: Mapping[str, FloatArray]
    mean: float
    spread: float


def _signal(runs: Sequence[Run], name: str) -> _Signal | None:
    """The signal ``name``; None where it is unknown or constant."""
    values = {run.trial.name: _values(run.trial, name) for run in runs}
    every = np.concatenate([values[run.trial.name] for run in runs])
    if not np.isfinite(every).any():
        return None
    mean, spread = float(np.nanmean(every)), float(np.nanstd(every))
    return _Signal(name, values, mean, spread) if spread > 1e-9 * (abs(mean) + 1e-300) else None


def _rate(run: Run) -> FloatArray:
    """(n,) measured rate in rad/s at the centre of each sampling interval."""
    known, time = np.isfinite(run.rates.rate), run.trial.time
    if not known.any():
        return np.zeros(len(time))
    centre = time + 0.5 * np.diff(time, append=time[-1])
    return np.interp(centre, run.rates.time[known], run.rates.rate[known])


def _effect(signal: _Signal, way: str, rates: Mapping[str, FloatArray]) -> Effect:
    def modified(inputs: ActuatorInputs, torque: FloatArray, values: Values) -> FloatArray:
        series = np.nan_to_num((inputs.from_trials(signal.values) - signal.mean) / signal.spread)
        size, *other = values.values()
        if way == "torque":
            return torque + size * series + other[0]
        if way == "drag":
            rate = inputs.from_trials(rates)
            return torque - series * rate * (size * np.abs(rate) + other[0])
        return torque * (1.0 + size * series)

    return Effect(
        id=_PREFIX + signal.name,
        form=way,
        title=f"{_TITLES[way]} {signal.name}",
        parameters=_PARAMETERS[way],
        equation="",
        fingerprint="residual torque that follows the signal",
        experiment="the same run with the signal held at two values",
        acts=OnTorque(modified),
    )
