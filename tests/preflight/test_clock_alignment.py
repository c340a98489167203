"""Offsets between clocks, from signals in both files or from the response of the vehicle."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmarks.clocks import told
from rovid.core.array_types import FloatArray
from rovid.preflight import clock_offsets
from rovid.preflight.clock_alignment import ClockOffset, ClockOffsets, align_clocks
from rovid.preflight.raw_columns import RawColumn
from rovid.readers import read_campaign
from rovid.trial.config import Config, load_config
from rovid.trial.log_files import Join
from tests.conftest import Rovid, slow
from tests.readers.test_formats import day
from tools.folders import Clocks, write_folder
from tools.wide import draw, write_campaign

LASTS, STEP = 200.0, 0.1


def turn(seed: int) -> tuple[FloatArray, FloatArray]:
    """(n,) times on a fine grid, and a heading in rad over several turns."""
    rng = np.random.default_rng(seed)
    time = np.arange(-10.0, LASTS + 10.0, 0.02)
    rate = np.zeros(len(time))
    pushes = np.repeat(rng.uniform(-0.6, 0.6, len(time) // 150 + 1), 150)[: len(time)]
    for k in range(1, len(time)):
        rate[k] = rate[k - 1] + 0.02 * (pushes[k] - rate[k - 1]) / 1.5
    return time, np.cumsum(rate) * 0.02


def columns(seed: int, *, ahead: float, drift: float = 0.0, noise: float = 0.05) -> tuple[dict[str, RawColumn], ...]:
    """Headings of two loggers in different units and signs; the clock of the second is ``ahead``."""
    rng = np.random.default_rng(100 + seed)
    fine, angle = turn(seed)
    one, two = np.arange(0.0, LASTS, STEP), np.arange(0.05, LASTS, 2.0 * STEP)
    heading = np.degrees(np.interp(one, fine, angle)) + noise * rng.normal(size=len(one))
    other = -np.interp(two, fine, angle) + np.radians(noise) * rng.normal(size=len(two))
    stamps = two + ahead + drift * two
    return (
        {"heading_deg": RawColumn(source="heading_deg", time=one, values=heading % 360.0)},
        {"yaw_rad": RawColumn(source="yaw_rad", time=stamps, values=(other + np.pi) % (2.0 * np.pi) - np.pi)},
    )


def found(seed: int, *, ahead: float, drift: float = 0.0, noise: float = 0.05) -> ClockOffset:
    alignment = align_clocks(*columns(seed, ahead=ahead, drift=drift, noise=noise))
    assert alignment is not None
    return alignment


@pytest.mark.parametrize("noise", [0.01, 0.3])
@pytest.mark.parametrize("ahead", [-1.7, 0.0, 0.5])
def test_an_offset_is_found_within_its_error(ahead: float, noise: float) -> None:
    alignments = [found(seed, ahead=ahead, noise=noise) for seed in range(6)]
    off = np.array([one.offset + ahead for one in alignments])
    errors = np.array([one.error for one in alignments])
    assert np.all(np.abs(off) < 4.0 * errors)
    assert np.mean(np.abs(off) < 2.0 * errors) >= 0.5
    assert errors.max() < 0.05


def test_a_drift_is_found_within_its_error() -> None:
    one = found(3, ahead=0.3, drift=400e-6, noise=0.02)
    assert one.drift == pytest.approx(-400.0, abs=3.0 * one.drift_error)
    assert abs(one.drift) > 3.0 * one.drift_error


def test_a_yaw_rate_is_aligned_with_a_heading() -> None:
    home, _ = columns(5, ahead=0.0)
    fine, angle = turn(5)
    time = np.arange(0.0, LASTS, STEP)
    rate = np.degrees(np.gradient(np.interp(time, fine, angle), time))
    gyro = {"yaw_rate_dps": RawColumn(source="yaw_rate_dps", time=time + 0.8, values=rate)}
    alignment = align_clocks(home, gyro)
    assert alignment is not None
    assert alignment.offset == pytest.approx(-0.8, abs=3.0 * alignment.error)
    assert alignment.by == "yaw_rate_dps against heading_deg"


def test_a_copied_command_is_aligned_but_not_its_response() -> None:
    time = np.arange(0.0, LASTS, STEP)
    command = np.repeat(np.random.default_rng(1).uniform(-1.0, 1.0, len(time) // 20 + 1), 20)[: len(time)]
    late = np.convolve(command, np.exp(-np.arange(30) / 8.0) / 8.0)[: len(time)]

    def log(name: str, values: FloatArray, ahead: float = 0.0) -> dict[str, RawColumn]:
        return {name: RawColumn(source=name, time=time + ahead, values=values)}

    copy = align_clocks(log("port_cmd", command), log("thr_port", command, -0.4))
    assert copy is not None
    assert copy.offset == pytest.approx(0.4, abs=max(3.0 * copy.error, 0.01))
    assert align_clocks(log("port_cmd", command), log("motor_port", late)) is None


def test_unrelated_signals_are_not_aligned() -> None:
    one, _ = columns(7, ahead=0.0)
    _, two = columns(8, ahead=0.0)
    assert align_clocks(one, two) is None
    assert align_clocks(one, {}) is None


@pytest.mark.parametrize(
    ("offset", "by", "certain", "said"),
    [
        (-0.5, "", True, "responds 0.500 ± 0.020 s before the commands in thr, which is impossible"),
        (0.5, "", False, "The logs do not show which"),
        (0.05, "", False, "(none seen)"),
        (0.5, "yaw against heading", True, "0.500 ± 0.020 s behind, by yaw against heading in both files"),
        (-0.05, "yaw", False, "0.050 ± 0.020 s ahead"),
    ],
)
def test_a_clock_in_words(offset: float, by: str, certain: bool, said: str) -> None:
    clock = ClockOffset(name="thr", offset=offset, error=0.02, by=by)
    assert clock.certain is certain
    assert said in clock.text


def test_join_settings_add_to_the_existing_ones() -> None:
    clock = ClockOffset(name="a b.csv", offset=0.2, error=0.01, drift=30.0, drift_error=2.0, by="yaw", given=(1.0, 5.0))
    assert clock.join_settings == {"offset": '"a b.csv" = 1.200', "drift": '"a b.csv" = 35.0'}


def test_equal_findings_are_grouped() -> None:
    late = [ClockOffset(name=f"{number}.csv", offset=0.5 + 0.1 * number, error=0.02) for number in range(12)]
    early = ClockOffset(name="x.csv", offset=-1.0, error=0.02)
    clocks = ClockOffsets(offsets=(*late, early), lag=0.3)
    assert clocks.groups == [tuple(late), (early,)]
    words = clocks.text(late)
    assert "thrust seems to lag the command by 0.3 s" in words
    assert "1.csv 0.600 ± 0.020" in words
    assert "and 3 more" in words


@pytest.mark.parametrize("apart", [0.0, 80.0])
def test_logs_that_begin_at_once_show_no_drift_of_a_day(apart: float) -> None:
    """Offsets that grow with the lengths of the logs are no drift of one clock, unless one log follows the other."""
    half = [30.0, 40.0, 50.0, 60.0]
    starts: dict[str, float | None] = {f"{k}": 1e9 + apart * k for k in range(4)}
    clocks = [
        ClockOffset(name=f"{k}", offset=0.5 + 4e-3 * (apart * k + half[k]), error=0.005, middle=half[k])
        for k in range(4)
    ]
    drifts = [clock.drift for clock in clock_offsets.pooled_offsets(clocks, starts, None)]
    assert drifts == [pytest.approx(4000.0 if apart else 0.0)] * 4


def test_files_with_offsets_of_their_own_are_not_one_clock() -> None:
    """What is left of their offsets is alike, but what [join] sets is not."""
    join = Join(parts=("ins", "thr"), offset={"1_thr.csv": -0.9, "2_thr.csv": -1.1})
    clocks = [ClockOffset(name=f"{k}_thr.csv", offset=0.001 * k, error=0.01) for k in range(1, 4)]
    starts: dict[str, float | None] = {clock.name: 1e9 for clock in clocks}
    assert [clock.name for clock in clock_offsets.pooled_offsets(clocks, starts, join)] == [
        "1_thr.csv",
        "2_thr.csv",
        "3_thr.csv",
    ]
    assert [clock.name for clock in clock_offsets.pooled_offsets(clocks, starts, replace(join, offset={}))] == ["thr"]


JOIN = 'parts = ["ins", "thr"]\n'


def clocks(rovid: Rovid, folder: str) -> list[dict[str, object]]:
    found: list[dict[str, object]] = rovid("check", folder, "--json").document["clocks"]
    return found


def test_a_response_before_the_command_is_a_clock_offset(tmp_path: Path, rovid: Rovid) -> None:
    folder = day(tmp_path / "day", split="{run}_{part}.csv", late=0.6)
    document = rovid("check", "day", "--json").document
    (one,) = document["clocks"]
    assert one["name"] == "thr"
    assert one["certain"] is True
    assert one["offset"] == pytest.approx(-0.6, abs=0.1)
    assert document["verdict"] == "no_go"
    (advice,) = [each for each in document["advice"] if each["kind"] == "clock_offset"]
    assert "which is impossible" in advice["text"]
    assert "Put offset = { thr = -0.6" in advice["text"]
    # `rovid fit` refuses for the same reason.
    refused = rovid("fit", "day")
    assert refused.code == 2
    assert "which is impossible" in refused.err
    assert "Put offset = { thr = -0.6" in refused.err
    # A first rovid.toml sets it, with the reason; nothing is left then.
    (folder / "rovid.toml").unlink()
    init = rovid("init", "day", "--json").document
    assert [each["name"] for each in init["clocks"]] == ["thr"]
    written = tomllib.loads((folder / "rovid.toml").read_text(encoding="utf-8"))
    assert written["join"]["offset"]["thr"] == pytest.approx(-0.6, abs=0.1)
    assert "which is impossible" in (folder / "rovid.toml").read_text(encoding="utf-8")
    settings = load_config(folder / "rovid.toml")
    trials = read_campaign([folder], settings).trials
    assert not any(clock.certain for clock in clock_offsets.estimate_clock_offsets(trials, settings).offsets)
    assert all(any(remark.kind == "clock" for remark in trial.remarks) for trial in trials)


def test_init_estimates_a_large_offset_again(tmp_path: Path, rovid: Rovid, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each estimate is that of what the setting before leaves."""
    folder = day(tmp_path / "day", split="{run}_{part}.csv")
    (folder / "rovid.toml").unlink()

    def estimate(_: object, config: Config) -> ClockOffsets:
        assert config.join is not None
        given = config.join.offset.get("thr", 0.0)
        rest = {0.0: -4.6, -4.6: -0.4, -5.0: 0.01}[given]
        return ClockOffsets(offsets=(ClockOffset(name="thr", offset=rest, error=0.1, given=(given, 0.0)),))

    monkeypatch.setattr(clock_offsets, "estimate_clock_offsets", estimate)
    (found,) = rovid("init", "day", "--json").document["clocks"]
    written = tomllib.loads((folder / "rovid.toml").read_text(encoding="utf-8"))
    assert written["join"]["offset"] == {"thr": pytest.approx(-4.99)}
    assert found["offset"] == pytest.approx(-4.99)


