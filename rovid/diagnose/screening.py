"""Screening: score tests (Lagrange multiplier tests), and the shortlist of the forms that deserve a fit by them.

A score test predicts the log-likelihood gain of a further effect without a fit.
"""

import math
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray
from rovid.core.spmd import parallel_map
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects import Effect
from rovid.estimate.fisher_information import Innovations, Jacobian, NormalEquations
from rovid.estimate.fit_result import FitResult
from rovid.estimate.nested_fits import scaled_start
from rovid.estimate.objective import NegativeLogLikelihood

# Information below which a direction has no effect on the innovations, and above which the model diverges.
_MIN_INFORMATION, _MAX_INFORMATION = 1e-9, 1e200
# Gain, start of a fit, best start as it stands, and gain at the size of the first start.
_Prediction = tuple[float, FloatArray, FloatArray, float]
# Objective with a further form, and the initial values of that form.
_FormStarts = tuple[NegativeLogLikelihood, list[FloatArray]]


def bic_penalty(objective: NegativeLogLikelihood) -> float:
    """BIC penalty of one parameter in nats, half the logarithm of the effective sample size (Schwarz 1978)."""
    # Very short logs have no effective sample at all.
    return 0.5 * math.log(max(objective.effective_count, 1.0))


class Directions(NamedTuple):
    """Derivatives of the negative log-likelihood along the directions from a model to the starts of a further form."""

    starts: FloatArray  # (s, q) initial values of the form's parameters
    gradient: FloatArray  # (s,)
    information: FloatArray  # (s, s)
    cross_information: FloatArray  # (p, s) between the model's parameters and the directions
    gains_unfitted: FloatArray  # (s,) log-likelihood gain at each start

    @classmethod
    def summed(cls, each: Sequence[Self]) -> Self:
        """The sum over chunks of the data."""
        # Starts from which the model diverges have infinite values in any chunk.
        with np.errstate(over="ignore", invalid="ignore"):
            sums = [np.sum(chunks, axis=0) for chunks in zip(*(one[1:] for one in each), strict=True)]
        return cls(each[0].starts, *sums)

    @property
    def valid(self) -> Self:
        """The directions along which the model does not diverge."""
        finite = np.isfinite(self.cross_information).all(axis=0)
        valid = np.flatnonzero((np.diag(self.information) < _MAX_INFORMATION) & finite)
        return type(self)(
            self.starts[valid],
            self.gradient[valid],
            self.information[np.ix_(valid, valid)],
            self.cross_information[:, valid],
            self.gains_unfitted[valid],
        )


@dataclass(frozen=True, eq=False)
class ScoreTest:
    """Score test of one form of an effect.

    ``gain`` is the predicted log-likelihood gain (nats) over all starts together. With several sizes, it includes the
    BIC penalty of all but one.
    """

    effect: Effect
    gain: float
    start: FloatArray  # initial values of a fit, with the size that the linearisation predicts
    best_start: FloatArray  # the start with the largest gain as it stands
    power: float  # log-likelihood gain of an effect with the size of the first start
    directions: Directions  # valid directions of the form
    equations: NormalEquations  # of the model


