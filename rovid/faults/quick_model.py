"""A model of all logs within milliseconds, and how far each log deviates: one regression by instrumental variables.

I rdot + DQ |r| r + DL r + trim = T + A(psi), all signals through one filter. A torque A of the heading, of wind, a
current or a tether, is part of the model where it predicts the other logs: in a sine run alone it acts like an inertia.
Sensor noise is in the regressors; the instruments are the same regressors of a motion that follows the torque with one
time constant. A log that deviates from the others counts less (Huber's weights), so that a minority of foreign logs
does not move the model.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from itertools import compress

import numpy as np

from rovid.core.array_types import BoolArray, ComplexArray, FloatArray, IntArray
from rovid.faults.log_regressors import LogRegressors, held_torque, solved
from rovid.trial.preprocessing import Run
from rovid.trial.rates import fast_fft_length
from rovid.trial.vehicle import Vehicle

# Logs that show a torque of the heading.
_MIN_LOGS = 3
# Valid samples that a log needs.
_MIN_SAMPLES = 50
# Number of passes: in the first ones the time constant settles, in the others the weights.
_SETTLING, _PASSES = 3, 6
# Share of the median standard deviation of the torque that a log needs: another log says nothing.
_EXCITED = 0.02
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
# Smallest over largest eigenvalue of a regular matrix.
_SINGULAR = 1e-15
# Standard deviations of an outlier, and median absolute deviations in one of a normal distribution. Convention.
_OUTLYING, _NORMAL = 5.0, 1.48
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
    deviation: FloatArray = field(default_factory=partial(np.full, 2, np.nan))
    standard_errors: FloatArray = field(default_factory=partial(np.full, 2, np.nan))
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
    regressors: tuple[LogRegressors, ...]

    @property
    def inertia(self) -> float:
        """Inertia with the added one."""
        return float(self.values[0])


def log_name(run: Run) -> str:
    """Name of the log that a run is, or is a part of."""
    return run.trial.parent or run.trial.name


def log_parts(runs: Iterable[Run]) -> dict[str, list[Run]]:
    """The runs of each log, by its name."""
    parts: dict[str, list[Run]] = {}
    for run in runs:
        parts.setdefault(log_name(run), []).append(run)
    return parts


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
    tau, moments = 1.0, list[LogMoments]()
    logs = [LogRegressors(name, own, vehicle, tau, scale) for name, own in parts.items()]
    # A log that moves against its torque would cancel another; signs that are wrong in all logs stay.
    agree = np.array([not log.is_opposite for log in logs])
    agree |= not agree.any()
    weights = base * agree
    for count in range(_PASSES):
        if count < _SETTLING:
            logs = [log.following(tau) for log in logs] if count else logs
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
            usual = np.ones(len(found), dtype=bool)
            if not moments:
                # From the median of all logs: one foreign log with more thrust than the others is no majority.
                centre = _centre([*compress(found, agree)])
                values = values + _directions(values) @ np.maximum(centre, _LEAST_CENTRE)
                found = _moments(logs, values)
                usual = _has_usual_inertia(found)
            moments = _with_distances(found, values, agree)
            far = np.array([log.distance for log in moments]).clip(_FAR)
            weights = base * usual * np.where(far < _FOREIGN, _FAR / far, 0.0)
            if not weights.any():
                return None
    return QuickModel(values=values, time_constant=tau, logs=tuple(moments), regressors=tuple(logs))


def _has_usual_inertia(logs: Sequence[LogMoments]) -> BoolArray:
    """(n,) whether the inertia of each log is near the median, by the scatter about it.

    Light vehicles move most, and pull the first models. Those divide the drag wrongly, and its deviations scatter.
    """
    deviations, errors = np.array([(log.deviation[0], log.standard_errors[0]) for log in logs]).T
    distances = np.abs(deviations - np.median(deviations))
    scale = np.hypot(errors, (_NORMAL * np.median(distances)).clip(_LEAST_SCATTER))
    return np.asarray(distances < _OUTLYING * scale)


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
    found = [_moments_of(log, values, shares) for log in logs]
    deviations, information = _deviations(found, np.full((len(found), 1), _LEAST_SCATTER), np.zeros(2), values)
    errors = np.sqrt(np.diagonal(_inverse(information), axis1=-2, axis2=-1))
    every = zip(found, deviations, errors, strict=True)
    return [replace(log, deviation=own[0], standard_errors=error[0]) for log, own, error in every]


def _moments_of(log: LogRegressors, values: FloatArray, shares: FloatArray) -> LogMoments:
    """The moments without ``deviation`` and ``standard_errors``."""
    residual = log.forcing - log.x @ values
    slope, shapes, torque, single = np.split(log.products, (3, 6, 7), axis=1)
    score, contrast = log.z.T @ residual, single - torque * shares
    shapes = np.column_stack((slope @ _directions(values), shapes))
    return LogMoments(
        name=log.name,
        slope=slope,
        score=score,
        noise=_covariance(log.waves, residual - log.x @ solved(slope, score)) + GAIN**2 * contrast @ contrast.T,
        spread=shapes @ shapes.T,
        features=log.features,
        misfit=float(np.sqrt(np.mean(residual**2)) / np.sqrt(np.mean(log.torque**2)).clip(1e-300)),
    )


def _with_distances(logs: Sequence[LogMoments], values: FloatArray, agree: BoolArray) -> list[LogMoments]:
    """The logs with their distances from the median deviation, with the scatter of the other logs that ``agree``."""
    centre = _centre([*compress(logs, agree)])
    distances = _distances(logs, np.tile(_SCATTERS, (len(logs), 1)), centre, values)
    others = agree & ~np.eye(len(logs), dtype=bool)
    size = others.sum(axis=1)
    # Medians of the others: the rest is beyond all.
    ranked = np.sort(np.where(others[:, :, None], distances, np.inf), axis=1)
    middle = 0.5 * sum(ranked[np.arange(len(logs)), each] for each in ((size - 1).clip(0) // 2, size // 2))
    fits = (middle <= _MEDIAN) | (size == 0)[:, None]
    own = np.where(fits.any(axis=1), _SCATTERS[fits.argmax(axis=1)], _SCATTERS[-1])
    freedom = _USUAL_LOGS + (size - 1).clip(0)
    scatter = np.sqrt((_USUAL_LOGS * _USUAL_SCATTER**2 + (freedom - _USUAL_LOGS) * own**2) / freedom)
    likely = np.maximum(scatter, own)
    every = _distances(logs, likely[:, None] * np.append(1.0, _FACTORS), centre, values)
    # The scatter itself is uncertain: a scaled inverse chi-square. Without noise the result is that of F.
    ratio = 1.0 / _FACTORS**2
    weights = np.exp(0.5 * freedom[:, None] * (np.log(ratio) + 1.0 - ratio))
    chances = np.sum(weights * np.exp(-0.5 * every[:, 1:]), axis=1) / weights.sum(axis=1)
    pairs = zip(logs, every[:, 0].tolist(), chances.tolist(), strict=True)
    return [replace(log, distance=distance, chance=chance) for log, distance, chance in pairs]


def _centre(logs: Sequence[LogMoments]) -> FloatArray:
    """(2,) median of the deviations, weighted by their standard errors."""
    centre = []
    for k in (0, 1):
        values, errors = np.array(sorted((log.deviation[k], log.standard_errors[k]) for log in logs)).T
        weights = 1.0 / errors.clip(_LEAST_SCATTER) ** 2
        weights = np.cumsum(weights.clip(max=_MOST_WEIGHT * np.median(weights)))
        centre.append(values[np.searchsorted(weights, 0.5 * weights[-1])])
    return np.array(centre)


def _distances(logs: Sequence[LogMoments], scatters: FloatArray, centre: FloatArray, values: FloatArray) -> FloatArray:
    """(l, m) squared distances of the l ``logs`` from the ``centre`` for each of the (l, m) ``scatters``."""
    deviations, information = _deviations(logs, scatters, centre, values)
    return np.asarray(np.einsum("lmi,lmij,lmj->lm", deviations, information, deviations))


def _deviations(
    logs: Sequence[LogMoments], scatters: FloatArray, centre: FloatArray, values: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(l, m, 2) deviations of inertia and drag from the ``centre``, relative, and (l, m, 2, 2) information.

    They are those of generalised least squares for each of the (l, m) ``scatters`` of the l ``logs``.
    """
    slopes, scores, noises, spreads = (
        np.array([getattr(log, name) for log in logs])[:, None] for name in ("slope", "score", "noise", "spread")
    )
    slopes = slopes @ _directions(values)
    scores = scores - slopes @ centre
    noises = noises + scatters[:, :, None, None] ** 2 * spreads
    size = np.sqrt(np.diagonal(noises, axis1=-2, axis2=-1)).clip(1e-300)[..., None]
    x, y = slopes / size, scores[..., None] / size
    inverse = np.linalg.inv(noises / size / np.swapaxes(size, -2, -1) + 1e-9 * np.eye(scores.shape[-1]))
    pulls = np.swapaxes(x, -2, -1) @ inverse
    information = pulls @ x
    return (_inverse(information) @ (pulls @ y))[..., 0], information


