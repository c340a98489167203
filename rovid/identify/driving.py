"""What drives the runs of a campaign, worked out once for a model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from rovid.campaign.trial import Trial
from rovid.campaign.vehicle import Vehicle
from rovid.ground.arrays import BoolArray, IntArray
from rovid.model.commanded import Commanded
from rovid.model.drive import MOST_PARTS, Drive, Intervals
from rovid.model.model import Model
from rovid.motion.runs import Run

# Of the position's noise: so much of an angle may be lost by a mean torque.
_LOST = 0.1
# For so many steps at least a change of a command is looked at closely, or so many times as long, or as long again.
_FRESH, _LONGER = 5.0, 4.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Driving:
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
    """

    runs: Sequence[Run]
    vehicle: Vehicle | None
    inertia: float
    position_noise: float
    steps: list[IntArray] | None
    means_alone: bool = False
    # By into how many intervals are cut, and how long a change is fresh.
    _commanded: dict[tuple[int, float], tuple[Commanded, Intervals | None]] = field(
        default_factory=dict, init=False, repr=False
    )
    _chosen: dict[int, list[IntArray]] = field(default_factory=dict, init=False, repr=False)

    def at_instants(self, model: Model) -> Drive:
        """Of all runs, at all instants of their logs."""
        if self.vehicle is None or model.drivetrain.is_plain:
            return self._held
        return Drive.joined([model.drive(self.vehicle, run.trial) for run in self.runs])

    def between_steps(self, model: Model) -> Drive:
        """Of all runs, from each of their steps to the next."""
        if self.vehicle is None or model.drivetrain.is_plain:
            return self._held_between
        return model.drivetrain.driven(*self._given(self.vehicle, model))

    def _given(self, vehicle: Vehicle, model: Model) -> tuple[Commanded, Intervals | None]:
        """What was commanded, as finely as ``model`` asks for; and between which steps."""
        train, steps = model.drivetrain, self.steps
        parts = 1 if self.means_alone and train.means_exactly else min(self._parts, train.parts)
        fresh_for = self._fresh_for(train.settles(self._change))
        if (parts, fresh_for) not in self._commanded:
            fresh = [_fresh(run.trial, fresh_for) for run in self.runs]
            at, cut = self._at(fresh), fresh
            if at is not None:
                cut = [here[chosen] for here, chosen in zip(fresh, at, strict=True)]
                self._chosen[sum(map(len, at))] = at
                if steps is not None:
                    steps = [np.searchsorted(here, step) for here, step in zip(at, steps, strict=True)]
            trials = [run.trial for run in self.runs]
            given = Commanded.of(vehicle, trials, parts, at, cut if parts > 1 else None)
            between = None if steps is None or self.means_alone else given.between(steps)
            self._commanded[parts, fresh_for] = given, between
        return self._commanded[parts, fresh_for]

    def chosen(self, count: int) -> list[IntArray]:
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

    def _fresh_for(self, settles: float) -> float:
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
            return float(np.median([run.trial.period for run in self.runs]))
        pairs = zip(self.runs, self.steps, strict=True)
        return float(np.median(np.concatenate([np.diff(run.trial.time[at]) for run, at in pairs])))

    @cached_property
    def _change(self) -> float:
        """The most by which a command may change."""
        commands = [run.trial.commands for run in self.runs]
        return max(float(np.max(np.ptp(here, axis=0), initial=0.0)) for here in commands)

    @cached_property
    def _held(self) -> Drive:
        torques = [run.torque for run in self.runs]
        return Drive.held(np.concatenate(torques), begins=np.cumsum([0, *map(len, torques)]))

    @cached_property
    def _held_between(self) -> Drive:
        if self.steps is None or self.means_alone:
            return self._held
        return Drive.over(Intervals.of([run.trial.time for run in self.runs], self.steps), self._held.torque)

    @cached_property
    def _parts(self) -> int:
        """How finely a torque that changes between two samples has to be known.

        What a mean in its place does to the angle is to be lost in the position's noise.
        """
        period = float(np.median([run.trial.period for run in self.runs]))
        most = max(float(np.max(np.abs(run.torque))) for run in self.runs)
        # A parabola over the interval and its chord are so far apart in the middle.
        lost = most / self.inertia * period**2 / 8.0
        parts = math.ceil(math.sqrt(lost / (_LOST * self.position_noise)))
        return int(np.clip(parts, 1, MOST_PARTS))


def _fresh(trial: Trial, seconds: float) -> BoolArray:
    """(n,) which instants of ``trial`` are no later than so many after a change of a command."""
    count = len(trial.time)
    changed = np.concatenate(([False], (np.diff(trial.commands, axis=0) != 0.0).any(axis=1)))
    latest = np.maximum.accumulate(np.where(changed, np.arange(count), -1))
    return np.asarray((latest >= 0) & (trial.time - trial.time[latest] <= seconds))
