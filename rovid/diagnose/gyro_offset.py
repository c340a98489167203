"""Rival of causes where only a rate was measured: the offset of the gyro.

A gyro whose readings are off by a constant shows a turn that no torque causes. A measured heading tells the offset.
Otherwise a constant torque, or drag that differs between the two senses, may stand for it. The offset is
fitted in place of such causes. If it is as likely, they are not established.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rovid.core.budget import Budget, ProgressCallback
from rovid.core.errors import DataError
from rovid.diagnose.result import Diagnosis, doubted
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects.base import Effect
from rovid.estimate.maximum_likelihood import fit_likelihood
from rovid.trial.preprocessing import PreparedRuns, prepare
from rovid.trial.trial import Campaign, Trial
from rovid.trial.vehicle import Vehicle

# Effects with a mean turn of their own.
_IMITATED = ("bias_torque", "drag_asymmetry")
# Largest offset and its resolution, relative to the RMS rate of the logs. Convention: a larger offset is a fault that
# every plot shows, and a finer one is below the errors of the drags.
_LARGEST, _FINEST = 0.5, 0.002


def without_gyro_offset(
    prepared: PreparedRuns, diagnosis: Diagnosis, vehicle: Vehicle, report: ProgressCallback, budget: Budget
) -> Diagnosis:
    """The ``diagnosis``, in which no cause is established that an offset of the gyro explains as well."""
    imitated = [cause for cause in diagnosis.causes if cause.effect.id in _IMITATED]
    causes = [cause for cause in imitated if cause in diagnosis.findings] or imitated[:1]
    if not causes or not prepared.rate_only or budget.skips("offset of the gyro"):
        return diagnosis
    report("Testing an offset of the gyro …")
    others = tuple(finding.effect for finding in diagnosis.findings if finding not in causes)
    trials = [run.trial for run in prepared.items]
    try:
        best = fit_likelihood(prepared.items, vehicle, (*others, *(cause.effect for cause in causes))).log_likelihood
        offset, likelihood = _fitted_offset(trials, prepared.cutoff, vehicle, others)
    except DataError:
        # Without the causes the logs determine nothing: the offset does not replace them.
        return diagnosis
    if likelihood < best - THRESHOLDS.tie_margin:
        return diagnosis
    for cause in causes:
        diagnosis = doubted(diagnosis, cause)
    unit, factor = trials[0].axis.display_unit
    titles = " and ".join(cause.effect.title for cause in causes)
    text = (
        f"Only a rate was measured. A sensor that is off by {factor * offset:.2g} {unit}/s explains these logs as well "
        f"as {titles}. Measure the {trials[0].axis.position_words}, or the rate of the vehicle ashore, to tell which."
    )
    return replace(diagnosis, warnings=(text, *diagnosis.warnings))


def _fitted_offset(
    trials: Sequence[Trial], cutoff: float, vehicle: Vehicle, effects: tuple[Effect, ...]
) -> tuple[float, float]:
    """The likeliest offset of the gyro in rad/s, and its log-likelihood with these ``effects``."""
    from scipy.optimize import minimize_scalar

    def likelihood(offset: float) -> float:
        corrected = tuple(_corrected(trial, offset) for trial in trials)
        runs = prepare(Campaign(trials=corrected, sources=()), vehicle, cutoff=cutoff)
        return fit_likelihood(runs.items, vehicle, effects).log_likelihood

    rates = np.concatenate([trial.rate for trial in trials if trial.rate is not None])
    size = float(np.sqrt(np.nanmean(rates**2)))
    bounds = (-_LARGEST * size, _LARGEST * size)
    found = minimize_scalar(
        lambda offset: -likelihood(offset), bounds=bounds, method="bounded", options={"xatol": _FINEST * size}
    )
    return float(found.x), -float(found.fun)


def _corrected(trial: Trial, offset: float) -> Trial:
    position = trial.position - offset * (trial.time - trial.time[0])
    return replace(trial, rate=None if trial.rate is None else trial.rate - offset, position=position)
