"""Commands whose stamps are late: no cause, but a fault of the logs that a cause may imitate.

The clocks of joined files may differ, and a logger may write a command at the end of the interval in which it acted. A
clock that is ahead looks the same as a command delay, which covers that sign.
"""

import math

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.base import ActuatorInputs, Effect, EffectParameter, OnTorque, Values


def mean_shifted(time: FloatArray, values: FloatArray, delay: float) -> FloatArray:
    """Means between (n,) times of the held ``values`` after a ``delay`` of either sign in s."""
    ends = np.append(time, time[-1] + 1.0)
    integral = np.concatenate(([0.0], np.cumsum(values * np.diff(ends))))
    at = ends - delay
    # The first and the last value are held outside.
    before, after = np.minimum(at - ends[0], 0.0), np.maximum(at - ends[-1], 0.0)
    moved = np.interp(at, ends, integral) + before * values[0] + after * values[-1]
    width = np.diff(ends)
    return np.where(width > 0.0, np.diff(moved) / np.where(width > 0.0, width, 1.0), values)


def _advanced(inputs: ActuatorInputs, torque: FloatArray, values: Values) -> FloatArray:
    out = torque.copy()
    for trial in inputs.trials:
        out[trial.rows] = mean_shifted(inputs.time[trial.rows], torque[trial.rows], -values["lead"])
    return out


CLOCKS_APART: Effect = Effect(
    id="clocks_apart",
    title="clock offset of the commands",
    parameters=(EffectParameter(name="lead", unit="s", high=30.0, initial_values=(0.02, 0.2, 1.0), scale="time"),),
    equation="T'(t) = T(t + δ)",
    fingerprint="the vehicle responds before its commands",
    experiment="the same run with commands and motion stamped by one clock",
    rivals=("command_delay", "thruster_lag", "added_mass_memory"),
    acts=OnTorque(_advanced, settling_time=lambda *_: math.inf),
)
