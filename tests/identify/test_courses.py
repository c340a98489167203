"""Runs on a grid, and where predictions begin and end."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.identify.courses import HORIZONS, Grid, course_of, means_on, motion_of
from tests import synthetic

TIME = synthetic.clock(400.0, rate=5.0)
TORQUE = np.where(TIME % 100.0 < 50.0, 100.0, -100.0)


def test_means_of_a_held_series_hold_its_integral() -> None:
    time, series = np.array([0.0, 1.0, 3.0, 4.0]), np.array([2.0, -1.0, 5.0, 7.0])
    grid = np.array([0.0, 0.5, 2.0, 4.0])
    held = np.searchsorted(time, grid, side="right") - 1
    means = means_on(time, series, grid, held, grid - time[held])
    # By hand: 2 for half a second; 2 for half and -1 for one; -1 for one and 5 for one.
    assert means == pytest.approx([2.0, 0.0, 2.0, 7.0])


def test_a_rate_that_the_filter_has_not_is_bridged_by_the_angle() -> None:
    time = np.arange(6.0)
    rate = np.array([np.nan, 3.0, 3.0, 3.0, 3.0, np.nan])
    turned, moving = motion_of(time, 10.0 + 2.0 * time, rate)
    assert turned == pytest.approx(2.0 * time)
    assert moving == pytest.approx([2.0, 3.0, 3.0, 3.0, 3.0, 2.0])


def test_each_prediction_is_as_long_as_its_horizon() -> None:
    constant = 10.0
    course = course_of(synthetic.run(TIME, TORQUE), constant, 0.25 * constant)
    grid = course.grid
    lengths = course.time[grid.ends] - course.time[grid.starts]
    wanted = np.array(HORIZONS)[course.horizon] * constant
    # To half a step of the grid.
    assert np.abs(lengths - wanted).max() <= 0.5 * course.period + 1e-9
    assert (grid.restarts[grid.number] == grid.starts).all()
    assert (grid.ends <= grid.restarts[grid.number] + grid.reach[grid.number]).all()


def test_courses_one_after_the_other_keep_their_own_predictions() -> None:
    one = course_of(synthetic.run(TIME, TORQUE), 10.0, 2.5)
    both = Grid.joined([one, one])
    count, length = len(one.grid.starts), len(one.time)
    assert (both.starts[:count] == one.grid.starts).all()
    assert (both.starts[count:] == one.grid.starts + length).all()
    assert (both.restarts[both.number] == both.starts).all()
    assert set(both.run.tolist()) == {0, 1}
