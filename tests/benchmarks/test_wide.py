"""Scores of wide campaigns, and the section of the page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from benchmarks.wide import read_state
from benchmarks.wide_page import BEGIN, END, line_of, marked_section, section, write_section
from benchmarks.wide_scores import CLASSES, LAWS, OUTCOMES, OUTCOMES_NOTHING, score
from tools.wide import FORMS, draw, truth_of


def finding(effect: str, *others: str, **parameters: tuple[float, float]) -> dict[str, Any]:
    return {
        "effect": effect, "form": None, "confidence": 0.97, "cannot_be_told_from": list(others),
        "parameters": {name: {"value": v, "standard_error": e} for name, (v, e) in parameters.items()},
    }  # fmt: skip


def record(truth: dict[str, Any], verdict: str, *findings: Any, suspects: tuple[Any, ...] = ()) -> dict[str, Any]:
    base = {name: {"value": 1.1 * truth[name], "standard_error": 0.05 * truth[name]} for name in truth["comparable"]}
    said = {
        "verdict": verdict, "findings": list(findings), "suspects": list(suspects), "base": {"parameters": base},
        "extended": None, "seconds": 3.0, "failure": "",
    }  # fmt: skip
    return {"seed": truth["seed"], "index": truth["index"], "truth": truth, "said": {"diagnose": said}}


@pytest.fixture(scope="module")
def lag() -> dict[str, Any]:
    return truth_of(draw(3, 2, "thruster_lag", "torque")) | {"left": 0.1, "evidence": 300.0}


@pytest.fixture(scope="module")
def nothing() -> dict[str, Any]:
    return truth_of(draw(3, 2, "none")) | {"left": 0.0, "evidence": 0.0}


def test_outcomes_with_a_cause(lag: dict[str, Any]) -> None:
    right, wrong = finding("thruster_lag"), finding("tank_seiche")
    expected = {
        "exact": record(lag, "found", right),
        "class": record(lag, "found", finding("command_delay", "thruster_lag")),
        "suspect first": record(lag, "suspected", suspects=(right, wrong)),
        "extra": record(lag, "found", right, wrong),
        "wrong": record(lag, "found", wrong),
        "unexplained": record(lag, "unexplained"),
        "missed": record(lag, "suspected", suspects=(wrong, right)),
        "no answer": record(lag, "bad_logs"),
    }
    assert {name: score(one)["outcome"] for name, one in expected.items()} == {name: name for name in OUTCOMES}
    assert score(record(lag, "found", finding("thruster_lag", "slew_limit")))["outcome"] == "class"
    assert score(expected["extra"])["false"] == ["tank_seiche"]
    or_clocks = record(lag, "suspected", suspects=(finding("thruster_lag", "clocks_apart"), wrong))
    assert score(or_clocks)["outcome"] == "class"


def test_a_class_holds_for_its_law_alone(lag: dict[str, Any]) -> None:
    delay = finding("command_delay")
    assert score(record(lag, "found", delay))["outcome"] == "wrong"
    assert score(record(lag | {"form": "series"}, "found", delay))["outcome"] == "class"
    for effect, form in (*CLASSES, *LAWS):
        assert form in FORMS[effect]


def test_outcomes_without_a_cause(nothing: dict[str, Any]) -> None:
    some = finding("tank_seiche")
    expected = {
        "clean": record(nothing, "nothing_found"),
        "suspects": record(nothing, "suspected", suspects=(some,)),
        "unexplained": record(nothing, "unexplained"),
        "false": record(nothing, "found", some),
        "no answer": record(nothing, "too_little_data"),
    }
    assert {name: score(one)["outcome"] for name, one in expected.items()} == {name: name for name in OUTCOMES_NOTHING}


def test_errors_count_in_standard_errors(lag: dict[str, Any]) -> None:
    true = lag["parameters"]["time_constant"]
    result = score(record(lag, "found", finding("thruster_lag", time_constant=(1.3 * true, 0.1 * true))))
    assert result["effect_z"]["time_constant"] == pytest.approx(3.0)
    assert result["z"]["inertia"] == pytest.approx(2.0)
    assert score(record(lag, "found", finding("thruster_lag", time_constant=(true, 0.0))))["effect_z"] == {}


def test_the_section_takes_its_place_and_no_more(tmp_path: Path, lag: dict[str, Any], nothing: dict[str, Any]) -> None:
    page = tmp_path / "page.md"
    page.write_text("# Page\n\ntext\n", encoding="utf-8")
    records = [record(lag, "found", finding("tank_seiche")), record(nothing, "nothing_found")]
    for _ in range(2):
        write_section(page, records)
    text = page.read_text(encoding="utf-8")
    assert text.startswith("# Page\n\ntext\n")
    assert (text.count(BEGIN), text.count(END), text.count("## Wide campaigns\n")) == (1, 1, 1)
    assert f"`{lag['seed']} {lag['index']}` thruster_lag, torque" in text  # the failure, by its name
    assert marked_section(page) in text
    assert "1 (100 %)" in section(records)
    assert "wrong" in line_of(records[0])


def test_a_state_that_was_cut_short_is_read(tmp_path: Path) -> None:
    state = tmp_path / "state.jsonl"
    state.write_text('{"seed": 1, "index": 0, "n": 1}\n{"seed": 1, "index": 0, "n": 2}\n{"seed": 1, "ind', "utf-8")
    assert read_state(state) == [{"seed": 1, "index": 0, "n": 2}]
    assert read_state(None) == []
