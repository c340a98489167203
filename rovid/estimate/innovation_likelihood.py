"""Negative log-likelihood of the innovations of an extended Kalman filter."""

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from typing import ClassVar, Self, TypeVar

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.spmd import parallel_map
from rovid.core.threads import thread_map
from rovid.effects.base import Term
from rovid.estimate.filter_data import DataChunk, InnovationData
from rovid.estimate.fisher_information import Innovations
from rovid.estimate.objective import NegativeLogLikelihood
from rovid.estimate.parametrization import COMMON, DISTURBANCE, MEMORY, NOISE, Parametrization
from rovid.jit.simd import LANES
from rovid.model.filter_batch import FilterInputs, ParameterBatch
from rovid.model.model import Model

One = TypeVar("One")
# Distance of the logarithm of the disturbance from its limit within which it counts as at the limit.
_LIMIT_TOLERANCE = 1e-3
# Loss of log-likelihood (nats) at half the disturbance that shows the limit to be active; about a 95 % interval.
_LOSS_AT_HALF = 2.0
# Gain of log-likelihood by a disturbance beyond the limit, from which it exceeds the limit significantly: half the
# square of the one-sided 95 % quantile of a Gaussian. Relative change of the disturbance for its first two derivatives.
_GAIN_BEYOND_LIMIT = 1.35
_LIMIT_STEP = 0.1


@dataclass(frozen=True, eq=False)
class InnovationLikelihood(NegativeLogLikelihood):
    """Negative log-likelihood of each reading, predicted from all readings before it; docs/method.md, (12).

    Masked readings still update the filter.
    """

    data: InnovationData
    chunk: int | None = None  #: Number of the chunk of the data that is evaluated; None for all.

    method: ClassVar[str] = "maximum likelihood of Kalman-filter innovations"
    bfgs_pairs: ClassVar[int] = 10
    profiles_variance: ClassVar[bool] = False
    simd_slots_left: ClassVar[int] = LANES - 1
    is_smooth: ClassVar[bool] = True

    @cached_property
    def parametrization(self) -> Parametrization:
        """Coordinates within physical bounds, and the disturbance below its limit."""
        return Parametrization.of(self.data, self.effects, self.limit)

    @cached_property
    def chunks(self) -> list[Self]:
        """The objective of each chunk of the data."""
        if len(self.data_chunks) == 1:
            return [self]
        return [replace(self, chunk=number) for number in range(len(self.data_chunks))]

    @cached_property
    def rows(self) -> slice:
        """Rows of these innovations among the used ones."""
        begin, end = self.data_chunks[0].rows.start, self.data_chunks[-1].rows.stop
        if self.mask is None:
            return slice(begin, end)
        return slice(int(self.mask[:begin].sum()), int(self.mask[:end].sum()))

    @property
    def data_chunks(self) -> list[DataChunk]:
        """The chunks of the data that are evaluated."""
        chunks = self.data.chunks
        return chunks if self.chunk is None else [chunks[self.chunk]]

    @property
    def weight(self) -> float:
        """1: innovations are independent."""
        return 1.0

    @cached_property
    def batch_key(self) -> Hashable:
        """The filter and the kinds of terms, which all lanes of a pass share."""
        model = self.parametrization.model(self.parametrization.initial())
        return self.has_oscillator, len(model.wave_parameters), *model.terms.kinds.tolist()

    @property
    def has_oscillator(self) -> bool:
        """Whether the filter has two more states for an oscillating effect."""
        return any(effect.oscillatory for effect in self.effects)

    def evaluate(self, points: Sequence[FloatArray]) -> list[Innovations]:
        """For each of the (p,) ``points``, (N,) innovations in rad or m, and rad/s or m/s, with their variances."""
        return [one for few in _groups(LANES, [(self, x) for x in points]) for one in _evaluate_batch(few)]

    def evaluate_nearby(
        self, x: FloatArray, near: Sequence[FloatArray], centre: Innovations | None = None
    ) -> list[Innovations]:
        """As `evaluate`, at ``x`` and at ``near`` points for finite differences; ``centre`` is the known value at x.

        All lanes of a pass take the same integration steps. So ``x`` is one lane of each pass, and differences are
        taken within the pass, where a changed number of steps cancels.
        """
        if not near:
            return [self.innovations(x) if centre is None else centre]
        groups = _groups(LANES - 1, near)
        # A slow pass is worth sending its results between processes.
        slow = self.has_oscillator or any(isinstance(effect.acts, Term) for effect in self.effects)
        run = parallel_map if slow else thread_map
        found = run(lambda few: _evaluate_batch([(self, point) for point in (x, *few)]), groups)
        first = found[0][0] if centre is None else centre
        # Both may be infinite where the model diverges.
        with np.errstate(over="ignore", invalid="ignore"):
            for own, *others in found[1 if centre is None else 0 :]:
                for side in others:
                    # In place: the arrays are large, and nothing else refers to them.
                    for here, there, series in zip(own, first, side, strict=True):
                        np.subtract(series, here, out=series)
                        np.add(series, there, out=series)
        return [first, *(side for _, *others in found for side in others)]

    @classmethod
    def evaluate_each(cls, pairs: Sequence[tuple[Self, FloatArray]]) -> list[Innovations]:
        """As `evaluate`, of objectives of the same data, each at a point of its own, on all cores."""
        by_key: dict[Hashable, list[int]] = {}
        for at, (objective, _) in enumerate(pairs):
            by_key.setdefault(objective.batch_key, []).append(at)
        groups = [few for places in by_key.values() for few in _groups(LANES, places)]
        every = thread_map(lambda few: _evaluate_batch([pairs[at] for at in few]), groups)
        found = dict(zip(chain(*groups), chain(*every), strict=True))
        return [found[at] for at in range(len(pairs))]

    def held_out_values(self, tests: Sequence[Self], fits: Sequence[FloatArray]) -> list[float]:
        """Value of each of the ``tests`` at coordinates fitted to other innovations."""
        values = np.zeros(len(tests))
        for chunks in zip(*(test.chunks for test in tests), strict=True):
            found = self.evaluate_each(list(zip(chunks, fits, strict=True)))
            values += [chunk.value_of(here) for chunk, here in zip(chunks, found, strict=True)]
        return values.tolist()

    def reweighted(self, model: Model) -> Self:  # noqa: ARG002 - as every objective
        """Itself: innovations are independent."""
        return self

    def split_horizons(self) -> None:
        """None: all are one-step predictions."""

    def at_limit(self, x: FloatArray) -> bool:
        """Whether the disturbance is at its limit, half of it is less likely, and a larger one significantly likelier.

        Where waves or an effect explain everything, any size of the disturbance is as likely. A disturbance that is as
        large as the limit by itself is not limited.
        """
        if x[DISTURBANCE] <= self.parametrization.high[DISTURBANCE] - _LIMIT_TOLERANCE:
            return False
        moves = 0.0, -math.log(2.0), _LIMIT_STEP, -_LIMIT_STEP
        here, half, above, below = self.values([x + move * (np.arange(len(x)) == DISTURBANCE) for move in moves])
        if half - here <= _LOSS_AT_HALF:
            return False
        slope, bend = (below - above) / (2.0 * _LIMIT_STEP), (above + below - 2.0 * here) / _LIMIT_STEP**2
        # A Newton step beyond the limit gains slope^2 / (2 bend).
        return slope > 0.0 and slope**2 > 2.0 * _GAIN_BEYOND_LIMIT * bend

    def disturbance(self, x: FloatArray) -> tuple[float, float]:
        """Standard deviation of the disturbance torque in N m, and its correlation time in s."""
        return math.exp(x[DISTURBANCE]), math.exp(x[MEMORY])

    def position_noise(self, x: FloatArray) -> float:
        """Standard deviation of the measurement noise."""
        return math.exp(x[NOISE])


