"""How sure the parameters of a fit are, where its form is not nature's."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.formatting import significant
from rovid.estimate.fit_result import FitResult, fit
from rovid.model.parameter_names import unit_of

# A few steps of a climb.
COARSE_ITERATIONS = 4
# The answers of short and of long horizons are apart from so many joint errors on.
_APART = 3.0
# Of a difference between two answers, so much may either be off.
_HALF = 0.5


class _Answer(NamedTuple):
    """(p,) all parameters of a model, and their variances."""

    values: FloatArray
    variances: FloatArray


def misspecification_covariance(fitted: FitResult) -> tuple[FloatArray, list[str]]:
    """(p, p) what is added to the sandwich of all parameters for a form that is not nature's, and what is said of it.

    Predictions miss much the same in every stretch of the logs, which then scatters less than their errors would by
    chance: the information, which counts those, is the least that is not known.

    Short horizons and long ones would ask for the same parameters, were the model right. Half of what they are apart
    beyond chance is how far another choice of horizons might move them.
    """
    parts = fitted.objective.split_horizons()
    if parts is None:
        count = len(fitted.model.names)
        return np.zeros((count, count)), []
    scatter = np.diag(fitted.covariance(sandwich=True))
    least = np.diag(fitted.covariance(sandwich=False))
    doubt = np.diag(np.maximum(least - scatter, 0.0))
    if min(part.effective_count for part in parts) <= len(fitted.x):
        return doubt, []
    answers = []
    for part in parts:
        alone = fit(part, fitted.x, iterations=2 * COARSE_ITERATIONS)
        variances = np.diag(alone.covariance(sandwich=True))
        answers.append(_Answer(alone.model.values, variances))
    short, long = answers
    apart = short.values - long.values
    chance = short.variances + long.variances
    half = _HALF * np.sign(apart) * np.sqrt(np.maximum(apart**2 - chance, 0.0))
    return doubt + np.outer(half, half), _said(fitted, short, long)


def _said(fitted: FitResult, short: _Answer, long: _Answer) -> list[str]:
    """What is said of inertia or drag where the answers of short and of long horizons are farthest apart."""
    apart = short.values - long.values
    chance = short.variances + long.variances
    worst = int(np.argmax(np.abs(apart[:3]) / np.sqrt(np.maximum(chance[:3], 1e-300))))
    if abs(apart[worst]) <= _APART * math.sqrt(chance[worst]):
        return []
    name = fitted.model.names[worst]
    words, unit = name.replace("_", " "), unit_of(name, fitted.data.axis)
    near, far = (f"{significant(answer.values[worst], 3)} {unit}" for answer in (short, long))
    text = (
        f"Predictions up to one time constant ahead ask for another {words} ({near}) than "
        f"those from four on ({far}): something is still missing. Where commands answer the "
        "motion believe the short ones. The standard errors include half of the difference."
    )
    return [text]
