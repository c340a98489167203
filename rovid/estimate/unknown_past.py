"""The unknown state of drives and water at a log's first sample, as more states of the Kalman filter."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.estimate.dataset import FitData, InputCache
from rovid.jit.decorators import compiled
from rovid.model.bound_effects import term_values, unknown_states
from rovid.model.filter_batch import FilterData, FilterInputs, ParameterBatch
from rovid.model.model import Model
from rovid.model.torque_input import TorqueInput

# Share of the unknown torque below which nothing is left of it. Convention.
_NEGLIGIBLE = 1e-3
# Factor between the durations that are distinguished, so that models share their data.
_DURATION_FACTOR = 2.0


class _Beginnings(NamedTuple):
    """The first samples of the runs that do not begin at rest."""

    data: FilterData
    among_all: IntArray  #: (n,) index of each filter step among those of all runs.
    among_own: IntArray  #: (n,) index of each filter step among those of the runs with an unknown past.
    innovations: IntArray  #: (N,) index of each innovation among those of all runs, in the order of time.
    offsets: IntArray  #: (r + 1,) index of the first one of each run, and N.


@dataclass(frozen=True, eq=False, kw_only=True)
class UnknownPasts:
    """Runs that do not begin at rest, see `rovid.model.ode`; docs/method.md, (12a).

    The error of the torque before the first sample, and the states of water in motion at the first sample, are further
    states. Innovations are linear in them. The filter without them, and one with another value of each, give the
    innovations and variances of the filter with these states (Friedland 1969).
    """

    runs: IntArray  #: (r,) numbers of the runs in the chunk.
    data: FilterData  #: Of all runs of the chunk.
    inputs: InputCache  #: Of these r runs, with other commands before the first sample where these are estimated.
    changes: FloatArray  #: (r,) N m, change of the torque before by these commands.
    std: float  #: N m, standard deviation of the torque before.
    memory: float  #: s, time in which the motion forgets its state.
    #: ``rate``, ``torque``: RMS rate in rad/s and torque in N m of the data: what moved the water.
    rate: float
    torque: float
    _beginnings: dict[float, _Beginnings] = field(default_factory=dict)

    @np.errstate(invalid="ignore")  # infinite innovations of a model that diverges
    def correct(
        self,
        kernel: Callable[..., tuple[FloatArray, FloatArray]],
        models: Sequence[Model],
        batch: ParameterBatch,
        torque_inputs: Sequence[TorqueInput],
        angles: Sequence[FloatArray],
        found: tuple[FloatArray, FloatArray],
    ) -> None:
        """Add the unknown states to the (LANES, N) innovations and variances ``found`` by ``kernel``, in place."""
        drives = not all(model.actuators.is_plain for model in models) and bool(np.any(self.changes))
        water = self._water(models)
        if not (drives or water):
            return
        moved = list(map(self.inputs.between_steps, models)) if drives else []
        duration = math.inf
        if not water:
            distinct = {id(one): (given, one) for given, one in zip(torque_inputs, moved, strict=True)}
            duration = max(self._duration(given, one) for given, one in distinct.values())
        if not duration > 0.0:
            return
        early = self._early(duration)
        errors, variances = found
        first = errors[:, early.innovations]
        own_angles = _each(angles, lambda one: one[early.among_all])
        counts = np.diff(early.offsets)
        unknowns = []
        if drives:
            inputs = FilterInputs.stack(_each(moved, lambda one: one.rows(early.among_own)), own_angles)
            change = np.where(self.changes == 0.0, math.inf, self.changes)
            shifted, _ = kernel(early.data, inputs, batch)
            unknowns.append(((first - shifted) / np.repeat(change, counts), np.full(len(models), self.std)))
        if water:
            inputs = FilterInputs.stack(_each(torque_inputs, lambda one: one.rows(early.among_all)), own_angles)
        for row, stds in water:
            # Water that a turn has moved turns the same way.
            step = np.mean(stds) * np.where(early.data.initial_rate[:, 0] < 0.0, -1.0, 1.0)
            states = np.zeros((len(self.runs), row + 1))
            states[:, row] = step
            shifted, _ = kernel(early.data._replace(states=states), inputs, batch)
            unknowns.append(((first - shifted) / np.repeat(step, counts), stds))
        sensitivity, std = np.array([one for one, _ in unknowns]), np.array([one for _, one in unknowns])
        sensitivity[~np.isfinite(sensitivity)] = 0.0
        for lane, (error, variance) in enumerate(zip(errors, variances, strict=True)):
            own = np.ascontiguousarray(sensitivity[:, lane])
            _update(error, variance, early.innovations, own, early.offsets, std[:, lane] ** 2)

    def _water(self, models: Sequence[Model]) -> list[tuple[int, FloatArray]]:
        """Index among the states of all terms, and (LANES,) standard deviation, of each unknown state of water."""
        lanes = [unknown_states(model.terms, self.rate, self.torque / model.inertia) for model in models]
        states = [(each[0][0], np.array([std for _, std in each])) for each in zip(*lanes, strict=True)]
        return [(row, stds) for row, stds in states if stds.all()]

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
        if until in self._beginnings:
            return self._beginnings[until]
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
            states=np.zeros((len(self.runs), 0)),
        )
        innovations, offsets = data.output_index[rows][used], np.cumsum([0, *counts])
        found = _Beginnings(beginnings, rows, np.concatenate(own_steps), innovations, offsets)
        self._beginnings[until] = found
        return found


def water_warning(model: Model, data: FitData) -> list[str]:
    """Warning that water and tether may not be at rest in runs that begin in motion; empty where none does."""
    names = [run.trial.name for run in data.driven_runs if run.trial.past is not None]
    if not names or all(term.unknown_start is None for term, _ in term_values(model.terms)):
        return []
    more = f" and of {len(names) - 1} more" if len(names) > 1 else ""
    allowed = "The parameters allow for this, and simulations start with what fits the measured motion best."
    if data.means_only:
        allowed = "The fitted predictions start with both at rest, and their first errors may be too large there."
    return [f"The water may already move, or the tether be stretched, at the start of {names[0]}{more}. {allowed}"]


def _each(series: Sequence[Any], function: Callable[[Any], Any]) -> list[Any]:
    """``function`` of each of the ``series``; equal objects give equal results."""
    found = {id(one): one for one in series}
    results = {key: function(one) for key, one in found.items()}
    return [results[id(one)] for one in series]


@compiled
def _update(
    error: FloatArray,
    variance: FloatArray,
    rows: IntArray,
    sensitivity: FloatArray,
    offsets: IntArray,
    prior: FloatArray,
) -> None:
    """Recursive least squares of the states of each run, with their (k,) ``prior`` variances; docs/method.md, (12a)."""
    count = len(prior)
    mean, spread, cross = np.zeros(count), np.zeros((count, count)), np.zeros(count)
    for run in range(len(offsets) - 1):
        for i in range(count):
            mean[i] = 0.0
            for j in range(count):
                spread[i, j] = prior[i] if i == j else 0.0
        for k in range(offsets[run], offsets[run + 1]):
            at = rows[k]
            for i in range(count):
                cross[i] = 0.0
                for j in range(count):
                    cross[i] += spread[i, j] * sensitivity[j, k]
                error[at] -= sensitivity[i, k] * mean[i]
            for i in range(count):
                variance[at] += sensitivity[i, k] * cross[i]
            for i in range(count):
                gain = cross[i] / variance[at]
                mean[i] += gain * error[at]
                for j in range(count):
                    spread[i, j] -= gain * cross[j]
