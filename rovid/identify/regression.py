"""Regression of torque on acceleration, |r| r and r over all excited data, by instrumental variables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rovid.errors import DataError
from rovid.identify.estimate import Estimate
from rovid.model import Model
from rovid.runs import Run
from rovid.trial import FloatArray

NAMES = ("inertia", "quadratic_drag", "linear_drag")
_BLOCK_SECONDS = 20.0
_MIN_BLOCKS = 8
_PASSES = 8
_CONVERGED = 1e-4

ADVICE = "Run sines, steps or a pseudo-random command that change the rate."


@dataclass(frozen=True, kw_only=True, eq=False)
class Regression:
    """The instrumental-variable estimate, and the plain least-squares one to show what the errors cost."""

    estimate: Estimate
    least_squares: FloatArray
    r_squared: float


def fit_regression(runs: Sequence[Run]) -> Regression:
    """Fit T = I rdot + DQ |r| r + DL r, all signals through the same filter.

    Sensor noise and the disturbance torque are in the regressors, which biases least squares. The
    instruments are the same regressors from a noise-free simulation under the measured torque, renewed with
    each estimate (the refined instrumental variable method, Young 2011; Ljung 1999, section 7.6): they know
    the torque but not the noise. Drag is kept from turning negative. The covariance is robust to residuals
    that are correlated within blocks of 20 s.

    Raises
    ------
    DataError
        The vehicle was not excited enough to see its inertia.
    """
    torque, measured, blocks = _assemble(runs, [(run.rates.yaw_rate, run.rates.acceleration) for run in runs])
    _require_motion(measured, torque)
    free = np.ones(3, dtype=bool)
    plain = _solve(measured, measured, torque, free)
    values = _physical_start(plain, measured, torque)
    for _ in range(_PASSES):
        instruments = _simulated(runs, Model(inertia=values[0], quadratic_drag=values[1], linear_drag=values[2]))
        free = np.ones(3, dtype=bool)
        new = _solve(instruments, measured, torque, free)
        while (new[free] < 0.0).any() and free[1:].any():
            free[1 + int(np.argmin(new[1:] / np.abs(plain[1:]).clip(1e-12)))] = False
            new = _solve(instruments, measured, torque, free)
        if not new[0] > 0.0:
            raise _not_excited("the inertia comes out negative")
        done = bool(np.all(np.abs(new - values) <= _CONVERGED * np.abs(new).clip(1e-12)))
        values = new
        if done:
            break
    residuals = torque - measured @ values
    covariance = _robust_covariance(instruments, measured, residuals, blocks, free)
    estimate = Estimate(
        names=NAMES,
        values=values,
        covariance=covariance,
        method="regression on all excited data, instrumental variables",
        samples=len(torque),
        degrees_of_freedom=float(len(np.unique(blocks)) - int(free.sum())),
        warnings=tuple(
            f"{name} would come out negative in the regression; it is held at zero, its lower bound."
            for name, kept in zip(NAMES, free, strict=True)
            if not kept
        ),
    )
    if estimate.value("inertia") < 3.0 * estimate.standard_error("inertia"):
        raise _not_excited(
            f"the inertia is {estimate.value('inertia'):.3g} ± {estimate.standard_error('inertia'):.2g} kg m^2"
        )
    spread = float(np.sum((torque - torque.mean()) ** 2))
    return Regression(estimate=estimate, least_squares=plain, r_squared=1.0 - float(residuals @ residuals) / spread)


def _assemble(
    runs: Sequence[Run], motions: Sequence[tuple[FloatArray, FloatArray]]
) -> tuple[FloatArray, FloatArray, NDArray[np.intp]]:
    """(n,) torque, (n, 3) regressors of the given motions and (n,) block number at every valid instant."""
    torque, columns, blocks, first = [], [], [], 0
    for run, (rate, acceleration) in zip(runs, motions, strict=True):
        rows = run.valid
        columns.append(np.column_stack((acceleration, np.abs(rate) * rate, rate))[rows])
        torque.append(run.drive[rows])
        number = first + (run.rates.time[rows] // _BLOCK_SECONDS).astype(np.intp)
        blocks.append(number)
        first = int(number[-1]) + 1 if len(number) else first
    return np.concatenate(torque), np.concatenate(columns), np.concatenate(blocks)


def _simulated(runs: Sequence[Run], model: Model) -> FloatArray:
    motions = []
    for run in runs:
        rate, _ = model.simulate(run.trial, run.torque)
        on_grid = np.interp(run.rates.time, run.trial.time, rate)
        kernel = run.rates.kernel
        motions.append((kernel.smooth(on_grid), kernel.rate(on_grid)))
    return np.asarray(np.nan_to_num(_assemble(runs, motions)[1]))


def _solve(instruments: FloatArray, measured: FloatArray, torque: FloatArray, free: NDArray[np.bool_]) -> FloatArray:
    values = np.zeros(3)
    z, x = instruments[:, free], measured[:, free]
    scale = np.linalg.norm(x, axis=0)
    moments = z.T @ (x / scale)
    values[free] = np.linalg.lstsq(moments, z.T @ torque, rcond=1e-12)[0] / scale
    return values


def _physical_start(plain: FloatArray, measured: FloatArray, torque: FloatArray) -> FloatArray:
    """Least squares where it is physical; else an inertia and one quadratic drag that are."""
    if (plain > 0.0).all():
        return plain
    from scipy.optimize import nnls

    scale = np.linalg.norm(measured, axis=0)
    values = nnls(measured / scale, torque)[0] / scale
    floor = 1e-3 * np.linalg.norm(torque) / scale
    return np.asarray(np.maximum(values, floor * np.array([1.0, 0.0, 1.0])))


def _robust_covariance(
    instruments: FloatArray,
    measured: FloatArray,
    residuals: FloatArray,
    blocks: NDArray[np.intp],
    free: NDArray[np.bool_],
) -> FloatArray:
    """Sandwich covariance with the scores summed over blocks, small-sample corrected."""
    z, x = instruments[:, free], measured[:, free]
    scores = np.stack([np.bincount(blocks, weights=column * residuals) for column in z.T], axis=1)
    count = int(np.sum(np.bincount(blocks) > 0))
    bread = np.linalg.inv(z.T @ x)
    covariance = np.zeros((3, 3))
    correction = count / max(count - free.sum(), 1)
    covariance[np.ix_(free, free)] = bread @ (scores.T @ scores) @ bread.T * correction
    return covariance


def _require_motion(measured: FloatArray, torque: FloatArray) -> None:
    if not len(torque):
        raise _not_excited("no stretch is long enough for the filter")
    if not np.any(torque):
        raise _not_excited("the thrusters never push")
    if np.std(measured[:, 2]) == 0.0:
        raise _not_excited("the rate never changes")


def _not_excited(found: str) -> DataError:
    return DataError(f"inertia cannot be determined from these logs: {found}.", mend=ADVICE)
