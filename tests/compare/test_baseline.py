"""Parameter files, and what one held before, without any logs."""

from __future__ import annotations

from pathlib import Path

import pytest

from rovid.core.atomic_write import OutputSet
from rovid.store.history import history_output, update_parameters
from rovid.store.parameter_file import Parameters
from tests.compare.files import DRIVE, LAG, LAGGING, PLAIN, stored_at, times
from tests.conftest import Rovid
from tests.whole.test_bad_input import assert_one_message

SEEN = {"thruster_lag": 0.05}


def remembered(stored: Parameters, seen: dict[str, float] | None = None) -> None:
    update_parameters(
        stored, OutputSet([stored.output, history_output(stored.path)]), lambda _: stored, detection_limits=seen or {}
    )


def test_what_two_files_say_is_compared(rovid: Rovid, tmp_path: Path) -> None:
    stored_at(tmp_path / "spring.toml")
    stored_at(tmp_path / "autumn.toml", times(1.1, "quadratic_drag"), log="b")
    document = rovid("compare", "spring.toml", "autumn.toml", "--json").document
    assert (document["verdict"], document["changed"]) == ("changed", ["quadratic_drag"])
    drag = document["parameters"]["quadratic_drag"]
    assert abs(drag["ratio"] - 1.1) < 1e-9
    assert abs(drag["difference"]["value"] - 350.0) < 1e-6
    assert drag["standard_error"] == pytest.approx((12.0**2 + (1.1 * 12.0) ** 2) ** 0.5 / 3500.0)
    # No run is simulated where there are no logs.
    assert document["prediction"]["a_on_b"]["yaw_rate_r2"] is None
    same = rovid("compare", "spring.toml", "spring.toml", "--json").document
    assert same["verdict"] == "same"
    assert any("a.csv" in text for text in same["warnings"])


def test_what_too_little_is_known_of_is_left_open(rovid: Rovid, tmp_path: Path) -> None:
    vague = {name: (value, 0.1 * value) for name, (value, _) in PLAIN.items()}
    stored_at(tmp_path / "a.toml", vague)
    stored_at(tmp_path / "b.toml", vague, log="b")
    document = rovid("compare", "a.toml", "b.toml", "--json").document
    assert document["verdict"] == "cannot_tell"
    assert document["smallest_seen"]["inertia"] > 0.1
    assert rovid("compare", "a.toml", "b.toml", "--matters", "100", "--json").document["verdict"] == "same"


def test_a_cause_of_one_file_alone_is_not_told_to_have_come(rovid: Rovid, tmp_path: Path) -> None:
    stored_at(tmp_path / "a.toml")
    stored_at(tmp_path / "b.toml", LAGGING, log="b")
    document = rovid("compare", "a.toml", "b.toml", "--json").document
    assert document["verdict"] == "cannot_tell"
    assert document["causes"] == {"a": [], "b": ["thruster_lag"]}
    assert any("thruster_lag" in clause and "give the logs" in clause for clause in document["open"])


def test_a_cause_that_a_diagnosis_did_not_find_came(rovid: Rovid, tmp_path: Path) -> None:
    remembered(stored_at(tmp_path / "parameters.toml"), SEEN)
    remembered(stored_at(tmp_path / "parameters.toml", LAGGING, log="b"), {})
    document = rovid("compare", "--json").document
    assert (document["verdict"], document["changed"]) == ("changed", [LAG])
    assert document["causes"] == {"a": [], "b": ["thruster_lag"]}


def test_without_arguments_the_last_on_other_logs_is_a(rovid: Rovid, tmp_path: Path) -> None:
    path = tmp_path / "parameters.toml"
    for values, log in ((times(0.5, "inertia"), "old"), (PLAIN, "spring"), (times(1.2, "inertia"), "autumn")):
        remembered(stored_at(path, values, log=log))
    # The same logs once more, by other means: that is not the campaign before.
    remembered(stored_at(path, times(1.201, "inertia"), log="autumn"))
    document = rovid("compare", "--json").document
    assert document["parameters"]["inertia"]["a"]["value"] == PLAIN["inertia"][0]
    assert document["campaigns"]["a"].startswith("spring as of ")
    assert document["changed"] == ["inertia"]


def test_one_file_is_compared_with_that_at_hand(rovid: Rovid, tmp_path: Path) -> None:
    stored_at(tmp_path / "old.toml")
    stored_at(tmp_path / "parameters.toml", times(1.2, "inertia"), log="b")
    document = rovid("compare", "old.toml", "--json").document
    assert document["campaigns"] == {"a": "old.toml", "b": "parameters.toml"}
    assert document["changed"] == ["inertia"]


@pytest.mark.parametrize("write", [False, True])
def test_without_a_history_it_says_what_to_give(write: bool, rovid: Rovid, tmp_path: Path) -> None:
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
def test_a_damaged_history_is_told(content: str, words: list[str], rovid: Rovid, tmp_path: Path) -> None:
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
