"""Scores of planar campaigns."""

from __future__ import annotations

from typing import Any

import pytest

from benchmarks.planar_page import effect_errors, errors_of, outcome, page, refusals


def record(hidden: str | None, form: str | None, *named: str) -> dict[str, Any]:
    estimate = {"yaw.inertia": {"value": 11.0, "standard_error": 0.5}, "sway.inertia": {"value": None},
                "surge.inertia": {"value": 7.0, "standard_error": 0.1},
                "current.direction": {"value": -3.1, "standard_error": 0.02}}  # fmt: skip
    truth = {
        "hidden": hidden, "form": form, "family": "rov", "base_exact": True, "sensors": [{"kind": "compass"}],
        "parameters": {"yaw.inertia": 10.0, "sway.inertia": 5.0, "surge.inertia": 5.0},
        "comparable": ["yaw.inertia", "sway.inertia"], "hidden_parameters": {"direction": 3.1},
        "determined": ["yaw.inertia", "sway.inertia"], "undetermined": ["surge.inertia"],
        "predicted_relative_errors": {"yaw.inertia": 0.01, "sway.inertia": 0.02, "surge.inertia": 3.0},
    }  # fmt: skip
    findings = [{"effect": name, "cannot_be_told_from": []} for name in named]
    said = {
        "fit": {"parameters": estimate, "seconds": 2.0, "failure": ""},
        "diagnose": {"verdict": "found", "findings": findings, "suspects": [], "seconds": 3.0, "failure": ""},
        "yaw": {"parameters": {"inertia": {"value": 12.0, "standard_error": 1.0}}, "seconds": 1.0, "failure": ""},
    }
    return {"seed": 1, "index": 0, "truth": truth, "said": said}


def test_errors_count_what_is_answered_and_what_is_refused() -> None:
    one = record("current", "constant")
    assert errors_of(one) == {"yaw.inertia": pytest.approx(2.0)}
    # Across the south, 0.083 rad away and not 6.2.
    assert effect_errors(one)["current.direction"] == pytest.approx(0.0832 / 0.02, rel=1e-2)
    assert refusals(one) == ([], ["surge.inertia"], ["sway.inertia"])


@pytest.mark.parametrize(
    ("hidden", "form", "named", "result"),
    [
        ("current", "constant", ("current",), "exact"),
        ("current", "constant", ("bias_torque",), "wrong"),
        ("current", "constant", ("current", "bias_torque"), "extra"),
        ("thruster_lag", "thrust", ("command_delay",), "class"),
        ("current", "constant", (), "missed"),
        (None, None, (), "clean"),
        (None, None, ("current",), "false"),
    ],
)
def test_outcomes(hidden: str | None, form: str | None, named: tuple[str, ...], result: str) -> None:
    assert outcome(record(hidden, form, *named)) == result


def test_the_page_has_each_measure() -> None:
    text = page([record("current", "constant", "current"), record(None, None)])
    assert "| error of the yaw inertia, coupled model | +10.0 %" in text
    assert "| error of the yaw inertia, yaw alone | +20.0 %" in text
    assert "| current constant | 1 | exact 1 |" in text
