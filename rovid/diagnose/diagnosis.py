"""What is wrong with the model, why, how much better it gets, what is left, and what to run next."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from scipy import linalg

from rovid.campaign.vehicle import Vehicle
from rovid.diagnose.amplitudes import Amplitudes
from rovid.diagnose.heldout import Fold, HeldOut, cross_validate, errors_ahead, log_likelihood, simulate_folds
from rovid.diagnose.odds import ESTABLISHED, POSSIBLE, PRIOR_ODDS, confidence
from rovid.diagnose.parts import FEWEST_TRIALS, Piece, parts_of, pieces_of, recorded, shortest_part
from rovid.diagnose.scatter import of_one_trial, stands_out
from rovid.diagnose.search import MARGIN, Fitted, Found, Key, Promise, Rival, Search, by_cause, screen, worth
from rovid.diagnose.signals import PREFIX, drivers, is_driver
from rovid.diagnose.size import one_size, size_of
from rovid.diagnose.swell import Swell, swell
from rovid.effects import CATALOGUE, Effect, forms_for
from rovid.ground.arrays import FloatArray
from rovid.ground.errors import DataError
from rovid.identify.estimate import Estimate
from rovid.identify.free_run import CERTAINTY, fit_free_run, free_run_r2
from rovid.identify.horizons import HORIZONS, HorizonLikelihood, HorizonRecords, time_constant
from rovid.identify.innovations import DISTURBANCE, Likelihood, Records
from rovid.identify.likelihood import (
    TRUSTED_R2,
    UNLIMITED,
    canonical,
    colour,
    covariance,
    fit_base,
    form_doubt,
    likelihood_is_white,
    loosened,
    physical,
    scale_doubt,
    simulated_r2,
)
from rovid.identify.regression import require_inertia
from rovid.model.model import Model, without_form
from rovid.motion.runs import Run, Runs, channels
from rovid.plan.design import Plan, plan
from rovid.plan.programme import Limits
from rovid.plan.worth import Belief

# A rival is beaten by so much log-likelihood, and by such a share of what the effect gains, up to so much more.
_BEATEN = (6.0, 0.03, 40.0)
# An effect that differs from nothing by fewer standard errors, as printed, is not claimed: by every reading, and by
# predictions, which count as few.
_SIGNIFICANT, _SIGNIFICANT_AHEAD = 3.5, 2.0
# Nor is one suspected that differs from nothing by fewer.
_SUSPECTED_SIZE = 1.0
# What is surer than that is likely.
_LIKELY, _EVEN = "is likely, and not established", 0.5
# By predictions an addition has to gain so much log-likelihood: with the number of causes tried it is then established.
_MARGIN_AHEAD = math.log(ESTABLISHED / (1.0 - ESTABLISHED) / PRIOR_ODDS)
# Of suspects: one that has a tenth of another's odds is told from it.
_TOLD = math.log(10.0)
# A rival with this share of an effect's gain is compared with it over every reading.
_CLOSE = 0.8
_DECISIONS = 3
# The search looks at readings this share of the vehicle's time constant apart, and no farther than so many seconds.
_THINNED, _THINNED_SECONDS = 0.05, 0.2
# For waves so many readings do, this share of the time constant apart at most.
_READINGS, _THINNED_WAVES = 6000, 0.1
# Fewer predictions than so many tell nothing: the logs are too short beside the vehicle's time constant.
_FEWEST_READINGS = 2.0
# So often a search goes on without what a test refused.
_REFUSALS = 6
# The best of so many more causes may be missing together from what predictions found; slopes promise such a share.
_TOGETHER, _SHARE = 3, 0.25
# A search after which no more predictions count than so many times those before is the last.
_MORE = 1.2
# So many of the likeliest models tell how many predictions count.
_COUNTED = 6
_BY_HORIZONS = (
    "The innovations are not white, or the disturbance is at its limit: each next reading would not tell what is "
    "missing. So causes were judged by predictions from half to eight time constants ahead; gains are of their "
    "log-likelihood, with errors that correlate counted as one."
)
_SHRUNK = (
    "With {} predictions would be better, but each next reading shows less of it than that asks for, as where commands "
    "answer what waves do: it is not claimed."
)
_CUT_SHORT = (
    "The search was ended before nothing more could be found: each addition asked for another. What was found is "
    "likely to stand for something else."
)
# No data along one axis show these: the same motion comes of other inertia and drag.
NEVER_SHOWN = ("thrust_scale", "rate_scale")
INVISIBLE = {
    "thrust_scale": "a common scale of all thrust",
    "rate_scale": "a constant scale of the rate",
    "thruster_imbalance": "an imbalance between thrusters",
    "inertia": "the inertia, and with it the size of every torque and drag, where nothing drives the vehicle",
}
# A model of another form that explains so much of what one explains is as good, where neither explains all.
_NEARLY = 0.9
# A rate below so many times its noise is no motion.
_MOTION = 2.0

Report = Callable[[str], None]


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
    worth: float
    held_out_gain: float
    confidence: float
    rivals: tuple[Rival, ...]
    undecided: tuple[Effect, ...]
    plan: Plan | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Side:
    """One of the two models: its estimate, its free-running model and how it does on trials not fitted."""

    model: Model
    estimate: Estimate
    held_out: HeldOut


@dataclass(frozen=True, kw_only=True)
class Ahead:
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
        Logged signals that drive what no effect explains, with the log-likelihood each gains.
    unexplained_share
        Variance of the disturbance torque over that of all torque, the thrusters' and its own.
    noise_floor
        In the unit of the rate; what a perfect model would miss of it.
    detectable
        Each effect that was not found, and the size of its first parameter that would have been seen, in its unit;
        infinite where none would.
    missing
        What there is too little of.
    amplitudes
        What tables show, where there are no logs.
    """

    verdict: str
    base: Side | None = None
    extended: Side | None = None
    findings: tuple[Finding, ...] = ()
    suspects: tuple[Finding, ...] = ()
    horizons: tuple[Ahead, ...] = ()
    signals: tuple[tuple[Effect, float], ...] = ()
    unexplained_share: float = math.nan
    noise_floor: float = math.nan
    detectable: tuple[tuple[Effect, float], ...] = ()
    warnings: tuple[str, ...] = ()
    missing: str = ""
    amplitudes: Amplitudes | None = None


