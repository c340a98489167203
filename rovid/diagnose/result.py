"""What a diagnosis says: findings and suspects, before and after, what is left."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from rovid.design.experiment_design import ExperimentPlan
from rovid.diagnose.bic import Alternative
from rovid.diagnose.cross_validation import HeldOutScores
from rovid.diagnose.tables import TableDiagnosis
from rovid.effects import Effect
from rovid.estimate.estimate import Estimate
from rovid.model.model import Model
from rovid.trial.vehicle import Vehicle

# No data along one axis show these: the same motion comes of other inertia and drag.
NEVER_IDENTIFIABLE = ("thrust_scale", "rate_scale")
UNIDENTIFIABLE = {
    "thrust_scale": "a common scale of all thrust",
    "rate_scale": "a constant scale of the rate",
    "thruster_imbalance": "an imbalance between thrusters",
    "inertia": "the inertia, and with it the size of every torque and drag, where nothing drives the vehicle",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Finding:
    """One cause that was named, or is suspected.

    Attributes
    ----------
    estimate
        Of the parameters of ``effect`` alone.
    gain
        Log-likelihood that the effect gains.
    worth
        The same less the price of its parameters, as that of its rivals is.
    held_out_gain
        The same on trials that were not fitted.
    confidence
        Probability that the cause, or one of those not told from it, acts.
    rivals
        Other causes in its place, best first.
    undecided
        Those of them that these data do not rule out, and causes that could not be tried for want of a signal.
    plan
        Runs that would tell it from the first of those; None where it is decided.
    """

    effect: Effect
    estimate: Estimate
    gain: float
    bic_gain: float
    held_out_gain: float
    probability: float
    alternatives: tuple[Alternative, ...]
    indistinguishable: tuple[Effect, ...]
    plan: ExperimentPlan | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelAssessment:
    """One of the two models: its estimate, its free-running model and how it does on trials not fitted."""

    model: Model
    estimate: Estimate
    held_out: HeldOutScores


@dataclass(frozen=True, kw_only=True)
class HorizonErrors:
    """RMS position error so many ``seconds`` after a restart, in rad or m, on trials that were not fitted."""

    seconds: float
    base: float
    extended: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Diagnosis:
    """What `rovid diagnose` says.

    Attributes
    ----------
    verdict
        found, suspected, nothing_found, unexplained or too_little_data.
    base, extended
        None where there was too little data.
    findings
        What is established, the strongest first.
    suspects
        What is likely or possible, the most likely first; it is not in the extended model.
    horizons
        How far both models are off from half to eight time constants ahead.
    signals
        Logged signals that drive what no effect explains, each with its worth.
    unexplained_share
        Variance of the disturbance torque over that of all torque, the thrusters' and its own.
    between
        Models with some of what was found, where there is more than one: each combination of up to three causes; of
        more, the strongest, the two strongest, and so on.
    noise_floor
        In the unit of the rate; what a perfect model would miss of it.
    position_floors
        Horizon in s -> rad or m that a perfect model would be off that far after a restart; NaN where it is not known.
    detectable
        Each effect that was not found, and the size of its first parameter that would have been seen, in its unit;
        infinite where none would.
    missing
        What there is too little of.
    amplitudes
        What tables show, where there are no logs.
    """

    verdict: str
    base: ModelAssessment | None = None
    extended: ModelAssessment | None = None
    findings: tuple[Finding, ...] = ()
    suspects: tuple[Finding, ...] = ()
    horizons: tuple[HorizonErrors, ...] = ()
    signals: tuple[tuple[Effect, float], ...] = ()
    unexplained_share: float = math.nan
    nested_models: tuple[Model, ...] = ()
    noise_floor: float = math.nan
    position_floors: Mapping[float, float] = field(default_factory=dict)
    detectable: tuple[tuple[Effect, float], ...] = ()
    warnings: tuple[str, ...] = ()
    missing: str = ""
    from_tables: TableDiagnosis | None = None

    @property
    def detectable_sizes(self) -> dict[str, float]:
        """Effect's id -> size of its first parameter that would have been seen, of those that were not found."""
        return {effect.id: size for effect, size in self.detectable}


def unidentifiable_parameters(vehicle: Vehicle) -> tuple[str, ...]:
    """What data of ``vehicle`` cannot show at all."""
    # Tables know their torque without a thruster; logs without one are of what rights itself.
    if not vehicle.thrusters and vehicle.axis.self_righting:
        return ("inertia", "rate_scale")
    thrusters = [thruster for thruster in vehicle.thrusters if thruster.curve is not None]
    if len(thrusters) > 1:
        return NEVER_IDENTIFIABLE
    return (*NEVER_IDENTIFIABLE, "thruster_imbalance")
