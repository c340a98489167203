"""Stages between command and measured heading at which an effect may act, and the functions by which it acts.

    command -> [OnCommand] -> bench curve -> [OnThrust] -> sum -> [OnTorque] -> motion [Term, WaveTorque] -> [OnHeading]

The first three are functions of the logged commands alone, those of all trials concatenated. They are evaluated once
for a set of parameters. Terms are compiled, and evaluated in each step of the integration.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass
from typing import Any, NamedTuple

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_inputs import ActuatorInputs
from rovid.jit.decorators import compiled

# Room for parameters and states of each term.
TERM_PARAMETERS = 4
TERM_STATES = 2
# Parameters of a term in their order, or its states.
Numbers = tuple[float, ...]
# Parameter values of an effect by name.
Values = Mapping[str, float]
# (trials, series, parameter values) -> series.
OnSeries = Callable[[ActuatorInputs, FloatArray, Values], FloatArray]
# (parameter values, largest change of a command) -> s after the change.
Settling = Callable[[Values, float], float]


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


# Stages between command and torque.
Actuating = OnCommand | OnThrust | OnTorque
Acts = Actuating | Term | OnHeading | WaveTorque | Coupling | WaterCurrent
