"""A model of all logs within milliseconds, and how far each log deviates: one regression by instrumental variables.

I rdot + DQ |r| r + DL r + trim = T + A(psi), all signals through one filter. A torque A of the heading, of wind, a
current or a tether, is part of the model where it predicts the other logs: in a sine run alone it acts like an inertia.
Sensor noise is in the regressors; the instruments are the same regressors of a motion that follows the torque with one
time constant. A log that deviates from the others counts less (Huber's weights), so that a minority of foreign logs
does not move the model.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import compress

import numpy as np

from rovid.core.array_types import BoolArray, ComplexArray, FloatArray
from rovid.trial.preprocessing import Run
from rovid.trial.rates import fast_fft_length
from rovid.trial.vehicle import Thruster, Vehicle

# Logs that show a torque of the heading.
_MIN_LOGS = 3
# Valid samples that a log needs.
_MIN_SAMPLES = 50
# Number of passes: in the first ones the time constant settles, in the others the weights.
_SETTLING, _PASSES = 3, 6
# Share of the median standard deviation of the torque that a log needs: another log says nothing.
_EXCITED = 0.02
# Share of the torque's RMS over which the sign of the motion changes.
_SIGN_WIDTH = 0.05
# Largest share of the torque's variance that a log's own model leaves, in a log that moves against its torque.
_OPPOSED = 0.5
# Bins of the residuals' spectrum (of twice the length) that the fit of a log takes out.
_FITTED_BINS = 4
# Share of the residual variance that a torque of the heading removes in a log that was not fitted: the least median of
# all logs. Chance removes nothing in half of them.
_OF_HEADING = 0.1
# Standard deviation of the gain of one thruster: a log in which it pushes more or less than usual may deviate by that.
GAIN = 0.2
# Squared distance from which a log counts less, and not at all: 99.9 % of a chi-square of two, and far beyond.
_FAR, _FOREIGN = 13.8, 30.0
# Scatter of the deviations of one vehicle's logs: least, usual with its weight in logs, and the range, relative.
_LEAST_SCATTER, _USUAL_SCATTER, _USUAL_LOGS = 0.03, 0.06, 3
_SCATTERS = np.geomspace(_LEAST_SCATTER, 2.0, 40)
# Factors on the scatter of the logs, over which the probability of a deviation is averaged.
_FACTORS = np.geomspace(0.3, 60.0, 80)
# Weight of a log in a median, over the median weight, at most: two precise logs of six are no majority.
_MOST_WEIGHT = 1.0
# Relative deviation of the centre at least: the parameters stay positive.
_LEAST_CENTRE = -0.9
# Median of a chi-square of two degrees of freedom.
_MEDIAN = 1.386


@dataclass(frozen=True, kw_only=True, eq=False)
class LogMoments:
    """What one log says on the common model; p = 3 parameters: inertia, quadratic drag, linear drag."""

    name: str
    slope: FloatArray  #: (p, p) instruments times regressors.
    score: FloatArray  #: (p,) instruments times residuals of the common model.
    noise: FloatArray  #: (p, p) covariance of the score by the autocorrelated residuals and by the thrusters' gains.
    #: (p, p) covariance of the score per squared relative scatter of inertia, drag, and torques of other shapes.
    spread: FloatArray
    features: FloatArray  #: (5,) logarithms of torque, rate, speed and peakedness of the torque; campaign time in s.
    misfit: float  #: RMS residual of the common model over the RMS torque.
    #: ``deviation``, ``standard_errors``: (2,) relative, of inertia and drag, with the least scatter.
    deviation: FloatArray
    standard_errors: FloatArray
    distance: float = 0.0  #: Squared distance from the other logs with their scatter.
    chance: float = 1.0  #: Probability that a log of the same vehicle is as far from the others.

    @property
    def log_residual(self) -> float:
        """Logarithm of the RMS residual of the common model."""
        return float(np.log(self.misfit) + self.features[0])


@dataclass(frozen=True, kw_only=True, eq=False)
class QuickModel:
    """The common model: kg m^2, N m s^2, N m s (or kg, N s^2/m^2, N s/m)."""

    values: FloatArray  #: (3,) inertia, quadratic drag, linear drag.
    time_constant: float  #: s
    logs: tuple[LogMoments, ...]
    regressors: tuple["LogRegressors", ...]

    @property
    def inertia(self) -> float:
        """Inertia with the added one."""
        return float(self.values[0])


class LogRegressors:
    """Regressors and instruments of a log, which may be in parts, without their means."""

    def __init__(self, name: str, runs: Sequence[Run], vehicle: Vehicle, tau: float, scale: float) -> None:
        self.name, self.start, self.runs = name, runs[0].trial.campaign_time, runs
        parts = [_regressors(run, vehicle, tau, scale) for run in runs]
        #: (n, 3), (n, 3), (n, 3) torques of other shapes, (n,), (n, k) torque of each thruster with its mean.
        self.x, self.z, self.shapes, self.torque, self.single = map(np.concatenate, zip(*parts, strict=True))
        self.ambient = np.zeros(len(self.torque))  #: (n,) torque that depends on the heading alone, without its mean.

    @property
    def forcing(self) -> FloatArray:
        """(n,) torque of the thrusters and of the surroundings."""
        return np.asarray(self.torque + self.ambient)

    @cached_property
    def of_heading(self) -> FloatArray:
        """(n, 5) shapes of a torque of the heading, less their means: two harmonics, and the angle since the start."""
        parts = []
        for run in self.runs:
            # Where the position is absent, a logged rate may be known.
            time, known, angle = run.rates.time, np.isfinite(run.rates.position), np.zeros(int(run.valid.sum()))
            if known.any():
                angle = np.interp(time[run.valid], time[known], run.rates.position[known])
            columns = (*(each(k * angle) for k in (1.0, 2.0) for each in (np.sin, np.cos)), angle - angle[0])
            parts.append(np.column_stack([column - column.mean() for column in columns]))
        return np.concatenate(parts)

    @cached_property
    def time(self) -> FloatArray:
        """(n,) s from the beginning of the log's first part."""
        return np.concatenate([run.rates.time[run.valid] + run.trial.campaign_time - self.start for run in self.runs])

    def centred(self, values: FloatArray) -> FloatArray:
        """(n,) or (n, k) ``values`` without their mean in each part of the log, as the regressors are."""
        ends = np.cumsum([int(run.valid.sum()) for run in self.runs])[:-1]
        return np.concatenate([part - part.mean(axis=0) for part in np.split(values, ends)])

    @cached_property
    def is_opposite(self) -> bool:
        """Whether the vehicle moves against its torque: own inertia and drag both negative, which is impossible."""
        values = solved(self.x.T @ self.x, self.x.T @ self.torque)
        rest = self.torque - self.x @ values
        drag = values[2] + 1.5 * values[1] * np.sqrt(np.mean(self.x[:, 2] ** 2))
        explains = float(rest @ rest) < _OPPOSED * float(self.torque @ self.torque)
        return bool(values[0] < 0.0 and drag < 0.0 and explains)

    @cached_property
    def rms_rate(self) -> float:
        """RMS rate, with its mean."""
        return float(np.sqrt(np.mean(np.concatenate([run.rates.rate[run.valid] for run in self.runs]) ** 2)))

    @property
    def is_cut(self) -> bool:
        """Whether the log is in parts, because of another fault."""
        return len(self.runs) > 1

    @property
    def commands(self) -> FloatArray:
        """(m, k) commands at the log's own instants."""
        return np.concatenate([run.trial.commands for run in self.runs])

    def torque_by(self, thruster: Thruster, at: int) -> FloatArray:
        """(n,) torque of ``thruster`` with the command number ``at``."""
        parts = []
        for run in self.runs:
            torque = thruster.torque(run.trial.commands[:, at])
            parts.append(run.rates.filter_held(run.trial, torque)[run.valid])
        return np.concatenate(parts)

    @cached_property
    def waves(self) -> ComplexArray:
        """(m, 3) spectrum of the instruments, of twice the length."""
        return np.asarray(np.fft.rfft(self.z, fast_fft_length(2 * len(self.z)), axis=0))


