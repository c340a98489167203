"""Poor input gives a verdict with the missing data or one message, but no traceback."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from rovid.diagnose.cross_validation import recorded_seconds, split_runs
from tests import synthetic
from tests.conftest import SAMPLES, Rovid
from tests.whole.test_bad_input import TOML, assert_one_message
from tools.programme import Hold, Run, Sine
from tools.trial_day import write_trial_day

TIME = np.arange(0.0, 120.0, 0.1)
# The minimum data of a diagnosis.
CAMPAIGN = (
    Run(name="ahead", pieces=(Hold(1.5, 40.0), Hold(0.0, 20.0))),
    Run(name="astern", pieces=(Hold(-1.9, 40.0), Hold(0.0, 20.0))),
    Run(name="sine_20s", pieces=(Sine(2.0, 2.5, 20.0, 4),)),
    Run(name="sine_30s", pieces=(Sine(1.6, 2.2, 30.0, 3),)),
)
LONG = (Run(name="all", pieces=(Hold(1.5, 60.0), Hold(-1.9, 60.0), Sine(2.0, 2.5, 20.0, 4))),)


def write_campaign(folder: Path, logs: int, command: float, rate: float, seconds: float = 120.0) -> Path:
    """Logs of a vehicle that turns at a steady ``rate`` in deg/s, with a little noise.

    No two rates are quite the same: logs that agree to the noise are taken for one recording.
    """
    folder.mkdir()
    (folder / "rovid.toml").write_text(TOML)
    (folder / "curve.csv").write_text("command,thrust_N\n-5,-500\n0,0\n5,1000\n")
    for number in range(logs):
        noise = np.random.default_rng(number).normal(0.0, 0.01, len(TIME))
        rows = [
            f"{t:.2f},{((1.0 + 0.01 * number) * rate * t + 37.0 * number + e) % 360:.3f},{command}"
            for t, e in zip(TIME, noise, strict=True)
            if t < seconds - 7 * number
        ]
        (folder / f"log_{number}.csv").write_text("time_s,heading_deg,fore_V\n" + "\n".join(rows) + "\n")
    return folder


@pytest.mark.parametrize(
    ("name", "logs", "command", "rate", "seconds", "missing"),
    [
        ("one steady hold, repeated", 6, 1.5, 9.0, 120.0, ("inertia cannot be determined", "Run sines")),
        ("one short trial", 1, 1.5, 9.0, 20.0, ("inertia cannot be determined", "Run sines")),
        ("two short trials", 2, 1.5, 9.0, 60.0, ("too few trials (2, 113 s", "4 parts of", "Record more runs")),
        ("no motion", 6, 1.5, 0.0, 120.0, ("never turns", "run sines, steps")),
        ("thrusters never run", 6, 0.0, 5.0, 120.0, ("no thruster ever runs", "Log a run under thrust")),
    ],
)
def test_too_little_data_says_what_is_missing(
    name: str,
    logs: int,
    command: float,
    rate: float,
    seconds: float,
    missing: tuple[str, ...],
    tmp_path: Path,
    rovid: Rovid,
) -> None:
    folder = write_campaign(tmp_path / name.replace(" ", "_").replace(",", ""), logs, command, rate, seconds)
    done = rovid("diagnose", folder, "--json")
    document = done.document
    assert document["verdict"] == "too_little_data"
    assert document["findings"] == []
    assert document["base"] is None
    assert document["extended"] is None
    assert document["next_experiment"]["run"]
    for words in missing:
        assert words in document["missing"], document["missing"]
    assert done.err == ""
    told = rovid("diagnose", folder)
    assert (told.code, told.err) == (0, "")
    assert "too little data" in told.out
    assert not Path("parameters.toml").exists(), "nothing was found that could be remembered"


def test_a_heading_that_was_never_measured(tmp_path: Path, rovid: Rovid) -> None:
    folder = write_campaign(tmp_path / "empty", 3, 1.5, 9.0)
    for log in folder.glob("log_*.csv"):
        rows = [line.split(",") for line in log.read_text().splitlines()]
        log.write_text("\n".join([",".join(rows[0]), *(f"{row[0]},,{row[2]}" for row in rows[1:])]) + "\n")
    assert_one_message(rovid("diagnose", folder, "--json"), "heading_deg", "log_0.csv")


def write_day(folder: Path, edit: Callable[[pd.DataFrame], pd.DataFrame], campaign: tuple[Run, ...] = CAMPAIGN) -> Path:
    """A small good day whose logs went through ``edit``."""
    write_trial_day(folder, seed=5, formats="csv", campaign=campaign)
    for run in campaign:
        log = folder / f"{run.name}.csv"
        edit(pd.read_csv(log)).to_csv(log, index=False)
    return folder


def test_the_minimum_length_depends_on_the_filter(tmp_path: Path, rovid: Rovid) -> None:
    folder = write_day(tmp_path / "day", lambda log: log, CAMPAIGN[:2])
    document = rovid("diagnose", folder, "--cutoff", "0.05", "--json").document
    assert document["verdict"] == "too_little_data"
    assert "parts of 160 s" in document["missing"]


def test_logs_of_a_second(tmp_path: Path, rovid: Rovid) -> None:
    folder = write_day(tmp_path / "day", lambda log: log.iloc[:20])
    assert_one_message(rovid("diagnose", folder, "--json"), "ahead.csv", "34 readings", "longer runs")


@pytest.mark.parametrize("column", ["supply_V", "temperature_C", "roll_deg"])
def test_an_empty_extra_channel_is_reported_and_skipped(column: str, tmp_path: Path, rovid: Rovid) -> None:
    folder = write_day(tmp_path / "day", lambda log: log.assign(**{column: np.nan}))
    with (folder / "rovid.toml").open("a") as toml:
        toml.write('temperature = { csv = "temperature_C" }\n' if column == "temperature_C" else "")
    done = rovid("diagnose", folder, "--json")
    assert done.err == ""
    assert done.document["verdict"] == "nothing_found"
    assert any(column in text for text in done.document["warnings"])


def test_a_long_trial_with_a_long_gap(tmp_path: Path, rovid: Rovid) -> None:
    def edit(log: pd.DataFrame) -> pd.DataFrame:
        return log.assign(heading_deg=log.heading_deg.where((log.time_s < 50.0) | (log.time_s > 150.0)))

    done = rovid("diagnose", write_day(tmp_path / "day", edit, LONG), "--json")
    assert done.err == ""
    # Commands change within the gap; a part that starts there starts with its first heading.
    assert done.document["verdict"] == "nothing_found"
    assert any("too few trials (1)" in text for text in done.document["warnings"])


def test_a_pause_does_not_make_a_trial_short() -> None:
    time = synthetic.clock(400.0)
    time = np.where(time > 200.0, time + 1500.0, time)
    noise = np.random.default_rng(2).normal(0.0, 1e-4, len(time))
    log = synthetic.run(time, 100.0 * np.sign(np.sin(0.1 * time)), noise=noise)
    parts = split_runs([log], synthetic.LOGGED, 0.5)
    assert parts is not None
    assert len(parts.items) == 8
    assert recorded_seconds(log.trial) == pytest.approx(400.0, abs=2.0)


def test_a_log_cut_off_in_the_middle_of_a_line(tmp_path: Path, rovid: Rovid) -> None:
    folder = write_day(tmp_path / "day", lambda log: log)
    whole = (folder / "ahead.csv").read_bytes()
    (folder / "ahead.csv").write_bytes(whole[:-15])
    done = rovid("diagnose", folder, "--json")
    assert done.err == ""
    assert done.document["verdict"] == "nothing_found"
    assert any("ahead.csv" in text and "left out" in text for text in done.document["warnings"])


@pytest.mark.parametrize(
    ("effect", "words"),
    [
        ("no_such_effect", ("'no_such_effect'", "There are: 'thruster_deadband'")),
        ("thruster_lagg", ("'thruster_lagg'", "Nearest: 'thruster_lag'")),
        ("thruster_imbalance", ("name of the thruster", "thruster_imbalance:fore")),
    ],
)
def test_an_effect_that_does_not_exist(effect: str, words: tuple[str, ...], rovid: Rovid) -> None:
    assert_one_message(rovid("fit", SAMPLES / "rosub_tank", "--effect", effect), *words)
    assert not Path("parameters.toml").exists()


def test_an_effect_on_a_missing_thruster(tmp_path: Path, rovid: Rovid) -> None:
    folder = write_day(tmp_path / "day", lambda log: log.assign(supply_V=np.nan))
    done = rovid("fit", folder, "--effect", "thruster_imbalance:four")
    assert_one_message(done, "thruster_imbalance:four", "Nearest: 'thruster_imbalance:fore'")
    done = rovid("fit", folder, "--effect", "supply_sag:voltage")
    assert_one_message(done, "supply_sag:voltage", "needs supply_voltage", "Map supply_voltage")


def test_a_thruster_that_was_renamed_since(tmp_path: Path, rovid: Rovid) -> None:
    # If both thrusters run alike, one weak thruster looks like two slightly weak ones.
    campaign = (*CAMPAIGN, Run(name="fore_only", pieces=(Hold(2.2, 40.0), Hold(-2.8, 40.0)), only="fore"))
    folder = write_day(tmp_path / "day", lambda log: log, campaign)
    assert rovid("fit", folder, "--effect", "thruster_imbalance:fore").code == 0
    toml = folder / "rovid.toml"
    toml.write_text(toml.read_text().replace('name = "fore"', 'name = "bow"'))
    assert_one_message(rovid("simulate"), "thruster_imbalance:fore", "'thruster_imbalance:bow'")
    assert_one_message(rovid("report", "--no-diagnosis"), "thruster_imbalance:fore", "'thruster_imbalance:bow'")


def test_an_effect_of_data_without_excitation(tmp_path: Path, rovid: Rovid) -> None:
    folder = write_campaign(tmp_path / "hold", 4, 1.5, 9.0)
    assert_one_message(rovid("fit", folder, "--effect", "thruster_lag"), "inertia", "Run sines, steps")


def test_tables_and_empty_folders(tmp_path: Path, rovid: Rovid) -> None:
    steady = tmp_path / "tables" / "steady.csv"
    steady.parent.mkdir()
    steady.write_text("command,yaw_rate_rad_s,torque_Nm\n1,0.1,50\n2,0.2,160\n")
    assert_one_message(rovid("diagnose", steady.parent, "--json"), "does not determine the inertia", "Give logs")
    assert_one_message(rovid("fit", steady, "--effect", "thruster_lag"), "no time series", "Give logs")
    assert_one_message(rovid("diagnose"), "parameters.toml", "Give LOGS")
    assert_one_message(rovid("diagnose", "--json"), "parameters.toml", "fit-drag LOGS")
