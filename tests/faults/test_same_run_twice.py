"""A recording that was given twice."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.faults.base import CampaignData, RunsData, examine
from rovid.faults.same_run_twice import DETECTORS
from rovid.readers import read_campaign
from rovid.trial.config import Config
from rovid.trial.fault import FaultOverrides
from rovid.trial.preprocessing import Run
from rovid.trial.rates import compute_rates
from tests.faults.days import VEHICLES, day
from tests.readers.logs import csv_text, mcap_bytes, stamped, to_ns, turning
from tests.readers.test_formats import log, names
from tests.synthetic import LOGGED, trial


def test_copies_are_left_out(tmp_path: Path, config: Config) -> None:
    (tmp_path / "a.csv").write_text(log(1))
    (tmp_path / "copy of a.csv").write_text(log(1))
    (tmp_path / "other.csv").write_text(log(1, rate=5.0))
    found = read_campaign([tmp_path], config)
    assert names(found) == ["a.csv", "other.csv"]
    (fault,) = found.faults
    assert (fault.fault, fault.logs, fault.remedy) == ("same_run_twice", ("copy of a.csv",), "counted_once")


def motion(seed: int, count: int = 2400) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(time, heading deg, command) of a run with rest, turns to both sides and noise of 0.01 deg."""
    time = np.arange(float(count)) * 0.05
    command = np.where(time < 20, 0.0, np.where(time < 60, 1.5, np.where(time < 90, -1.0, 0.0)))
    rate = np.zeros(count)
    for k in range(1, count):
        rate[k] = rate[k - 1] + 0.05 * (6.0 * command[k] - rate[k - 1]) / 3.0
    heading = 100.0 + np.cumsum(rate) * 0.05 + np.random.default_rng(seed).normal(0.0, 0.01, count)
    return time, heading, command


def as_csv(seed: int, part: slice = slice(None), decimals: int = 3, late: float = 0.0) -> str:
    time, heading, command = (values[part] for values in motion(seed))
    return csv_text(
        {"time_s": time - late, "heading_deg": np.round(heading, decimals) % 360.0, "fore_V": command}, form=".6f"
    )


def as_mcap(seed: int) -> bytes:
    time, heading, command = motion(seed)
    messages = [
        ("/phins/heading", int(ns), stamped(h % 360, int(ns))) for ns, h in zip(to_ns(time), heading, strict=True)
    ]
    messages += [("/thrusters/fore", int(ns), stamped(u, int(ns))) for ns, u in zip(to_ns(time), command, strict=True)]
    return mcap_bytes(sorted(messages, key=lambda message: message[1]), compression="zstd")


SAME = {
    "both formats": (as_csv(1), "dive.csv"),
    "rounded to a tenth": (as_csv(1, decimals=1), "dive.csv"),
    "every second sample": (as_csv(1, slice(None, None, 2)), "dive.mcap"),
    "begun two seconds later": (as_csv(1, slice(40, None), late=2.0), "dive.mcap"),
    "cut short": (as_csv(1, slice(0, 1700)), "dive.mcap"),
}


@pytest.mark.parametrize("case", SAME)
def test_a_recording_given_twice_counts_once(case: str, tmp_path: Path, config: Config) -> None:
    text, kept = SAME[case]
    (tmp_path / "dive.csv").write_text(text)
    (tmp_path / "dive.mcap").write_bytes(as_mcap(1))
    found = read_campaign([tmp_path], config)
    assert names(found) == [kept]
    (fault,) = found.faults
    assert (fault.fault, fault.remedy) == ("same_run_twice", "counted_once")
    assert "is the same recording as" in fault.text


@pytest.mark.parametrize(
    ("cut", "decimals"), [(900, 2), (900, 3), (1500, 1), (1500, 2), (1500, 3), (2200, 1), (2200, 2), (2200, 3)]
)
def test_a_part_that_two_logs_share_counts_once(cut: int, decimals: int, tmp_path: Path, config: Config) -> None:
    """The second log begins at row ``cut - 600`` of the run, the first ends at row ``cut``."""
    (tmp_path / "a.csv").write_text(as_csv(1, slice(0, cut), decimals=decimals))
    (tmp_path / "b.csv").write_text(as_csv(1, slice(cut - 600, None), decimals=decimals, late=0.05 * (cut - 600)))
    if decimals > 1:  # Rounded to ten times the noise, a second run without disturbances is a copy.
        (tmp_path / "c.csv").write_text(as_csv(2, decimals=decimals))
    found = read_campaign([tmp_path], config)
    (fault,) = found.faults
    assert (fault.fault, fault.logs, fault.remedy) == ("same_run_twice", ("b.csv",), "counted_once")
    assert fault.at == (0.0,)
    assert fault.size == pytest.approx(30.0, abs=0.1)
    # All rows of the run are there once.
    assert sum(trial.measured.sum() for trial in found.trials[:2]) == 2400


def test_cycles_of_one_test_with_lost_rows_are_no_copies() -> None:
    """Parts of one log, and of two logs of one programme: where rows are lost, motion is no noise."""
    rng = np.random.default_rng(4)
    parts = []
    for number, parent in enumerate(("a.csv", "a.csv", "b.csv")):
        time = np.arange(0.0, 10.0, 0.05)[np.flatnonzero(rng.random(200) > 0.15)]
        swing = np.sin(2.0 * np.pi * time / 2.5)
        heading = np.deg2rad(20.0) * swing + rng.normal(0.0, np.deg2rad(0.05), len(time))
        parts.append(replace(trial(time, swing, heading, name=f"{parent}, part {number}"), parent=parent))
    data = CampaignData(trials=parts, vehicle=LOGGED)
    assert not examine(DETECTORS["campaign"], data, FaultOverrides())[1]


