"""Experiment design: expected information of candidate runs, the best run, and its command file."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.core.formatting import csv_line, significant
from rovid.core.threads import thread_map
from rovid.estimate.candidate_runs import CandidateRun, RunLimits, RunScales, candidate_runs, design_run
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fit_result import FitResult
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.estimate.maximum_likelihood import LikelihoodFit
from rovid.estimate.objective import UNLIMITED
from rovid.model.model import Model
from rovid.trial.preprocessing import prepare
from rovid.trial.trial import Campaign, Trial
from rovid.trial.vehicle import Vehicle

# Expected log-likelihood ratio in nats from which a run is decisive. The realised ratio, of twice the variance, then
# exceeds 6 with a probability of 0.89.
DECISIVE_LLR = 12.0
# Standard errors from nothing at which logs show a cause; the largest size that they leave open without.
_SHOWN = 3.0
# Largest logarithm of a ratio of variances whose exponential is taken.
_MAX_GAIN = 500.0
# Smallest standard deviation of the measurement noise, against division by zero.
_MIN_NOISE = 1e-6


@dataclass(frozen=True, eq=False)
class CandidateModel:
    """A fitted model with its uncertainty."""

    name: str
    model: Model
    covariance: FloatArray  # (p, p) of ``model.values``
    disturbance: float  # standard deviation in N m (N)
    memory: float  # correlation time of the disturbance in s
    noise: float  # standard deviation of the measurement
    integrated: bool = False  # the rate alone is measured
    is_assumed: bool = False  # the logs do not show its last effect, whose size is assumed
    lasting: FloatArray | float = 0.0  # (p, p) part of the covariance that no further run reduces

    @classmethod
    def from_fit(cls, name: str, fitted: FitResult, covariance: FloatArray) -> Self:
        """Model of a fit with the (p, p) ``covariance`` of its parameters."""
        noise = fitted.objective.position_noise(fitted.x)
        return cls(name, fitted.model, covariance, *fitted.disturbance, noise, fitted.data.rate_only)

    def coordinates(self, objective: InnovationLikelihood) -> FloatArray:
        """(p,) coordinates of the model, its disturbance and its noise."""
        noise = max(self.noise, _MIN_NOISE)
        return objective.parametrization.coordinates_of(self.model, self.disturbance + 1e-300, self.memory, noise)


def candidate_model(fit: LikelihoodFit, name: str) -> CandidateModel:
    """Model of a maximum-likelihood fit with its uncertainty."""
    noises = fit.disturbance, fit.correlation_time, fit.position_noise
    # A torque that the logs do not show may be excluded by further ones, and one that they show stays.
    lasting = fit.lasting if fit.estimate.lacks_torque else 0.0
    return CandidateModel(name, fit.model, fit.estimate.covariance, *noises, fit.rate_only, lasting=lasting)


def with_visible_size(candidate: CandidateModel) -> CandidateModel:
    """The model with its last effect at the largest size that its fit leaves open, if the fit shows none.

    Two causes that are fitted as nothing predict the same: no run would distinguish them.
    """
    model, effect = candidate.model, candidate.model.effects[-1]
    at, parameter = len(model.values) - len(effect.parameters), effect.parameters[0]
    value, error = float(model.values[at]), math.sqrt(max(candidate.covariance[at, at], 0.0))
    inverse, factor = parameter.neutral_at_infinity, np.ones(len(model.values))
    size = 1.0 / value if inverse else value - parameter.neutral
    error = error / value**2 if inverse else error
    if not math.isfinite(error) or error == 0.0 or abs(size) >= _SHOWN * error:
        return candidate
    size = math.copysign(_SHOWN * error, size)
    own = [1.0 / size if inverse else parameter.neutral + size, *model.values[at + 1 :]]
    factor[at] = (own[0] / value) ** 2 if inverse else 1.0
    values = (*model.effect_values[: -len(own)], *map(float, own))
    covariance = candidate.covariance * np.outer(factor, factor)
    return replace(candidate, model=replace(model, effect_values=values), covariance=covariance, is_assumed=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class ExpectedInformation:
    """A run with its expected information."""

    run: CandidateRun
    # Log-likelihood ratio (nats) in favour of the true model, or logarithm of the ratio of a parameter's variances.
    gain: float
    rates: FloatArray  # (m, n) predicted rate of each model at the instants of the run

    @property
    def gain_per_minute(self) -> float:
        """Gain for each minute of the run."""
        return 60.0 * self.gain / self.run.seconds

    @property
    def information_per_minute(self) -> float:
        """The same; of a parameter the information over that before the run, which adds up over runs."""
        information = math.expm1(min(self.gain, _MAX_GAIN)) if len(self.rates) == 1 else self.gain
        return 60.0 * information / self.run.seconds


@dataclass(frozen=True, kw_only=True, eq=False)
class ExperimentPlan:
    """Candidate runs, the best first."""

    #: ``models``, ``parameter``: the two models to distinguish, or the one model with the ``parameter`` to improve; no
    #: model for the planar one.
    models: tuple[CandidateModel, ...]
    parameter: str
    runs: tuple[ExpectedInformation, ...]
    thrusters: tuple[str, ...]
    disturbance_rate: float  #: Rate in rad/s or m/s that the disturbance drives: smaller differences are not visible.
    reason: str = ""  #: Why these causes, or this parameter.

    @property
    def best(self) -> ExpectedInformation:
        """The run to make next."""
        return self.runs[0]

    @property
    def is_decisive(self) -> bool:
        """Whether the best run is expected to distinguish the models; always true for a parameter."""
        return len(self.models) < 2 or self.best.gain >= DECISIVE_LLR


def plan_experiment(
    models: Sequence[CandidateModel], vehicle: Vehicle, trials: Sequence[Trial], limits: RunLimits, parameter: str = ""
) -> ExperimentPlan:
    """Rank candidate runs that distinguish two models, or that improve the ``parameter`` of one model.

    With ``limits.design``, a run with optimised levels and switching times, as long as the best run, is one of them.
    Raises DataError if there are no thrusters, they push one way only, or no run stays within the limits.
    """
    require_thrusters(vehicle)
    names = tuple(thruster.name for thruster in vehicle.thrusters)
    scales = RunScales.from_trials(models[0].model, vehicle, trials, limits.share)
    recorded = sum(trial.duration for trial in trials)
    if not scales.constant <= recorded:
        raise DataError(
            f"the fitted time constant of {scales.constant:.2g} s is longer than all logs together ({recorded:.0f} s): "
            "these data do not determine the drag or the inertia, and no run can be planned with them.",
            mend="Run `rovid check`, and record sines, steps and holds.",
        )
    # Rounding to the clock of the commands adds less than an interval.
    drawn = candidate_runs(scales, names, limits.seconds + scales.period)
    reference = trials[0].reference
    runs = [replace(run, reference=reference) for run in drawn]
    if len(models) > 1:
        reason = f"it gives the most evidence a minute between {models[0].name} and {models[1].name}"
    else:
        errors, most = relative_errors(models[0]), "" if parameter else ", the largest of all"
        parameter = parameter or max(errors, key=errors.__getitem__)
        reason = (
            f"the standard error of {parameter} is {significant(100.0 * errors[parameter], 2)} % of its value{most}"
        )
    ranked = rank_runs(runs, models, vehicle, limits, parameter=parameter)

    def worth(run: CandidateRun) -> float:
        found = _expected_information(replace(run, reference=reference), models, vehicle, limits, parameter)
        return -1.0 if found is None else found.information_per_minute

    if limits.design:
        designed = replace(design_run(worth, scales, ranked[0].run.seconds), reference=reference)
        ranked = rank_runs([designed, *runs], models, vehicle, limits, parameter=parameter)
    rate = float(np.sqrt(np.mean(ranked[0].rates ** 2)))
    return ExperimentPlan(
        models=tuple(models),
        parameter=parameter,
        runs=tuple(ranked),
        thrusters=names,
        disturbance_rate=models[0].disturbance * models[0].model.rate_std_per_torque(rate, models[0].memory),
        reason=reason,
    )


def require_thrusters(vehicle: Vehicle) -> None:
    """Refuse to plan commands without thrusters or for a rudder. Raises DataError without, ConfigError for a rudder."""
    vehicle.require_no_rudder("a run of commands")
    if not vehicle.thrusters:
        text = f"nothing drives the vehicle in {vehicle.axis.name}: there are no commands to plan."
        raise DataError(text, mend="Release it from a large and from a small tilt, at rest and at speed.")


def relative_errors(candidate: CandidateModel) -> dict[str, float]:
    """Parameter -> its standard error as a share of its value; 0 for a parameter of value 0."""
    values = np.abs(candidate.model.values)
    errors = np.sqrt(np.maximum(np.diag(candidate.covariance), 0.0))
    relative = np.where(values != 0.0, errors / np.maximum(values, 1e-300), 0.0)
    return dict(zip(candidate.model.names, relative.tolist(), strict=True))


def rank_runs(
    runs: Sequence[CandidateRun],
    models: Sequence[CandidateModel],
    vehicle: Vehicle,
    limits: RunLimits,
    *,
    parameter: str = "",
) -> list[ExpectedInformation]:
    """Expected information of the runs within ``limits``, the best first.

    Of two models, decisive runs come first, by gain per minute, and then the others by gain. For a ``parameter``, the
    order is by gain per minute. Raises DataError if no run stays within the limits.
    """
    every = thread_map(lambda run: _expected_information(run, models, vehicle, limits, parameter), runs)
    within = [one for one in every if one is not None]
    if not within:
        raise DataError("no run stays within these limits.", mend="Allow a longer run, more turns or a higher rate.")
    if len(models) == 1:
        return sorted(within, key=lambda one: -one.gain_per_minute)
    return sorted(within, key=lambda one: (-min(one.gain, DECISIVE_LLR) / DECISIVE_LLR, -one.gain_per_minute))


def _expected_information(
    run: CandidateRun, models: Sequence[CandidateModel], vehicle: Vehicle, limits: RunLimits, parameter: str
) -> ExpectedInformation | None:
    """Expected information of ``run``; None where the run exceeds the limits."""
    if run.seconds > limits.seconds:
        return None
    trials = [noise_free(run.trial(vehicle.axis), candidate, vehicle) for candidate in models]
    turn = 2.0 * math.pi if vehicle.axis.angular else 1.0
    for trial in trials:
        travel = np.ptp(trial.position) / turn
        if trial.rate is None or np.max(np.abs(trial.rate)) > limits.rate or travel > limits.travel:
            return None
    rates = np.array([trial.rate for trial in trials])
    if len(models) == 1:
        _, jacobian = _innovations(trials[0], models[0], vehicle)
        at, before = models[0].model.names.index(parameter), models[0].covariance
        # The run reduces the error by noise and disturbance, and not that by what the model lacks.
        prior, scale = _prior_information(before - models[0].lasting)
        narrowed = np.linalg.pinv(prior + (jacobian * scale).T @ (jacobian * scale), rcond=1e-12)[at, at]
        reducible = scale[at] ** 2 / before[at, at]
        gain = -math.log(max(narrowed * reducible + 1.0 - reducible, 1e-300))
    else:
        first, second = models
        # Either model may be true: the smaller gain counts.
        gain = min(_log_likelihood_ratio(trials[0], second, vehicle), _log_likelihood_ratio(trials[1], first, vehicle))
    return ExpectedInformation(run=run, gain=gain, rates=rates)


def noise_free(trial: Trial, candidate: CandidateModel, vehicle: Vehicle) -> Trial:
    """The trial as simulated by a model, without noise or disturbance, where it has readings."""
    rate, position = candidate.model.simulate(trial, candidate.model.torque_input(vehicle, trial))
    position = np.where(trial.measured, position, np.nan)
    return replace(trial, rate=rate, position=position, rate_only=candidate.integrated, readings={})


def fit_objective(
    trials: Sequence[Trial], candidate: CandidateModel, vehicle: Vehicle, interval: float = 0.0
) -> InnovationLikelihood:
    """The innovation likelihood of simulated ``trials``, with the effects of a model; readings ``interval`` s apart."""
    measured = [trial if candidate.integrated else replace(trial, rate=None) for trial in trials]
    # The lowest cut-off for runs of any length: the filter does not affect innovations.
    cutoff = 0.1 / max(trial.sampling_interval for trial in trials)
    runs = prepare(Campaign(trials=tuple(measured), sources=()), vehicle, cutoff=cutoff).items
    bare = replace(candidate.model, effects=(), effect_values=())
    return InnovationLikelihood(
        InnovationData(runs, vehicle, bare, interval=interval), UNLIMITED, candidate.model.effects
    )


def _innovations(trial: Trial, candidate: CandidateModel, vehicle: Vehicle) -> tuple[FloatArray, FloatArray]:
    """(N,) normalised innovations of a trial under a model, and their (N, p) Jacobian in the model's own units."""
    objective = fit_objective([trial], candidate, vehicle)
    x = candidate.coordinates(objective)
    pieces = list(objective.jacobian(x))
    # The first half of the rows are innovations, the second half belongs to their variances.
    residual = np.concatenate([np.split(piece.residual, 2)[0] for piece in pieces])
    matrix = np.concatenate([np.split(piece.matrix, 2)[0] for piece in pieces])
    shown, size = objective.parametrization.model_jacobian(x)
    return residual, matrix[:, shown] / size


