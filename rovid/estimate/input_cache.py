"""What drives the runs of a campaign, worked out once for a model."""

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
from rovid.model.command_series import CommandSeries
from rovid.model.model import Model
from rovid.model.torque_input import MAX_SUBDIVISION, Intervals, TorqueInput
from rovid.signals.preprocessing import Run
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle

# Of the position's noise: so much of an angle may be lost by a mean torque.
_LOST = 0.1
# What was commanded, as finely as models asked for it: that of logs of hours takes more than there is room for.
_GIVEN = SizedCache(96_000_000, evict_randomly=True)
# For so many steps at least a change of a command is looked at closely, or so many times as long, or as long again.
_FRESH, _LONGER = 5.0, 4.0


class _Given(NamedTuple):
    """What was commanded, and between which steps it drives; None for between its instants."""

    commanded: CommandSeries
    between: Intervals | None

    @property
    def nbytes(self) -> int:
        """Bytes, about."""
        return self.commanded.nbytes + (0 if self.between is None else self.between.nbytes)


@dataclass(frozen=True, eq=False, kw_only=True)
class InputCache:
    """What drives some runs.

    Attributes
    ----------
    vehicle
        None where effects between command and torque have nothing to act on.
    inertia
        kg m^2, about.
    position_noise
        Standard deviation of the noise of what is measured.
    steps
        (n,) of each run, at which of the log's instants it is looked at; None for all.
    means_alone
        Whether the mean torque from each of some instants to the next is all that is wanted, see `chosen`; else that
        from each step to the next is, and when in between it acts.
    among
        That of all runs, where these are some of them: how finely it is looked is told by all.
    """

    runs: Sequence[Run]
    vehicle: Vehicle | None
    inertia: float
    position_noise: float
    steps: list[IntArray] | None
    means_only: bool = False
    parent: Self | None = None
    _chosen: dict[int, list[IntArray]] = field(default_factory=dict, init=False, repr=False)

    def subset(self, place: slice) -> Self:
        """Of some of the runs."""
        steps = None if self.steps is None else self.steps[place]
        return replace(self, runs=self.runs[place], steps=steps, parent=self._all)

    @property
    def _all(self) -> Self:
        return self if self.parent is None else self.parent

    def at_samples(self, model: Model) -> Iterator[TorqueInput]:
        """Of each run, at all instants of its log."""
        for run in self.runs:
            if self.vehicle is None or model.actuators.is_plain:
                yield TorqueInput.held(run.torque)
            else:
                yield model.torque_input(self.vehicle, run.trial)

    def between_steps(self, model: Model) -> TorqueInput:
        """Of all runs, from each of their steps to the next."""
        if self.vehicle is None or model.actuators.is_plain:
            return self._held_between
        return model.actuators.torque_inputs(*self._given(self.vehicle, model))

    def _given(self, vehicle: Vehicle, model: Model) -> _Given:
        """What was commanded, as finely as ``model`` asks for."""
        train, every = model.actuators, self._all
        parts = 1 if self.means_only and train.has_exact_means else min(every.parts, train.subdivision)
        fresh_for = every.transient_seconds(train.settling_time(every.change))
        return _GIVEN.get_or_make((ref(self), parts, fresh_for), lambda: self._commanded(vehicle, parts, fresh_for))

    def _commanded(self, vehicle: Vehicle, parts: int, fresh_for: float) -> _Given:
        """With intervals cut into so many ``parts`` as long as a change of commands is fresh."""
        fresh, steps = [_fresh(run.trial, fresh_for) for run in self.runs], self.steps
        at, cut = self._at(fresh), fresh
        if at is not None:
            cut = [here[chosen] for here, chosen in zip(fresh, at, strict=True)]
            if self.means_only:
                self._chosen[sum(map(len, at))] = at
            if steps is not None:
                steps = [np.searchsorted(here, step) for here, step in zip(at, steps, strict=True)]
        trials = [run.trial for run in self.runs]
        commanded = CommandSeries.from_trials(vehicle, trials, parts, at, cut if parts > 1 else None)
        return _Given(commanded, None if steps is None or self.means_only else commanded.intervals_between(steps))

    def chosen_rows(self, count: int) -> list[IntArray]:
        """Of each run the instants that a drive of so many in all is of, where they are not all that there are."""
        return self._chosen[count]

    def _at(self, fresh: Sequence[BoolArray]) -> list[IntArray] | None:
        """Of each run its ends, its steps and whatever is ``fresh``; None for all instants."""
        if self.steps is None:
            return None
        at = []
        for here, steps in zip(fresh, self.steps, strict=True):
            telling = here.copy()
            telling[[0, -1]] = telling[steps] = True
            at.append(np.flatnonzero(telling))
        return None if sum(map(len, at)) == sum(map(len, fresh)) else at

    def transient_seconds(self, settles: float) -> float:
        """How long a change of commands is looked at closely, in s: as long as it takes, or longer.

        There are few such times, so that much is shared by models that are compared.
        """
        least = _FRESH * self._apart
        if settles <= least:
            return least
        return least * _LONGER ** math.ceil(math.log(settles / least, _LONGER)) if settles < math.inf else settles

    @cached_property
    def _apart(self) -> float:
        """How far apart steps are, in s, mostly."""
        if self.steps is None:
            return float(np.median([run.trial.sampling_interval for run in self.runs]))
        pairs = zip(self.runs, self.steps, strict=True)
        return float(np.median(np.concatenate([np.diff(run.trial.time[at]) for run, at in pairs])))

    @cached_property
    def change(self) -> float:
        """The most by which a command may change."""
        commands = [run.trial.commands for run in self.runs]
        return max(float(np.max(np.ptp(here, axis=0), initial=0.0)) for here in commands)

    @cached_property
    def _held_between(self) -> TorqueInput:
        torques = [run.torque for run in self.runs]
        held = np.concatenate(torques)
        if self.steps is None or self.means_only:
            return TorqueInput.held(held, begins=np.cumsum([0, *map(len, torques)]))
        return TorqueInput.averaged_over(Intervals.from_times([run.trial.time for run in self.runs], self.steps), held)

    @cached_property
    def parts(self) -> int:
        """How finely a torque that changes between two samples has to be known.

        What a mean in its place does to the angle is to be lost in the position's noise.
        """
        period = float(np.median([run.trial.sampling_interval for run in self.runs]))
        most = max(float(np.max(np.abs(run.torque))) for run in self.runs)
        # A parabola over the interval and its chord are so far apart in the middle.
        lost = most / self.inertia * period**2 / 8.0
        parts = math.ceil(math.sqrt(lost / (_LOST * self.position_noise)))
        return int(np.clip(parts, 1, MAX_SUBDIVISION))


def _fresh(trial: Trial, seconds: float) -> BoolArray:
    """(n,) which instants of ``trial`` are no later than so many after a change of a command."""
    count = len(trial.time)
    changed = np.concatenate(([False], (np.diff(trial.commands, axis=0) != 0.0).any(axis=1)))
    latest = np.maximum.accumulate(np.where(changed, np.arange(count), -1))
    return np.asarray((latest >= 0) & (trial.time - trial.time[latest] <= seconds))
