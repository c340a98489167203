"""Cross-flow drag along the hull, whose sides move at different speeds in a turn."""

import math
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


@compiled
def ship_forces(u: float, v: float, r: float, p: Numbers) -> tuple[float, float, float]:
    """Forces of third order in drift and turn of a full hull that moves ahead, with l = ``p[1]`` m.

    Source: Yasukawa and Yoshimura 2015, equation 8; the numbers are rounded ones between those of its tanker, table 3,
    and the regressions of Yoshimura and Masumoto 2012 for block coefficients of 0.8. They are derivatives by v/V and
    r l/V in units of half the density times d l V^2: ``p[0]`` is half the density times the draught d.
    """
    speed, rate = math.sqrt(u * u + v * v), r * p[1]
    if not speed > 0.0:
        return 0.0, 0.0, 0.0
    unit = p[0] * p[1] / speed
    side = (-1.5 * v * v + 0.4 * v * rate - 0.38 * rate * rate) * v
    turning = (-0.03 * v * v - 0.33 * v * rate + 0.07 * rate * rate) * v - 0.015 * rate * rate * rate
    return unit * 0.7 * v * v * v * v / speed, unit * side, unit * p[1] * turning


EFFECT: Effect = Effect(
    id="cross_flow_drag",
    axes=("planar",),
    title="cross-flow drag along the hull",
    parameters=(
        EffectParameter(
            name="coefficient", unit="N s^2/m^3", high=20.0, initial_values=(0.3,), scale="sway_force/sway/sway"
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
                name="centre", unit="m", low=-10.0, high=10.0, initial_values=(0.2, -0.2), scale="sway/rate"
            ),
        ),
        equation="Y − c·(∫|w|·w dx − l·|v|·v), N − c·(∫x·|w|·w dx − |r|·r·∫|x|³ dx), w = v + x·r, "
        "x from a − l/2 to a + l/2",
        fingerprint="as of the plain form, and a torque in a pure drift",
        acts=Coupling(off_centre_forces),
    ),
    replace(
        EFFECT,
        form="ship",
        equation="X + 0.7·c·l·v⁴/V², Y − c·l·(1.5·v² − 0.4·v·q + 0.38·q²)·v/V, "
        "N − c·l²·(0.03·v³ + 0.33·v²·q − 0.07·v·q² + 0.015·q³)/V, q = r·l, V = √(u² + v²)",
        fingerprint="as of the plain form, of third order: next to nothing at small drift, large in a tight turn",
        experiment="turning circles with large rudder angles, next to zigzags with small ones",
        acts=Coupling(ship_forces),
    ),
)
