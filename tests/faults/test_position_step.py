"""A position that jumps and stays."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rovid.faults.base import TrialData
from rovid.faults.position_step import DETECTORS
from rovid.trial.axis import axis_named
from rovid.trial.fault import Fault
from rovid.trial.preprocessing import split
from rovid.trial.trial import Readings, Trial
from tests.faults.drives import drives
from tests.synthetic import VEHICLE

NOISE, INTERVAL = 0.05, 0.5


def tracked(tmp_path: Path, *, jump: tuple[float, float] = (0.0, 0.0), rounded: float = 0.0, back: int = 0) -> Trial:
    """A trial with a position every 0.5 s that jumps after two thirds, and ``back`` readings later returns."""
    trial = dict(drives(3))["prbs 5.0"].trial(tmp_path)
    time = np.arange(0.0, trial.time[-1], INTERVAL)
    heading = np.interp(time, trial.time, np.where(trial.measured, trial.position, 0.0))
    at, rng = 2 * len(time) // 3, np.random.default_rng(5)
    away = (np.arange(len(time)) >= at) & ((np.arange(len(time)) < at + back) | (back == 0))
    readings = {}
    for name, rate, size in (("north", np.cos(heading), jump[0]), ("east", np.sin(heading), jump[1])):
        values = np.cumsum(0.8 * INTERVAL * rate) + NOISE * rng.normal(size=len(time)) + size * away
        readings[name] = Readings(time=time, values=np.round(values / rounded) * rounded if rounded else values)
    return replace(trial, readings=readings)


def found(trial: Trial) -> list[Fault]:
    return [one.fault for detect in DETECTORS["trial"] for one in detect(TrialData(trial=trial, vehicle=VEHICLE))]


def test_a_jump_is_found_and_the_log_is_cut(tmp_path: Path) -> None:
    trial = tracked(tmp_path, jump=(1.5, -2.0))
    (fault,) = found(trial)
    time = trial.readings["north"].time
    assert fault.at == pytest.approx((time[2 * len(time) // 3],))
    assert fault.size is not None
    assert fault.standard_error is not None
    # The course turns within the readings on each side: a tenth of the way in them.
    assert abs(fault.size - 2.5) < 4.0 * fault.standard_error + 0.1 * 0.8 * 8 * INTERVAL
    ((detect,),) = (DETECTORS["trial"],)
    (one,) = detect(TrialData(trial=trial, vehicle=VEHICLE))
    first, second = split(one.repair(TrialData(trial=trial, vehicle=VEHICLE)).trial)
    assert len(first.readings["north"].time) + len(second.readings["north"].time) == len(time)


@pytest.mark.parametrize("jump", [0.0, 2.0])
def test_a_depth_that_jumps_is_found_and_one_of_the_heading_is_not_its_business(jump: float, tmp_path: Path) -> None:
    trial = dict(drives(3))["prbs 5.0"].trial(tmp_path)
    at = 2 * len(trial.time) // 3
    moved = replace(trial, position=trial.position + jump * (np.arange(len(trial.time)) >= at))
    assert not found(moved)
    faults = found(replace(moved, axis=axis_named("heave")))
    assert [fault.at[0] for fault in faults] == pytest.approx([trial.time[at]] if jump else [])
    assert all("the depth jumps and stays" in fault.text for fault in faults)


def test_noise_wild_readings_and_coarse_positions_are_no_jumps(tmp_path: Path) -> None:
    assert not found(tracked(tmp_path))
    assert not found(tracked(tmp_path, jump=(3.0, 3.0), back=2))
    assert not found(tracked(tmp_path, rounded=1.0))
    assert not found(replace(tracked(tmp_path, jump=(3.0, 3.0)), readings={}))
