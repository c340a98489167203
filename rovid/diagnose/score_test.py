"""What each form of a cause promises, from the slopes alone."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray
from rovid.core.spmd import parallel_map
from rovid.diagnose.bic import bic_penalty
from rovid.effects import Effect
from rovid.estimate.fisher_information import Innovations, Jacobian, NormalEquations
from rovid.estimate.fit_result import FitResult
from rovid.estimate.objective import NegativeLogLikelihood

# Directions with less information tell nothing, and with more the model runs away.
_LEAST_POWER, _MOST_POWER = 1e-9, 1e200
# The gain, the starts and the power of a promise.
_Told = tuple[float, FloatArray, FloatArray, float]
# A form beside what is known already, and where to start from with it.
_Begun = tuple[NegativeLogLikelihood, list[FloatArray]]


@dataclass(frozen=True, eq=False)
class Directions:
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
    cross_information: FloatArray
    gains_unfitted: FloatArray

    @classmethod
    def summed(cls, each: Sequence[Self]) -> Self:
        """Over all innovations, of some of them each."""
        # Starts from which the model runs away are infinitely bad in any of them.
        with np.errstate(over="ignore", invalid="ignore"):
            return cls(
                each[0].starts,
                np.sum([one.gradient for one in each], axis=0),
                np.sum([one.information for one in each], axis=0),
                np.sum([one.cross_information for one in each], axis=0),
                np.sum([one.gains_unfitted for one in each], axis=0),
            )

    @property
    def valid(self) -> Self:
        """Of those starts that bear the form."""
        bears = np.flatnonzero(
            (np.diag(self.information) < _MOST_POWER) & np.isfinite(self.cross_information).all(axis=0)
        )
        return type(self)(
            self.starts[bears],
            self.gradient[bears],
            self.information[np.ix_(bears, bears)],
            self.cross_information[:, bears],
            self.gains_unfitted[bears],
        )


@dataclass(frozen=True, eq=False)
class ScoreTest:
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
    best_start: FloatArray
    power: float
    directions: Directions
    equations: NormalEquations

    @property
    def penalised_parameters(self) -> int:
        """How many of its parameters the gain has yet to pay for: of several sizes one."""
        return len(self.effect.parameters) - (self.effect.size_count - 1)


def screen(current: FitResult, forms: Sequence[Effect]) -> list[ScoreTest]:
    """What each of ``forms`` promises to gain, from the slopes alone."""
    misfits = [current.objective.with_effects((*current.effects, form)) for form in forms]
    starts = [misfit.parametrization.initial_values() for misfit in misfits]
    portions: Iterable[Sequence[NegativeLogLikelihood]] = zip(
        current.objective.chunks, *(one.chunks for one in misfits), strict=True
    )
    each = [_slopes(current.x, portion, list(zip(own, starts, strict=True))) for portion, *own in portions]
    equations = NormalEquations.sum_of([own for own, _ in each])
    past = NuisanceProjection(equations)
    tried = map(Directions.summed, zip(*(found for _, found in each), strict=True))
    return [_promised(misfit, one, past, equations) for misfit, one in zip(misfits, tried, strict=True)]


def _slopes(
    x: FloatArray, misfit: NegativeLogLikelihood, begun: Sequence[_Begun]
) -> tuple[NormalEquations, list[Directions]]:
    """At (p,) ``x``: by the parameters of ``misfit``, and of each further form to all of its starts."""
    known = misfit.evaluate_with_spare(x)
    here, (centre, _) = list(misfit.jacobian(x, known)), known

    def tried(few: Sequence[int]) -> list[tuple[int, Directions]]:
        # No more innovations are held than those of a few forms.
        pairs = [(begun[at][0], np.concatenate((x, begin))) for at in few for begin in begun[at][1]]
        found = iter(misfit.evaluate_each(pairs))
        sides = [[next(found) for _ in begun[at][1]] for at in few]
        return [(at, _tried(*begun[at], own, centre, here)) for at, own in zip(few, sides, strict=True)]

    every = dict(pair for pairs in parallel_map(tried, _abreast(begun)) for pair in pairs)
    return NormalEquations.from_jacobians(here), [every[at] for at in range(len(begun))]


def _abreast(begun: Sequence[_Begun]) -> list[list[int]]:
    """Forms by their numbers, some together whose starts fill all lanes; those with most starts first."""
    # Of those that may be side by side, how many starts each few have.
    every: dict[Hashable, list[tuple[int, list[int]]]] = {}
    for at in sorted(range(len(begun)), key=lambda at: -len(begun[at][1])):
        misfit, starts = begun[at]
        alike = every.setdefault(misfit.batch_key, [])
        lanes = misfit.simd_slots_left + 1
        place = next((place for place, (count, _) in enumerate(alike) if len(starts) <= -count % lanes), len(alike))
        count, few = alike.pop(place) if place < len(alike) else (0, [])
        alike.insert(place, (count + len(starts), [*few, at]))
    return sorted((few for alike in every.values() for _, few in alike), key=lambda few: -len(begun[few[0]][1]))


class NuisanceProjection:
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

    def __call__(self, tried: Directions) -> tuple[FloatArray, FloatArray]:
        """(s,) pull of the residual on s directions, and (s, s) their information."""
        common = tried.cross_information[self.free]
        taken = self.inverse @ common
        pull = taken.T @ self.gradient - tried.gradient - tried.cross_information.T @ self.moved
        return pull, tried.information - common.T @ taken


def _tried(
    misfit: NegativeLogLikelihood,
    begins: list[FloatArray],
    sides: list[Innovations],
    centre: Innovations,
    here: Sequence[Jacobian],
) -> Directions:
    """The last effect of ``misfit``, with the innovations at each of its starts."""
    along, power, common = list[FloatArray](), list[FloatArray](), list[FloatArray]()
    # A drag that falls with the rate runs away from one start, and may hold from another.
    with np.errstate(over="ignore", invalid="ignore"):
        # Of as many innovations at a time.
        for own, one in zip(here, misfit.jacobian_between(centre, sides, np.ones(len(sides))), strict=True):
            along.append(one.gradient)
            power.append(one.information)
            common.append(own.cross_information(one))
        gradient, information, both = (np.sum(each, axis=0) for each in (along, power, common))
    outright = misfit.value_of(centre) - np.array([misfit.value_of(side) for side in sides])
    return Directions(np.array(begins), gradient, information, both, outright)


def _promised(
    misfit: NegativeLogLikelihood, every: Directions, past: NuisanceProjection, own: NormalEquations
) -> ScoreTest:
    """Of the last effect of ``misfit``."""
    form, tried = misfit.effects[-1], every.valid
    nothing: _Told = (0.0, every.starts[0], every.starts[0], 0.0)
    return ScoreTest(form, *(_told(misfit, tried, past) if len(tried.starts) else nothing), tried, own)


def _told(misfit: NegativeLogLikelihood, tried: Directions, past: NuisanceProjection) -> _Told:
    """As `_promised`, of those starts that bear the effect."""
    form, begins = misfit.effects[-1], tried.starts
    pull, information = past(tried)
    if form.size_count > 1:
        return _of_several(misfit, begins, pull, information)
    gains, share = gains_each(form, pull, information)
    size = form.parameters[0]
    sizes = np.ones(len(begins)) if size.neutral_at_infinity else begins[:, 0] - size.neutral
    # Starts differ in what else there is to an effect, too: the one that shows best at a size tells.
    shown = 0.5 * float(np.max(np.diag(information) * (sizes[0] / sizes) ** 2))
    # Where slopes mislead, as at a threshold, what is gained there without any fit may tell more.
    unscaled = begins[int(np.argmax(tried.gains_unfitted))]
    if tried.gains_unfitted.max() > gains.max():
        return float(tried.gains_unfitted.max()), unscaled, unscaled, shown
    best = int(np.argmax(gains))
    if gains[best] <= 0.0:
        return 0.0, begins[best], unscaled, shown
    # What noise gains by so many starts together is no promise: all but one are paid for.
    together = gain_together(pull, information) - bic_penalty(misfit) * (len(begins) - 1)
    asked = float(share[best])
    # Slopes hold near by: what they ask for is neither taken to be next to nothing nor far away.
    taken = min(max(abs(asked), 0.1), 5.0)
    start = sized(form, begins[best], math.copysign(taken, asked))
    return max(together, float(gains[best])), start, unscaled, shown


def gains_each(form: Effect, pull: FloatArray, information: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(s,) what a form would gain along each direction that has such a pull and information, and the step asked for."""
    power, size = np.diag(information), form.parameters[0]
    one_sided = size.low >= size.neutral or size.high <= size.neutral
    share = np.where(power > _LEAST_POWER, pull / np.maximum(power, _LEAST_POWER), 0.0)
    return np.where((share > 0.0) | (not one_sided), 0.5 * share * pull, 0.0), share


