"""Test for waves: a narrow-band disturbance against a broad one, by one-step predictions, which know the phase."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.diagnose.candidate_fits import bic_score, fit_coarse, fit_in_parallel, is_plausible
from rovid.diagnose.cross_validation import CvPiece, cross_validate, held_out_log_likelihood
from rovid.diagnose.evidence import posterior_probability, probability_not_a_stand_in
from rovid.diagnose.formulas.regression import series_effect
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects import Effect
from rovid.effects.wave_torque import SEA_DAMPING
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fit_result import FitResult
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.estimate.objective import UNLIMITED, NegativeLogLikelihood
from rovid.estimate.parametrization import COMMON, DISTURBANCE, MEMORY
from rovid.faults.log_regressors import first_order, held_torque
from rovid.trial.axis import YAW

# Time constants in sampling intervals of a filter that an INS may have. Largest number of readings in the test for such
# a filter, which takes whole runs: the test stays fast.
_FILTERS = 2.0 ** np.arange(-1.0, 5.0)
_MAX_READINGS = 10_000
# Harmonics of the heading in the power of waves. Their moment goes with the sine of once or twice the angle to them.
_HARMONICS = (1.0, 2.0, 4.0)
# Gain of log-likelihood beyond that by chance, from which the power of the waves depends on a signal (p about 0.002).
_LEAST_GAIN = 4.8


@dataclass(frozen=True, eq=False)
class WaveTest:
    """One-step fits without and with waves, and the gain of the waves in nats."""

    plain: FitResult
    pieces: Sequence[CvPiece]
    fitted: FitResult | None = None  # with waves; None where waves gain nothing
    gain: float = 0.0
    bic_gain: float = 0.0

    @cached_property
    def held_out_gain(self) -> float:
        """Log-likelihood gain of the waves on pieces that were not fitted, in nats."""
        if self.fitted is None:
            return 0.0
        folds = [cross_validate(fitted, self.pieces) for fitted in (self.fitted, self.plain)]
        return held_out_log_likelihood(folds[0]) - held_out_log_likelihood(folds[1])

    @cached_property
    def probability(self) -> float:
        """Probability that the waves exist."""
        if self.fitted is None:
            return 0.0
        name = self.fitted.effects[-1].id
        probability = posterior_probability({name: self.bic_gain}, (name,), 1)
        # Cross-validation is slow and can only lower the probability.
        if probability < THRESHOLDS.possible:
            return probability
        gain = min(self.bic_gain, self.held_out_gain)
        cap = probability_not_a_stand_in(self.held_out_gain, self.bic_gain, white=True)
        return min(posterior_probability({name: gain}, (name,), 1, cap=cap), self._probability_of_a_sea)

    @cached_property
    def _probability_of_a_sea(self) -> float:
        """Probability that the hump in the spectrum has the power and the band of waves.

        Any hump in the spectrum of a torque fits a second-order filter: flow separation, for instance, or the noise of
        a stalled propeller. Thrust and motion change the power of those, and only the heading that of waves. Where the
        heading does, the result is the two-sided p value of a band no wider than that of a sea; 1 for a narrower one. A
        vehicle that turns at a rate r meets waves of the frequency w at w - r and w + r, which widens their band by
        r/w. Without such evidence only a band that is certainly as narrow as that of a sea is that of waves.
        """
        fitted = self.fitted
        if fitted is None:
            return 0.0
        power = power_of_waves(fitted)
        if power.beside >= _LEAST_GAIN and power.drive > power.heading:
            return 0.0
        at = fitted.model.names.index(f"{fitted.effects[-1].key}.damping")
        error = math.sqrt(float(fitted.covariance(sandwich=not fitted.is_white)[at, at]))
        _, frequency, damping = fitted.model.wave_parameters.tolist()
        if power.heading < _LEAST_GAIN:
            return 0.5 * math.erfc((damping - SEA_DAMPING) / error / math.sqrt(2.0))
        excess = damping - math.hypot(SEA_DAMPING, fitted.data.scales.rate / frequency)
        return math.erfc(excess / error / math.sqrt(2.0)) if excess > 0.0 else 1.0

    @property
    def is_broad(self) -> bool:
        """Whether a hump in the spectrum of the disturbance is certain, and its band or its power not that of waves."""
        return self.bic_gain > THRESHOLDS.bic_margin and self._probability_of_a_sea < THRESHOLDS.likely

    @property
    def likelier(self) -> FitResult:
        """The model with waves where these have a BIC gain, else the model without."""
        if self.fitted is None or self.bic_gain <= 0.0:
            return self.plain
        return self.fitted

    @property
    def established(self) -> FitResult | None:
        """The model with waves; None where waves are not established."""
        return self.fitted if self.probability >= THRESHOLDS.established else None

    @property
    def imitated(self) -> tuple[str, ...]:
        """Ids of causes that the established waves imitate."""
        return () if self.established is None else self.established.effects[-1].rivals


def run_wave_test(data: InnovationData, beside: FitResult, wave: Effect | None, pieces: Sequence[CvPiece]) -> WaveTest:
    """Test for the effect ``wave`` next to the effects of the model ``beside``; the disturbance has no limit."""
    plain = _fit_without_waves(data, beside)
    if wave is None:
        return WaveTest(plain, pieces)
    with_waves = _fit_with_waves(plain, wave)
    bic_gain = bic_score(with_waves) - bic_score(plain)
    is_possible = is_plausible(with_waves) and bic_gain > 0.0 and not _is_sensor_filter(data, plain, with_waves)
    if not is_possible or _in_one_run(with_waves) or _follows_thrust(plain, with_waves):
        return WaveTest(plain, pieces)
    if not with_waves.is_white:
        # Coloured innovations overstate the gain: its scatter over time limits it.
        difference = plain.objective.contributions(plain.x) - with_waves.objective.contributions(with_waves.x)
        # Gains less than a time constant apart concern the same motion.
        block = data.blocks_of(data.usual_time)
        gains: FloatArray = np.bincount(block, weights=difference).astype(np.float64)
        bic_gain = min(bic_gain, supported_gain(gains[np.bincount(block) > 0]))
    return WaveTest(plain, pieces, with_waves, plain.value - with_waves.value, bic_gain)


def _in_one_run(fitted: FitResult) -> bool:
    """Whether the other runs are no likelier with the waves that one run shows, as with a harmonic of its commands."""
    calm = fitted.x.copy()
    calm[len(calm) - len(fitted.effects[-1].parameters)] = 0.0
    gains = fitted.objective.contributions(calm) - fitted.objective.contributions(fitted.x)
    by_run = np.bincount(fitted.data.run_index, weights=gains)
    return len(by_run) > 1 and bool(by_run.sum() <= by_run.max())


def _follows_thrust(plain: FitResult, with_waves: FitResult) -> bool:
    """Whether an oscillation in the band of the waves that the known thrust excites explains the readings better.

    Waves have no phase relation to the thrust. Under feedback the thrust follows them, but it then knows of them only
    what the filter knows too. A swinging mast of the compass, a tether, or water in the hull do follow it.
    """
    _, frequency, damping = with_waves.model.wave_parameters.tolist()
    swings = {}
    for run in plain.data.runs:
        time = run.rates.time
        ringing = np.exp((1j - damping) * frequency * (time - time[0]))
        torque, response = np.fft.fft((held_torque(run), ringing), 2 * len(time))
        swings[run.trial.name] = np.interp(run.trial.time, time, np.fft.ifft(torque * response)[: len(time)])
    effects = [
        series_effect(f"swing {part.__name__}", {name: part(swing) for name, swing in swings.items()})
        for part in (np.real, np.imag)
    ]
    objective = plain.objective.with_effects((*plain.effects, *effects))
    start = np.concatenate((plain.x, objective.parametrization.initial()[len(plain.x) :]))
    return bic_score(fit_coarse(objective, start, THRESHOLDS.close_iterations)) > bic_score(with_waves)


def _fit_without_waves(data: InnovationData, beside: FitResult) -> FitResult:
    objective = InnovationLikelihood(data, UNLIMITED, beside.effects)
    begin = objective.parametrization.initial()
    other = np.r_[0:DISTURBANCE, COMMON : len(begin)]
    begin[other] = beside.x[other]
    # An unlimited disturbance has several local optima: the fit starts from the most likely of a grid.
    starts = []
    for share, time in itertools.product(THRESHOLDS.wave_disturbance_shares, THRESHOLDS.wave_disturbance_times):
        start = begin.copy()
        start[DISTURBANCE] = math.log(share * data.rms_torque)
        start[MEMORY] = math.log(time * data.usual_time)
        starts.append(np.clip(start, *objective.parametrization.bounds))
    (best,) = objective.most_likely(starts, 1)
    return fit_coarse(objective, best, THRESHOLDS.close_iterations)


def _fit_with_waves(plain: FitResult, wave: Effect) -> FitResult:
    objective: NegativeLogLikelihood = plain.objective.with_effects((*plain.effects, wave))
    starts = [np.concatenate((plain.x, start)) for start in objective.parametrization.initial_values()]
    begun = objective.most_likely(starts, THRESHOLDS.wave_starts)

    def first_steps(at: int) -> FitResult:
        return fit_coarse(objective, begun[at], THRESHOLDS.wave_first_iterations)

    best = min(fit_in_parallel([objective] * len(begun), first_steps), key=lambda fitted: fitted.value)
    return fit_coarse(objective, best.x, THRESHOLDS.close_iterations)


def _is_sensor_filter(data: InnovationData, plain: FitResult, with_waves: FitResult) -> bool:
    """Whether a first-order filter of the heading, by an INS, explains all readings better than waves.

    Such a filter colours the noise of the sensor, which the likelihood takes as white. Its inverse is exact where no
    reading is left out, and there the density of the readings y is that of the inverse x over the product of a_k in
    y_k = y_{k-1} + a_k (x_k - y_{k-1}).
    """
    counts = np.array([int(run.trial.measured.sum()) for run in data.runs])
    order = np.argsort(counts)
    runs = [data.runs[at] for at in order[np.cumsum(counts[order]) <= _MAX_READINGS]]
    if not runs or data.rate_only:
        return False
    every = replace(data, runs=runs, interval=0.0)
    waves: NegativeLogLikelihood = InnovationLikelihood(every, UNLIMITED, with_waves.effects)
    best = fit_coarse(waves, with_waves.x, THRESHOLDS.close_iterations).value
    interval = float(np.median([run.trial.sampling_interval for run in runs]))
    for time_constant in interval * _FILTERS:
        # The position before the filter, and the sum of ln a_k of the readings.
        before, offset = [], 0.0
        for run in runs:
            used, position = np.flatnonzero(run.trial.measured), run.trial.position.copy()
            share = -np.expm1(-np.diff(run.trial.time[used]) / time_constant)
            position[used[1:]] += (1.0 / share - 1.0) * np.diff(position[used])
            before.append(replace(run, trial=replace(run.trial, position=position)))
            offset += float(np.log(share).sum())
        if _fit_without_waves(replace(every, runs=before), plain).value + offset < best:
            return True
    return False


class PowerOfWaves(NamedTuple):
    """Gains of log-likelihood, beyond those by chance, by a power of the waves that depends on a signal."""

    heading: float
    drive: float  #: On the size of the thrust or of the rate, whichever gains more.
    beside: float  #: The same next to the heading.


def power_of_waves(fitted: FitResult) -> PowerOfWaves:
    """Score tests of a model with waves for a power that depends on the heading, the thrust or the rate."""
    signals, count = _power_signals(fitted), len(fitted.x)
    amplitude = count - len(fitted.effects[-1].parameters)
    information, rows = np.zeros(()), []
    for piece in fitted.objective.jacobian(fitted.x):
        here = np.tile(signals[piece.rows], (2, 1))
        # A turn widens the band of waves: that explains a part of their power away from the frequency.
        widened, modulated = piece.matrix[:, [-1]] * here[:, [1]], piece.matrix[:, [amplitude]] * here
        joined = replace(piece, matrix=np.hstack((piece.matrix, widened, modulated)))
        information = information + joined.information
        rows.append(joined.scores)
    block = fitted.data.block_index
    sums = [np.bincount(block, weights=column) for column in np.concatenate(rows).T]
    scores = np.column_stack(sums)[np.bincount(block) > 0]

    def gain(tested: Sequence[int], known: Sequence[int]) -> float:
        moved = np.linalg.pinv(information[np.ix_(known, known)], rcond=1e-10, hermitian=True)
        left = scores[:, tested] - scores[:, known] @ (moved @ information[np.ix_(known, tested)])
        total = left.sum(axis=0)
        rest = left - total / len(left)
        # The scatter of the scores over time is their variance: coloured innovations count less.
        square = float(total @ np.linalg.pinv(rest.T @ rest, rcond=1e-8, hermitian=True) @ total)
        return 0.5 * (len(left) * math.log1p(square / len(left)) - len(tested))

    own, headings = range(count + 1), range(count + 3, count + 1 + signals.shape[1])
    drives = range(count + 1, count + 3)
    return PowerOfWaves(
        heading=gain(headings, own) if headings else 0.0,
        drive=max(gain([one], own) for one in drives),
        beside=max(gain([one], [*own, *headings]) for one in drives),
    )


def _power_signals(fitted: FitResult) -> FloatArray:
    """(N, q) size of the thrust and of the rate, and harmonics of the heading, over the memory of the waves."""
    _, frequency, damping = fitted.model.wave_parameters.tolist()
    memory = 0.5 / (damping * frequency)
    columns = []
    for run, (instants, _) in zip(fitted.data.runs, fitted.data.innovation_spans, strict=True):
        rates = run.rates
        signals = [np.abs(held_torque(run)), np.abs(np.nan_to_num(rates.rate))]
        if fitted.data.axis is YAW:
            heading = np.nan_to_num(rates.position)
            signals += [function(k * heading) for k in _HARMONICS for function in (np.cos, np.sin)]
        period = float(rates.time[1] - rates.time[0])
        past = [first_order(signal, memory, period) for signal in signals]
        columns.append(np.column_stack([np.interp(instants, rates.time, each) for each in past]))
    every = np.concatenate(columns)
    return np.asarray((every - every.mean(axis=0)) / np.maximum(every.std(axis=0), 1e-12))


def supported_gain(gains: FloatArray) -> float:
    """Gain in nats that the scatter of the (n,) ``gains`` of successive blocks of time supports (Vuong 1989).

    The variance of the sum includes the autocorrelation between blocks, by Bartlett's weights with the bandwidth of
    Andrews (1991). Its degrees of freedom are 1.5 times the blocks over the bandwidth. Negative autocorrelation does
    not count: it would make the sum more certain than independent blocks do.
    """
    count = len(gains)
    if count < 2:
        return 0.0
    rest = gains - gains.mean()
    square = max(float(rest @ rest), 1e-300)
    first = max(float(rest[1:] @ rest[:-1]) / square, 0.0)
    bandwidth = max(1.1447 * (4.0 * (first / (1.0 - first**2)) ** 2 * count) ** (1.0 / 3.0), 1.0)
    lags = range(1, min(math.ceil(bandwidth), count))
    both = 2.0 * sum((1.0 - lag / bandwidth) * float(rest[lag:] @ rest[:-lag]) for lag in lags)
    freedom = max(min(1.5 * count / bandwidth, count) - 1.0, 1.0)
    variance = (square + max(both, 0.0)) * count / (count - 1)
    away = float(gains.sum()) / math.sqrt(variance)
    # Student's distribution, because the scatter comes from the gains themselves.
    return math.copysign(0.5 * (freedom + 1.0) * math.log1p(away**2 / (freedom + 1.0)), away)
