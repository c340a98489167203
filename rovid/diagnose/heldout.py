"""How good a model is on trials that it was not fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rovid.diagnose.search import Fitted
from rovid.identify.innovations import Likelihood
from rovid.simulation import HORIZONS, overall, simulate_runs
from rovid.trial import FloatArray

_FOLDS = 4
_ITERATIONS = 15


@dataclass(frozen=True, kw_only=True)
class HeldOut:
    """Every trial predicted by a model that was fitted to other trials.

    Attributes
    ----------
    log_likelihood
        Of the innovations of all trials.
    yaw_rate_r2, yaw_rate_rmse
        Free-running, over all trials; rad/s.
    heading_errors
        Horizon in s -> RMS heading error in rad that far after a restart; None where no trial is as long.
    """

    log_likelihood: float
    yaw_rate_r2: float
    yaw_rate_rmse: float
    heading_errors: dict[float, float | None]


def held_out(fitted: Fitted) -> HeldOut:
    """Fit the model of ``fitted`` anew without each fourth of the trials, and predict those."""
    records = fitted.likelihood.records
    total, simulations = 0.0, []
    for fold in _folds(len(records.runs)):
        outside = np.isin(records.trial, fold)
        x = _fitted_without(fitted, outside)
        total -= float(np.sum(Likelihood(records, fitted.likelihood.limit, fitted.effects, outside).pieces(x)))
        assert records.vehicle is not None  # noqa: S101 - a diagnosis has one
        simulations += simulate_runs([records.runs[k] for k in fold], fitted.likelihood.model(x), records.vehicle)
    fit = overall(simulations)
    errors = {horizon: _mean([item.heading_errors[horizon] for item in simulations]) for horizon in HORIZONS}
    return HeldOut(log_likelihood=total, yaw_rate_r2=fit.r2, yaw_rate_rmse=fit.rmse, heading_errors=errors)


def predictive_gain(full: Fitted, less: Fitted) -> float:
    """Log-likelihood of trials not fitted that ``full`` gains over ``less``."""
    return sum(held_out_scores(full)) - sum(held_out_scores(less))


def held_out_scores(fitted: Fitted) -> list[float]:
    """Log-likelihood of each fourth of the trials under the fit to the others."""
    records = fitted.likelihood.records
    scores = []
    for fold in _folds(len(records.runs)):
        outside = np.isin(records.trial, fold)
        x = _fitted_without(fitted, outside)
        pieces = Likelihood(records, fitted.likelihood.limit, fitted.effects, outside).pieces(x)
        scores.append(-float(np.sum(pieces)))
    return scores


def _fitted_without(fitted: Fitted, outside: np.ndarray) -> FloatArray:
    train = Likelihood(fitted.likelihood.records, fitted.likelihood.limit, fitted.effects, ~outside)
    return train.climb(fitted.x, iterations=_ITERATIONS)[0]


def _folds(count: int) -> list[list[int]]:
    """Every fourth trial: neighbours by name, which are of one kind, fall into different folds."""
    return [list(range(first, count, _FOLDS)) for first in range(min(_FOLDS, count))]


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.sqrt(np.mean(np.square(known)))) if known else None