def gain_together(pull: FloatArray, information: FloatArray) -> float:
    """What a form would gain along all directions together, with such a pull and information."""
    return 0.5 * float(pull @ np.linalg.pinv(information, rcond=1e-6) @ pull)


def _of_several(misfit: NegativeLogLikelihood, begins: FloatArray, pull: FloatArray, information: FloatArray) -> _Told:
    """Of an effect with several sizes, each of which one of its starts has alone; less the price of all but one."""
    form = misfit.effects[-1]
    null = np.array([parameter.neutral for parameter in form.parameters])
    asked = np.linalg.pinv(information, rcond=1e-6) @ pull
    low, high = (bound[-len(null) :] for bound in misfit.parametrization.bounds)
    start = np.clip(null + asked @ (begins - null), low, high)
    price = bic_penalty(misfit) * (form.size_count - 1)
    gain = max(0.5 * float(pull @ asked) - price, 0.0)
    return gain, start, start, float(np.mean(np.diag(information)))


def sized(form: Effect, begin: FloatArray, share: float) -> FloatArray:
    """``begin`` with ``share`` times as much of the effect, within its bounds."""
    sized = begin.copy()
    for k, size in enumerate(form.parameters[: form.size_count]):
        if not size.neutral_at_infinity:
            sized[k] = np.clip(size.neutral + share * (begin[k] - size.neutral), size.low, size.high)
    return sized