def test_a_late_response_is_not_called_a_clock_offset(tmp_path: Path, rovid: Rovid) -> None:
    folder = day(tmp_path / "day", split="{run}_{part}.csv", late=-0.6)
    document = rovid("check", "day", "--json").document
    (one,) = document["clocks"]
    assert one["certain"] is False
    assert one["offset"] == pytest.approx(0.6, abs=0.1)
    (advice,) = [each for each in document["advice"] if each["kind"] == "clocks"]
    assert "The logs do not show which" in advice["text"]
    (folder / "rovid.toml").unlink()
    assert rovid("init", "day").code == 0
    assert "offset" not in tomllib.loads((folder / "rovid.toml").read_text(encoding="utf-8"))["join"]


def test_a_heading_in_both_files_determines_each_offset(tmp_path: Path, rovid: Rovid) -> None:
    """The offset differs from run to run."""
    folder = day(tmp_path / "day", split="{run}_{part}.csv", block=JOIN)
    rng = np.random.default_rng(4)
    late = {"hold_03": 0.4, "steps": -0.7, "sine_20s": 1.1}
    for run, seconds in late.items():
        ins, thr = (folder / f"{run}_{part}.csv" for part in ("ins", "thr"))
        log, other = pd.read_csv(ins), pd.read_csv(thr)
        turned = np.unwrap(log["heading_deg"], period=360.0)
        other["compass_deg"] = np.interp(other["time_s"], log["time_s"], turned) + rng.normal(0.0, 0.02, len(other))
        other["time_s"] += seconds
        other.to_csv(thr, index=False)
    found = {str(one["name"]): one for one in clocks(rovid, "day") if one["by"]}
    assert found.keys() == {f"{run}_thr.csv" for run in late}
    for run, seconds in late.items():
        one = found[f"{run}_thr.csv"]
        assert one["certain"] is True
        assert one["offset"] == pytest.approx(-seconds, abs=max(4.0 * float(str(one["error"])), 0.01))


