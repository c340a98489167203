"""The moment of the water about the vertical axis, the hidden cause in it: one function for truth and oracle."""

from __future__ import annotations

import math

from tools.hard.layout import (
    ASYMMETRY,
    ASYMMETRY_RATE,
    BIAS,
    COULOMB,
    COULOMB_RATE,
    CUBIC,
    HEADING_1,
    HEADING_1_PHASE,
    HEADING_2,
    HEADING_2_PHASE,
    MEMORY,
    MEMORY_QUADRATIC,
    MEMORY_TIME,
    MUNK,
    OSCILLATORY,
    OSCILLATORY_ANGLE,
    POWER,
    POWER_RATE,
    SEICHE,
    SEICHE_DAMPING,
    SEICHE_FREQUENCY,
    SIDESLIP,
    SPEED_LINEAR,
    SPEED_QUADRATIC,
    STICTION,
    STRIBECK_RATE,
    SWIRL,
    SWIRL_BRAKE,
    TETHER,
    TETHER_HARDENING,
    TETHER_REST,
    Floats,
    compiled,
)


@compiled
def drag(r: float, cause: Floats, quadratic: float, linear: float) -> float:
    """Torque that resists a rate through the water, its law and its two directions as the cause has them."""
    size = abs(r)
    law = quadratic * size * r
    if cause[POWER] != 0.0:
        law *= (max(size, 1e-9) / cause[POWER_RATE]) ** cause[POWER]
    if cause[ASYMMETRY] != 0.0:
        backward = 0.5 * (1.0 - math.tanh(r / cause[ASYMMETRY_RATE]))
        law *= 1.0 + cause[ASYMMETRY] * backward
    return float(law + linear * r + cause[CUBIC] * r * r * r)


@compiled
def moment(
    r: float, psi: float, u: float, v: float, water: Floats, cause: Floats, quadratic: float, linear: float, out: Floats
) -> float:
    """Moment of water and tether; the rates of the water's own two states go to ``out``."""
    out[0] = 0.0
    out[1] = 0.0
    total = cause[BIAS]
    if cause[SWIRL] > 0.0:  # the water turns with the vehicle, and a quadratic friction at the walls brakes it
        resistance = drag(r - water[0], cause, quadratic, linear)
        out[0] = (resistance - cause[SWIRL_BRAKE] * abs(water[0]) * water[0]) / cause[SWIRL]
    else:
        resistance = drag(r, cause, quadratic, linear)
    if cause[OSCILLATORY] != 0.0:  # the wake of before lies ahead after a reversal, until it has been swept through
        direction = math.tanh(r / cause[COULOMB_RATE])
        out[0] = abs(r) / cause[OSCILLATORY_ANGLE] * (direction - water[0])
        resistance += cause[OSCILLATORY] * quadratic * abs(r) * r * 0.5 * (1.0 - water[0] * direction)
    total -= resistance
    if cause[COULOMB] != 0.0:
        breakaway = (cause[STICTION] - cause[COULOMB]) * math.exp(-((r / cause[STRIBECK_RATE]) ** 2))
        total -= (cause[COULOMB] + breakaway) * math.tanh(r / cause[COULOMB_RATE])
    if cause[MEMORY] != 0.0:  # trapped water that follows late, dragged along in proportion or with the square
        slip = r - water[0]
        pull = cause[MEMORY] / cause[MEMORY_TIME] * slip
        if cause[MEMORY_QUADRATIC] > 0.0:
            pull *= abs(slip) / cause[MEMORY_QUADRATIC]
        out[0] = pull / cause[MEMORY]
        total -= pull
    if cause[SEICHE] != 0.0:
        frequency = cause[SEICHE_FREQUENCY]
        out[0] = water[1]
        out[1] = frequency * frequency * (r - water[0]) - 2.0 * cause[SEICHE_DAMPING] * frequency * water[1]
        total -= cause[SEICHE] * water[1]
    if cause[TETHER] != 0.0:
        twist = psi - cause[TETHER_REST]
        total -= cause[TETHER] * (twist + cause[TETHER_HARDENING] * twist * twist * twist)
    if cause[HEADING_1] != 0.0 or cause[HEADING_2] != 0.0:
        total += cause[HEADING_1] * math.sin(psi - cause[HEADING_1_PHASE])
        total += cause[HEADING_2] * math.sin(2.0 * (psi - cause[HEADING_2_PHASE]))
    total -= (cause[SPEED_LINEAR] * abs(u) + cause[SPEED_QUADRATIC] * u * u) * r
    total -= cause[SIDESLIP] * v + cause[MUNK] * u * v
    return float(total)