def _groups(count: int, every: Sequence[One]) -> list[Sequence[One]]:
    """Consecutive groups of up to ``count`` elements."""
    return [every[first : first + count] for first in range(0, len(every), count)]


def _evaluate_batch(pairs: Sequence[tuple[InnovationLikelihood, FloatArray]]) -> list[Innovations]:
    """Innovations of up to LANES models with the same terms and the same data, by one pass over all readings."""
    chunks = [objective.chunks for objective, _ in pairs]
    if len(chunks[0]) == 1:
        return _filter_chunk(pairs)
    counts = [objective.rows.stop for objective, _ in pairs]
    joined = [Innovations(np.empty(count), np.empty(count)) for count in counts]

    def fill(each: Sequence[InnovationLikelihood]) -> None:
        few = [(chunk, x) for chunk, (_, x) in zip(each, pairs, strict=True)]
        for chunk, whole, found in zip(each, joined, _filter_chunk(few), strict=True):
            whole.error[chunk.rows], whole.variance[chunk.rows] = found

    thread_map(fill, list(zip(*chunks, strict=True)))
    return joined


def _filter_chunk(pairs: Sequence[tuple[InnovationLikelihood, FloatArray]]) -> list[Innovations]:
    """As `_evaluate_batch`, of objectives of one chunk."""
    from rovid.model.kernels import ekf3_innovations, ekf5_innovations

    first = pairs[0][0]
    (chunk,) = first.data_chunks
    # Unused lanes repeat the last model.
    filled = [pairs[min(at, len(pairs) - 1)] for at in range(LANES)]
    models = [objective.parametrization.model(x) for objective, x in pairs]
    models += models[-1:] * (LANES - len(pairs))
    corrected = list(map(chunk.corrected_angle, models))
    torque_inputs, angles = list(map(chunk.inputs.between_steps, models)), [one.angle for one in corrected]
    inputs = FilterInputs.stack(torque_inputs, angles)
    noise = []
    for objective, x in filled:
        sizes = np.exp(x[DISTURBANCE:COMMON])
        noise.append(np.array([*sizes, sizes[2] if objective.data.rate_only else objective.data.gyro_noise]))
    batch = ParameterBatch.stack(models, noise)
    kernel = ekf5_innovations if first.has_oscillator else ekf3_innovations
    errors, variances = kernel(chunk.filter_data, inputs, batch)
    if chunk.unknown_pasts is not None:
        chunk.unknown_pasts.correct(kernel, models, batch, torque_inputs, angles, (errors, variances))
    found = []
    for (objective, _), error, variance, (_, slope) in zip(pairs, errors, variances, corrected, strict=False):
        if slope is not None:
            # The likelihood is that of the measured heading, including its deviation.
            index = chunk.innovation_index
            gain = np.where(index % 2, 1.0, slope[index // 2])
            error, variance = error * gain, variance * gain**2  # noqa: PLW2901 - of the same innovations
        if objective.mask is not None:
            used = objective.mask[chunk.rows]
            error, variance = error[used], variance[used]  # noqa: PLW2901 - likewise
        found.append(Innovations(error, variance))
    return found
