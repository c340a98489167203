"""Maximum likelihood of Kalman-filter innovations: all parameters from all trials at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rovid.campaign.vehicle import Vehicle
from rovid.effects import Effect
from rovid.ground.arrays import FloatArray
from rovid.ground.errors import DataError
from rovid.identify.certainty import TRIAL_ITERATIONS, covariance, form_doubt, physical
from rovid.identify.estimate import PER_INERTIA, Estimate
from rovid.identify.free_run import CERTAINTY, fit_free_run, free_run_r2
from rovid.identify.horizons import HorizonLikelihood, HorizonRecords
from rovid.identify.innovations import Likelihood
from rovid.identify.records import Records
from rovid.identify.regression import require_inertia
from rovid.identify.whiteness import likelihood_is_white
from rovid.model.model import Model
from rovid.model.simulation import compare, simulated_rate
from rovid.motion.runs import Run

# Upper limits of the disturbance, as shares of the torque in use. Without a limit the disturbance explains whatever
# the model does not, and the parameters go where they like.
LIMITS = (0.05, 0.02, 0.01, 0.005)
# As large as the torque in use: no limit at all.
UNLIMITED = 1.0
# Where the free-running simulation of the plain model is worse than this, the model misses so much that no limit of
# the disturbance is right: the simulation itself is then what is fitted.
TRUSTED_R2 = 0.93
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
    free_run_r2, base_r2
        R^2 of the free-running rate with this model, and with the fit that looks at nothing else.
    """

    estimate: Estimate
    model: Model
    log_likelihood: float
    disturbance: float
    correlation_time: float
    position_noise: float
    integrated: bool
    limit: float
    at_limit: bool
    white: bool
    free_run_r2: float
    base_r2: float


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
            mend=f"Map {axis.rate} in [signals] of rovid.toml, or leave it out.",
        )
    start = fit_free_run(runs, certainty=0.0 if effects else CERTAINTY)
    records = Records(runs, vehicle, start, gyro=gyro)
    base_r2 = free_run_r2(runs, records.start)
    likelihood: Likelihood
    if base_r2 >= TRUSTED_R2:
        likelihood, x, r2 = fit_base(records, base_r2)
    else:
        likelihood, x, r2 = fit_horizons(records)
    if effects:
        likelihood, x = with_effects(likelihood, x, effects)
        r2 = simulated_r2(likelihood, x)
    return _result(likelihood, x, r2=r2, base_r2=base_r2)


def fit_base(records: Records, base_r2: float) -> tuple[Likelihood, FloatArray, float]:
    """Most likely coordinates without effects, under the first limit whose free-running R^2 is near ``base_r2``.

    Returns
    -------
    likelihood, x, r2
        With the limit that was chosen.
    """
    best: tuple[Likelihood, FloatArray, float] | None = None
    for limit in LIMITS:
        likelihood = Likelihood(records, limit)
        x, _ = likelihood.climb(likelihood.first())
        r2 = free_run_r2(records.runs, likelihood.model(x))
        if best is None or r2 > best[2]:
            best = likelihood, x, r2
        if r2 >= base_r2 - _R2_LOSS:
            break
    assert best is not None  # noqa: S101 - there are limits
    return best


def fit_horizons(records: Records) -> tuple[HorizonLikelihood, FloatArray, float]:
    """As `fit_base`, by predictions some time ahead."""
    likelihood = HorizonLikelihood(HorizonRecords.of(records, records.start))
    x, _ = likelihood.climb(likelihood.first())
    return likelihood, x, simulated_r2(likelihood, x)


def with_effects(bare: Likelihood, x: FloatArray, effects: tuple[Effect, ...]) -> tuple[Likelihood, FloatArray]:
    """Continue from the fit without effects: the likeliest of all starts, its disturbance then limited anew."""
    likelihood, better = bare, [x[: bare.base]]
    for count in range(1, len(effects) + 1):
        likelihood = bare.like(effects[:count], bare.counted)
        begins = [np.concatenate((begin, start)) for begin in better for start in likelihood.starts()]
        better = sorted(begins, key=likelihood.cost)[:_TRIALS]
    # A few steps tell which of the better starts leads lowest.
    tried = [likelihood.climb(begin, iterations=TRIAL_ITERATIONS) for begin in better]
    nearest, _ = min(tried, key=lambda pair: pair[1])
    best, _ = likelihood.climb(nearest)
    if isinstance(likelihood, HorizonLikelihood):
        # What the effects explain made the errors correlate: now more predictions count.
        records = likelihood.records.counting(likelihood.model(best))
        likelihood = HorizonLikelihood(records, effects=effects)
        best, _ = likelihood.climb(best)
        return likelihood, best
    return loosened(likelihood, best)


