"""Units and senses that are not as rovid.toml says."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.trial.trial import Trial
from tests.readers.channels import trial_of
from tests.readers.logs import campaign, csv_text, kinds, read_csv, toml, turning


def said(trial: Trial) -> str:
    """The sentence on the scale of the heading, which stops every fit."""
    (fault,) = [fault for fault in trial.faults if fault.fault == "scaled_heading"]
    assert fault.stops
    return fault.text


def sweep(low: float, high: float, count: int = 1200) -> FloatArray:
    """There and back, in deg, smoothly."""
    return low + (high - low) * 0.5 * (1.0 - np.cos(np.linspace(0.0, 4.0 * np.pi, count)))


LONG = np.arange(1200) * 0.05
RADIANS = {
    "wrapped 0..2pi": np.deg2rad(turning(1200)[1] % 360.0),
    "wrapped -pi..pi": np.deg2rad((turning(1200)[1] + 180.0) % 360.0 - 180.0),
    "a sweep without a jump": np.deg2rad(sweep(-120.0, 110.0)),
    "one turn after a long rest": np.deg2rad(np.concatenate([np.full(900, 20.0), np.linspace(20.0, 300.0, 300)])),
}


@pytest.mark.parametrize("shape", RADIANS)
def test_radians_declared_as_degrees(shape: str, tmp_path: Path) -> None:
    text = csv_text({"time_s": LONG, "heading_deg": RADIANS[shape], "fore_V": LONG * 0 + 1}, form=".5f")
    assert re.search(
        r"heading_deg is declared in degrees but looks like radians.*unit = .rad.", said(read_csv(tmp_path, text))
    )


@pytest.mark.parametrize("shape", RADIANS)
def test_radians_declared_as_radians(shape: str, tmp_path: Path) -> None:
    config = campaign(tmp_path, toml(heading='heading = { csv = "heading_deg", unit = "rad" }'))
    text = csv_text({"time_s": LONG, "heading_deg": RADIANS[shape], "fore_V": LONG * 0 + 1}, form=".5f")
    trial = read_csv(tmp_path, text, config)
    assert np.ptp(trial.position) > 3.0
    assert kinds(trial) == {}


DEGREES = {
    "wrapped 0..360": turning(1200)[1] % 360.0,
    "wrapped -180..180": (turning(1200)[1] + 180.0) % 360.0 - 180.0,
    "fast, without a jump": sweep(30.0, 330.0),
}


@pytest.mark.parametrize("shape", DEGREES)
def test_degrees_declared_as_radians(shape: str, tmp_path: Path) -> None:
    config = campaign(tmp_path, toml(heading='heading = { csv = "heading_deg", unit = "rad" }'))
    text = csv_text({"time_s": LONG, "heading_deg": DEGREES[shape], "fore_V": LONG * 0 + 1})
    found = said(read_csv(tmp_path, text, config))
    assert re.search(r"declared in radians but looks like degrees.*unit = .deg.", found)


@pytest.mark.parametrize(
    "heading",
    [
        sweep(-2.6, 2.6),  # a small zigzag about north, rounded as degrees are
        sweep(-1.5, 1.5),
        sweep(-6.0, 6.9),
        sweep(0.0, 3.0) + np.random.default_rng(5).normal(0.0, 0.05, 1200),
    ],
)
def test_small_headings_in_degrees_pass(heading: FloatArray, tmp_path: Path) -> None:
    text = csv_text({"time_s": LONG, "heading_deg": heading, "fore_V": LONG * 0 + 1}, form=".2f")
    assert kinds(read_csv(tmp_path, text)) == {}


@pytest.mark.parametrize("turns", [3, 40])
def test_many_turns_in_radians_pass(turns: int, tmp_path: Path) -> None:
    config = campaign(tmp_path, toml(heading='heading = { csv = "heading_deg", unit = "rad" }'))
    heading = np.linspace(0.0, 2.0 * np.pi * turns, 1200 * 5)
    time = np.arange(len(heading)) * 0.05
    trial = read_csv(tmp_path, csv_text({"time_s": time, "heading_deg": heading, "fore_V": time * 0 + 1}), config)
    assert np.ptp(trial.position) == pytest.approx(2 * np.pi * turns, abs=1e-3)


def gyro_log(scale: float, heading: FloatArray) -> str:
    rate = np.gradient(np.unwrap(np.deg2rad(heading)), LONG) + np.random.default_rng(2).normal(0, 0.002, len(LONG))
    columns = {"time_s": LONG, "heading_deg": heading, "fore_V": LONG * 0 + 1, "yaw_rate": rate * scale}
    return csv_text(columns, form=".6f")


@pytest.mark.parametrize(
    ("scale", "heading_unit", "rate_unit", "mend"),
    [
        (57.29578, "deg", "rad/s", 'unit = "deg/s" in [signals] yaw_rate'),
        (1.0, "deg", "deg/s", 'unit = "rad/s" in [signals] yaw_rate'),
        (-1.0, "deg", "rad/s", "sign = -1"),
        (1.0, "rad", "rad/s", 'unit = "deg" in [signals] heading'),
    ],
)
def test_the_gyro_tells_units_and_senses(
    scale: float, heading_unit: str, rate_unit: str, mend: str, tmp_path: Path
) -> None:
    config = campaign(
        tmp_path,
        toml(
            f'yaw_rate = {{ csv = "yaw_rate", unit = "{rate_unit}" }}',
            heading=f'heading = {{ csv = "heading_deg", unit = "{heading_unit}" }}',
        ),
    )
    assert mend in said(read_csv(tmp_path, gyro_log(scale, sweep(40.0, 100.0)), config))


def test_the_gyro_names_a_heading_in_radians(tmp_path: Path) -> None:
    heading = sweep(40.0, 100.0)
    rate = np.gradient(np.deg2rad(heading), LONG)
    trial = trial_of(tmp_path, heading=(LONG, np.deg2rad(heading)), fore=([0.0], [1.0]), yaw_rate=(LONG, rate))
    assert 'unit = "rad" in [signals] heading' in said(trial)


def test_the_gyro_confirms_small_headings_in_degrees(tmp_path: Path) -> None:
    """Without it, five degrees at full precision would pass for radians."""
    config = campaign(tmp_path, toml('yaw_rate = { csv = "yaw_rate" }'))
    trial = read_csv(tmp_path, gyro_log(1.0, sweep(-2.6, 2.6)), config)
    assert np.ptp(trial.position) == pytest.approx(np.deg2rad(5.2), rel=1e-3)


def test_a_gyro_at_rest_says_nothing(tmp_path: Path) -> None:
    config = campaign(tmp_path, toml('yaw_rate = { csv = "yaw_rate" }'))
    noise = np.random.default_rng(4)
    columns = {"time_s": LONG, "heading_deg": 50 + noise.normal(0, 0.01, 1200), "fore_V": LONG * 0 + 1}
    read_csv(tmp_path, csv_text({**columns, "yaw_rate": noise.normal(0, 1e-3, 1200)}, form=".6f"), config)
