"""A constant torque in the body frame."""

from collections.abc import Sequence
from dataclasses import replace

from rovid.core.array_types import FloatArray
from rovid.effects import further_terms
from rovid.effects.base import (
    ActuatorInputs,
    Coupling,
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
def _term(at: Instant, p: Numbers) -> float:
    return p[0]


@compiled
def planar_forces(u: float, v: float, r: float, p: Numbers) -> tuple[float, float, float]:
    """Constant forces ahead and to starboard, and a constant torque."""
    return p[0], p[1], p[2]


EFFECT: Effect = Effect(
    id="bias_torque",
    environmental=True,
    axes=("yaw", "surge", "sway"),
    title="constant torque",
    parameters=(
        EffectParameter(name="torque", unit="N m", low=-1.0, high=1.0, initial_values=(0.02, -0.02), scale="torque"),
    ),
    equation="+ b",
    fingerprint="slow rotation without command; one direction faster than the other by a constant torque",
    experiment="a coast-down to rest from each direction",
    rivals=("thrust_asymmetry", "drag_asymmetry", "heading_dependent_torque"),
    acts=Term(_term),
)
FORMS: tuple[Effect, ...] = (EFFECT,)
_TORQUE = EFFECT.parameters[0]
PLANAR_FORMS: tuple[Effect, ...] = (
    replace(
        EFFECT,
        form="planar",
        title="constant forces",
        axes=("planar",),
        parameters=(
            replace(_TORQUE, name="surge", unit="N", scale="surge_force"),
            replace(_TORQUE, name="sway", unit="N", scale="sway_force"),
            replace(_TORQUE, name="yaw"),
        ),
        size_count=3,
        equation="X + b_x, Y + b_y, N + b_n",
        fingerprint="slow drift and rotation without command, in body axes",
        rivals=("current", "thrust_asymmetry"),
        acts=Coupling(planar_forces),
    ),
)


def for_trials(names: Sequence[str]) -> Effect:
    """The form with another torque in each of these trials, as by a tether or a current."""
    torques = further_terms.one_size_per_trial(EFFECT.parameters[0], len(names), 0.02)

    def in_trials(inputs: ActuatorInputs, torque: FloatArray, values: Values) -> FloatArray:
        return torque + further_terms.held_sizes(inputs, names, [values[one.name] for one in torques], 0.0)

    return replace(
        EFFECT,
        form=further_terms.form_name(names),
        title="different constant torque in each trial",
        parameters=torques,
        size_count=len(torques),
        equation=f"+ b, a separate b for each trial: {', '.join(names)}",
        fingerprint="slow rotation without command, different in each log",
        experiment="a coast-down to rest from each direction in every run; notes on the tether's lead and the current",
        rivals=("heading_dependent_torque", "tether_torsion"),
        acts=OnTorque(in_trials),
    )
