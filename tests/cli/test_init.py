"""A first rovid.toml from logs only."""

from __future__ import annotations

import shutil
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from rovid.trial.axis import AXES
from tests.conftest import SAMPLES, Rovid


def logs_of(day: Path, folder: Path, change: Callable[[pd.DataFrame], pd.DataFrame] = lambda log: log) -> Path:
    """The logs of ``day`` without rovid.toml, changed."""
    shutil.copytree(day, folder, ignore=shutil.ignore_patterns("rovid.toml"))
    for path in folder.glob("*.csv"):
        if "curve" not in path.name:
            change(pd.read_csv(path)).to_csv(path, index=False)
    return folder


def toml_of(folder: Path) -> dict[str, Any]:
    return tomllib.loads((folder / "rovid.toml").read_text())


@pytest.mark.usefixtures("blank")
@pytest.mark.slow
def test_three_commands_lead_from_logs_to_a_page(csv_day: Path, tmp_path: Path, rovid: Rovid) -> None:
    folder = logs_of(csv_day, tmp_path / "day")
    document = rovid("init", folder, "--json").document
    assert document["curve"] == {"file": "thrust_curve.csv", "guessed": False}
    assert [one["turns"] for one in document["commands"]["csv"]] == [1, 1]
    assert rovid("check", folder).code == 0
    assert rovid("report", folder, "--no-diagnosis", "--no-control", "--no-export").code == 0
    assert (tmp_path / "report" / "index.html").is_file()
    inertia = rovid("fit-inertia", folder, "--json").document["parameters"]["inertia"]["value"]
    # The logs do not hold the arm, 0.43 m in truth and 1 m in the guess: it scales inertia and drag.
    assert 0.43 * inertia == pytest.approx(5057.0, rel=0.02)


def test_sign_and_unit_are_found_from_the_motion(csv_day: Path, tmp_path: Path, rovid: Rovid) -> None:
    def change(log: pd.DataFrame) -> pd.DataFrame:
        turned = np.radians(-log["heading_deg"].to_numpy())
        rate = np.degrees(np.gradient(np.unwrap(turned), log["time_s"]))
        return pd.DataFrame(
            {
                "Time": log["time_s"],
                "psi": np.round((turned + np.pi) % (2.0 * np.pi) - np.pi, 6),
                "gyro_z": np.round(-rate, 4),
                "motor_fore": log["fore_V"],
                "motor_aft": -log["aft_V"],
                "note": "calm",
            }
        )

    folder = logs_of(csv_day, tmp_path / "day", change)
    assert rovid("init", folder).code == 0
    found = toml_of(folder)
    assert found["signals"]["time"] == {"csv": "Time"}
    assert found["signals"]["heading"] == {"csv": "psi", "unit": "rad"}
    assert found["signals"]["yaw_rate"] == {"csv": "gyro_z", "unit": "deg/s", "sign": -1}
    assert {one["name"]: one["yaw_arm"] for one in found["thrusters"]} == {"motor_fore": -1.0, "motor_aft": 1.0}
    text = (folder / "rovid.toml").read_text()
    assert "more of it turns the heading down" in text
    assert "the negative rate of the heading: sign changed here" in text


def test_a_mixed_folder_has_both_formats_in_one_map(tmp_path: Path, rovid: Rovid) -> None:
    folder = logs_of(SAMPLES / "rosub_tank", tmp_path / "day")
    assert rovid("init", folder).code == 0
    found, known = toml_of(folder), toml_of(SAMPLES / "rosub_tank")
    assert found["signals"] == {name: {**known["signals"][name]} for name in known["signals"]}
    assert [one["command"] for one in found["thrusters"]] == [one["command"] for one in known["thrusters"]]


