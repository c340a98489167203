"""What each form of a cause promises, from the slopes alone, and which of them are worth a fit."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rovid.diagnose.rivals import climbed_on, cost_of, fitted_together, price_of_one, quickly_climbed, worth
from rovid.effects import Effect
from rovid.ground.arrays import FloatArray
from rovid.ground.in_step import shared
from rovid.identify.fitted import Fitted
from rovid.identify.misfit import Misfit
from rovid.identify.scoring import Innovations, NormalEquations, Slopes

# Of the best candidate's promise, as far as its fit begins by keeping it: who promises less is not fitted.
_PROMISE = 0.1
_FITTED = 7
_FORMS_FITTED = 3
ITERATIONS = 25
# Sizes to begin with, as shares of what the slopes ask for: where they mislead, that may be far too much.
_SHARES = (1.0, 0.3, 0.1)
_FIRST_ITERATIONS = 4
# Then those go on, for so many steps, that have this share of the best one's worth.
_STAGES = ((0.2, 8), (0.4, ITERATIONS))
# Rivals that come nearer than that to the best, in log-likelihood, are told from it by what they are worth to the end.
_CLOSE = 50.0
# What a promise has beside the effect.
_Promised = tuple[float, FloatArray, FloatArray, float]
# A form beside what is known already, and where to start from with it.
_Begun = tuple[Misfit, list[FloatArray]]


@dataclass(frozen=True, eq=False)
class Promise:
    """What the slopes say that one form of an effect would gain.

    Attributes
    ----------
    gain
        Of log-likelihood, over all starts of the form together; of several sizes all but one are paid for.
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

    @property
    def unpaid(self) -> int:
        """How many of its parameters the gain has yet to pay for: of several sizes one."""
        return len(self.effect.parameters) - (self.effect.sizes - 1)


def screen(current: Fitted, forms: Sequence[Effect]) -> list[Promise]:
    """What each of ``forms`` promises to gain, from the slopes alone."""
    known = current.misfit.looked(current.x)
    past, (centre, _) = _Complement(list(current.misfit.slopes(current.x, known))), known
    misfits = [current.misfit.like((*current.effects, form)) for form in forms]
    begun = [(misfit, misfit.coordinates.starts()) for misfit in misfits]

    def promised(few: Sequence[int]) -> list[tuple[int, _Promised]]:
        # No more innovations are held than those of a few forms.
        pairs = [(begun[at][0], np.concatenate((current.x, begin))) for at in few for begin in begun[at][1]]
        found = iter(current.misfit.of_each(pairs))
        sides = [[next(found) for _ in begun[at][1]] for at in few]
        return [(at, _promised(*begun[at], own, centre, past)) for at, own in zip(few, sides, strict=True)]

    found = shared(promised, _abreast(begun))
    promises = dict(pair for pairs in found for pair in pairs)
    return [Promise(form, *promises[at]) for at, form in enumerate(forms)]


def _abreast(begun: Sequence[_Begun]) -> list[list[int]]:
    """Forms by their numbers, some together whose starts fill all lanes; those with most starts first."""
    # Of those that may be side by side, how many starts each few have.
    every: dict[Hashable, list[tuple[int, list[int]]]] = {}
    for at in sorted(range(len(begun)), key=lambda at: -len(begun[at][1])):
        misfit, starts = begun[at]
        alike = every.setdefault(misfit.abreast, [])
        lanes = misfit.spare + 1
        place = next((place for place, (count, _) in enumerate(alike) if len(starts) <= -count % lanes), len(alike))
        count, few = alike.pop(place) if place < len(alike) else (0, [])
        alike.insert(place, (count + len(starts), [*few, at]))
    return sorted((few for alike in every.values() for _, few in alike), key=lambda few: -len(begun[few[0]][1]))


def fit_all(
    current: Fitted, promises: Sequence[Promise], leads: Callable[[Fitted], bool], ends: Mapping[str, Fitted]
) -> tuple[list[Fitted], list[Fitted]]:
    """Each promise kept: fitted together with all else; and those that fell behind, left where they were.

    None is followed that cannot catch up with the worthiest of those that may lead, as ``leads`` has it. Of a cause
    whose first forms fell behind no others are fitted that promise no more than that. ``ends`` are, by the key of what
    they add, models that were followed to their end: these are not fitted again.
    """

    def gain(fit: Fitted) -> float:
        return worth(fit) - worth(current)

    def least(share: float, fits: Sequence[Fitted]) -> float:
        return max(share * max(map(gain, fits), default=0.0), 0.0)

    def goals(misfits: Sequence[Misfit], fits: Sequence[Fitted]) -> list[float]:
        close = max(map(worth, filter(leads, fits)), default=-math.inf) - _CLOSE
        return [cost_of(close, misfit) for misfit in misfits]

    def begun(few: Sequence[Promise]) -> list[Fitted]:
        misfits = [_with_promised(current, one) for one in few]
        costs = goals(misfits, ended)
        return fitted_together(misfits, lambda at: _begun(current, misfits[at], few[at], costs[at]))

    def followed(fits: Sequence[Fitted], iterations: int) -> list[Fitted]:
        misfits = [fit.misfit for fit in fits]
        costs = goals(misfits, fits)
        return fitted_together(misfits, lambda at: climbed_on(fits[at], iterations, costs[at]))

    ended = [ends[one.effect.key] for one in promises if one.effect.key in ends]
    left = [one for one in promises if one.effect.key not in ends]
    first = _first_of_each(left)
    ahead, behind = [*ended, *begun(first)], list[Fitted]()
    limit = least(_STAGES[0][0], ahead)
    in_front = {fit.effects[-1].id for fit in ahead if gain(fit) >= limit}
    more = [one for one in left if one.effect.id in in_front or one.gain >= limit]
    ahead += begun([one for one in more if one not in first])
    for share, iterations in _STAGES:
        limit = least(share, ahead)
        behind += [fit for fit in ahead if gain(fit) < limit]
        ahead = followed([fit for fit in ahead if gain(fit) >= limit], iterations)
    return ahead, behind


