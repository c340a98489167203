"""What is put in by hand takes the place of what was guessed, and is written as no guess."""

from __future__ import annotations

from pathlib import Path

from rovid.preflight.config_writer import assumptions_in, config_files
from rovid.preflight.log_survey import LogSurvey, SurveyOptions, read_logs, survey_read_logs
from rovid.preflight.raw_columns import SignalGuess
from rovid.preflight.user_overrides import CHOSEN, UserOverrides
from rovid.trial.config import load_config
from rovid.trial.trial import Exclusion
from tests.app.conftest import logs_into


def by_hand(folder: Path, hand: UserOverrides) -> LogSurvey:
    return survey_read_logs(read_logs([folder]), SurveyOptions(), hand)


def written(survey: LogSurvey) -> Path:
    for output, text in config_files(survey).items():
        output.path.write_text(text)
    return survey.folder / "rovid.toml"


def test_an_arm_that_was_measured_is_marked_no_guess(tmp_path: Path) -> None:
    survey = by_hand(logs_into(tmp_path / "day"), UserOverrides(arms={"fore_V": 0.43}))
    assert assumptions_in(survey).items == ("yaw_arm of aft",)
    assert load_config(written(survey)).vehicle.assumptions.items == ("yaw_arm of aft",)


def test_the_sense_is_that_of_the_arm_and_the_name_as_given(tmp_path: Path) -> None:
    survey = by_hand(logs_into(tmp_path / "day"), UserOverrides(arms={"fore_V": -0.5}, names={"fore_V": 'bow "1"'}))
    first, _ = load_config(written(survey)).vehicle.thrusters
    assert (first.name, first.arm) == ('bow "1"', -0.5)


def test_a_command_that_is_not_wanted_is_carried_nowhere(tmp_path: Path) -> None:
    survey = by_hand(logs_into(tmp_path / "day"), UserOverrides(commands=frozenset({"fore_V"})))
    assert [thruster.name for thruster in load_config(written(survey)).vehicle.thrusters] == ["fore"]
    assert "aft_V" in survey.mappings["csv"].unused


def test_signals_as_chosen_keep_the_reason_where_it_still_holds(tmp_path: Path) -> None:
    heading = SignalGuess(source="heading_deg", unit="deg", reason="")
    chosen = {"heading": heading, "depth tank": SignalGuess(source="supply_V", sign=-1, reason="")}
    survey = by_hand(logs_into(tmp_path / "day"), UserOverrides(signals={"csv": chosen}))
    signals = survey.mappings["csv"].signals
    assert signals["heading"].reason.startswith("named so")
    assert signals["depth tank"].reason == CHOSEN
    read = load_config(written(survey)).signals
    assert read["depth tank"].factor == -1.0
    assert set(read) == {"heading", "depth tank"}


def test_a_log_whose_heading_was_taken_away_is_open(tmp_path: Path) -> None:
    survey = by_hand(logs_into(tmp_path / "day"), UserOverrides(signals={"csv": {}}, commands=frozenset()))
    assert survey.unrecognised == ("heading", "command")
    assert "OPEN: no column was recognised as heading" in "".join(config_files(survey).values())


def test_stretches_and_size_are_in_the_file(tmp_path: Path) -> None:
    left_out = (
        Exclusion(log="hold_03.csv", begin=3.25, end=1234.5, reason='a "hand"'),
        Exclusion(log="*", begin=2000.0),
    )
    survey = by_hand(
        logs_into(tmp_path / "day"), UserOverrides(exclusions=left_out, size={"mass": 2604.0}, name="mine")
    )
    config = load_config(written(survey))
    assert config.exclusions == left_out
    assert (config.vehicle.mass, config.vehicle.name) == (2604.0, "mine")
