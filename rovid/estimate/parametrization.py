"""The scaled coordinates in which a model is fitted: where each stands, its bounds, and the way to the model."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray
from rovid.effects import Effect, EffectParameter, restoring_effect
from rovid.estimate.dataset import ANGLE_NOISE_FLOOR, FitData
from rovid.model.model import Model

# Where each stands: log of the inertia, both drags over their scale, log of the disturbance's size and memory, log of
# the measurement's noise. Behind these `COMMON` ones stand what weight and buoyancy do, and then the effects.
INERTIA, QUADRATIC, LINEAR, DISTURBANCE, MEMORY, NOISE = range(6)
COMMON = 6
LOGARITHMS = [INERTIA, DISTURBANCE, MEMORY, NOISE]
# Bounds of the logarithms: of the inertia about where it starts, of the disturbance below its limit, of its memory in s
# and of the noise.
_INERTIA_RANGE, _DISTURBANCE_RANGE = 2.5, 9.0
_MEMORIES, _MOST_NOISE = (0.2, 100.0), 0.2
# The disturbance to begin with, as a share of the torque in use, its memory in s, and how far below the limit it is.
_FIRST_SHARE, _FIRST_MEMORY, _BELOW_LIMIT = 0.01, 4.0, 0.1
# Step for slopes of the logarithms and scaled drags.
_STEP = 1e-5
# Of its start: a parameter that is gone is stepped as if it were so large.
_GONE = 0.1


@dataclass(frozen=True, eq=False)
class Parametrization:
    """What the coordinates of a fit stand for.

    Attributes
    ----------
    low, high
        (p,) bounds.
    """

    data: FitData
    effects: tuple[Effect, ...]
    low: FloatArray
    high: FloatArray

    @classmethod
    def of(cls, records: FitData, effects: tuple[Effect, ...], limit: float) -> Self:
        """Within physical bounds; the disturbance is no more than ``limit``, a share of the torque in use."""
        top = math.log(limit * records.rms_torque)
        inertia = math.log(records.initial_model.inertia)
        # Without a drive nothing tells the inertia.
        reach = _INERTIA_RANGE if records.has_actuators else 0.0
        shortest, longest = map(math.log, _MEMORIES)
        low = [inertia - reach, 0.0, 0.0, top - _DISTURBANCE_RANGE, shortest, math.log(ANGLE_NOISE_FLOOR)]
        high = [inertia + reach, np.inf, np.inf, top, longest, math.log(_MOST_NOISE)]
        own = _parameters(records, effects)
        coordinates = cls(
            records,
            effects,
            np.array(low + [parameter.low for parameter in own]),
            np.array(high + [parameter.high for parameter in own]),
        )
        coordinates.bound_frequencies()
        return coordinates

    def bound_frequencies(self) -> None:
        """Keep what swings by itself slower than readings show (Nyquist), and to a cycle in the longest run or more."""
        if not any(effect.oscillatory for effect in self.effects):
            return
        longest = max(run.trial.duration for run in self.data.runs)
        slowest, fastest = 2.0 * math.pi / longest, self._nyquist()
        for at, effect, parameter in self.effect_parameters():
            if effect.oscillatory and parameter.name == "frequency":
                self.high[at] = max(min(self.high[at], fastest), self.low[at])
                self.low[at] = min(max(self.low[at], slowest), self.high[at])

    def _nyquist(self) -> float:
        """Half the sampling frequency, rad/s."""
        period = min(run.trial.sampling_interval for run in self.data.runs)
        return math.pi / max(self.data.interval, period)

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """(p,) low and high."""
        return self.low, self.high

    @cached_property
    def parameters(self) -> list[EffectParameter]:
        """Those behind the common ones: of what weight and buoyancy do, then of the effects."""
        return _parameters(self.data, self.effects)

    @cached_property
    def units(self) -> FloatArray:
        """What one unit of each of ``parameters`` is."""
        return np.array([self.data.scales.unit_size(parameter) for parameter in self.parameters])

    @property
    def effects_begin(self) -> int:
        """How many coordinates stand before those of the effects."""
        return COMMON + len(_restoring(self.data))

    def effect_parameters(self) -> list[tuple[int, Effect, EffectParameter]]:
        """Where each parameter of each effect stands."""
        pairs = [(effect, parameter) for effect in self.effects for parameter in effect.parameters]
        return [(at, *pair) for at, pair in enumerate(pairs, start=self.effects_begin)]

    def effect_slices(self) -> list[tuple[Effect, slice]]:
        """Each effect, and where its parameters stand."""
        places, at = [], self.effects_begin
        for effect in self.effects:
            end = at + len(effect.parameters)
            places.append((effect, slice(at, end)))
            at = end
        return places

    def initial_values(self) -> list[FloatArray]:
        """Where to begin the search for the parameters of the last effect, within their bounds."""
        last = self.effects[-1]
        own = slice(len(self.low) - len(last.parameters), None)
        within = np.clip(last.initial_values, self.low[own], self.high[own])
        starts = []
        for k, start in enumerate(within):
            same = (within[:k] == start).all(axis=1)
            # Two starts beyond a bound are one within it.
            if not same.any():
                starts.append(start)
        return starts

    def initial(self) -> FloatArray:
        """(p,) coordinates to start from, each effect at the first of its starts."""
        records, start = self.data, self.data.initial_model
        quadratic, linear = records.drag_scale
        restoring = len(_restoring(records))
        x = [
            math.log(start.inertia),
            start.quadratic_drag / quadratic,
            start.linear_drag / linear,
            min(math.log(_FIRST_SHARE * records.rms_torque), self.high[DISTURBANCE] - _BELOW_LIMIT),
            math.log(_FIRST_MEMORY),
            math.log(records.position_noise),
            *(np.array(start.restoring_values) / self.units[:restoring]),
            *[parameter.initial_values[0] for parameter in self.parameters[restoring:]],
        ]
        return np.asarray(np.clip(x, self.low, self.high))

    def model(self, x: FloatArray) -> Model:
        """The model at (p,) ``x``."""
        quadratic, linear = self.data.drag_scale
        sizes = tuple(float(value) for value in x[COMMON:] * self.units)
        restoring = len(_restoring(self.data))
        return Model(
            inertia=math.exp(x[INERTIA]),
            quadratic_drag=float(x[QUADRATIC] * quadratic),
            linear_drag=float(x[LINEAR] * linear),
            effects=self.effects,
            effect_values=sizes[restoring:],
            axis=self.data.axis,
            restoring_values=sizes[:restoring],
        )

    def model_jacobian(self, x: FloatArray) -> tuple[list[int], FloatArray]:
        """Which coordinates are the model's own parameters, and the change of each of those with its coordinate."""
        own = [INERTIA, QUADRATIC, LINEAR, *range(COMMON, len(x))]
        return own, np.array([math.exp(x[INERTIA]), *self.data.drag_scale, *self.units])

    def coordinates_of(self, model: Model, disturbance: float, memory: float, noise: float) -> FloatArray:
        """(p,) where ``model`` stands, with a disturbance in N m, its memory in s, and the noise measured."""
        quadratic, linear = self.data.drag_scale
        own = np.array([*model.restoring_values, *model.effect_values])
        return np.array(
            [
                math.log(model.inertia),
                model.quadratic_drag / quadratic,
                model.linear_drag / linear,
                math.log(disturbance),
                math.log(memory),
                math.log(noise),
                *(own / self.units),
            ]
        )

    def difference_steps(self, x: FloatArray) -> FloatArray:
        """(p,) small changes of ``x``: a parameter's in proportion to itself, or to its start where it is gone."""
        starts = np.array([abs(parameter.initial_values[0]) or 1.0 for parameter in self.parameters])
        shares = np.array([parameter.step for parameter in self.parameters])
        own = shares * np.maximum(np.abs(x[COMMON:]), _GONE * starts)
        return np.concatenate((np.full(COMMON, _STEP), own))

    def parameter(self, at: int) -> EffectParameter:
        """That of the coordinate number ``at``, behind the common ones."""
        return self.parameters[at - COMMON]

    def piecewise_constant(self) -> list[int]:
        """Coordinates along which the likelihood has steps in place of slopes."""
        return [at for at, parameter in enumerate(self.parameters, start=COMMON) if parameter.piecewise_constant]

    def fixed(self) -> BoolArray:
        """(p,) whether its bounds leave a coordinate no choice."""
        return np.asarray(self.low == self.high)

    def canonical(self, x: FloatArray) -> FloatArray:
        """The same ``x`` with amplitudes positive and phases within a turn."""
        tidy = x.copy()
        for effect, own in self.effect_slices():
            if effect.canonical is not None:
                tidy[own] = effect.canonical(x[own])
        return tidy


def _restoring(records: FitData) -> tuple[EffectParameter, ...]:
    """Of what weight and buoyancy do along the axis."""
    effect = restoring_effect(records.axis)
    return () if effect is None else effect.parameters


def _parameters(records: FitData, effects: tuple[Effect, ...]) -> list[EffectParameter]:
    """Of what brings the vehicle back, then of each effect."""
    own = [parameter for effect in effects for parameter in effect.parameters]
    return [*_restoring(records), *own]
