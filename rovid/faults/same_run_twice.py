"""One run in two logs: copies, in two formats or at two rates.

Counted twice, a run would pass for two independent runs and halve every variance. Two runs of one experiment can agree
to a fraction of a degree, but each has its own noise; two copies of one recording have the same noise. Criteria: equal
commands, positions within half a degree throughout, and a difference below the noise.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property, partial

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.faults.base import CampaignData, Detection, FaultKind
from rovid.signals.intervals import gap_limit
from rovid.trial.fault import Fault
from rovid.trial.trial import Trial

_TURN = 2.0 * np.pi
# Share of the longer recording that the shorter must cover: one may be cut.
_MIN_COVER = 0.5
_MAX_DIFFERENCE = np.deg2rad(0.5)
# RMS difference over noise: 1.41 for two independent noises, that of the rounding for two copies.
_NOISE_RATIO = 1.1
# s; two formats may begin this far apart, because a trial begins when the last command becomes known.
_MAX_SHIFT = 5.0
_MAX_POINTS, _MIN_POINTS = 5000, 50
# Commands must agree to this share of their size for this share of the time, which excludes the steps.
_COMMAND_TOLERANCE, _COMMAND_SHARE = 0.03, 0.9


class _Recording:
    """A trial with cached quantities for comparisons with many others."""

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
        """Standard deviation of the noise in rad, by third differences without the largest tenth."""
        differences = np.sort(np.abs(np.diff(self.position, n=3)))
        kept = differences[: max(1, int(0.9 * len(differences)))]
        # A third difference has 20 variances; without the largest tenth a Gaussian keeps 0.789 of its RMS.
        return float(np.sqrt(np.mean(kept**2) / 20.0) / 0.789)

    @cached_property
    def resolution(self) -> float:
        """Smallest step in rad."""
        steps = np.abs(np.diff(self.position))
        return float(steps[steps > 1e-9].min(initial=0.1))

    @cached_property
    def at_seconds(self) -> FloatArray:
        """Position in rad at each full second."""
        return np.interp(np.arange(0.0, self.time[-1]), self.time, self.position)

    @cached_property
    def envelope(self) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest position in rad within the largest shift of each full second."""
        reach = int(_MAX_SHIFT) + 1
        padded = np.pad(self.at_seconds, reach, mode="edge")
        near = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1)
        return near.min(axis=1), near.max(axis=1)

    def difference(self, time: FloatArray, psi: FloatArray) -> FloatArray:
        """(n,) rad from the position at ``time`` to ``psi``, without whole turns; NaN in gaps."""
        after = np.clip(np.searchsorted(self.time, time), 1, len(self.time) - 1)
        inside = (time >= self.time[0]) & (time <= self.time[-1])
        inside &= self.time[after] - self.time[after - 1] <= self.gap
        difference = psi - np.interp(time, self.time, self.position)
        difference -= _TURN * np.rint(np.median(difference) / _TURN)
        return np.where(inside, difference, np.nan)


def _detect(data: CampaignData) -> Iterator[Detection[CampaignData]]:
    """Trials that are copies of another; the copy with the most measurements stays, or else the first."""
    kept: list[_Recording] = []
    for recording in sorted(map(_Recording, data.trials), key=lambda one: -len(one.time)):
        original = next((other for other in kept if _is_same(other, recording)), None)
        if original is None:
            kept.append(recording)
            continue
        copy, stays = recording.trial, original.trial.name
        more = ", which has more samples" if len(original.time) > len(recording.time) else ""
        fault = Fault(
            fault="same_run_twice",
            logs=(copy.name,),
            text=f"{copy.name} is the same recording as {stays}{more}.",
            remedy="counted_once",
        )
        yield Detection(fault=fault, done="It was left out.", repair=partial(_without, copy=copy))


def _without(data: CampaignData, copy: Trial) -> CampaignData:
    return replace(data, trials=[trial for trial in data.trials if trial is not copy])


def _is_same(fine: _Recording, coarse: _Recording) -> bool:
    """Whether both are copies of one recording; ``fine`` has at least as many measurements."""
    if fine.trial.commands.shape[1] != coarse.trial.commands.shape[1] or len(coarse.time) < _MIN_POINTS:
        return False
    shorter, longer = sorted((fine.trial.duration, coarse.trial.duration))
    if shorter < _MIN_COVER * longer or not _may_be_same(fine, coarse):
        return False
    every = len(coarse.time) // _MAX_POINTS + 1
    time, psi = coarse.time[::every], coarse.position[::every]
    shift = _align(fine, time, psi)
    if shift is None:
        return False
    difference = fine.difference(time - shift, psi)
    known = difference[np.isfinite(difference)]
    if len(known) < max(_MIN_POINTS, _MIN_COVER * len(difference)):
        return False
    rounding = (fine.resolution**2 + coarse.resolution**2) / 12.0
    limit = _NOISE_RATIO * np.sqrt(fine.noise**2 + rounding) + 1e-9
    is_small = np.abs(known).max() < _MAX_DIFFERENCE and float(np.sqrt(np.mean(known**2))) <= limit
    return bool(is_small) and _commands_agree(fine.trial, coarse.trial, shift)


def _may_be_same(fine: _Recording, coarse: _Recording) -> bool:
    """Whether a shift could bring both together; a cheap test that excludes most pairs."""
    low, high = fine.envelope
    count = min(len(low), len(coarse.at_seconds))
    if not count:
        return True
    low, high, psi = low[:count], high[:count], coarse.at_seconds[:count]
    # The two may be unwrapped from different turns.
    psi = psi - _TURN * np.rint(np.median(psi - 0.5 * (low + high)) / _TURN)
    inside = (psi >= low - _MAX_DIFFERENCE) & (psi <= high + _MAX_DIFFERENCE)
    return bool(np.mean(inside) > _COMMAND_SHARE)


def _align(fine: _Recording, time: FloatArray, psi: FloatArray) -> float | None:
    """Delay of ``time`` in s by Gauss-Newton least squares from zero; None where it diverges."""
    shift = 0.0
    for _ in range(8):
        difference = fine.difference(time - shift, psi)
        known = np.isfinite(difference)
        rate = np.interp(time[known] - shift, fine.time, fine.rates)
        if not rate.any():
            return shift
        step = -float(rate @ difference[known]) / float(rate @ rate)
        shift += step
        if abs(shift) > _MAX_SHIFT:
            return None
        if abs(step) < 1e-6:
            break
    return shift


def _commands_agree(fine: Trial, coarse: Trial, shift: float) -> bool:
    at = np.clip(np.searchsorted(fine.time, coarse.time - shift, side="right") - 1, 0, len(fine.time) - 1)
    difference = np.abs(fine.commands[at] - coarse.commands)
    scale = np.abs(coarse.commands).max(axis=0)
    return bool(np.all(np.mean(difference <= _COMMAND_TOLERANCE * scale, axis=0) >= _COMMAND_SHARE))


FAULT = FaultKind(
    id="same_run_twice",
    title="One run in two logs",
    stage="campaign",
    detect=_detect,
    false_alarms="none: independent noise makes the difference of two runs 1.41 times as large as that of two copies.",
)
