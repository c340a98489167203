"""Fits by the chord method: steps with one Jacobian, which is corrected by Broyden's update."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray, IntArray
from rovid.core.errors import DataError
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects import Effect
from rovid.estimate.fisher_information import OUTLIER, Innovations
from rovid.estimate.levenberg_marquardt import bounded_step, updated_damping
from rovid.planar.coordinates import PlanarCoordinates
from rovid.planar.likelihood import PlanarLikelihood
from rovid.planar.optimum import PlanarOptimum

# Most steps of a chord fit, and the dampings: first, largest, factor.
STEPS, _FIRST_DAMPING, _MAX_DAMPING, _MORE_DAMPING = 14, 1e-3, 1e4, 10.0


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Residuals of a model and their derivatives, in place of a complete Jacobian at each step of a fit."""

    optimum: PlanarOptimum
    innovations: Innovations
    matrix: FloatArray  #: (2N, p) derivatives of `residual_of` to first order; zero for fixed coordinates.

    @classmethod
    def of(cls, optimum: PlanarOptimum) -> Self:
        """The linearisation at the ``optimum``.

        Raises
        ------
        DataError
            The filter diverges next to the optimum, so that there are no derivatives.
        """
        centre = optimum.likelihood.evaluate(optimum.x)
        free, pieces = optimum.likelihood.jacobian(optimum.x, centre)
        count = len(centre.error)
        matrix = np.zeros((2 * count, len(optimum.x)))
        for piece in pieces:
            matrix[piece.rows, :][:, free], matrix[count:][piece.rows, :][:, free] = np.split(piece.matrix, 2)
        if not np.isfinite(matrix).all():
            raise DataError(
                "the coupled model fits these logs so badly that causes cannot be tested: the filter diverges.",
                mend="Run `rovid check --axes planar`, and `rovid diagnose` for yaw alone.",
            )
        return cls(optimum, centre, matrix)


def residual_of(here: Innovations) -> FloatArray:
    """(2N,) normalised innovations with Huber's limit, and variance residuals; see `Jacobian`."""
    z = here.error / np.sqrt(here.variance)
    limited = np.clip(z, -OUTLIER, OUTLIER)
    return np.concatenate((limited, (1.0 - limited * z) / math.sqrt(2.0)))


def change_between(here: Innovations, there: Innovations) -> FloatArray:
    """(2N,) change of the innovations and of their variances, in the units of `residual_of`."""
    root = np.sqrt(here.variance)
    weight = np.sqrt(np.minimum(1.0, OUTLIER / np.maximum(np.abs(here.error / root), 1e-300)))
    with np.errstate(over="ignore", invalid="ignore"):
        changed = (
            (there.error - here.error) / root * weight,
            (there.variance - here.variance) / (math.sqrt(2.0) * here.variance),
        )
    return np.nan_to_num(np.concatenate(changed), nan=0.0, posinf=1e12, neginf=-1e12)


def chord_fit(
    likelihood: PlanarLikelihood, x: FloatArray, matrix: FloatArray, rows: BoolArray | None = None, steps: int = STEPS
) -> PlanarOptimum:
    """Minimum of the negative log-likelihood near ``x``, by steps with the (2N, p) ``matrix`` of derivatives.

    ``rows`` are the innovations that count; ``matrix`` is changed.
    """
    coordinates = likelihood.coordinates
    two = None if rows is None else np.concatenate((rows, rows))

    def value_of(innovations: Innovations) -> float:
        return likelihood.value_of(innovations if rows is None else Innovations(*(one[rows] for one in innovations)))

    def counted(values: FloatArray) -> FloatArray:
        return values if two is None else values[two]

    here = likelihood.evaluate(x)
    value, damping, small = value_of(here), _FIRST_DAMPING, 0
    information = counted(matrix).T @ counted(matrix)
    for _ in range(steps):
        gradient = counted(matrix).T @ counted(residual_of(here))
        step = bounded_step(x, gradient, information, damping, coordinates.bounds)
        step *= min(1.0, 1.0 / max(float(np.abs(step).max()), 1e-300))
        expected = -float(gradient @ step) - 0.5 * float(step @ information @ step)
        if expected < THRESHOLDS.search_tolerance:
            break
        ahead = coordinates.projected(x + step)
        moved = ahead - x
        there = likelihood.evaluate(ahead)
        gained = value - value_of(there)
        # Broyden's update in the metric of the information, also after a step that fails.
        weighted = np.diag(information) * moved
        length = float(weighted @ moved)
        if length > 0.0:
            missing = change_between(here, there) - matrix @ moved
            if float(counted(missing) @ counted(missing)) < 4.0 * float(moved @ information @ moved):
                matrix += np.outer(missing, weighted / length)
                information = counted(matrix).T @ counted(matrix)
        if gained > 0.0:
            x, here, value = ahead, there, value - gained
            damping = updated_damping(damping, gained / expected)
            small = small + 1 if gained < THRESHOLDS.search_tolerance else 0
            if small > 1:
                break
        else:
            damping *= _MORE_DAMPING
            if damping > _MAX_DAMPING:
                break
    return PlanarOptimum(likelihood, x, value)


def neutral_values(effect: Effect, start: FloatArray) -> FloatArray:
    """(k,) values without the effect, in units of the scales: neutral sizes, the rest as at ``start``."""
    values = start.copy()
    for at, parameter in enumerate(effect.parameters[: effect.size_count]):
        # A size whose neutral value is infinite has nearly no effect far from its start.
        values[at] = 20.0 * start[at] if parameter.neutral_at_infinity else parameter.neutral
    return values


def coordinates_without(fitted: PlanarOptimum, effect: Effect) -> tuple[PlanarCoordinates, FloatArray, IntArray]:
    """Coordinates without one effect, their values, and the kept columns."""
    coordinates, at = fitted.coordinates, fitted.coordinates.effects_begin
    for one in coordinates.effects:
        if one.key == effect.key:
            break
        at += len(one.parameters)
    columns = np.delete(np.arange(len(fitted.x)), np.arange(at, at + len(effect.parameters)))
    left = tuple(one for one in coordinates.effects if one.key != effect.key)
    kept = replace(
        coordinates,
        effects=left,
        units=coordinates.units[columns],
        low=coordinates.low[columns],
        high=coordinates.high[columns],
    )
    return kept, fitted.x[columns], columns