class NuisanceProjection:
    """Removal of everything that the parameters of a model can do from directions of further forms.

    Parameters
    ----------
    held, moved
        (p,) parameters that are held, and the displacement at which they are held.

    Attributes
    ----------
    lost
        Log-likelihood that the displacement loses, all other parameters refitted to first order.
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

    def __call__(self, directions: Directions) -> tuple[FloatArray, FloatArray]:
        """(s,) score along the projected directions, and (s, s) their information."""
        cross = directions.cross_information[self.free]
        coefficients = self.inverse @ cross
        score = coefficients.T @ self.gradient - directions.gradient - directions.cross_information.T @ self.moved
        return score, directions.information - cross.T @ coefficients


def score_tests(current: FitResult, forms: Sequence[Effect]) -> list[ScoreTest]:
    """Score test of each of ``forms`` as an addition to a fitted model; none next to a model that diverges."""
    objectives = [current.objective.with_effects((*current.effects, form)) for form in forms]
    starts = [objective.parametrization.initial_values() for objective in objectives]
    chunks: Iterable[Sequence[NegativeLogLikelihood]] = zip(
        current.objective.chunks, *(one.chunks for one in objectives), strict=True
    )
    each = [_chunk_derivatives(current.x, chunk, list(zip(own, starts, strict=True))) for chunk, *own in chunks]
    equations = NormalEquations.sum_of([own for own, _ in each])
    if not np.isfinite(equations.information).all():
        return []
    projection = NuisanceProjection(equations)
    tests = []
    for objective, parts in zip(objectives, zip(*(found for _, found in each), strict=True), strict=True):
        every = Directions.summed(parts)
        valid = every.valid
        predicted: _Prediction = (0.0, every.starts[0], every.starts[0], 0.0)
        if len(valid.starts):
            predicted = _predict(objective, valid, projection)
        tests.append(ScoreTest(objective.effects[-1], *predicted, valid, equations))
    return tests


def _chunk_derivatives(
    x: FloatArray, objective: NegativeLogLikelihood, forms: Sequence[_FormStarts]
) -> tuple[NormalEquations, list[Directions]]:
    """Normal equations of the model at ``x``, and the directions of all forms, for one chunk of the data."""
    known = objective.evaluate_with_spare(x)
    own, (centre, _) = list(objective.jacobian(x, known)), known

    def directions(batch: Sequence[int]) -> list[tuple[int, Directions]]:
        # Memory holds the innovations of one batch at a time.
        pairs = [(forms[at][0], np.concatenate((x, begin))) for at in batch for begin in forms[at][1]]
        found = iter(objective.evaluate_each(pairs))
        sides = [[next(found) for _ in forms[at][1]] for at in batch]
        return [(at, _directions(*forms[at], side, centre, own)) for at, side in zip(batch, sides, strict=True)]

    every = dict(pair for pairs in parallel_map(directions, _batches(forms)) for pair in pairs)
    return NormalEquations.from_jacobians(own), [every[at] for at in range(len(forms))]


def _batches(forms: Sequence[_FormStarts]) -> list[list[int]]:
    """Indices of forms, grouped so that their starts fill whole SIMD vectors; the largest groups first."""
    # By batch key: the number of starts, and the forms, of each group.
    every: dict[Hashable, list[tuple[int, list[int]]]] = {}
    for at in sorted(range(len(forms)), key=lambda at: -len(forms[at][1])):
        objective, starts = forms[at]
        groups = every.setdefault(objective.batch_key, [])
        width = objective.simd_slots_left + 1
        place = next((place for place, (count, _) in enumerate(groups) if len(starts) <= -count % width), len(groups))
        count, batch = groups.pop(place) if place < len(groups) else (0, [])
        groups.insert(place, (count + len(starts), [*batch, at]))
    return sorted(
        (batch for groups in every.values() for _, batch in groups), key=lambda batch: -len(forms[batch[0]][1])
    )


def _directions(
    objective: NegativeLogLikelihood,
    starts: list[FloatArray],
    sides: list[Innovations],
    centre: Innovations,
    own: Sequence[Jacobian],
) -> Directions:
    """Directions of the last effect, from the innovations ``sides`` at its ``starts``."""
    gradients, informations, crosses = list[FloatArray](), list[FloatArray](), list[FloatArray]()
    # A model may diverge from some starts and not from others.
    with np.errstate(over="ignore", invalid="ignore"):
        for rows, one in zip(own, objective.jacobian_between(centre, sides, np.ones(len(sides))), strict=True):
            gradients.append(one.gradient)
            informations.append(one.information)
            crosses.append(rows.cross_information(one))
        gradient, information, cross = (np.sum(each, axis=0) for each in (gradients, informations, crosses))
    gains = objective.value_of(centre) - np.array(list(map(objective.value_of, sides)))
    return Directions(np.array(starts), gradient, information, cross, gains)


def _predict(objective: NegativeLogLikelihood, directions: Directions, projection: NuisanceProjection) -> _Prediction:
    """Predicted gain and starts of the last effect of ``objective``."""
    form, starts = objective.effects[-1], directions.starts
    score, information = projection(directions)
    if form.size_count > 1:
        neutral = np.array([parameter.neutral for parameter in form.parameters])
        step = np.linalg.pinv(information, rcond=1e-6) @ score
        low, high = (bound[-len(neutral) :] for bound in objective.parametrization.bounds)
        start = np.clip(neutral + step @ (starts - neutral), low, high)
        penalty = bic_penalty(objective) * (form.size_count - 1)
        gain = max(0.5 * float(score @ step) - penalty, 0.0)
        return gain, start, start, float(np.mean(np.diag(information)))
    gains, share = gains_each(form, score, information)
    size = form.parameters[0]
    sizes = np.ones(len(starts)) if size.neutral_at_infinity else starts[:, 0] - size.neutral
    # Starts differ in other parameters too: the power is that of the most visible start, scaled to the first size.
    power = 0.5 * float(np.max(np.diag(information) * (sizes[0] / sizes) ** 2))
    # Where the linearisation misleads, as at a threshold, the gain at a start may be larger.
    likeliest, best = int(np.argmax(directions.gains_unfitted)), int(np.argmax(gains))
    best_start = starts[likeliest]
    if directions.gains_unfitted[likeliest] > gains[best]:
        return float(directions.gains_unfitted[likeliest]), best_start, best_start, power
    if gains[best] <= 0.0:
        return 0.0, starts[best], best_start, power
    # The joint gain of many starts includes that of noise: all but one have their BIC penalty.
    together = gain_together(score, information) - bic_penalty(objective) * (len(starts) - 1)
    predicted = float(share[best])
    smallest, largest = THRESHOLDS.start_share_limits
    share_of_start = math.copysign(min(max(abs(predicted), smallest), largest), predicted)
    start = scaled_start(form, starts[best], share_of_start)
    return max(together, float(gains[best])), start, best_start, power


def gains_each(form: Effect, score: FloatArray, information: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(s,) predicted gain along each direction alone, and the predicted step in units of the direction."""
    power, size = np.diag(information), form.parameters[0]
    one_sided = size.low >= size.neutral or size.high <= size.neutral
    share = np.where(power > _MIN_INFORMATION, score / np.maximum(power, _MIN_INFORMATION), 0.0)
    return np.where((share > 0.0) | (not one_sided), 0.5 * share * score, 0.0), share


