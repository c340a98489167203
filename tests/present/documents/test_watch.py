"""What a trial day is as JSON."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rovid.estimate.estimate import Estimate
from rovid.present.terminal.watch import parameters_with_previous, watch_documents, watch_start_document
from rovid.store.folder_monitor import Problem
from rovid.store.watch_session import parse_criteria
from rovid.trial.axis import YAW

ESTIMATE = Estimate(names=("inertia",), values=np.array([100.0]), covariance=np.array([[1.0]]), method="", samples=9)


def test_every_line_says_of_what_kind_it_is() -> None:
    (trouble,) = watch_documents(Problem(where="day", text="is not there."))
    began = watch_start_document(Path("day"), parse_criteria("inertia 2 %", YAW))
    for document, kind in ((trouble, "problem"), (began, "start")):
        assert (document["schema"], document["event"]) == ("rovid-watch/1", kind)
    assert began["until"] == ["inertia 2 %"]
    assert trouble["over"] is False


def test_intervals_stand_beside_those_of_before() -> None:
    before = replace(ESTIMATE, covariance=np.array([[9.0]]), values=np.array([104.0]))
    row = parameters_with_previous(ESTIMATE, before)["inertia"]
    assert row["narrower"] == pytest.approx(3.0)
    assert row["before"]["value"] == 104.0
    assert row["relative_interval"] == pytest.approx(0.0196, rel=1e-3)
    assert parameters_with_previous(ESTIMATE, None)["inertia"]["before"] is None
