"""Which forms may do what an effect does, by the slopes at a model that has it."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.diagnose.candidate_fits import PROMISE
from rovid.diagnose.score_test import screen
from rovid.diagnose.stepwise import Search
from rovid.diagnose.substitutes import may_replace
from rovid.effects import effect_named
from rovid.estimate.fit_result import Fitted, climbed
from rovid.estimate.innovation_likelihood import InnovationMisfit
from tests.diagnose.test_strategies import LAG, readings

LATE = ("command_delay", "thruster_lag:spin", "slew_limit")
OTHERS = ("bias_torque", "drag_curvature", "tether_torsion", "drag_asymmetry")


def with_more(fitted: Fitted, *start: float) -> FloatArray:
    return np.array([*fitted.x, *start])


@pytest.fixture(scope="module")
def late() -> Fitted:
    plain = InnovationMisfit(readings(1.5), 0.05)
    return climbed(plain.like((LAG,)), with_more(climbed(plain, plain.coordinates.first()), 1.0))


def test_what_comes_late_may_stand_for_a_lag_and_what_does_not_may_not(late: Fitted) -> None:
    promises = screen(late, [effect_named(key) for key in (*LATE, *OTHERS)])
    found = {form.key for form in may_replace(late, LAG, promises)}
    assert {"command_delay", "thruster_lag:spin"} <= found
    assert not found & {*OTHERS}


def test_where_nothing_is_no_size_every_form_may(late: Fitted) -> None:
    limit = effect_named("slew_limit")
    assert limit.parameters[0].endless
    limited = late.misfit.like((LAG, limit))
    current = Fitted.at(limited, with_more(late, *limit.starts[0]))
    promises = screen(current, [effect_named(key) for key in OTHERS])
    assert len(may_replace(current, limit, promises)) == len(OTHERS)


def test_in_the_place_of_a_cause_those_are_tried_that_may_do_as_much(late: Fitted) -> None:
    candidates = [LAG, *(effect_named(key) for key in (*LATE, *OTHERS))]
    search = Search(candidates)
    search.known.fits[late.key] = late
    rest = search.without(late, LAG)
    assert rest.cost - late.cost > search.threshold / PROMISE
    cause = search.cause(late, LAG)
    assert rest.key not in search.known.promises
    whole = Search(candidates)
    every = [rival for rival in whole.candidates_beside(whole.without(late, LAG)) if rival.effect.id != LAG.id]
    assert cause.rivals[0].effect.id == every[0].effect.id == "command_delay"
    # One that is out of reach is not followed to its end.
    assert every[0].worth - 50.0 < cause.rivals[0].worth <= every[0].worth + 0.1 < cause.worth


def test_what_gains_so_little_that_chance_does_is_compared_with_every_form(late: Fitted) -> None:
    bias = effect_named("bias_torque")
    misfit = late.misfit.like((LAG, bias))
    idle = climbed(misfit, with_more(late, *bias.starts[0]))
    search = Search([LAG, bias, *(effect_named(key) for key in OTHERS)])
    search.known.fits.update({late.key: late, idle.key: idle})
    search.cause(idle, bias)
    assert {promise.effect.id for promise in search.known.promises[late.key]} == {*OTHERS}
