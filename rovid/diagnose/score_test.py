"""What each form of a cause promises, from the slopes alone."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray
from rovid.core.spmd import shared
from rovid.diagnose.bic import price_of_one
from rovid.effects import Effect
from rovid.estimate.fisher_information import Innovations, NormalEquations, Slopes
from rovid.estimate.fit_result import Fitted
from rovid.estimate.objective import Misfit

# Directions with less information tell nothing, and with more the model runs away.
_LEAST_POWER, _MOST_POWER = 1e-9, 1e200
# The gain, the starts and the power of a promise.
_Told = tuple[float, FloatArray, FloatArray, float]
# A form beside what is known already, and where to start from with it.
_Begun = tuple[Misfit, list[FloatArray]]


@dataclass(frozen=True, eq=False)
class Tried:
    """A form beside a model, by the slopes from there to its starts.

    Attributes
    ----------
    starts
        (s, q) coordinates of the form's parameters.
    gradient, information
        (s,) and (s, s) of the cost.
    common
        (p, s) what the information has between the model's parameters and these.
    outright
        (s,) log-likelihood that each start gains as it stands.
    """

    starts: FloatArray
    gradient: FloatArray
    information: FloatArray
    common: FloatArray
    outright: FloatArray

    @classmethod
    def summed(cls, each: Sequence[Self]) -> Self:
        """Over all innovations, of some of them each."""
        # Starts from which the model runs away are infinitely bad in any of them.
        with np.errstate(over="ignore", invalid="ignore"):
            return cls(
                each[0].starts,
                np.sum([one.gradient for one in each], axis=0),
                np.sum([one.information for one in each], axis=0),
                np.sum([one.common for one in each], axis=0),
                np.sum([one.outright for one in each], axis=0),
            )

    @property
    def borne(self) -> Self:
        """Of those starts that bear the form."""
        bears = np.flatnonzero((np.diag(self.information) < _MOST_POWER) & np.isfinite(self.common).all(axis=0))
        return type(self)(
            self.starts[bears],
            self.gradient[bears],
            self.information[np.ix_(bears, bears)],
            self.common[:, bears],
            self.outright[bears],
        )


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
    tried, own
        What it was made of, of those starts that bear it, and the slopes by the model's parameters.
    """

    effect: Effect
    gain: float
    start: FloatArray
    unscaled: FloatArray
    power: float
    tried: Tried
    own: NormalEquations

    @property
    def unpaid(self) -> int:
        """How many of its parameters the gain has yet to pay for: of several sizes one."""
        return len(self.effect.parameters) - (self.effect.sizes - 1)


def screen(current: Fitted, forms: Sequence[Effect]) -> list[Promise]:
    """What each of ``forms`` promises to gain, from the slopes alone."""
    misfits = [current.misfit.like((*current.effects, form)) for form in forms]
    starts = [misfit.coordinates.starts() for misfit in misfits]
    portions: Iterable[Sequence[Misfit]] = zip(current.misfit.portions, *(one.portions for one in misfits), strict=True)
    each = [_slopes(current.x, portion, list(zip(own, starts, strict=True))) for portion, *own in portions]
    equations = NormalEquations.summed([own for own, _ in each])
    past = Past(equations)
    tried = map(Tried.summed, zip(*(found for _, found in each), strict=True))
    return [_promised(misfit, one, past, equations) for misfit, one in zip(misfits, tried, strict=True)]


def _slopes(x: FloatArray, misfit: Misfit, begun: Sequence[_Begun]) -> tuple[NormalEquations, list[Tried]]:
    """At (p,) ``x``: by the parameters of ``misfit``, and of each further form to all of its starts."""
    known = misfit.looked(x)
    here, (centre, _) = list(misfit.slopes(x, known)), known

    def tried(few: Sequence[int]) -> list[tuple[int, Tried]]:
        # No more innovations are held than those of a few forms.
        pairs = [(begun[at][0], np.concatenate((x, begin))) for at in few for begin in begun[at][1]]
        found = iter(misfit.of_each(pairs))
        sides = [[next(found) for _ in begun[at][1]] for at in few]
        return [(at, _tried(*begun[at], own, centre, here)) for at, own in zip(few, sides, strict=True)]

    every = dict(pair for pairs in shared(tried, _abreast(begun)) for pair in pairs)
    return NormalEquations.of(here), [every[at] for at in range(len(begun))]


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


