"""An effect: equation, parameters, fingerprint, and the experiment that reveals it.

The stage at which an effect acts, and its function there, is one of `rovid.effects.stages`. An effect's file imports
all it needs from here. One physical cause may have several forms with different equations. They share the id, and
differ in ``form``. A diagnosis names the cause by the form that fits best.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_inputs import SPEEDS, ActuatorInputs
from rovid.effects.stages import (
    TERM_PARAMETERS,
    TERM_STATES,
    Acts,
    Actuating,
    Body,
    Coupling,
    Instant,
    Numbers,
    OnCommand,
    OnHeading,
    OnThrust,
    OnTorque,
    Term,
    Values,
    WaterCurrent,
    WaveTorque,
    drag,
)
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
    "Coupling",
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
    "WaterCurrent",
    "WaveTorque",
    "canonical_phases",
    "compiled",
    "drag",
    "maximum",
    "minimum",
    "where_nonnegative",
]

# rad/s; at this rate all forms of an effect agree, and have the time constant that is given.
REFERENCE_RATE = 0.3
# Relative step of a difference quotient, above which the likelihood is taken to be piecewise constant.
_SMOOTH_STEP = 1e-3
# A neutral value beyond this stands for infinity.
_INFINITE = 1e5


@dataclass(frozen=True, kw_only=True)
class EffectParameter:
    """One parameter of an effect."""

    name: str
    unit: str
    neutral: float  #: Value without the effect.
    #: ``low``, ``high``: physical bounds, in ``unit`` times the scale.
    low: float
    high: float
    initial_values: tuple[float, ...]  #: Initial values of fits, in ``unit`` times the scale.
    #: Typical size: ``one``; ``command``, a hundredth of the largest command from neutral; ``torque``, ``rate``,
    #: ``wash``, ``sqrt_thrust``, ``surge`` and ``sway``, the RMS over all logs; ``load``, the largest share of full
    #: thrust; ``longest``, hours of the longest log; ``day``, hours from the first log's start to the last one's end;
    #: ``surge_force`` and ``sway_force``, RMS in the planar model; ``time``, time constant of the vehicle;
    #: ``time_at_reference``, time for the same angle at the reference rate.
    #: Quotients are written as ``torque/surge/rate``.
    scale: str = "one"
    #: Relative step of difference quotients. A threshold makes the likelihood piecewise constant: with a small step its
    #: derivative would be zero or far too large.
    step: float = 1e-4

    @property
    def piecewise_constant(self) -> bool:
        """Whether the likelihood has steps along this parameter."""
        return self.step > _SMOOTH_STEP

    @property
    def neutral_at_infinity(self) -> bool:
        """Whether the effect vanishes at infinity, for which ``neutral`` stands."""
        return abs(self.neutral) > _INFINITE


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
            "time_at_reference": self.time * self.rate / REFERENCE_RATE,
        }
        first, *others = parameter.scale.split("/")
        return float(sizes[first] / math.prod(sizes[name] for name in others))


def canonical_phases(numbers: FloatArray) -> FloatArray:
    """Pairs of amplitude and phase in rad, with amplitudes of 0 or more and phases between -pi and pi."""
    amplitude, phase = np.asarray(numbers, dtype=np.float64).reshape(-1, 2).T
    phase = np.where(amplitude < 0.0, phase + math.pi, phase)
    phase = np.arctan2(np.sin(phase), np.cos(phase))
    return np.column_stack((np.abs(amplitude), phase)).ravel()
