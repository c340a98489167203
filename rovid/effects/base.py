"""An effect: equation, parameters, fingerprint, and the experiment that reveals it.

An effect's file imports all it needs from here. One physical cause may have several forms with different equations.
They share the id, and differ in ``form``. A diagnosis names the cause by the form that fits best.

An effect acts, by one or more functions, at a stage between command and measured heading:

    command -> [OnCommand] -> bench curve -> [OnThrust] -> sum -> [OnTorque] -> motion [Term, WaveTorque] -> [OnHeading]

The first three are functions of the logged commands alone, those of all trials concatenated. They are evaluated once
for a set of parameters. Terms are compiled, and evaluated in each step of the integration.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects import actuator_inputs
from rovid.jit import decorators, simd

# Room for parameters and states of each term.
TERM_PARAMETERS = 4
TERM_STATES = 2
# Parameters of a term in their order, or its states.
Numbers = tuple[float, ...]
# Parameter values of an effect by name.
Values = Mapping[str, float]
ActuatorInputs = actuator_inputs.ActuatorInputs
# (trials, series, parameter values) -> series.
OnSeries = Callable[[ActuatorInputs, FloatArray, Values], FloatArray]
# (parameter values, largest change of a command) -> s after the change.
Settling = Callable[[Values, float], float]
# An effect's file takes these from here.
SPEEDS = actuator_inputs.SPEEDS
compiled = decorators.compiled
maximum, minimum, where_nonnegative = simd.maximum, simd.minimum, simd.where_nonnegative
# rad/s; at this rate all forms of an effect agree, and have the time constant that is given.
REFERENCE_RATE = 0.3
# Relative step of a difference quotient, above which the likelihood is taken to be piecewise constant.
_SMOOTH_STEP = 1e-3
# A neutral value beyond this stands for infinity.
_INFINITE = 1e5
# Factor beyond its bounds, at the scales of some logs, from which a value is unusual. A decision.
_MARGIN = 10.0


class Body(NamedTuple):
    """The plain model, in SI and rad.

    ``stiffness`` in N m/rad and ``trim`` in rad belong to the restoring torque, and are 0 along an axis without.
    """

    inertia: float
    quadratic_drag: float
    linear_drag: float
    stiffness: float = 0.0
    trim: float = 0.0


class Instant(NamedTuple):
    """Motion and inputs at one instant."""

    #: ``rate``, ``relative_rate``: rad/s over ground, and relative to the water around the hull.
    rate: float
    relative_rate: float
    #: ``angle``, ``start``: rad since the start of the trial, and the position at the start. Their sum is the position,
    #: in yaw the heading.
    angle: float
    start: float
    thruster_torque: float  #: N m.
    wash: float  #: N^0.5 m^2; sum of sqrt(thrust) * arm^2 over the thrusters.
    #: ``surge``, ``sway``: m/s ahead and to starboard.
    surge: float
    sway: float
    body: Body  #: The plain model.


@compiled
def drag(body: Body, rate: float) -> float:
    """Drag of the plain model in N m at ``rate`` in rad/s relative to the water."""
    return (body.quadratic_drag * abs(rate) + body.linear_drag) * rate


@dataclass(frozen=True, eq=False)
class OnCommand:
    """``change``: (n, k) commands -> commands. Other fields as in `OnThrust`."""

    change: OnSeries
    _: KW_ONLY
    settling_time: Settling | None = None
    anchored: bool = False
    of_angles: bool = False  #: Whether the effect acts on the angles of rudders and azimuth thrusters alone.


@dataclass(frozen=True, eq=False)
class OnThrust:
    """``change``: (n, k) thrusts in N -> thrusts."""

    change: OnSeries
    _: KW_ONLY
    #: Time until the thrust is constant after a command change, if it varies within a sample interval.
    settling_time: Settling | None = None
    #: Whether the effect leaves thrust unchanged at a reference thrust, command or voltage that is a mere convention.
    anchored: bool = False


@dataclass(frozen=True, eq=False)
class OnTorque:
    """``change``: (n,) torque in N m -> torque, each value the mean until the next instant."""

    change: OnSeries
    _: KW_ONLY
    settling_time: Settling | None = None  #: As in `OnThrust`.
    #: (n,) torque in N m before the change -> variance in N^2 m^2 s^2 of its integral until the next instant, if the
    #: effect leaves open when the torque acts.
    impulse_variance: OnSeries | None = None


@dataclass(frozen=True, eq=False)
class Term:
    """``torque``: a compiled term of the equation of motion in N m, ``(at, p) -> torque``.

    ``at`` is an `Instant`, ``p`` holds the parameters in their order. A term with states x returns their derivatives
    too: ``(at, p, x) -> (torque, derivative, ...)``.
    """

    torque: Callable[..., Any]
    _: KW_ONLY
    states: int = 0  #: Number of states.
    #: (parameter values) -> fastest rate of change of the states in 1/s, for the step of the integration.
    fastest: Callable[[Values], float] | None = None
    #: Compiled ``(rate, x) -> state``: the value to which the single state is reset at this rate, mostly itself.
    reset: Callable[[float, Numbers], float] | None = None
    #: Whether the two states oscillate after an excitation. A filter then estimates their covariance. They are linear
    #: in the rate and in each other, and the first is the integral of the second. A model has one such effect at most.
    oscillatory: bool = False
    #: Compiled ``(p, x)`` -> rad/s of the water around the hull. Drag in all terms is that of the relative rate.
    entrained_rate: Callable[[Numbers, Numbers], float] | None = None
    #: (parameter values) -> inertia in kg m^2 that the term adds in slow motion.
    added_inertia: Callable[[Values], float] | None = None
    #: (parameter values, rate in rad/s, acceleration in rad/s^2) -> standard deviation of each state at the first
    #: sample of a log that begins in motion of this size. None: the term forgets within a swing.
    unknown_start: Callable[[Values, float, float], tuple[float, ...]] | None = None
    uses_wash: bool = False  #: Whether the term depends on ``at.wash``.
    #: (n, k) thrusts in N -> (n,) values for ``at.surge``, each the mean until the next instant, for a form that does
    #: without a logged speed.
    surge_from_thrust: OnSeries | None = None

    def evaluate(self, instant: Instant, numbers: Numbers, states: Numbers) -> tuple[float, Numbers]:
        """Torque in N m and the derivatives of the states, for loops that are not compiled."""
        if not self.states:
            return self.torque(instant, numbers), ()
        torque, *derivatives = self.torque(instant, numbers, states)
        return torque, tuple(derivatives)


@dataclass(frozen=True, eq=False)
class OnHeading:
    """``deviation``: (n,) true headings in rad -> deviation of the measured heading in rad, periodic in a turn.

    The measured heading is a monotonic function of the true one.
    """

    deviation: Callable[[FloatArray, Values], FloatArray]


@dataclass(frozen=True, eq=False)
class WaveTorque:
    """A torque of random phase, for which a filter has two states. Parameters: amplitude, frequency and damping."""


@dataclass(frozen=True, eq=False)
class Coupling:
    """Forces that couple surge, sway and yaw; only the planar model has them.

    ``forces`` is compiled, ``(u, v, r, p) -> (X, Y, N)``: forces in N and torque in N m at speeds through the water in
    m/s and rad/s, for the parameters ``p`` in their order.
    """

    forces: Callable[..., tuple[float, float, float]]


@dataclass(frozen=True, eq=False)
class WaterCurrent:
    """A uniform current: the planar model's speeds are relative to it. Parameters: speed and direction.

    With ``wanders`` further parameters are the standard deviation and the correlation time of its change.
    """

    wanders: bool = False


@dataclass(frozen=True, eq=False)
class SensorPlace:
    """The place of the ``sensors`` of the planar model on one instrument. Parameters: m ahead, and to starboard."""

    sensors: tuple[str, str]


# Stages between command and torque.
Actuating = OnCommand | OnThrust | OnTorque
Acts = Actuating | Term | OnHeading | WaveTorque | Coupling | WaterCurrent | SensorPlace


@dataclass(frozen=True, kw_only=True)
class EffectParameter:
    """One parameter of an effect."""

    name: str
    unit: str
    neutral: float = 0.0  #: Value without the effect.
    #: ``low``, ``high``: physical bounds, in ``unit`` times the scale.
    low: float = 0.0
    high: float
    initial_values: tuple[float, ...]  #: Initial values of fits, in ``unit`` times the scale.
    #: Typical size: ``one``; ``command``, a hundredth of the largest command from neutral; ``torque``, ``rate``,
    #: ``wash``, ``sqrt_thrust``, ``surge`` and ``sway``, the RMS over all logs; ``load``, the largest share of full
    #: thrust; ``longest``, hours of the longest log; ``day``, hours from the first log's start to the last one's end;
    #: ``surge_force`` and ``sway_force``, RMS in the planar model; ``time``, time constant of the vehicle;
    #: ``impulse``, of the RMS torque in that time; ``angle``, swept in it at the RMS rate; ``time_at_reference``, time
    #: for it at the reference rate.
    #: Quotients are written as ``torque/surge/rate``.
    scale: str = "one"
    #: Relative step of difference quotients. A threshold makes the likelihood piecewise constant: with a small step its
    #: derivative would be zero or far too large.
    step: float = 1e-4

    @property
    def piecewise_constant(self) -> bool:
        """Whether the likelihood has steps along this parameter."""
        return self.step > _SMOOTH_STEP

    def bounds(self, scales: Scales | None = None) -> tuple[float, float]:
        """Bounds in ``unit`` of the usual values at these ``scales``; without them those of the possible values.

        Usual values have a margin: the logs of the fit may have had other scales. Possible are twice the range of a
        parameter without a scale, and all values of its sign of another one.
        """
        if scales is None:
            span = self.high - self.low if self.scale == "one" else math.inf
            least = -math.inf if self.low < 0.0 else math.ulp(0.0) if self.low > 0.0 else 0.0
            return max(self.low - span, least), self.high + span
        size, margin = (1.0, 1.0 + 1e-6) if self.scale == "one" else (scales.unit_size(self), _MARGIN)
        return size * self.low * (margin if self.low < 0.0 else 1.0 / margin), size * self.high * margin

    @property
    def neutral_at_infinity(self) -> bool:
        """Whether the effect vanishes at infinity, for which ``neutral`` stands."""
        return abs(self.neutral) > _INFINITE


HOUR = 3600.0  # s, the unit of instants
# Begin of an effect that lasts to the end of the campaign, in h from the begin of the first log. Its initial values are
# shares of the time in all logs together. At 0 the effect acts in all logs.
INSTANT = EffectParameter(
    name="instant", unit="h", high=1.0, initial_values=tuple((k + 0.5) / 16 for k in range(16)), scale="day"
)
# End of an effect that stops before the campaign does; at 1 the effect lasts.
UNTIL = replace(INSTANT, name="until", neutral=1.0, initial_values=tuple(min((k + 1.5) / 16, 1.0) for k in range(16)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Effect:
    """One physical cause, in one of its forms."""

    id: str  #: Name of the effect for users and programs.
    title: str
    parameters: tuple[EffectParameter, ...]
    acts: Acts  #: Stage at which the effect acts, with its function.
    #: ``equation``, ``fingerprint``, ``experiment``: texts: the equation, the pattern in the residuals, and the run
    #: that reveals the effect.
    equation: str
    fingerprint: str
    experiment: str
    form: str = ""  #: Name of the form; empty for the plain one.
    rivals: tuple[str, ...] = ()  #: Ids of effects with which it is confused.
    needs: tuple[str, ...] = ()  #: Channels of the log without which the form cannot be evaluated.
    replaces: tuple[str, ...] = ()  #: Channels of the log each of which makes the form superfluous.
    axes: tuple[str, ...] = ()  #: Names of the axes along which the effect exists; empty for all.
    #: (parameters) -> equivalent parameters in the usual range.
    canonical: Callable[[FloatArray], FloatArray] | None = None
    per_thruster: bool = False  #: Whether the effect acts on one thruster, whose name is the form.
    size_count: int = 1  #: Number of parameters, the first ones, that are the size of the effect.
    #: Whether the effect belongs to the day (water, cable, battery) rather than to the vehicle.
    environmental: bool = False

    @property
    def key(self) -> str:
        """Id and form, as in ``thruster_lag:rotor``."""
        return f"{self.id}:{self.form}" if self.form else self.id

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters in estimates and files, as ``thruster_lag.time_constant``."""
        return tuple(f"{self.key}.{parameter.name}" for parameter in self.parameters)

    @property
    def changes_torque_input(self) -> bool:
        """Whether the torque input depends on the effect's parameters."""
        estimates_surge = isinstance(self.acts, Term) and self.acts.surge_from_thrust is not None
        return estimates_surge or isinstance(self.acts, Actuating)

    @property
    def uses_wash(self) -> bool:
        """Whether the effect depends on the wash of the thrusters."""
        return isinstance(self.acts, Term) and self.acts.uses_wash

    @property
    def stateful(self) -> bool:
        """Whether the effect has states, which are integrated with the motion."""
        return isinstance(self.acts, Term) and self.acts.states > 0

    @property
    def is_wave(self) -> bool:
        """Whether the effect is a torque of random phase."""
        return isinstance(self.acts, WaveTorque)

    @property
    def oscillatory(self) -> bool:
        """Whether the effect oscillates with its parameter ``frequency``, and a filter estimates its states."""
        return self.is_wave or (isinstance(self.acts, Term) and self.acts.oscillatory)

    @property
    def initial_values(self) -> list[FloatArray]:
        """Initial values of fits, each (k,), in units of the scales. Short lists repeat their last value."""
        count = max(len(parameter.initial_values) for parameter in self.parameters)
        return [
            np.array([p.initial_values[min(number, len(p.initial_values) - 1)] for p in self.parameters], dtype=float)
            for number in range(count)
        ]

    @property
    def instants(self) -> list[int]:
        """Numbers of the parameters that are instants of the campaign: its `INSTANT` of begin, and `UNTIL`."""
        return [at for at, parameter in enumerate(self.parameters) if parameter in (INSTANT, UNTIL)]

    def values(self, numbers: FloatArray) -> dict[str, float]:
        """Parameter values by name."""
        return {parameter.name: float(value) for parameter, value in zip(self.parameters, numbers, strict=True)}


