"""What a diagnosis falls back on where each next reading does not explain all after all."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.diagnose.algorithm import diagnose
from rovid.diagnose.result import Diagnosis
from rovid.diagnose.strategies import ByInnovations
from rovid.diagnose.validation import Work
from rovid.signals.preprocessing import PreparedRuns
from tests import synthetic
from tests.diagnose.test_strategies import readings


def said(monkeypatch: pytest.MonkeyPatch, *, explains: bool) -> tuple[Diagnosis, list[str]]:
    """By predictions, which a look at each next reading ends early or not, while no search by it holds."""
    monkeypatch.setattr(ByInnovations, "at_once", lambda *_: None)
    monkeypatch.setattr(ByInnovations, "explains", lambda *_: explains)
    monkeypatch.setattr(ByInnovations, "search", lambda *_: None)
    told: list[str] = []
    runs = PreparedRuns(items=tuple(readings(1.5).runs), cutoff=1.0, chosen=False, remarks=())
    return diagnose(runs, synthetic.LOGGED, told.append), told


def test_predictions_say_what_they_do_without_an_early_end(monkeypatch: pytest.MonkeyPatch) -> None:
    (early, once_more), (whole, once) = (said(monkeypatch, explains=explains) for explains in (True, False))
    assert [finding.effect.id for finding in early.findings] == ["thruster_lag"]
    assert early.verdict == whole.verdict
    assert early.warnings == whole.warnings
    for one, other in ((early.base, whole.base), (early.extended, whole.extended)):
        assert one is not None
        assert other is not None
        assert np.array_equal(one.estimate.values, other.estimate.values)
    assert once_more.count("Looking for waves …") == 2
    assert once.count("Looking for waves …") == 1


def test_where_some_of_what_is_found_at_once_is_in_doubt_predictions_are_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []
    runs = PreparedRuns(items=tuple(readings(1.5).runs), cutoff=1.0, chosen=False, remarks=())
    holds = diagnose(runs, synthetic.LOGGED, asked.append)
    count = len(asked)
    monkeypatch.setattr(Work, "holds", lambda _: False)
    doubted = diagnose(runs, synthetic.LOGGED, asked.append)
    assert [finding.effect.id for finding in holds.findings] == ["thruster_lag"]
    assert [finding.effect.id for finding in doubted.findings] == ["thruster_lag"]
    assert len(asked) - count > count
    assert holds.extended is not None
    assert doubted.extended is not None
    np.testing.assert_allclose(holds.extended.estimate.values, doubted.extended.estimate.values, rtol=1e-3)
