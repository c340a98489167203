"""Estimates of the same parameters in two campaigns, and the changes that may explain their difference."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.trial.assumptions import scales_with_thrust

THRUST_SCALE = "thrust_scale"
DRAG = "drag"
_DRAGS = ("quadratic_drag", "linear_drag")


@dataclass(frozen=True, kw_only=True, eq=False)
class EstimatePair:
    """Estimates of the same parameters in campaigns A and B."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    # a, b: (p,) values
    a: FloatArray
    b: FloatArray
    # covariance_a, covariance_b: (p, p) covariances
    covariance_a: FloatArray
    covariance_b: FloatArray
    white: bool  # Whether the innovations of both models are white
    samples: int  # Number of samples of both campaigns

    @property
    def difference(self) -> FloatArray:
        """(p,) values of B minus A."""
        return self.b - self.a

    @property
    def covariance(self) -> FloatArray:
        """(p, p) covariance of the difference."""
        return self.covariance_a + self.covariance_b

    @property
    def errors(self) -> FloatArray:
        """(p,) standard errors of the difference, which scale all computations."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def pooled(self) -> FloatArray:
        """(p,) inverse-variance weighted mean of A and B."""
        variances = [np.diag(self.covariance_a), np.diag(self.covariance_b)]
        weight_a, weight_b = (1.0 / np.maximum(variance, 1e-300) for variance in variances)
        return np.asarray((weight_a * self.a + weight_b * self.b) / (weight_a + weight_b))


@dataclass(frozen=True, kw_only=True, eq=False)
class ChangeCandidate:
    """A possible change."""

    name: str
    parameters: tuple[str, ...]  # Names of the parameters it affects
    directions: FloatArray  # (p, k) columns that span the change of the parameters
    is_factor: bool = True  # Whether all its parameters change by one factor
    # Whether the named quantity changes by the inverse factor: with less thrust all parameters that are measured
    # relative to thrust seem larger
    inverse: bool = False


def change_candidates(
    pair: EstimatePair, weak_thrusters: Sequence[str] = (), remaining_thruster: str = ""
) -> list[ChangeCandidate]:
    """Possible changes: of each parameter, of all drag together, of all thrust together, and of each cause.

    ``weak_thrusters`` are keys of thruster gains among the parameters; ``remaining_thruster`` has no gain.
    """
    names = pair.names
    candidates = [_factor(pair, name, (name,)) for name in names if "." not in name]
    if set(_DRAGS) <= set(names):
        candidates.append(_factor(pair, DRAG, _DRAGS))
    torques = [name for name, unit in zip(names, pair.units, strict=True) if scales_with_thrust(unit)]
    if "inertia" in torques:
        candidates.append(replace(_factor(pair, THRUST_SCALE, torques), inverse=True))
        gains = [name for name in names if name.rpartition(".")[0] in weak_thrusters]
        if remaining_thruster and gains:
            candidates.append(replace(_factor(pair, remaining_thruster, [*torques, *gains]), inverse=True))
    for key in dict.fromkeys(name.rpartition(".")[0] for name in names if "." in name):
        own = tuple(name for name in names if name.rpartition(".")[0] == key)
        directions = np.array([[float(name == parameter) for parameter in own] for name in names])
        directions *= pair.errors[:, np.newaxis]
        candidates.append(ChangeCandidate(name=key, parameters=own, directions=directions, is_factor=False))
    return candidates


def _factor(pair: EstimatePair, name: str, parameters: Sequence[str]) -> ChangeCandidate:
    """A change of the ``parameters`` by one factor."""
    affected = [parameter in parameters for parameter in pair.names]
    direction = np.where(affected, pair.pooled, 0.0)
    # Parameters that are zero in both campaigns cannot change by a factor. The error is the step then.
    if not np.any(np.abs(direction) > 0.0):
        direction = np.where(affected, pair.errors, 0.0)
    return ChangeCandidate(name=name, parameters=tuple(parameters), directions=direction[:, np.newaxis])
