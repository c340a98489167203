"""Comparison of two campaigns by the coupled model of surge, sway and yaw."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from rovid.core.errors import ConfigError
from rovid.effects import Effect
from rovid.model.parameter_names import PLANAR_UNITS
from rovid.model.simulation import FitMeasures
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


@dataclass(frozen=True, kw_only=True)
class PlanarChange:
    """One parameter in both campaigns."""

    name: str
    a: Entry
    b: Entry
    ratio: float  #: B over A; NaN where A is zero.
    standard_error: float  #: Of the ratio.
    confidence: float  #: Probability that the difference is no chance, allowing for the number of parameters.
    changed: bool


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


def planar_campaigns(paths: tuple[Path, Path], report: Callable[[str], None]) -> tuple[PlanarCampaign, PlanarCampaign]:
    """The campaigns of two parameter files or folders of logs.

    Folders are diagnosed, and fitted with the causes of either campaign; causes of one day stay with their own. Raises
    ConfigError if a parameter file holds the parameters of one axis.
    """
    sides = [_opened(path, report) for path in paths]
    shared = [effect for _, _, effects in sides for effect in effects if not effect.environmental]
    found = []
    for path, (stored, study, effects) in zip(paths, sides, strict=True):
        parameters = stored or Parameters(path=path, axis=PLANAR)
        if stored is None and study is not None:
            report(f"Fitting {path.name} …")
            fit = study.fit(tuple(dict.fromkeys((*shared, *effects))))
            parameters = with_fit(parameters, fit, study.provenance)
        found.append(PlanarCampaign(name=str(path), parameters=parameters, study=study))
    return found[0], found[1]


def _opened(path: Path, report: Callable[[str], None]) -> tuple[Parameters | None, PlanarStudy | None, list[Effect]]:
    """A parameter file with its logs as far as they exist, or None and a folder of logs; and the causes in either."""
    if path.is_file():
        stored = read_parameters(path)
        if stored.axis is not PLANAR:
            text = f"holds the parameters of {stored.axis.name}, but --axes is planar."
            raise ConfigError(text, where=path, mend="Give the file of another fit.")
        has_logs = bool(stored.logs) and all(log.exists() for log in stored.logs)
        return stored, open_planar_study(stored.logs) if has_logs else None, list(map(planar_effect, stored.effects))
    study = open_planar_study([path])
    report(f"Diagnosing {path.name} …")
    extended = study.diagnosis(report).extended
    return None, study, [] if extended is None else [one.effect for one in extended.fit.model.effects]


def compare_planar(a: PlanarCampaign, b: PlanarCampaign, *, relevant_change: float) -> PlanarComparison:
    """Compare two campaigns; a change of an inertia by ``relevant_change`` has to be detectable for "same"."""
    ours, others = a.parameters.entries, b.parameters.entries
    # A prior of both sides makes them alike.
    names = [name for name in ours if name in others and not (ours[name].from_prior or others[name].from_prior)]
    changes = tuple(_change(name, ours[name], others[name], len(names)) for name in names)
    detectable = {one.name: _DETECTABLE * one.standard_error for one in changes if one.name in _INERTIAS}
    verdict = "same"
    if any(change.changed for change in changes):
        verdict = "changed"
    elif not detectable or not all(limit <= relevant_change for limit in detectable.values()):
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
    chance = 1.0
    if 0.0 < joint < math.inf:
        chance = min(1.0, count * math.erfc(abs(b.value - a.value) / joint / math.sqrt(2.0)))
    ratio = b.value / a.value if a.value else math.nan
    error = math.nan
    if a.value:
        error = math.hypot(b.standard_error / a.value, ratio * a.standard_error / a.value)
    # Only the base parameters belong to the vehicle: a current or a constant force may differ from day to day.
    environmental = name not in PLANAR_UNITS and "." in name and _is_environmental(name)
    return PlanarChange(
        name=name,
        a=a,
        b=b,
        ratio=ratio,
        standard_error=error,
        confidence=1.0 - chance,
        changed=chance < _FALSE_CHANGE and not environmental,
    )


def _is_environmental(name: str) -> bool:
    key = name.rpartition(".")[0]
    return not key.startswith("rudder") and planar_effect(key).environmental
