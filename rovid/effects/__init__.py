"""The catalogue: one file an effect, one line here."""

from __future__ import annotations

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
    oscillatory_drag,
    slew_limit,
    supply_sag,
    tether_torsion,
    thrust_asymmetry,
    thrust_curve_shape,
    thruster_deadband,
    thruster_lag,
)
from rovid.effects.base import Actuation, Effect, EffectParameter
from rovid.errors import ConfigError, nearest

CATALOGUE: tuple[Effect, ...] = (
    thruster_deadband.EFFECT,
    thrust_asymmetry.EFFECT,
    thrust_curve_shape.EFFECT,
    supply_sag.EFFECT,
    thruster_lag.EFFECT,
    command_delay.EFFECT,
    slew_limit.EFFECT,
    command_hysteresis.EFFECT,
    advance_speed_loss.EFFECT,
    bias_torque.EFFECT,
    drag_curvature.EFFECT,
    drag_asymmetry.EFFECT,
    coulomb_resistance.EFFECT,
    oscillatory_drag.EFFECT,
    added_mass_memory.EFFECT,
    entrained_swirl.EFFECT,
    tether_torsion.EFFECT,
    heading_dependent_torque.EFFECT,
)
# Compiled terms of the equation of motion, in the order in which their parameters stand in the kernels' arrays.
MOTION: tuple[Effect, ...] = tuple(effect for effect in CATALOGUE if effect.term is not None)
TERMS = tuple(effect.term for effect in CATALOGUE if effect.term is not None)

__all__ = ["CATALOGUE", "MOTION", "TERMS", "Actuation", "Effect", "EffectParameter", "effect_named"]


def effect_named(name: str) -> Effect:
    """The effect with this id.

    Raises
    ------
    ConfigError
        There is none; the nearest ids are offered.
    """
    for effect in CATALOGUE:
        if effect.id == name:
            return effect
    raise ConfigError(f"there is no effect {name!r}. {nearest(name, [effect.id for effect in CATALOGUE])}")
