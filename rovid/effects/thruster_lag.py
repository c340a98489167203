"""Thrust that lags the command, by filters and currents or by a rotor that has to spin up."""

from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_dynamics import lagged, lagged_in_series, lagged_unequally, rotor_lagged
from rovid.effects.base import ActuatorInputs, Effect, EffectParameter, OnCommand, OnThrust, OnTorque, Values


def _lagged(inputs: ActuatorInputs, series: FloatArray, values: Values) -> FloatArray:
    return inputs.apply_per_trial(lagged, series, values["time_constant"])


def _lagged_in_series(inputs: ActuatorInputs, torque: FloatArray, values: Values) -> FloatArray:
    first = values["time_constant"]
    return inputs.apply_per_trial(lagged_in_series, torque, first, values["ratio"] * first)


def _twice_lagged(inputs: ActuatorInputs, command: FloatArray, values: Values) -> FloatArray:
    return _lagged(inputs, _lagged(inputs, command, values), values)


def _unequally(inputs: ActuatorInputs, command: FloatArray, values: Values) -> FloatArray:
    return np.asarray(_unequally_of_thrust(inputs, command - inputs.neutral, values) + inputs.neutral)


def _unequally_of_thrust(inputs: ActuatorInputs, thrust: FloatArray, values: Values) -> FloatArray:
    return inputs.apply_per_trial(lagged_unequally, thrust, values["time_constant"], values["falling"])


def _lagged_speed(inputs: ActuatorInputs, thrust: FloatArray, values: Values) -> FloatArray:
    late = inputs.apply_per_trial(lagged, np.sign(thrust) * np.sqrt(np.abs(thrust)), values["time_constant"])
    return np.asarray(late * np.abs(late))


def _rotor(inputs: ActuatorInputs, thrust: FloatArray, values: Values) -> FloatArray:
    late = inputs.apply_per_trial(rotor_lagged, thrust / inputs.reference_thrust, values["time_constant"])
    return np.asarray(late * inputs.reference_thrust)


def _unequally_settled(values: Values, _: float) -> float:
    return 5.0 * max(values["time_constant"], values["falling"])


def _settled(values: Values, _: float) -> float:
    """Time until less than a hundredth of a change is left."""
    return 5.0 * values["time_constant"]


EFFECT: Effect = Effect(
    id="thruster_lag",
    title="thruster lag",
    parameters=(
        EffectParameter(name="time_constant", unit="s", high=30.0, initial_values=(0.02, 0.15, 1.0), scale="time"),
    ),
    equation="τ·dT'/dt + T' = T",
    fingerprint="residual torque at the edges of steps and ahead of the peaks of a sine, none in steady motion",
    experiment="a fast pseudo-random command, 1 to 3 s a level",
    rivals=("command_delay", "added_mass_memory", "slew_limit"),
    acts=OnTorque(_lagged, settling_time=_settled),
)
_UNEQUAL = (
    replace(EFFECT.parameters[0], initial_values=(0.1, 0.4, 0.1)),
    replace(EFFECT.parameters[0], name="falling", initial_values=(0.2, 0.1, 1.0)),
)
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(
        EFFECT,
        form="command",
        equation="τ·du'/dt + u' = u, ahead of the thrust curve",
        acts=OnCommand(_lagged, settling_time=_settled),
    ),
    replace(
        EFFECT,
        form="spin",
        equation="τ·dn/dt + n = sign(F)·√|F|, F' = n·|n|: rotor with a speed controller",
        acts=OnThrust(_lagged_speed, settling_time=_settled),
    ),
    replace(
        EFFECT,
        form="unequal",
        parameters=_UNEQUAL,
        equation="τ·du'/dt + u' = u where |u| > |u'|, elsewhere with τ2: a motor slows down with another lag",
        acts=OnCommand(_unequally, settling_time=_unequally_settled),
    ),
    replace(
        EFFECT,
        form="unequal_thrust",
        parameters=_UNEQUAL,
        equation="τ·dF'/dt + F' = F where |F| > |F'|, elsewhere with τ2: thrust falls with another lag than it grows",
        acts=OnThrust(_unequally_of_thrust, settling_time=_unequally_settled),
    ),
    # A rotor after a motor or a controller with its own lag.
    replace(
        EFFECT,
        form="double",
        equation="τ²·d²u'/dt² + 2τ·du'/dt + u' = u, ahead of the thrust curve",
        acts=OnCommand(_twice_lagged, settling_time=lambda values, change: 2.0 * _settled(values, change)),
    ),
    replace(
        EFFECT,
        form="series",
        parameters=(
            replace(EFFECT.parameters[0], initial_values=(0.1, 0.4, 1.0)),
            # The two lags can change places: a ratio of 2 is that of 1/2.
            EffectParameter(name="ratio", unit="1", high=2.0, initial_values=(0.4,)),
        ),
        equation="two lags of the thrust in series, τ and a·τ",
        acts=OnTorque(
            _lagged_in_series, settling_time=lambda values, change: (1.0 + values["ratio"]) * _settled(values, change)
        ),
    ),
    # Yoerger, Cooke and Slotine 1990: n' = β·u − α·n|n|, F = C·n|n|.
    replace(
        EFFECT,
        form="rotor",
        equation="2τ·√F0·dn/dt + n|n| = F, F' = n|n|: τ at a tenth of full thrust F0, slower at smaller thrust",
        acts=OnThrust(_rotor, settling_time=_settled),
    ),
)
# Of rudders and azimuth thrusters: their gear is slow, the thrust is not.
ANGLE_FORMS: tuple[Effect, ...] = (
    replace(
        EFFECT,
        form="angle",
        title="lag of the angle",
        axes=("planar", "yaw"),
        equation="τ·dδ'/dt + δ' = δ, δ the angle of each rudder and azimuth thruster",
        acts=OnCommand(_lagged, settling_time=_settled, of_angles=True),
    ),
)
