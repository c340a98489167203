"""Which forms of which causes are worth a fit, by what they promise and what they keep of it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from rovid.diagnose.screening import Promise, screen, shortlist
from rovid.effects import Effect, effect_named
from rovid.ground.arrays import FloatArray
from rovid.identify.fitted import Fitted
from rovid.identify.scoring import Innovations, Slopes, slopes_between, total_cost


@dataclass(frozen=True)
class Keeping:
    """Stands for a misfit of which each effect gains what it ``keeps``, wherever its fit would start."""

    keeps: Mapping[str, float]
    count: float
    effects: tuple[Effect, ...] = ()

    def like(self, effects: tuple[Effect, ...]) -> Keeping:
        return replace(self, effects=effects)

    def costs_of(self, points: Sequence[FloatArray]) -> list[float]:
        count = 1 + sum(len(effect.parameters) for effect in self.effects)
        assert all(len(x) == count for x in points)
        return [1000.0 - sum(self.keeps[effect.key] for effect in self.effects)] * len(points)


def listed(
    promised: Mapping[str, float],
    keeps: Mapping[str, float] | None = None,
    *,
    threshold: float = 0.0,
    price: float = 0.0,
    share: float = 1.0,
) -> list[str]:
    """Keys of what is fitted; everything is kept that is promised, but for ``keeps``. A parameter has its ``price``."""
    promises = [
        Promise(effect, gain, effect.starts[0], effect.starts[0], 1.0)
        for effect, gain in ((effect_named(key), gain) for key, gain in promised.items())
    ]
    misfit: Any = Keeping({**promised, **(keeps or {})}, count=math.exp(2.0 * price))  # stands in for a Misfit
    current = Fitted(misfit, np.zeros(1), 1000.0)
    return [promise.effect.key for promise in shortlist(current, promises, threshold, share)]


def test_the_best_comes_first_and_what_promises_a_tenth_of_it_comes_too() -> None:
    assert listed({"bias_torque": 11.0, "thruster_lag": 100.0, "tether_torsion": 9.0}) == [
        "thruster_lag",
        "bias_torque",
    ]


@pytest.mark.parametrize(("kept", "others"), [(57_000.0, []), (8_000.0, ["thruster_lag"])])
def test_a_promise_that_is_not_kept_keeps_no_other_cause_out(kept: float, others: list[str]) -> None:
    found = listed({"command_delay": 57_000.0, "thruster_lag": 3_000.0}, {"command_delay": kept})
    assert found == ["command_delay", *others]


def test_small_promises_are_kept_to_the_letter() -> None:
    assert listed({"bias_torque": 3.0, "thruster_lag": 5.0}, threshold=4.0) == ["thruster_lag"]
    assert listed({"bias_torque": 3.0}, threshold=4.0) == []


def test_who_promises_too_little_for_the_price_of_its_parameters_is_not_fitted() -> None:
    # A bias has one parameter, a dependence on the heading two.
    promised = {"bias_torque": 10.0, "heading_dependent_torque": 10.0}
    assert listed(promised, threshold=4.0, price=4.0) == ["bias_torque"]
    assert listed(promised, threshold=4.0, price=4.0, share=0.5) == [*promised]


def test_a_simpler_form_is_fitted_though_it_promises_little() -> None:
    # A lag with load has two parameters, a drift with time has one.
    promised = {"supply_sag": 100.0, "supply_sag:drift": 2.0}
    assert listed(promised) == ["supply_sag", "supply_sag:drift"]
    assert listed({"supply_sag:drift": 100.0, "supply_sag": 2.0}) == ["supply_sag:drift"]


def test_the_simplest_form_is_fitted_behind_however_many_others() -> None:
    others = ["tether_torsion:wound", "tether_torsion:rest", "tether_torsion:stiffening"]
    promised = {key: 100.0 - place for place, key in enumerate(others)}
    assert listed({**promised, "tether_torsion": 90.0}) == [*others, "tether_torsion"]
    assert listed({**promised, "tether_torsion": 0.0}) == others


def test_no_more_than_seven_causes_are_fitted() -> None:
    causes = ["bias_torque", "thruster_lag", "tether_torsion", "command_delay", "drag_curvature", "slew_limit"]
    causes += ["thruster_deadband", "thrust_asymmetry", "drag_asymmetry"]
    assert listed(dict.fromkeys(causes, 10.0)) == causes[:7]


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
        return self.effects[-1].starts

    def innovations(self, x: FloatArray) -> Innovations:
        pattern = np.sin(np.arange(200.0))
        error = 3.0 * pattern * (1.0 - x[-1]) if x[-1] >= 0.0 else np.full(200, np.nan)
        return Innovations(error, np.ones(200) if x[-1] >= 0.0 else np.full(200, np.inf))

    spare = 0

    @property
    def abreast(self) -> int:
        return 0

    @staticmethod
    def of_each(pairs: Sequence[tuple[RunningAway, FloatArray]]) -> list[Innovations]:
        return [misfit.innovations(x) for misfit, x in pairs]

    def cost_of(self, here: Innovations) -> float:
        return total_cost(here, 1.0)

    def looked(self, x: FloatArray) -> tuple[Innovations, list[Innovations]]:
        return self.innovations(x), []

    def slopes(self, x: FloatArray, known: tuple[Innovations, list[Innovations]]) -> Iterator[Slopes]:
        here, _ = known
        return self.slopes_between(here, [here], np.ones(len(x)))

    def slopes_between(self, centre: Innovations, sides: Sequence[Innovations], step: FloatArray) -> Iterator[Slopes]:
        return slopes_between(centre, sides, step, 1.0)


def test_a_start_that_runs_away_keeps_no_other_start_of_its_form_out() -> None:
    form = effect_named("drag_curvature")
    assert {np.sign(start[0]) for start in form.starts} == {-1.0, 1.0}
    misfit: Any = RunningAway()  # stands in for a Misfit
    (promise,) = screen(Fitted(misfit, np.zeros(1), 0.0), [form])
    # All of half the sum of squares is there to be gained.
    assert promise.gain == pytest.approx(0.5 * 9.0 * 100.0, rel=0.02)
    assert promise.start[0] > 0.0
