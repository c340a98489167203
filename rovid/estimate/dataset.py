"""What was measured, as a fit takes it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.effects.base import Scales
from rovid.estimate.input_cache import InputCache
from rovid.estimate.scaling import effect_scales, rms_nonzero, rms_rate
from rovid.model.model import Model
from rovid.model.torque_input import TorqueInput
from rovid.signals.preprocessing import Run
from rovid.trial.axis import Axis
from rovid.trial.vehicle import Vehicle

ANGLE_NOISE_FLOOR = 1e-5  # rad; no heading is better, and one from an autopilot's filter would claim to be


@dataclass(frozen=True, eq=False)
class FitData(ABC):
    """What a misfit looks at in some runs, worked out once.

    Attributes
    ----------
    start
        A model to start from and to take scales from.
    gyro
        Whether logged rates are looked at besides the positions.
    """

    runs: Sequence[Run]
    vehicle: Vehicle | None
    initial_model: Model
    gyro: bool = False

    # Of what drives the runs, as in `Driving`.
    means_only: ClassVar[bool] = False

    @property
    @abstractmethod
    def interval(self) -> float:
        """Readings nearer to each other, in s, are passed over; 0 for none."""

    @property
    @abstractmethod
    def steps(self) -> list[IntArray] | None:
        """(n,) of each run, at which of the log's instants it is looked; None for all."""

    @property
    @abstractmethod
    def innovation_spans(self) -> list[tuple[FloatArray, FloatArray]]:
        """Of each run the (n,) s at which each innovation begins and ends to tell of the motion."""

    @property
    @abstractmethod
    def block_seconds(self) -> float:
        """Length of a stretch of time whose innovations are taken together."""

    @property
    def axis(self) -> Axis:
        """The degree of freedom that is looked at."""
        return self.runs[0].trial.axis

    @property
    def rate_only(self) -> bool:
        """Whether the rate alone was measured."""
        return self.runs[0].trial.rate_only

    @property
    def has_actuators(self) -> bool:
        """Whether anything drives the vehicle; else all torques, and the inertia, are those of 1 kg m^2."""
        return self.runs[0].trial.has_actuators

    @cached_property
    def run_index(self) -> IntArray:
        """(N,) index of the run of each innovation."""
        counts = [len(begin) for begin, _ in self.innovation_spans]
        return np.repeat(np.arange(len(self.runs)), counts)

    @cached_property
    def block_index(self) -> IntArray:
        """(N,) number of the stretch of time of each innovation."""
        length = self.block_seconds
        blocks, before = [], 0
        for begin, _ in self.innovation_spans:
            block = (begin / length).astype(np.intp)
            blocks.append(block + before)
            before += int(block.max(initial=0)) + 1
        return np.concatenate(blocks)

    @cached_property
    def rms_rate(self) -> float:
        """Root mean square of the rate, rad/s or m/s."""
        return rms_rate(self.runs)

    @cached_property
    def rms_torque(self) -> float:
        """Root mean square of the torque in use, N m."""
        if self.has_actuators:
            return rms_nonzero(np.concatenate([run.torque for run in self.runs]))
        return rms_nonzero(self._restoring_torque())

    def _restoring_torque(self) -> FloatArray:
        """(N,) of what brings the vehicle back, at each measured position, N m."""
        tilt = np.concatenate([run.trial.position[run.trial.measured] for run in self.runs])
        return np.asarray(self.initial_model.stiffness * np.sin(tilt - self.initial_model.restoring_values[1]))

    @cached_property
    def drag_scale(self) -> FloatArray:
        """Quadratic and linear drag that would each brake as much as all drag does."""
        drag = self.initial_model.quadratic_drag * self.rms_rate + self.initial_model.linear_drag
        return np.array([drag / self.rms_rate, drag])

    @cached_property
    def scales(self) -> Scales:
        """Of the effects' parameters."""
        trials = [run.trial for run in self.runs]
        return effect_scales(trials, self.vehicle, self.rms_torque, self.rms_rate, has_actuators=self.has_actuators)

    @cached_property
    def position_noise(self) -> float:
        """Standard deviation of the noise of what is measured, before any fit."""
        noise = [run.rates.position_noise for run in self.runs]
        return max(float(np.median(noise)), ANGLE_NOISE_FLOOR)

    @cached_property
    def _driving(self) -> InputCache:
        return InputCache(
            runs=self.runs,
            vehicle=self.vehicle,
            inertia=self.initial_model.inertia,
            position_noise=self.position_noise,
            steps=self.steps,
            means_only=self.means_only,
        )

    def torque_inputs(self, model: Model) -> Iterator[TorqueInput]:
        """What drives each run, at all instants of its log."""
        return self._driving.at_samples(model)
