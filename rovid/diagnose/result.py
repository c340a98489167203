"""Result of a diagnosis: findings, suspects, models with their scores, and the next experiment."""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from rovid.core.budget import BudgetUse
from rovid.diagnose.candidate_fits import Alternative, Challenger
from rovid.diagnose.cross_validation import HeldOutScores
from rovid.diagnose.evidence import Evidence, grade
from rovid.diagnose.signal_regressors import signal_name
from rovid.diagnose.tables import TableDiagnosis
from rovid.effects import Effect, effect_named
from rovid.effects.clock_offset import CLOCKS_APART
from rovid.effects.further_terms import trials_in_form
from rovid.estimate.estimate import Estimate
from rovid.estimate.experiment_design import CandidateModel, ExperimentPlan, commands_by_name
from rovid.model.model import Model
from rovid.trial.fault import Fault
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle

# Parameters that no data along one axis identify: other inertia and drag give the same motion.
NEVER_IDENTIFIABLE = ("thrust_scale", "rate_scale")
UNIDENTIFIABLE = {
    "thrust_scale": "a common factor on all thrust",
    "rate_scale": "a constant factor on the rate",
    "thruster_imbalance": "an imbalance between thrusters",
    "inertia": "the inertia, and with it the size of every torque and drag, where nothing drives the vehicle",
}
# Effects that a clock offset between commands and motion, or a delay of the sensor, resembles.
DELAYS = ("command_delay", "thruster_lag")
# Runs that separate two causes best; for other pairs, the run that shows one of them.
DISCRIMINATING_RUNS = {
    frozenset({"command_delay", CLOCKS_APART.id}): CLOCKS_APART.experiment,
    frozenset({"thruster_lag", "command_delay"}): "a fast pseudo-random command, 1 to 3 s a level",
    frozenset({"entrained_swirl", "tether_torsion"}): "six turns one way, rest, and six turns back",
    frozenset({"coulomb_resistance", "drag_curvature"}): "coast-downs to rest and the slowest possible holds",
    frozenset({"bias_torque", "thrust_asymmetry"}): "a coast-down to rest without commands, and holds of both signs",
    frozenset({"bias_torque", "drag_asymmetry"}): "a coast-down to rest without commands",
    frozenset({"thrust_asymmetry", "drag_asymmetry"}): "sines from 10 to 80 s, and coast-downs from both directions",
    frozenset({"oscillatory_drag", "added_mass_memory"}): "coast-downs from a long turn; sines from 10 to 160 s",
    frozenset({"added_mass_memory", "thruster_lag"}): "a fast pseudo-random command; sines from 5 to 160 s",
    frozenset({"thruster_deadband", "supply_sag"}): "a low-speed staircase through neutral, both ways",
    frozenset({"oscillatory_drag", "entrained_swirl"}): "coast-downs from turns of different length",
    frozenset({"command_hysteresis", "command_delay"}): "a slow staircase up and down through neutral",
    frozenset({"speed_dependent_damping", "advance_speed_loss"}): "coast-downs of the rate at several speeds ahead",
    frozenset({"sideslip_moment", "bias_torque"}): "the same sideways drift in both directions",
    frozenset({"restoring_curve", "drag_curvature"}): "releases from a large and from a small tilt",
    frozenset({"drag_curvature", "supply_sag"}): "coast-downs and holds, with the supply's voltage in the log",
}
# Least RMS rate error of the plain model, in noise floors, with a stated share: an error of a third in the mean square
# of the floor then changes the removable error by no more than a tenth. Decision.
_ABOVE_FLOOR = 2.0
# Share of the probability of a cause that is its own, where the logs do not distinguish it from something else.
EVEN = 0.5


