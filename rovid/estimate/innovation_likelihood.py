"""The misfit of each next reading: innovations of an extended Kalman filter."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self, TypeVar

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.spmd import parallel_map
from rovid.core.threads import thread_map
from rovid.effects.base import Term
from rovid.estimate.data_chunk import DataChunk
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fisher_information import Innovations
from rovid.estimate.objective import NegativeLogLikelihood
from rovid.estimate.parametrization import COMMON, DISTURBANCE, MEMORY, NOISE, Parametrization
from rovid.jit.simd import LANES
from rovid.model.filter_batch import FilterInputs, ParameterBatch
from rovid.model.model import Model

One = TypeVar("One")
# A disturbance is at its limit where its logarithm is nearer to that.
_NEAR = 1e-3
# By so much log-likelihood, as nineteen of twenty have it.
_LESS_LIKELY = 2.0


@dataclass(frozen=True, eq=False)
class InnovationLikelihood(NegativeLogLikelihood):
    """Negative log-likelihood of each next reading, predicted from all before it.

    The filter passes over readings that do not count all the same.

    Attributes
    ----------
    portion
        Which portion of the records is looked at; None for all.
    """

    data: InnovationData
    chunk: int | None = None

    method: ClassVar[str] = "maximum likelihood of Kalman-filter innovations"
    bfgs_pairs: ClassVar[int] = 10
    profiles_variance: ClassVar[bool] = False
    simd_slots_left: ClassVar[int] = LANES - 1
    is_smooth: ClassVar[bool] = True

    @cached_property
    def parametrization(self) -> Parametrization:
        """Within physical bounds, and the disturbance below its limit."""
        return Parametrization.of(self.data, self.effects, self.limit)

    @cached_property
    def chunks(self) -> list[Self]:
        """The same of each portion of the records."""
        if len(self.data_chunks) == 1:
            return [self]
        return [replace(self, chunk=number) for number in range(len(self.data_chunks))]

    @cached_property
    def rows(self) -> slice:
        """Which of the innovations that count these are."""
        begin, end = self.data_chunks[0].rows.start, self.data_chunks[-1].rows.stop
        if self.mask is None:
            return slice(begin, end)
        before, until = (int(np.count_nonzero(self.mask[:place])) for place in (begin, end))
        return slice(before, until)

    @property
    def data_chunks(self) -> list[DataChunk]:
        """Portions of the records, one after the other."""
        portions = self.data.chunks
        return portions if self.chunk is None else [portions[self.chunk]]

    @property
    def weight(self) -> float:
        """One: each innovation is news."""
        return 1.0

    @property
    def caveats(self) -> tuple[str, ...]:
        """None."""
        return ()

    def evaluate(self, points: Sequence[FloatArray]) -> list[Innovations]:
        """Of each of the (p,) ``points``, (N,) innovations in rad or m, and rad/s or m/s, with their variances."""
        pairs = [(self, x) for x in points]
        return [one for few in _by(LANES, pairs) for one in _side_by_side(few)]

    def evaluate_nearby(
        self, x: FloatArray, near: Sequence[FloatArray], centre: Innovations | None = None
    ) -> list[Innovations]:
        """As `innovations_of`, of ``x`` and points so ``near`` that differences count; at ``x`` they are ``centre``.

        Filters side by side take the same steps. So each few points have ``x`` beside them, and what they differ from
        it by is free of what a step more or less would make of them.
        """
        if not near:
            return [self.innovations(x) if centre is None else centre]
        groups = _by(LANES - 1, near)
        # Where a pass takes long its results are sooner told to another process than worked out by it.
        among = parallel_map if self._is_slow else thread_map
        found = among(lambda few: _side_by_side([(self, point) for point in (x, *few)]), groups)
        first = found[0][0] if centre is None else centre
        # Of a model that runs away both may be infinite.
        with np.errstate(over="ignore", invalid="ignore"):
            for own, *others in found[0 if first is not found[0][0] else 1 :]:
                for side in others:
                    # In place: there are many of them, and nobody else has them.
                    for here, there, series in zip(own, first, side, strict=True):
                        np.subtract(series, here, out=series)
                        np.add(series, there, out=series)
        return [first, *(side for _, *others in found for side in others)]

    @classmethod
    def evaluate_each(cls, pairs: Sequence[tuple[Self, FloatArray]]) -> list[Innovations]:
        """As `innovations_of`, of misfits of the same records, each at a point of its own; on all cores at once."""
        alike: dict[Hashable, list[int]] = {}
        for at, (misfit, _) in enumerate(pairs):
            alike.setdefault(misfit.batch_key, []).append(at)
        groups = [few for places in alike.values() for few in _by(LANES, places)]
        found: dict[int, Innovations] = {}
        every = thread_map(lambda few: _side_by_side([pairs[at] for at in few]), groups)
        for few, series in zip(groups, every, strict=True):
            found.update(zip(few, series, strict=True))
        return [found[at] for at in range(len(pairs))]

    @cached_property
    def batch_key(self) -> Hashable:
        """The filter and the terms, which all lanes of a pass share."""
        model = self.parametrization.model(self.parametrization.initial())
        return self.has_oscillator, len(model.wave_parameters), *model.terms.kinds.tolist()

    @property
    def has_oscillator(self) -> bool:
        """Whether two states more have to be filtered."""
        return any(effect.oscillatory for effect in self.effects)

    @cached_property
    def _is_slow(self) -> bool:
        """Whether a pass takes much longer than that of the plain model."""
        return self.has_oscillator or any(isinstance(effect.acts, Term) for effect in self.effects)

    def noise_parameters(self, x: FloatArray) -> FloatArray:
        """(4,) as `rovid.model.filter_batch.Abreast` takes it."""
        sizes = np.exp(x[DISTURBANCE:COMMON])
        return np.array([*sizes, sizes[2] if self.data.rate_only else self.data.gyro_noise])

    def held_out_values(self, tests: Sequence[Self], fits: Sequence[FloatArray]) -> list[float]:
        """Cost of each of ``tests`` with the coordinates that were fitted to others."""
        costs = np.zeros(len(tests))
        for portions in zip(*(test.chunks for test in tests), strict=True):
            found = self.evaluate_each(list(zip(portions, fits, strict=True)))
            costs += [portion.cost_of(here) for portion, here in zip(portions, found, strict=True)]
        return costs.tolist()

    def reweighted(self, model: Model) -> Self:  # noqa: ARG002 - as every misfit
        """Itself: each innovation is news."""
        return self

    def split_horizons(self) -> None:
        """None: all look at the next reading."""

    def at_limit(self, x: FloatArray) -> bool:
        """Whether the disturbance would be larger if it might: it is at its limit, and half of that is less likely.

        Where waves or an effect explain all, any size does.
        """
        if x[DISTURBANCE] <= self.parametrization.high[DISTURBANCE] - _NEAR:
            return False
        half = x - math.log(2.0) * (np.arange(len(x)) == DISTURBANCE)
        here, there = self.values([x, half])
        return there - here > _LESS_LIKELY

    def disturbance(self, x: FloatArray) -> tuple[float, float]:
        """Standard deviation of the disturbance torque in N m, and its memory in s."""
        return math.exp(x[DISTURBANCE]), math.exp(x[MEMORY])

    def disturbance_rate_std(self, x: FloatArray) -> float:
        """Standard deviation of the rate that the disturbance drives, about the usual rate."""
        torque, memory = self.disturbance(x)
        return torque * self.parametrization.model(x).rate_std_per_torque(self.data.rms_rate, memory)

    def position_noise(self, x: FloatArray) -> float:
        """Standard deviation of the noise of what is measured."""
        return math.exp(x[NOISE])


def _by(count: int, every: Sequence[One]) -> list[Sequence[One]]:
    """Cut into so many each."""
    return [every[first : first + count] for first in range(0, len(every), count)]


def _side_by_side(pairs: Sequence[tuple[InnovationLikelihood, FloatArray]]) -> list[Innovations]:
    """Innovations of up to LANES models of the same terms and the same records, by one pass over the readings."""
    portions = [misfit.chunks for misfit, _ in pairs]
    if len(portions[0]) == 1:
        return _passed(pairs)
    joined = [Innovations.empty(misfit.rows.stop) for misfit, _ in pairs]

    def passed(each: Sequence[InnovationLikelihood]) -> None:
        few = [(portion, x) for portion, (_, x) in zip(each, pairs, strict=True)]
        for portion, all_of_it, found in zip(each, joined, _passed(few), strict=True):
            all_of_it.error[portion.rows], all_of_it.variance[portion.rows] = found

    thread_map(passed, list(zip(*portions, strict=True)))
    return joined


def _passed(pairs: Sequence[tuple[InnovationLikelihood, FloatArray]]) -> list[Innovations]:
    """As `_side_by_side`, of misfits of one portion."""
    from rovid.model.kernels import ekf3_innovations, ekf5_innovations

    first = pairs[0][0]
    (portion,) = first.data_chunks
    # What is left over is worked out again beside the last.
    every = [pairs[min(at, len(pairs) - 1)] for at in range(LANES)]
    models = [misfit.parametrization.model(x) for misfit, x in pairs]
    models += models[-1:] * (LANES - len(pairs))
    seen = [portion.corrected_angle(model) for model in models]
    driven = FilterInputs.stack([portion.torque_input(model) for model in models], [one.angle for one in seen])
    abreast = ParameterBatch.stack(models, [misfit.noise_parameters(x) for misfit, x in every])
    errors, variances = (ekf5_innovations if first.has_oscillator else ekf3_innovations)(
        portion.filter_data, driven, abreast
    )
    found = []
    for (misfit, _), error, variance, (_, slope) in zip(pairs, errors, variances, seen, strict=False):
        if slope is not None:
            # The density is that of the measured heading, whatever it deviates by.
            told = portion.innovation_index
            gain = np.where(told % 2, 1.0, slope[told // 2])
            error, variance = error * gain, variance * gain**2  # noqa: PLW2901 - of the same innovations
        if misfit.mask is not None:
            counted = misfit.mask[portion.rows]
            error, variance = error[counted], variance[counted]  # noqa: PLW2901 - likewise
        found.append(Innovations(error, variance))
    return found
