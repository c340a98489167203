"""Diagnosis of the planar model: named causes of what it predicts wrongly."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from rovid.core.budget import Budget, BudgetUse, ProgressCallback
from rovid.diagnose.candidate_fits import Challenger
from rovid.diagnose.result import Finding
from rovid.effects import Effect
from rovid.planar.dataset import PlanarData
from rovid.planar.fit import PlanarFit
from rovid.trial.fault import Fault


@dataclass(frozen=True, kw_only=True)
class PlanarScores:
    """Errors of a model on held-out parts of the logs, each predicted by a fit to the others."""

    log_likelihood: float  #: Of the innovations, in nats.
    #: surge_velocity, sway_velocity (m/s), yaw_rate (rad/s) -> RMS error of the free-running simulation.
    rmse: Mapping[str, float]
    heading_errors: Mapping[float, float]  #: Horizon in s -> RMS heading error in rad that far after a restart.


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarAssessment:
    """One of the two models, with its scores on held-out parts."""

    fit: PlanarFit
    held_out: PlanarScores


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarDiagnosis:
    """Result of `rovid diagnose --axes planar`; names and meaning are those of `rovid.diagnose.result.Diagnosis`."""

    verdict: str  #: found, suspected, nothing_found, unexplained, too_little_data or bad_logs.
    #: ``base``, ``extended``: model without, and with the established causes; None with too little data.
    base: PlanarAssessment | None = None
    extended: PlanarAssessment | None = None
    findings: tuple[Finding, ...] = ()
    suspects: tuple[Finding, ...] = ()
    challengers: tuple[Challenger, ...] = ()
    #: Axis (surge, sway, yaw) -> variance of the disturbance over that of the disturbance and all forces in use.
    unexplained_shares: Mapping[str, float] = field(default_factory=dict)
    #: As `PlanarScores.rmse` and `PlanarScores.heading_errors`, of a perfect model.
    noise_floors: Mapping[str, float] = field(default_factory=dict)
    heading_floors: Mapping[float, float] = field(default_factory=dict)
    #: Each effect that was not found, with the smallest detectable size of its first parameter; may be infinite.
    detectable: tuple[tuple[Effect, float], ...] = ()
    warnings: tuple[str, ...] = ()
    faults: tuple[Fault, ...] = ()
    missing: str = ""
    budget: BudgetUse | None = None


def diagnose_planar(
    data: PlanarData,
    report: ProgressCallback = lambda _: None,
    budget: Budget | None = None,
) -> PlanarDiagnosis:
    """Find the causes that the planar base model misses, within the ``budget``; ``report`` is called with each step."""
    raise NotImplementedError
