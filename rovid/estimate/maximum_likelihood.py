"""Maximum likelihood of all parameters from all trials at once."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.core.formatting import significant
from rovid.effects import Effect
from rovid.estimate.estimate import PER_INERTIA, Estimate
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.estimate.missing_torque import include_missing_torque
from rovid.estimate.multi_step import MultiStepData, MultiStepLikelihood
from rovid.estimate.nested_fits import covariance_of_optima, exchanged_or_same, fit_with_effects
from rovid.estimate.output_error import MIN_INERTIA_SIGMAS, fit_output_error, require_inertia
from rovid.estimate.unknown_past import water_warning
from rovid.model.model import Model
from rovid.model.parameter_names import unit_of
from rovid.trial.preprocessing import Run
from rovid.trial.vehicle import Vehicle

# Upper limits of the disturbance, as shares of the torque in use. Without a limit the disturbance takes up whatever the
# model misses, and the parameters become arbitrary.
DISTURBANCE_LIMITS = (0.05, 0.02, 0.01, 0.005)
# Upper limit, likewise, of a disturbance that makes a model with effects adequate. Convention: 2.5 times the widest.
REAL_DISTURBANCE_LIMIT = 0.125
# Least free-running R^2 of the plain model for the innovation likelihood. Below it the model is so incomplete that no
# limit of the disturbance is right, and multi-step predictions are fitted instead.
INNOVATIONS_R2 = 0.93
# Free-running R^2 of the plain model below which it explains next to nothing, under whatever limit of the disturbance.
NOTHING_R2 = 0.1
# Largest loss of free-running R^2 against the output-error fit, or against a tighter limit of the disturbance.
MAX_R2_LOSS = 0.01
# Factor on the limit of an active disturbance, for the effect of the limit on the parameters.
_LOOSER = 2.5
# Least free-running R^2 of free swings. Below it most of the motion is no swing of the model, and period and damping
# have no meaning; decision: half of the variance.
_SWING_R2 = 0.5
# Steps of the fits of short and of long horizons alone, from the fit of both.
_HORIZON_ITERATIONS = 8
# Joint standard errors between the answers of short and of long horizons that are reported.
_DISAGREE_SIGMAS = 3.0
# Share of the difference between the two answers by which either may be wrong.
_HALF = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class LikelihoodFit:
    """Maximum-likelihood estimate, with its disturbance and noise."""

    estimate: Estimate
    #: (p, p) part of the covariance that is not by noise and disturbance: what the model may lack, other optima, and
    #: the scale of the thrust.
    lasting: FloatArray
    model: Model
    log_likelihood: float  #: Of the innovations of all trials.
    #: ``disturbance``, ``correlation_time``: standard deviation of the disturbance torque in N m and its correlation
    #: time in s.
    disturbance: float
    correlation_time: float
    position_noise: float  #: Standard deviation of the white measurement noise.
    rate_only: bool  #: Whether only the rate was measured.
    limit: float  #: Upper limit of the disturbance as a share of the torque in use.
    at_limit: bool  #: Whether the likelihood grows with the disturbance at its limit.
    white: bool  #: Whether the normalised innovations are white (Ljung-Box) and without heavy tails.
    #: R^2 of the free-running rate with this model, and with the output-error fit of the plain model.
    free_run_r2: float
    simulation_r2: float


def fit_likelihood(
    runs: Sequence[Run],
    vehicle: Vehicle | None = None,
    effects: tuple[Effect, ...] = (),
    *,
    gyro: bool = False,
    by_predictions: bool = False,
) -> LikelihoodFit:
    """Estimate inertia, drag, effects, disturbance and measurement noise together by the prediction-error method.

    The likelihood of the innovations of an extended Kalman filter (Schweppe 1965; Ljung 1999, section 7.4) with a
    first-order Gauss-Markov disturbance torque is consistent under feedback, with gaps and at any sampling. The fit
    starts from the output-error fit. The limit of the disturbance is tightened until the free-running simulation is as
    good as that of the output-error fit. Then the effects are added, from each of their initial values, and the limit
    is loosened as far as the simulation stays as good.

    Effects between command and torque need the ``vehicle``. With ``gyro``, logged rates are used too. They should come
    from an instrument of their own: the errors of a rate and a heading from the same filter are correlated.
    ``by_predictions``: fit multi-step predictions, as where the innovations are far from white.

    Raises DataError if the vehicle was not excited enough, or no rate is logged.
    """
    axis = runs[0].trial.axis
    if gyro and all(run.trial.rate is None for run in runs):
        text = f"no {axis.rate_words} is logged."
        mend = f"Map {axis.rate_signal} in [signals] of rovid.toml, or leave it out."
        raise DataError(text, where="--gyro", mend=mend)
    start = fit_output_error(runs, min_sigmas=0.0 if effects else MIN_INERTIA_SIGMAS)
    data = InnovationData(runs, vehicle, start, gyro=gyro)
    simulation_r2 = data.free_run_r2(start)
    if not by_predictions and (simulation_r2 >= INNOVATIONS_R2 or effects):
        fitted = fit_innovations(data, simulation_r2)
        if effects:
            fitted = add_effects(fitted, effects)
        # A poor plain model says nothing about the model with the effects, and little about a noisy sensor.
        if max(simulation_r2, fitted.simulated_r2) >= INNOVATIONS_R2 or fitted.is_adequate:
            return _result(fitted, simulation_r2)
    objective = MultiStepLikelihood(MultiStepData.from_data(data, start))
    fitted = fit(objective, objective.parametrization.initial())
    return _result(add_effects(fitted, effects) if effects else fitted, simulation_r2)


def fit_innovations(data: InnovationData, simulation_r2: float) -> FitResult:
    """Fit without effects, under the widest limit of the disturbance with a free-running R^2 near ``simulation_r2``.

    If no limit gives that, the fit with the best free-running R^2.
    """
    tried = []
    for limit in DISTURBANCE_LIMITS:
        objective = InnovationLikelihood(data, limit)
        tried.append(fit(objective, objective.parametrization.initial()))
        if tried[-1].simulated_r2 >= simulation_r2 - MAX_R2_LOSS or simulation_r2 < NOTHING_R2:
            break
    return max(tried, key=lambda one: one.simulated_r2)


def add_effects(base: FitResult, effects: tuple[Effect, ...]) -> FitResult:
    """Fit with effects, no less likely than ``base``, then with the disturbance's limit loosened."""
    best = fit_with_effects(base, effects)
    # With the effects the errors are less correlated, and more predictions count.
    reweighted = best.objective.reweighted(best.model)
    if reweighted is not best.objective:
        best = fit(reweighted, best.x)
        plain = fit(reweighted.with_effects(base.effects, reweighted.mask), base.x)
        if plain.value < best.value:
            best = fit_with_effects(plain, effects)
    # Under another limit the other order of two time constants may be the likelier one.
    return exchanged_or_same(loosen_limit(best))


