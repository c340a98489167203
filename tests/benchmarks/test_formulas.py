"""Scores and page of the benchmark of formulas."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from benchmarks.formulas import struck_cases
from benchmarks.formulas_page import (
    BEGIN,
    DRIVERS,
    END,
    held_out_share,
    removed,
    right_signals,
    section,
    write_section,
    wrong_names,
)


def struck(hidden: str = "drag_curvature", **changed: Any) -> dict[str, Any]:
    formula = {"formula": "-6000*rate*rate*rate", "signals": ["rate"], "beside": [], "held_out_nats": 90.0}
    plain = {"kind": "struck", "hidden": hidden, "seed": 1, "reference_nats": 100.0, "causes_nats": 0.0, "causes": []}
    return plain | {"established": [], "formulas": [formula], "seconds": [1.0, 2.0]} | changed


def outside(hidden: str, name: str, evidence: str = "confirmed", **changed: Any) -> dict[str, Any]:
    said = {"effect": name, "or": [], "evidence": evidence}
    shares = {"removed_by_causes": 0.9, "removed_by_formulas": [0.5], "causes": [name], "plain_error": 0.2}
    return struck(hidden, established=[said], **shares) | {"kind": "beyond"} | changed


def test_the_share_counts_the_causes_next_to_the_formula() -> None:
    assert held_out_share(struck()) == 0.9
    assert held_out_share(struck(formulas=[], causes_nats=30.0)) == 0.3
    beside = struck()["formulas"][0] | {"beside": ["bias_torque"], "held_out_nats": 40.0}
    assert held_out_share(struck(formulas=[beside], causes_nats=30.0)) == 0.7


def test_the_signals_are_right_only_without_others() -> None:
    assert right_signals(struck())
    assert not right_signals(struck("coulomb_resistance", formulas=[]))
    assert not right_signals(struck("heading_dependent_torque"))
    other = struck()["formulas"][0] | {"signals": ["thrust:fore"]}
    assert right_signals(struck("thruster_imbalance", formulas=[other]))
    assert right_signals(struck("thruster_lag", formulas=[other]))


def test_each_struck_effect_has_its_signals() -> None:
    assert {*struck_cases()} - {"nothing", "wave_torque"} == {*DRIVERS}


def test_a_name_is_wrong_unless_the_cause_or_a_tie_is_akin() -> None:
    assert wrong_names(outside("cavitation", "thrust_curve_shape:saturating")) == []
    assert wrong_names(outside("coanda", "advance_speed_loss")) == ["advance_speed_loss (confirmed)"]
    tie = {"effect": "drag_curvature", "or": ["coulomb_resistance"], "evidence": "likely"}
    assert wrong_names(outside("seals", "", established=[tie])) == []


def test_what_a_wrong_cause_removes_does_not_count() -> None:
    assert removed(outside("cavitation", "thrust_curve_shape")) == 0.9
    assert removed(outside("coanda", "advance_speed_loss")) == 0.5


def test_the_page_names_the_failures(tmp_path: Path) -> None:
    bare = struck("nothing", reference_nats=0.0)
    records = [struck(), struck("tank_seiche", formulas=[]), bare, outside("coanda", "advance_speed_loss")]
    text = section(records)
    for line in (
        "A share of 0.8 or more: 1 of 2 campaigns.",
        "a formula is offered in 1 of 1. Not run yet: added_mass_memory, advance_speed_loss,",
        "- tank_seiche, seed 1: the share is 0.00.",
        "| coanda | 0.20 | 0.50 | `-6000*rate*rate*rate` | advance_speed_loss, confirmed |",
        "- coanda, seed 1: 0.50 of the error is removed.",
        "- coanda, seed 1: advance_speed_loss (confirmed) is established.",
        "- nothing hidden, seed 1: `-6000*rate*rate*rate`.",
    ):
        assert line in " ".join(text.split())
    page = tmp_path / "page.md"
    page.write_text(f"before\n{BEGIN}\nold\n{END}\nafter\n")
    write_section(page, records)
    assert page.read_text() == f"before\n{BEGIN}\n\n{text}\n\n{END}\nafter\n"


def test_a_campaign_without_an_answer_is_left_out() -> None:
    failed = {"kind": "struck", "hidden": "tank_seiche", "seed": 1, "failure": "no data"}
    assert section([struck(), failed]) == section([struck()])
