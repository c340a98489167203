"""How good a model is on trials that it was not fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rovid.diagnose.search import Fitted
from rovid.simulation import HORIZONS, overall, simulate_runs
from rovid.trial import FloatArray

_FOLDS = 4
_ITERATIONS = 8
_TOLERANCE = 0.2


@dataclass(frozen=True, kw_only=True)
class HeldOut:
    """Every trial predicted by a model that was fitted to other trials.

    Attributes
    ----------
    log_likelihood
        Of the innovations of all trials.
    rate_r2, rate_rmse
        Free-running, over all trials.
    position_errors
        Horizon in s -> RMS position error that far after a restart; None where no trial is as long.
    """

    log_likelihood: float
    rate_r2: float
    rate_rmse: float
    position_errors: dict[float, float | None]


@dataclass(frozen=True, kw_only=True, eq=False)
class Fold:
    """A fourth of the trials: their indices, the coordinates fitted to all others, and their log-likelihood there."""

    trials: list[int]
    x: FloatArray
    log_likelihood: float


def cross_validate(fitted: Fitted) -> list[Fold]:
    """Fit the model of ``fitted`` anew without each fourth of the trials, and predict those."""
    records, left_out, tests, fits = fitted.likelihood.records, _folds(len(fitted.likelihood.records.runs)), [], []
    for trials in left_out:
        outside = np.isin(records.trial, trials)
        train, test = (fitted.likelihood.like(fitted.effects, part) for part in (~outside, outside))
        # All trials together are a start so good that a few steps do.
        fits.append(train.climb(fitted.x, iterations=_ITERATIONS, tolerance=_TOLERANCE)[0])
        tests.append(test)
    costs = fitted.likelihood.held_out_costs(tests, fits)
    return [
        Fold(trials=trials, x=x, log_likelihood=-cost)
        for trials, cost, x in zip(left_out, costs, fits, strict=True)
    ]


def log_likelihood(folds: Sequence[Fold]) -> float:
    """Of all trials, each by the model that was fitted to others."""
    return sum(fold.log_likelihood for fold in folds)


def simulate_folds(fitted: Fitted, folds: Sequence[Fold]) -> HeldOut:
    """Simulate every trial freely with the model that was fitted to others."""
    records, simulations = fitted.likelihood.records, []
    assert records.vehicle is not None  # noqa: S101 - a diagnosis has one
    for fold in folds:
        model = fitted.likelihood.model(fold.x)
        simulations += simulate_runs([records.runs[k] for k in fold.trials], model, records.vehicle)
    fit = overall(simulations)
    errors = {horizon: _mean([item.position_errors[horizon] for item in simulations]) for horizon in HORIZONS}
    return HeldOut(
        log_likelihood=log_likelihood(folds),
        rate_r2=fit.r2,
        rate_rmse=fit.rmse,
        position_errors=errors,
    )


def _folds(count: int) -> list[list[int]]:
    """Every fourth trial: neighbours by name, which are of one kind, fall into different folds."""
    return [list(range(first, count, _FOLDS)) for first in range(min(_FOLDS, count))]


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.sqrt(np.mean(np.square(known)))) if known else None
