"""From commands to what drives the vehicle, through every effect on the way."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from weakref import ref

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_inputs import SPEEDS, ActuatorInputs
from rovid.effects.base import Actuating, OnCommand, OnThrust, OnTorque, Term
from rovid.model.bound_effects import BoundEffect, actions_at, effects_at
from rovid.model.command_series import CommandSeries
from rovid.model.torque_input import MAX_SUBDIVISION, Intervals, TorqueInput
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle


@dataclass(frozen=True, eq=False)
class ActuatorModel:
    """The bench curves, and those of a model's effects that act between command and torque."""

    acting: tuple[BoundEffect, ...]

    @property
    def is_plain(self) -> bool:
        """Whether no effect needs more of the commands than the torque that the bench curve makes of them."""
        effects = [one.effect for one in self.acting]
        asked = any(effect.uses_wash or set(effect.needs) & set(SPEEDS) for effect in effects)
        return not asked and not any(effect.changes_torque_input for effect in effects)

    @property
    def subdivision(self) -> int:
        """How many parts each interval between two instants has to be cut into for the drive."""
        return MAX_SUBDIVISION if self._quick else 1

    @property
    def has_exact_means(self) -> bool:
        """Whether the mean torque until the next instant is exact, however far that is, while commands are held."""
        return not self._quick or (len(self._quick) == 1 and isinstance(self._quick[0], OnTorque))

    def settling_time(self, change: float) -> float:
        """When nothing changes within an interval any more, in s after a ``change`` of commands at most."""
        every = ((one, one.effect.acts) for one in self.acting)
        return sum(
            act.settling_time(one.values, change)
            for one, act in every
            if isinstance(act, Actuating) and act.settling_time
        )

    @property
    def _quick(self) -> list[Actuating]:
        """What acts within the interval between two instants."""
        acts = [one.effect.acts for one in self.acting]
        return [act for act in acts if isinstance(act, Actuating) and act.settling_time]

    def torque_input(self, vehicle: Vehicle, trial: Trial) -> TorqueInput:
        """After every effect between command and torque, from each instant of ``trial`` to the next."""
        if self.is_plain:
            return TorqueInput.held(vehicle.torque(trial))
        return self.torque_inputs(CommandSeries.from_trials(vehicle, [trial], self.subdivision))

    def torque_inputs(self, given: CommandSeries, over: Intervals | None = None) -> TorqueInput:
        """As ``drive``, of several trials; between the log's instants where not ``over`` others."""
        over = given.intervals if over is None else over
        return given.cached(
            ("drive", None if over is None else ref(over), *self._told()), lambda: self._driven(given, over)
        )

    def _driven(self, given: CommandSeries, over: Intervals | None) -> TorqueInput:
        where = given.inputs
        thrust, made_of = self._thrust(given, self.acting)
        made_of = (*made_of, None)
        torque, scatter = given.cached(made_of, lambda: where.weighted_sum(thrust, where.arms)), None
        for one, act in effects_at(self.acting, OnTorque):
            if act.impulse_variance is not None:
                more = act.impulse_variance(where, torque, one.values)
                scatter = more if scatter is None else scatter + more
            made_of = (*made_of, one.effect, *one.parameters)
            torque = given.cached(made_of, partial(act.change, where, torque, one.values))
        beside = self._beside(where, thrust)
        if over is None:
            return TorqueInput.held(torque, beside, scatter, where.offsets)
        return TorqueInput.averaged_over(over, torque, beside, scatter)

    def _told(self) -> Iterator[Hashable]:
        """All that a drive is made of: effects, with their parameters where these change it."""
        for one in self.acting:
            if one.effect.changes_torque_input or one.effect.uses_wash or set(one.effect.needs) & set(SPEEDS):
                yield one.effect
            if one.effect.changes_torque_input:
                yield from one.parameters.tolist()

    def thrust(self, given: CommandSeries, *, bent: bool = True) -> FloatArray:
        """(m, k) thrust in N at the instants of ``given.where``, after every effect up to it.

        ``bent`` includes effects that are anchored.
        """
        acting = (
            self.acting if bent else [one for one in self.acting if not getattr(one.effect.acts, "anchored", False)]
        )
        return self._thrust(given, acting)[0]

    def _thrust(self, given: CommandSeries, acting: Sequence[BoundEffect]) -> tuple[FloatArray, tuple[Hashable, ...]]:
        """As ``thrust``, after such effects; and what it is made of."""
        where, commands, thrust, made_of = given.inputs, given.commands, given.thrust, tuple[Hashable, ...]()
        for one, act in effects_at(acting, OnCommand):
            made_of = (*made_of, one.effect, *one.parameters)
            commands = given.cached(made_of, partial(act.change, where, commands, one.values))
        if made_of:
            made_of = (*made_of, "thrust")
            # No effect asks for more than there is, which a bench curve sees to itself.
            if any(thruster.curve is None for thruster in given.vehicle.thrusters):
                commands = np.clip(commands, *where.command_range.T)
            thrust = given.cached(made_of, lambda: given.vehicle.thrust(commands))
        for one, bend in effects_at(acting, OnThrust):
            made_of = (*made_of, one.effect, *one.parameters)
            thrust = given.cached(made_of, partial(bend.change, where, thrust, one.values))
        return thrust, made_of

    def _beside(self, where: ActuatorInputs, thrust: FloatArray) -> FloatArray | None:
        """(m, 3) what effects are told of each instant of ``where``, see `Drive`; None where they ask for nothing.

        ``thrust`` is (m, k) in N.
        """
        told = {}
        if any(one.effect.uses_wash for one in self.acting):
            told[0] = where.wash(thrust)
        for column, name in enumerate(SPEEDS, start=1):
            if any(name in one.effect.needs for one in self.acting):
                told[column] = where.speed(name)
        for term, values in actions_at(self.acting, Term):
            if term.surge_from_thrust is not None:
                told[1] = term.surge_from_thrust(where, thrust, values)
        if not told:
            return None
        beside = np.zeros((len(thrust), 1 + len(SPEEDS)))
        for column, series in told.items():
            beside[:, column] = series
        return beside

    def thrust_scale_uncertainty(self, vehicle: Vehicle, trials: Iterable[Trial]) -> float:
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
            given = CommandSeries.from_trials(vehicle, [trial])
            bent, straight = (self.thrust(given, bent=way)[:-1] for way in (True, False))
            weight = np.abs(straight * given.inputs.arms) * np.diff(trial.time)[:, None]
            used = (bent != 0.0) & (weight > 0.0)
            total += float(weight[used] @ np.log(np.abs(bent[used] / straight[used])) ** 2)
            weights += float(weight[used].sum())
        return math.sqrt(total / weights) if weights > 0.0 else 0.0