def log_name(run: Run) -> str:
    """Name of the log that a run is, or is a part of."""
    return run.trial.parent or run.trial.name


def log_parts(runs: Iterable[Run]) -> dict[str, list[Run]]:
    """The runs of each log, by its name."""
    parts: dict[str, list[Run]] = {}
    for run in runs:
        parts.setdefault(log_name(run), []).append(run)
    return parts


def first_order(values: FloatArray, tau: float, period: float) -> FloatArray:
    """(n,) first-order low pass of ``values`` with the time constant ``tau`` in s, from rest."""
    size = fast_fft_length(2 * len(values))
    decay = np.exp(-period * np.arange(len(values)) / tau)
    response = np.fft.rfft(decay * -np.expm1(-period / tau), size)
    return np.asarray(np.fft.irfft(np.fft.rfft(values, size) * response, size)[: len(values)])


def held_torque(run: Run) -> FloatArray:
    """(m,) torque on the grid of the rates, filtered where that is known."""
    held = np.interp(run.rates.time, run.trial.time, run.torque)
    return np.where(np.isfinite(run.filtered_torque), run.filtered_torque, held)


def fit_quick_model(runs: Sequence[Run], vehicle: Vehicle) -> QuickModel | None:
    """The common model and the logs' moments; None where the logs do not determine a model."""
    return _fitted(tuple(runs), vehicle)


