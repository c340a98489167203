"""From commands to what drives the vehicle, through every effect on the way."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from rovid.campaign.trial import Trial
from rovid.campaign.vehicle import Vehicle
from rovid.effects.actuation import SPEEDS, Actuation, actuation, finer, race
from rovid.effects.base import Actuating, OnCommand, OnThrust, OnTorque, Term, Values
from rovid.ground.arrays import FloatArray, IntArray
from rovid.model.acting import Acting, that_act
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
        return self.driven(vehicle, actuation(vehicle, trial, self.parts), trial.commands)

    def driven(self, vehicle: Vehicle, where: Actuation, commands: FloatArray, at: IntArray | None = None) -> Drive:
        """As ``drive``, of (n, k) ``commands`` held between instants, each interval cut into parts as in ``where``.

        ``at``: from each of these of the n instants to the next of them; from each to the next if not given.
        """
        thrust = self.thrust(vehicle, where, commands)
        torque = np.asarray(thrust @ where.arms)
        scatter = np.zeros(len(torque))
        for act, values in that_act(self.acting, OnTorque):
            if act.scatter is not None:
                scatter += act.scatter(where, torque, values)
            torque = act.change(where, torque, values)
        drive = Drive.held(torque, self._beside(where, thrust), scatter)
        if at is None and where.parts == 1:
            return drive
        every = np.arange((len(where.time) - 1) // where.parts + 1)
        return drive.between(where.time, where.parts * (every if at is None else at))

    def thrust(self, vehicle: Vehicle, where: Actuation, commands: FloatArray, *, bent: bool = True) -> FloatArray:
        """(m, k) thrust in N of (n, k) ``commands`` as in ``driven``, after every effect up to it.

        ``bent`` includes effects that are anchored.
        """
        if any(isinstance(one.effect.acts, OnCommand) for one in self.acting):
            commands = finer(commands, where.parts)
            for act, values in self._that_bend(OnCommand, bent=bent):
                commands = act.change(where, commands, values)
            # No effect asks for more than the bench curve has.
            thrust = vehicle.thrust(np.clip(commands, *where.ends.T))
        else:
            thrust = finer(vehicle.thrust(commands), where.parts)
        for act, values in self._that_bend(OnThrust, bent=bent):
            thrust = act.change(where, thrust, values)
        return thrust

    def _that_bend(
        self, where: type[OnCommand | OnThrust], *, bent: bool
    ) -> Iterator[tuple[OnCommand | OnThrust, Values]]:
        for act, values in that_act(self.acting, where):
            if bent or not act.anchored:
                yield act, values

    def _beside(self, where: Actuation, thrust: FloatArray) -> FloatArray:
        """(m, 3) what effects are told of each instant of ``where``, see `Drive`; ``thrust`` is (m, k) in N."""
        beside = np.zeros((len(thrust), 1 + len(SPEEDS)))
        if any(one.effect.races for one in self.acting):
            beside[:, 0] = race(thrust, where.arms)
        for column, name in enumerate(SPEEDS, start=1):
            if any(name in one.effect.needs for one in self.acting):
                beside[:, column] = where.speed(name)
        for term, values in that_act(self.acting, Term):
            if term.surge is not None:
                beside[:, 1] = term.surge(where, thrust, values)
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
            where = actuation(vehicle, trial)
            bent, straight = (self.thrust(vehicle, where, trial.commands, bent=way)[:-1] for way in (True, False))
            weight = np.abs(straight * where.arms) * np.diff(trial.time)[:, None]
            used = (bent != 0.0) & (weight > 0.0)
            total += float(weight[used] @ np.log(np.abs(bent[used] / straight[used])) ** 2)
            weights += float(weight[used].sum())
        return math.sqrt(total / weights) if weights > 0.0 else 0.0
