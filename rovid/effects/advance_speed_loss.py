"""Loss of thrust with the speed of advance of the thruster."""

from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.base import (
    SPEEDS,
    ActuatorInputs,
    Effect,
    EffectParameter,
    Instant,
    Numbers,
    OnThrust,
    Term,
    Values,
    compiled,
    maximum,
    minimum,
    where_nonnegative,
)

# Largest gain of thrust against the stream, as a share: the open-water curve is unknown beyond.
_MAX_GAIN = -0.5


@compiled
def _term(at: Instant, p: Numbers) -> float:
    # Each thruster loses rotor speed times speed of advance. The rotor's speed is proportional to the root of thrust.
    return -p[0] * at.wash * at.rate


@compiled
def _open_water(at: Instant, p: Numbers) -> float:
    along = where_nonnegative(at.thruster_torque, at.rate, -at.rate)
    # Mean advance ratio of the thrusters: speed of each over the root of its thrust.
    advance = minimum(maximum(p[0] * along * at.wash / (abs(at.thruster_torque) + 1e-150), _MAX_GAIN), 0.6)
    # KT = 0.24 − 0.25 J − 0.66 J² + 0.5 J³ of the ROV Minerva over its value at J = 0, with j = 1.04 J; zero at J =
    # 0.53.
    lost = minimum(advance * (1.0 + advance * (2.534 - 1.843 * advance)), 1.0)
    return -at.thruster_torque * where_nonnegative(advance, lost, advance)


def _measured(inputs: ActuatorInputs, thrust: FloatArray, values: Values) -> FloatArray:
    # Without forward shares in rovid.toml all thrusters are assumed to push ahead.
    share = inputs.forward_share
    along = np.outer(inputs.speed(SPEEDS[0]), share if share.any() else np.ones(len(share)))
    return np.asarray(thrust - values["coefficient"] * along * np.sqrt(np.abs(thrust)))


def _across(inputs: ActuatorInputs, thrust: FloatArray, values: Values) -> FloatArray:
    # A jet across the stream is bent along the hull, when the vehicle moves ahead or astern (Brix 1993).
    lost = values["coefficient"] * np.abs(inputs.speed(SPEEDS[0]))[:, np.newaxis] * np.sqrt(np.abs(thrust))
    return np.asarray(np.sign(thrust) * np.maximum(np.abs(thrust) - lost, 0.0))


_COEFFICIENT = EffectParameter(
    name="coefficient", unit="N^0.5 s/m", high=2.0, initial_values=(0.05,), scale="torque/wash/rate"
)

EFFECT: Effect = Effect(
    id="advance_speed_loss",
    title="loss of thrust with speed of advance",
    parameters=(_COEFFICIENT,),
    equation="F' = F − a·√|F|·l·r, l the arm of the thruster",
    fingerprint="more damping under thrust than in a coast-down",
    experiment="coast-downs, and holds at the same rates",
    rivals=("drag_curvature", "supply_sag"),
    acts=Term(_term, uses_wash=True),
)
_MEASURED = replace(
    EFFECT,
    form="measured",
    parameters=(replace(_COEFFICIENT, scale="sqrt_thrust/surge"),),
    equation="F' = F − a·√|F|·s·u, u the logged speed ahead, s the share of the thrust along it",
    fingerprint="residual torque in proportion to √|F| times the speed ahead; zero in a coast-down",
    experiment="the same commands at several speeds ahead; coast-downs at speed, where no thrust acts",
    rivals=("speed_dependent_damping", "supply_sag"),
    needs=SPEEDS[:1],
    acts=OnThrust(_measured),
)
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(
        EFFECT,
        form="open_water",
        equation="− T·(j + 2.5 j² − 1.8 j³), j = a·l·r·sign(T)/√|F|: a curved open-water characteristic",
        acts=Term(_open_water, uses_wash=True),
    ),
    _MEASURED,
    replace(
        _MEASURED,
        form="across",
        equation="|F'| = |F| − a·√|F|·|u|, u the logged speed ahead: thrusters across the direction of motion",
        fingerprint="less torque from the same command at higher speed, ahead or astern",
        experiment="the same commands at several speeds ahead and astern, and at zero speed",
        rivals=("supply_sag", "speed_dependent_damping"),
        acts=OnThrust(_across),
    ),
)
