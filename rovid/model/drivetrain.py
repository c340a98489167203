"""From commands to what drives the vehicle, through every effect on the way."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from rovid.campaign.trial import Trial
from rovid.campaign.vehicle import Vehicle
from rovid.effects.actuation import SPEEDS, Actuation
from rovid.effects.base import Actuating, OnCommand, OnThrust, OnTorque, Term, Values
from rovid.ground.arrays import FloatArray
from rovid.model.acting import Acting, that_act
from rovid.model.commanded import Commanded
from rovid.model.drive import MOST_PARTS, Drive


@dataclass(frozen=True, eq=False)
class Drivetrain:
    """The bench curves, and those of a model's effects that act between command and torque."""

    acting: tuple[Acting, ...]

    @property
    def is_plain(self) -> bool:
        """Whether no effect needs more of the commands than the torque that the bench curve makes of them."""
        effects = [one.effect for one in self.acting]
        asked = any(effect.races or set(effect.needs) & set(SPEEDS) for effect in effects)
        return not asked and not any(effect.actuates for effect in effects)

    @property
    def values(self) -> tuple[float, ...]:
        """Parameters on which the drive depends."""
        return tuple(float(value) for one in self.acting if one.effect.actuates for value in one.numbers)

    @property
    def parts(self) -> int:
        """How many parts each interval between two instants has to be cut into for the drive."""
        is_quick = any(isinstance(one.effect.acts, Actuating) and one.effect.acts.quick for one in self.acting)
        return MOST_PARTS if is_quick else 1

    def drive(self, vehicle: Vehicle, trial: Trial) -> Drive:
        """After every effect between command and torque, from each instant of ``trial`` to the next."""
        if self.is_plain:
            return Drive.held(vehicle.torque(trial))
        return self.driven(Commanded.of(vehicle, [trial], self.parts))

    def driven(self, given: Commanded) -> Drive:
        """As ``drive``, of what was commanded in several trials."""
        where, thrust = given.where, self.thrust(given)
        torque, scatter = where.summed(thrust, where.arms), None
        for act, values in that_act(self.acting, OnTorque):
            if act.scatter is not None:
                more = act.scatter(where, torque, values)
                scatter = more if scatter is None else scatter + more
            torque = act.change(where, torque, values)
        beside = self._beside(where, thrust)
        if given.intervals is None:
            return Drive.held(torque, beside, scatter, where.begins)
        return Drive.over(given.intervals, torque, beside, scatter)

    def thrust(self, given: Commanded, *, bent: bool = True) -> FloatArray:
        """(m, k) thrust in N at the instants of ``given.where``, after every effect up to it.

        ``bent`` includes effects that are anchored.
        """
        where = given.where
        if any(isinstance(one.effect.acts, OnCommand) for one in self.acting):
            commands = given.commands
            for act, values in self._that_bend(OnCommand, bent=bent):
                commands = act.change(where, commands, values)
            # No effect asks for more than the bench curve has.
            thrust = given.vehicle.thrust(np.clip(commands, *where.ends.T))
        else:
            thrust = given.thrust
        for act, values in self._that_bend(OnThrust, bent=bent):
            thrust = act.change(where, thrust, values)
        return thrust

    def _that_bend(
        self, where: type[OnCommand | OnThrust], *, bent: bool
    ) -> Iterator[tuple[OnCommand | OnThrust, Values]]:
        for act, values in that_act(self.acting, where):
            if bent or not act.anchored:
                yield act, values

    def _beside(self, where: Actuation, thrust: FloatArray) -> FloatArray | None:
        """(m, 3) what effects are told of each instant of ``where``, see `Drive`; None where they ask for nothing.

        ``thrust`` is (m, k) in N.
        """
        told = {}
        if any(one.effect.races for one in self.acting):
            told[0] = where.race(thrust)
        for column, name in enumerate(SPEEDS, start=1):
            if any(name in one.effect.needs for one in self.acting):
                told[column] = where.speed(name)
        for term, values in that_act(self.acting, Term):
            if term.surge is not None:
                told[1] = term.surge(where, thrust, values)
        if not told:
            return None
        beside = np.zeros((len(thrust), 1 + len(SPEEDS)))
        for column, series in told.items():
            beside[:, column] = series
        return beside

    def scale_doubt(self, vehicle: Vehicle, trials: Iterable[Trial]) -> float:
        """How open the scale of all thrust is, as a share: at which thrust it is as it was taken is not known.

        Effects that bend the thrust leave it as it was at one that was chosen. Any other that the ``trials`` use, each
        by how much torque it gave for how long, would do as well, and all thrust would be larger or smaller by what
        they make of that one: the root of the mean square of its logarithm.
        """
        acts = [one.effect.acts for one in self.acting]
        if not any(isinstance(act, OnCommand | OnThrust) and act.anchored for act in acts):
            return 0.0
        total = weights = 0.0
        for trial in trials:
            given = Commanded.of(vehicle, [trial])
            bent, straight = (self.thrust(given, bent=way)[:-1] for way in (True, False))
            weight = np.abs(straight * given.where.arms) * np.diff(trial.time)[:, None]
            used = (bent != 0.0) & (weight > 0.0)
            total += float(weight[used] @ np.log(np.abs(bent[used] / straight[used])) ** 2)
            weights += float(weight[used].sum())
        return math.sqrt(total / weights) if weights > 0.0 else 0.0
