"""Validation of a selected model: rejection rules, ties, suspects."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rovid.diagnose import cross_validation, validation
from rovid.diagnose import selection as selections
from rovid.diagnose.algorithm import validate
from rovid.diagnose.build_result import search_warnings
from rovid.diagnose.candidate_fits import Alternative, Cause, FitCache, bic_score
from rovid.diagnose.challenge import resolve_ties
from rovid.diagnose.cross_validation import Fold, HeldOutScores, simulate_folds
from rovid.diagnose.evidence import probability_not_a_stand_in
from rovid.diagnose.selection import Selection
from rovid.diagnose.signal_regressors import signal_regressors
from rovid.diagnose.stepwise import SearchProgress, SearchStop, StepwiseSearch
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.diagnose.validation import (
    changes_time_constant,
    drop_inconsistent,
    first_rejection,
    raises_disturbance,
    report_remainder,
    simulates_worse,
    suspects,
    within_sampling,
)
from rovid.diagnose.wave_test import WaveTest
from rovid.effects import Effect, EffectParameter, effect_named
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.multi_step import MultiStepLikelihood
from rovid.estimate.objective import ModelKey
from rovid.estimate.parametrization import INERTIA
from rovid.trial.vehicle import Vehicle
from tests.predictions import BIAS

UNEQUAL = effect_named("thrust_asymmetry")


def passing(
    monkeypatch: pytest.MonkeyPatch, *, gain: float = 50.0, size: float = 10.0, probability: float = 0.97
) -> None:
    """Every effect has such a held-out gain, such a size in standard errors, and such a probability."""
    monkeypatch.setattr(Selection, "held_out_gain", lambda *_: gain)
    monkeypatch.setattr(validation, "significance", lambda *_: size)
    monkeypatch.setattr(Selection, "probability", lambda *_: probability)


def reason_of(selection: Selection) -> str:
    rejected = first_rejection(selection)
    return "" if rejected is None else rejected.reason


def test_a_cause_that_acts_passes_all_tests(selection: Selection) -> None:
    assert selection.held_out_gain(BIAS) > 20.0
    assert first_rejection(selection) is None
    assert validate(selection).model.effects == (BIAS,)


def test_each_model_is_simulated_once_for_all_rules(selection: Selection, monkeypatch: pytest.MonkeyPatch) -> None:
    passing(monkeypatch)
    simulated = list[ModelKey]()

    def counted(fitted: FitResult, folds: Sequence[Fold]) -> HeldOutScores:
        simulated.append(fitted.key)
        return simulate_folds(fitted, folds)

    monkeypatch.setattr(selections, "simulate_folds", counted)
    for _ in range(2):
        assert first_rejection(selection) is None
    assert Counter(simulated) == {selection.model.key: 1, selection.base.key: 1}


@pytest.mark.parametrize(("gain", "held_out"), [(14.0, 20.0), (20.0, 13.0)])
def test_the_smaller_of_expected_and_held_out_gain_caps_a_probability(
    selection: Selection, monkeypatch: pytest.MonkeyPatch, gain: float, held_out: float
) -> None:
    """White innovations; both gains are of other trials, so one nat for the only parameter is all that they differ."""
    monkeypatch.setattr(FitResult, "is_white", True)
    selection = replace(selection, model=replace(selection.model))  # without the cached property
    capped = probability_not_a_stand_in(13.0, 13.0, white=True)
    assert selection.stand_in_cap(BIAS, gain, held_out, 0.0) == pytest.approx(capped)
    assert selection.stand_in_cap(BIAS, gain + 2.0, held_out + 2.0, 2.0) == pytest.approx(capped)


@pytest.mark.parametrize(("gain", "fails"), [(-3.0, True), (0.0, True), (1e-9, False)])
def test_an_effect_must_gain_on_held_out_trials(
    selection: Selection, monkeypatch: pytest.MonkeyPatch, gain: float, *, fails: bool
) -> None:
    passing(monkeypatch, gain=gain)
    assert ("predicts held-out trials worse" in reason_of(selection)) is fails


def test_an_effect_must_not_be_at_its_bound(selection: Selection, monkeypatch: pytest.MonkeyPatch) -> None:
    passing(monkeypatch)
    x = selection.model.x.copy()
    x[-1] = BIAS.parameters[0].high
    at_bound = replace(selection, model=replace(selection.model, x=x))
    assert reason_of(selection) == ""
    assert "physically plausible" in reason_of(at_bound)


@pytest.mark.parametrize(
    ("multi_step", "least"),
    [(False, THRESHOLDS.min_standard_errors), (True, THRESHOLDS.min_standard_errors_multi_step)],
)
def test_an_effect_must_differ_from_zero_by_its_standard_errors(
    selection: Selection, monkeypatch: pytest.MonkeyPatch, least: float, *, multi_step: bool
) -> None:
    selection = replace(selection, multi_step=multi_step)
    passing(monkeypatch, size=least)
    assert reason_of(selection) == ""
    passing(monkeypatch, size=0.99 * least)
    assert "standard errors" in reason_of(selection)


@pytest.mark.parametrize(
    ("probability", "reason", "is_likely"),
    [
        (0.95, "", False),
        (0.9499, "is not established", True),
        (0.5, "is not established", True),
        (0.4999, "is possible, but not established", False),
    ],
)
def test_an_effect_must_be_probable(
    selection: Selection, monkeypatch: pytest.MonkeyPatch, probability: float, reason: str, *, is_likely: bool
) -> None:
    passing(monkeypatch, probability=probability)
    rejected = first_rejection(selection)
    assert reason_of(selection) == reason
    assert (rejected is not None and rejected.is_likely) is is_likely


def test_an_effect_that_was_passed_over_is_not_tested(selection: Selection, monkeypatch: pytest.MonkeyPatch) -> None:
    passing(monkeypatch, gain=-1.0)
    assert first_rejection(selection, [BIAS.key]) is None


def test_an_effect_that_is_nothing_on_all_data_is_rejected(
    selection: Selection, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The search uses thinned data; the size on all data counts too."""
    passing(monkeypatch)
    full = replace(selection.model)
    monkeypatch.setattr(Selection, "full_data", lambda *_: full)
    sizes = {id(selection.model): 10.0, id(full): 0.4}
    monkeypatch.setattr(validation, "significance", lambda fitted, _: sizes[id(fitted)])
    assert reason_of(selection) == "differs from zero by only 0.4 standard errors on all data"


