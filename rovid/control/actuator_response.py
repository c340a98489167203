"""What comes of the torque that is wanted, found by sines sent through the actuators."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rovid.control.allocation import Allocation, bare_actuation
from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.effects.actuator_inputs import ActuatorInputs
from rovid.model.command_series import CommandSeries
from rovid.model.model import Model
from rovid.trial.vehicle import Vehicle

ComplexArray = NDArray[np.complex128]

# The actuators' response is probed at so many frequencies, from rad/s to a share of half the sampling frequency, after
# s at least and a period of the sine.
_PROBES, _LOWEST_PROBE, _HIGHEST_PROBE = 18, 0.02, 0.9
_SETTLING, _FEWEST_SAMPLES = 20.0, 40


@dataclass(frozen=True, kw_only=True, eq=False)
class ActuatorProbe:
    """Sines of torque that are wanted of ``vehicle``'s thrusters.

    Attributes
    ----------
    parts
        Into which each interval is cut for what acts between command and torque.
    period, amplitude
        s, of the sampling; N m.
    """

    vehicle: Vehicle
    parts: int
    allocation: Allocation
    period: float
    amplitude: float

    @property
    def frequencies(self) -> FloatArray:
        """(f,) rad/s."""
        return np.geomspace(_LOWEST_PROBE, _HIGHEST_PROBE * math.pi / self.period, _PROBES)

    def frequency_response(self, model: Model) -> tuple[FloatArray, ComplexArray]:
        """Frequencies in rad/s and the (f,) response from wanted to acting torque.

        The describing function of whatever acts between command and torque, found by sending the sines through it.

        Raises
        ------
        DataError
            Something does, and the thrusters turn the vehicle one way only.
        """
        if model.actuators.is_plain:
            return self.frequencies, np.ones(_PROBES, dtype=np.complex128)
        given, measured = self._sines
        acting = model.actuators.torque_inputs(given).torque
        return self.frequencies, np.array([phasor @ acting[rows] for rows, phasor in measured])

    @cached_property
    def _sines(self) -> tuple[CommandSeries, list[tuple[slice, ComplexArray]]]:
        """Commands of every sine, one after the other; where each has settled, and weights of its response there."""
        if not self.amplitude > 0.0:
            raise one_way_only()
        begin, where, commands, measured = 0, [], [], list[tuple[slice, ComplexArray]]()
        for frequency in self.frequencies.tolist():
            length = max(round(2.0 * math.pi / frequency / self.period), _FEWEST_SAMPLES)
            count = length + max(length, math.ceil(_SETTLING / self.period))
            time = self.period * np.arange(count + 1)
            where.append(bare_actuation(self.vehicle, time, self.parts))
            commands.append(self.allocation(self.amplitude * np.sin(frequency * time)))
            # Of a sine itself this coordinate is its amplitude over 2j.
            phasor = _phasor(time[count - length : count], frequency) / (self.amplitude / 2j)
            measured.append((slice(begin + count - length, begin + count), phasor))
            begin += count + 1
        return CommandSeries(self.vehicle, ActuatorInputs.concatenated(where), np.concatenate(commands)), measured


def one_way_only() -> DataError:
    """The thrusters cannot turn the vehicle both ways."""
    return DataError("the thrusters turn the vehicle one way only.", mend="Look at yaw_arm and curve in rovid.toml.")


def _phasor(time: FloatArray, frequency: float) -> ComplexArray:
    """(n,) of a signal at (n,) ``time``: what exp(i w t) is multiplied by to fit it, its mean aside."""
    ahead, back = np.exp(1j * frequency * time), np.exp(-1j * frequency * time)
    basis = np.column_stack((ahead, back, np.ones(len(time))))
    return np.asarray(np.linalg.pinv(basis)[0])
