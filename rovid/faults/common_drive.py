"""A drive that all logs share, and that makes one log deviate: it is slow, late or has play; no log is foreign.

A lag, a delay, a slew limit or play changes the inertia and the drag that a fast or fine log shows, and hardly those of
the others. Each is applied to the commands of all logs, with the size that leaves the least torque unexplained.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_dynamics import delayed, lagged, played, slewed, soft_started
from rovid.effects.actuator_inputs import neutral_commands
from rovid.faults.quick_model import LogRegressors, QuickModel, fit_quick_model, log_name, log_parts, solved
from rovid.trial.preprocessing import Run
from rovid.trial.vehicle import Vehicle

# Changes of the held commands by name: (time in s, commands, size) -> commands.
_Drive = Callable[[FloatArray, FloatArray, float], FloatArray]
# Sizes: time constants of the vehicle; shares of the commands' range in such a time; shares of the range.
_TIMES, _RATES, _WIDTHS = np.geomspace(0.04, 2.0, 8), np.geomspace(0.1, 8.0, 8), np.geomspace(0.02, 0.4, 6)
# Factors on the best of these sizes, one after another.
_FINER = (1.3, 1.14)
# Share of the unexplained torque of the other logs that shows the drive in them, and by which chance may raise it.
_SHOWN, _CHANCE = 0.05, 0.01
# Share of the unexplained torque of the deviating logs that a drive leaves at most, if it is the reason.
_EXPLAINED = 0.5


@dataclass(frozen=True, kw_only=True)
class CommonDrive:
    """A drive that all logs may share."""

    name: str
    model: QuickModel  #: The common model with it.
    is_shown: bool  #: Whether the other logs show it too.


def common_drive(
    runs: Sequence[Run], vehicle: Vehicle, model: QuickModel, deviating: Collection[str]
) -> CommonDrive | None:
    """The drive of all ``runs`` that explains the ``deviating`` logs best; None where the other logs contradict it."""
    rest = [log_name(run) not in deviating for run in runs]
    plain = fit_quick_model([*compress(runs, rest)], vehicle)
    if plain is None:
        return None
    before, most = unexplained(plain), _EXPLAINED * unexplained(model, deviating)

    def tried(name: str, acting: Sequence[Run]) -> tuple[float, CommonDrive | None]:
        """Share that the deviating logs leave unexplained, and the drive; None if it leaves too much of any log."""
        if least_unexplained(acting, vehicle, model, deviating) > most:
            return np.inf, None
        whole = fit_quick_model(acting, vehicle)
        if whole is None or (left := unexplained(whole, deviating)) > most:
            return np.inf, None
        others = fit_quick_model([*compress(acting, rest)], vehicle)
        if others is None or len(others.logs) < len(plain.logs) or unexplained(others) > (1.0 + _CHANCE) * before:
            return np.inf, None
        return left, CommonDrive(name=name, model=whole, is_shown=unexplained(others) < (1.0 - _SHOWN) * before)

    def driven(name: str, size: float) -> list[Run]:
        return [_driven(run, vehicle, drives[name][0], size) for run in runs]

    drives = _drives(runs, model.time_constant)
    every = [(*tried(name, driven(name, size)), name, size) for name, (_, sizes) in drives.items() for size in sizes]
    for factor in _FINER:
        _, best, name, size = nearest = min(every, key=lambda one: one[0])
        if best is None:
            return None
        sizes = size / factor, size * factor
        every = [nearest, *((*tried(name, driven(name, each)), name, each) for each in sizes)]
    return min(every, key=lambda one: one[0])[1]


def _drives(runs: Sequence[Run], time_constant: float) -> Mapping[str, tuple[_Drive, FloatArray]]:
    every = np.concatenate([run.trial.commands for run in runs])
    extent = float(np.nanmax(np.nanmax(every, axis=0) - np.nanmin(every, axis=0)))
    times = time_constant * _TIMES
    return {
        "a lag of the thrusters": (lagged, times),
        "a delay of the commands": (delayed, np.concatenate((-times[:-4], times))),
        "a slew limit of the commands": (slewed, extent / time_constant * _RATES),
        "a soft start of the thrusters": (soft_started, extent / time_constant * _RATES),
        "play of the commands": (played, extent * _WIDTHS),
    }


def _driven(run: Run, vehicle: Vehicle, change: _Drive, size: float) -> Run:
    """The run with ``change`` in its commands; where they are unknown they stay so."""
    trial, columns = run.trial, []
    for neutral, command in zip(neutral_commands(vehicle), run.trial.commands.T, strict=True):
        known = np.isfinite(command)
        if not known.any():
            return run
        column = np.full(len(command), np.nan)
        column[known] = neutral + change(trial.time[known], command[known] - neutral, size)
        columns.append(column)
    moved = replace(trial, commands=np.column_stack(columns))
    torque = vehicle.torque(moved)
    return replace(run, trial=moved, torque=torque, filtered_torque=run.rates.filter_held(moved, torque))


def least_unexplained(runs: Sequence[Run], vehicle: Vehicle, model: QuickModel, deviating: Collection[str]) -> float:
    """``_unexplained`` by one regression, in which the ``deviating`` logs count as much as the others."""
    parts, pairs = log_parts(runs), list[tuple[LogRegressors, FloatArray]]()
    for plain in (log for log in model.regressors if log.name in parts):
        log = LogRegressors(plain.name, parts[plain.name], vehicle, model.time_constant, 1.0)
        pairs.append((log, log.torque + plain.ambient))
    slope, score = (
        np.sum(each, axis=0) for each in zip(*((log.z.T @ log.x, log.z.T @ y) for log, y in pairs), strict=True)
    )
    values = solved(slope, score)
    shares = [(log, np.sum((y - log.x @ values) ** 2) / np.sum(log.torque**2).clip(1e-300)) for log, y in pairs]
    return float(sum(share for log, share in shares if log.name in deviating))


def unexplained(model: QuickModel, logs: Collection[str] | None = None) -> float:
    """Sum of the shares of the squared torque that the model leaves in these ``logs``, or in all."""
    return sum(log.misfit**2 for log in model.logs if logs is None or log.name in logs)
