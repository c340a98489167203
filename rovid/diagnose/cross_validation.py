"""Cross-validation: required data, division of runs into pieces, scores on held-out pieces, and their noise floor."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.core.errors import DataError
from rovid.core.spmd import parallel_map
from rovid.core.stats import t_quantile
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects import Effect
from rovid.effects.base import OnHeading, WaveTorque
from rovid.estimate.dataset import FitData, rms_rate, time_constant
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.multi_step import MultiStepData, prediction_errors, states_at_starts
from rovid.estimate.objective import NegativeLogLikelihood
from rovid.estimate.output_error import fit_output_error
from rovid.estimate.restart_grid import HORIZONS
from rovid.model.model import Model
from rovid.model.simulation import HORIZONS as HORIZON_SECONDS
from rovid.model.simulation import fit_measures, simulate_runs
from rovid.trial.preprocessing import PreparedRuns, Run, prepare_trials
from rovid.trial.rates import highest_cutoff
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle


def missing_data(runs: Sequence[Run], cutoff: float) -> str:
    """Message on what a diagnosis of ``runs`` lacks; empty if nothing. ``cutoff`` of the low-pass filter in Hz."""
    if len(runs) < THRESHOLDS.min_trials:
        part = min_part_length(runs, cutoff)
        seconds = sum(recorded_seconds(run.trial) for run in runs)
        return (
            f"there are too few trials ({len(runs)}, {seconds:.0f} s in all) to hold some out for validation, and they "
            f"are too short for {THRESHOLDS.min_trials} parts of {part:.0f} s. Record more runs of other kinds (a hold "
            "the other way, a sine, a coast-down)."
        )
    axis = runs[0].trial.axis
    if all(run.trial.has_actuators and not np.any(run.torque != 0.0) for run in runs):
        return (
            f"no thruster ever runs: there is no {axis.force_name} to explain the motion with. Log a run under thrust."
        )
    if not any(map(_moves, runs)):
        moves, move = ("turns", "turn") if axis.angular else ("moves", "move")
        return (
            f"the vehicle never {moves}: its {axis.rate_words} does not exceed the sensor noise. Check that "
            f"{axis.position_signal} in rovid.toml is the vehicle's, and run sines, steps or a pseudo-random command "
            f"that {move} it."
        )
    return ""


def _moves(run: Run) -> bool:
    """Whether the rate exceeds the sensor noise."""
    rate = run.rates.rate[np.isfinite(run.rates.rate)]
    noise = run.rates.rate_noise * math.sqrt(len(rate))
    return bool(np.linalg.norm(rate) > THRESHOLDS.motion_over_noise * noise)


@dataclass(frozen=True, eq=False)
class CvPiece:
    """Interval from ``begin`` to ``end`` (s) of run ``run_index``, prepared as a run of its own."""

    run_index: int
    begin: float
    end: float
    run: Run


def split_runs(runs: Sequence[Run], vehicle: Vehicle, cutoff: float) -> PreparedRuns | None:
    """Parts of ``runs`` of about an eighth of all recorded time; None with enough runs, or with too little time.

    Each part is simulated from its own start, without the memory of water and tether before that start.
    """
    if len(runs) >= THRESHOLDS.min_trials:
        return None
    parts = _cut_runs(runs, cutoff)
    if len(parts) < THRESHOLDS.min_trials:
        return None
    return _prepare_parts(parts, vehicle, cutoff)


def cv_pieces(runs: Sequence[Run], vehicle: Vehicle, cutoff: float) -> list[CvPiece]:
    """Pieces of ``runs`` for cross-validation: whole runs where these are many and short, parts of them otherwise."""
    parts = _cut_runs(runs, cutoff)
    # A part in which gaps leave too little for the filter has no run: no fold predicts it, and no fold is fitted to it.
    prepared = {id(run.trial): run for run in _prepare_parts(parts, vehicle, cutoff).items}
    known = [part for part in parts if id(part.trial) in prepared]
    return [CvPiece(part.run_index, part.begin, part.end, prepared[id(part.trial)]) for part in known]


def min_part_length(runs: Sequence[Run], cutoff: float) -> float:
    """Shortest length of a part in s: some time constants of the vehicle, and some periods of ``cutoff`` in Hz."""
    try:
        start = fit_output_error(runs, min_sigmas=0.0)
        constant = time_constant(start, rms_rate(runs))
        # Rounding costs each run half a part at most, and runs are cut where they are fewer than `min_trials`.
        longest = sum(recorded_seconds(run.trial) for run in runs) / (1.5 * THRESHOLDS.min_trials)
        # Missing effects lengthen the time constant of the plain model: shorter parts are allowed where needed.
        shortest = max(longest, THRESHOLDS.part_time_constants_min * constant)
        shortest = min(shortest, THRESHOLDS.part_time_constants * constant)
    except DataError:
        shortest = sum(recorded_seconds(run.trial) for run in runs) / THRESHOLDS.parts
    return max(shortest, THRESHOLDS.part_cutoff_periods / cutoff)


def recorded_seconds(trial: Trial) -> float:
    """Time in s with measured positions, without pauses."""
    return sum(float(np.ptp(trial.time[session])) for session in _sessions(trial))


def has_pause(runs: Sequence[Run]) -> bool:
    """Whether positions are missing for so long that a part begins anew after it; a whole log does not."""
    return any(len(_sessions(run.trial)) > 1 for run in runs)


def _sessions(trial: Trial) -> list[IntArray]:
    """Indices of the measured positions between pauses."""
    measured = np.flatnonzero(trial.measured)
    pause = THRESHOLDS.pause_periods * trial.sampling_interval
    return np.split(measured, 1 + np.flatnonzero(np.diff(trial.time[measured]) > pause))


class _Part(NamedTuple):
    """Interval from ``begin`` to ``end`` (s) of run ``run_index``."""

    run_index: int
    begin: float
    end: float
    trial: Trial


def _prepare_parts(parts: Sequence[_Part], vehicle: Vehicle, cutoff: float) -> PreparedRuns:
    trials = [part.trial for part in parts]
    return prepare_trials(trials, vehicle, cutoff=min(cutoff, highest_cutoff(trials)))


def _cut_runs(runs: Sequence[Run], cutoff: float) -> list[_Part]:
    """Parts of all runs; at least two of each run that is long enough, for effects that are specific to one trial."""
    shortest, seconds = min_part_length(runs, cutoff), [recorded_seconds(run.trial) for run in runs]
    usual = max(sum(seconds) / THRESHOLDS.parts, shortest)
    parts = []
    for run_index, (run, own) in enumerate(zip(runs, seconds, strict=True)):
        parts += _cut_run(run_index, run.trial, min(usual, max(own / 2.0, shortest)))
    return parts


def _cut_run(run_index: int, trial: Trial, length: float) -> list[_Part]:
    """Parts of about ``length`` s that begin and end with a measured position, none across a pause."""
    pieces: list[IntArray] = []
    for session in _sessions(trial):
        time = trial.time[session]
        count = max(round(float(np.ptp(time)) / length), 1)
        pieces += np.split(session, np.searchsorted(time, np.linspace(time[0], time[-1], count + 1)[1:-1]))
    parts = []
    for number, piece in enumerate(pieces, start=1):
        if len(piece) < THRESHOLDS.part_samples:
            continue
        first, last = int(piece[0]), int(piece[-1])
        part = trial.part(slice(first, last + 1), f"{trial.name} part {number}")
        parts.append(_Part(run_index, float(trial.time[first]), float(trial.time[last]), part))
    return parts


@dataclass(frozen=True, kw_only=True)
class HeldOutScores:
    """Scores of a model on all trials, each predicted by a fit to the others."""

    log_likelihood: float  #: Of the innovations.
    #: ``rate_r2``, ``rate_rmse``: of the free-running simulation.
    rate_r2: float
    rate_rmse: float
    #: (p,) mean square error of the rate in each piece, in the order of the folds; NaN where none is known.
    rate_squares: FloatArray
    #: Horizon in s -> RMS position error that far after a restart; None where no trial is as long.
    position_errors: dict[float, float | None]


@dataclass(frozen=True, kw_only=True, eq=False)
class Fold:
    """Held-out pieces, the coordinates fitted to all other pieces, and the held-out log-likelihood."""

    pieces: list[CvPiece]
    x: FloatArray
    log_likelihood: float


def cross_validate(fitted: FitResult, pieces: Sequence[CvPiece]) -> list[Fold]:
    """Refit the model without each fold of the ``pieces``, and predict that fold.

    A fold is every fourth piece: neighbours by name, which are runs of one kind, fall into different folds.
    """
    piece = _piece_index(fitted.data, pieces)
    count = len(pieces)
    numbers = [list(range(first, count, THRESHOLDS.cv_folds)) for first in range(min(THRESHOLDS.cv_folds, count))]
    held_out = [np.isin(piece, own) for own in numbers]
    tests = [fitted.objective.with_effects(fitted.effects, mask) for mask in held_out]
    # A prediction that spans two pieces belongs to neither.
    training = [fitted.objective.with_effects(fitted.effects, ~mask & (piece >= 0)) for mask in held_out]

    def train(objective: NegativeLogLikelihood) -> FloatArray:
        # The fit to all pieces is so close that a few steps are enough.
        most, tolerance = THRESHOLDS.cv_iterations, THRESHOLDS.cv_tolerance
        return _without_undetermined(fit(objective, fitted.x, iterations=most, tolerance=tolerance))

    fits = parallel_map(train, training)
    values = fitted.objective.held_out_values(tests, fits)
    folds = []
    for own, value, x in zip(numbers, values, fits, strict=True):
        folds.append(Fold(pieces=[pieces[number] for number in own], x=x, log_likelihood=-value))
    return folds


def _without_undetermined(fitted: FitResult) -> FloatArray:
    """Coordinates with neutral values of effects without influence; their values would come from the held-out data."""
    objective, x = fitted.objective, fitted.x
    for effect, own in objective.parametrization.effect_slices():
        without = x.copy()
        without[own] = [parameter.neutral for parameter in effect.parameters]
        if abs(objective.value(without) - fitted.value) < THRESHOLDS.cv_indifference:
            x = without
    return x


def _piece_index(data: FitData, pieces: Sequence[CvPiece]) -> IntArray:
    """(N,) index of the piece of each innovation; -1 for an innovation within no single piece."""
    numbers = []
    for run, (begin, end) in enumerate(data.innovation_spans):
        own = np.full(len(begin), -1)
        for index, piece in enumerate(pieces):
            if piece.run_index == run:
                own[(piece.begin <= begin) & (end <= piece.end)] = index
        numbers.append(own)
    return np.concatenate(numbers)


def held_out_log_likelihood(folds: Sequence[Fold]) -> float:
    """Log-likelihood of all trials, each by the fit to the others."""
    return sum(fold.log_likelihood for fold in folds)


def simulate_folds(fitted: FitResult, folds: Sequence[Fold]) -> HeldOutScores:
    """Scores of free-running simulations of all trials, each by the fit to the others."""
    vehicle, models = fitted.data.vehicle, [fitted.objective.parametrization.model(fold.x) for fold in folds]
    assert vehicle is not None  # noqa: S101 - a diagnosis has one
    pairs = [(piece.run, model) for fold, model in zip(folds, models, strict=True) for piece in fold.pieces]

    def simulate(pair: tuple[Run, Model]) -> tuple[FloatArray, dict[float, float | None]]:
        run, model = pair
        (item,) = simulate_runs([run], model, vehicle)
        return item.simulated, item.position_errors

    rates, errors = zip(*parallel_map(simulate, pairs), strict=True)
    measured = [run.rates.rate for run, _ in pairs]
    measures = fit_measures(np.concatenate(measured), np.concatenate(rates))
    position_errors: dict[float, float | None] = {}
    for horizon in HORIZON_SECONDS:
        known = [one[horizon] for one in errors if one[horizon] is not None]
        position_errors[horizon] = float(np.sqrt(np.mean(np.square(known)))) if known else None
    return HeldOutScores(
        log_likelihood=held_out_log_likelihood(folds),
        rate_r2=measures.r2,
        rate_rmse=measures.rmse,
        rate_squares=np.array([fit_measures(*one).rmse ** 2 for one in zip(measured, rates, strict=True)]),
        position_errors=position_errors,
    )


def simulated_rates(fitted: FitResult, pieces: Sequence[CvPiece]) -> list[FloatArray]:
    """(m,) free-running rate of each piece."""
    vehicle, runs = fitted.data.vehicle, [piece.run for piece in pieces]
    assert vehicle is not None  # noqa: S101 - a diagnosis has one
    return [one.simulated for one in simulate_runs(runs, fitted.model, vehicle)]


def change_in_samples(effect: Effect, own: Sequence[FloatArray], other: Sequence[FloatArray]) -> float:
    """RMS difference of the `simulated_rates` of two models, over the RMS change of the rate in a sampling interval.

    The steps of a logger and of a simulator have errors of a small part of it. Of samples far apart, the change counts
    at most as `THRESHOLDS.sampling_change` of the RMS rate. Infinite for an ``effect`` that is not part of the
    simulated rate: a torque of random phase, or a deviation of the heading.
    """
    if isinstance(effect.acts, WaveTorque | OnHeading):
        return math.inf
    change = np.concatenate(own) - np.concatenate(other)
    steps = np.nanmean(np.concatenate([np.diff(one) for one in other]) ** 2)
    most = THRESHOLDS.sampling_change**2 * np.nanmean(np.concatenate(other) ** 2)
    return math.sqrt(float(np.nanmean(change**2)) / max(float(min(steps, most)), np.finfo(float).tiny))


def certain_growth(own: FloatArray, without: FloatArray) -> float:
    """Mean relative growth of the RMS errors; 0 where it may be chance.

    ``own`` and ``without``: (p, q) mean square errors of p pieces over q horizons, which count alike. The mean of the
    logarithm of the ratio is tested by Student's t, one-sided, over the pieces with a known error.
    """
    known = np.isfinite(own) & np.isfinite(without) & (own > 0.0) & (without > 0.0)
    count = known.sum(axis=1)
    logs = 0.5 * np.log(np.where(known, own, 1.0) / np.where(known, without, 1.0))
    growths = logs.sum(axis=1)[count > 0] / count[count > 0]
    if len(growths) < 2:
        return 0.0
    mean, error = float(growths.mean()), float(growths.std(ddof=1)) / math.sqrt(len(growths))
    least = t_quantile(1.0 - THRESHOLDS.held_out_growth_level, len(growths) - 1) * error
    return math.expm1(mean) if mean > least else 0.0


def horizon_errors(fitted: FitResult, folds: Sequence[Fold], pieces: Sequence[CvPiece]) -> FloatArray:
    """(q,) RMS position error over each of `HORIZONS`, each piece by the fit to the others; NaN without predictions."""
    squares, count = _horizon_squares(fitted, folds, pieces)
    return np.sqrt(_ratio(squares.sum(axis=0), count.sum(axis=0)))


def horizon_squares(fitted: FitResult, folds: Sequence[Fold], pieces: Sequence[CvPiece]) -> FloatArray:
    """(p, q) mean square position error of each piece over each of `HORIZONS`; NaN without predictions."""
    return _ratio(*_horizon_squares(fitted, folds, pieces))


def _horizon_squares(
    fitted: FitResult, folds: Sequence[Fold], pieces: Sequence[CvPiece]
) -> tuple[FloatArray, FloatArray]:
    """(p, q) sums of squared position errors of each piece, by the fit to the others, and their numbers."""
    data = MultiStepData.from_data(fitted.data, fitted.data.initial_model)
    piece, shape = _piece_index(data, pieces), (len(pieces), len(HORIZONS))
    squares, count, vehicle = np.zeros(shape), np.zeros(shape), fitted.data.vehicle
    assert vehicle is not None  # noqa: S101 - a diagnosis has one
    for fold in folds:
        model = fitted.objective.parametrization.model(fold.x)
        own = np.isin(piece, list(map(pieces.index, fold.pieces)))
        at = piece[own], data.horizon[own]
        errors = prediction_errors(data, model, states_at_starts(data, model, vehicle))
        np.add.at(squares, at, errors[own] ** 2)
        np.add.at(count, at, 1.0)
    return squares, count


def _ratio(total: FloatArray, count: FloatArray) -> FloatArray:
    return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan))


# Doublings of a short step in the transition matrix: longer backward steps overflow.
_DOUBLINGS = 12


def rate_floor(fitted: FitResult) -> float:
    """RMS rate error of a perfect model: rate that the disturbance drives, and filtered sensor noise."""
    torque, memory = fitted.disturbance
    return math.hypot(torque * fitted.model.rate_std_per_torque(fitted.data.rms_rate, memory), _rate_noise(fitted))


def position_floor(fitted: FitResult, seconds: float) -> float:
    """RMS position error (rad or m) of a perfect model ``seconds`` after a restart, by a fit of innovations."""
    initial = 2.0 * fitted.objective.position_noise(fitted.x) ** 2, _rate_noise(fitted) ** 2
    return position_std_after(fitted.model, fitted.data.rms_rate, fitted.disturbance, initial, seconds)


def _rate_noise(fitted: FitResult) -> float:
    """Standard deviation of the filtered sensor noise of the rate."""
    return float(np.median([run.rates.rate_noise for run in fitted.data.runs]))


def position_std_after(
    model: Model, rate: float, disturbance: tuple[float, float], initial: tuple[float, float], seconds: float
) -> float:
    """Standard deviation of the position in rad or m after ``seconds``, of the motion linearised at ``rate``.

    ``disturbance``: Standard deviation in N m and correlation time in s of the disturbance torque.
    ``initial``: Variances of position and rate at the start.
    """
    torque, memory = disturbance
    slope = 2.0 * model.quadratic_drag * rate + model.linear_drag
    motion = np.array([-model.stiffness, -slope, 1.0]) / model.inertia
    dynamics = np.array([[0.0, 1.0, 0.0], motion, [0.0, 0.0, -1.0 / memory]])
    driving = np.diag([0.0, 0.0, 2.0 * torque**2 / memory])
    return math.sqrt(max(float(_propagate(dynamics, driving, np.diag([*initial, torque**2]), seconds)[0, 0]), 0.0))


def _propagate(dynamics: FloatArray, driving: FloatArray, initial: FloatArray, seconds: float) -> FloatArray:
    """(k, k) covariance of a linear motion driven by white noise (Van Loan 1978)."""
    from scipy import linalg

    zero, count = np.zeros_like(dynamics), len(dynamics)
    step = linalg.expm(np.block([[-dynamics, driving], [zero, dynamics.T]]) * (seconds / 2**_DOUBLINGS))
    transition = step[count:, count:].T
    added = transition @ step[:count, count:]
    for _ in range(_DOUBLINGS):
        added = transition @ added @ transition.T + added
        transition = transition @ transition
    return np.asarray(transition @ initial @ transition.T + added)
