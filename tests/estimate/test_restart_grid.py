"""Measured motion on grids, restarts of predictions, and means over grid intervals."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.estimate.filter_data import InnovationData
from rovid.estimate.multi_step import MultiStepData
from rovid.estimate.restart_grid import HORIZONS, GriddedRun, IntervalMeans, RestartGrid, Trajectory
from tests import synthetic

TIME = synthetic.clock(400.0, rate=5.0)
TORQUE = np.where(TIME % 100.0 < 50.0, 100.0, -100.0)


def test_missing_rates_are_bridged_by_the_slope_of_the_angle() -> None:
    time = np.arange(6.0)
    rate = np.array([np.nan, 3.0, 3.0, 3.0, 3.0, np.nan])
    angle = 10.0 + 2.0 * time
    angle[3] = np.nan
    motion = Trajectory.of(time, angle, rate, np.ones(6))
    assert motion.angle == pytest.approx(2.0 * time)
    assert motion.bridged_rate == pytest.approx([2.0, 3.0, 3.0, 3.0, 3.0, 2.0])


def test_each_prediction_is_as_long_as_its_horizon() -> None:
    constant = 10.0
    gridded = GriddedRun.of(synthetic.run(TIME, TORQUE), constant, 0.25 * constant)
    grid = RestartGrid.of([gridded])
    lengths = gridded.time[grid.ends] - gridded.time[grid.starts]
    wanted = np.array(HORIZONS)[gridded.horizon] * constant
    # To half a step of the grid.
    assert np.abs(lengths - wanted).max() <= 0.5 * gridded.period + 1e-9
    assert (grid.restarts[grid.restart_number] == grid.starts).all()
    assert (grid.ends <= grid.restarts[grid.restart_number] + grid.reach[grid.restart_number]).all()


def test_gridded_runs_one_after_the_other_keep_their_own_predictions() -> None:
    run = synthetic.run(TIME, TORQUE)
    data = MultiStepData.from_data(InnovationData([run, run], synthetic.LOGGED, synthetic.ROSUB), synthetic.ROSUB)
    one, both = data.gridded_runs[0], data.grid
    count, length = len(one.starts), len(one.time)
    assert (both.starts[:count] == one.starts).all()
    assert (both.starts[count:] == one.starts + length).all()
    assert (both.restarts[both.restart_number] == both.starts).all()
    assert (np.diff(both.reach) <= 0).all()
    assert set(both.run.tolist()) == {0, 1}
    # A mean at the end of the first run contains nothing of the second.
    assert (data.torque[:length] == data.torque[length:]).all()
    assert (data.trajectory.angle[length:] == one.trajectory.angle).all()


SAMPLES, SERIES = np.array([0.0, 1.0, 3.0, 4.0]), np.array([2.0, -1.0, 5.0, 7.0])
GRID = np.array([0.0, 0.5, 2.0, 4.0])


def test_means_of_a_held_series_hold_its_integral() -> None:
    # By hand: 2 for half a second; 2 for half and -1 for one; -1 for one and 5 for one.
    assert IntervalMeans.between_grids([SAMPLES], [GRID]).apply(SERIES) == pytest.approx([2.0, 0.0, 2.0, 7.0])


def test_runs_one_after_the_other_have_means_of_their_own() -> None:
    other = np.array([0.5, 1.0, 3.5])
    both = IntervalMeans.between_grids([SAMPLES, SAMPLES[:3]], [GRID, other])
    alone = IntervalMeans.between_grids([SAMPLES[:3]], [other])
    assert both.grid_offsets.tolist() == [0, 4, 7]
    assert both.apply(np.append(SERIES, -SERIES[:3])).tolist() == [
        *IntervalMeans.between_grids([SAMPLES], [GRID]).apply(SERIES),
        *alone.apply(-SERIES[:3]),
    ]
