"""Combinations of parameters that the data do not determine, from the scaled covariance of a fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray

# Largest standard error of a determined combination, in units of its scale: three standard errors make one unit.
MAX_ERROR = 1.0 / 3.0
# Least share of a parameter in a combination that is listed.
_LEAST_SHARE = 0.1


@dataclass(frozen=True, kw_only=True)
class Undetermined:
    """A combination of parameters along which the data hardly change the likelihood."""

    combination: Mapping[str, float]  #: Parameter -> its share in SI; the largest relative change is that of 1.
    text: str  #: A sentence for people.


def undetermined_directions(
    names: Sequence[str], covariance: FloatArray, scale: FloatArray, free: BoolArray
) -> tuple[tuple[Undetermined, ...], tuple[str, ...]]:
    """Undetermined combinations, and the names of the parameters that are refused because of them.

    Parameters
    ----------
    names, covariance, scale
        (q,) parameters, (q, q) covariance and (q,) typical sizes in SI.
    free
        (q,) parameters that were estimated.
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
    signs = ("together" if listed[name] > 0.0 else "against it" for name in others)
    parts = ", ".join(f"{name} ({sign})" for name, sign in zip(others, signs, strict=True))
    return f"These runs hardly change if {first} and {parts} change in proportion; only other combinations are known."
