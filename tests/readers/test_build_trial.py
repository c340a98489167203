"""Raw channels, clocks and units on the way to a trial."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.core.errors import ConfigError, LogError
from rovid.readers.raw_log import (
    Columns,
    RawLog,
    numeric_sources,
    raw_log_of_topics,
    require_library,
    required_signals,
    required_time,
    select_instance,
    split_instance,
    wrong_format,
)
from rovid.readers.timestamps import guess_clock, is_plausible, time_unit, without_rounding
from rovid.trial.axis import Signal
from rovid.trial.config import Config
from rovid.trial.segments import subsampled_median
from rovid.trial.trial import Remark, Trial
from tests.readers.channels import HEADING, HEADINGS, TIME, trial_of
from tests.readers.logs import campaign, csv_text, kinds, read_csv, standard, toml, turning
from tests.readers.test_csv_reader import assert_standard


def test_the_base_is_headings_and_changes(tmp_path: Path) -> None:
    command = ([-1.0, 0.013, 1.0, 3.51, 3.7, 25.0], [1.0, 1.0, 2.0, 3.0, 3.0, 9.0])
    trial = trial_of(tmp_path, heading=HEADINGS, fore=command)
    np.testing.assert_allclose(trial.time, np.union1d(TIME, [3.51]))  # at 1.0 both, after the end none
    assert trial.measured.sum() == 400
    assert trial.commands[trial.time < 0.99].max() == 1.0
    assert trial.commands[np.searchsorted(trial.time, 3.51), 0] == 3.0
    assert trial.remarks == ()


def test_it_begins_when_every_command_is_known(tmp_path: Path) -> None:
    trial = trial_of(tmp_path, heading=HEADINGS, fore=([2.03, 5.0], [1.0, 2.0]))
    assert trial.time[0] == 0.0
    assert trial.measured[0]
    assert trial.duration == pytest.approx(TIME[-1] - 2.05)
    (remark,) = trial.remarks
    assert (remark.kind, remark.count) == ("start", 41)
    assert "2.0 s" in remark.text


def test_a_command_that_comes_too_late(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="0 heading readings come after every command is known"):
        trial_of(tmp_path, heading=HEADINGS, fore=([50.0], [1.0]))
    with pytest.raises(LogError, match=f"The commands begin {50.0 - TIME[-1]:.1f} s after the last reading"):
        trial_of(tmp_path, heading=HEADINGS, fore=([50.0], [1.0]))


def test_a_number_that_signals_is_missing(tmp_path: Path) -> None:
    def damaged(values: FloatArray) -> FloatArray:
        broken = values.copy()
        broken.view(np.uint64)[100] = 0x7FF0_0000_0000_0001
        return broken

    trial = trial_of(
        tmp_path,
        heading=(TIME, damaged(HEADING % 360.0)),
        fore=(TIME, damaged(np.ones(400))),
        yaw_rate=(TIME, damaged(np.full(400, 0.14))),
        roll=(TIME, damaged(np.full(400, 3.0))),
    )
    assert trial.measured.sum() == 399
    assert kinds(trial)["missing"] >= 1


@pytest.mark.parametrize(("scale", "words"), [(1e3, "50 s apart"), (1e-3, "5e-05 s apart")])
def test_time_in_a_wrong_unit_is_refused(scale: float, words: str, tmp_path: Path) -> None:
    with pytest.raises(LogError, match=f"{words}.*unit = .s.*time.*convert the stamps of this log"):
        read_csv(tmp_path, csv_text(standard(time_s=TIME * scale), form=".7f"))


@pytest.mark.parametrize(
    ("heading", "words"),
    [
        (np.full(400, 123.4), "never changes"),
        (np.full(400, np.nan), "holds 0 heading readings"),
        (np.where(np.arange(400) < 9, HEADING, np.nan), "holds 9 heading readings"),
    ],
)
def test_no_heading(heading: FloatArray, words: str, tmp_path: Path) -> None:
    with pytest.raises(LogError, match=words):
        read_csv(tmp_path, csv_text(standard(heading_deg=heading)))


def test_missing_commands_hold(tmp_path: Path) -> None:
    command = (TIME, np.where(np.arange(400) % 2, np.nan, np.where(TIME < 5, 1.0, 2.0)))
    trial = trial_of(tmp_path, heading=HEADINGS, fore=command)
    assert kinds(trial) == {"missing": 200}
    assert "held" in trial.remarks[0].text
    with pytest.raises(LogError, match="holds no number"):
        trial_of(tmp_path, heading=HEADINGS, fore=(TIME, np.full(400, np.nan)))


def test_continuous_signals_are_interpolated_within_gaps(tmp_path: Path) -> None:
    other = np.arange(-0.02, 20.0, 0.1)
    other = other[(other < 5.0) | (other > 8.0)]
    trial = trial_of(
        tmp_path,
        heading=HEADINGS,
        fore=([0.0], [1.0]),
        yaw_rate=(other, np.deg2rad(8.0 + 0.0 * other)),
        roll=(other, (178.0 + 0.2 * other + 180.0) % 360.0 - 180.0),
        pitch=(TIME, np.where(TIME < 1.0, np.nan, 3.0)),
    )
    assert trial.roll is not None
    assert trial.rate is not None
    assert trial.pitch is not None
    hole = (trial.time > 4.99) & (trial.time < 8.07)
    assert np.isnan(trial.roll[hole]).all()
    assert np.isfinite(trial.roll[~hole & (trial.time < 19.9)]).all()
    wrapped = (np.rad2deg(trial.roll) + 360.0) % 360.0
    np.testing.assert_allclose(
        wrapped[~hole & (trial.time < 19.9)], 178.0 + 0.2 * trial.time[~hole & (trial.time < 19.9)]
    )
    np.testing.assert_allclose(np.deg2rad(8.0), trial.rate[~hole & (trial.time < 19.9)])
    assert np.isnan(trial.pitch[trial.time < 0.99]).all()
    assert kinds(trial) == {"missing": 20}


def test_extras_are_held(tmp_path: Path) -> None:
    trial = trial_of(tmp_path, heading=HEADINGS, fore=([0.0], [1.0]), supply=([1.0, 10.0], [48.0, 47.0]))
    supply = trial.extras["supply"]
    assert np.isnan(supply[trial.time < 0.99]).all()
    assert set(supply[trial.time > 0.99]) == {48.0, 47.0}
    empty = trial_of(tmp_path, heading=HEADINGS, fore=([0.0], [1.0]), supply=([1.0], [np.nan]))
    assert np.isnan(empty.extras["supply"]).all()


def test_a_format_without_a_source_of_what_is_needed_is_refused(config: Config, tmp_path: Path) -> None:
    assert {"heading", "command.fore"} <= set(required_signals(config, "csv", tmp_path / "a.csv"))
    with pytest.raises(ConfigError, match="heading names no tlog source"):
        required_signals(config, "tlog", tmp_path / "a.tlog")


def test_the_time_has_to_be_named_for_tables(config: Config) -> None:
    assert required_time(config, "csv").sources["csv"] == "time_s"
    with pytest.raises(ConfigError, match="time names no parquet column"):
        required_time(config, "parquet")


def test_a_package_that_is_not_there_is_named_with_its_extra() -> None:
    with pytest.raises(LogError, match=r"needs the package no_such_package.*rovid\[logs\]"):
        require_library("no_such_package.inside", "logs", Path("a.bag"))


def test_a_foreign_file_is_told_from_an_empty_one(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("x")
    (tmp_path / "b").write_text("")
    assert "does not begin as one" in str(wrong_format(tmp_path / "a", "a log"))
    assert "it is empty" in str(wrong_format(tmp_path / "b", "a log"))


def test_what_no_sensor_measures_is_not_sensible() -> None:
    assert is_plausible(np.array([0.0, -1e9, np.nan, np.inf, 1e16])).tolist() == [True, True, False, False, False]


def test_the_typical_value_is_near_the_median_of_many() -> None:
    values = np.random.default_rng(1).normal(5.0, 1.0, 1_000_000)
    # Of 10 000 the median is known to 0.0125 standard deviations.
    assert subsampled_median(values) == pytest.approx(np.median(values), abs=0.06)
    assert np.isnan(subsampled_median(np.empty(0)))


# --- topics as columns: sensors told apart, and what can be taken from a topic

LOG = Path("a.bin")
# A clock that began long ago: to the us no float would hold it.
BEGIN = 1_700_000_000_000_000
ATT: Columns = {
    "time": BEGIN + np.array([0, 50_000, 100_000]),
    "yaw": np.array([1.0, 2.0, 3.0]),
    "mode": np.array(["a", "b", "c"]),
}
OUT: Columns = {"time": (BEGIN + np.array([20_000, 120_000])).astype(np.uint64), "c1": np.array([1500, 1600])}
TOPICS = {"ATT": ATT, "OUT": OUT}


def signal(name: str, source: str, *, optional: bool = False) -> Signal:
    return Signal(name=name, sources={"bin": source}, optional=optional)


def raw(signals: dict[str, Signal]) -> RawLog:
    return raw_log_of_topics(LOG, "bin", signals, TOPICS.__getitem__, "time", [])


def test_all_topics_count_from_the_first_message_of_any() -> None:
    signals = {"heading": signal("heading", "ATT.yaw"), "command.a": signal("command.a", "OUT.c1")}
    found = raw(signals).channels
    assert found["heading"].time == pytest.approx([0.0, 0.05, 0.1], abs=1e-12)
    assert found["command.a"].time == pytest.approx([0.02, 0.12], abs=1e-12)
    assert found["command.a"].values.tolist() == [1500.0, 1600.0]


def test_a_field_that_is_missing_or_text_is_refused_unless_nobody_asked_for_it() -> None:
    for source, words in (("ATT.roll", "ATT has no field 'roll'"), ("ATT.mode", "ATT.mode .* is text")):
        with pytest.raises(LogError, match=words):
            raw({"roll": signal("roll", source)})
    both = {"heading": signal("heading", "ATT.yaw"), "roll": signal("roll", "ATT.roll", optional=True)}
    assert set(raw(both).channels) == {"heading"}


def test_numbers_are_sources_and_clocks_and_text_are_not() -> None:
    quaternion = {f"q[{k}]": np.zeros(1) for k in range(4)}
    assert numeric_sources({**TOPICS, "att": quaternion}) == ["ATT.yaw", "OUT.c1", "att.q"]


def test_one_sensor_of_several_is_taken_and_said() -> None:
    assert split_instance("IMU[1]") == ("IMU", 1)
    assert split_instance("IMU") == ("IMU", None)
    columns: Columns = {"I": np.array([0, 1, 0, 1]), "gz": np.array([0.0, 10.0, 1.0, 11.0])}
    remarks: list[Remark] = []
    assert select_instance(LOG, "bin", "IMU", columns, "I", remarks)["gz"].tolist() == [0.0, 1.0]
    assert "IMU[1] is another" in remarks[0].text
    assert select_instance(LOG, "bin", "IMU[1]", columns, "I", remarks)["gz"].tolist() == [10.0, 11.0]
    assert len(remarks) == 1
    with pytest.raises(LogError, match=r"holds no message 'IMU\[2\]'"):
        select_instance(LOG, "bin", "IMU[2]", columns, "I", remarks)


@pytest.mark.parametrize(("unit", "scale"), [("s", 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_declared_time_units(unit: str, scale: float, tmp_path: Path) -> None:
    config = campaign(tmp_path, toml(time=f'time = {{ csv = "time_s", unit = "{unit}" }}'))
    trial = read_csv(tmp_path, csv_text(standard(time_s=np.round(TIME * scale, 3))), config)
    assert_standard(trial.position, trial.time)


@pytest.mark.parametrize(
    ("name", "unit"),
    [("millis", "ms"), ("TimeUS", "us"), ("t_usec", "us"), ("Zeit [μs]", "us"), ("status", "s"), ("Times", "s")],
)
def test_a_unit_in_the_name_of_the_clock(name: str, unit: str) -> None:
    assert time_unit(name, 5e5, "auto") == unit


def test_a_clock_by_name_whose_stamps_repeat_or_step_back_stays_the_clock() -> None:
    other = {"distance": TIME * 3.0}
    for faulty in (np.floor(TIME), np.concatenate((TIME[:200], TIME[:200])), np.roll(TIME, 1)):
        assert guess_clock({"time_s": faulty, **other}, []) == "time_s"
    assert guess_clock({"time_s": np.zeros(len(TIME)), **other}, []) == "distance"


def test_nanoseconds_lose_no_digit(tmp_path: Path) -> None:
    ticks = 1767787200000000001 + np.arange(400) * 50_000_007
    trial = read_csv(tmp_path, csv_text(standard(time_s=ticks)))
    np.testing.assert_allclose(trial.time, np.arange(400) * 0.050000007, rtol=0, atol=1e-13)


def test_nanoseconds_with_an_empty_cell(tmp_path: Path) -> None:
    ticks = [str(1767787200000000001 + k * 50_000_000) for k in range(400)]
    ticks[7] = ""
    trial = read_csv(tmp_path, csv_text(standard(time_s=ticks)))
    assert len(trial.time) == 399
    assert kinds(trial) == {"missing": 1}


@pytest.mark.parametrize("round_down", [np.floor, np.rint])
def test_rounded_stamps_of_a_regular_clock_are_recovered(round_down: np.ufunc) -> None:
    exact = np.delete(1.0 + np.arange(1000) / 7.0, [50, 51, 300])
    recovered = without_rounding(round_down(exact / 1e-3) * 1e-3)
    error = recovered - exact
    # s; the fitted line is off by 0.6 ms / sqrt(1000) at its ends. The offset of truncation is the same everywhere.
    assert np.ptp(error) < 8.0 * 0.6e-3 / np.sqrt(1000.0)


@pytest.mark.parametrize("wander", [0.02, 0.0])
def test_stamps_of_an_irregular_or_exact_clock_are_kept(wander: float) -> None:
    intervals = 0.125 * (1.0 + wander * np.random.default_rng(3).standard_normal(500))
    stamps = np.rint(np.cumsum(intervals) / 1e-3) * 1e-3
    assert without_rounding(stamps) is stamps


def test_duplicates_keep_the_first(tmp_path: Path) -> None:
    text = csv_text(standard()).split("\n")
    text.insert(100, text[99].replace(",", ",9", 1))
    text.insert(200, text[199])
    trial = read_csv(tmp_path, "\n".join(text))
    assert kinds(trial) == {"duplicate": 2}
    np.testing.assert_allclose(trial.position, np.deg2rad(HEADING), atol=2e-6)


def test_a_clock_without_order_is_refused(tmp_path: Path) -> None:
    time = TIME.copy()
    np.random.default_rng(1).shuffle(time)
    with pytest.raises(LogError, match=r"time_s runs backwards at line \d+, from"):
        read_csv(tmp_path, csv_text(standard(time_s=time)))


def test_rows_out_of_order_are_sorted(tmp_path: Path) -> None:
    rows = np.argsort(np.arange(len(TIME)) + np.random.default_rng(2).uniform(0.0, 4.0, len(TIME)))
    trial = read_csv(tmp_path, csv_text({name: np.asarray(values)[rows] for name, values in standard().items()}))
    assert_standard(trial.position, trial.time)
    assert set(kinds(trial)) == {"backward"}


def test_blocks_out_of_order_are_sorted(tmp_path: Path) -> None:
    rows = np.arange(len(TIME)).reshape(8, -1)[[0, 2, 1, 3, 6, 5, 4, 7]].ravel()
    trial = read_csv(tmp_path, csv_text({name: np.asarray(values)[rows] for name, values in standard().items()}))
    assert_standard(trial.position, trial.time)
    assert set(kinds(trial)) == {"backward"}
    assert not trial.faults


def test_coarse_stamps_that_hide_gaps_are_refused(tmp_path: Path) -> None:
    time = np.floor(TIME / 5.0) ** 3
    with pytest.raises(LogError, match=r"repeats the stamp before it in 396 of 400.*more decimals"):
        read_csv(tmp_path, csv_text(standard(time_s=time)))


def test_a_kept_step_is_refused(tmp_path: Path) -> None:
    time = TIME.copy()
    time[200:] -= 5.0
    config = campaign(tmp_path, toml() + '[faults]\nclock_step = "keep"\n')
    text = csv_text(standard(time_s=time))
    with pytest.raises(LogError, match=r"time_s runs backwards at line 202, from 9\.95 s to 5 s"):
        read_csv(tmp_path, text, config)


def test_a_kept_leap_is_refused(tmp_path: Path) -> None:
    time = TIME.copy()
    time[20:] += 1.7e9
    config = campaign(tmp_path, toml() + '[faults]\nclock_step = "keep"\n')
    with pytest.raises(LogError, match=r"leaps by 1\.7e\+09 s after sample 20"):
        read_csv(tmp_path, csv_text(standard(time_s=time)), config)


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