@pytest.mark.parametrize(
    ("margins", "banned", "fails"), [(1.01, True, True), (0.99, True, False), (-1.0, True, False), (1.01, False, False)]
)
def test_no_cause_takes_the_place_of_a_better_one_that_failed(
    selection: Selection, monkeypatch: pytest.MonkeyPatch, margins: float, *, banned: bool, fails: bool
) -> None:
    passing(monkeypatch)
    cause = selection.cause(BIAS)
    gain = margins * THRESHOLDS.tie(cause.bic_gain)
    other = Alternative(UNEQUAL, cause.bic_gain + gain, selection.model)
    monkeypatch.setattr(Selection, "cause", lambda *_: replace(cause, alternatives=(other,)))
    tested = selection.ban(UNEQUAL) if banned else selection
    assert ("gains less than" in reason_of(tested)) is fails


def test_the_weakest_effect_is_rejected_first(selection: Selection, monkeypatch: pytest.MonkeyPatch) -> None:
    passing(monkeypatch, gain=-1.0)
    objective = selection.base.objective.with_effects((BIAS, UNEQUAL))
    both = fit(objective, np.concatenate((selection.model.x, UNEQUAL.initial_values[0])))
    rejected = first_rejection(replace(selection, model=both))
    assert rejected is not None
    assert rejected.effect is UNEQUAL


@pytest.mark.parametrize(("high", "fails"), [(0.7, True), (0.71, False)])
def test_no_parameter_may_be_at_the_limit_of_its_range(
    selection: Selection, monkeypatch: pytest.MonkeyPatch, high: float, *, fails: bool
) -> None:
    """A second parameter, such as a memory, may be at a limit where the size is not."""
    passing(monkeypatch)
    memory = EffectParameter(name="memory", unit="s", neutral=0.0, low=0.0, high=high, initial_values=(0.1,))
    late = replace(BIAS, parameters=(*BIAS.parameters, memory))
    (size,) = selection.model.effect_coordinates(BIAS)
    monkeypatch.setattr(FitResult, "effect_coordinates", lambda *_: np.array([size, 0.7]))
    full = replace(selection.model)
    monkeypatch.setattr(Selection, "full_data", lambda *_: full)
    assert bool(validation.at_bound_on_all_data(selection, late)) is fails