def test_a_missing_thrust_curve_is_guessed_and_marked(tmp_path: Path, rovid: Rovid) -> None:
    (tmp_path / "dive").mkdir()
    shutil.copy(SAMPLES / "bluerov2_pier59" / "dive.csv", tmp_path / "dive")
    document = rovid("init", "dive", "--json").document
    assert document["curve"] == {"file": "thrust_guess.csv", "guessed": True}
    assert "is a guess" in (tmp_path / "dive" / "rovid.toml").read_text()
    ways = {one["source"]: one["turns"] for one in document["commands"]["csv"]}
    # No thruster that turns this vehicle gets the wrong sign.
    assert (ways["pwm3_us"], ways["pwm4_us"]) == (-1, 1)
    assert ways["pwm1_us"] <= 0 <= ways["pwm2_us"]
    assert rovid("check", "dive").code == 0


def test_small_tilts_of_a_recording_are_in_the_unit_of_its_heading(tmp_path: Path, rovid: Rovid) -> None:
    (tmp_path / "day").mkdir()
    for path in (SAMPLES / "rosub_tank").glob("*.mcap"):
        shutil.copy(path, tmp_path / "day")
    signals = rovid("init", "day", "--json").document["signals"]["mcap"]
    assert [signals[name]["unit"] for name in ("heading", "roll", "pitch")] == ["deg", "deg", "deg"]


def test_other_columns_are_not_mistaken_for_the_heading(tmp_path: Path, rovid: Rovid) -> None:
    (tmp_path / "day").mkdir()
    for path in (SAMPLES / "surge_tank").glob("*.csv"):
        shutil.copy(path, tmp_path / "day")
    done = rovid("init", "day")
    assert done.out.startswith("Open: no column was recognised as heading")
    assert "# OPEN: no column was recognised as heading" in (tmp_path / "day" / "rovid.toml").read_text()
    checked = rovid("check", "day")
    assert (checked.code, checked.err.count("\n")) == (2, 1)
    assert "heading" in checked.err


def test_logs_of_different_columns_share_what_is_mapped(csv_day: Path, tmp_path: Path, rovid: Rovid) -> None:
    folder = tmp_path / "day"
    (folder / ".trash").mkdir(parents=True)
    log = pd.read_csv(next(csv_day.glob("sine_*.csv")))
    log.insert(0, "dive_time_h", log["time_s"] / 3600.0)
    log["v_m_s"] = 0.1 * log["fore_V"]
    log.to_csv(folder / "a.csv", index=False)
    log = log.drop(columns="roll_deg")
    log.to_csv(folder / "b.csv", index=False)
    log.drop(columns="aft_V").to_csv(folder / "c.csv", index=False)
    (folder / ".trash" / "d.csv").write_text("x\n1\n")
    document = rovid("init", folder, "--json").document
    assert document["logs"] == 3
    assert "roll" not in document["signals"]["csv"]
    assert {one["source"] for one in document["commands"]["csv"]} == {"fore_V", "aft_V"}
    assert document["warnings"] == ["c.csv: holds no aft_V; is it of another vehicle?"]
    assert toml_of(folder)["signals"]["time"] == {"csv": "time_s"}
    assert rovid("check", folder / "a.csv", folder / "b.csv").code == 0


def test_a_changed_curve_is_not_overwritten(tmp_path: Path, rovid: Rovid) -> None:
    (tmp_path / "dive").mkdir()
    shutil.copy(SAMPLES / "bluerov2_pier59" / "dive.csv", tmp_path / "dive")
    curve = tmp_path / "dive" / "thrust_guess.csv"
    curve.write_text("command,thrust_N\n1100,-40\n1500,0\n1900,51\n")
    done = rovid("init", "dive")
    assert done.code == 2
    assert "thrust_guess.csv: already exists" in done.err
    assert "51" in curve.read_text()
    assert not (tmp_path / "dive" / "rovid.toml").exists()


