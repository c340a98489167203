"""Scaled coordinates of a fit: order, bounds, initial values, and the map to model parameters."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray
from rovid.effects import Effect, EffectParameter, restoring_effect
from rovid.effects.base import HOUR
from rovid.estimate.dataset import NOISE_FLOOR, FitData
from rovid.model.model import Model

# Positions of the `COMMON` coordinates: log inertia, both drags over their scale, logs of the disturbance's size and
# correlation time, log measurement noise. The restoring parameters and those of the effects follow.
INERTIA, QUADRATIC, LINEAR, DISTURBANCE, MEMORY, NOISE = range(6)
COMMON = 6
LOGARITHMS = [INERTIA, DISTURBANCE, MEMORY, NOISE]
# Half range of the log inertia about its start, and range of the log disturbance below its limit.
_INERTIA_RANGE, _DISTURBANCE_RANGE = 2.5, 9.0
# Bounds of the disturbance's correlation time in time constants of the vehicle, and largest measurement noise over
# the scale of the readings.
_MEMORY_BOUNDS, _MAX_NOISE = (0.05, 100.0), 0.2
# Initial disturbance as a share of the torque in use, its correlation time in time constants, and its least distance to
# the limit in logarithms.
_FIRST_SHARE, _FIRST_MEMORY, _BELOW_LIMIT = 0.01, 1.0, 0.1
# Difference step of the common coordinates.
_STEP = 1e-5
# Least size of a parameter for its difference step, as a share of its initial value.
_LEAST_SIZE = 0.1


@dataclass(frozen=True, eq=False)
class Parametrization:
    """Scaled coordinates of the model with some effects."""

    data: FitData
    effects: tuple[Effect, ...]
    #: ``low``, ``high``: (p,) bounds.
    low: FloatArray
    high: FloatArray

    @classmethod
    def of(cls, data: FitData, effects: tuple[Effect, ...], limit: float) -> Self:
        """Coordinates within physical bounds, with a disturbance of at most ``limit`` times the torque in use."""
        top = math.log(limit * data.rms_torque)
        inertia = math.log(data.initial_model.inertia)
        # Without actuators the data do not determine the inertia.
        reach = _INERTIA_RANGE if data.has_actuators else 0.0
        shortest, longest = (math.log(bound * data.usual_time) for bound in _MEMORY_BOUNDS)
        least, most = (math.log(bound * data.reading_scale) for bound in (NOISE_FLOOR, _MAX_NOISE))
        low = [inertia - reach, 0.0, 0.0, top - _DISTURBANCE_RANGE, shortest, least]
        high = [inertia + reach, np.inf, np.inf, top, longest, most]
        own = _parameters(data, effects)
        low += [parameter.low for parameter in own]
        high += [parameter.high for parameter in own]
        found = cls(data, effects, np.array(low), np.array(high))
        # Oscillating effects stay below the Nyquist frequency, and at one cycle in the longest run or more.
        cycle = max(run.trial.duration for run in data.runs)
        period = max(data.interval, min(run.trial.sampling_interval for run in data.runs))
        for at, effect, parameter in found.effect_parameters():
            if effect.oscillatory and parameter.name == "frequency":
                unit = data.scales.unit_size(parameter)
                slowest, nyquist = 2.0 * math.pi / cycle / unit, math.pi / period / unit
                found.high[at] = max(min(found.high[at], nyquist), found.low[at])
                found.low[at] = min(max(found.low[at], slowest), found.high[at])
        return found

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """(p,) lower and upper bounds."""
        return self.low, self.high

    @cached_property
    def parameters(self) -> list[EffectParameter]:
        """Parameters after the common coordinates: restoring torque, then effects."""
        return _parameters(self.data, self.effects)

    @cached_property
    def units(self) -> FloatArray:
        """Size of one unit of each of ``parameters``."""
        return np.array(list(map(self.data.scales.unit_size, self.parameters)))

    @property
    def effects_begin(self) -> int:
        """Number of coordinates before those of the effects."""
        return COMMON + len(_restoring_parameters(self.data))

    def effect_parameters(self) -> list[tuple[int, Effect, EffectParameter]]:
        """Coordinate number, effect and parameter, for each parameter of each effect."""
        pairs = [(effect, parameter) for effect in self.effects for parameter in effect.parameters]
        return [(at, *pair) for at, pair in enumerate(pairs, start=self.effects_begin)]

    def effect_slices(self) -> list[tuple[Effect, slice]]:
        """Each effect with the slice of its coordinates."""
        slices, at = [], self.effects_begin
        for effect in self.effects:
            slices.append((effect, slice(at, at + len(effect.parameters))))
            at += len(effect.parameters)
        return slices

    def initial_values(self) -> list[FloatArray]:
        """Distinct initial values of the parameters of the last effect, within their bounds."""
        last = self.effects[-1]
        own = slice(len(self.low) - len(last.parameters), None)
        values = np.array(last.initial_values)
        if last.instants:
            values[:, last.instants] = np.interp(values[:, last.instants], *self.logged_time)
        within = np.clip(values, self.low[own], self.high[own])
        return [start for k, start in enumerate(within) if not (within[:k] == start).all(axis=1).any()]

    @cached_property
    def logged_time(self) -> tuple[FloatArray, FloatArray]:
        """Begin and end of each log in turn: share of the time in all logs together, and coordinate of the instant."""
        trials = sorted((run.trial for run in self.data.runs), key=lambda trial: trial.campaign_time)
        logged = np.cumsum([0.0, *(trial.duration for trial in trials)])
        sides = np.array([(trial.campaign_time, trial.campaign_time + trial.duration) for trial in trials])
        shares = np.column_stack((logged[:-1], logged[1:])) / logged[-1]
        return shares.ravel(), sides.ravel() / (HOUR * self.data.scales.day)

    def initial(self) -> FloatArray:
        """(p,) initial coordinates, with each effect at the first of its initial values."""
        data, start = self.data, self.data.initial_model
        quadratic, linear = data.drag_scale
        restoring = len(_restoring_parameters(data))
        x = [
            math.log(start.inertia),
            start.quadratic_drag / quadratic,
            start.linear_drag / linear,
            min(math.log(_FIRST_SHARE * data.rms_torque), self.high[DISTURBANCE] - _BELOW_LIMIT),
            math.log(_FIRST_MEMORY * data.usual_time),
            math.log(data.position_noise),
            *(np.array(start.restoring_values) / self.units[:restoring]),
            *[parameter.initial_values[0] for parameter in self.parameters[restoring:]],
        ]
        return np.asarray(np.clip(x, self.low, self.high))

    def model(self, x: FloatArray) -> Model:
        """The model at (p,) ``x``."""
        quadratic, linear = self.data.drag_scale
        base = math.exp(x[INERTIA]), x[QUADRATIC] * quadratic, x[LINEAR] * linear
        return Model.from_values([*base, *(x[COMMON:] * self.units)], self.data.axis, self.effects)

    def model_jacobian(self, x: FloatArray) -> tuple[list[int], FloatArray]:
        """Coordinates that are model parameters, and the derivative of each parameter by its coordinate."""
        own = [INERTIA, QUADRATIC, LINEAR, *range(COMMON, len(x))]
        return own, np.array([math.exp(x[INERTIA]), *self.data.drag_scale, *self.units])

    def coordinates_of(self, model: Model, disturbance: float, memory: float, noise: float) -> FloatArray:
        """(p,) coordinates of a ``model``, a disturbance in N m, its correlation time in s, and measurement noise."""
        drags = np.array([model.quadratic_drag, model.linear_drag]) / self.data.drag_scale
        logs = map(math.log, (disturbance, memory, noise))
        return np.array([math.log(model.inertia), *drags, *logs, *(model.values[3:] / self.units)])

    def difference_steps(self, x: FloatArray) -> FloatArray:
        """(p,) positive difference steps at ``x``; those of effects are proportional to the parameter."""
        starts = np.array([abs(parameter.initial_values[0]) or 1.0 for parameter in self.parameters])
        shares = np.array([parameter.step for parameter in self.parameters])
        own = shares * np.maximum(np.abs(x[COMMON:]), _LEAST_SIZE * starts)
        return np.concatenate((np.full(COMMON, _STEP), own))

    def piecewise_constant(self) -> list[int]:
        """Coordinates along which the likelihood is piecewise constant."""
        return [at for at, parameter in enumerate(self.parameters, start=COMMON) if parameter.piecewise_constant]

    def fixed(self) -> BoolArray:
        """(p,) whether each coordinate is fixed by its bounds."""
        return np.asarray(self.low == self.high)

    def canonical(self, x: FloatArray) -> FloatArray:
        """Equivalent coordinates with positive amplitudes and phases within one turn."""
        tidy = x.copy()
        for effect, own in self.effect_slices():
            if effect.canonical is not None:
                tidy[own] = effect.canonical(x[own])
        return tidy


def _restoring_parameters(data: FitData) -> tuple[EffectParameter, ...]:
    """Parameters of the restoring torque by weight and buoyancy."""
    effect = restoring_effect(data.axis)
    return () if effect is None else effect.parameters


def _parameters(data: FitData, effects: tuple[Effect, ...]) -> list[EffectParameter]:
    """Parameters of the restoring torque, then of each effect."""
    return [*_restoring_parameters(data), *[parameter for effect in effects for parameter in effect.parameters]]