def with_growths(monkeypatch: pytest.MonkeyPatch, growths: dict[str, np.ndarray]) -> None:
    """The RMS errors of "position", (p, q), and "rate", (p,), of the pieces grow by these shares with an effect."""

    def squares(name: str, fitted: FitResult) -> np.ndarray:
        growth = np.array(growths[name])
        return 1e-4 * (1.0 + growth * bool(fitted.effects)) ** 2

    def scores(_: Selection, fitted: FitResult) -> HeldOutScores:
        own = squares("rate", fitted)
        return HeldOutScores(log_likelihood=0.0, rate_r2=0.0, rate_rmse=0.0, rate_squares=own, position_errors={})

    monkeypatch.setattr(Selection, "horizon_squares", lambda _, fitted: squares("position", fitted))
    monkeypatch.setattr(Selection, "held_out_scores", scores)


@pytest.mark.parametrize("quantity", ["position", "rate"])
@pytest.mark.parametrize(("growth", "fails"), [(0.06, True), (0.019, False), (-0.3, False)])
def test_an_effect_must_make_neither_held_out_rate_nor_position_worse(
    selection: Selection, monkeypatch: pytest.MonkeyPatch, quantity: str, growth: float, *, fails: bool
) -> None:
    passing(monkeypatch)
    growths = {"position": np.full((8, 2), -0.5), "rate": np.full(8, -0.5)}
    growths[quantity] = np.full_like(growths[quantity], growth)
    growths["position"][3, 0] = math.nan
    with_growths(monkeypatch, growths)
    assert (f"makes the {quantity} errors on held-out trials 6 % larger" == reason_of(selection)) is fails


@pytest.mark.parametrize("quantity", ["position", "rate"])
@pytest.mark.parametrize(
    ("pieces", "fails"),
    [([-0.1] * 7 + [3.0], False), ([0.1] * 7 + [-0.02], True), ([0.3, -0.2, 0.25, -0.15, 0.2, -0.1, 0.1, 0.0], False)],
    ids=["one goes wrong", "one does not", "scatter"],
)
def test_held_out_pieces_are_compared_in_pairs(
    selection: Selection, monkeypatch: pytest.MonkeyPatch, quantity: str, pieces: list[float], *, fails: bool
) -> None:
    """Pooled, the piece that goes wrong outweighs the seven that improve: the mean square error grows to 2.7 times."""
    growths = {"position": np.full((8, 2), -0.5), "rate": np.full(8, -0.5)}
    growths[quantity] = np.array(pieces) if quantity == "rate" else np.array(pieces)[:, np.newaxis] * np.ones(2)
    with_growths(monkeypatch, growths)
    assert bool(simulates_worse(selection, BIAS)) is fails


