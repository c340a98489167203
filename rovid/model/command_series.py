"""Commands of trials, and what effects make of them, cached for all models that are compared."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self
from weakref import WeakValueDictionary, ref

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray, IntArray
from rovid.core.lru_cache import SizedCache, Value
from rovid.effects.actuator_inputs import ActuatorInputs, actuator_inputs
from rovid.model.torque_input import Intervals
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle

# Commands, thrusts and torques after effects, of any trials. Models that are compared have most of them in common.
_CACHE = SizedCache(32_000_000)


@dataclass(frozen=True, eq=False)
class CommandSeries:
    """Commands of one trial or of several concatenated ones."""

    vehicle: Vehicle
    inputs: ActuatorInputs  #: The trials as effects see them, with each interval between two log instants subdivided.
    held_commands: FloatArray  #: (n, k) commands at the selected log instants, in each trial after those of its past.

    @classmethod
    def from_trials(
        cls,
        vehicle: Vehicle,
        trials: Sequence[Trial],
        subdivision: int = 1,
        at: Sequence[IntArray] | None = None,
        subdivided: Sequence[BoolArray] | None = None,
    ) -> Self:
        """Commands in ``trials``. Equal arguments give the same object as long as it is in use.

        Parameters
        ----------
        subdivision
            Number of parts of each interval.
        at
            Selected log instants of each trial, between which no command changes; all if None.
        subdivided
            Which of the intervals after the selected instants are subdivided; all if None.
        """
        arrays = (series.tobytes() for series in (*(at or ()), *(subdivided or ())))
        key = (vehicle, subdivision, at is None, *trials, *arrays)
        found = _IN_USE.get(key)
        if not isinstance(found, cls):
            none = [None] * len(trials)
            every = list(zip(trials, at or none, subdivided or none, strict=True))
            inputs = ActuatorInputs.concatenated(
                [actuator_inputs(vehicle, trial, subdivision, here, some) for trial, here, some in every]
            )
            commands = list[FloatArray]()
            for trial, here, _ in every:
                commands += [] if trial.past is None else [trial.past.commands]
                commands.append(trial.commands if here is None else trial.commands[here])
            found = cls(vehicle, inputs, np.concatenate(commands))
            _IN_USE[key] = found
        return found

    def cached(self, key: Hashable, make: Callable[[], Value]) -> Value:
        """The cached result of ``make``; ``key`` holds the effects and parameters on which it depends."""
        return _CACHE.get_or_make((ref(self), key), make)

    @property
    def nbytes(self) -> int:
        """Approximate size in bytes, with commands and thrust at all instants."""
        finer = 2 * self.held_commands[:1].nbytes + (2 + len(self.inputs.extras)) * self.inputs.time.itemsize
        return 2 * self.held_commands.nbytes + finer * len(self.inputs.time)

    @cached_property
    def commands(self) -> FloatArray:
        """(m, k) commands at the instants of ``inputs``."""
        return self.inputs.subdivide(self.held_commands)

    @cached_property
    def thrust(self) -> FloatArray:
        """(m, k) thrust in N by the bench curves, at the instants of ``inputs``."""
        return self.inputs.subdivide(self.vehicle.thrust(self.held_commands))

    @cached_property
    def intervals(self) -> Intervals | None:
        """Intervals between the log's instants; None if nothing is subdivided."""
        if self.inputs.subdivision == 1:
            return None
        pairs = zip(self.inputs.subdivisions, self.inputs.trials, strict=True)
        return self.intervals_between([np.arange(len(counts) - one.past) for counts, one in pairs])

    def intervals_between(self, at: Sequence[IntArray]) -> Intervals:
        """Intervals between those of each trial's selected instants with indices ``at``."""
        times = [self.inputs.time[one.rows] for one in self.inputs.trials]
        every = zip(self.inputs.subdivisions, self.inputs.trials, at, strict=True)
        return Intervals.from_times(
            times, [(np.cumsum(counts) - counts)[one.past + here] for counts, one, here in every]
        )


# Command series in use, by the arguments that they were made from.
_IN_USE: WeakValueDictionary[tuple[object, ...], CommandSeries] = WeakValueDictionary()