def _log_likelihood_ratio(trial: Trial, wrong: CandidateModel, vehicle: Vehicle) -> float:
    """Log-likelihood that the ``wrong`` model loses after its parameters have adapted within their covariance."""
    residual, jacobian = _innovations(trial, wrong, vehicle)
    prior, scale = _prior_information(wrong.covariance)
    jacobian = jacobian * scale
    gradient = jacobian.T @ residual
    step, *_ = np.linalg.lstsq(jacobian.T @ jacobian + prior, gradient, rcond=1e-12)
    return max(0.5 * float(residual @ residual - gradient @ step), 0.0)


def _prior_information(covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(p, p) inverse of the correlation matrix, and (p,) standard deviations that scale its parameters."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    correlations = covariance / np.outer(scale, scale)
    return np.asarray(np.linalg.pinv(correlations, rcond=1e-10)), scale


def command_changes(information: ExpectedInformation) -> tuple[list[float], list[list[float]]]:
    """Instants in s at which a command changes, and the commands from then on; the last ones are those of rest."""
    commands = information.run.commands.copy()
    commands[-1] = commands[0]  # each run begins at rest
    changes = np.flatnonzero(np.any(np.diff(commands, axis=0) != 0.0, axis=1)) + 1
    rows = np.unique(np.concatenate(([0], changes, [len(commands) - 1])))
    return [round(float(instant), 4) for instant in information.run.time[rows]], np.round(commands[rows], 5).tolist()


def commands_by_name(plan: ExperimentPlan) -> dict[str, list[float]]:
    """Times and commands of each thruster in the best run."""
    times, rows = command_changes(plan.best)
    columns = {"time_s": times}
    for place, name in enumerate(plan.thrusters):
        columns[name] = [row[place] for row in rows]
    return columns


def command_csv(plan: ExperimentPlan) -> str:
    """The best run as CSV: time_s and a column for each actuator; each row holds until the next.

    The quotes about time_s mark a file written by rovid.
    """
    times, rows = command_changes(plan.best)
    lines = [f'"time_s",{csv_line(plan.thrusters)}']
    for time, row in zip(times, rows, strict=True):
        lines.append(",".join(f"{value:g}" for value in (time, *row)))
    return "\n".join(lines) + "\n"
