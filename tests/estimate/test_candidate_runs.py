"""Candidate runs within the limits of a crew."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.estimate.candidate_runs import LEAD_SECONDS, RunScales, candidate_runs
from rovid.model.model import Model
from rovid.trial.vehicle import ThrustCurve, Thruster, Vehicle
from tests.synthetic import VEHICLE, clock, trial

MODEL = Model(inertia=5057.0, quadratic_drag=3532.0, linear_drag=132.37)


def test_every_run_starts_at_rest_within_the_commands_in_use() -> None:
    time = clock(60.0)
    log = trial(time, np.where(time < 30.0, 2.0, -1.5))
    scales = RunScales.from_trials(MODEL, VEHICLE, [log], 0.5)
    runs = candidate_runs(scales, ["a"])
    assert len({run.name for run in runs}) == len(runs) > 20
    for run in runs:
        assert (run.commands[run.time < LEAD_SECONDS] == run.commands[0]).all()
        assert run.commands.max() <= 0.5 * 2.0 + 1e-9
        assert run.commands.min() >= 0.5 * -1.5 - 1e-9
        assert np.diff(run.time) == pytest.approx(scales.period)
        assert run.commands.min() < 0.0 < run.commands.max() or "alone at rest" in run.name


def test_a_side_that_was_never_driven_gets_the_reach_of_the_other() -> None:
    time = clock(60.0)
    scales = RunScales.from_trials(MODEL, VEHICLE, [trial(time, np.where(time < 30.0, 2.0, 0.0))], 0.5)
    assert np.abs(scales.full).ravel() == pytest.approx(1.0)


def test_no_run_exceeds_a_curve_with_an_off_centre_neutral() -> None:
    curve = ThrustCurve(command=np.array([-1.0, 0.05, 1.0]), thrust=np.array([-40.0, 0.0, 40.0]))
    vehicle = Vehicle(name="test", thrusters=(Thruster(name="a", arm=1.0, curve=curve),))
    time = clock(60.0)
    scales = RunScales.from_trials(MODEL, vehicle, [trial(time, np.where(time < 30.0, 1.0, -1.0))], 1.0)
    for run in candidate_runs(scales, ["a"]):
        assert np.abs(run.commands).max() <= 1.0
