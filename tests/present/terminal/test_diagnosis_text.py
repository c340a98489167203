"""The readable account of a diagnosis."""

from __future__ import annotations

import io

from rovid.core.console import SafeConsole
from rovid.diagnose.result import Diagnosis
from rovid.effects import effect_named
from rovid.present.terminal.diagnosis_text import show_diagnosis
from rovid.trial.vehicle import Vehicle
from tests.present.test_verdict import LAG
from tests.synthetic import VEHICLE


def told(diagnosis: Diagnosis, vehicle: Vehicle = VEHICLE) -> str:
    stream = io.StringIO()
    show_diagnosis(SafeConsole(file=stream, width=200), diagnosis, vehicle)
    return stream.getvalue()


def test_each_verdict_has_its_sentence_and_a_next_run() -> None:
    said = {}
    for verdict in ("nothing_found", "unexplained", "too_little_data"):
        account = told(Diagnosis(verdict=verdict))
        said[verdict] = account.splitlines()[0]
        assert "Next:" in account
        assert "never visible in yaw data: a common scale of all thrust" in account
    assert len(set(said.values())) == 3


def test_what_is_missing_is_said() -> None:
    assert "No sines." in told(Diagnosis(verdict="too_little_data", missing="No sines."))


def test_where_nothing_was_found_the_smallest_that_would_have_been_seen_is_told() -> None:
    detectable = ((effect_named("bias_torque"), 0.5), (effect_named("thruster_lag"), float("inf")))
    account = told(Diagnosis(verdict="nothing_found", detectable=detectable))
    rows = {line.split("  ")[0].strip(): line for line in account.splitlines()}
    assert "0.5" in rows[effect_named("bias_torque").title]
    assert "not visible" in rows[effect_named("thruster_lag").title]


def test_a_cause_stands_with_its_size_before_the_evidence() -> None:
    account = told(Diagnosis(verdict="found", findings=(LAG,))).splitlines()
    assert account[0] == "The plain model misses thruster lag."
    assert account[2:6] == [
        "Thruster lag: time_constant 0.6000 ± 0.0100 s",
        "  established: odds 32 to 1",
        "  thruster_lag: τ·dT'/dt + T' = T",
        "  log-likelihood gained: 4000, on trials not fitted 4500",
    ]
    (suspected,) = (
        line for line in told(Diagnosis(verdict="suspected", suspects=(LAG,))).splitlines() if "may" in line
    )
    assert suspected == "The plain model may miss thruster lag."
