"""What an effect is: an equation, its parameters, what it looks like, and how to tell it from its rivals.

Where it acts, and by which function, is one of `rovid.effects.stages`. What an effect's file needs is to be had here.

Nature does not know our equations: one cause may have several forms. They share the id and are told apart by ``form``;
a cause is named, whichever form fits best.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_inputs import SPEEDS, ActuatorInputs
from rovid.effects.stages import Acts, Actuating, OnCommand, OnHeading, OnThrust, OnTorque, Term, Values, WaveTorque
from rovid.effects.term_inputs import TERM_PARAMETERS, TERM_STATES, Body, Instant, Numbers, drag
from rovid.jit.decorators import compiled
from rovid.jit.simd import maximum, minimum, where_nonnegative

__all__ = [
    "REFERENCE_RATE",
    "SPEEDS",
    "TERM_PARAMETERS",
    "TERM_STATES",
    "Acts",
    "Actuating",
    "ActuatorInputs",
    "Body",
    "Effect",
    "EffectParameter",
    "Instant",
    "Numbers",
    "OnCommand",
    "OnHeading",
    "OnThrust",
    "OnTorque",
    "Scales",
    "Term",
    "Values",
    "WaveTorque",
    "compiled",
    "drag",
    "maximum",
    "minimum",
    "where_nonnegative",
]

# rad/s; where forms that depend on the rate agree with the plain one, or have the time constant that they are given.
REFERENCE_RATE = 0.3
# A parameter whose slopes are taken over more than this share of it makes stairs of the likelihood.
_SMOOTH = 1e-3
# A null so large stands for infinity.
_ENDLESS = 1e5


@dataclass(frozen=True, kw_only=True)
class EffectParameter:
    """One parameter of an effect.

    Attributes
    ----------
    null
        Value at which the effect is not there.
    low, high
        Physical bounds, in ``unit``, or in units of the scale.
    starts
        Where to begin a fit, in units of the scale.
    scale
        What one unit of the search is: ``one``, ``command`` (a hundredth of the largest command in use), or what is in
        use of ``torque``, ``rate``, ``race``, ``surge`` or ``sway`` speed and of ``root``, that of a thrust, the
        heaviest ``load`` as a share of full thrust, the hours of the ``longest`` log or of the ``day`` from the first
        log's beginning to the last one's end; or one of them over others, as ``torque/surge/rate``.
    step
        Share of its size over which slopes are taken. A threshold between samples makes stairs of the likelihood: over
        less than a step of them it has no slope, or far too much.
    """

    name: str
    unit: str
    neutral: float
    low: float
    high: float
    initial_values: tuple[float, ...]
    scale: str = "one"
    step: float = 1e-4

    @property
    def piecewise_constant(self) -> bool:
        """Whether the likelihood has steps along it in place of slopes."""
        return self.step > _SMOOTH

    @property
    def neutral_at_infinity(self) -> bool:
        """Whether the effect is gone only at infinity, for which ``null`` stands."""
        return abs(self.neutral) > _ENDLESS


@dataclass(frozen=True, kw_only=True, eq=False)
class Effect:
    """One physical cause.

    Attributes
    ----------
    id
        Its name for users and programs.
    acts
        Where it acts, and how.
    equation, fingerprint, experiment
        For people: what it does, what it looks like in the residuals, and the run that reveals it.
    form
        Which of the effect's forms this is; empty for the plain one.
    rivals
        Ids of the effects it is confused with.
    needs
        Channels of the log without which this form cannot be.
    axes
        Names of the axes along which there is such a thing; empty for all.
    canonical
        (parameters) -> the same, in the range in which people expect them.
    each_thruster
        Whether it acts on one thruster, whose name is the form.
    sizes
        How many of its parameters, the first ones, are its size together.
    passing
        Whether it is of a day, of its water, its cable and its battery, rather than of the vehicle.
    """

    id: str
    title: str
    parameters: tuple[EffectParameter, ...]
    acts: Acts
    equation: str
    fingerprint: str
    experiment: str
    form: str = ""
    rivals: tuple[str, ...] = ()
    needs: tuple[str, ...] = ()
    axes: tuple[str, ...] = ()
    canonical: Callable[[FloatArray], FloatArray] | None = None
    per_thruster: bool = False
    size_count: int = 1
    environmental: bool = False

    @property
    def key(self) -> str:
        """Id and form, as in ``thruster_lag:rotor``."""
        return f"{self.id}:{self.form}" if self.form else self.id

    @property
    def changes_torque_input(self) -> bool:
        """Whether its parameters change what drives the vehicle."""
        stands_in = isinstance(self.acts, Term) and self.acts.surge_from_thrust is not None
        return stands_in or isinstance(self.acts, Actuating)

    @property
    def uses_wash(self) -> bool:
        """Whether it asks for the thrusters' race."""
        return isinstance(self.acts, Term) and self.acts.uses_wash

    @property
    def stateful(self) -> bool:
        """Whether it has states of its own, which move on with the vehicle."""
        return isinstance(self.acts, Term) and self.acts.states > 0

    @property
    def is_wave(self) -> bool:
        """Whether it is a torque at random phase."""
        return isinstance(self.acts, WaveTorque)

    @property
    def oscillatory(self) -> bool:
        """Whether it swings by itself, with its parameter ``frequency``, and a filter carries its states along."""
        return self.is_wave or (isinstance(self.acts, Term) and self.acts.oscillatory)

    @property
    def initial_values(self) -> list[FloatArray]:
        """Where to begin the search for the parameters, in units of their scale."""
        count = max(len(parameter.initial_values) for parameter in self.parameters)
        return [self._start(number) for number in range(count)]

    def _start(self, number: int) -> FloatArray:
        """(k,) the start of that number, or a parameter's last where it has fewer."""
        return np.array(
            [p.initial_values[min(number, len(p.initial_values) - 1)] for p in self.parameters], dtype=float
        )

    def values(self, numbers: FloatArray) -> dict[str, float]:
        """Parameters by name."""
        return {parameter.name: float(value) for parameter, value in zip(self.parameters, numbers, strict=True)}


@dataclass(frozen=True)
class Scales:
    """What one unit of each parameter's search is, in SI; see ``EffectParameter.scale``."""

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

    def unit_size(self, parameter: EffectParameter) -> float:
        """Size of one unit of ``parameter``."""
        sizes = {"one": 1.0, **vars(self), "command": 0.01 * self.command}
        first, *others = parameter.scale.split("/")
        return float(sizes[first] / math.prod(sizes[name] for name in others))