@pytest.mark.slow
@pytest.mark.parametrize(("index", "twice"), [(13, "heading"), slow(20, "rate"), (28, "")])
def test_clock_offsets_in_a_generated_folder(index: int, twice: str, tmp_path: Path) -> None:
    truth = write_folder(tmp_path, seed=77, index=index, clocks=Clocks(apart=0.9, drift=1e-4, twice=twice))
    rows = told(tmp_path, truth)
    assert not isinstance(rows, str)
    assert rows
    assert all(bool(row.by) is bool(twice) for row in rows)
    # Without the same in both files a lag of the thrusters stands against it.
    most = 0.05 if twice else 0.6
    assert all(abs(row.off) < max(most, 4.0 * row.error) for row in rows)
    assert all(row.certain for row in rows) or not twice


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "index"), [(78, 26), (91, 20)])
def test_water_that_swings_in_a_tank_is_no_early_response(seed: int, index: int, tmp_path: Path, rovid: Rovid) -> None:
    write_campaign(tmp_path / "day", draw(seed, index))
    document = rovid("check", "day", "--json").document
    assert not [one for one in document["clocks"] if one["certain"]]
    assert document["verdict"] == "care"


@pytest.mark.slow
def test_a_diagnosed_delay_may_be_a_clock_offset(tmp_path: Path, rovid: Rovid) -> None:
    day(tmp_path / "day", split="{run}_{part}.csv")
    document = rovid("diagnose", "day", "--json").document
    assert {finding["effect"] for finding in document["findings"]} & {"thruster_lag", "command_delay"}
    assert any("may be a clock offset of the joined files" in text for text in document["warnings"])
