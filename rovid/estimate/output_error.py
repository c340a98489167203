"""Output-error fit: least squares of the free-running rate, within physical bounds."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.core.spmd import parallel_map
from rovid.effects import restoring_effect
from rovid.estimate.dataset import rms, rms_rate, time_constant
from rovid.estimate.instrumental_variables import fit_free_swings, fit_regression
from rovid.model.model import Model
from rovid.model.simulation import simulated_rate
from rovid.model.torque_input import TorqueInput
from rovid.signals.preprocessing import Run

# Least number of standard errors of the inertia from zero. Steady holds are compatible with any inertia.
MIN_INERTIA_SIGMAS = 2.0
# Shortest time constant of a first model, in sampling intervals.
_SHORTEST_DECAY = 0.2
# Least scale of a trim in rad, and of a lift or a stiffness over the RMS torque.
_LEAST_RESTORING = 1e-2


def fit_output_error(runs: Sequence[Run], *, min_sigmas: float = MIN_INERTIA_SIGMAS) -> Model:
    """Least squares of measured minus simulated rate, both through the same filter, within physical bounds.

    Parameters
    ----------
    min_sigmas
        Least number of standard errors of the regression's inertia from zero. 0 where effects are added afterwards,
        which may determine the inertia.

    Raises
    ------
    DataError
        The vehicle was not excited enough to start from.
    """
    return _fit(tuple(runs), min_sigmas)


# A diagnosis needs the fit of all trials, and of folds of them, more than once.
@functools.lru_cache(maxsize=2)
def _fit(runs: tuple[Run, ...], min_sigmas: float) -> Model:
    # Imported here because the import takes longer than commands that fit nothing.
    from scipy.optimize import least_squares

    axis = runs[0].trial.axis
    has_actuators = runs[0].trial.has_actuators
    start = _start(runs, min_sigmas) if has_actuators else fit_free_swings(runs).values
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

        def of_run(run: Run) -> FloatArray:
            return np.nan_to_num(run.rates.rate - simulated_rate(run, here, TorqueInput.held(run.torque)))

        return np.concatenate(parallel_map(of_run, runs))

    unbounded = np.full(len(start) - 3, np.inf)
    low, high = np.array([0.05, 0.0, 0.0, *-unbounded]), np.array([20.0, np.inf, np.inf, *unbounded])
    begin = (start / scale)[free]
    bounds = low[free], high[free]
    solution = least_squares(residuals, begin, bounds=bounds, x_scale=np.maximum(np.abs(begin), 0.1))
    return _with_resolved_decay(model(solution.x), rate, runs)


def _with_resolved_decay(model: Model, rate: float, runs: Sequence[Run]) -> Model:
    """``model`` with less drag where its motion decays in less than a fifth of the sampling interval.

    Drag runs off where the best simulation stands still. Filters then take thousands of steps in each interval.
    """
    shortest = _SHORTEST_DECAY * float(np.median([run.trial.sampling_interval for run in runs]))
    share = min(time_constant(model, rate) / shortest, 1.0)
    return replace(model, quadratic_drag=share * model.quadratic_drag, linear_drag=share * model.linear_drag)


def _start(runs: Sequence[Run], min_sigmas: float) -> FloatArray:
    """Initial parameters by regression, or by RMS values where the regression fails and ``min_sigmas`` is 0.

    The regression fails where effects dominate, such as slow thrusters under an oscillating autopilot.
    """
    try:
        return fit_regression(runs, min_sigmas=min_sigmas).estimate.values
    except DataError:
        start = _start_by_rms(runs)
        if min_sigmas > 0.0 or start is None:
            raise
        return start


def _start_by_rms(runs: Sequence[Run]) -> FloatArray | None:
    """Inertia by the RMS torque and acceleration, and quadratic drag by the dissipated power.

    None where no power is dissipated, or where a restoring torque acts too.
    """
    series = []
    for run in runs:
        torque = np.interp(run.rates.time, run.trial.time, run.torque)
        series.append((run.rates.rate, run.rates.acceleration, torque))
    every = np.hstack(series)
    rate, acceleration, torque = every[:, np.isfinite(every[:2]).all(axis=0)]
    power = float(torque @ rate)
    if not power > 0.0 or restoring_effect(runs[0].trial.axis) is not None:
        return None
    inertia = float(np.linalg.norm(torque) / np.linalg.norm(acceleration))
    drag = power / np.sum(np.abs(rate) ** 3)
    return np.array([inertia, drag, 0.0])
