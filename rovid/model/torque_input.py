"""The torque that drives a vehicle in its trials, after all effects between command and torque."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise, starmap
from typing import Self
from weakref import WeakValueDictionary

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.effects.actuator_inputs import SPEEDS
from rovid.jit.decorators import compiled

# Parts of an interval between two samples, for an effect that acts within it.
MAX_SUBDIVISION = 8


@dataclass(frozen=True, eq=False, kw_only=True)
class Intervals:
    """Intervals of one trial or of several concatenated ones, over each of which a torque input is averaged."""

    #: (m,) index among n instants of each interval's begin. The last interval of a trial has no end, and lasts 1 s.
    indices: IntArray
    offsets: IntArray  #: (t + 1,) index among the m intervals of each trial's first one, and m.
    #: ``lengths``, ``midpoints``: (n,) s from each instant to the next, 0 from the last of a trial; and the time in the
    #: middle.
    lengths: FloatArray
    midpoints: FloatArray
    #: ``durations``, ``ends``: (m,) s that each interval lasts, and the time at which it ends.
    durations: FloatArray
    ends: FloatArray

    @classmethod
    def from_times(cls, times: Sequence[FloatArray], at: Sequence[IntArray]) -> Self:
        """From the instants of each trial in s, and the indices among these at which its intervals begin."""
        first = np.cumsum([0, *map(len, times)])[:-1]
        begins = [time[here] for time, here in zip(times, at, strict=True)]
        return cls(
            indices=np.concatenate([offset + here for offset, here in zip(first, at, strict=True)]),
            offsets=np.cumsum([0, *map(len, at)]),
            lengths=np.concatenate([np.append(np.diff(time), 0.0) for time in times]),
            midpoints=np.concatenate([np.append(0.5 * (time[1:] + time[:-1]), time[-1]) for time in times]),
            durations=np.concatenate([np.append(np.diff(begin), 1.0) for begin in begins]),
            ends=np.concatenate([np.append(begin[1:], begin[-1]) for begin in begins]),
        )

    @property
    def nbytes(self) -> int:
        """Size in bytes."""
        return sum(series.nbytes for series in (self.indices, self.lengths, self.midpoints, self.durations, self.ends))


@dataclass(frozen=True, eq=False)
class TorqueInput:
    """Torque from each instant to the next, of one trial or of several concatenated ones."""

    torque: FloatArray  #: (n,) N m, mean over the interval.
    #: (n,) N m s^2; integral of (torque - mean) times the time left in the interval. A torque that comes late gives the
    #: same rate at the interval's end, but less angle, by ``timing_moment / inertia``.
    timing_moment: FloatArray
    #: (n, 3) further inputs of effects' terms: the wash of the thrusters in N^0.5 m^2, which is the sum of sqrt(thrust)
    #: * arm^2, and the speeds `SPEEDS` in m/s. Zeros if no effect needs them.
    effect_inputs: FloatArray
    #: (n,) N^2 m^2 s^2; variance of the torque's integral if an effect leaves open when the torque acts, else zeros.
    impulse_variance: FloatArray
    offsets: IntArray  #: (t + 1,) index of each trial's first instant, and n.

    @classmethod
    def held(
        cls,
        torque: FloatArray,
        effect_inputs: FloatArray | None = None,
        impulse_variance: FloatArray | None = None,
        offsets: IntArray | None = None,
    ) -> Self:
        """From a torque that is held from each instant to the next; of one trial without ``offsets``."""
        zeros = _shared_zeros(len(torque))
        return cls(
            torque,
            zeros,
            _no_effect_inputs(len(torque)) if effect_inputs is None else effect_inputs,
            zeros if impulse_variance is None else impulse_variance,
            np.array([0, len(torque)]) if offsets is None else offsets,
        )

    @classmethod
    def averaged_over(
        cls,
        intervals: Intervals,
        torque: FloatArray,
        effect_inputs: FloatArray | None = None,
        impulse_variance: FloatArray | None = None,
    ) -> Self:
        """Averages over ``intervals`` of (n,) values that are held from each instant to the next."""
        last = intervals.offsets[1:] - 1
        area, first_moment = _integrals(intervals.indices, intervals.lengths, intervals.midpoints, torque)
        mean = area / intervals.durations
        timing_moment = area * intervals.ends - first_moment - 0.5 * area * intervals.durations
        # The last value of a trial is held on.
        mean[last], timing_moment[last] = torque[intervals.indices[last]], 0.0
        mean_inputs, variance = _no_effect_inputs(len(mean)), _shared_zeros(len(mean))
        if effect_inputs is not None:
            areas = np.add.reduceat(effect_inputs * intervals.lengths[:, None], intervals.indices)
            mean_inputs = areas / intervals.durations[:, None]
            mean_inputs[last] = effect_inputs[intervals.indices[last]]
        if impulse_variance is not None:
            variance = np.asarray(np.add.reduceat(impulse_variance, intervals.indices))
            variance[last] = 0.0
        return cls(mean, timing_moment, mean_inputs, variance, intervals.offsets)

    @property
    def nbytes(self) -> int:
        """Size in bytes, without zeros that all torque inputs share."""
        every = self.torque, self.timing_moment, self.effect_inputs, self.impulse_variance
        return sum(one.nbytes for one in every if one is not _ZEROS.get(one.shape))

    @property
    def has_effect_inputs(self) -> bool:
        """Whether an effect needs effect inputs."""
        return self.effect_inputs is not _no_effect_inputs(len(self.torque))

    @property
    def by_trial(self) -> list[Self]:
        """The torque input of each trial."""
        return list(map(self.rows, starmap(slice, pairwise(self.offsets.tolist()))))

    def rows(self, at: IntArray | slice) -> Self:
        """The torque input from the instants ``at``, as that of one trial."""
        series = self.torque[at], self.timing_moment[at], self.effect_inputs[at], self.impulse_variance[at]
        return type(self)(*series, np.array([0, len(series[0])]))

    def mapped(self, function: Callable[[FloatArray], FloatArray]) -> Self:
        """``function`` of each series of one trial."""
        torque = function(self.torque)
        inputs = np.column_stack(list(map(function, self.effect_inputs.T)))
        offsets = np.array([0, len(torque)])
        return type(self)(torque, function(self.timing_moment), inputs, function(self.impulse_variance), offsets)


@compiled
def _integrals(
    indices: IntArray, lengths: FloatArray, midpoints: FloatArray, held: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(m,) integrals of ``held`` and of ``held`` times time, from each of ``indices`` to the next."""
    area, moment = np.zeros((2, len(indices)))
    for number in range(len(indices)):
        end = indices[number + 1] if number + 1 < len(indices) else len(held)
        for k in range(indices[number], end):
            impulse = held[k] * lengths[k]
            area[number] += impulse
            moment[number] += impulse * midpoints[k]
    return area, moment


# Zeros of each shape, shared by all torque inputs that exist. They are never written to.
_ZEROS: WeakValueDictionary[tuple[int, ...], FloatArray] = WeakValueDictionary()


def _shared_zeros(*shape: int) -> FloatArray:
    zeros = _ZEROS.get(shape)
    return _ZEROS.setdefault(shape, np.zeros(shape)) if zeros is None else zeros


def _no_effect_inputs(count: int) -> FloatArray:
    """(n, 3) zeros."""
    return _shared_zeros(count, 1 + len(SPEEDS))
