"""Yaw moment of a hull with sideslip, and its Munk moment with speed ahead."""

from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_dynamics import speed_of_thrust
from rovid.effects.actuator_inputs import interpolate_gaps
from rovid.effects.base import (
    SPEEDS,
    ActuatorInputs,
    Effect,
    EffectParameter,
    Instant,
    Numbers,
    OnTorque,
    Term,
    Values,
    compiled,
)


@compiled
def _drift(at: Instant, p: Numbers) -> float:
    return -p[0] * at.sway


@compiled
def _munk(at: Instant, p: Numbers) -> float:
    return -p[0] * at.surge * at.sway


@compiled
def _both(at: Instant, p: Numbers) -> float:
    return -(p[0] + p[1] * at.surge) * at.sway


@compiled
def _turned(at: Instant, p: Numbers, x: Numbers) -> tuple[float, float]:
    # State: estimated sway. Turning with speed ahead excites it, and it decays (Fossen 2011, section 7.1).
    return -p[0] * x[0], (-at.surge * at.rate - x[0]) / p[1]


@compiled
def _carried(at: Instant, p: Numbers, x: Numbers) -> tuple[float, float]:
    return -p[0] * at.surge * x[0], (-at.surge * at.rate - x[0]) / p[1]


@compiled
def _followed(at: Instant, p: Numbers, x: Numbers) -> tuple[float, float]:
    return -p[0] * x[0], (at.rate - x[0]) / p[1]


@compiled
def _crept(at: Instant, p: Numbers, x: Numbers) -> tuple[float, float, float]:
    # States: speeds ahead and to starboard, in units of the thrust ahead per N m over the mass. The vehicle turns, and
    # its velocity persists until the drag has used it up.
    ahead, starboard = x
    change = abs(at.thruster_torque) + at.rate * starboard - ahead / p[1]
    return -p[0] * ahead * starboard, change, -at.rate * ahead - starboard / p[1]


def _decay_rate(values: Values) -> float:
    return 1.0 / values["time_constant"]


def _unknown_start(values: Values, rate: float, acceleration: float) -> tuple[float, ...]:
    """The sway of a steady turn, in units of the rate: that of a log that begins under way."""
    return (rate,)


def _accelerated(inputs: ActuatorInputs, torque: FloatArray, values: Values) -> FloatArray:
    """(n,) torque less that of the mean sideways acceleration between two log instants."""
    logged, changes = inputs.extras.get(SPEEDS[1], np.zeros(len(torque))), []
    for one, counts in zip(inputs.trials, inputs.subdivisions, strict=True):
        at = np.cumsum(counts) - counts
        sway = interpolate_gaps(logged[one.rows][at])
        changes.append(np.repeat(np.append(np.diff(sway) / np.diff(inputs.time[one.rows][at]), 0.0), counts))
    return np.asarray(torque - values["mass"] * np.concatenate(changes))


def _surge_from_thrust(inputs: ActuatorInputs, thrust: FloatArray, values: Values) -> FloatArray:
    return speed_of_thrust(inputs, thrust, values["surge_time_constant"])


_DRIFT = EffectParameter(
    name="coefficient", unit="N s", low=-3.0, high=3.0, initial_values=(0.05, -0.05), scale="torque/sway"
)
_MUNK = replace(_DRIFT, name="munk", unit="kg", scale="torque/surge/sway")
# Time constant of the sway. Sway that decays at once would be the same as damping with the square of the speed.
_DECAY = EffectParameter(
    name="time_constant", unit="s", neutral=1.0, low=0.02, high=60.0, initial_values=(0.1, 0.7), scale="time"
)

