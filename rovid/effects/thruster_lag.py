"""Thrust that follows the command late: filters and currents, or a rotor that has to spin up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_dynamics import lagged, rotor_lagged
from rovid.effects.base import ActuatorInputs, Effect, EffectParameter, OnCommand, OnThrust, OnTorque, Values


def _of_torque(where: ActuatorInputs, torque: FloatArray, values: Values) -> FloatArray:
    return where.apply_per_trial(lagged, torque, values["time_constant"])


def _of_command(where: ActuatorInputs, command: FloatArray, values: Values) -> FloatArray:
    return where.apply_per_trial(lagged, command, values["time_constant"])


def _doubled(where: ActuatorInputs, command: FloatArray, values: Values) -> FloatArray:
    return _of_command(where, _of_command(where, command, values), values)


def _of_spin(where: ActuatorInputs, thrust: FloatArray, values: Values) -> FloatArray:
    late = where.apply_per_trial(lagged, np.sign(thrust) * np.sqrt(np.abs(thrust)), values["time_constant"])
    return np.asarray(late * np.abs(late))


def _of_rotor(where: ActuatorInputs, thrust: FloatArray, values: Values) -> FloatArray:
    late = where.apply_per_trial(rotor_lagged, thrust / where.reference_thrust, values["time_constant"])
    return np.asarray(late * where.reference_thrust)


def _fades(values: Values, _: float) -> float:
    """Until less than a hundredth of a change is left."""
    return 5.0 * values["time_constant"]


EFFECT: Effect = Effect(
    id="thruster_lag",
    title="thruster lag",
    parameters=(
        EffectParameter(name="time_constant", unit="s", neutral=0.0, low=0.0, high=30.0, initial_values=(0.1, 0.8)),
    ),
    equation="τ·dT'/dt + T' = T",
    fingerprint="residual torque at the edges of steps and ahead of the peaks of a sine, none in steady motion",
    experiment="a fast pseudo-random command, 1 to 3 s a level",
    rivals=("command_delay", "added_mass_memory", "slew_limit"),
    acts=OnTorque(_of_torque, settling_time=_fades),
)
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(
        EFFECT,
        form="command",
        equation="τ·du'/dt + u' = u, ahead of the thrust curve",
        acts=OnCommand(_of_command, settling_time=_fades),
    ),
    replace(
        EFFECT,
        form="spin",
        equation="τ·dn/dt + n = sign(F)·√|F|, F' = n·|n|: the rotor's speed, as a motor's controller has it follow",
        acts=OnThrust(_of_spin, settling_time=_fades),
    ),
    # A rotor behind a motor or a controller of its own: no thrust at once, as of one lag.
    replace(
        EFFECT,
        form="double",
        equation="τ²·d²u'/dt² + 2τ·du'/dt + u' = u, ahead of the thrust curve",
        acts=OnCommand(_doubled, settling_time=lambda values, change: 2.0 * _fades(values, change)),
    ),
    # Yoerger, Cooke and Slotine 1990: n' = β·u − α·n|n|, F = C·n|n|.
    replace(
        EFFECT,
        form="rotor",
        equation="2τ·√F0·dn/dt + n|n| = F, F' = n|n|: τ at a tenth of full thrust F0, longer at less",
        acts=OnThrust(_of_rotor, settling_time=_fades),
    ),
)
