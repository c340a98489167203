"""Inertia and damping from forced and free oscillations.

Of sine runs by three methods, of which the peak method of the founding paper is biased. Of free decays the period, the
damping ratios and the ratios to the inertia, as a roll-decay test reports them.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rovid.core.array_types import ComplexArray, FloatArray, IntArray
from rovid.core.errors import DataError
from rovid.core.stats import f_sf
from rovid.estimate.estimate import Estimate
from rovid.model.model import Model
from rovid.trial.axis import Axis
from rovid.trial.preprocessing import Run
from rovid.trial.segments import SineRun, find_sines
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle

HARMONICS = 9
# Least gain of the low pass at a harmonic that is fitted.
_LEAST_GAIN = 0.25
# Samples of a waveform over one period.
_PHASES = 720
# First cycles of a run that are dropped as transient, and simulated cycles until the motion is periodic.
_DROPPED_CYCLES, _SETTLED_CYCLES = 1, 20
# p-value of the variance between runs over that within (F test) below which the runs share no inertia; a decision.
_DISAGREE = 1e-3
# Samples in each period of a simulated swing, and number of simulated periods.
_SAMPLES, _PERIODS = 400, 2
# Difference step for error propagation, as a share of a parameter's standard error.
_STEP = 0.01


@dataclass(frozen=True, kw_only=True, eq=False)
class PeriodicMotion:
    """The periodic part of a sine run.

    ``torque`` (N m) and ``rate`` (rad/s) are complex amplitudes of the harmonics 0..K at multiples of
    ``frequency`` (rad/s): x(t) = Re sum x_k exp(i k w t). ``seconds`` is the length of the data behind them.
    """

    frequency: float
    torque: ComplexArray
    rate: ComplexArray
    seconds: float

    def acceleration(self) -> ComplexArray:
        """Complex amplitudes of the acceleration in rad/s^2."""
        return np.asarray(1j * self.frequency * np.arange(len(self.rate)) * self.rate)

    def over_one_period(self, amplitudes: ComplexArray) -> FloatArray:
        """The waveform with these ``amplitudes`` at 720 phases of one period."""
        phase = 2.0 * np.pi * np.arange(_PHASES) / _PHASES
        harmonics = np.exp(1j * np.outer(phase, np.arange(len(amplitudes))))
        return np.asarray(np.real(harmonics @ amplitudes))

    def peak(self, amplitudes: ComplexArray) -> float:
        """Largest magnitude of the waveform with these ``amplitudes``."""
        return float(np.max(np.abs(self.over_one_period(amplitudes))))


@dataclass(frozen=True, eq=False)
class SineTrial:
    """One sine run with the periodic motion of all its whole periods, and of all but each one."""

    source: str
    start: float
    stop: float
    period: float
    cycles: int
    motion: PeriodicMotion
    without: tuple[PeriodicMotion, ...]


@dataclass(frozen=True, kw_only=True)
class InertiaReading:
    """An inertia in kg m^2, its standard error (NaN where unknown), and (name, value, error) of each run.

    ``consistent`` is whether the runs share one inertia; None where there is one run only.
    """

    value: float
    standard_error: float
    runs: tuple[tuple[str, float, float], ...]
    consistent: bool | None = None


def sine_trials(runs: Sequence[Run]) -> list[SineTrial]:
    """Find the sine runs and fit their harmonics."""
    found = [_sine_trial(run, sine) for run in runs for sine in find_sines(run.trial, run.torque)]
    return list(filter(None, found))


def require_motion(trials: Sequence[SineTrial], axis: Axis) -> None:
    """Raise DataError for a sine without acceleration in all periods, or in all but one."""
    for trial in trials:
        if all(motion.acceleration().any() for motion in (trial.motion, *trial.without)):
            continue
        raise DataError(
            f"the vehicle never {axis.motion_verb} under the sine-shaped {axis.force_name} of {trial.source}: its "
            f"{axis.rate_words} is zero in every period, or in all but one.",
            mend=f"Check that {axis.required_signals} in rovid.toml is the vehicle's, or leave that log out.",
        )


def _sine_trial(run: Run, sine: SineRun) -> SineTrial | None:
    """Periodic motion of one sine run after its first cycle; None where too few samples are valid."""
    first = sine.start + _DROPPED_CYCLES * sine.period
    cycles = sine.cycles - _DROPPED_CYCLES
    rates = run.rates
    # A margin of half a sample: rounding decides nothing.
    begin, end = first - 0.5 * rates.kernel.period, sine.stop - 0.5 * rates.kernel.period
    rows = np.flatnonzero((rates.time >= begin) & (rates.time < end) & run.valid)
    if cycles < 2 or len(rows) * rates.kernel.period < (cycles - 0.5) * sine.period:
        return None
    cycle = ((rates.time[rows] - first) / sine.period).astype(np.intp)
    without = [_fit_harmonics(run, rows[cycle != k], sine.period) for k in range(cycles)]
    motion = _fit_harmonics(run, rows, sine.period)
    return SineTrial(run.trial.name, first, sine.stop, sine.period, cycles, motion, tuple(without))


def _fit_harmonics(run: Run, rows: IntArray, period: float) -> PeriodicMotion:
    """Least squares of mean, drift and harmonics, divided by the gain of the low pass.

    The orbit integral is exact only for the whole waveform. Attenuated harmonics, even of torque and rate alike, leave
    a part of the drag's work.
    """
    frequency = 2.0 * math.pi / period
    time = run.rates.time[rows] - run.rates.time[rows[0]]
    gain = run.rates.kernel.gain(np.arange(HARMONICS + 1) / period)
    # Harmonics beyond the cut-off carry only noise.
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
    """I = sum(T rdot) / sum(rdot^2) over whole periods; exact for any memoryless drag. docs/method.md, (8).

    The drag's work on the acceleration, the loop integral of D(r) dr, is zero over a closed orbit. The sums
    run over the harmonics of the mean orbit, which sensor noise and disturbance bias little.
    """
    return _combine(trials, lambda motion: _work_and_weight(motion, motion.torque[1:], slice(1, None)))


def harmonic_balance(trials: Sequence[SineTrial], drag: Model | None) -> InertiaReading:
    """I = Im(T1 conj(R1)) / (w |R1|^2) at the fundamental; docs/method.md, (9).

    The harmonics of the waveform give the drag's fundamental a quadrature part of about 2 % of I. It is subtracted
    where the ``drag`` is known.
    """
    phase = 2.0 * np.pi * np.arange(_PHASES) / _PHASES

    def fundamental(motion: PeriodicMotion) -> tuple[float, float]:
        torque = motion.torque[1:2]
        if drag is not None:
            series = drag.drag(motion.over_one_period(motion.rate))
            torque = torque - complex(2.0 * np.mean(series * np.exp(-1j * phase)))
        return _work_and_weight(motion, torque, slice(1, 2))

    return _combine(trials, fundamental)


def _work_and_weight(motion: PeriodicMotion, torque: ComplexArray, harmonics: slice) -> tuple[float, float]:
    """Work of the torque on the acceleration, and the squared acceleration, of ``harmonics`` over the whole run."""
    acceleration = motion.acceleration()[harmonics]
    work = float(np.real(np.sum(torque * np.conj(acceleration))))
    return work * motion.seconds, float(np.sum(np.abs(acceleration) ** 2)) * motion.seconds


def _combine(trials: Sequence[SineTrial], measure: Callable[[PeriodicMotion], tuple[float, float]]) -> InertiaReading:
    """Ratio of the sums over all runs of the (work, weight) that ``measure`` gives.

    The variance of a run's ratio is inversely proportional to its weight (amplitude squared times length). Its size is
    pooled over all runs, by a jackknife over periods. Where the runs disagree by more than their errors, the standard
    error is inflated by the Birge ratio.
    """
    work, weight = np.array([measure(trial.motion) for trial in trials]).T
    values = work / weight
    scatter = []  # kg m^2, standard error of each run by the jackknife
    for trial in trials:
        ratios = np.array([part / whole for part, whole in map(measure, trial.without)])
        squares = float(np.sum((ratios - ratios.mean()) ** 2))
        scatter.append(math.sqrt((len(ratios) - 1) / len(ratios) * squares))
    dof = np.array([trial.cycles - 1 for trial in trials])
    density = float(np.sum(np.square(scatter) * weight * dof) / dof.sum())
    errors = np.sqrt(density / weight)
    value, error = float(work.sum() / weight.sum()), math.sqrt(density / float(weight.sum()))
    consistent = None
    if len(trials) > 1:
        ratio = float(np.sum(((values - value) / errors) ** 2)) / (len(trials) - 1)
        consistent = f_sf(len(trials) - 1, float(dof.sum()), ratio) > _DISAGREE
        error *= math.sqrt(max(ratio, 1.0))
    runs = zip([trial.source for trial in trials], values.tolist(), errors.tolist(), strict=True)
    return InertiaReading(value=value, standard_error=error, runs=tuple(runs), consistent=consistent)


def peak_method(trials: Sequence[SineTrial], drag: Model) -> InertiaReading:
    """The founding paper's method: (peak torque - steady torque at the peak rate) / peak acceleration.

    Torque, rate and acceleration do not peak together (rate and acceleration are in quadrature), so the result is
    biased, mostly low; see ``peak_bias``.
    """
    values = [peak_inertia(trial.motion, drag) for trial in trials]
    error = float(np.std(values, ddof=1) / math.sqrt(len(values))) if len(values) > 1 else math.nan
    runs = tuple((trial.source, value, math.nan) for trial, value in zip(trials, values, strict=True))
    return InertiaReading(value=float(np.mean(values)), standard_error=error, runs=runs)


def peak_inertia(motion: PeriodicMotion, drag: Model) -> float:
    """The peak method on one periodic motion, in kg m^2."""
    steady = float(drag.drag(np.array(motion.peak(motion.rate))))
    return (motion.peak(motion.torque) - steady) / motion.peak(motion.acceleration())


def peak_bias(trials: Sequence[SineTrial], model: Model) -> float:
    """Ratio of the peak method's result on this ``model``'s own motion under these torques to its true inertia."""
    from rovid.model.kernels import simulate

    ratios = []
    for trial in trials:
        motion = trial.motion
        time = np.arange(_SETTLED_CYCLES * _PHASES + 1) * trial.period / _PHASES
        torque = np.tile(motion.over_one_period(motion.torque), _SETTLED_CYCLES)
        torque = np.append(torque, torque[0])
        rate, _ = simulate(time, torque, model.body, 0.0)
        spectrum = np.fft.rfft(rate[-_PHASES - 1 : -1])[: len(motion.rate)] / _PHASES
        spectrum[1:] *= 2.0
        ratios.append(peak_inertia(replace(motion, rate=spectrum), model) / model.inertia)
    return float(np.mean(ratios))


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A number with its standard error and unit."""

    value: float
    standard_error: float
    unit: str


