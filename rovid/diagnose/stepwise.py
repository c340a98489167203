"""Which effects the data ask for: promising ones fitted, added one by one and tested again."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import combinations

from rovid.diagnose.bic import (
    REMAINDER,
    Alternative,
    Cause,
    bic_score,
    fit_in_parallel,
    is_plausible,
    simplest_form,
)
from rovid.diagnose.candidate_fits import PROMISE, best_forms, fit_candidates, gains_by_cause, shortlist
from rovid.diagnose.fit_cache import FitCache, climbed_from_best
from rovid.diagnose.score_test import ScoreTest, screen
from rovid.diagnose.signal_regressors import is_signal
from rovid.diagnose.substitutes import possible_substitutes
from rovid.effects import Effect
from rovid.estimate.fit_result import FitResult
from rovid.estimate.maximum_likelihood import loosen_limit
from rovid.estimate.objective import Key, NegativeLogLikelihood

# Of log-likelihood; for what is told by every reading.
MARGIN = 6.0
# Nor is one that promises less than this share of what an effect has to gain: small promises are kept to the letter.
_NEGLIGIBLE = 0.4
# Nor is an effect exchanged for another for less.
_WORTH_A_CHANGE = 0.5
# What one more effect has to add is no more than so much.
_MOST_WHITE, _MOST_COLOURED = 100.0, 300.0
_BESIDE_SIGNAL = 0.1
_MAX_EFFECTS = 6
# Of a model that is far off so many single causes are tried by twos.
_PAIRED = 6
# A single cause takes two looks at what else there may be, three causes seven or so.
_MOST_LOOKS = 12
# A logged signal is preferred to a named effect only if it gains so much more, in all and in proportion.
_SIGNAL_HANDICAP = (6.0, 0.05)
ProgressCallback = Callable[[str], None]
# What each cause more would gain, the most first; and whether that is too little to go on.
Gains = Callable[[], Sequence[float]]
Hopeless = Callable[[FitResult, Gains], bool]


@dataclass(eq=False)
class StepwiseSearch:
    """Greedy search with second thoughts.

    Parameters
    ----------
    candidates
        Every form that may be tried.
    report
        Called with a line of text as the search goes on.
    is_enough
        Whether a model explains so much that the search may end; not asked of one that is far off.
    hopeless
        Whether no causes more, by what each of them gains, the most first, can explain what a model misses: then the
        search is given up. None goes on in any case.
    thorough
        Whether a model is so far from the truth that slopes do not tell what would help: then every cause is fitted.
    margin
        An addition has to gain so much log-likelihood beyond what its parameters and the number of causes tried would.
    least
        Who promises less than this share of that and the price of its parameters is not fitted.
    known
        What searches before this one worked out, and this one.
    cut_short
        Whether so many models were looked at that the search ended before it was done.
    has_enough, given_up
        Whether it ended because what it had found was enough, or because it was hopeless.
    """

    candidates: Sequence[Effect]
    report: ProgressCallback = field(default=lambda _: None)
    is_enough: Callable[[FitResult], bool] | None = None
    is_hopeless: Hopeless | None = None
    thorough: Callable[[FitResult], bool] = field(default=lambda _: False)
    margin: float = MARGIN
    least: float = _NEGLIGIBLE
    known: FitCache = field(default_factory=FitCache)
    cut_short: bool = False
    has_enough: bool = False
    given_up: bool = False
    _barred: set[str] = field(default_factory=set)
    _left: set[Key] = field(default_factory=set)
    _looked_beside: set[Key] = field(default_factory=set)

    def _ends(self) -> bool:
        """Whether to look at no more models."""
        self.cut_short = self.cut_short or len(self._looked_beside) >= _MOST_LOOKS
        return self.cut_short or self.has_enough or self.given_up

    @property
    def threshold(self) -> float:
        """Worth that an effect has to add: the more causes were tried, the more."""
        return self.margin + math.log(max(self.tried, 1))

    @property
    def tried(self) -> int:
        """How many causes are looked at."""
        return len({effect.id for effect in self.candidates})

    def is_worth_adding(self, better: FitResult, current: FitResult) -> bool:
        """Whether ``better``, with one more effect than ``current``, adds enough: the more, the more was explained.

        Nature's form of an effect is never quite the equation's, and another effect may gain by the difference: most
        of all where ``better`` does not explain the data down to white innovations.
        """
        added = bic_score(better) - bic_score(current)
        if added < max(self.threshold, self.misspecification_allowance(current, white=True)):
            return False
        return added >= self.misspecification_allowance(current, white=better.is_white)

    def misspecification_allowance(self, current: FitResult, *, white: bool) -> float:
        """Log-likelihood that the difference between nature's form of what ``current`` has and the equation's may be.

        ``white`` is whether the data are explained down to white innovations. Then waves have the form that they need
        to have: they are a kind of disturbance, and no cause gains by what is left of them.
        """
        earned = bic_score(current) - bic_score(self.without_any(current, but_waves=white))
        if any(map(is_signal, current.effects)):
            # How something depends on a mere signal is known even less.
            return _BESIDE_SIGNAL * earned
        most = _MOST_WHITE if white else _MOST_COLOURED
        return min(REMAINDER * earned, most)

    def ban(self, effect: Effect) -> None:
        """Take up no form of ``effect`` any more: a test that the search does not make refused it."""
        self._barred.add(effect.id)

    def is_allowed(self, effect: Effect) -> bool:
        """Whether ``effect`` may be taken up."""
        return effect.id not in self._barred

    def run(self, base: FitResult) -> FitResult:
        """Exchange what another explains better, add what pays and drop what no longer does, until nothing changes."""
        self.known.fits[base.key], self.has_enough = base, False
        current = self._pruned(base)
        for _ in range(_MAX_EFFECTS):
            self._may_end(current)
            changed = self._grown(self._exchanged(current))
            if changed is current or self.has_enough or self.given_up:
                return changed
            current = changed
        self.cut_short = True
        return current

    def _grown(self, current: FitResult) -> FitResult:
        """With what pays added; where that lets the disturbance have more, only so far."""
        while len(current.effects) < _MAX_EFFECTS and not self._ends():
            better = self._best(self.extensions(current, growing=True), current)
            if better is not current:
                better = self.known.converged(simplest_form(better, self._plausible(current), current))
            if not self.is_worth_adding(better, current):
                better = self._best_pair(current)
            if not self.is_worth_adding(better, current):
                break
            added = self._pruned(better)
            if bic_score(added) <= bic_score(current):
                # What was dropped for it was worth more: adding and dropping would go round in a circle.
                break
            current = self._opened(added)
            self._may_end(current)
            if current is not added:
                break
        return current

    def _may_end(self, current: FitResult) -> None:
        if self.is_enough is not None and not self.thorough(current):
            self.has_enough = self.has_enough or self.is_enough(current)
        if self.is_hopeless is not None and not self.given_up:
            self.given_up = self.is_hopeless(current, lambda: self._gains(current))

    def _gains(self, current: FitResult) -> list[float]:
        """What each cause beside ``current`` gains, the most first: where it is fitted, else what slopes promise."""
        if current.key not in self.known.extensions:
            return gains_by_cause(self.score_tests(current))
        best: dict[str, float] = {}
        for fit in self.known.extensions[current.key]:
            cause = fit.effects[-1].id
            best[cause] = max(best.get(cause, 0.0), current.value - fit.value)
        return sorted(best.values(), reverse=True)

    def _best_pair(self, current: FitResult) -> FitResult:
        """With two effects that gain little alone and much together, as where each hides the other.

        Slopes and single fits tell of neither; so of a model that is far off the best singles are tried by twos.
        """
        if not self.thorough(current) or len(current.effects) + 2 > _MAX_EFFECTS:
            return current
        singles = self._best_singles(current)[:_PAIRED]
        pairs = list(combinations(singles, 2))
        misfits = [one.objective.with_effects((*one.effects, other.effects[-1])) for one, other in pairs]
        fits = fit_in_parallel(misfits, lambda at: _joined(misfits[at], *pairs[at]))
        for fit in fits:
            self.known.fits.setdefault(fit.key, fit)
        chosen = max(fits, key=bic_score, default=current)
        # There are so many more pairs than single causes.
        price = math.log(max(len(singles), 1))
        if chosen is not current and bic_score(chosen) - price > bic_score(current):
            return chosen
        return current

    def _best_singles(self, current: FitResult) -> list[FitResult]:
        """With one effect more, each cause in its worthiest form, the worthiest first."""
        best: dict[str, FitResult] = {}
        for fit in sorted(self._plausible(current), key=bic_score, reverse=True):
            best.setdefault(fit.effects[-1].id, fit)
        return list(best.values())

    def _plausible(self, current: FitResult) -> list[FitResult]:
        """With one effect more that may be, of a size that there is."""
        return [fit for fit in self.extensions(current) if self.is_allowed(fit.effects[-1]) and is_plausible(fit)]

    def _opened(self, current: FitResult) -> FitResult:
        """``current`` with as much disturbance as it bears, less what is then no longer needed.

        A disturbance is held tight where it would explain what an effect does. Once that is in, it may have its own
        again; else other effects would be taken for what is left of it.
        """
        opened = loosen_limit(current)
        if opened is current:
            return current
        self.known.fits[opened.key] = opened
        needed = self._pruned(opened)
        if not needed.effects:
            return current
        return needed

    def _pruned(self, current: FitResult) -> FitResult:
        """Without what is no longer needed: one effect may have stood in for another that came later."""
        self.known.fit(current.objective, [current.without(effect) for effect in current.effects])
        for effect in current.effects:
            rest = self.without(current, effect)
            if not self.is_worth_adding(current, rest):
                return self._pruned(rest)
        return current

    def _exchanged(self, current: FitResult) -> FitResult:
        """The model with another form or another cause in the place of an effect, where that is better."""
        if self._ends():
            return current
        for effect in current.effects:
            rest = self.without(current, effect)
            other = self._best(self.in_place_of(current, effect), rest)
            if bic_score(other) > bic_score(current) + _WORTH_A_CHANGE and other.key not in self._left:
                self._left.add(current.key)
                return self._opened(self._pruned(other))
        return current

    def _best(self, fits: Sequence[FitResult], default: FitResult) -> FitResult:
        """The worthiest; a named effect goes before a mere signal that is little better."""
        named, signals = list[FitResult](), list[FitResult]()
        for fit in fits:
            effect = fit.effects[-1]
            if not self.is_allowed(effect):
                continue
            if is_signal(effect):
                signals.append(fit)
            elif is_plausible(fit):
                named.append(fit)
        best = max(named, key=bic_score, default=default)
        signal = max(signals, key=bic_score, default=default)
        least, share = _SIGNAL_HANDICAP
        gap = least + share * max(bic_score(best) - bic_score(default), 0.0)
        chosen = signal if bic_score(signal) > bic_score(best) + gap else best
        return chosen if chosen is default else self.known.converged(chosen)

    def best_extension(self, current: FitResult) -> FitResult | None:
        """The worthiest model with one effect more, whether it pays or not; None where there is none."""
        return max(filter(is_plausible, self.extensions(current)), key=bic_score, default=None)

    def extensions(self, current: FitResult, *, growing: bool = False) -> list[FitResult]:
        """The model with each promising effect more, in each promising form."""
        self._looked_beside.add(current.key)
        if current.key not in self.known.extensions:
            every = growing and self.thorough(current)
            self.known.extensions[current.key] = self._extended(current, self.score_tests(current), every=every)
        return self.known.extensions[current.key]

    def in_place_of(self, current: FitResult, effect: Effect) -> list[FitResult]:
        """As `extensions` of ``current`` without ``effect``, of what may do what that does."""
        rest = self.without(current, effect)
        if rest.key in self.known.extensions or PROMISE * (rest.value - current.value) < self.threshold:
            # So little may be promised by chance.
            return self.extensions(rest)
        self._looked_beside.add(rest.key)
        keys = current.key, rest.key
        if keys not in self.known.replacements:
            same = [form for form in self.candidates if form.id == effect.id]
            forms = [*same, *possible_substitutes(current, effect, self.score_tests(current))]
            self.known.replacements[keys] = self._extended(rest, screen(rest, forms))
        return self.known.replacements[keys]

    def _extended(self, current: FitResult, promises: Sequence[ScoreTest], *, every: bool = False) -> list[FitResult]:
        """The model with each form that is worth a fit more, or with each at all."""
        ends = self.known.converged_extensions(current)
        if every:
            listed = best_forms(promises)
        else:
            gained = max((current.value - fit.value for fit in ends.values() if self._leads(fit)), default=0.0)
            listed = shortlist(current, promises, self.threshold, self.least, gained)
        ahead, behind = fit_candidates(current, listed, self._leads, ends)
        for fit in ahead:
            self.known.fits.setdefault(fit.key, fit)
        return [*ahead, *behind]

    def _leads(self, fit: FitResult) -> bool:
        """Whether it may be taken up as it is, and not for want of a named cause."""
        effect = fit.effects[-1]
        return self.is_allowed(effect) and is_plausible(fit) and not is_signal(effect)

    def score_tests(self, current: FitResult) -> list[ScoreTest]:
        """What each effect that ``current`` lacks promises, worked out once."""
        if current.key not in self.known.promises:
            self.report(f"{_named(current.effects)}: trying {len(self.candidates)} forms of what else there may be …")
            self.known.promises[current.key] = screen(current, self._lacking(current))
        return self.known.promises[current.key]

    def _lacking(self, current: FitResult) -> list[Effect]:
        """The forms of all causes of which ``current`` has none."""
        taken = {effect.id for effect in current.effects}
        return [effect for effect in self.candidates if effect.id not in taken]

    def cause(self, current: FitResult, effect: Effect) -> Cause:
        """What ``effect`` gains, and what each other cause would be worth in its place."""
        rest = self.without(current, effect)
        rivals = self._ranked(rest, self.in_place_of(current, effect), current)
        return Cause(effect, rest.value - current.value, bic_score(current) - bic_score(rest), rivals)

    def candidates_beside(self, current: FitResult) -> tuple[Alternative, ...]:
        """What each cause that ``current`` lacks would be worth beside it, best first."""
        return self._ranked(current, self.extensions(current), current)

    def _ranked(self, rest: FitResult, extensions: Sequence[FitResult], current: FitResult) -> tuple[Alternative, ...]:
        """What the best of the ``extensions`` by each cause that ``current`` lacks adds to ``rest``, best first."""
        taken = {effect.id for effect in current.effects}
        best: dict[str, Alternative] = {}
        for fit in extensions:
            last, net = fit.effects[-1], bic_score(fit) - bic_score(rest)
            if last.id in taken or not is_plausible(fit):
                continue
            if last.id not in best or net > best[last.id].bic_gain:
                best[last.id] = Alternative(last, net, fit)
        return tuple(sorted(best.values(), key=lambda rival: -rival.bic_gain))

    def without_any(self, current: FitResult, *, but_waves: bool = False) -> FitResult:
        """The model without any effect, or with its waves alone."""
        return self.without(current, *(effect for effect in current.effects if not (effect.is_wave and but_waves)))

    def without(self, current: FitResult, *dropped: Effect) -> FitResult:
        """The model without some effects, all else fitted again."""
        return self.known.without(current, *dropped)


def _joined(misfit: NegativeLogLikelihood, one: FitResult, other: FitResult) -> FitResult:
    """``one`` with the last effect of ``other`` besides, which is what ``misfit`` has."""
    starts = (other.effect_coordinates(other.effects[-1]), *misfit.parametrization.initial_values())
    return climbed_from_best(misfit, one.x, starts)


def _named(effects: Sequence[Effect]) -> str:
    """The titles, in a row, for a line of progress."""
    return ", ".join(effect.title for effect in effects) or "no effect"
