"""A torque that depends on the heading, by a current or a side pull of the tether."""

import math
from dataclasses import replace

from rovid.effects.base import Effect, EffectParameter, Instant, Numbers, Term, canonical_phases, compiled


@compiled
def _once(at: Instant, p: Numbers) -> float:
    return p[0] * math.sin(at.angle + at.start + p[1])


@compiled
def _twice(at: Instant, p: Numbers) -> float:
    return p[0] * math.sin(2.0 * (at.angle + at.start) + p[1])


@compiled
def _mixed(at: Instant, p: Numbers) -> float:
    heading = at.angle + at.start
    return p[0] * math.sin(heading + p[1]) + p[2] * math.sin(2.0 * heading + p[3])


def _pair(prefix: str, phases: tuple[float, ...]) -> tuple[EffectParameter, EffectParameter]:
    return (
        EffectParameter(
            name=f"{prefix}amplitude", unit="N m", low=-2.0, high=2.0, initial_values=(0.03,), scale="torque"
        ),
        EffectParameter(name=f"{prefix}phase", unit="rad", low=-6.3, high=6.3, initial_values=phases),
    )


_FIRST = _pair("", (0.0, 1.57))

EFFECT: Effect = Effect(
    id="heading_dependent_torque",
    environmental=True,
    axes=("yaw",),
    title="torque that depends on heading",
    parameters=_FIRST,
    equation="+ a·sin(ψ + φ)",
    fingerprint="a residual torque that repeats with every turn",
    experiment="slow full turns, both ways, from different headings",
    rivals=("bias_torque", "tether_torsion", "heading_deviation"),
    acts=Term(_once),
    canonical=canonical_phases,
)
# A tether pulls once in each turn, a current on a long body twice (Munk moment).
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(EFFECT, form="two_cycles", equation="+ a·sin(2ψ + φ)", acts=Term(_twice)),
    replace(
        EFFECT,
        form="mixed",
        # All combinations of the two phases.
        parameters=_pair("", (0.0, 1.57, 0.0, 1.57)) + _pair("second_", (0.0, 0.0, 1.57, 1.57)),
        equation="+ a·sin(ψ + φ) + a2·sin(2ψ + φ2)",
        acts=Term(_mixed),
    ),
)