@dataclass(frozen=True, eq=False)
class OtherCause:
    """Another effect in the place of a cause, in its best form, with its BIC gain there; without its fit."""

    effect: Effect
    bic_gain: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Finding:
    """An established or suspected cause."""

    effect: Effect
    estimate: Estimate  #: Parameters of ``effect`` alone.
    #: ``gain``, ``bic_gain``, ``held_out_gain``: log-likelihood gain of the effect in nats: in the fit, less its BIC
    #: penalty, and on held-out trials.
    gain: float
    bic_gain: float
    held_out_gain: float
    #: Distance of the size from its value without the effect: in standard errors; of several sizes, Mahalanobis'.
    standard_errors: float
    probability: float  #: Probability that the cause, or an indistinguishable one, acts.
    alternatives: tuple[Alternative | OtherCause, ...]  #: Other causes in its place, best first.
    #: Causes that these data do not rule out, including those that could not be tested without a logged signal.
    indistinguishable: tuple[Effect, ...]
    #: Runs that distinguish the cause from the first of those; None where it is decided.
    plan: ExperimentPlan | None = None
    white: bool = False  #: Whether the one-step prediction errors of the model are white.
    is_complete: bool = True  #: Whether the search came to its end.

    @property
    def evidence(self) -> Evidence:
        """Evidence for the cause; of several indistinguishable ones, none is confirmed.

        A cause is possible at most if another one in its place gains more, and was rejected for another reason. So is a
        size of its own in single trials, which describes the logs: no law relates the sizes to a load or to the time.
        """
        if trials_in_form(self.effect.form) or any(other.bic_gain > self.bic_gain for other in self.alternatives):
            return Evidence.POSSIBLE
        numbers = self.probability, self.held_out_gain, self.standard_errors
        return grade(*numbers, white=self.white, is_conclusive=self.is_complete and not self.indistinguishable)


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelAssessment:
    """One of the two models: free-running model, estimate, and scores on held-out trials."""

    model: Model
    estimate: Estimate
    held_out: HeldOutScores


@dataclass(frozen=True, kw_only=True)
class HorizonErrors:
    """RMS position error of both models in rad or m ``seconds`` after a restart, on held-out trials."""

    seconds: float
    base: float
    extended: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Conclusion:
    """What the diagnosis of any model concludes."""

    verdict: str  #: found, suspected, nothing_found, unexplained, too_little_data or bad_logs.
    #: ``findings``, ``suspects``: established causes, the largest gain first; likely or possible ones, the most
    #: probable first.
    findings: tuple[Finding, ...] = ()
    suspects: tuple[Finding, ...] = ()
    #: Logged signals that explain part of the motion, each with its BIC gain.
    signals: tuple[tuple[Effect, float], ...] = ()
    challengers: tuple[Challenger, ...] = ()  #: Other sets of causes, the closest to the established set first.
    #: Each effect that was not found, with the smallest detectable size of its first parameter; may be infinite.
    detectable: tuple[tuple[Effect, float], ...] = ()
    warnings: tuple[str, ...] = ()
    missing: str = ""  #: Message on the data that are missing.
    is_endless: bool = False  #: Whether the search ended though each addition asked for another: no lack of time.
    budget: BudgetUse | None = None  #: The time that the diagnosis was allowed, and that it took.

    @property
    def is_cut_short(self) -> bool:
        """Whether the budget ended before every cause was tried."""
        return self.budget is not None and bool(self.budget.not_tried)

    @property
    def is_settled(self) -> bool:
        """Whether every cause is confirmed, or none was found, and no run is needed to name the causes."""
        confirmed = all(finding.evidence is Evidence.CONFIRMED for finding in self.findings)
        complete = self.verdict == "found" or (self.verdict == "nothing_found" and not self.is_cut_short)
        return complete and confirmed and not self.suspects and not self.signals

    @property
    def causes(self) -> tuple[Finding, ...]:
        """Findings and suspects by evidence, the best first; then suspects by probability; then by held-out gain."""
        words, likely = list(Evidence), {id(one): -one.probability for one in self.suspects}

        def rank(one: Finding) -> tuple[float, ...]:
            return words.index(one.evidence), likely.get(id(one), -1.0), -one.held_out_gain, -one.standard_errors

        return tuple(sorted((*self.findings, *self.suspects), key=rank))


