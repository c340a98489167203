"""The model: inertia, drag, restoring torque, effects, and the heading sensor."""

import math
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, pairwise
from typing import Self

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects import Effect, restoring_effect
from rovid.effects.base import Body, OnHeading, Term
from rovid.model.actuator_model import ActuatorModel
from rovid.model.bound_effects import BoundEffect, Equation, PackedTerms, actions_at, effects_at, pack_terms
from rovid.model.ode import euler_heading, initial_rate, integrate, integrate_batch, with_past
from rovid.model.parameter_names import base_names
from rovid.model.torque_input import TorqueInput
from rovid.trial.axis import YAW, Axis
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle

# Arcs of the circle; interpolation between their ends has an error of 1e-8 rad for the largest deviation.
_TURN, _ARCS = 2.0 * math.pi, 512
_NUDGE = 1e-4  # rad, for a difference quotient


@dataclass(frozen=True, eq=False)
class HeadingSensor:
    """The sensor of a model's positions, with the effects of the model that act on the heading."""

    effects: tuple[BoundEffect, ...]

    @property
    def deviates(self) -> bool:
        """Whether the measured heading differs from the true one."""
        return any(isinstance(one.effect.acts, OnHeading) for one in self.effects)

    @property
    def cache_key(self) -> tuple[Hashable, ...]:
        """Effects on the heading, with their parameters."""
        return tuple((one.effect, *one.parameters.tolist()) for one, _ in effects_at(self.effects, OnHeading))

    def deviation(self, heading: FloatArray) -> FloatArray:
        """(n,) deviation of the measured heading in rad at the (n,) true headings in rad."""
        total = np.zeros(len(heading))
        for act, values in actions_at(self.effects, OnHeading):
            total += act.deviation(heading, values)
        return total

    def to_true(self, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The true position for a measured one.

        ``position``: (n,) rad or m.
        Returns ``true``, ``gain``: (n,) rad or m, and d(measured)/d(true).
        """
        if not self.deviates:
            return position, np.ones(len(position))
        # The inverse function as a cubic Hermite spline over one turn.
        true = np.linspace(0.0, _TURN, _ARCS + 1)
        measured, gain = self.to_measured(true, np.ones(_ARCS + 1))
        within = measured[0] + np.mod(position - measured[0], _TURN)
        place = np.interp(within, measured, np.arange(_ARCS + 1.0))
        arc = np.minimum(np.nan_to_num(place).astype(int), _ARCS - 1)
        wide, rise = np.diff(measured), _TURN / _ARCS
        begins, ends = wide / gain[:-1], wide / gain[1:]
        a, b, c = (each[arc] for each in (begins, 3.0 * rise - 2.0 * begins - ends, begins + ends - 2.0 * rise))
        u = place - arc
        turned = true[arc] + u * (a + u * (b + u * c))
        return position + (turned - within), wide[arc] / (a + u * (2.0 * b + 3.0 * u * c))

    def to_measured(self, heading: FloatArray, rate: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(n,) measured heading and rate for the true ones."""
        above, below = (self.deviation(heading + side) for side in (_NUDGE, -_NUDGE))
        return heading + self.deviation(heading), rate * (1.0 + (above - below) / (2.0 * _NUDGE))


@dataclass(frozen=True, kw_only=True)
class Model:
    """``inertia*rdot + quadratic_drag*|r|*r + linear_drag*r + g(q) = torque``, qdot = r.

    In yaw q is the heading psi. ``g`` is the restoring torque of weight and buoyancy along ``axis``, with the
    parameters ``restoring_values``, see `rovid.effects.restoring_curve`. Effects act on the ``actuators``, as terms
    of the ``equation``, and on the ``heading_sensor``.
    """

    inertia: float
    quadratic_drag: float
    linear_drag: float
    effects: tuple[Effect, ...] = ()
    effect_values: tuple[float, ...] = ()
    axis: Axis = YAW
    restoring_values: tuple[float, ...] = ()

    @classmethod
    def from_values(cls, values: Iterable[float], axis: Axis, effects: tuple[Effect, ...] = ()) -> Self:
        """The model with these ``values`` of all its parameters, in the order of ``names``."""
        inertia, quadratic, linear, *others = map(float, values)
        restoring = len(base_names(axis)) - 3
        return cls(
            inertia=inertia,
            quadratic_drag=quadratic,
            linear_drag=linear,
            effects=effects,
            effect_values=tuple(others[restoring:]),
            axis=axis,
            restoring_values=tuple(others[:restoring]),
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters, in the order of ``values``."""
        return (*base_names(self.axis), *(name for effect in self.effects for name in effect.parameter_names))

    @property
    def values(self) -> FloatArray:
        """(p,) values of all parameters."""
        base = (self.inertia, self.quadratic_drag, self.linear_drag)
        return np.array([*base, *self.restoring_values, *self.effect_values])

    @cached_property
    def bound_effects(self) -> tuple[BoundEffect, ...]:
        """The restoring torque, if the axis has one, and the effects, each with its parameters."""
        restoring = restoring_effect(self.axis)
        effects = self.effects if restoring is None else (restoring, *self.effects)
        values, bound = np.array([*self.restoring_values, *self.effect_values]), []
        for effect in effects:
            count = len(effect.parameters)
            bound.append(BoundEffect(effect, values[:count]))
            values = values[count:]
        return tuple(bound)

    def with_effects(self, keep: Callable[[Effect], bool] = lambda _: False) -> Self:
        """The model with the effects that ``keep`` accepts; by default without any."""
        known = {one.effect: one.parameters.tolist() for one in self.bound_effects}
        kept = tuple(filter(keep, self.effects))
        return replace(self, effects=kept, effect_values=tuple(chain.from_iterable(map(known.__getitem__, kept))))

    @cached_property
    def actuators(self) -> ActuatorModel:
        """The way from commands to torque."""
        return ActuatorModel(self.bound_effects)

    @cached_property
    def heading_sensor(self) -> HeadingSensor:
        """The way from the true position to the measured one."""
        return HeadingSensor(self.bound_effects)

    @cached_property
    def body(self) -> Body:
        """The plain model for effects and compiled loops."""
        trim = self.restoring_values[1] if self.axis.self_righting else 0.0
        return Body(self.inertia, self.quadratic_drag, self.linear_drag, self.stiffness, trim)

    @cached_property
    def terms(self) -> PackedTerms:
        """Terms of the equation of motion for compiled loops."""
        return pack_terms(self.bound_effects, self.natural_frequency, self.inertia)

    def equation(self, start: float) -> Equation:
        """Equation of motion for a trial that starts at position ``start`` in rad or m."""
        return Equation(self.body, self.terms, start)

    def equation_for(self, trial: Trial) -> Equation:
        """Equation of motion for ``trial``."""
        return self.equation(trial.first_position)

    @property
    def wave_parameters(self) -> FloatArray:
        """(3,) amplitude in N m, frequency in rad/s and damping of the wave torque; empty without a wave."""
        return next((one.parameters for one in self.bound_effects if one.effect.is_wave), np.zeros(0))

    def torque_input(self, vehicle: Vehicle, trial: Trial) -> TorqueInput:
        """Torque input by the commands of ``trial``, from each instant to the next; see `rovid.model.ode`."""
        if not self.actuators.is_plain:
            trial = with_past(trial, self.body, vehicle)
        return self.actuators.torque_input(vehicle, trial)

    def simulate(
        self, trial: Trial, torque_input: TorqueInput, states: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Free-running simulation of ``trial`` from its first sample, with ``states`` of the terms as in `integrate`.

        Returns ``rate``, ``position``: (n,) body rate and position as the sensors would measure them, at the instants
            of ``trial``. The position starts at the first measured one. In yaw with logged roll and pitch, the heading
            rate is psidot = (r + thetadot sin(phi)) / (cos(phi) cos(theta)) (Fossen 2011, eq. 2.28).
        """
        begin = self._initial_motion(trial)
        rate, angle = integrate(self.equation_for(trial), trial.time, torque_input, begin, states)
        if self.axis is YAW and trial.roll is not None and trial.pitch is not None:
            angle = euler_heading(trial, rate)
        first = int(np.argmax(trial.measured))
        if not self.heading_sensor.deviates:
            return rate, trial.position[first] + angle - angle[first]
        true, _ = self.heading_sensor.to_true(trial.position)
        heading, heading_rate = self.heading_sensor.to_measured(true[first] + angle - angle[first], rate)
        # A gyro measures the rate of the body; only a rate from the heading has the deviation of the heading.
        return (heading_rate if trial.rate is None else rate), heading

    def simulate_rates(self, trials: Sequence[Trial], torque_input: TorqueInput) -> list[FloatArray]:
        """(n,) rate of each trial as by `simulate`, without the position; ``torque_input`` is that of all trials."""
        if self.heading_sensor.deviates:
            return [self.simulate(*pair)[0] for pair in zip(trials, torque_input.by_trial, strict=True)]
        time = np.concatenate([trial.time for trial in trials])
        first = np.array(list(map(self._initial_motion, trials)))
        starts = np.array([trial.first_position for trial in trials])
        rate, _ = integrate_batch(self.body, self.terms, time, torque_input, starts, first)
        return [rate[begin:end] for begin, end in pairwise(torque_input.offsets.tolist())]

    def _initial_motion(self, trial: Trial) -> tuple[float, float]:
        """Body rate at the first instant, and the angle turned until then."""
        return initial_rate(trial, self.natural_frequency), 0.0

    @property
    def low_frequency_inertia(self) -> float:
        """Inertia in slow motion in kg m^2, with the water that moves with the vehicle."""
        terms = actions_at(self.bound_effects, Term)
        return self.inertia + sum(term.added_inertia(values) for term, values in terms if term.added_inertia)

    def damping(self, rate: float) -> float:
        """Least slope of all resistance in N m s at ``rate`` in rad/s: that of drag, and of fast motion against water.

        An added inertia m < 0 with the time constant tau takes m/tau from the slope in fast motion. If the sum is
        negative, the water drives the vehicle, which no passive fluid does (Cummins 1962).
        """
        taken = sum(
            min(term.added_inertia(values), 0.0) * term.fastest(values)
            for term, values in actions_at(self.bound_effects, Term)
            if term.added_inertia and term.fastest
        )
        return 2.0 * self.quadratic_drag * abs(rate) + self.linear_drag + taken

    @property
    def stiffness(self) -> float:
        """Restoring stiffness at rest in N m/rad; 0 along an axis without."""
        return self.restoring_values[0] if self.axis.self_righting else 0.0

    @property
    def natural_frequency(self) -> float:
        """Undamped natural frequency in rad/s; 0 along an axis without restoring torque."""
        return math.sqrt(max(self.stiffness, 0.0) / self.inertia)

    def rate_std_per_torque(self, rate: float, correlation_time: float) -> float:
        """Standard deviation of the rate for each N m of a disturbance torque with this ``correlation_time`` T in s.

        For the motion linearised at ``rate`` the variance is T / (c (I + c T + K T^2)), with the slope c of the drag
        and the stiffness K.
        """
        slope = max(2.0 * self.quadratic_drag * rate + self.linear_drag, 1e-12)
        spread = self.inertia + slope * correlation_time + self.stiffness * correlation_time**2
        return math.sqrt(correlation_time / (slope * spread))

    def drag(self, rate: FloatArray) -> FloatArray:
        """Drag torque in N m at ``rate`` in rad/s."""
        return self.quadratic_drag * np.abs(rate) * rate + self.linear_drag * rate

    def steady_rate(self, torque: float) -> float:
        """Rate in rad/s at which drag balances a ``torque`` of zero or more N m."""
        root = math.sqrt(self.linear_drag**2 + 4.0 * self.quadratic_drag * torque)
        return 2.0 * torque / max(self.linear_drag + root, 1e-12)