def _first_of_each(promises: Sequence[Promise]) -> list[Promise]:
    """Of each cause the most promising form, and the first of the plainest."""
    groups = by_cause(promises)
    plainest = [min(forms, key=lambda one: len(one.effect.parameters)) for forms in groups]
    pairs = zip(groups, plainest, strict=True)
    return [one for forms, plain in pairs for one in dict.fromkeys((forms[0], plain))]


def _with_promised(current: Fitted, promise: Promise) -> Misfit:
    return current.misfit.like((*current.effects, promise.effect))


def _begun(current: Fitted, misfit: Misfit, promise: Promise, goal: float) -> Fitted:
    """``current`` with what is promised, after the first steps from the nearest of several sizes to the ``goal``."""
    scaled = [sized(promise.effect, promise.start, share) for share in _SHARES]
    begins = [np.concatenate((current.x, start)) for start in (promise.unscaled, *scaled)]
    (nearest,) = misfit.likeliest(begins, 1)
    return quickly_climbed(misfit, nearest, _FIRST_ITERATIONS, goal)


class _Complement:
    """What directions have past what the fitted parameters can do by themselves, by their products alone.

    ``here`` are the slopes by those parameters, some innovations after the other.
    """

    def __init__(self, here: Sequence[Slopes]) -> None:
        self.here = here
        self.gradient, information = NormalEquations.of(here)
        self.inverse = np.linalg.pinv(information, rcond=1e-12)

    def __call__(self, directions: Iterable[Slopes]) -> tuple[FloatArray, FloatArray]:
        """(s,) pull of the residual on s directions, and (s, s) their information; of as many innovations at a time."""
        along, power, shared = list[FloatArray](), list[FloatArray](), list[FloatArray]()
        for here, one in zip(self.here, directions, strict=True):
            along.append(one.gradient)
            power.append(one.information)
            shared.append(here.with_others(one))
        both = np.sum(shared, axis=0)
        taken = self.inverse @ both
        return taken.T @ self.gradient - np.sum(along, axis=0), np.sum(power, axis=0) - both.T @ taken


def _promised(
    misfit: Misfit,
    begins: list[FloatArray],
    sides: list[Innovations],
    centre: Innovations,
    past: _Complement,
) -> _Promised:
    """Of the last effect of ``misfit``, with the innovations at each of its starts."""
    form = misfit.effects[-1]
    # A drag that falls with the rate runs away from one start, and may hold from another.
    with np.errstate(over="ignore", invalid="ignore"):
        pull, information = past(misfit.slopes_between(centre, sides, np.ones(len(sides))))
    bears = np.flatnonzero(np.isfinite(np.diag(information)))
    if not bears.size:
        return 0.0, begins[0], begins[0], 0.0
    begins, sides = [begins[k] for k in bears], [sides[k] for k in bears]
    pull, information = pull[bears], information[np.ix_(bears, bears)]
    if form.sizes > 1:
        return _of_several(misfit, begins, pull, information)
    power = np.diag(information)
    size = form.parameters[0]
    sizes = np.ones(len(begins))
    if not size.endless:
        sizes = np.array([begin[0] - size.null for begin in begins])
    # Starts differ in what else there is to an effect, too: the one that shows best at a size tells.
    shown = 0.5 * float(np.max(power * (sizes[0] / sizes) ** 2))
    one_sided = size.low >= size.null or size.high <= size.null
    share = np.where(power > 1e-9, pull / np.maximum(power, 1e-9), 0.0)
    gains = np.where((share > 0.0) | (not one_sided), 0.5 * share * pull, 0.0)
    # Where slopes mislead, as at a threshold, what is gained there without any fit may tell more.
    outright = misfit.cost_of(centre) - np.array([misfit.cost_of(side) for side in sides])
    unscaled = begins[int(np.argmax(outright))]
    if outright.max() > gains.max():
        return float(outright.max()), unscaled, unscaled, shown
    best = int(np.argmax(gains))
    if gains[best] <= 0.0:
        return 0.0, begins[best], unscaled, shown
    together = 0.5 * float(pull @ np.linalg.pinv(information, rcond=1e-6) @ pull)
    # What noise gains by so many starts together is no promise: all but one are paid for.
    together -= price_of_one(misfit) * (len(begins) - 1)
    asked = float(share[best])
    # Slopes hold near by: what they ask for is neither taken to be next to nothing nor far away.
    taken = min(max(abs(asked), 0.1), 5.0)
    start = sized(form, begins[best], math.copysign(taken, asked))
    return max(together, float(gains[best])), start, unscaled, shown


