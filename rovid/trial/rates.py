"""Rate and acceleration from the measured position, through one zero-phase low pass."""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from rovid.core.array_types import ComplexArray, FloatArray, IntArray
from rovid.core.errors import DataError
from rovid.trial.trial import Trial

# Least R² between a logged rate and the position's derivative at which the regression is on the logged rate. Below it,
# one of the two is another quantity, whose ratio would be large by chance. A convention.
_RELATED = 0.25
# Convolution and spectrum are implemented below because importing scipy.signal or scipy.fft takes longer than they do.
# Half width of the kernel in units of 1/cutoff. A sinc under a Hann window of this width is flat to a third of the
# cut-off and 44 dB down beyond twice the cut-off.
_HALF_WIDTH = 1.25
# Highest cut-off, as a share of the sampling rate. Up to it the central differences are accurate to one percent.
_MAX_CUTOFF = 0.2
# Central differences of eighth order (Fornberg 1988), reversed for convolution.
_FIRST = np.array([-1 / 280, 4 / 105, -1 / 5, 4 / 5, 0.0, -4 / 5, 1 / 5, -4 / 105, 1 / 280])
_SECOND = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])
# Gaps of up to this many samples are interpolated. Longer gaps stay NaN.
_BRIDGE_SAMPLES = 5.5
# Minimum length of an unbroken series of second differences for the noise spectrum.
_MIN_SPECTRUM_SAMPLES = 32
# Samples of one piece of the noise spectrum.
_SPECTRUM_LENGTH = 512


