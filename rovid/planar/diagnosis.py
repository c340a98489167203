"""Diagnosis of the planar model: named causes of what it predicts wrongly.

The base model is fitted to the innovations. Score tests screen all forms that couple surge, sway and yaw, or that act
between command and thrust. The best ones are fitted, and added while they gain enough; other sets of causes challenge
the result. Each cause then has to pass the held-out gate; see `rovid.planar.validation`. One that fails is banned, and
the search goes on without it. Thresholds are those of `rovid.diagnose.thresholds`.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rovid.core.budget import Budget, ProgressCallback
from rovid.core.errors import DataError
from rovid.diagnose.evidence import size_in_errors
from rovid.diagnose.result import Conclusion, Finding
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.diagnose.validation import OUT_OF_TIME
from rovid.effects import Effect
from rovid.effects.base import Coupling, WaterCurrent
from rovid.estimate.maximum_likelihood import INNOVATIONS_R2
from rovid.planar.dataset import PlanarData
from rovid.planar.effect_fits import add_effect, planar_candidates, with_hull_lift
from rovid.planar.fit import PlanarFit, fit_base, planar_result, refined
from rovid.planar.free_runs import better_simulating, fit_free_runs
from rovid.planar.held_out import Parts, PlanarScores, noise_floors
from rovid.planar.model import AXIS_NAMES
from rovid.planar.optimum import PlanarOptimum, coordinates_without
from rovid.planar.search import PlanarSearch
from rovid.planar.validation import Gate, challengers, is_at_bound, validated

# Most suspects of a result.
_MOST_SUSPECTS = 3
_FORMLESS = (
    "{} improves the prediction of held-out parts, but the base model is not exact here: its form is not established."
)
# A position comes from a vehicle at the surface, or from acoustics.
_WIND = "If the vehicle was at the surface, a steady wind may act like the current: compare with the wind of that time."
_DISAGREED = "Free-running simulations favour {}, the likelihood of the innovations {}: neither is established."
# Probability that either of two criteria is right that name different causes. A decision.
_ONE_OF_TWO = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarAssessment:
    """One of the two models, with its scores on held-out parts."""

    fit: PlanarFit
    held_out: PlanarScores


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarDiagnosis(Conclusion):
    """Result of `rovid diagnose --axes planar`."""

    #: ``base``, ``extended``: model without, and with the established causes; None with too little data.
    base: PlanarAssessment | None = None
    extended: PlanarAssessment | None = None
    #: Axis (surge, sway, yaw) -> variance of the disturbance over that of the disturbance and all forces in use.
    unexplained_shares: Mapping[str, float] = field(default_factory=dict)
    #: As `PlanarScores.rmse` and `PlanarScores.heading_errors`, of a perfect model.
    noise_floors: Mapping[str, float] = field(default_factory=dict)
    heading_floors: Mapping[float, float] = field(default_factory=dict)


def diagnose_planar(
    data: PlanarData, report: ProgressCallback = lambda _: None, budget: Budget | None = None
) -> PlanarDiagnosis:
    """Find the causes that the planar base model misses, within the ``budget``; ``report`` is called with each step."""
    own = replace(budget or Budget(), report=report)
    if missing := _missing(data):
        return PlanarDiagnosis(verdict="too_little_data", missing=missing)
    report("Fitting surge, sway and yaw together …")
    try:
        base = with_hull_lift(fit_base(data), data)
    except DataError as error:
        return PlanarDiagnosis(verdict="too_little_data", missing=str(error))
    parts = Parts(data, base)
    if missing := _too_short(data, parts, base):
        return PlanarDiagnosis(verdict="too_little_data", missing=missing)
    search = _search(data, base, own)
    if (of_current := _base_in_current(search)) is not None:
        base, parts, search = of_current, Parts(data, of_current), _search(data, of_current, own)
    model = _selected(search)
    likelier: list[Finding] = []
    simulating = better_simulating(model, data)
    if simulating.is_multi_step and not model.is_multi_step:
        # The likelihood does not hold for any model of the search: free-running simulations decide.
        report("Fitting free-running simulations …")
        first = Gate(search, parts)
        likelier = [first.tested(model, effect)[0] for effect in search.causes(model)]
        base = fit_free_runs(base, data) if search.causes(model) else replace(simulating, likeliest=None)
        parts = Parts(data, base)
        search = _search(data, base, own)
        model = _agreeing(search, _selected(search), {one.effect.id for one in likelier})
    report("Validating on held-out parts …")
    gate = Gate(search, parts)
    model, tested, rejected = validated(search, gate, model)
    return _result(gate, model, tested, rejected, likelier)


def _search(data: PlanarData, base: PlanarOptimum, budget: Budget) -> PlanarSearch:
    # A slew limit of commands is one of angles where these steer the vehicle.
    same = {"slew_limit"} if data.actuators.steered else set()
    candidates = tuple(form for form in planar_candidates(data) if form.key not in same)
    return PlanarSearch(data, base, candidates, budget)


def _selected(search: PlanarSearch) -> PlanarOptimum:
    """The model with the causes that no other set beats."""
    search.budget.report("Searching for causes …")
    return search.challenged(search.run(search.base))


def _base_in_current(search: PlanarSearch) -> PlanarOptimum | None:
    """The base model of a hull with rudders in the current that shows next to it; None if that is the same model.

    A current hides which forces of hull and rudder the runs show.
    """
    data = search.data
    tests = search.screen(search.base) if data.actuators.rudders and search.is_usable(search.base) else []
    current = next((one.effect for one in tests if isinstance(one.effect.acts, WaterCurrent)), None)
    if current is None or tests[0].gain < search.threshold or tests[0].effect is not current:
        return None
    search.budget.report("Fitting the hull in the current …")
    moved = with_hull_lift(add_effect(fit_base(data, with_current=True), current, data), data)
    coordinates, x, _ = coordinates_without(moved, current)
    still = PlanarOptimum.fit(moved.likelihood.with_coordinates(coordinates), coordinates.projected(x))
    return still if still.model.names != search.base.model.names else None


def _agreeing(search: PlanarSearch, model: PlanarOptimum, likelier: Collection[str]) -> PlanarOptimum:
    """The model with ``likelier`` causes in the place of others that free-running simulations do not tell from them."""
    for effect in search.causes(model):
        gain = search.score(model) - search.score(search.without(model, effect))
        for one in search.replacements(model, effect) if effect.id not in likelier else ():
            if one.effects[-1].id in likelier and search.score(model) - search.score(one) < THRESHOLDS.tie(gain):
                model = search.polish(one)
                break
    return model


def _missing(data: PlanarData) -> str:
    """Message on what the logs lack before any fit; empty if nothing."""
    forces = np.concatenate([run.forces().force for run in data.runs])
    if not np.any(forces != 0.0) and not data.actuators.rudders:
        return "no thruster ever runs: there is no force to explain the motion with. Log a run under thrust."
    return ""


def _too_short(data: PlanarData, parts: Parts, base: PlanarOptimum) -> str:
    """Message on logs too short to hold parts out; empty if long enough."""
    times = base.coordinates.sizes.time
    constant = float(times[2] if base.likelihood.grid.yaw_only else times.min())
    least = THRESHOLDS.part_time_constants_min * constant
    if parts.count >= THRESHOLDS.min_trials and parts.shortest >= least:
        return ""
    seconds = sum(run.duration for run in data.runs)
    return (
        f"there are {len(data.runs)} trials, {seconds:.0f} s in all: too little for {THRESHOLDS.min_trials} parts of "
        f"{least:.0f} s, of which some are held out for validation. Record more runs of other kinds (straight runs at "
        "two speeds, sideways runs, turns both ways, a zigzag)."
    )


# --- Result -----------------------------------------------------------------------------------------------------------


def _result(
    gate: Gate,
    model: PlanarOptimum,
    tested: Sequence[Finding],
    rejected: Sequence[tuple[str, str]],
    likelier: Sequence[Finding],
) -> PlanarDiagnosis:
    """The result; ``rejected`` are ids of effects, and why they are not claimed.

    ``likelier``: Causes by the likelihood, where free-running simulations replaced it.
    """
    search, parts, data = gate.search, gate.parts, gate.search.data
    late = bool(search.budget.not_tried)
    # Where the base model is not exact, a coupling of another form may fit as well as the true one.
    formless = [one for one in tested if model.is_multi_step and isinstance(one.effect.acts, Coupling)]
    messages = [_FORMLESS.format(one.effect.title) for one in formless]
    apart, others = _contradicted(tested, likelier), " and ".join(one.effect.title for one in likelier)
    messages += [_DISAGREED.format(one.effect.title, others) for one in apart]
    sure = [one for one in tested if one.probability >= THRESHOLDS.established and one not in (*formless, *apart)]
    established, final, worse = gate.established(model, tested, [] if late else sure)
    messages += worse
    # Another form of an established cause may have been rejected.
    named = {one.effect.id for one in established}
    messages = [*(text for effect, text in rejected if effect not in named), *messages]
    if "current" in named and "north" in data.sensors:
        messages.append(_WIND)
    search.budget.report("Fitting all readings …")
    established, final, complete, small = _fitted_to_all_readings(search, final, established)
    messages += small
    fit = planar_result(data, complete)
    base_fit = fit if not search.causes(final) else planar_result(data, search.base)
    findings, suspects = [], []
    for one in established:
        if _is_refused(fit, one.effect):
            messages = [*messages, f"{one.effect.title} shows, but these logs do not determine its size."]
        own = fit.estimate.only(one.effect.parameter_names)
        findings.append(replace(one, estimate=own, is_complete=not late))
    likely = planar_result(data, model).estimate if len(findings) < len(tested) else fit.estimate
    for one in tested:
        if one not in established:
            own, probability = likely.only(one.effect.parameter_names), _as_suspect(one.probability)
            suspects.append(replace(one, estimate=own, probability=probability, is_complete=not late))
    rivals = [one for one in likelier if apart and one.effect.id not in {own.effect.id for own in tested}]
    suspects += [*rivals, *_further(search, gate, model, {one.effect.id for one in (*tested, *rivals)})]
    share = _ONE_OF_TWO if apart else 1.0
    suspects = [replace(one, probability=share * one.probability) for one in suspects]
    floors = noise_floors(parts, final).scores
    scores = gate.held_out(final).scores
    base = PlanarAssessment(fit=base_fit, held_out=gate.held_out(search.base).scores)
    is_left = not fit.white and (fit.at_limit or min(fit.free_run_r2.values(), default=1.0) < INNOVATIONS_R2)
    verdict = "unexplained" if is_left else "nothing_found"
    if findings or suspects:
        verdict = "found" if findings else "suspected"
    warnings = [*fit.warnings, *dict.fromkeys(messages)]
    if late:
        warnings.append(OUT_OF_TIME.format(search.budget.seconds))
    # Each effect that is not in the ``model``, with the smallest size of its best form that would be added.
    taken = {effect.id for effect in final.effects}
    best: dict[str, tuple[Effect, float]] = {}
    for test in search.screen(final):
        known = best.get(test.effect.id)
        if test.effect.id not in taken and (known is None or not test.effect.form):
            best[test.effect.id] = test.effect, test.detectable
    detectable = tuple(best.values())
    return PlanarDiagnosis(
        verdict=verdict,
        base=base,
        extended=PlanarAssessment(fit=fit, held_out=scores),
        findings=tuple(sorted(findings, key=lambda one: -one.gain)),
        suspects=tuple(sorted(suspects, key=lambda one: -one.probability)[:_MOST_SUSPECTS]),
        challengers=challengers(search, final),
        unexplained_shares=_unexplained(fit, final),
        noise_floors=floors.rmse,
        heading_floors=floors.heading_errors,
        detectable=detectable,
        warnings=tuple(warnings),
        budget=search.budget.use,
    )


def _fitted_to_all_readings(
    search: PlanarSearch, model: PlanarOptimum, established: Sequence[Finding]
) -> tuple[list[Finding], PlanarOptimum, PlanarOptimum, list[str]]:
    """Causes that remain ``established``, their model, its fit to all readings, and messages on the others.

    The search takes thinned readings. In all of them a cause may be too small.
    """
    found, messages, complete = list[Finding](), list[str](), refined(model, search.data)
    for one in established:
        if not _is_small(complete, one.effect):
            found.append(one)
        else:
            messages.append(f"{one.effect.title} is too small in all readings: it is not established.")
            model = search.polish(search.without(model, one.effect))
            complete = refined(model, search.data)
    return found, model, complete, messages


def _is_small(fitted: PlanarOptimum, effect: Effect) -> bool:
    own = fitted.effect_estimate(effect)
    errors = size_in_errors(effect, own.values, own.covariance, fitted.coordinates.sizes.effects)
    return errors < THRESHOLDS.min_standard_errors_multi_step


def _contradicted(tested: Sequence[Finding], likelier: Sequence[Finding]) -> list[Finding]:
    """Causes by free-running simulations that contradict the likelihood.

    It names other causes, and the logs distinguish them.
    """
    named = {one.effect.id for one in likelier}
    return [
        one for one in tested if named and named.isdisjoint({one.effect.id, *(e.id for e in one.indistinguishable)})
    ]


def _is_refused(fit: PlanarFit, effect: Effect) -> bool:
    return any(name in fit.estimate.refused for name in effect.parameter_names[: effect.size_count])


def _as_suspect(probability: float) -> float:
    return min(probability, THRESHOLDS.max_suspect_probability)


def _further(search: PlanarSearch, gate: Gate, model: PlanarOptimum, known: Collection[str]) -> list[Finding]:
    """Suspects next to the model: causes that gain too little to be added, or failed a test."""
    found: list[Finding] = []
    if search.budget.is_late:
        return found
    for fitted in search.extensions(model):
        effect = fitted.effects[-1]
        if not search.is_usable(fitted):
            continue
        if effect.id in known or effect.id in {one.effect.id for one in found}:
            continue
        if search.score(fitted) - search.score(model) <= 0.0:
            break
        one, growths = gate.tested(fitted, effect)
        probability = _as_suspect(one.probability)
        if probability < THRESHOLDS.possible or one.standard_errors < THRESHOLDS.min_standard_errors_suspect:
            continue
        if one.held_out_gain <= THRESHOLDS.min_held_out_gain or is_at_bound(fitted, effect):
            continue
        if max(growths.values()) > THRESHOLDS.held_out_growth:
            continue
        estimate = planar_result(search.data, fitted).estimate.only(effect.parameter_names)
        found.append(replace(one, estimate=estimate, probability=probability))
    return found


def _unexplained(fit: PlanarFit, model: PlanarOptimum) -> dict[str, float]:
    shares = {}
    for name, (size, _) in fit.disturbance.items():
        force = float(model.coordinates.sizes.force[AXIS_NAMES.index(name)])
        shares[name] = size**2 / (size**2 + force**2)
    return shares