@lru_cache(maxsize=2)  # Several kinds of faults examine the same runs, or compare them with changed ones.
def _fitted(runs: tuple[Run, ...], vehicle: Vehicle) -> QuickModel | None:
    parts = log_parts([run for run in runs if int(run.valid.sum()) >= _MIN_SAMPLES])
    # A constant torque says nothing on the inertia, and in the regression, which has a trim, nothing on the drag.
    size = {
        name: float(np.std(np.concatenate([held_torque(run)[run.valid] for run in own]))) for name, own in parts.items()
    }
    least = _EXCITED * float(np.median(list(size.values()))) if size else 0.0
    parts = {name: own for name, own in parts.items() if size[name] > least}
    used = [run for own in parts.values() for run in own]
    scale = float(np.sqrt(np.mean([np.mean(run.torque**2) for run in used]))) if used else 0.0
    if vehicle.axis.self_righting or not scale > 0.0:
        return None
    # A log with more thrust than the others counts as much as one of them.
    powers = np.array([sum(float(np.sum(run.torque**2)) for run in own) for own in parts.values()])
    base = np.minimum(1.0, np.median(powers) / powers.clip(1e-300))
    tau, weights, moments = 1.0, base, list[LogMoments]()
    for count in range(_PASSES):
        if count < _SETTLING:
            logs = [LogRegressors(name, own, vehicle, tau, scale) for name, own in parts.items()]
            # A log that moves against its torque would cancel another; signs that are wrong in all logs stay.
            agree = np.array([not log.is_opposite for log in logs])
            agree |= not agree.any()
            weights = base * agree
            if vehicle.axis.angular:
                _add_torque_of_heading(logs, weights)
        pairs = [(log.z if count else log.x, log) for log in logs]
        slope = sum(weight * z.T @ log.x for weight, (z, log) in zip(weights, pairs, strict=True))
        score = sum(weight * z.T @ log.forcing for weight, (z, log) in zip(weights, pairs, strict=True))
        values = solved(np.asarray(slope), np.asarray(score))
        rate = float(np.sqrt(np.mean(np.concatenate([log.x[:, 2] for log in logs]) ** 2)))
        drag = 1.5 * values[1] * rate + values[2]
        if not (values[0] > 0.0 and drag > 0.0):
            return None
        if count < _SETTLING:
            longest = max(run.trial.duration for run in used)
            tau = float(np.clip(values[0] / drag, used[0].rates.kernel.period, longest))
        if count >= _SETTLING - 1:
            found = _moments(logs, values)
            if not moments:
                # From the median of all logs: one foreign log with more thrust than the others is no majority.
                centre = _centre([*compress(found, agree)])
                values = values + _directions(values) @ np.maximum(centre, _LEAST_CENTRE)
                found = _moments(logs, values)
            moments = _with_distances(found, values, agree)
            far = np.array([log.distance for log in moments]).clip(_FAR)
            weights = base * np.where(far < _FOREIGN, _FAR / far, 0.0)
            if not weights.any():
                return None
    return QuickModel(values=values, time_constant=tau, logs=tuple(moments), regressors=tuple(logs))


