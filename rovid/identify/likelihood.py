"""Maximum likelihood of Kalman-filter innovations: all parameters from all trials at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg, special

from rovid.campaign.vehicle import Vehicle
from rovid.effects import Effect
from rovid.ground.arrays import FloatArray
from rovid.ground.errors import DataError
from rovid.identify.estimate import PER_INERTIA, Estimate
from rovid.identify.free_run import CERTAINTY, fit_free_run, free_run_r2
from rovid.identify.horizons import HORIZONS, HorizonLikelihood, HorizonRecords
from rovid.identify.innovations import BASE, Likelihood, Records
from rovid.identify.regression import require_inertia
from rovid.model.model import Model, unit_of
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
_TRIALS, _TRIAL_ITERATIONS = 8, 4
# Runs that tell by their scatter how much the kind of run has to say.
_FEWEST_RUNS = 3
# Of the horizons the middle one, between short and long; their answers are apart from so many joint errors on.
_MIDDLE, _APART = len(HORIZONS) // 2, 3.0
_WHITE_LAGS = 20
_WHITE_P = 1e-3
_KURTOSIS = 1.0


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
    likelihood, x, r2 = fit_base(records, base_r2) if base_r2 >= TRUSTED_R2 else fit_horizons(records)
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
    best, _ = min((likelihood.climb(begin, iterations=_TRIAL_ITERATIONS) for begin in better), key=lambda pair: pair[1])
    best, _ = likelihood.climb(best)
    if isinstance(likelihood, HorizonLikelihood):
        # What the effects explain made the errors correlate: now more predictions count.
        likelihood = HorizonLikelihood(likelihood.records.counting(likelihood.model(best)), effects=effects)
        return likelihood, likelihood.climb(best)[0]
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
    simulated = [simulated_rate(run, model, drive) for run, drive in pairs]
    return compare(np.concatenate([run.rates.rate for run in runs]), np.concatenate(simulated)).r2


def covariance(likelihood: Likelihood, x: FloatArray, *, sandwich: bool) -> FloatArray:
    """Of all parameters: inverse information, or the sandwich that allows for coloured innovations."""
    # All of them, a drag at its bound too: to take its zero for certain would make the rest look certain.
    here = likelihood.flatter_slopes(x)
    plain = inverse = _inverse(here.matrix.T @ here.matrix)
    if sandwich:
        inverse = _sandwich(plain, likelihood.scores(here, likelihood.records.block))
        by_run = likelihood.scores(here, likelihood.records.trial)
        if len(by_run) >= _FEWEST_RUNS:
            # Each kind of run may ask for parameters of its own, where the model's form is not nature's.
            ratio = np.diag(_sandwich(plain, by_run)) / np.maximum(np.diag(inverse), 1e-300)
            wider = np.sqrt(np.maximum(ratio, 1.0))
            inverse = inverse * np.outer(wider, wider)
        # What has no slope has no scatter of it either, which is no certainty.
        flat = np.asarray(~here.matrix.any(axis=0))
        inverse = np.where(flat | flat[:, np.newaxis], plain, inverse)
    inflated = float(np.median(np.sqrt(np.diag(inverse)[:3] / np.diag(plain)[:3])))
    for at, parameter in enumerate(likelihood.parameters, start=BASE):
        if parameter.stairs and (reach := _reach(likelihood, x, at)) is not None:
            # Stairs have no curvature: how far it goes until the likelihood has fallen says how sure it is, and no
            # surer than the step over which its slopes were taken, for where nature's threshold is in that is not told.
            reach = max(inflated * reach, parameter.step * abs(x[at]) / math.sqrt(3.0))
            factor = np.where(np.arange(len(x)) == at, reach / math.sqrt(inverse[at, at]), 1.0)
            inverse = inverse * np.outer(factor, factor)
    held = likelihood.low == likelihood.high
    inverse = np.where(held | held[:, np.newaxis], 0.0, inverse)
    shown, size = likelihood.of_model(x)
    return np.asarray(inverse[np.ix_(shown, shown)] * np.outer(size, size))


def form_doubt(likelihood: Likelihood, x: FloatArray) -> tuple[FloatArray, list[str]]:
    """(p, p) what is added to the sandwich of all parameters for a form that is not nature's, and what is said of it.

    Predictions miss much the same in every stretch of the logs, which then scatters less than their errors would by
    chance: the information, which counts those, is the least that is not known.

    Short horizons and long ones would ask for the same parameters, were the model right. Half of what they are apart
    beyond chance is how far another choice of horizons might move them.
    """
    names = likelihood.model(x).names
    if not isinstance(likelihood, HorizonLikelihood):
        return np.zeros((len(names), len(names))), []
    scatter, least = (np.diag(covariance(likelihood, x, sandwich=sandwich)) for sandwich in (True, False))
    doubt = np.diag(np.maximum(least - scatter, 0.0))
    horizon = likelihood.records.horizon
    parts = [likelihood.like(likelihood.effects, part) for part in (horizon < _MIDDLE, horizon > _MIDDLE)]
    if min(part.count for part in parts) <= len(x):
        return doubt, []
    fits = [part.climb(x, iterations=2 * _TRIAL_ITERATIONS)[0] for part in parts]
    short, long = (physical(part, at) for part, at in zip(parts, fits, strict=True))
    chance = np.sum(
        [np.diag(covariance(part, at, sandwich=True)) for part, at in zip(parts, fits, strict=True)], axis=0
    )
    apart = short - long
    half = 0.5 * np.sign(apart) * np.sqrt(np.maximum(apart**2 - chance, 0.0))
    worst = int(np.argmax(np.abs(apart[:3]) / np.sqrt(np.maximum(chance[:3], 1e-300))))
    if abs(apart[worst]) <= _APART * math.sqrt(chance[worst]):
        return doubt + np.outer(half, half), []
    name, unit = names[worst].replace("_", " "), unit_of(names[worst], likelihood.records.axis)
    said = (
        f"Predictions up to one time constant ahead ask for another {name} ({short[worst]:.3g} {unit}) than those from "
        f"four on ({long[worst]:.3g} {unit}): something is still missing. Where commands answer the motion believe "
        "the short ones. The standard errors include half of the difference."
    )
    return doubt + np.outer(half, half), [said]


def _sandwich(inverse: FloatArray, scores: FloatArray) -> FloatArray:
    scores = scores - scores.mean(axis=0)
    return np.asarray(inverse @ (scores.T @ scores * len(scores) / (len(scores) - 1)) @ inverse)


def _reach(likelihood: Likelihood, x: FloatArray, at: int) -> float | None:
    """How far coordinate ``at`` may go, all else held, until half a unit of log-likelihood is lost; None if never."""
    best = likelihood.cost(x)
    reaches = []
    for way in (1.0, -1.0):
        step = way * 1e-4 * max(abs(x[at]), 1e-3)
        while abs(step) < max(abs(x[at]), 1.0):
            moved = x.copy()
            moved[at] += step
            if not likelihood.low[at] <= moved[at] <= likelihood.high[at]:
                break
            if likelihood.cost(moved) > best + 0.5:
                reaches.append(abs(step))
                break
            step *= 1.5
    return max(reaches, default=None)


def physical(likelihood: Likelihood, x: FloatArray) -> FloatArray:
    """All parameters of the model in their units."""
    return likelihood.model(x).values


def _result(likelihood: Likelihood, x: FloatArray, *, r2: float, base_r2: float) -> LikelihoodFit:
    x = canonical(likelihood, x)
    white = likelihood_is_white(likelihood, x)
    at_limit = likelihood.at_limit(x)
    doubt, said = form_doubt(likelihood, x)
    found = covariance(likelihood, x, sandwich=not white)
    if at_limit:
        # The limit is a choice; what a looser one would change is part of the uncertainty.
        looser = Likelihood(likelihood.records, _LOOSER * likelihood.limit, likelihood.effects)
        shift = physical(looser, looser.climb(x)[0]) - physical(likelihood, x)
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
    estimate = estimate if likelihood.records.driven else estimate.undriven()
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
    """As `Model.scale_doubt` at ``x``, of the runs that were looked at."""
    vehicle, runs = likelihood.records.vehicle, likelihood.records.runs
    return 0.0 if vehicle is None else likelihood.model(x).scale_doubt(vehicle, [run.trial for run in runs])


def canonical(likelihood: Likelihood, x: FloatArray) -> FloatArray:
    """The same ``x`` with amplitudes positive and phases within a turn."""
    at, parts = likelihood.base, [x[: likelihood.base]]
    for effect in likelihood.effects:
        own = x[at : at + len(effect.parameters)]
        parts.append(own if effect.canonical is None else effect.canonical(own))
        at += len(effect.parameters)
    return np.concatenate(parts)


def _warnings(likelihood: Likelihood, model: Model, *, white: bool, at_limit: bool) -> list[str]:
    texts, axis = [], likelihood.records.axis
    if at_limit:
        unit = axis.push_unit if likelihood.records.driven else axis.push_unit + PER_INERTIA
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


def likelihood_is_white(likelihood: Likelihood, x: FloatArray) -> bool:
    """Whether the normalised innovations at ``x`` are white and free of heavy tails."""
    return innovations_are_white(_normalised(likelihood, x))


def colour(likelihood: Likelihood, x: FloatArray) -> float:
    """Log-likelihood that a model gains at least that leaves the innovations at ``x`` white; see `whitening_gain`."""
    return whitening_gain(_normalised(likelihood, x))


def whitening_gain(series: Sequence[FloatArray]) -> float:
    """Log-likelihood that ``series`` would gain, were each value predicted from those before it.

    Half the count of the logarithm of how much the variance falls in an autoregression (Ljung 1999, section 16.4).
    """
    lags = range(_WHITE_LAGS + 1)
    power = np.array([sum(float(z[lag:] @ z[: len(z) - lag]) for z in series if len(z) > lag) for lag in lags])
    if power[0] <= 0.0:
        return 0.0
    # The least noise keeps a series that repeats itself exactly from having no predictor.
    predictor = linalg.solve_toeplitz(power[:-1] + 1e-9 * power[0] * (np.arange(_WHITE_LAGS) == 0), power[1:])
    left = 1.0 - float(predictor @ power[1:]) / power[0]
    return -0.5 * sum(len(z) for z in series) * math.log(max(left, 1e-12))


def _normalised(likelihood: Likelihood, x: FloatArray) -> list[FloatArray]:
    """Innovations of each run over their standard deviations."""
    error, variance = likelihood.innovations(x)
    trial = likelihood.records.trial
    trial = trial if likelihood.counted is None else trial[likelihood.counted]
    z = error / np.sqrt(variance)
    return [z[trial == number] for number in np.unique(trial)]


def _inverse(information: FloatArray) -> FloatArray:
    """Inverse of the information; a direction in which the likelihood is flat gets a large variance."""
    power = np.diag(information)
    size = np.sqrt(np.where(power > 0.0, power, 1.0))
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    return np.asarray((vectors / np.maximum(values, 1e-9)) @ vectors.T / np.outer(size, size))


def innovations_are_white(series: Sequence[FloatArray]) -> bool:
    """Whether normalised innovations are white (Ljung-Box over all trials) and without heavy tails.

    Spikes leave innovations white, so that the kurtosis is looked at too.
    """
    count = sum(len(z) for z in series)
    power = sum(float(z @ z) for z in series)
    statistic = 0.0
    for lag in range(1, _WHITE_LAGS + 1):
        product = sum(float(z[lag:] @ z[:-lag]) for z in series if len(z) > lag)
        statistic += (product / power) ** 2 / (count - lag)
    p_value = float(special.gammaincc(_WHITE_LAGS / 2.0, count * (count + 2.0) * statistic / 2.0))
    fourth = sum(float(np.sum(z**4)) for z in series) * count / power**2
    return p_value > _WHITE_P and fourth - 3.0 < _KURTOSIS
