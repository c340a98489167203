"""`rovid control` from the command line."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.conftest import SAMPLES, Rovid


def test_control_of_the_papers_tables(rovid: Rovid) -> None:
    assert rovid("fit-drag", SAMPLES / "rosub_paper").code == 0
    assert rovid("fit-inertia").code == 0
    document = rovid("control", "--kp", "100", "--kd", "710", "--json").document
    assert document["schema"] == "rovid-control/1"
    assert document["gains"] == {"kp": 100.0, "kd": 710.0}
    assert document["torque_limits"] == [None, None]
    assert set(document["margins"]) == {"gain_db", "phase_deg", "delay_s"}
    names = [run["name"] for run in document["runs"]]
    assert names[:2] == ["90 to 200 deg"] * 2
    assert {run["model_aid"] for run in document["runs"]} == {True, False}
    first = document["runs"][0]
    assert {
        *("name", "effects", "model_aid", "time_constant", "rise_time", "settling_time", "overshoot_deg"),
        *("steady_error_deg", "limit_cycle"),
    } <= set(first)
    assert first["effects"] == []
    assert first["time_constant"] == pytest.approx(11.5, abs=1.0)
    printed = rovid("control", "--kp", "100", "--kd", "710")
    assert printed.code == 0
    assert "without limit" in printed.out


@pytest.mark.slow
def test_control_of_a_trial_day_writes_its_source(rovid: Rovid, csv_day: Path, tmp_path: Path) -> None:
    assert rovid("fit-drag", csv_day).code == 0
    assert rovid("fit-inertia").code == 0
    done = rovid("control", "--step", "350:10", "--c", "out.c", "--python", "out.py", "--json").document
    assert done["damping_ratio"] == pytest.approx(0.7)
    assert done["margins"]["phase_deg"] >= 45.0
    turn = next(run for run in done["runs"] if run["name"] == "350 to 10 deg")
    assert turn["steady_error_deg"] < 0.6
    assert turn["overshoot_deg"] < 5.0  # it goes through north, not around
    assert "rovid_control_step" in (tmp_path / "out.c").read_text()
    compile((tmp_path / "out.py").read_text(), "out.py", "exec")
    for law, gain in (("ardusub", "ATC_RAT_YAW_P"), ("ardurover", "ATC_STR_RAT_P"), ("px4", "UUV_YAW_D")):
        tuned = rovid("control", "--law", law, "--json").document
        assert tuned["law"] == law
        assert tuned["autopilot_parameters"][gain] > 0.0
        assert tuned["damping_ratio"] == pytest.approx(0.7, abs=0.01)  # gains of four digits
        assert tuned["margins"]["phase_deg"] >= 45.0
        assert tuned["runs"] == []
    given = rovid("control", "--law", "px4", "--kp", "100", "--kd", "710", "--json").document
    assert given["gains"] == pytest.approx({"kp": 100.0, "kd": 710.0}, rel=1e-3)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("--kp", "100"), "--kp: needs the other gain"),
        (("--kp", "-1", "--kd", "5"), "--kp: is -1"),
        (("--kp", "100", "--kd", "5", "--bandwidth", "1"), "--bandwidth"),
        (("--step", "20-120"), "--step"),
        (("--step", "0:inf"), "--step"),
        (("--period", "0"), "--period"),
        (("--law", "ardu"), "ardusub"),
        (("--law", "px4", "--step", "0:20"), "--step"),
        (("--law", "px4", "--python", "out.py"), "model-aided law alone"),
        (("--law", "px4"), "without thrusters"),
        (("--delay", "nan"), "--delay"),
        (("--delay", "90"), "the delay of the loop is too long"),
    ],
)
def test_bad_numbers_end_with_one_message(rovid: Rovid, arguments: tuple[str, ...], complaint: str) -> None:
    assert rovid("fit-drag", SAMPLES / "rosub_paper").code == 0
    assert rovid("fit-inertia").code == 0
    done = rovid("control", *arguments)
    assert done.code == 2
    assert complaint in done.err
    assert "Traceback" not in done.err


def test_control_without_parameters_says_what_to_run(rovid: Rovid) -> None:
    done = rovid("control")
    assert done.code == 2
    assert "fit-drag" in done.err