def diagnose(prepared: Runs, vehicle: Vehicle, report: Report = lambda _: None) -> Diagnosis:
    """Name what the simulation misses.

    Parameters
    ----------
    report
        Called with a line of text as the work goes on.
    """
    runs, notes = prepared.items, []
    parts = parts_of(runs, vehicle, prepared.cutoff)
    if parts is not None:
        runs = parts.items
        notes.append(
            f"There are too few trials ({len(prepared.items)}) to hold any out: they were cut into {len(runs)} parts, "
            "each simulated from its own start."
        )
    lack = _lack(runs, prepared.cutoff)
    if lack:
        return Diagnosis(verdict="too_little_data", missing=lack, warnings=tuple(notes))
    try:
        start = fit_free_run(runs, certainty=0.0)
    except DataError as error:
        return Diagnosis(verdict="too_little_data", missing=str(error), warnings=tuple(notes))
    report("Fitting the model without effects …")
    forms = forms_for(vehicle, channels(runs), [run.trial.name for run in prepared.items])
    pieces = pieces_of(prepared.items, vehicle, prepared.cutoff)
    logged = drivers((*prepared.items, *runs, *(piece.run for piece in pieces)))
    candidates = (*forms, *logged)
    whole = Records(prepared.items, vehicle, start)
    ahead = _by_horizons(whole, pieces, candidates, report)
    ahead.sea = _sea(whole, forms, pieces)
    ahead.settle()
    near = _by_innovations(Records(runs, vehicle, start), candidates, ahead, report)
    report("Testing what was found on trials that were not fitted …")
    work = ahead if near is None else near
    refused = work.decided()
    if not work.by_horizons and not work.explains:
        # What made it explain all is refused: then predictions tell.
        work = ahead
        refused = work.decided()
    notes = [_BY_HORIZONS] if work.by_horizons else notes
    cut_short = [_CUT_SHORT] if work.search.cut_short else []
    shrunk = [_SHRUNK.format(effect.title) for effect in work.shrunk]
    warnings = [*notes, *cut_short, *shrunk, *refused]
    try:
        return _diagnosis(work, [work.found(effect) for effect in work.final.effects], warnings)
    except DataError as error:
        return Diagnosis(verdict="too_little_data", missing=str(error), warnings=tuple(warnings))


def _by_horizons(full: Records, pieces: Sequence[Piece], candidates: Sequence[Effect], report: Report) -> _Work:
    """Search by predictions some time ahead.

    What is missing makes errors correlate for long, so that little counts. With the right cause they do so for less:
    the correlation is that which the best next cause would leave, whether that is claimed in the end or not.
    """
    records = HorizonRecords.of(full, full.start)
    base = final = _ahead((), records, HorizonLikelihood(records).first())
    if records.readings < _FEWEST_READINGS:
        return _Work(Search([], report), records, base, base, pieces)
    # No phase of a wave is known to a prediction.
    listed = [effect for effect in candidates if not effect.wave]
    while True:
        search = Search(listed, report, thorough=_is_far_off, margin=_MARGIN_AHEAD, least=0.0)
        final = search.run(final)
        others = (final, *(fitted for fitted in search.extensions(final) if fitted.plausible))
        likeliest = sorted(others, key=worth, reverse=True)[:_COUNTED]
        counted = (records.counting(fitted.likelihood.model(fitted.x)) for fitted in likeliest)
        closer = max(counted, key=lambda one: one.readings)
        if closer.readings < _MORE * records.readings:
            return _Work(search, records, base, final, pieces)
        records = closer
        base, final = (_ahead(fitted.effects, records, fitted.x) for fitted in (base, final))


