"""Which effects the data ask for: screened by their slopes, fitted, added one by one and tested again."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field

import numpy as np

from rovid.effects import Effect
from rovid.ground.arrays import FloatArray
from rovid.ground.workers import spread
from rovid.identify.innovations import Likelihood, Slopes
from rovid.identify.likelihood import likelihood_is_white, loosened

# Of log-likelihood; for what is told by every reading.
MARGIN = 6.0
# Of the best candidate's promise, as far as its fit begins by keeping it: who promises less is not fitted.
_PROMISE = 0.1
# Nor is one that promises less than this share of what an effect has to gain: small promises are kept to the letter.
_NEGLIGIBLE = 0.4
_FITTED = 7
_FORMS_FITTED = 3
# Nor is an effect exchanged for another for less.
_WORTH_A_CHANGE = 0.5
# What one more effect has to add: this share of what was gained, but no more than so much.
_REMAINDER = 0.04
_MOST_WHITE, _MOST_COLOURED = 100.0, 300.0
_BESIDE_SIGNAL = 0.1
_ITERATIONS = 25
# Sizes to begin with, as shares of what the slopes ask for: where they mislead, that may be far too much.
_SHARES = (1.0, 0.3, 0.1)
_FIRST_ITERATIONS = 4
# Then those go on, for so many steps, that have this share of the best one's worth.
_STAGES = ((0.2, 8), (0.4, _ITERATIONS))
_TOLERANCE = 0.1
_MAX_EFFECTS = 6
# Of a model that is far off so many single causes are tried by twos.
_PAIRED = 6
# A single cause takes two looks at what else there may be, three causes seven or so.
_MOST_LOOKS = 12
# A logged signal is preferred to a named effect only if it gains so much more, in all and in proportion.
_SIGNAL_HANDICAP = (6.0, 0.05)

Report = Callable[[str], None]
# What tells one model from another: how much disturbance it is allowed, and its effects.
Key = tuple[float, frozenset[str]]


@dataclass(frozen=True, eq=False)
class Fitted:
    """A model with some effects, fitted.

    Attributes
    ----------
    cost
        Negative log-likelihood.
    """

    likelihood: Likelihood
    x: FloatArray
    cost: float

    @property
    def effects(self) -> tuple[Effect, ...]:
        """In the order in which their parameters stand in ``x``."""
        return self.likelihood.effects

    @property
    def key(self) -> Key:
        """What tells it from other models of the same records."""
        return _key(self.likelihood)

    def own(self, effect: Effect) -> FloatArray:
        """Coordinates of ``effect``."""
        at = self.likelihood.base
        for other in self.effects:
            width = len(other.parameters)
            if other is effect:
                return self.x[at : at + width]
            at += width
        raise KeyError(effect.key)

    @property
    def plausible(self) -> bool:
        """Whether the last effect is of a size that there is, none of its parameters at the edge, nor the inertia."""
        effect = self.effects[-1]
        return self.likelihood.is_physical(self.x) and not any(
            (value >= parameter.high != parameter.null) or (value <= parameter.low != parameter.null)
            for value, parameter in zip(self.own(effect), effect.parameters, strict=True)
        )

    def beyond(self, effect: Effect) -> bool:
        """Whether ``effect`` would be larger than there is: its size is at the edge."""
        size, value = effect.parameters[0], float(self.own(effect)[0])
        return (value >= size.high != size.null) or (value <= size.low != size.null)

    def without(self, effect: Effect) -> tuple[tuple[Effect, ...], FloatArray]:
        """The other effects, and the coordinates that are left."""
        rest = tuple(other for other in self.effects if other is not effect)
        return rest, np.concatenate((self.x[: self.likelihood.base], *(self.own(other) for other in rest)))


@dataclass(frozen=True, eq=False)
class Promise:
    """What the slopes say that one form of an effect would gain.

    Attributes
    ----------
    gain
        Of log-likelihood, over all starts of the form together.
    start
        Coordinates of the form's parameters from which to fit, of the size that the slopes ask for.
    unscaled
        Those of its starts that gains most as it stands.
    power
        Gain that the effect would have, were it there with the size of its first start.
    """

    effect: Effect
    gain: float
    start: FloatArray
    unscaled: FloatArray
    power: float


@dataclass(frozen=True, eq=False)
class Rival:
    """Another cause in the place of one that was found: its gain of log-likelihood, less the price of parameters."""

    effect: Effect
    gain: float
    fitted: Fitted


@dataclass(frozen=True, eq=False)
class Found:
    """One effect of the final model.

    Attributes
    ----------
    gain
        Log-likelihood that its removal would lose, all else fitted again.
    worth
        The same less the price of its parameters.
    rivals
        The best form of each other cause in its place, best first.
    """

    effect: Effect
    gain: float
    worth: float
    rivals: tuple[Rival, ...] = ()


@dataclass(eq=False)
class Search:
    """Greedy search with second thoughts.

    Parameters
    ----------
    candidates
        Every form that may be tried.
    report
        Called with a line of text as the search goes on.
    hopeless
        Whether no causes more, of what they promise, can explain what a model misses: then the search is given up.
        None goes on in any case.
    thorough
        Whether a model is so far from the truth that slopes do not tell what would help: then every cause is fitted.
    margin
        An addition has to gain so much log-likelihood beyond what its parameters and the number of causes tried would.
    least
        Who promises less than this share of that is not fitted.
    promises
        Key of a model -> what each further form promised there.
    cut_short
        Whether so many models were looked at that the search ended before it was done.
    given_up
        Whether it ended because it was hopeless.
    """

    candidates: Sequence[Effect]
    report: Report = field(default=lambda _: None)
    hopeless: Callable[[Fitted, Sequence[Promise]], bool] | None = None
    thorough: Callable[[Fitted], bool] = field(default=lambda _: False)
    margin: float = MARGIN
    least: float = _NEGLIGIBLE
    promises: dict[Key, list[Promise]] = field(default_factory=dict)
    cut_short: bool = False
    given_up: bool = False
    _barred: set[str] = field(default_factory=set)
    _left: set[Key] = field(default_factory=set)
    _extensions: dict[Key, list[Fitted]] = field(default_factory=dict)
    _fits: dict[Key, Fitted] = field(default_factory=dict)

    def _ends(self) -> bool:
        """Whether to look at no more models."""
        self.cut_short = self.cut_short or len(self._extensions) >= _MOST_LOOKS
        return self.cut_short or self.given_up

    @property
    def threshold(self) -> float:
        """Worth that an effect has to add: the more causes were tried, the more."""
        return self.margin + math.log(max(self.tried, 1))

    @property
    def tried(self) -> int:
        """How many causes are looked at."""
        return len({effect.id for effect in self.candidates})

    def pays(self, better: Fitted, current: Fitted) -> bool:
        """Whether ``better``, with one more effect than ``current``, adds enough: the more, the more was explained.

        Nature's form of an effect is never quite the equation's, and another effect may gain by the difference: most
        of all where ``better`` does not explain the data down to white innovations.
        """
        added = worth(better) - worth(current)
        if added < max(self.threshold, self.form_doubt(current, white=True)):
            return False
        return added >= self.form_doubt(current, white=likelihood_is_white(better.likelihood, better.x))

    def form_doubt(self, current: Fitted, *, white: bool) -> float:
        """Log-likelihood that the difference between nature's form of what ``current`` has and the equation's may be.

        ``white`` is whether the data are explained down to white innovations. Then waves have the form that they need
        to have: they are a kind of disturbance, and no cause gains by what is left of them.
        """
        earned = worth(current) - worth(self.without_any(current, but_waves=white))
        if not all(effect.equation for effect in current.effects):
            # How something depends on a mere signal is known even less.
            return _BESIDE_SIGNAL * earned
        return min(_REMAINDER * earned, _MOST_WHITE if white else _MOST_COLOURED)

    def bar(self, effect: Effect) -> None:
        """Take up no form of ``effect`` any more: a test that the search does not make refused it."""
        self._barred.add(effect.id)

    def allows(self, effect: Effect) -> bool:
        """Whether ``effect`` may be taken up."""
        return effect.id not in self._barred

    def run(self, base: Fitted) -> Fitted:
        """Exchange what another explains better, add what pays and drop what no longer does, until nothing changes."""
        self._fits[base.key] = base
        current = self._pruned(base)
        for _ in range(_MAX_EFFECTS):
            self._may_give_up(current)
            changed = self._grown(self._exchanged(current))
            if changed is current or self.given_up:
                return changed
            current = changed
        self.cut_short = True
        return current

    def _grown(self, current: Fitted) -> Fitted:
        """With what pays added; where that lets the disturbance have more, only so far."""
        while len(current.effects) < _MAX_EFFECTS and not self._ends():
            better = self._best(self.extensions(current, growing=True), current)
            if not self.pays(better, current):
                better = self._best_pair(current)
            if not self.pays(better, current):
                break
            added = self._pruned(better)
            if worth(added) <= worth(current):
                # What was dropped for it was worth more: adding and dropping would go round in a circle.
                break
            current = self._opened(added)
            self._may_give_up(current)
            if current is not added:
                break
        return current

    def _may_give_up(self, current: Fitted) -> None:
        if self.hopeless is not None and not self.given_up:
            self.given_up = self.hopeless(current, self._promised(current))

    def _best_pair(self, current: Fitted) -> Fitted:
        """With two effects that gain little alone and much together, as where each hides the other.

        Slopes and single fits tell of neither; so of a model that is far off the best singles are tried by twos.
        """
        if not self.thorough(current) or len(current.effects) + 2 > _MAX_EFFECTS:
            return current
        best: dict[str, Fitted] = {}
        for fit in sorted(self.extensions(current), key=worth, reverse=True):
            if self.allows(fit.effects[-1]) and fit.plausible:
                best.setdefault(fit.effects[-1].id, fit)
        singles = list(best.values())[:_PAIRED]
        pairs = [(one, other) for k, one in enumerate(singles) for other in singles[k + 1 :]]
        fits = spread(lambda pair: self._joined(*pair), pairs)
        for fit in fits:
            self._fits.setdefault(fit.key, fit)
        chosen = max(fits, key=worth, default=current)
        # There are so many more pairs than single causes.
        price = math.log(max(len(singles), 1))
        return chosen if chosen is not current and worth(chosen) - price > worth(current) else current

    def _joined(self, one: Fitted, other: Fitted) -> Fitted:
        """``one`` with the last effect of ``other`` besides."""
        effect = other.effects[-1]
        likelihood = one.likelihood.like((*one.effects, effect))
        begins = [np.concatenate((one.x, start)) for start in (other.own(effect), *likelihood.starts())]
        return climbed(likelihood, min(begins, key=likelihood.cost), _ITERATIONS)

    def _opened(self, current: Fitted) -> Fitted:
        """``current`` with as much disturbance as it bears, less what is then no longer needed.

        A disturbance is held tight where it would explain what an effect does. Once that is in, it may have its own
        again; else other effects would be taken for what is left of it.
        """
        likelihood, x = loosened(current.likelihood, current.x)
        if likelihood is current.likelihood:
            return current
        opened = Fitted(likelihood, x, likelihood.cost(x))
        self._fits[opened.key] = opened
        needed = self._pruned(opened)
        return needed if needed.effects else current

    def _pruned(self, current: Fitted) -> Fitted:
        """Without what is no longer needed: one effect may have stood in for another that came later."""
        for effect in current.effects:
            rest = self.without(current, effect)
            if not self.pays(current, rest):
                return self._pruned(rest)
        return current

    def _exchanged(self, current: Fitted) -> Fitted:
        """The model with another form or another cause in the place of an effect, where that is better."""
        for effect in () if self._ends() else current.effects:
            rest = self.without(current, effect)
            other = self._best(self.extensions(rest), rest)
            if worth(other) > worth(current) + _WORTH_A_CHANGE and other.key not in self._left:
                self._left.add(current.key)
                return self._opened(self._pruned(other))
        return current

    def _best(self, fits: Sequence[Fitted], default: Fitted) -> Fitted:
        """The worthiest; a named effect goes before a mere signal that is little better."""
        fits = [fit for fit in fits if self.allows(fit.effects[-1])]
        named = max((fit for fit in fits if fit.effects[-1].equation and fit.plausible), key=worth, default=default)
        signal = max((fit for fit in fits if not fit.effects[-1].equation), key=worth, default=default)
        gap = _SIGNAL_HANDICAP[0] + _SIGNAL_HANDICAP[1] * max(worth(named) - worth(default), 0.0)
        return signal if worth(signal) > worth(named) + gap else named

    def best_extension(self, current: Fitted) -> Fitted | None:
        """The worthiest model with one effect more, whether it pays or not; None where there is none."""
        plausible = [fit for fit in self.extensions(current) if fit.plausible]
        return max(plausible, key=worth, default=None)

    def extensions(self, current: Fitted, *, growing: bool = False) -> list[Fitted]:
        """The model with each promising effect more, in each promising form."""
        if current.key not in self._extensions:
            promises = self._promised(current)
            ahead, behind = _fit_all(
                current,
                _best_forms(promises)
                if growing and self.thorough(current)
                else shortlist(current, promises, self.threshold * self.least),
            )
            self._extensions[current.key] = [*ahead, *behind]
            for fit in ahead:
                self._fits.setdefault(fit.key, fit)
        return self._extensions[current.key]

    def _promised(self, current: Fitted) -> list[Promise]:
        """What each effect that ``current`` lacks promises, worked out once."""
        if current.key not in self.promises:
            taken = {effect.id for effect in current.effects}
            self.report(f"{_named(current.effects)}: trying {len(self.candidates)} forms of what else there may be …")
            self.promises[current.key] = screen(current, [one for one in self.candidates if one.id not in taken])
        return self.promises[current.key]

    def found(self, current: Fitted, effect: Effect) -> Found:
        """What ``effect`` gains, and what each other cause would gain in its place."""
        rest = self.without(current, effect)
        ranked = self._ranked(rest, {other.id for other in current.effects})
        return Found(effect, rest.cost - current.cost, worth(current) - worth(rest), ranked)

    def candidates_beside(self, current: Fitted) -> tuple[Rival, ...]:
        """What each cause that ``current`` lacks would gain beside it, best first."""
        return self._ranked(current, {effect.id for effect in current.effects})

    def _ranked(self, rest: Fitted, taken: Collection[str]) -> tuple[Rival, ...]:
        best: dict[str, Rival] = {}
        for fit in self.extensions(rest):
            last, gain = fit.effects[-1], worth(fit) - worth(rest)
            if last.id not in taken and fit.plausible and (last.id not in best or gain > best[last.id].gain):
                best[last.id] = Rival(last, gain, fit)
        return tuple(sorted(best.values(), key=lambda rival: -rival.gain))

    def without_any(self, current: Fitted, *, but_waves: bool = False) -> Fitted:
        """The model without any effect, or with its waves alone."""
        for effect in current.effects:
            if not (effect.wave and but_waves):
                current = self.without(current, effect)
        return current

    def without(self, current: Fitted, effect: Effect) -> Fitted:
        """The model without ``effect``, all else fitted again."""
        effects, x = current.without(effect)
        likelihood = current.likelihood.like(effects)
        key = _key(likelihood)
        if key not in self._fits:
            self._fits[key] = self._restored(climbed(likelihood, x, _ITERATIONS))
        return self._fits[key]

    def _restored(self, fitted: Fitted) -> Fitted:
        """``fitted``, or if a model with one effect less was fitted better, that with the effect put in anew."""
        for effect in fitted.effects:
            effects, _ = fitted.without(effect)
            less = self._fits.get(_key(fitted.likelihood.like(effects)))
            if less is not None and less.cost < fitted.cost:
                likelihood = fitted.likelihood.like((*effects, effect))
                begins = [np.concatenate((less.x, start)) for start in likelihood.starts()]
                return climbed(likelihood, min(begins, key=likelihood.cost), _ITERATIONS)
        return fitted


def worth(fitted: Fitted) -> float:
    """Log-likelihood less the price of the effects' parameters: half the logarithm of the samples (Schwarz 1978)."""
    # Logs too short for any prediction count none.
    count = max(fitted.likelihood.count, 1.0)
    return -fitted.cost - 0.5 * math.log(count) * len(fitted.likelihood.parameters)


