"""Causes that all logs share, and that make one log deviate: a drive, or a torque along the motion; no log is foreign.

The first one is the model itself: logs of one rate do not divide the drag into quadratic and linear, and predict no log
at another rate. One inertia and drag may explain it with the others.

A lag, a delay, a slew limit or play changes the inertia and the drag that a fast or fine log shows, and hardly those of
the others. Each is applied to the commands of all logs, with the size that leaves the least torque unexplained.

A torque that the plain model lacks looks like another inertia or drag in a log of another programme: a drag that
differs between the directions in the only log that turns to port. The torques are linear in their sizes, as the
catalogue's effects are.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_dynamics import delayed, lagged, played, slewed, soft_started
from rovid.effects.actuator_inputs import neutral_commands
from rovid.faults.log_regressors import LogRegressors, first_order, held, held_torque, solved
from rovid.faults.quick_model import QuickModel, fit_quick_model, log_name, log_parts
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
# Time constants of memories over the vehicle's.
_MEMORIES = 0.5, 2.0, 6.0, 20.0
# Share of the rate that the water around the hull has.
_SWIRL = 0.4
# Share of the RMS rate, or torque, over which friction or a dead zone changes its sign.
_SIGN_WIDTH = 0.1
# Share of what a model of each of two groups leaves unexplained, that a torque of all logs leaves at most.
_FAR_LESS = 0.5
# Share of the torque's mean square, below which a log shows no motion: a quarter of the amplitude.
_STILL = 0.06
# Likelihood ratio (nats) of a model of its own for one log over one model of all: 99.9 % quantile of three parameters.
_OWN_MODEL = 8.1
# Probability of a residual variance, over the median of the other logs, up to which a disturbance explains it.
_USUAL = 0.95
# Factor on the residual of a model with a negative inertia: it predicts nothing.
_IMPOSSIBLE = 1e30
# Passes in which the weights of the logs settle.
_PASSES = 4
# Harmonics of the heading: of a deviation by hard and soft iron and a further one, and of a torque by wind or a cable.
_DEVIATIONS, _HARMONICS = (1.0, 2.0, 3.0), (1.0, 2.0)


@dataclass(frozen=True, kw_only=True)
class CommonDrive:
    """A drive that all logs may share."""

    name: str
    model: QuickModel  #: The common model with it.
    is_shown: bool  #: Whether the other logs show it too.


class JointModel:
    """One inertia and drag of the ``odd`` log and of the ``others``, one or more, by the likelihood ratio test of Chow.

    Chow, G. C. (1960), Tests of equality between sets of coefficients in two linear regressions, Econometrica 28.
    """

    def __init__(self, odd: LogRegressors, others: Sequence[LogRegressors]) -> None:
        from scipy.special import fdtri

        self._odd, self._others, self._values = odd, others, _model_of([odd, *others])
        rest = _model_of(others)
        residuals = [(log.forcing - log.x @ self._values, log.forcing - log.x @ rest) for log in others]
        #: (n,) residual torque of the ``odd`` log.
        self.residual = odd.forcing - odd.x @ self._values
        #: Likelihood (nats) of a model of the ``others`` alone over this one.
        self.loss = max(0.0, sum(likelihood_gain(self._scale(rest) * own, joint) for joint, own in residuals))
        usual = float(np.median([np.mean(own**2) for _, own in residuals]))
        counts = _independent(self.residual), sum(_independent(own) for _, own in residuals)
        #: Whether a disturbance as in the ``others`` explains the residual: F-test.
        self.is_usual = bool(np.mean(self.residual**2) < usual * fdtri(*counts, _USUAL))

    def _scale(self, values: FloatArray) -> float:
        """Factor on a residual by other ``values``: models predict accelerations, which a tiny inertia cannot."""
        return float(self._values[0] / values[0]) if values[0] > 0.0 else _IMPOSSIBLE

    @property
    def explains(self) -> bool:
        """Whether the ``odd`` log needs no model of its own."""
        if self.is_usual or self._odd.is_opposite:
            return self.is_usual
        gains, (inertia, *drags) = [], self._values
        # Its own inertia and drags, or the others' with one factor on the inertia and one on the drag.
        for directions in np.eye(3), np.array([[inertia, 0.0], [0.0, drags[0]], [0.0, drags[1]]]):
            x, z = self._odd.x @ directions, self._odd.z @ directions
            own = directions @ solved(z.T @ x, z.T @ self._odd.forcing)
            gains.append(likelihood_gain(self._scale(own) * (self._odd.forcing - self._odd.x @ own), self.residual))
        return max(gains) + self.loss < _OWN_MODEL + float(np.log(1 + len(self._others)))


def _model_of(logs: Sequence[LogRegressors]) -> FloatArray:
    """(3,) inertia, quadratic and linear drag of all ``logs``, weighted by their residual variances."""
    slopes = np.array([log.z.T @ log.x for log in logs])
    scores = np.array([log.z.T @ log.forcing for log in logs])
    variances = np.array([np.mean(log.forcing**2) for log in logs])
    for _ in range(_PASSES):
        # A log with a small residual by chance counts as much as a usual one.
        weights = 1.0 / np.maximum(variances, np.median(variances))
        values = solved(np.tensordot(weights, slopes, 1), weights @ scores)
        variances = np.array([np.mean((log.forcing - log.x @ values) ** 2) for log in logs])
    return values


def likelihood_gain(residual: FloatArray, other: FloatArray) -> float:
    """Log-likelihood (nats) of a residual over another one, with its number of independent values."""
    ratio = (other @ other) / (residual @ residual).clip(1e-300)
    return 0.5 * _independent(residual) * float(np.log(ratio))


def _independent(residual: FloatArray) -> float:
    power = np.abs(np.fft.rfft(residual)) ** 2
    # Of a periodogram, whose ordinates are exponentially distributed: two values each.
    return float(4.0 * power.sum() ** 2 / (power @ power).clip(1e-300))


def common_drive(
    runs: Sequence[Run], vehicle: Vehicle, model: QuickModel, deviating: Collection[str]
) -> CommonDrive | None:
    """The drive of all ``runs`` that explains the ``deviating`` logs best; None where the other logs contradict it."""
    rest = [log_name(run) not in deviating for run in runs]
    plain = fit_quick_model([*compress(runs, rest)], vehicle)
    if plain is None:
        return None
    before, most = unexplained(plain), _EXPLAINED * unexplained(model, deviating)

    drives = _drives(runs, model.time_constant)

    def tried(name: str, size: float) -> tuple[float, CommonDrive | None, str, float]:
        """Share that the deviating logs leave unexplained, and the drive; None if it leaves too much of any log."""
        none = np.inf, None, name, size
        acting = [_driven(run, vehicle, drives[name][0], size) for run in runs]
        if least_unexplained(acting, vehicle, model, deviating) > most:
            return none
        whole = fit_quick_model(acting, vehicle)
        if whole is None or (left := unexplained(whole, deviating)) > most:
            return none
        others = fit_quick_model([*compress(acting, rest)], vehicle)
        if others is None or len(others.logs) < len(plain.logs) or unexplained(others) > (1.0 + _CHANCE) * before:
            return none
        is_shown = unexplained(others) < (1.0 - _SHOWN) * before
        return left, CommonDrive(name=name, model=whole, is_shown=is_shown), name, size

    every = [tried(name, size) for name, (_, sizes) in drives.items() for size in sizes]
    for factor in _FINER:
        _, best, name, size = nearest = min(every, key=lambda one: one[0])
        if best is None:
            return None
        every = [nearest, tried(name, size / factor), tried(name, size * factor)]
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
    return _with_commands(run, vehicle, np.column_stack(columns))


def _with_commands(run: Run, vehicle: Vehicle, commands: FloatArray) -> Run:
    moved = replace(run.trial, commands=commands)
    torque = vehicle.torque(moved)
    return replace(run, trial=moved, torque=torque, filtered_torque=run.rates.filter_held(moved, torque))


def dead_thrusters(runs: Sequence[Run], vehicle: Vehicle) -> dict[int, set[str]]:
    """Numbers of the thrusters that push in no log, each with the logs that show it: used alone, it moves nothing.

    A model of the other logs without that thruster explains one of them far better, and all of them no worse.
    """
    model, found = fit_quick_model(runs, vehicle), dict[int, set[str]]()
    if model is None or len(vehicle.thrusters) < 2:
        return found
    for k in range(len(vehicle.thrusters)):
        alone = [log for log in model.regressors if not np.delete(log.single, k, axis=1).any()]
        silent = {log.name for log in alone if np.sum((log.x @ model.values) ** 2) < _STILL * np.sum(log.torque**2)}
        if not silent or len(silent) < len(alone):
            continue
        rest = [run for run in runs if log_name(run) not in silent]
        plain, without = fit_quick_model(rest, vehicle), fit_quick_model(at_rest(rest, vehicle, [k]), vehicle)
        if plain is None or without is None:
            continue
        before = {log.name: log.misfit**2 for log in plain.logs}
        pairs = [(before.get(log.name, 0.0), log.misfit**2) for log in without.logs]
        is_far_better = any(after < _FAR_LESS * own for own, after in pairs)
        if is_far_better and sum(after for _, after in pairs) < sum(own for own, _ in pairs):
            found[k] = silent
    return found


def at_rest(runs: Sequence[Run], vehicle: Vehicle, thrusters: Collection[int]) -> Sequence[Run]:
    """The ``runs`` with the commands of these ``thrusters`` at their neutral values."""
    if not thrusters:
        return runs
    neutral, at = neutral_commands(vehicle), np.isin(np.arange(len(vehicle.thrusters)), [*thrusters])
    return [_with_commands(run, vehicle, np.where(at, neutral, run.trial.commands)) for run in runs]


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


def with_common_torque(runs: Sequence[Run], plain: QuickModel) -> Iterator[list[Run]]:
    """``runs`` with each torque in turn, of the sizes that the logs of the ``plain`` model show."""
    used = [run for log in plain.regressors for run in log.runs]
    for every in zip(*(_torques(run, plain) for run in (*used, *runs)), strict=True):
        torques = iter(every)
        slope, score = np.zeros(()), np.zeros(())
        for log in plain.regressors:
            columns = -log.centred(np.concatenate([next(torques)[run.valid] for run in log.runs]))
            z = np.column_stack((log.z, columns))
            slope, score = slope + z.T @ np.column_stack((log.x, columns)), score + z.T @ log.torque
        sizes = solved(slope, score)[3:]
        yield [replace(run, filtered_torque=run.filtered_torque + next(torques) @ sizes) for run in runs]


def replaces_groups(
    runs: Sequence[Run],
    vehicle: Vehicle,
    model: QuickModel,
    groups: Sequence[Collection[str]],
    remaining: Callable[[QuickModel], object],
) -> bool:
    """Whether a torque of all ``runs`` leaves far less than a model of each of the ``groups``, which vanish.

    What they leave is compared in N m: a disturbance is as large in all logs, and most of the torque of a weak one.
    """

    def left(*models: QuickModel) -> float:
        return float(sum(np.exp(2.0 * log.log_residual) for each in models for log in each.logs))

    own = [fit_quick_model([run for run in runs if log_name(run) in group], vehicle) for group in groups]
    known = [each for each in own if each]
    most = left(*known) if len(known) == len(own) else left(model)
    for acting in with_common_torque(runs, model):
        whole = fit_quick_model(acting, vehicle)
        if whole is not None and left(whole) < _FAR_LESS * most and not remaining(whole):
            return True
    return False


def _torques(run: Run, model: QuickModel) -> Iterator[FloatArray]:
    """(m, q) torques in N m of size one on the grid of the rates, one cause after another."""
    rate, angle, torque = held(run, run.rates.rate), held(run, run.rates.position), held_torque(run)
    size, width = np.abs(rate), _SIGN_WIDTH * np.sqrt(np.mean(torque**2)).clip(1e-300)

    def drag(rates: FloatArray) -> FloatArray:
        return np.asarray((model.values[1] * np.abs(rates) + model.values[2]) * rates)

    # Drag, and thrust, that differ between the directions.
    yield np.column_stack((np.abs(drag(rate)), np.abs(torque)))
    # Friction.
    yield -np.tanh(rate / (_SIGN_WIDTH * np.sqrt(np.mean(rate**2)).clip(1e-300)))[:, None]
    # A cubic drag.
    yield -(rate[:, None] ** 3)
    # A dead zone, another curve, and a loss of thrust with the rate.
    yield np.column_stack((np.tanh(torque / width), torque * np.abs(torque), torque * size))
    # A torque of the heading, or of the angle since the start.
    yield np.column_stack([*(each(k * angle) for k in _HARMONICS for each in (np.sin, np.cos)), angle - angle[0]])
    # The torque of the motion that a deviation of the heading imitates.
    acceleration, slope = np.nan_to_num(run.rates.acceleration), 2.0 * model.values[1] * size + model.values[2]
    columns = []
    for k in _DEVIATIONS:
        for value, first in ((np.sin, np.cos), (np.cos, lambda x: -np.sin(x))):
            change = k * first(k * angle)
            turned = change * acceleration - (k * rate) ** 2 * value(k * angle)
            columns.append(model.inertia * turned + slope * change * rate)
    yield np.column_stack(columns)
    times, period = [each * model.time_constant for each in _MEMORIES], run.rates.kernel.period
    for tau in times:  # Added mass with memory.
        yield (first_order(rate, tau, period) - rate)[:, None]
    for tau in times:  # Water that follows the hull.
        yield (drag(rate) - drag(rate - _SWIRL * first_order(rate, tau, period)))[:, None]
    for tau in times:  # Thrust that sags under load.
        yield (torque * first_order(np.abs(torque), tau, period))[:, None]
