"""Verification commands, integration schemes of simulators, and the mismatch between two yaw rates."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_inputs import neutral_commands
from rovid.export.body_equation import BodyEquation
from rovid.export.interface import PERIOD, ExportInput
from rovid.export.thruster_curves import COMMAND_LAG, NO_LAG, THRUST_LAG, ThrusterCurve, ThrusterLag
from rovid.model.model import Model
from rovid.trial.numba_loops import first_order_sum
from rovid.trial.trial import Trial

# Sections of the verification: length in settling times, and share of the largest command at a share x of the length.
_SECTIONS: tuple[tuple[float, Callable[[float], float]], ...] = (
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
# s, range of the settling time, for enough samples and a finite length.
_SETTLING = (1.0, 15.0)
# Number of bisections for the amplitude.
_BISECTIONS = 30


@dataclass(frozen=True, kw_only=True)
class Mismatch:
    """Difference between the yaw rates of a simulator and of rovid.

    ``percent_of_range`` is the largest difference relative to the range of rovid's rate; ``rms`` is in rad/s.
    """

    percent_of_range: float
    rms: float


def verification_commands(subject: ExportInput) -> FloatArray:
    """(n, k) commands for `PERIOD` each: holds, coast-downs and sines, within the yaw rates of the logs."""
    settling = min(max(settling_time(subject), _SETTLING[0]), _SETTLING[1])
    samples: list[float] = []
    for length, shape in _SECTIONS:
        count = round(length * settling / PERIOD)
        samples += [shape(k / count) for k in range(count)]
    shares = np.array(samples)

    def stays_within(factor: float) -> bool:
        rate = rovid_rate(subject, subject.model, commands_at(subject, factor * shares))
        return float(np.max(np.abs(rate))) <= subject.largest_rate

    if stays_within(1.0):
        return commands_at(subject, shares)
    low, high = 0.0, 1.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if stays_within(middle):
            low = middle
        else:
            high = middle
    return commands_at(subject, low * shares)


def settling_time(subject: ExportInput) -> float:
    """Time constant in s of small changes at half the largest yaw rate of the logs."""
    model = subject.model
    slope = model.linear_drag + model.quadratic_drag * subject.largest_rate
    return model.inertia / max(slope, 1e-12)


def commands_at(subject: ExportInput, shares: FloatArray) -> FloatArray:
    """(n, k) commands of (n,) ``shares`` of the largest ones in the logs, positive where the heading turns up."""
    vehicle, columns = subject.vehicle, []
    for thruster, neutral, ends in zip(vehicle.thrusters, neutral_commands(vehicle), subject.commands, strict=True):
        order = np.argsort(thruster.torque(ends), kind="stable")
        columns.append(np.interp(shares, [-1.0, 0.0, 1.0], [ends[order[0]], neutral, ends[order[1]]]))
    return np.column_stack(columns)


def rovid_rate(subject: ExportInput, model: Model, commands: FloatArray) -> FloatArray:
    """(n,) yaw rate in rad/s of ``model`` from rest under (n, k) ``commands`` for `PERIOD` each."""
    time = PERIOD * np.arange(len(commands), dtype=np.float64)
    trial = Trial.from_commands(time, commands, reference=subject.reference)
    return model.simulate(trial, model.torque_input(subject.vehicle, trial))[0]


def compare_rates(rovid: FloatArray, other: FloatArray) -> Mismatch:
    """Mismatch of the (n,) yaw rate ``other`` in rad/s."""
    error, span = other - rovid, float(np.ptp(rovid))
    largest = float(np.max(np.abs(error)))
    percent = 0.0
    if largest != 0.0:
        percent = 100.0 * largest / span if span > 0.0 else math.inf
    # The square of an unstable solution would overflow.
    scale = largest or 1.0
    return Mismatch(percent_of_range=percent, rms=scale * float(np.sqrt(np.mean((error / scale) ** 2))))


# ---- integration schemes


def repeat_held(values: FloatArray, step: float) -> FloatArray:
    """(n*m, ...) of (n, ...) values that are held for `PERIOD`: one for each of its m steps."""
    return np.repeat(values, round(PERIOD / step), axis=0)


def first_order_lag(values: FloatArray, time_constant: float, step: float) -> FloatArray:
    """First-order lag of (m,) ``values`` from zero, updated exactly before each step."""
    if time_constant <= 0.0:
        return values
    fade = math.exp(-step / time_constant)
    return first_order_sum((1.0 - fade) * values, fade)


def thrust_torque(
    curves: Sequence[ThrusterCurve], commands: FloatArray, step: float, lag: ThrusterLag = NO_LAG
) -> FloatArray:
    """(m,) yaw torque in N m in each step under (n, k) commands, positive where the heading turns up."""
    total = np.zeros(len(commands) * round(PERIOD / step))
    for curve, command in zip(curves, commands.T, strict=True):
        beyond = repeat_held(command - curve.neutral, step)
        if lag.key == COMMAND_LAG:
            beyond = first_order_lag(beyond, lag.time_constant, step)
        thrust = curve(curve.neutral + beyond)
        if lag.key == THRUST_LAG:
            thrust = first_order_lag(thrust, lag.time_constant, step)
        total += curve.arm * thrust
    return total


def equation_rate(equation: BodyEquation, torque: FloatArray) -> FloatArray:
    """(n,) yaw rate in rad/s at the beginning of each `PERIOD` under (m,) torques in N m for a step each, from rest."""
    forces = np.zeros((len(torque), 3))
    forces[:, 2] = torque
    return equation.simulate(forces, every=round(PERIOD / equation.step))[:, 3]