EFFECT: Effect = Effect(
    id="sideslip_moment",
    axes=("yaw",),
    title="moment of sideslip",
    parameters=(_DRIFT,),
    equation="− N·v, v the logged speed to starboard",
    fingerprint="residual torque in proportion to the sideways speed, whatever the rate",
    experiment="sideways drifts without turning, in both directions, at rest and with speed ahead",
    rivals=("speed_dependent_damping", "supply_sag", "heading_dependent_torque", "drag_asymmetry"),
    needs=SPEEDS[1:],
    acts=Term(_drift),
)
# Munk moment: (added mass across - added mass along)·u·v turns a hull broadside to the flow.
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(
        EFFECT,
        form="munk",
        parameters=(_MUNK,),
        equation="− m·u·v, u the logged speed ahead; m the added mass in sway less that in surge",
        fingerprint="residual torque in proportion to the product of the speeds ahead and sideways",
        needs=SPEEDS,
        acts=Term(_munk),
    ),
    replace(
        EFFECT,
        form="estimated",
        parameters=(
            replace(_DRIFT, unit="N^0.5 m s/rad", scale="torque/sqrt_thrust/rate"),
            _DECAY,
            EffectParameter(name="surge_time_constant", unit="s", high=100.0, initial_values=(1.0, 4.0), scale="time"),
        ),
        equation="− N·w, τ·dw/dt = − s·r − w, τ1·ds/dt = sign(F)·√|F| − s, F the thrust ahead: in place of a logged v",
        fingerprint="residual torque that follows the rate with a lag, in proportion to the root of the thrust ahead",
        experiment="the speeds in the log; the same turns with large thrust ahead and without it",
        needs=(),
        acts=Term(_turned, states=1, fastest=_decay_rate, surge_from_thrust=_surge_from_thrust),
    ),
    replace(
        EFFECT,
        form="carried",
        parameters=(
            replace(_DRIFT, unit="N m s^3/(m^2 rad)", scale="torque/surge/surge/rate"),
            replace(_DECAY, initial_values=(0.3, 2.0)),
        ),
        equation="− N·u·w, τ·dw/dt = − u·r − w, u the logged speed ahead: in place of a logged v",
        fingerprint="residual torque that follows the rate with a lag, in proportion to the square of the speed ahead",
        experiment="the same turns at several speeds ahead, and at zero speed",
        needs=SPEEDS[:1],
        acts=Term(_carried, states=1, fastest=_decay_rate),
    ),
    # A coefficient below zero would be memory of the water, `added_mass_memory`, with another linear drag.
    replace(
        EFFECT,
        form="turning",
        title="sway that follows the turn, not logged",
        parameters=(
            replace(_DRIFT, unit="N m s/rad", low=0.0, high=6.0, initial_values=(0.1, 0.5), scale="torque/rate"),
            # Sway and yaw of a hull decay within a factor of a few (Fossen 2011); a longer memory would be a tether.
            replace(_DECAY, high=6.0, initial_values=(0.3, 2.0)),
        ),
        equation="− N·w, τ·dw/dt = r − w, w the sway by the turn, in place of a logged v",
        fingerprint="residual torque that follows the rate with a lag and opposes it",
        experiment="the sway in the log; a turn of several time constants, and then none",
        rivals=("tether_torsion", "added_mass_memory", "entrained_swirl"),
        needs=(),
        acts=Term(_followed, states=1, fastest=_decay_rate, unknown_start=_unknown_start),
    ),
    replace(
        EFFECT,
        form="creep",
        title="Munk moment of a vehicle that creeps ahead as it turns",
        parameters=(
            replace(_DRIFT, unit="1/(N m s^2)", initial_values=(0.03, -0.03), scale="one/torque/time/time"),
            replace(_DECAY, low=0.1, high=20.0, initial_values=(3.0,)),
        ),
        equation="− N·u·v, du/dt = |T| + r·v − u/τ, dv/dt = − r·u − v/τ: T drives ahead too, in place of logged speeds",
        fingerprint="residual torque at the onset of a turn that grows with the cube of the rate and fades in the turn",
        experiment="the speeds in the log; turns on the spot, each from rest",
        rivals=("added_mass_memory", "entrained_swirl", "drag_curvature"),
        needs=(),
        replaces=SPEEDS,
        acts=Term(_crept, states=2, fastest=_decay_rate),
    ),
    # Added mass that couples sway and yaw, and the centre of mass ahead of the origin.
    replace(
        EFFECT,
        form="acceleration",
        title="torque of sideways acceleration",
        parameters=(replace(_DRIFT, name="mass", unit="kg m", scale="impulse/sway"),),
        equation="− m·dv/dt, v the logged speed to starboard; m the added mass of sway and yaw and the centre's offset",
        fingerprint="residual torque in proportion to the sideways acceleration",
        experiment="sudden sideways thrusts without turning, in both directions",
        rivals=("added_mass_memory", "entrained_swirl"),
        acts=OnTorque(_accelerated),
    ),
    replace(EFFECT, form="both", parameters=(_DRIFT, _MUNK), equation="− N·v − m·u·v", needs=SPEEDS, acts=Term(_both)),
)
