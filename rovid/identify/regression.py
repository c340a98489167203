"""Regression of torque on acceleration, |r| r and r over all excited data, by instrumental variables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rovid.errors import DataError
from rovid.identify.estimate import Estimate
from rovid.model import Drive, Model
from rovid.runs import Run
from rovid.trial import FloatArray

NAMES = ("inertia", "quadratic_drag", "linear_drag")
# A block has to be long beside the memory of waves and eddies, and there have to be enough of them.
_BLOCK_SECONDS = 40.0
_BLOCKS = 12
_PASSES = 8
_CONVERGED = 1e-4

ADVICE = "Run sines, steps or a pseudo-random command that change the rate."


@dataclass(frozen=True, kw_only=True, eq=False)
class Regression:
    """The instrumental-variable estimate, and the plain least-squares one to show what the errors cost."""

    estimate: Estimate
    least_squares: FloatArray
    r_squared: float


def fit_regression(runs: Sequence[Run], *, certainty: float = 3.0) -> Regression:
    """Fit T = I rdot + DQ |r| r + DL r, all signals through the same filter.

    Sensor noise and the disturbance torque are in the regressors, which biases least squares. The
    instruments are the same regressors from a noise-free simulation under the measured torque, renewed with
    each estimate (the refined instrumental variable method, Young 2011; Ljung 1999, section 7.6): they know
    the torque but not the noise. Drag is kept from turning negative. The covariance is a jackknife
    over blocks of 40 s (shorter where the logs are), within which the residuals may be correlated.

    Parameters
    ----------
    certainty
        Standard errors by which the inertia has to differ from zero.

    Raises
    ------
    DataError
        The vehicle was not excited enough to see its inertia.
    """
    torque, blocks = _torque(runs)
    raw = np.concatenate([_regressors(run.rates.yaw_rate, run.rates.acceleration)[run.valid] for run in runs])
    _require_motion(raw, torque)
    plain = _solve(raw, raw, torque, np.ones(3, dtype=bool))
    values = _physical_start(plain, raw, torque)
    for _ in range(_PASSES):
        instruments, correction = _simulated(runs, values)
        measured = raw + correction
        free, new = _bounded(instruments, measured, torque)
        done = bool(np.all(np.abs(new - values) <= _CONVERGED * np.abs(new).clip(1e-12)))
        values = new
        if done:
            break
    residuals = torque - measured @ values
    # That of the free fit even where a drag is at its bound: it would take the zero for certain, and the rest with it.
    covariance = _jackknife_covariance(instruments, measured, torque, blocks)
    estimate = Estimate(
        names=NAMES,
        values=values,
        covariance=covariance,
        method="regression on all excited data, instrumental variables",
        samples=len(torque),
        degrees_of_freedom=float(len(np.unique(blocks)) - len(NAMES)),
        warnings=tuple(
            f"{name} would come out negative in the regression; it is held at zero, its lower bound."
            for name, kept in zip(NAMES, free, strict=True)
            if not kept
        ),
    )
    require_inertia(estimate, certainty)
    spread = float(np.sum((torque - torque.mean()) ** 2))
    return Regression(estimate=estimate, least_squares=plain, r_squared=1.0 - float(residuals @ residuals) / spread)


def require_inertia(estimate: Estimate, certainty: float) -> None:
    """Refuse an inertia that is less than ``certainty`` standard errors away from nothing.

    Raises
    ------
    DataError
        It is.
    """
    value, error = estimate.value("inertia"), estimate.standard_error("inertia")
    if value < certainty * error:
        raise _not_excited(f"the inertia is {value:.3g} ± {error:.2g} kg m^2")


def _torque(runs: Sequence[Run]) -> tuple[FloatArray, NDArray[np.intp]]:
    """(n,) torque and block number at every valid instant of all runs."""
    length = min(_BLOCK_SECONDS, sum(run.valid.sum() * run.rates.kernel.period for run in runs) / _BLOCKS)
    torque, blocks, first = [], [], 0
    for run in runs:
        torque.append(run.drive[run.valid])
        blocks.append(first + (run.rates.time[run.valid] // length).astype(np.intp))
        first = int(np.max(blocks[-1], initial=first)) + 1
    return np.concatenate(torque), np.concatenate(blocks)


def _regressors(rate: FloatArray, acceleration: FloatArray) -> FloatArray:
    return np.column_stack((acceleration, np.abs(rate) * rate, rate))


def _simulated(runs: Sequence[Run], values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n, 3) regressors of the noise-free simulation, and what filtering does to its square.

    The low pass of |r| r is not |r| r of the low pass; the difference, small but in step with the
    acceleration, is taken from the simulation and added to the measured regressors.
    """
    model = Model(inertia=values[0], quadratic_drag=values[1], linear_drag=values[2])
    instruments, corrections = [], []
    for run in runs:
        kernel = run.rates.kernel
        rate = np.interp(run.rates.time, run.trial.time, model.simulate(run.trial, Drive.held(run.torque))[0])
        columns = _regressors(kernel.smooth(rate), kernel.rate(rate))
        correction = np.zeros_like(columns)
        correction[:, 1] = kernel.smooth(np.abs(rate) * rate) - columns[:, 1]
        instruments.append((columns + correction)[run.valid])
        corrections.append(correction[run.valid])
    # The simulation's filter has no answer where the measurement's has none either, but for the gyro's gaps.
    return np.nan_to_num(np.concatenate(instruments)), np.nan_to_num(np.concatenate(corrections))


def _bounded(instruments: FloatArray, measured: FloatArray, torque: FloatArray) -> tuple[NDArray[np.bool_], FloatArray]:
    """Which parameters are free, and all their values; a drag that would turn negative is held at zero."""
    free = np.ones(3, dtype=bool)
    values = _solve(instruments, measured, torque, free)
    while (values[1:] < 0.0).any():
        free[1 + int(np.argmin(values[1:] * np.linalg.norm(measured[:, 1:], axis=0)))] = False
        values = _solve(instruments, measured, torque, free)
    if not values[0] > 0.0:
        raise DataError(
            "the inertia comes out negative: the vehicle turns against its torque, or hardly at all.",
            mend=f"Check in rovid.toml the signs of yaw_arm, command and heading. {ADVICE}",
        )
    return free, values


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


def _jackknife_covariance(
    instruments: FloatArray,
    measured: FloatArray,
    torque: FloatArray,
    blocks: NDArray[np.intp],
) -> FloatArray:
    """Covariance from leaving out one block at a time, which allows for residuals correlated within blocks."""
    z, x = instruments, measured / (scale := np.linalg.norm(measured, axis=0))
    edges = np.flatnonzero(np.diff(blocks, prepend=-1))
    moments = np.add.reduceat(z[:, :, None] * x[:, None, :], edges)
    work = np.add.reduceat(z * torque[:, None], edges)
    others = np.linalg.pinv(moments.sum(axis=0) - moments)
    without = (others @ (work.sum(axis=0) - work)[:, :, None])[:, :, 0] / scale
    count = len(edges)
    deviations = without - without.mean(axis=0)
    return np.asarray((count - 1) / count * deviations.T @ deviations)


def _require_motion(measured: FloatArray, torque: FloatArray) -> None:
    if not len(torque):
        raise _not_excited("no stretch is long enough for the filter")
    if not np.any(torque):
        raise _not_excited("the thrusters never push")
    if np.std(measured[:, 2]) == 0.0:
        raise _not_excited("the rate never changes")


def _not_excited(found: str) -> DataError:
    return DataError(f"inertia cannot be determined from these logs: {found}.", mend=ADVICE)