def test_chance_makes_held_out_errors_worse_at_the_stated_level(
    selection: Selection, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of effects that change nothing in the mean, one in twenty is rejected."""
    rng = np.random.default_rng(1)
    monkeypatch.setattr(validation, "THRESHOLDS", replace(THRESHOLDS, held_out_growth=0.0))
    without = np.ones((8, 1))
    drawn = (cross_validation.certain_growth(np.exp(rng.normal(0.0, 0.2, (8, 1))), without) for _ in range(4000))
    share = float(np.mean([growth > 0.0 for growth in drawn]))
    assert share == pytest.approx(THRESHOLDS.held_out_growth_level, abs=4.0 * math.sqrt(0.05 * 0.95 / 4000))


@pytest.mark.parametrize(
    ("size", "memory", "fails"),
    [(1.05, 3.0, False), (1.5, 3.0, True), (0.5, 3.0, False), (1.5, 12.0, False), (1.5, 1.0, False)],
    ids=["within its error", "larger", "smaller", "slower", "faster"],
)
def test_an_effect_must_not_raise_the_disturbance(
    selection: Selection, monkeypatch: pytest.MonkeyPatch, size: float, memory: float, *, fails: bool
) -> None:
    """The size of 1 N m and the memory of 3 s without the effect have a standard error of 0.05 N m or more."""
    seconds = sum(float(np.ptp(run.trial.time)) for run in selection.data.runs)
    assert THRESHOLDS.disturbance_growth * math.sqrt(3.0 / seconds) > 0.05
    with_effect = selection.model.objective.effects
    monkeypatch.setattr(
        MultiStepLikelihood, "disturbance", lambda own, _: (size, memory) if own.effects == with_effect else (1.0, 3.0)
    )
    assert bool(raises_disturbance(selection, BIAS)) is fails


@pytest.mark.parametrize(("factor", "growth", "fails"), [(0.3, 0.0, True), (0.3, -0.3, False), (0.6, 0.0, False)])
def test_an_effect_that_takes_the_place_of_the_inertia_must_improve_simulations(
    selection: Selection, monkeypatch: pytest.MonkeyPatch, factor: float, growth: float, *, fails: bool
) -> None:
    with_growths(monkeypatch, {"position": np.full((8, 2), -0.5), "rate": np.full(8, growth)})
    x = selection.model.x.copy()
    x[INERTIA] += math.log(factor)
    changed = replace(selection, model=replace(selection.model, x=x))
    assert bool(changes_time_constant(changed, BIAS)) is fails
    # More thrust changes inertia and drag alike.
    x[INERTIA + 1 : INERTIA + 3] *= factor
    scaled = replace(selection, model=replace(selection.model, x=x))
    assert not changes_time_constant(scaled, BIAS)


def test_an_effect_that_moves_the_simulation_less_than_the_sampling_is_not_claimed(selection: Selection) -> None:
    assert within_sampling(selection, BIAS) == ""
    x = selection.search.without(selection.model, BIAS).x
    x = np.append(x, 1e-4 * selection.model.x[-1])
    tiny = replace(selection, model=replace(selection.model, x=x))
    assert "less than the sampling" in within_sampling(tiny, BIAS)
    waves = effect_named("wave_torque")
    assert cross_validation.change_in_samples(waves, tiny.rates(tiny.model), tiny.rates(selection.model)) == math.inf


def test_a_cause_that_acts_lowers_the_disturbance_and_the_held_out_errors(selection: Selection) -> None:
    assert raises_disturbance(selection, BIAS) == ""
    assert simulates_worse(selection, BIAS) == ""
    without = selection.search.without(selection.model, BIAS)
    assert selection.model.disturbance[0] < 0.9 * without.disturbance[0]


BEND = effect_named("drag_curvature")


def test_the_probability_falls_with_the_held_out_gain(selection: Selection) -> None:
    cause = selection.cause(BIAS)
    probabilities = [selection.probability(cause, gain) for gain in (-20.0, 0.0, 6.0, 20.0, 100.0)]
    assert probabilities == sorted(probabilities)
    assert probabilities[0] < 0.05
    assert probabilities[2] <= 0.5
    assert probabilities[-1] > THRESHOLDS.established


def with_tie(selection: Selection, other: Effect, full_gain: float) -> Selection:
    """The alternative ``other`` is worse by 1 nat on thinned data, and better by ``full_gain`` on all data."""
    objective = selection.base.objective.with_effects((other,))
    fitted = FitResult.at(objective, np.concatenate((selection.base.x, other.initial_values[0])))
    gain = bic_score(selection.model) - bic_score(selection.base)
    cause = Cause(BIAS, gain, gain, (Alternative(other, gain - 1.0, fitted),))

    class Tied(StepwiseSearch):
        def cause(self, current: FitResult, effect: Effect) -> Cause:
            assert current.effects
            return cause if effect is BIAS else Cause(effect, gain, gain)

    search: Any = Tied(selection.search.candidates, cache=selection.search.cache)
    selection = replace(selection, search=search, data=replace(selection.data))
    full = selection.search.cache.full_data
    full[selection.model.key], full[selection.base.key] = selection.model, selection.base
    score = bic_score(selection.model) + full_gain
    full[fitted.key] = replace(fitted, value=fitted.value - (score - bic_score(fitted)))
    return selection


@pytest.mark.parametrize(("full_gain", "found"), [(2.0, UNEQUAL), (-2.0, BIAS)])
def test_a_tie_is_decided_by_all_data(selection: Selection, full_gain: float, found: Effect) -> None:
    assert resolve_ties(with_tie(selection, UNEQUAL, full_gain)).model.effects == (found,)


def test_a_banned_alternative_wins_no_tie(selection: Selection) -> None:
    assert resolve_ties(with_tie(selection, UNEQUAL, 2.0).ban(UNEQUAL)).model.effects == (BIAS,)


def test_a_signal_wins_no_tie_with_a_named_effect(selection: Selection, monkeypatch: pytest.MonkeyPatch) -> None:
    runs = [replace(run, trial=replace(run.trial, extras={"x": run.trial.time})) for run in selection.data.runs]
    (signal, *_) = signal_regressors(runs)
    cause = Cause(
        BIAS, 40.0, 40.0, (Alternative(signal, 45.0, selection.base), Alternative(BEND, 39.0, selection.base))
    )
    monkeypatch.setattr(Selection, "cause", lambda *_: cause)
    assert resolve_ties(selection).model.effects == (BIAS,)


def test_a_rejected_effect_is_banned_and_the_search_continues(
    selection: Selection, monkeypatch: pytest.MonkeyPatch
) -> None:
    passing(monkeypatch)
    monkeypatch.setattr(Selection, "held_out_gain", lambda _, effect: -1.0 if effect is BIAS else 50.0)
    started: list[tuple[Effect, ...]] = []
    run = StepwiseSearch.run

    def searched_on(search: StepwiseSearch, base: FitResult) -> FitResult:
        assert not search.is_allowed(BIAS)
        started.append(base.effects)
        return run(search, base)

    monkeypatch.setattr(StepwiseSearch, "run", searched_on)
    validated = validate(selection)
    # No lesser cause takes the place of the one that failed.
    assert set(started) == {()}
    assert validated.model.effects == ()
    assert not validated.search.is_allowed(BIAS)
    assert selection.search.is_allowed(BIAS)
    assert any("constant torque" in message and "not claimed" in message for message in validated.messages)
    assert validated.model is validated.base


def test_a_likely_effect_keeps_its_place_until_the_end(selection: Selection, monkeypatch: pytest.MonkeyPatch) -> None:
    passing(monkeypatch, probability=0.6)
    monkeypatch.setattr(StepwiseSearch, "run", None)
    validated = validate(selection)
    assert validated.model is validated.base
    assert validated.messages[-1] == "constant torque is not established: it is not claimed."


def test_what_shows_only_next_to_a_likely_effect_is_kept_for_the_errors(
    selection: Selection, monkeypatch: pytest.MonkeyPatch
) -> None:
    rejections = iter([validation.Rejection(effect=BIAS, reason="fails"), None])
    monkeypatch.setattr(validation, "first_rejection", lambda _: next(rejections))
    left = validation.drop_likely(selection, ["a likely one"])
    assert (left.model.effects, left.dropped) == ((), selection.model)


def test_an_effect_that_one_step_predictions_do_not_show_is_dropped(
    selection: Selection, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(validation, "has_consistent_size", lambda *_: False)
    assert drop_inconsistent(selection) is selection
    tested = replace(selection, wave_test=lambda beside: WaveTest(beside, ()))
    dropped = drop_inconsistent(tested)
    assert BIAS not in dropped.model.effects
    assert dropped.inconsistent[0] is BIAS
    assert not dropped.search.is_allowed(BIAS)
    assert dropped.waves is not None
    monkeypatch.setattr(validation, "has_consistent_size", lambda *_: True)
    assert drop_inconsistent(tested).model is tested.model


def test_a_dropped_effect_returns_where_its_size_is_consistent(
    selection: Selection, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Next to a stand-in its size was not: a lesser cause does not keep its place."""
    cause, objective = selection.cause(BIAS), selection.model.objective.with_effects((UNEQUAL,))
    fitted = FitResult(objective, objective.parametrization.initial(), 0.0, 0.0)
    better = Alternative(UNEQUAL, cause.bic_gain + 1.0, fitted)

    def in_place(_: Selection, effect: Effect) -> Cause:
        return replace(cause, alternatives=(better,) if effect is BIAS else ())

    monkeypatch.setattr(Selection, "cause", in_place)
    monkeypatch.setattr(validation, "has_consistent_size", lambda *_: True)
    monkeypatch.setattr(FitCache, "without", lambda _, fitted, *__: fitted)
    lesser = replace(selection.ban(UNEQUAL), wave_test=lambda beside: WaveTest(beside, ()))
    assert drop_inconsistent(lesser).model is selection.model
    back = drop_inconsistent(replace(lesser, inconsistent=(UNEQUAL,)))
    assert (back.model, back.inconsistent) == (fitted, ())
    assert back.search.is_allowed(UNEQUAL)


def test_a_further_effect_with_a_notable_gain_is_reported(selection: Selection) -> None:
    assert report_remainder(selection).messages == ()
    without = selection.drop(BIAS)
    (message,) = report_remainder(without).messages
    assert message.startswith("constant torque would gain a log-likelihood of")
    shown = replace(without, inconsistent=(BIAS,))
    assert report_remainder(shown).messages == ()


def test_a_cause_with_more_gain_than_a_suspect_has_its_reason(
    selection: Selection, monkeypatch: pytest.MonkeyPatch
) -> None:
    fitted = selection.model
    left = (Alternative(UNEQUAL, 60.0, fitted), Alternative(BIAS, 50.0, fitted))
    monkeypatch.setattr(StepwiseSearch, "further_causes", lambda *_: left)
    monkeypatch.setattr(validation, "significance", lambda _, effect: 0.5 if effect is UNEQUAL else 9.0)
    monkeypatch.setattr(validation, "change_in_samples", lambda *_: 1.0)
    monkeypatch.setattr(Selection, "chance_corrected_gain", lambda _, one: one.bic_gain)
    monkeypatch.setattr(Selection, "stand_in_cap", lambda *_: 1.0)
    monkeypatch.setattr(validation, "outlier_probability", lambda *_: 1.0)
    (suspect,) = suspects(selection.drop(BIAS))
    assert suspect.alternative.effect is BIAS
    said = "gains 60 after the parameter penalty, but its size is only 0.5 standard errors: it is not suspected."
    assert suspect.failed == {UNEQUAL.id: f"{UNEQUAL.title} {said}"}


def test_a_suspect_s_size_is_compared_without_effects_that_were_dropped(
    selection: Selection, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Next to another effect a size is another one."""
    compared = list[FitResult]()

    def consistent(_: FitResult, one_step: FitResult, __: Effect) -> bool:
        compared.append(one_step)
        return True

    monkeypatch.setattr(validation, "has_consistent_size", consistent)
    dropped = replace(selection.drop(BIAS), waves=WaveTest(selection.model, ()))
    assert suspects(dropped)[0].alternative.effect is BIAS
    assert {fitted.effects for fitted in compared} == {()}


@pytest.mark.parametrize(("stops", "found"), [((), "larger --budget"), ((SearchStop.CUT_SHORT,), "More time does not")])
def test_more_time_is_asked_for_only_where_it_helps(
    selection: Selection, stops: tuple[SearchStop, ...], found: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    progress = SearchProgress(stops={*stops, SearchStop.OUT_OF_TIME})
    monkeypatch.setattr(Selection, "is_out_of_time", True)
    tested = replace(selection, search=replace(selection.search, progress=progress))
    (_, said) = search_warnings(tested, [])
    assert found in said


def test_a_gain_with_an_implausible_inertia_is_told(selection: Selection, monkeypatch: pytest.MonkeyPatch) -> None:
    """A wrong mass or size would otherwise hide the cause without a word."""
    x = selection.model.x.copy()
    x[INERTIA] -= math.log(2.0)
    extended = replace(selection.model, x=x)
    monkeypatch.setattr(Vehicle, "reference_inertia", selection.model.model.inertia)
    monkeypatch.setattr(StepwiseSearch, "extensions", lambda *_: [extended])
    (message,) = report_remainder(selection.drop(BIAS)).messages
    assert message.startswith("constant torque would gain a log-likelihood of")
    assert "with an inertia of 0.5 times the rigid body's by mass and size, outside 0.9 to 8.0." in message


@pytest.mark.parametrize(("share", "limited"), [(1.0, True), (0.5, False)])
def test_a_gain_with_a_parameter_at_its_limit_is_told(
    selection: Selection, monkeypatch: pytest.MonkeyPatch, share: float, *, limited: bool
) -> None:
    """Such an effect is never selected, but what it gains is not passed over."""
    x = selection.model.x.copy()
    x[-1] = share * BIAS.parameters[0].high
    extended = replace(selection.model, x=x)
    without = selection.drop(BIAS)
    monkeypatch.setattr(StepwiseSearch, "extensions", lambda *_: [extended])
    messages = [one for one in report_remainder(without).messages if "at the limit of its range" in one]
    assert bool(messages) is limited
    if limited:
        gain = without.model.value - extended.value
        assert messages[0].startswith(f"constant torque would gain a log-likelihood of {gain:.0f} with a size")
