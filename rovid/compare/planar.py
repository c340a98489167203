"""Comparison of two campaigns by the coupled model of surge, sway and yaw."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rovid.core.errors import ConfigError
from rovid.effects import Effect
from rovid.model.parameter_names import PLANAR_UNITS
from rovid.model.simulation import FitMeasures
from rovid.planar.model import PlanarModel
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

    def model_for(self, other: "PlanarCampaign") -> PlanarModel | None:
        """The model of these parameters on the vehicle of ``other``; None without logs there."""
        return None if other.study is None else other.study.model(self.parameters)


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
    shared = [effect for side in sides for effect in side.effects if not effect.environmental]
    return _fitted(sides[0], shared, report), _fitted(sides[1], shared, report)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Opened:
    """A parameter file with its logs as far as they exist, or a folder of logs with the causes in it."""

    path: Path
    stored: Parameters | None
    study: PlanarStudy | None
    effects: tuple[Effect, ...]


def _opened(path: Path, report: Callable[[str], None]) -> _Opened:
    if path.is_file():
        stored = read_parameters(path)
        if stored.axis is not PLANAR:
            text = f"holds the parameters of {stored.axis.name}, but --axes is planar."
            raise ConfigError(text, where=path, mend="Give the file of another fit.")
        has_logs = bool(stored.logs) and all(log.exists() for log in stored.logs)
        study = open_planar_study(stored.logs) if has_logs else None
        return _Opened(path=path, stored=stored, study=study, effects=tuple(map(planar_effect, stored.effects)))
    study = open_planar_study([path])
    report(f"Diagnosing {path.name} …")
    extended = study.diagnosis(report).extended
    effects = () if extended is None else tuple(one.effect for one in extended.fit.model.effects)
    return _Opened(path=path, stored=None, study=study, effects=effects)


def _fitted(side: _Opened, shared: Sequence[Effect], report: Callable[[str], None]) -> PlanarCampaign:
    """The campaign of a file as it is; logs are fitted with the ``shared`` effects and their own."""
    stored = side.stored
    if stored is None and side.study is not None:
        report(f"Fitting {side.path.name} …")
        fit = side.study.fit(tuple(dict.fromkeys((*shared, *side.effects))))
        stored = with_fit(Parameters(path=side.path, axis=PLANAR), fit, side.study.provenance)
    return PlanarCampaign(name=str(side.path), parameters=stored or Parameters(path=side.path), study=side.study)


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
    predictions = {}
    for (one, model_of), (other, runs_of) in (
        (("a", a), ("b", b)), (("a", a), ("a", a)), (("b", b), ("b", b)), (("b", b), ("a", a))
    ):  # fmt: skip
        model = model_of.model_for(runs_of)
        if model is not None and runs_of.study is not None:
            predictions[one, other] = pooled_measures(runs_of.study.simulate(model))
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