def _inverse(matrices: FloatArray) -> FloatArray:
    """(…, 2, 2) pseudo-inverses of symmetric matrices without negative eigenvalues, to rounding."""
    (a, b), (_, d) = np.moveaxis(matrices, (-2, -1), (0, 1))
    largest = 0.5 * (a + d) + np.hypot(0.5 * (a - d), b)
    determinant = a * d - b * b
    is_regular = determinant > _SINGULAR * largest**2
    regular = np.array([[d, -b], [-b, a]]) / np.where(is_regular, determinant, 1.0)
    singular = np.array([[a, b], [b, d]]) / np.where(largest > 0.0, largest, 1.0) ** 2
    return np.moveaxis(np.where(is_regular, regular, singular), (0, 1), (-2, -1))


def _directions(values: FloatArray) -> FloatArray:
    """(3, 2) parameters per relative deviation of the inertia and of the whole drag."""
    return np.array([[values[0], 0.0], [0.0, values[1]], [0.0, values[2]]])


def _covariance(waves: ComplexArray, rest: FloatArray) -> FloatArray:
    """(p, p) covariance of z' e for autocorrelated residuals e, by their smoothed periodogram and z's ``waves``."""
    size = fast_fft_length(2 * len(rest))
    power = np.abs(np.fft.rfft(rest, size)) ** 2 / len(rest)
    low, high = _bands(len(power))
    sums = np.concatenate(([0.0], np.cumsum(power)))
    smooth = 2.0 * (sums[high + 1] - sums[low]) / (high + 1 - low)
    smooth[0] *= 0.5
    return np.asarray(np.real((waves.conj() * smooth[:, None]).T @ waves) / size)


@lru_cache(maxsize=64)
def _bands(count: int) -> tuple[IntArray, IntArray]:
    """First and last of the bins over which each of ``count`` bins of a periodogram is averaged.

    Averages over half an octave and some more bins, without the bins that the fit has taken out.
    """
    bins = np.arange(count)
    high = np.minimum((1.2 * bins).astype(np.intp) + 3 * _FITTED_BINS, count - 1)
    return np.minimum(np.maximum((bins / 1.2).astype(np.intp), _FITTED_BINS), high), high
