"""Results on a terminal."""

from __future__ import annotations

import io
from types import SimpleNamespace
from typing import Any

import pytest

from rovid.core.formatting import SafeConsole
from rovid.present.terminal.results import show_plan
from rovid.trial.assumptions import Assumptions


@pytest.mark.parametrize(("gain", "is_said"), [(0.086, True), (1.4, False)])
def test_a_run_that_hardly_narrows_an_interval_is_said_to(gain: float, *, is_said: bool) -> None:
    """A variance that is divided by 1.09 is a standard error that is 4 % smaller."""
    best = SimpleNamespace(run=SimpleNamespace(name="hold", seconds=60.0), gain=gain, gain_per_minute=gain)
    plan: Any = SimpleNamespace(
        models=[None], parameter="inertia", runs=(best,), best=best, reason="why", is_decisive=True
    )
    out = io.StringIO()
    show_plan(SafeConsole(file=out, width=200), plan, [], Assumptions(), [])
    assert ("hardly helps: it makes the standard error 4.2 % smaller" in out.getvalue()) == is_said
