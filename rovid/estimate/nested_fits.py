"""Fits of a model with further effects, which never end below the model without them.

A fit ends at the optimum next to its start. So a larger model is fitted from several starts: each smaller model at its
optimum with the missing effect at its initial values, and the best smaller model with the missing effect at its neutral
value. There both models are equal. The optimiser never takes a step upwards, so the larger model cannot end lower.

A lag of the thrust and the vehicle's own time constant act in series. With linear drag they are one second-order
system, and change places without a change of the motion: I/D <-> T. Both orders are tried.
"""

import math
from collections.abc import Sequence
from itertools import combinations

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.formatting import significant
from rovid.effects import Effect
from rovid.effects.thruster_lag import EFFECT as LAG
from rovid.estimate.dataset import time_constant
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.levenberg_marquardt import ITERATIONS
from rovid.estimate.objective import NegativeLogLikelihood
from rovid.estimate.parametrization import INERTIA
from rovid.model.parameter_names import unit_of
from rovid.trial.vehicle import PLAUSIBLE_INERTIA_RATIO

# Starts that are fitted coarsely, further ones with a small effect, and steps of a coarse fit.
_STARTS, _WEAK_STARTS, _COARSE_ITERATIONS = 6, 3, 4
# Shares of the initial size of a small effect. A weak effect of a wrong size may look worse than none.
_WEAK = (0.3, 0.1)
# Coarse fits that are continued to convergence.
_CONTINUED = 2
# Smaller models of one size from which larger ones are fitted: all of up to three effects.
_KEPT = 3
# Least ratio of the lag to the vehicle's time constant at an exchange of the two, for a lag of zero.
_LEAST_RATIO = 0.05
# Nats; the likelihood does not decide between optima that differ by less: odds of 400 to 1.
DISTINGUISHABLE = 6.0
# Instants that are tried at once, levels of nearer and nearer ones, and most repetitions after a fit.
_INSTANTS, _INSTANT_LEVELS, _INSTANT_ROUNDS = 48, 3, 3
# Share of the inertia by which two optima are one.
_SAME_INERTIA = 0.03
# Nats by which equal models may differ, since the filter takes other steps.
_SAME = 0.1


def scaled_start(effect: Effect, start: FloatArray, share: float) -> FloatArray:
    """(k,) ``start`` with ``share`` times the size of the effect, within its bounds; 0 is no effect."""
    scaled = start.copy()
    for k, size in enumerate(effect.parameters[: effect.size_count]):
        if not size.neutral_at_infinity:
            scaled[k] = np.clip(size.neutral + share * (start[k] - size.neutral), size.low, size.high)
        elif share == 0.0:
            scaled[k] = size.neutral
    return scaled


def neutral_start(objective: NegativeLogLikelihood, nested: FitResult) -> FloatArray:
    """(p,) coordinates of the ``nested`` model next to the last effect of ``objective`` at its neutral value.

    The other parameters of the effect have initial values, or their neutral ones where the effect would act with these.
    """
    effect, start = objective.effects[-1], objective.parametrization.initial_values()[0]
    low, high = (bound[-len(start) :] for bound in objective.parametrization.bounds)
    without = np.clip([parameter.neutral for parameter in effect.parameters], low, high)
    begins = [np.concatenate((nested.x, one)) for one in (scaled_start(effect, start, 0.0), without)]
    first, second = objective.values(begins)
    return begins[0] if first <= second + _SAME else begins[1]


def fit_with_effects(base: FitResult, effects: Sequence[Effect]) -> FitResult:
    """The best fit of ``base`` with all ``effects``, no less likely than a fit with fewer of them."""
    fits: dict[tuple[Effect, ...], FitResult] = {(): base}
    alone: dict[Effect, FloatArray] = {}  # optimal parameters of each effect without the others
    for count in range(1, len(effects) + 1):
        larger = {some: _extended(base, some, fits, alone) for some in combinations(effects, count)}
        if count == 1:
            alone = {some[0]: one.effect_coordinates(some[0]) for some, one in larger.items()}
        kept = sorted(larger, key=lambda some: larger[some].value)[:_KEPT]
        fits = {some: larger[some] for some in kept}
    return fits[tuple(effects)]


