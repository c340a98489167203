"""Damping that grows with the speed ahead, by lift of hull, skegs and rudder."""

from dataclasses import replace

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_dynamics import speed_of_thrust
from rovid.effects.base import (
    SPEEDS,
    ActuatorInputs,
    Coupling,
    Effect,
    EffectParameter,
    Instant,
    Numbers,
    Term,
    Values,
    compiled,
)


@compiled
def _linear(at: Instant, p: Numbers) -> float:
    return -p[0] * abs(at.surge) * at.relative_rate


@compiled
def _quadratic(at: Instant, p: Numbers) -> float:
    return -p[0] * at.surge * at.surge * at.relative_rate


@compiled
def _both(at: Instant, p: Numbers) -> float:
    speed = abs(at.surge)
    return -(p[0] + p[1] * speed) * speed * at.relative_rate


@compiled
def coupled_forces(u: float, v: float, r: float, p: Numbers) -> tuple[float, float, float]:
    """Damping of yaw and of sway in proportion to the speed ahead."""
    return 0.0, -p[1] * abs(u) * v, -p[0] * abs(u) * r


@compiled
def coupled_quadratic_forces(u: float, v: float, r: float, p: Numbers) -> tuple[float, float, float]:
    """Damping of yaw and of sway in proportion to the square of the speed ahead."""
    return 0.0, -p[1] * u * u * v, -p[0] * u * u * r


def _surge_from_thrust(inputs: ActuatorInputs, thrust: FloatArray, values: Values) -> FloatArray:
    return speed_of_thrust(inputs, thrust, values["time_constant"])


_LINEAR = EffectParameter(
    name="linear", unit="N m s^2/(m rad)", high=10.0, initial_values=(0.1, 1.0), scale="torque/surge/rate"
)
_QUADRATIC = replace(_LINEAR, name="quadratic", unit="N m s^3/(m^2 rad)", scale="torque/surge/surge/rate")

EFFECT: Effect = Effect(
    id="speed_dependent_damping",
    axes=("yaw", "roll", "pitch"),
    title="damping that grows with speed",
    parameters=(_LINEAR,),
    equation="− N·|u|·r, u the logged speed ahead",
    fingerprint="residual torque against the rate, in proportion to the speed ahead; zero at zero speed",
    experiment="the same turns at several speeds ahead, and at zero speed",
    rivals=("advance_speed_loss", "drag_curvature", "supply_sag"),
    needs=SPEEDS[:1],
    acts=Term(_linear),
)
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(EFFECT, form="quadratic", parameters=(_QUADRATIC,), equation="− N2·u²·r", acts=Term(_quadratic)),
    replace(
        EFFECT,
        form="both",
        parameters=(_LINEAR, replace(_QUADRATIC, low=-10.0)),
        equation="− (N·|u| + N2·u²)·r",
        acts=Term(_both),
    ),
    replace(
        EFFECT,
        form="estimated",
        parameters=(
            replace(_LINEAR, unit="N^0.5 m s/rad", scale="torque/sqrt_thrust/rate"),
            EffectParameter(name="time_constant", unit="s", high=100.0, initial_values=(0.7, 4.0), scale="time"),
        ),
        equation="− N·|s|·r, τ·ds/dt = sign(F)·√|F| − s, F the thrust ahead: in place of a speed that is not logged",
        experiment="the speed ahead in the log; the same turns with large thrust ahead and without it",
        needs=(),
        acts=Term(_linear, surge_from_thrust=_surge_from_thrust),
    ),
)
# Of the planar model, whose speed ahead is a state.
_PLANAR = replace(
    EFFECT,
    form="planar",
    axes=("planar",),
    parameters=(
        replace(_LINEAR, name="yaw"),
        replace(_LINEAR, name="sway", unit="N s^2/m^2", scale="sway_force/surge/sway"),
    ),
    size_count=2,
    equation="N − a·|u|·r, Y − b·|u|·v",
    fingerprint="residual torque and side force in proportion to the speed ahead; zero at zero speed",
    needs=(),
    acts=Coupling(coupled_forces),
)
PLANAR_FORMS: tuple[Effect, ...] = (
    _PLANAR,
    replace(
        _PLANAR,
        form="planar_quadratic",
        parameters=(
            replace(_QUADRATIC, name="yaw"),
            replace(_QUADRATIC, name="sway", unit="N s^3/m^3", scale="sway_force/surge/surge/sway"),
        ),
        equation="N − a·u²·r, Y − b·u²·v",
        acts=Coupling(coupled_quadratic_forces),
    ),
)
