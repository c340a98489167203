"""Finds a recording that was given twice, in two formats or at two rates.

Counted twice, a run would pass for two independent ones and halve every variance. Two runs of one experiment
can look alike to a fraction of a degree, but each has its own noise; one recording has the same noise twice.
So: same commands, headings alike within half a degree all along, and closer than their own noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.readers.cleaning import gap_limit
from rovid.trial.trial import Remark, Trial

_TURN = 2.0 * np.pi
# The shorter covers this much of the longer: one of them may have been cut.
_SHARE = 0.5
_ALIKE = np.deg2rad(0.5)
# Two independent noises differ by 1.41 of one; two copies of one noise by their rounding alone.
_NOISE = 1.1
# Two formats may begin this far apart: the trial begins when the last command becomes known.
_SHIFT = 5.0
_POINTS, _FEWEST = 5000, 50
# Commands agree to this share of their size, for this share of the time: not at the very steps.
_SAME_COMMAND, _MOSTLY = 0.03, 0.9


class _Run:
    """A trial, with what comparing it to many others takes."""

    def __init__(self, trial: Trial) -> None:
        self.trial = trial
        rows = np.flatnonzero(trial.measured)
        self.time, self.position = trial.time[rows], trial.position[rows]

    @cached_property
    def rates(self) -> FloatArray:
        """(n,) rad/s."""
        rates: FloatArray = np.gradient(self.position, self.time)
        return rates

    @cached_property
    def gap(self) -> float:
        """Longest interval in s that is no gap."""
        return gap_limit(np.diff(self.time))

    @cached_property
    def noise(self) -> float:
        """Standard deviation in rad of the heading's noise, by its third differences, the largest tenth aside."""
        bends = np.sort(np.abs(np.diff(self.position, n=3)))
        usual = bends[: max(1, int(0.9 * len(bends)))]
        # A third difference holds 20 variances; without its largest tenth a Gaussian keeps 0.789 of its rms.
        return float(np.sqrt(np.mean(usual**2) / 20.0) / 0.789)

    @cached_property
    def resolution(self) -> float:
        """Smallest step in rad between headings: what they were rounded to."""
        steps = np.abs(np.diff(self.position))
        return float(steps[steps > 1e-9].min(initial=0.1))

    @cached_property
    def seconds(self) -> FloatArray:
        """Heading in rad at each full second."""
        return np.interp(np.arange(0.0, self.time[-1]), self.time, self.position)

    @cached_property
    def envelope(self) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest heading in rad within the largest shift of each full second."""
        reach = int(_SHIFT) + 1
        padded = np.pad(self.seconds, reach, mode="edge")
        near = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1)
        return near.min(axis=1), near.max(axis=1)


def without_duplicates(trials: Sequence[Trial], remarks: list[Remark]) -> list[Trial]:
    """``trials`` without those that repeat another; of two, the one with more measured headings stays.

    Of equals the first stays.
    """
    kept: list[_Run] = []
    runs = sorted((_Run(trial) for trial in trials), key=lambda run: -len(run.time))  # stable: of equals, the first
    for run in runs:
        twin = next((other for other in kept if _same(other, run)), None)
        if twin is None:
            kept.append(run)
            continue
        more = ", which has more samples" if len(twin.time) > len(run.time) else ""
        text = f"{run.trial.name} was left out: it is the same recording as {twin.trial.name}{more}."
        remarks.append(Remark(kind="repeated", count=1, text=text))
    staying = {id(run.trial) for run in kept}
    return [trial for trial in trials if id(trial) in staying]


def _same(fine: _Run, coarse: _Run) -> bool:
    """Whether both hold the same recording; ``fine`` has at least as many measured headings."""
    if fine.trial.commands.shape[1] != coarse.trial.commands.shape[1] or len(coarse.time) < _FEWEST:
        return False
    spans = sorted((fine.trial.duration, coarse.trial.duration))
    if spans[0] < _SHARE * spans[1] or not _roughly(fine, coarse):
        return False
    every = len(coarse.time) // _POINTS + 1
    time, psi = coarse.time[::every], coarse.position[::every]
    shift = _align(fine, time, psi)
    if shift is None:
        return False
    off = _difference(fine, time - shift, psi)
    near = off[np.isfinite(off)]
    if len(near) < max(_FEWEST, _SHARE * len(off)):
        return False
    rounding = (fine.resolution**2 + coarse.resolution**2) / 12.0
    small = float(np.sqrt(np.mean(near**2))) <= _NOISE * np.sqrt(fine.noise**2 + rounding) + 1e-9
    return bool(np.abs(near).max() < _ALIKE) and small and _same_commands(fine.trial, coarse.trial, shift)


def _roughly(fine: _Run, coarse: _Run) -> bool:
    """Whether a shift could make one of the other: cheap, since most pairs end here."""
    low, high = fine.envelope
    count = min(len(low), len(coarse.seconds))
    if not count:
        return True
    low, high, psi = low[:count], high[:count], coarse.seconds[:count]
    # One may have been unwrapped from another turn than the other.
    psi = psi - _TURN * np.rint(np.median(psi - 0.5 * (low + high)) / _TURN)
    inside = (psi >= low - _ALIKE) & (psi <= high + _ALIKE)
    return bool(np.mean(inside) > _MOSTLY)


def _difference(fine: _Run, time: FloatArray, psi: FloatArray) -> FloatArray:
    """(n,) rad between ``psi`` and the heading of ``fine`` at ``time``, whole turns aside; NaN in gaps."""
    t = fine.time
    after = np.clip(np.searchsorted(t, time), 1, len(t) - 1)
    inside = (time >= t[0]) & (time <= t[-1]) & (t[after] - t[after - 1] <= fine.gap)
    off = psi - np.interp(time, t, fine.position)
    off -= _TURN * np.rint(np.median(off) / _TURN)
    return np.where(inside, off, np.nan)


def _align(fine: _Run, time: FloatArray, psi: FloatArray) -> float | None:
    """Seconds by which ``time`` is late, by least squares from no shift on; None where it runs away."""
    shift = 0.0
    for _ in range(8):
        off = _difference(fine, time - shift, psi)
        good = np.isfinite(off)
        rate = np.interp(time[good] - shift, fine.time, fine.rates)
        if not rate.any():
            return shift
        step = -float(rate @ off[good]) / float(rate @ rate)
        shift += step
        if abs(shift) > _SHIFT:
            return None
        if abs(step) < 1e-6:
            break
    return shift


def _same_commands(fine: Trial, coarse: Trial, shift: float) -> bool:
    at = np.clip(np.searchsorted(fine.time, coarse.time - shift, side="right") - 1, 0, len(fine.time) - 1)
    off = np.abs(fine.commands[at] - coarse.commands)
    scale = np.abs(coarse.commands).max(axis=0)
    return bool(np.all(np.mean(off <= _SAME_COMMAND * scale, axis=0) >= _MOSTLY))