def screen(current: Fitted, forms: Sequence[Effect]) -> list[Promise]:
    """What each of ``forms`` promises to gain, from the slopes alone."""
    here = current.likelihood.slopes(current.x)
    past = _Complement(here)
    centre = current.likelihood.innovations(current.x)
    return spread(lambda form: _promise(current, form, centre, here, past), forms)


def _fit_all(current: Fitted, promises: Sequence[Promise]) -> tuple[list[Fitted], list[Fitted]]:
    """Each promise kept: fitted together with all else; and those that fell behind, left where they were."""

    def begin(promise: Promise) -> Fitted:
        likelihood = current.likelihood.like((*current.effects, promise.effect))
        tried = (promise.unscaled, *(_sized(promise.effect, promise.start, share) for share in _SHARES))
        begins = [np.concatenate((current.x, start)) for start in tried]
        return climbed(likelihood, min(begins, key=likelihood.cost), _FIRST_ITERATIONS)

    ahead, behind = spread(begin, promises), list[Fitted]()
    for share, iterations in _STAGES:
        least = max(share * max((worth(fit) - worth(current) for fit in ahead), default=0.0), 0.0)
        behind += [fit for fit in ahead if worth(fit) - worth(current) < least]
        ahead = [fit for fit in ahead if fit not in behind]
        ahead = spread(lambda fit: climbed(fit.likelihood, fit.x, iterations), ahead)  # noqa: B023 - used at once
    return ahead, behind


