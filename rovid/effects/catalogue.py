"""The catalogue of effects: one file an effect, one line here."""

from collections.abc import Callable, Collection, Mapping, Sequence
from importlib import import_module
from pathlib import Path

from rovid.core.errors import ConfigError, suggestion
from rovid.effects import (
    bias_torque,
    command_hysteresis,
    restoring_curve,
    slew_limit,
    supply_sag,
    thruster_deadband,
    thruster_imbalance,
    thruster_lag,
)
from rovid.effects.actuator_inputs import SPEEDS
from rovid.effects.base import Effect, OnCommand, Term
from rovid.effects.clock_offset import CLOCKS_APART
from rovid.effects.further_terms import address_of, effect_at, trials_in_form
from rovid.effects.plugins import further_forms, is_id, load_files
from rovid.trial.axis import Axis
from rovid.trial.vehicle import Vehicle

# Ids of all effects, which are also the names of their files, in the order in which effects are listed everywhere.
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
# Id -> other words that people use, and the reverse.
_WORDS = {
    "thruster_deadband": "deadzone dead_zone",
    "thrust_asymmetry": "reverse",
    "thruster_imbalance": "weak_thruster fault",
    "thrust_curve_shape": "exponent saturation",
    "supply_sag": "battery voltage",
    "thruster_lag": "spin_up",
    "command_delay": "latency dead_time",
    "slew_limit": "ramp rate_limit",
    "command_hysteresis": "backlash play",
    "advance_speed_loss": "inflow",
    "bias_torque": "offset trim",
    "drag_curvature": "cubic",
    "coulomb_resistance": "friction stiction",
    "oscillatory_drag": "keulegan",
    "added_mass_memory": "radiation",
    "tether_torsion": "cable umbilical",
    "wave_torque": "swell waves",
    "tank_seiche": "sloshing",
    "heading_deviation": "compass magnetic",
    "sideslip_moment": "munk drift_angle",
    "restoring_curve": "metacentre",
}
SYNONYMS = {word: effect for effect, words in _WORDS.items() for word in words.split()}
# All forms of all effects, the plain form of each effect first.
FORMS: tuple[Effect, ...] = tuple(form for name in EFFECTS for form in import_module(f"rovid.effects.{name}").FORMS)
# Ids of the effects with forms of the planar model, `Coupling`, `WaterCurrent` and `SensorPlace`, and these forms.
PLANAR_EFFECTS = (
    "current",
    "sway_yaw_damping",
    "cross_flow_drag",
    "speed_dependent_damping",
    "bias_torque",
    "sensor_place",
)
PLANAR_FORMS: tuple[Effect, ...] = tuple(
    form for name in PLANAR_EFFECTS for form in import_module(f"rovid.effects.{name}").PLANAR_FORMS
)
# Forms that act on the angles of rudders and azimuth thrusters.
ANGLE_FORMS: tuple[Effect, ...] = tuple(
    form for module in (thruster_deadband, thruster_lag, slew_limit, command_hysteresis) for form in module.ANGLE_FORMS
)
_ANGLE_FORMS = {form.id: form for form in ANGLE_FORMS}
# The plain forms.
CATALOGUE: tuple[Effect, ...] = tuple(effect for effect in FORMS if not effect.form)
# Restoring torque or force by weight and buoyancy, part of the base model of these axes.
_RESTORING = {"heave": restoring_curve.LIFT, "roll": restoring_curve.RIGHTING, "pitch": restoring_curve.RIGHTING}
# Effects that are terms of the equation of motion. A term's index here is its kind in the compiled loops.
TERM_EFFECTS: tuple[Effect, ...] = (
    *(effect for effect in FORMS if isinstance(effect.acts, Term)),
    restoring_curve.LIFT,
    restoring_curve.RIGHTING,
)
TERMS = tuple(effect.acts for effect in TERM_EFFECTS if isinstance(effect.acts, Term))
_KINDS = {effect: kind for kind, effect in enumerate(TERM_EFFECTS)}
# Effects with a form that has another size in each trial.
_PER_TRIAL: Mapping[str, Callable[[Sequence[str]], Effect]] = {
    supply_sag.EFFECT.id: supply_sag.for_trials,
    bias_torque.EFFECT.id: bias_torque.for_trials,
}
# Trials for which such forms are tried. With more trials their fits would take most of the time.
_MIN_TRIALS, _MAX_TRIALS = 3, 24


def term_kind(effect: Effect) -> int:
    """Number by which the compiled loops know the term of ``effect``: its index in `TERM_EFFECTS`, or an address."""
    kind = _KINDS.get(effect)
    return address_of(effect) if kind is None else kind


def term_effect(kind: int) -> Effect:
    """The effect with the term of this ``kind``."""
    return TERM_EFFECTS[kind] if kind < len(TERM_EFFECTS) else effect_at(kind)