@dataclass(frozen=True, kw_only=True)
class FreeSwing:
    """One full swing that begins at rest at ``amplitude`` rad from the level."""

    name: str  #: The trial with this as its largest swing; empty for the RMS swing of all trials.
    amplitude: float
    natural_period: Quantity  #: Undamped natural period, s.
    damping_ratio: Quantity  #: Of the linear system with the same decrement.


@dataclass(frozen=True, kw_only=True)
class FreeDecay:
    """Results of a free-decay test."""

    rms_swing: FreeSwing  #: The swing with the amplitude of the RMS tilt.
    swings: tuple[FreeSwing, ...]  #: The largest swing of each trial, at the speeds of that trial.
    natural_frequency: Quantity  #: rad/s, of ``rms_swing``.
    #: Damping ratio by the linear drag alone, and the addition by the quadratic drag per rad of amplitude.
    terms: Mapping[str, Quantity]
    over_inertia: Mapping[str, Quantity]  #: Restoring stiffness, linear and quadratic drag over the inertia.


def analyse_free_decay(model: Model, estimate: Estimate, runs: Sequence[Run], vehicle: Vehicle) -> FreeDecay:
    """Free-decay results of ``model``, with the ``estimate`` of its parameters, at the amplitudes of ``runs``."""
    level = model.restoring_values[1]
    tilts = [run.trial.position[run.trial.measured] - level for run in runs]
    rms_amplitude = math.sqrt(2.0 * float(np.mean(np.concatenate(tilts) ** 2)))

    values, errors = model.values, np.sqrt(np.diag(estimate.covariance))

    def quantity(formula: Callable[[Model], float], unit: str) -> Quantity:
        # First-order propagation of the estimate's covariance.
        value, slopes = formula(model), np.zeros(len(values))
        for at in np.flatnonzero(errors > 0.0):
            step = np.where(np.arange(len(values)) == at, _STEP * errors, 0.0)
            slopes[at] = (formula(Model.from_values(values + step, model.axis, model.effects)) - value) / step[at]
        error = math.sqrt(float(slopes @ estimate.covariance @ slopes))
        return Quantity(value=value, standard_error=error, unit=unit)

    def swing(name: str, amplitude: float, reference: Mapping[str, float]) -> FreeSwing:
        def simulate(changed: Model) -> tuple[float, float]:
            return _period_and_damping(changed, vehicle, amplitude, reference)

        period, damping = quantity(lambda m: simulate(m)[0], "s"), quantity(lambda m: simulate(m)[1], "1")
        return FreeSwing(name=name, amplitude=amplitude, natural_period=period, damping_ratio=damping)

    rms_swing = swing("", rms_amplitude, runs[0].trial.reference)
    period = rms_swing.natural_period
    frequency = 2.0 * math.pi / period.value
    error = period.standard_error / period.value * frequency
    swings = []
    for run, tilt in zip(runs, tilts, strict=True):
        known = {name: values[np.isfinite(values)] for name, values in run.trial.extras.items()}
        medians = {name: float(np.median(values)) for name, values in known.items() if values.size}
        swings.append(swing(run.trial.name, float(np.max(np.abs(tilt))), medians))
    return FreeDecay(
        rms_swing=rms_swing,
        swings=tuple(swings),
        natural_frequency=Quantity(value=frequency, standard_error=error, unit="rad/s"),
        terms={
            "linear": quantity(lambda m: m.linear_drag / (2.0 * math.sqrt(m.stiffness * m.inertia)), "1"),
            # 8/(3 pi) of frequency times amplitude is the equivalent linear drag in a sine.
            "quadratic": quantity(lambda m: 4.0 / (3.0 * math.pi) * m.quadratic_drag / m.inertia, "1/rad"),
        },
        over_inertia={
            "restoring_stiffness": quantity(lambda m: m.stiffness / m.inertia, "1/s^2"),
            "linear_drag": quantity(lambda m: m.linear_drag / m.inertia, "1/s"),
            "quadratic_drag": quantity(lambda m: m.quadratic_drag / m.inertia, "1/rad"),
        },
    )


