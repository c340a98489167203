"""Means over the intervals of grids, of series that are held between the instants of logs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False, kw_only=True)
class IntervalMeans:
    """From the n instants of some runs, one after the other, to the m of their grids.

    Attributes
    ----------
    begins, grid_begins
        (r + 1,) which of the n, and of the m, begins each of r runs, and how many there are in all.
    length, span
        (n,) and (m,) s from each instant to the next of its run; 1 s from the last.
    held, since
        (m,) which of the n is held at each instant of the grid, and for how many s it has been.
    same
        (m,) whether it is held at the next instant of the grid too.
    """

    begins: IntArray
    grid_begins: IntArray
    length: FloatArray
    span: FloatArray
    held: IntArray
    since: FloatArray
    same: BoolArray

    @classmethod
    def between_grids(cls, times: Sequence[FloatArray], grids: Sequence[FloatArray]) -> Self:
        """From the instants of each run, in s, to its grid."""
        begins = np.cumsum([0, *map(len, times)])
        latest, since = [], []
        for begin, time, grid in zip(begins[:-1], times, grids, strict=True):
            before = _latest(time, grid)
            latest.append(begin + before)
            since.append(grid - time[before])
        held = np.concatenate(latest)
        return cls(
            begins=begins,
            grid_begins=np.cumsum([0, *map(len, grids)]),
            length=np.concatenate([np.append(np.diff(time), 1.0) for time in times]),
            span=np.concatenate([np.append(np.diff(grid), 1.0) for grid in grids]),
            held=held,
            since=np.concatenate(since),
            same=np.append(held[1:] == held[:-1], False),
        )

    def apply(self, series: FloatArray) -> FloatArray:
        """(m,) means of an (n,) ``series`` from each instant of the grid to the next; its last value at the last."""
        # From what is held to what is held at the next, and what of both is before the instants of the grid.
        area = np.add.reduceat(series * self.length, self.held)
        area[self.same] = 0.0
        area[:-1] += np.diff(series[self.held] * self.since)
        means = area / self.span
        means[self.grid_begins[1:] - 1] = series[self.begins[1:] - 1]
        return means


def held_rows(time: FloatArray, grid: FloatArray) -> IntArray:
    """Which of the (n,) instants are the latest at any of a grid's; both in s."""
    return np.unique(_latest(time, grid))


def _latest(time: FloatArray, grid: FloatArray) -> IntArray:
    """(m,) the latest of the (n,) instants at each of the grid's."""
    return np.clip(np.searchsorted(time, grid, side="right") - 1, 0, len(time) - 1)