def climbed(likelihood: Likelihood, x: FloatArray, iterations: int) -> Fitted:
    """The model that so many steps from ``x`` lead to, near enough for a search."""
    return Fitted(likelihood, *likelihood.climb(x, iterations=iterations, tolerance=_TOLERANCE))


def _key(likelihood: Likelihood) -> Key:
    return likelihood.limit, frozenset(effect.key for effect in likelihood.effects)


def _named(effects: Sequence[Effect]) -> str:
    return ", ".join(effect.title for effect in effects) or "no effect"


class _Complement:
    """Projection of directions past what the fitted parameters can do by themselves."""

    def __init__(self, here: Slopes) -> None:
        self.matrix = here.matrix
        self.inverse = np.linalg.pinv(here.matrix.T @ here.matrix, rcond=1e-12)

    def __call__(self, directions: FloatArray) -> FloatArray:
        return np.asarray(directions - self.matrix @ (self.inverse @ (self.matrix.T @ directions)))


def _promise(
    current: Fitted, form: Effect, centre: tuple[FloatArray, FloatArray], here: Slopes, past: _Complement
) -> Promise:
    likelihood = current.likelihood.like((*current.effects, form))
    begins = likelihood.starts()
    sides = [likelihood.innovations(np.concatenate((current.x, begin))) for begin in begins]
    raw = likelihood.slopes_between(centre, sides, np.ones(len(sides))).matrix
    # A drag that falls with the rate runs away from one start, and may hold from another.
    bears = np.flatnonzero(np.isfinite(raw).all(axis=0))
    if not bears.size:
        return Promise(form, 0.0, begins[0], begins[0], 0.0)
    begins, sides, directions = [begins[k] for k in bears], [sides[k] for k in bears], past(raw[:, bears])
    pull = -(directions.T @ here.residual)
    power = np.sum(directions**2, axis=0)
    size = form.parameters[0]
    sizes = np.ones(len(begins)) if size.endless else np.array([begin[0] - size.null for begin in begins])
    # Starts differ in what else there is to an effect, too: the one that shows best at a size tells.
    shown = 0.5 * float(np.max(power * (sizes[0] / sizes) ** 2))
    one_sided = size.low >= size.null or size.high <= size.null
    share = np.where(power > 1e-9, pull / np.maximum(power, 1e-9), 0.0)
    gains = np.where((share > 0.0) | (not one_sided), 0.5 * share * pull, 0.0)
    # Where slopes mislead, as at a threshold, what is gained there without any fit may tell more.
    outright = here.cost - np.array([likelihood.cost_of(*side) for side in sides])
    unscaled = begins[int(np.argmax(outright))]
    if outright.max() > gains.max():
        return Promise(form, float(outright.max()), unscaled, unscaled, shown)
    best = int(np.argmax(gains))
    if gains[best] <= 0.0:
        return Promise(form, 0.0, begins[best], unscaled, shown)
    information = directions.T @ directions
    together = 0.5 * float(pull @ np.linalg.pinv(information, rcond=1e-6) @ pull)
    asked = float(share[best])
    start = _sized(form, begins[best], math.copysign(min(max(abs(asked), 0.1), 5.0), asked))
    return Promise(form, max(together, float(gains[best])), start, unscaled, shown)


