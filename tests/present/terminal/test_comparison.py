"""What is said of two campaigns: the answer first, sizes with their errors, whatever the width."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from rich.cells import cell_len

from rovid.compare.campaign_fit import campaign_from_parameters
from rovid.compare.comparison import Comparison, compare
from rovid.core.console import SafeConsole
from rovid.present.terminal.comparison import comparison_headline, comparison_sentences, show_comparison
from rovid.trial.assumptions import Assumptions
from tests.compare.files import LAGGING, PLAIN, stored_at, times

CASES = {
    "same": (PLAIN, PLAIN, "Nothing changed from A to B"),
    "drag": (PLAIN, times(1.1, "quadratic_drag"), "From A to B changed: quadratic drag, 1.1000 ± 0.0051 times."),
    "thrust": (PLAIN, times(1.0 / 0.9, *PLAIN), "From A to B changed: all thrust (or inertia and drag together"),
    "came": (PLAIN, LAGGING, "thruster lag, which came (time constant 0.4000 ± 0.0040 s)"),
    "went": (LAGGING, PLAIN, "thruster lag, which went (it had time constant 0.4000 ± 0.0040 s)"),
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
    assert "It would have been seen from: inertia" in said
    assert "Never visible in yaw data: a common scale of all thrust" in said


def test_less_thrust_is_no_change_of_the_vehicle(tmp_path: Path) -> None:
    comparison = of("thrust", tmp_path)
    assert comparison.changed == ("thrust_scale",)
    out = io.StringIO()
    show_comparison(SafeConsole(file=out, width=120), comparison, Assumptions(), [])
    rows = {line.split()[0]: line for line in out.getvalue().splitlines() if line}
    assert all("as thrust did" in rows[name] for name in PLAIN)
    assert "1.0000" in rows["I/DQ"]


@pytest.mark.parametrize("width", [60, 80, 120])
@pytest.mark.parametrize("case", CASES)
def test_it_fits_the_terminal(case: str, width: int, tmp_path: Path) -> None:
    out = io.StringIO()
    show_comparison(SafeConsole(file=out, width=width), of(case, tmp_path), Assumptions(), ["a note"])
    lines = out.getvalue().splitlines()
    assert max(map(cell_len, lines)) <= width
    assert lines[0].startswith(("From A", "Nothing changed"))
    assert "\x1b" not in out.getvalue()
