"""Verification commands, thrusters in the steps of a simulator, and the mismatch between two motions."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.export.body_equation import BodyEquation
from rovid.export.interface import PERIOD, ExportInput, Simulate
from rovid.export.planar_input import PlanarInput
from rovid.export.thruster_curves import COMMAND_LAG, NO_LAG, THRUST_LAG, ThrusterLag, ThrusterUnit
from rovid.trial.numba_loops import first_order_sum


@dataclass(frozen=True, kw_only=True)
class Mismatch:
    """Difference between the velocities of a simulator and of rovid, by the names of `VELOCITIES`."""

    percent_of_range: Mapping[str, float]  #: Largest difference relative to the range of rovid's.
    rms: Mapping[str, float]  #: m/s and rad/s.

    @property
    def largest(self) -> float:
        """Largest percentage."""
        return max(self.percent_of_range.values())


def compare_motions(subject: ExportInput | PlanarInput, rovid: FloatArray, other: FloatArray) -> Mismatch:
    """Mismatch of the (n, v) motion ``other``."""
    percents, sizes = {}, {}
    for name, mine, theirs, least in zip(subject.velocities, rovid.T, other.T, subject.least_ranges, strict=True):
        error = np.abs(theirs - mine)
        # The square of an unstable solution would overflow.
        scale = float(np.max(error))
        span = max(float(np.ptp(mine)), least, 1e-12)
        percents[name] = 100.0 * scale / span
        sizes[name] = scale
        if math.isfinite(scale) and scale > 0.0:
            sizes[name] *= float(np.sqrt(np.mean((error / scale) ** 2)))
    return Mismatch(percent_of_range=percents, rms=sizes)


def verification_commands(subject: ExportInput | PlanarInput) -> FloatArray:
    """(n, k) commands for `PERIOD` each, within the speeds of the logs."""
    shares, least, bisections = subject.verification_shares()
    limits = np.maximum(subject.envelope, 1e-9)

    def stays_within(factor: float) -> bool:
        motion = subject.motion(subject.model, subject.commands_at(factor * shares))
        return bool(np.all(np.max(np.abs(motion), axis=0) <= limits[-motion.shape[1] :]))

    low, high = 0.0, 1.0
    if stays_within(high):
        return subject.commands_at(shares)
    for _ in range(bisections):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stays_within(middle) else (low, middle)
    # A bias or a current alone may exceed the envelope.
    return subject.commands_at(max(low, least) * shares)


def repeat_held(values: FloatArray, step: float) -> FloatArray:
    """(n*m, ...) of (n, ...) values that are held for `PERIOD`: one for each of its m steps."""
    return np.repeat(values, round(PERIOD / step), axis=0)


def first_order_lag(values: FloatArray, time_constant: float, step: float) -> FloatArray:
    """First-order lag of (m,) ``values`` from zero, updated exactly before each step."""
    if time_constant <= 0.0:
        return values
    fade = math.exp(-step / time_constant)
    return first_order_sum((1.0 - fade) * values, fade)


def unit_forces(
    subject: ExportInput | PlanarInput,
    commands: FloatArray,
    step: float,
    units: Sequence[ThrusterUnit] | None = None,
    lag: ThrusterLag = NO_LAG,
    delay: float = 0.0,
) -> FloatArray:
    """(m, 3) forces along surge and sway, and torque in yaw, in each ``step`` in s under (n, k) ``commands``.

    ``units``: Thrusters of the file; by default those of the ``subject``. ``delay`` in s acts between curve and lag.
    """
    names = [one.name for one in subject.vehicle.thrusters]
    forces = np.zeros((len(commands) * round(PERIOD / step), 3))
    for unit in subject.units if units is None else units:
        curve = unit.curve
        beyond = repeat_held(commands[:, names.index(curve.name)] - curve.neutral, step)
        if lag.key == COMMAND_LAG:
            beyond = first_order_lag(beyond, lag.time_constant, step)
        thrust = curve(curve.neutral + beyond)
        if delay:
            thrust = np.concatenate([np.full(round(delay / step), thrust[0]), thrust])[: len(thrust)]
        if lag.key == THRUST_LAG:
            thrust = first_order_lag(thrust, lag.time_constant, step)
        forces += np.outer(thrust, unit.lever)
    return forces


def simulation(
    subject: ExportInput | PlanarInput,
    equation: BodyEquation,
    units: Sequence[ThrusterUnit] | None = None,
    lag: ThrusterLag = NO_LAG,
    delay: float = 0.0,
) -> Simulate:
    """Simulation of ``equation`` with thrusters as in `unit_forces`."""

    def simulate(commands: FloatArray) -> FloatArray:
        forces = unit_forces(subject, commands, equation.step, units, lag, delay)
        return equation.simulate(forces, every=round(PERIOD / equation.step))[:, -len(subject.velocities) :]

    return simulate
