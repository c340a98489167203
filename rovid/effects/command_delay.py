"""A delay between the logged command and its action."""

from dataclasses import replace

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_dynamics import delayed, mean_delayed, pending_changes, waited
from rovid.effects.base import ActuatorInputs, Effect, EffectParameter, OnThrust, OnTorque, Values


def _delayed(inputs: ActuatorInputs, torque: FloatArray, values: Values) -> FloatArray:
    return inputs.apply_per_trial(delayed, torque, values["delay"])


def _mean_of_delays(inputs: ActuatorInputs, torque: FloatArray, values: Values) -> FloatArray:
    return inputs.apply_per_trial(mean_delayed, torque, *_delay_range(values))


def _waits(inputs: ActuatorInputs, thrust: FloatArray, values: Values) -> FloatArray:
    return inputs.apply_per_trial(waited, thrust, values["delay"])


def _impulse_variance(inputs: ActuatorInputs, torque: FloatArray, values: Values) -> FloatArray:
    """Variance of the impulse in each interval, in (N m s)^2.

    A change c with a delay of (1 - J) L to (1 + J) L has the variance (c J L)^2 / 3, spread evenly over the 2 J L
    between the shortest and the longest delay.
    """
    jitter = values["jitter"] * values["delay"]
    return inputs.apply_per_trial(pending_changes, torque, *_delay_range(values)) * (jitter / 6.0) * inputs.intervals


def _delay_range(values: Values) -> tuple[float, float]:
    """Shortest and longest delay in s."""
    delay, jitter = values["delay"], values["jitter"]
    return delay * (1.0 - jitter), delay * (1.0 + jitter)


# Relative step of difference quotients: below the accuracy with which logs determine a range of delays, and wide enough
# for the jumps of the likelihood where a delay passes an instant of the log. Origin not recorded.
_STEP = 0.1

EFFECT: Effect = Effect(
    id="command_delay",
    title="command delay",
    parameters=(EffectParameter(name="delay", unit="s", high=30.0, initial_values=(0.02, 0.1, 0.6), scale="time"),),
    equation="T'(t) = T(t − L)",
    fingerprint="residual torque at the edges of steps, for the duration of the delay; none in steady motion",
    experiment="a fast pseudo-random command, 1 to 3 s a level",
    rivals=("thruster_lag", "command_hysteresis", "slew_limit"),
    acts=OnTorque(_delayed, settling_time=lambda values, _: values["delay"]),
)
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(
        EFFECT,
        form="scattered",
        # A drive that reads with its own clock, or a busy link: the delay of each command is unknown. The filter uses
        # the mean over all delays, and the variance around it.
        parameters=(
            replace(EFFECT.parameters[0], initial_values=(0.02, 0.08, 0.4), step=_STEP),
            # A jitter of 1, the neutral value, is that of a drive with its own clock.
            EffectParameter(name="jitter", unit="1", neutral=1.0, high=1.0, initial_values=(1.0, 0.5, 0.5), step=_STEP),
        ),
        equation="each command waits between (1 − J)·L and (1 + J)·L",
        acts=OnTorque(
            _mean_of_delays, settling_time=lambda values, _: _delay_range(values)[1], impulse_variance=_impulse_variance
        ),
    ),
    replace(
        EFFECT,
        form="reversal",
        title="delay at reversal",
        # A gear or a speed controller that stops before it reverses.
        parameters=(replace(EFFECT.parameters[0], initial_values=(0.05, 0.2, 0.8)),),
        equation="each thrust is zero for L after a change of its sign",
        acts=OnThrust(_waits, settling_time=lambda values, _: values["delay"]),
    ),
)
