"""Thrusters: what a command becomes on its way to a thrust, with the cause that sits there."""

from __future__ import annotations

import math

import numpy as np

from tools.hard.layout import (
    ADVANCE,
    ADVANCE_2,
    BACKWARD,
    COS,
    DEADBAND,
    DEADBAND_SOFT,
    EXPONENT,
    FORWARD,
    LOSS,
    PLACE_X,
    PLACE_Y,
    PLAY,
    POD,
    REVERSE,
    REVERSE_THRUST,
    SCHMITT_OFF,
    SCHMITT_ON,
    SHAPE,
    SIN,
    SLEW_DOWN,
    SLEW_UP,
    UNEQUAL,
    UNEQUAL_GAIN,
    ZONE_BACKWARD,
    ZONE_FORWARD,
    Floats,
    compiled,
)


@compiled
def bench(command: float, thruster: Floats) -> float:
    """Steady thrust of a command from -1 to 1, as the bench has it."""
    if thruster[POD] > 0.0:
        return float(thruster[FORWARD] * math.sin(thruster[POD] * command))
    zone = thruster[ZONE_FORWARD] if command > 0.0 else thruster[ZONE_BACKWARD]
    most = thruster[FORWARD] if command > 0.0 else -thruster[BACKWARD]
    beyond = (abs(command) - zone) / (1.0 - zone)
    return most * beyond ** thruster[EXPONENT] if beyond > 0.0 else 0.0


@compiled
def aimed(command: float, thruster: Floats, cause: Floats) -> float:
    """Steady thrust of a command with what the cause does to the curve."""
    if cause[DEADBAND] > 0.0:
        zone = thruster[ZONE_FORWARD] if command > 0.0 else thruster[ZONE_BACKWARD]
        beyond = abs(command) - zone
        if beyond > 0.0:  # a further dead zone beyond the bench's, with a soft edge
            soft = cause[DEADBAND_SOFT] * cause[DEADBAND]
            at_rest = soft * math.log1p(math.exp(-cause[DEADBAND] / soft))
            ahead = (beyond - cause[DEADBAND]) / soft
            reached = soft * ahead if ahead > 30.0 else soft * math.log1p(math.exp(ahead))
            command = math.copysign(zone + max(reached - at_rest, 0.0), command)
    thrust = bench(command, thruster)
    if cause[SHAPE] != 1.0:
        most = thruster[FORWARD] if thrust > 0.0 else thruster[BACKWARD]
        thrust = math.copysign(most * (abs(thrust) / most) ** cause[SHAPE], thrust)
    return thrust


@compiled
def gain(thrust: float, index: int, cause: Floats) -> float:
    """Factor on a thrust: weaker astern (more so at large thrust), and one thruster unlike the others."""
    factor = 1.0
    if thrust < 0.0 and cause[REVERSE] != 1.0:
        grown = 1.0 - math.exp(-abs(thrust) / cause[REVERSE_THRUST])
        factor = 1.0 - (1.0 - cause[REVERSE]) * grown
    if index == int(cause[UNEQUAL]):
        factor *= cause[UNEQUAL_GAIN]
    return factor


@compiled
def delivered(spin: float, thruster: Floats, cause: Floats, u: float, v: float, r: float) -> float:
    """Thrust of a rotor at its speed (the root of its bollard thrust), less what it loses to advance."""
    if thruster[POD] > 0.0:
        return spin
    bollard = abs(spin) * spin
    if abs(spin) < 1e-9:
        return 0.0
    advance = thruster[COS] * (u - thruster[PLACE_Y] * r) + thruster[SIN] * (v + thruster[PLACE_X] * r)
    ratio = advance / spin  # positive where the rotor moves the way it pushes
    ratio = min(max(ratio, -0.6), 1.5)
    # A jet that leaves a tunnel across the way on is bent along the hull, whichever way it goes.
    lost = min(ratio + abs(thruster[SIN]) * abs(u / spin), 1.5)
    left = 1.0 - thruster[LOSS] * ratio - cause[ADVANCE] * lost - cause[ADVANCE_2] * lost * abs(lost)
    return float(bollard * max(left, 0.0))


@compiled
def through_the_drive(command: float, before: float, running: float, step: float, cause: Floats) -> tuple[float, float]:
    """What reaches the rotor of a command: play, start and stop thresholds, slew; and whether the rotor runs."""
    reached = command
    if cause[PLAY] > 0.0:
        half = 0.5 * cause[PLAY]
        reached = min(max(before, command - half), command + half)
    if cause[SCHMITT_ON] > 0.0:
        threshold = cause[SCHMITT_OFF] if running > 0.5 else cause[SCHMITT_ON]
        running = 1.0 if abs(command) > threshold else 0.0
        reached = command if running > 0.5 else 0.0
    change = reached - before
    growing = abs(reached) > abs(before) and reached * before >= 0.0
    most = (cause[SLEW_UP] if growing else cause[SLEW_DOWN]) * step
    return before + min(max(change, -most), most), running


def rotor_step(time_constant: float, damping: float, step: float) -> Floats:
    """Matrix that carries (distance to the aim, its rate) over a step: second order with a damping above 0."""
    if damping <= 0.0:
        return np.array([[math.exp(-step / time_constant), 0.0], [0.0, 0.0]])
    # A second-order rotor whose delay in the long run, 2 * damping / frequency, is the time constant.
    frequency = 2.0 * damping / time_constant
    system = np.array([[0.0, 1.0], [-frequency * frequency, -2.0 * damping * frequency]])
    values, vectors = np.linalg.eig(system.astype(complex) + 1e-9 * np.eye(2))
    return np.real(vectors @ np.diag(np.exp(values * step)) @ np.linalg.inv(vectors))
