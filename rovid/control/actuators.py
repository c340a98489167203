"""Actuators of the controller: allocation of torque to commands, and their frequency response."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rovid.core.array_types import ComplexArray, FloatArray
from rovid.core.errors import DataError
from rovid.effects.actuator_inputs import ActuatorInputs, actuator_inputs, neutral_commands
from rovid.model.actuator_model import CommandSeries
from rovid.model.model import Model
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle

# Number of torques each way in the table, and the smallest one relative to the largest.
_LEVELS, _TINY = 501, 1e-9
# N m, torques of an actuator that takes the torque itself as its command.
_UNLIMITED = np.append(0.0, np.geomspace(1e-2, 1e6, _LEVELS - 1))
# Number of frequencies in the response, the lowest in rad/s, and the highest relative to the Nyquist frequency.
_FREQUENCIES, _LOWEST, _HIGHEST = 18, 0.02, 0.9
# s, shortest time before the response is read, and minimum number of samples of a sine.
_SETTLING, _MIN_SAMPLES = 20.0, 40


@dataclass(frozen=True, kw_only=True, eq=False)
class Allocation:
    """Commands with each thruster at the same share of its range beyond the dead zone, in the sense of the torque."""

    #: ``torque``, ``commands``: (m,) N m, increasing, and (m, k); the commands jump over the dead zone at zero torque.
    torque: FloatArray
    commands: FloatArray
    limited: bool  #: Whether a bench curve limits the torque.
    inverse: bool = True  #: Whether the commands exert ``torque``; else only a nominal torque.

    @property
    def lowest(self) -> float:
        """Most negative torque in N m."""
        return float(self.torque[0]) if self.limited else -math.inf

    @property
    def highest(self) -> float:
        """Largest torque in N m."""
        return float(self.torque[-1]) if self.limited else math.inf

    def __call__(self, torque: FloatArray) -> FloatArray:
        """(n, k) commands for (n,) ``torque`` in N m, saturated at the limits."""
        return np.column_stack([np.interp(torque, self.torque, column) for column in self.commands.T])


def allocate(vehicle: Vehicle, model: Model) -> Allocation:
    """Inverse of the steady torque of ``vehicle`` with the effects of ``model``."""
    up, forward = _one_way(vehicle, model, 1.0)
    down, backward = _one_way(vehicle, model, -1.0)
    return Allocation(
        torque=np.concatenate((-down[::-1], [0.0], up)),
        commands=np.concatenate((backward[::-1], [neutral_commands(vehicle)], forward)),
        limited=any(thruster.curve is not None for thruster in vehicle.thrusters),
    )


def _one_way(vehicle: Vehicle, model: Model, sign: float) -> tuple[FloatArray, FloatArray]:
    """(m,) absolute torques, increasing from nearly zero, and their (m, k) commands, for torques of one sign."""
    where = bare_inputs(vehicle, np.array([0.0, 1.0]))
    share = np.linspace(0.0, 1.0, _LEVELS)
    columns = []
    for at, thruster in enumerate(vehicle.thrusters):
        sense = math.copysign(1.0, thruster.arm) * sign
        if thruster.curve is None:
            columns.append(sense * _UNLIMITED)
            continue
        side = 1 if sense > 0.0 else 0
        edge, end = where.dead_zone[at][side], thruster.curve.command[-side]
        columns.append(edge + share * (end - edge))
    commands = np.column_stack(columns)
    torque = np.maximum.accumulate(np.maximum(sign * command_torque(vehicle, model, commands), 0.0))
    # Among commands with equal torque the largest one, and at the top the smallest one.
    keep = np.append(np.diff(torque) > 0.0, False) | (np.arange(_LEVELS) == np.searchsorted(torque, torque[-1]))
    torque, commands = torque[keep], commands[keep]
    torque[0] = max(torque[0], _TINY * torque[-1])
    return torque, commands


def command_torque(vehicle: Vehicle, model: Model, commands: FloatArray) -> FloatArray:
    """(m,) torque in N m at the beginning of a trial with each of (m, k) ``commands``."""
    trials = ActuatorInputs.concatenated([bare_inputs(vehicle, np.array([0.0, 1.0]))] * len(commands))
    series = CommandSeries(vehicle, trials, np.repeat(commands, 2, axis=0))
    return model.actuators.torque_inputs(series).torque[::2]


def bare_inputs(vehicle: Vehicle, time: FloatArray, parts: int = 1) -> ActuatorInputs:
    """Actuator inputs at the (n,) ``time`` in s, without further channels."""
    still = np.zeros((len(time), len(vehicle.thrusters)))
    return actuator_inputs(vehicle, Trial.from_commands(time, still), parts)


@dataclass(frozen=True, kw_only=True, eq=False)
class ActuatorProbe:
    """Sines of wanted torque for the frequency response."""

    vehicle: Vehicle
    parts: int  #: Number of parts of each interval for the effects between command and torque.
    allocation: Allocation
    #: ``period``, ``amplitude``: sampling period in s; N m.
    period: float
    amplitude: float

    @property
    def frequencies(self) -> FloatArray:
        """(f,) in rad/s."""
        return np.geomspace(_LOWEST, _HIGHEST * math.pi / self.period, _FREQUENCIES)

    def frequency_response(self, model: Model) -> tuple[FloatArray, ComplexArray]:
        """Frequencies in rad/s and the (f,) describing function from wanted to acting torque.

        Raises DataError if an effect acts between command and torque, and the thrusters turn the vehicle one way only.
        """
        if model.actuators.is_plain and self.allocation.inverse:
            return self.frequencies, np.ones(_FREQUENCIES, dtype=np.complex128)
        series, readings = self._sines
        torque = model.actuators.torque_inputs(series).torque
        return self.frequencies, np.array([weights @ torque[rows] for rows, weights in readings])

    @cached_property
    def _sines(self) -> tuple[CommandSeries, list[tuple[slice, ComplexArray]]]:
        """Commands of all sines in succession; for each, the settled rows and the weights of its response there."""
        if not self.amplitude > 0.0:
            raise one_way_only()
        begin, where, commands, readings = 0, [], [], list[tuple[slice, ComplexArray]]()
        for frequency in self.frequencies.tolist():
            length = max(round(2.0 * math.pi / frequency / self.period), _MIN_SAMPLES)
            count = length + max(length, math.ceil(_SETTLING / self.period))
            time = self.period * np.arange(count + 1)
            where.append(bare_inputs(self.vehicle, time, self.parts))
            commands.append(self.allocation(self.amplitude * np.sin(frequency * time)))
            # Least squares fit of exp(i w t), exp(-i w t) and a constant. The sine itself has the coefficient
            # amplitude / 2j.
            settled = time[count - length : count]
            ahead, back = np.exp(1j * frequency * settled), np.exp(-1j * frequency * settled)
            weights = np.linalg.pinv(np.column_stack((ahead, back, np.ones(len(settled)))))[0] / (self.amplitude / 2j)
            readings.append((slice(begin + count - length, begin + count), weights))
            begin += count + 1
        return CommandSeries(self.vehicle, ActuatorInputs.concatenated(where), np.concatenate(commands)), readings


def one_way_only() -> DataError:
    """Error for thrusters that turn the vehicle one way only."""
    return DataError("the thrusters turn the vehicle one way only.", mend="Check yaw_arm and curve in rovid.toml.")
