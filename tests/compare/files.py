"""Parameter files of one fictitious vehicle."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from rovid.estimate.estimate import Estimate
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.store.parameter_file import Parameters, Provenance, Source
from rovid.trial.assumptions import ConfigFingerprint

LAG = "thruster_lag.time_constant"
PLAIN = {"inertia": (5000.0, 8.0), "quadratic_drag": (3500.0, 12.0), "linear_drag": (130.0, 3.0)}
LAGGING = {**PLAIN, LAG: (0.4, 0.004)}
DRIVE = {"yaw_arm of fore": "0.43", "curve of fore": "sha256 0", "yaw_arm of aft": "0.43", "curve of aft": "sha256 0"}


def stored_at(
    path: Path, values: Mapping[str, tuple[float, float]] = PLAIN, *, log: str = "a", drive: Mapping[str, str] = DRIVE
) -> Parameters:
    """A parameter file at ``path`` from a log of this name."""
    sizes = np.array(list(values.values()))
    estimate = Estimate(
        names=tuple(values),
        values=sizes[:, 0],
        covariance=np.diag(sizes[:, 1] ** 2),
        method=InnovationLikelihood.method,
        samples=10_000,
    )
    origin = Provenance(
        logs=(path.parent / log,),
        vehicle="a vehicle",
        sources=(Source(name=f"{log}.csv", sha256=log, samples=10_000),),
        settings=ConfigFingerprint(drive=drive),
    )
    written = Parameters(path=path).with_estimate(estimate, origin)
    written.write()
    return written


def times(factor: float, *names: str) -> dict[str, tuple[float, float]]:
    """`PLAIN` with some values multiplied."""
    return {name: (value * (factor if name in names else 1.0), error) for name, (value, error) in PLAIN.items()}