def _extended(
    base: FitResult,
    effects: tuple[Effect, ...],
    fits: dict[tuple[Effect, ...], FitResult],
    alone: dict[Effect, FloatArray],
) -> FitResult:
    """The best fit of ``base`` with ``effects``, from the ``fits`` with one of them less."""
    objective = base.objective.with_effects(effects, base.objective.mask)
    begins, weak, neutral = list[FloatArray](), list[FloatArray](), list[tuple[float, FloatArray]]()
    for effect in effects:
        nested = fits.get(tuple(other for other in effects if other is not effect))
        if nested is None:
            continue
        larger = base.objective.with_effects((*nested.effects, effect), base.objective.mask)
        starts = larger.parametrization.initial_values()
        if effect in alone:
            starts.append(alone[effect])
        smaller_sizes = [scaled_start(effect, start, share) for start in starts for share in _WEAK]
        begins += [_in_order(larger, np.concatenate((nested.x, start)), effects) for start in starts]
        weak += [_in_order(larger, np.concatenate((nested.x, start)), effects) for start in smaller_sizes]
        neutral.append((nested.value, _in_order(larger, neutral_start(larger, nested), effects)))
    chosen = [
        *objective.most_likely(begins, _STARTS),
        *objective.most_likely(weak, _WEAK_STARTS),
        min(neutral, key=lambda pair: pair[0])[1],
    ]
    coarse = sorted((fit(objective, x, iterations=_COARSE_ITERATIONS) for x in chosen), key=lambda one: one.value)
    best = min((fit(objective, one.x) for one in coarse[:_CONTINUED]), key=lambda one: one.value)
    return exchanged_or_same(at_best_instant(best))


def _in_order(objective: NegativeLogLikelihood, x: FloatArray, effects: Sequence[Effect]) -> FloatArray:
    """(p,) the coordinates ``x`` of ``objective`` for its effects in another order."""
    places = dict(objective.parametrization.effect_slices())
    return np.concatenate((x[: objective.parametrization.effects_begin], *(x[places[effect]] for effect in effects)))


def exchanged_or_same(fitted: FitResult) -> FitResult:
    """The better of a fit and of the fit from its exchanged time constants.

    A physical inertia is better than one below the rigid body's, unless the likelihood clearly contradicts.
    """
    other = _exchanged_fit(fitted)
    if other is None:
        return fitted
    handicaps = [DISTINGUISHABLE * _is_below_rigid_body(one) for one in (fitted, other)]
    return other if other.value + handicaps[1] < fitted.value + handicaps[0] else fitted


def at_best_instant(fitted: FitResult, iterations: int = ITERATIONS, goal: float = math.inf) -> FitResult:
    """The fit continued from the most likely instants of its last effect, if that has any, one after the other.

    The likelihood has an optimum near each change of the commands. So instants in all logs are tried, then nearer ones,
    until the instants no longer change, or the value ``goal`` is out of reach.
    """
    parametrization = fitted.objective.parametrization
    last = fitted.effects[-1] if fitted.effects else None
    if last is None or not last.instants:
        return fitted
    places = [len(fitted.x) - len(last.parameters) + at for at in last.instants]
    shares, instants = parametrization.logged_time
    trials = [run.trial for run in fitted.data.runs]
    # Between two readings the fit itself finds the instant.
    finest = min(trial.sampling_interval for trial in trials) / sum(trial.duration for trial in trials)
    for repetition in range(_INSTANT_ROUNDS):
        x = fitted.x
        for at in places:
            centre, width = 0.5, 0.5
            for _ in range(_INSTANT_LEVELS):
                tried = [x, *(x.copy() for _ in range(_INSTANTS))]
                for one, share in zip(tried[1:], centre + width * np.linspace(-1.0, 1.0, _INSTANTS), strict=True):
                    one[at] = np.interp(share, shares, instants)
                (x,) = fitted.objective.most_likely(tried, 1)
                centre, width = float(np.interp(x[at], instants, shares)), 2.0 * width / (_INSTANTS - 1)
                # Before the fit, nearer instants than these were tried.
                if width < finest or (repetition and x is tried[0]):
                    break
        if x is fitted.x:
            break
        fitted = fit(fitted.objective, x, iterations=iterations)
        if fitted.remaining_gain < fitted.value - goal:
            break
    return fitted


