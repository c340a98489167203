"""From commands to what drives the vehicle, through every effect on the way."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from weakref import ref

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_inputs import SPEEDS, Actuation
from rovid.effects.base import Actuating, OnCommand, OnThrust, OnTorque, Term
from rovid.model.bound_effects import Acting, each_that, that_act
from rovid.model.command_series import Commanded
from rovid.model.torque_input import MOST_PARTS, Drive, Intervals
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle


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
    def parts(self) -> int:
        """How many parts each interval between two instants has to be cut into for the drive."""
        return MOST_PARTS if self._quick else 1

    @property
    def means_exactly(self) -> bool:
        """Whether the mean torque until the next instant is exact, however far that is, while commands are held."""
        return not self._quick or (len(self._quick) == 1 and isinstance(self._quick[0], OnTorque))

    def settles(self, change: float) -> float:
        """When nothing changes within an interval any more, in s after a ``change`` of commands at most."""
        every = ((one, one.effect.acts) for one in self.acting)
        return sum(act.settles(one.values, change) for one, act in every if isinstance(act, Actuating) and act.settles)

    @property
    def _quick(self) -> list[Actuating]:
        """What acts within the interval between two instants."""
        acts = [one.effect.acts for one in self.acting]
        return [act for act in acts if isinstance(act, Actuating) and act.settles]

    def drive(self, vehicle: Vehicle, trial: Trial) -> Drive:
        """After every effect between command and torque, from each instant of ``trial`` to the next."""
        if self.is_plain:
            return Drive.held(vehicle.torque(trial))
        return self.driven(Commanded.of(vehicle, [trial], self.parts))

    def driven(self, given: Commanded, over: Intervals | None = None) -> Drive:
        """As ``drive``, of several trials; between the log's instants where not ``over`` others."""
        over = given.intervals if over is None else over
        return given.made(
            ("drive", None if over is None else ref(over), *self._told()), lambda: self._driven(given, over)
        )

    def _driven(self, given: Commanded, over: Intervals | None) -> Drive:
        where = given.where
        thrust, made_of = self._thrust(given, self.acting)
        made_of = (*made_of, None)
        torque, scatter = given.made(made_of, lambda: where.summed(thrust, where.arms)), None
        for one, act in each_that(self.acting, OnTorque):
            if act.scatter is not None:
                more = act.scatter(where, torque, one.values)
                scatter = more if scatter is None else scatter + more
            made_of = (*made_of, one.effect, *one.numbers)
            torque = given.made(made_of, partial(act.change, where, torque, one.values))
        beside = self._beside(where, thrust)
        if over is None:
            return Drive.held(torque, beside, scatter, where.begins)
        return Drive.over(over, torque, beside, scatter)

    def _told(self) -> Iterator[Hashable]:
        """All that a drive is made of: effects, with their parameters where these change it."""
        for one in self.acting:
            if one.effect.actuates or one.effect.races or set(one.effect.needs) & set(SPEEDS):
                yield one.effect
            if one.effect.actuates:
                yield from one.numbers.tolist()

    def thrust(self, given: Commanded, *, bent: bool = True) -> FloatArray:
        """(m, k) thrust in N at the instants of ``given.where``, after every effect up to it.

        ``bent`` includes effects that are anchored.
        """
        acting = (
            self.acting if bent else [one for one in self.acting if not getattr(one.effect.acts, "anchored", False)]
        )
        return self._thrust(given, acting)[0]

    def _thrust(self, given: Commanded, acting: Sequence[Acting]) -> tuple[FloatArray, tuple[Hashable, ...]]:
        """As ``thrust``, after such effects; and what it is made of."""
        where, commands, thrust, made_of = given.where, given.commands, given.thrust, tuple[Hashable, ...]()
        for one, act in each_that(acting, OnCommand):
            made_of = (*made_of, one.effect, *one.numbers)
            commands = given.made(made_of, partial(act.change, where, commands, one.values))
        if made_of:
            made_of = (*made_of, "thrust")
            # No effect asks for more than there is, which a bench curve sees to itself.
            if any(thruster.curve is None for thruster in given.vehicle.thrusters):
                commands = np.clip(commands, *where.ends.T)
            thrust = given.made(made_of, lambda: given.vehicle.thrust(commands))
        for one, bend in each_that(acting, OnThrust):
            made_of = (*made_of, one.effect, *one.numbers)
            thrust = given.made(made_of, partial(bend.change, where, thrust, one.values))
        return thrust, made_of

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