def _sea(full: Records, forms: Sequence[Effect], pieces: Sequence[Piece]) -> Callable[[Fitted], Swell]:
    """What looks for waves beside a model, by each next reading, over some of the readings."""
    wave = next((form for form in forms if form.wave), None)
    seconds = sum(float(np.ptp(run.trial.time)) for run in full.runs)
    farthest = _THINNED_WAVES * time_constant(full.start, full.rate)
    interval = max(_interval(full), min(seconds / _READINGS, farthest))
    few = Records(full.runs, full.vehicle, full.start, interval=interval)
    return lambda beside: swell(few, beside, wave, pieces)


def _by_innovations(full: Records, candidates: Sequence[Effect], ahead: _Work, report: Report) -> _Work | None:
    """Search by the likelihood of each next reading, over some of the readings, from what ``ahead`` found on.

    None where that does not explain all: each next reading would then not tell what is missing.
    """
    report("Looking at each next reading …")
    quick = replace(full, interval=_interval(full))
    few = quick if ahead.swell is None else ahead.swell.plain.likelihood.records
    # Where it is hopeless over few readings it is so over more, which would take long to say.
    if few.interval > quick.interval and _is_hopeless_over(few, candidates, ahead):
        return None
    base = _base_of(quick)
    begun = _begun(base, ahead)
    search = Search(_beside(begun, candidates), report, hopeless=_is_hopeless)
    pieces = [Piece(number, -math.inf, math.inf, run) for number, run in enumerate(full.runs)]
    work = _Work(search, full, base, search.run(begun), pieces)
    return None if search.given_up or not work.explains else work


def _base_of(records: Records) -> Fitted:
    likelihood, x, _ = fit_base(records, free_run_r2(records.runs, records.start))
    return Fitted(likelihood, x, likelihood.cost(x))


def _beside(begun: Fitted, candidates: Sequence[Effect]) -> list[Effect]:
    """What each next reading is searched for: waves take long, and are found without such a search."""
    wavy = any(effect.wave for effect in begun.effects)
    return [effect for effect in candidates if wavy or not effect.wave]


def _is_hopeless_over(records: Records, candidates: Sequence[Effect], ahead: _Work) -> bool:
    begun = _begun(_base_of(records), ahead)
    taken = {effect.id for effect in begun.effects}
    more = [effect for effect in _beside(begun, candidates) if effect.id not in taken]
    return _is_hopeless(begun, screen(begun, more))


def _begun(base: Fitted, ahead: _Work) -> Fitted:
    """``base`` with the effects that predictions found, and with the waves beside them."""
    found, waves = ahead.final, ahead.swell
    effects, own = found.effects, found.x[found.likelihood.base :]
    if waves is not None and waves.fitted is not None and waves.confidence >= ESTABLISHED:
        effects, own = waves.fitted.effects, waves.fitted.x[waves.fitted.likelihood.base :]
    if not effects:
        return base
    x = np.concatenate((base.x, own))
    x[:DISTURBANCE] = found.x[:DISTURBANCE]
    likelihood = base.likelihood.like(effects)
    x, _ = likelihood.climb(np.clip(x, likelihood.low, likelihood.high))
    likelihood, x = loosened(likelihood, x)
    return Fitted(likelihood, x, likelihood.cost(x))


def _is_hopeless(current: Fitted, promises: Sequence[Promise]) -> bool:
    """Whether no causes more can leave white innovations and a disturbance within its limit.

    They would have to gain what whitening the innovations does, and what a larger disturbance does, or some share of
    it, for slopes may mislead. Where a disturbance above its limit gains nothing it is real: no cause takes it away.
    """
    likelihood, x = current.likelihood, current.x
    lacking = 0.0
    if likelihood.at_limit(x):
        likelihood = Likelihood(likelihood.records, UNLIMITED, likelihood.effects, likelihood.counted)
        x, cost = likelihood.climb(x)
        lacking = current.cost - cost
        if lacking < MARGIN:
            return True
    if not likelihood_is_white(likelihood, x):
        lacking += colour(likelihood, x)
    best = [forms[0].gain for forms in by_cause(promises)]
    return sum(best[:_TOGETHER]) < _SHARE * lacking


def _ahead(effects: tuple[Effect, ...], records: HorizonRecords, x: FloatArray) -> Fitted:
    likelihood = HorizonLikelihood(records, effects=effects)
    return Fitted(likelihood, *likelihood.climb(x))


def _is_far_off(fitted: Fitted) -> bool:
    """Whether the plain model misses so much that slopes do not tell what would help."""
    return not fitted.effects and simulated_r2(fitted.likelihood, fitted.x) < TRUSTED_R2


