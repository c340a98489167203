"""Forms of an effect with another size in each trial, or in one trial alone. The form names the trials.

Parts of a trial, cut for validation, have the size of that trial, their `TrialRows.parent`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.base import ActuatorInputs, EffectParameter

_ONE, _SEVERAL, _SEPARATOR = "trial ", "trials ", "|"


def form_name(names: Sequence[str]) -> str:
    """Name of the form for trials with these ``names``."""
    return (_ONE if len(names) == 1 else _SEVERAL) + _SEPARATOR.join(names)


def trials_in_form(form: str) -> tuple[str, ...]:
    """Names of the trials in the name of a ``form``; empty for other forms."""
    if form.startswith(_ONE):
        return (form.removeprefix(_ONE),)
    if form.startswith(_SEVERAL):
        return tuple(form.removeprefix(_SEVERAL).split(_SEPARATOR))
    return ()


def one_size_per_trial(size: EffectParameter, count: int, start: float) -> tuple[EffectParameter, ...]:
    """``count`` parameters like ``size``. Each has one initial value ``start``, with the other parameters neutral."""
    parameters = []
    for own in range(count):
        initial_values = [size.neutral] * count
        initial_values[own] = start
        parameters.append(replace(size, name=f"{size.name}_{own + 1}", initial_values=tuple(initial_values)))
    return tuple(parameters)


def held_sizes(inputs: ActuatorInputs, names: Sequence[str], sizes: Sequence[float], otherwise: float) -> FloatArray:
    """(n,) size in the trial of each instant; ``otherwise`` in trials that are not among ``names``."""
    by_name = dict(zip(names, sizes, strict=True))
    series = np.full(len(inputs.time), otherwise)
    for trial in inputs.trials:
        series[trial.rows] = by_name.get(trial.parent, otherwise)
    return series
