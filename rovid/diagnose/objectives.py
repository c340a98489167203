"""The two objectives of the search: likelihood of one-step innovations, and likelihood of multi-step predictions.

Both have the same interface: `data` of the final fit, `pieces` for cross-validation, `base` model, and `search`.
"""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from importlib import import_module
from typing import ClassVar, Self

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.budget import Budget
from rovid.core.threads import require_address_space
from rovid.diagnose.candidate_fits import FitCache, bic_score, fit_coarse, is_plausible
from rovid.diagnose.cross_validation import CvPiece, cv_pieces, has_pause
from rovid.diagnose.signal_regressors import signal_regressors
from rovid.diagnose.stepwise import Gains, StepwiseSearch, StopRule
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.diagnose.wave_test import WaveTest, run_wave_test
from rovid.effects import Effect, forms_for
from rovid.effects.clock_offset import CLOCKS_APART
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.maximum_likelihood import (
    DISTURBANCE_LIMITS,
    INNOVATIONS_R2,
    MAX_R2_LOSS,
    NOTHING_R2,
    REAL_DISTURBANCE_LIMIT,
    fit_innovations,
    loosen_limit,
)
from rovid.estimate.multi_step import MultiStepData, MultiStepLikelihood
from rovid.estimate.objective import UNLIMITED, ModelKey, NegativeLogLikelihood
from rovid.estimate.output_error import fit_output_error
from rovid.estimate.parametrization import DISTURBANCE
from rovid.trial.preprocessing import PreparedRuns, Run, shared_channels
from rovid.trial.vehicle import Vehicle

# BIC gain in nats of an effect whose posterior probability alone reaches `THRESHOLDS.established`.
_MULTI_STEP_MARGIN = math.log(THRESHOLDS.established / (1.0 - THRESHOLDS.established) / THRESHOLDS.prior_odds)


@dataclass(frozen=True, kw_only=True, eq=False)
class MultiStepObjective:
    """Likelihood of multi-step predictions, from half to eight time constants ahead; ``data`` sets their weights."""

    multi_step: ClassVar[bool] = True
    data: MultiStepData
    pieces: Sequence[CvPiece]
    base: FitResult
    candidates: Sequence[Effect]
    budget: Budget

    @classmethod
    def from_data(
        cls, full: InnovationData, pieces: Sequence[CvPiece], candidates: Sequence[Effect], budget: Budget
    ) -> Self:
        """Weighted by the prediction errors of the initial model."""
        data = MultiStepData.from_data(full, full.initial_model)
        base = fit(MultiStepLikelihood(data, effects=()), MultiStepLikelihood(data).parametrization.initial())
        # Predictions do not know the phase of waves. With too few predictions, no cause is searched.
        searched = without_waves(candidates) if data.effective_count >= THRESHOLDS.min_predictions else []
        return cls(data=data, pieces=pieces, base=base, candidates=searched, budget=budget)

    def search(self, is_adequate: Callable[[FitResult], bool] | None) -> StepwiseSearch:
        """Search by this objective."""
        return StepwiseSearch(
            self.candidates,
            self.budget,
            is_adequate=is_adequate,
            fits_poorly=fits_poorly,
            margin=_MULTI_STEP_MARGIN,
            screening_share=0.0,
        )

    def reweighted(self, search: StepwiseSearch, found: FitResult) -> Self:
        """The objective with the most independent predictions among the likeliest models next to ``found``.

        A missing effect correlates the errors, and few predictions count. The correlation of interest is that of the
        best next effect, whether this effect is established or not.
        """
        models = found, *filter(is_plausible, search.extensions(found))
        likeliest = sorted(models, key=bic_score, reverse=True)[: THRESHOLDS.reweighting_models]
        reweighted = (self.data.reweighted(fitted.model) for fitted in likeliest)
        return replace(self, data=max(reweighted, key=lambda data: data.effective_count))

    def refit(self, fitted: FitResult) -> FitResult:
        """The model of ``fitted`` with the weights of this objective."""
        return fit(MultiStepLikelihood(self.data, effects=fitted.effects), fitted.x)


