"""The model: inertia, drag, what weight and buoyancy do, effects; and its free-running simulation."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rovid.campaign.axis import YAW, Axis
from rovid.campaign.trial import Trial
from rovid.campaign.vehicle import Vehicle
from rovid.effects import MOTION, Actuation, Effect, restoring_of
from rovid.effects.base import BASE_SIZE, SPEEDS, TERM_PARAMETERS, TERM_STATES, actuation, bridged, finer, race
from rovid.ground.arrays import FloatArray, IntArray
from rovid.model.drive import MOST_PARTS, Drive
from rovid.model.names import base_names
from rovid.motion.rates import body_position, on_grid, uniform_grid

_START_SECONDS = 2.0
_START_SAMPLES = 5
_START_SWING = 0.5  # rad of the phase of a swing about its level
_FIXED_POINT_TURNS = 6
_NUDGE = 1e-4  # rad


@dataclass(frozen=True, kw_only=True)
class Model:
    """``inertia*rdot + quadratic_drag*|r|*r + linear_drag*r + g(q) = torque``, qdot = r.

    In yaw q is the heading psi. ``g`` is what weight and buoyancy do along ``axis``, see `rovid.effects.restoring`;
    ``restoring_values`` are its parameters.
    """

    inertia: float
    quadratic_drag: float
    linear_drag: float
    effects: tuple[Effect, ...] = ()
    effect_values: tuple[float, ...] = ()
    axis: Axis = YAW
    restoring_values: tuple[float, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Of all parameters, in the order of ``values``."""
        return (*base_names(self.axis), *(f"{e.key}.{p.name}" for e in self.effects for p in e.parameters))

    @property
    def values(self) -> FloatArray:
        """(p,) all parameters."""
        base = (self.inertia, self.quadratic_drag, self.linear_drag)
        return np.array([*base, *self.restoring_values, *self.effect_values])

    @property
    def slow_inertia(self) -> float:
        """The inertia in slow motion, with the water that goes along; kg m^2."""
        return self.inertia + sum(e.added_inertia(e.values(numbers)) for e, numbers in self._each if e.added_inertia)

    @property
    def stiffness(self) -> float:
        """How much torque in N m a tilt of one rad from rest would ask for; 0 along an axis without."""
        return self.restoring_values[0] if self.axis.rights else 0.0

    @property
    def swing(self) -> float:
        """Frequency in rad/s at which the vehicle would swing about its level without drag; 0 along an axis without."""
        return math.sqrt(max(self.stiffness, 0.0) / self.inertia)

    def initial_rate(self, trial: Trial) -> float:
        """Rate at the first sample of ``trial``, as `initial_rate` reads it."""
        return initial_rate(trial, self.swing)

    def base(self, trial: Trial) -> FloatArray:
        """Inertia, drags, first position, fastest state, stiffness, trim, and room, as the kernels take them."""
        return self.base_from(float(trial.position[int(np.argmax(trial.measured))]))

    def base_from(self, position: float) -> FloatArray:
        """As ``base``, with the first ``position``."""
        fastest = max((e.fastest(e.values(numbers)) for e, numbers in self._each if e.fastest), default=0.0)
        fastest = max(fastest, self.swing)
        trim = self.restoring_values[1] if self.axis.rights else 0.0
        known = self.inertia, self.quadratic_drag, self.linear_drag, position, fastest, self.stiffness, trim
        return np.concatenate((known, np.zeros(BASE_SIZE - len(known))))

    def terms(self) -> tuple[FloatArray, NDArray[np.int64]]:
        """(m, 4) parameters of each term of the equation of motion; (m,) its index in ``MOTION``."""
        acting = [(effect, numbers) for effect, numbers in self._each if effect.term is not None]
        # What drag there is in moving water can only be said once it is known how that moves; and whoever steps states
        # need look no further than to the last that has any.
        acting.sort(key=lambda pair: (not pair[0].moves_water, not pair[0].remembers))
        values = np.zeros((len(acting), TERM_PARAMETERS))
        for row, (_, numbers) in zip(values, acting, strict=True):
            row[: len(numbers)] = numbers
        return values, np.array([MOTION.index(effect) for effect, _ in acting], dtype=np.int64)

    def wave(self) -> FloatArray:
        """(3,) amplitude in N m, frequency in rad/s and damping of the wave torque; empty where there is none."""
        return next((numbers for effect, numbers in self._each if effect.wave), np.zeros(0))

    def true_angle(self, trial: Trial, angle: FloatArray, at: IntArray) -> tuple[FloatArray, FloatArray]:
        """What the (n,) ``angle`` in rad, measured at the instants ``at``, is without the deviation of the heading.

        Returns
        -------
        angle, gain
            (n,) rad and d(measured)/d(true).
        """
        gain = np.ones(len(angle))
        for effect, numbers in self._each:
            if effect.on_heading is None:
                continue
            values, measured = effect.values(numbers), trial.position[at]
            true = measured
            # Contracts by the deviation's slope, some percent, at each turn.
            for _ in range(_FIXED_POINT_TURNS):
                true = measured - effect.on_heading(true, values)
            angle = angle - (measured - true)
            ahead, behind = (effect.on_heading(true + side, values) for side in (_NUDGE, -_NUDGE))
            gain = gain + (ahead - behind) / (2.0 * _NUDGE)
        return angle, gain

    @property
    def deviates(self) -> bool:
        """Whether the measured heading is not the true one."""
        return any(effect.on_heading is not None for effect in self.effects)

    def deviation(self, heading: FloatArray) -> FloatArray:
        """(n,) rad by which the instrument's heading is off at the (n,) true headings in rad."""
        off = np.zeros(len(heading))
        for effect, numbers in self._each:
            if effect.on_heading is not None:
                off += effect.on_heading(heading, effect.values(numbers))
        return off

    def _as_measured(self, heading: FloatArray, rate: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Heading and rate as an instrument with these deviations would give them."""
        gain = np.ones(len(heading))
        for effect, numbers in self._each:
            if effect.on_heading is not None:
                values = effect.values(numbers)
                ahead, behind = (effect.on_heading(heading + side, values) for side in (_NUDGE, -_NUDGE))
                gain += (ahead - behind) / (2.0 * _NUDGE)
        return heading + self.deviation(heading), rate * gain

    @cached_property
    def _each(self) -> list[tuple[Effect, FloatArray]]:
        restoring = restoring_of(self.axis)
        effects = self.effects if restoring is None else (restoring, *self.effects)
        widths = np.cumsum([0, *(len(effect.parameters) for effect in effects)])
        numbers = np.array([*self.restoring_values, *self.effect_values])
        return [(effect, numbers[a:b]) for effect, a, b in zip(effects, widths[:-1], widths[1:], strict=True)]

    @property
    def acts_on_drive(self) -> bool:
        """Whether any effect needs more of the commands than the torque that the bench curve makes of them."""
        return any(effect.actuates or effect.races or set(effect.needs) & set(SPEEDS) for effect in self.effects)

    @property
    def drive_values(self) -> tuple[float, ...]:
        """Parameters on which the drive depends."""
        return tuple(float(value) for effect, numbers in self._each if effect.actuates for value in numbers)

    def drive(self, vehicle: Vehicle, trial: Trial) -> Drive:
        """After every effect between command and torque, from each instant of ``trial`` to the next."""
        if not self.acts_on_drive:
            return Drive.held(vehicle.torque(trial))
        return self.driven(vehicle, actuation(vehicle, trial, self.parts), trial.commands)

    @property
    def parts(self) -> int:
        """How many parts each interval between two instants has to be cut into for the drive."""
        return MOST_PARTS if any(effect.quick for effect in self.effects) else 1

    def driven(self, vehicle: Vehicle, where: Actuation, commands: FloatArray, at: IntArray | None = None) -> Drive:
        """As ``drive``, of (n, k) ``commands`` held between instants, each interval cut into parts as in ``where``.

        ``at``: from each of these of the n instants to the next of them; from each to the next if not given.
        """
        thrust = self.thrust(vehicle, where, commands)
        torque = np.asarray(thrust @ where.arms)
        scatter = np.zeros(len(torque))
        for effect, numbers in self._each:
            if effect.scatter is not None:
                scatter += effect.scatter(where, torque, effect.values(numbers))
            if effect.on_torque is not None:
                torque = effect.on_torque(where, torque, effect.values(numbers))
        drive = Drive.held(torque, self._beside(where, thrust), scatter)
        if at is None and where.parts == 1:
            return drive
        every = np.arange((len(where.time) - 1) // where.parts + 1)
        return drive.between(where.time, where.parts * (every if at is None else at))

    def _beside(self, where: Actuation, thrust: FloatArray) -> FloatArray:
        """(m, 3) what effects are told of each instant of ``where``, see `Drive`; ``thrust`` is (m, k) in N."""
        beside = np.zeros((len(thrust), 1 + len(SPEEDS)))
        if any(effect.races for effect in self.effects):
            beside[:, 0] = race(thrust, where.arms)
        for column, name in enumerate(SPEEDS, start=1):
            if any(name in effect.needs for effect in self.effects):
                beside[:, column] = where.speed(name)
        for effect, numbers in self._each:
            if effect.on_speed is not None:
                beside[:, 1] = effect.on_speed(where, thrust, effect.values(numbers))
        return beside

    def thrust(self, vehicle: Vehicle, where: Actuation, commands: FloatArray, *, bent: bool = True) -> FloatArray:
        """(m, k) thrust in N of (n, k) ``commands`` as in ``driven``, after every effect up to it.

        ``bent`` includes effects that are anchored.
        """
        if any(effect.on_command is not None for effect in self.effects):
            commands = finer(commands, where.parts)
            for effect, numbers in self._each:
                if effect.on_command is not None and (bent or not effect.anchored):
                    commands = effect.on_command(where, commands, effect.values(numbers))
            # No effect asks for more than the bench curve has.
            commands = np.clip(commands, *where.ends.T)
            thrust = vehicle.thrust(commands)
        else:
            thrust = finer(vehicle.thrust(commands), where.parts)
        for effect, numbers in self._each:
            if effect.on_thrust is not None and (bent or not effect.anchored):
                thrust = effect.on_thrust(where, thrust, effect.values(numbers))
        return thrust

    def scale_doubt(self, vehicle: Vehicle, trials: Iterable[Trial]) -> float:
        """How open the scale of all thrust is, as a share: at which thrust it is as it was taken is not known.

        Effects that bend the thrust leave it as it was at one that was chosen. Any other that the ``trials`` use, each
        by how much torque it gave for how long, would do as well, and all thrust would be larger or smaller by what
        they make of that one: the root of the mean square of its logarithm.
        """
        if not any(effect.anchored for effect in self.effects):
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

    def restlessness(self, rate: float, memory: float) -> float:
        """Standard deviation of the rate for each N m of a disturbance torque with a ``memory`` in s.

        Of the motion linearised at ``rate``: variance T^2 memory / (c (I + c memory + K memory^2)), c the slope of the
        drag and K the stiffness.
        """
        slope = max(2.0 * self.quadratic_drag * rate + self.linear_drag, 1e-12)
        return math.sqrt(memory / (slope * (self.inertia + slope * memory + self.stiffness * memory**2)))

    def drag(self, rate: FloatArray) -> FloatArray:
        """Drag torque in N m at ``rate`` in rad/s."""
        return self.quadratic_drag * np.abs(rate) * rate + self.linear_drag * rate

    @property
    def remembers(self) -> bool:
        """Whether any term has states of its own."""
        return any(effect.term is not None and effect.remembers for effect in self.effects)

    def along(
        self, trial: Trial, period: float, course: Sequence[FloatArray], beside: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """(n,) torque in N m of all terms and their (n, m, TERM_STATES) states, on a measured ``course``.

        That is (n,) rate, angle since the start of the trial and thrusters' torque, a ``period`` in s apart; ``beside``
        is theirs as in `Drive`. What is not known of them is bridged by straight lines.
        """
        from rovid.model.kernels import effects_along

        known, told = (np.column_stack([bridged(values) for values in series]) for series in (course, beside.T))
        torque, states = effects_along(period, known, told, self.base(trial), *self.terms())
        return torque, states

    def turned(
        self, trial: Trial, time: FloatArray, drive: Drive, start: tuple[float, float], states: FloatArray
    ) -> float:
        """Angle in rad turned over the (n,) instants ``time``.

        ``start`` is the rate in rad/s and the angle since the start of the trial in rad at the first of them;
        ``states`` of the terms there are as `along` gives them.
        """
        return float(self._integrate(trial, time, drive, start, states)[1][-1] - start[1])

    def _integrate(
        self,
        trial: Trial,
        time: FloatArray,
        drive: Drive,
        start: tuple[float, float],
        states: FloatArray | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        from rovid.model.kernels import simulate, simulate_effects

        if any(effect.term is not None for effect, _ in self._each) or drive.moment.any():
            series, (terms, kinds) = (drive.torque, drive.moment, drive.beside), self.terms()
            states = np.zeros((len(terms), TERM_STATES)) if states is None else states
            rate, angle = simulate_effects(time, *series, self.base(trial), terms, kinds, start, states)
            return rate, angle
        rate, angle = simulate(time, drive.torque, self.inertia, self.quadratic_drag, self.linear_drag, start[0])
        return rate, angle + start[1]

    def simulate(self, trial: Trial, drive: Drive) -> tuple[FloatArray, FloatArray]:
        """Simulate freely from the first sample, under ``drive`` at the instants of ``trial``.

        Returns
        -------
        rate, position
            (n,) body rate and position at the instants of ``trial``, as they would be measured. The position starts at
            the first one measured. In yaw, where roll and pitch are logged, the body rate turns into the heading's by
            psidot = (r + thetadot sin(phi)) / (cos(phi) cos(theta)) (Fossen 2011, eq. 2.28).
        """
        rate, angle = self._integrate(trial, trial.time, drive, (self.initial_rate(trial), 0.0))
        if self.axis is YAW and trial.roll is not None and trial.pitch is not None:
            angle = _euler_heading(trial, rate)
        first = int(np.argmax(trial.measured))
        if not self.deviates:
            return rate, trial.position[first] + angle - angle[first]
        true, _ = self.true_angle(trial, trial.position, np.arange(len(trial.time)))
        heading, rate = self._as_measured(true[first] + angle - angle[first], rate)
        return rate, heading


def initial_rate(trial: Trial, swing: float = 0.0) -> float:
    """Rate at the first sample: the gyro's, or the slope of the first positions.

    The slope is taken over two seconds at most, and only until the first command changes: a fast vehicle is elsewhere
    soon after. One that swings at ``swing`` rad/s is so after a fraction of a radian.
    """
    changed = np.flatnonzero(np.any(trial.commands != trial.commands[0], axis=1))
    steady = trial.time[changed[0]] - trial.time[0] if changed.size else _START_SECONDS
    most = _START_SWING / swing if swing > 0.0 else _START_SECONDS
    known = np.flatnonzero(trial.measured)
    early = known[trial.time[known] <= trial.time[0] + min(steady, most, _START_SECONDS)]
    early = early if len(early) >= _START_SAMPLES else known[:_START_SAMPLES]
    time = trial.time[early] - trial.time[0]
    if trial.rate is not None and (read := np.isfinite(trial.rate[early])).any():
        if swing > 0.0 and read.sum() > 1:
            return float(np.polynomial.polynomial.polyfit(time[read], trial.rate[early][read], 1)[0])
        return float(np.mean(trial.rate[early][read][:_START_SAMPLES]))
    angle = body_position(trial)[early]
    if len(time) < _START_SAMPLES:
        return 0.0
    bent = len(time) > _START_SAMPLES or swing > 0.0
    return float(np.polynomial.polynomial.polyfit(time, angle - angle[0], 2 if bent else 1)[1])


def _euler_heading(trial: Trial, rate: FloatArray) -> FloatArray:
    assert trial.roll is not None and trial.pitch is not None  # noqa: S101, PT018 - narrowed by the caller
    grid = uniform_grid(trial)
    roll, pitch = (_tilt(trial, values, grid) for values in (trial.roll, trial.pitch))
    pitch_rate = np.gradient(pitch, trial.time)
    slope = (rate + pitch_rate * np.sin(roll)) / (np.cos(roll) * np.cos(pitch))
    steps = 0.5 * (slope[1:] + slope[:-1]) * np.diff(trial.time)
    return np.concatenate(([0.0], np.cumsum(steps)))


def _tilt(trial: Trial, values: FloatArray, grid: FloatArray) -> FloatArray:
    known = on_grid(trial, values, grid)
    finite = np.isfinite(known)
    return np.interp(trial.time, grid[finite], known[finite]) if finite.any() else np.zeros(len(trial.time))
