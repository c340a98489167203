"""What drives a vehicle in its trials, with the effects between command and torque."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Self
from weakref import WeakValueDictionary

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.effects.actuator_inputs import SPEEDS
from rovid.jit.decorators import compiled

# Into how many the interval between two samples is cut for an effect that acts within it.
MAX_SUBDIVISION = 8


@dataclass(frozen=True, eq=False, kw_only=True)
class Intervals:
    """Over which intervals of one trial, or of several one after the other, a drive is taken together.

    Attributes
    ----------
    at
        (m,) the instants, of the n, with which they begin; the last of each trial ends its last interval.
    begins
        (t + 1,) which of the m begins each of t trials, and how many there are in all.
    length, middle
        (n,) s from each instant to the next, 0 from the last of a trial; and when half of that has passed.
    span, end
        (m,) s that each interval lasts, and when it ends; of the last of a trial 1 s, for it has none.
    """

    indices: IntArray
    offsets: IntArray
    lengths: FloatArray
    midpoints: FloatArray
    durations: FloatArray
    ends: FloatArray

    @classmethod
    def from_times(cls, times: Sequence[FloatArray], at: Sequence[IntArray]) -> Self:
        """Of each trial the instants in s, and between which of them."""
        before = np.cumsum([0, *map(len, times)])[:-1]
        ends = [time[here] for time, here in zip(times, at, strict=True)]
        return cls(
            indices=np.concatenate([first + here for first, here in zip(before, at, strict=True)]),
            offsets=np.cumsum([0, *map(len, at)]),
            lengths=np.concatenate([np.append(np.diff(time), 0.0) for time in times]),
            midpoints=np.concatenate([np.append(0.5 * (time[1:] + time[:-1]), time[-1]) for time in times]),
            durations=np.concatenate([np.append(np.diff(end), 1.0) for end in ends]),
            ends=np.concatenate([np.append(end[1:], end[-1]) for end in ends]),
        )

    @property
    def nbytes(self) -> int:
        """Bytes."""
        return sum(series.nbytes for series in (self.indices, self.lengths, self.midpoints, self.durations, self.ends))

    @property
    def last_indices(self) -> IntArray:
        """(t,) which of the m is the last of each trial."""
        return self.offsets[1:] - 1


@dataclass(frozen=True, eq=False)
class TorqueInput:
    """What drives one trial, or several one after the other, from each instant to the next.

    Attributes
    ----------
    torque
        (n,) N m, its mean.
    moment
        (n,) N m s^2; integral of torque less mean times the time left. A torque that comes late in the interval gives
        the same rate at its end, but less angle, by ``moment / inertia``.
    beside
        (n, 3) what else the terms of effects are told: the thrusters' race in N^0.5 m^2, which is the sum over them of
        the root of their thrust times their arm squared, and the speeds `SPEEDS` in m/s. Zeros where no effect asks.
    scatter
        (n,) N^2 m^2 s^2; variance of the impulse, where an effect leaves open when a torque acts. Zeros elsewhere.
    begins
        (t + 1,) the instant with which each of t trials begins, and how many there are in all.
    """

    torque: FloatArray
    timing_moment: FloatArray
    effect_inputs: FloatArray
    impulse_variance: FloatArray
    offsets: IntArray

    @classmethod
    def held(
        cls,
        torque: FloatArray,
        beside: FloatArray | None = None,
        scatter: FloatArray | None = None,
        begins: IntArray | None = None,
    ) -> Self:
        """Of a torque that is held from each instant to the next; of one trial where ``begins`` is not given."""
        nothing = _nothing(len(torque))
        return cls(
            torque,
            nothing,
            _untold(len(torque)) if beside is None else beside,
            nothing if scatter is None else scatter,
            np.array([0, len(torque)]) if begins is None else begins,
        )

    @classmethod
    def averaged_over(
        cls, steps: Intervals, torque: FloatArray, beside: FloatArray | None = None, scatter: FloatArray | None = None
    ) -> Self:
        """Over each of some intervals, of what is held between (n,) instants."""
        last = steps.last_indices

        def total(values: FloatArray) -> FloatArray:
            return np.asarray(np.add.reduceat(values, steps.indices))

        area, early = _gathered(steps.indices, steps.lengths, steps.midpoints, torque)
        mean, moment = area / steps.durations, area * steps.ends - early - 0.5 * area * steps.durations
        # Nothing follows the last instant of a trial, from which what is held goes on.
        mean[last], moment[last] = torque[steps.indices[last]], 0.0
        told, open_when = _untold(len(mean)), _nothing(len(mean))
        if beside is not None:
            told = total(beside * steps.lengths[:, None]) / steps.durations[:, None]
            told[last] = beside[steps.indices[last]]
        if scatter is not None:
            open_when = total(scatter)
            open_when[last] = 0.0
        return cls(mean, moment, told, open_when, steps.offsets)

    @property
    def nbytes(self) -> int:
        """Bytes that it takes by itself: zeros are shared with all others."""
        every = self.torque, self.timing_moment, self.effect_inputs, self.impulse_variance
        return sum(one.nbytes for one in every if one is not _ZEROS.get(one.shape))

    @property
    def has_effect_inputs(self) -> bool:
        """Whether effects may be told anything beside the torque."""
        return self.effect_inputs is not _untold(len(self.torque))

    @property
    def by_trial(self) -> list[Self]:
        """That of each trial by itself."""
        return [self._rows(slice(begin, end)) for begin, end in pairwise(self.offsets.tolist())]

    def _rows(self, rows: slice) -> Self:
        series = self.torque[rows], self.timing_moment[rows], self.effect_inputs[rows], self.impulse_variance[rows]
        return type(self)(*series, np.array([0, len(series[0])]))

    def mapped(self, function: Callable[[FloatArray], FloatArray]) -> Self:
        """Of one trial, with ``function`` of each series."""
        torque = function(self.torque)
        beside = np.column_stack([function(column) for column in self.effect_inputs.T])
        begins = np.array([0, len(torque)])
        return type(self)(torque, function(self.timing_moment), beside, function(self.impulse_variance), begins)


@compiled
def _gathered(at: IntArray, length: FloatArray, middle: FloatArray, held: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(m,) integral of what is (n,) held from each instant ``at`` to the next, and that of it times when it is."""
    area, moment = np.zeros((2, len(at)))
    for number in range(len(at)):
        behind = at[number + 1] if number + 1 < len(at) else len(held)
        for k in range(at[number], behind):
            impulse = held[k] * length[k]
            area[number] += impulse
            moment[number] += impulse * middle[k]
    return area, moment


# Zeros of each shape, one for all drives as long as there are such: nobody writes into a drive.
_ZEROS: WeakValueDictionary[tuple[int, ...], FloatArray] = WeakValueDictionary()


def _nothing(*shape: int) -> FloatArray:
    """Zeros."""
    zeros = _ZEROS.get(shape)
    return _ZEROS.setdefault(shape, np.zeros(shape)) if zeros is None else zeros


def _untold(count: int) -> FloatArray:
    """(n, 3) what terms are told beside the torque where none of them asks."""
    return _nothing(count, 1 + len(SPEEDS))
