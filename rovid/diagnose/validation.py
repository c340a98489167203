"""The search, its two models, and what of it holds on trials that were not fitted."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

from rovid.diagnose.bic import Alternative, Cause, bic_score, fit_in_parallel, is_at_bound
from rovid.diagnose.cross_validation import Fold, cross_validate, held_out_log_likelihood
from rovid.diagnose.effect_size import effect_size, has_consistent_size
from rovid.diagnose.posterior import ESTABLISHED, POSSIBLE, posterior_probability, recalibrated, stand_in_cap
from rovid.diagnose.signal_regressors import is_signal
from rovid.diagnose.splitting import CvPiece
from rovid.diagnose.stepwise import StepwiseSearch
from rovid.diagnose.trial_outlier_test import outlier_probability
from rovid.diagnose.wave_test import WaveTest
from rovid.effects import Effect
from rovid.estimate.dataset import FitData
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.objective import Key

# A rival is beaten by so much log-likelihood, and by such a share of what the effect gains, up to so much more.
_BEATEN = (6.0, 0.03, 40.0)
# An effect that differs from nothing by fewer standard errors, as printed, is not claimed: by every reading, and by
# predictions, which count as few.
_SIGNIFICANT, _SIGNIFICANT_AHEAD = 3.5, 2.0
# Nor is one suspected that differs from nothing by fewer.
_SUSPECTED_SIZE = 1.0
# What is surer than that is likely.
_LIKELY, _EVEN = "is likely, and not established", 0.5
# Of suspects: one that has a tenth of another's odds is told from it.
_TOLD = math.log(10.0)
# A rival with this share of an effect's gain is compared with it over every reading.
_CLOSE = 0.8
_DECISIONS = 3
# Of log-likelihood: so close is the same model fitted to every reading.
_REFINED = 0.05
# So often a search goes on without what a test refused.
_REFUSALS = 6


@dataclass(eq=False)
class Work:
    """The search, its two models, and their trials held out.

    Attributes
    ----------
    full
        All readings; the search may look at fewer.
    base, final
        The model without effects, and that with which the search ended.
    look_for_waves
        What looks for waves beside a model, and as ``waves`` what it saw last.
    by_horizons
        Whether the simulation misses so much that predictions some time ahead are what is looked at.
    shrunk
        What each next reading shows less of than predictions ask for.
    """

    search: StepwiseSearch
    full: FitData
    base: FitResult
    final: FitResult
    pieces: Sequence[CvPiece]
    look_for_waves: Callable[[FitResult], WaveTest] | None = None
    waves: WaveTest | None = None
    by_horizons: bool = False
    shrunk: list[Effect] = field(default_factory=list)
    _folds: dict[Key, list[Fold]] = field(default_factory=dict)
    _refined: dict[Key, FitResult] = field(default_factory=dict)

    @property
    def explains(self) -> bool:
        """Whether the final model leaves white innovations, and no more disturbance than there may be."""
        return self.final.is_white and not self.final.at_limit

    def holds(self) -> bool:
        """Decide between rivals; whether all is explained then, and none of it in doubt."""
        self.decide()
        doubted, _ = self._doubted(())
        return doubted is None and self.explains

    def settle(self) -> None:
        """Look for waves beside the final model, and leave out what is not there for each next reading.

        The search goes on without that.
        """
        if self.look_for_waves is None:
            return
        for _ in range(_REFUSALS):
            self.waves = self.look_for_waves(self.final)
            idle = [one for one in self.final.effects if not has_consistent_size(self.final, self.waves.likelier, one)]
            if not idle:
                return
            self._refuse(idle)
            self.final = self.search.run(self.final)
        self.final = self.base
        self.waves = self.look_for_waves(self.final)

    def _refuse(self, idle: Sequence[Effect]) -> None:
        for effect in idle:
            self.shrunk.append(effect)
            self.search.ban(effect)
            self.final = self.search.without(self.final, effect)

    def decide(self) -> None:
        """Let every reading decide between an effect and a close rival: the quick look may have taken the wrong one."""
        for _ in range(_DECISIONS):
            better = self._better()
            if better is None:
                return
            self.final = better.fitted

    def _better(self) -> Alternative | None:
        """The first rival that is worth more than what was found in its place."""
        for effect in self.final.effects:
            cause = self.cause(effect)
            for rival in cause.alternatives:
                # A mere signal that is little better takes no name's place.
                for_a_name = is_signal(rival.effect) and not is_signal(effect)
                if rival.bic_gain > cause.bic_gain and not for_a_name and self.search.is_allowed(rival.effect):
                    return rival
        return None

    def cause(self, effect: Effect) -> Cause:
        """What ``effect`` gains, its close rivals compared over every reading."""
        cause = self.search.cause(self.final, effect)
        least = _CLOSE * cause.bic_gain
        close = [rival for rival in cause.alternatives[:2] if rival.bic_gain > least and not is_signal(rival.effect)]
        if not close or self.final.data is self.full:
            return cause
        # The base too, which is asked for in the end: one core would be without work.
        self.refine((self.final, *(rival.fitted for rival in close), self.base))
        here = bic_score(self.refined(self.final))
        rivals = []
        for rival in cause.alternatives:
            if rival in close:
                net = cause.bic_gain + bic_score(self.refined(rival.fitted)) - here
                rivals.append(replace(rival, bic_gain=net))
            else:
                rivals.append(rival)
        return replace(cause, alternatives=tuple(sorted(rivals, key=lambda rival: -rival.bic_gain)))

    def refined(self, fitted: FitResult) -> FitResult:
        """The same model fitted to every reading, once."""
        self.refine((fitted,))
        return self._refined[fitted.key]

    def refine(self, models: Sequence[FitResult]) -> None:
        """Fit to every reading, all at once, those ``models`` that were not yet."""
        left = [fitted for fitted in models if fitted.key not in self._refined]
        misfits = [replace(fitted.objective, data=self.full, mask=None) for fitted in left]
        fits = fit_in_parallel(misfits, lambda at: fit(misfits[at], left[at].x, tolerance=_REFINED))
        self._refined.update((fitted.key, fit) for fitted, fit in zip(left, fits, strict=True))

    def folds(self, fitted: FitResult) -> list[Fold]:
        """Each fourth of the trials predicted from the others, worked out once for a model."""
        if fitted.key not in self._folds:
            self._folds[fitted.key] = cross_validate(fitted, self.pieces)
        return self._folds[fitted.key]

    def held_out_gain(self, effect: Effect) -> float:
        """Log-likelihood of trials not fitted that ``effect`` gains."""
        less = self.search.without(self.final, effect)
        full, rest = held_out_log_likelihood(self.folds(self.final)), held_out_log_likelihood(self.folds(less))
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
            effect, doubt = self._doubted(likely)
            if effect is None:
                break
            warnings.append(f"{effect.title} {doubt}: it is not claimed.")
            self.search.ban(effect)
            if doubt == _LIKELY:
                likely.append(effect.key)
                continue
            self.final = self.search.run(self.search.without(self.final, effect))
            self.decide()
            self.settle()
        if likely:
            warnings += self._leave_out(likely)
        if not self.final.effects:
            # Its own limit of the disturbance suits a model without effects best.
            self.final = self.base
        return warnings

    def _doubted(self, passed: Collection[str]) -> tuple[Effect | None, str]:
        """The first effect that is in doubt, but those whose keys are ``passed`` over, and why; None where none is."""
        for effect in self.final.effects:
            if effect.key in passed:
                continue
            doubt = self._doubt(effect)
            if doubt:
                return effect, doubt
        return None, ""

    def _leave_out(self, likely: Collection[str]) -> list[str]:
        """Leave out what is ``likely``, by its key, and what is in doubt without that; what is said of the latter."""
        for effect in self.final.effects:
            if effect.key in likely:
                self.final = self.search.without(self.final, effect)
        warnings = []
        idle, _ = self._doubted(())
        while idle is not None:
            warnings.append(f"{idle.title} shows only beside what is not established: it is not claimed.")
            self.final = self.search.without(self.final, idle)
            idle, _ = self._doubted(())
        return warnings

    def _remainder(self) -> list[str]:
        """What would be added, were not so much explained already that it may be the form of that."""
        following = self.search.best_extension(self.final)
        if following is None or bic_score(following) - bic_score(self.final) < self.search.threshold:
            return []
        effect, gain = following.effects[-1], self.final.value - following.value
        if any(effect is shrunk for shrunk in self.shrunk):
            return []
        if self.search.is_worth_adding(following, self.final):
            why = "enough for a cause; but the search ended before it was taken up"
        else:
            why = (
                "little beside what was found: nature's form of that is never quite the equation's, and this may be "
                "no more than the difference"
            )
        return [f"{effect.title} would gain a log-likelihood of {gain:.0f}, {why}. It is not claimed."]

    def _doubt(self, effect: Effect) -> str:
        gain, size = self.held_out_gain(effect), significance(self.final, effect)
        least = _SIGNIFICANT_AHEAD if self.by_horizons else _SIGNIFICANT
        if gain <= 0.0:
            return f"fits these trials but predicts trials not fitted worse (log-likelihood {gain:.1f})"
        if is_at_bound(self.final, effect):
            return "would be larger here than there is"
        if size < least:
            return f"is only {size:.1f} standard errors away from nothing"
        sure = self.confidence(self.cause(effect), gain)
        if sure < ESTABLISHED:
            return _LIKELY if sure >= _EVEN else "is possible, and not established"
        return ""

    def confidence(self, cause: Cause, held_out_gain: float) -> float:
        """Probability that ``cause``, or one not told from it, acts; on trials not fitted it has to gain too."""
        # A signal that the cause follows, or that follows it, is not another cause.
        worths = {
            rival.effect.id: self._sure_worth(rival) for rival in cause.alternatives if not is_signal(rival.effect)
        }
        worths[cause.effect.id] = own = self._sure_worth(cause)
        others = undecided(cause, self.margin(cause.bic_gain))
        alike = [cause.effect.id, *[effect.id for effect in others]]
        rest = self.search.without(self.final, cause.effect)
        white = self.final.is_white
        # Part of it may be no more than how nature's form of the others differs from the equations'.
        doubt = self.search.misspecification_allowance(rest, white=white)
        less = max(own - held_out_gain, 0.0) + doubt
        for name in worths:
            worths[name] -= less
        most = stand_in_cap(held_out_gain - doubt, own - doubt, white=white)
        sure = posterior_probability(worths, alike, self.search.tried, cap=most)
        return sure if white else min(sure, outlier_probability(self.final, cause.effect))

    def _sure_worth(self, one: Cause | Alternative) -> float:
        """What it is worth, less what the best of so many forms, as of one for each trial, gains by chance.

        Where the model does not explain the data to the noise, odds were held against campaigns without that.
        """
        if not self.final.is_white:
            return one.bic_gain
        forms = sum(candidate.id == one.effect.id for candidate in self.search.candidates)
        return one.bic_gain - math.log(max(forms, 1))

    def margin(self, worth: float) -> float:
        """By so much a rival is beaten of a cause that is worth so much.

        Where the model explains the data to the noise, likelihood decides; else part of any gain is that of its form.
        """
        least, share, most = _BEATEN
        if self.final.is_white:
            return least
        return least + min(share * worth, most)

    def suspects(self) -> list[Suspected]:
        """Causes that are likely or possible beside the final model, the most likely first.

        The first stands for its class; each other for itself, were it the one that acts.
        """
        beside = self.search.candidates_beside(self.final)
        named = [rival for rival in beside if not is_signal(rival.effect)]
        passed = {effect.id for effect in self.shrunk}
        if self.waves is not None:
            passed.update(self.waves.passed_for)
        left = [rival for rival in named if rival.bic_gain > 0.0 and rival.effect.id not in passed]
        white = self.final.is_white
        doubt = self.search.misspecification_allowance(self.final, white=white)

        def odds(names: Collection[Alternative], less: float = 0.0, most: float = 1.0) -> float:
            worths = {rival.effect.id: self._sure_worth(rival) - doubt - less for rival in left}
            return posterior_probability(worths, [rival.effect.id for rival in names], self.search.tried, cap=most)

        # Whether one acts takes a fit: only those are asked that are possible if they do.
        acts = cache(self._acts)
        suspects: list[Suspected] = []
        for rival in left.copy():
            least = max(rival.bic_gain - _TOLD, 0.0)
            near = [] if suspects else [other for other in left if other is not rival and other.bic_gain > least]
            if recalibrated(odds([rival, *near]), white=white) < POSSIBLE:
                break
            if not acts(rival):
                left.remove(rival)
                continue
            alike = [other for other in near if acts(other)]
            gain = held_out_log_likelihood(self.folds(rival.fitted)) - held_out_log_likelihood(self.folds(self.final))
            own = self._sure_worth(rival)
            most = stand_in_cap(gain - doubt, own - doubt, white=white)
            sure = odds([rival, *alike], max(own - gain, 0.0), most)
            if not white:
                sure = min(sure, outlier_probability(rival.fitted, rival.effect))
            if (said := recalibrated(sure, white=white)) >= POSSIBLE:
                suspects.append(Suspected(rival, said, gain, tuple(alike)))
        return sorted(suspects, key=lambda one: -one.confidence)

    def _acts(self, rival: Alternative) -> bool:
        """Whether ``rival`` has a size, and where predictions are looked at, each next reading shows as much of it."""
        if significance(rival.fitted, rival.effect) < _SUSPECTED_SIZE:
            return False
        return self.waves is None or has_consistent_size(rival.fitted, self.waves.likelier, rival.effect)


@dataclass(frozen=True, eq=False)
class Suspected:
    """A cause that is likely or possible beside the final model, and the ``others`` that it is not told from."""

    rival: Alternative
    confidence: float
    held_out_gain: float
    others: tuple[Alternative, ...]


def undecided(cause: Cause, margin: float) -> tuple[Effect, ...]:
    """Rivals of ``cause`` that neither beat it by ``margin`` nor are so beaten; of a mere signal that is not asked."""
    close = [rival.effect for rival in cause.alternatives if abs(rival.bic_gain - cause.bic_gain) < margin]
    return tuple(effect for effect in close if not is_signal(effect))


def significance(fitted: FitResult, effect: Effect) -> float:
    """Distance of the effect's size from nothing, in standard errors."""
    away, error = effect_size(fitted, effect, sandwich=not fitted.is_white)
    return abs(away) / error if error > 0.0 else math.inf
