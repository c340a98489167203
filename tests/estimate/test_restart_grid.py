"""Runs on a grid, and where predictions begin and end."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.estimate.restart_grid import HORIZONS, GriddedRuns, Trajectory, grid_run
from tests import synthetic

TIME = synthetic.clock(400.0, rate=5.0)
TORQUE = np.where(TIME % 100.0 < 50.0, 100.0, -100.0)


def test_a_rate_that_the_filter_has_not_is_bridged_by_the_angle() -> None:
    time = np.arange(6.0)
    rate = np.array([np.nan, 3.0, 3.0, 3.0, 3.0, np.nan])
    angle = 10.0 + 2.0 * time
    angle[3] = np.nan
    motion = Trajectory.of(time, angle, rate, np.ones(6))
    assert motion.angle == pytest.approx(2.0 * time)
    assert motion.bridged_rate == pytest.approx([2.0, 3.0, 3.0, 3.0, 3.0, 2.0])


def test_each_prediction_is_as_long_as_its_horizon() -> None:
    constant = 10.0
    course = grid_run(synthetic.run(TIME, TORQUE), constant, 0.25 * constant)
    grid = course.grid
    lengths = course.time[grid.ends] - course.time[grid.starts]
    wanted = np.array(HORIZONS)[course.horizon] * constant
    # To half a step of the grid.
    assert np.abs(lengths - wanted).max() <= 0.5 * course.period + 1e-9
    assert (grid.restarts[grid.restart_number] == grid.starts).all()
    assert (grid.ends <= grid.restarts[grid.restart_number] + grid.reach[grid.restart_number]).all()


def test_courses_one_after_the_other_keep_their_own_predictions() -> None:
    one = grid_run(synthetic.run(TIME, TORQUE), 10.0, 2.5)
    courses = GriddedRuns([one, one])
    both = courses.grid
    count, length = len(one.grid.starts), len(one.time)
    assert (both.starts[:count] == one.grid.starts).all()
    assert (both.starts[count:] == one.grid.starts + length).all()
    assert (both.restarts[both.restart_number] == both.starts).all()
    assert set(both.run.tolist()) == {0, 1}
    # A mean at the end of the first run knows nothing of the second.
    assert (courses.torque[:length] == courses.torque[length:]).all()
    assert (courses.trajectory.angle[length:] == one.trajectory.angle).all()
