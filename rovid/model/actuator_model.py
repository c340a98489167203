"""The way from commands to torque: bench curves, and the effects that act on commands, thrust and torque.

Command series are cached for all models that are compared.
"""

import math
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Self
from weakref import WeakValueDictionary, ref

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray, IntArray
from rovid.core.threads import SizedCache, Value
from rovid.effects.actuator_inputs import SPEEDS, ActuatorInputs, actuator_inputs
from rovid.effects.base import Actuating, OnCommand, OnThrust, OnTorque, Term, Values
from rovid.model.bound_effects import BoundEffect, actions_at, effects_at
from rovid.model.torque_input import MAX_SUBDIVISION, Intervals, TorqueInput
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
    held_gains: FloatArray | None = None  #: (n, k) `Trial.angle_gains` at these instants.

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

        ``subdivision``: Number of parts of each interval.
        ``at``: Selected log instants of each trial, between which no command changes; all if None.
        ``subdivided``: Which of the intervals after the selected instants are subdivided; all if None.
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
            commands, gains = list[FloatArray](), list[FloatArray]()
            for (trial, here, _), one in zip(every, inputs.trials, strict=True):
                commands += [] if trial.past is None else [trial.past.commands]
                commands.append(trial.commands if here is None else trial.commands[here])
                if trial.angle_gains is not None:
                    gains += [np.repeat(trial.angle_gains[:1], one.past, axis=0)]
                    gains.append(trial.angle_gains if here is None else trial.angle_gains[here])
            # Effects act on whole columns.
            held = np.asfortranarray(np.concatenate(commands))
            found = cls(vehicle, inputs, held, np.concatenate(gains) if gains else None)
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

    def changed(self, values: FloatArray, act: OnCommand, parameters: Values) -> FloatArray:
        """(m, k) commands ``values`` after an effect, which acts on the angles of rudders and not on their torques.

        An effect acts on all rudders or on all other drives, if there are both.
        """
        if self.held_gains is None:
            return act.change(self.inputs, values, parameters)
        gains = self.inputs.subdivide(self.held_gains)
        rudders = np.array([one.is_rudder for one in self.vehicle.thrusters])
        acting = rudders if act.of_angles or rudders.all() else ~rudders
        return np.where(acting, gains * act.change(self.inputs, values / gains, parameters), values)

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
        times, begins = [self.inputs.time[one.rows] for one in self.inputs.trials], []
        for counts, one, here in zip(self.inputs.subdivisions, self.inputs.trials, at, strict=True):
            begins.append((np.cumsum(counts) - counts)[one.past + here])
        return Intervals.from_times(times, begins)


# Command series in use, by the arguments that they were made from.
_IN_USE: WeakValueDictionary[tuple[object, ...], CommandSeries] = WeakValueDictionary()