@dataclass(eq=False)
class _Work:
    """The search, its two models, and their trials held out."""

    search: Search
    full: Records
    base: Fitted
    final: Fitted
    pieces: Sequence[Piece]
    sea: Callable[[Fitted], Swell] | None = None
    swell: Swell | None = None
    shrunk: list[Effect] = field(default_factory=list)
    _folds: dict[Key, list[Fold]] = field(default_factory=dict)
    _refined: dict[Key, Fitted] = field(default_factory=dict)

    @property
    def by_horizons(self) -> bool:
        """Whether the simulation misses so much that predictions some time ahead are what is looked at."""
        return isinstance(self.base.likelihood, HorizonLikelihood)

    @property
    def explains(self) -> bool:
        """Whether the final model leaves white innovations, and no more disturbance than there may be."""
        likelihood, x = self.final.likelihood, self.final.x
        return likelihood_is_white(likelihood, x) and not likelihood.at_limit(x)

    def settle(self) -> None:
        """Look for waves beside the final model, and leave out what is not there for each next reading.

        The search goes on without that.
        """
        if self.sea is None:
            return
        for _ in range(_REFUSALS):
            self.search.report("Looking for waves …")
            self.swell = self.sea(self.final)
            idle = [one for one in self.final.effects if not one_size(self.final, self.swell.likelier, one)]
            if not idle:
                return
            for effect in idle:
                self.shrunk.append(effect)
                self.search.bar(effect)
                self.final = self.search.without(self.final, effect)
            self.final = self.search.run(self.final)
        self.final = self.base
        self.swell = self.sea(self.final)

    def decide(self) -> None:
        """Let every reading decide between an effect and a close rival: the quick look may have taken the wrong one."""
        for _ in range(_DECISIONS):
            found = (self.found(effect) for effect in self.final.effects)
            pairs = ((one, rival) for one in found for rival in one.rivals if rival.gain > one.worth)
            # A mere signal that is little better takes no name's place.
            named = (rival for one, rival in pairs if is_driver(one.effect) or not is_driver(rival.effect))
            allowed = (rival for rival in named if self.search.allows(rival.effect))
            if (better := next(allowed, None)) is None:
                return
            self.final = better.fitted

    def found(self, effect: Effect) -> Found:
        """What ``effect`` gains, its close rivals compared over every reading."""
        found = self.search.found(self.final, effect)
        close = [
            rival for rival in found.rivals[:2] if rival.gain > _CLOSE * found.worth and not is_driver(rival.effect)
        ]
        if not close or self.final.likelihood.records is self.full:
            return found
        here = worth(self.refined(self.final))
        exact = {r.effect.id: found.worth + worth(self.refined(r.fitted)) - here for r in close}
        rivals = (replace(rival, gain=exact.get(rival.effect.id, rival.gain)) for rival in found.rivals)
        return replace(found, rivals=tuple(sorted(rivals, key=lambda rival: -rival.gain)))

    def refined(self, fitted: Fitted) -> Fitted:
        """The same model fitted to every reading, once."""
        if fitted.key not in self._refined:
            likelihood = type(fitted.likelihood)(self.full, fitted.likelihood.limit, fitted.effects)
            self._refined[fitted.key] = Fitted(likelihood, *likelihood.climb(fitted.x, tolerance=0.05))
        return self._refined[fitted.key]

    def folds(self, fitted: Fitted) -> list[Fold]:
        """Each fourth of the trials predicted from the others, worked out once for a model."""
        if fitted.key not in self._folds:
            self._folds[fitted.key] = cross_validate(fitted, self.pieces)
        return self._folds[fitted.key]

    def held_out_gain(self, effect: Effect) -> float:
        """Log-likelihood of trials not fitted that ``effect`` gains."""
        scores = (self.folds(model) for model in (self.final, self.search.without(self.final, effect)))
        full, rest = map(log_likelihood, scores)
        return full - rest

    def decided(self) -> list[str]:
        """Decide between rivals and leave out what does not hold; what is said of that."""
        self.decide()
        return self.confirm()

    def confirm(self) -> list[str]:
        """Leave out what does not hold on trials not fitted, or is no larger than its uncertainty; say so.

        The search goes on without it: what it stood in for may now be found. What is likely and not established stays
        in until the end, so that nothing is taken up in its place.
        """
        warnings, likely = self._remainder(), list[str]()
        for _ in range(_REFUSALS):
            doubts = ((one, self._doubt(one)) for one in self.final.effects if one.key not in likely)
            effect, doubt = next(((effect, doubt) for effect, doubt in doubts if doubt), (None, ""))
            if effect is None:
                break
            warnings.append(f"{effect.title} {doubt}: it is not claimed.")
            self.search.bar(effect)
            if doubt == _LIKELY:
                likely.append(effect.key)
                continue
            self.final = self.search.run(self.search.without(self.final, effect))
            self.decide()
            self.settle()
        for effect in [one for one in self.final.effects if one.key in likely]:
            self.final = self.search.without(self.final, effect)
        while likely and (effect := next((one for one in self.final.effects if self._doubt(one)), None)):
            warnings.append(f"{effect.title} shows only beside what is not established: it is not claimed.")
            self.final = self.search.without(self.final, effect)
        # Its own limit of the disturbance suits a model without effects best.
        self.final = self.final if self.final.effects else self.base
        return warnings

    def _remainder(self) -> list[str]:
        """What would be added, were not so much explained already that it may be the form of that."""
        following = self.search.best_extension(self.final)
        if following is None or worth(following) - worth(self.final) < self.search.threshold:
            return []
        effect, gain = following.effects[-1], self.final.cost - following.cost
        why = (
            "enough for a cause; but the search ended before it was taken up"
            if self.search.pays(following, self.final)
            else "little beside what was found: nature's form of that is never quite the equation's, and this may be "
            "no more than the difference"
        )
        return [f"{effect.title} would gain a log-likelihood of {gain:.0f}, {why}. It is not claimed."]

    def _doubt(self, effect: Effect) -> str:
        gain, size = self.held_out_gain(effect), _significance(self.final, effect)
        if gain <= 0.0:
            return f"fits these trials but predicts trials not fitted worse (log-likelihood {gain:.1f})"
        if self.final.beyond(effect):
            return "would be larger here than there is"
        if size < (_SIGNIFICANT_AHEAD if self.by_horizons else _SIGNIFICANT):
            return f"is only {size:.1f} standard errors away from nothing"
        sure = self.confidence(self.found(effect), gain)
        if sure < ESTABLISHED:
            return _LIKELY if sure >= _EVEN else "is possible, and not established"
        return ""

    def confidence(self, found: Found, held_out_gain: float) -> float:
        """Probability that the cause, or one not told from it, acts; on trials not fitted it has to gain too."""
        # A signal that the cause follows, or that follows it, is not another cause.
        worths = {rival.effect.id: rival.gain for rival in found.rivals if not is_driver(rival.effect)}
        worths[found.effect.id] = found.worth
        alike = (found.effect.id, *(effect.id for effect in undecided(found, self.margin(found.worth))))
        rest = self.search.without(self.final, found.effect)
        white = likelihood_is_white(self.final.likelihood, self.final.x)
        # Part of it may be no more than how nature's form of the others differs from the equations'.
        less = max(found.worth - held_out_gain, 0.0) + self.search.form_doubt(rest, white=white)
        sure = confidence({name: worth - less for name, worth in worths.items()}, alike, self.search.tried)
        return min(sure, stands_out(self.final, found.effect)) if of_one_trial(found.effect) and not white else sure

    def margin(self, worth: float) -> float:
        """By so much a rival is beaten of a cause that is worth so much.

        Where the model explains the data to the noise, likelihood decides; else part of any gain is that of its form.
        """
        white = likelihood_is_white(self.final.likelihood, self.final.x)
        return _BEATEN[0] + (0.0 if white else min(_BEATEN[1] * worth, _BEATEN[2]))

    def suspects(self) -> list[Suspected]:
        """Causes that are likely or possible beside the final model, the most likely first.

        The first stands for its class; each other for itself, were it the one that acts.
        """
        beside = self.search.candidates_beside(self.final)
        named = [rival for rival in beside if not is_driver(rival.effect)]
        passed = {effect.id for effect in self.shrunk} | set(() if self.swell is None else self.swell.passed_for)
        left = [rival for rival in named if rival.gain > 0.0 and rival.effect.id not in passed]
        white = likelihood_is_white(self.final.likelihood, self.final.x)
        doubt = self.search.form_doubt(self.final, white=white)

        def odds(names: Collection[Rival], less: float = 0.0) -> float:
            worths = {rival.effect.id: rival.gain - doubt - less for rival in left}
            return confidence(worths, [rival.effect.id for rival in names], self.search.tried)

        # Whether one acts takes a fit: only those are asked that are possible if they do.
        acts = cache(self._acts)
        found: list[Suspected] = []
        for rival in left.copy():
            least = max(rival.gain - _TOLD, 0.0)
            near = [] if found else [other for other in left if other is not rival and other.gain > least]
            if odds([rival, *near]) < POSSIBLE:
                break
            if not acts(rival):
                left.remove(rival)
                continue
            alike = [other for other in near if acts(other)]
            gain = log_likelihood(self.folds(rival.fitted)) - log_likelihood(self.folds(self.final))
            sure = odds([rival, *alike], max(rival.gain - gain, 0.0))
            if of_one_trial(rival.effect) and not white:
                sure = min(sure, stands_out(rival.fitted, rival.effect))
            if sure >= POSSIBLE:
                found.append(Suspected(rival, sure, gain, tuple(alike)))
        return sorted(found, key=lambda one: -one.confidence)

    def _acts(self, rival: Rival) -> bool:
        """Whether ``rival`` has a size, and where predictions are looked at, each next reading shows as much of it."""
        if _significance(rival.fitted, rival.effect) < _SUSPECTED_SIZE:
            return False
        return self.swell is None or one_size(rival.fitted, self.swell.likelier, rival.effect)


