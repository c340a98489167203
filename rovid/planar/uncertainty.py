"""Errors of a planar fit: covariance with further sources, what the data leave open, and what the prior decides."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray
from rovid.core.errors import DataError, join_words
from rovid.core.formatting import plus_minus
from rovid.estimate.fisher_information import NormalEquations, inverse_information
from rovid.estimate.maximum_likelihood import INNOVATIONS_R2, fit_likelihood
from rovid.model.parameter_names import unit_of
from rovid.planar.dataset import PlanarData
from rovid.planar.kernels import NOISE_SENSOR
from rovid.planar.likelihood import PlanarPrior, PriorValue
from rovid.planar.model import AXIS_NAMES, BASE_COUNT
from rovid.planar.optimum import PlanarOptimum
from rovid.trial.preprocessing import prepare_trials

# Factor on the limit of an active disturbance, for the effect of the limit on the parameters.
LOOSER = 2.5
# Largest standard error of a determined combination, in units of its scale: three standard errors make one unit.
MAX_ERROR = 1.0 / 3.0
# Least share of a parameter in a combination that is listed; number that its sentence names next to the first one.
_LEAST_SHARE, _NAMED = 0.1, 3
# Largest variance over that by the logs alone, of a parameter that is said to come from the prior. A decision.
_DECIDED = 0.5
# Standard errors between the prior and the logs that are a contradiction.
_CONTRADICTION = 3.0
# Least share of the information on a parameter that is not the prior's, for a contradiction. A decision.
_LEAST_OTHER = 0.02
# Standard error of a logarithm of the disturbance that adds less than 5 % to other errors. By the law of total variance
# a variance grows by twice its square at most.
_KNOWN = 0.22


def total_covariance(best: PlanarOptimum) -> FloatArray:
    """(q, q) covariance of the model parameters with the uncertainty of the disturbance.

    By the law of total variance, over three Gauss-Hermite points of each size and each correlation time: the mean
    covariance there, and the scatter of the likeliest parameters. Where the disturbance is at its limit, which is a
    choice, the change of the parameters under a limit `LOOSER` times as high is added. Errors do not become smaller.
    """
    coordinates, begin, free = best.coordinates, best.coordinates.noise_begin, best.coordinates.free
    own, count = np.flatnonzero(free[:begin]), len(best.x)

    def moments(equations: NormalEquations) -> tuple[FloatArray, FloatArray]:
        """Covariance at a disturbance, and the distance to the parameters that are the likeliest there."""
        inverse = inverse_information(equations.information[np.ix_(own, own)])
        return inverse, inverse @ equations.gradient[own]

    def moments_at(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        held = coordinates.bounded({at: (x[at], x[at]) for at in range(begin, count)})
        return moments(best.likelihood.with_coordinates(held).equations(x))

    centre, start = moments(best.equations)
    spread, shift = np.zeros_like(centre), np.zeros(len(own))
    errors = np.sqrt(np.diag(inverse_information(best.equations.information)))
    for at in range(begin, begin + NOISE_SENSOR):
        for step in (-math.sqrt(3.0), math.sqrt(3.0)) if free[at] and errors[at] > _KNOWN else ():
            point = coordinates.projected(best.x + step * errors[at] * (np.arange(count) == at))
            inverse, away = moments_at(point)
            spread += (inverse - centre + np.outer(away - start, away - start)) / 6.0
    if best.limited.any():
        looser = best.x.copy()
        looser[begin : begin + len(best.limited)] += math.log(LOOSER) * best.limited
        shift = moments_at(looser)[1] - start
    jacobian = coordinates.value_jacobian(best.x)[:, own]
    grown, change = jacobian @ growth(centre, spread), jacobian @ shift
    return np.asarray(grown @ best.coordinate_covariance[np.ix_(own, own)] @ grown.T + np.outer(change, change))


def growth(centre: FloatArray, spread: FloatArray) -> FloatArray:
    """(n, n) linear map of errors with the covariance ``centre`` to errors with the positive part of ``spread`` added.

    Combinations that are known keep their small errors next to those that are not: a factor for each parameter would
    give them a part of the errors of the others.
    """
    variances, axes = np.linalg.eigh(centre)
    sizes = np.sqrt(np.maximum(variances, 1e-12 * variances.max()))
    more, directions = np.linalg.eigh((axes.T @ spread @ axes) / np.outer(sizes, sizes))
    factors = (directions * np.sqrt(1.0 + np.maximum(more, 0.0))) @ directions.T
    return np.asarray((axes * sizes) @ factors @ (axes / sizes).T)


def yaw_alone_covariance(data: PlanarData, best: PlanarOptimum) -> FloatArray:
    """(q, q) further covariance where thrusters push along surge and sway, and neither is measured.

    Drift turns a hull (Munk moment). The model of yaw alone counts that among the torques that it may lack. Without
    effects its parameters are another answer, too: the covariance includes the difference.
    """
    names = list(best.model.names)
    added = np.zeros((len(names), len(names)))
    try:
        runs = prepare_trials([run.trial for run in data.runs], data.vehicle).items
        own = fit_likelihood(runs, data.vehicle).estimate
    except DataError:
        return added
    base = ("inertia", "linear_drag", "quadratic_drag")
    at, other = ([where.index(f"{axis}{name}") for name in base] for where, axis in ((names, "yaw."), (own.names, "")))
    shift = (own.values[other] - best.model.values[at]) * (not best.effects)
    added[np.ix_(at, at)] = own.covariance[np.ix_(other, other)] + np.outer(shift, shift)
    return added


def misfit_variance(best: PlanarOptimum, r2: Mapping[str, float], scale: FloatArray) -> FloatArray:
    """(q,) further variance of the parameters of axes where the model misses a force: its disturbance is at its limit.

    A missing force with the share f of all forces moves the coefficient of a force, to which it has the correlation c,
    by f c of its ``scale``, at which that force is as large as all (specification error; Theil 1957). The root of
    1 - ``r2`` of the free-running speed stands for f, and any value between -1 and 1 for c: its variance is 1/3.
    """
    limited = dict(zip(AXIS_NAMES, best.limited.tolist(), strict=True))
    shares = {name: 1.0 - value for name, value in r2.items() if value < INNOVATIONS_R2 and limited[name]}
    found = np.zeros(len(scale))
    for at, name in enumerate(best.coordinates.base_names):
        axes = "sway_yaw" if name.startswith("rudder") else name
        found[at] = min(max((share for axis, share in shares.items() if axis in axes), default=0.0), 1.0)
    return np.asarray(found * scale**2 / 3.0)


def with_variance(covariance: FloatArray, at: int, variance: float) -> FloatArray:
    """(q, q) ``covariance`` with another ``variance`` of the parameter ``at``.

    The other parameters follow it as they do in the ``covariance``: the motion in the runs stays the same.
    """
    before = max(float(covariance[at, at]), 1e-300)
    along = covariance[:, at] / before
    return np.asarray(covariance + (variance - before) * np.outer(along, along))


def with_rigid_body(covariance: FloatArray, values: FloatArray, mass: float | None) -> FloatArray:
    """(q, q) ``covariance`` of the ``values`` of a model, whose inertias include what they lack of the ``mass``.

    No added mass is negative: what an inertia of surge or sway lacks is an error that the logs do not show.
    """
    if mass is None:
        return covariance
    for at in (0, 1):
        lack = max(mass - float(values[at]), 0.0)
        covariance = with_variance(covariance, at, float(covariance[at, at]) + lack**2)
    return covariance


def parameter_scale(best: PlanarOptimum) -> FloatArray:
    """(q,) sizes of the model parameters at which each would matter as much as all forces of its axis."""
    coordinates, base = best.coordinates, best.model.base
    scale = coordinates.units[: coordinates.noise_begin].copy()
    # Of an inertia its own size. Of a drag the total damping of its axis at the usual speed.
    scale[:3] = base[:3]
    scale[3] = math.sqrt(base[1] * base[2])
    speed = coordinates.sizes.speed
    by_speed = np.hstack((np.eye(3), np.diag(speed)))
    total = by_speed @ base[4:10]
    error = np.sqrt(np.maximum(np.diag(by_speed @ best.covariance[4:10, 4:10] @ by_speed.T), 0.0))
    # A total that is known no better than its error does not make a drag small: the usual force does, if it is smaller.
    least = np.minimum(scale[4:7], np.where(total > 0.0, total, np.inf))
    damping = np.where(total > error, total, least)
    scale[4:7], scale[7:10] = damping, damping / speed
    own = np.abs(coordinates.values(best.x))
    # Of a rudder and of an effect its own size, if that is larger than the scale.
    scale[BASE_COUNT:] = np.maximum(scale[BASE_COUNT:], own[BASE_COUNT:])
    return scale


@dataclass(frozen=True, kw_only=True)
class Undetermined:
    """A combination of parameters along which the data hardly change the likelihood."""

    combination: Mapping[str, float]  #: Parameter -> its share in SI; the largest relative change is that of 1.
    text: str  #: A sentence for people.


def undetermined_directions(
    names: Sequence[str], covariance: FloatArray, scale: FloatArray, free: BoolArray
) -> tuple[tuple[Undetermined, ...], tuple[str, ...]]:
    """Undetermined combinations, and the names of the parameters that are refused because of them.

    ``names``, ``covariance``, ``scale``: (q,) parameters, (q, q) covariance and (q,) typical sizes in SI.
    ``free``: (q,) parameters that were estimated.
    """
    own = np.flatnonzero(free & (scale > 0.0))
    scaled = covariance[np.ix_(own, own)] / np.outer(scale[own], scale[own])
    if not np.isfinite(scaled).all():
        return (), tuple(names[at] for at in own.tolist())
    errors = np.sqrt(np.maximum(np.diag(scaled), 0.0))
    refused = tuple(names[at] for at, error in zip(own.tolist(), errors, strict=True) if error > MAX_ERROR)
    values, vectors = np.linalg.eigh(scaled)
    found = []
    for value, vector in sorted(zip(values, vectors.T, strict=True), key=lambda pair: -pair[0]):
        if value <= MAX_ERROR**2:
            break
        shares = {names[at]: float(share) for at, share in zip(own.tolist(), vector, strict=True)}
        largest = max(shares, key=lambda name: abs(shares[name]))
        listed = {name: share / shares[largest] for name, share in shares.items()}
        listed = {name: share for name, share in listed.items() if abs(share) >= _LEAST_SHARE}
        # Many small errors may add up in a direction although each parameter is known well enough.
        if not set(refused).isdisjoint(listed):
            found.append(Undetermined(combination=listed, text=_text(listed)))
    return tuple(found), refused


def _text(listed: Mapping[str, float]) -> str:
    if len(listed) == 1:
        (name,) = listed
        return f"{name} has next to no influence on what these runs measure."
    first, *others = sorted(listed, key=lambda name: -abs(listed[name]))
    parts = [f"{name} {'grows' if listed[name] > 0.0 else 'falls'}" for name in (first, *others[:_NAMED])]
    if rest := len(others) - _NAMED:
        parts.append(f"{rest} more change" if rest > 1 else "another one changes")
    text = "These runs do not determine each of these parameters: their measurements hardly change if"
    return f"{text} {join_words(parts)}, each by a share of its own."


@dataclass(frozen=True, kw_only=True)
class PriorUse:
    """What the prior decided in a fit."""

    values: Mapping[str, PriorValue] = field(default_factory=dict)
    decided: tuple[str, ...] = ()  #: Parameters on which the logs alone hold less than half of the information.
    only_by_prior: tuple[Undetermined, ...] = ()  #: Combinations that the logs alone do not determine.
    contradictions: tuple[str, ...] = ()  #: Full sentences.

    @classmethod
    def of(cls, best: PlanarOptimum, covariance: FloatArray, scale: FloatArray, refused: Mapping[str, str]) -> PriorUse:
        """The use of the prior in a fit with this (q, q) ``covariance``; see `undetermined_directions`."""
        prior = best.likelihood.grid.prior
        if prior is None:
            return cls()
        names, coordinates = best.model.names, best.coordinates
        free = coordinates.free[: coordinates.noise_begin]
        alone = replace(best, likelihood=best.likelihood.of_logs)
        combinations, _ = undetermined_directions(names, alone.covariance, scale, free)
        most = _DECIDED * np.diag(alone.covariance)
        smaller = (np.diag(best.covariance) <= most) & (most > 0.0)
        decided = [name for name, one in zip(names, smaller, strict=True) if one and name not in refused]
        at = prior.index(names)
        known = prior.slopes(best.model.values[at]) * np.sqrt(np.diag(covariance)[at]) / prior.width
        return cls(
            values=prior.values,
            decided=tuple(decided),
            only_by_prior=tuple(one for one in combinations if not set(decided).isdisjoint(one.combination)),
            contradictions=tuple(_contradictions(prior, best, known)),
        )


def _contradictions(prior: PlanarPrior, best: PlanarOptimum, known: FloatArray) -> Iterator[str]:
    """Parameters whose prior the logs, and the other priors, contradict.

    ``known`` are the (k,) standard errors of the fit, in those of the prior. The estimate without one prior follows
    from the fit by the rules of normal densities; its error is that by the curvature at least.
    """
    rows = prior.jacobian(best.coordinates, best.x)
    curved = np.einsum("ki,ij,kj->k", rows, inverse_information(best.equations.information), rows)
    shifts = prior.errors(best.coordinates, best.x).error / prior.width
    for number, (name, one) in enumerate(prior.values.items()):
        share = 1.0 - float(curved[number])  # Of the information that is not the prior's.
        if not rows[number].any() or share < _LEAST_OTHER:
            continue
        shift = float(shifts[number]) / share
        error = max(float(known[number]), math.sqrt(float(curved[number]))) / math.sqrt(share)
        apart = abs(shift) / math.hypot(error, 1.0)
        if apart <= _CONTRADICTION:
            continue
        place = "by the logs"
        if share < _DECIDED:  # Too far to extrapolate.
            shift, error, place = float(shifts[number]), float(known[number]), "in the fit with the prior"
        width, is_logarithm = float(prior.width[number]), bool(prior.is_logarithm[number])
        value = one.value * math.exp(shift * width) if is_logarithm else one.value + shift * width
        spread = error * width * (value if is_logarithm else 1.0)
        yield (
            f"The logs contradict the prior of {name} by {apart:.1f} standard errors: "
            f"{plus_minus(one.value, one.standard_error)} {unit_of(name)} by {one.source}, "
            f"{plus_minus(value, spread)} {unit_of(name)} {place}. Check the source and the thrust curves, or leave "
            "this prior out."
        )
