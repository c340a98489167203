"""Rows that two recordings share: parts of one run that overlap, found by their common noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.signals.rates import fast_fft_length
from rovid.trial.trial import Trial

# Readings that an overlap needs, and as many changes of the slope: fewer agree by chance in a coarse signal at rest.
_MIN_COMMON, _MIN_CHANGES = 50, 50
# RMS difference over the noise of one recording: independent noise makes it 1.41, and rounding far below 0.1.
_SAME_NOISE = 0.3
# Share of the sampling interval within which stamps agree; share of the time in which commands agree.
_STAMPS, _COMMANDS = 0.5, 0.9


class Series:
    """Measured rows of a trial, with the spectrum of the third differences of the position."""

    def __init__(self, trial: Trial) -> None:
        self.trial = trial
        self.rows = np.flatnonzero(trial.measured)
        self.time, self.position = trial.time[self.rows], trial.position[self.rows]
        self.interval = float(np.median(np.diff(self.time))) if len(self.rows) > 1 else np.inf
        third = np.diff(self.position, n=3)
        # Motion and outliers are limited: the noise finds the lag.
        limit = 3.0 * float(np.median(np.abs(third))) if third.size else 0.0
        self.third: FloatArray = np.clip(third, -limit, limit) if limit > 0.0 else third
        self.noise = float(np.median(np.abs(third))) / 0.6745 / np.sqrt(20.0) if third.size else 0.0

    def spectrum(self, size: int) -> FloatArray:
        """Fourier transform of the third differences, padded to ``size``."""
        return np.asarray(np.fft.rfft(self.third, size))


def overlaps(trials: Sequence[Trial]) -> list[tuple[Trial, Trial, slice]]:
    """(earlier log, later log, rows of the later one) of each pair of ``trials`` that overlap in part."""
    series = [Series(trial) for trial in trials]
    size = fast_fft_length(2 * max((len(one.rows) for one in series), default=1))
    spectra = [one.spectrum(size) for one in series]
    found = []
    for later, other in enumerate(series):
        for earlier, one in enumerate(series[:later]):
            if not _may_overlap(one, other):
                continue
            products = np.fft.irfft(spectra[earlier] * np.conj(spectra[later]), size)
            lag = int(np.argmax(products))
            rows = _common(one, other, lag - size if lag > size // 2 else lag)
            if rows is not None:
                found.append((one.trial, other.trial, rows))
                break
    return found


def _may_overlap(one: Series, other: Series) -> bool:
    shorter = min(len(one.rows), len(other.rows))
    if shorter < _MIN_COMMON or abs(one.interval - other.interval) > 0.01 * one.interval:
        return False
    return bool(one.trial.commands.shape[1] == other.trial.commands.shape[1])


def _common(one: Series, other: Series, lag: int) -> slice | None:
    """Rows of ``other``'s trial that ``one`` has, too, ``lag`` readings later; None if these are no copies."""
    first, last = max(0, -lag), min(len(other.rows), len(one.rows) - lag)
    if last - first < _MIN_COMMON:
        return None
    own, theirs = slice(first + lag, last + lag), slice(first, last)
    difference = other.position[theirs] - one.position[own]
    turn = 2.0 * np.pi if one.trial.axis.angular and not one.trial.rate_only else 0.0
    offset = float(np.median(difference))
    difference = difference - (turn * np.rint(offset / turn) if turn else offset)
    changes = int(np.count_nonzero(np.abs(np.diff(other.position[theirs], n=3)) > 1e-9))
    stamps = (other.time[theirs] - other.time[first]) - (one.time[own] - one.time[first + lag])
    rms = float(np.sqrt(np.mean(difference**2)))
    if changes < _MIN_CHANGES or rms > _SAME_NOISE * one.noise + 1e-9 or np.abs(stamps).max() > _STAMPS * one.interval:
        return None
    mine, yours = one.trial.commands[one.rows[own]], other.trial.commands[other.rows[theirs]]
    if np.any(np.mean(np.isclose(mine, yours, rtol=0.03), axis=0) < _COMMANDS):
        return None
    return slice(int(other.rows[first]), int(other.rows[last - 1]) + 1)