@dataclass(frozen=True, eq=False)
class Suspected:
    """A cause that is likely or possible beside the final model, and the ``others`` that it is not told from."""

    rival: Rival
    confidence: float
    held_out_gain: float
    others: tuple[Rival, ...]


def undecided(found: Found, margin: float) -> tuple[Effect, ...]:
    """Rivals of ``found`` that neither beat it by ``margin`` nor are so beaten; of a mere signal that is not asked."""
    return tuple(
        rival.effect for rival in found.rivals if abs(rival.gain - found.worth) < margin and not is_driver(rival.effect)
    )


def _lack(runs: Sequence[Run], cutoff: float) -> str:
    """What is missing for a diagnosis, and what to run; ``cutoff`` in Hz is the low pass's."""
    if len(runs) < FEWEST_TRIALS:
        part = shortest_part(runs, cutoff)
        seconds = sum(recorded(run.trial) for run in runs)
        return (
            f"there are too few trials ({len(runs)}, {seconds:.0f} s in all) to hold any out and test a cause on, and "
            f"they are too short to be cut into {FEWEST_TRIALS} parts of {part:.0f} s. Record more runs, of other "
            "kinds (a hold the other way, a sine, a coast-down)."
        )
    axis = runs[0].trial.axis
    if all(run.trial.driven for run in runs) and not any(np.any(run.torque != 0.0) for run in runs):
        return f"no thruster ever runs: there is no {axis.push} to explain the motion with. Log a run under thrust."
    if not any(_moves(run) for run in runs):
        moves, move = ("turns", "turn") if axis.angular else ("moves", "move")
        return (
            f"the vehicle never {moves}: its {axis.rate_words} is no larger than the sensor's noise makes it. Check "
            f"that {axis.position} in rovid.toml is the vehicle's, and run sines, steps or a pseudo-random command "
            f"that {move} it."
        )
    return ""