@dataclass(frozen=True, kw_only=True, eq=False)
class Diagnosis(Conclusion):
    """Result of `rovid diagnose`."""

    #: ``base``, ``extended``: model without, and with the established causes; None with too little data.
    base: ModelAssessment | None = None
    extended: ModelAssessment | None = None
    horizons: tuple[HorizonErrors, ...] = ()  #: Position errors after half to eight time constants.
    unexplained_share: float = math.nan  #: Variance of the disturbance torque over that of all torque.
    #: Models with some of the established causes: all subsets of up to three causes; of more, the strongest, the two
    #: strongest, and so on.
    nested_models: tuple[Model, ...] = ()
    noise_floor: float = math.nan  #: RMS rate error of a perfect model.
    #: Whether the extended model leaves something unexplained: the noise floor then contains the error by it.
    leaves_unexplained: bool = False
    #: Horizon in s -> RMS position error of a perfect model in rad or m; NaN where unknown.
    position_floors: Mapping[float, float] = field(default_factory=dict)
    faults: tuple[Fault, ...] = ()  #: Faults of the logs that the diagnosis found.
    #: The extended model with its disturbance and noise; None unless all predictions are one-step.
    fitted: CandidateModel | None = None
    from_tables: TableDiagnosis | None = None  #: Diagnosis of tables, where there are no logs.

    @property
    def removed_share(self) -> float | None:
        """Part of the removable mean square rate error that the extended model removes; None where it is not known.

        Removable is the mean square error of the plain model on held-out trials less that of a perfect model. Where
        the extended model leaves something unexplained, the share is an upper bound.
        """
        if self.base is None or self.extended is None:
            return None
        plain, extended = self.base.held_out.rate_rmse, self.extended.held_out.rate_rmse
        if not plain > _ABOVE_FLOOR * self.noise_floor:
            return None
        return (plain**2 - extended**2) / (plain**2 - self.noise_floor**2)

    @property
    def detectable_sizes(self) -> dict[str, float]:
        """Effect id -> smallest detectable size, of the effects that were not found."""
        return {effect.id: size for effect, size in self.detectable}


def doubted(diagnosis: Diagnosis, finding: Finding) -> Diagnosis:
    """The ``diagnosis`` with a ``finding`` as its first suspect: something else explains the logs as well."""
    findings = tuple(one for one in diagnosis.findings if one is not finding)
    suspects = (one for one in diagnosis.suspects if one.effect.id != finding.effect.id)
    suspect = replace(finding, probability=EVEN * finding.probability)
    verdict = "found" if findings else "suspected"
    return replace(diagnosis, verdict=verdict, findings=findings, suspects=(suspect, *suspects))


def not_identifiable(vehicle: Vehicle, diagnosis: Diagnosis | None = None) -> dict[str, str]:
    """Parameters of ``vehicle``, and effects of any size, that the data cannot identify; each with a description."""
    names = [*NEVER_IDENTIFIABLE[1 if vehicle.thrust_scale_error else 0 :]]
    if sum(thruster.curve is not None for thruster in vehicle.thrusters) < 2:
        names.append("thruster_imbalance")
    # Tables state their torque without a thruster. Logs without a thruster are of a self-righting axis.
    if not vehicle.thrusters and vehicle.axis.self_righting:
        names = ["inertia", "rate_scale"]
    found = {name: UNIDENTIFIABLE[name] for name in names}
    hidden = [] if diagnosis is None else [effect for effect, size in diagnosis.detectable if not math.isfinite(size)]
    return found | {effect.id: f"{effect.title}, of any size" for effect in hidden if effect.id not in found}


