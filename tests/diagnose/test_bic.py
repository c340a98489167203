"""Which fits count as causes that there may be."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.diagnose import bic
from rovid.diagnose.bic import is_converged, is_plausible, refine_fit
from rovid.effects import effect_named
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fisher_information import Innovations
from rovid.estimate.fit_result import FitResult
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from tests import synthetic
from tests.predictions import NOISE, TIME, TORQUE

WAVE = effect_named("wave_torque")
FEW = 500
SLOWEST = 2.0 * np.pi / float(np.ptp(TIME[:FEW]))


@pytest.fixture(scope="module")
def misfit() -> InnovationLikelihood:
    runs = [synthetic.run(TIME[:FEW], TORQUE[:FEW], noise=NOISE[:FEW])]
    return InnovationLikelihood(InnovationData(runs, synthetic.LOGGED, synthetic.ROSUB), 0.05, (WAVE,))


@pytest.mark.parametrize(("frequency", "plausible"), [(SLOWEST, False), (1.5 * SLOWEST, True)])
def test_a_wave_without_a_cycle_in_any_run_is_none(
    misfit: InnovationLikelihood, frequency: float, *, plausible: bool
) -> None:
    coordinates = misfit.parametrization
    x = coordinates.initial()
    x[coordinates.effects_begin :] = 0.05, frequency, 0.04
    fitted = FitResult.at(misfit, np.clip(x, coordinates.low, coordinates.high))
    assert is_plausible(fitted) is plausible


def test_a_wave_that_is_no_narrow_band_is_none(misfit: InnovationLikelihood) -> None:
    coordinates = misfit.parametrization
    x = coordinates.initial()
    x[coordinates.effects_begin :] = 0.05, 2.0 * SLOWEST, coordinates.high[-1]
    assert not is_plausible(FitResult.at(misfit, x))


def test_who_cannot_reach_the_goal_is_not_followed(
    misfit: InnovationLikelihood, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked: list[InnovationLikelihood] = []
    look = InnovationLikelihood.evaluate_with_spare

    def looked_at(self: InnovationLikelihood, x: FloatArray) -> tuple[Innovations, list[Innovations]]:
        looked.append(self)
        return look(self, x)

    monkeypatch.setattr(InnovationLikelihood, "looked", looked_at)
    begun = replace(FitResult.at(misfit, misfit.parametrization.initial()), remaining_gain=20.0)
    assert refine_fit(begun, 1, goal=begun.value - 20.5) is begun
    assert not looked
    further = refine_fit(begun, 1, goal=begun.value - 19.5)
    assert further.value < begun.value
    # Without a goal all is followed, until nothing is left to be gained.
    assert is_converged(refine_fit(begun, 60))
    ended = replace(begun, remaining_gain=0.0)
    assert refine_fit(ended, 60) is ended


@pytest.mark.parametrize(("many", "at_once"), [(10**9, True), (1, False)])
def test_fits_of_many_readings_come_one_after_the_other(
    misfit: InnovationLikelihood, monkeypatch: pytest.MonkeyPatch, many: int, *, at_once: bool
) -> None:
    asked: list[bool] = []

    def one_by_one(function: Any, items: Any, *, among_threads: bool) -> list[Any]:
        asked.append(among_threads)
        return [function(item) for item in items]

    monkeypatch.setattr(bic, "_MANY", many)
    monkeypatch.setattr(bic, "shared", one_by_one)
    fitted = FitResult(misfit, misfit.parametrization.initial(), 1.0)
    (found,) = bic.fit_in_parallel([misfit], lambda _: fitted)
    assert found.value == 1.0
    assert asked == [at_once]