def _moves(run: Run) -> bool:
    rate = run.rates.rate[np.isfinite(run.rates.rate)]
    return bool(np.linalg.norm(rate) > _MOTION * run.rates.rate_noise * math.sqrt(len(rate)))


def _interval(full: Records) -> float:
    wanted = min(_THINNED * time_constant(full.start, full.rate), _THINNED_SECONDS)
    period = float(np.median([run.trial.period for run in full.runs]))
    return wanted if wanted >= 2.0 * period else 0.0


def _significance(fitted: Fitted, effect: Effect) -> float:
    """Distance of the effect's size from nothing, in standard errors."""
    away, error = size_of(fitted, effect, sandwich=not likelihood_is_white(fitted.likelihood, fitted.x))
    return abs(away) / error if error > 0.0 else math.inf


def _diagnosis(work: _Work, found: Sequence[Found], warnings: list[str]) -> Diagnosis:
    base, final = work.refined(work.base), work.refined(work.final)
    white = likelihood_is_white(final.likelihood, final.x)
    estimate = _across_forms(work, _estimate(final, white=white))
    base_estimate = _estimate(base, white=likelihood_is_white(base.likelihood, base.x))
    # What is missing makes one of them uncertain; where both are, the vehicle was not excited.
    require_inertia(min(base_estimate, estimate, key=_uncertainty), CERTAINTY)
    estimate = estimate.with_scale_doubt(scale_doubt(final.likelihood, final.x))
    warnings.extend(estimate.warnings)
    findings = [_finding(work, one, estimate) for one in found if not is_driver(one.effect)]
    findings = [replace(one, plan=_telling(work, one)) if one.undecided else one for one in findings]
    signals = tuple((one.effect, one.worth) for one in found if is_driver(one.effect))
    at_limit = final.likelihood.at_limit(final.x)
    if at_limit:
        warnings.append(
            f"What is left would be a disturbance above {100 * final.likelihood.limit:.2g} % of the torque in use: "
            "something is still missing, and it follows no other logged signal."
        )
    suspects = tuple(_suspect(work, one) for one in work.suspects())
    extended = _side(work, work.final, final, estimate, work.final)
    if work.swell is not None and work.swell.fitted is not None and work.swell.confidence >= POSSIBLE:
        waves = _waves(work.swell, work.swell.fitted)
        if waves.confidence >= ESTABLISHED:
            findings, extended = [*findings, waves], _with_waves(extended, waves)
        else:
            suspects = tuple(sorted((*suspects, waves), key=lambda one: -one.confidence))
    unexplained = bool(signals) or at_limit or simulated_r2(final.likelihood, final.x) < TRUSTED_R2
    verdict = "found" if findings else "suspected" if suspects else "unexplained" if unexplained else "nothing_found"
    disturbance, _ = final.likelihood.disturbance(final.x)
    return Diagnosis(
        verdict=verdict,
        base=_side(work, work.base, base, base_estimate, work.search.without_any(work.final)),
        extended=extended,
        findings=tuple(sorted(findings, key=lambda finding: -finding.gain)),
        suspects=suspects,
        horizons=_ahead_of(work),
        signals=signals,
        unexplained_share=disturbance**2 / (disturbance**2 + work.full.torque**2),
        noise_floor=_noise_floor(final),
        detectable=_detectable(work),
        warnings=tuple(warnings),
    )


