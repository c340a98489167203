"""Steps and gaps of the heading."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.faults.base import TrialData
from rovid.faults.heading_step import DETECTORS
from rovid.readers.ulg_reader import _resets
from rovid.trial.axis import AXES
from rovid.trial.preprocessing import split
from tests.faults.drives import drives, found, undamaged
from tests.synthetic import VEHICLE


@pytest.mark.parametrize("degrees", [4.0, 25.0, -90.0, 179.0])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_jump_is_found_with_instant_and_size(degrees: float, seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    for name, drive in drives(seed, interval=0.05):
        if name in {"sine 0.5", "sine 5.0", "prbs 5.0", "staircase 5.0"}:
            at = int(rng.integers(50, 550))
            trial = drive.with_step(at, degrees).trial(tmp_path)
            (fault,) = found(trial, "heading_step")
            assert fault.at == pytest.approx((drive.time[at],)), name
            assert fault.size is not None
            assert fault.standard_error is not None
            # Rates that change within four readings add to the error by noise: half a degree on these vehicles.
            error = (fault.size - np.deg2rad(degrees) + np.pi) % (2.0 * np.pi) - np.pi
            assert abs(error) < 4.0 * fault.standard_error + np.deg2rad(0.5), name
            assert [part.time[-1] > 0.0 for part in split(trial)] == [True, True]


def test_a_jump_of_another_angle_has_its_name(tmp_path: Path) -> None:
    trial = dict(drives(3))["sine 5.0"].trial(tmp_path)
    jump = np.where(np.arange(len(trial.time)) < 300, 0.0, np.deg2rad(20.0))
    data = TrialData(trial=replace(trial, axis=AXES["roll"], position=trial.position + jump), vehicle=VEHICLE)
    (fault,) = [one.fault for detect in DETECTORS["trial"] for one in detect(data)]
    assert "the roll jumps and stays" in fault.text


def test_a_jump_after_a_single_change_of_the_command_is_found(tmp_path: Path) -> None:
    """The vehicle slows down from then on, and does not turn away and go on as before."""
    drive = dict(drives(3))["coast 0.5"].with_step(243, 20.0)
    (fault,) = found(drive.trial(tmp_path), "heading_step")
    assert fault.at == pytest.approx((24.3,))


def test_several_jumps_are_all_found(tmp_path: Path) -> None:
    drive = dict(drives(3))["sine 5.0"].with_step(100, 20.0).with_step(300, -40.0).with_step(420, 8.0)
    times = [fault.at[0] for fault in found(drive.trial(tmp_path), "heading_step")]
    assert times == pytest.approx([10.0, 30.0, 42.0])


@pytest.mark.parametrize("seed", range(4, 8))
def test_undamaged_logs_have_no_jump(seed: int, tmp_path: Path) -> None:
    assert not [name for name, trial in undamaged(seed, tmp_path) if found(trial, "heading_step")]


def test_readings_with_the_stamps_of_their_neighbours_do_not_jump(tmp_path: Path) -> None:
    """Each damaged row has the stamp that the row before it had; two in a row leave a stamp that is not repeated."""
    drive = dict(drives(3, interval=0.5))["staircase 0.5"]
    late = np.random.default_rng(1).random(len(drive.time)) < 0.1
    late[:2] = False
    damaged = replace(drive, time=np.where(late, np.roll(drive.time, 1), drive.time))
    trial = damaged.trial(tmp_path)
    assert found(trial, "repeated_stamps")
    assert not found(trial, "heading_step")
    slow = dict(drives(3, interval=0.1))["sine 5.0"].with_step(300, 90.0)
    jumping = replace(slow, time=np.where(late, np.roll(slow.time, 1), slow.time)).trial(tmp_path)
    assert found(jumping, "repeated_stamps")
    assert len(found(jumping, "heading_step")) == 1


def test_a_wild_reading_is_no_jump(tmp_path: Path) -> None:
    """Slow logs hold wild readings that a vehicle could follow; the heading is back with the next reading."""
    drive = dict(drives(3))["sine 5.0"]
    for length in (1, 2):
        heading = drive.heading.copy()
        heading[243 : 243 + length] += 6.0
        trial = replace(drive, heading=heading, time=5.0 * drive.time).trial(tmp_path)
        assert trial.measured.all()
        assert found(trial, "heading_step") == []


def test_spikes_wraps_and_frozen_stretches_are_no_jumps(tmp_path: Path) -> None:
    drive = dict(drives(8))["sine 5.0"]
    spiked = drive.heading.copy()
    spiked[[60, 200, 201, 400]] += 30.0
    frozen = drive.heading.copy()
    frozen[300:340] = frozen[300]
    for heading in (spiked, frozen):
        assert not found(drive.trial(tmp_path, heading=heading % 360.0), "heading_step")


def test_resets_that_a_ulog_states() -> None:
    half = np.deg2rad(25.0) / 2.0
    still, turn = (1.0, 0.0, 0.0, 0.0), (np.cos(half), 0.0, 0.0, np.sin(half))
    parts: list[FloatArray] = list(np.array([still, still, turn, turn]).T)
    columns = {f"delta_q_reset[{at}]": part for at, part in enumerate(parts)}
    columns["quat_reset_counter"] = np.array([255, 255, 0, 0], dtype=np.uint8)
    ((at, size),) = _resets(columns, np.arange(4.0), 1.0)
    assert (at, np.rad2deg(size)) == pytest.approx((2.0, 25.0))
    assert _resets({}, np.arange(4.0), 1.0) == ()


def test_a_stated_reset_is_cut_once(tmp_path: Path) -> None:
    drive = dict(drives(9))["sine 5.0"]
    trial = drive.trial(tmp_path)
    (detection,) = DETECTORS["trial"][0](TrialData(trial=trial, vehicle=VEHICLE, resets=((30.0, 0.1), (40.0, 1e-4))))
    assert detection.repair(TrialData(trial=trial, vehicle=VEHICLE)).trial.cuts == (30.0,)
    assert "states a reset of the heading at 30.00 s, by +5.7 deg" in detection.fault.text
    stepped = drive.with_step(300, 25.0).trial(tmp_path)
    assert len(list(DETECTORS["trial"][0](TrialData(trial=stepped, vehicle=VEHICLE, resets=((29.95, 0.44),))))) == 1


def test_gaps_are_counted_and_left_open(tmp_path: Path) -> None:
    drive = dict(drives(1))["sine 5.0"]
    cells = [f"{value:.3f}" for value in drive.heading % 360.0]
    for first, last in ((100, 130), (300, 309)):
        cells[first:last] = [""] * (last - first)
    trial = drive.trial(tmp_path, heading=cells)
    (fault,) = found(trial, "heading_gaps")
    assert fault.at == pytest.approx((9.9, 29.9))
    assert fault.size == pytest.approx(3.1 + 1.0)
    assert "in 2 gaps, 4.1 s in all, the longest of 3.1 s from 9.9 s on" in fault.text
    assert not np.isfinite(trial.position[100:130]).any()


@pytest.mark.parametrize("seed", [2, 3])
def test_undamaged_logs_have_no_gaps(seed: int, tmp_path: Path) -> None:
    assert not [name for name, trial in undamaged(seed, tmp_path) if found(trial, "heading_gaps")]
