"""The two ways to look for causes: by predictions some time ahead, and by each next reading."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.diagnose.bic import ITERATIONS, bic_score, fit_coarse, is_plausible
from rovid.diagnose.candidate_fits import gains_by_cause
from rovid.diagnose.fit_cache import FitCache
from rovid.diagnose.posterior import ESTABLISHED, PRIOR_ODDS
from rovid.diagnose.splitting import CvPiece
from rovid.diagnose.stepwise import MARGIN, Gains, Hopeless, ProgressCallback, StepwiseSearch
from rovid.diagnose.validation import Work
from rovid.diagnose.wave_test import WaveTest, run_wave_test
from rovid.effects import Effect
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.maximum_likelihood import DISTURBANCE_LIMITS, INNOVATIONS_R2, fit_innovations, loosen_limit
from rovid.estimate.multi_step_data import MultiStepData, time_constant
from rovid.estimate.multi_step_likelihood import MultiStepLikelihood
from rovid.estimate.objective import UNLIMITED, Key, NegativeLogLikelihood
from rovid.estimate.output_error import free_run_r2
from rovid.estimate.parametrization import DISTURBANCE

# By predictions an addition has to gain so much log-likelihood: with the number of causes tried it is then established.
_MARGIN_AHEAD = math.log(ESTABLISHED / (1.0 - ESTABLISHED) / PRIOR_ODDS)
# The search looks at readings this share of the vehicle's time constant apart, and no farther than so many seconds.
_THINNED, _THINNED_SECONDS = 0.05, 0.2
# For waves so many readings do, this share of the time constant apart at most.
_READINGS, _THINNED_WAVES = 6000, 0.1
# Readings so many times fewer are looked at first, whether each next reading can tell what is missing.
_FEWER = 4.0
# Fewer predictions than so many tell nothing: the logs are too short beside the vehicle's time constant.
_FEWEST_READINGS = 2.0
# A model that explains all takes so few steps from what predictions found.
_NEAR_BY = 8
# The best of so many more causes may be missing together from what predictions found; slopes promise such a share.
_TOGETHER, _SHARE = 3, 0.25
# Of several causes, one has so much of what is missing; else the way to them is not straight.
_STRAIGHT = 0.3
# A search after which no more predictions count than so many times those before is the last.
_MORE = 1.2
# So many of the likeliest models tell how many predictions count.
_COUNTED = 6


def by_horizons(
    full: InnovationData,
    pieces: Sequence[CvPiece],
    candidates: Sequence[Effect],
    report: ProgressCallback,
    is_enough: Callable[[FitResult], bool] | None,
) -> Iterator[Work]:
    """Search by predictions some time ahead: first what was found once it ``is_enough``, and at last all that there is.

    What is missing makes errors correlate for long, so that little counts. With the right cause they do so for less:
    the correlation is that which the best next cause would leave, whether that is claimed in the end or not.
    """
    records = MultiStepData.from_data(full, full.initial_model)
    base = final = _ahead((), records, MultiStepLikelihood(records).parametrization.initial())
    if records.effective_count < _FEWEST_READINGS:
        yield Work(StepwiseSearch([], report), records, base, base, pieces, by_horizons=True)
        return
    # No phase of a wave is known to a prediction.
    listed = _but_waves(candidates)
    while True:
        search = StepwiseSearch(
            listed, report, is_enough=is_enough, thorough=_is_far_off, margin=_MARGIN_AHEAD, least=0.0
        )
        found = search.run(final)
        if search.has_enough:
            yield Work(search, records, base, found, pieces, by_horizons=True)
            # Whoever asks on is told what is found by searching as if nothing had been enough.
            is_enough = None
            continue
        final = found
        closer = _counting(records, final, search)
        if closer.effective_count < _MORE * records.effective_count:
            # What is refused of it is not enough either.
            search.is_enough = None
            yield Work(search, records, base, final, pieces, by_horizons=True)
            return
        records = closer
        base = _ahead(base.effects, records, base.x)
        final = _ahead(final.effects, records, final.x)


def _counting(records: MultiStepData, final: FitResult, search: StepwiseSearch) -> MultiStepData:
    """``records`` by that one of the likeliest models which makes the most predictions count."""
    plausible = [fitted for fitted in search.extensions(final) if is_plausible(fitted)]
    likeliest = sorted((final, *plausible), key=bic_score, reverse=True)[:_COUNTED]
    counted = (records.reweighted(fitted.model) for fitted in likeliest)
    return max(counted, key=lambda one: one.effective_count)


def few_of(full: InnovationData) -> InnovationData:
    """As few of the readings as still show waves."""
    seconds = sum(float(np.ptp(run.trial.time)) for run in full.runs)
    farthest = _THINNED_WAVES * time_constant(full.initial_model, full.rms_rate)
    return replace(full, interval=max(interval_of(full), min(seconds / _READINGS, farthest)))


def wave_search(
    few: InnovationData, forms: Sequence[Effect], pieces: Sequence[CvPiece], report: ProgressCallback
) -> Callable[[FitResult], WaveTest]:
    """What looks for waves beside a model, by each next of ``few`` readings."""
    wave = next((form for form in forms if form.is_wave), None)

    def look(beside: FitResult) -> WaveTest:
        report("Looking for waves …")
        return run_wave_test(few, beside, wave, pieces)

    return look


@dataclass(frozen=True, eq=False)
class ByInnovations:
    """Search by the likelihood of each next reading of ``full``, over some of them.

    Where there are many, ``few`` tell beforehand whether that pays.
    """

    full: InnovationData
    few: InnovationData
    candidates: Sequence[Effect]
    report: ProgressCallback
    _bases: dict[float, FitResult] = field(default_factory=dict)
    _explained: dict[Key, bool] = field(default_factory=dict)
    _known: dict[tuple[float, int], FitCache] = field(default_factory=dict)

    def explains(self, found: FitResult) -> bool:
        """Whether the effects of ``found`` leave white innovations, and no more disturbance than there may be."""
        misfit, x = self._beginning(self._first, found, found)
        if misfit.key not in self._explained:
            # A model that does is near by; and what the widest limit does not leave, none does.
            near = fit_coarse(misfit.with_limit(max(DISTURBANCE_LIMITS)), x, _NEAR_BY)
            self._explained[misfit.key] = near.is_white and not near.at_limit
        return self._explained[misfit.key]

    def at_once(self, look_for_waves: Callable[[FitResult], WaveTest]) -> Work | None:
        """Search from nothing on, and ``look_for_waves`` beside what that finds.

        None where the way is not straight, or what is found does not explain all: then predictions tell where to begin.
        """
        base = self._base(self._quick)
        work = None if _is_far_off(base) else self._searched(base, base, _leads_astray)
        if work is None:
            return None
        waves = look_for_waves(work.final).established
        return work if waves is None else self._searched(waves, work.final, _is_hopeless)

    def search(self, ahead: Work) -> Work | None:
        """Search on from what ``ahead`` found.

        None where that does not explain all: each next reading would then not tell what is missing.
        """
        waves = None if ahead.waves is None else ahead.waves.established
        return self._searched(ahead.final if waves is None else waves, ahead.final, _is_hopeless)

    def _searched(self, found: FitResult, predicted: FitResult, hopeless: Hopeless) -> Work | None:
        """Search from the effects of ``found`` on; None where that is ``hopeless``, or does not explain all."""
        self.report("Looking at each next reading …")
        # Where it is hopeless over few readings it is so over more, which would take long to say.
        if self._first is not self._quick:
            begun = self._begun(self._first, found, predicted)
            promised = self._search(begun).score_tests
            if hopeless(begun, lambda: gains_by_cause(promised(begun))):
                return None
        begun = self._begun(self._quick, found, predicted)
        search = self._search(begun, hopeless)
        pieces = [CvPiece(number, -math.inf, math.inf, run) for number, run in enumerate(self.full.runs)]
        work = Work(search, self.full, self._base(self._quick), search.run(begun), pieces)
        if search.given_up or not work.explains:
            return None
        return work

    @cached_property
    def _quick(self) -> InnovationData:
        interval = interval_of(self.full)
        return replace(self.full, interval=interval) if interval > self.full.interval else self.full

    @property
    def _first(self) -> InnovationData:
        return looked_first(self.few, self._quick)

    def _base(self, records: InnovationData) -> FitResult:
        """The model without effects, by each next reading of ``records``."""
        if records.interval not in self._bases:
            self._bases[records.interval] = fit_innovations(records, free_run_r2(records.runs, records.initial_model))
        return self._bases[records.interval]

    def _beginning(
        self, records: InnovationData, found: FitResult, predicted: FitResult
    ) -> tuple[NegativeLogLikelihood, FloatArray]:
        """Misfit with the effects of ``found``, and (p,) where to climb from, by the inertia and drag ``predicted``."""
        base = self._base(records)
        x = np.concatenate((base.x, found.x[len(found.common_coordinates) :]))
        x[:DISTURBANCE] = predicted.x[:DISTURBANCE]
        return base.objective.with_effects(found.effects), x

    def _begun(self, records: InnovationData, found: FitResult, predicted: FitResult) -> FitResult:
        """The model with the effects of ``found``, fitted."""
        if not found.effects:
            return self._base(records)
        return loosen_limit(fit(*self._beginning(records, found, predicted)))

    def _search(self, begun: FitResult, hopeless: Hopeless | None = None) -> StepwiseSearch:
        """With what is known already, of the same readings and the same candidates."""
        forms = _beside(begun, self.candidates)
        known = self._known.setdefault((begun.data.interval, len(forms)), FitCache())
        return StepwiseSearch(forms, self.report, is_hopeless=hopeless, known=known)


def looked_first(few: InnovationData, quick: InnovationData) -> InnovationData:
    """Which are looked at before all that a search looks at: the few, where those of a ``quick`` look are many more."""
    return few if len(quick.run_index) > _FEWER * len(few.run_index) else quick


def _beside(begun: FitResult, candidates: Sequence[Effect]) -> list[Effect]:
    """What each next reading is searched for: waves take long, and are found without such a search."""
    if len(_but_waves(begun.effects)) < len(begun.effects):
        return list(candidates)
    return _but_waves(candidates)


def _but_waves(effects: Sequence[Effect]) -> list[Effect]:
    """Those of the ``effects`` that need no phase."""
    return [effect for effect in effects if not effect.is_wave]


def _is_hopeless(current: FitResult, gains: Gains) -> bool:
    """Whether no causes more, by what each ``gains``, can leave white innovations and a disturbance within its limit.

    They would have to gain what is lacking, or some share of it, for slopes may mislead. Where a disturbance above its
    limit gains nothing it is real: no cause takes it away.
    """
    disturbance, colour = _lacking(current)
    if current.at_limit and disturbance < MARGIN:
        return True
    lacking = disturbance + colour
    # Where nothing is, nothing has to be screened to know.
    return lacking > 0.0 and sum(gains()[:_TOGETHER]) < _SHARE * lacking


def _leads_astray(current: FitResult, gains: Gains) -> bool:
    """Whether the best single cause gains too little of what is lacking for the search to be on a straight way.

    Beside a cause a disturbance at its limit need not be real: another may take it away.
    """
    disturbance, colour = _lacking(current)
    if current.at_limit and disturbance < MARGIN and not current.effects:
        return True
    if current.is_white and not current.at_limit:
        return False
    return max(gains(), default=0.0) < max(_STRAIGHT * (disturbance + colour), MARGIN)


def _lacking(current: FitResult) -> tuple[float, float]:
    """Log-likelihood that a disturbance beyond its limit would gain, and white innovations beside that."""
    unlimited = current
    if current.at_limit:
        unlimited = fit_coarse(current.objective.with_limit(UNLIMITED), current.x, ITERATIONS)
    return current.value - unlimited.value, 0.0 if unlimited.is_white else unlimited.whitening_gain


def _ahead(effects: tuple[Effect, ...], records: MultiStepData, x: FloatArray) -> FitResult:
    """The likeliest model by predictions some time ahead, from (p,) ``x`` on."""
    return fit(MultiStepLikelihood(records, effects=effects), x)


def _is_far_off(fitted: FitResult) -> bool:
    """Whether the plain model misses so much that slopes do not tell what would help."""
    return not fitted.effects and fitted.simulated_r2 < INNOVATIONS_R2


def interval_of(full: InnovationData) -> float:
    """How far apart, in s, the readings are that a search looks at."""
    wanted = min(_THINNED * time_constant(full.initial_model, full.rms_rate), _THINNED_SECONDS)
    period = float(np.median([run.trial.sampling_interval for run in full.runs]))
    return wanted if wanted >= 2.0 * period else 0.0