def _side(work: _Work, quick: Fitted, fitted: Fitted, estimate: Estimate, fair: Fitted) -> Side:
    """``fair`` is the same model with as much disturbance as the other side has, for only such likelihoods compare."""
    held = replace(simulate_folds(quick, work.folds(quick)), log_likelihood=log_likelihood(work.folds(fair)))
    return Side(model=fitted.likelihood.model(fitted.x), estimate=estimate, held_out=held)


def _estimate(fitted: Fitted, *, white: bool) -> Estimate:
    x = canonical(fitted.likelihood, fitted.x)
    names = fitted.likelihood.model(x).names
    doubt, said = form_doubt(fitted.likelihood, x)
    # What follows a signal is a dependence; it is no parameter of the vehicle.
    at = [k for k, name in enumerate(names) if not name.startswith(PREFIX)]
    estimate = Estimate(
        names=tuple(names[k] for k in at),
        values=physical(fitted.likelihood, x)[at],
        covariance=(covariance(fitted.likelihood, x, sandwich=not white) + doubt)[np.ix_(at, at)],
        axis=fitted.likelihood.records.axis,
        method=fitted.likelihood.method,
        samples=len(fitted.likelihood.records.trial),
        warnings=tuple(said),
    )
    return estimate if fitted.likelihood.records.driven else estimate.undriven()


def _across_forms(work: _Work, estimate: Estimate) -> Estimate:
    """``estimate`` with what models nearly as good, of another form or cause each, say of its parameters besides.

    To the variance comes that between the models (Hoeting et al. 1999). Each has its weight by the likelihood where the
    innovations are white; else none is nature's form, and all that explain nearly as much have the same weight.
    """
    final, search = work.final, work.search
    white = likelihood_is_white(final.likelihood, final.x)
    moved, weights = [], []
    for effect in final.effects:
        rest = search.without(final, effect)
        earned = worth(final) - worth(rest)
        for fit in search.extensions(rest):
            if not fit.plausible or is_driver(fit.effects[-1]) or fit.key == final.key:
                continue
            alike = not white and worth(fit) - worth(rest) >= _NEARLY * earned
            weights.append(1.0 if alike else math.exp(min(worth(fit) - worth(final), 0.0)))
            moved.append(_moved(estimate, fit))
    share = np.array(weights) / (1.0 + sum(weights))
    off = np.array(moved).reshape(-1, len(estimate.names))
    return replace(estimate, covariance=estimate.covariance + off.T @ (off * share[:, np.newaxis]))


def _moved(estimate: Estimate, fit: Fitted) -> FloatArray:
    """(p,) how far each parameter of ``estimate`` is elsewhere in ``fit``; zero where that has none like it."""
    model = fit.likelihood.model(canonical(fit.likelihood, fit.x))
    there = dict(zip(_alike(model.names, fit.effects), model.values.tolist(), strict=True))
    here = zip(_alike(estimate.names, fit.effects), estimate.values.tolist(), strict=True)
    return np.array([there.get(name, value) - value for name, value in here])


def _alike(names: Sequence[str], effects: Sequence[Effect]) -> list[str]:
    """``names`` of parameters, those of forms that share an effect's parameters without the form."""
    apart = {effect.key for effect in effects if effect.each_thruster}
    return [name if name.rpartition(".")[0] in apart else without_form(name) for name in names]


def _uncertainty(estimate: Estimate) -> float:
    return estimate.standard_error("inertia") / estimate.value("inertia")


def _untried(work: _Work, effect: Effect) -> tuple[Effect, ...]:
    """Causes that pass for ``effect`` and that no log tells of, where not all is explained."""
    tried = {candidate.id for candidate in work.search.candidates}
    axis = work.full.axis.name
    passing = (other for other in CATALOGUE if effect.id in other.rivals and other.needs and other.id not in tried)
    return tuple(other for other in passing if work.by_horizons and (not other.axes or axis in other.axes))


def _finding(work: _Work, found: Found, estimate: Estimate) -> Finding:
    effect, held_out_gain = found.effect, work.held_out_gain(found.effect)
    return Finding(
        effect=effect,
        estimate=_own(estimate, effect),
        gain=found.gain,
        worth=found.worth,
        held_out_gain=held_out_gain,
        confidence=work.confidence(found, held_out_gain),
        rivals=found.rivals,
        undecided=(*undecided(found, work.margin(found.worth)), *_untried(work, effect)),
    )


def _suspect(work: _Work, suspected: Suspected) -> Finding:
    """What is said of a cause that is not established: its size where it is put in beside the final model."""
    rival, fitted = suspected.rival, work.refined(suspected.rival.fitted)
    estimate = _estimate(fitted, white=False)
    return Finding(
        effect=rival.effect,
        estimate=_own(estimate, rival.effect),
        gain=work.final.cost - rival.fitted.cost,
        worth=rival.gain,
        held_out_gain=suspected.held_out_gain,
        confidence=suspected.confidence,
        rivals=tuple(one for one in work.search.candidates_beside(work.final) if one.effect is not rival.effect),
        undecided=(*(other.effect for other in suspected.others), *_untried(work, rival.effect)),
    )


