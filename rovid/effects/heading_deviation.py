"""Deviation of a compass: an error of the measured heading that depends on the heading."""

import math
from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.base import Effect, EffectParameter, OnHeading, Values, canonical_phases


def _once(heading: FloatArray, values: Values) -> FloatArray:
    return np.asarray(values["amplitude"] * np.sin(heading + values["phase"]))


def _twice(heading: FloatArray, values: Values) -> FloatArray:
    return np.asarray(values["amplitude"] * np.sin(2.0 * heading + values["phase"]))


def _mixed(heading: FloatArray, values: Values) -> FloatArray:
    second = values["second_amplitude"] * np.sin(2.0 * heading + values["second_phase"])
    return np.asarray(_once(heading, values) + second)


def _thrice(heading: FloatArray, values: Values) -> FloatArray:
    third = values["third_amplitude"] * np.sin(3.0 * heading + values["third_phase"])
    return np.asarray(_mixed(heading, values) + third)


# rad; largest amplitudes, of an uncorrected compass near steel. With both the measured heading is still monotonic.
_MAX, _MAX_SECOND = 0.4, 0.25


def _pair(
    prefix: str, amplitude: float, phases: tuple[float, ...], limit: float = _MAX
) -> tuple[EffectParameter, EffectParameter]:
    return (
        EffectParameter(name=f"{prefix}amplitude", unit="rad", low=-limit, high=limit, initial_values=(amplitude,)),
        EffectParameter(name=f"{prefix}phase", unit="rad", low=-6.3, high=6.3, initial_values=phases),
    )


_FIRST = _pair("", 0.01, (0.0, math.pi / 2.0))

EFFECT: Effect = Effect(
    id="heading_deviation",
    axes=("yaw",),
    title="deviation of the heading",
    parameters=_FIRST,
    equation="ψ measured = ψ + a·sin(ψ + φ)",
    fingerprint="a ripple of the rate that repeats with every turn, in proportion to the rate and not to the torque",
    experiment="full turns at two rates, both ways, with a gyro in the log",
    rivals=("heading_dependent_torque",),
    acts=OnHeading(_once),
    canonical=canonical_phases,
)
# The deviation of a magnetic compass: terms B to E of the handbook of compass adjustment (NGA).
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(EFFECT, form="two_cycles", equation="ψ measured = ψ + a·sin(2ψ + φ)", acts=OnHeading(_twice)),
    replace(
        EFFECT,
        form="mixed",
        # All combinations of the two phases.
        parameters=_pair("", 0.01, (0.0, 1.57, 0.0, 1.57))
        + _pair("second_", 0.005, (0.0, 0.0, 1.57, 1.57), _MAX_SECOND),
        equation="ψ measured = ψ + a·sin(ψ + φ) + a2·sin(2ψ + φ2)",
        acts=OnHeading(_mixed),
    ),
    # Strong iron and needles near it also give sextantal terms.
    replace(
        EFFECT,
        form="three_cycles",
        parameters=_pair("", 0.01, (0.0, 1.57, 0.0, 1.57, 0.0, 1.57, 0.0, 1.57), 0.3)
        + _pair("second_", 0.005, (0.0, 0.0, 1.57, 1.57, 0.0, 0.0, 1.57, 1.57), 0.15)
        + _pair("third_", 0.005, (0.0, 0.0, 0.0, 0.0, 1.57, 1.57, 1.57, 1.57), 0.1),
        equation="ψ measured = ψ + a·sin(ψ + φ) + a2·sin(2ψ + φ2) + a3·sin(3ψ + φ3)",
        acts=OnHeading(_thrice),
    ),
)