def test_nothing_is_overwritten(csv_day: Path, tmp_path: Path, rovid: Rovid) -> None:
    folder = logs_of(csv_day, tmp_path / "day")
    (folder / "rovid.toml").write_text("# mine\n")
    done = rovid("init", folder)
    assert done.code == 2
    assert "--force" in done.err
    assert (folder / "rovid.toml").read_text() == "# mine\n"
    assert rovid("init", folder, "--force").code == 0


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("time_s,depth_m\n0,1\n1,1.1\n2,1.2\n3,1.3\n", "no heading and no command was recognised among depth_m"),
        pytest.param(
            "time_s,roll_deg\n" + "".join(f"{k},{k % 7}.5\n" for k in range(60)),
            "Motion was recognised in roll (roll_deg): `rovid init LOGS --axis roll`",
            id="roll",
        ),
        ("heading_deg,fore_V\n1,0\n2,1\n1,0\n", "no column that could be the time"),
        ("name,place\nrov,tank\n", "holds no column of numbers"),
        ("", "is empty"),
    ],
)
def test_unrecognised_columns_are_reported(text: str, said: str, tmp_path: Path, rovid: Rovid) -> None:
    (tmp_path / "log.csv").write_text(text)
    done = rovid("init", tmp_path)
    assert done.code == 2
    assert said in done.err
    assert done.err.count("\n") == 1
    assert not (tmp_path / "rovid.toml").exists()


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("time_s,depth_m,fore_V\n" + "".join(f"{k},1.{k},{k % 3}\n" for k in range(60)), "heading"),
        ("time_s,heading_deg,s1\n" + "".join(f"{k},{k % 360},{k % 3}\n" for k in range(60)), "command"),
    ],
)
def test_open_entries_are_marked_and_can_be_given(text: str, what: str, tmp_path: Path, rovid: Rovid) -> None:
    (tmp_path / "log.csv").write_text(text)
    assert rovid("init", tmp_path, "--json").document["open"][0] == what
    column = {"heading": "depth_m", "command": "s1"}[what]
    missing = rovid("init", tmp_path, f"--{what}", "depth", "--force")
    assert missing.code == 2
    assert f"--{what}" in missing.err
    done = rovid("init", tmp_path, f"--{what}", column, "--force", "--json")
    assert what not in done.document["open"]


def test_a_dive_needs_nothing_but_its_log(tmp_path: Path, rovid: Rovid) -> None:
    shutil.copy(SAMPLES / "bluerov2_dataflash" / "dive.BIN", tmp_path)
    document = rovid("init", tmp_path, "--json").document
    assert document["vehicle"] == {"type": "bluerov2-heavy", "guessed": True}
    senses = {command["source"]: command["turns"] for command in document["commands"]["bin"]}
    assert senses == {f"RCOU.C{at}": way for at, way in zip(range(1, 9), (-1, 1, -1, 1, 0, 0, 0, 0), strict=True)}
    assert document["signals"]["bin"]["supply_voltage"]["source"] == "BAT.Volt"
    assert "RCOU.C10" in document["unused"]["bin"]
    assert document["curve"] == {"file": "t200_16V_curve.csv", "guessed": True}
    assert rovid("check", tmp_path).code == 0


def test_a_named_vehicle_is_no_guess(tmp_path: Path, rovid: Rovid) -> None:
    shutil.copy(SAMPLES / "bluerov2_dataflash" / "dive.BIN", tmp_path)
    document = rovid("init", tmp_path, "--vehicle", "BlueROV2 Heavy", "--json").document
    assert document["vehicle"] == {"type": "bluerov2-heavy", "guessed": False}
    text = (tmp_path / "rovid.toml").read_text()
    assert not [line for line in text.splitlines() if "_guessed =" in line and not line.startswith("#")]
    assert rovid("init", tmp_path, "--vehicle", "bluerov", "--force").err.count("bluerov2") >= 1


@pytest.mark.parametrize(
    ("log", "kind", "outputs"),
    [("small.BIN", "RCOU.C{}", (1, 2, 3, 4)), ("small.tlog", "SERVO_OUTPUT_RAW.servo{}_raw", range(1, 9))],
)
def test_autopilot_parameters_distinguish_thrusters_from_lights(
    log: str, kind: str, outputs: Sequence[int], tmp_path: Path, rovid: Rovid
) -> None:
    shutil.copy(SAMPLES / "ardusub_small" / log, tmp_path)
    document = rovid("init", tmp_path, "--json").document
    (commands,) = document["commands"].values()
    assert [command["source"] for command in commands] == [kind.format(at) for at in outputs]
    (signals,) = document["signals"].values()
    assert "olt" in signals["supply_voltage"]["source"]
    done = rovid("fit", tmp_path)
    assert (done.code, done.err.count("\n")) == (2, 1)


