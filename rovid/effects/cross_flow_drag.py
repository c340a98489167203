"""Cross-flow drag along the hull, whose sides move at different speeds in a turn."""

from dataclasses import replace

from rovid.effects.base import Coupling, Effect, EffectParameter, Numbers, compiled


@compiled
def _integrals(v: float, r: float, half: float) -> tuple[float, float]:
    """Integrals of |w|·w and x·|w|·w over x from -``half`` to ``half``, w = v + x·r."""
    bow, stern = v + half * r, v - half * r
    if bow * stern >= 0.0:
        # All strips move to the same side.
        sign = 1.0 if v >= 0.0 else -1.0
        return sign * 2.0 * half * (v * v + r * r * half * half / 3.0), sign * v * r * 4.0 * half**3 / 3.0
    cubes = (abs(bow) ** 3 - abs(stern) ** 3) / 3.0
    return cubes / r, ((abs(bow) * bow**3 - abs(stern) * stern**3) / 4.0 - v * cubes) / (r * r)


@compiled
def off_centre_forces(u: float, v: float, r: float, p: Numbers) -> tuple[float, float, float]:
    """Strip integrals of c·|v + x·r|·(v + x·r) along a hull with its middle at ``p[2]`` m ahead of the origin.

    Without the side force in pure sway and the torque in pure yaw, which the quadratic drags of the base model contain.
    Source: Fossen 2011, equations 6.91 and 6.92.
    """
    half, centre = 0.5 * p[1], p[2]
    side, turning = _integrals(v + centre * r, r, half)
    turning += centre * side
    bow, stern = centre + half, centre - half
    side -= 2.0 * half * abs(v) * v
    turning -= 0.25 * (abs(bow) * bow**3 - abs(stern) * stern**3) * abs(r) * r
    return 0.0, -p[0] * side, -p[0] * turning


@compiled
def strip_forces(u: float, v: float, r: float, p: Numbers) -> tuple[float, float, float]:
    """As `off_centre_forces`, with the origin in the middle of the hull."""
    half = 0.5 * p[1]
    side, turning = _integrals(v, r, half)
    side -= 2.0 * half * abs(v) * v
    turning -= 0.5 * half**4 * abs(r) * r
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
PLANAR_FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(
        EFFECT,
        form="off_centre",
        parameters=(
            *EFFECT.parameters,
            EffectParameter(
                name="centre",
                unit="m",
                neutral=0.0,
                low=-10.0,
                high=10.0,
                initial_values=(0.2, -0.2),
                scale="sway/rate",
            ),
        ),
        equation="Y − c·(∫|w|·w dx − l·|v|·v), N − c·(∫x·|w|·w dx − |r|·r·∫|x|³ dx), w = v + x·r, "
        "x from a − l/2 to a + l/2",
        fingerprint="as of the plain form, and a torque in a pure drift",
        acts=Coupling(off_centre_forces),
    ),
)
