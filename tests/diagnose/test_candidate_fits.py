"""Fits of candidate models: shortlist, stages, plausibility, cache."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.diagnose import candidate_fits
from rovid.diagnose.candidate_fits import (
    FitCache,
    bic_score,
    fit_candidates,
    is_converged,
    is_plausible,
    refine_fit,
    value_at_score,
)
from rovid.diagnose.screening import Directions, ScoreTest, shortlist
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects import Effect, effect_named
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fisher_information import Innovations, NormalEquations
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.estimate.multi_step import MultiStepLikelihood
from rovid.estimate.objective import NegativeLogLikelihood
from tests import synthetic
from tests.predictions import BIAS, NOISE, TIME, TORQUE, biased


@dataclass(frozen=True)
class MadeUpGains:
    """Stand-in for an objective; each effect gains ``gains`` at any start."""

    gains: Mapping[str, float]
    effective_count: float
    effects: tuple[Effect, ...] = ()

    def with_effects(self, effects: tuple[Effect, ...]) -> MadeUpGains:
        return replace(self, effects=effects)

    def values(self, points: Sequence[FloatArray]) -> list[float]:
        count = 1 + sum(len(effect.parameters) for effect in self.effects)
        assert all(len(x) == count for x in points)
        return [1000.0 - sum(self.gains[effect.key] for effect in self.effects)] * len(points)


def predicted_test(key: str, gain: float) -> ScoreTest:
    """Score test with a given predicted gain."""
    effect, none, square = effect_named(key), np.zeros(0), np.zeros((0, 0))
    tried = Directions(np.zeros((0, len(effect.parameters))), none, square, np.zeros((0, 0)), none)
    return ScoreTest(
        effect, gain, effect.initial_values[0], effect.initial_values[0], 1.0, tried, NormalEquations(none, square)
    )


def listed(
    predicted: Mapping[str, float],
    gains: Mapping[str, float] | None = None,
    *,
    threshold: float = 0.0,
    price: float = 0.0,
    share: float = 1.0,
) -> list[str]:
    """Keys of the shortlist; gains at the starts are as predicted, except ``gains``; ``price`` is the BIC penalty."""
    tests = [predicted_test(key, gain) for key, gain in predicted.items()]
    objective: Any = MadeUpGains(
        {**predicted, **(gains or {})}, effective_count=math.exp(2.0 * price)
    )  # stand-in for an objective
    current = FitResult(objective, np.zeros(1), 1000.0)
    return [test.effect.key for test in shortlist(current, tests, threshold, share)]


def test_the_shortlist_has_the_best_cause_and_those_with_a_tenth_of_its_gain() -> None:
    assert listed({"bias_torque": 11.0, "thruster_lag": 100.0, "tether_torsion": 9.0}) == [
        "thruster_lag",
        "bias_torque",
    ]


@pytest.mark.parametrize(("confirmed", "others"), [(57_000.0, []), (8_000.0, ["thruster_lag"])])
def test_a_predicted_gain_that_the_start_does_not_confirm_excludes_no_other_cause(
    confirmed: float, others: list[str]
) -> None:
    found = listed({"command_delay": 57_000.0, "thruster_lag": 3_000.0}, {"command_delay": confirmed})
    assert found == ["command_delay", *others]


def test_a_predicted_gain_below_the_threshold_is_not_fitted() -> None:
    assert listed({"bias_torque": 3.0, "thruster_lag": 5.0}, threshold=4.0) == ["thruster_lag"]
    assert listed({"bias_torque": 3.0}, threshold=4.0) == []


def test_a_predicted_gain_below_the_bic_penalty_is_not_fitted() -> None:
    # A bias has one parameter, a dependence on the heading two.
    predicted = {"bias_torque": 10.0, "heading_dependent_torque": 10.0}
    assert listed(predicted, threshold=4.0, price=4.0) == ["bias_torque"]
    assert listed(predicted, threshold=4.0, price=4.0, share=0.5) == [*predicted]


def test_a_simpler_form_is_fitted_with_a_small_predicted_gain() -> None:
    # A lag with load has two parameters, a drift with time has one.
    predicted = {"supply_sag": 100.0, "supply_sag:drift": 2.0}
    assert listed(predicted) == ["supply_sag", "supply_sag:drift"]
    assert listed({"supply_sag:drift": 100.0, "supply_sag": 2.0}) == ["supply_sag:drift"]


def test_the_simplest_form_is_fitted_after_any_number_of_others() -> None:
    others = ["tether_torsion:wound", "tether_torsion:rest", "tether_torsion:stiffening"]
    predicted = {key: 100.0 - place for place, key in enumerate(others)}
    assert listed({**predicted, "tether_torsion": 90.0}) == [*others, "tether_torsion"]
    assert listed({**predicted, "tether_torsion": 0.0}) == others


def test_a_simple_form_behind_costly_ones_is_fitted() -> None:
    # Three forms with two parameters gain less than these cost; the form with one parameter gains enough.
    predicted = dict.fromkeys(("tether_torsion:stiffening", "tether_torsion:slack", "tether_torsion:rest"), 10.0)
    assert listed({**predicted, "tether_torsion": 9.0}, threshold=4.0, price=4.0) == ["tether_torsion"]


def test_no_more_than_seven_causes_are_fitted() -> None:
    causes = ["bias_torque", "thruster_lag", "tether_torsion", "command_delay", "drag_curvature", "slew_limit"]
    causes += ["thruster_deadband", "thrust_asymmetry", "drag_asymmetry"]
    assert listed(dict.fromkeys(causes, 10.0)) == causes[:7]


def test_a_larger_known_gain_excludes_small_predicted_gains() -> None:
    tests = [predicted_test("bias_torque", 11.0), predicted_test("thruster_lag", 100.0)]
    objective: Any = MadeUpGains(
        {"bias_torque": 11.0, "thruster_lag": 100.0}, effective_count=1.0
    )  # stand-in for an objective
    current = FitResult(objective, np.zeros(1), 1000.0)
    assert len(shortlist(current, tests, 0.0, 1.0)) == 2
    assert [one.effect.id for one in shortlist(current, tests, 0.0, 1.0, known_gain=200.0)] == ["thruster_lag"]


@pytest.fixture(scope="module")
def base() -> FitResult:
    plain = MultiStepLikelihood(biased())
    return fit(plain, plain.parametrization.initial())


@pytest.fixture
def begun(monkeypatch: pytest.MonkeyPatch) -> dict[str, float]:
    """BIC gain of each form; fitted forms are removed from the dictionary."""
    bic_gains: dict[str, float] = {}

    def begin(current: FitResult, objective: NegativeLogLikelihood, predicted: ScoreTest, _: float) -> FitResult:
        x = np.concatenate((current.x, predicted.start))
        return FitResult(
            objective, x, value_at_score(bic_score(current) + bic_gains.pop(predicted.effect.key), objective)
        )

    monkeypatch.setattr(candidate_fits, "_begin", begin)
    monkeypatch.setattr(candidate_fits, "refine_fit", lambda fit, *_: fit)
    return bic_gains


def keys_of(fits: Sequence[FitResult]) -> list[str]:
    return [fit.effects[-1].key for fit in fits]


RING = ("tank_seiche", "tank_seiche:following", "tank_seiche:thrust")


@pytest.mark.parametrize(("predicted", "fitted"), [(90.0, False), (300.0, True)])
def test_further_forms_of_a_poor_cause_need_a_large_predicted_gain(
    base: FitResult, begun: dict[str, float], predicted: float, *, fitted: bool
) -> None:
    begun.update(dict.fromkeys(RING, 5.0) | {"bias_torque": 1000.0})
    tests = [
        predicted_test("bias_torque", 900.0),
        predicted_test(RING[0], 400.0),
        *(predicted_test(key, predicted) for key in RING[1:]),
    ]
    ahead, behind = fit_candidates(base, tests, lambda _: True, {})
    assert keys_of(ahead) == ["bias_torque"]
    assert keys_of(behind) == [*(RING if fitted else RING[:1])]
    assert [*begun] == [*(() if fitted else RING[1:])]


def test_all_forms_of_a_good_cause_are_fitted(base: FitResult, begun: dict[str, float]) -> None:
    begun.update(dict.fromkeys(RING, 5.0) | {"bias_torque": 20.0})
    tests = [predicted_test("bias_torque", 900.0), *(predicted_test(key, 1.0) for key in RING)]
    ahead, behind = fit_candidates(base, tests, lambda _: True, {})
    assert {*keys_of(ahead), *keys_of(behind)} == {"bias_torque", *RING}


def test_the_simplest_form_is_fitted_where_the_first_form_is_poor(base: FitResult, begun: dict[str, float]) -> None:
    begun.update({"command_delay:scattered": -1.0, "command_delay": 700.0, "bias_torque": 1000.0})
    tests = [
        predicted_test("bias_torque", 900.0),
        predicted_test("command_delay:scattered", 50.0),
        predicted_test("command_delay", 1.0),
    ]
    assert len(effect_named("command_delay").parameters) < len(effect_named("command_delay:scattered").parameters)
    ahead, _ = fit_candidates(base, tests, lambda _: True, {})
    assert keys_of(ahead) == ["bias_torque", "command_delay"]


def test_a_converged_model_is_not_fitted_again(base: FitResult, begun: dict[str, float]) -> None:
    begun["bias_torque"] = 10.0
    (known,), _ = fit_candidates(base, [predicted_test("bias_torque", 10.0)], lambda _: True, {})
    begun["thruster_lag"] = 9.0
    tests = [predicted_test("thruster_lag", 9.0), predicted_test("bias_torque", 10.0)]
    ahead, _ = fit_candidates(base, tests, lambda _: True, {"bias_torque": known})
    assert keys_of(ahead) == ["bias_torque", "thruster_lag"]
    assert ahead[0].value == known.value


WAVE = effect_named("wave_torque")
FEW = 500
SLOWEST = 2.0 * np.pi / float(np.ptp(TIME[:FEW]))


@pytest.fixture(scope="module")
def objective() -> InnovationLikelihood:
    runs = [synthetic.run(TIME[:FEW], TORQUE[:FEW], noise=NOISE[:FEW])]
    return InnovationLikelihood(InnovationData(runs, synthetic.LOGGED, synthetic.ROSUB), 0.05, (WAVE,))


@pytest.mark.parametrize(("frequency", "plausible"), [(SLOWEST, False), (1.5 * SLOWEST, True)])
def test_a_wave_with_less_than_one_cycle_is_not_plausible(
    objective: InnovationLikelihood, frequency: float, *, plausible: bool
) -> None:
    coordinates = objective.parametrization
    x = coordinates.initial()
    x[coordinates.effects_begin :] = 0.05, frequency / coordinates.units[1], 0.04
    fitted = FitResult.at(objective, np.clip(x, coordinates.low, coordinates.high))
    assert is_plausible(fitted) is plausible


def test_a_wave_without_a_narrow_band_is_not_plausible(objective: InnovationLikelihood) -> None:
    coordinates = objective.parametrization
    x = coordinates.initial()
    x[coordinates.effects_begin :] = 0.05, 2.0 * SLOWEST / coordinates.units[1], coordinates.high[-1]
    assert not is_plausible(FitResult.at(objective, x))


def test_a_fit_stops_where_the_goal_is_out_of_reach(
    objective: InnovationLikelihood, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked: list[InnovationLikelihood] = []
    look = InnovationLikelihood.evaluate_with_spare

    def looked_at(self: InnovationLikelihood, x: FloatArray) -> tuple[Innovations, list[Innovations]]:
        looked.append(self)
        return look(self, x)

    monkeypatch.setattr(InnovationLikelihood, "evaluate_with_spare", looked_at)
    begun = replace(FitResult.at(objective, objective.parametrization.initial()), remaining_gain=20.0)
    assert refine_fit(begun, 1, goal=begun.value - 20.5) is begun
    assert not looked
    further = refine_fit(begun, 1, goal=begun.value - 19.5)
    assert further.value < begun.value
    # Without a goal, a fit continues to convergence.
    assert is_converged(refine_fit(begun, 60))
    ended = replace(begun, remaining_gain=0.0)
    assert refine_fit(ended, 60) is ended


@pytest.mark.parametrize(("many", "at_once"), [(10**9, True), (1, False)])
def test_large_data_are_fitted_one_model_at_a_time(
    objective: InnovationLikelihood, monkeypatch: pytest.MonkeyPatch, many: int, *, at_once: bool
) -> None:
    asked: list[bool] = []

    def one_by_one(function: Any, items: Any, *, use_threads: bool) -> list[Any]:
        asked.append(use_threads)
        return [function(item) for item in items]

    monkeypatch.setattr(candidate_fits, "THRESHOLDS", replace(THRESHOLDS, parallel_fit_samples=many))
    monkeypatch.setattr(candidate_fits, "parallel_map", one_by_one)
    fitted = FitResult(objective, objective.parametrization.initial(), 1.0)
    (found,) = candidate_fits.fit_in_parallel([objective], lambda _: fitted)
    assert found.value == 1.0
    assert asked == [at_once]


BEND, UNEQUAL = effect_named("drag_curvature"), effect_named("thrust_asymmetry")


def with_effects(base: FitResult, *effects: Effect) -> FitResult:
    """The model with ``effects`` at their initial values, as if converged."""
    x = np.concatenate((base.x, *(effect.initial_values[0] for effect in effects)))
    return replace(FitResult.at(base.objective.with_effects(effects), x), remaining_gain=0.0)


def test_a_model_without_several_effects_is_fitted_once(base: FitResult, monkeypatch: pytest.MonkeyPatch) -> None:
    models, whole = FitCache(), with_effects(base, BIAS, BEND, UNEQUAL)
    rest = models.without(whole, BEND, UNEQUAL)
    assert rest.effects == (BIAS,)
    assert rest.value < with_effects(base, BIAS).value
    # There are no fits of intermediate models, and the result is in the cache.
    assert [*models.fits] == [rest.key]
    monkeypatch.setattr(candidate_fits, "fit_coarse", None)
    assert models.without(whole, UNEQUAL, BEND) is rest
    assert models.without(whole) is whole


def test_a_model_without_an_effect_is_fitted_to_convergence(base: FitResult) -> None:
    models, left = FitCache(), replace(with_effects(base, BIAS), remaining_gain=math.inf)
    models.fits[left.key] = left
    ended = models.without(with_effects(base, BIAS, BEND), BEND)
    assert ended.value < left.value
    assert models.fits[left.key] is ended
    assert models.converged(ended) is ended


def test_converged_extensions_have_one_effect_more_which_is_the_last(base: FitResult) -> None:
    models, here = FitCache(), with_effects(base, BIAS)
    ended, unfinished = (
        with_effects(base, BEND, BIAS),
        replace(with_effects(base, BIAS, UNEQUAL), remaining_gain=math.inf),
    )
    every = with_effects(base, BIAS, BEND, UNEQUAL)
    looser = replace(ended, objective=replace(ended.objective, limit=0.5))
    models.fits.update({fit.key: fit for fit in (here, ended, unfinished, every, looser)})
    ((key, found),) = models.converged_extensions(here).items()
    assert key == BEND.key
    assert found.effects == (BIAS, BEND)
    assert found.value == ended.value
    assert found.model.values == pytest.approx(with_effects(base, BIAS, BEND).model.values)


def test_a_fit_worse_than_its_nested_model_is_repeated_from_there(
    base: FitResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    models, plain = FitCache(), replace(base, remaining_gain=0.0)
    models.fits[plain.key] = plain
    astray = replace(with_effects(base, BEND), value=plain.value + 5.0)
    climb, climbs = candidate_fits.fit_coarse, [astray]
    monkeypatch.setattr(candidate_fits, "fit_coarse", lambda *told: climbs.pop() if climbs else climb(*told))
    models.fit_all(base.objective, [((BEND,), astray.x)])
    assert models.fits[astray.key].value <= plain.value
    assert climbs == []
