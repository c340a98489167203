"""Damping that couples sway and yaw: the drag of the hull acts ahead or astern of the origin."""

from dataclasses import replace

from rovid.effects.base import Coupling, Effect, EffectParameter, Numbers, compiled


@compiled
def linear_forces(u: float, v: float, r: float, p: Numbers) -> tuple[float, float, float]:
    """Linear damping off the diagonal, N_v and Y_r (Fossen 2011, equation 6.71)."""
    return 0.0, -p[1] * r, -p[0] * v


@compiled
def lift_forces(u: float, v: float, r: float, p: Numbers) -> tuple[float, float, float]:
    """Lift of hull and fins, in proportion to the speed ahead (Fossen 2011, section 6.4.2)."""
    return 0.0, -p[1] * abs(u) * r, -p[0] * abs(u) * v


_YAW = EffectParameter(
    name="yaw_by_sway", unit="N s", low=-20.0, high=20.0, initial_values=(0.05, -0.05), scale="torque/sway"
)
_SWAY = replace(_YAW, name="sway_by_yaw", scale="sway_force/rate")

EFFECT: Effect = Effect(
    id="sway_yaw_damping",
    axes=("planar",),
    title="damping that couples sway and yaw",
    parameters=(_YAW, _SWAY),
    size_count=2,
    equation="N − a·v, Y − b·r: a = −N_v, b = −Y_r; v and r through the water",
    fingerprint="residual torque in proportion to the sway, and residual side force in proportion to the yaw rate",
    experiment="turns on the spot, and sideways runs without a turn, in both directions",
    rivals=("cross_flow_drag", "sideslip_moment"),
    acts=Coupling(linear_forces),
)
FORMS: tuple[Effect, ...] = ()
PLANAR_FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(
        EFFECT,
        form="lift",
        parameters=(
            replace(_YAW, unit="kg", scale="torque/surge/sway"),
            replace(_SWAY, unit="kg", scale="sway_force/surge/rate"),
        ),
        equation="N − a·|u|·v, Y − b·|u|·r: a = −N_uv, b = −Y_ur beyond the Munk moment and the Coriolis force",
        fingerprint="as of the plain form, in proportion to the speed ahead",
        experiment="turns and zigzags at several speeds ahead, and turns on the spot",
        acts=Coupling(lift_forces),
    ),
)
