"""What the forms of causes promise, by slopes alone."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.diagnose.score_test import screen
from rovid.effects import Effect, effect_named
from rovid.estimate.fisher_information import Innovations, Jacobian, jacobian_chunks, total_negative_log_likelihood
from rovid.estimate.fit_result import FitResult


@dataclass(frozen=True)
class RunningAway:
    """Stands for a misfit whose last coordinate explains the innovations, and that nothing bears below zero."""

    effects: tuple[Effect, ...] = ()

    @property
    def coordinates(self) -> RunningAway:
        return self

    def like(self, effects: tuple[Effect, ...]) -> RunningAway:
        return RunningAway(effects)

    def starts(self) -> list[FloatArray]:
        return self.effects[-1].initial_values

    def innovations(self, x: FloatArray) -> Innovations:
        pattern = np.sin(np.arange(200.0))
        error = 3.0 * pattern * (1.0 - x[-1]) if x[-1] >= 0.0 else np.full(200, np.nan)
        return Innovations(error, np.ones(200) if x[-1] >= 0.0 else np.full(200, np.inf))

    spare, count = 0, 200.0

    @property
    def portions(self) -> list[RunningAway]:
        return [self]

    @property
    def abreast(self) -> int:
        return 0

    @staticmethod
    def of_each(pairs: Sequence[tuple[RunningAway, FloatArray]]) -> list[Innovations]:
        return [misfit.innovations(x) for misfit, x in pairs]

    def cost_of(self, here: Innovations) -> float:
        return total_negative_log_likelihood(here, 1.0)

    def looked(self, x: FloatArray) -> tuple[Innovations, list[Innovations]]:
        return self.innovations(x), []

    def slopes(self, x: FloatArray, known: tuple[Innovations, list[Innovations]]) -> Iterator[Jacobian]:
        here, _ = known
        return self.slopes_between(here, [here], np.ones(len(x)))

    def slopes_between(self, centre: Innovations, sides: Sequence[Innovations], step: FloatArray) -> Iterator[Jacobian]:
        return jacobian_chunks(centre, sides, step, 1.0)


def test_a_start_that_runs_away_keeps_no_other_start_of_its_form_out() -> None:
    form = effect_named("drag_curvature")
    assert {np.sign(start[0]) for start in form.initial_values} == {-1.0, 1.0}
    misfit: Any = RunningAway()  # stands in for a Misfit
    (promise,) = screen(FitResult(misfit, np.zeros(1), 0.0), [form])
    # All of half the sum of squares is there to be gained.
    assert promise.gain == pytest.approx(0.5 * 9.0 * 100.0, rel=0.02)
    assert promise.start[0] > 0.0


@dataclass(frozen=True)
class Noise(RunningAway):
    """Stands for a misfit of which each start of an effect changes the innovations, as noise does, by nothing true."""

    effects: tuple[Effect, ...] = ()

    def like(self, effects: tuple[Effect, ...]) -> Noise:
        return Noise(effects)

    def innovations(self, x: FloatArray) -> Innovations:
        error = np.random.default_rng(0).normal(size=200)
        aside = np.random.default_rng(int(1e6 * x[-2])).normal(size=200) if len(x) > 1 else 0.0
        return Innovations(error + 0.1 * aside, np.ones(200))

    @staticmethod
    def of_each(pairs: Sequence[tuple[RunningAway, FloatArray]]) -> list[Innovations]:
        return [misfit.innovations(x) for misfit, x in pairs]


def test_many_starts_promise_nothing_together_that_noise_does() -> None:
    form = effect_named("tank_seiche")
    assert len(form.initial_values) == 36
    misfit: Any = Noise()  # stands in for a Misfit
    (promise,) = screen(FitResult(misfit, np.zeros(1), 0.0), [form])
    # Together 36 directions take 18 from noise, as chi squared has it; the best of them alone a few.
    assert 0.0 < promise.gain < 8.0
