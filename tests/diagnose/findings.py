"""Findings with given sizes."""

from __future__ import annotations

import numpy as np

from rovid.diagnose.result import Finding
from rovid.effects.base import Effect
from rovid.estimate.estimate import Estimate


def finding(effect: Effect, sizes: list[float]) -> Finding:
    """The finding of ``effect`` with these ``sizes`` and a standard error of 0.01 each."""
    count = len(effect.parameters)
    names = tuple(f"{effect.key}.{one.name}" for one in effect.parameters)
    # The mean of all sizes is known where the last one follows from the others.
    covariance = 1e-4 * (np.eye(count) - (1.0 / len(sizes) if len(sizes) > count else 0.0))
    estimate = Estimate(names=names, values=np.array(sizes[:count]), covariance=covariance, method="", samples=1000)
    return Finding(
        effect=effect,
        estimate=estimate,
        gain=100.0,
        bic_gain=80.0,
        held_out_gain=50.0,
        standard_errors=20.0,
        probability=0.99,
        alternatives=(),
        indistinguishable=(),
    )
