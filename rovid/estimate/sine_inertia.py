"""Sine runs: three readings of the inertia, one of them the founding paper's and biased."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rovid.core.array_types import FloatArray, IntArray
from rovid.core.errors import DataError
from rovid.model.model import Model
from rovid.signals.preprocessing import Run
from rovid.signals.segments import SineRun, find_sines
from rovid.trial.axis import Axis

HARMONICS = 9
_LEAST_GAIN = 0.25
_PHASES = 720
# The response to switching on has to die away before the motion repeats; simulated, after so many cycles it has.
_DROPPED_CYCLES = 1
_SETTLED = 20
# Runs whose scatter exceeds their own errors this much (variance) share no single inertia.
_BIRGE_LIMIT = 5.0


@dataclass(frozen=True, kw_only=True, eq=False)
class PeriodicMotion:
    """The periodic part of a sine run.

    ``torque`` (N m) and ``rate`` (rad/s) are complex amplitudes of the harmonics 0..K at multiples of
    ``frequency`` (rad/s): x(t) = Re sum x_k exp(i k w t). ``seconds`` is how much of the log they rest on.
    """

    frequency: float
    torque: NDArray[np.complex128]
    rate: NDArray[np.complex128]
    seconds: float

    @property
    def moves(self) -> bool:
        """Whether there is any acceleration in it."""
        return bool(self.acceleration().any())

    def acceleration(self) -> NDArray[np.complex128]:
        """Complex amplitudes of the acceleration in rad/s^2."""
        return np.asarray(1j * self.frequency * np.arange(len(self.rate)) * self.rate)

    def over_one_period(self, amplitudes: NDArray[np.complex128]) -> FloatArray:
        """The wave with these ``amplitudes`` at 720 phases of one period."""
        phase = 2.0 * np.pi * np.arange(_PHASES) / _PHASES
        harmonics = np.exp(1j * np.outer(phase, np.arange(len(amplitudes))))
        return np.asarray(np.real(harmonics @ amplitudes))


@dataclass(frozen=True, kw_only=True, eq=False)
class SineTrial:
    """One sine run with the periodic part of all its whole periods, and of all but each one."""

    source: str
    start: float
    stop: float
    period: float
    cycles: int
    motion: PeriodicMotion
    without: tuple[PeriodicMotion, ...]


@dataclass(frozen=True, kw_only=True)
class InertiaReading:
    """An inertia in kg m^2, its standard error (NaN where it cannot be given), per run and over all runs."""

    value: float
    standard_error: float
    runs: tuple[tuple[str, float, float], ...]
    consistent: bool | None = None


def sine_trials(runs: Sequence[Run]) -> list[SineTrial]:
    """Find the sine runs and take their harmonics."""
    trials = []
    for run in runs:
        for sine in find_sines(run.trial, run.torque):
            trial = _trial(run, sine)
            if trial is not None:
                trials.append(trial)
    return trials


def require_motion(trials: Sequence[SineTrial], axis: Axis) -> None:
    """Refuse sines under which the vehicle does not move: what has no acceleration has no inertia.

    Raises
    ------
    DataError
        There is one, or one that moves in a single period.
    """
    for trial in trials:
        if all(wave.moves for wave in (trial.motion, *trial.without)):
            continue
        raise DataError(
            f"the vehicle never {axis.motion_verb} under the sine-shaped {axis.force_name} of {trial.source}: its "
            f"{axis.rate_words} is zero in every period, or in all but one.",
            mend=f"Check that {axis.required_signals} in rovid.toml is the vehicle's, or leave that log out.",
        )


def _trial(run: Run, sine: SineRun) -> SineTrial | None:
    """The mean orbit of one sine run after its first periods; None where too little of it is whole."""
    first = sine.start + _DROPPED_CYCLES * sine.period
    cycles = sine.cycles - _DROPPED_CYCLES
    rates = run.rates
    rows = np.flatnonzero((rates.time >= first) & (rates.time < sine.stop) & run.valid)
    if cycles < 2 or len(rows) * rates.kernel.period < (cycles - 0.5) * sine.period:
        return None
    cycle = ((rates.time[rows] - first) / sine.period).astype(np.intp)
    without = [_wave(run, rows[cycle != k], sine.period) for k in range(cycles)]
    return SineTrial(
        source=run.trial.name,
        start=first,
        stop=sine.stop,
        period=sine.period,
        cycles=cycles,
        motion=_wave(run, rows, sine.period),
        without=tuple(without),
    )


def _wave(run: Run, rows: IntArray, period: float) -> PeriodicMotion:
    """Least squares of mean, drift and harmonics, freed of what the filter took from them.

    The orbit integral is exact for the whole wave: a share of a harmonic taken away, even from torque and rate alike,
    leaves some of the drag's work in it.
    """
    frequency = 2.0 * math.pi / period
    time = run.rates.time[rows] - run.rates.time[rows[0]]
    gain = run.rates.kernel.gain(np.arange(HARMONICS + 1) / period)
    # Harmonics beyond the filter carry noise alone.
    count = max(int(np.argmax(np.append(gain < _LEAST_GAIN, True))) - 1, 1)
    phase = frequency * np.outer(time, np.arange(1, count + 1))
    drift = time / max(float(time[-1]), 1e-9) - 0.5
    basis = np.column_stack((np.ones(len(rows)), drift, np.cos(phase), np.sin(phase)))
    both = np.column_stack((run.filtered_torque[rows], run.rates.rate[rows]))
    coefficients = np.linalg.lstsq(basis, both, rcond=None)[0]
    amplitudes = coefficients[2 : 2 + count] - 1j * coefficients[2 + count :]
    torque, rate = np.vstack((coefficients[:1], amplitudes)).T / gain[: count + 1]
    return PeriodicMotion(frequency=frequency, torque=torque, rate=rate, seconds=len(rows) * run.rates.kernel.period)


def orbit_integral(trials: Sequence[SineTrial]) -> InertiaReading:
    """I = sum(T rdot) / sum(rdot^2) over whole periods; exact for any memoryless drag.

    The drag's work on the acceleration, the loop integral of D(r) dr, is zero over a closed orbit. The sums
    run over the harmonics of the mean orbit, so that sensor noise and disturbance do not bias them.
    """
    return _combine(trials, lambda wave: _ratio(wave, wave.torque[1:], slice(1, None)))


def harmonic_balance(trials: Sequence[SineTrial], drag: Model | None) -> InertiaReading:
    """I = Im(T1 conj(R1)) / (w |R1|^2) at the fundamental.

    Where the ``drag`` is known the quadrature part of its fundamental, which the waveform's harmonics
    create (about 2 % of I), is taken off; without it that part stays in.
    """

    def fundamental(wave: PeriodicMotion) -> tuple[float, float]:
        torque = wave.torque[1:2]
        if drag is not None:
            torque = torque - _first_harmonic(drag.drag(wave.over_one_period(wave.rate)))
        return _ratio(wave, torque, slice(1, 2))

    return _combine(trials, fundamental)


def _ratio(wave: PeriodicMotion, torque: NDArray[np.complex128], harmonics: slice) -> tuple[float, float]:
    """Work of the torque on the acceleration, and the acceleration squared, of ``harmonics`` over the whole run."""
    acceleration = wave.acceleration()[harmonics]
    work = float(np.real(np.sum(torque * np.conj(acceleration))))
    weight = float(np.sum(np.abs(acceleration) ** 2))
    return work * wave.seconds, weight * wave.seconds


def _first_harmonic(series: FloatArray) -> complex:
    """Complex amplitude at the frequency of the period that ``series`` goes over."""
    phase = 2.0 * np.pi * np.arange(_PHASES) / _PHASES
    return complex(2.0 * np.mean(series * np.exp(-1j * phase)))


def _combine(trials: Sequence[SineTrial], reading: Callable[[PeriodicMotion], tuple[float, float]]) -> InertiaReading:
    """Ratio of sums over all runs.

    The error of a run's ratio goes as one over its denominator (amplitude squared times length); its size is
    pooled over all runs, from leaving out one period at a time. Where the runs still disagree by more than
    their errors the standard error is inflated by the Birge ratio.
    """
    whole = np.array([reading(trial.motion) for trial in trials])
    work, weight = whole.T
    values = work / weight
    scatter = [_jackknife(list(map(reading, trial.without))) for trial in trials]
    dof = np.array([trial.cycles - 1 for trial in trials])
    density = float(np.sum(np.square(scatter) * weight * dof) / dof.sum())
    errors = np.sqrt(density / weight)
    value, error = float(work.sum() / weight.sum()), math.sqrt(density / float(weight.sum()))
    consistent = None
    if len(trials) > 1:
        ratio = float(np.sum(((values - value) / errors) ** 2)) / (len(trials) - 1)
        consistent = ratio < _BIRGE_LIMIT
        error *= math.sqrt(max(ratio, 1.0))
    sources = [trial.source for trial in trials]
    runs = zip(sources, values.tolist(), errors.tolist(), strict=True)
    return InertiaReading(value=value, standard_error=error, runs=tuple(runs), consistent=consistent)


def _jackknife(readings: Sequence[tuple[float, float]]) -> float:
    """Standard error in kg m^2, from (work, weight) with one period after another left out."""
    ratios = np.array([work / weight for work, weight in readings])
    count = len(ratios)
    squares = float(np.sum((ratios - ratios.mean()) ** 2))
    return math.sqrt((count - 1) / count * squares)


def peak_method(trials: Sequence[SineTrial], drag: Model) -> InertiaReading:
    """The founding paper's reading: (peak torque - steady torque at the peak rate) / peak acceleration.

    Torque, rate and acceleration do not peak together (they are in quadrature), so that the result is
    biased, mostly low; see ``peak_bias``.
    """
    values = [peak_inertia(trial.motion, drag) for trial in trials]
    error = math.nan
    if len(values) > 1:
        error = float(np.std(values, ddof=1) / math.sqrt(len(values)))
    return InertiaReading(
        value=float(np.mean(values)),
        standard_error=error,
        runs=tuple((trial.source, value, math.nan) for trial, value in zip(trials, values, strict=True)),
    )


def peak_inertia(wave: PeriodicMotion, drag: Model) -> float:
    """The peak method on one wave, in kg m^2."""
    steady = float(drag.drag(np.array(_peak(wave, wave.rate))))
    return (_peak(wave, wave.torque) - steady) / _peak(wave, wave.acceleration())


def _peak(wave: PeriodicMotion, amplitudes: NDArray[np.complex128]) -> float:
    """Largest size of what has these complex ``amplitudes``, over one period."""
    return float(np.max(np.abs(wave.over_one_period(amplitudes))))


def peak_bias(trials: Sequence[SineTrial], model: Model) -> float:
    """What the peak method returns on this ``model``'s own motion under these torques, over its true inertia."""
    from rovid.model.kernels import simulate

    ratios = []
    for trial in trials:
        wave = trial.motion
        time = np.arange(_SETTLED * _PHASES + 1) * trial.period / _PHASES
        torque = np.tile(wave.over_one_period(wave.torque), _SETTLED)
        torque = np.append(torque, torque[0])
        rate, _ = simulate(time, torque, model.body, 0.0)
        spectrum = np.fft.rfft(rate[-_PHASES - 1 : -1])[: len(wave.rate)] / _PHASES
        spectrum[1:] *= 2.0
        steady = PeriodicMotion(frequency=wave.frequency, torque=wave.torque, rate=spectrum, seconds=wave.seconds)
        ratios.append(peak_inertia(steady, model) / model.inertia)
    return float(np.mean(ratios))
