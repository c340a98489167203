"""How good a model is on trials that it was not fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.core.spmd import parallel_map
from rovid.diagnose.splitting import CvPiece
from rovid.estimate.dataset import FitData
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.multi_step_data import MultiStepData, prediction_errors
from rovid.estimate.restart_grid import HORIZONS
from rovid.model.model import Model
from rovid.model.simulation import HORIZONS as SECONDS
from rovid.model.simulation import fit_measures, simulate_runs
from rovid.signals.preprocessing import Run

_FOLDS = 4
_ITERATIONS = 8
_TOLERANCE = 0.2
# Log-likelihood by which an effect changes nothing, to rounding.
_NOTHING = 1e-6


@dataclass(frozen=True, kw_only=True)
class HeldOutScores:
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
    """A fourth of the pieces, the coordinates fitted to all others, and their log-likelihood there."""

    pieces: list[CvPiece]
    x: FloatArray
    log_likelihood: float


def cross_validate(fitted: FitResult, pieces: Sequence[CvPiece]) -> list[Fold]:
    """Fit the model of ``fitted`` anew without each fourth of the pieces, and predict those."""
    piece = _piece(fitted.data, pieces)
    left_out = _folds(len(pieces))
    tested = [np.isin(piece, numbers) for numbers in left_out]
    tests = [fitted.objective.with_effects(fitted.effects, test) for test in tested]
    # What begins in one piece and ends in another tells of both.
    taught = [fitted.objective.with_effects(fitted.effects, ~test & (piece >= 0)) for test in tested]
    # All trials together are a start so good that a few steps do.
    fits = parallel_map(lambda one: _told(fit(one, fitted.x, iterations=_ITERATIONS, tolerance=_TOLERANCE)), taught)
    costs = fitted.objective.held_out_values(tests, fits)
    folds = []
    for numbers, cost, x in zip(left_out, costs, fits, strict=True):
        own = [pieces[number] for number in numbers]
        folds.append(Fold(pieces=own, x=x, log_likelihood=-cost))
    return folds


def _told(fitted: FitResult) -> FloatArray:
    """Its coordinates, no effect where what was fitted tells nothing of one: else it would be known from the rest."""
    misfit, x = fitted.objective, fitted.x
    for effect, own in misfit.parametrization.effect_slices():
        without = x.copy()
        without[own] = [parameter.neutral for parameter in effect.parameters]
        if abs(misfit.value(without) - fitted.value) < _NOTHING:
            x = without
    return x


def _piece(records: FitData, pieces: Sequence[CvPiece]) -> IntArray:
    """(N,) index of the piece that each innovation lies in; -1 where it lies in more than one, or none."""
    numbers = []
    for run, (begin, end) in enumerate(records.innovation_spans):
        own = np.full(len(begin), -1)
        for index, piece in enumerate(pieces):
            if piece.run_index == run:
                own[(piece.begin <= begin) & (end <= piece.end)] = index
        numbers.append(own)
    return np.concatenate(numbers)


def held_out_log_likelihood(folds: Sequence[Fold]) -> float:
    """Of all trials, each by the model that was fitted to others."""
    return sum(fold.log_likelihood for fold in folds)


def simulate_folds(fitted: FitResult, folds: Sequence[Fold]) -> HeldOutScores:
    """Simulate every trial freely with the model that was fitted to others."""
    vehicle, models = fitted.data.vehicle, [fitted.objective.parametrization.model(fold.x) for fold in folds]
    assert vehicle is not None  # noqa: S101 - a diagnosis has one
    pairs = [(piece.run, model) for fold, model in zip(folds, models, strict=True) for piece in fold.pieces]

    def simulated(pair: tuple[Run, Model]) -> tuple[FloatArray, dict[float, float | None]]:
        run, model = pair
        (item,) = simulate_runs([run], model, vehicle)
        return item.simulated, item.position_errors

    rates, ahead = zip(*parallel_map(simulated, pairs), strict=True)
    fit = fit_measures(np.concatenate([run.rates.rate for run, _ in pairs]), np.concatenate(rates))
    errors = {horizon: _mean([of_one[horizon] for of_one in ahead]) for horizon in SECONDS}
    return HeldOutScores(
        log_likelihood=held_out_log_likelihood(folds),
        rate_r2=fit.r2,
        rate_rmse=fit.rmse,
        position_errors=errors,
    )


def horizon_errors(fitted: FitResult, folds: Sequence[Fold], pieces: Sequence[CvPiece]) -> FloatArray:
    """(q,) RMS error of the position over each of `HORIZONS`, each piece predicted from others; NaN where none."""
    records = MultiStepData.from_data(fitted.data, fitted.data.initial_model)
    piece = _piece(records, pieces)
    squares, count = np.zeros(len(HORIZONS)), np.zeros(len(HORIZONS))
    for fold in folds:
        model = fitted.objective.parametrization.model(fold.x)
        mine = np.isin(piece, [pieces.index(one) for one in fold.pieces])
        horizon = records.horizon[mine]
        errors = prediction_errors(records, model, records.torque_between_steps(model))[mine]
        squares += np.bincount(horizon, weights=errors**2, minlength=len(HORIZONS))
        count += np.bincount(horizon, minlength=len(HORIZONS))
    mean = np.where(count > 0, squares / np.maximum(count, 1), np.nan)
    return np.asarray(np.sqrt(mean))


def _folds(count: int) -> list[list[int]]:
    """Every fourth piece: neighbours by name, which are of one kind, fall into different folds."""
    return [list(range(first, count, _FOLDS)) for first in range(min(_FOLDS, count))]


def _mean(values: Sequence[float | None]) -> float | None:
    """Root mean square of what is known; None where nothing is."""
    known = [value for value in values if value is not None]
    if not known:
        return None
    return float(np.sqrt(np.mean(np.square(known))))