def _period_and_damping(
    model: Model, vehicle: Vehicle, amplitude: float, reference: Mapping[str, float]
) -> tuple[float, float]:
    """Natural period in s and damping ratio of a swing from ``amplitude``; NaN where the vehicle does not return."""
    time = np.linspace(0.0, _PERIODS * 2.0 * math.pi / model.natural_frequency, _PERIODS * _SAMPLES + 1)
    still = Trial.from_commands(time, np.zeros((len(time), len(vehicle.thrusters))), reference=reference)
    level = model.restoring_values[1]
    trial = replace(still, axis=model.axis, position=np.full(len(time), level + amplitude))
    rate, tilt = model.simulate(trial, model.torque_input(vehicle, trial))
    turns = np.flatnonzero((rate[:-1] > 0.0) & (rate[1:] <= 0.0))
    if not turns.size:
        return math.nan, math.nan
    # The rate is interpolated linearly to its zero.
    k = turns[0]
    share = rate[k] / (rate[k] - rate[k + 1])
    next_peak = float(tilt[k] + share * (tilt[k + 1] - tilt[k])) - level
    decrement = math.log(amplitude / next_peak)
    damping = decrement / math.hypot(2.0 * math.pi, decrement)
    period = float(time[k] + share * (time[k + 1] - time[k]))
    return period * math.sqrt(1.0 - damping**2), damping
