"""Where an effect acts, on the way from command to measured heading, and by which function.

    command -> [OnCommand] -> bench curve -> [OnThrust] -> sum -> [OnTorque] -> motion [Term, Wave] -> [OnHeading]

The first three are functions of the logged commands alone, those of all trials one after the other, and are worked out
once for a set of parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass
from typing import Any

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_inputs import ActuatorInputs
from rovid.effects.term_inputs import Instant, Numbers

# Parameters of an effect by name.
Values = Mapping[str, float]
OnSeries = Callable[[ActuatorInputs, FloatArray, Values], FloatArray]
# (parameters, largest change of a command) -> s after a change of commands.
Settling = Callable[[Values, float], float]


@dataclass(frozen=True, eq=False)
class OnCommand:
    """``change``: (n, k) commands -> commands; other flags as in `OnThrust`."""

    change: OnSeries
    _: KW_ONLY
    settling_time: Settling | None = None
    anchored: bool = False


@dataclass(frozen=True, eq=False)
class OnThrust:
    """``change``: (n, k) thrusts in N -> thrusts.

    Attributes
    ----------
    settles
        When all is over that it does in less than the interval between two samples; None where there is no such thing.
    anchored
        Whether it leaves thrust as it was taken at one thrust, command or voltage that is a mere choice. An effect
        that says where thrust is gone (astern, of one thruster, with load, with time) leaves the rest as it was.
    """

    change: OnSeries
    _: KW_ONLY
    settling_time: Settling | None = None
    anchored: bool = False


@dataclass(frozen=True, eq=False)
class OnTorque:
    """``change``: (n,) torque in N m -> torque, each value the mean until the next instant.

    Attributes
    ----------
    settles
        As in `OnThrust`.
    scatter
        (n,) torque in N m, before the change -> variance of its impulse until the next instant in N^2 m^2 s^2, where
        the equation leaves open when the torque acts.
    """

    change: OnSeries
    _: KW_ONLY
    settling_time: Settling | None = None
    impulse_variance: OnSeries | None = None


@dataclass(frozen=True, eq=False)
class Term:
    """``torque``: a compiled term of the equation of motion, in N m: ``(at, p) -> torque``.

    ``at`` is an `Instant`, ``p`` holds the parameters in their order. One with states is told them too, and says how
    each of them changes with time: ``(at, p, x) -> (torque, change, ...)``.

    Attributes
    ----------
    states
        How many it has.
    fastest
        (parameters) -> the fastest rate of the states in 1/s, for the step of the integration.
    jumps
        Compiled; ``(rate, x) -> state``, to which its one state jumps at such a rate: itself, mostly.
    rings
        Whether its two states ring on after what set them off, so that a filter has to know how well it knows them.
        They are linear in the rate and each other, the first the integral of the second; one of a model's effects may
        be of this kind.
    water
        Compiled; ``(p, x)`` -> rad/s at which it takes the water about the hull along. All drag, in every term, is of
        the rate less that of the water.
    added_inertia
        (parameters) -> what it adds to the inertia in slow motion, in kg m^2.
    races
        Whether it asks for the thrusters' race, ``at.race``.
    surge
        (n, k) thrusts in N -> (n,) what ``at.surge`` is, each value the mean until the next instant, of a form that
        makes do without a logged speed.
    """

    torque: Callable[..., Any]
    _: KW_ONLY
    states: int = 0
    fastest: Callable[[Values], float] | None = None
    reset: Callable[[float, Numbers], float] | None = None
    oscillatory: bool = False
    entrained_rate: Callable[[Numbers, Numbers], float] | None = None
    added_inertia: Callable[[Values], float] | None = None
    uses_wash: bool = False
    surge_from_thrust: OnSeries | None = None

    def evaluate(self, instant: Instant, numbers: Numbers, states: Numbers) -> tuple[float, Numbers]:
        """Torque in N m, and how the states change; for loops that are not compiled."""
        if not self.states:
            return self.torque(instant, numbers), ()
        torque, *change = self.torque(instant, numbers, states)
        return torque, tuple(change)


@dataclass(frozen=True, eq=False)
class OnHeading:
    """``deviation``: (n,) true headings in rad -> deviation of the measured heading in rad, the same after each turn.

    It leaves the measured heading one to one with the true one.
    """

    deviation: Callable[[FloatArray, Values], FloatArray]


@dataclass(frozen=True, eq=False)
class WaveTorque:
    """A torque of its own at random phase, which a filter carries along.

    The effect's parameters are its amplitude, frequency and damping.
    """


# Those between command and torque.
Actuating = OnCommand | OnThrust | OnTorque
Acts = Actuating | Term | OnHeading | WaveTorque
