"""Causes that are of another size in each trial, or in one alone. Their forms name the trials."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.base import ActuatorInputs, EffectParameter

_ONE, _EACH, _BETWEEN = "trial ", "trials ", "|"


def form_name(names: Sequence[str]) -> str:
    """The form of a cause in the trials of these ``names``."""
    return (_ONE if len(names) == 1 else _EACH) + _BETWEEN.join(names)


def trials_in_form(form: str) -> tuple[str, ...]:
    """Names of the trials that a ``form`` is of; none of other forms."""
    if form.startswith(_ONE):
        return (form.removeprefix(_ONE),)
    if form.startswith(_EACH):
        return tuple(form.removeprefix(_EACH).split(_BETWEEN))
    return ()


def one_size_per_trial(size: EffectParameter, count: int, start: float) -> tuple[EffectParameter, ...]:
    """So many parameters like ``size``, each with a ``start`` of its own at which the others are not there."""
    every = range(count)
    return tuple(
        replace(
            size,
            name=f"{size.name}_{own + 1}",
            initial_values=tuple(start if number == own else size.neutral for number in every),
        )
        for own in every
    )


def held_sizes(where: ActuatorInputs, names: Sequence[str], sizes: Sequence[float], otherwise: float) -> FloatArray:
    """(n,) at each instant the size in its trial, and ``otherwise`` in trials that are not among ``names``."""
    own = dict(zip(names, sizes, strict=True))
    series = np.full(len(where.time), otherwise)
    for trial in where.trials:
        series[trial.rows] = own.get(trial.parent, otherwise)
    return series
