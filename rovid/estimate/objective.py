"""The abstract negative log-likelihood that the optimiser minimises: coordinates, values, derivatives."""

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

# Limit of the disturbance that is no limit: as large as the torque in use.
UNLIMITED = 1.0

# Identity of a model among those of the same data: the limit of its disturbance and its effects.
ModelKey = tuple[float, frozenset[str]]


@dataclass(frozen=True, eq=False)
class NegativeLogLikelihood(ABC):
    """Negative log-likelihood of the measurements, as a function of (p,) scaled coordinates.

    The two final subclasses are `rovid.estimate.innovation_likelihood.InnovationLikelihood` and
    `rovid.estimate.multi_step.MultiStepLikelihood`. An innovation is here the error of any prediction.
    """

    data: FitData
    #: Upper limit of the disturbance, as a share of the torque in use; infinite for an objective without disturbance.
    limit: float = UNLIMITED
    #: Effects of the model. Their parameters are the last coordinates, after those of the restoring torque.
    effects: tuple[Effect, ...] = ()
    mask: BoolArray | None = None  #: (N,) which innovations are used; None for all.

    method: ClassVar[str]  #: Name of the method for reports.
    bfgs_pairs: ClassVar[int]  #: Number of past steps that correct the curvature.
    #: Whether the variance is estimated from the innovations themselves; it then has no derivatives.
    profiles_variance: ClassVar[bool]
    simd_slots_left: ClassVar[int]  #: Number of further points that one evaluation takes without extra time.
    is_smooth: ClassVar[bool]  #: Whether finite differences are free of jumps.

    @property
    @abstractmethod
    def parametrization(self) -> Parametrization:
        """The coordinates, their bounds, and the map to model parameters."""

    @property
    @abstractmethod
    def weight(self) -> float | FloatArray:
        """Weight of the innovations, one for all or (N,) of the used ones; below 1 where neighbours are correlated."""

    @property
    @abstractmethod
    def batch_key(self) -> Hashable:
        """Key that is equal for objectives which one SIMD pass can evaluate together."""

    @abstractmethod
    def evaluate(self, points: Sequence[FloatArray]) -> list[Innovations]:
        """For each of the (p,) ``points``, the (N,) used innovations and their variances."""

    @abstractmethod
    def evaluate_nearby(
        self, x: FloatArray, near: Sequence[FloatArray], centre: Innovations | None = None
    ) -> list[Innovations]:
        """As `evaluate`, at ``x`` and at ``near`` points for finite differences; ``centre`` is the known value at x."""

    @classmethod
    @abstractmethod
    def evaluate_each(cls, pairs: Sequence[tuple[Self, FloatArray]]) -> list[Innovations]:
        """As `evaluate`, of objectives of the same data, each at a point of its own, on all cores."""

    @abstractmethod
    def held_out_values(self, tests: Sequence[Self], fits: Sequence[FloatArray]) -> list[float]:
        """Value of each of the ``tests`` at coordinates fitted to other innovations."""

    @abstractmethod
    def reweighted(self, model: Model) -> Self:
        """The objective with weights by the correlation of the errors of ``model``; itself where weights are fixed."""

    @abstractmethod
    def split_horizons(self) -> tuple[Self, Self] | None:
        """The short and the long predictions alone; None where all are one-step predictions."""

    @abstractmethod
    def at_limit(self, x: FloatArray) -> bool:
        """Whether the likelihood grows with the disturbance at its limit."""

    @abstractmethod
    def disturbance(self, x: FloatArray) -> tuple[float, float]:
        """Standard deviation of the disturbance torque in N m, and its correlation time in s."""

    @abstractmethod
    def position_noise(self, x: FloatArray) -> float:
        """Standard deviation of the measurement noise."""

    @property
    @abstractmethod
    def chunks(self) -> Sequence[Self]:
        """The objective of each part of the innovations, evaluated one at a time to bound memory."""

    @property
    @abstractmethod
    def rows(self) -> slice:
        """Rows of these innovations among the used ones, where this is the objective of a chunk."""

    def with_effects(self, effects: tuple[Effect, ...], mask: BoolArray | None = None) -> Self:
        """The objective of a model with other effects, or with another mask."""
        return replace(self, effects=effects, mask=mask)

    def with_limit(self, limit: float) -> Self:
        """The objective with another limit of the disturbance."""
        return replace(self, limit=limit)

    @property
    def key(self) -> ModelKey:
        """Identity among the objectives of the same data."""
        return self.limit, frozenset(effect.key for effect in self.effects)

    @property
    def effective_count(self) -> float:
        """Number of independent innovations."""
        number = len(self.data.run_index) if self.mask is None else int(self.mask.sum())
        return float(np.sum(np.broadcast_to(self.weight, number)))

    def innovations(self, x: FloatArray) -> Innovations:
        """As `evaluate`, at one point."""
        return self.evaluate([x])[0]

    def values(self, points: Sequence[FloatArray]) -> list[float]:
        """Negative log-likelihood at each of the (p,) ``points``."""
        each = thread_map(lambda chunk: list(map(chunk.value_of, chunk.evaluate(points))), self.chunks)
        return list(map(sum, zip(*each, strict=True)))

    def value(self, x: FloatArray) -> float:
        """Negative log-likelihood."""
        return self.values([x])[0]

    def value_of(self, here: Innovations) -> float:
        """Negative log-likelihood of innovations."""
        return total_negative_log_likelihood(here, self.weight)

    def contributions(self, x: FloatArray) -> FloatArray:
        """(N,) contribution of each innovation to the negative log-likelihood."""
        return np.asarray(self.weight * negative_log_likelihoods(*self.innovations(x)))

    def most_likely(self, points: Sequence[FloatArray], count: int) -> list[FloatArray]:
        """The ``count`` most likely of the ``points``, best first."""
        return [points[at] for at in np.argsort(self.values(points), kind="stable")[:count]]

    def masked(self, series: IntArray) -> IntArray:
        """(n,) elements of the (N,) ``series`` that belong to used innovations."""
        return series if self.mask is None else series[self.mask]

    def evaluate_with_spare(self, x: FloatArray) -> tuple[Innovations, list[Innovations]]:
        """Innovations at ``x``, and one step away along as many coordinates as take no extra time."""
        centre, *sides = self.evaluate_nearby(x, self._moved(x, self._free[: self.simd_slots_left]))
        return centre, sides

    def jacobian(
        self, x: FloatArray, known: tuple[Innovations, Sequence[Innovations]] | None = None
    ) -> Iterator[Jacobian]:
        """Jacobians at ``x``, some innovations at a time, by forward differences (backward at an upper bound).

        ``known`` is the result of `evaluate_with_spare` at ``x``, where it is at hand.
        """
        for chunk in self.chunks:
            own = known
            if known is not None and chunk is not self:
                own = known[0].select(chunk.rows), [side.select(chunk.rows) for side in known[1]]
            yield from chunk.jacobian_between(*chunk.perturbed(x, own), self._steps(x))

    def perturbed(
        self, x: FloatArray, known: tuple[Innovations, Sequence[Innovations]] | None = None
    ) -> tuple[Innovations, list[Innovations]]:
        """Innovations at ``x``, and one step away along each coordinate; ``known`` as in `jacobian`."""
        centre, sides = self.evaluate_with_spare(x) if known is None else known
        _, *others = self.evaluate_nearby(x, self._moved(x, self._free[len(sides) :]), centre)
        # Along a fixed coordinate nothing changes.
        every = [centre] * len(x)
        for at, side in zip(self._free, [*sides, *others], strict=True):
            every[at] = side
        return centre, every

    @cached_property
    def _free(self) -> list[int]:
        """Coordinates that are not fixed."""
        return np.flatnonzero(~self.parametrization.fixed()).tolist()

    def _steps(self, x: FloatArray) -> FloatArray:
        """(p,) signed difference steps that stay within the bounds."""
        step = self.parametrization.difference_steps(x)
        return np.where(x + step > self.parametrization.high, -step, step)

    def _moved(self, x: FloatArray, coordinates: Sequence[int], step: FloatArray | None = None) -> list[FloatArray]:
        """``x`` moved by one ``step`` along each of the ``coordinates``."""
        step = self._steps(x) if step is None else step
        return [x + step[k] * (np.arange(len(x)) == k) for k in coordinates]

    def robust_jacobian(self, x: FloatArray) -> Iterator[Jacobian]:
        """As `jacobian`, with the smaller of the forward and the backward difference for each innovation.

        Where a parameter moves a threshold across a sample, the filter takes one step more and the innovations jump by
        a part of their error. Over a difference step such a jump dominates, but only on one side.
        """
        if self.is_smooth:
            yield from self.jacobian(x)
            return
        centre, sides = self.perturbed(x)
        ahead = self.jacobian_between(centre, sides, self._steps(x))
        low, high = self.parametrization.bounds
        step = self.parametrization.difference_steps(x)
        # At a bound there is one side only, and a piecewise constant likelihood consists of jumps.
        both = (x + step <= high) & (x - step >= low)
        both[self.parametrization.piecewise_constant()] = False
        twice = np.flatnonzero(both)
        centre, *sides = self.evaluate_nearby(x, self._moved(x, twice.tolist(), -step), centre)
        behind = self.jacobian_between(centre, sides, -step[twice])
        for here, back in zip(ahead, behind, strict=True):
            forward = here.matrix[:, twice]
            here.matrix[:, twice] = np.where(np.abs(back.matrix) < np.abs(forward), back.matrix, forward)
            yield here

    def jacobian_between(
        self, centre: Innovations, sides: Sequence[Innovations], step: FloatArray
    ) -> Iterator[Jacobian]:
        """Jacobians from the innovations at a point and one ``step`` away along each coordinate."""
        if self.profiles_variance:
            sides = [side._replace(variance=centre.variance) for side in sides]
        return jacobian_chunks(centre, sides, step, self.weight, first=self.rows.start)
