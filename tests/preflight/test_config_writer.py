"""Text of a first rovid.toml: marks on guesses, open entries, and overrides by the user."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from rovid.preflight.config_writer import assumptions_in, config_files
from rovid.preflight.log_reading import read_logs
from rovid.preflight.log_survey import CHOSEN, LogSurvey, SurveyOptions, UserOverrides, survey, survey_read_logs
from rovid.preflight.raw_columns import SignalGuess
from rovid.readers.campaign import read_campaign
from rovid.trial.config import load_config
from rovid.trial.preprocessing import Exclusion
from tests.app.conftest import logs_into
from tests.conftest import Rovid

TIME = np.arange(0.0, 200.0, 0.2)


def written(folder: Path, asked: SurveyOptions | None = None, **columns: np.ndarray) -> tuple[str, list[str]]:
    """rovid.toml of a log with these columns, and its assumptions."""
    pd.DataFrame({"time_s": TIME, **columns}).to_csv(folder / "log.csv", index=False)
    surveyed = survey([folder], asked)
    return write(surveyed).read_text(encoding="utf-8"), list(assumptions_in(surveyed).items)


def write(survey: LogSurvey) -> Path:
    for output, text in config_files(survey).items():
        output.path.write_text(text, encoding="utf-8")
    return survey.folder / "rovid.toml"


def heading() -> np.ndarray:
    return np.asarray((90.0 + 80.0 * np.sin(0.05 * TIME)) % 360.0)


def test_guessed_arms_and_curves_are_marked(tmp_path: Path) -> None:
    text, guessed = written(tmp_path, heading_deg=heading(), port_cmd=np.sin(TIME), stbd_cmd=np.cos(TIME))
    assert guessed == ["yaw_arm of port", "curve of port", "yaw_arm of stbd", "curve of stbd"]
    assert load_config(tmp_path / "rovid.toml").vehicle.assumptions.items == tuple(guessed)
    assert text.count("\nyaw_arm_guessed = ") == 2


def test_published_arms_are_not_marked(tmp_path: Path) -> None:
    asked = SurveyOptions(vehicle="otter")
    text, guessed = written(tmp_path, asked, heading_deg=heading(), port_rpm=np.sin(TIME), stbd_rpm=np.cos(TIME))
    assert guessed == ["curve of port", "curve of stbd"]
    config = load_config(tmp_path / "rovid.toml")
    assert [thruster.arm for thruster in config.vehicle.thrusters] == pytest.approx([0.395, -0.395])
    assert (config.vehicle.name, config.vehicle.mass) == ("Otter", 55.0)
    assert "Fossen" in text


def test_unused_columns_are_listed(tmp_path: Path) -> None:
    text, _ = written(tmp_path, heading_deg=heading(), port_cmd=np.sin(TIME), depth_m=np.cos(TIME))
    assert "# csv: not used: depth_m" in text


def test_a_missing_command_is_open_in_the_head_and_in_its_section(tmp_path: Path) -> None:
    text, guessed = written(tmp_path, heading_deg=heading(), depth_m=np.cos(TIME))
    assert "# OPEN: no column was recognised as command" in text.partition("[vehicle]")[0]
    assert "# [[thrusters]]" in text
    assert not guessed
    assert "thrusters" not in tomllib.loads(text)


def test_a_logged_torque_replaces_thrusters(tmp_path: Path) -> None:
    text, guessed = written(tmp_path, heading_deg=heading(), torque_Nm=20.0 * np.sin(TIME))
    assert tomllib.loads(text)["signals"]["torque"] == {"csv": "torque_Nm", "unit": "N m"}
    assert not guessed
    assert load_config(tmp_path / "rovid.toml").commands


@pytest.mark.parametrize(("size", "guessed"), [("1.0", False), ("0.4", False), ("1.0\nsenses_alone = true", True)])
def test_published_arms_of_any_size_are_no_guess(size: str, guessed: bool, tmp_path: Path) -> None:
    size, _, alone = size.partition("\n")
    (tmp_path / "mine.toml").write_text(f"{alone}\n[arms]\nport = {size}\nstarboard = -{size}\n")
    folder = tmp_path / "day"
    folder.mkdir()
    asked = SurveyOptions(vehicle=str(tmp_path / "mine.toml"))
    written(folder, asked, heading_deg=heading(), port_cmd=np.sin(TIME), stbd_cmd=np.cos(TIME))
    thrusters = load_config(folder / "rovid.toml").vehicle.thrusters
    assert [thruster.arm_guessed for thruster in thrusters] == [guessed, guessed]
    assert [thruster.arm for thruster in thrusters] == pytest.approx([float(size), -float(size)])


def test_a_heading_recognised_only_by_its_jumps_causes_a_warning(tmp_path: Path) -> None:
    written(tmp_path, channel_7=(30.0 * TIME) % 360.0, port_cmd=np.sin(TIME))
    assert [text for text in survey([tmp_path]).warnings if text.startswith("channel_7 is taken for the heading")]


# ---- overrides


def by_hand(folder: Path, hand: UserOverrides) -> LogSurvey:
    """Survey of the sample logs in a new ``folder``, with the choices of the user."""
    return survey_read_logs(read_logs([logs_into(folder)]), SurveyOptions(), hand)


def test_a_measured_arm_is_no_guess(tmp_path: Path) -> None:
    survey = by_hand(tmp_path / "day", UserOverrides(arms={"fore_V": 0.43}))
    assert assumptions_in(survey).items == ("yaw_arm of aft",)
    assert load_config(write(survey)).vehicle.assumptions.items == ("yaw_arm of aft",)


def test_an_override_sets_sign_and_name(tmp_path: Path) -> None:
    survey = by_hand(tmp_path / "day", UserOverrides(arms={"fore_V": -0.5}, names={"fore_V": 'bow "1"'}))
    first, _ = load_config(write(survey)).vehicle.thrusters
    assert (first.name, first.arm) == ('bow "1"', -0.5)


def test_a_rejected_command_is_not_written(tmp_path: Path) -> None:
    survey = by_hand(tmp_path / "day", UserOverrides(commands=frozenset({"fore_V"})))
    assert [thruster.name for thruster in load_config(write(survey)).vehicle.thrusters] == ["fore"]
    assert "aft_V" in survey.mappings["csv"].unused


def test_chosen_signals_keep_a_valid_reason(tmp_path: Path) -> None:
    heading = SignalGuess(source="heading_deg", unit="deg", reason="")
    chosen = {"heading": heading, "depth tank": SignalGuess(source="supply_V", sign=-1, reason="")}
    survey = by_hand(tmp_path / "day", UserOverrides(signals={"csv": chosen}))
    signals = survey.mappings["csv"].signals
    assert signals["heading"].reason.startswith("by name")
    assert signals["depth tank"].reason == CHOSEN
    read = load_config(write(survey)).signals
    assert read["depth tank"].factor == -1.0
    assert set(read) == {"heading", "depth tank"}


def test_a_removed_heading_is_open(tmp_path: Path) -> None:
    survey = by_hand(tmp_path / "day", UserOverrides(signals={"csv": {}}, commands=frozenset()))
    assert survey.unrecognised == ("heading", "command")
    assert "OPEN: no column was recognised as heading" in "".join(config_files(survey).values())


def test_exclusions_and_size_are_written(tmp_path: Path) -> None:
    hand = Exclusion(log="hold_03.csv", begin=3.25, end=1234.5, reason='a "hand"')
    left_out = (hand, Exclusion(log="*", begin=2000.0))
    overrides = UserOverrides(exclusions=left_out, size={"mass": 2604.0}, name="mine")
    survey = by_hand(tmp_path / "day", overrides)
    config = load_config(write(survey))
    assert config.exclusions == left_out
    assert (config.vehicle.mass, config.vehicle.name) == (2604.0, "mine")


def test_a_curve_with_other_names_is_no_log(tmp_path: Path, rovid: Rovid) -> None:
    time, rng = np.arange(0.0, 120.0, 0.1), np.random.default_rng(4)
    (tmp_path / "a_curve.csv").write_text("pwm_us,thrust_N\n1100,-40\n1500,0\n1900,50\n")
    for number in range(2):
        pulse = 1500.0 + 50.0 * np.repeat(rng.integers(-6, 7, 24), 50)
        heading = np.cumsum(0.002 * (pulse - 1500.0)) + rng.normal(0.0, 0.05, len(time))
        rows = zip(time, pulse, heading, strict=True)
        text = "\n".join(f"2026-06-03T09:{int(t) // 60:02}:{t % 60:06.3f}Z,{p:.0f},{h:.2f}" for t, p, h in rows)
        (tmp_path / f"run_{number}.csv").write_text(f"Timestamp,ESC_Bow_us,Compass (deg)\n{text}\n")
    done = rovid("init", tmp_path)
    assert done.code == 0, done.err
    assert "a_curve.csv: has the columns pwm_us and thrust_N, as a thrust curve has" in " ".join(done.out.split())
    assert load_config(tmp_path / "rovid.toml").time.sources == {"csv": "Timestamp"}


@pytest.mark.parametrize(("ticks", "unit"), [(1e3, "ms"), (1e6, "us"), (1e9, "ns")])
def test_the_unit_of_a_clock_is_guessed_if_seconds_are_impossible(ticks: float, unit: str, tmp_path: Path) -> None:
    frame = pd.DataFrame({"tick": (ticks * TIME).astype(np.int64), "heading_deg": heading(), "fore_cmd": np.sin(TIME)})
    frame.to_csv(tmp_path / "log.csv", index=False)
    surveyed = survey([tmp_path])
    assert any("please check" in text for text in surveyed.warnings)
    config = load_config(write(surveyed))
    assert config.time.unit == unit
    [trial] = read_campaign([tmp_path], config).trials
    assert trial.duration == pytest.approx(TIME[-1], rel=1e-6)
    # Where the name or the text of the time tells the unit, or several units are possible, there is no guess.
    minutes = pd.date_range("2026-01-07", periods=len(TIME), freq="min")
    slow = np.arange(len(TIME)) * 60
    for name, column in (
        ("time_s", slow),
        ("t [s]", slow),
        ("time", slow + 1_700_000_000),
        ("stamp", minutes.strftime("%Y-%m-%dT%H:%M:%S")),
        ("time", minutes.strftime("%H:%M:%S")),
    ):
        frame.drop(columns="tick").assign(**{name: column}).to_csv(tmp_path / "log.csv", index=False)
        assert survey([tmp_path]).time_unit == "auto", name
    units = frame.assign(tick=slow).astype(str).to_csv(index=False).split("\n", 1)
    (tmp_path / "log.csv").write_text(f"{units[0]}\ns,deg,V\n{units[1]}")
    assert survey([tmp_path]).time_unit == "auto"
    frame.assign(tick=np.arange(len(TIME)) * 3000).to_csv(tmp_path / "log.csv", index=False)
    assert survey([tmp_path]).time_unit == "auto"
