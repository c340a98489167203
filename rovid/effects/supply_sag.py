"""Thrust that falls with the load on the supply."""

from __future__ import annotations

import numpy as np

from rovid.effects.base import Actuation, Effect, EffectParameter, Values
from rovid.effects.series import lagged
from rovid.trial import FloatArray


def _on_thrust(where: Actuation, thrust: FloatArray, values: Values) -> FloatArray:
    load = np.abs(thrust).sum(axis=1) / float(where.full_thrust.sum())
    drop = values["sag"] * lagged(where.time, load, values["time_constant"])
    return np.asarray(thrust * np.maximum(1.0 - drop, 0.0)[:, None])


EFFECT: Effect = Effect(
    id="supply_sag",
    title="supply sag",
    parameters=(
        EffectParameter(name="sag", unit="1", null=0.0, low=0.0, high=3.0, starts=(0.2,)),
        EffectParameter(name="time_constant", unit="s", null=0.0, low=0.0, high=200.0, starts=(1.0, 20.0)),
    ),
    equation="T' = T·(1 − s·load), the load as a share of full thrust, behind a first-order lag",
    fingerprint="residual torque as −T·|T|, growing during long hard runs",
    experiment="the supply's voltage in the log; one level with other thrusters loaded and idle",
    rivals=("drag_curvature", "thrust_curve_shape", "thruster_deadband"),
    on_thrust=_on_thrust,
)
