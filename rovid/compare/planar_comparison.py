"""Comparison of two campaigns by the coupled model."""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from rovid.compare.comparison import cut_short
from rovid.core.errors import ConfigError
from rovid.diagnose.result import Finding
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects import Effect
from rovid.model.parameter_names import PLANAR_UNITS
from rovid.model.simulation import FitMeasures
from rovid.planar.diagnosis import PlanarDiagnosis
from rovid.planar.trial_simulation import pooled_measures
from rovid.store.load import read_parameters
from rovid.store.parameter_file import Entry, Parameters
from rovid.store.planar_study import PlanarStudy, open_planar_study, planar_effect, with_fit
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import PLANAR

# Probability of a false change among all parameters of a comparison without one; a decision.
_FALSE_CHANGE = 0.01
# Joint standard errors of a change that is detected in nearly all comparisons; a decision.
_DETECTABLE = 4.0
_INERTIAS = ("surge.inertia", "sway.inertia", "yaw.inertia")


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarCampaign:
    """The parameters of one campaign, and its logs where there are any."""

    name: str
    parameters: Parameters
    study: PlanarStudy | None = None
    is_cut_short: bool = False  #: Whether its diagnosis ended before every cause was tried.
    suspects: tuple[Finding, ...] = ()  #: Of its diagnosis.

    @property
    def doubts(self) -> Iterator[str]:
        """Clauses on what may explain a difference of parameters without a change of the vehicle."""
        if self.is_cut_short:
            yield cut_short(self.name)
        if self.parameters.missing:
            yield f"{self.name}: {self.parameters.missing}, so its parameters may stand for something else"
        for one in self.suspects:
            if one.probability >= THRESHOLDS.likely:
                words = f"{one.effect.title} (confidence {one.probability:.2f})"
                yield f"the diagnosis of {self.name} suspects {words}, which may explain differences"


@dataclass(frozen=True, kw_only=True)
class PlanarChange:
    """One parameter in both campaigns."""

    name: str
    a: Entry
    b: Entry
    ratio: float  #: B over A; NaN where A is zero, and of directions.
    standard_error: float  #: Of the ratio, or of the difference of directions.
    confidence: float  #: Probability that the difference is no chance, allowing for the number of parameters.
    changed: bool
    difference: float = math.nan  #: B less A in rad, of directions.


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarComparison:
    """Result of `rovid compare --axes planar`."""

    verdict: str  #: "same", "changed" or "cannot_tell".
    a: PlanarCampaign
    b: PlanarCampaign
    changes: tuple[PlanarChange, ...]
    #: (model of, runs of), as ("a", "b") -> speed -> agreement; without logs absent.
    predictions: Mapping[tuple[str, str], Mapping[str, FitMeasures]]
    #: Inertia -> smallest relative change that nearly always would be found.
    detectable: Mapping[str, float]

    @property
    def open_questions(self) -> list[str]:
        """Clauses on what else may explain a difference, or was not tried."""
        return [clause for side in (self.a, self.b) for clause in side.doubts]

    @property
    def changed(self) -> list[str]:
        """Names of the changed parameters."""
        return [change.name for change in self.changes if change.changed]

    @property
    def assumptions(self) -> Assumptions:
        """Guesses that either campaign depends on."""
        guesses = Assumptions()
        for side in (self.a, self.b):
            if side.parameters.settings is not None:
                guesses |= side.parameters.settings.assumptions
        return guesses


def planar_campaigns(
    paths: tuple[Path, Path], report: Callable[[str], None], budget: float | None = None
) -> tuple[PlanarCampaign, PlanarCampaign]:
    """The campaigns of two parameter files or folders of logs.

    Folders are diagnosed, and fitted with the causes of either campaign; causes of one day stay with their own. Raises
    ConfigError if a parameter file holds the parameters of one axis.
    """
    sides = [_opened(path, report, budget) for path in paths]
    shared = [effect for _, _, effects, _ in sides for effect in effects if not effect.environmental]
    found = []
    for path, (stored, study, effects, diagnosis) in zip(paths, sides, strict=True):
        parameters = stored or Parameters(path=path, axis=PLANAR)
        if study is not None and stored is None:
            report(f"Fitting {path.name} …")
            fit = study.fit(tuple(dict.fromkeys((*shared, *effects))))
            parameters = with_fit(parameters, fit, study.provenance)
        campaign = PlanarCampaign(
            name=str(path),
            parameters=parameters,
            study=study,
            is_cut_short=diagnosis is not None and diagnosis.is_cut_short,
            suspects=() if diagnosis is None else diagnosis.suspects,
        )
        found.append(campaign)
    return found[0], found[1]


