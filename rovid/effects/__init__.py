"""The catalogue: one file an effect, one line here."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from importlib import import_module

from rovid.core.errors import ConfigError, suggestion
from rovid.effects import bias_torque, restoring, supply_sag, thruster_imbalance
from rovid.effects.actuator_inputs import SPEEDS, ActuatorInputs
from rovid.effects.base import Effect, EffectParameter, Term
from rovid.effects.per_trial import trials_in_form
from rovid.trial.axis import Axis
from rovid.trial.vehicle import Vehicle

# The file of each effect, which is called as it is, in the order in which effects are listed everywhere.
EFFECTS = (
    "thruster_deadband",
    "thrust_asymmetry",
    "thruster_imbalance",
    "thrust_curve_shape",
    "supply_sag",
    "thruster_lag",
    "command_delay",
    "slew_limit",
    "command_hysteresis",
    "advance_speed_loss",
    "bias_torque",
    "drag_curvature",
    "drag_asymmetry",
    "coulomb_resistance",
    "oscillatory_drag",
    "added_mass_memory",
    "entrained_swirl",
    "tether_torsion",
    "heading_dependent_torque",
    "wave_torque",
    "tank_seiche",
    "heading_deviation",
    "speed_dependent_damping",
    "sideslip_moment",
    "restoring_curve",
)
# What people call them besides -> effect.
SYNONYMS = {
    "deadzone": "thruster_deadband",
    "dead_zone": "thruster_deadband",
    "reverse": "thrust_asymmetry",
    "weak_thruster": "thruster_imbalance",
    "fault": "thruster_imbalance",
    "exponent": "thrust_curve_shape",
    "saturation": "thrust_curve_shape",
    "battery": "supply_sag",
    "voltage": "supply_sag",
    "spin_up": "thruster_lag",
    "latency": "command_delay",
    "dead_time": "command_delay",
    "ramp": "slew_limit",
    "rate_limit": "slew_limit",
    "backlash": "command_hysteresis",
    "play": "command_hysteresis",
    "inflow": "advance_speed_loss",
    "offset": "bias_torque",
    "trim": "bias_torque",
    "cubic": "drag_curvature",
    "friction": "coulomb_resistance",
    "stiction": "coulomb_resistance",
    "keulegan": "oscillatory_drag",
    "radiation": "added_mass_memory",
    "cable": "tether_torsion",
    "umbilical": "tether_torsion",
    "current": "heading_dependent_torque",
    "swell": "wave_torque",
    "waves": "wave_torque",
    "sloshing": "tank_seiche",
    "compass": "heading_deviation",
    "magnetic": "heading_deviation",
    "munk": "sideslip_moment",
    "drift_angle": "sideslip_moment",
    "metacentre": "restoring_curve",
}
# Every form of every effect, the plain one of each first.
FORMS: tuple[Effect, ...] = tuple(form for name in EFFECTS for form in import_module(f"rovid.effects.{name}").FORMS)
CATALOGUE: tuple[Effect, ...] = tuple(effect for effect in FORMS if not effect.form)
# What weight and buoyancy do; part of the base model of these axes.
_RESTORING = {"heave": restoring.LIFT, "roll": restoring.RIGHTING, "pitch": restoring.RIGHTING}
_ALL = "`rovid help effects` tells what each does."
# Compiled terms of the equation of motion, in the order in which their parameters stand in the kernels' arrays.
TERM_EFFECTS: tuple[Effect, ...] = (
    *(effect for effect in FORMS if isinstance(effect.acts, Term)),
    restoring.LIFT,
    restoring.RIGHTING,
)
# What makes forms of another size in each trial. Of so many trials each is asked for; of more it would take longer than
# all else.
_BY_TRIAL: Mapping[str, Callable[[Sequence[str]], Effect]] = {
    supply_sag.EFFECT.id: supply_sag.for_trials,
    bias_torque.EFFECT.id: bias_torque.for_trials,
}
_FEWEST_TRIALS, _MOST_TRIALS = 3, 24
TERMS = tuple(effect.acts for effect in TERM_EFFECTS if isinstance(effect.acts, Term))

__all__ = [
    "CATALOGUE",
    "FORMS",
    "TERMS",
    "TERM_EFFECTS",
    "ActuatorInputs",
    "Effect",
    "EffectParameter",
    "effect_named",
    "forms_for",
    "restoring_effect",
]


def restoring_effect(axis: Axis) -> Effect | None:
    """What weight and buoyancy do along ``axis``; None where they do nothing."""
    return _RESTORING.get(axis.name)


def forms_for(
    vehicle: Vehicle, channels: Collection[str] = (), trials: Sequence[str] = (), repeated: Sequence[str] = ()
) -> tuple[Effect, ...]:
    """Every form that can be tried on ``vehicle`` with these further ``channels`` in its logs, and these ``trials``.

    Those ``repeated`` have parts of which one may tell what is then tried on another.
    """
    found: list[Effect] = []
    # The thrust ahead stands in for a speed that is not logged.
    tells_speed = SPEEDS[0] not in channels and bool(vehicle.surge_shares.any())
    for effect in FORMS:
        if effect.axes and vehicle.axis.name not in effect.axes:
            continue
        if not vehicle.thrusters and (effect.changes_torque_input or effect.uses_wash):
            continue
        if effect.per_thruster:
            found += _of_each_thruster(vehicle)
        elif set(effect.needs) <= set(channels) and (tells_speed or not _stands_in(effect)):
            found.append(effect)
    if vehicle.thrusters and len(trials) > 1:
        # Of two nobody knows which one is the odd one.
        found += [supply_sag.for_trials([name]) for name in (trials[1:] if len(trials) == 2 else trials)]
    if vehicle.thrusters and _FEWEST_TRIALS <= len(repeated) <= _MOST_TRIALS:
        each = [of_trials(repeated) for of_trials in _BY_TRIAL.values()]
        found += [effect for effect in each if not effect.axes or vehicle.axis.name in effect.axes]
    return tuple(found)


def _of_each_thruster(vehicle: Vehicle) -> list[Effect]:
    # One thruster alone only scales the torque, which yaw data do not show.
    names = [t.name for t in vehicle.thrusters if t.curve is not None]
    ways = ("", thruster_imbalance.WITH_OTHERS)
    return [thruster_imbalance.for_thruster(name + way) for name in names for way in ways if len(names) > 1]


def _stands_in(effect: Effect) -> bool:
    return isinstance(effect.acts, Term) and effect.acts.surge_from_thrust is not None


def effect_named(name: str) -> Effect:
    """The effect with this id, or the form of one with this key (``id:form``).

    Raises
    ------
    ConfigError
        There is none; the nearest ids are offered.
    """
    for effect in FORMS:
        if effect.key == name and not effect.per_thruster:
            return effect
    key, _, thruster = name.partition(":")
    if key == thruster_imbalance.EFFECT.id:
        if thruster:
            return thruster_imbalance.for_thruster(thruster)
        raise ConfigError(f"{key} needs the name of the thruster, as in {key}:fore.")
    trials = trials_in_form(thruster)
    if trials and key in _BY_TRIAL:
        return _BY_TRIAL[key](trials)
    # Forms only where one was asked for: of one effect they are much alike.
    offered = [effect.key for effect in (FORMS if ":" in name else CATALOGUE)]
    raise ConfigError(f"there is no effect {name!r}. {suggestion(name, offered, SYNONYMS)}", mend=_ALL)