@pytest.mark.parametrize("decimals", [2, 3, 6])
def test_the_same_run_repeated_is_not_the_same_recording(decimals: int, tmp_path: Path, config: Config) -> None:
    """Same commands, same motion to the last hundredth: only the noise differs."""
    for seed in (1, 2, 3):
        (tmp_path / f"hold_{seed}.csv").write_text(as_csv(seed, decimals=decimals))
    (tmp_path / "hold_4.mcap").write_bytes(as_mcap(4))
    found = read_campaign([tmp_path], config)
    assert len(found.trials) == 4
    assert not found.remarks
    assert not found.faults


def test_two_rests_are_not_the_same_recording(tmp_path: Path, config: Config) -> None:
    time = turning(1200)[0]
    for seed in (1, 2):
        heading = 90.0 + np.random.default_rng(seed).normal(0.0, 0.01, 1200)
        (tmp_path / f"rest_{seed}.csv").write_text(
            csv_text({"time_s": time, "heading_deg": heading, "fore_V": 0.0 * time})
        )
    assert len(read_campaign([tmp_path], config).trials) == 2


def test_the_same_heading_under_other_commands_is_not_the_same(tmp_path: Path, config: Config) -> None:
    (tmp_path / "a.csv").write_text(as_csv(1))
    (tmp_path / "b.csv").write_text(as_csv(1).replace(",1.500000", ",2.500000"))
    assert len(read_campaign([tmp_path], config).trials) == 2


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_a_second_sensor_counts_once(vehicle: str, seed: int) -> None:
    """Each run again, by a sensor with its own noise and another zero."""
    runs = day(vehicle, seed)
    names = [run.trial.name for run in runs]
    every = [*runs, *(by_another_sensor(run, 200 + k) for k, run in enumerate(runs))]
    data, faults = examine(DETECTORS["runs"], RunsData(runs=every, vehicle=LOGGED), FaultOverrides())
    assert [run.trial.name for run in data.runs] == names
    assert len(faults) == len(names)
    assert all(fault.size == pytest.approx(7.3, abs=0.02) for fault in faults)  # 5 errors of the noise.
    assert {fault.remedy for fault in faults} == {"counted_once"}


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_a_short_run_by_two_sensors_is_known_by_its_absolute_time(vehicle: str) -> None:
    """Too short for a correlation of disturbances, which are below the noise."""
    runs = day(vehicle, 1, disturbance=1e-4)
    times = [1.7e9 + 1000.0 * number for number in range(len(runs))]
    runs = [at_epoch(run, epoch) for run, epoch in zip(runs, times, strict=True)]
    second = by_another_sensor(runs[0], 7)
    data, (fault,) = examine(DETECTORS["runs"], RunsData(runs=[*runs, second], vehicle=LOGGED), FaultOverrides())
    assert fault.logs == (second.trial.name,)
    assert "the same absolute time" in fault.text
    assert list(data.runs) == runs


def at_epoch(run: Run, epoch: float) -> Run:
    return replace(run, trial=replace(run.trial, start_epoch=epoch))


@pytest.mark.parametrize("disturbance", [0.002, 0.05])
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_a_programme_run_twice_is_not_one_run(vehicle: str, disturbance: float) -> None:
    """Same commands on two days, with their own disturbances."""
    first, second = (day(vehicle, seed, disturbance=disturbance) for seed in (1, 2))
    pairs = zip(first, second, strict=True)
    every = [*first, *(run for one, run in pairs if np.array_equal(one.torque, run.torque))]
    assert len(every) == 18
    assert not examine(DETECTORS["runs"], RunsData(runs=every, vehicle=LOGGED), FaultOverrides())[1]


def test_a_second_compass_with_a_deviation_counts_once() -> None:
    runs = day("large", 1, disturbance=0.005)[4:]
    every = [*runs, *(by_another_sensor(run, 200 + k, deviation=1.5) for k, run in enumerate(runs))]
    data, faults = examine(DETECTORS["runs"], RunsData(runs=every, vehicle=LOGGED), FaultOverrides())
    assert [run.trial.name for run in data.runs] == [run.trial.name for run in runs]
    assert any("deviation of the compass" in fault.text for fault in faults)


def test_a_common_error_of_the_model_makes_no_copy() -> None:
    """A lag of the thrusters in two runs of one programme in calm water, in which the positions agree to the noise."""
    first, second = (day("small", seed, disturbance=2e-4) for seed in (1, 2))
    pairs = zip(first, second, strict=True)
    every = [*first, *(run for one, run in pairs if np.array_equal(one.torque, run.torque))]
    lagged = [early(run, 3) for run in every]
    assert not examine(DETECTORS["runs"], RunsData(runs=lagged, vehicle=LOGGED), FaultOverrides())[1]


def early(run: Run, samples: int) -> Run:
    """``run`` with its commands ``samples`` earlier."""
    torque = np.roll(run.torque, -samples)
    return replace(run, torque=torque, filtered_torque=run.rates.filter_held(run.trial, torque))


def by_another_sensor(run: Run, seed: int, deviation: float = 0.0) -> Run:
    noise = np.random.default_rng(seed).normal(0.0, np.deg2rad(0.05), len(run.trial.time))
    position = run.trial.position + np.deg2rad(7.3 + deviation * np.sin(run.trial.position)) + noise
    trial = replace(run.trial, name=f"second_{run.trial.name}", position=position)
    return replace(run, trial=trial, rates=compute_rates(trial, cutoff=run.rates.kernel.cutoff))
