"""Comparisons of parameters of the coupled model."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from rovid.compare.comparison import PlanarCampaign, compare_planar
from rovid.diagnose.result import Finding
from rovid.effects import effect_named
from rovid.present.documents.diagnosis import planar_comparison_document
from rovid.store.load import read_parameters
from rovid.store.parameter_file import Entry, Parameters
from rovid.trial.axis import PLANAR


def campaign(inertia: float, direction: float = 0.0) -> PlanarCampaign:
    values = {"surge.inertia": (inertia, "kg"), "current.speed": (0.2, "m/s"), "current.direction": (direction, "rad")}
    entries = {
        name: Entry(value=value, standard_error=0.01 * abs(value) + 0.001, unit=unit, method="test")
        for name, (value, unit) in values.items()
    }
    return PlanarCampaign(name="day", parameters=Parameters(path=Path("p.toml"), axis=PLANAR, entries=entries))


def missing(inertia: float) -> PlanarCampaign:
    one = campaign(inertia)
    return replace(one, parameters=replace(one.parameters, missing="the model misses something (R^2: sway 0.72)"))


def suspecting(inertia: float, probability: float) -> PlanarCampaign:
    suspect: Any = SimpleNamespace(effect=effect_named("current"), probability=probability)
    return replace(campaign(inertia), suspects=(cast("Finding", suspect),))


def test_a_change_is_established_by_models_that_explain_their_logs() -> None:
    comparison = compare_planar(campaign(100.0), campaign(70.0), relevant_change=0.1)
    assert (comparison.verdict, comparison.changed) == ("changed", ["surge.inertia"])
    assert comparison.open_questions == []


@pytest.mark.parametrize(
    ("other", "words"), [(missing(70.0), "sway 0.72"), (suspecting(70.0, 0.8), "suspects current")]
)
def test_what_a_model_misses_establishes_no_change(other: PlanarCampaign, words: str) -> None:
    for pair in ((campaign(100.0), other), (other, campaign(100.0))):
        comparison = compare_planar(*pair, relevant_change=0.1)
        assert (comparison.verdict, comparison.changed) == ("cannot_tell", [])
        (clause,) = comparison.open_questions
        assert words in clause


def test_an_improbable_suspect_is_no_doubt() -> None:
    assert compare_planar(campaign(100.0), suspecting(70.0, 0.3), relevant_change=0.1).verdict == "changed"


def test_directions_have_a_difference() -> None:
    comparison = compare_planar(campaign(100.0, 3.0), campaign(100.0, -3.0), relevant_change=0.1)
    change = next(one for one in comparison.changes if one.name == "current.direction")
    assert change.difference == pytest.approx(2.0 * math.pi - 6.0)
    assert math.isnan(change.ratio)
    assert not change.changed  # A current is of the day.
    document = planar_comparison_document(comparison, [])["parameters"]["current.direction"]
    assert document["ratio"] is None
    assert document["difference"] == pytest.approx(2.0 * math.pi - 6.0)


def test_a_file_keeps_what_its_model_misses(tmp_path: Path) -> None:
    path = tmp_path / "parameters_planar.toml"
    path.write_text(replace(missing(70.0).parameters, path=path).text())
    assert "sway 0.72" in read_parameters(path).missing