@dataclass(frozen=True, kw_only=True, eq=False)
class InnovationObjective:
    """Likelihood of one-step innovations of ``data``; ``wave_data`` are thinned for the test for waves."""

    multi_step: ClassVar[bool] = False
    data: InnovationData
    pieces: Sequence[CvPiece]
    wave_data: InnovationData
    candidates: Sequence[Effect]
    budget: Budget
    _bases: dict[float, FitResult] = field(default_factory=dict)
    _adequate: dict[ModelKey, bool] = field(default_factory=dict)
    _caches: dict[tuple[float, int], FitCache] = field(default_factory=dict)

    @property
    def base(self) -> FitResult:
        """Model without effects, fitted to the search data."""
        return self.base_of(self.search_data)

    @cached_property
    def search_data(self) -> InnovationData:
        """The data of the search, thinned where the sampling interval is short next to the time constant."""
        interval = _search_interval(self.data)
        return replace(self.data, interval=interval) if interval > self.data.interval else self.data

    @property
    def screening_data(self) -> InnovationData:
        """Data for the first screening: the wave data where the search data are many times more."""
        return screening_data(self.wave_data, self.search_data)

    @property
    def fits_with_one_cause(self) -> bool:
        """Whether a single cause makes one-step predictions suitable, however poor the plain model is."""
        base = self.base_of(self.screening_data)
        fits = filter(is_plausible, self.search(base).extensions(base))
        return any(fitted.simulated_r2 >= INNOVATIONS_R2 or fitted.is_adequate for fitted in fits)

    def base_of(self, data: InnovationData) -> FitResult:
        """Model without effects, fitted to ``data``."""
        if data.interval not in self._bases:
            fitted = fit_innovations(data, data.free_run_r2(data.initial_model))
            self._bases[data.interval] = with_real_disturbance(fitted)
        return self._bases[data.interval]

    def begin(self, data: InnovationData, effects_from: FitResult, drag_from: FitResult) -> FitResult:
        """Fit the effects of ``effects_from`` to ``data``, from the inertia and drag of ``drag_from``."""
        if not effects_from.effects:
            return self.base_of(data)
        return loosen_limit(fit(*self._start(data, effects_from, drag_from)))

    def search(self, start: FitResult, is_hopeless: StopRule | None = None) -> StepwiseSearch:
        """Search from ``start`` with the cache of fits of earlier searches on the same data.

        Waves are candidates only where ``start`` has them: they are slow to fit, and have a test of their own.
        """
        forms = list(self.candidates)
        if len(without_waves(start.effects)) == len(start.effects):
            forms = without_waves(self.candidates)
        cache = self._caches.setdefault((start.data.interval, len(forms)), FitCache())
        own = cache.for_another_selection()
        return StepwiseSearch(forms, self.budget, is_hopeless=is_hopeless, cache=own)

    def is_adequate(self, found: FitResult) -> bool:
        """Whether the effects of ``found`` leave white innovations and a disturbance within its limit."""
        objective, x = self._start(self.screening_data, found, found)
        if objective.key not in self._adequate:
            # An adequate model is close to ``found``, and adequate within the widest limit.
            near = fit_coarse(objective.with_limit(REAL_DISTURBANCE_LIMIT), x, THRESHOLDS.adequacy_iterations)
            self._adequate[objective.key] = near.is_white and not near.at_limit
        return self._adequate[objective.key]

    def _start(
        self, data: InnovationData, effects_from: FitResult, drag_from: FitResult
    ) -> tuple[NegativeLogLikelihood, FloatArray]:
        """Objective with the effects of one model, and (p,) start with the inertia and drag of another one."""
        base = self.base_of(data)
        x = np.concatenate((base.x, effects_from.x[len(effects_from.common_coordinates) :]))
        x[:DISTURBANCE] = drag_from.x[:DISTURBANCE]
        return base.objective.with_effects(effects_from.effects), x


SearchObjective = InnovationObjective | MultiStepObjective


def thin_for_waves(data: InnovationData) -> InnovationData:
    """``data`` thinned as far as the test for waves allows."""
    seconds = sum(float(np.ptp(run.trial.time)) for run in data.runs)
    longest = THRESHOLDS.wave_thinning_time_constants * data.usual_time
    return replace(data, interval=max(_search_interval(data), min(seconds / THRESHOLDS.wave_samples, longest)))


def screening_data(wave_data: InnovationData, search_data: InnovationData) -> InnovationData:
    """The smaller of two data sets, if it is smaller by `THRESHOLDS.thinning_ratio`; else the ``search_data``."""
    if len(search_data.run_index) > THRESHOLDS.thinning_ratio * len(wave_data.run_index):
        return wave_data
    return search_data


def _search_interval(data: InnovationData) -> float:
    """Interval between the samples of a search in s; 0 for all samples."""
    wanted = THRESHOLDS.thinning_time_constants * data.usual_time
    sampling = float(np.median([run.trial.sampling_interval for run in data.runs]))
    return wanted if wanted >= THRESHOLDS.thinning_samples * sampling else 0.0


def without_waves(effects: Sequence[Effect]) -> list[Effect]:
    """``effects`` that do not depend on an unknown phase."""
    return [effect for effect in effects if not effect.is_wave]


def fits_poorly(fitted: FitResult) -> bool:
    """Whether the plain model simulates so badly that score tests mislead."""
    return not fitted.effects and fitted.simulated_r2 < INNOVATIONS_R2


@lru_cache(maxsize=1)
def missing_log_likelihood(fitted: FitResult) -> tuple[float, float]:
    """Log-likelihood (nats) that an unlimited disturbance would gain, and that white innovations would gain then."""
    unlimited = fitted
    if fitted.at_limit:
        unlimited = fit_coarse(fitted.objective.with_limit(UNLIMITED), fitted.x, THRESHOLDS.search_iterations)
    colour = 0.0 if unlimited.is_white else unlimited.whitening_gain
    return fitted.value - unlimited.value, colour


