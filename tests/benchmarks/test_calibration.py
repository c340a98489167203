"""Calibration: what is drawn is what its seed says, and the page counts rightly."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.calibration import NOTHING, drawn, told
from benchmarks.calibration_page import group_of, odds_of, readings_of, write_page


@pytest.mark.slow
def test_a_campaign_is_the_same_whenever_it_is_drawn(tmp_path: Path) -> None:
    first, second = (drawn(3, 5, tmp_path / name) for name in ("a", "b"))
    assert first == second == drawn(3, 5, None)
    files = sorted(path.name for path in (tmp_path / "a").iterdir())
    assert "rovid.toml" in files
    assert all((tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes() for name in files)


def test_priors_are_those_that_the_page_states() -> None:
    campaigns = [drawn(1, number, None) for number in range(400)]
    hidden = [one.hidden for one in campaigns]
    assert abs(hidden.count(None) / 400 - NOTHING) < 0.07
    assert len(set(hidden)) > 20
    inertia = np.log([one.parameters["inertia"] for one in campaigns if one.vehicle.startswith("ROSUB")])
    assert abs(inertia.mean() - np.log(5057.0)) < 0.06
    assert abs(inertia.std() - 0.2) < 0.04
    assert all(np.isfinite(size) for one in campaigns for size in one.parameters.values())
    lags = [one.parameters["thruster_lag.time_constant"] for one in campaigns if one.hidden == "thruster_lag"]
    assert min(lags) > 0.7 * 0.03
    assert max(lags) < 1.3 * 0.6


def record(number: int, deviation: float, *, hidden: str | None = None, named: str | None = None) -> dict[str, Any]:
    """A campaign in which everything is off by so many standard errors."""

    def said(name: str) -> dict[str, Any]:
        value = truth[name] - deviation
        return {"value": value, "standard_error": 1.0, "interval_95": [value - 1.959964, value + 1.959964]}

    truth = {"inertia": 100.0, "quadratic_drag": 100.0, "linear_drag": 100.0, "thruster_lag.time_constant": 50.0}
    findings: list[dict[str, Any]] = []
    if named:
        parameters = {"time_constant": said("thruster_lag.time_constant")}
        findings = [
            {"effect": named, "form": None, "parameters": parameters, "confidence": 0.97, "cannot_be_told_from": []}
        ]
    plain = {"parameters": {name: said(name) for name in ("inertia", "quadratic_drag", "linear_drag")}}
    diagnosis = {"verdict": "found", "findings": findings, "suspects": [], "base": plain, "extended": None}
    kept = {"diagnosis": diagnosis, "error": None, "took": 3.0, "rovid": "0.3.0"}
    return told({"number": number, "hidden": hidden, "parameters": truth}, kept)


def test_coverage_is_counted_by_what_was_hidden_and_named(tmp_path: Path) -> None:
    deviations = np.random.default_rng(2).normal(size=1500)
    records = [record(k, float(one)) for k, one in enumerate(deviations)]
    records += [record(2000 + k, 3.0, hidden="thruster_lag") for k in range(10)]
    records += [record(3000 + k, 0.5, hidden="thruster_lag", named="thruster_lag") for k in range(10)]
    assert [group_of(one) for one in records[-11:-9]] == ["cause not named", "cause named"]
    assert {one["group"] for one in readings_of(records[-1])} == {"cause named", "size"}
    assert list(odds_of(records[-1])) == [(0.97, True)]
    assert list(odds_of(record(0, 0.0, hidden=None, named="thruster_lag"))) == [(0.97, False)]
    text = write_page(records, tmp_path / "calibration.md", 2)
    assert (tmp_path / "calibration.md").read_text(encoding="utf-8") == f"{text}\n"
    assert (tmp_path / "pictures" / "calibration_ranks.png").exists()
    rows = {line.split("|")[1].strip(): line.split("|")[2:-1] for line in text.splitlines() if line.startswith("| ")}
    number, *shares = rows["nothing hidden: inertia"]
    assert int(number) == 1500
    for share, level in zip(shares, (50.0, 80.0, 95.0), strict=True):
        assert abs(float(share.split()[0]) - level) < 3.5
    assert rows["cause not named: inertia"][3].split()[0] == "0.0"
    assert rows["**a cause's size**, cause named"][1].split()[0] == "100.0"
    assert "without a hidden cause 0 have a false finding" in " ".join(text.split())
