"""Errors by torques that a model lacks; docs/method.md, (15a)."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.formatting import significant
from rovid.effects import Effect, EffectParameter
from rovid.effects.actuator_inputs import SPEEDS, ActuatorInputs
from rovid.effects.base import OnTorque, Values
from rovid.effects.catalogue import CATALOGUE
from rovid.estimate.dataset import FitData
from rovid.estimate.estimate import Estimate
from rovid.estimate.fisher_information import NormalEquations
from rovid.estimate.fit_result import FitResult
from rovid.estimate.objective import NegativeLogLikelihood

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
    "speed_dependent_damping",
)
_SWAY = SPEEDS[1]
# Torque of the acceleration in sway, of one standard deviation, as a share of the torque in use.
_TORQUE = EffectParameter(
    name="torque", unit="N m", neutral=0.0, low=-2.0, high=2.0, initial_values=(0.03,), scale="torque"
)
# Initial values of each kind, the shortest time constants first: a long one is a large step, not a derivative.
_STARTS = 2
# Common variances of the torques that are tried.
_VARIANCES = 10.0 ** np.arange(-4.0, 10.0, 0.25)
# Least gain of log-likelihood by these torques where the innovations are white, which a complete model exceeds once in
# a thousand (half of chi-squared with one degree of freedom). Where they are not white, something is missing anyway.
_LEAST_GAIN = 4.8
# Least share of information that is left to a torque beside the parameters of the model; rounding errors are smaller.
_LEAST_SHARE = 1e-6
# Number of inertia and drags, and growth of their standard errors that is reported.
_BASE = 3
_REPORTED = 1.2


class _Scores(NamedTuple):
    """Scores of q torques beside a model with p parameters, in units of the change of all predictions."""

    score: FloatArray  #: (q,)
    information: FloatArray  #: (q, q)
    shift: FloatArray  #: (p, q) change of the parameters by one unit of a torque.


def include_missing_torque(estimate: Estimate, fitted: FitResult) -> Estimate:
    """``estimate`` of the model ``fitted`` with errors that include torques which the model lacks, and a warning."""
    shown, size = fitted.objective.parametrization.model_jacobian(fitted.x)
    covariance = missing_torque_covariance(fitted)[np.ix_(shown, shown)] * np.outer(size, size)
    names = fitted.model.names
    at = list(map(names.index, estimate.names))
    added = covariance[np.ix_(at, at)]
    wider = replace(estimate, covariance=estimate.covariance + added)
    reach = []
    for k, name in enumerate(estimate.names[:_BASE]):
        if wider.standard_error(name) > _REPORTED * estimate.standard_error(name):
            most = significant(2.0 * float(np.sqrt(added[k, k])), 2)
            reach.append(f"the {name.replace('_', ' ')} by up to {most} {estimate.unit(name)}")
    if not reach:
        return wider
    other = "sway" if estimate.axis.name == "yaw" else "motion along another axis"
    warning = (
        "The model lacks a torque: the errors of its predictions depend on the motion or on the commands. For instance "
        f"{other} that follows the motion is not modelled. This may change {', '.join(reach)}. The standard errors "
        "include it."
    )
    return replace(wider, warnings=(*wider.warnings, warning))


def missing_torque_covariance(fitted: FitResult) -> FloatArray:
    """(p, p) covariance of the coordinates by torques that the model lacks.

    The torques of all kinds are random, with one common variance in units of the change that they make of all
    predictions. It is that with the largest marginal likelihood of the scores. The covariance is the mean square of
    what the torques, given their scores, change.
    """
    found, none = _scores(fitted), np.zeros((len(fitted.x), len(fitted.x)))
    power, axes = np.linalg.eigh(found.information)
    kept = power > _LEAST_SHARE * power.max(initial=0.0)
    power, axes = power[kept], axes[:, kept]
    score = axes.T @ found.score
    variances = _VARIANCES[:, np.newaxis] * power**2 + power
    likelihoods = -0.5 * np.sum(np.log(variances) + score**2 / variances, axis=1)
    complete = -0.5 * float(np.sum(np.log(power) + score**2 / power))
    best = int(np.argmax(likelihoods))
    if likelihoods[best] <= complete + (_LEAST_GAIN if fitted.is_white else 0.0):
        return none
    spread = 1.0 / (power + 1.0 / _VARIANCES[best])
    shift = found.shift @ axes
    mean = shift @ (spread * score)
    return np.asarray(np.outer(mean, mean) + (shift * spread) @ shift.T)


def _kinds(fitted: FitResult) -> list[Effect]:
    data, own = fitted.data, {effect.id for effect in fitted.effects}
    drives = data.vehicle is not None and bool(data.vehicle.thrusters)
    channels = set.intersection(*(set(run.trial.extras) for run in data.runs))
    kinds = [
        effect
        for effect in CATALOGUE
        if effect.id in _KINDS
        and effect.id not in own
        and (not effect.axes or data.axis.name in effect.axes)
        and (drives or not (effect.changes_torque_input or effect.uses_wash))
        and set(effect.needs) <= channels
    ]
    # By the coupled mass of sway and yaw.
    acceleration = _acceleration(data) if drives and _SWAY in channels and data.axis.name == "yaw" else None
    return kinds if acceleration is None else [*kinds, acceleration]


def _acceleration(data: FitData) -> Effect | None:
    """A torque that follows the acceleration in sway; None where that is constant."""
    width = 0.5 * data.usual_time
    rates = {run.trial.name: _smooth_derivative(run.trial.time, run.trial.extras[_SWAY], width) for run in data.runs}
    spread = float(np.std(np.concatenate(list(rates.values()))))
    if not spread > 0.0:
        return None

    def modified(inputs: ActuatorInputs, torque: FloatArray, values: Values) -> FloatArray:
        return torque + values["torque"] / spread * np.nan_to_num(inputs.from_trials(rates))

    words = "torque of the acceleration in sway"
    return Effect(
        id="sway_acceleration",
        title=words,
        parameters=(_TORQUE,),
        equation=words,
        fingerprint=words,
        experiment=words,
        acts=OnTorque(modified),
    )


def _smooth_derivative(time: FloatArray, values: FloatArray, width: float) -> FloatArray:
    """(n,) difference over ``width`` s of the means over ``width`` s, per second; 0 where all values are missing."""
    known = np.isfinite(values)
    if known.sum() < 2:
        return np.zeros(len(time))
    instants, known_values = time[known], values[known]
    steps = np.diff(instants)
    total = np.concatenate(([0.0], np.cumsum(0.5 * steps * (known_values[1:] + known_values[:-1]))))

    def integral(at: FloatArray) -> FloatArray:
        return np.interp(at, instants, total)

    return np.asarray((integral(time + width) - 2.0 * integral(time) + integral(time - width)) / width**2)


def _scores(fitted: FitResult) -> _Scores:
    """Scores of the torques of all kinds."""
    objective, count = fitted.objective, len(fitted.x)
    objectives = [objective.with_effects((*fitted.effects, kind), objective.mask) for kind in _kinds(fitted)]
    starts = [objective.parametrization.initial_values()[:_STARTS] for objective in objectives]
    chunks = zip(objective.chunks, *(one.chunks for one in objectives), strict=True)
    gradient, information = NormalEquations.sum_of(
        _equations(fitted.x, own, list(zip(others, starts, strict=True))) for own, *others in chunks
    )
    model = slice(None, count)
    with np.errstate(over="ignore", invalid="ignore"):
        cross, power = information[model, count:], np.diag(information)[count:]
        inverse = np.linalg.pinv(information[model, model], rcond=1e-12)
        # A model may diverge with a torque of that size.
        finite = np.isfinite(cross).all(axis=0) & np.isfinite(power) & np.isfinite(gradient[count:])
        moved = inverse @ np.where(finite, cross, 0.0)
        left = np.where(finite, power, 0.0) - np.sum(np.where(finite, cross, 0.0) * moved, axis=0)
    at = np.flatnonzero(finite & (left > _LEAST_SHARE * power))
    unit = 1.0 / np.sqrt(power[at])
    score = (moved[:, at].T @ gradient[model] - gradient[count:][at]) * unit
    beside = information[np.ix_(count + at, count + at)] - cross[:, at].T @ moved[:, at]
    return _Scores(score, beside * np.outer(unit, unit), -moved[:, at] * unit)


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
