"""Score tests of further effects, and substitutes for an effect."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.diagnose.screening import possible_substitutes, score_tests
from rovid.diagnose.stepwise import StepwiseSearch
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects import Effect, effect_named
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fisher_information import Innovations, Jacobian, jacobian_chunks, total_negative_log_likelihood
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.estimate.output_error import fit_output_error
from tests import synthetic
from tests.diagnose.test_algorithm import LAG, readings
from tests.predictions import NOISE, TIME, TORQUE


@dataclass(frozen=True)
class RunningAway:
    """Stand-in for an objective; the last coordinate explains the innovations, and diverges below zero."""

    effects: tuple[Effect, ...] = ()

    @property
    def parametrization(self) -> RunningAway:
        return self

    def with_effects(self, effects: tuple[Effect, ...]) -> RunningAway:
        return RunningAway(effects)

    def initial_values(self) -> list[FloatArray]:
        return self.effects[-1].initial_values

    def innovations(self, x: FloatArray) -> Innovations:
        pattern = np.sin(np.arange(200.0))
        error = 3.0 * pattern * (1.0 - x[-1]) if x[-1] >= 0.0 else np.full(200, np.nan)
        return Innovations(error, np.ones(200) if x[-1] >= 0.0 else np.full(200, np.inf))

    simd_slots_left, effective_count = 0, 200.0

    @property
    def chunks(self) -> list[RunningAway]:
        return [self]

    @property
    def batch_key(self) -> int:
        return 0

    @staticmethod
    def evaluate_each(pairs: Sequence[tuple[RunningAway, FloatArray]]) -> list[Innovations]:
        return [objective.innovations(x) for objective, x in pairs]

    def value_of(self, here: Innovations) -> float:
        return total_negative_log_likelihood(here, 1.0)

    def evaluate_with_spare(self, x: FloatArray) -> tuple[Innovations, list[Innovations]]:
        return self.innovations(x), []

    def jacobian(self, x: FloatArray, known: tuple[Innovations, list[Innovations]]) -> Iterator[Jacobian]:
        here, _ = known
        return self.jacobian_between(here, [here], np.ones(len(x)))

    def jacobian_between(
        self, centre: Innovations, sides: Sequence[Innovations], step: FloatArray
    ) -> Iterator[Jacobian]:
        return jacobian_chunks(centre, sides, step, 1.0)


def test_a_start_that_diverges_excludes_no_other_start() -> None:
    form = effect_named("drag_curvature")
    assert {np.sign(start[0]) for start in form.initial_values} == {-1.0, 1.0}
    objective: Any = RunningAway()  # stand-in for an objective
    (test,) = score_tests(FitResult(objective, np.zeros(1), 0.0), [form])
    # The effect can gain half the sum of squares.
    assert test.gain == pytest.approx(0.5 * 9.0 * 100.0, rel=0.02)
    assert test.start[0] > 0.0


def test_next_to_a_model_that_diverges_nothing_is_tested() -> None:
    objective: Any = RunningAway()
    assert score_tests(FitResult(objective, np.array([math.nan]), 0.0), [effect_named("drag_curvature")]) == []


@dataclass(frozen=True)
class Noise(RunningAway):
    """Stand-in for an objective; each start of an effect adds noise to the innovations."""

    effects: tuple[Effect, ...] = ()

    def with_effects(self, effects: tuple[Effect, ...]) -> Noise:
        return Noise(effects)

    def innovations(self, x: FloatArray) -> Innovations:
        error = np.random.default_rng(0).normal(size=200)
        aside = np.random.default_rng(int(1e6 * x[-2])).normal(size=200) if len(x) > 1 else 0.0
        return Innovations(error + 0.1 * aside, np.ones(200))

    @staticmethod
    def evaluate_each(pairs: Sequence[tuple[RunningAway, FloatArray]]) -> list[Innovations]:
        return [objective.innovations(x) for objective, x in pairs]


def test_many_starts_together_predict_no_gain_from_noise() -> None:
    form = effect_named("tank_seiche")
    assert len(form.initial_values) == 36
    objective: Any = Noise()  # stand-in for an objective
    (test,) = score_tests(FitResult(objective, np.zeros(1), 0.0), [form])
    # Together, 36 directions gain 18 from noise (chi-square); the best one alone gains a few.
    assert 0.0 < test.gain < 8.0


@pytest.mark.parametrize("share", [0.15, 0.3, 0.45])
def test_a_score_test_sees_a_switch_wherever_its_threshold_lies(share: float) -> None:
    """Between two commands, 5 % of the largest one away, the likelihood has no slope."""
    switch = effect_named("command_hysteresis:schmitt")
    time = synthetic.clock(400.0, 5.0)
    levels = np.outer([share - 0.05, 0.0, share + 0.05, 0.0, 0.8, 0.0, 1.0, 0.0], [1.0, -1.0]).T.ravel()
    torque = 160.0 * np.resize(np.repeat(levels, 50), len(time))
    acting = np.where(np.abs(torque) > 160.0 * share, torque, 0.0)
    noise = np.random.default_rng(3).normal(0.0, 3e-4, len(time))
    run = synthetic.run(time, torque, disturbance=acting - torque, noise=noise)
    run = replace(run, trial=replace(run.trial, commands=torque[:, None] / 100.0))  # in V
    plain = InnovationLikelihood(InnovationData([run], synthetic.VEHICLE, synthetic.ROSUB), 0.05)
    current, extended = fit(plain, plain.parametrization.initial()), plain.with_effects((switch,))
    true = fit(extended, with_more(current, 1.6 * share / extended.parametrization.units[-1]))
    (test,) = score_tests(current, [switch])
    assert test.gain > 0.2 * (current.value - true.value) > 5.0


LATE = ("command_delay", "thruster_lag:spin", "slew_limit")
OTHERS = ("bias_torque", "drag_curvature", "tether_torsion", "drag_asymmetry")


def with_more(fitted: FitResult, *start: float) -> FloatArray:
    return np.array([*fitted.x, *start])


@pytest.fixture(scope="module")
def late() -> FitResult:
    plain = InnovationLikelihood(readings(1.5), 0.05)
    return fit(plain.with_effects((LAG,)), with_more(fit(plain, plain.parametrization.initial()), 1.0))


def test_delays_are_possible_substitutes_for_a_lag(late: FitResult) -> None:
    tests = score_tests(late, [effect_named(key) for key in (*LATE, *OTHERS)])
    found = {form.key for form in possible_substitutes(late, tests, LAG)}
    assert {"command_delay", "thruster_lag:spin"} <= found
    assert not found & {*OTHERS}


def test_every_form_is_a_substitute_where_the_neutral_value_is_infinite(late: FitResult) -> None:
    limit = effect_named("slew_limit")
    assert limit.parameters[0].neutral_at_infinity
    limited = late.objective.with_effects((LAG, limit))
    current = FitResult.at(limited, with_more(late, *limit.initial_values[0]))
    tests = score_tests(current, [effect_named(key) for key in OTHERS])
    assert len(possible_substitutes(current, tests, limit)) == len(OTHERS)


def test_substitutes_are_fitted_in_the_place_of_a_cause(late: FitResult) -> None:
    candidates = [LAG, *(effect_named(key) for key in (*LATE, *OTHERS))]
    search = StepwiseSearch(candidates)
    search.cache.fits[late.key] = late
    rest = search.without(late, LAG)
    assert rest.value - late.value > search.threshold / THRESHOLDS.shortlist_share
    cause = search.cause(late, LAG)
    assert rest.key not in search.cache.score_tests
    whole = StepwiseSearch(candidates)
    every = [rival for rival in whole.further_causes(whole.without(late, LAG)) if rival.effect.id != LAG.id]
    assert cause.alternatives[0].effect.id == every[0].effect.id == "command_delay"
    # The fit of an alternative out of reach is not continued.
    assert every[0].bic_gain - 50.0 < cause.alternatives[0].bic_gain <= every[0].bic_gain + 0.1 < cause.bic_gain


def test_a_cause_with_a_small_gain_is_compared_with_every_form(late: FitResult) -> None:
    bias = effect_named("bias_torque")
    objective = late.objective.with_effects((LAG, bias))
    idle = fit(objective, with_more(late, *bias.initial_values[0]))
    search = StepwiseSearch([LAG, bias, *(effect_named(key) for key in OTHERS)])
    search.cache.fits.update({late.key: late, idle.key: idle})
    search.cause(idle, bias)
    assert {test.effect.id for test in search.cache.score_tests[late.key]} == {*OTHERS}


def small_torque(key: str, torque: FloatArray) -> FloatArray:
    """Torque in N m of a small effect: a bias of 1 N m, or 0.5 % more thrust astern."""
    if key == "bias_torque":
        return np.full(len(torque), 1.0)
    return 0.005 * np.minimum(torque, 0.0)


@pytest.mark.parametrize("key", ["bias_torque", "thrust_asymmetry"])
def test_the_predicted_gain_of_a_small_effect_is_that_of_the_refit(key: str) -> None:
    disturbed = []
    rng = np.random.default_rng(1)
    for first in range(0, len(TORQUE) - 1500, 1500):
        rows = slice(first, first + 1500)
        water = synthetic.gauss_markov(1500, 0.2, 2.0, 4.0, rng)
        disturbance = water + small_torque(key, TORQUE[rows])
        disturbed.append(synthetic.run(TIME[:1500], TORQUE[rows], disturbance=disturbance, noise=NOISE[rows]))
    data = InnovationData(disturbed, synthetic.LOGGED, fit_output_error(disturbed, min_sigmas=0.0))
    plain, effect = InnovationLikelihood(data, 0.05), effect_named(key)
    base = fit(plain, plain.parametrization.initial(), tolerance=1e-4)
    (test,) = score_tests(base, [effect])
    refitted = fit(plain.with_effects((effect,)), with_more(base, *test.start), tolerance=1e-4)
    gain = base.value - refitted.value
    assert gain > 5.0
    # The prediction is of first order in the size; at these sizes, of three to five standard errors, it is off by 1 %.
    assert test.gain == pytest.approx(gain, rel=0.02)