def _waves(swell: Swell, fitted: Fitted) -> Finding:
    effect, estimate = fitted.effects[-1], _estimate(fitted, white=False)
    return Finding(
        effect=effect,
        estimate=_own(estimate, effect),
        gain=swell.gain,
        worth=swell.worth,
        held_out_gain=swell.held_out_gain,
        confidence=swell.confidence,
        rivals=(),
        undecided=(),
    )


def _own(estimate: Estimate, effect: Effect) -> Estimate:
    """Of the parameters of ``effect`` alone."""
    at = [estimate.names.index(f"{effect.key}.{parameter.name}") for parameter in effect.parameters]
    names, scatter = tuple(estimate.names[k] for k in at), estimate.covariance[np.ix_(at, at)]
    return replace(estimate, names=names, values=estimate.values[at], covariance=scatter)


def _with_waves(side: Side, waves: Finding) -> Side:
    """``side`` with waves, which no free-running simulation shows, beside all else."""
    model, estimate, own = side.model, side.estimate, waves.estimate
    effects = (*model.effects, waves.effect)
    values = (*model.effect_values, *own.values.tolist())
    return replace(
        side,
        model=replace(model, effects=effects, effect_values=values),
        estimate=replace(
            estimate,
            names=(*estimate.names, *own.names),
            values=np.concatenate((estimate.values, own.values)),
            covariance=linalg.block_diag(estimate.covariance, own.covariance),
        ),
    )


def _ahead_of(work: _Work) -> tuple[Ahead, ...]:
    base, extended = (errors_ahead(fitted, work.folds(fitted), work.pieces) for fitted in (work.base, work.final))
    constant = time_constant(work.full.start, work.full.rate)
    return tuple(
        Ahead(seconds=horizon * constant, base=float(one), extended=float(other))
        for horizon, one, other in zip(HORIZONS, base, extended, strict=True)
        if math.isfinite(one) and math.isfinite(other)
    )


def _telling(work: _Work, finding: Finding) -> Plan | None:
    """Runs that would tell ``finding`` from its nearest rival; None where there is no such run."""
    rival = next((one for one in finding.rivals if one.effect is finding.undecided[0]), None)
    if rival is None:
        return None  # it could not be tried: no run tells without its signal
    models = {finding.effect.title: work.final, rival.effect.title: rival.fitted}
    if any(is_driver(effect) for fitted in models.values() for effect in fitted.effects):
        return None  # nobody knows what the signal will be
    vehicle = work.full.vehicle
    assert vehicle is not None  # noqa: S101 - a diagnosis has one
    beliefs = []
    for name, fitted in models.items():
        full = work.refined(fitted)
        beliefs.append(Belief.of(name, full.likelihood, full.x, covariance(full.likelihood, full.x, sandwich=False)))
    try:
        return plan(beliefs, vehicle, [run.trial for run in work.full.runs], Limits())
    except DataError:
        return None


def _noise_floor(fitted: Fitted) -> float:
    """RMS rate that the disturbance drives, and what the low pass leaves of the sensor's noise."""
    noise = float(np.median([run.rates.rate_noise for run in fitted.likelihood.records.runs]))
    return math.hypot(fitted.likelihood.driven_rate(fitted.x), noise)


def _detectable(work: _Work) -> tuple[tuple[Effect, float], ...]:
    """Size of each effect not found that would have been seen, to first order."""
    work.search.extensions(work.final)
    plain: dict[str, Promise] = {}
    for promise in work.search.promises[work.final.key]:
        if not is_driver(promise.effect):
            plain.setdefault(promise.effect.id, promise)
    scales, sizes = work.full.scales, []
    for promise in plain.values():
        size, start = promise.effect.parameters[0], promise.effect.parameters[0].starts[0]
        price = 0.5 * math.log(work.final.likelihood.count) * len(promise.effect.parameters)
        if promise.power > 0.0 and not size.endless:
            share = math.sqrt((work.search.threshold + price) / promise.power)
            seen = abs(share * (start - size.null))
            # What would have to be larger than there is would not be seen at all.
            real = seen <= max(size.high - size.null, size.null - size.low)
            sizes.append((promise.effect, seen * scales.of(size) if real else math.inf))
    return tuple(sizes)


def not_identifiable(vehicle: Vehicle) -> tuple[str, ...]:
    """What data of ``vehicle`` cannot show at all."""
    if not vehicle.thrusters:
        return ("inertia", "rate_scale")
    thrusters = [thruster for thruster in vehicle.thrusters if thruster.curve is not None]
    return NEVER_SHOWN if len(thrusters) > 1 else (*NEVER_SHOWN, "thruster_imbalance")
