"""Commands of a trial moved in time against the motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.trial.trial import Trial

# Resolution of the time stamps of a shifted trial, per sampling interval.
_RESOLUTION = 50.0


def shift_commands(trial: Trial, delay: float) -> Trial:
    """``trial`` with its motion and further channels, and its commands ``delay`` s later; the common time alone.

    Raises
    ------
    DataError
        The delay is longer than the trial.
    """
    if abs(delay) > trial.duration - 2.0 * trial.sampling_interval:
        raise DataError(f"{trial.name} is shorter than the offset of {abs(delay):.3g} s.")
    # Time stamps on a common grid do not nearly coincide.
    grid = trial.sampling_interval / _RESOLUTION
    measured = grid * np.round(trial.time[trial.measured] / grid)
    commanded = grid * np.round((trial.time + delay) / grid)
    base = grid * np.unique(np.round(np.concatenate((measured, commanded)) / grid))
    first, last = max(measured[0], commanded[0]), min(measured[-1], commanded[-1])
    base = base[(base >= first - 0.5 * grid) & (base <= last + 0.5 * grid)]
    inside = (measured >= base[0] - 0.5 * grid) & (measured <= base[-1] + 0.5 * grid)
    position = np.full(len(base), np.nan)
    position[np.searchsorted(base, measured[inside] - 0.5 * grid)] = trial.position[trial.measured][inside]

    def held(values: FloatArray, stamps: FloatArray) -> FloatArray:
        at: FloatArray = values[np.maximum(np.searchsorted(stamps, base + 0.5 * grid, side="right") - 1, 0)]
        return at

    def interpolated(values: FloatArray | None) -> FloatArray | None:
        if values is None or not np.isfinite(values).any():
            return values
        known = np.isfinite(values)
        at: FloatArray = np.interp(base, trial.time[known], values[known])
        return at

    return replace(
        trial,
        time=base - base[0],
        position=position,
        commands=held(trial.commands, commanded),
        rate=interpolated(trial.rate),
        roll=interpolated(trial.roll),
        pitch=interpolated(trial.pitch),
        extras={name: held(values, trial.time) for name, values in trial.extras.items()},
    )
