"""The model: inertia, drag, what weight and buoyancy do, and effects."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects import Effect, restoring_effect
from rovid.effects.base import Body, Term
from rovid.model.actuator_model import ActuatorModel
from rovid.model.bound_effects import BoundEffect, actions_at
from rovid.model.heading_sensor import HeadingSensor
from rovid.model.ode import euler_heading, initial_rate, integrate, integrate_batch
from rovid.model.packed_terms import Equation, PackedTerms, pack_terms
from rovid.model.parameter_names import base_names
from rovid.model.torque_input import TorqueInput
from rovid.trial.axis import YAW, Axis
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle


@dataclass(frozen=True, kw_only=True)
class Model:
    """``inertia*rdot + quadratic_drag*|r|*r + linear_drag*r + g(q) = torque``, qdot = r.

    In yaw q is the heading psi. ``g`` is what weight and buoyancy do along ``axis``, see `rovid.effects.restoring`;
    ``restoring_values`` are its parameters. What effects make of the commands is the ``drivetrain``'s, what they make
    of the measured heading the ``instrument``'s; all others are terms of the ``equation``.
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

    @cached_property
    def bound_effects(self) -> tuple[BoundEffect, ...]:
        """What weight and buoyancy do, and the effects, each with its parameters."""
        restoring = restoring_effect(self.axis)
        effects = self.effects if restoring is None else (restoring, *self.effects)
        numbers, acting = np.array([*self.restoring_values, *self.effect_values]), []
        for effect in effects:
            count = len(effect.parameters)
            acting.append(BoundEffect(effect, numbers[:count]))
            numbers = numbers[count:]
        return tuple(acting)

    @cached_property
    def actuators(self) -> ActuatorModel:
        """From commands to what drives the vehicle."""
        return ActuatorModel(self.bound_effects)

    @cached_property
    def heading_sensor(self) -> HeadingSensor:
        """From the true position to the measured one."""
        return HeadingSensor(self.bound_effects)

    @cached_property
    def body(self) -> Body:
        """The plain model, as terms and compiled loops take it."""
        trim = self.restoring_values[1] if self.axis.self_righting else 0.0
        return Body(self.inertia, self.quadratic_drag, self.linear_drag, self.stiffness, trim)

    @cached_property
    def terms(self) -> PackedTerms:
        """Those of the equation of motion, as compiled loops take them."""
        return pack_terms(self.bound_effects, self.natural_frequency)

    def equation(self, start: float) -> Equation:
        """Of motion, from the position ``start`` on; in rad or m."""
        return Equation(self.body, self.terms, start)

    def equation_for(self, trial: Trial) -> Equation:
        """Of motion, from the first position that was measured in ``trial``."""
        return self.equation(trial.first_position)

    @property
    def wave_parameters(self) -> FloatArray:
        """(3,) amplitude in N m, frequency in rad/s and damping of the wave torque; empty where there is none."""
        return next((one.parameters for one in self.bound_effects if one.effect.is_wave), np.zeros(0))

    def torque_input(self, vehicle: Vehicle, trial: Trial) -> TorqueInput:
        """What the commands of ``trial`` make, from each of its instants to the next."""
        return self.actuators.torque_input(vehicle, trial)

    def simulate(self, trial: Trial, drive: TorqueInput) -> tuple[FloatArray, FloatArray]:
        """Simulate freely from the first sample, under ``drive`` at the instants of ``trial``.

        Returns
        -------
        rate, position
            (n,) body rate and position at the instants of ``trial``, as they would be measured. The position starts at
            the first one measured. In yaw, where roll and pitch are logged, the body rate turns into the heading's by
            psidot = (r + thetadot sin(phi)) / (cos(phi) cos(theta)) (Fossen 2011, eq. 2.28).
        """
        rate, angle = self._integrated(trial, drive)
        if self.axis is YAW and trial.roll is not None and trial.pitch is not None:
            angle = euler_heading(trial, rate)
        first = int(np.argmax(trial.measured))
        if not self.heading_sensor.deviates:
            return rate, trial.position[first] + angle - angle[first]
        true, _ = self.heading_sensor.to_true(trial.position)
        heading, rate = self.heading_sensor.to_measured(true[first] + angle - angle[first], rate)
        return rate, heading

    def simulate_rates(self, trials: Sequence[Trial], drive: TorqueInput) -> list[FloatArray]:
        """(n,) rate of each trial as `simulate` has it, under the ``drive`` of all, one after the other.

        Most often nobody has to turn it into a position.
        """
        if self.heading_sensor.deviates:
            return [self.simulate(trial, one)[0] for trial, one in zip(trials, drive.by_trial, strict=True)]
        time = np.concatenate([trial.time for trial in trials])
        first = np.array([self._first(trial) for trial in trials])
        starts = np.array([trial.first_position for trial in trials])
        rate, _ = integrate_batch(self.body, self.terms, time, drive, starts, first)
        return [rate[begin:end] for begin, end in pairwise(drive.offsets.tolist())]

    def _integrated(self, trial: Trial, drive: TorqueInput) -> tuple[FloatArray, FloatArray]:
        """(n,) rate of the body, and the angle that it turned."""
        return integrate(self.equation_for(trial), trial.time, drive, self._first(trial))

    def _first(self, trial: Trial) -> tuple[float, float]:
        """Rate of the body at the first instant, and the angle that it has turned by then."""
        return initial_rate(trial, self.natural_frequency), 0.0

    @property
    def low_frequency_inertia(self) -> float:
        """The inertia in slow motion, with the water that goes along; kg m^2."""
        terms = actions_at(self.bound_effects, Term)
        return self.inertia + sum(term.added_inertia(values) for term, values in terms if term.added_inertia)

    @property
    def stiffness(self) -> float:
        """How much torque in N m a tilt of one rad from rest would ask for; 0 along an axis without."""
        return self.restoring_values[0] if self.axis.self_righting else 0.0

    @property
    def natural_frequency(self) -> float:
        """Frequency in rad/s at which the vehicle would swing about its level without drag; 0 along an axis without."""
        return math.sqrt(max(self.stiffness, 0.0) / self.inertia)

    def rate_std_per_torque(self, rate: float, memory: float) -> float:
        """Standard deviation of the rate for each N m of a disturbance torque with a ``memory`` in s.

        Of the motion linearised at ``rate``: variance T^2 memory / (c (I + c memory + K memory^2)), c the slope of the
        drag and K the stiffness.
        """
        slope = max(2.0 * self.quadratic_drag * rate + self.linear_drag, 1e-12)
        return math.sqrt(memory / (slope * (self.inertia + slope * memory + self.stiffness * memory**2)))

    def drag(self, rate: FloatArray) -> FloatArray:
        """Drag torque in N m at ``rate`` in rad/s."""
        return self.quadratic_drag * np.abs(rate) * rate + self.linear_drag * rate

    def steady_rate(self, torque: float) -> float:
        """Rate in rad/s at which drag balances a ``torque`` of zero or more N m."""
        root = math.sqrt(self.linear_drag**2 + 4.0 * self.quadratic_drag * torque)
        return 2.0 * torque / max(self.linear_drag + root, 1e-12)
