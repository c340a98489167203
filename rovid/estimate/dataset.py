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
from rovid.estimate.input_cache import Driving
from rovid.estimate.scaling import in_use, scales_of, usual_rate
from rovid.model.model import Model
from rovid.model.torque_input import Drive
from rovid.signals.preprocessing import Run
from rovid.trial.axis import Axis
from rovid.trial.vehicle import Vehicle

ANGLE_NOISE_FLOOR = 1e-5  # rad; no heading is better, and one from an autopilot's filter would claim to be


@dataclass(frozen=True, eq=False)
class Records(ABC):
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
    start: Model
    gyro: bool = False

    # Of what drives the runs, as in `Driving`.
    means_alone: ClassVar[bool] = False

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
    def spans(self) -> list[tuple[FloatArray, FloatArray]]:
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
    def integrated(self) -> bool:
        """Whether the rate alone was measured."""
        return self.runs[0].trial.integrated

    @property
    def driven(self) -> bool:
        """Whether anything drives the vehicle; else all torques, and the inertia, are those of 1 kg m^2."""
        return self.runs[0].trial.driven

    @cached_property
    def trial(self) -> IntArray:
        """(N,) index of the run of each innovation."""
        counts = [len(begin) for begin, _ in self.spans]
        return np.repeat(np.arange(len(self.runs)), counts)

    @cached_property
    def block(self) -> IntArray:
        """(N,) number of the stretch of time of each innovation."""
        length = self.block_seconds
        blocks, before = [], 0
        for begin, _ in self.spans:
            block = (begin / length).astype(np.intp)
            blocks.append(block + before)
            before += int(block.max(initial=0)) + 1
        return np.concatenate(blocks)

    @cached_property
    def rate(self) -> float:
        """Root mean square of the rate, rad/s or m/s."""
        return usual_rate(self.runs)

    @cached_property
    def torque(self) -> float:
        """Root mean square of the torque in use, N m."""
        if self.driven:
            return in_use(np.concatenate([run.torque for run in self.runs]))
        return in_use(self._restoring_torque())

    def _restoring_torque(self) -> FloatArray:
        """(N,) of what brings the vehicle back, at each measured position, N m."""
        tilt = np.concatenate([run.trial.position[run.trial.measured] for run in self.runs])
        return np.asarray(self.start.stiffness * np.sin(tilt - self.start.restoring_values[1]))

    @cached_property
    def drag_scale(self) -> FloatArray:
        """Quadratic and linear drag that would each brake as much as all drag does."""
        drag = self.start.quadratic_drag * self.rate + self.start.linear_drag
        return np.array([drag / self.rate, drag])

    @cached_property
    def scales(self) -> Scales:
        """Of the effects' parameters."""
        trials = [run.trial for run in self.runs]
        return scales_of(trials, self.vehicle, self.torque, self.rate, driven=self.driven)

    @cached_property
    def position_noise(self) -> float:
        """Standard deviation of the noise of what is measured, before any fit."""
        noise = [run.rates.position_noise for run in self.runs]
        return max(float(np.median(noise)), ANGLE_NOISE_FLOOR)

    @cached_property
    def _driving(self) -> Driving:
        return Driving(
            runs=self.runs,
            vehicle=self.vehicle,
            inertia=self.start.inertia,
            position_noise=self.position_noise,
            steps=self.steps,
            means_alone=self.means_alone,
        )

    def drives(self, model: Model) -> Iterator[Drive]:
        """What drives each run, at all instants of its log."""
        return self._driving.at_instants(model)
