"""The catalogue: one file an effect, one line here."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from rovid.campaign.axis import Axis
from rovid.campaign.vehicle import Vehicle
from rovid.effects import (
    added_mass_memory,
    advance_speed_loss,
    bias_torque,
    command_delay,
    command_hysteresis,
    coulomb_resistance,
    drag_asymmetry,
    drag_curvature,
    entrained_swirl,
    heading_dependent_torque,
    heading_deviation,
    oscillatory_drag,
    restoring,
    restoring_curve,
    sideslip_moment,
    slew_limit,
    speed_dependent_damping,
    supply_sag,
    tank_seiche,
    tether_torsion,
    thrust_asymmetry,
    thrust_curve_shape,
    thruster_deadband,
    thruster_imbalance,
    thruster_lag,
    wave_torque,
)
from rovid.effects.base import SPEEDS, Actuation, Effect, EffectParameter
from rovid.ground.errors import ConfigError, nearest

# Every form of every effect, the plain one of each first.
FORMS: tuple[Effect, ...] = (
    *thruster_deadband.FORMS,
    *thrust_asymmetry.FORMS,
    thruster_imbalance.EFFECT,
    *thrust_curve_shape.FORMS,
    *supply_sag.FORMS,
    *thruster_lag.FORMS,
    *command_delay.FORMS,
    *slew_limit.FORMS,
    *command_hysteresis.FORMS,
    *advance_speed_loss.FORMS,
    bias_torque.EFFECT,
    *drag_curvature.FORMS,
    *drag_asymmetry.FORMS,
    *coulomb_resistance.FORMS,
    *oscillatory_drag.FORMS,
    *added_mass_memory.FORMS,
    *entrained_swirl.FORMS,
    *tether_torsion.FORMS,
    *heading_dependent_torque.FORMS,
    wave_torque.EFFECT,
    *tank_seiche.FORMS,
    *heading_deviation.FORMS,
    *speed_dependent_damping.FORMS,
    *sideslip_moment.FORMS,
    *restoring_curve.FORMS,
)
CATALOGUE: tuple[Effect, ...] = tuple(effect for effect in FORMS if not effect.form)
# What weight and buoyancy do; part of the base model of these axes.
_RESTORING = {"heave": restoring.LIFT, "roll": restoring.RIGHTING, "pitch": restoring.RIGHTING}
# Compiled terms of the equation of motion, in the order in which their parameters stand in the kernels' arrays.
MOTION: tuple[Effect, ...] = (
    *(effect for effect in FORMS if effect.term is not None),
    restoring.LIFT,
    restoring.RIGHTING,
)
TERMS = tuple(effect.term for effect in MOTION if effect.term is not None)

__all__ = [
    "CATALOGUE",
    "FORMS",
    "MOTION",
    "TERMS",
    "Actuation",
    "Effect",
    "EffectParameter",
    "effect_named",
    "forms_for",
    "restoring_of",
]


def restoring_of(axis: Axis) -> Effect | None:
    """What weight and buoyancy do along ``axis``; None where they do nothing."""
    return _RESTORING.get(axis.name)


def forms_for(vehicle: Vehicle, channels: Collection[str] = (), trials: Sequence[str] = ()) -> tuple[Effect, ...]:
    """Every form that can be tried on ``vehicle`` with these further ``channels`` in its logs, and these ``trials``."""
    found: list[Effect] = []
    ahead = bool(vehicle.ahead.any())
    for effect in FORMS:
        if effect.axes and vehicle.axis.name not in effect.axes:
            continue
        if not vehicle.thrusters and (effect.actuates or effect.races):
            continue
        if effect.each_thruster:
            # One thruster alone only scales the torque, which yaw data do not show.
            names = [t.name for t in vehicle.thrusters if t.curve is not None]
            ways = ("", thruster_imbalance.BESIDE)
            found += [thruster_imbalance.of_thruster(name + way) for name in names for way in ways if len(names) > 1]
        elif set(effect.needs) <= set(channels) and not (effect.on_speed and (SPEEDS[0] in channels or not ahead)):
            found.append(effect)
    if vehicle.thrusters and len(trials) > 1:
        # Of two nobody knows which one is the odd one.
        found += [supply_sag.of_trial(name) for name in (trials[1:] if len(trials) == 2 else trials)]
    return tuple(found)


def effect_named(name: str) -> Effect:
    """The effect with this id, or the form of one with this key (``id:form``).

    Raises
    ------
    ConfigError
        There is none; the nearest ids are offered.
    """
    for effect in FORMS:
        if effect.key == name and not effect.each_thruster:
            return effect
    key, _, thruster = name.partition(":")
    if key == thruster_imbalance.EFFECT.id:
        if thruster:
            return thruster_imbalance.of_thruster(thruster)
        raise ConfigError(f"{key} needs the name of the thruster, as in {key}:fore.")
    if key == supply_sag.EFFECT.id and thruster.startswith(supply_sag.TRIAL):
        return supply_sag.of_trial(thruster.removeprefix(supply_sag.TRIAL))
    raise ConfigError(f"there is no effect {name!r}. {nearest(name, [effect.key for effect in FORMS])}")
