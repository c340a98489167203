"""Maximum likelihood: all parameters from all trials at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.core.formatting import significant
from rovid.effects import Effect
from rovid.estimate.dataset import FitData
from rovid.estimate.estimate import PER_INERTIA, Estimate
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.estimate.instrumental_variables import require_inertia
from rovid.estimate.misspecification import COARSE_ITERATIONS, misspecification_covariance
from rovid.estimate.multi_step_data import MultiStepData
from rovid.estimate.multi_step_likelihood import MultiStepLikelihood
from rovid.estimate.output_error import MIN_INERTIA_SIGMAS, fit_output_error, free_run_r2
from rovid.model.model import Model
from rovid.signals.preprocessing import Run
from rovid.trial.vehicle import Vehicle

# Upper limits of the disturbance, as shares of the torque in use. Without a limit the disturbance explains whatever
# the model does not, and the parameters go where they like.
DISTURBANCE_LIMITS = (0.05, 0.02, 0.01, 0.005)
# Where the free-running simulation of the plain model is worse than this, the model misses so much that no limit of
# the disturbance is right: the simulation itself is then what is fitted.
INNOVATIONS_R2 = 0.93
# The free-running simulation may lose this much R^2 against the fit that looks at nothing else.
_R2_LOSS = 0.01
# Where the disturbance is at its limit, the fit is tried again with this many times as much.
_LOOSER = 2.5
_TRIALS = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class LikelihoodFit:
    """Maximum-likelihood estimate and what it says of the disturbance.

    Attributes
    ----------
    log_likelihood
        Of the innovations of all trials.
    disturbance, correlation_time
        Standard deviation of the disturbance torque in N m and its memory in s.
    position_noise
        Standard deviation of the white noise of what is measured.
    integrated
        Whether that is the rate alone.
    limit
        Share of the torque in use that the disturbance was allowed.
    at_limit
        Whether it would take more.
    white
        Whether the normalised innovations are white (Ljung-Box) and free of heavy tails.
    free_run_r2, simulation_r2
        R^2 of the free-running rate with this model, and with the fit that looks at nothing else.
    """

    estimate: Estimate
    model: Model
    log_likelihood: float
    disturbance: float
    correlation_time: float
    position_noise: float
    rate_only: bool
    limit: float
    at_limit: bool
    white: bool
    free_run_r2: float
    simulation_r2: float


def fit_likelihood(
    runs: Sequence[Run], vehicle: Vehicle | None = None, effects: tuple[Effect, ...] = (), *, gyro: bool = False
) -> LikelihoodFit:
    """Estimate inertia, drag, effects, disturbance and measurement noise together by the prediction-error method.

    The likelihood of the innovations of an extended Kalman filter (Ljung 1999, section 7.4; Schweppe 1965) with a
    first-order Gauss-Markov disturbance torque is right under feedback, with gaps and at any sampling. It starts
    from the free-running fit. The disturbance is limited; the limit is tightened until the free-running simulation
    is as good as that of the fit that looks at nothing else. Effects are put in after that, from each of their starts,
    and the limit is loosened as far as the simulation with them bears.

    Parameters
    ----------
    vehicle
        Needed by effects that act between command and torque.
    gyro
        Whether logged rates are looked at too. They should come of an instrument of their own: a heading out of
        the same filter is not independent of them.

    Raises
    ------
    DataError
        The vehicle was not excited enough, or no rate is logged.
    """
    axis = runs[0].trial.axis
    if gyro and all(run.trial.rate is None for run in runs):
        raise DataError(
            f"no {axis.rate_words} is logged.",
            where="--gyro",
            mend=f"Map {axis.rate_signal} in [signals] of rovid.toml, or leave it out.",
        )
    start = fit_output_error(runs, min_sigmas=0.0 if effects else MIN_INERTIA_SIGMAS)
    records = InnovationData(runs, vehicle, start, gyro=gyro)
    simulation_r2 = free_run_r2(runs, records.initial_model)
    fitted = fit_innovations(records, simulation_r2) if simulation_r2 >= INNOVATIONS_R2 else fit_multi_step(records)
    if effects:
        fitted = add_effects(fitted, effects)
    return _result(fitted, simulation_r2)


def fit_innovations(records: InnovationData, simulation_r2: float) -> FitResult:
    """Without effects, under the first limit of the disturbance whose free-running R^2 is near ``simulation_r2``.

    Where there is none, under that whose R^2 is best.
    """
    tried = []
    for limit in DISTURBANCE_LIMITS:
        misfit = InnovationLikelihood(records, limit)
        fitted = fit(misfit, misfit.parametrization.initial())
        tried.append(fitted)
        if fitted.simulated_r2 >= simulation_r2 - _R2_LOSS:
            break
    return max(tried, key=lambda one: one.simulated_r2)


def fit_multi_step(records: FitData) -> FitResult:
    """Without effects, by predictions some time ahead."""
    misfit = MultiStepLikelihood(MultiStepData.from_data(records, records.initial_model))
    return fit(misfit, misfit.parametrization.initial())


def add_effects(bare: FitResult, effects: tuple[Effect, ...]) -> FitResult:
    """Continue from the fit without effects: the likeliest of all starts, its disturbance then limited anew."""
    misfit, better = bare.objective, [bare.common_coordinates]
    for count in range(1, len(effects) + 1):
        misfit = bare.objective.with_effects(effects[:count], bare.objective.mask)
        begins = [
            np.concatenate((begin, start)) for begin in better for start in misfit.parametrization.initial_values()
        ]
        better = misfit.most_likely(begins, _TRIALS)
    # A few steps tell which of the better starts leads lowest.
    tried = [fit(misfit, begin, iterations=COARSE_ITERATIONS) for begin in better]
    nearest = min(tried, key=lambda one: one.value)
    best = fit(misfit, nearest.x)
    # What the effects explain made errors correlate: now more of them may count.
    recounted = misfit.reweighted(best.model)
    if recounted is not misfit:
        best = fit(recounted, best.x)
    return loosen_limit(best)


def loosen_limit(fitted: FitResult) -> FitResult:
    """``fitted`` anew under the widest limit at which the free-running simulation stays as good."""
    wider = [limit for limit in DISTURBANCE_LIMITS if limit > fitted.objective.limit]
    for limit in wider:
        loose = fit(fitted.objective.with_limit(limit), fitted.x)
        if loose.simulated_r2 >= fitted.simulated_r2 - _R2_LOSS:
            return loose
    return fitted


def _result(best: FitResult, simulation_r2: float) -> LikelihoodFit:
    fitted = best.canonical()
    model, records = fitted.model, fitted.data
    doubt, said = misspecification_covariance(fitted)
    covariance = fitted.covariance(sandwich=not fitted.is_white)
    if fitted.at_limit:
        covariance = covariance + _by_limit(fitted)
    estimate = Estimate(
        names=model.names,
        axis=model.axis,
        values=model.values,
        covariance=covariance,
        method=fitted.objective.method,
        samples=sum(int(run.trial.measured.sum()) for run in records.runs),
        warnings=(*_warnings(fitted), *said),
    )
    if not records.has_actuators:
        estimate = estimate.undriven()
    require_inertia(estimate, MIN_INERTIA_SIGMAS)
    # The vehicle was excited; how far another form would move the answer is another matter.
    estimate = replace(estimate, covariance=estimate.covariance + doubt)
    estimate = estimate.with_thrust_scale_uncertainty(fitted.thrust_scale_uncertainty)
    disturbance, memory = fitted.disturbance
    return LikelihoodFit(
        estimate=estimate,
        model=model,
        log_likelihood=-fitted.value,
        disturbance=disturbance,
        correlation_time=memory,
        position_noise=fitted.objective.position_noise(fitted.x),
        rate_only=records.rate_only,
        limit=fitted.objective.limit,
        at_limit=fitted.at_limit,
        white=fitted.is_white,
        free_run_r2=best.simulated_r2,
        simulation_r2=simulation_r2,
    )


def _by_limit(fitted: FitResult) -> FloatArray:
    """(p, p) what the limit of the disturbance adds, which is a choice: what a looser one would change."""
    looser = fit(fitted.objective.with_limit(_LOOSER * fitted.objective.limit), fitted.x)
    shift = looser.model.values - fitted.model.values
    return np.outer(shift, shift)


def _warnings(fitted: FitResult) -> list[str]:
    texts = []
    if fitted.at_limit:
        texts.append(_at_limit(fitted))
    texts += fitted.objective.caveats
    if not fitted.is_white:
        texts.append(
            "The innovations are not white: the standard errors come from the scatter between stretches of the "
            "logs, not from the curvature of the likelihood."
        )
    drags = ("quadratic_drag", "linear_drag")
    texts += [f"{name} is held at zero, its lower bound." for name in drags if getattr(fitted.model, name) == 0.0]
    return texts


def _at_limit(fitted: FitResult) -> str:
    """What is said where the disturbance would be larger than it may be."""
    axis, limit = fitted.data.axis, fitted.objective.limit
    per_inertia = "" if fitted.data.has_actuators else PER_INERTIA
    most = f"{significant(limit * fitted.data.rms_torque, 3)} {axis.force_unit}{per_inertia}"
    return (
        f"The disturbance {axis.force_name} would exceed {100 * limit:.2g} % of the {axis.force_name} in use "
        f"({most}): the model misses something that these data show. The standard errors include what "
        f"a limit {_LOOSER:g} times as high would change."
    )