def loosened(likelihood: Likelihood, x: FloatArray) -> tuple[Likelihood, FloatArray]:
    """``likelihood`` under the widest limit at which the free-running simulation stays as good, climbed from ``x``."""
    limits = [limit for limit in LIMITS if limit > likelihood.limit]
    if not limits:
        return likelihood, x
    wanted = simulated_r2(likelihood, x) - _R2_LOSS
    for limit in limits:
        wider = Likelihood(likelihood.records, limit, likelihood.effects, likelihood.counted)
        widest, _ = wider.climb(x)
        if simulated_r2(wider, widest) >= wanted:
            return wider, widest
    return likelihood, x


def simulated_r2(likelihood: Likelihood, x: FloatArray) -> float:
    """R^2 of the free-running rate at ``x``."""
    model, runs = likelihood.model(x), likelihood.records.runs
    pairs = zip(runs, likelihood.records.drives(model), strict=True)
    measured = np.concatenate([run.rates.rate for run in runs])
    simulated = [simulated_rate(run, model, drive) for run, drive in pairs]
    return compare(measured, np.concatenate(simulated)).r2


def _result(likelihood: Likelihood, x: FloatArray, *, r2: float, base_r2: float) -> LikelihoodFit:
    x = canonical(likelihood, x)
    white = likelihood_is_white(likelihood, x)
    at_limit = likelihood.at_limit(x)
    doubt, said = form_doubt(likelihood, x)
    found = covariance(likelihood, x, sandwich=not white)
    if at_limit:
        # The limit is a choice; what a looser one would change is part of the uncertainty.
        looser = Likelihood(likelihood.records, _LOOSER * likelihood.limit, likelihood.effects)
        elsewhere, _ = looser.climb(x)
        shift = physical(looser, elsewhere) - physical(likelihood, x)
        found = found + np.outer(shift, shift)
    model = likelihood.model(x)
    disturbance, memory = likelihood.disturbance(x)
    estimate = Estimate(
        names=model.names,
        axis=model.axis,
        values=physical(likelihood, x),
        covariance=found,
        method=likelihood.method,
        samples=sum(int(run.trial.measured.sum()) for run in likelihood.records.runs),
        warnings=(*_warnings(likelihood, model, white=white, at_limit=at_limit), *said),
    )
    if not likelihood.records.driven:
        estimate = estimate.undriven()
    require_inertia(estimate, CERTAINTY)
    # The vehicle was excited; how far another form would move the answer is another matter.
    estimate = replace(estimate, covariance=estimate.covariance + doubt)
    estimate = estimate.with_scale_doubt(scale_doubt(likelihood, x))
    return LikelihoodFit(
        estimate=estimate,
        model=model,
        log_likelihood=-likelihood.cost(x),
        disturbance=disturbance,
        correlation_time=memory,
        position_noise=likelihood.position_noise(x),
        integrated=likelihood.records.integrated,
        limit=likelihood.limit,
        at_limit=at_limit,
        white=white,
        free_run_r2=r2,
        base_r2=base_r2,
    )


def scale_doubt(likelihood: Likelihood, x: FloatArray) -> float:
    """As `Drivetrain.scale_doubt` at ``x``, of the runs that were looked at."""
    vehicle, runs = likelihood.records.vehicle, likelihood.records.runs
    if vehicle is None:
        return 0.0
    return likelihood.model(x).drivetrain.scale_doubt(vehicle, [run.trial for run in runs])


def canonical(likelihood: Likelihood, x: FloatArray) -> FloatArray:
    """The same ``x`` with amplitudes positive and phases within a turn."""
    at, parts = likelihood.base, [x[: likelihood.base]]
    for effect in likelihood.effects:
        own = x[at : at + len(effect.parameters)]
        if effect.canonical is not None:
            own = effect.canonical(own)
        parts.append(own)
        at += len(effect.parameters)
    return np.concatenate(parts)


def _warnings(likelihood: Likelihood, model: Model, *, white: bool, at_limit: bool) -> list[str]:
    texts, axis = [], likelihood.records.axis
    if at_limit:
        per_inertia = "" if likelihood.records.driven else PER_INERTIA
        unit = axis.push_unit + per_inertia
        most = f"{likelihood.limit * likelihood.records.torque:.3g} {unit}"
        texts.append(
            f"The disturbance {axis.push} would exceed {100 * likelihood.limit:.2g} % of the {axis.push} in use "
            f"({most}): the model misses something that these data show. The standard errors include what "
            f"a limit {_LOOSER:g} times as high would change."
        )
    if isinstance(likelihood, HorizonLikelihood):
        texts.append(
            "The simulation misses too much for the likelihood of each next reading, which would call it disturbance: "
            "the parameters are those of the best predictions from half to eight time constants ahead."
        )
        if likelihood.records.gyro:
            texts.append("--gyro has no say there: what is predicted is the position.")
    if not white:
        texts.append(
            "The innovations are not white: the standard errors come from the scatter between stretches of the "
            "logs, not from the curvature of the likelihood."
        )
    drags = ("quadratic_drag", "linear_drag")
    texts += [f"{name} is held at zero, its lower bound." for name in drags if getattr(model, name) == 0.0]
    return texts
