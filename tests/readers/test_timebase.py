"""One time base for all channels, and what is said about clocks, commands and units."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike

from rovid.campaign.config import Config
from rovid.campaign.trial import Trial
from rovid.ground.arrays import FloatArray
from rovid.ground.errors import LogError
from rovid.readers.raw import Channel, RawLog
from rovid.readers.timebase import build
from tests.readers.logs import campaign, csv_text, kinds, read_csv, standard, toml, turning

TIME, HEADING = turning()
Pairs = tuple[ArrayLike, ArrayLike]


def trial_of(config: Config, *, sortable: bool = True, **signals: Pairs) -> Trial:
    """A trial from (time, values) of each signal; underscores in names stand for dots."""
    channels = {}
    for key, (time, values) in signals.items():
        name = "command.fore" if key == "fore" else key
        channels[name] = Channel(
            source=f"/{key}.data",
            clock=f"log time of /{key}",
            time=np.asarray(time, dtype=np.float64),
            values=np.asarray(values, dtype=np.float64),
        )
    raw = RawLog(channels=channels, place=lambda _, index: f"message {index + 1}", sortable=sortable)
    return build(raw, config, Path("dive.mcap"), "dive.mcap")


@pytest.fixture
def config(tmp_path: Path) -> Config:
    optional = ("yaw_rate", "roll", "pitch", "supply")
    return campaign(tmp_path, toml(*(f'{name} = {{ csv = "{name}", mcap = "/{name}.data" }}' for name in optional)))


HEADINGS = (TIME, HEADING % 360.0)


def test_the_base_is_headings_and_changes(config: Config) -> None:
    command = ([-1.0, 0.013, 1.0, 3.51, 3.7, 25.0], [1.0, 1.0, 2.0, 3.0, 3.0, 9.0])
    trial = trial_of(config, heading=HEADINGS, fore=command)
    np.testing.assert_allclose(trial.time, np.union1d(TIME, [3.51]))  # at 1.0 both, after the end none
    assert trial.measured.sum() == 400
    assert trial.commands[trial.time < 0.99].max() == 1.0
    assert trial.commands[np.searchsorted(trial.time, 3.51), 0] == 3.0
    assert trial.remarks == ()


def test_it_begins_when_every_command_is_known(config: Config) -> None:
    trial = trial_of(config, heading=HEADINGS, fore=([2.03, 5.0], [1.0, 2.0]))
    assert trial.time[0] == 0.0
    assert trial.measured[0]
    assert trial.duration == pytest.approx(TIME[-1] - 2.05)
    (remark,) = trial.remarks
    assert (remark.kind, remark.count) == ("start", 41)
    assert "2.0 s" in remark.text


def test_a_command_that_comes_too_late(config: Config) -> None:
    with pytest.raises(LogError, match="0 heading readings come after every command is known"):
        trial_of(config, heading=HEADINGS, fore=([50.0], [1.0]))


def test_missing_commands_hold(config: Config) -> None:
    command = (TIME, np.where(np.arange(400) % 2, np.nan, np.where(TIME < 5, 1.0, 2.0)))
    trial = trial_of(config, heading=HEADINGS, fore=command)
    assert kinds(trial) == {"missing": 200}
    assert "held" in trial.remarks[0].text
    with pytest.raises(LogError, match="holds no number"):
        trial_of(config, heading=HEADINGS, fore=(TIME, np.full(400, np.nan)))


def test_a_number_that_signals_is_missing(config: Config) -> None:
    def damaged(values: FloatArray) -> FloatArray:
        broken = values.copy()
        broken.view(np.uint64)[100] = 0x7FF0_0000_0000_0001
        return broken

    trial = trial_of(
        config,
        heading=(TIME, damaged(HEADING % 360.0)),
        fore=(TIME, damaged(np.ones(400))),
        yaw_rate=(TIME, damaged(np.full(400, 0.14))),
        roll=(TIME, damaged(np.full(400, 3.0))),
    )
    assert trial.measured.sum() == 399
    assert kinds(trial)["missing"] >= 1


@pytest.mark.parametrize(("times", "stale"), [(TIME[:200], True), (TIME[:395], False), ([0.0, 1.3, 1.4, 7.0], False)])
def test_a_command_that_stops(times: FloatArray, stale: bool, config: Config) -> None:
    trial = trial_of(config, heading=HEADINGS, fore=(times, 1.0 + 0.1 * (np.arange(len(times)) % 2)))
    assert ("stale" in kinds(trial)) == stale


def test_continuous_signals_are_interpolated_within_gaps(config: Config) -> None:
    other = np.arange(-0.02, 20.0, 0.1)
    other = other[(other < 5.0) | (other > 8.0)]
    trial = trial_of(
        config,
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


def test_extras_are_held(config: Config) -> None:
    trial = trial_of(config, heading=HEADINGS, fore=([0.0], [1.0]), supply=([1.0, 10.0], [48.0, 47.0]))
    supply = trial.extras["supply"]
    assert np.isnan(supply[trial.time < 0.99]).all()
    assert set(supply[trial.time > 0.99]) == {48.0, 47.0}
    empty = trial_of(config, heading=HEADINGS, fore=([0.0], [1.0]), supply=([1.0], [np.nan]))
    assert np.isnan(empty.extras["supply"]).all()


# --- order -----------------------------------------------------------------------------------------------


def test_duplicates_keep_the_first(tmp_path: Path) -> None:
    text = csv_text(standard()).split("\n")
    text.insert(100, text[99].replace(",", ",9", 1))
    text.insert(200, text[199])
    trial = read_csv(tmp_path, "\n".join(text))
    assert kinds(trial) == {"duplicate": 2}
    np.testing.assert_allclose(trial.position, np.deg2rad(HEADING), atol=2e-6)


def test_backward_steps_are_left_out(tmp_path: Path) -> None:
    time = TIME.copy()
    time[[50, 51, 300]] -= 0.2
    trial = read_csv(tmp_path, csv_text(standard(time_s=time)))
    assert kinds(trial) == {"backward": 3}
    assert np.all(np.diff(trial.time) > 0)
    assert len(trial.time) == 397
    assert "line 52" in trial.remarks[0].text


def test_coarse_stamps_are_refused(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"repeats the stamp before it in 380 of 400.*more decimals"):
        read_csv(tmp_path, csv_text(standard(time_s=np.floor(TIME))))


def test_a_clock_that_is_set_back_is_not_sorted(config: Config) -> None:
    time = TIME.copy()
    time[200:] -= 5.0
    with pytest.raises(LogError, match=r"log time of /heading runs backwards at message 201, from 9\.95 s to 5 s"):
        trial_of(config, heading=(time, HEADING % 360), fore=([0.0], [1.0]))


def test_a_clock_that_leaps_is_refused(tmp_path: Path) -> None:
    time = TIME.copy()
    time[20:] += 1.7e9
    with pytest.raises(LogError, match=r"leaps by 1\.7e\+09 s after sample 20"):
        read_csv(tmp_path, csv_text(standard(time_s=time)))


@pytest.mark.parametrize(("scale", "words"), [(1e3, "50 s apart"), (1e-3, "5e-05 s apart")])
def test_time_in_a_wrong_unit_is_refused(scale: float, words: str, tmp_path: Path) -> None:
    with pytest.raises(LogError, match=f"{words}.*unit = .s.*time"):
        read_csv(tmp_path, csv_text(standard(time_s=TIME * scale), form=".7f"))


# --- heading that is none --------------------------------------------------------------------------------


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


# --- units -----------------------------------------------------------------------------------------------


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
    with pytest.raises(LogError, match=r"heading_deg is declared in degrees but looks like radians.*unit = .rad."):
        read_csv(tmp_path, text)


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
    with pytest.raises(LogError, match=r"declared in radians but looks like degrees.*unit = .deg."):
        read_csv(tmp_path, text, config)


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
    with pytest.raises(LogError) as caught:
        read_csv(tmp_path, gyro_log(scale, sweep(40.0, 100.0)), config)
    assert mend in str(caught.value)


def test_the_gyro_names_a_heading_in_radians(config: Config, tmp_path: Path) -> None:
    heading = sweep(40.0, 100.0)
    rate = np.gradient(np.deg2rad(heading), LONG)
    with pytest.raises(LogError, match=r'unit = "rad" in \[signals\] heading'):
        trial_of(config, heading=(LONG, np.deg2rad(heading)), fore=([0.0], [1.0]), yaw_rate=(LONG, rate))


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