def _regressors(run: Run, vehicle: Vehicle, tau: float, scale: float) -> tuple[FloatArray, ...]:
    valid, rates = run.valid, run.rates
    rate, torque = rates.rate[valid], held_torque(run)
    follows = first_order(torque, tau, rates.kernel.period)
    own, lagged = follows[valid], ((torque - follows) / tau)[valid]
    x = np.column_stack((rates.acceleration[valid], np.abs(rate) * rate, rate))
    z = np.column_stack((lagged, np.abs(own) * own, own))
    # A delay or lag, a gain of one direction, and friction or a dead zone.
    sign = scale * np.tanh(follows / (_SIGN_WIDTH * scale))
    shapes = np.column_stack((np.gradient(torque, rates.kernel.period) * tau, np.abs(torque), sign))[valid]
    pairs = zip(vehicle.thrusters, run.trial.commands.T, strict=True)
    single = np.column_stack([rates.filter_held(run.trial, thruster.torque(command)) for thruster, command in pairs])
    return (*(each - each.mean(axis=0) for each in (x, z, shapes, torque[valid])), single[valid])


def _add_torque_of_heading(logs: Sequence[LogRegressors], weights: FloatArray) -> None:
    """Set the ambient torque of the ``logs`` if it predicts each log from the others."""
    if len(logs) < _MIN_LOGS:
        return
    slopes, scores, removed = list[FloatArray](), list[FloatArray](), list[float]()
    for weight, log in zip(weights, logs, strict=True):
        x, z = np.column_stack((log.x, log.of_heading)), np.column_stack((log.z, log.of_heading))
        slopes.append(weight * z.T @ x)
        scores.append(weight * z.T @ log.torque)
    slope, score = np.sum(slopes, axis=0), np.sum(scores, axis=0)
    for log, own_slope, own_score in zip(logs, slopes, scores, strict=True):
        others, torque = slope - own_slope, score - own_score
        values, plain = solved(others, torque), solved(others[:3, :3], torque[:3])
        rest, plain_rest = log.torque - log.x @ values[:3] - log.of_heading @ values[3:], log.torque - log.x @ plain
        removed.append(1.0 - float(rest @ rest) / float(plain_rest @ plain_rest))
    if np.median(removed) > _OF_HEADING:
        values = solved(slope, score)
        for log in logs:
            log.ambient = -log.of_heading @ values[3:]


def _moments(logs: Sequence[LogRegressors], values: FloatArray) -> list[LogMoments]:
    total = np.concatenate([log.torque for log in logs])
    shares = total @ np.concatenate([log.single for log in logs]) / (total @ total)
    return [_moments_of(log, values, shares) for log in logs]


def _moments_of(log: LogRegressors, values: FloatArray, shares: FloatArray) -> LogMoments:
    residual = log.forcing - log.x @ values
    slope, score = log.z.T @ log.x, log.z.T @ residual
    contrast = log.z.T @ (log.single - log.torque[:, None] * shares)
    noise = _covariance(log.waves, residual - log.x @ solved(slope, score)) + GAIN**2 * contrast @ contrast.T
    shapes = np.column_stack((slope @ _directions(values), log.z.T @ log.shapes))
    spread = shapes @ shapes.T
    deviations, information = _deviation(slope, score, (noise + _LEAST_SCATTER**2 * spread)[None], values)
    size = np.sqrt(np.mean(log.torque**2)).clip(1e-300)
    speed = np.std(np.diff(log.torque)).clip(1e-300) / size
    peak = np.mean(log.torque**4) / size**4
    rate = np.sqrt(np.mean(log.x[:, 2] ** 2)).clip(1e-300)
    return LogMoments(
        name=log.name,
        slope=slope,
        score=score,
        noise=noise,
        spread=spread,
        features=np.append(np.log((size, rate, speed, max(peak, 1e-300))), log.start),
        misfit=float(np.sqrt(np.mean(residual**2)) / size),
        deviation=deviations[0],
        standard_errors=np.sqrt(np.diag(np.linalg.pinv(information[0], hermitian=True))),
    )


