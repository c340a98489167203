"""Errors by torques that a model lacks; docs/method.md, (15a)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.formatting import significant
from rovid.core.stats import chi2_sf, t_quantile
from rovid.effects import Effect
from rovid.effects.catalogue import CATALOGUE
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
)
# Initial values of each kind, the shortest time constants first: a long one is a large step, not a derivative.
_STARTS = 2
# Largest probability of the scores of an incomplete model with white innovations: that of the whiteness test. Where the
# innovations are not white, something is missing anyway.
_MAX_P = 1e-3
# Least share of information that is left to a torque beside the parameters of the model; rounding errors are smaller.
_LEAST_SHARE = 1e-6
# Number of inertia and drags, and growth of their standard errors that is reported.
_BASE = 3
_REPORTED = 1.2


class _Scores(NamedTuple):
    """Scores of q torques beside a model with p parameters."""

    score: FloatArray  #: (q,) normalised: of variance 1 where the model is complete.
    correlation: FloatArray  #: (q, q) of the scores.
    shift: FloatArray  #: (p, q) change of the parameters by a torque of one standard error.


def include_missing_torque(estimate: Estimate, fitted: FitResult) -> Estimate:
    """``estimate`` of the model ``fitted`` with errors that include torques which the model lacks, and a warning."""
    shown, size = fitted.objective.parametrization.model_jacobian(fitted.x)
    covariance = missing_torque_covariance(fitted)[np.ix_(shown, shown)] * np.outer(size, size)
    names = fitted.model.names
    at = [names.index(name) for name in estimate.names]
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

    The torques of all kinds are taken as random and equally likely, in units of their standard errors. Their common
    variance is what the scores have beyond that of a complete model. It follows from few independent scores, and the
    errors are widened by Student's t.
    """
    found = _scores(fitted)
    count = len(found.score)
    if count == 0:
        return np.zeros((len(fitted.x), len(fitted.x)))
    # Number of independent scores with the same scatter of the sum of squares (Satterthwaite 1946).
    independent = count**2 / float(np.sum(found.correlation**2))
    mean_square = float(np.mean(found.score**2))
    if fitted.is_white and chi2_sf(independent, mean_square * independent) > _MAX_P:
        return np.zeros((len(fitted.x), len(fitted.x)))
    variance = max(mean_square - 1.0, 0.0) * independent / count
    widening = t_quantile(0.975, max(independent, 1.0)) / t_quantile(0.975, np.inf)
    return np.asarray(widening**2 * variance * found.shift @ found.shift.T)


def _kinds(fitted: FitResult) -> list[Effect]:
    data, own = fitted.data, {effect.id for effect in fitted.effects}
    drives = data.vehicle is not None and bool(data.vehicle.thrusters)
    return [
        effect
        for effect in CATALOGUE
        if effect.id in _KINDS
        and effect.id not in own
        and (not effect.axes or data.axis.name in effect.axes)
        and (drives or not (effect.changes_torque_input or effect.uses_wash))
    ]


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
    error = 1.0 / np.sqrt(left[at])
    score = (moved[:, at].T @ gradient[model] - gradient[count:][at]) * error
    beside = information[np.ix_(count + at, count + at)] - cross[:, at].T @ moved[:, at]
    return _Scores(score, beside * np.outer(error, error), -moved[:, at] * error)


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
