"""Knowledge of the parameters from elsewhere: its penalty in a fit, and what it decides next to the logs.

The prior of an inertia is normal in its logarithm, that of any other parameter in the parameter. Its negative logarithm
is added to every criterion of the coupled model as one more error a parameter, with the variance of the prior. So all
models of a search have the same penalty terms, and each difference of their criteria is a difference of log posterior
densities. Held-out gains do not contain it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray, IntArray
from rovid.core.formatting import plus_minus
from rovid.estimate.fisher_information import Innovations, inverse_information
from rovid.model.parameter_names import unit_of
from rovid.planar.coordinates import PlanarCoordinates, Undetermined, undetermined_directions
from rovid.planar.model import PlanarModel

if TYPE_CHECKING:
    from rovid.planar.optimum import PlanarOptimum

# Largest variance over that by the logs alone, of a parameter that is said to come from the prior. A decision.
_DECIDED = 0.5
# Standard errors between the prior and the logs that are a contradiction.
_CONTRADICTION = 3.0
# Largest coupling of sway and yaw in the inertia of a start, as of a regression.
_MAX_COUPLING = 0.8
# Least share of the information on a parameter that is not the prior's, for a contradiction. A decision.
_LEAST_OTHER = 0.02


@dataclass(frozen=True, kw_only=True)
class PriorValue:
    """What is known of a parameter before the logs."""

    value: float  #: SI.
    standard_error: float  #: SI; of an inertia, the relative error is that of its logarithm.
    source: str  #: For people, as "strip theory".


@dataclass(frozen=True, eq=False)
class PlanarPrior:
    """Independent priors of base parameters and of coefficients of rudders."""

    values: Mapping[str, PriorValue]

    @cached_property
    def is_logarithm(self) -> BoolArray:
        """(k,) whether the prior is one of a logarithm."""
        return np.array([name.endswith(".inertia") and name != "sway_yaw.inertia" for name in self.values])

    @cached_property
    def _centre(self) -> FloatArray:
        return np.array([one.value for one in self.values.values()])

    @cached_property
    def width(self) -> FloatArray:
        """(k,) standard errors in the units of `scaled`."""
        return np.array([one.standard_error for one in self.values.values()]) * self.slopes(self._centre)

    def index(self, names: Sequence[str]) -> IntArray:
        """(k,) place of each parameter among the ``names`` of a model."""
        return np.array([names.index(name) for name in self.values], dtype=np.intp)

    def scaled(self, values: FloatArray) -> FloatArray:
        """(k,) logarithms of inertias, and the other ``values`` as they are."""
        return np.where(self.is_logarithm, np.log(np.where(self.is_logarithm, values, 1.0)), values)

    def slopes(self, values: FloatArray) -> FloatArray:
        """(k,) derivatives of `scaled`."""
        return 1.0 / np.where(self.is_logarithm, values, 1.0)

    def start(self, model: PlanarModel) -> PlanarModel:
        """The ``model`` with the values of the prior, and with a coupling of the inertias that these allow."""
        values = model.values.copy()
        values[self.index(model.names)] = self._centre
        most = _MAX_COUPLING * math.sqrt(values[1] * values[2])
        values[3] = np.clip(values[3], -most, most)
        return model.with_values(values)

    def errors(self, coordinates: PlanarCoordinates, x: FloatArray) -> Innovations:
        """(k,) differences of the parameters at ``x`` from the prior, and its variances."""
        own = coordinates.values(x)[self.index(coordinates.base_names)]
        return Innovations(self.scaled(own) - self.scaled(self._centre), self.width**2)

    def jacobian(self, coordinates: PlanarCoordinates, x: FloatArray) -> FloatArray:
        """(k, p) derivatives of `errors` by the coordinates, in the prior's standard errors; zeros for fixed ones."""
        at, found = self.index(coordinates.base_names), np.zeros((len(self.values), len(x)))
        slopes = self.slopes(coordinates.values(x)[at]) / self.width
        found[:, : coordinates.noise_begin] = coordinates.value_jacobian(x)[at] * slopes[:, None]
        return np.asarray(found * coordinates.free)


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
