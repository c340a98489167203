"""What every misfit that is fitted has in common: its coordinates, its cost, its slopes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray, IntArray
from rovid.core.threads import thread_map
from rovid.effects import Effect
from rovid.estimate.dataset import FitData
from rovid.estimate.fisher_information import (
    Innovations,
    Jacobian,
    jacobian_chunks,
    negative_log_likelihoods,
    total_negative_log_likelihood,
)
from rovid.estimate.parametrization import Parametrization
from rovid.model.model import Model

# A disturbance as large as the torque in use has no limit at all.
UNLIMITED = 1.0

# What tells one model of the same records from another: how much disturbance it is allowed, and its effects.
Key = tuple[float, frozenset[str]]


@dataclass(frozen=True, eq=False)
class NegativeLogLikelihood(ABC):
    """Negative log-likelihood of what was measured, as a function of scaled coordinates.

    Attributes
    ----------
    limit
        Of the disturbance, as a share of the torque in use; infinite where nothing is set aside as a disturbance.
    effects
        Their parameters are the last coordinates, behind those of what weight and buoyancy do.
    counted
        (N,) which innovations count; all of them if None.
    method
        What is likely.
    remembered
        How many points of before tell the curvature, as one climbs.
    profiled
        Whether the variance is that of the innovations themselves: it has no slopes of its own then.
    spare
        How many points more cost no more than one.
    is_smooth
        Whether differences between points near to each other are free of jumps.
    """

    data: FitData
    limit: float = UNLIMITED
    effects: tuple[Effect, ...] = ()
    mask: BoolArray | None = None

    method: ClassVar[str]
    bfgs_pairs: ClassVar[int]
    profiles_variance: ClassVar[bool]
    simd_slots_left: ClassVar[int]
    is_smooth: ClassVar[bool]

    @property
    @abstractmethod
    def parametrization(self) -> Parametrization:
        """What the coordinates stand for, and their bounds."""

    @property
    @abstractmethod
    def weight(self) -> float | FloatArray:
        """Of every innovation, or of each that counts; below one where neighbours tell much the same."""

    @property
    @abstractmethod
    def caveats(self) -> tuple[str, ...]:
        """What has to be said wherever this is what was fitted, in full sentences."""

    @abstractmethod
    def evaluate(self, points: Sequence[FloatArray]) -> list[Innovations]:
        """Of each of the (p,) ``points``, (N,) errors of predictions and their variances, but those not counted."""

    @abstractmethod
    def held_out_values(self, tests: Sequence[Self], fits: Sequence[FloatArray]) -> list[float]:
        """Cost of each of ``tests`` with the coordinates that were fitted to others."""

    @abstractmethod
    def reweighted(self, model: Model) -> Self:
        """The same with as many innovations counted as the errors of ``model`` leave; itself where all count anyway."""

    @abstractmethod
    def split_horizons(self) -> tuple[Self, Self] | None:
        """What looks a short time ahead alone, and what looks far; None where all look at the next reading."""

    @abstractmethod
    def at_limit(self, x: FloatArray) -> bool:
        """Whether the disturbance would be larger if it might."""

    @abstractmethod
    def disturbance(self, x: FloatArray) -> tuple[float, float]:
        """Standard deviation of the disturbance torque in N m, and its memory in s."""

    @abstractmethod
    def disturbance_rate_std(self, x: FloatArray) -> float:
        """Standard deviation of the rate that the disturbance drives, about the usual rate."""

    @abstractmethod
    def position_noise(self, x: FloatArray) -> float:
        """Standard deviation of the noise of what is measured."""

    @property
    def chunks(self) -> Sequence[Self]:
        """The same of some of the innovations after the others, so that no more is held than takes such a portion."""
        return [self]

    @property
    def rows(self) -> slice:
        """Which of the innovations that count these are, where this is of a portion."""
        return slice(0, None)

    def with_effects(self, effects: tuple[Effect, ...], counted: BoolArray | None = None) -> Self:
        """The same question asked of a model with other effects, or of other innovations."""
        return replace(self, effects=effects, mask=counted)

    def with_limit(self, limit: float) -> Self:
        """The same with another limit of the disturbance."""
        return replace(self, limit=limit)

    @property
    def key(self) -> Key:
        """What tells it from others of the same records."""
        return self.limit, frozenset(effect.key for effect in self.effects)

    @property
    def effective_count(self) -> float:
        """How many independent innovations there are."""
        number = len(self.data.run_index) if self.mask is None else int(self.mask.sum())
        return float(np.sum(np.broadcast_to(self.weight, number)))

    @abstractmethod
    def evaluate_nearby(
        self, x: FloatArray, near: Sequence[FloatArray], centre: Innovations | None = None
    ) -> list[Innovations]:
        """As `innovations_of`, of ``x`` and points so ``near`` that differences count; at ``x`` they are ``centre``."""

    @property
    @abstractmethod
    def batch_key(self) -> Hashable:
        """What those have in common that can be looked at side by side, as many as come free with one."""

    @classmethod
    @abstractmethod
    def evaluate_each(cls, pairs: Sequence[tuple[Self, FloatArray]]) -> list[Innovations]:
        """As `innovations_of`, of misfits of the same records, each at a point of its own; on all cores at once."""

    def innovations(self, x: FloatArray) -> Innovations:
        """As `innovations_of`, of one point."""
        return self.evaluate([x])[0]

    def values(self, points: Sequence[FloatArray]) -> list[float]:
        """Negative log-likelihood at each of the (p,) ``points``."""
        each = thread_map(lambda portion: list(map(portion.value_of, portion.evaluate(points))), self.chunks)
        return [sum(costs) for costs in zip(*each, strict=True)]

    def most_likely(self, points: Sequence[FloatArray], count: int) -> list[FloatArray]:
        """So many of the ``points``, the likeliest first."""
        order = np.argsort(self.values(points), kind="stable")
        return [points[at] for at in order[:count]]

    def value(self, x: FloatArray) -> float:
        """Negative log-likelihood."""
        return self.values([x])[0]

    def value_of(self, here: Innovations) -> float:
        """Negative log-likelihood of innovations."""
        return total_negative_log_likelihood(here, self.weight)

    def contributions(self, x: FloatArray) -> FloatArray:
        """(N,) what each innovation adds to the cost."""
        return np.asarray(self.weight * negative_log_likelihoods(*self.innovations(x)))

    def masked(self, series: IntArray) -> IntArray:
        """(n,) those of (N,) ``series`` that belong to innovations that count."""
        return series if self.mask is None else series[self.mask]

    def evaluate_with_spare(self, x: FloatArray) -> tuple[Innovations, list[Innovations]]:
        """What `innovations` gives at ``x``, and one step aside along as many coordinates as come free with it."""
        centre, *sides = self.evaluate_nearby(x, self._aside(x, self._free[: self.simd_slots_left]))
        return centre, sides

    def jacobian(
        self, x: FloatArray, known: tuple[Innovations, Sequence[Innovations]] | None = None
    ) -> Iterator[Jacobian]:
        """Slopes at ``x``, some innovations after the other.

        By forward differences, backward at an upper bound; on all cores at once. ``known`` is what was `looked` at
        already.
        """
        for portion in self.chunks:
            own = known
            if known is not None and portion is not self:
                own = known[0].select(portion.rows), [side.select(portion.rows) for side in known[1]]
            yield from portion.jacobian_between(*portion.perturbed(x, own), self._inward(x))

    def perturbed(
        self, x: FloatArray, known: tuple[Innovations, Sequence[Innovations]] | None = None
    ) -> tuple[Innovations, list[Innovations]]:
        """Innovations at ``x``, and one step aside along each coordinate; ``known`` is what was `looked` at already."""
        centre, sides = self.evaluate_with_spare(x) if known is None else known
        _, *others = self.evaluate_nearby(x, self._aside(x, self._free[len(sides) :]), centre)
        # Along a coordinate that has no choice nothing changes.
        every = [centre] * len(x)
        for at, side in zip(self._free, [*sides, *others], strict=True):
            every[at] = side
        return centre, every

    @cached_property
    def _free(self) -> list[int]:
        """Coordinates that have a choice."""
        return np.flatnonzero(~self.parametrization.fixed()).tolist()

    def _inward(self, x: FloatArray) -> FloatArray:
        """(p,) step aside along each coordinate, within the bounds."""
        step = self.parametrization.difference_steps(x)
        return np.where(x + step > self.parametrization.high, -step, step)

    def _aside(self, x: FloatArray, coordinates: Sequence[int], step: FloatArray | None = None) -> list[FloatArray]:
        """``x`` one ``step`` aside along each of the ``coordinates``."""
        step = self._inward(x) if step is None else step
        return [x + step[k] * (np.arange(len(x)) == k) for k in coordinates]

    def robust_jacobian(self, x: FloatArray) -> Iterator[Jacobian]:
        """As ``slopes``, but of the slopes ahead and behind the flatter for each innovation.

        Where a change cuts an interval into one step more, innovations jump by a part of their error. Over the short
        step of a slope that is more than all others together, but on one side alone.
        """
        if self.is_smooth:
            yield from self.jacobian(x)
            return
        centre, sides = self.perturbed(x)
        ahead = self.jacobian_between(centre, sides, self._inward(x))
        low, high = self.parametrization.bounds
        step = self.parametrization.difference_steps(x)
        # At a bound there is one side, and along stairs all that is told is told by jumps.
        both = (x + step <= high) & (x - step >= low)
        both[self.parametrization.piecewise_constant()] = False
        twice = np.flatnonzero(both)
        centre, *sides = self.evaluate_nearby(x, self._aside(x, twice.tolist(), -step), centre)
        behind = self.jacobian_between(centre, sides, -step[twice])
        for here, back in zip(ahead, behind, strict=True):
            forward = here.matrix[:, twice]
            here.matrix[:, twice] = np.where(np.abs(back.matrix) < np.abs(forward), back.matrix, forward)
            yield here

    def jacobian_between(
        self, centre: Innovations, sides: Sequence[Innovations], step: FloatArray
    ) -> Iterator[Jacobian]:
        """Slopes from the innovations at a point and one ``step`` aside along each coordinate."""
        if self.profiles_variance:
            sides = [side._replace(variance=centre.variance) for side in sides]
        return jacobian_chunks(centre, sides, step, self.weight, first=self.rows.start)
