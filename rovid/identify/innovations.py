"""The likelihood of Kalman-filter innovations, its derivatives, and how to climb it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from rovid.campaign.vehicle import PLAUSIBLE_RATIO
from rovid.effects import Effect, restoring_of
from rovid.ground.arrays import BoolArray, FloatArray, IntArray
from rovid.ground.workers import spread
from rovid.identify.records import ANGLE_NOISE_FLOOR, Records
from rovid.identify.scoring import OUTLIER, bounded_step, costs, damped, with_curvature
from rovid.model.drive import Drive
from rovid.model.model import Model

# Coordinates before those of effects and of what weight and buoyancy do: log I, DQ and DL over their scale, log of
# the disturbance's size and memory, log of the measurement's noise.
BASE = 6
DISTURBANCE, MEMORY, NOISE = 3, 4, 5
# Of the usual rate: how well the first rate of a trial is known.
_RATE_ERROR = 0.2
# Step for slopes of the logarithms and scaled drags.
_STEP = 1e-5
# No step changes a logarithm by more: far from the top the slopes promise too much.
_LONGEST = 1.0
_LOGARITHMS = [0, DISTURBANCE, MEMORY, NOISE]
_WORST = 1e12
# Sizes of the disturbance, of the torque in use, and memories in s, to begin with.
_SHARES, _MEMORIES = (0.01, 0.1, 1.0), (0.3, 4.0)
# How many drives are kept as one climbs: where one is, and the latest two beside it.
_DRIVES = 3


@dataclass(frozen=True, eq=False)
class Slopes:
    """The likelihood about a point.

    Attributes
    ----------
    cost
        Negative log-likelihood.
    residual
        (2N,) normalised innovations above, and what their squares are short of one below.
    matrix
        (2N, p) slopes of the same: the gradient of the cost is ``matrix.T @ residual``, the information ``matrix.T @
        matrix`` (Fisher scoring).
    """

    cost: float
    residual: FloatArray
    matrix: FloatArray


class Likelihood:
    """Negative log-likelihood of the innovations as a function of scaled coordinates; see ``BASE``.

    Attributes
    ----------
    method
        What is likely.
    weight
        Of every innovation, or of each that counts; below one where neighbours tell much the same.
    remembered
        How many points of before tell the curvature, as one climbs.

    Parameters
    ----------
    limit
        Of the disturbance, as a share of the torque in use.
    effects
        Their parameters are the last coordinates, behind those of what weight and buoyancy do.
    counted
        (N,) which innovations count; all of them if None. The filter passes over the others all the same.
    """

    method = "maximum likelihood of Kalman-filter innovations"
    weight: float | FloatArray = 1.0
    remembered = 10

    def __init__(
        self,
        records: Records,
        limit: float,
        effects: tuple[Effect, ...] = (),
        counted: BoolArray | None = None,
    ) -> None:
        self.records = records
        self.limit = limit
        self.effects = effects
        self.counted = counted
        restoring = restoring_of(records.axis)
        self.restoring = () if restoring is None else restoring.parameters
        own = [parameter for effect in effects for parameter in effect.parameters]
        self.parameters = [*self.restoring, *own]
        self.units = np.array([records.scales.of(parameter) for parameter in self.parameters])
        top = math.log(limit * records.torque)
        inertia = math.log(records.start.inertia)
        # Without a drive nothing tells the inertia.
        open_by = 2.5 if records.driven else 0.0
        low = [inertia - open_by, 0.0, 0.0, top - 9.0, math.log(0.2), math.log(ANGLE_NOISE_FLOOR)]
        high = [inertia + open_by, np.inf, np.inf, top, math.log(100.0), math.log(0.2)]
        self.low = np.array(low + [parameter.low for parameter in self.parameters])
        self.high = np.array(high + [parameter.high for parameter in self.parameters])
        self._bound_frequencies()
        self._drives: dict[tuple[float, ...], list[Drive]] = {}

    def _bound_frequencies(self) -> None:
        """Keep what swings by itself slower than readings show (Nyquist)."""
        period = min(run.trial.period for run in self.records.runs)
        fastest = math.pi / max(self.records.interval, period)
        parameters = [(effect, parameter) for effect in self.effects for parameter in effect.parameters]
        for at, (effect, parameter) in enumerate(parameters, start=self.base):
            if effect.oscillates and parameter.name == "frequency":
                self.high[at] = max(min(self.high[at], fastest), self.low[at])

    def starts(self) -> list[FloatArray]:
        """Where to begin the search for the parameters of the last effect, within their bounds."""
        own = slice(len(self.low) - len(self.effects[-1].parameters), None)
        within = np.clip(self.effects[-1].starts, self.low[own], self.high[own])
        found = []
        for k, start in enumerate(within):
            same = (within[:k] == start).all(axis=1)
            # Two starts beyond a bound are one within it.
            if not same.any():
                found.append(start)
        return found

    def like(self, effects: tuple[Effect, ...], counted: BoolArray | None = None) -> Self:
        """The same question asked of a model with other effects, or of other innovations."""
        return type(self)(self.records, self.limit, effects, counted)

    def held_out_costs(self, tests: Sequence[Self], fits: Sequence[FloatArray]) -> list[float]:
        """Cost of each of ``tests`` with the coordinates that were fitted to others."""
        return [test.cost(x) for test, x in zip(tests, fits, strict=True)]

    @property
    def base(self) -> int:
        """How many coordinates stand before those of the effects."""
        return BASE + len(self.restoring)

    def at_limit(self, x: FloatArray) -> bool:
        """Whether the disturbance would be larger if it might."""
        return bool(x[DISTURBANCE] > self.high[DISTURBANCE] - 1e-3)

    def disturbance(self, x: FloatArray) -> tuple[float, float]:
        """Standard deviation of the disturbance torque in N m, and its memory in s."""
        return math.exp(x[DISTURBANCE]), math.exp(x[MEMORY])

    def is_physical(self, x: FloatArray) -> bool:
        """Whether the inertia is one that such a vehicle can have, or no farther from that than before any effect.

        In slow motion, too, it is no less than the rigid body's, whatever water goes along.
        """
        vehicle = self.records.vehicle
        rigid = None if vehicle is None else vehicle.rigid_body_inertia
        if rigid is None or not self.records.driven:
            return True
        low, high = PLAUSIBLE_RATIO
        before, model = self.records.start.inertia, self.model(x)
        # What thrust is taken for may be off, and with it every inertia.
        least = min(low * rigid, low * before)
        most = max(high * rigid, before / low)
        return least <= min(model.inertia, model.slow_inertia) and model.inertia <= most

    def driven_rate(self, x: FloatArray) -> float:
        """Standard deviation of the rate that the disturbance drives, about the usual rate."""
        torque, memory = self.disturbance(x)
        return torque * self.model(x).restlessness(self.records.rate, memory)

    def position_noise(self, x: FloatArray) -> float:
        """Standard deviation of the noise of what is measured."""
        return math.exp(x[NOISE])

    def of_model(self, x: FloatArray) -> tuple[list[int], FloatArray]:
        """Which coordinates are the model's own parameters, and the change of each of those with its coordinate."""
        own = [0, 1, 2, *range(BASE, len(x))]
        return own, np.array([math.exp(x[0]), *self.records.drag_scale, *self.units])

    def first(self) -> FloatArray:
        """Coordinates to start from, each effect at the first of its starts."""
        start, scale = self.records.start, self.records.drag_scale
        own = len(self.restoring)
        x = [
            math.log(start.inertia),
            start.quadratic_drag / scale[0],
            start.linear_drag / scale[1],
            min(math.log(0.01 * self.records.torque), self.high[DISTURBANCE] - 0.1),
            math.log(4.0),
            math.log(self.records.position_noise),
            *(np.array(start.restoring_values) / self.units[:own]),
            *[parameter.starts[0] for parameter in self.parameters[own:]],
        ]
        return np.asarray(np.clip(x, self.low, self.high))

    def disturbed(self, x: FloatArray) -> FloatArray:
        """``x`` with the likeliest of a few disturbances: unlimited, a climb from one far too small goes astray."""
        begins = []
        for share, memory in itertools.product(_SHARES, _MEMORIES):
            begin = x.copy()
            begin[DISTURBANCE] = math.log(share * self.records.torque)
            begin[MEMORY] = math.log(memory)
            begins.append(np.clip(begin, self.low, self.high))
        return min(begins, key=self.cost)

    def model(self, x: FloatArray) -> Model:
        """The model at ``x``."""
        sizes = tuple(float(value) for value in x[BASE:] * self.units)
        return Model(
            inertia=math.exp(x[0]),
            quadratic_drag=float(x[1] * self.records.drag_scale[0]),
            linear_drag=float(x[2] * self.records.drag_scale[1]),
            effects=self.effects,
            effect_values=sizes[len(self.restoring) :],
            axis=self.records.axis,
            restoring_values=sizes[: len(self.restoring)],
        )

    def drives(self, model: Model) -> list[Drive]:
        """What drives each run after the effects between command and torque, held between the instants."""
        key = model.drivetrain.values
        found = self._drives.pop(key, None) or self.records.drives_between(model)
        # The slopes along all other parameters ask for the same again, and so does the next step.
        self._drives[key] = found
        for old in list(self._drives)[:-_DRIVES]:
            self._drives.pop(old, None)
        return found

    def innovations(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(N,) innovations in rad and their variances; those not counted are left out."""
        from rovid.model.kernels import innovations, innovations_wide

        records, model = self.records, self.model(x)
        is_wide = any(effect.oscillates for effect in model.effects)
        sizes = np.exp(x[DISTURBANCE:BASE])
        gyro_noise = sizes[2] if records.integrated else records.gyro_noise
        noise = np.array([*sizes, gyro_noise])
        errors, variances = [], []
        parts = zip(records.runs, self.drives(model), records.angles, records.gyro_rates, strict=True)
        for number, (run, drive, angle, gyro) in enumerate(parts):
            start = np.array([records.initial_rates[number], _RATE_ERROR * records.rate])
            true, gain = model.instrument.true_angle(run.trial, angle, records.instants[number])
            driven = (records.times[number], drive.torque, drive.beside, drive.moment, drive.scatter)
            motion = (model.equation_in(run.trial), noise)
            if is_wide:
                error, variance = innovations_wide(*driven, true, gyro, *motion, model.wave, start)
            else:
                error, variance = innovations(*driven, true, gyro, *motion, start)
            known, known_rates = records.known[number], records.known_rates[number]
            # The density is that of the measured heading, whatever it deviates by.
            errors += [error[known, 0] * gain[known], error[known_rates, 1]]
            variances += [variance[known, 0] * gain[known] ** 2, variance[known_rates, 1]]
        error, variance = np.concatenate(errors), np.concatenate(variances)
        if self.counted is None:
            return error, variance
        return error[self.counted], variance[self.counted]

    @property
    def count(self) -> float:
        """How many independent innovations there are."""
        number = len(self.records.trial) if self.counted is None else int(self.counted.sum())
        return float(np.sum(np.broadcast_to(self.weight, number)))

    def cost(self, x: FloatArray) -> float:
        """Negative log-likelihood."""
        return self.cost_of(*self.innovations(x))

    def cost_of(self, error: FloatArray, variance: FloatArray) -> float:
        """Negative log-likelihood of innovations of these variances."""
        total = float(np.sum(self.weight * costs(error, variance)))
        if not math.isfinite(total):
            return _WORST
        return total

    def pieces(self, error: FloatArray, variance: FloatArray) -> FloatArray:
        """(N,) what each innovation adds to the cost."""
        return np.asarray(self.weight * costs(error, variance))

    def scores(self, here: Slopes, group: IntArray) -> FloatArray:
        """(m, p) gradient of the cost over each (N,) ``group``; their scatter tells what the information does not."""
        if self.counted is not None:
            group = group[self.counted]
        score = here.matrix * here.residual[:, None]
        # Those of the innovations, and of their variances below.
        score = score[: len(group)] + score[len(group) :]
        used, number = np.unique(group, return_inverse=True)
        sums = [np.bincount(number, weights=column, minlength=len(used)) for column in score.T]
        return np.column_stack(sums)

    def _steps(self, x: FloatArray) -> FloatArray:
        """Small changes of ``x``: an effect's parameter in proportion to itself, or to its start where it is gone."""
        starts = np.array([abs(parameter.starts[0]) or 1.0 for parameter in self.parameters])
        shares = np.array([parameter.step for parameter in self.parameters])
        own = shares * np.maximum(np.abs(x[BASE:]), 0.1 * starts)
        return np.concatenate((np.full(BASE, _STEP), own))

    def slopes(self, x: FloatArray, centre: tuple[FloatArray, FloatArray] | None = None) -> Slopes:
        """Slopes at ``x`` by forward differences, backward at an upper bound; on all cores at once.

        ``centre`` is what `innovations` gives at ``x``, where that is known already.
        """
        step = self._steps(x)
        centre = self.innovations(x) if centre is None else centre
        inward = np.where(x + step > self.high, -step, step)
        return self._slopes_over(inward, x, centre, range(len(x)))

    def flatter_slopes(self, x: FloatArray) -> Slopes:
        """As ``slopes``, but of the slopes ahead and behind the flatter for each innovation.

        Where a change cuts an interval of the filter into one step more, innovations jump by a part of their error.
        Over the short step of a slope that is more than all others together, but on one side alone.
        """
        step, centre = self._steps(x), self.innovations(x)
        here = self.slopes(x, centre)
        # Along stairs all that is told is told by jumps, and at a bound there is one side.
        stairs = np.array([False] * BASE + [parameter.stairs for parameter in self.parameters])
        twice = np.flatnonzero(~stairs & (x + step <= self.high) & (x - step >= self.low))
        ahead = here.matrix[:, twice]
        behind = self._slopes_over(-step, x, centre, twice.tolist()).matrix
        here.matrix[:, twice] = np.where(np.abs(behind) < np.abs(ahead), behind, ahead)
        return here

    def _slopes_over(
        self, step: FloatArray, x: FloatArray, centre: tuple[FloatArray, FloatArray], coordinates: Sequence[int]
    ) -> Slopes:
        sides = spread(lambda k: self._aside(x, centre, k, float(step[k])), coordinates)
        return self.slopes_between(centre, sides, step[list(coordinates)])

    def _aside(
        self, x: FloatArray, centre: tuple[FloatArray, FloatArray], coordinate: int, step: float
    ) -> tuple[FloatArray, FloatArray]:
        """Innovations and variances one ``step`` aside along a coordinate; ``centre`` are those at ``x``."""
        if self.low[coordinate] == self.high[coordinate]:
            return centre
        moved = x.copy()
        moved[coordinate] += step
        return self.innovations(moved)

    def slopes_between(
        self,
        centre: tuple[FloatArray, FloatArray],
        sides: Sequence[tuple[FloatArray, FloatArray]],
        step: FloatArray,
    ) -> Slopes:
        """Slopes from innovations and variances at a point and one ``step`` aside along each coordinate."""
        error, variance = centre
        root = np.sqrt(variance)
        z = error / root
        # So that squares have the weights.
        share = np.sqrt(self.weight)
        weight = share * np.sqrt(np.minimum(1.0, OUTLIER / np.maximum(np.abs(z), 1e-300)))
        matrix = np.empty((2 * len(z), len(sides)))
        # A model that runs away has no slopes, which whoever asks can see.
        with np.errstate(over="ignore", invalid="ignore"):
            for k, (side, scatter) in enumerate(sides):
                matrix[: len(z), k] = weight * (side - error) / (step[k] * root)
                matrix[len(z) :, k] = share * (scatter - variance) / (step[k] * math.sqrt(2.0) * variance)
        residual = np.concatenate((weight * z, (share - (weight * z) ** 2 / share) / math.sqrt(2.0)))
        return Slopes(self.cost_of(error, variance), residual, matrix)

    def climb(self, start: FloatArray, *, iterations: int = 60, tolerance: float = 0.01) -> tuple[FloatArray, float]:
        """Most likely coordinates from ``start`` and their cost, by Fisher scoring within the bounds.

        Ends when less than ``tolerance`` of log-likelihood is still to be gained.
        """
        x = np.clip(start, self.low, self.high)
        damping = 1e-3
        centre = self.innovations(x)
        cost = self.cost_of(*centre)
        been: list[tuple[FloatArray, FloatArray]] = []
        for _ in range(iterations):
            here = self.slopes(x, centre)
            gradient, information = here.matrix.T @ here.residual, here.matrix.T @ here.matrix
            if not np.isfinite(information).all():
                break
            been = [*been, (x, gradient)][-self.remembered - 1 :]
            information = with_curvature(information, been)
            moved = False
            while damping < 1e6:
                step = bounded_step(x, gradient, information, damping, (self.low, self.high))
                longest = float(np.max(np.abs(step[_LOGARITHMS])))
                step *= min(1.0, _LONGEST / max(longest, 1e-300))
                promised = -float(gradient @ step)
                trial = np.clip(x + step, self.low, self.high)
                there = self.innovations(trial)
                reached = self.cost_of(*there)
                if reached < cost:
                    expected = promised - 0.5 * float(step @ information @ step)
                    damping = damped(damping, (cost - reached) / max(expected, 1e-300))
                    moved = True
                    break
                if promised < tolerance:
                    break
                damping *= 10.0
            if not moved:
                break
            gained, cost, x, centre = cost - reached, reached, trial, there
            if gained < tolerance:
                break
        self._drives.clear()
        return x, cost