def gain_together(score: FloatArray, information: FloatArray) -> float:
    """Predicted gain along all directions together."""
    return 0.5 * float(score @ np.linalg.pinv(information, rcond=1e-6) @ score)


def possible_substitutes(
    current: FitResult, tests: Sequence[ScoreTest], *removed: Effect, share: float = THRESHOLDS.substitute_share
) -> list[Effect]:
    """Forms that may replace effects, from the score ``tests`` at the model ``current`` that includes the effects.

    The sizes of the ``removed`` effects are set to zero by linearisation. A form is possible if its predicted gain
    there is at least the ``share`` of the log-likelihood lost. The form with the largest predicted gain comes first.
    """
    sizes = [size for effect in removed for size in effect.parameters[: effect.size_count]]
    if any(size.neutral_at_infinity for size in sizes) or not tests:
        # The linearisation does not reach an infinite neutral value.
        return [test.effect for test in tests]
    held, moved = np.zeros(len(current.x), dtype=bool), np.zeros(len(current.x))
    for effect, place in current.objective.parametrization.effect_slices():
        if effect in removed:
            own = current.effect_coordinates(effect)
            held[place], moved[place] = True, scaled_start(effect, own, 0.0) - own
    projection = NuisanceProjection(tests[0].equations, held, moved)

    def gain(test: ScoreTest) -> float:
        if not len(test.directions.starts):
            return math.inf  # no valid direction: the prediction is unknown
        score, information = projection(test.directions)
        if test.effect.size_count > 1:
            return gain_together(score, information)
        gains, _ = gains_each(test.effect, score, information)
        return float(gains.max())

    least = share * projection.lost
    gains = [(gain(test), test.effect) for test in tests]
    return [effect for own, effect in sorted(gains, key=lambda pair: -pair[0]) if own >= least]


