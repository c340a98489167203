"""One standard manoeuvre, the steppers of the targets, and how far two yaw rates lie apart."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_inputs import neutral_commands
from rovid.export.curves import ThrusterCurve
from rovid.export.export_input import ExportInput
from rovid.model.model import Model
from rovid.signals.numba_loops import first_order_sum
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Thruster

# s; every target's step goes into it a whole number of times.
PERIOD = 0.1
# Shapes, each (length in settling times, share of the largest command at a share x of that length).
_SHAPES: tuple[tuple[float, Callable[[float], float]], ...] = (
    (1.0, lambda _: 0.0),
    (5.0, lambda _: 1.0),
    (4.0, lambda _: 0.0),
    (5.0, lambda _: -1.0),
    (4.0, lambda _: 0.0),
    (4.0, lambda _: 0.6),
    (10.0, lambda x: math.sin(4.0 * math.pi * x)),
    (10.0, lambda x: 0.7 * math.sin(8.0 * math.pi * x)),
    (5.0, lambda _: 0.0),
)
# s; a fast vehicle still needs samples, and a slow one's manoeuvre an end.
_SETTLING = (1.0, 15.0)
_HALVINGS = 30


@dataclass(frozen=True, kw_only=True)
class Mismatch:
    """How far a target's yaw rate is from rovid's on the manoeuvre.

    Attributes
    ----------
    percent_of_range
        Largest difference over the range of rovid's own rate.
    rms
        rad/s.
    """

    percent_of_range: float
    rms: float


def verification_commands(subject: ExportInput) -> FloatArray:
    """(n, k) commands, each held for ``PERIOD``: hold both ways, coast down, two sines, within the measured rates."""
    settling = min(max(settling_time(subject), _SETTLING[0]), _SETTLING[1])
    share: list[float] = []
    for length, shape in _SHAPES:
        count = round(length * settling / PERIOD)
        share += [shape(k / count) for k in range(count)]
    shares = np.array(share)
    low, high = 0.0, 1.0
    if _largest(subject, commands_at(subject, shares)) > subject.largest_rate:
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            if _largest(subject, commands_at(subject, middle * shares)) <= subject.largest_rate:
                low = middle
            else:
                high = middle
        shares = low * shares
    return commands_at(subject, shares)


def settling_time(subject: ExportInput) -> float:
    """Time constant in s of small changes at half the largest measured rate."""
    model = subject.model
    slope = model.linear_drag + model.quadratic_drag * subject.largest_rate
    return model.inertia / max(slope, 1e-12)


def commands_at(subject: ExportInput, shares: FloatArray) -> FloatArray:
    """(n, k) commands that push by (n,) ``shares`` of the largest in use, positive ones turning the heading up."""
    vehicle = subject.vehicle
    each = zip(vehicle.thrusters, neutral_commands(vehicle), subject.commands, strict=True)
    columns = [np.interp(shares, [-1.0, 0.0, 1.0], _reach(*one)) for one in each]
    return np.column_stack(columns)


def _reach(thruster: Thruster, neutral: float, ends: FloatArray) -> list[float]:
    """The commands in use that turn the heading down most, not at all, and up most."""
    down, up = sorted(ends, key=lambda command: float(thruster.torque(np.array([command]))[0]))
    return [down, neutral, up]


def _largest(subject: ExportInput, commands: FloatArray) -> float:
    """Largest size of the yaw rate in rad/s that (n, k) ``commands`` lead to."""
    return float(np.max(np.abs(rovid_rate(subject, subject.model, commands))))


def rovid_rate(subject: ExportInput, model: Model, commands: FloatArray) -> FloatArray:
    """(n,) yaw rate in rad/s of ``model`` under (n, k) ``commands``, from rest."""
    trial = Trial.from_commands(
        PERIOD * np.arange(len(commands), dtype=np.float64), commands, reference=subject.reference
    )
    return model.simulate(trial, model.torque_input(subject.vehicle, trial))[0]


def compare_rates(rovid: FloatArray, other: FloatArray) -> Mismatch:
    """How far ``other`` lies from the yaw rate ``rovid``, both (n,) rad/s."""
    error, span = other - rovid, float(np.ptp(rovid))
    worst = float(np.max(np.abs(error)))
    percent = 0.0
    if worst != 0.0:
        percent = 100.0 * worst / span if span > 0.0 else math.inf
    # A model that runs away is off by more than can be squared.
    scale = worst or 1.0
    return Mismatch(percent_of_range=percent, rms=scale * float(np.sqrt(np.mean((error / scale) ** 2))))


def repeat_held(values: FloatArray, period: float, step: float) -> FloatArray:
    """(n*m, ...) of (n, ...) values held for ``period``: one for each of its m steps."""
    return np.repeat(values, round(period / step), axis=0)


def first_order_lag(values: FloatArray, time_constant: float, step: float) -> FloatArray:
    """First-order lag of (m,) ``values``, from zero, updated exactly and ahead of each step."""
    if time_constant <= 0.0:
        return values
    fade = math.exp(-step / time_constant)
    return first_order_sum((1.0 - fade) * values, fade)


def thrust_torque(
    propulsion: Sequence[ThrusterCurve],
    commands: FloatArray,
    period: float,
    step: float,
    *,
    command_lag: float = 0.0,
    thrust_lag: float = 0.0,
) -> FloatArray:
    """(m,) yaw torque in N m, positive as rovid's, in each step of (n, k) commands held for ``period``."""
    total = np.zeros(len(commands) * round(period / step))
    for curve, command in zip(propulsion, commands.T, strict=True):
        beyond = first_order_lag(repeat_held(command - curve.neutral, period, step), command_lag, step)
        total += curve.arm * first_order_lag(curve(curve.neutral + beyond), thrust_lag, step)
    return total


def integrate_rate(
    torque: FloatArray, steps: int, advance: Callable[[float, float, float], float], step: float
) -> FloatArray:
    """(n,) rate in rad/s before every ``steps`` of the (m,) torques in N m, from rest.

    ``advance`` turns (rate, angle, torque) into the rate a step later; the angle follows with the new rate, as in the
    semi-implicit Euler method of rigid-body engines.
    """
    rate = angle = 0.0
    rates = []
    for index, push in enumerate(torque.tolist()):
        if index % steps == 0:
            rates.append(rate)
        rate = advance(rate, angle, push)
        angle += step * rate
    return np.array(rates)
