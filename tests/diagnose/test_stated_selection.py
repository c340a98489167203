"""What is stated of a selected model: causes whose size the stated errors leave open are not established."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
import pytest

from rovid.diagnose import stated_selection
from rovid.diagnose.algorithm import conclude
from rovid.diagnose.selection import Selection
from rovid.diagnose.stated_selection import is_established, state
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.estimate.estimate import Estimate
from rovid.estimate.fit_result import FitResult
from tests.predictions import BIAS


def widen(monkeypatch: pytest.MonkeyPatch, errors: float) -> None:
    """What the model lacks makes the constant torque this many standard errors large."""

    def wider(estimate: Estimate, _: FitResult) -> Estimate:
        covariance = np.array(estimate.covariance)
        for at, name in enumerate(estimate.names):
            if name == "bias_torque.torque":
                covariance[at, at] = (estimate.values[at] / errors) ** 2
        return replace(estimate, covariance=covariance)

    monkeypatch.setattr(stated_selection, "include_missing_torque", wider)


def test_a_cause_that_is_large_in_the_stated_errors_stays(
    selection: Selection, monkeypatch: pytest.MonkeyPatch
) -> None:
    widen(monkeypatch, 1.01 * THRESHOLDS.min_stated_errors)
    stated = state(selection)
    assert stated.selection is selection
    assert stated.size_in_errors(BIAS) == pytest.approx(1.01 * THRESHOLDS.min_stated_errors)


def test_a_cause_that_the_stated_errors_leave_open_is_a_suspect(
    selection: Selection, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The model and all figures are without it, as if it had failed a rule."""
    widen(monkeypatch, 0.99 * THRESHOLDS.min_stated_errors)
    told = conclude(selection, ())
    assert told.verdict == "suspected"
    assert told.findings == ()
    assert [one.effect.id for one in told.suspects] == ["bias_torque"]
    assert told.suspects[0].probability <= THRESHOLDS.max_suspect_probability
    assert told.extended is not None
    assert told.extended.model.effects == ()
    assert "bias_torque.torque" not in told.extended.estimate.names
    assert any("only 3.0 of the standard errors that include what the model lacks" in one for one in told.warnings)


def test_what_fails_without_the_dropped_cause_is_dropped_too(
    selection: Selection, monkeypatch: pytest.MonkeyPatch
) -> None:
    dropped: list[str] = []

    def drop(one: Selection, keys: Collection[str]) -> Selection:
        dropped.extend(keys)
        return replace(one, model=one.base)

    monkeypatch.setattr(stated_selection, "drop_likely", drop)
    widen(monkeypatch, 1.0)
    stated = state(selection)
    assert dropped == [BIAS.key]
    assert not stated.selection.search.is_allowed(BIAS)


@pytest.mark.parametrize(
    ("errors", "probability", "expected"), [(2.9, 0.97, False), (3.1, 0.97, True), (9.0, 0.9, False)]
)
def test_waves_are_established_by_the_same_rule(
    selection: Selection, errors: float, probability: float, *, expected: bool
) -> None:
    (finding,) = conclude(selection, ()).findings
    assert is_established(replace(finding, standard_errors=errors, probability=probability)) is expected
