"""Cross-flow drag along the hull, whose sides move at different speeds in a turn."""

from __future__ import annotations

from rovid.effects.base import Coupling, Effect, EffectParameter, Numbers, compiled


@compiled
def strip_forces(u: float, v: float, r: float, p: Numbers) -> tuple[float, float, float]:
    """Strip integrals of c·|v + x·r|·(v + x·r) along the hull, less their values in pure sway and in pure yaw.

    The quadratic drags of sway and yaw contain these values. Source: Fossen 2011, equations 6.91 and 6.92.
    """
    half = 0.5 * p[1]
    bow, stern = v + half * r, v - half * r
    if bow * stern >= 0.0:
        # All strips move to the same side.
        sign = 1.0 if v >= 0.0 else -1.0
        side = sign * 2.0 * half * (v * v + r * r * half * half / 3.0)
        turning = sign * v * r * 4.0 * half**3 / 3.0
    else:
        cubes = (abs(bow) ** 3 - abs(stern) ** 3) / 3.0
        side = cubes / r
        turning = ((abs(bow) * bow**3 - abs(stern) * stern**3) / 4.0 - v * cubes) / (r * r)
    side = side - 2.0 * half * abs(v) * v
    turning = turning - 0.5 * half**4 * abs(r) * r
    return 0.0, -p[0] * side, -p[0] * turning


EFFECT: Effect = Effect(
    id="cross_flow_drag",
    axes=("planar",),
    title="cross-flow drag along the hull",
    parameters=(
        EffectParameter(
            name="coefficient",
            unit="N s^2/m^3",
            neutral=0.0,
            low=0.0,
            high=20.0,
            initial_values=(0.3,),
            scale="sway_force/sway/sway",
        ),
        EffectParameter(
            name="length", unit="m", neutral=1.0, low=0.02, high=50.0, initial_values=(1.5,), scale="sway/rate"
        ),
    ),
    equation="Y − c·(∫|w|·w dx − l·|v|·v), N − c·(∫x·|w|·w dx − l⁴/32·|r|·r), w = v + x·r, x from −l/2 to l/2",
    fingerprint="more side force in a turn than in a straight drift, and a torque in proportion to v·r",
    experiment="turns with sideways speed, sideways runs and turns on the spot at equal speeds of the bow",
    rivals=("sway_yaw_damping", "speed_dependent_damping"),
    acts=Coupling(strip_forces),
)
FORMS: tuple[Effect, ...] = ()
PLANAR_FORMS: tuple[Effect, ...] = (EFFECT,)
