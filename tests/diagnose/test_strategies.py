"""Searching by predictions until each next reading explains all, and by those from there on."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.diagnose.splitting import cv_pieces
from rovid.diagnose.strategies import ByInnovations, by_horizons, few_of, looked_first
from rovid.diagnose.wave_test import WaveTest
from rovid.effects import Effect, effect_named
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fit_result import FitResult
from rovid.estimate.output_error import fit_output_error
from tests import synthetic
from tests.predictions import NOISE, TIME, TORQUE

LAG, WAVES = effect_named("thruster_lag"), effect_named("wave_torque")
CANDIDATES = [LAG, effect_named("drag_curvature"), effect_named("thrust_asymmetry")]
LONG, PERIOD = 1500, 0.2


def late(torque: FloatArray, lag: float) -> FloatArray:
    """Mean until the next instant of a held torque that comes through a first-order lag, settled at the start."""
    if not lag:
        return torque
    fade, state, means = math.exp(-PERIOD / lag), float(torque[0]), []
    for wanted in torque.tolist():
        means.append(wanted + (state - wanted) * (1.0 - fade) * lag / PERIOD)
        state = wanted + (state - wanted) * fade
    return np.array(means)


def readings(lag: float, unknown: float = 0.0) -> InnovationData:
    """Of four runs whose torque comes so many s late, in water that is never quite still.

    An ``unknown`` torque in N m besides turns its sign every minute.
    """
    rng = np.random.default_rng(1)
    runs = []
    for first in range(0, 4 * LONG, LONG):
        rows = slice(first, first + LONG)
        water = synthetic.gauss_markov(LONG, PERIOD, 2.0, 4.0, rng)
        off = late(TORQUE[rows], lag) - TORQUE[rows] + water + unknown * (-1.0) ** (TIME[:LONG] // 60.0)
        runs.append(synthetic.run(TIME[:LONG], TORQUE[rows], disturbance=off, noise=NOISE[rows]))
    return InnovationData(runs, synthetic.LOGGED, fit_output_error(runs, min_sigmas=0.0))


def unsaid(_: str) -> None:
    pass


def no_waves(few: InnovationData) -> Callable[[FitResult], WaveTest]:
    return lambda beside: WaveTest(few, beside, ())


@pytest.mark.parametrize(("lag", "found"), [(0.0, ()), (1.5, (LAG,))])
def test_what_each_next_reading_explains_is_found_at_once(lag: float, found: tuple[Effect, ...]) -> None:
    full = readings(lag)
    work = ByInnovations(full, few_of(full), CANDIDATES, unsaid).at_once(no_waves(full))
    assert work is not None
    assert work.explains
    assert work.final.effects == found
    assert not work.by_horizons
    # It is known what else there may be.
    assert work.final.key in work.search.known.promises


def test_the_search_goes_on_beside_waves_that_are_seen_beside_what_was_found_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    full, said = readings(1.5), list[str]()

    def look(beside: FitResult) -> WaveTest:
        assert beside.effects == (LAG,)
        misfit = beside.objective.with_effects((*beside.effects, WAVES))
        begins = [np.concatenate((beside.x, start)) for start in misfit.parametrization.initial_values()]
        return WaveTest(full, beside, (), FitResult.at(misfit, misfit.most_likely(begins, 1)[0]))

    monkeypatch.setattr(WaveTest, "established", property(lambda waves: waves.fitted))
    work = ByInnovations(full, few_of(full), CANDIDATES, said.append).at_once(look)
    assert said.count("Looking at each next reading …") == 2
    assert work is not None
    # There are none: the search that goes on beside them leaves them out.
    assert work.final.effects == (LAG,)


def test_nothing_is_found_at_once_where_no_cause_gains_much_of_what_is_missing() -> None:
    full = readings(1.5, unknown=60.0)
    looked_beside = list[FitResult]()

    def look(beside: FitResult) -> WaveTest:
        looked_beside.append(beside)
        return WaveTest(full, beside, ())

    assert ByInnovations(full, few_of(full), CANDIDATES, unsaid).at_once(look) is None
    assert not looked_beside


def test_nothing_is_looked_for_at_once_where_the_simulation_is_far_off() -> None:
    full = readings(50.0)
    said = list[str]()
    near = ByInnovations(full, few_of(full), CANDIDATES, said.append)
    assert near.at_once(no_waves(full)) is None
    assert said == []


@pytest.mark.parametrize(("lag", "found"), [(0.0, ()), (1.5, (LAG,))])
def test_predictions_are_asked_until_each_next_reading_explains_all(lag: float, found: tuple[Effect, ...]) -> None:
    full = readings(lag)
    near, pieces = ByInnovations(full, few_of(full), CANDIDATES, unsaid), cv_pieces(full.runs, synthetic.LOGGED, 1.0)
    works = by_horizons(full, pieces, CANDIDATES, unsaid, near.explains)
    early = next(works)
    assert early.final.effects == found
    assert early.final.key not in early.search.known.promises
    assert near.explains(early.final)
    assert near.explains(early.base) is not bool(found)
    work = near.search(early)
    assert work is not None
    assert work.explains
    assert work.final.effects == found
    # Whatever was refused of it, the search to the end knows nothing of that.
    for effect in CANDIDATES:
        early.search.ban(effect)
    early.final = early.base
    (whole,) = works
    (alone,) = by_horizons(full, pieces, CANDIDATES, unsaid, lambda _: False)
    assert whole.final.effects == alone.final.effects == found
    assert whole.final.x == pytest.approx(alone.final.x, abs=0.0)
    assert whole.final.key in whole.search.known.promises


def test_what_is_never_enough_is_searched_to_the_end() -> None:
    full = readings(1.5)
    pieces = cv_pieces(full.runs, synthetic.LOGGED, 1.0)
    (work,) = by_horizons(full, pieces, CANDIDATES, unsaid, lambda _: False)
    assert work.final.effects == (LAG,)
    assert work.final.key in work.search.known.promises
    # Whoever refuses some of it and searches on is not told that the rest is enough.
    assert work.search.is_enough is None


@pytest.mark.parametrize(("seconds", "are_few"), [(PERIOD, False), (3.0 * PERIOD, False), (6.0 * PERIOD, True)])
def test_few_are_looked_at_first_where_they_are_many_times_fewer(seconds: float, *, are_few: bool) -> None:
    quick = readings(0.0)
    few = replace(quick, interval=seconds)
    # However near the readings of the quick look are to each other: all of them have no interval.
    assert quick.interval == 0.0
    assert looked_first(few, quick) is (few if are_few else quick)
