"""Which forms may do what an effect does, by the slopes at a model that has it."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.diagnose.candidate_fits import PROMISE
from rovid.diagnose.score_test import screen
from rovid.diagnose.stepwise import StepwiseSearch
from rovid.diagnose.substitutes import possible_substitutes
from rovid.effects import effect_named
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from tests.diagnose.test_strategies import LAG, readings

LATE = ("command_delay", "thruster_lag:spin", "slew_limit")
OTHERS = ("bias_torque", "drag_curvature", "tether_torsion", "drag_asymmetry")


def with_more(fitted: FitResult, *start: float) -> FloatArray:
    return np.array([*fitted.x, *start])


@pytest.fixture(scope="module")
def late() -> FitResult:
    plain = InnovationLikelihood(readings(1.5), 0.05)
    return fit(plain.with_effects((LAG,)), with_more(fit(plain, plain.parametrization.initial()), 1.0))


def test_what_comes_late_may_stand_for_a_lag_and_what_does_not_may_not(late: FitResult) -> None:
    promises = screen(late, [effect_named(key) for key in (*LATE, *OTHERS)])
    found = {form.key for form in possible_substitutes(late, LAG, promises)}
    assert {"command_delay", "thruster_lag:spin"} <= found
    assert not found & {*OTHERS}


def test_where_nothing_is_no_size_every_form_may(late: FitResult) -> None:
    limit = effect_named("slew_limit")
    assert limit.parameters[0].neutral_at_infinity
    limited = late.objective.with_effects((LAG, limit))
    current = FitResult.at(limited, with_more(late, *limit.initial_values[0]))
    promises = screen(current, [effect_named(key) for key in OTHERS])
    assert len(possible_substitutes(current, limit, promises)) == len(OTHERS)


def test_in_the_place_of_a_cause_those_are_tried_that_may_do_as_much(late: FitResult) -> None:
    candidates = [LAG, *(effect_named(key) for key in (*LATE, *OTHERS))]
    search = StepwiseSearch(candidates)
    search.known.fits[late.key] = late
    rest = search.without(late, LAG)
    assert rest.value - late.value > search.threshold / PROMISE
    cause = search.cause(late, LAG)
    assert rest.key not in search.known.promises
    whole = StepwiseSearch(candidates)
    every = [rival for rival in whole.candidates_beside(whole.without(late, LAG)) if rival.effect.id != LAG.id]
    assert cause.alternatives[0].effect.id == every[0].effect.id == "command_delay"
    # One that is out of reach is not followed to its end.
    assert every[0].bic_gain - 50.0 < cause.alternatives[0].bic_gain <= every[0].bic_gain + 0.1 < cause.bic_gain


def test_what_gains_so_little_that_chance_does_is_compared_with_every_form(late: FitResult) -> None:
    bias = effect_named("bias_torque")
    misfit = late.objective.with_effects((LAG, bias))
    idle = fit(misfit, with_more(late, *bias.initial_values[0]))
    search = StepwiseSearch([LAG, bias, *(effect_named(key) for key in OTHERS)])
    search.known.fits.update({late.key: late, idle.key: idle})
    search.cause(idle, bias)
    assert {promise.effect.id for promise in search.known.promises[late.key]} == {*OTHERS}