@dataclass(frozen=True)
class Scales:
    """Typical sizes in SI; see ``EffectParameter.scale``."""

    command: float
    torque: float
    rate: float
    wash: float
    sqrt_thrust: float = 1.0
    surge: float = 1.0
    sway: float = 1.0
    load: float = 1.0
    longest: float = 1.0
    day: float = 1.0
    time: float = 1.0
    #: ``surge_force``, ``sway_force``: N, of the planar model.
    surge_force: float = 1.0
    sway_force: float = 1.0

    def unit_size(self, parameter: EffectParameter) -> float:
        """Scale of ``parameter``."""
        sizes = {
            "one": 1.0,
            **vars(self),
            "command": 0.01 * self.command,
            "inertia": self.torque * self.time / self.rate,
            "impulse": self.torque * self.time,
            "angle": self.time * self.rate,
            "time_at_reference": self.time * self.rate / REFERENCE_RATE,
        }
        first, *others = parameter.scale.split("/")
        return float(sizes[first] / math.prod(sizes[name] for name in others))

    def neutral_sizes(self, effect: Effect) -> FloatArray:
        """(s,) neutral values of the sizes of ``effect`` in SI; 0 where the neutral value is infinite."""
        sizes = effect.parameters[: effect.size_count]
        neutral = [0.0 if size.neutral_at_infinity else size.neutral * self.unit_size(size) for size in sizes]
        return np.array(neutral)


def canonical_phases(numbers: FloatArray) -> FloatArray:
    """Pairs of amplitude and phase in rad, with amplitudes of 0 or more and phases between -pi and pi."""
    amplitude, phase = np.asarray(numbers, dtype=np.float64).reshape(-1, 2).T
    phase = np.where(amplitude < 0.0, phase + math.pi, phase)
    phase = np.arctan2(np.sin(phase), np.cos(phase))
    return np.column_stack((np.abs(amplitude), phase)).ravel()
