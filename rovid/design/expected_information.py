"""What a run to come would tell: how much likelier the right one of two models, how much surer a parameter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.core.threads import thread_map
from rovid.design.candidate_runs import CandidateRun, RunLimits
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fit_result import FitResult
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.estimate.objective import UNLIMITED
from rovid.model.model import Model
from rovid.signals.preprocessing import prepare
from rovid.trial.trial import Campaign, Trial
from rovid.trial.vehicle import Vehicle

# Log-likelihood that decides, as in the diagnosis.
DECISIVE_LLR = 12.0
_ROOM = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class CandidateModel:
    """A fitted model and how sure it is.

    Attributes
    ----------
    covariance
        (p, p) of ``model.values``.
    disturbance, memory
        N m (N), and s.
    noise
        Standard deviation of what is measured.
    integrated
        Whether that is the rate alone.
    """

    name: str
    model: Model
    covariance: FloatArray
    disturbance: float
    memory: float
    noise: float
    integrated: bool = False

    def driven_rate(self, rate: float) -> float:
        """Standard deviation of the rate that the disturbance drives, where the vehicle moves at ``rate``."""
        return self.disturbance * self.model.rate_std_per_torque(rate, self.memory)

    @classmethod
    def from_fit(cls, name: str, fitted: FitResult, covariance: FloatArray) -> CandidateModel:
        """Of a fitted model with the (p, p) ``covariance`` of its parameters."""
        disturbance, memory = fitted.disturbance
        return cls(
            name=name,
            model=fitted.model,
            covariance=covariance,
            disturbance=disturbance,
            memory=memory,
            noise=fitted.objective.position_noise(fitted.x),
            integrated=fitted.data.rate_only,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class ExpectedInformation:
    """A run with what it is expected to tell, and the rates that each model predicts in it.

    Attributes
    ----------
    gain
        Of log-likelihood by which the right model would win, or the logarithm of the ratio of a parameter's variances.
    rates
        (m, n) predicted rate of each belief at the instants of the run.
    """

    run: CandidateRun
    gain: float
    rates: FloatArray

    @property
    def gain_per_minute(self) -> float:
        """Gain for each minute in the water."""
        return 60.0 * self.gain / self.run.seconds


def rank_runs(
    runs: Sequence[CandidateRun],
    beliefs: Sequence[CandidateModel],
    vehicle: Vehicle,
    limits: RunLimits,
    *,
    narrow: str = "",
) -> list[ExpectedInformation]:
    """``runs`` within ``limits``, the best for its time first.

    Parameters
    ----------
    beliefs
        Two rivals, or the one model of which the parameter ``narrow`` is to be surer.

    Raises
    ------
    DataError
        No run stays within the limits.
    """
    tried = thread_map(lambda run: _worth(run, beliefs, vehicle, limits, narrow), runs)
    within = [worth for worth in tried if worth is not None]
    if not within:
        raise DataError("no run stays within these limits.", mend="Allow a longer run, more turns or a higher rate.")
    return _best_first(within, rivals=len(beliefs) > 1)


def _best_first(worths: Sequence[ExpectedInformation], *, rivals: bool) -> list[ExpectedInformation]:
    """Of the runs that decide the one that does so fastest; where none does, the one that tells most."""
    if rivals:
        return sorted(worths, key=lambda one: (-min(one.gain, DECISIVE_LLR) / DECISIVE_LLR, -one.gain_per_minute))
    return sorted(worths, key=lambda one: -one.gain_per_minute)


def _worth(
    run: CandidateRun, beliefs: Sequence[CandidateModel], vehicle: Vehicle, limits: RunLimits, narrow: str
) -> ExpectedInformation | None:
    """What ``run`` is worth; None where it leaves the limits."""
    if run.seconds > limits.seconds:
        return None
    trials = [_imagined(run, belief, vehicle) for belief in beliefs]
    turn = 2.0 * math.pi if vehicle.axis.angular else 1.0
    for trial in trials:
        travel = np.ptp(trial.position) / turn
        if trial.rate is None or np.max(np.abs(trial.rate)) > limits.rate or travel > limits.travel:
            return None
    rates = np.array([trial.rate for trial in trials])
    if len(beliefs) == 1:
        gain = _narrowed(trials[0], beliefs[0], vehicle, narrow)
    else:
        first, second = beliefs
        # Whichever is right: the run has to tell either.
        gain = min(_told(trials[0], second, vehicle), _told(trials[1], first, vehicle))
    return ExpectedInformation(run=run, gain=gain, rates=rates)


def _imagined(run: CandidateRun, belief: CandidateModel, vehicle: Vehicle) -> Trial:
    """The run as the vehicle of ``belief`` would answer it, without noise or disturbance."""
    still = Trial.from_commands(run.time, run.commands, name=run.name, reference=run.reference)
    trial = replace(still, axis=vehicle.axis)
    rate, position = belief.model.simulate(trial, belief.model.torque_input(vehicle, trial))
    return replace(trial, rate=rate, position=position, rate_only=belief.integrated)


def _slopes(trial: Trial, belief: CandidateModel, vehicle: Vehicle) -> tuple[FloatArray, FloatArray]:
    """(N,) normalised innovations of the imagined trial under ``belief``, and their (N, p) slopes.

    By the model's own parameters, in their units.
    """
    seen = trial if belief.integrated else replace(trial, rate=None)
    # The lowest cut-off that any run of some length takes: the filter has no say here.
    runs = prepare(Campaign(trials=(seen,), sources=()), vehicle, cutoff=0.1 / trial.sampling_interval).items
    model = belief.model
    bare = replace(model, effects=(), effect_values=())
    misfit = InnovationLikelihood(InnovationData(runs, vehicle, bare), UNLIMITED, model.effects)
    noise = max(belief.noise, _ROOM)
    x = misfit.parametrization.coordinates_of(model, belief.disturbance + 1e-300, belief.memory, noise)
    residual, matrix = list[FloatArray](), list[FloatArray]()
    for piece in misfit.jacobian(x):
        count = len(piece.residual) // 2
        residual.append(piece.residual[:count])
        matrix.append(piece.matrix[:count])
    shown, size = misfit.parametrization.model_jacobian(x)
    return np.concatenate(residual), np.concatenate(matrix)[:, shown] / size


def _told(trial: Trial, wrong: CandidateModel, vehicle: Vehicle) -> float:
    """Log-likelihood that ``wrong`` loses, though its parameters give way within what is known of them."""
    residual, slopes = _slopes(trial, wrong, vehicle)
    known, scale = _information(wrong.covariance)
    slopes = slopes * scale
    pull = slopes.T @ residual
    give, *_ = np.linalg.lstsq(slopes.T @ slopes + known, pull, rcond=1e-12)
    lost = 0.5 * float(residual @ residual - pull @ give)
    return max(lost, 0.0)


def _information(covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(p, p) inverse of the correlations, and the (p,) standard deviations by which its unknowns are divided."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    correlations = covariance / np.outer(scale, scale)
    return np.asarray(np.linalg.pinv(correlations, rcond=1e-10)), scale


def _narrowed(trial: Trial, belief: CandidateModel, vehicle: Vehicle, name: str) -> float:
    """Logarithm of the parameter's variance before the run over that after it."""
    _, slopes = _slopes(trial, belief, vehicle)
    at = belief.model.names.index(name)
    known, scale = _information(belief.covariance)
    # In units of the standard deviations of before: the variance before the run is one.
    after = np.linalg.pinv(known + (slopes * scale).T @ (slopes * scale), rcond=1e-12)
    return -math.log(max(after[at, at], 1e-300))
