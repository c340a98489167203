"""Finds a recording that was given twice, in two formats or at two rates.

Counted twice, a run would pass for two independent ones and halve every variance. Two runs of one experiment
can look alike to a fraction of a degree, but each has its own noise; one recording has the same noise twice.
So: same commands, headings alike within half a degree all along, and closer than their own noise.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rovid.readers.heading import gap_limit
from rovid.trial import FloatArray, Remark, Trial

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


def without_twins(trials: Sequence[Trial], remarks: list[Remark]) -> list[Trial]:
    """``trials`` without those that repeat another; of two, the one with more measured headings stays.

    Of equals the first stays.
    """
    kept: list[Trial] = []
    for trial in sorted(trials, key=lambda one: -int(one.measured.sum())):  # stable: of equals, the first leads
        twin = next((other for other in kept if same_recording(other, trial)), None)
        if twin is None:
            kept.append(trial)
        else:
            text = f"{trial.name} was left out: it is the same recording as {twin.name}, which has more samples"
            if twin.measured.sum() == trial.measured.sum():
                text = f"{trial.name} was left out: it is the same recording as {twin.name}"
            remarks.append(Remark(kind="repeated", count=1, text=text + "."))
    return [trial for trial in trials if any(trial is one for one in kept)]


def same_recording(fine: Trial, coarse: Trial) -> bool:
    """Whether both hold the same recording; ``fine`` has at least as many measured headings."""
    if fine.commands.shape[1] != coarse.commands.shape[1]:
        return False
    spans = sorted((fine.duration, coarse.duration))
    if spans[0] < _SHARE * spans[1] or coarse.measured.sum() < _FEWEST:
        return False
    t, psi = _thinned(coarse)
    shift = _align(fine, t, psi)
    if shift is None:
        return False
    off = _difference(fine, t - shift, psi)
    near = off[np.isfinite(off)]
    if len(near) < max(_FEWEST, _SHARE * len(off)):
        return False
    rounding = (_resolution(fine) ** 2 + _resolution(coarse) ** 2) / 12.0
    small = float(np.sqrt(np.mean(near**2))) <= _NOISE * np.sqrt(_noise(fine) ** 2 + rounding) + 1e-9
    return bool(np.abs(near).max() < _ALIKE) and small and _same_commands(fine, coarse, shift)


def _thinned(trial: Trial) -> tuple[FloatArray, FloatArray]:
    """At most some thousand measured headings, evenly picked."""
    rows = np.flatnonzero(trial.measured)
    rows = rows[:: len(rows) // _POINTS + 1]
    return trial.time[rows], trial.heading[rows]


def _difference(fine: Trial, time: FloatArray, psi: FloatArray) -> FloatArray:
    """(n,) rad between ``psi`` and the heading of ``fine`` at ``time``, whole turns aside; NaN in gaps."""
    rows = np.flatnonzero(fine.measured)
    t, heading = fine.time[rows], fine.heading[rows]
    after = np.clip(np.searchsorted(t, time), 1, len(t) - 1)
    inside = (time >= t[0]) & (time <= t[-1]) & (t[after] - t[after - 1] <= gap_limit(np.diff(t)))
    off = psi - np.interp(time, t, heading)
    off -= 2.0 * np.pi * np.rint(np.nanmedian(off) / (2.0 * np.pi))
    return np.where(inside, off, np.nan)


def _align(fine: Trial, time: FloatArray, psi: FloatArray) -> float | None:
    """Seconds by which ``time`` is late, by least squares from no shift on; None where it runs away."""
    rows = np.flatnonzero(fine.measured)
    t, heading = fine.time[rows], fine.heading[rows]
    rates = np.gradient(heading, t)
    shift = 0.0
    for _ in range(8):
        off = _difference(fine, time - shift, psi)
        good = np.isfinite(off)
        rate = np.interp(time[good] - shift, t, rates)
        if not rate.any():
            return shift
        step = -float(rate @ off[good]) / float(rate @ rate)
        shift += step
        if abs(shift) > _SHIFT:
            return None
        if abs(step) < 1e-6:
            break
    return shift


def _noise(trial: Trial) -> float:
    """Standard deviation in rad of the heading's noise, by its third differences, the largest tenth aside."""
    bends = np.sort(np.abs(np.diff(trial.heading[trial.measured], n=3)))
    usual = bends[: max(1, int(0.9 * len(bends)))]
    # A third difference holds 20 variances; without its largest tenth a Gaussian keeps 0.789 of its rms.
    return float(np.sqrt(np.mean(usual**2) / 20.0) / 0.789)


def _resolution(trial: Trial) -> float:
    """Smallest step in rad between headings: what they were rounded to."""
    steps = np.abs(np.diff(trial.heading[trial.measured]))
    return float(steps[steps > 1e-9].min(initial=0.1))


def _same_commands(fine: Trial, coarse: Trial, shift: float) -> bool:
    at = np.clip(np.searchsorted(fine.time, coarse.time - shift, side="right") - 1, 0, len(fine.time) - 1)
    off = np.abs(fine.commands[at] - coarse.commands)
    scale = np.abs(coarse.commands).max(axis=0)
    return bool(np.all(np.mean(off <= _SAME_COMMAND * scale, axis=0) >= _MOSTLY))