def _of_several(misfit: Misfit, begins: list[FloatArray], pull: FloatArray, information: FloatArray) -> _Promised:
    """Of an effect with several sizes, each of which one of its starts has alone; less the price of all but one."""
    form = misfit.effects[-1]
    null = np.array([parameter.null for parameter in form.parameters])
    asked = np.linalg.pinv(information, rcond=1e-6) @ pull
    low, high = (bound[-len(null) :] for bound in misfit.coordinates.bounds)
    start = np.clip(null + asked @ (np.array(begins) - null), low, high)
    price = price_of_one(misfit) * (form.sizes - 1)
    gain = max(0.5 * float(pull @ asked) - price, 0.0)
    return gain, start, start, float(np.mean(np.diag(information)))


def sized(form: Effect, begin: FloatArray, share: float) -> FloatArray:
    """``begin`` with ``share`` times as much of the effect, within its bounds."""
    sized = begin.copy()
    for k, size in enumerate(form.parameters[: form.sizes]):
        if not size.endless:
            sized[k] = np.clip(size.null + share * (begin[k] - size.null), size.low, size.high)
    return sized


def by_cause(promises: Sequence[Promise]) -> list[list[Promise]]:
    """The forms of each cause, best first in both."""
    groups: dict[str, list[Promise]] = {}
    for promise in sorted(promises, key=lambda promise: -promise.gain):
        groups.setdefault(promise.effect.id, []).append(promise)
    return list(groups.values())


def gains_of(promises: Sequence[Promise]) -> list[float]:
    """What the best form of each cause promises, the most first."""
    return [forms[0].gain for forms in by_cause(promises)]


def best_forms(promises: Sequence[Promise]) -> list[Promise]:
    """The most promising form of every cause that shows at all, and more forms of those that show most."""
    listed: list[Promise] = []
    for place, group in enumerate(by_cause(promises)):
        count = _FORMS_FITTED if place < _FITTED else 1
        listed += [promise for promise in group[:count] if promise.gain > 0.0]
    return listed


def shortlist(
    current: Fitted, promises: Sequence[Promise], threshold: float, share: float, gained: float = 0.0
) -> list[Promise]:
    """The forms worth fitting: of the causes that promise most, the best forms of each, and simpler ones.

    None promises less than a ``share`` of what it has to gain: its parameters' price and the ``threshold``. Slopes
    promise too much of some forms, and one with fewer parameters may gain as much. So much is ``gained`` by one that
    is known already.
    """
    each = price_of_one(current.misfit)

    def is_enough(promise: Promise) -> bool:
        return promise.gain >= share * (threshold + each * promise.unpaid)

    ranked = [group for group in by_cause(promises)[:_FITTED] if any(map(is_enough, group))]
    kept = shared(lambda group: min(group[0].gain, _outright(current, group[0])), ranked)
    top = max((gained, *kept))
    listed: list[Promise] = []
    for group in ranked:
        if group[0].gain >= _PROMISE * top:
            listed += _worth_a_fit(group, is_enough)
    return listed


def _worth_a_fit(group: Sequence[Promise], is_enough: Callable[[Promise], bool]) -> list[Promise]:
    """Of the forms of a cause, best first: the first few that promise enough, and simpler ones that promise at all."""
    first, few, rest = group[:1], group[:_FORMS_FITTED], group[_FORMS_FITTED:]
    least = _PROMISE * first[0].gain
    listed = [one for one in few if (one.gain >= least and is_enough(one)) or _is_simpler(one, first)]
    return [*listed, *(one for one in rest if _is_simpler(one, listed))]


def _is_simpler(promise: Promise, others: Sequence[Promise]) -> bool:
    """Whether a form promises anything with fewer parameters than any of the ``others``."""
    return promise.gain > 0.0 and len(promise.effect.parameters) < min(len(one.effect.parameters) for one in others)


def _outright(current: Fitted, promise: Promise) -> float:
    """What a form gains where its fit would start, before any."""
    misfit = _with_promised(current, promise)
    begins = [np.concatenate((current.x, start)) for start in (promise.start, promise.unscaled)]
    return current.cost - min(misfit.costs_of(begins))
