"""Which of the promises are worth a fit, and what is kept of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from rovid.core.spmd import parallel_map
from rovid.diagnose.bic import (
    ITERATIONS,
    bic_penalty,
    bic_score,
    cost_at_score,
    fit_coarse,
    fit_in_parallel,
    refine_fit,
)
from rovid.diagnose.score_test import ScoreTest, sized
from rovid.estimate.fit_result import FitResult
from rovid.estimate.objective import NegativeLogLikelihood

# Of the best candidate's promise, as far as its fit begins by keeping it: who promises less is not fitted.
PROMISE = 0.1
_FITTED = 7
_FORMS_FITTED = 3
# Sizes to begin with, as shares of what the slopes ask for: where they mislead, that may be far too much.
_SHARES = (1.0, 0.3, 0.1)
_FIRST_ITERATIONS = 4
# Then those go on, for so many steps, that have this share of the best one's worth.
_STAGES = ((0.2, 8), (0.4, ITERATIONS))
# Rivals that come nearer than that to the best, in log-likelihood, are told from it by what they are worth to the end.
_CLOSE = 50.0


def group_by_cause(promises: Sequence[ScoreTest]) -> list[list[ScoreTest]]:
    """The forms of each cause, best first in both."""
    groups: dict[str, list[ScoreTest]] = {}
    for promise in sorted(promises, key=lambda promise: -promise.gain):
        groups.setdefault(promise.effect.id, []).append(promise)
    return list(groups.values())


def gains_by_cause(promises: Sequence[ScoreTest]) -> list[float]:
    """What the best form of each cause promises, the most first."""
    return [forms[0].gain for forms in group_by_cause(promises)]


def best_forms(promises: Sequence[ScoreTest]) -> list[ScoreTest]:
    """The most promising form of every cause that shows at all, and more forms of those that show most."""
    listed: list[ScoreTest] = []
    for place, group in enumerate(group_by_cause(promises)):
        count = _FORMS_FITTED if place < _FITTED else 1
        listed += [promise for promise in group[:count] if promise.gain > 0.0]
    return listed


def shortlist(
    current: FitResult, promises: Sequence[ScoreTest], threshold: float, share: float, gained: float = 0.0
) -> list[ScoreTest]:
    """The forms worth fitting: of the causes that promise most, the best forms of each, and simpler ones.

    None promises less than a ``share`` of what it has to gain: its parameters' price and the ``threshold``. Slopes
    promise too much of some forms, and one with fewer parameters may gain as much. So much is ``gained`` by one that
    is known already.
    """
    each = bic_penalty(current.objective)

    def is_enough(promise: ScoreTest) -> bool:
        return promise.gain >= share * (threshold + each * promise.penalised_parameters)

    ranked = [group for group in group_by_cause(promises)[:_FITTED] if any(map(is_enough, group))]
    kept = parallel_map(lambda group: min(group[0].gain, _outright(current, group[0])), ranked)
    top = max((gained, *kept))
    listed: list[ScoreTest] = []
    for group in ranked:
        if group[0].gain >= PROMISE * top:
            listed += _worth_a_fit(group, is_enough)
    return listed


def _worth_a_fit(group: Sequence[ScoreTest], is_enough: Callable[[ScoreTest], bool]) -> list[ScoreTest]:
    """Of the forms of a cause, best first: the first few that promise enough, and simpler ones that promise at all."""
    first, few, rest = group[:1], group[:_FORMS_FITTED], group[_FORMS_FITTED:]
    least = PROMISE * first[0].gain
    listed = [one for one in few if (one.gain >= least and is_enough(one)) or _is_simpler(one, first)]
    return [*listed, *(one for one in rest if _is_simpler(one, listed))]


def _is_simpler(promise: ScoreTest, others: Sequence[ScoreTest]) -> bool:
    """Whether a form promises anything with fewer parameters than any of the ``others``."""
    return promise.gain > 0.0 and len(promise.effect.parameters) < min(len(one.effect.parameters) for one in others)


def _outright(current: FitResult, promise: ScoreTest) -> float:
    """What a form gains where its fit would start, before any."""
    misfit = _with_promised(current, promise)
    begins = [np.concatenate((current.x, start)) for start in (promise.start, promise.best_start)]
    return current.value - min(misfit.values(begins))


def fit_candidates(
    current: FitResult, promises: Sequence[ScoreTest], leads: Callable[[FitResult], bool], ends: Mapping[str, FitResult]
) -> tuple[list[FitResult], list[FitResult]]:
    """Each promise kept: fitted together with all else; and those that fell behind, left where they were.

    None is followed that cannot catch up with the worthiest of those that may lead, as ``leads`` has it. Of a cause
    whose first forms fell behind no others are fitted that promise no more than that. ``ends`` are, by the key of what
    they add, models that were followed to their end: these are not fitted again.
    """

    def gain(fit: FitResult) -> float:
        return bic_score(fit) - bic_score(current)

    def least(share: float, fits: Sequence[FitResult]) -> float:
        return max(share * max(map(gain, fits), default=0.0), 0.0)

    def goals(misfits: Sequence[NegativeLogLikelihood], fits: Sequence[FitResult]) -> list[float]:
        close = max(map(bic_score, filter(leads, fits)), default=-math.inf) - _CLOSE
        return [cost_at_score(close, misfit) for misfit in misfits]

    def begun(few: Sequence[ScoreTest]) -> list[FitResult]:
        misfits = [_with_promised(current, one) for one in few]
        costs = goals(misfits, ended)
        return fit_in_parallel(misfits, lambda at: _begun(current, misfits[at], few[at], costs[at]))

    def followed(fits: Sequence[FitResult], iterations: int) -> list[FitResult]:
        misfits = [fit.objective for fit in fits]
        costs = goals(misfits, fits)
        return fit_in_parallel(misfits, lambda at: refine_fit(fits[at], iterations, costs[at]))

    ended = [ends[one.effect.key] for one in promises if one.effect.key in ends]
    left = [one for one in promises if one.effect.key not in ends]
    first = _first_of_each(left)
    ahead, behind = [*ended, *begun(first)], list[FitResult]()
    limit = least(_STAGES[0][0], ahead)
    in_front = {fit.effects[-1].id for fit in ahead if gain(fit) >= limit}
    more = [one for one in left if one.effect.id in in_front or one.gain >= limit]
    ahead += begun([one for one in more if one not in first])
    for share, iterations in _STAGES:
        limit = least(share, ahead)
        behind += [fit for fit in ahead if gain(fit) < limit]
        ahead = followed([fit for fit in ahead if gain(fit) >= limit], iterations)
    return ahead, behind


def _first_of_each(promises: Sequence[ScoreTest]) -> list[ScoreTest]:
    """Of each cause the most promising form, and the first of the plainest."""
    first: list[ScoreTest] = []
    for forms in group_by_cause(promises):
        plainest = min(forms, key=lambda one: len(one.effect.parameters))
        first += forms[:1] if plainest is forms[0] else [forms[0], plainest]
    return first


def _with_promised(current: FitResult, promise: ScoreTest) -> NegativeLogLikelihood:
    return current.objective.with_effects((*current.effects, promise.effect))


def _begun(current: FitResult, misfit: NegativeLogLikelihood, promise: ScoreTest, goal: float) -> FitResult:
    """``current`` with what is promised, after the first steps from the nearest of several sizes.

    Fewer if the ``goal`` is out of reach.
    """
    scaled = [sized(promise.effect, promise.start, share) for share in _SHARES]
    begins = [np.concatenate((current.x, start)) for start in (promise.best_start, *scaled)]
    (nearest,) = misfit.most_likely(begins, 1)
    return fit_coarse(misfit, nearest, _FIRST_ITERATIONS, goal)
