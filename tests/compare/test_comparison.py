"""Comparison on the command line: hidden changes are found, and no others."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from rovid.compare.campaign_fit import CampaignFit, campaign_from_study, with_diagnosis
from rovid.compare.comparison import compare
from rovid.diagnose.result import Diagnosis
from rovid.store.study import open_study
from tests.compare.conftest import VEHICLE, WEAK, Write, more_drag
from tests.conftest import Done, Rovid, run_rovid
from tests.whole.test_bad_input import assert_one_message
from tools.truth import Thruster

BASE = ("inertia", "quadratic_drag", "linear_drag")


@pytest.fixture(scope="module")
def compared(before: Path, lagging: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Done, Path]:
    page = tmp_path_factory.mktemp("page") / "both.html"
    return run_rovid("compare", before, lagging, "-o", page, "--json"), page


@pytest.mark.slow
def test_only_a_new_lag_is_named(compared: tuple[Done, Path]) -> None:
    document = compared[0].document
    assert document["schema"] == "rovid-comparison/1"
    assert document["verdict"] == "changed"
    assert document["changed"] == ["thruster_lag.time_constant"]
    assert document["causes"] == {"a": [], "b": ["thruster_lag"]}
    lag = document["parameters"]["thruster_lag.time_constant"]
    assert abs(lag["b"]["value"] - 0.5) < 4.0 * lag["b"]["standard_error"]
    assert lag["confidence"] >= 0.95
    assert lag["ratio"] is None  # no ratio to zero
    for name in BASE:
        told = document["parameters"][name]
        assert set(told) >= {"a", "b", "ratio", "standard_error", "confidence"}
        assert set(told["a"]) == {"value", "standard_error", "unit"}
        assert abs(told["ratio"] - 1.0) < 4.0 * told["standard_error"]
        assert told["confidence"] < 0.2
        sharpest = min(told["a"]["standard_error"], told["b"]["standard_error"])
        assert told["together"]["a"]["standard_error"] < sharpest


def cut(campaign: CampaignFit) -> Diagnosis:
    diagnosed = with_diagnosis(campaign, lambda _: None, 1e-6).diagnosis
    assert diagnosed is not None
    return diagnosed


def test_a_diagnosis_cut_short_leaves_the_question_open(before: Path, write: Write) -> None:
    sides = [campaign_from_study(open_study([path]), path.name) for path in (before, write("again", seed=3))]
    # No time at all: causes that both models lack may have changed.
    found = compare(sides[0], sides[1], budget=1e-6)
    assert found.verdict == "cannot_tell"
    assert any("ended at the limit of its time (give a larger --budget)" in one for one in found.open_questions)
    # Where more time does not help, none is asked for.
    endless = [replace(one, diagnosis=replace(cut(one), is_endless=True)) for one in sides]
    clauses = compare(*endless).open_questions
    assert any("as each addition asked for another, before every cause was tried" in one for one in clauses)
    assert not any("--budget" in one for one in clauses)


def test_the_model_of_one_campaign_does_not_predict_the_other(compared: tuple[Done, Path]) -> None:
    made = compared[0].document["prediction"]
    assert set(made) == {"a_on_a", "a_on_b", "b_on_a", "b_on_b"}
    for other, own in (("a_on_b", "b_on_b"), ("b_on_a", "a_on_a")):
        assert made[other]["yaw_rate_r2"] < made[own]["yaw_rate_r2"]
        assert made[other]["heading_error_10s"] > 2.0 * made[own]["heading_error_10s"]


def test_the_page_shows_the_result_and_is_self_contained(compared: tuple[Done, Path]) -> None:
    done, page = compared
    text = page.read_text(encoding="utf-8")
    assert done.document["page"] == str(page)
    assert "thruster lag, which is new" in text
    assert text.count("<svg") == 4  # ratios, drag, the worst run of either
    assert not re.search(r"""(?:src|href)\s*=\s*["'](?!data:|#)""", text)
    assert "<script" not in text


def test_only_its_own_page_is_replaced(compared: tuple[Done, Path], before: Path, lagging: Path, here: Path) -> None:
    del here
    _, page = compared
    foreign = page.with_name("mine.html")
    foreign.write_text("mine")
    done = run_rovid("compare", before, lagging, "-o", foreign)
    assert_one_message(done, "mine.html", "already exists", "--force")
    assert foreign.read_text() == "mine"
    log = next(before.glob("*.csv"))
    assert_one_message(
        run_rovid("compare", before, lagging, "-o", log, "--force"), log.name, "is an input of this command"
    )


@pytest.mark.slow
@pytest.mark.parametrize("seed", [10, 20])
def test_hidden_changes(write: Write, before: Path, seed: int, rovid: Rovid) -> None:
    cases = {
        "drag": (more_drag(VEHICLE), {"quadratic_drag", "linear_drag"}),
        "weak": (replace(VEHICLE, hidden=(WEAK,)), {"thruster_imbalance:fore.gain"}),
        "as it was": (VEHICLE, set[str]()),
    }
    for at, (name, (truth, wanted)) in enumerate(cases.items()):
        document = rovid("compare", before, write(name, truth, seed=seed + at), "--json").document
        assert document["verdict"] == ("changed" if wanted else "same"), name
        assert set(document["changed"]) <= wanted, name
        assert bool(document["changed"]) == bool(wanted), name


def test_two_thruster_layouts_are_refused(write: Write, before: Path, rovid: Rovid) -> None:
    three = replace(VEHICLE, thrusters=(*VEHICLE.thrusters, Thruster(name="bow", arm=0.2)))
    assert_one_message(
        rovid("compare", before, write("three", three, seed=3)), "bow", "different thrusters cannot be compared"
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere", "nowhere_else"], ["nowhere", "there is no such file or folder"]),
        (["a", "b", "c"], ["3 campaigns were given"]),
        ([], ["parameters.toml", "there is no such parameter file"]),
        (["broken.toml", "nowhere"], ["broken.toml", "not valid TOML"]),
    ],
)
def test_bad_input_is_one_message(arguments: list[str], words: list[str], rovid: Rovid) -> None:
    Path("broken.toml").write_text("schema = ")
    assert_one_message(rovid("compare", *arguments), *words)
