"""Means over the intervals of grids."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.estimate.interval_means import IntervalMeans

TIME, SERIES = np.array([0.0, 1.0, 3.0, 4.0]), np.array([2.0, -1.0, 5.0, 7.0])
GRID = np.array([0.0, 0.5, 2.0, 4.0])


def test_means_of_a_held_series_hold_its_integral() -> None:
    # By hand: 2 for half a second; 2 for half and -1 for one; -1 for one and 5 for one.
    assert IntervalMeans.between_grids([TIME], [GRID]).apply(SERIES) == pytest.approx([2.0, 0.0, 2.0, 7.0])


def test_runs_one_after_the_other_have_means_of_their_own() -> None:
    other = np.array([0.5, 1.0, 3.5])
    both = IntervalMeans.between_grids([TIME, TIME[:3]], [GRID, other])
    alone = IntervalMeans.between_grids([TIME[:3]], [other])
    assert both.grid_begins.tolist() == [0, 4, 7]
    assert both.apply(np.append(SERIES, -SERIES[:3])).tolist() == [
        *IntervalMeans.between_grids([TIME], [GRID]).apply(SERIES),
        *alone.apply(-SERIES[:3]),
    ]
