"""Torque inputs of all runs, with the resolved commands cached between models."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple, Self
from weakref import ref

import numpy as np

from rovid.core.array_types import BoolArray, IntArray
from rovid.core.lru_cache import SizedCache
from rovid.model.actuator_model import CommandSeries
from rovid.model.model import Model
from rovid.model.torque_input import MAX_SUBDIVISION, Intervals, TorqueInput
from rovid.signals.preprocessing import Run
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle

# Largest error of an angle from averaging the torque over an interval, as a share of the position noise.
_MAX_ANGLE_ERROR = 0.1
# Resolved commands of all input caches. Those of logs of hours take more than there is room for.
_COMMANDS = SizedCache(96_000_000, evict_randomly=True)
# Shortest transient after a change of a command that is resolved finely, in steps, and the factor between the
# transients that are distinguished. Few distinct transients let models share commands.
_LEAST_TRANSIENT, _TRANSIENT_FACTOR = 5.0, 4.0


class _StepCommands(NamedTuple):
    """Commands of all runs, and the intervals between steps; None for those between the commands' own instants."""

    commands: CommandSeries
    between: Intervals | None

    @property
    def nbytes(self) -> int:
        """Bytes, approximately."""
        return self.commands.nbytes + (0 if self.between is None else self.between.nbytes)


@dataclass(frozen=True, eq=False, kw_only=True)
class InputCache:
    """Torque inputs of some runs."""

    runs: Sequence[Run]
    vehicle: Vehicle | None  #: None where no effect may act between command and torque.
    inertia: float  #: Approximate inertia, kg m^2.
    position_noise: float  #: Standard deviation of the measured position.
    steps: list[IntArray] | None  #: For each run, the (n,) sample numbers of the steps; None for all samples.
    #: Whether only mean torques are needed, see `chosen_rows`; else the torque from each step to the next and its
    #: timing within.
    means_only: bool = False
    parent: Self | None = None  #: The cache of all runs, where this is a subset; it decides on the resolution.
    #: Count of values of a torque input that is shorter than the log -> the samples of each run behind it.
    chosen_rows: dict[int, list[IntArray]] = field(default_factory=dict, init=False, repr=False)

    def subset(self, place: slice) -> Self:
        """The inputs of some of the runs."""
        return self.of(self.runs[place], None if self.steps is None else self.steps[place])

    def of(self, runs: Sequence[Run], steps: list[IntArray] | None) -> Self:
        """The inputs of other ``runs`` at these ``steps``, at the same resolution."""
        return replace(self, runs=runs, steps=steps, parent=self._root)

    @property
    def _root(self) -> Self:
        return self if self.parent is None else self.parent

    def at_samples(self, model: Model) -> Iterator[TorqueInput]:
        """Torque input of each run at all samples of its log."""
        for run in self.runs:
            if self.vehicle is None or model.actuators.is_plain:
                yield TorqueInput.held(run.torque)
            else:
                yield model.torque_input(self.vehicle, run.trial)

    def between_steps(self, model: Model) -> TorqueInput:
        """Torque input of all runs, from each step to the next."""
        if self.vehicle is None or model.actuators.is_plain:
            return self._plain
        return model.actuators.torque_inputs(*self._commands(self.vehicle, model))

    def _commands(self, vehicle: Vehicle, model: Model) -> _StepCommands:
        """Commands at the resolution that ``model`` needs."""
        actuators, root = model.actuators, self._root
        parts = 1 if self.means_only and actuators.has_exact_means else min(root.parts, actuators.subdivision)
        transient = root.transient_seconds(actuators.settling_time(root.largest_change))
        return _COMMANDS.get_or_make((ref(self), parts, transient), lambda: self._resolve(vehicle, parts, transient))

    @cached_property
    def _plain(self) -> TorqueInput:
        """Torque input by the bench curves."""
        torques = [run.torque for run in self.runs]
        held = np.concatenate(torques)
        if self.steps is None or self.means_only:
            return TorqueInput.held(held, offsets=np.cumsum([0, *map(len, torques)]))
        return TorqueInput.averaged_over(Intervals.from_times([run.trial.time for run in self.runs], self.steps), held)

    def _resolve(self, vehicle: Vehicle, parts: int, transient: float) -> _StepCommands:
        """Commands with intervals cut into ``parts`` for ``transient`` s after each change."""
        fresh, steps = [_is_transient(run.trial, transient) for run in self.runs], self.steps
        rows, cut = self._needed_rows(fresh), fresh
        if rows is not None:
            cut = [here[chosen] for here, chosen in zip(fresh, rows, strict=True)]
            if self.means_only:
                self.chosen_rows[sum(map(len, rows))] = rows
            if steps is not None:
                steps = [np.searchsorted(here, step) for here, step in zip(rows, steps, strict=True)]
        trials = [run.trial for run in self.runs]
        commands = CommandSeries.from_trials(vehicle, trials, parts, rows, cut if parts > 1 else None)
        return _StepCommands(commands, None if steps is None or self.means_only else commands.intervals_between(steps))

    def _needed_rows(self, fresh: Sequence[BoolArray]) -> list[IntArray] | None:
        """For each run, the samples at its ends, at its steps and in a transient; None for all samples."""
        if self.steps is None:
            return None
        rows = []
        for here, steps in zip(fresh, self.steps, strict=True):
            needed = here.copy()
            needed[[0, -1]] = needed[steps] = True
            rows.append(np.flatnonzero(needed))
        return None if sum(map(len, rows)) == sum(map(len, fresh)) else rows

    def transient_seconds(self, settling_time: float) -> float:
        """Time in s after a change of commands that is resolved finely: the ``settling_time`` or longer."""
        least = _LEAST_TRANSIENT * self._step_seconds
        if settling_time <= least:
            return least
        if math.isinf(settling_time):
            return settling_time
        return least * _TRANSIENT_FACTOR ** math.ceil(math.log(settling_time / least, _TRANSIENT_FACTOR))

    @cached_property
    def _step_seconds(self) -> float:
        """Median interval between steps, s."""
        if self.steps is None:
            return float(np.median([run.trial.sampling_interval for run in self.runs]))
        pairs = zip(self.runs, self.steps, strict=True)
        return float(np.median(np.concatenate([np.diff(run.trial.time[at]) for run, at in pairs])))

    @cached_property
    def largest_change(self) -> float:
        """Largest possible change of a command."""
        commands = [run.trial.commands for run in self.runs]
        return max(float(np.max(np.ptp(here, axis=0), initial=0.0)) for here in commands)

    @cached_property
    def parts(self) -> int:
        """Parts per sampling interval that keep the angle's error from averaging the torque below the noise."""
        period = float(np.median([run.trial.sampling_interval for run in self.runs]))
        largest = max(float(np.max(np.abs(run.torque))) for run in self.runs)
        # Distance in the middle between a parabola over the interval and its chord.
        error = largest / self.inertia * period**2 / 8.0
        parts = math.ceil(math.sqrt(error / (_MAX_ANGLE_ERROR * self.position_noise)))
        return int(np.clip(parts, 1, MAX_SUBDIVISION))


def _is_transient(trial: Trial, seconds: float) -> BoolArray:
    """(n,) whether each sample of ``trial`` is at most so many ``seconds`` after a change of a command."""
    count = len(trial.time)
    changed = np.concatenate(([trial.past is not None], (np.diff(trial.commands, axis=0) != 0.0).any(axis=1)))
    latest = np.maximum.accumulate(np.where(changed, np.arange(count), -1))
    return np.asarray((latest >= 0) & (trial.time - trial.time[latest] <= seconds))
