"""Poor input gets a verdict that says what is missing, or one message; never a traceback."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.conftest import SAMPLES, Rovid
from tests.test_bad_input import TOML, assert_one_message

TIME = np.arange(0.0, 120.0, 0.1)


def write_campaign(folder: Path, logs: int, command: float, rate: float, seconds: float = 120.0) -> Path:
    """Logs of a vehicle that turns at a steady ``rate`` in deg/s, with a little noise."""
    folder.mkdir()
    (folder / "rovid.toml").write_text(TOML)
    (folder / "curve.csv").write_text("command,thrust_N\n-5,-500\n0,0\n5,1000\n")
    for number in range(logs):
        noise = np.random.default_rng(number).normal(0.0, 0.01, len(TIME))
        rows = [
            f"{t:.2f},{(rate * t + 37.0 * number + e) % 360:.3f},{command}"
            for t, e in zip(TIME, noise, strict=True)
            if t < seconds - 7 * number
        ]
        (folder / f"log_{number}.csv").write_text("time_s,heading_deg,fore_V\n" + "\n".join(rows) + "\n")
    return folder


@pytest.mark.parametrize(
    ("name", "logs", "command", "rate", "seconds", "missing"),
    [
        ("one steady hold, repeated", 6, 1.5, 9.0, 120.0, ("Record more runs",)),
        ("one short trial", 1, 1.5, 9.0, 20.0, ("too few", "Record more runs")),
        ("no motion", 6, 1.5, 0.0, 120.0, ("Run sines, steps",)),
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
    for words in missing:
        assert words in document["missing"], document["missing"]
    assert "Warning" not in done.err
    assert rovid("diagnose", folder).code == 0


def test_a_heading_that_was_never_measured(tmp_path: Path, rovid: Rovid) -> None:
    folder = write_campaign(tmp_path / "empty", 3, 1.5, 9.0)
    for log in folder.glob("log_*.csv"):
        rows = [line.split(",") for line in log.read_text().splitlines()]
        log.write_text("\n".join([",".join(rows[0]), *(f"{row[0]},,{row[2]}" for row in rows[1:])]) + "\n")
    assert_one_message(rovid("diagnose", folder, "--json"), "heading_deg", "log_0.csv")


@pytest.mark.parametrize("effect", ["no_such_effect", "thruster_lagg"])
def test_an_effect_that_does_not_exist(effect: str, rovid: Rovid) -> None:
    assert_one_message(rovid("fit", SAMPLES / "rosub_tank", "--effect", effect), effect, "there is no effect")


def test_tables_and_nothing_at_all(rovid: Rovid) -> None:
    assert_one_message(rovid("diagnose", SAMPLES / "rosub_paper"), "no time series")
    assert_one_message(rovid("diagnose"), "parameters.toml", "Give LOGS")
