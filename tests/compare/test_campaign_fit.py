"""Campaigns of a comparison: shared causes, parameter files and their history."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from unittest import mock

import numpy as np
import pytest

from rovid.compare import campaign_fit
from rovid.compare.campaign_fit import (
    CampaignFit,
    campaign_from_parameters,
    campaign_from_study,
    shared_effects,
    shared_estimate,
)
from rovid.core.errors import DataError
from rovid.core.output_files import OutputSet
from rovid.diagnose.cross_validation import HeldOutScores
from rovid.diagnose.result import Diagnosis, Finding, ModelAssessment
from rovid.effects import effect_named
from rovid.estimate.estimate import Estimate
from rovid.estimate.multi_step import MultiStepLikelihood
from rovid.model.model import Model
from rovid.store.load import history_output, update_parameters
from rovid.store.parameter_file import Parameters
from rovid.store.study import open_study
from tests.compare.files import DRIVE, LAG, LAGGING, PLAIN, stored_at, times
from tests.conftest import SAMPLES, Rovid
from tests.whole.test_bad_input import assert_one_message

NOTHING = Estimate(names=(), values=np.zeros(0), covariance=np.zeros((0, 0)), method="", samples=0)


def finding(key: str, worth: float, confidence: float = 0.97) -> Finding:
    return Finding(
        effect=effect_named(key),
        estimate=NOTHING,
        gain=worth,
        bic_gain=worth,
        held_out_gain=worth,
        standard_errors=worth,
        probability=confidence,
        alternatives=(),
        indistinguishable=(),
    )


@pytest.fixture(scope="module")
def plain(before: Path) -> CampaignFit:
    return campaign_from_study(open_study([before]), "before")


def found(day: CampaignFit, *findings: Finding, suspects: tuple[Finding, ...] = ()) -> CampaignFit:
    return replace(day, diagnosis=Diagnosis(verdict="found", findings=findings, suspects=suspects))


def test_both_models_get_the_causes_of_either_in_one_form(plain: CampaignFit) -> None:
    a = found(plain, finding("thruster_lag", 50.0), finding("bias_torque", 20.0))
    b = found(plain, finding("thruster_lag:rotor", 80.0), suspects=(finding("thrust_asymmetry", 9.0, 0.6),))
    assert [effect.key for effect in shared_effects(a, b)] == ["thruster_lag:rotor", "bias_torque", "thrust_asymmetry"]


def test_unlikely_and_single_trial_causes_are_not_shared(plain: CampaignFit) -> None:
    a = found(plain, finding("supply_sag:trial sine.csv", 30.0), suspects=(finding("drag_curvature", 4.0, 0.3),))
    assert shared_effects(a, found(plain)) == []


def test_one_thruster_keeps_its_gain(plain: CampaignFit) -> None:
    a = found(plain, finding("thruster_imbalance:fore", 50.0))
    b = found(plain, finding("thruster_imbalance:aft", 60.0))
    assert [effect.key for effect in shared_effects(a, b)] == ["thruster_imbalance:aft"]


def test_causes_with_missing_signals_are_left_out(plain: CampaignFit) -> None:
    needs = next(key for key in ("speed_dependent_damping", "sideslip_moment") if effect_named(key).needs)
    assert shared_effects(found(plain, finding(needs, 50.0)), found(plain)) == []


def test_logs_keep_the_figures_of_a_diagnosis_with_the_same_model(plain: CampaignFit) -> None:
    """A new fit by predictions would have other weights."""
    bias = effect_named("bias_torque")
    held = HeldOutScores(log_likelihood=0.0, rate_r2=1.0, rate_rmse=0.0, rate_squares=np.zeros(0), position_errors={})
    names = ("inertia", "quadratic_drag", "linear_drag", "bias_torque.torque")
    values = np.array([1.0, 2.0, 3.0, 4.0])
    method = MultiStepLikelihood.method
    estimate = Estimate(names=names, values=values, covariance=np.diag(values), method=method, samples=9)
    model = Model(inertia=1.0, quadratic_drag=2.0, linear_drag=3.0, effects=(bias,), effect_values=(4.0,))
    extended = ModelAssessment(model=model, estimate=estimate, held_out=held)
    diagnosis = Diagnosis(verdict="found", findings=(finding(bias.key, 9.0),), extended=extended)
    said = shared_estimate(replace(plain, diagnosis=diagnosis), [bias])
    assert (said.names, said.values.tolist(), said.white) == (names, values.tolist(), False)
    # The errors of a diagnosis with suspects include what these would change. Only the criterion is kept.
    doubted = replace(diagnosis, suspects=(finding("thruster_lag", 3.0, 0.3),))
    with mock.patch.object(campaign_fit, "fit_likelihood", side_effect=DataError("a fit")) as fit:
        with pytest.raises(DataError, match="a fit"):
            shared_estimate(replace(plain, diagnosis=doubted), [bias])
        assert fit.call_args.kwargs == {"by_predictions": True}


def test_a_file_gives_its_stored_values(tmp_path: Path) -> None:
    day = campaign_from_parameters(stored_at(tmp_path / "p.toml", LAGGING), "p")
    said = shared_estimate(day, day.found_effects)
    assert said.names == tuple(LAGGING)
    assert np.allclose(np.sqrt(np.diag(said.covariance)), [error for _, error in LAGGING.values()])
    assert not said.white  # unknown for a file


def test_a_cause_not_found_is_zero_within_its_detection_limit(tmp_path: Path) -> None:
    day = campaign_from_parameters(stored_at(tmp_path / "p.toml", PLAIN), "p", {"thruster_lag": 0.05})
    said = shared_estimate(day, [effect_named("thruster_lag")])
    assert said.names[-1] == "thruster_lag.time_constant"
    assert said.values[-1] == 0.0
    assert 0.0 < said.covariance[-1, -1] ** 0.5 < 0.05


def test_tables_are_refused() -> None:
    with pytest.raises(DataError, match="tables"):
        campaign_from_study(open_study([SAMPLES / "rosub_paper"]), "paper")


SEEN = {"thruster_lag": 0.05}


def remembered(stored: Parameters, seen: dict[str, float] | None = None) -> None:
    update_parameters(
        stored, OutputSet([stored.output, history_output(stored.path)]), lambda _: stored, detection_limits=seen or {}
    )


def test_two_files_are_compared(rovid: Rovid, tmp_path: Path) -> None:
    stored_at(tmp_path / "spring.toml")
    stored_at(tmp_path / "autumn.toml", times(1.1, "quadratic_drag"), log="b")
    document = rovid("compare", "spring.toml", "autumn.toml", "--json").document
    assert (document["verdict"], document["changed"]) == ("changed", ["quadratic_drag"])
    drag = document["parameters"]["quadratic_drag"]
    assert abs(drag["ratio"] - 1.1) < 1e-9
    assert abs(drag["difference"]["value"] - 350.0) < 1e-6
    assert drag["standard_error"] == pytest.approx((12.0**2 + (1.1 * 12.0) ** 2) ** 0.5 / 3500.0)
    # Without logs no run is simulated.
    assert document["prediction"]["a_on_b"]["yaw_rate_r2"] is None
    same = rovid("compare", "spring.toml", "spring.toml", "--json").document
    assert same["verdict"] == "same"
    assert any("a.csv" in text for text in same["warnings"])
    # Two models of the same logs differ without a change of the vehicle.
    stored_at(tmp_path / "other_model.toml", times(1.1, "quadratic_drag"))
    models = rovid("compare", "spring.toml", "other_model.toml", "--json").document
    assert (models["verdict"], models["changed"]) == ("cannot_tell", [])
    assert "the same logs" in models["open"][0]


def test_imprecise_parameters_leave_the_question_open(rovid: Rovid, tmp_path: Path) -> None:
    vague = {name: (value, 0.1 * value) for name, (value, _) in PLAIN.items()}
    stored_at(tmp_path / "a.toml", vague)
    stored_at(tmp_path / "b.toml", vague, log="b")
    document = rovid("compare", "a.toml", "b.toml", "--json").document
    assert document["verdict"] == "cannot_tell"
    assert document["smallest_seen"]["inertia"] > 0.1
    assert rovid("compare", "a.toml", "b.toml", "--matters", "100", "--json").document["verdict"] == "same"


def test_a_cause_in_only_one_file_is_not_called_a_change(rovid: Rovid, tmp_path: Path) -> None:
    stored_at(tmp_path / "a.toml")
    stored_at(tmp_path / "b.toml", LAGGING, log="b")
    document = rovid("compare", "a.toml", "b.toml", "--json").document
    assert document["verdict"] == "cannot_tell"
    assert document["causes"] == {"a": [], "b": ["thruster_lag"]}
    assert any("thruster_lag" in clause and "give the logs" in clause for clause in document["open"])


def test_a_cause_not_found_by_an_earlier_diagnosis_is_a_change(rovid: Rovid, tmp_path: Path) -> None:
    remembered(stored_at(tmp_path / "parameters.toml"), SEEN)
    remembered(stored_at(tmp_path / "parameters.toml", LAGGING, log="b"), {})
    document = rovid("compare", "--json").document
    assert (document["verdict"], document["changed"]) == ("changed", [LAG])
    assert document["causes"] == {"a": [], "b": ["thruster_lag"]}


def test_without_arguments_a_is_the_last_model_of_other_logs(rovid: Rovid, tmp_path: Path) -> None:
    path = tmp_path / "parameters.toml"
    for values, log in ((times(0.5, "inertia"), "old"), (PLAIN, "spring"), (times(1.2, "inertia"), "autumn")):
        remembered(stored_at(path, values, log=log))
    # Another fit of the same logs is not the previous campaign.
    remembered(stored_at(path, times(1.201, "inertia"), log="autumn"))
    document = rovid("compare", "--json").document
    assert document["parameters"]["inertia"]["a"]["value"] == PLAIN["inertia"][0]
    assert document["campaigns"]["a"].startswith("spring as of ")
    assert document["changed"] == ["inertia"]


def test_one_file_is_compared_with_the_current_one(rovid: Rovid, tmp_path: Path) -> None:
    stored_at(tmp_path / "old.toml")
    stored_at(tmp_path / "parameters.toml", times(1.2, "inertia"), log="b")
    document = rovid("compare", "old.toml", "--json").document
    assert document["campaigns"] == {"a": "old.toml", "b": "parameters.toml"}
    assert document["changed"] == ["inertia"]


@pytest.mark.parametrize("write", [False, True])
def test_a_missing_history_gives_advice(write: bool, rovid: Rovid, tmp_path: Path) -> None:
    stored = stored_at(tmp_path / "parameters.toml")
    if write:
        remembered(stored)
    assert_one_message(rovid("compare"), "parameters.history", "Give A and B")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("mine\n", ["is not a history", "Move it away"]),
        ('{"schema": "rovid-history/1"}\n{"schema": \n', ["parameters.history:2", "is damaged"]),
        ('{"schema": "rovid-history/1"}\n{"schema": "rovid-parameters/1"}\n', ["parameters.history:2", "is damaged"]),
        ('{"schema": "rovid-history/1"}\n[1]\n', ["parameters.history:2", "is damaged"]),
    ],
)
def test_a_damaged_history_is_an_error(content: str, words: list[str], rovid: Rovid, tmp_path: Path) -> None:
    stored_at(tmp_path / "parameters.toml")
    (tmp_path / "parameters.history").write_text(content)
    assert_one_message(rovid("compare"), *words)


def test_files_that_cannot_be_compared_are_refused(rovid: Rovid, tmp_path: Path) -> None:
    stored_at(tmp_path / "a.toml")
    stored_at(tmp_path / "drag.toml", {"linear_drag": (130.0, 3.0)})
    assert_one_message(rovid("compare", "a.toml", "drag.toml"), "drag.toml", "no inertia or no drag")
    other = {"yaw_arm of bow": "0.2", "curve of bow": "sha256 0"}
    stored_at(tmp_path / "bow.toml", drive=other)
    assert_one_message(rovid("compare", "a.toml", "bow.toml"), "aft, fore", "bow", "different thrusters")


def test_another_arm_is_a_warning(rovid: Rovid, tmp_path: Path) -> None:
    stored_at(tmp_path / "a.toml")
    stored_at(tmp_path / "b.toml", drive={**DRIVE, "yaw_arm of fore": "0.5"}, log="b")
    warnings = rovid("compare", "a.toml", "b.toml", "--json").document["warnings"]
    assert any("yaw_arm of fore was 0.43 and is 0.5" in text for text in warnings)