def with_real_disturbance(fitted: FitResult) -> FitResult:
    """The plain model under the limit of a real disturbance, where its own limit costs little and hides no colour."""
    if not (fitted.is_white and fitted.at_limit and fitted.objective.limit == max(DISTURBANCE_LIMITS)):
        return fitted
    disturbance, _ = missing_log_likelihood(fitted)
    if disturbance >= THRESHOLDS.bic_margin:
        return fitted
    loose = fit(fitted.objective.with_limit(REAL_DISTURBANCE_LIMIT), fitted.x)
    return loose if loose.is_adequate and loose.simulated_r2 >= fitted.simulated_r2 - MAX_R2_LOSS else fitted


def has_no_dominant_cause(current: FitResult, gains: Gains) -> bool:
    """Whether the best further cause gains too little of what is missing, so that a one-step search may go astray."""
    disturbance, colour = missing_log_likelihood(current)
    if current.at_limit and disturbance < THRESHOLDS.bic_margin and not current.effects:
        return True
    if current.is_white and not current.at_limit:
        return False
    least = max(THRESHOLDS.dominant_share * (disturbance + colour), THRESHOLDS.bic_margin)
    return max(gains(), default=0.0) < least


def cannot_whiten(current: FitResult, gains: Gains) -> bool:
    """Whether the best further causes together cannot make a model adequate: they gain too little of what is missing.

    A disturbance at its limit that gains nothing beyond the limit is real: no cause removes it.
    """
    disturbance, colour = missing_log_likelihood(current)
    if current.at_limit and disturbance < THRESHOLDS.bic_margin:
        return True
    missing = disturbance + colour
    # The gains are computed only where something is missing.
    return missing > 0.0 and sum(gains()[: THRESHOLDS.whitening_causes]) < THRESHOLDS.whitening_share * missing


@dataclass(frozen=True, kw_only=True, eq=False)
class SearchProblem:
    """Data, candidates, and the test for waves; no step of the algorithm changes them."""

    data: InnovationData
    pieces: Sequence[CvPiece]
    candidates: Sequence[Effect]
    innovations: InnovationObjective
    wave_test: Callable[[FitResult], WaveTest]
    budget: Budget

    def report(self, words: str) -> None:
        """Report progress."""
        self.budget.report(words)


def pose(prepared: PreparedRuns, runs: Sequence[Run], vehicle: Vehicle, budget: Budget) -> SearchProblem:
    """Candidates and data of the diagnosis; ``runs`` are the prepared runs or their parts.

    Raises DataError if the motion determines no first model.
    """
    budget.report("Fitting the model without effects …")
    start = fit_output_error(prepared.items, min_sigmas=0.0)
    pieces = cv_pieces(prepared.items, vehicle, prepared.cutoff)
    counts = Counter(piece.run_index for piece in pieces)
    trials = [run.trial.name for run in prepared.items]
    repeated = [name for number, name in enumerate(trials) if counts[number] > 1]
    forms = forms_for(vehicle, shared_channels(runs), trials, repeated)
    # Of joined files by their clocks; in one file a row may hold the command of the interval that ends with it.
    clock = () if prepared.clocks_agree else (CLOCKS_APART,)
    candidates = (*forms, *clock, *signal_regressors((*prepared.items, *runs, *(piece.run for piece in pieces))))
    data = InnovationData(prepared.items, vehicle, start)
    if data.free_run_r2(start) < NOTHING_R2:
        budget.shorten(THRESHOLDS.hopeless_share)
    wave_data = thin_for_waves(data)
    wave = next((form for form in forms if form.is_wave), None)
    tested: dict[ModelKey, WaveTest] = {}

    def wave_test(beside: FitResult) -> WaveTest:
        if beside.key not in tested:
            budget.report("Testing for waves …")
            searched = None if wave is not None and budget.skips(wave.id) else wave
            tested[beside.key] = run_wave_test(wave_data, beside, searched, pieces)
        return tested[beside.key]

    is_cut, searched, held_out = runs is not prepared.items, data, pieces
    if is_cut and has_pause(prepared.items):
        searched = replace(data, runs=runs)  # A part begins anew after a pause; the whole log does not.
    if not is_cut or searched is not data:
        held_out = [CvPiece(number, -math.inf, math.inf, run) for number, run in enumerate(searched.runs)]
    innovations = InnovationObjective(
        data=searched, pieces=held_out, wave_data=wave_data, candidates=candidates, budget=budget
    )
    return SearchProblem(
        data=data, pieces=pieces, candidates=candidates, innovations=innovations, wave_test=wave_test, budget=budget
    )


def preload(*, wait: bool = False) -> bool:
    """Import libraries, and load the kernels if they are compiled, or with ``wait``; return whether they are compiled.

    Call it while logs are read. Without compiled kernels, forked processes would compile each for itself. Raises
    MemoryError if a limit leaves no room for a diagnosis.
    """
    require_address_space()
    from rovid.model.kernels import compile_all, is_compiled

    for name in ("scipy.linalg", "scipy.optimize"):
        import_module(name)
    compiled = is_compiled()
    if compiled or wait:
        compile_all()
    return compiled