def test_percent_ends_at_a_hundred(csv_day: Path, tmp_path: Path, rovid: Rovid) -> None:
    (tmp_path / "day").mkdir()
    log = pd.read_csv(next(csv_day.glob("sine_*.csv")))
    log["fore_pct"], log["aft_pct"] = 17.0 * log.pop("fore_V"), 17.0 * log.pop("aft_V")
    log.to_csv(tmp_path / "day" / "a.csv", index=False)
    assert rovid("init", "day").code == 0
    ends = pd.read_csv(tmp_path / "day" / "thrust_guess.csv")["command"]
    assert (ends.min(), ends.max()) == (-100.0, 100.0)


@pytest.mark.parametrize(
    ("day", "axis", "signal", "arms"),
    [
        ("surge_tank", "surge", "surge_velocity", {"port": 1.0, "starboard": 1.0}),
        pytest.param("pitch_tank", "pitch", "pitch", {"fore": 1.0, "aft": 1.0}, marks=pytest.mark.slow),
        ("kvlcc2_roll_decay", "roll", "roll", {}),
    ],
)
def test_the_other_axes_are_guessed_too(
    day: str, axis: str, signal: str, arms: dict[str, float], tmp_path: Path, rovid: Rovid
) -> None:
    shutil.copytree(SAMPLES / day, tmp_path / "day")
    own = tomllib.loads((tmp_path / "day" / "rovid.toml").read_text(encoding="utf-8"))
    (tmp_path / "day" / "rovid.toml").unlink()
    document = rovid("init", "day", "--axis", axis, "--json").document
    assert document["axis"] == axis
    assert not document["open"]
    written = tomllib.loads((tmp_path / "day" / "rovid.toml").read_text(encoding="utf-8"))
    assert {one["name"]: one[AXES[axis].arm_key] for one in written.get("thrusters", ())} == arms
    assert {one["name"]: np.sign(one[AXES[axis].arm_key]) for one in own.get("thrusters", ())} == arms
    mapped = written["signals"][signal]
    assert (mapped["csv"], mapped["unit"]) == (own["signals"][signal]["csv"], own["signals"][signal]["unit"])
    fitted = rovid("fit", "day", "--axis", axis, "--json").document
    assert fitted["parameters"]["linear_drag"]


def test_signals_of_another_axis_are_requested_and_can_be_given(tmp_path: Path, rovid: Rovid) -> None:
    shutil.copytree(SAMPLES / "surge_tank", tmp_path / "day")
    (tmp_path / "day" / "rovid.toml").unlink()
    for path in (tmp_path / "day").glob("*.csv"):
        text = path.read_text(encoding="utf-8")
        path.write_text(text.replace("surge_velocity_m_s", "channel_3"), encoding="utf-8")
    found = rovid("init", "day", "--axis", "heave", "--json").document
    assert "depth" in found["open"]
    assert "# depth = " in (tmp_path / "day" / "rovid.toml").read_text(encoding="utf-8")
    named = rovid("init", "day", "--axis", "surge", "--heading", "channel_3", "--force", "--json").document
    assert "surge_position" not in named["open"]


def test_a_curve_with_the_name_of_a_thruster_is_that_of_this_thruster(tmp_path: Path, rovid: Rovid) -> None:
    (tmp_path / "day").mkdir()
    shutil.copy(SAMPLES / "rosub_hidden" / "steps.csv", tmp_path / "day")
    for name in ("aft", "fore"):
        shutil.copy(SAMPLES / "rosub_hidden" / "thrust_curve.csv", tmp_path / "day" / f"curve_{name}.csv")
    rovid("init", "day", "--json")
    written = tomllib.loads((tmp_path / "day" / "rovid.toml").read_text())
    curves = {one["name"]: one["curve"] for one in written["thrusters"]}
    assert len(curves) == 2
    assert all(curve == f"curve_{'aft' if 'aft' in name else 'fore'}.csv" for name, curve in curves.items())
