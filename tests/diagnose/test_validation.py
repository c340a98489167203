"""Rules of validation: which effects of a selected model are rejected, and how the search continues."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rovid.diagnose import validation
from rovid.diagnose.algorithm import validate
from rovid.diagnose.candidate_fits import Alternative, Cause, bic_score
from rovid.diagnose.selection import Selection
from rovid.diagnose.signal_regressors import signal_regressors
from rovid.diagnose.stepwise import StepwiseSearch
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.diagnose.validation import drop_inconsistent, report_remainder, resolve_ties
from rovid.diagnose.wave_test import WaveTest
from rovid.effects import Effect, effect_named
from rovid.estimate.fit_result import FitResult
from tests.predictions import BIAS

BEND, UNEQUAL = effect_named("drag_curvature"), effect_named("thrust_asymmetry")


def passing(
    monkeypatch: pytest.MonkeyPatch, *, gain: float = 50.0, size: float = 10.0, probability: float = 0.97
) -> None:
    """Every effect has such a held-out gain, such a size in standard errors, and such a probability."""
    monkeypatch.setattr(Selection, "held_out_gain", lambda *_: gain)
    monkeypatch.setattr(validation, "significance", lambda *_: size)
    monkeypatch.setattr(Selection, "probability", lambda *_: probability)


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
    assert validated.messages[-1] == "constant torque is likely, but not established: it is not claimed."


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


def test_a_further_effect_with_a_notable_gain_is_reported(selection: Selection) -> None:
    assert report_remainder(selection).messages == ()
    without = selection.drop(BIAS)
    (message,) = report_remainder(without).messages
    assert message.startswith("constant torque would gain a log-likelihood of")
    shown = replace(without, inconsistent=(BIAS,))
    assert report_remainder(shown).messages == ()


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