def loosen_limit(fitted: FitResult) -> FitResult:
    """Fit anew under the widest limit of the disturbance at which the free-running simulation stays as good.

    A larger disturbance is real, and no sign of missing physics, where it makes a model with effects adequate.
    """
    least = fitted.simulated_r2 - MAX_R2_LOSS
    for limit in DISTURBANCE_LIMITS:
        if limit <= fitted.objective.limit:
            break
        loose = fit(fitted.objective.with_limit(limit), fitted.x)
        if loose.simulated_r2 >= least:
            fitted = loose
            break
    if fitted.effects and fitted.at_limit and fitted.objective.limit == max(DISTURBANCE_LIMITS):
        loose = fit(fitted.objective.with_limit(REAL_DISTURBANCE_LIMIT), fitted.x)
        if loose.is_adequate and loose.simulated_r2 >= least:
            return loose
    return fitted


def _result(best: FitResult, simulation_r2: float) -> LikelihoodFit:
    require_swing(best)
    fitted = best.canonical()
    model, data = fitted.model, fitted.data
    added, misspecification_warnings = misspecification_covariance(fitted)
    covariance = fitted.covariance(sandwich=not fitted.is_white)
    if fitted.at_limit:
        # The limit is a choice: the errors include the change of the parameters under a looser one.
        looser = fit(fitted.objective.with_limit(_LOOSER * fitted.objective.limit), fitted.x)
        shift = looser.model.values - model.values
        covariance = covariance + np.outer(shift, shift)
    estimate = Estimate(
        names=model.names,
        axis=model.axis,
        values=model.values,
        covariance=covariance,
        method=fitted.objective.method,
        samples=sum(int(run.trial.measured.sum()) for run in data.runs),
        warnings=(*_warnings(fitted), *misspecification_warnings),
    )
    if not data.has_actuators:
        estimate = estimate.normalised_by_inertia()
    require_inertia(estimate, MIN_INERTIA_SIGMAS)
    sampling = estimate.covariance
    # Added after the check of the excitation, because misspecification does not mean too little excitation.
    estimate = replace(estimate, covariance=estimate.covariance + added)
    estimate = include_missing_torque(estimate, fitted)
    estimate = estimate.with_thrust_scale_uncertainty(fitted.thrust_scale_uncertainty)
    disturbance, memory = fitted.disturbance
    return LikelihoodFit(
        estimate=estimate,
        lasting=estimate.covariance - sampling,
        model=model,
        log_likelihood=-fitted.value,
        disturbance=disturbance,
        correlation_time=memory,
        position_noise=fitted.objective.position_noise(fitted.x),
        rate_only=data.rate_only,
        limit=fitted.objective.limit,
        at_limit=fitted.at_limit,
        white=fitted.is_white,
        free_run_r2=best.simulated_r2,
        simulation_r2=simulation_r2,
    )


