"""Play between command and thruster."""

from dataclasses import replace

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_dynamics import latched, played
from rovid.effects.base import ActuatorInputs, Effect, EffectParameter, OnCommand, Values

# Width of the threshold as a share of it. A sharp threshold would make the likelihood piecewise constant.
_RAMP = 0.1


def _play(inputs: ActuatorInputs, command: FloatArray, values: Values) -> FloatArray:
    return inputs.apply_per_trial(played, command, values["width"])


def _latch(inputs: ActuatorInputs, command: FloatArray, values: Values) -> FloatArray:
    return inputs.from_excess(inputs.apply_per_trial(latched, inputs.excess(command), values["width"], _RAMP))


EFFECT: Effect = Effect(
    id="command_hysteresis",
    title="command hysteresis",
    parameters=(EffectParameter(name="width", unit="command", high=50.0, initial_values=(2.0, 8.0), scale="command"),),
    equation="u' follows u within ±b/2",
    fingerprint="at one command the residual differs for rising and falling commands, however slowly they change",
    experiment="a slow staircase up and down",
    rivals=("command_delay", "thruster_deadband"),
    acts=OnCommand(_play),
)
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(
        EFFECT,
        form="schmitt",
        # The likelihood has a local maximum for each command near the threshold.
        parameters=(
            replace(
                EFFECT.parameters[0],
                initial_values=(2.0, 4.0, 6.0, 8.0, 11.0, 14.0, 18.0, 22.0, 27.0, 33.0, 40.0, 46.0),
                step=0.5 * _RAMP,  # to the edge of the ramp
            ),
        ),
        equation="u' = u after |u| exceeds the bench's dead zone by b, until u returns to the dead zone; else 0",
        acts=OnCommand(_latch),
    ),
)
# Of rudders and azimuth thrusters: play of their gear.
ANGLE_FORMS: tuple[Effect, ...] = (
    replace(
        EFFECT,
        form="angle",
        title="play of the angle",
        axes=("planar", "yaw"),
        parameters=(replace(EFFECT.parameters[0], unit="rad", high=0.4, initial_values=(0.02, 0.1), scale="one"),),
        equation="δ' follows δ within ±b/2, δ the angle of each rudder and azimuth thruster",
        acts=OnCommand(_play, of_angles=True),
    ),
)
