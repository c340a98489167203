"""Two campaigns side by side: what changed, which cause came or went, and whether either's model predicts the other."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rovid.compare.campaign_fit import CampaignFit, SharedEstimate, shared_effects, shared_estimate, with_diagnosis
from rovid.compare.difference_tests import (
    DRAG,
    RELEVANT_CHANGE,
    DifferenceTest,
    EstimatePair,
    change_candidates,
    test_difference,
)
from rovid.core.errors import ConfigError
from rovid.core.threads import thread_map
from rovid.effects import Effect
from rovid.effects.thruster_imbalance import EFFECT as IMBALANCE
from rovid.model.model import Model
from rovid.model.simulation import HORIZONS, TrialSimulation, pooled_fit, simulate_runs
from rovid.trial.config_fingerprint import ConfigFingerprint

# Of the vehicle as a whole: a change of these that these data could not have seen leaves the question open.
_WANTED = ("inertia", DRAG)
# A cause acts in a campaign whose own size of it is so many standard errors from nothing.
_ACTS = 3.0
# What differs as much by a smaller chance is no chance.
_CHANCE = 1e-3
Report = Callable[[str], None]


@dataclass(frozen=True, kw_only=True, eq=False)
class CrossPrediction:
    """One campaign's runs simulated freely by the model of another, or by its own.

    Attributes
    ----------
    rate_r2, rate_rmse
        Over all runs.
    position_errors
        Horizon in s -> RMS position error that far after a restart; None where no run is as long.
    """

    simulations: tuple[TrialSimulation, ...]
    rate_r2: float
    rate_rmse: float
    position_errors: Mapping[float, float | None]


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """What `rovid compare` says.

    Attributes
    ----------
    verdict
        same, changed or cannot_tell.
    causes
        Ids of the causes that act in A, and in B.
    predictions
        (model of, runs of), as ("a", "b") -> how well; none of a parameter file.
    matters
        Share from which on a change matters.
    passing
        Ids of causes of a day alone that acted in one of the two.
    why
        What leaves the question open, a clause each; empty where nothing does.
    """

    verdict: str
    a: CampaignFit
    b: CampaignFit
    effects: tuple[Effect, ...]
    changes: DifferenceTest
    causes: tuple[tuple[str, ...], tuple[str, ...]]
    transient_causes: tuple[str, ...]
    predictions: Mapping[tuple[str, str], CrossPrediction]
    relevant_change: float
    open_questions: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def changed(self) -> tuple[str, ...]:
        """What is established to have changed: names of parameters, or thrust_scale."""
        names: list[str] = []
        for change in self.changes.established:
            one = change.candidate
            names += [one.name] if one.inverse else one.parameters
        return tuple(dict.fromkeys(names))


def compare(
    a: CampaignFit, b: CampaignFit, *, matters: float = RELEVANT_CHANGE, report: Report = lambda _: None
) -> Comparison:
    """Hold two campaigns against each other; logs are diagnosed where they are not yet.

    Both are fitted with the causes of either, so that no difference is one between models.

    Raises
    ------
    ConfigError
        They are of different vehicles.
    DataError
        One tells too little.
    """
    warnings = [*_alike(a, b), *_called(a, b), *_twice(a, b)]
    a, b = with_diagnosis(a, report), with_diagnosis(b, report)
    effects = shared_effects(a, b)
    report("Fitting both with the causes of either …")
    one, other = thread_map(lambda day: shared_estimate(day, effects), [a, b])
    pair, named = _pair(one, other, [effect for effect in effects if effect.environmental])
    weak = [effect.key for effect in effects if effect.id == IMBALANCE.id]
    changes = test_difference(pair, change_candidates(pair, weak, _other_thruster(a, effects)))
    report("Simulating the runs of each by the model of the other …")
    why = [*_unseen(changes, matters), *_apart(changes), *_untold(named, pair, a, b)]
    if changes.established:
        verdict = "changed"
    elif why or changes.changes:
        verdict = "cannot_tell"
    else:
        verdict = "same"
    return Comparison(
        verdict=verdict,
        a=a,
        b=b,
        effects=tuple(effects),
        changes=changes,
        causes=(_causes(a, b, effects, one, changes), _causes(b, a, effects, other, changes)),
        transient_causes=_passing(a, b),
        predictions=_predictions(a, b),
        relevant_change=matters,
        open_questions=tuple(why),
        warnings=(*warnings, *_said({a.name: _noticed(a, one), b.name: _noticed(b, other)})),
    )


def _alike(a: CampaignFit, b: CampaignFit) -> list[str]:
    """What differs in how both are driven; refused where that leaves nothing to compare."""
    if a.axis is not b.axis:
        raise ConfigError(
            f"is of {a.axis.name} and {b.name} of {b.axis.name}; one degree of freedom was expected.",
            where=a.name,
            mend="Give --axis, or two parameter files of one axis.",
        )
    if a.settings is None or b.settings is None:
        return []
    mine, yours = (_thrusters(day.settings) for day in (a, b))
    if mine != yours:
        raise ConfigError(
            f"is driven by {_listed(mine)}, and {b.name} by {_listed(yours)}: parameters are measured by what drives "
            "the vehicle, and these are two vehicles, or two layouts.",
            where=a.name,
            mend="Compare campaigns of one layout, the thrusters called alike in both rovid.toml.",
        )
    differing = a.settings.changes(b.settings, drive_alone=True)
    if not differing:
        return []
    text = (
        f"rovid.toml differs: {'; '.join(differing)}. Where that is a correction and no refit, make both alike: thrust "
        "is what everything is measured by."
    )
    return [text]


def _called(a: CampaignFit, b: CampaignFit) -> list[str]:
    """What is said of vehicles that are not called alike."""
    if a.vehicle_name == b.vehicle_name:
        return []
    return [f"{a.name} is of {a.vehicle_name or 'no vehicle by name'}, {b.name} of {b.vehicle_name or 'none'}."]


def _twice(a: CampaignFit, b: CampaignFit) -> list[str]:
    """What is said where a log is in both."""
    both = {source.sha256 for source in a.sources} & {source.sha256 for source in b.sources}
    if not both:
        return []
    names = [source.name for source in a.sources if source.sha256 in both]
    return [
        f"In both campaigns: {', '.join(names)}. What rests on the same logs agrees, and errors are no errors then."
    ]


def _thrusters(settings: ConfigFingerprint | None) -> list[str]:
    """Names of what drives the vehicle."""
    drive = {} if settings is None else settings.drive
    return sorted({name.partition(" of ")[2] or f"logged {name}" for name in drive})


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names) or "nothing"


def _pair(one: SharedEstimate, other: SharedEstimate, passing: Sequence[Effect]) -> tuple[EstimatePair, list[str]]:
    """What both say of the same parameters, but for what is of a day alone; and the names of all that either has."""
    aside = tuple(f"{effect.key}." for effect in passing)
    named = [name for name in dict.fromkeys((*one.names, *other.names)) if not name.startswith(aside)]
    kept = [name for name in named if _is_known(one, name) and _is_known(other, name)]
    places = [[side.names.index(name) for name in kept] for side in (one, other)]
    pair = EstimatePair(
        names=tuple(kept),
        units=tuple(one.units[at] for at in places[0]),
        a=one.values[places[0]],
        b=other.values[places[1]],
        covariance_a=one.covariance[np.ix_(places[0], places[0])],
        covariance_b=other.covariance[np.ix_(places[1], places[1])],
        white=one.white and other.white,
        samples=one.samples + other.samples,
    )
    return pair, named


def _is_known(side: SharedEstimate, name: str) -> bool:
    if name not in side.names:
        return False
    at = side.names.index(name)
    variance = side.covariance[at, at]
    return math.isfinite(variance) and variance > 0.0


def _other_thruster(a: CampaignFit, effects: Sequence[Effect]) -> str:
    """Key of the one thruster whose gain is not among the ``effects``; empty where there is none, or more."""
    if not a.runs:
        return ""
    named = {effect.form for effect in effects if effect.id == IMBALANCE.id}
    left = [
        thruster.name for thruster in a.vehicle.thrusters if thruster.curve is not None and thruster.name not in named
    ]
    return f"{IMBALANCE.id}:{left[0]}" if named and len(left) == 1 else ""


def _unseen(changes: DifferenceTest, matters: float) -> list[str]:
    """What might have changed by a share that ``matters``, and these data would not show it."""
    return [
        f"{name.replace('_', ' ')} would have had to change by {100.0 * changes.detectable_changes[name]:.0f} % to be seen"
        for name in _WANTED
        if changes.detectable_changes.get(name, 0.0) > matters
    ]


def _apart(changes: DifferenceTest) -> list[str]:
    """What is said where too much differs for chance, and no few changes explain it."""
    if changes.p_value >= _CHANCE:
        return []
    return [
        "what did not change by any name differs by more than its errors, which are too small, or much changed a little"
    ]


def _untold(named: Sequence[str], pair: EstimatePair, a: CampaignFit, b: CampaignFit) -> list[str]:
    """What one of the two alone knows, a clause each."""
    clauses = []
    for name in named:
        if name in pair.names:
            continue
        what = f"{name} is known of one of the two alone"
        if a.runs and b.runs:
            clauses.append(what)
        else:
            clauses.append(f"{what}, and of a parameter file nobody tells whether its logs show it: give the logs")
    return clauses


def _causes(
    day: CampaignFit, against: CampaignFit, effects: Sequence[Effect], own: SharedEstimate, changes: DifferenceTest
) -> tuple[str, ...]:
    """Ids of what acts in ``day``: what was found there, and what was found in the other, did not change, and shows."""
    found = {effect.key: effect.id for effect in day.found_effects}
    gone = {change.candidate.name for change in changes.established}
    for effect in effects:
        size = f"{effect.key}.{effect.parameters[0].name}"
        acts = size in own.names and _is_away(own, size, effect.parameters[0].neutral)
        if effect.key in gone and effect.id in found.values() and not acts:
            found = {key: name for key, name in found.items() if name != effect.id}
        elif acts and any(effect.id == other.id for other in against.found_effects) and not effect.environmental:
            found[effect.key] = effect.id
    return tuple(dict.fromkeys(found.values()))


def _is_away(own: SharedEstimate, name: str, null: float) -> bool:
    at = own.names.index(name)
    return bool(abs(own.values[at] - null) > _ACTS * math.sqrt(own.covariance[at, at]))


def _passing(a: CampaignFit, b: CampaignFit) -> tuple[str, ...]:
    """Ids of what is of a day alone and acted in one of the two."""
    each = [{effect.id for effect in day.found_effects if effect.environmental} for day in (a, b)]
    return tuple(sorted(each[0] ^ each[1]))


def _predictions(a: CampaignFit, b: CampaignFit) -> dict[tuple[str, str], CrossPrediction]:
    """Each model on each campaign's runs, where there are any."""
    days = {"a": a, "b": b}
    wanted = []
    for name, day in days.items():
        for runs_of, on in days.items():
            if day.model is not None and on.runs and (day is on or _suits(day.model, on)):
                wanted.append((name, runs_of, day.model, on))
    made = thread_map(lambda one: _predicted(one[2], one[3]), wanted)
    return {(name, runs_of): prediction for (name, runs_of, *_), prediction in zip(wanted, made, strict=True)}


