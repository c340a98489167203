"""Regressions that start the likelihood fits.

Instrumental variables regress the torque on acceleration, |r| r, r and position over all excited data. The output-error
fit then minimises the squared error of the free-running rate within physical bounds.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray, IntArray
from rovid.core.errors import DataError
from rovid.core.formatting import plus_minus
from rovid.core.spmd import parallel_map
from rovid.effects import restoring_effect
from rovid.effects.restoring_curve import from_regressors, regressors
from rovid.estimate.dataset import rms, rms_rate, time_constant
from rovid.estimate.estimate import Estimate, r_squared, varies
from rovid.model.model import Model
from rovid.model.parameter_names import base_names
from rovid.model.simulation import simulated_rate
from rovid.model.torque_input import TorqueInput
from rovid.trial.axis import Axis
from rovid.trial.preprocessing import Run
from rovid.trial.segments import coarse_text

# Slice of the drags among the unknowns: inertia, quadratic and linear drag, and those of the restoring torque.
_DRAGS = slice(1, 3)
# Share of samples, and of the largest value, that noise and filters may take below zero.
_FEW = 0.02
# Shortest jackknife block in periods of the cut-off, longer than the memory of waves and eddies; usual number of blocks
# in all logs, and the least number.
_BLOCK, _USUAL_BLOCKS, _BLOCKS = 30.0, 60, 12
# Largest number of renewals of the instruments, and the relative change at which they have converged.
_PASSES, _CONVERGED = 8, 1e-4
# Least ratio of the rate's standard deviation to that of its noise: half the power is motion.
_MIN_MOTION = 2.0**0.5

EXCITATION_ADVICE = "Run sines, steps or a pseudo-random command that change the rate."
FINER_ADVICE = "Log it with more digits, or log the rate of a gyro too."
# Least number of standard errors of the inertia from zero. Steady holds are compatible with any inertia.
MIN_INERTIA_SIGMAS = 2.0
# Shortest time constant of a first model, in sampling intervals.
_SHORTEST_DECAY = 0.2
# Least scale of a trim in rad, and of a lift or a stiffness over the RMS torque.
_LEAST_RESTORING = 1e-2


@dataclass(frozen=True, kw_only=True, eq=False)
class Regression:
    """The instrumental-variable estimate, and the (p,) plain least-squares one, which shows the bias by noise.

    ``r_squared`` is NaN where the torque never changes.
    """

    estimate: Estimate
    least_squares: FloatArray
    r_squared: float


def fit_regression(runs: Sequence[Run], *, min_sigmas: float = 3.0) -> Regression:
    """Fit T = I rdot + DQ |r| r + DL r + g, all signals through the same filter; g is the restoring torque.

    Sensor noise and the disturbance torque are in the regressors, which biases least squares. The
    instruments are the same regressors from a noise-free simulation under the measured torque, renewed with
    each estimate (the refined instrumental variable method, Young 2011; Ljung 1999, section 7.6). They are
    correlated with the torque but not with the noise. Drag is bounded below by zero. The covariance is a jackknife
    over 12 to 60 blocks, within which the residuals may be correlated. docs/method.md, (10).

    Raises DataError if the vehicle was not excited enough to determine its inertia.

    ``min_sigmas``: Least number of standard errors of the inertia from zero.
    """
    try:
        found = _regression(tuple(runs))
        require_inertia(found.estimate, min_sigmas)
        return found
    except DataError as error:
        # Where the readings are coarse, signs and commands are not the first suspects.
        if coarse := coarse_text([run.trial for run in runs]):
            raise DataError(f"inertia cannot be determined from these logs: {coarse}.", mend=FINER_ADVICE) from error
        raise


# A fit and a diagnosis need the fits of all trials, and of folds of them, more than once.
@functools.lru_cache(maxsize=2)
def _regression(runs: tuple[Run, ...]) -> Regression:
    torque, blocks = _torque_and_blocks(runs)
    axis = runs[0].trial.axis
    raw = _measured_regressors(runs)[np.concatenate([run.valid for run in runs])]
    _require_motion(runs, raw, torque)
    plain = _solve(raw, raw, torque, np.ones(raw.shape[1], dtype=bool))
    values = _physical_start(plain, raw, torque)
    for _ in range(_PASSES):
        instruments, correction = _instruments(runs, _model(axis, values))
        measured = raw + correction
        free, new = _bounded(instruments, measured, torque, axis)
        done = bool(np.all(np.abs(new - values) <= _CONVERGED * np.abs(new).clip(1e-12)))
        values = new
        if done:
            break
    residuals = torque - measured @ values
    # The covariance is that of the free fit, since taking a drag's zero as certain would understate all errors.
    # (p, p) covariance by leaving out one block at a time, for residuals that are correlated within blocks.
    scale = np.linalg.norm(measured, axis=0)
    z, x = instruments, measured / scale
    edges = np.flatnonzero(np.diff(blocks, prepend=-1))
    moments = np.add.reduceat(z[:, :, None] * x[:, None, :], edges)
    products = np.add.reduceat(z * torque[:, None], edges)
    # Sums over all blocks less one.
    inverses = np.linalg.pinv(moments.sum(axis=0) - moments)
    other_products = products.sum(axis=0) - products
    without = (inverses @ other_products[:, :, None])[:, :, 0] / scale
    count = len(edges)
    deviations = without - without.mean(axis=0)
    covariance = np.asarray((count - 1) / count * deviations.T @ deviations)
    names = base_names(axis)
    # (p, p) derivatives of the parameters by the unknowns.
    steps = np.diag(1e-6 * np.maximum(np.abs(values), 1e-9))
    here = _model(axis, values).values
    derivatives = np.column_stack([(_model(axis, values + step).values - here) / step.sum() for step in steps])
    text = "{} would come out negative in the regression; it is held at zero, its lower bound."
    estimate = Estimate(
        names=names,
        values=_model(axis, values).values,
        covariance=derivatives @ covariance @ derivatives.T,
        method="regression on all excited data, instrumental variables",
        samples=len(torque),
        degrees_of_freedom=float(len(np.unique(blocks)) - len(names)),
        warnings=tuple(map(text.format, compress(names, ~free))),
        axis=axis,
    )
    return Regression(estimate=estimate, least_squares=plain, r_squared=r_squared(torque, residuals))


def fit_free_swings(runs: Sequence[Run]) -> Model:
    """Least squares of the acceleration in free swings; inertia 1 kg m^2, all torques per kg m^2.

    Raises DataError if the vehicle does not swing.
    """
    from scipy.optimize import lsq_linear

    axis = runs[0].trial.axis
    every = _measured_regressors(runs)[np.concatenate([run.rates.valid for run in runs])]
    acceleration, others = every[:, 0], np.ascontiguousarray(every[:, 1:])
    _require_motion(runs, every, np.ones(len(acceleration)))
    scale = np.linalg.norm(others, axis=0)
    low = np.array([0.0, 0.0, *np.full(len(scale) - 2, -np.inf)])
    values = lsq_linear(others / scale, -acceleration, bounds=(low, np.inf)).x / scale
    if not values[2] > 0.0:
        text = f"the free motion in {axis.name} is no swing: there is no restoring torque."
        mend = f"Give logs of releases, or map what drives the vehicle: [[thrusters]] with {axis.arm_key}."
        raise DataError(text, mend=mend)
    return _model(axis, np.array([1.0, *values]))


def require_inertia(estimate: Estimate, min_sigmas: float) -> None:
    """Raise DataError if the inertia is less than ``min_sigmas`` standard errors from zero, or its error unknown."""
    value, error = estimate.value("inertia"), estimate.standard_error("inertia")
    if not value >= min_sigmas * error:
        raise _not_excited(f"the inertia is {plus_minus(value, error)} {estimate.unit('inertia')}")


def _not_excited(why: str) -> DataError:
    return DataError(f"inertia cannot be determined from these logs: {why}.", mend=EXCITATION_ADVICE)


def _require_motion(runs: Sequence[Run], regressors: FloatArray, torque: FloatArray) -> None:
    if not len(torque):
        raise _not_excited("no stretch is long enough for the filter")
    if not np.any(torque):
        raise _not_excited("the thrusters never push")
    noise = float(np.linalg.norm([run.rates.rate_noise for run in runs])) / len(runs) ** 0.5
    if not varies(regressors[:, 2], noise=_MIN_MOTION * noise):
        raise _not_excited("the rate hardly changes by more than its noise")


def _torque_and_blocks(runs: Sequence[Run]) -> tuple[FloatArray, IntArray]:
    """(n,) filtered torque and block number at every valid instant of all runs."""
    seconds = sum(run.valid.sum() * run.rates.kernel.period for run in runs)
    length = min(max(_BLOCK / runs[0].rates.kernel.cutoff, seconds / _USUAL_BLOCKS), seconds / _BLOCKS)
    torque, blocks, first = [], [], 0
    for run in runs:
        torque.append(run.filtered_torque[run.valid])
        blocks.append(first + (run.rates.time[run.valid] // length).astype(np.intp))
        first = int(np.max(blocks[-1], initial=first)) + 1
    return np.concatenate(torque), np.concatenate(blocks)


def _measured_regressors(runs: Sequence[Run]) -> FloatArray:
    """(n, p) regressors from the filtered motion of all runs."""
    motion = np.hstack([(run.rates.rate, run.rates.acceleration, run.rates.position) for run in runs])
    return _regressors(runs[0].trial.axis, *motion)


def _regressors(axis: Axis, rate: FloatArray, acceleration: FloatArray, position: FloatArray) -> FloatArray:
    """(n, p) regressors of inertia, quadratic drag, linear drag and each restoring unknown."""
    return np.column_stack((acceleration, np.abs(rate) * rate, rate, regressors(restoring_effect(axis), position)))


def _model(axis: Axis, unknowns: FloatArray) -> Model:
    return Model.from_values([*unknowns[:3], *from_regressors(restoring_effect(axis), unknowns[3:])], axis)


def _instruments(runs: Sequence[Run], model: Model) -> tuple[FloatArray, FloatArray]:
    """(n, p) regressors of the noise-free simulation, and corrections of the measured regressors.

    The low pass of |r| r is not |r| r of the low pass. The difference is small but correlated with the
    acceleration. It is taken from the simulation and added to the measured regressors.
    """

    def simulate(run: Run) -> tuple[FloatArray, FloatArray]:
        kernel = run.rates.kernel
        rate, position = model.simulate(run.trial, TorqueInput.held(run.torque))
        rate = np.interp(run.rates.time, run.trial.time, rate)
        position = np.interp(run.rates.time, run.trial.time, position)
        clean = _regressors(model.axis, kernel.smooth(rate), kernel.rate(rate), kernel.smooth(position))
        correction = np.zeros_like(clean)
        correction[:, 1] = kernel.smooth(np.abs(rate) * rate) - clean[:, 1]
        return (clean + correction)[run.valid], correction[run.valid]

    pairs = parallel_map(simulate, runs)
    # The filtered simulation is NaN only where the measurement is, except in gaps of the gyro.
    instruments, corrections = (np.nan_to_num(np.concatenate(each)) for each in zip(*pairs, strict=True))
    return instruments, corrections


def _bounded(
    instruments: FloatArray, measured: FloatArray, torque: FloatArray, axis: Axis
) -> tuple[BoolArray, FloatArray]:
    """Which unknowns are free, and all values; a drag that would be negative is held at zero."""
    free = np.ones(measured.shape[1], dtype=bool)
    values = _solve(instruments, measured, torque, free)
    while (values[_DRAGS] < 0.0).any():
        # The drag with the largest negative torque first.
        free[1 + int(np.argmin(values[_DRAGS] * np.linalg.norm(measured[:, _DRAGS], axis=0)))] = False
        values = _solve(instruments, measured, torque, free)
    if not values[0] > 0.0:
        signs = f"{axis.arm_key}, command and {axis.required_signals}"
        shares = (_FEW, 1.0 - _FEW)
        least_torque, most_torque = np.quantile(torque, shares)
        least_rate, most_rate = np.quantile(measured[:, 2], shares)
        if least_torque > -_FEW * most_torque and least_rate < -_FEW * most_rate < 0.0:
            text = f"the {axis.force_name} has one sign, but the vehicle moves both ways."
            mend = f"A logged size, as of a motor's current, has no sign: give the {axis.force_name} with its sign."
            raise DataError(text, mend=mend)
        text = f"the inertia comes out negative: the vehicle moves against its {axis.force_name}, or hardly at all."
        raise DataError(text, mend=f"Check in rovid.toml the signs of {signs}. {EXCITATION_ADVICE}")
    return free, values


def _solve(instruments: FloatArray, measured: FloatArray, torque: FloatArray, free: BoolArray) -> FloatArray:
    """(p,) values at which the residuals are orthogonal to the instruments; unknowns that are not ``free`` are zero."""
    values = np.zeros(len(free))
    z, x = instruments[:, free], measured[:, free]
    scale = np.linalg.norm(x, axis=0)
    values[free] = np.linalg.lstsq(z.T @ (x / scale), z.T @ torque, rcond=1e-12)[0] / scale
    return values


def _physical_start(plain: FloatArray, measured: FloatArray, torque: FloatArray) -> FloatArray:
    """Least squares where it is physical; else bounded least squares with a positive inertia and drag."""
    if (plain[:3] > 0.0).all():
        return plain
    from scipy.optimize import lsq_linear

    scale = np.linalg.norm(measured, axis=0)
    low = np.where(np.arange(len(plain)) < 3, 0.0, -np.inf)
    values = lsq_linear(measured / scale, torque, bounds=(low, np.inf)).x / scale
    floor = 1e-3 * np.linalg.norm(torque) / scale[:3]
    values[:3] = np.maximum(values[:3], floor * np.array([1.0, 0.0, 1.0]))
    return np.asarray(values)


def fit_output_error(runs: Sequence[Run], *, min_sigmas: float = MIN_INERTIA_SIGMAS) -> Model:
    """Least squares of measured minus simulated rate, both through the same filter, within physical bounds.

    Raises DataError if the vehicle was not excited enough to start from.

    ``min_sigmas``: Least number of standard errors of the regression's inertia from zero. 0 where effects are added
        afterwards, which may determine the inertia.
    """
    if min_sigmas > 0.0 and runs[0].trial.has_actuators:
        fit_regression(runs, min_sigmas=min_sigmas)
    return _fit(tuple(runs))


@functools.lru_cache(maxsize=8)
def _fit(runs: tuple[Run, ...]) -> Model:
    # Imported here because the import takes longer than commands that fit nothing.
    from scipy.optimize import least_squares

    axis = runs[0].trial.axis
    has_actuators = runs[0].trial.has_actuators
    start = _start(runs) if has_actuators else fit_free_swings(runs).values
    # Scales of parameters that may start at zero.
    rate, torque = rms_rate(runs), rms([run.torque for run in runs])
    drag = start[1] * rate + start[2] or torque
    restoring = restoring_effect(axis)
    own = () if restoring is None else restoring.parameters
    least = [_LEAST_RESTORING * (torque if parameter.scale == "torque" else 1.0) for parameter in own]
    scale = np.array([start[0], drag / rate, drag, *np.maximum(np.abs(start[3:]), least)])
    # Without actuators the data do not determine the inertia.
    free = slice(None) if has_actuators else slice(1, None)

    def model(x: FloatArray) -> Model:
        values = start / scale
        values[free] = x
        return Model.from_values(values * scale, axis)

    def residuals(x: FloatArray) -> FloatArray:
        """(N,) measured minus simulated rate; zero where the filter has no answer."""
        here = model(x)
        errors = parallel_map(
            lambda run: run.rates.rate - simulated_rate(run, here, TorqueInput.held(run.torque)), runs
        )
        return np.nan_to_num(np.concatenate(errors))

    unbounded = np.full(len(start) - 3, np.inf)
    low, high = np.array([0.05, 0.0, 0.0, *-unbounded]), np.array([20.0, np.inf, np.inf, *unbounded])
    begin = (start / scale)[free]
    solution = least_squares(residuals, begin, bounds=(low[free], high[free]), x_scale=np.maximum(np.abs(begin), 0.1))
    found = model(solution.x)
    # Drag runs off where the best simulation stands still. Filters would then take thousands of steps in each interval.
    shortest = _SHORTEST_DECAY * float(np.median([run.trial.sampling_interval for run in runs]))
    share = min(time_constant(found, rate) / shortest, 1.0)
    return replace(found, quadratic_drag=share * found.quadratic_drag, linear_drag=share * found.linear_drag)


def _start(runs: Sequence[Run]) -> FloatArray:
    """Initial parameters by regression; where that fails, by RMS values of torque and acceleration, and by power.

    The regression fails where effects dominate, such as slow thrusters under an oscillating autopilot. The dissipated
    power gives a quadratic drag if there is any, and no restoring torque acts.
    """
    try:
        return fit_regression(runs, min_sigmas=0.0).estimate.values
    except DataError as refusal:
        error = refusal
    series = []
    for run in runs:
        torque = np.interp(run.rates.time, run.trial.time, run.torque)
        series.append((run.rates.rate, run.rates.acceleration, torque))
    every = np.hstack(series)
    rate, acceleration, torque = every[:, np.isfinite(every[:2]).all(axis=0)]
    power = float(torque @ rate)
    if not power > 0.0 or restoring_effect(runs[0].trial.axis) is not None:
        raise error
    inertia = float(np.linalg.norm(torque) / np.linalg.norm(acceleration))
    return np.array([inertia, power / np.sum(np.abs(rate) ** 3), 0.0])
