"""What was commanded in trials, and all that follows from it whichever effects there are."""

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

# What effects made of commands, of any trials: models that are compared share most of it.
_MADE = SizedCache(32_000_000)


@dataclass(frozen=True, eq=False)
class CommandSeries:
    """Commands of one trial, or of several one after the other.

    Attributes
    ----------
    where
        What effects are told of the trials, with each interval between two of the log's instants cut into parts.
    held
        (n, k) commands at the log's instants, those that were chosen.
    """

    vehicle: Vehicle
    inputs: ActuatorInputs
    held_commands: FloatArray

    @classmethod
    def from_trials(
        cls,
        vehicle: Vehicle,
        trials: Sequence[Trial],
        parts: int = 1,
        at: Sequence[IntArray] | None = None,
        cut: Sequence[BoolArray] | None = None,
    ) -> Self:
        """In ``trials``, with each interval cut into ``parts``; one for all who ask, as long as anybody has it.

        Of each trial the instants ``at``, all where that is None: no command changes at any other. Of the intervals
        from these on those ``cut``, all where that is None.
        """
        told = (series.tobytes() for series in (*(at or ()), *(cut or ())))
        key = (vehicle, parts, at is None, *trials, *told)
        found = _SHARED.get(key)
        if not isinstance(found, cls):
            none = [None] * len(trials)
            every = list(zip(trials, at or none, cut or none, strict=True))
            where = ActuatorInputs.concatenated(
                [actuator_inputs(vehicle, trial, parts, here, some) for trial, here, some in every]
            )
            held = [trial.commands if here is None else trial.commands[here] for trial, here, _ in every]
            found = cls(vehicle, where, np.concatenate(held))
            _SHARED[key] = found
        return found

    def cached(self, of: Hashable, make: Callable[[], Value]) -> Value:
        """What effects ``make`` of it, by what it is made ``of``: them and their parameters."""
        return _MADE.get_or_make((ref(self), of), make)

    @property
    def nbytes(self) -> int:
        """Bytes, about, with commands and thrust, and when they are given."""
        finer = 2 * self.held_commands[:1].nbytes + (2 + len(self.inputs.extras)) * self.inputs.time.itemsize
        return 2 * self.held_commands.nbytes + finer * len(self.inputs.time)

    @cached_property
    def commands(self) -> FloatArray:
        """(m, k) at the instants of ``where``."""
        return self.inputs.subdivide(self.held_commands)

    @cached_property
    def thrust(self) -> FloatArray:
        """(m, k) N by the bench curves, at the instants of ``where``."""
        return self.inputs.subdivide(self.vehicle.thrust(self.held_commands))

    @cached_property
    def intervals(self) -> Intervals | None:
        """Between the log's instants; None where these are all that there are."""
        if self.inputs.subdivision == 1:
            return None
        return self.intervals_between([np.arange(len(counts)) for counts in self.inputs.subdivisions])

    def intervals_between(self, at: Sequence[IntArray]) -> Intervals:
        """Of each trial from each of the chosen instants ``at`` to the next of them."""
        times = [self.inputs.time[one.rows] for one in self.inputs.trials]
        pairs = zip(self.inputs.subdivisions, at, strict=True)
        return Intervals.from_times(times, [(np.cumsum(counts) - counts)[here] for counts, here in pairs])


# By the vehicle, the parts and the trials, which nobody else may be as long as it lasts.
_SHARED: WeakValueDictionary[tuple[object, ...], CommandSeries] = WeakValueDictionary()
