"""Restoring torque and net buoyancy, part of the base model of some axes, and the effect of another restoring curve."""

import math

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.base import Effect, EffectParameter, Instant, Numbers, Term, compiled


@compiled
def _term(at: Instant, p: Numbers) -> float:
    tilt = at.angle + at.start - at.body.trim
    return -at.body.stiffness * p[0] * tilt * tilt * math.sin(tilt)


EFFECT: Effect = Effect(
    id="restoring_curve",
    axes=("roll", "pitch"),
    title="bent restoring torque",
    parameters=(EffectParameter(name="cubic", unit="1/rad^2", low=-5.0, high=20.0, initial_values=(1.0, -1.0)),),
    equation="K·(sin x + c·x²·sin x) in place of K·sin x, x = θ − θ0",
    fingerprint="residual torque in proportion to the cube of the tilt; a period that changes while a swing decays",
    experiment="releases from a large and from a small tilt",
    rivals=("drag_curvature", "oscillatory_drag"),
    acts=Term(_term),
)
FORMS: tuple[Effect, ...] = (EFFECT,)


@compiled
def _lift(at: Instant, p: Numbers) -> float:
    return -p[0]


@compiled
def _righting(at: Instant, p: Numbers) -> float:
    return -p[0] * math.sin(at.angle + at.start - p[1])


# Fossen 2011, eq. 4.6: (W - B) along z, and z_G W sin(theta) about y, where buoyancy acts at the origin.
LIFT: Effect = Effect(
    id="buoyancy",
    title="net buoyancy",
    parameters=(
        EffectParameter(name="net_buoyancy", unit="N m", low=-3.0, high=3.0, initial_values=(0.01,), scale="torque"),
    ),
    equation="− B",
    fingerprint="a constant force",
    experiment="holds up and down",
    acts=Term(_lift),
)
RIGHTING: Effect = Effect(
    id="restoring",
    title="restoring torque",
    parameters=(
        EffectParameter(name="restoring_stiffness", unit="N m/rad", high=1e3, initial_values=(1.0,), scale="torque"),
        EffectParameter(name="trim", unit="rad", low=-1.0, high=1.0, initial_values=(0.0,)),
    ),
    equation="− K·sin(θ − θ0)",
    fingerprint="a tilt in proportion to the torque",
    experiment="holds both ways and a release",
    acts=Term(_righting),
)


def regressors(restoring: Effect | None, position: FloatArray) -> FloatArray:
    """(n, k) regressors of ``restoring`` at (n,) positions: it is linear in k coefficients."""
    if restoring is None:
        return np.empty((len(position), 0))
    if restoring is LIFT:
        return np.ones((len(position), 1))
    return np.column_stack((np.sin(position), np.cos(position)))


def from_regressors(restoring: Effect | None, coefficients: FloatArray) -> FloatArray:
    """(k,) parameters of ``restoring`` for the (k,) coefficients of its regressors."""
    if restoring is not RIGHTING:
        return coefficients
    # K sin(theta - theta0) = (K cos theta0) sin theta - (K sin theta0) cos theta
    return np.array([math.hypot(*coefficients), math.atan2(-coefficients[1], coefficients[0])])