def covariance_of_optima(fitted: FitResult) -> tuple[FloatArray, list[str]]:
    """(p, p) addition to the covariance for a second optimum and for parameters at a bound, and warnings.

    Two standard errors reach from one optimum to the other, unless the likelihood decides between them. The error of a
    parameter at a bound other than its neutral value is that of a uniform distribution over its range, because the
    curvature there has no meaning.
    """
    parametrization, model = fitted.objective.parametrization, fitted.model
    added, warnings = np.zeros((len(model.names),) * 2), list[str]()
    shown, size = parametrization.model_jacobian(fitted.x)
    for at, effect, parameter in parametrization.effect_parameters():
        low, high = parametrization.low[at], parametrization.high[at]
        if low < fitted.x[at] < high or low == high:
            continue
        place = shown.index(at)
        name, value = model.names[place], significant(float(model.values[place]), 3)
        if fitted.x[at] == parameter.neutral:
            # A second parameter without influence, such as a rounding, says nothing about the effect.
            if parameter in effect.parameters[: effect.size_count]:
                warnings.append(f"{name} ends at {value}, its bound: these data show no {effect.title}.")
            continue
        added[place, place] = (size[place] * (high - low)) ** 2 / 12.0
        warnings.append(
            f"{name} ends at {value}, the bound of its range, and has no standard error of its own: the one that is "
            "stated is that of the whole range. The cause may be another one."
        )
    other = _exchanged_fit(fitted)
    if other is None or other.value > fitted.value + DISTINGUISHABLE or _is_below_rigid_body(other):
        return added, warnings
    away = other.model.values - model.values
    if abs(away[0]) < _SAME_INERTIA * model.inertia:
        return added, warnings
    added += np.outer(0.5 * away, 0.5 * away)
    unit = unit_of("inertia", fitted.data.axis)
    warnings.append(
        f"Two time constants in a row, that of the thrust and that of the vehicle, can change places: an inertia of "
        f"{significant(other.model.inertia, 3)} {unit} in place of {significant(model.inertia, 3)} {unit} explains "
        f"these data as well (log-likelihood {significant(abs(other.value - fitted.value), 2)} "
        f"{'lower' if other.value > fitted.value else 'higher'}). The standard errors include it. "
        "mass, length and width in [vehicle] may decide, or turns at a higher rate."
    )
    return added, warnings


def _exchanged_fit(fitted: FitResult) -> FitResult | None:
    """The fit from exchanged time constants, as far as the likelihood may not decide; None without a lag."""
    exchanged = with_exchanged_time_constants(fitted)
    return None if exchanged is None else fit(fitted.objective, exchanged, goal=fitted.value + DISTINGUISHABLE)


def _is_below_rigid_body(fitted: FitResult) -> bool:
    """Whether the inertia is below that of the rigid body, which is impossible with a measured thrust curve."""
    vehicle = fitted.data.vehicle
    rigid = None if vehicle is None else vehicle.reference_inertia
    return rigid is not None and fitted.data.has_actuators and fitted.model.inertia < PLAUSIBLE_INERTIA_RATIO[0] * rigid


def with_exchanged_time_constants(fitted: FitResult) -> FloatArray | None:
    """(p,) coordinates with the lag of the thrust and the vehicle's time constant exchanged; None without a lag.

    The drag, and so the steady motion, stays the same.
    """
    parametrization, x = fitted.objective.parametrization, fitted.x.copy()
    for at, effect, parameter in parametrization.effect_parameters():
        if effect.id == LAG.id and parameter.name == "time_constant":
            own = time_constant(fitted.model, fitted.data.rms_rate) / fitted.data.scales.unit_size(parameter)
            ratio = max(float(x[at]) / own, _LEAST_RATIO)
            x[at], x[INERTIA] = own, x[INERTIA] + math.log(ratio)
            return np.asarray(np.clip(x, *parametrization.bounds))
    return None
