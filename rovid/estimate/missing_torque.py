"""Errors by torques that a model lacks; docs/method.md, (15a)."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple, Self

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.formatting import significant
from rovid.effects import Effect, EffectParameter
from rovid.effects.actuator_inputs import SPEEDS, ActuatorInputs
from rovid.effects.base import OnTorque, Values
from rovid.effects.catalogue import forms_for
from rovid.effects.clock_offset import CLOCKS_APART
from rovid.effects.thruster_imbalance import EFFECT as IMBALANCE
from rovid.effects.thruster_imbalance import thruster_of
from rovid.estimate.dataset import FitData
from rovid.estimate.estimate import Estimate
from rovid.estimate.fisher_information import NormalEquations
from rovid.estimate.fit_result import FitResult
from rovid.estimate.objective import NegativeLogLikelihood
from rovid.estimate.parametrization import LINEAR
from rovid.trial.vehicle import Vehicle

# Kinds of torque that any vehicle may have: of motion along another axis that follows the turn (memory of the rate), of
# drive, drag, water and cable. Those with thresholds are left out, because the likelihood has steps along them.
_KINDS = (
    "added_mass_memory",
    "entrained_swirl",
    "thruster_lag",
    "drag_curvature",
    "drag_asymmetry",
    "coulomb_resistance",
    "bias_torque",
    "tether_torsion",
    "thrust_curve_shape",
    "thrust_asymmetry",
    "sideslip_moment",
    "sideslip_moment:creep",
    "speed_dependent_damping",
)
# Kinds whose size says nothing of that of the others: they are hypotheses of their own. A vehicle creeps ahead by a
# difference of thrusts, and turns.
_OWN = frozenset({IMBALANCE.id, "sideslip_moment:creep"})
_SWAY = SPEEDS[1]
# Torque of the acceleration in sway, of one standard deviation, as a share of the torque in use.
_TORQUE = EffectParameter(
    name="torque", unit="N m", neutral=0.0, low=-2.0, high=2.0, initial_values=(0.03,), scale="torque"
)
# Initial values of each kind, the shortest time constants first: a long one is a large step, not a derivative.
_STARTS = 2
# Common variances of the torques that are tried.
_VARIANCES = 10.0 ** np.arange(-4.0, 10.0, 0.25)
# Number of variances in an average. The smallest is 1: such a torque moves no parameter by a standard error. The
# largest is that of a share of the model's own largest torque. Decision: a model whose one-step predictions count has
# an R^2 of 0.93 or more (`maximum_likelihood.INNOVATIONS_R2`), so a quarter of the motion is left at most.
_AVERAGED, _LARGEST_SHARE = 40, 0.25
# Kind of a torque that inertia or drag absorbs as a whole, such as damping at a constant speed ahead.
_ABSORBED = "absorbed"
# Least gain of log-likelihood by these torques where the innovations are white, which a complete model exceeds once in
# a thousand (half of chi-squared with one degree of freedom). Where they are not white, something is missing anyway.
_LEAST_GAIN = 4.8
# Least share of information that is left to a torque beside the parameters of the model; rounding errors are smaller.
_LEAST_SHARE = 1e-6
# Information on a shift of the commands in half sampling intervals, by a prior that is uniform over one interval.
_SHIFT_INFORMATION = 3.0
# Least step between two readings in rad or m; floating-point errors are smaller. Share of the variance of the noise.
_NO_STEP, _ROUNDED_SHARE = 1e-9, 0.25
# Number of inertia and drags, and growth of their standard errors that is reported.
_BASE = 3
_REPORTED = 1.2


class _Scores(NamedTuple):
    """Scores of q torques beside a model with p parameters, in units of the change of all predictions."""

    score: FloatArray  #: (q,)
    information: FloatArray  #: (q, q)
    shift: FloatArray  #: (p, q) change of the parameters by one unit of a torque.
    kinds: tuple[str, ...]  #: Id of the effect of each torque.
    largest: float  #: Largest plausible variance of a torque.

    def only(self, kinds: Collection[str]) -> Self:
        """The scores of the torques of some kinds."""
        at = [k for k, name in enumerate(self.kinds) if name in kinds]
        information, names = self.information[np.ix_(at, at)], tuple(self.kinds[k] for k in at)
        return self._replace(score=self.score[at], information=information, shift=self.shift[:, at], kinds=names)


def include_missing_torque(estimate: Estimate, fitted: FitResult) -> Estimate:
    """``estimate`` of the model ``fitted`` with errors that include torques which the model lacks, and a warning."""
    shown, size = fitted.objective.parametrization.model_jacobian(fitted.x)
    covariance = missing_torque_covariance(fitted)[np.ix_(shown, shown)] * np.outer(size, size)
    at = list(map(fitted.model.names.index, estimate.names))
    added = covariance[np.ix_(at, at)]
    wider, reach = replace(estimate, covariance=estimate.covariance + added), []
    for k, name in enumerate(estimate.names[:_BASE]):
        if wider.standard_error(name) > _REPORTED * estimate.standard_error(name):
            most = significant(2.0 * float(np.sqrt(added[k, k])), 2)
            reach.append(f"the {name.replace('_', ' ')} by up to {most} {estimate.unit(name)}")
    if not reach:
        return wider
    other = "sway" if estimate.axis.name == "yaw" else "motion along another axis"
    example, likeliest = f"{other} that follows the motion is not modelled", max(_hypotheses(fitted), key=_gain)
    if likeliest.kinds == {IMBALANCE.id}:
        example = "one thruster gives less thrust than its curve"
    reason = "The model lacks a torque: the errors of its predictions depend on the motion or on the commands."
    if not (lacks_torque := likeliest.gain > 0.0):
        reason = "The model may lack a torque that these runs do not distinguish from inertia and drag."
    warning = f"{reason} For instance {example}. This may change {', '.join(reach)}. The standard errors include it."
    return replace(wider, warnings=(*wider.warnings, warning), lacks_torque=lacks_torque)


def missing_torque_covariance(fitted: FitResult) -> FloatArray:
    """(p, p) covariance of the coordinates by torques that the model lacks.

    The torques of all kinds are random, with one common variance in units of the change that they make of all
    predictions. The covariance is the mean square of what the torques, given their scores, change, and the mean over
    the variances by their marginal likelihood. If the scores do not show torques of all kinds, they may show those of
    one kind alone: the covariance is then that of the likeliest one. Other laws of the model's own effects replace the
    torques of all kinds where the laws are likelier. The gains of the thrusters add their covariance, with their share
    of the likelihood: all runs that drive the thrusters alike agree on wrong parameters.
    """
    first, *alone = _hypotheses(fitted)
    own = {effect.id for effect in fitted.effects} if fitted.is_white else set()
    rivals = [one for one in alone if one.gain > 0.0 and (first.gain <= 0.0 or one.kinds <= own)]
    likeliest = max((first, *rivals), key=_gain)
    covariance = likeliest.covariance
    for one in (first, *alone):
        if one.kinds <= _OWN and one.kinds != likeliest.kinds and one.gain > 0.0:
            total = np.logaddexp(max(likeliest.gain, 0.0), one.gain)
            covariance = covariance + np.exp(one.gain - total) * one.covariance
    return covariance


def lacks_torque(fitted: FitResult) -> bool:
    """Whether the innovations are not white, or depend on the motion or on the commands (p = 0.001).

    Rounded readings have errors that are not white: they count where they depend on the motion alone.
    """
    return not (fitted.is_white or _is_rounded(fitted)) or any(
        one.gain > 0.0 for one in _hypotheses(fitted, white=True)
    )


class _LackingTorques(NamedTuple):
    """Random torques of some kinds: gain of marginal log-likelihood beyond the least, and (p, p) covariance by them."""

    gain: float
    covariance: FloatArray
    kinds: frozenset[str]

    @classmethod
    def of(cls, found: _Scores, least: float, *, even: bool) -> Self:
        """The torques with these scores; none of them acts with ``even`` odds.

        The prior of the logarithm of their variance is uniform up to the largest plausible variance, or the likeliest.
        """
        power, axes = np.linalg.eigh(found.information)
        known = power > _LEAST_SHARE * power.max(initial=0.0)
        power = np.where(known, power, 0.0)
        score = axes.T @ found.score

        def gains(variances: FloatArray) -> FloatArray:
            growth = 1.0 + variances[:, np.newaxis] * power[known]
            squares = score[known] ** 2 / power[known] * (1.0 - 1.0 / growth)
            return np.asarray(0.5 * np.sum(squares - np.log(growth), axis=1))

        tried = gains(_VARIANCES)
        top = max(found.largest, float(_VARIANCES[np.argmax(tried)]), 1.0)
        variances = np.geomspace(1.0, top, _AVERAGED)
        likelihoods = gains(variances)
        scale = max(0.0, float(likelihoods.max()))
        weights = np.exp(likelihoods - scale) / _AVERAGED
        weights /= weights.sum() + even * np.exp(-scale)
        # Nothing is known of a combination of torques that the parameters can replace.
        shift, covariance = found.shift @ axes, np.zeros((len(found.shift),) * 2)
        for variance, weight in zip(variances, weights, strict=True):
            spread = 1.0 / (power + 1.0 / variance)
            mean = shift @ np.where(known, spread * score, 0.0)
            covariance += weight * (np.outer(mean, mean) + (shift * spread) @ shift.T)
        return cls(float(tried.max()) - least, covariance, frozenset(found.kinds))


def _gain(torques: _LackingTorques) -> float:
    return torques.gain


def _hypotheses(fitted: FitResult, *, white: bool | None = None) -> Iterator[_LackingTorques]:
    """Torques of all kinds but the thrusters' gains, and those gains.

    Next to ``white`` innovations also those of each kind alone, and the other laws of the model's effects alone. The
    least gain is then corrected for the number of hypotheses.
    """
    found, white = _scores(fitted), fitted.is_white if white is None else white
    least, laws = _LEAST_GAIN if white else 0.0, {effect.id for effect in fitted.effects}
    yield _LackingTorques.of(found.only({*found.kinds} - _OWN), least, even=white)
    single = [{kind} for kind in found.kinds if kind != _ABSORBED]
    several = [*single, laws.intersection(found.kinds)] if white else [{kind} for kind in sorted(_OWN & {*found.kinds})]
    groups = dict.fromkeys(frozenset(group) for group in several if group)
    for group in groups:
        yield _LackingTorques.of(found.only(group), least + float(np.log(len(groups))), even=white)


def _is_rounded(fitted: FitResult) -> bool:
    """Whether rounding of the readings is a notable part of their noise."""
    trials = [run.trial for run in fitted.data.runs]
    steps = np.abs(np.concatenate([np.diff(trial.position[trial.measured]) for trial in trials]))
    rounding = float(steps[steps > _NO_STEP].min(initial=np.inf)) ** 2 / 12.0
    return _ROUNDED_SHARE * fitted.objective.position_noise(fitted.x) ** 2 < rounding < np.inf


def _counts(form: Effect, own: Sequence[Effect]) -> bool:
    """Whether a model may lack the torque of a ``form``: of a kind, or of another smooth law of its ``own`` effects."""
    if form.key in [effect.key for effect in own]:
        return False
    if form.per_thruster:
        return form.form == thruster_of(form.form)
    if form.id not in [effect.id for effect in own]:
        return form.key in _KINDS
    return not (form.oscillatory or any(parameter.piecewise_constant for parameter in form.parameters))


def _acceleration(data: FitData) -> list[Effect]:
    """A torque that follows the acceleration in sway; none where that is constant."""
    width = 0.5 * data.usual_time
    rates = {run.trial.name: _smooth_derivative(run.trial.time, run.trial.extras[_SWAY], width) for run in data.runs}
    spread = float(np.std(np.concatenate(list(rates.values()))))
    if not spread > 0.0:
        return []

    def modified(inputs: ActuatorInputs, torque: FloatArray, values: Values) -> FloatArray:
        return torque + values["torque"] / spread * np.nan_to_num(inputs.from_trials(rates))

    words = "torque of the acceleration in sway"
    effect = Effect(
        id="sway_acceleration",
        title=words,
        parameters=(_TORQUE,),
        equation=words,
        fingerprint=words,
        experiment=words,
        acts=OnTorque(modified),
    )
    return [effect]


def _smooth_derivative(time: FloatArray, values: FloatArray, width: float) -> FloatArray:
    """(n,) difference over ``width`` s of the means over ``width`` s, per second; 0 where all values are missing."""
    known = np.isfinite(values)
    if known.sum() < 2:
        return np.zeros(len(time))
    instants, known_values = time[known], values[known]
    steps = np.diff(instants)
    total = np.concatenate(([0.0], np.cumsum(0.5 * steps * (known_values[1:] + known_values[:-1]))))
    before, here, after = (np.interp(time + shift, instants, total) for shift in (-width, 0.0, width))
    return np.asarray((after - 2.0 * here + before) / width**2)


@lru_cache(maxsize=2)
def _scores(fitted: FitResult) -> _Scores:
    """Scores of the torques of all kinds, and of the effects' parameters beyond a bound at which the fit ended.

    A logger knows the instant of a command to a part of its sampling interval: this shift is a further parameter.
    """
    objective, count = fitted.objective, len(fitted.x)
    # The kinds that the model lacks, and the other laws of its own effects: nature follows none of them exactly.
    data = fitted.data
    vehicle = data.vehicle or Vehicle(name="", thrusters=(), axis=data.axis)
    channels = set.intersection(*(set(run.trial.extras) for run in data.runs))
    kinds = [form for form in forms_for(vehicle, channels) if _counts(form, fitted.effects)]
    if vehicle.thrusters and _SWAY in channels and data.axis.name == "yaw":
        kinds += _acceleration(data)  # by the coupled mass of sway and yaw
    shift_of_commands = [CLOCKS_APART] * (CLOCKS_APART not in fitted.effects)
    others = [*kinds, *shift_of_commands]
    objectives = [objective.with_effects((*fitted.effects, kind), objective.mask) for kind in others]
    starts = [one.parametrization.initial_values()[:_STARTS] for one in objectives]
    if shift_of_commands:
        half = 0.5 * max(run.trial.sampling_interval for run in data.runs)
        starts[-1] = [np.array([half / data.scales.unit_size(*CLOCKS_APART.parameters)])]
    chunks = zip(objective.chunks, *(one.chunks for one in objectives), strict=True)
    gradient, information = NormalEquations.sum_of(
        _equations(fitted.x, own, list(zip(chunk, starts, strict=True))) for own, *chunk in chunks
    )
    if shift_of_commands:
        information[-1, -1] += _SHIFT_INFORMATION
    names = [""] * count + [
        kind.key if kind.key in _OWN else kind.id for kind, own in zip(others, starts, strict=True) for _ in own
    ]
    low, high = objective.parametrization.bounds
    is_free, outward = np.ones(count, dtype=bool), -gradient[:count]
    for effect, place in objective.parametrization.effect_slices():
        names[place] = [effect.id] * len(effect.parameters)
        is_free[place] = ((fitted.x > low) | (outward >= 0.0))[place] & ((fitted.x < high) | (outward <= 0.0))[place]
    last = len(gradient) - len(shift_of_commands)
    model = np.r_[np.flatnonzero(is_free), last : len(gradient)]
    other = np.r_[np.flatnonzero(~is_free), count:last]
    with np.errstate(over="ignore", invalid="ignore"):
        cross, power = information[np.ix_(model, other)], np.diag(information)[other]
        inverse = np.linalg.pinv(information[np.ix_(model, model)], rcond=1e-12)
        # A model may diverge with a torque of that size.
        finite = np.isfinite(cross).all(axis=0) & np.isfinite(power) & np.isfinite(gradient[other])
        moved = inverse @ np.where(finite, cross, 0.0)
        left = np.where(finite, power, 0.0) - np.sum(np.where(finite, cross, 0.0) * moved, axis=0)
    kept = np.flatnonzero(finite & (left > _LEAST_SHARE * power))
    at, moved, cross = other[kept], moved[:, kept], cross[:, kept]
    unit = 1.0 / np.sqrt(power[kept])
    score = (moved.T @ gradient[model] - gradient[at]) * unit
    beside = information[np.ix_(at, at)] - cross.T @ moved
    chosen, shift = tuple(names[k] for k in at), np.zeros((count, len(at)))
    shift[model[model < count]] = (-moved * unit)[model < count]
    for effect, place in objective.parametrization.effect_slices():
        # Another law of an effect takes over a part of its size.
        shift[place, [k for k, name in enumerate(chosen) if name == effect.id]] = 0.0
    # Torques that inertia or drag absorbs: in the unit of the others, and without a score.
    base, count = np.flatnonzero(np.diag(information)[: LINEAR + 1]), len(at)
    size = np.sqrt(np.diag(information)[base])
    absorbed = np.zeros((len(shift), len(base)))
    absorbed[base, range(len(base))] = 1.0 / size
    own = size * np.array([1.0, *fitted.x[1 : LINEAR + 1]])[base]  # The inertia is a logarithm.
    joint = np.zeros((count + len(base),) * 2)
    joint[:count, :count] = beside * np.outer(unit, unit)
    return _Scores(
        score=np.concatenate((score, np.zeros(len(base)))),
        information=joint,
        shift=np.hstack((shift, absorbed)),
        kinds=(*chosen, *[_ABSORBED] * len(base)),
        largest=_LARGEST_SHARE**2 * float(np.max(own**2, initial=0.0)),
    )


def _equations(
    x: FloatArray, objective: NegativeLogLikelihood, others: Sequence[tuple[NegativeLogLikelihood, list[FloatArray]]]
) -> NormalEquations:
    """Gradient and information of the model's parameters and the torques, for one chunk of the data."""
    centre = objective.innovations(x)
    pairs = [(other, np.concatenate((x, start))) for other, starts in others for start in starts]
    sides = objective.evaluate_each(pairs)
    pieces = zip(objective.jacobian(x), objective.jacobian_between(centre, sides, np.ones(len(sides))), strict=True)
    with np.errstate(over="ignore", invalid="ignore"):
        joined = (replace(own, matrix=np.hstack((own.matrix, torques.matrix))) for own, torques in pieces)
        return NormalEquations.from_jacobians(joined)
