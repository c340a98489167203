"""What drives the runs of a campaign, worked out once for a model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from rovid.campaign.trial import Trial
from rovid.campaign.vehicle import Vehicle
from rovid.ground.arrays import IntArray
from rovid.model.commanded import Commanded
from rovid.model.drive import MOST_PARTS, Drive, Intervals
from rovid.model.model import Model
from rovid.motion.runs import Run

# Of the position's noise: so much of an angle may be lost by a mean torque.
_LOST = 0.1
# A change of a command is long past after so many steps: what is left of it then is lost in the noise, too.
_FRESH = 5.0


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
        Whether the mean torque from each of the instants `chosen` to the next is all that is wanted; else that from
        each step to the next is, and when in between it acts.
    """

    runs: Sequence[Run]
    vehicle: Vehicle | None
    inertia: float
    position_noise: float
    steps: list[IntArray] | None
    means_alone: bool = False
    _commanded: dict[tuple[int, bool], tuple[Commanded, Intervals | None]] = field(
        default_factory=dict, init=False, repr=False
    )

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
        train, chosen, steps = model.drivetrain, self.chosen, self.steps
        few, parts = train.calms, min(self._parts, train.parts)
        if self.means_alone:
            few, parts, steps = train.means_exactly, 1 if train.means_exactly else parts, None
        if (parts, few) not in self._commanded:
            at = chosen if few else None
            given = Commanded.of(vehicle, [run.trial for run in self.runs], parts, at)
            if at is not None and steps is not None:
                steps = [np.searchsorted(here, step) for here, step in zip(at, steps, strict=True)]
            self._commanded[parts, few] = given, None if steps is None else given.between(steps)
        return self._commanded[parts, few]

    @cached_property
    def chosen(self) -> list[IntArray] | None:
        """Of each run, its steps and whatever commands changed at, or a while before; None for all instants."""
        if self.steps is None:
            return None
        return [_telling(run.trial, steps) for run, steps in zip(self.runs, self.steps, strict=True)]

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


def _telling(trial: Trial, steps: IntArray) -> IntArray:
    """Instants of ``trial``: the ``steps``, the ends, and all from each change of a command until it is long past."""
    time, count = trial.time, len(trial.time)
    changed = np.concatenate(([False], (np.diff(trial.commands, axis=0) != 0.0).any(axis=1)))
    latest = np.maximum.accumulate(np.where(changed, np.arange(count), -1))
    apart = float(np.median(np.diff(time[steps]))) if len(steps) > 1 else 0.0
    fresh = (latest >= 0) & (time - time[latest] <= _FRESH * apart)
    fresh[[0, count - 1]] = fresh[steps] = True
    return np.flatnonzero(fresh)