class Past:
    """What directions have past what the parameters of a model can do by themselves.

    Some of these may be ``held`` where they were ``moved`` to, (p,) both: then it is what directions have from there.

    Attributes
    ----------
    lost
        Log-likelihood that the move costs, all other parameters moved along with it.
    """

    def __init__(self, own: NormalEquations, held: BoolArray | bool = False, moved: FloatArray | float = 0.0) -> None:
        count = len(own.gradient)
        self.free = np.flatnonzero(~np.broadcast_to(held, count))
        self.moved = np.broadcast_to(moved, count)
        pushed = own.information @ self.moved
        self.gradient = (own.gradient + pushed)[self.free]
        self.inverse = np.linalg.pinv(own.information[np.ix_(self.free, self.free)], rcond=1e-12)
        risen = float(self.moved @ (own.gradient + 0.5 * pushed))
        self.lost = risen - 0.5 * float(self.gradient @ self.inverse @ self.gradient)

    def __call__(self, tried: Tried) -> tuple[FloatArray, FloatArray]:
        """(s,) pull of the residual on s directions, and (s, s) their information."""
        common = tried.common[self.free]
        taken = self.inverse @ common
        pull = taken.T @ self.gradient - tried.gradient - tried.common.T @ self.moved
        return pull, tried.information - common.T @ taken


def _tried(
    misfit: Misfit, begins: list[FloatArray], sides: list[Innovations], centre: Innovations, here: Sequence[Slopes]
) -> Tried:
    """The last effect of ``misfit``, with the innovations at each of its starts."""
    along, power, common = list[FloatArray](), list[FloatArray](), list[FloatArray]()
    # A drag that falls with the rate runs away from one start, and may hold from another.
    with np.errstate(over="ignore", invalid="ignore"):
        # Of as many innovations at a time.
        for own, one in zip(here, misfit.slopes_between(centre, sides, np.ones(len(sides))), strict=True):
            along.append(one.gradient)
            power.append(one.information)
            common.append(own.with_others(one))
        gradient, information, both = (np.sum(each, axis=0) for each in (along, power, common))
    outright = misfit.cost_of(centre) - np.array([misfit.cost_of(side) for side in sides])
    return Tried(np.array(begins), gradient, information, both, outright)


def _promised(misfit: Misfit, every: Tried, past: Past, own: NormalEquations) -> Promise:
    """Of the last effect of ``misfit``."""
    form, tried = misfit.effects[-1], every.borne
    nothing: _Told = (0.0, every.starts[0], every.starts[0], 0.0)
    return Promise(form, *(_told(misfit, tried, past) if len(tried.starts) else nothing), tried, own)


def _told(misfit: Misfit, tried: Tried, past: Past) -> _Told:
    """As `_promised`, of those starts that bear the effect."""
    form, begins = misfit.effects[-1], tried.starts
    pull, information = past(tried)
    if form.sizes > 1:
        return _of_several(misfit, begins, pull, information)
    gains, share = gains_each(form, pull, information)
    size = form.parameters[0]
    sizes = np.ones(len(begins)) if size.endless else begins[:, 0] - size.null
    # Starts differ in what else there is to an effect, too: the one that shows best at a size tells.
    shown = 0.5 * float(np.max(np.diag(information) * (sizes[0] / sizes) ** 2))
    # Where slopes mislead, as at a threshold, what is gained there without any fit may tell more.
    unscaled = begins[int(np.argmax(tried.outright))]
    if tried.outright.max() > gains.max():
        return float(tried.outright.max()), unscaled, unscaled, shown
    best = int(np.argmax(gains))
    if gains[best] <= 0.0:
        return 0.0, begins[best], unscaled, shown
    # What noise gains by so many starts together is no promise: all but one are paid for.
    together = gain_together(pull, information) - price_of_one(misfit) * (len(begins) - 1)
    asked = float(share[best])
    # Slopes hold near by: what they ask for is neither taken to be next to nothing nor far away.
    taken = min(max(abs(asked), 0.1), 5.0)
    start = sized(form, begins[best], math.copysign(taken, asked))
    return max(together, float(gains[best])), start, unscaled, shown


def gains_each(form: Effect, pull: FloatArray, information: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(s,) what a form would gain along each direction that has such a pull and information, and the step asked for."""
    power, size = np.diag(information), form.parameters[0]
    one_sided = size.low >= size.null or size.high <= size.null
    share = np.where(power > _LEAST_POWER, pull / np.maximum(power, _LEAST_POWER), 0.0)
    return np.where((share > 0.0) | (not one_sided), 0.5 * share * pull, 0.0), share


def gain_together(pull: FloatArray, information: FloatArray) -> float:
    """What a form would gain along all directions together, with such a pull and information."""
    return 0.5 * float(pull @ np.linalg.pinv(information, rcond=1e-6) @ pull)


def _of_several(misfit: Misfit, begins: FloatArray, pull: FloatArray, information: FloatArray) -> _Told:
    """Of an effect with several sizes, each of which one of its starts has alone; less the price of all but one."""
    form = misfit.effects[-1]
    null = np.array([parameter.null for parameter in form.parameters])
    asked = np.linalg.pinv(information, rcond=1e-6) @ pull
    low, high = (bound[-len(null) :] for bound in misfit.coordinates.bounds)
    start = np.clip(null + asked @ (begins - null), low, high)
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
