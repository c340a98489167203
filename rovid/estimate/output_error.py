"""Fit of the free-running rate: what a user means by a good model, and a start that stays sane."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.core.spmd import parallel_map
from rovid.effects import restoring_effect
from rovid.estimate.dataset import rms, rms_rate
from rovid.estimate.instrumental_variables import fit_free_swings, fit_regression
from rovid.model.model import Model
from rovid.model.simulation import fit_measures, simulated_rate
from rovid.model.torque_input import TorqueInput
from rovid.signals.preprocessing import Run
from rovid.trial.axis import Axis

# An inertia nearer to nothing, in standard errors, is none: steady holds fit any.
MIN_INERTIA_SIGMAS = 2.0
# Of a trim in rad, or a lift in N.
_LEAST = 1e-2


def fit_output_error(runs: Sequence[Run], *, min_sigmas: float = MIN_INERTIA_SIGMAS) -> Model:
    """Least squares of measured less simulated rate, both behind the same filter, within physical bounds.

    Parameters
    ----------
    certainty
        Standard errors that the regression's inertia has to be away from nothing. Where effects are put in after, it
        is they that may make it certain.

    Raises
    ------
    DataError
        The vehicle was not excited enough to start from.
    """
    return _fitted(tuple(runs), min_sigmas)


# A diagnosis asks of all trials, and of the parts of them, more than once.
@functools.lru_cache(maxsize=2)
def _fitted(runs: tuple[Run, ...], certainty: float) -> Model:
    # It takes longer to import than commands that fit nothing.
    from scipy.optimize import least_squares

    axis = runs[0].trial.axis
    driven = runs[0].trial.has_actuators
    start = _start(runs, certainty) if driven else fit_free_swings(runs).values
    # A drag at its bound still needs a scale to move by, and so do both; so does what weight and buoyancy do.
    rate, torque = rms_rate(runs), rms([run.torque for run in runs])
    drag = start[1] * rate + start[2] or torque
    scale = np.array([start[0], drag / rate, drag, *np.maximum(np.abs(start[3:]), _LEAST)])
    # Without a drive nothing tells the inertia.
    free = slice(None) if driven else slice(1, None)

    def model(x: FloatArray) -> Model:
        values = start / scale
        values[free] = x
        return _model(values * scale, axis)

    more = np.full(len(start) - 3, np.inf)
    low, high = np.array([0.05, 0.0, 0.0, *-more]), np.array([20.0, np.inf, np.inf, *more])
    begin = (start / scale)[free]

    def misfit(x: FloatArray) -> FloatArray:
        return _misfit(runs, model(x))

    solution = least_squares(
        misfit,
        begin,
        bounds=(low[free], high[free]),
        x_scale=np.maximum(np.abs(begin), 0.1),
    )
    return model(solution.x)


def _start(runs: Sequence[Run], certainty: float) -> FloatArray:
    """Where the model misses much the regression is uncertain, and good enough to start from.

    It may even miss so much that no inertia fits, as where thrusters are slow and an autopilot swings. Then the vehicle
    is as inert and as damped as makes both motion and torque what they usually are, if it dissipates power at all.
    """
    try:
        return fit_regression(runs, min_sigmas=certainty).estimate.values
    except DataError:
        usual_motion = _from_usual_motion(runs)
        if certainty > 0.0 or usual_motion is None:
            raise
        return usual_motion


def _from_usual_motion(runs: Sequence[Run]) -> FloatArray | None:
    """Inertia and drags that make motion and torque what they usually are; None where no power is dissipated.

    Nor is it told where weight and buoyancy act besides.
    """
    series = []
    for run in runs:
        torque = np.interp(run.rates.time, run.trial.time, run.torque)
        series.append((run.rates.rate, run.rates.acceleration, torque))
    every = np.hstack(series)
    rate, change, torque = every[:, np.isfinite(every[:2]).all(axis=0)]
    power = float(torque @ rate)
    if not power > 0.0 or restoring_effect(runs[0].trial.axis) is not None:
        return None
    inertia = float(np.linalg.norm(torque) / np.linalg.norm(change))
    drag = power / np.sum(np.abs(rate) ** 3)
    return np.array([inertia, drag, 0.0])


def free_run_r2(runs: Sequence[Run], model: Model) -> float:
    """R^2 of the rate over all runs, each simulated freely from its first sample."""
    measured = np.concatenate([run.rates.rate for run in runs])
    simulated = np.concatenate([_simulated(run, model) for run in runs])
    return fit_measures(measured, simulated).r2


def _model(values: FloatArray, axis: Axis) -> Model:
    inertia, quadratic, linear, *restoring = (float(value) for value in values)
    return Model(
        inertia=inertia,
        quadratic_drag=quadratic,
        linear_drag=linear,
        axis=axis,
        restoring_values=tuple(restoring),
    )


def _misfit(runs: Sequence[Run], model: Model) -> FloatArray:
    """(N,) rad/s or m/s that the free-running rate is off in all runs."""
    # Where the filter has no answer nothing is missed.
    return np.concatenate(parallel_map(lambda run: np.nan_to_num(run.rates.rate - _simulated(run, model)), runs))


def _simulated(run: Run, model: Model) -> FloatArray:
    """(n,) rate, free-running under the measured torque."""
    return simulated_rate(run, model, TorqueInput.held(run.torque))