@dataclass(frozen=True, eq=False)
class ActuatorModel:
    """The actuators of a vehicle with the effects of a model."""

    effects: tuple[BoundEffect, ...]

    @property
    def is_plain(self) -> bool:
        """Whether the torque by the bench curves is all that the model needs of the commands."""
        effects = [one.effect for one in self.effects]
        needs_inputs = any(effect.uses_wash or set(effect.needs) & set(SPEEDS) for effect in effects)
        return not needs_inputs and not any(effect.changes_torque_input for effect in effects)

    @property
    def subdivision(self) -> int:
        """Number of parts into which each interval between two instants has to be divided."""
        return MAX_SUBDIVISION if self._within_interval else 1

    @property
    def has_exact_means(self) -> bool:
        """Whether the mean torque over any interval of held commands is exact without subdivision."""
        quick = self._within_interval
        return not quick or (len(quick) == 1 and isinstance(quick[0][1], OnTorque))

    def settling_time(self, change: float) -> float:
        """Time in s after a command change of at most ``change``, until the torque within an interval is constant."""
        quick = self._within_interval
        return sum(act.settling_time(one.values, change) for one, act in quick if act.settling_time)

    @property
    def _within_interval(self) -> list[tuple[BoundEffect, Actuating]]:
        """Effects that change the torque within the interval between two instants, with their actions."""
        acts = [(one, one.effect.acts) for one in self.effects]
        return [(one, act) for one, act in acts if isinstance(act, Actuating) and act.settling_time]

    def torque_input(self, vehicle: Vehicle, trial: Trial) -> TorqueInput:
        """Torque input from each instant of ``trial`` to the next."""
        if self.is_plain:
            return TorqueInput.held(vehicle.torque(trial))
        return self.torque_inputs(CommandSeries.from_trials(vehicle, [trial], self.subdivision))

    def torque_inputs(self, commands: CommandSeries, intervals: Intervals | None = None) -> TorqueInput:
        """Torque input of several trials over ``intervals``, between the log's instants by default."""
        intervals = commands.intervals if intervals is None else intervals
        key = ("torque input", None if intervals is None else ref(intervals), *self._dependencies())
        return commands.cached(key, lambda: self._torque_inputs(commands, intervals))

    def _torque_inputs(self, commands: CommandSeries, intervals: Intervals | None) -> TorqueInput:
        inputs = commands.inputs
        thrust, key = self._thrust(commands, self.effects)
        key = (*key, None)
        torque, variance = commands.cached(key, lambda: inputs.weighted_sum(thrust, inputs.arms)), None
        for one, act in effects_at(self.effects, OnTorque):
            if act.impulse_variance is not None:
                more = act.impulse_variance(inputs, torque, one.values)
                variance = more if variance is None else variance + more
            key = (*key, one.effect, *one.parameters)
            torque = commands.cached(key, partial(act.change, inputs, torque, one.values))
        effect_inputs = self._effect_inputs(inputs, thrust)
        if intervals is None:
            further = inputs.without_past(effect_inputs), inputs.without_past(variance)
            return TorqueInput.held(inputs.without_past(torque), *further, inputs.logged_offsets)
        return TorqueInput.averaged_over(intervals, torque, effect_inputs, variance)

    def mean_forces(self, commands: CommandSeries, weights: Sequence[FloatArray]) -> list[FloatArray]:
        """Weighted sums of the thrusts, after all effects, as means over the intervals between the log's instants.

        (n,) N for each of ``weights``, which are (k,), or (m, k) at the instants of ``commands.inputs``.
        """
        inputs, found = commands.inputs, []
        thrust, _ = self._thrust(commands, self.effects)
        for each in weights:
            force = inputs.weighted_sum(thrust, each)
            for one, act in effects_at(self.effects, OnTorque):
                force = act.change(inputs, force, one.values)
            if commands.intervals is None:
                found.append(inputs.without_past(force))
            else:
                found.append(TorqueInput.averaged_over(commands.intervals, force).torque)
        return found

    def _dependencies(self) -> Iterator[Hashable]:
        """Effects on which the torque input depends, with their parameters if it depends on these too."""
        for one in self.effects:
            if one.effect.changes_torque_input or one.effect.uses_wash or set(one.effect.needs) & set(SPEEDS):
                yield one.effect
            if one.effect.changes_torque_input:
                yield from one.parameters.tolist()

    def thrust(self, commands: CommandSeries, *, with_anchored: bool = True) -> FloatArray:
        """(m, k) thrust in N at the instants of the logs; without anchored effects if asked for."""
        effects = [one for one in self.effects if with_anchored or not getattr(one.effect.acts, "anchored", False)]
        return commands.inputs.without_past(self._thrust(commands, effects)[0])

    def _thrust(
        self, commands: CommandSeries, effects: Sequence[BoundEffect]
    ) -> tuple[FloatArray, tuple[Hashable, ...]]:
        """(m, k) thrust in N after ``effects``, and its cache key."""
        inputs, values, thrust, key = commands.inputs, commands.commands, commands.thrust, tuple[Hashable, ...]()
        for one, act in effects_at(effects, OnCommand):
            key = (*key, one.effect, *one.parameters)
            values = commands.cached(key, partial(commands.changed, values, act, one.values))
        if key:
            key = (*key, "thrust")
            # A bench curve limits the thrust itself. Logged torques have no curve.
            if any(thruster.curve is None for thruster in commands.vehicle.thrusters):
                values = np.clip(values, *inputs.command_range.T)
            thrust = commands.cached(key, lambda: commands.vehicle.thrust(values))
        for one, on_thrust in effects_at(effects, OnThrust):
            key = (*key, one.effect, *one.parameters)
            thrust = commands.cached(key, partial(on_thrust.change, inputs, thrust, one.values))
        return thrust, key

    def _effect_inputs(self, inputs: ActuatorInputs, thrust: FloatArray) -> FloatArray | None:
        """(m, 3) effect inputs as in `TorqueInput` for (m, k) ``thrust`` in N; None if no effect needs them."""
        columns = {}
        if any(one.effect.uses_wash for one in self.effects):
            columns[0] = inputs.wash(thrust)
        for column, name in enumerate(SPEEDS, start=1):
            if any(name in one.effect.needs for one in self.effects):
                columns[column] = inputs.speed(name)
        for term, values in actions_at(self.effects, Term):
            if term.surge_from_thrust is not None:
                columns[1] = term.surge_from_thrust(inputs, thrust, values)
        if not columns:
            return None
        effect_inputs = np.zeros((len(thrust), 1 + len(SPEEDS)))
        for column, series in columns.items():
            effect_inputs[:, column] = series
        return effect_inputs

    def thrust_scale_uncertainty(self, vehicle: Vehicle, trials: Iterable[Trial]) -> float:
        """Uncertainty of the scale of all thrust, as a share, that comes from the anchors of effects.

        An anchored effect leaves thrust unchanged at one reference thrust, which is a convention. With another
        reference among the thrusts that the ``trials`` use, all thrust would have another scale. The result is the root
        mean square of the logarithm of that scale, weighted by torque and time.
        """
        acts = [one.effect.acts for one in self.effects]
        if not any(isinstance(act, OnCommand | OnThrust) and act.anchored for act in acts):
            return 0.0
        total = weights = 0.0
        for trial in trials:
            commands = CommandSeries.from_trials(vehicle, [trial])
            changed, unchanged = (self.thrust(commands, with_anchored=way)[:-1] for way in (True, False))
            weight = np.abs(unchanged * commands.inputs.arms) * np.diff(trial.time)[:, None]
            used = (changed != 0.0) & (weight > 0.0)
            total += float(weight[used] @ np.log(np.abs(changed[used] / unchanged[used])) ** 2)
            weights += float(weight[used].sum())
        return math.sqrt(total / weights) if weights > 0.0 else 0.0