def _sized(form: Effect, begin: FloatArray, share: float) -> FloatArray:
    """``begin`` with ``share`` times as much of the effect, within its bounds."""
    size = form.parameters[0]
    if size.endless:
        return begin
    sized = begin.copy()
    sized[0] = np.clip(size.null + share * (begin[0] - size.null), size.low, size.high)
    return sized


def by_cause(promises: Sequence[Promise]) -> list[list[Promise]]:
    """The forms of each cause, best first in both."""
    groups: dict[str, list[Promise]] = {}
    for promise in sorted(promises, key=lambda promise: -promise.gain):
        groups.setdefault(promise.effect.id, []).append(promise)
    return list(groups.values())


def _best_forms(promises: Sequence[Promise]) -> list[Promise]:
    """The most promising form of every cause that shows at all, and more forms of those that show most."""
    counts = ((group, _FORMS_FITTED if place < _FITTED else 1) for place, group in enumerate(by_cause(promises)))
    return [promise for group, count in counts for promise in group[:count] if promise.gain > 0.0]


def shortlist(current: Fitted, promises: Sequence[Promise], least: float) -> list[Promise]:
    """The forms worth fitting: of the causes that promise most, the best forms of each, and simpler ones.

    Slopes promise too much of some forms, and one with fewer parameters may gain as much.
    """
    ranked = [group for group in by_cause(promises)[:_FITTED] if group[0].gain >= least]
    top = max(spread(lambda group: min(group[0].gain, _outright(current, group[0])), ranked), default=0.0)
    return [
        promise
        for first, *others in ranked
        if first.gain >= _PROMISE * top
        for promise in (first, *others)[:_FORMS_FITTED]
        if promise.gain >= _PROMISE * first.gain
        or (promise.gain > 0.0 and len(promise.effect.parameters) < len(first.effect.parameters))
    ]


def _outright(current: Fitted, promise: Promise) -> float:
    """What a form gains where its fit would start, before any."""
    likelihood = current.likelihood.like((*current.effects, promise.effect))
    begins = (np.concatenate((current.x, start)) for start in (promise.start, promise.unscaled))
    return current.cost - min(map(likelihood.cost, begins))
