"""Torsion of a tether that winds up."""

import math
from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.base import Effect, EffectParameter, Instant, Numbers, Term, compiled, maximum, where_nonnegative


@compiled
def _linear(at: Instant, p: Numbers) -> float:
    return -p[0] * at.angle


@compiled
def _stiffening(at: Instant, p: Numbers) -> float:
    share = at.angle / p[1]
    return -p[0] * at.angle * (1.0 + share * share)


@compiled
def _wound(at: Instant, p: Numbers) -> float:
    return -p[0] * (at.angle + p[1])


@compiled
def _slack(at: Instant, p: Numbers) -> float:
    pull = p[0] * maximum(abs(at.angle) - p[1], 0.0)
    return where_nonnegative(at.angle, -pull, pull)


@compiled
def _rest(at: Instant, p: Numbers) -> float:
    # at.start is the heading at the start of the trial. The turns in the tether at that time are not logged.
    start = at.start - p[1]
    return -p[0] * (at.angle + start - 2.0 * math.pi * math.floor(start / (2.0 * math.pi) + 0.5))


def _within_a_turn(numbers: FloatArray) -> FloatArray:
    stiffness, heading = numbers
    return np.array([stiffness, math.remainder(heading, 2.0 * math.pi)])


_STIFFNESS = EffectParameter(name="stiffness", unit="N m/rad", high=1.0, initial_values=(0.004, 0.04), scale="torque")

EFFECT: Effect = Effect(
    id="tether_torsion",
    environmental=True,
    axes=("yaw",),
    title="tether torsion",
    parameters=(_STIFFNESS,),
    equation="− k·(ψ − ψ at the start of the trial)",
    fingerprint="residual torque in proportion to the angle turned; recoil after a stop",
    experiment="six turns in one direction, rest, six turns back",
    rivals=("entrained_swirl", "bias_torque"),
    acts=Term(_linear),
)
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(
        EFFECT,
        form="stiffening",
        parameters=(
            _STIFFNESS,
            EffectParameter(name="angle", unit="rad", neutral=10.0, low=0.5, high=200.0, initial_values=(6.0, 25.0)),
        ),
        equation="− k·x·(1 + (x/x0)²), x turned since the start of the trial",
        acts=Term(_stiffening),
    ),
    replace(
        EFFECT,
        form="slack",
        parameters=(
            replace(_STIFFNESS, high=10.0, initial_values=(0.04, 0.04, 0.1, 0.1)),
            EffectParameter(name="slack", unit="rad", high=40.0, initial_values=(0.5, 1.2, 2.8, 7.0)),
        ),
        equation="− k·(|x| − s)·sign(x) where |x| > s, x turned since the start of the trial",
        acts=Term(_slack),
    ),
    replace(
        EFFECT,
        form="rest",
        parameters=(
            _STIFFNESS,
            EffectParameter(
                name="heading", unit="rad", low=-9.5, high=9.5, initial_values=(0.0, 0.9, 1.8, 2.7, -0.9, -1.8, -2.7)
            ),
        ),
        equation="− k·(ψ − ψ0), within half a turn of ψ0 at the start of the trial",
        acts=Term(_rest),
        canonical=_within_a_turn,
    ),
    replace(
        EFFECT,
        form="wound",
        parameters=(
            _STIFFNESS,
            EffectParameter(name="wound", unit="rad", low=-40.0, high=40.0, initial_values=(3.0, -3.0)),
        ),
        equation="− k·(w + ψ − ψ at the start of the trial), wound by w before each trial",
        acts=Term(_wound),
    ),
)
