"""From the slopes of a cost to the covariance of what was fitted."""

from __future__ import annotations

import numpy as np

from rovid.core.array_types import FloatArray

# Of the largest eigenvalue, which is about one: below it the likelihood is flat.
_FLAT = 1e-9


def inverse_information(information: FloatArray) -> FloatArray:
    """Inverse of the information; a direction in which the likelihood is flat gets a large variance."""
    power = np.diag(information)
    size = np.sqrt(np.where(power > 0.0, power, 1.0))
    # Scaled, so that units have no say in what counts as flat.
    scale = np.outer(size, size)
    values, vectors = np.linalg.eigh(information / scale)
    scaled = (vectors / np.maximum(values, _FLAT)) @ vectors.T
    return np.asarray(scaled / scale)


def sandwich_covariance(bread: FloatArray, scores: FloatArray) -> FloatArray:
    """(p, p) covariance where the (m, p) scores scatter more than the information, whose inverse is ``bread``, says."""
    scores = scores - scores.mean(axis=0)
    count = len(scores)
    scatter = scores.T @ scores * count / (count - 1)
    return np.asarray(bread @ scatter @ bread)
