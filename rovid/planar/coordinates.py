"""Scaled coordinates of a planar fit: order, bounds, and map to model and noise."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray, IntArray
from rovid.effects import Effect, EffectParameter
from rovid.effects.base import Scales
from rovid.estimate.fisher_information import Innovations
from rovid.estimate.maximum_likelihood import DISTURBANCE_LIMITS
from rovid.model.bound_effects import BoundEffect
from rovid.planar.equations import has_couplings, speed_jacobian
from rovid.planar.kernels import NOISE_COUNT, NOISE_LATENCY, NOISE_SENSOR
from rovid.planar.model import BASE_COUNT, INPUT_COUNT, RUDDER_INPUTS, SENSORS, PlanarModel, RudderModel

# Half range of the log inertias about those of the best regression: a factor of 30. Those of sway and yaw are half
# logarithms. The last is that of their coupling.
_INERTIA_RANGE = np.array([3.4, 1.7, 1.7, 3.0])
# Range of the log disturbance below its limit, and its start below it.
_DISTURBANCE_RANGE, _FIRST_DISTURBANCE = 9.0, 0.7
# Bounds of the disturbance's correlation time in time constants, and its start.
_MEMORY_BOUNDS, _FIRST_MEMORY = (0.05, 100.0), 1.0
# Prior of the disturbance: usual share of the forces, usual correlation time in time constants, and standard error of
# the logarithm of each, a factor of 20 both ways in two of them. Without it the likelihood of a disturbance that hardly
# shows is flat, with minima at the bounds (Chung et al. 2013, Psychometrika 78).
_USUAL_DISTURBANCE, _USUAL_MEMORY, _DISTURBANCE_ERROR = 0.01, 2.0, 1.5
# Least and largest straightening of the flow at a rudder and its asymmetry, by published ones of ships; starts.
_STRAIGHTENING, _STRAIGHT = ((0.25, -0.5), (0.8, 0.5)), (0.5, 0.0)
# Least and largest resistance of a rudder. Models of ships have 0.6 to 0.8 (1 - t_R; Yasukawa and Yoshimura 2015), a
# force normal to the blade 1, and many models of fins none.
_RESISTANCE = (0.0, 1.5)
# Least and largest stall angle of a rudder in rad, 15 and 60 deg: those of a spade rudder, and of one in a slipstream.
_STALL = (0.26, 1.05)
# Range of the log noise of a sensor about its start.
_NOISE_RANGE = 4.0
# Least noise of a heading in rad: an instrument resolves no more.
_HEADING_FLOOR = 1e-5
# Sensors of one instrument, which share a latency. That of the heading is zero: the clock of the commands.
_INSTRUMENTS = (("yaw_rate",), ("surge_velocity", "sway_velocity"), ("north", "east"))
# Largest change of a latency in one fit, in the shortest time constant.
_LATENCY_RANGE = 0.7
# Difference step of scaled coordinates. That of effects is relative, to this share of the initial value at least.
_STEP, _LEAST_SIZE = 1e-5, 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarSizes:
    """Typical sizes of a campaign."""

    force: FloatArray  #: (3,) N, N, N m; RMS along each axis.
    speed: FloatArray  #: (3,) m/s, m/s, rad/s; RMS.
    time: FloatArray  #: (3,) s; time constants.
    effects: Scales  #: Of the parameters of effects.
    noise: dict[str, float]  #: Sensor -> standard deviation of its noise at the start.
    inertia: FloatArray  #: (3,) kg, kg, kg m^2; of the best regression.


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarCoordinates:
    """Coordinates x: log-Cholesky inertias (4), drags (6), rudders, effects, log disturbances and times, log noises."""

    sizes: PlanarSizes
    rudders: tuple[RudderModel, ...]
    effects: tuple[Effect, ...]
    sensors: tuple[str, ...]
    units: FloatArray  #: (p,) SI size of one unit of the coordinates of drags, rudders and effects; 1 for logarithms.
    low: FloatArray  #: (p,) bounds; equal ones fix a coordinate.
    high: FloatArray

    @classmethod
    def of(cls, start: PlanarModel, sizes: PlanarSizes, sensors: tuple[str, ...], *, yaw_only: bool) -> Self:
        """Coordinates around ``start`` without effects, with the usual limit of disturbances."""
        rows = [(1.0, -half, half) for half in _INERTIA_RANGE]
        drags = np.concatenate((sizes.force / sizes.speed, sizes.force / sizes.speed**2))
        rows += [(unit, 0.0, np.inf) for unit in drags]
        for rudder in start.rudders:
            arm = max(math.hypot(*rudder.position), 1e-9)
            unit = float(max(sizes.force[1], sizes.force[2] / arm) / sizes.speed[0] ** 2)
            rows += [(unit, 0.0, np.inf), (rudder.slipstream or 1.0, 0.0, 1e3 if rudder.slipstream > 0.0 else 0.0)]
            if rudder.resistance is not None:
                rows += [(1.0, *(_RESISTANCE if not yaw_only else (rudder.resistance,) * 2))]
            if rudder.straightening is not None:
                rows += [(1.0, *bounds) for bounds in zip(*_STRAIGHTENING, strict=True)]
        for force in sizes.force:
            top = math.log(DISTURBANCE_LIMITS[0] * force)
            rows.append((1.0, top - _DISTURBANCE_RANGE, top))
        for time in sizes.time:
            rows.append((1.0, math.log(_MEMORY_BOUNDS[0] * time), math.log(_MEMORY_BOUNDS[1] * time)))
        for name in sensors:
            first = math.log(sizes.noise[name])
            least = max(first - _NOISE_RANGE, math.log(_HEADING_FLOOR) if name == "heading" else -math.inf)
            rows.append((1.0, least, max(first + _NOISE_RANGE, least)))
        rows += [(float(sizes.time.min()), -_LATENCY_RANGE, _LATENCY_RANGE)] * len(_instruments(sensors))
        units, low, high = np.array(rows, dtype=np.float64).T.copy()
        found = cls(sizes=sizes, rudders=start.rudders, effects=(), sensors=sensors, units=units, low=low, high=high)
        if yaw_only:
            fixed = [0, 1, 3, 4, 5, 7, 8]
            low[fixed] = high[fixed] = 0.0
            fixed = [found.noise_begin + at for at in (0, 1, 3, 4)]
            low[fixed] = high[fixed]
        return found

    @property
    def latency_begin(self) -> int:
        """Number of coordinates before those of the latencies of instruments."""
        return self.noise_begin + NOISE_SENSOR + len(self.sensors)

    @property
    def instruments(self) -> tuple[tuple[str, ...], ...]:
        """Sensors of each instrument that may be late."""
        return _instruments(self.sensors)

    def latencies(self, x: FloatArray) -> FloatArray:
        """(6,) latency in s of each of `SENSORS`, beyond that of its stamps."""
        found = np.zeros(len(SENSORS))
        own = x[self.latency_begin :] * self.units[self.latency_begin :]
        for names, value in zip(self.instruments, own.tolist(), strict=True):
            found[list(map(SENSORS.index, names))] = value
        return found

    def on_time(self, fixed: Sequence[bool]) -> Self:
        """The same coordinates with the latency of the instruments that are ``fixed`` at zero."""
        low, high = self.low.copy(), self.high.copy()
        at = np.flatnonzero(fixed) + self.latency_begin
        low[at] = high[at] = 0.0
        return replace(self, low=low, high=high)

    def with_effect(self, effect: Effect) -> Self:
        """The same coordinates with those of one more effect before the disturbance."""
        at = self.noise_begin
        units = list(map(self.sizes.effects.unit_size, effect.parameters))
        low, high = ([getattr(one, side) for one in effect.parameters] for side in ("low", "high"))
        return replace(
            self,
            effects=(*self.effects, effect),
            units=np.insert(self.units, at, units),
            low=np.insert(self.low, at, low),
            high=np.insert(self.high, at, high),
        )

    def with_time_of(self, model: PlanarModel) -> Self:
        """The same coordinates, with the yaw of ``model`` as the unit of the times of further effects.

        The regression at the start leaves the damping of a hull that is steered by a rudder to the lift.
        """
        jacobian, held = np.zeros((3, 3)), np.zeros(INPUT_COUNT + RUDDER_INPUTS * len(model.rudders))
        speed, c = self.sizes.speed, model.coefficients
        speed_jacobian(c, has_couplings(c), held, speed, float(speed[0]), 0.0, float(speed[2]), jacobian)
        if not jacobian[2, 2] < 0.0:
            return self
        effects = replace(self.sizes.effects, time=-1.0 / float(jacobian[2, 2]))
        return replace(self, sizes=replace(self.sizes, effects=effects))

    def straightened(self, x: FloatArray) -> tuple[Self, FloatArray]:
        """The same coordinates with the straightening of the flow at each rudder, and ``x`` at its usual value."""
        at = np.repeat(BASE_COUNT + np.cumsum([len(one.parts) for one in self.rudders]), 2)
        rudders = tuple(replace(one, straightening=_STRAIGHT[0]) for one in self.rudders)

        def longer(values: FloatArray, own: tuple[float, float]) -> FloatArray:
            return np.insert(values, at, np.tile(own, len(rudders)))

        low, high = (longer(*one) for one in zip(self.bounds, _STRAIGHTENING, strict=True))
        found = replace(self, rudders=rudders, units=longer(self.units, (1.0, 1.0)), low=low, high=high)
        return found, longer(x, _STRAIGHT)

    def stalling(self, x: FloatArray, numbers: Sequence[int]) -> tuple[Self, FloatArray, IntArray]:
        """The same coordinates with the stall angles of the rudders with these ``numbers``, ``x``, and their places."""
        ends = BASE_COUNT + np.cumsum([len(one.parts) for one in self.rudders])
        before = ends[list(numbers)]
        rudders = tuple(replace(one, stalls=one.stalls or at in numbers) for at, one in enumerate(self.rudders))
        pairs = (self.units, 1.0), (self.low, _STALL[0]), (self.high, _STALL[1])
        units, low, high = (np.insert(old, before, new) for old, new in pairs)
        longer = np.insert(x, before, [self.rudders[at].stall for at in numbers])
        places = before + np.arange(len(before))
        return replace(self, rudders=rudders, units=units, low=low, high=high), longer, places

    def bounded(self, limits: Mapping[int, tuple[float, float]]) -> Self:
        """The same coordinates with some of them within other ``limits``; equal ones hold a coordinate."""
        low, high = self.low.copy(), self.high.copy()
        for at, pair in limits.items():
            low[at], high[at] = pair
        return replace(self, low=low, high=high)

    @cached_property
    def base_names(self) -> tuple[str, ...]:
        """Names of the parameters before those of effects."""
        return PlanarModel(base=np.zeros(BASE_COUNT), rudders=self.rudders).names

    @cached_property
    def effects_begin(self) -> int:
        """Number of coordinates before those of effects."""
        return BASE_COUNT + sum(len(rudder.parts) for rudder in self.rudders)

    @cached_property
    def noise_begin(self) -> int:
        """Number of coordinates before those of disturbance and noise: the model parameters."""
        return self.effects_begin + len(_parameters(self.effects))

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """(p,) lower and upper bounds."""
        return self.low, self.high

    @property
    def free(self) -> BoolArray:
        """(p,) whether a coordinate is not fixed by its bounds."""
        return np.asarray(self.low < self.high)

    def initial(self, start: PlanarModel, effect_values: Sequence[FloatArray]) -> FloatArray:
        """(p,) coordinates of ``start`` with the ``effect_values`` in SI, and the first disturbance and noise."""
        values = np.concatenate((start.base[4:], *[one.values for one in start.rudders], *effect_values))
        drag = values / self.units[4 : self.noise_begin]
        tops = self.high[self.noise_begin : self.noise_begin + 3] - _FIRST_DISTURBANCE
        times = np.log(_FIRST_MEMORY * self.sizes.time)
        noises = np.log([self.sizes.noise[name] for name in self.sensors])
        late = np.zeros(len(self.instruments))
        x = np.concatenate((log_cholesky(start.mass_matrix, self.sizes.inertia), drag, tops, times, noises, late))
        return np.asarray(np.clip(x, self.low, self.high))

    def values(self, x: FloatArray) -> FloatArray:
        """(q,) model parameters in SI at ``x``, in the order of `PlanarModel.values`."""
        rest = x[4 : self.noise_begin] * self.units[4 : self.noise_begin]
        return np.concatenate((from_log_cholesky(x[:4], self.sizes.inertia), rest))

    def model(self, x: FloatArray) -> PlanarModel:
        """The model at (p,) ``x``."""
        effects = tuple(BoundEffect(effect, np.zeros(len(effect.parameters))) for effect in self.effects)
        empty = PlanarModel(base=np.zeros(BASE_COUNT), effects=effects, rudders=self.rudders)
        return empty.with_values(self.values(x))

    def value_jacobian(self, x: FloatArray) -> FloatArray:
        """(q, noise_begin) derivatives of the model parameters by the coordinates."""
        jacobian = np.diag(self.units[: self.noise_begin].copy())
        for at in range(4):
            step = 1e-6 * (np.arange(4) == at)
            ahead, behind = (from_log_cholesky(x[:4] + s * step, self.sizes.inertia) for s in (1.0, -1.0))
            jacobian[:4, at] = (ahead - behind) / 2e-6
        return jacobian

    def noise(self, x: FloatArray) -> FloatArray:
        """(18,) disturbance, noise and latency as `rovid.planar.kernels` reads them."""
        numbers = np.ones(NOISE_COUNT)
        own = np.exp(x[self.noise_begin : self.latency_begin])
        numbers[:NOISE_SENSOR] = own[:NOISE_SENSOR]
        for name, value in zip(self.sensors, own[NOISE_SENSOR:], strict=True):
            numbers[NOISE_SENSOR + SENSORS.index(name)] = value
        numbers[NOISE_LATENCY:] = self.latencies(x)
        return numbers

    def steps(self, x: FloatArray) -> FloatArray:
        """(p,) positive difference steps at ``x``."""
        step = np.full(len(x), _STEP)
        for at, parameter in enumerate(_parameters(self.effects), start=self.effects_begin):
            first = abs(parameter.initial_values[0]) or 1.0
            step[at] = parameter.step * max(abs(x[at]), _LEAST_SIZE * first)
        return step

    def projected(self, x: FloatArray) -> FloatArray:
        """``x`` within its bounds and with dissipative linear damping.

        The symmetric part of the linear damping of sway and yaw is made positive semidefinite, and the cross-flow drag
        no larger than the quadratic drags that contain it.
        """
        x = np.clip(x, self.low, self.high)
        values = self.values(x)
        at = self.effects_begin
        for effect in self.effects:
            if effect.key == "sway_yaw_damping":
                most = 2.0 * math.sqrt(max(values[5] * values[6], 0.0))
                total = values[at] + values[at + 1]
                if abs(total) > most:
                    excess = 0.5 * (total - math.copysign(most, total))
                    x[at] -= excess / self.units[at]
                    x[at + 1] -= excess / self.units[at + 1]
            if effect.id == "cross_flow_drag" and effect.form != "ship":
                length, centre = max(values[at + 1], 1e-9), values[at + 2] if effect.form else 0.0
                bow, stern = centre + 0.5 * length, centre - 0.5 * length
                most = min(values[8] / length, 4.0 * values[9] / (abs(bow) * bow**3 - abs(stern) * stern**3))
                x[at] = min(x[at], most / self.units[at])
            at += len(effect.parameters)
        return x

    def disturbance_errors(self, x: FloatArray) -> Innovations:
        """(6,) differences of the log disturbances and times from their prior, and its variances; zero where fixed."""
        own = slice(self.noise_begin, self.noise_begin + NOISE_SENSOR)
        usual = np.log(np.concatenate((_USUAL_DISTURBANCE * self.sizes.force, _USUAL_MEMORY * self.sizes.time)))
        return Innovations(np.where(self.free[own], x[own] - usual, 0.0), np.full(NOISE_SENSOR, _DISTURBANCE_ERROR**2))

    def canonical(self, x: FloatArray) -> FloatArray:
        """Equivalent coordinates with currents of 0 or more."""
        tidy, at = x.copy(), self.effects_begin
        for effect in self.effects:
            own = slice(at, at + len(effect.parameters))
            if effect.canonical is not None:
                tidy[own] = effect.canonical(x[own] * self.units[own]) / self.units[own]
            at = own.stop
        return tidy


def _parameters(effects: Sequence[Effect]) -> list[EffectParameter]:
    return [parameter for effect in effects for parameter in effect.parameters]


def _instruments(sensors: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    if "heading" not in sensors:
        return ()
    found = (tuple(name for name in names if name in sensors) for names in _INSTRUMENTS)
    return tuple(names for names in found if names)


def log_cholesky(mass: FloatArray, scale: FloatArray) -> FloatArray:
    """(4,) unbounded coordinates of a positive definite (3, 3) ``mass`` matrix: logarithms of its Cholesky factor.

    ``scale``: (3,) typical inertias.
    """
    sway = 0.5 * np.log(mass[1, 1] / scale[1])
    root = np.sqrt(scale[1] * scale[2])
    coupled = mass[1, 2] / root / np.exp(sway)
    rest = max(mass[2, 2] / scale[2] - coupled**2, 1e-12)
    return np.array([np.log(mass[0, 0] / scale[0]), sway, 0.5 * np.log(rest), coupled])


def from_log_cholesky(numbers: FloatArray, scale: FloatArray) -> FloatArray:
    """(4,) inertias of surge, sway, yaw and their coupling, from the coordinates of `log_cholesky`."""
    surge, sway, yaw, coupled = numbers
    side = np.exp(sway)
    turned = scale[2] * (coupled**2 + np.exp(2.0 * yaw))
    coupling = np.sqrt(scale[1] * scale[2]) * side * coupled
    return np.array([scale[0] * np.exp(surge), scale[1] * side**2, turned, coupling])