def _opened(
    path: Path, report: Callable[[str], None], budget: float | None
) -> tuple[Parameters | None, PlanarStudy | None, list[Effect], PlanarDiagnosis | None]:
    """A parameter file and its logs as far as they exist, or None and a folder's logs; causes; the diagnosis."""
    if path.is_file():
        stored = read_parameters(path)
        if stored.axis is not PLANAR:
            text = f"holds the parameters of {stored.axis.name}, but --axes is planar."
            raise ConfigError(text, where=path, mend="Give the file of another fit.")
        has_logs = bool(stored.logs) and all(log.exists() for log in stored.logs)
        study = open_planar_study(stored.logs) if has_logs else None
        return stored, study, list(map(planar_effect, stored.effects)), None
    study = open_planar_study([path])
    report(f"Diagnosing {path.name} …")
    found = study.diagnosis(report, budget=budget)
    effects = [] if found.extended is None else [one.effect for one in found.extended.fit.model.effects]
    return None, study, effects, found


def compare_planar(a: PlanarCampaign, b: PlanarCampaign, *, relevant_change: float) -> PlanarComparison:
    """Compare two campaigns; a change of an inertia by ``relevant_change`` has to be detectable for "same"."""
    ours, others = a.parameters.entries, b.parameters.entries
    # A prior of both sides makes them alike.
    names = [name for name in ours if name in others and not (ours[name].from_prior or others[name].from_prior)]
    doubts = [*a.doubts, *b.doubts]
    changes = tuple(_change(name, ours[name], others[name], len(names)) for name in names)
    detectable = {one.name: _DETECTABLE * one.standard_error for one in changes if one.name in _INERTIAS}
    if doubts:
        # What a model misses changes its parameters, too.
        changes = tuple(replace(change, changed=False) for change in changes)
    verdict = "same"
    if any(change.changed for change in changes):
        verdict = "changed"
    elif doubts or not detectable or not all(limit <= relevant_change for limit in detectable.values()):
        verdict = "cannot_tell"
    predictions, sides = {}, {"a": a, "b": b}
    for one, other in (("a", "b"), ("a", "a"), ("b", "b"), ("b", "a")):
        study = sides[other].study
        if study is not None:
            simulations = study.simulate(study.model(sides[one].parameters))
            predictions[one, other] = pooled_measures(simulations)
    return PlanarComparison(verdict=verdict, a=a, b=b, changes=changes, predictions=predictions, detectable=detectable)


def _change(name: str, a: Entry, b: Entry, count: int) -> PlanarChange:
    joint = math.hypot(a.standard_error, b.standard_error)
    chance, difference, is_direction = 1.0, b.value - a.value, name.endswith(".direction")
    if is_direction:
        difference = math.remainder(difference, 2.0 * math.pi)
    if 0.0 < joint < math.inf:
        chance = min(1.0, count * math.erfc(abs(difference) / joint / math.sqrt(2.0)))
    ratio = b.value / a.value if a.value and not is_direction else math.nan
    error = joint if is_direction else math.nan
    if math.isfinite(ratio):
        error = math.hypot(b.standard_error / a.value, ratio * a.standard_error / a.value)
    # Only the base parameters belong to the vehicle: a current or a constant force may differ from day to day.
    key = "" if name in PLANAR_UNITS else name.rpartition(".")[0]
    environmental = bool(key) and not key.startswith("rudder") and planar_effect(key).environmental
    return PlanarChange(
        name=name,
        a=a,
        b=b,
        ratio=ratio,
        standard_error=error,
        confidence=1.0 - chance,
        changed=chance < _FALSE_CHANGE and not environmental,
        difference=difference if is_direction else math.nan,
    )
