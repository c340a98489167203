"""The unknown state of the drives at a log's first sample, as one more state of the Kalman filter."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.estimate.input_cache import InputCache
from rovid.jit.decorators import compiled
from rovid.model.filter_batch import FilterData, FilterInputs, ParameterBatch
from rovid.model.model import Model
from rovid.model.torque_input import TorqueInput

# Share of the unknown torque below which nothing is left of it. Convention.
_NEGLIGIBLE = 1e-3
# Factor between the durations that are distinguished, so that models share their data.
_DURATION_FACTOR = 2.0


class _Beginnings(NamedTuple):
    """The first samples of the runs with an unknown past."""

    data: FilterData
    among_all: IntArray  #: (n,) index of each filter step among those of all runs.
    among_own: IntArray  #: (n,) index of each filter step among those of the runs with an unknown past.
    innovations: IntArray  #: (N,) index of each innovation among those of all runs, in the order of time.
    offsets: IntArray  #: (r + 1,) index of the first one of each run, and N.


@dataclass(frozen=True, eq=False, kw_only=True)
class UnknownPasts:
    """Runs whose commands before the first sample are estimated, see `rovid.model.past`; docs/method.md, (12a).

    The error of the torque before the first sample is a constant state. Innovations are linear in it. The filter
    without it and a second one, with another torque before, give the innovations and variances of the filter with that
    state (Friedland 1969).
    """

    runs: IntArray  #: (r,) numbers of the runs in the chunk.
    data: FilterData  #: Of all runs of the chunk.
    inputs: InputCache  #: Of these r runs, with other commands before the first sample.
    changes: FloatArray  #: (r,) N m, change of the torque before by these commands.
    std: float  #: N m, standard deviation of the torque before.
    memory: float  #: s, time in which the motion forgets its state.
    _beginnings: dict[float, _Beginnings] = field(default_factory=dict)

    def correct(
        self,
        kernel: Callable[..., tuple[FloatArray, FloatArray]],
        models: Sequence[Model],
        batch: ParameterBatch,
        torque_inputs: Sequence[TorqueInput],
        angles: Sequence[FloatArray],
        found: tuple[FloatArray, FloatArray],
    ) -> None:
        """Add the unknown state to the (LANES, N) innovations and variances ``found`` by ``kernel``, in place."""
        if all(model.actuators.is_plain for model in models):
            return
        moved = [self.inputs.between_steps(model) for model in models]
        distinct = {id(one): (given, one) for given, one in zip(torque_inputs, moved, strict=True)}
        duration = max(self._duration(given, one) for given, one in distinct.values())
        if not duration > 0.0:
            return
        early = self._early(duration)
        inputs = FilterInputs.stack(
            _each(moved, lambda one: one.rows(early.among_own)), _each(angles, lambda one: one[early.among_all])
        )
        errors, variances = found
        shifted, _ = kernel(early.data, inputs, batch)
        change = np.repeat(self.changes, np.diff(early.offsets))
        sensitivity = (errors[:, early.innovations] - shifted) / change
        for error, variance, own in zip(errors, variances, sensitivity, strict=True):
            _update(error, variance, early.innovations, own, early.offsets, self.std**2)

    def _duration(self, given: TorqueInput, moved: TorqueInput) -> float:
        """Time in s after which the torque before has no influence on the torque."""
        longest, first = 0.0, 0
        for run, change in zip(self.runs.tolist(), self.changes.tolist(), strict=True):
            begin, end = self.data.offsets[run : run + 2].tolist()
            here, there = slice(begin, end), slice(first, first + end - begin)
            differs = np.abs(given.torque[here] - moved.torque[there]) > _NEGLIGIBLE * abs(change)
            if given.effect_inputs is not moved.effect_inputs:
                differs |= np.any(given.effect_inputs[here] != moved.effect_inputs[there], axis=1)
            last = np.flatnonzero(differs[:-1])
            if last.size:
                longest = max(longest, float(self.data.time[begin + last[-1] + 1] - self.data.time[begin]))
            first += end - begin
        return longest

    def _early(self, duration: float) -> _Beginnings:
        """The beginnings in which a torque over this ``duration`` in s has an influence."""
        until = _DURATION_FACTOR ** np.ceil(np.log(duration + self.memory) / np.log(_DURATION_FACTOR))
        if until not in self._beginnings:
            self._beginnings[until] = self._begin(until)
        return self._beginnings[until]

    def _begin(self, until: float) -> _Beginnings:
        data, all_steps, own_steps, counts, first = self.data, list[IntArray](), list[IntArray](), list[int](), 0
        for run in self.runs.tolist():
            begin, end = data.offsets[run : run + 2].tolist()
            count = int(np.searchsorted(data.time[begin:end], data.time[begin] + until, side="right"))
            all_steps.append(np.arange(begin, begin + count))
            own_steps.append(np.arange(first, first + count))
            counts.append(int((data.output_index[begin : begin + count] >= 0).sum()))
            first += end - begin
        rows = np.concatenate(all_steps)
        used = data.output_index[rows] >= 0
        index = np.full(used.shape, -1)
        index[used] = np.arange(used.sum())
        beginnings = FilterData(
            offsets=np.cumsum([0, *map(len, all_steps)]),
            time=data.time[rows],
            rate=data.rate[rows],
            start_position=data.start_position[self.runs],
            initial_rate=data.initial_rate[self.runs],
            output_index=index,
        )
        innovations = data.output_index[rows][used]
        return _Beginnings(beginnings, rows, np.concatenate(own_steps), innovations, np.cumsum([0, *counts]))


def _each(series: Sequence[Any], function: Callable[[Any], Any]) -> list[Any]:
    """``function`` of each of the ``series``; equal objects give equal results."""
    found = {id(one): one for one in series}
    results = {key: function(one) for key, one in found.items()}
    return [results[id(one)] for one in series]


@compiled
def _update(
    error: FloatArray, variance: FloatArray, rows: IntArray, sensitivity: FloatArray, offsets: IntArray, prior: float
) -> None:
    """Recursive least squares of the state of each run, with its ``prior`` variance; docs/method.md, (12a)."""
    for run in range(len(offsets) - 1):
        mean, spread = 0.0, prior
        for k in range(offsets[run], offsets[run + 1]):
            at, slope = rows[k], sensitivity[k]
            error[at] -= slope * mean
            variance[at] += slope * slope * spread
            gain = spread * slope / variance[at]
            mean += gain * error[at]
            spread -= gain * slope * spread
