"""The shortlist: which forms deserve a fit, by their score tests."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from rovid.core.spmd import parallel_map
from rovid.diagnose.score_test import ScoreTest, bic_penalty
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.estimate.fit_result import FitResult
from rovid.estimate.objective import NegativeLogLikelihood


def group_by_cause(tests: Sequence[ScoreTest]) -> list[list[ScoreTest]]:
    """Score tests of the forms of each effect, the largest predicted gain first in both lists."""
    groups: dict[str, list[ScoreTest]] = {}
    for test in sorted(tests, key=lambda test: -test.gain):
        groups.setdefault(test.effect.id, []).append(test)
    return list(groups.values())


def gains_by_cause(tests: Sequence[ScoreTest]) -> list[float]:
    """Predicted gain of the best form of each effect, largest first."""
    return [forms[0].gain for forms in group_by_cause(tests)]


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

    Parameters
    ----------
    threshold, share
        A form needs a predicted gain of ``share`` times the sum of its BIC penalty and the ``threshold``.
    known_gain
        Largest gain of a model that has been fitted already.
    """
    penalty = bic_penalty(current.objective)

    def is_enough(test: ScoreTest) -> bool:
        return test.gain >= share * (threshold + penalty * test.penalised_parameters)

    def gain_at_start(test: ScoreTest) -> float:
        begins = [np.concatenate((current.x, start)) for start in (test.start, test.best_start)]
        return current.value - min(extended(current, test).values(begins))

    ranked = [group for group in group_by_cause(tests)[: THRESHOLDS.shortlisted_causes] if any(map(is_enough, group))]
    confirmed = parallel_map(lambda group: min(group[0].gain, gain_at_start(group[0])), ranked)
    least = THRESHOLDS.shortlist_share * max((known_gain, *confirmed))
    listed: list[ScoreTest] = []
    for group in ranked:
        if group[0].gain >= least:
            listed += _shortlisted_forms(group, is_enough)
    return listed


def _shortlisted_forms(group: Sequence[ScoreTest], is_enough: Callable[[ScoreTest], bool]) -> list[ScoreTest]:
    """The first few forms with enough predicted gain, and any simpler form with some."""
    first, few, rest = group[:1], group[: THRESHOLDS.shortlisted_forms], group[THRESHOLDS.shortlisted_forms :]
    least = THRESHOLDS.shortlist_share * first[0].gain
    listed = [one for one in few if (one.gain >= least and is_enough(one)) or _is_simpler(one, first)]
    return [*listed, *(one for one in rest if _is_simpler(one, listed))]


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
    listed = {one.effect.key for one in tests}
    ids = {fitted.effects[-1].id for fitted in leading}
    least = {forms[0].effect.id: THRESHOLDS.further_forms_share * forms[0].gain for forms in group_by_cause(tests)}
    return [
        one
        for one in others
        if one.effect.id in ids and one.effect.key not in listed and one.gain >= least[one.effect.id] > 0.0
    ]


def extended(current: FitResult, test: ScoreTest) -> NegativeLogLikelihood:
    """The objective of ``current`` with the tested form."""
    return current.objective.with_effects((*current.effects, test.effect))
