"""Means over the intervals of grids, of series that are held between the instants of logs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Self

import numpy as np

from rovid.ground.arrays import FloatArray, IntArray


@dataclass(frozen=True, eq=False, kw_only=True)
class Means:
    """From the n instants of some runs, one after the other, to the m of their grids.

    Attributes
    ----------
    begins, grid_begins
        (r + 1,) which of the n, and of the m, begins each of r runs, and how many there are in all.
    length, span
        (n,) and (m,) s from each instant to the next of its run; 1 s from the last.
    held, since
        (m,) which of the n is held at each instant of the grid, and for how many s it has been.
    """

    begins: IntArray
    grid_begins: IntArray
    length: FloatArray
    span: FloatArray
    held: IntArray
    since: FloatArray

    @classmethod
    def onto(cls, times: Sequence[FloatArray], grids: Sequence[FloatArray]) -> Self:
        """From the instants of each run, in s, to its grid."""
        begins = np.cumsum([0, *map(len, times)])
        held, since = [], []
        for begin, time, grid in zip(begins[:-1], times, grids, strict=True):
            latest = np.clip(np.searchsorted(time, grid, side="right") - 1, 0, len(time) - 1)
            held.append(begin + latest)
            since.append(grid - time[latest])
        return cls(
            begins=begins,
            grid_begins=np.cumsum([0, *map(len, grids)]),
            length=np.concatenate([np.append(np.diff(time), 1.0) for time in times]),
            span=np.concatenate([np.append(np.diff(grid), 1.0) for grid in grids]),
            held=np.concatenate(held),
            since=np.concatenate(since),
        )

    def of(self, series: FloatArray) -> FloatArray:
        """(m,) means of an (n,) ``series`` from each instant of the grid to the next; its last value at the last."""
        # Under the series up to each of its instants, run by run, and from there on.
        step, area = series * self.length, np.zeros(len(series))
        for begin, end in pairwise(self.begins.tolist()):
            np.cumsum(step[begin : end - 1], out=area[begin + 1 : end])
        area = area[self.held] + series[self.held] * self.since
        means = np.append(np.diff(area), 0.0) / self.span
        means[self.grid_begins[1:] - 1] = series[self.begins[1:] - 1]
        return means
