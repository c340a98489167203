"""Regression of the missing torque on the products of the grammar.

The Kalman filter turns a torque that the model lacks into innovations, which are independent with known variances. The
response of the innovations to each product is the regressor. It is the weak form of the regression: the test functions
are the responses of the filter, no measured signal is differentiated, and the covariance of the smoothed missing torque
is taken into account (de Jong 1991, equivalence of innovations and smoothed disturbances).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.core.spmd import parallel_map
from rovid.diagnose.formulas.grammar import Grammar
from rovid.diagnose.formulas.products import Product
from rovid.effects import Effect, EffectParameter
from rovid.effects.actuator_inputs import ActuatorInputs
from rovid.effects.base import OnTorque, Values
from rovid.estimate.fisher_information import Jacobian
from rovid.estimate.fit_result import FitResult

Form = TypeVar("Form")
# Products whose responses are computed at once.
_AT_ONCE = 32
# Size of a torque in the RMS torque in use, for the difference quotient.
_SIZE = 0.01
# Least share of its information that is left to a product next to the model's parameters; with less, the linearisation
# misleads.
_LEAST_SHARE = 1e-3


@dataclass(frozen=True, eq=False)
class InnovationRegression:
    """Normal equations of p parameters of a model and q regressors, for each of b blocks of the data."""

    gradient: FloatArray  #: (b, p + q)
    own: FloatArray  #: (b, p, p) information of the parameters.
    cross: FloatArray  #: (b, p, q)
    power: FloatArray  #: (b, q) information of each regressor.
    between: FloatArray  #: (q, q) information between regressors, of all blocks; empty where it is not asked for.

    def gains(self, weights: FloatArray | None = None) -> FloatArray:
        """(q,) log-likelihood gain in nats of each regressor alone; ``weights`` are counts of (b,) blocks."""
        w = np.ones(len(self.own)) if weights is None else weights
        count = self.own.shape[1]
        gradient, cross, power = w @ self.gradient, np.tensordot(w, self.cross, 1), w @ self.power
        moved = np.linalg.pinv(np.tensordot(w, self.own, 1), rcond=1e-12) @ cross
        score = gradient[count:] - moved.T @ gradient[:count]
        left = power - np.sum(cross * moved, axis=0)
        known = left > _LEAST_SHARE * np.maximum(power, 1e-300)
        return np.where(known, 0.5 * score**2 / np.where(known, left, 1.0), 0.0)

    def correlation(self) -> FloatArray:
        """(q, q) correlation of the regressors next to the model's parameters; 0 for regressors without power."""
        cross = self.cross.sum(axis=0)
        left = self.between - cross.T @ np.linalg.pinv(self.own.sum(axis=0), rcond=1e-12) @ cross
        size = np.sqrt(np.maximum(np.diag(left), 0.0))
        known = np.outer(size, size) > 0.0
        return np.where(known, left / np.where(known, np.outer(size, size), 1.0), 0.0)


def product_effects(grammar: Grammar, products: Sequence[Product]) -> list[Effect]:
    """Each product as an effect with the measured motion, for regression alone."""
    return [series_effect(f"product {k}", grammar.values(product)) for k, product in enumerate(products)]


def series_effect(name: str, series: Mapping[str, FloatArray]) -> Effect:
    """A torque that follows a series of each trial, by its name; the size is that of its RMS value."""
    every = np.concatenate(list(series.values()))
    size = max(float(np.sqrt(np.mean(every**2))), 1e-300)
    scaled = {trial: values / size for trial, values in series.items()}

    def changed(inputs: ActuatorInputs, torque: FloatArray, values: Values) -> FloatArray:
        return np.asarray(torque + values["size"] * inputs.from_trials(scaled))

    parameter = EffectParameter(
        name="size", unit="N m", neutral=0.0, low=-5.0, high=5.0, initial_values=(_SIZE,), scale="torque"
    )
    return Effect(
        id=name,
        title=name,
        parameters=(parameter,),
        equation=name,
        fingerprint=name,
        experiment=name,
        acts=OnTorque(changed),
    )


