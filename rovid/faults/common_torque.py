"""Torques that all logs may share along the measured motion, linear in their sizes, as the catalogue's effects are.

A torque that the plain model lacks looks like another inertia or drag in a log of another programme: a drag that
differs between the directions in the only log that turns to port.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.faults.common_drive import unexplained
from rovid.faults.quick_model import QuickModel, first_order, fit_quick_model, held_torque, log_name, solved
from rovid.trial.preprocessing import Run
from rovid.trial.vehicle import Vehicle

# (run, plain model) -> (m, q) torques in N m of size one on the grid of the rates.
_Torques = Callable[[Run, QuickModel], FloatArray]
# Time constants of memories over the vehicle's.
_MEMORIES = 0.5, 2.0, 6.0, 20.0
# Share of the rate that the water around the hull has.
_SWIRL = 0.4
# Share of the RMS rate, or torque, over which friction or a dead zone changes its sign.
_SIGN_WIDTH = 0.1
# Share of what a model of each of two groups leaves unexplained, that a torque of all logs leaves at most.
_FAR_LESS = 0.5
# Harmonics of the heading: of a deviation by hard and soft iron and a further one, and of a torque by wind or a cable.
_DEVIATIONS, _HARMONICS = (1.0, 2.0, 3.0), (1.0, 2.0)


def with_common_torque(runs: Sequence[Run], plain: QuickModel) -> Iterator[list[Run]]:
    """``runs`` with each torque in turn, of the sizes that the logs of the ``plain`` model show."""
    every: list[_Torques] = [*_OF_MOTION]
    every += [partial(each, times=times) for each in (_memory, _swirl, _sag) for times in _MEMORIES]
    for torques in every:
        slope, score = np.zeros(()), np.zeros(())
        for log in plain.regressors:
            each = [torques(run, plain)[run.valid] for run in log.runs]
            columns = -log.centred(np.concatenate(each))
            z = np.column_stack((log.z, columns))
            slope, score = slope + z.T @ np.column_stack((log.x, columns)), score + z.T @ log.torque
        sizes = solved(slope, score)[3:]
        yield [replace(run, filtered_torque=run.filtered_torque + torques(run, plain) @ sizes) for run in runs]


def replaces_groups(
    runs: Sequence[Run],
    vehicle: Vehicle,
    model: QuickModel,
    groups: Sequence[Collection[str]],
    remaining: Callable[[QuickModel], object],
) -> bool:
    """Whether a torque of all ``runs`` leaves far less than a model of each of the ``groups``, which vanish."""
    own = [fit_quick_model([run for run in runs if log_name(run) in group], vehicle) for group in groups]
    most = sum(unexplained(each) for each in own if each) if all(own) else unexplained(model)
    for acting in with_common_torque(runs, model):
        whole = fit_quick_model(acting, vehicle)
        if whole is not None and unexplained(whole) < _FAR_LESS * most and not remaining(whole):
            return True
    return False


def _rate(run: Run) -> FloatArray:
    """(m,) rate, held where it is unknown."""
    return _held(run, run.rates.rate)


def _drag(rate: FloatArray, model: QuickModel) -> FloatArray:
    return np.asarray((model.values[1] * np.abs(rate) + model.values[2]) * rate)


def _directions(run: Run, model: QuickModel) -> FloatArray:
    """Drag, and thrust, that differ between the directions."""
    rate, torque = _rate(run), held_torque(run)
    return np.column_stack((np.abs(_drag(rate, model)), np.abs(torque)))


def _friction(run: Run, _: QuickModel) -> FloatArray:
    rate = _rate(run)
    return np.asarray(-np.tanh(rate / (_SIGN_WIDTH * np.sqrt(np.mean(rate**2)).clip(1e-300)))[:, None])


def _cubic(run: Run, _: QuickModel) -> FloatArray:
    return -(_rate(run)[:, None] ** 3)


def _thrust(run: Run, _: QuickModel) -> FloatArray:
    """A dead zone, another curve, and a loss of thrust with the rate."""
    rate, torque = _rate(run), held_torque(run)
    width = _SIGN_WIDTH * np.sqrt(np.mean(torque**2)).clip(1e-300)
    return np.column_stack((np.tanh(torque / width), torque * np.abs(torque), torque * np.abs(rate)))


def _memory(run: Run, model: QuickModel, times: float) -> FloatArray:
    """Added mass with memory."""
    rate = _rate(run)
    return (first_order(rate, times * model.time_constant, run.rates.kernel.period) - rate)[:, None]


def _swirl(run: Run, model: QuickModel, times: float) -> FloatArray:
    """Water that follows the hull."""
    rate = _rate(run)
    water = first_order(rate, times * model.time_constant, run.rates.kernel.period)
    return (_drag(rate, model) - _drag(rate - _SWIRL * water, model))[:, None]


def _sag(run: Run, model: QuickModel, times: float) -> FloatArray:
    """Thrust that sags under load."""
    torque = held_torque(run)
    return (torque * first_order(np.abs(torque), times * model.time_constant, run.rates.kernel.period))[:, None]


def _heading(run: Run, _: QuickModel) -> FloatArray:
    """A torque of the heading, or of the angle since the start."""
    angle = _held(run, run.rates.position)
    return np.column_stack([*(each(k * angle) for k in _HARMONICS for each in (np.sin, np.cos)), angle - angle[0]])


def _deviation(run: Run, model: QuickModel) -> FloatArray:
    """Torque of the motion that a deviation of the heading imitates."""
    angle, rate = _held(run, run.rates.position), _rate(run)
    acceleration = np.nan_to_num(run.rates.acceleration)
    slope = 2.0 * model.values[1] * np.abs(rate) + model.values[2]
    columns = []
    for k in _DEVIATIONS:
        for value, first in ((np.sin, np.cos), (np.cos, lambda x: -np.sin(x))):
            change = k * first(k * angle)
            columns.append(
                model.inertia * (change * acceleration - (k * rate) ** 2 * value(k * angle)) + slope * change * rate
            )
    return np.column_stack(columns)


def _held(run: Run, values: FloatArray) -> FloatArray:
    """(m,) ``values``, interpolated or held where they are unknown; zeros where all are."""
    time, known = run.rates.time, np.isfinite(values)
    return np.interp(time, time[known], values[known]) if known.any() else np.zeros(len(time))


_OF_MOTION: tuple[_Torques, ...] = (_directions, _friction, _cubic, _thrust, _heading, _deviation)