def group_by_cause(tests: Sequence[ScoreTest]) -> list[list[ScoreTest]]:
    """Score tests of the forms of each effect, the largest predicted gain first in both lists."""
    groups: dict[str, list[ScoreTest]] = {}
    for test in sorted(tests, key=lambda test: -test.gain):
        groups.setdefault(test.effect.id, []).append(test)
    return list(groups.values())


def best_forms(tests: Sequence[ScoreTest]) -> list[ScoreTest]:
    """The best form of every effect with a predicted gain, and more forms of the best effects."""
    listed: list[ScoreTest] = []
    for place, group in enumerate(group_by_cause(tests)):
        count = THRESHOLDS.shortlisted_forms if place < THRESHOLDS.shortlisted_causes else 1
        listed += [test for test in group[:count] if test.gain > 0.0]
    return listed


def shortlist(
    current: FitResult, tests: Sequence[ScoreTest], threshold: float, share: float, known_gain: float = 0.0
) -> list[ScoreTest]:
    """Forms that deserve a fit: the best forms of the best effects, and simpler ones.

    ``threshold``, ``share``: A form needs a predicted gain of ``share`` times the sum of its BIC penalty and the
        ``threshold``.
    ``known_gain``: Largest gain of a model that has been fitted already.
    """
    penalty = bic_penalty(current.objective)

    def is_enough(test: ScoreTest) -> bool:
        # The gain includes the BIC penalty of all sizes but one. An instant has that of two parameters.
        count = len(test.effect.parameters) - (test.effect.size_count - 1) + len(test.effect.instants)
        return test.gain >= share * (threshold + penalty * count)

    def gain_at_start(test: ScoreTest) -> float:
        begins = [np.concatenate((current.x, start)) for start in (test.start, test.best_start)]
        return current.value - min(extended(current, test).values(begins))

    ranked = [group for group in group_by_cause(tests)[: THRESHOLDS.shortlisted_causes] if any(map(is_enough, group))]
    confirmed = parallel_map(lambda group: min(group[0].gain, gain_at_start(group[0])), ranked)
    least = THRESHOLDS.shortlist_share * max((known_gain, *confirmed))
    listed: list[ScoreTest] = []
    for group in ranked:
        if group[0].gain < least:
            continue
        # The first few forms with enough predicted gain, and any simpler form with some.
        few, rest = group[: THRESHOLDS.shortlisted_forms], group[THRESHOLDS.shortlisted_forms :]
        enough = THRESHOLDS.shortlist_share * group[0].gain
        own = [one for one in few if (one.gain >= enough and is_enough(one)) or _is_simpler(one, group[:1])]
        listed += [*own, *(one for one in rest if _is_simpler(one, own or group[:1]))]
    return listed


def _is_simpler(test: ScoreTest, others: Sequence[ScoreTest]) -> bool:
    return test.gain > 0.0 and len(test.effect.parameters) < min(len(one.effect.parameters) for one in others)


def first_of_each(tests: Sequence[ScoreTest]) -> list[ScoreTest]:
    """The form with the largest predicted gain of each effect, and its first form with the fewest parameters."""
    first: list[ScoreTest] = []
    for forms in group_by_cause(tests):
        simplest = min(forms, key=lambda one: len(one.effect.parameters))
        first += forms[:1] if simplest is forms[0] else [forms[0], simplest]
    return first


def further_forms(
    tests: Sequence[ScoreTest], others: Sequence[ScoreTest], leading: Sequence[FitResult]
) -> list[ScoreTest]:
    """The ``others`` of the causes of ``leading`` fits whose predicted gain is near that of the best listed form."""
    listed, ids = {one.effect.key for one in tests}, {fitted.effects[-1].id for fitted in leading}
    least = {forms[0].effect.id: THRESHOLDS.further_forms_share * forms[0].gain for forms in group_by_cause(tests)}
    further = (one for one in others if one.effect.id in ids and one.effect.key not in listed)
    return [one for one in further if one.gain >= least[one.effect.id] > 0.0]


def extended(current: FitResult, test: ScoreTest) -> NegativeLogLikelihood:
    """The objective of ``current`` with the tested form."""
    return current.objective.with_effects((*current.effects, test.effect))