def _suits(model: Model, on: CampaignFit) -> bool:
    """Whether the logs hold what the effects of ``model`` need."""
    return all(on.has_signals_for(effect) for effect in model.effects)


def _predicted(model: Model, on: CampaignFit) -> CrossPrediction:
    simulations = simulate_runs(on.runs, model, on.vehicle)
    fit = pooled_fit(simulations)
    errors: dict[float, float | None] = {}
    for horizon in HORIZONS:
        known = [error for one in simulations if (error := one.position_errors[horizon]) is not None]
        errors[horizon] = math.sqrt(sum(error**2 for error in known) / len(known)) if known else None
    return CrossPrediction(simulations=tuple(simulations), rate_r2=fit.r2, rate_rmse=fit.rmse, position_errors=errors)


def _noticed(day: CampaignFit, own: SharedEstimate) -> list[str]:
    """What was noticed in the logs, and of the fit."""
    remarks = [] if day.study is None else day.study.remarks()
    return [*remarks, *own.warnings]


def _said(noticed: Mapping[str, Sequence[str]]) -> list[str]:
    """Each remark once, with the campaign that it is on, or both."""
    of: dict[str, list[str]] = {}
    for name, texts in noticed.items():
        for text in texts:
            of.setdefault(text, []).append(name)
    return [f"{' and '.join(names)}: {text}" for text, names in of.items()]