def require_swing(fitted: FitResult) -> None:
    """Raise DataError if no actuator drives the vehicle and its motion is not that of the model's free swings."""
    r2 = fitted.simulated_r2
    if fitted.data.has_actuators or r2 >= _SWING_R2:
        return
    axis = fitted.data.axis
    raise DataError(
        f"these logs are no free decay: the model's free swings explain {100.0 * max(r2, 0.0):.0f} % of the "
        f"{axis.rate_words}; {100.0 * _SWING_R2:.0f} % or more was expected.",
        mend=f"Give logs of releases, or map what drives the vehicle by {axis.arm_key} of [[thrusters]].",
    )


def _warnings(fitted: FitResult) -> Iterator[str]:
    if fitted.at_limit:
        axis, limit = fitted.data.axis, fitted.objective.limit
        per_inertia = "" if fitted.data.has_actuators else PER_INERTIA
        most = f"{significant(limit * fitted.data.rms_torque, 3)} {axis.force_unit}{per_inertia}"
        yield (
            f"The disturbance {axis.force_name} would exceed its limit of {100 * limit:.2g} % of the "
            f"{axis.force_name} in use ({most}): the model misses an effect that these data show. The standard errors "
            f"include the change of the parameters under a limit {_LOOSER:g} times as high."
        )
    if isinstance(fitted.objective, MultiStepLikelihood):
        yield (
            "The model is too incomplete for one-step predictions, which would attribute the missing effect to the "
            "disturbance. The parameters are those of the best predictions from half to eight time constants ahead."
        )
        if fitted.data.gyro:
            yield "--gyro has no influence on these predictions, which are of the position."
    if not fitted.is_white:
        yield (
            "The innovations are not white. The standard errors come from the scatter between blocks of the logs, not "
            "from the curvature of the likelihood."
        )
    yield from water_warning(fitted.model, fitted.data)
    for name in ("quadratic_drag", "linear_drag"):
        if getattr(fitted.model, name) == 0.0:
            yield f"{name} is held at zero, its lower bound."


def misspecification_covariance(fitted: FitResult) -> tuple[FloatArray, list[str]]:
    """(p, p) addition to the sandwich covariance for an incomplete model and for other optima, and warnings."""
    added, warnings = covariance_of_optima(fitted)
    by_horizon, further = _covariance_of_horizons(fitted)
    return added + by_horizon, [*warnings, *further]


def _covariance_of_horizons(fitted: FitResult) -> tuple[FloatArray, list[str]]:
    """As `misspecification_covariance`, from the difference between short and long horizons.

    Errors of multi-step predictions recur in every block, so the scores of blocks scatter too little: the variance is
    at least that of the information. And a correct model has the same parameters for short and for long horizons. Half
    of the difference beyond chance is the error by the choice of horizons.
    """
    parts = fitted.objective.split_horizons()
    if parts is None:
        count = len(fitted.model.names)
        return np.zeros((count, count)), []
    scatter = np.diag(fitted.covariance(sandwich=True))
    added = np.diag(np.maximum(np.diag(fitted.covariance(sandwich=False)) - scatter, 0.0))
    if min(part.effective_count for part in parts) <= len(fitted.x):
        return added, []
    short, long = (fit(part, fitted.x, iterations=_HORIZON_ITERATIONS) for part in parts)
    variance = np.diag(short.covariance(sandwich=True)) + np.diag(long.covariance(sandwich=True))
    difference = short.model.values - long.model.values
    half = _HALF * np.sign(difference) * np.sqrt(np.maximum(difference**2 - variance, 0.0))
    added = added + np.outer(half, half)
    # Inertia and drags.
    worst = int(np.argmax(np.abs(difference[:3]) / np.sqrt(np.maximum(variance[:3], 1e-300))))
    if abs(difference[worst]) <= _DISAGREE_SIGMAS * math.sqrt(variance[worst]):
        return added, []
    name = fitted.model.names[worst]
    words, unit = name.replace("_", " "), unit_of(name, fitted.data.axis)
    near, far = (f"{significant(one.model.values[worst], 3)} {unit}" for one in (short, long))
    warning = (
        f"Predictions up to one time constant ahead give another {words} ({near}) than predictions from four time "
        f"constants on ({far}): the model misses an effect. If the commands follow the motion (autopilot), use the "
        "value of the short predictions. The standard errors include half of the difference."
    )
    return added, [warning]