def discriminating_experiment(finding: Finding) -> dict[str, Any] | None:
    """The run that distinguishes ``finding`` from the nearest other cause; None where it is decided.

    With its commands, each held until the next, if the run is expected to be decisive.
    """
    if not finding.indistinguishable:
        return None
    other = finding.indistinguishable[0]
    untested = all(alternative.effect is not other for alternative in finding.alternatives)
    run, plan = _separating(finding.effect, other, untested=untested), finding.plan
    if plan is None or not plan.is_decisive:
        return run
    best = plan.best
    expected = {"minutes": best.run.seconds / 60.0, "expected_log_likelihood_ratio": best.gain}
    return run | {"run": best.run.name, **expected, "commands": commands_by_name(plan)}


def _separating(one: Effect, other: Effect, *, untested: bool = False) -> dict[str, Any]:
    """The run that separates two causes; where the ``other`` was not tested, the run that shows it."""
    pair = [one.id, other.id]
    run = other.experiment if untested else DISCRIMINATING_RUNS.get(frozenset(pair), one.experiment)
    return {"run": run, "separates": pair, "between": [one.key, other.key]}


def is_delay(effect: Effect, ids: Collection[str] = DELAYS) -> bool:
    """Whether ``effect`` has one of the ``ids`` and acts at all times, as a late clock or sensor does."""
    return effect.id in ids and effect.form != "reversal"


def delays_of_the_sensor(trials: Iterable[Trial], causes: Sequence[Finding]) -> list[str]:
    """Titles of the delays among the ``causes`` that the sensor may have, because no logged rate shows the motion."""
    delays = [cause.effect.title for cause in causes if is_delay(cause.effect)]
    return delays if all(trial.rate is None for trial in trials) else []


def first_experiment(diagnosis: Conclusion) -> dict[str, Any] | None:
    """The run that separates causes, or what has to be done before any run; None where neither is open."""
    if diagnosis.verdict == "bad_logs":
        run = "none yet: correct the fault of the logs, and repeat the diagnosis"
        return {"run": run, "reason": "no fit of these logs is valid"}
    for finding in (*diagnosis.findings, *diagnosis.suspects):
        discriminating = discriminating_experiment(finding)
        if discriminating is not None:
            return discriminating | {"reason": "more than one cause explains these data equally well"}
    if diagnosis.is_cut_short and not (diagnosis.causes or diagnosis.is_endless):
        run = "none yet: repeat the diagnosis with a larger --budget"
        return {"run": run, "reason": "the search ended before every cause was tried"}
    return None


def next_experiment(diagnosis: Diagnosis) -> dict[str, Any]:
    """The next run: one that separates causes, else one that shows the least certain or an unexcited effect."""
    step = first_experiment(diagnosis)
    if step is not None:
        return step
    if diagnosis.from_tables is not None and len(diagnosis.from_tables.causes) > 1:
        first, second, *_ = (cause.model.effects[0] for cause in diagnosis.from_tables.causes)
        return _separating(first, second) | {"reason": "the tables allow either"}
    if diagnosis.missing:
        return {
            "run": "holds of several levels both ways, sines of 20 to 80 s, and coast-downs to rest",
            "reason": "they excite all effects that a diagnosis tests",
        }
    if diagnosis.verdict == "unexplained":
        run = "a hold repeated first, in the middle and last"
        if diagnosis.signals:
            strongest, _ = diagnosis.signals[0]
            run = f"the same hold with {signal_name(strongest)} at two values"
        return {"run": run, "reason": "no effect of the catalogue explains the remaining error"}
    for finding in (*diagnosis.suspects, *diagnosis.findings):
        return {"run": finding.effect.experiment, "reason": f"it shows {finding.effect.title} by itself"}
    return {
        "run": effect_named("thruster_lag").experiment,
        "reason": "nothing is missing; fast commands improve the inertia and reveal timing errors first",
    }
