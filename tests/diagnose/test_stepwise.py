"""When a search for causes ends, and how another goes on from there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rovid.diagnose.bic import plainest, worth
from rovid.diagnose.stepwise import Search
from rovid.effects import effect_named
from rovid.estimate.fit_result import Fitted, climbed
from rovid.estimate.multi_step_likelihood import HorizonMisfit
from tests.predictions import BIAS, biased

CANDIDATES = [BIAS, effect_named("drag_curvature"), effect_named("thrust_asymmetry")]


@pytest.fixture(scope="module")
def base() -> Fitted:
    plain = HorizonMisfit(biased())
    return climbed(plain, plain.coordinates.first())


def test_it_ends_with_enough_and_another_goes_on_from_there(base: Fitted) -> None:
    search = Search(CANDIDATES, is_enough=lambda found: bool(found.effects))
    early = search.run(base)
    assert search.has_enough
    assert early.effects == (BIAS,)
    # What else there may be beside it was not looked for.
    assert early.key not in search.known.promises
    further = Search(CANDIDATES)
    later, whole = further.run(early), Search(CANDIDATES).run(base)
    assert early.key in further.known.promises
    assert later.effects == whole.effects == (BIAS,)
    assert later.x == pytest.approx(whole.x, rel=1e-6)


def test_where_nothing_is_missing_nothing_is_looked_at(base: Fitted) -> None:
    search = Search(CANDIDATES, is_enough=lambda _: True)
    assert search.run(base) is base
    assert search.known.promises == {}


def test_a_model_that_is_far_off_is_never_enough(base: Fitted) -> None:
    search = Search(CANDIDATES, is_enough=lambda _: True, thorough=lambda found: not found.effects)
    assert search.run(base).effects == (BIAS,)


def test_what_is_never_enough_changes_nothing(base: Fitted) -> None:
    asked: list[tuple[str, ...]] = []

    def enough(found: Fitted) -> bool:
        asked.append(tuple(effect.id for effect in found.effects))
        return False

    found, plain = Search(CANDIDATES, is_enough=enough).run(base), Search(CANDIDATES).run(base)
    assert found.effects == plain.effects == (BIAS,)
    assert np.array_equal(found.x, plain.x)
    assert {*asked} == {(), ("bias_torque",)}


def with_form(current: Fitted, key: str, gains: float) -> Fitted:
    """``current`` with one form more, which is worth so much."""
    effect = effect_named(key)
    misfit = current.misfit.like((*current.effects, effect))
    fitted = Fitted(misfit, np.concatenate((current.x, effect.starts[0])), 0.0)
    return replace(fitted, cost=worth(fitted) - worth(current) - gains)


def test_a_plain_form_is_taken_up_that_gains_nearly_as_much_as_long_as_another_cause_is_missing(base: Fitted) -> None:
    smooth, scattered = with_form(base, "command_delay", 97.0), with_form(base, "command_delay:scattered", 100.0)
    other = with_form(base, "thruster_lag", 98.0)
    assert worth(scattered) - worth(base) == pytest.approx(100.0)
    assert not scattered.is_white
    assert plainest(scattered, [other, smooth, scattered], base) is smooth
    assert plainest(scattered, [other, with_form(base, "command_delay", 95.0), scattered], base) is scattered
    assert plainest(smooth, [other, smooth, scattered], base) is smooth


def test_where_no_cause_is_missing_the_form_that_gains_most_is_taken_up(
    base: Fitted, monkeypatch: pytest.MonkeyPatch
) -> None:
    smooth, scattered = with_form(base, "command_delay", 97.0), with_form(base, "command_delay:scattered", 100.0)
    monkeypatch.setattr(Fitted, "is_white", True)
    assert plainest(scattered, [smooth, scattered], base) is scattered