@dataclass(frozen=True, kw_only=True, eq=False)
class ZeroPhaseFilter:
    """Convolution kernels for a value, its first and its second derivative on a grid of ``period`` s.

    The derivatives are those of the low-passed value, and all three kernels have the same length. ``cutoff`` is the
    -6 dB frequency in Hz.
    """

    period: float
    cutoff: float
    value: FloatArray
    first: FloatArray
    second: FloatArray

    @classmethod
    def design(cls, *, period: float, cutoff: float) -> Self:
        """Kernels for a grid of ``period`` s and a ``cutoff`` in Hz."""
        half = max(math.ceil(_HALF_WIDTH / cutoff / period), 3)
        t = np.arange(-half, half + 1) * period
        window = 1.0 + np.cos(np.pi * t / ((half + 1) * period))
        taps = np.sinc(2.0 * cutoff * t) * window
        taps /= taps.sum()
        first, second = np.convolve(taps, _FIRST) / period, np.convolve(taps, _SECOND) / period**2
        return cls(period=period, cutoff=cutoff, value=np.pad(taps, len(_FIRST) // 2), first=first, second=second)

    @property
    def half_width(self) -> float:
        """Half length of the kernel in s; the output is NaN this close to an end or a gap."""
        return float(len(self.value) // 2 * self.period)

    def smooth(self, values: FloatArray) -> FloatArray:
        """(n,) low-passed ``values``; NaN within half a kernel of a NaN or an end."""
        return _convolve(values, self.value)

    def rate(self, values: FloatArray) -> FloatArray:
        """(n,) first derivative per second of the low-passed ``values``."""
        return _convolve(values, self.first)

    def acceleration(self, values: FloatArray) -> FloatArray:
        """(n,) second derivative per second squared of the low-passed ``values``."""
        return _convolve(values, self.second)

    def gain(self, frequency: FloatArray) -> FloatArray:
        """Gain of the low pass at each ``frequency`` in Hz."""
        instants = self.period * (np.arange(len(self.value)) - len(self.value) // 2)
        phase = 2.0 * np.pi * np.outer(frequency, instants)
        return np.asarray(np.cos(phase) @ self.value)

    def noise(self, position_noise: float) -> tuple[float, float]:
        """Standard deviations of rate and acceleration that white ``position_noise`` causes."""
        rate, acceleration = (position_noise * np.linalg.norm([self.first, self.second], axis=1)).tolist()
        return rate, acceleration


@dataclass(frozen=True, kw_only=True, eq=False)
class Rates:
    """Position, rate and acceleration of a trial on a uniform grid, all through the same zero-phase low pass."""

    time: FloatArray  #: (m,) s on the trial's clock.
    #: ``rate``, ``acceleration``: (m,) body rate along the axis in rad/s or m/s, and its derivative; NaN within half a
    #: kernel of a gap or an end.
    rate: FloatArray
    acceleration: FloatArray
    position: FloatArray  #: (m,) low-passed position along the body's axis, rad or m.
    kernel: ZeroPhaseFilter  #: The filter.
    #: ``position_noise``, ``rate_noise``, ``acceleration_noise``: standard deviations of the white sensor noise: of the
    #: measured position (of the rate where only the rate was measured), and of the filtered rate and acceleration.
    position_noise: float
    rate_noise: float
    acceleration_noise: float
    from_gyro: bool  #: Whether ``rate`` comes from a logged rate instead of the position's derivative.
    #: ``gyro_gain``, ``gyro_offset``: slope and intercept of the logged rate against the position's derivative; NaN
    #: where no rate is logged.
    gyro_gain: float = math.nan
    gyro_offset: float = math.nan

    @property
    def valid(self) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """(m,) where rate and acceleration are known."""
        return np.isfinite(self.rate) & np.isfinite(self.acceleration)

    def filter_held(self, trial: Trial, values: FloatArray) -> FloatArray:
        """(m,) a held signal of the trial, such as torque, through the same filter."""
        averages = cell_averages(trial.time, values, self.time)
        # The three points undo the averaging to fourth order, 1/sinc(f h) = 1 + (pi f h)^2/6.
        correction = np.array([-1.0, 26.0, -1.0]) / 24.0
        return _convolve(averages, np.convolve(self.kernel.value, correction, mode="same"))

    def smooth_samples(self, trial: Trial, values: FloatArray) -> FloatArray:
        """(m,) a continuous signal given at the trial's instants, such as a simulated rate, through the same filter."""
        return self.kernel.smooth(np.interp(self.time, trial.time, values))


def compute_rates(trial: Trial, *, cutoff: float) -> Rates:
    """Rate and acceleration of one trial along its axis, with a low pass of ``cutoff`` Hz (-6 dB).

    In yaw with logged roll and pitch, the rates are the body's, see ``Trial.body_position``. Raises DataError if the
    trial is shorter than the filter.
    """
    grid = uniform_grid(trial)
    kernel = ZeroPhaseFilter.design(period=float(grid[1] - grid[0]), cutoff=cutoff)
    if len(grid) < len(kernel.value) + 2:
        text = f"lasts {trial.duration:.1f} s, shorter than the filter, which takes "
        text += f"{2 * kernel.half_width:.1f} s at a cut-off of {cutoff:.3g} Hz."
        raise DataError(text, where=trial.name, mend="Raise --cutoff or leave the log out.")
    angle = resample(trial, trial.body_position, grid)
    noise = white_noise(angle)
    rate, acceleration = kernel.rate(angle), kernel.acceleration(angle)
    rate_noise, acceleration_noise = kernel.noise(noise)
    gyro_gain = gyro_offset = math.nan
    if trial.rate is not None:
        gyro = resample(trial, trial.rate, grid)
        gyro_rate, gyro_acceleration = kernel.smooth(gyro), kernel.rate(gyro)
        gyro_noise = white_noise(gyro)
        filtered_noise = np.linalg.norm([kernel.value, kernel.first], axis=1) * gyro_noise
        gyro_gain, gyro_offset = _gain_and_offset(gyro_rate, rate, float(filtered_noise[0]))
        # In gaps of the gyro, the position's derivative is used.
        rate = np.where(np.isfinite(gyro_rate), gyro_rate, rate)
        acceleration = np.where(np.isfinite(gyro_acceleration), gyro_acceleration, acceleration)
        rate_noise, acceleration_noise = float(filtered_noise[0]), float(filtered_noise[1])
        if trial.rate_only:
            noise, gyro_gain, gyro_offset = gyro_noise, math.nan, math.nan
    return Rates(
        time=grid,
        rate=rate,
        acceleration=acceleration,
        position=kernel.smooth(angle),
        kernel=kernel,
        position_noise=noise,
        rate_noise=rate_noise,
        acceleration_noise=acceleration_noise,
        from_gyro=trial.rate is not None,
        gyro_gain=gyro_gain,
        gyro_offset=gyro_offset,
    )


def _gain_and_offset(gyro: FloatArray, rate: FloatArray, noise: float) -> tuple[float, float]:
    """Slope and intercept of (m,) ``gyro`` against the position's ``rate``; NaN where the rate is constant.

    The derivative of a position is the noisier of the two, which would lower the slope of a regression on it. The
    regression is therefore on the gyro, less the variance of its white ``noise`` (Fuller 1987, section 1.2).
    """
    known = np.isfinite(gyro) & np.isfinite(rate)
    if not known.any() or np.ptp(rate[known]) == 0.0:
        return math.nan, math.nan
    (of_gyro, both), (_, of_rate) = np.cov(gyro[known], rate[known], bias=True)
    true = of_gyro - noise**2
    is_related = true > 0.5 * of_gyro and both**2 > _RELATED * of_gyro * of_rate
    gain = true / both if is_related else both / of_rate
    return float(gain), float(np.mean(gyro[known]) - gain * np.mean(rate[known]))


def highest_cutoff(trials: Sequence[Trial]) -> float:
    """Highest cut-off in Hz at which the central differences are accurate at the sampling rate of ``trials``."""
    return _MAX_CUTOFF / float(np.median([trial.sampling_interval for trial in trials]))


def uniform_grid(trial: Trial) -> FloatArray:
    """(m,) instants in s at the trial's sampling interval, from its first to its last measured position."""
    measured = trial.time[trial.measured]
    period = trial.sampling_interval
    count = round((measured[-1] - measured[0]) / period) + 1
    return np.asarray(measured[0] + period * np.arange(count))


def resample(trial: Trial, values: FloatArray, grid: FloatArray) -> FloatArray:
    """(m,) ``values`` interpolated linearly to the grid; NaN inside gaps and outside the measured span."""
    known = np.isfinite(values)
    time, measured = trial.time[known], values[known]
    if len(time) < 2:
        return np.full(len(grid), np.nan)
    out = np.interp(grid, time, measured, left=np.nan, right=np.nan)
    period = grid[1] - grid[0]
    limit, margin = _BRIDGE_SAMPLES * period, 1e-6 * period
    # Readings before and after each instant, with a margin for rounding; an instant at a reading has more
    # than one step between them.
    before, after = np.searchsorted(time, grid - margin) - 1, np.searchsorted(time, grid + margin, side="right")
    between = np.flatnonzero((after == before + 1) & (before >= 0) & (after < len(time)))
    out[between[time[after[between]] - time[before[between]] > limit]] = np.nan
    return out


def integral(time: FloatArray, rate: FloatArray) -> FloatArray:
    """(n,) integral of the rate by the trapezoidal rule; NaN where not measured."""
    known = np.flatnonzero(np.isfinite(rate))
    steps = 0.5 * (rate[known][1:] + rate[known][:-1]) * np.diff(time[known])
    return cumulative(steps, known, len(time))


def cumulative(steps: FloatArray, known: IntArray, count: int) -> FloatArray:
    """(count,) cumulative sum of the (m-1,) ``steps`` between the (m,) ``known`` rows; NaN in the others."""
    position = np.full(count, np.nan)
    position[known] = np.concatenate(([0.0], np.cumsum(steps)))[: len(known)]
    return position


def cell_averages(time: FloatArray, values: FloatArray, grid: FloatArray) -> FloatArray:
    """(m,) average of the held (n,) ``values`` over the cell of one period around each grid instant."""
    passed = np.concatenate(([0.0], np.cumsum(values[:-1] * np.diff(time))))
    half = 0.5 * (grid[1] - grid[0])
    edges = np.concatenate((grid - half, grid[-1:] + half))
    inside = np.clip(edges, time[0], time[-1])
    width, area = np.diff(inside), np.diff(np.interp(inside, time, passed))
    return np.asarray(area / np.where(width > 0, width, np.nan))


def white_noise(values: FloatArray) -> float:
    """Robust standard deviation of the white part of (n,) ``values``, from fourth differences."""
    differences = np.diff(values, n=4)
    differences = differences[np.isfinite(differences)]
    if not differences.size:
        return 0.0
    # 70 = 1 + 16 + 36 + 16 + 1 is the variance gain of a fourth difference. 1.4826 turns a median into a deviation.
    return float(1.4826 * np.median(np.abs(differences)) / math.sqrt(70.0))


def choose_cutoff(trials: Sequence[Trial]) -> float:
    """Cut-off in Hz with the least expected error of the acceleration over all ``trials``; docs/method.md, (4).

    A low pass loses the signal above its cut-off and keeps the sensor noise below it. Signal and noise are separated in
    the spectrum of the position's second difference. White position noise rises there as the fourth power of
    sin(pi f h), and white rate noise as the square.
    """
    period = float(np.median([trial.sampling_interval for trial in trials]))
    frequency, spectrum = _acceleration_spectrum(trials, period)
    power = 2 if trials[0].rate_only else 4
    shape = (2.0 * np.sin(np.pi * frequency * period)) ** power
    # Above 0.7 of the Nyquist frequency the signal is negligible.
    top = frequency > 0.35 / period
    noise = float(np.median(spectrum[top] / shape[top])) * shape
    lost_signal = np.cumsum(np.clip(spectrum - noise, 0.0, None)[::-1])[::-1]
    error = lost_signal + np.cumsum(noise)
    # The kernel has to fit into the typical log. The median keeps one short log from deciding for all.
    low = 8.0 * _HALF_WIDTH / float(np.median([trial.duration for trial in trials]))
    high = _MAX_CUTOFF / period
    best = float(frequency[int(np.argmin(error))])
    return float(np.clip(best, min(low, high), high))


def _acceleration_spectrum(trials: Sequence[Trial], period: float) -> tuple[FloatArray, FloatArray]:
    """Frequencies in Hz and mean power spectral density of the position's second difference."""
    total, weight = np.zeros(_SPECTRUM_LENGTH // 2 + 1), 0
    frequency = np.asarray(np.fft.rfftfreq(_SPECTRUM_LENGTH, period), dtype=np.float64)
    for trial in trials:
        # Second differences of the position on a uniform grid, from first differences of the rate in a rate-only trial.
        grid = uniform_grid(trial)
        if trial.rate_only and trial.rate is not None:
            second = np.asarray(np.diff(resample(trial, trial.rate, grid)) * trial.sampling_interval)
        else:
            second = np.diff(resample(trial, trial.position, grid), n=2)
        for start, stop in finite_segments(second):
            part = second[start:stop]
            if len(part) < _MIN_SPECTRUM_SAMPLES:
                continue
            total += power_spectral_density(part, _SPECTRUM_LENGTH, period) * len(part)
            weight += len(part)
    if not weight:
        first = trials[0]
        name = first.axis.rate_words if first.rate_only else first.axis.position_words
        where = first.name if len(trials) == 1 else f"{first.name} and {len(trials) - 1} more"
        text = f"no stretch of {name} is long enough to find its noise: {_MIN_SPECTRUM_SAMPLES + 2} readings without a "
        text += "gap between them were expected."
        raise DataError(text, where=where, mend="Record longer runs.")
    return frequency, total / weight


def power_spectral_density(part: FloatArray, length: int, period: float, *, about_mean: bool = False) -> FloatArray:
    """(length/2 + 1,) one-sided power spectral density of (n,) ``part``, by Welch's method (1967).

    Pieces shorter than ``length`` are padded with zeros, which keeps the frequencies the same. ``about_mean`` subtracts
    the mean of each piece.
    """
    size = min(length, len(part))
    window = np.hanning(size + 1)[:-1]
    pieces = np.lib.stride_tricks.sliding_window_view(part, size)[:: size - size // 2]
    pieces = pieces - pieces.mean(axis=1, keepdims=True) if about_mean else pieces
    power = np.mean(np.abs(np.fft.rfft(pieces * window, length)) ** 2, axis=0)
    power[1:-1] *= 2.0
    return np.asarray(power * period / np.sum(window**2))


def finite_segments(values: FloatArray) -> list[tuple[int, int]]:
    """(start, stop) index of every unbroken run of finite ``values``."""
    known = np.concatenate(([0], np.isfinite(values).astype(np.int8), [0]))
    edges = np.flatnonzero(np.diff(known))
    return [(int(start), int(stop)) for start, stop in edges.reshape(-1, 2)]


def fast_fft_length(length: int) -> int:
    """Smallest length of at least ``length`` that is a power of two times 1, 3, 5, 9 or 15."""
    return min(odd << max((length - 1) // odd, 0).bit_length() for odd in (1, 3, 5, 9, 15))


@functools.lru_cache(maxsize=32)
def _spectrum(kernel: bytes, size: int) -> ComplexArray:
    """Transform of a kernel, cached because every simulation of a trial uses it again."""
    return np.fft.rfft(np.frombuffer(kernel), size)


def _convolve(values: FloatArray, kernel: FloatArray) -> FloatArray:
    """Convolution with a kernel centred on each sample; NaN where the kernel does not fit."""
    known = np.isfinite(values)
    # Subtracting the large offset of the position keeps rounding errors small.
    offset = float(values[known][0]) if known.any() else 0.0
    filled = np.where(known, values - offset, 0.0)
    size = fast_fft_length(len(filled) + len(kernel) - 1)
    spectrum = np.fft.rfft(filled, size) * _spectrum(kernel.tobytes(), size)
    out = np.fft.irfft(spectrum, size)[len(kernel) // 2 :][: len(filled)]
    complete = np.zeros(len(known), dtype=bool)
    unknown = np.cumsum(np.concatenate(([0], ~known)))
    half = len(kernel) // 2
    complete[half : len(known) - half] = unknown[len(kernel) :] == unknown[: -len(kernel)]
    return np.where(complete, out + offset * kernel.sum(), np.nan)
