"""Diagnosis of the planar model: named causes of what it predicts wrongly.

The base model is fitted to the innovations. Score tests screen all forms that couple surge, sway and yaw, or that act
between command and thrust. The best ones are fitted, and added while they gain enough; other sets of causes challenge
the result. Each cause then has to pass the held-out gate; see `rovid.planar.held_out`. One that fails is banned, and
the search goes on without it. Thresholds are those of `rovid.diagnose.thresholds`.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rovid.core.budget import Budget, ProgressCallback
from rovid.core.errors import DataError
from rovid.diagnose.build_result import OUT_OF_TIME
from rovid.diagnose.candidate_fits import Challenger
from rovid.diagnose.evidence import size_in_errors
from rovid.diagnose.result import Conclusion, Finding
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects import Effect
from rovid.effects.base import WaterCurrent
from rovid.estimate.estimate import Estimate
from rovid.estimate.maximum_likelihood import INNOVATIONS_R2
from rovid.planar.dataset import PlanarData
from rovid.planar.doubts import contradicted, formless, likelier_suspects, outweighed
from rovid.planar.effect_fits import add_effect, in_own_time, planar_candidates, with_hull_lift
from rovid.planar.fit import PlanarFit, fit_base, planar_result, refined, with_latencies
from rovid.planar.free_runs import better_simulating, fit_free_runs
from rovid.planar.held_out import Gate, Parts, PlanarScores, noise_floors
from rovid.planar.model import AXIS_NAMES
from rovid.planar.optimum import PlanarOptimum, coordinates_without
from rovid.planar.search import PlanarSearch

# Most suspects of a result.
_MOST_SUSPECTS = 3
_FORMLESS = (
    "{} improves the prediction of held-out parts, but the base model is not exact here: its form is not established."
)
# A position comes from a vehicle at the surface, or from acoustics.
_WIND = "If the vehicle was at the surface, a steady wind may act like the current: compare with the wind of that time."
_DISAGREED = "Free-running simulations favour {}, the likelihood of the innovations {}: neither is established."
_LIKELIER = "The likelihood of the innovations favours {}, but no free-running simulation does: it is not established."
_OUTWEIGHED = "{} explains these logs better, also held-out ones, but failed a test: {} is not established."
# Least share of the best predicted gain for which a current is tried first: with rudders, whose hulls take longer to
# fit, and without. Score tests are good to a factor of a few. Nats by which the model in the current has to be
# likelier.
_RUDDER_SHARE, _LEAST_SHARE, _BETTER = 0.5, 0.1, 10.0
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
    forces = np.concatenate([run.forces().force for run in data.runs])
    if not np.any(forces != 0.0) and not data.actuators.rudders:
        missing = "no thruster ever runs: there is no force to explain the motion with. Log a run under thrust."
        return PlanarDiagnosis(verdict="too_little_data", missing=missing)
    report("Fitting surge, sway and yaw together …")
    try:
        base = with_hull_lift(fit_base(data), data)
    except DataError as error:
        return PlanarDiagnosis(verdict="too_little_data", missing=str(error))
    parts = Parts(data, base)
    if missing := _too_short(data, parts):
        return PlanarDiagnosis(verdict="too_little_data", missing=missing)
    search = _in_current(_search(data, base, own))
    base, parts = search.base, Parts(data, search.base)
    model = _selected(search)
    likelier: list[Finding] = []
    simulating = better_simulating(model, data)
    if simulating.is_multi_step:
        # The likelihood does not hold for any model of the search: free-running simulations decide.
        report("Fitting free-running simulations …")
        first = Gate(search, parts)
        likelier = [first.tested(model, effect)[0] for effect in search.causes(model)]
        base = fit_free_runs(base, data) if search.causes(model) else replace(simulating, likeliest=None)
        parts = Parts(data, base)
        search = _search(data, base, own)
        model = _agreeing(search, _selected(search), {one.effect.id for one in likelier})
    elif simulating is not model:
        # The disturbance is larger than usual, and real: all models of the search are compared under its wider limit.
        search = _search(data, base.loosened(), own)
        model = _selected(search)
    report("Validating on held-out parts …")
    gate = Gate(search, parts)
    model, tested, rejected = _validated(search, gate, model)
    return _result(gate, model, tested, rejected, likelier)


def _search(data: PlanarData, base: PlanarOptimum, budget: Budget) -> PlanarSearch:
    return PlanarSearch(data, in_own_time(base), planar_candidates(data), budget)


def _selected(search: PlanarSearch) -> PlanarOptimum:
    """The model with the causes that no other set beats."""
    search.budget.report("Searching for causes …")
    return search.challenged(search.run(search.base))


def _in_current(search: PlanarSearch) -> PlanarSearch:
    """The search from the model in the current that shows, or the same ``search`` if that is no better.

    A current hides which forces of hull and rudder the runs show. Where positions alone measure the speeds, a fit
    without it may also end at inertias from which no step leads to those in the current: that fit begins anew.
    """
    data, base = search.data, search.base
    anew = (data.actuators.rudders or "surge_velocity" not in data.sensors) and not search.budget.is_late
    tests = search.screen(base) if anew and search.is_usable(base) else []
    currents = [one for one in tests if isinstance(one.effect.acts, WaterCurrent)]
    test = next((one for one in currents if not one.effect.form), None)
    share = _RUDDER_SHARE if data.actuators.rudders else _LEAST_SHARE
    if test is None or currents[0].gain < max(search.threshold, share * tests[0].gain):
        return search
    search.budget.report("Fitting the model in the current …")
    moved = add_effect(fit_base(data, with_current=True), test.effect, data)
    moved = with_latencies(with_hull_lift(moved, data), data)
    coordinates, x, _ = coordinates_without(moved, test.effect)
    still = PlanarOptimum.fit(moved.likelihood.with_coordinates(coordinates), coordinates.projected(x))
    if still.model.names == base.model.names:
        if moved.value > search.polish(search.extended(base, test)).value - _BETTER:
            return search
        other = PlanarOptimum.fit(still.likelihood, coordinates.projected(base.x))
        still = min((still, other), key=lambda one: one.value)
    found = _search(data, still, search.budget)
    likelihood = moved.likelihood.with_coordinates(coordinates.with_effect(test.effect))
    own = np.insert(x, coordinates.noise_begin, moved.x[moved.place(test.effect)])
    found.remember(PlanarOptimum(likelihood, own, moved.value))
    return found


def _agreeing(search: PlanarSearch, model: PlanarOptimum, likelier: Collection[str]) -> PlanarOptimum:
    """The model with ``likelier`` causes in the place of others that free-running simulations do not tell from them."""
    for effect in search.causes(model):
        gain = search.score(model) - search.score(search.without(model, effect))
        for one in search.replacements(model, effect) if effect.id not in likelier else ():
            if one.effects[-1].id in likelier and search.score(model) - search.score(one) < THRESHOLDS.tie(gain):
                model = search.polish(one)
                break
    return model


def _too_short(data: PlanarData, parts: Parts) -> str:
    """Message on logs too short to hold parts out; empty if long enough."""
    if parts.count >= THRESHOLDS.min_trials and parts.shortest >= parts.least:
        return ""
    seconds = sum(run.duration for run in data.runs)
    return (
        f"there are {len(data.runs)} trials, {seconds:.0f} s in all: too little for {THRESHOLDS.min_trials} parts of "
        f"{parts.least:.0f} s, of which some are held out for validation. Record more runs of other kinds (straight "
        "runs at two speeds, sideways runs, turns both ways, a zigzag)."
    )


def _validated(
    search: PlanarSearch, gate: Gate, model: PlanarOptimum
) -> tuple[PlanarOptimum, list[Finding], list[tuple[Finding, str]]]:
    """The model with causes that pass the gate, their tests, and the rejected causes with a message for each."""
    messages: list[tuple[Finding, str]] = []
    for _ in range(THRESHOLDS.max_rejections):
        tested = [gate.tested(model, effect) for effect in search.causes(model)]
        tested.sort(key=lambda one: one[0].bic_gain)
        failed = next(((one, why) for one, growths in tested if (why := _rejection(model, one, growths))), None)
        if failed is None:
            return model, [one for one, _ in tested], messages
        one, why = failed
        messages.append((one, f"{one.effect.title} {why}: it is not claimed."))
        search.banned.add(one.effect.key)
        rest = search.without(model, one.effect)
        model = rest if search.budget.is_late else search.challenged(search.run(search.polish(rest)))
    for effect in search.causes(model):
        tests = gate.tested(model, effect)
        if why := _rejection(model, *tests):
            messages.append((tests[0], f"{effect.title} {why}: it is not claimed."))
            model = search.polish(search.without(model, effect))
    return model, [gate.tested(model, effect)[0] for effect in search.causes(model)], messages


def _rejection(fitted: PlanarOptimum, tested: Finding, growths: Mapping[str, float]) -> str:
    """Why a cause is never claimed; empty where it passes."""
    if tested.held_out_gain <= THRESHOLDS.min_held_out_gain:
        return f"fits these logs but predicts held-out parts worse (log-likelihood {tested.held_out_gain:.1f})"
    if fitted.is_at_bound(tested.effect):
        return "would be larger than is physically plausible"
    if tested.standard_errors < THRESHOLDS.min_standard_errors:
        return f"differs from nothing by only {tested.standard_errors:.1f} standard errors"
    name, growth = max(growths.items(), key=lambda one: one[1])
    if growth > THRESHOLDS.held_out_growth:
        return f"makes the errors of held-out simulations of the {name.replace('_', ' ')} {100.0 * growth:.0f} % larger"
    if tested.probability < THRESHOLDS.likely:
        return "is possible, but not established"
    return ""


# --- Result -----------------------------------------------------------------------------------------------------------


def _result(
    gate: Gate,
    model: PlanarOptimum,
    tested: Sequence[Finding],
    rejected: Sequence[tuple[Finding, str]],
    likelier: Sequence[Finding],
) -> PlanarDiagnosis:
    """The result; ``rejected`` are causes, and why they are not claimed.

    ``likelier``: Causes by the likelihood, where free-running simulations replaced it.
    """
    search, data = gate.search, gate.search.data
    late = bool(search.budget.not_tried)
    without_form = formless(model, data, tested)
    apart, others = contradicted(tested, likelier), " and ".join(one.effect.title for one in likelier)
    beaten = outweighed(tested, [one for one, _ in rejected])
    messages = [
        *(_FORMLESS.format(one.effect.title) for one in without_form),
        *(_DISAGREED.format(one.effect.title, others) for one in apart),
        *(_OUTWEIGHED.format(other.effect.title, one.effect.title) for one, other in beaten),
    ]
    doubtful = [*without_form, *apart, *(one for one, _ in beaten)]
    sure = [one for one in tested if one.probability >= THRESHOLDS.established and one not in doubtful]
    established, final, worse = gate.established(model, tested, [] if late else sure)
    messages += worse
    # Another form of an established cause may have been rejected.
    named = {one.effect.id for one in established}
    messages = [*(text for one, text in rejected if one.effect.id not in named), *messages]
    if "current" in named and "north" in data.sensors:
        messages.append(_WIND)
    search.budget.report("Fitting all readings …")
    established, final, fit, small = _fitted_to_all_readings(search, final, established)
    messages += small
    base_fit = fit if not search.causes(final) else planar_result(data, search.base)
    findings = [replace(_stated(one, fit.estimate, final), is_complete=not late) for one in established]
    suspects = []
    likely = planar_result(data, model).estimate if len(findings) < len(tested) else fit.estimate
    for one in tested:
        if one not in established:
            probability = min(one.probability, THRESHOLDS.max_suspect_probability)
            suspects.append(replace(_stated(one, likely, model), probability=probability, is_complete=not late))
    rivals = likelier_suspects(tested, likelier)
    messages += [_LIKELIER.format(one.effect.title) for one in rivals if not tested]
    suspects += [*rivals, *_further(search, gate, model, {one.effect.id for one in (*tested, *rivals)})]
    share = _ONE_OF_TWO if apart or rivals else 1.0
    suspects = [replace(one, probability=share * one.probability) for one in suspects]
    floors = noise_floors(gate.parts, final).scores
    is_left = not fit.white and (fit.at_limit or min(fit.free_run_r2.values(), default=1.0) < INNOVATIONS_R2)
    verdict = "unexplained" if is_left else "nothing_found"
    if findings or suspects:
        verdict = "found" if findings else "suspected"
    warnings = [*fit.warnings, *dict.fromkeys(messages)]
    if late:
        warnings.append(OUT_OF_TIME.format(search.budget.seconds))
    # Each effect that is not in the ``model``, with the smallest size of its best form that would be added.
    taken = {effect.id for effect in final.effects}
    detectable: dict[str, tuple[Effect, float]] = {}
    for test in search.screen(final):
        if test.effect.id not in taken and (test.effect.id not in detectable or not test.effect.form):
            detectable[test.effect.id] = test.effect, test.detectable
    shares = {}
    for name, (size, _) in fit.disturbance.items():
        force = float(final.coordinates.sizes.force[AXIS_NAMES.index(name)])
        shares[name] = size**2 / (size**2 + force**2)
    return PlanarDiagnosis(
        verdict=verdict,
        base=PlanarAssessment(fit=base_fit, held_out=gate.held_out(search.base).scores),
        extended=PlanarAssessment(fit=fit, held_out=gate.held_out(final).scores),
        findings=tuple(sorted(findings, key=lambda one: -one.gain)),
        suspects=tuple(sorted(suspects, key=lambda one: -one.probability)[:_MOST_SUSPECTS]),
        challengers=_challengers(search, final),
        unexplained_shares=shares,
        noise_floors=floors.rmse,
        heading_floors=floors.heading_errors,
        detectable=tuple(detectable.values()),
        warnings=tuple(warnings),
        budget=search.budget.use,
    )


def _stated(one: Finding, estimate: Estimate, model: PlanarOptimum) -> Finding:
    """A cause with its size, and the distance of that from nothing, by the stated ``estimate`` of the ``model``."""
    size = size_in_errors(one.effect, estimate, model.coordinates.sizes.effects)
    return replace(one, estimate=estimate.only(one.effect.parameter_names), standard_errors=size)


def _fitted_to_all_readings(
    search: PlanarSearch, model: PlanarOptimum, established: Sequence[Finding]
) -> tuple[list[Finding], PlanarOptimum, PlanarFit, list[str]]:
    """Causes that remain ``established``, their model, its fit to all readings, and messages on the others.

    The search takes thinned readings, and its errors lack what the model misses. The stated errors of all readings
    include that: a cause with a size that they leave open is dropped, and the others are tested again.
    """
    found, messages, scales = list(established), list[str](), model.coordinates.sizes.effects
    while True:
        fit = planar_result(search.data, refined(model, search.data))
        sizes = [(size_in_errors(one.effect, fit.estimate, scales), one) for one in found]
        size, weakest = min(sizes, key=lambda one: one[0], default=(math.inf, None))
        if weakest is None or size >= THRESHOLDS.min_stated_errors:
            return found, model, fit, messages
        why = f"differs from nothing by only {size:.1f} standard errors in all readings"
        why = why if size > 0.0 else "shows, but these logs do not determine its size"
        messages.append(f"{weakest.effect.title} {why}: it is not established.")
        found = [one for one in found if one is not weakest]
        model = search.polish(search.without(model, weakest.effect))


def _further(search: PlanarSearch, gate: Gate, model: PlanarOptimum, known: Collection[str]) -> list[Finding]:
    """Suspects next to the model: causes that gain too little to be added, or failed a test."""
    found: list[Finding] = []
    if search.budget.is_late:
        return found
    for fitted in search.extensions(model):
        effect = fitted.effects[-1]
        if not search.is_usable(fitted) or effect.id in {*known, *(one.effect.id for one in found)}:
            continue
        if search.score(fitted) - search.score(model) <= 0.0:
            break
        one, growths = gate.tested(fitted, effect)
        probability = min(one.probability, THRESHOLDS.max_suspect_probability)
        if probability < THRESHOLDS.possible or one.standard_errors < THRESHOLDS.min_standard_errors_suspect:
            continue
        is_worse = max(growths.values()) > THRESHOLDS.held_out_growth
        if one.held_out_gain <= THRESHOLDS.min_held_out_gain or is_worse or fitted.is_at_bound(effect):
            continue
        own = _stated(one, planar_result(search.data, fitted).estimate, fitted)
        found.append(replace(own, probability=probability))
    return found


def _challengers(search: PlanarSearch, model: PlanarOptimum) -> tuple[Challenger, ...]:
    """Other fitted sets of causes, the closest to the ``model`` first."""
    found, own = [], {effect.key for effect in model.effects}
    for fitted in search.fits.values():
        if search.causes(fitted) and {effect.key for effect in fitted.effects} != own:
            gain = model.value - fitted.value
            found.append(Challenger(search.causes(fitted), gain, gain - (search.score(fitted) - search.score(model))))
    shown: dict[Collection[str], Challenger] = {}
    for one in sorted(found, key=lambda one: -one.score_difference):
        shown.setdefault(frozenset(one.causes), one)
    return tuple(shown.values())[: THRESHOLDS.challengers_shown]