def regress(
    fitted: FitResult,
    forms: Sequence[Form],
    effects_of: Callable[[Sequence[Form]], Sequence[Effect]],
    *,
    jointly: bool = True,
) -> InnovationRegression:
    """Normal equations of the first start of the effect of each of the ``forms`` next to a fitted model.

    ``jointly``: Whether the regressors are compared with each other. All of them are then kept, in one process.
    """
    number = np.unique(fitted.objective.masked(fitted.data.block_index), return_inverse=True)[1]
    chunks = []
    for chunk in fitted.objective.chunks:
        known = chunk.evaluate_with_spare(fitted.x)
        chunks.append((known[0], list(chunk.jacobian(fitted.x, known))))
    own = [piece for _, pieces in chunks for piece in pieces]
    gradient, information, _ = _summed(own, own, number)

    def columns(some: Sequence[Form]) -> list[Jacobian]:
        others = [fitted.objective.with_effects((*fitted.effects, effect)) for effect in effects_of(some)]
        points = [np.concatenate((fitted.x, other.parametrization.initial_values()[0])) for other in others]
        found = list[Jacobian]()
        for index, (centre, _) in enumerate(chunks):
            chunk = fitted.objective.chunks[index]
            sides = chunk.evaluate_each([(one.chunks[index], x) for one, x in zip(others, points, strict=True)])
            found += chunk.jacobian_between(centre, sides, np.ones(len(sides)))
        # A model may diverge with a torque of that size: such a product explains nothing.
        return [replace(one, matrix=np.nan_to_num(one.matrix, posinf=0.0, neginf=0.0)) for one in found]

    groups = [forms[first : first + _AT_ONCE] for first in range(0, len(forms), _AT_ONCE)]
    between = np.zeros((0, 0))
    if jointly:
        every = list(map(columns, groups))
        sums = [_summed(own, few, number) for few in every]
        joined = (np.hstack([one.matrix for one in pieces]) for pieces in zip(*every, strict=True))
        between = np.sum([matrix.T @ matrix for matrix in joined], axis=0)
    else:
        sums = parallel_map(lambda some: _summed(own, columns(some), number), groups)
    gradients, cross, power = zip(*sums, strict=True)
    return InnovationRegression(
        np.hstack((gradient, *gradients)), information, np.concatenate(cross, axis=2), np.hstack(power), between
    )


def _summed(
    own: Sequence[Jacobian], others: Sequence[Jacobian], number: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Of each of b blocks: gradient by q ``others``, (b, p, q) information between p ``own`` and these, and theirs."""
    count, p, q = int(number.max()) + 1, own[0].matrix.shape[1], others[0].matrix.shape[1]
    gradient, cross, power = np.zeros((count, q)), np.zeros((count, p, q)), np.zeros((count, q))
    for mine, theirs in zip(own, others, strict=True):
        blocks, begins = np.unique(number[mine.rows], return_index=True)
        half = mine.rows.stop - mine.rows.start
        for begin in (0, half):
            for block, first, end in zip(blocks, begin + begins, begin + np.append(begins[1:], half), strict=True):
                part = theirs.matrix[first:end]
                gradient[block] += part.T @ mine.residual[first:end]
                cross[block] += mine.matrix[first:end].T @ part
                power[block] += np.sum(part**2, axis=0)
    return gradient, cross, power


def inclusion(found: InnovationRegression, prices: FloatArray, rng: np.random.Generator, draws: int) -> FloatArray:
    """(draws,) index of the regressor with the largest gain less its price, in each draw of blocks with replacement."""
    count = len(found.own)
    chosen: list[int] = []
    for _ in range(draws):
        weights: IntArray = np.bincount(rng.integers(0, count, count), minlength=count)
        chosen.append(int(np.argmax(found.gains(weights.astype(float)) - prices)))
    return np.array(chosen)
