"""Diagnosis and comparison on a terminal."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from rich.cells import cell_len

from rovid.compare.campaign_fit import campaign_from_parameters
from rovid.compare.comparison import Comparison, compare
from rovid.core.formatting import SafeConsole
from rovid.diagnose.result import Diagnosis
from rovid.effects import effect_named
from rovid.present.number_format import parameter_title
from rovid.present.sentences import comparison_headline, comparison_sentences
from rovid.present.terminal.diagnosis import show_comparison, show_diagnosis
from rovid.trial.assumptions import Assumptions
from rovid.trial.vehicle import Vehicle
from tests.compare.files import LAGGING, PLAIN, stored_at, times
from tests.present.test_sentences import LAG
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
        assert "cannot be found from these data: a common factor on all thrust; a constant factor" in account
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
        "Thruster lag: time constant 0.600 ± 0.010 s",
        "  confirmed: size 60 standard errors, log-likelihood gain 4500 on trials that were not fitted",
        "  equation: τ·dT'/dt + T' = T",
        "  log-likelihood gain: 4000 after the parameter penalty",
    ]
    assert account[6].startswith("Confirmed: the cause is established, ")
    (suspected,) = (
        line for line in told(Diagnosis(verdict="suspected", suspects=(LAG,))).splitlines() if "may" in line
    )
    assert suspected == "The plain model may miss thruster lag."


CASES = {
    "same": (PLAIN, PLAIN, "Nothing changed from A to B"),
    "drag": (PLAIN, times(1.1, "quadratic_drag"), "From A to B changed: quadratic drag, 1.1000 ± 0.0051 times."),
    "thrust": (PLAIN, times(1.0 / 0.9, *PLAIN), "From A to B changed: all thrust (or inertia and drag together"),
    "came": (PLAIN, LAGGING, "thruster lag, which is new (time constant 0.4000 ± 0.0040 s)"),
    "went": (LAGGING, PLAIN, "thruster lag, which is gone (it had time constant 0.4000 ± 0.0040 s)"),
    "grew": ({**LAGGING, "thruster_lag.time_constant": (0.2, 0.004)}, LAGGING, "time constant 0.2000"),
}


def of(case: str, folder: Path) -> Comparison:
    one, other, _ = CASES[case]
    seen = {"thruster_lag": 0.01}
    a, b = stored_at(folder / "a.toml", one), stored_at(folder / "b.toml", other, log="b")
    return compare(campaign_from_parameters(a, "A", seen), campaign_from_parameters(b, "B", seen))


@pytest.mark.parametrize("case", CASES)
def test_the_answer_is_a_sentence(case: str, tmp_path: Path) -> None:
    assert CASES[case][2] in comparison_headline(of(case, tmp_path))


def test_where_nothing_changed_it_says_what_would_have_been_seen(tmp_path: Path) -> None:
    said = " ".join(comparison_sentences(of("same", tmp_path)))
    assert "Smallest changes that these data would establish: inertia" in said
    assert "Yaw data never show a common factor on all thrust" in said


def test_less_thrust_is_no_change_of_the_vehicle(tmp_path: Path) -> None:
    comparison = of("thrust", tmp_path)
    assert comparison.changed == ("thrust_scale",)
    out = io.StringIO()
    show_comparison(SafeConsole(file=out, width=120), comparison, Assumptions(), [])
    lines = out.getvalue().splitlines()
    titles = map(parameter_title, PLAIN)
    assert all("as thrust did" in next(line for line in lines if line.startswith(title)) for title in titles)
    assert "1.0000" in next(line for line in lines if line.startswith("I/DQ"))


@pytest.mark.parametrize("width", [60, 80, 120])
@pytest.mark.parametrize("case", CASES)
def test_it_fits_the_terminal(case: str, width: int, tmp_path: Path) -> None:
    out = io.StringIO()
    show_comparison(SafeConsole(file=out, width=width), of(case, tmp_path), Assumptions(), ["a note"])
    lines = out.getvalue().splitlines()
    assert max(map(cell_len, lines)) <= width
    assert lines[0].startswith(("From A", "Nothing changed"))
    assert "\x1b" not in out.getvalue()