def _with_distances(logs: Sequence[LogMoments], values: FloatArray, agree: BoolArray) -> list[LogMoments]:
    """The logs with their distances from the median deviation, with the scatter of the other logs that ``agree``."""
    centre = _centre([*compress(logs, agree)])
    distances = np.array([_distances(log, _SCATTERS, centre, values) for log in logs])
    found = []
    for at, log in enumerate(logs):
        others = distances[agree & (np.arange(len(logs)) != at)]
        fits = np.flatnonzero(np.median(others, axis=0) <= _MEDIAN) if len(others) else np.array([0])
        own = float(_SCATTERS[fits[0]]) if fits.size else float(_SCATTERS[-1])
        count = max(len(others) - 1, 0)
        scatter = np.sqrt((_USUAL_LOGS * _USUAL_SCATTER**2 + count * own**2) / (_USUAL_LOGS + count))
        likely = max(float(scatter), own)
        distance = float(_distances(log, np.array([likely]), centre, values)[0])
        # The scatter itself is uncertain: a scaled inverse chi-square. Without noise the result is that of F.
        freedom = _USUAL_LOGS + count
        x = freedom / _FACTORS**2
        weights = np.exp(0.5 * freedom * (np.log(x / freedom) + 1.0) - 0.5 * x)
        chances = np.exp(-0.5 * _distances(log, likely * _FACTORS, centre, values))
        found.append(replace(log, distance=distance, chance=float(weights @ chances / weights.sum())))
    return found


def _centre(logs: Sequence[LogMoments]) -> FloatArray:
    """(2,) median of the deviations, weighted by their standard errors."""
    centre = []
    for k in (0, 1):
        values, errors = np.array(sorted((log.deviation[k], log.standard_errors[k]) for log in logs)).T
        weights = 1.0 / errors.clip(_LEAST_SCATTER) ** 2
        weights = np.cumsum(weights.clip(max=_MOST_WEIGHT * np.median(weights)))
        centre.append(values[np.searchsorted(weights, 0.5 * weights[-1])])
    return np.array(centre)


def _distances(log: LogMoments, scatters: FloatArray, centre: FloatArray, values: FloatArray) -> FloatArray:
    """Squared distances of a log from the ``centre`` for each of the (m,) ``scatters``."""
    score = log.score - log.slope @ _directions(values) @ centre
    noise = log.noise + scatters[:, None, None] ** 2 * log.spread
    deviation, information = _deviation(log.slope, score, noise, values)
    return np.asarray(np.einsum("mi,mij,mj->m", deviation, information, deviation))


def _deviation(
    slope: FloatArray, score: FloatArray, noise: FloatArray, values: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(m, 2) relative deviations of inertia and drag by generalised least squares, and (m, 2, 2) information.

    ``noise``: (m, 3, 3) covariances of the (3,) ``score``.
    """
    size = np.sqrt(np.diagonal(noise, axis1=1, axis2=2)).clip(1e-300)
    x = (slope @ _directions(values)) / size[:, :, None]
    inverse = np.linalg.inv(noise / size[:, :, None] / size[:, None, :] + 1e-9 * np.eye(len(score)))
    information = x.transpose(0, 2, 1) @ inverse @ x
    pulls = x.transpose(0, 2, 1) @ inverse @ (score / size)[:, :, None]
    return (np.linalg.pinv(information, hermitian=True) @ pulls)[:, :, 0], information


def _directions(values: FloatArray) -> FloatArray:
    """(3, 2) parameters per relative deviation of the inertia and of the whole drag."""
    return np.array([[values[0], 0.0], [0.0, values[1]], [0.0, values[2]]])


def solved(slope: FloatArray, score: FloatArray) -> FloatArray:
    """(p,) least-squares solution of ``slope`` (p, p) times x = ``score`` (p,), with scaled rows and columns."""
    size = np.sqrt(np.abs(np.diag(slope))).clip(1e-300)
    return np.asarray(np.linalg.lstsq(slope / size[:, None] / size, score / size, rcond=1e-9)[0] / size)


def _covariance(waves: ComplexArray, rest: FloatArray) -> FloatArray:
    """(p, p) covariance of z' e for autocorrelated residuals e, by their smoothed periodogram and z's ``waves``."""
    size = fast_fft_length(2 * len(rest))
    power = np.abs(np.fft.rfft(rest, size)) ** 2 / len(rest)
    # Averages over half an octave and some more bins, without the bins that the fit has taken out.
    bins = np.arange(len(power))
    high = np.minimum((1.2 * bins).astype(np.intp) + 3 * _FITTED_BINS, len(power) - 1)
    low = np.minimum(np.maximum((bins / 1.2).astype(np.intp), _FITTED_BINS), high)
    sums = np.concatenate(([0.0], np.cumsum(power)))
    smooth = 2.0 * (sums[high + 1] - sums[low]) / (high + 1 - low)
    smooth[0] *= 0.5
    return np.asarray(np.real((waves.conj() * smooth[:, None]).T @ waves) / size)
