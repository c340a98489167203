"""Facts and problems of logs, and advice before a fit."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from rovid.core.errors import DataError
from rovid.preflight.check import check_logs, drag_without_feedback
from rovid.present.terminal.check import check_notes, check_tasks
from rovid.store.study import open_study
from rovid.trial.axis import AXES
from rovid.trial.config import Config, load_config
from tests.conftest import SAMPLES, Rovid

TANK = SAMPLES / "rosub_tank"


def config(folder: Path, *logs: str) -> Config:
    for name in ("rovid.toml", "thrust_curve.csv", *logs):
        shutil.copy(TANK / name, folder)
    return load_config(folder / "rovid.toml")


def test_holds_sines_and_samples_are_counted(tmp_path: Path) -> None:
    found = check_logs([tmp_path], config(tmp_path, "hold_03.csv", "sine_20s.mcap"))
    facts = {trial.name: row for trial, row in zip(found.trials, found.facts, strict=True)}
    assert not found.problems
    hold, sine = facts["hold_03.csv"], facts["sine_20s.mcap"]
    assert (hold["held_commands"], hold["sine_runs"]) == (3, 0)
    assert (sine["held_commands"], sine["sine_runs"]) == (0, 1)
    assert hold["sample_rate"] == pytest.approx(20.0, rel=0.01)
    assert hold["samples"] == pytest.approx(20.0 * hold["duration"], rel=0.01)
    low, high = sine["torque_range"]
    assert low < 0.0 < high


def test_sines_of_the_requested_length_are_not_requested_again(tmp_path: Path) -> None:
    """Logs that begin and end with the sine show the torque turn positive after one cycle, and before the last one."""
    settings = config(tmp_path, "hold_03.csv", "sine_40s_a.csv", "sine_80s.csv")
    for name, period in (("sine_40s_a.csv", 40.0), ("sine_80s.csv", 80.0)):
        log = pd.read_csv(tmp_path / name)
        begin = log["time_s"][log["fore_V"].abs() > 0.1].min()
        during = (log["time_s"] >= begin) & (log["time_s"] < begin + 5.0 * period)
        log[during].to_csv(tmp_path / name, index=False)
    assert "sines" not in {one.kind for one in check_logs([tmp_path], settings).advice}


def test_sines_with_lost_rows_are_not_requested_again(tmp_path: Path) -> None:
    """Lost rows cut a sine in pieces."""
    settings, rng = config(tmp_path, "hold_03.csv", "sine_40s_a.csv", "sine_80s.csv"), np.random.default_rng(2)
    for name in ("sine_40s_a.csv", "sine_80s.csv"):
        log = pd.read_csv(tmp_path / name)
        log[rng.random(len(log)) > 0.12].to_csv(tmp_path / name, index=False)
    found = check_logs([tmp_path], settings)
    assert {fault.fault for fault in found.faults} == {"lost_rows"}
    assert "sines" not in {one.kind for one in found.advice}


def heading_hold(seed: int) -> str:
    """CSV text of 60 s of a heading hold by thrust commands within 0.5 of the curve of the tank, in gusts."""
    rng, step, inertia = np.random.default_rng(seed), 0.05, 5000.0
    heading, rate, gust, rows = 0.0, 0.0, 0.0, ["time_s,heading_deg,fore_V,aft_V,roll_deg,pitch_deg,supply_V"]
    for number in range(1200):
        command = np.clip(-8.0 * heading - 25.0 * rate + rng.normal(0.0, 0.01), -4.0, 4.0)
        rows.append(f"{number * step:.2f},{np.degrees(heading) % 360.0:.3f},{command:.3f},{command:.3f},0,0,48")
        gust += -gust * step / 3.0 + 60.0 * np.sqrt(2.0 * step / 3.0) * rng.normal()
        rate += step * (60.0 * command + gust - 2000.0 * abs(rate) * rate - 200.0 * rate) / inertia
        heading += step * rate
    return "\n".join(rows) + "\n"


def test_drag_leaves_out_logs_under_feedback_and_says_so(tmp_path: Path) -> None:
    holds = sorted(path.name for path in TANK.glob("hold_*.csv"))[:5]
    config(tmp_path, *holds)
    plain = drag_without_feedback(open_study([tmp_path])).estimate
    for seed in range(3):
        (tmp_path / f"auto_{seed}.csv").write_text(heading_hold(seed), encoding="utf-8")
    mixed = drag_without_feedback(open_study([tmp_path])).estimate
    # The cut-off of the rates is chosen from all logs.
    for name in mixed.names:
        assert mixed.value(name) == pytest.approx(plain.value(name), rel=2e-3)
    assert any("auto_0.csv, auto_1.csv, auto_2.csv left out" in warning for warning in mixed.warnings)
    for name in holds:
        (tmp_path / name).unlink()
    with pytest.raises(DataError, match=r"there is feedback.*Run `rovid fit`"):
        drag_without_feedback(open_study([tmp_path]))


def test_a_bad_log_does_not_hide_the_others(tmp_path: Path) -> None:
    wanted = config(tmp_path, "hold_01.csv")
    (tmp_path / "bad.csv").write_text("time_s,heading_deg\n0,1\n")
    found = check_logs([tmp_path], wanted)
    assert [trial.name for trial in found.trials] == ["hold_01.csv"]
    assert set(found.problems) == {"bad.csv"}


def test_a_cut_log_is_said_first(tmp_path: Path) -> None:
    """Once, with the task to copy the file again; the verdict is not "go"."""
    settings = config(tmp_path, "hold_01.csv")
    log = tmp_path / "hold_01.csv"
    log.write_bytes(log.read_bytes()[:30_001])
    found = check_logs([tmp_path], settings)
    first = next(check_tasks(found))
    assert first.startswith("hold_01.csv: The file ends in a last line of ")
    assert first.endswith("copy it again.")
    assert not any("a last line of" in text for text in check_notes(found))
    assert found.verdict == "care"


def test_tables_of_steady_turns_need_no_check(rovid: Rovid) -> None:
    done = rovid("check", str(SAMPLES / "rosub_paper"))
    assert done.code == 2
    assert "Tables need no heading" in done.err
    assert "rovid fit-drag" in done.err


def test_a_log_of_two_seconds_is_one_message(tmp_path: Path, rovid: Rovid) -> None:
    day = tmp_path / "day"
    day.mkdir()
    for name in ("rovid.toml", "thrust_curve.csv"):
        shutil.copy(SAMPLES / "rosub_tank" / name, day)
    rows = (SAMPLES / "rosub_tank" / "staircase.csv").read_text(encoding="utf-8").splitlines()
    time = [float(row.split(",")[0]) for row in rows[1:]]
    (day / "run.csv").write_text("\n".join(rows[: 1 + sum(one <= 2.9 for one in time)]) + "\n", encoding="utf-8")
    done = rovid("check", "day")
    assert done.code == 2
    assert done.out == ""
    assert "too short to determine the inertia" in done.err


def kinds(rovid: Rovid, folder: Path) -> dict[str, str]:
    """Kind -> text of all advice."""
    return {one["kind"]: one["text"] for one in rovid("check", folder, "--json").document["advice"]}


def spoilt(day: Path, folder: Path, change: Callable[[pd.DataFrame], pd.DataFrame]) -> Path:
    """A copy of ``day`` with every log changed."""
    shutil.copytree(day, folder)
    for path in folder.glob("*.csv"):
        if "curve" not in path.name:
            change(pd.read_csv(path)).to_csv(path, index=False)
    return folder


def test_a_complete_campaign_gets_no_advice(csv_day: Path, rovid: Rovid) -> None:
    document = rovid("check", csv_day, "--json").document
    assert (document["verdict"], document["advice"]) == ("go", [])


@pytest.mark.parametrize(
    ("gone", "kind", "said"),
    [
        ("hold_*.csv", "holds", "Hold the command at 4 levels or more each way"),
        ("sine_*.csv", "sines", "Run sines of 2 or more different periods"),
        ("*_only.csv", "one_thruster", "Run each thruster by itself"),
        ("coast_*.csv", "coast", "Stop the thrusters under way"),
    ],
)
def test_missing_runs_are_requested(
    gone: str, kind: str, said: str, csv_day: Path, tmp_path: Path, rovid: Rovid
) -> None:
    shutil.copytree(csv_day, tmp_path / "day")
    # Stairs and steps hold commands, and stop, too.
    for pattern in (gone, *(["staircase.csv", "steps.csv", "multilevel.csv"] if kind in {"holds", "coast"} else [])):
        for path in (tmp_path / "day").glob(pattern):
            path.unlink()
    if kind == "coast":
        for path in (tmp_path / "day").glob("hold_*.csv"):
            path.unlink()
    assert said in kinds(rovid, tmp_path / "day")[kind]


def test_a_recording_in_two_formats_is_one_run(csv_day: Path, tmp_path: Path, rovid: Rovid) -> None:
    (tmp_path / "day").mkdir()
    for name in ("hold_01.csv", "sine_20s.csv", "rovid.toml", "thrust_curve.csv"):
        shutil.copy(csv_day / name, tmp_path / "day")
    once = kinds(rovid, tmp_path / "day")
    pd.read_csv(csv_day / "sine_20s.csv").iloc[::2].to_csv(tmp_path / "day" / "thinned.csv", index=False)
    document = rovid("check", "day", "--json").document
    assert [fault["fault"] for fault in document["faults"]] == ["same_run_twice"]
    assert {one["kind"]: one["text"] for one in document["advice"]} == once


def test_a_clock_offset_is_distinguished_from_a_lag(csv_day: Path, tmp_path: Path, rovid: Rovid) -> None:
    def shifted(seconds: float) -> Callable[[pd.DataFrame], pd.DataFrame]:
        def change(log: pd.DataFrame) -> pd.DataFrame:
            commands = [name for name in log.columns if name.endswith("_V") and name != "supply_V"]
            rows = round(seconds / float(log["time_s"].diff().median()))
            log[commands] = log[commands].shift(rows).ffill().bfill()
            return log

        return change

    late = rovid("check", spoilt(csv_day, tmp_path / "late", shifted(0.6)), "--json").document
    (fault,) = late["faults"]
    assert (fault["fault"], fault["stops"], late["verdict"]) == ("clocks_apart", True, "no_go")
    assert fault["size"] == pytest.approx(-0.6, abs=4.0 * fault["standard_error"] + 0.02)  # The step of the shifts.
    assert not rovid("check", spoilt(csv_day, tmp_path / "early", shifted(-0.6)), "--json").document["faults"]


@pytest.mark.parametrize("axis", ["surge", "pitch"])
def test_the_sample_campaigns_of_other_axes_get_no_advice(axis: str, rovid: Rovid) -> None:
    document = rovid("check", SAMPLES / f"{axis}_tank", "--axis", axis, "--json").document
    assert (document["axis"], document["advice"]) == (axis, [])


def test_a_release_is_requested_for_pitch(tmp_path: Path, rovid: Rovid) -> None:
    day = tmp_path / "day"
    day.mkdir()

    def early(log: pd.DataFrame) -> pd.DataFrame:
        commands = ["fore_V", "aft_V"]
        log[commands] = log[commands].shift(round(0.6 / float(log["time_s"].diff().median()))).bfill()
        return log

    for name in ("rovid.toml", "thrust_curve.csv"):
        shutil.copy(SAMPLES / "pitch_tank" / name, day)
    for name in ("sine_10s.csv", "sine_4.5s.csv"):
        early(pd.read_csv(SAMPLES / "pitch_tank" / name)).to_csv(day / name, index=False)
    document = rovid("check", day, "--axis", "pitch", "--json").document
    found = {a["kind"]: a["text"] for a in document["advice"]}
    assert "let go of it" in found["coast"]
    assert "Stiffness" in found["holds"]
    assert [fault["fault"] for fault in document["faults"]] == ["clocks_apart"]


def test_unreadable_logs_are_not_called_ready(tmp_path: Path, rovid: Rovid) -> None:
    shutil.copy(SAMPLES / "surge_tank" / "rovid.toml", tmp_path)
    shutil.copy(SAMPLES / "surge_tank" / "thrust_curve.csv", tmp_path)
    (tmp_path / "a.csv").write_text("time_s,surge_velocity_m_s\n0,1\n")
    done = rovid("check", tmp_path, "--axis", "surge")
    assert done.code == 2
    assert "good enough for a fit" not in done.out


def test_a_saturated_command_is_reported(csv_day: Path, tmp_path: Path, rovid: Rovid) -> None:
    shutil.copytree(csv_day, tmp_path / "day")
    for path in (tmp_path / "day").glob("*curve*.csv"):
        curve = pd.read_csv(path)
        curve[curve["command"].abs() <= 1.5].to_csv(path, index=False)
    toml = tmp_path / "day" / "rovid.toml"
    toml.write_text(toml.read_text().replace("[[thrusters]]", '[[thrusters]]\noutside = "clamp"'))
    assert "at the end of its bench curve" in kinds(rovid, tmp_path / "day")["saturation"]


def test_feedback_is_found_in_a_real_dive(rovid: Rovid) -> None:
    found = kinds(rovid, SAMPLES / "bluerov2_pier59" / "dive.csv")
    assert "by an autopilot or a pilot: in dive.csv" in found["feedback"]
    assert {"holds", "sines", "one_thruster"} <= set(found)


@pytest.mark.parametrize(("seed", "refused"), [(0, False), (1, True)])
def test_check_refuses_what_fit_refuses(seed: int, refused: bool, tmp_path: Path, rovid: Rovid) -> None:
    (tmp_path / "day").mkdir()
    for name in ("rovid.toml", "thrust_curve.csv"):
        shutil.copy(SAMPLES / "rosub_tank" / name, tmp_path / "day")
    log = pd.read_csv(SAMPLES / "rosub_tank" / "hold_02.csv")
    # In noise of 5 deg the regression finds no inertia with either seed, the likelihood with one of them.
    log["heading_deg"] = (log["heading_deg"] + np.random.default_rng(seed).normal(0.0, 5.0, len(log))) % 360.0
    log.to_csv(tmp_path / "day" / "hold_02.csv", index=False)
    fit, document = rovid("fit", "day"), rovid("check", "day", "--json").document
    assert fit.code == (2 if refused else 0)
    assert document["verdict"] == ("no_go" if refused else "care")
    if refused:
        assert f"rovid: {document['advice'][0]['text']}" == fit.err.strip()


def test_a_decay_about_another_level_is_named(tmp_path: Path) -> None:
    """A roll sensor with another zero in one of three logs."""
    for source in (SAMPLES / "kvlcc2_roll_decay").iterdir():
        if source.is_file():
            shutil.copy(source, tmp_path)
    log = tmp_path / "decay_21337.csv"
    table = pd.read_csv(log)
    table.assign(roll_rad=table["roll_rad"] + 0.05).to_csv(log, index=False)
    found = check_logs([tmp_path], load_config(tmp_path / "rovid.toml", AXES["roll"]))
    (remark,) = (remark for remark in found.remarks if remark.kind == "level")
    assert remark.text.startswith("decay_21337.csv swings about 2.88 deg")
    assert not found.faults
