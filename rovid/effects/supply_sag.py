"""Thrust that falls with the supply: with its load, over time, or with its voltage."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects import further_terms
from rovid.effects.actuator_dynamics import lagged
from rovid.effects.base import HOUR, INSTANT, ActuatorInputs, Effect, EffectParameter, OnThrust, Values

_CHANNEL = "supply_voltage"
# Ratios of a voltage to the reference are clipped to these: others are faults of the log.
_RATIOS = (0.3, 3.0)
# Bounds of the loss of thrust, as a share: at the largest load, or of the gain over time. A supply would trip before a
# larger loss. A gain, as by a battery that warms up, is small.
_MAX_LOSS, _MAX_GAIN = 0.6, -0.2
# Sag at full thrust, which may last for a shorter time than the supply takes to sag: half of this loss is reached then.
_MAX_SAG = 2.0
# Loss over a whole log, in which a battery may go flat.
_MAX_FADE = 0.95


def _with_load(inputs: ActuatorInputs, thrust: FloatArray, values: Values, power: float = 1.0) -> FloatArray:
    load = (np.abs(thrust) ** power).sum(axis=1) / float((inputs.full_thrust**power).sum())
    drop = values["sag"] * inputs.apply_per_trial(lagged, load, values["time_constant"])
    return np.asarray(thrust * np.maximum(1.0 - drop, 0.0)[:, None])


def _with_power(inputs: ActuatorInputs, thrust: FloatArray, values: Values) -> FloatArray:
    return _with_load(inputs, thrust, values, 1.5)


def _with_others(inputs: ActuatorInputs, thrust: FloatArray, values: Values) -> FloatArray:
    load = np.abs(thrust).sum(axis=1, keepdims=True) - np.abs(thrust)
    return np.asarray(thrust * np.maximum(1.0 - values["sag"] * load / float(inputs.full_thrust.sum()), 0.0))


def _from_instant(inputs: ActuatorInputs, thrust: FloatArray, values: Values) -> FloatArray:
    share = inputs.share_after(HOUR * values[INSTANT.name])
    return np.asarray(thrust * (1.0 - (1.0 - values["gain"]) * share)[:, None])


def _with_time(inputs: ActuatorInputs, thrust: FloatArray, values: Values) -> FloatArray:
    drop = values["drift"] * inputs.log_time / HOUR
    return np.asarray(thrust * np.maximum(1.0 - drop, 0.0)[:, None])


def _with_day(inputs: ActuatorInputs, thrust: FloatArray, values: Values) -> FloatArray:
    drop = values["drift"] * inputs.campaign_time / HOUR
    return np.asarray(thrust * np.maximum(1.0 - drop, 0.0)[:, None])


def _with_voltage(inputs: ActuatorInputs, thrust: FloatArray, values: Values) -> FloatArray:
    voltage = inputs.extras.get(_CHANNEL)
    if voltage is None or not np.isfinite(voltage).any():
        return thrust
    # Without a median of the campaign, the median of these trials.
    reference = inputs.reference.get(_CHANNEL, float(np.nanmedian(voltage)))
    if not reference > 0.0:
        return thrust
    ratio = np.clip(np.where(np.isfinite(voltage), voltage / reference, 1.0), *_RATIOS)
    return np.asarray(thrust * (ratio ** values["exponent"])[:, None])


_DRIFT = EffectParameter(
    name="drift", unit="1/h", low=_MAX_GAIN, high=_MAX_FADE, initial_values=(0.05,), scale="one/longest"
)
_GAIN = EffectParameter(name="gain", unit="1", neutral=1.0, low=0.3, high=2.0, initial_values=(0.9, 1.1))
# Rivals of thrust with another size in some trials.
_RIVALS_PER_TRIAL = ("thrust_asymmetry", "thruster_imbalance", "bias_torque")

EFFECT: Effect = Effect(
    id="supply_sag",
    environmental=True,
    title="supply sag",
    parameters=(
        # With 1, a load of 15 % of full thrust costs 15 % of the thrust.
        EffectParameter(name="sag", unit="1", high=_MAX_SAG, initial_values=(0.1,), scale="one/load"),
        EffectParameter(name="time_constant", unit="s", high=100.0, initial_values=(0.5, 8.0), scale="time"),
    ),
    equation="T' = T·(1 − s·load), the load as a share of full thrust, behind a first-order lag",
    fingerprint="residual torque in proportion to −T·|T|, growing during long runs at high load",
    experiment="the supply's voltage in the log; one level twice, with the other thrusters loaded and idle",
    rivals=("drag_curvature", "thrust_curve_shape", "thruster_deadband", "speed_dependent_damping"),
    acts=OnThrust(_with_load),
)
FORMS: tuple[Effect, ...] = (
    EFFECT,
    # Momentum theory: the power of a propeller grows with the thrust to the power of 3/2.
    replace(
        EFFECT,
        form="power",
        equation="T' = T·(1 − s·P), P the power Σ|F|^1.5 as a share of that at full thrust, behind a first-order lag",
        acts=OnThrust(_with_power),
    ),
    replace(
        EFFECT,
        form="others",
        title="thrust lost to the other thrusters",
        parameters=(replace(EFFECT.parameters[0], high=_MAX_LOSS),),
        equation="F' = F·(1 − s·load of the other thrusters, as a share of full thrust)",
        fingerprint="residual torque in proportion to −F·|F| of two thrusters that push together, none where one does",
        experiment="one level of each thruster, with the other thrusters loaded and idle",
        rivals=("thruster_imbalance", *EFFECT.rivals),
        acts=OnThrust(_with_others),
    ),
    replace(
        EFFECT,
        form="drift",
        parameters=(_DRIFT,),
        equation="T' = T·(1 − d·t), t since the log began",
        fingerprint="residual torque in proportion to −t·T: the same command has less effect later in a log",
        experiment="the same run at the start, in the middle and at the end; the supply's voltage in the log",
        acts=OnThrust(_with_time),
    ),
    replace(
        EFFECT,
        form="day",
        parameters=(replace(_DRIFT, scale="one/day"),),
        equation="T' = T·(1 − d·t), t since the first log began",
        fingerprint="residual torque in proportion to −t·T: the same command has less effect in later runs",
        experiment="the same run at the start, in the middle and at the end; the supply's voltage in the log",
        acts=OnThrust(_with_day),
    ),
    replace(
        EFFECT,
        form="instant",
        title="thrust that drops at an instant",
        parameters=(replace(_GAIN, initial_values=(0.9,)), INSTANT),
        equation="T' = g·T from the instant on, in h since the first log began",
        fingerprint="residual torque in proportion to T, in later logs only",
        experiment="the first runs again; the supply's voltage in the log",
        rivals=_RIVALS_PER_TRIAL,
        acts=OnThrust(_from_instant),
    ),
    replace(
        EFFECT,
        form="voltage",
        # 1.0 to 1.2 in bench data of a T200 at 10 to 20 V; 2 for a plain voltage chopper.
        parameters=(EffectParameter(name="exponent", unit="1", low=-3.0, high=5.0, initial_values=(1.0,)),),
        equation="T' = T·(V/V0)^p, V0 the median voltage",
        fingerprint="residual torque in proportion to T and to the change of the logged voltage",
        needs=(_CHANNEL,),
        acts=OnThrust(_with_voltage, anchored=True),
    ),
)


def for_trials(names: Sequence[str]) -> Effect:
    """The form for these trials: another thrust in one trial, as after a change of battery, or in each of several.

    The mean gain of several trials is one, as the logs do not determine a common scale of all thrust.
    """
    is_single = len(names) == 1
    gains = (_GAIN,) if is_single else further_terms.one_size_per_trial(_GAIN, len(names) - 1, 1.1)

    def in_trials(inputs: ActuatorInputs, thrust: FloatArray, values: Values) -> FloatArray:
        own = [values[gain.name] for gain in gains]
        last = [] if is_single else [max(len(names) - sum(own), 0.0)]
        return thrust * further_terms.held_sizes(inputs, names, [*own, *last], 1.0)[:, None]

    where = "in the named trial" if is_single else f"a separate g for each trial with a mean of 1: {', '.join(names)}"
    show = "in one log only" if is_single else "in every log, with a different size and sign in each"
    runs = "the named run again, and one of the other runs" if is_single else "the same run several times"
    return replace(
        EFFECT,
        form=further_terms.form_name(names),
        title=f"different thrust in {'one' if is_single else 'each'} trial",
        parameters=gains,
        size_count=len(gains),
        equation=f"T' = g·T{' ' if is_single else ', '}{where}",
        fingerprint=f"residual torque in proportion to T, {show}",
        experiment=f"{runs}; the supply's voltage in the log",
        rivals=_RIVALS_PER_TRIAL,
        acts=OnThrust(in_trials),
    )