def restoring_effect(axis: Axis) -> Effect | None:
    """Restoring torque or force along ``axis``; None if there is none."""
    return _RESTORING.get(axis.name)


def load_plugins(files: Sequence[Path]) -> None:
    """Add the effects in these ``files`` of the user; see `rovid.effects.plugins`.

    Raises ConfigError if a file does not exist.
    """
    load_files(files, EFFECTS)


def require_free_id(name: str) -> None:
    """Refuse a name that no new effect can have.

    Raises ConfigError if the name is taken, or has other signs than lower-case letters, digits and _.
    """
    if not is_id(name):
        mend = "Use lower-case letters, digits and _, as in my_effect."
        raise ConfigError(f"is {name!r}, which is no name of an effect.", where="NAME", mend=mend)
    if name in {form.id for form in every_form()}:
        raise ConfigError(f"is {name!r}, which is an effect already.", where="NAME", mend="Choose another name.")


def in_angles(effect: Effect) -> Effect:
    """The form in rad of an effect in the unit of the command, for a vehicle that is steered by angles; else itself."""
    in_commands = effect.parameters[0].unit.startswith("command") and isinstance(effect.acts, OnCommand)
    return _ANGLE_FORMS.get(effect.id, effect) if in_commands else effect


def every_form() -> tuple[Effect, ...]:
    """All forms of the catalogue and of the plug-ins."""
    return (*FORMS, *further_forms(EFFECTS))


def forms_for(
    vehicle: Vehicle, channels: Collection[str] = (), trials: Sequence[str] = (), repeated: Sequence[str] = ()
) -> tuple[Effect, ...]:
    """All forms that can be tried.

    ``channels``: Further channels in the logs.
    ``trials``: Names of the trials, without which no effect begins at an instant.
    ``repeated``: Names of trials with enough data to fit a size for each trial.
    """
    found: list[Effect] = []
    # The thrust ahead replaces a speed that is not logged.
    estimates_speed = SPEEDS[0] not in channels and bool(vehicle.surge_shares.any())
    has_rudder = any(thruster.is_rudder for thruster in vehicle.thrusters)
    for effect in (*every_form(), *(ANGLE_FORMS if has_rudder else ())):
        if isinstance(effect.acts, OnCommand) and vehicle.has_rudders_alone and not effect.acts.of_angles:
            continue  # it is of commands, which no curve turns into thrust
        if (effect.axes and vehicle.axis.name not in effect.axes) or set(effect.replaces) & set(channels):
            continue
        if not vehicle.thrusters and (effect.changes_torque_input or effect.uses_wash):
            continue
        if effect.per_thruster:
            names = [thruster.name for thruster in vehicle.thrusters if thruster.curve is not None]
            # A single thruster only scales all torque, which yaw data do not determine.
            for name in names if len(names) > 1 else ():
                found += [thruster_imbalance.for_thruster(name + suffix) for suffix in thruster_imbalance.SUFFIXES]
            continue
        estimated = isinstance(effect.acts, Term) and effect.acts.surge_from_thrust is not None
        needs_estimate = estimated and not effect.needs
        if set(effect.needs) <= set(channels) and (estimates_speed or not needs_estimate):
            found.append(effect)
    if vehicle.thrusters and len(trials) > 1:
        # With two trials only the ratio of their thrust matters: one form is enough.
        found += [supply_sag.for_trials([name]) for name in (trials[1:] if len(trials) == 2 else trials)]
    if vehicle.thrusters and _MIN_TRIALS <= len(repeated) <= _MAX_TRIALS:
        forms = [make(repeated) for make in _PER_TRIAL.values()]
        found += [effect for effect in forms if not effect.axes or vehicle.axis.name in effect.axes]
    return tuple(effect for effect in found if trials or not effect.instants)


def effect_named(name: str) -> Effect:
    """The effect with this id, or the form with this key (``id:form``).

    Raises ConfigError if there is none. The message offers the nearest ids.
    """
    for effect in (*every_form(), *PLANAR_FORMS, *ANGLE_FORMS, CLOCKS_APART):
        if effect.key == name and not effect.per_thruster:
            return effect
    key, _, form = name.partition(":")
    if key == thruster_imbalance.EFFECT.id:
        if form:
            return thruster_imbalance.for_thruster(form)
        raise ConfigError(f"{key} needs the name of the thruster, as in {key}:fore.")
    trials = trials_in_form(form)
    if trials and key in _PER_TRIAL:
        return _PER_TRIAL[key](trials)
    # Forms are offered if the user gave one.
    offered = [effect.key for effect in every_form() if ":" in name or not effect.form]
    mend = "`rovid help effects` explains each effect."
    raise ConfigError(f"there is no effect {name!r}. {suggestion(name, offered, SYNONYMS)}", mend=mend)
