"""No response to commands, and two sources in one signal."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rovid.faults.base import RunsData, examine
from rovid.faults.no_response import DETECTORS
from rovid.trial.fault import FaultOverrides
from rovid.trial.preprocessing import prepare_trials
from rovid.trial.vehicle import Rudder
from tests.conftest import slow
from tests.faults.days import VEHICLES, day
from tests.faults.drives import drives, found, undamaged
from tests.synthetic import LOGGED


@pytest.mark.parametrize("seed", [0, slow(1), slow(2)])
@pytest.mark.parametrize("name", ["hold_2.csv", "sine_1.csv", "random.csv"])
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_a_log_without_motion_is_named_and_set_aside(vehicle: str, name: str, seed: int) -> None:
    runs = day(vehicle, seed, still=name)
    data, (fault,) = examine(DETECTORS["runs"], RunsData(runs=runs, vehicle=LOGGED), FaultOverrides())
    assert (fault.logs, fault.remedy, fault.stops) == ((name,), "set_aside", False)
    assert "does not respond" in fault.text
    assert len(data.runs) == 9
    kept, (fault,) = examine(
        DETECTORS["runs"], RunsData(runs=runs, vehicle=LOGGED), FaultOverrides(kept={"no_response": (name,)})
    )
    assert (fault.remedy, len(kept.runs)) == ("none", 10)


def test_a_heading_that_repeats_one_reading_may_be_frozen() -> None:
    runs = [run.trial for run in day("small", 1)]
    last = len(runs[-1].time) // 2
    frozen = np.where(np.arange(len(runs[-1].time)) < last, runs[-1].position, runs[-1].position[last])
    stuck = prepare_trials([*runs[:-1], replace(runs[-1], position=frozen)], LOGGED).items
    _, (fault,) = examine(DETECTORS["runs"], RunsData(runs=stuck, vehicle=LOGGED), FaultOverrides())
    assert f"{len(frozen) - last} successive readings of the heading are equal" in fault.text


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_a_log_whose_thrusters_stop_pushing_is_named_with_the_instant(vehicle: str) -> None:
    runs = day(vehicle, 1, off="random.csv", disturbance=0.002)
    data, (fault,) = examine(DETECTORS["runs"], RunsData(runs=runs, vehicle=LOGGED), FaultOverrides())
    assert (fault.logs, fault.remedy, len(data.runs)) == (("random.csv",), "set_aside", 9)
    half = 0.5 * runs[-1].trial.time[-1]
    # The window of five time constants begins after the coast-down.
    assert half <= fault.at[0] < 1.5 * half
    assert "[[leave_out]]" in fault.text


@pytest.mark.parametrize("until", [0.5, 0.7])
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_a_supply_interrupted_in_a_hold_is_named_with_its_stretch(vehicle: str, until: float) -> None:
    """The supply returns during the hold, which ends at 0.625, or does not."""
    runs = day(vehicle, 2, off="hold_1.csv", off_from=0.35, off_until=until)
    _, (fault,) = examine(DETECTORS["runs"], RunsData(runs=runs, vehicle=LOGGED), FaultOverrides())
    end = next(run.trial.time[-1] for run in runs if run.trial.name == "hold_1.csv")
    assert fault.logs == ("hold_1.csv",)
    # The windows of a time constant, 1/40 of the log, begin every quarter of it; the filter takes two of them.
    assert fault.at[0] == pytest.approx(0.35 * end, abs=0.05 * end)
    assert "[[leave_out]]" in fault.text


def test_a_rudder_turns_nothing_where_the_vehicle_does_not_move_ahead() -> None:
    runs = day("large", 1, off="random.csv", disturbance=0.002)
    rudder = replace(LOGGED.thrusters[0], rudder=Rudder(position=(-1.0, 0.0)))
    steered = replace(LOGGED, thrusters=(rudder,), planar=True)
    assert not examine(DETECTORS["runs"], RunsData(runs=runs, vehicle=steered), FaultOverrides())[1]


@pytest.mark.parametrize("seed", [0, 1, slow(2), slow(3), slow(4)])
@pytest.mark.parametrize("disturbance", [0.002, 0.1])
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_logs_that_move_give_nothing(vehicle: str, disturbance: float, seed: int) -> None:
    runs = day(vehicle, seed, disturbance=disturbance)
    assert not examine(DETECTORS["runs"], RunsData(runs=runs, vehicle=LOGGED), FaultOverrides())[1]
    assert not examine(DETECTORS["runs"], RunsData(runs=runs[:1], vehicle=LOGGED), FaultOverrides())[1]


@pytest.mark.parametrize("offset", [1.0, 7.0, -40.0, 170.0])
@pytest.mark.parametrize("strict", [True, False])
def test_the_source_with_more_readings_is_taken(offset: float, tmp_path: Path, *, strict: bool) -> None:
    drive = dict(drives(1, interval=0.05))["sine 5.0"]
    row = np.arange(len(drive.time))
    second = row % 2 == 1 if strict else np.random.default_rng(2).random(len(row)) < 0.3
    logged = np.round((drive.heading + offset * second) % 360.0, 4)
    trial = drive.trial(tmp_path, heading=logged)
    (fault,) = found(trial, "two_sources")
    assert fault.size is not None
    # Motion within an interval adds to the change of the source.
    assert np.rad2deg(fault.size) == pytest.approx(abs(offset), abs=0.2)
    assert trial.measured.sum() >= 0.5 * len(row) - 1
    first = int(np.flatnonzero(np.isclose(logged, np.rad2deg(trial.position[0]) % 360.0))[0])
    kept = first + np.rint(trial.time[trial.measured] / 0.05).astype(int)
    assert len(set(second[kept].tolist())) == 1


@pytest.mark.parametrize("seed", range(3, 7))
def test_undamaged_logs_have_one_source(seed: int, tmp_path: Path) -> None:
    assert not [name for name, trial in undamaged(seed, tmp_path) if found(trial, "two_sources")]
