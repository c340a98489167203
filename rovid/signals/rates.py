"""Position -> rate and acceleration, by one zero-phase low pass that everything compared goes through."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.trial.trial import Trial

# Convolution and spectrum stand below: to import scipy.signal or scipy.fft for them takes long beside what they do.
# A sinc under a Hann window: flat to a third of the cut-off, 44 dB down beyond twice the cut-off.
_HALF_WIDTH = 1.25  # of 1/cutoff
_MAX_CUTOFF = 0.2  # of the sampling rate: up to it the differences below are derivatives to one percent
# Central differences of eighth order (Fornberg 1988), turned for convolution.
_FIRST = np.array([-1 / 280, 4 / 105, -1 / 5, 4 / 5, 0.0, -4 / 5, 1 / 5, -4 / 105, 1 / 280])
_SECOND = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])
# Missing positions shorter than this are bridged for the filter; longer ones stay a gap.
_BRIDGE_SAMPLES = 5
_BRIDGE_SECONDS = 0.5
_FEWEST_BENDS = 32  # second differences in a row that tell noise from motion


@dataclass(frozen=True, kw_only=True, eq=False)
class ZeroPhaseFilter:
    """Convolution kernels for a value, its first and its second derivative on a grid of ``period`` s.

    The derivatives are those of the low-passed value, so that torque, rate and acceleration pass through the
    same filter; all three kernels have the same length. ``cutoff`` is the -6 dB frequency in Hz.
    """

    period: float
    cutoff: float
    value: FloatArray
    first: FloatArray
    second: FloatArray

    @classmethod
    def design(cls, *, period: float, cutoff: float) -> ZeroPhaseFilter:
        """Kernels for a grid of ``period`` s and a ``cutoff`` in Hz."""
        half = max(math.ceil(_HALF_WIDTH / cutoff / period), 3)
        t = np.arange(-half, half + 1) * period
        window = 1.0 + np.cos(np.pi * t / ((half + 1) * period))
        taps = np.sinc(2.0 * cutoff * t) * window
        taps /= taps.sum()
        return cls(
            period=period,
            cutoff=cutoff,
            value=np.pad(taps, len(_FIRST) // 2),
            first=np.convolve(taps, _FIRST) / period,
            second=np.convolve(taps, _SECOND) / period**2,
        )

    @property
    def half_width(self) -> float:
        """Seconds at each end of a stretch for which the filter has no answer."""
        return float(len(self.value) // 2 * self.period)

    def smooth(self, values: FloatArray) -> FloatArray:
        """Low-passed (n,) ``values``; NaN within half a kernel of a NaN or an end."""
        return _convolve(values, self.value)

    def rate(self, values: FloatArray) -> FloatArray:
        """First derivative per second of the low-passed ``values``."""
        return _convolve(values, self.first)

    def acceleration(self, values: FloatArray) -> FloatArray:
        """Second derivative per second squared of the low-passed ``values``."""
        return _convolve(values, self.second)

    def smooth_held(self, averages: FloatArray) -> FloatArray:
        """Low-passed signal of which the averages over each grid cell are given."""
        # These three points undo the averaging to fourth order, 1/sinc(f h) = 1 + (pi f h)^2/6.
        correction = np.array([-1.0, 26.0, -1.0]) / 24.0
        return _convolve(averages, np.convolve(self.value, correction, mode="same"))

    def gain(self, frequency: FloatArray) -> FloatArray:
        """Share of a wave of ``frequency`` in Hz that the low pass leaves."""
        half = len(self.value) // 2
        instants = self.period * np.arange(-half, half + 1)
        phase = 2.0 * np.pi * np.outer(frequency, instants)
        return np.asarray(np.cos(phase) @ self.value)

    def noise(self, position_noise: float) -> tuple[float, float]:
        """Return the standard deviation of rate and acceleration from white ``position_noise``."""
        gain = np.linalg.norm([self.first, self.second], axis=1)
        return float(position_noise * gain[0]), float(position_noise * gain[1])


@dataclass(frozen=True, kw_only=True, eq=False)
class Rates:
    """A trial's motion on a uniform grid, all through the same zero-phase low pass.

    Attributes
    ----------
    time
        (m,) s on the trial's clock.
    rate, acceleration
        (m,) body rate along the axis in rad/s or m/s, and its derivative; NaN where the filter has no answer.
    position
        (m,) the position of which it is the rate, low-passed, in rad or m.
    kernel
        The filter.
    position_noise, rate_noise, acceleration_noise
        Standard deviation of the white sensor noise in what is measured, the position or else the rate, and what the
        filter leaves of it.
    from_gyro
        Whether a logged rate was used in place of the position's derivative.
    gyro_gain, gyro_offset
        How many times the position's rate the logged one is, and by how much it is more; NaN where none is.
    """

    time: FloatArray
    rate: FloatArray
    acceleration: FloatArray
    position: FloatArray
    kernel: ZeroPhaseFilter
    position_noise: float
    rate_noise: float
    acceleration_noise: float
    from_gyro: bool
    gyro_gain: float = math.nan
    gyro_offset: float = math.nan

    @property
    def valid(self) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """(m,) where rate and acceleration are known."""
        return np.isfinite(self.rate) & np.isfinite(self.acceleration)

    def filter_held(self, trial: Trial, values: FloatArray) -> FloatArray:
        """(m,) a held signal of the trial, such as torque, through the same filter."""
        return self.kernel.smooth_held(cell_averages(trial.time, values, self.time))

    def smooth_samples(self, trial: Trial, values: FloatArray) -> FloatArray:
        """(m,) a continuous signal given at the trial's instants, such as a simulated rate, filtered."""
        return self.kernel.smooth(np.interp(self.time, trial.time, values))


def compute_rates(trial: Trial, *, cutoff: float) -> Rates:
    """Rate and acceleration of one trial along its axis.

    In yaw, where roll and pitch are logged, they are those of the body, see ``Trial.body_position``.

    Parameters
    ----------
    cutoff
        -6 dB frequency of the low pass in Hz.

    Raises
    ------
    DataError
        The trial is shorter than the filter.
    """
    grid = uniform_grid(trial)
    kernel = ZeroPhaseFilter.design(period=float(grid[1] - grid[0]), cutoff=cutoff)
    if len(grid) < len(kernel.value) + 2:
        raise DataError(
            f"lasts {trial.duration:.1f} s, shorter than the filter, which takes "
            f"{2 * kernel.half_width:.1f} s at a cut-off of {cutoff:.3g} Hz.",
            where=trial.name,
            mend="Raise --cutoff or leave the log out.",
        )
    angle = resample(trial, trial.body_position, grid)
    noise = white_noise(angle)
    rate, acceleration = kernel.rate(angle), kernel.acceleration(angle)
    rate_noise, acceleration_noise = kernel.noise(noise)
    gyro_gain = gyro_offset = math.nan
    if trial.rate is not None:
        gyro = resample(trial, trial.rate, grid)
        read, change = kernel.smooth(gyro), kernel.rate(gyro)
        gyro_gain, gyro_offset = _against_position(read, rate)
        # Where the instrument has no reading the position's own rate is as good as without it.
        rate = np.where(np.isfinite(read), read, rate)
        acceleration = np.where(np.isfinite(change), change, acceleration)
        white = white_noise(gyro)
        gain = np.linalg.norm([kernel.value, kernel.first], axis=1) * white
        rate_noise, acceleration_noise = float(gain[0]), float(gain[1])
        if trial.rate_only:
            noise, gyro_gain, gyro_offset = white, math.nan, math.nan
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


def _against_position(gyro: FloatArray, rate: FloatArray) -> tuple[float, float]:
    """Gain and offset of (m,) ``gyro`` over the position's ``rate``; NaN where the rate hardly changes."""
    known = np.isfinite(gyro) & np.isfinite(rate)
    if not known.any() or np.ptp(rate[known]) == 0.0:
        return math.nan, math.nan
    gain, offset = np.polynomial.polynomial.polyfit(rate[known], gyro[known], 1)[::-1]
    return float(gain), float(offset)


def highest_cutoff(trials: Sequence[Trial]) -> float:
    """Cut-off in Hz up to which the differences are derivatives at the sampling rate of ``trials``."""
    return _MAX_CUTOFF / float(np.median([trial.sampling_interval for trial in trials]))


def uniform_grid(trial: Trial) -> FloatArray:
    """(m,) instants at the position's median interval, from its first to its last sample."""
    measured = trial.time[trial.measured]
    period = trial.sampling_interval
    count = round((measured[-1] - measured[0]) / period) + 1
    return np.asarray(measured[0] + period * np.arange(count))


def resample(trial: Trial, values: FloatArray, grid: FloatArray) -> FloatArray:
    """(m,) ``values`` brought to the grid; NaN inside gaps and outside the measured span."""
    known = np.isfinite(values)
    time, measured = trial.time[known], values[known]
    if len(time) < 2:
        return np.full(len(grid), np.nan)
    out = np.interp(grid, time, measured, left=np.nan, right=np.nan)
    period = grid[1] - grid[0]
    limit = max(_BRIDGE_SAMPLES * period, _BRIDGE_SECONDS)
    for k in np.flatnonzero(np.diff(time) > limit):
        out[(grid > time[k] + 1e-9) & (grid < time[k + 1] - 1e-9)] = np.nan
    return out


def cell_averages(time: FloatArray, values: FloatArray, grid: FloatArray) -> FloatArray:
    """(m,) average of the held (n,) ``values`` over the cell of one period around each grid instant."""
    integral = np.concatenate(([0.0], np.cumsum(values[:-1] * np.diff(time))))
    half = 0.5 * (grid[1] - grid[0])
    edges = np.concatenate((grid - half, grid[-1:] + half))
    inside = np.clip(edges, time[0], time[-1])
    width = np.diff(inside)
    area = np.diff(np.interp(inside, time, integral))
    return np.asarray(area / np.where(width > 0, width, np.nan))


def white_noise(values: FloatArray) -> float:
    """Robust standard deviation of the white part of (n,) ``values``, from fourth differences."""
    differences = np.diff(values, n=4)
    differences = differences[np.isfinite(differences)]
    if not differences.size:
        return 0.0
    # 70 = 1 + 16 + 36 + 16 + 1, the variance gain of a fourth difference; 1.4826 turns a median into a sd.
    return float(1.4826 * np.median(np.abs(differences)) / math.sqrt(70.0))


def choose_cutoff(trials: Sequence[Trial]) -> float:
    """Cut-off in Hz that makes the acceleration's expected error smallest over all ``trials``.

    What lies above the cut-off is lost, the sensor noise below it is kept. Signal and noise are told apart
    in the spectrum of the position's second difference, in which its white noise rises as the fourth power of
    the sine of half the angle, a rate's as the square.
    """
    period = float(np.median([trial.sampling_interval for trial in trials]))
    frequency, spectrum = _acceleration_spectrum(trials, period)
    power = 2 if trials[0].rate_only else 4
    shape = (2.0 * np.sin(np.pi * frequency * period)) ** power
    # So near to half the sampling frequency all is noise.
    top = frequency > 0.35 / period
    noise = float(np.median(spectrum[top] / shape[top])) * shape
    # The filter has to fit into the logs, but one short log may not spoil the rates of all.
    low = 8.0 * _HALF_WIDTH / float(np.median([trial.duration for trial in trials]))
    high = _MAX_CUTOFF / period
    best = float(frequency[int(np.argmin(_cost(spectrum, noise)))])
    return float(np.clip(best, min(low, high), high))


def _cost(spectrum: FloatArray, noise: FloatArray) -> FloatArray:
    """(n,) power that a cut-off at each frequency takes from the signal, and what it leaves of the ``noise``."""
    lost = np.cumsum(np.clip(spectrum - noise, 0.0, None)[::-1])[::-1]
    return np.asarray(lost + np.cumsum(noise))


def _acceleration_spectrum(trials: Sequence[Trial], period: float) -> tuple[FloatArray, FloatArray]:
    length = 512
    total, weight = np.zeros(length // 2 + 1), 0
    frequency = np.asarray(np.fft.rfftfreq(length, period), dtype=np.float64)
    for trial in trials:
        second = _second_differences(trial)
        for start, stop in finite_segments(second):
            part = second[start:stop]
            if len(part) < _FEWEST_BENDS:
                continue
            total += power_spectral_density(part, length, period) * len(part)
            weight += len(part)
    if not weight:
        raise _too_short(trials)
    return frequency, total / weight


def power_spectral_density(part: FloatArray, length: int, period: float, *, about_mean: bool = False) -> FloatArray:
    """(length/2 + 1,) one-sided power spectral density of (n,) ``part``, which is cut into pieces (Welch 1967).

    A shorter one is padded to the ``length``: of all the density is known at the same frequencies. ``about_mean`` takes
    its mean off each piece.
    """
    size = min(length, len(part))
    window = np.hanning(size + 1)[:-1]
    pieces = np.lib.stride_tricks.sliding_window_view(part, size)[:: size - size // 2]
    pieces = pieces - pieces.mean(axis=1, keepdims=True) if about_mean else pieces
    power = np.mean(np.abs(np.fft.rfft(pieces * window, length)) ** 2, axis=0)
    power[1:-1] *= 2.0
    return np.asarray(power * period / np.sum(window**2))


def _too_short(trials: Sequence[Trial]) -> DataError:
    first = trials[0]
    name = first.axis.rate_words if first.rate_only else first.axis.position_words
    where = first.name
    if len(trials) > 1:
        where += f" and {len(trials) - 1} more"
    return DataError(
        f"no stretch of {name} is long enough to find its noise: {_FEWEST_BENDS + 2} readings without a gap "
        "between them were expected.",
        where=where,
        mend="Record longer runs.",
    )


def _second_differences(trial: Trial) -> FloatArray:
    """Of the position on a uniform grid, by the first ones of the rate where that alone was measured."""
    grid = uniform_grid(trial)
    if trial.rate_only and trial.rate is not None:
        return np.asarray(np.diff(resample(trial, trial.rate, grid)) * trial.sampling_interval)
    return np.diff(resample(trial, trial.position, grid), n=2)


def finite_segments(values: FloatArray) -> list[tuple[int, int]]:
    """(start, stop) index of every unbroken run of finite ``values``."""
    # Nothing is known before the first and after the last: every stretch has two edges.
    known = np.concatenate(([0], np.isfinite(values).astype(np.int8), [0]))
    edges = np.flatnonzero(np.diff(known))
    return [(int(start), int(stop)) for start, stop in edges.reshape(-1, 2)]


def fast_fft_length(length: int) -> int:
    """The ``length`` of a series, or somewhat more, with small factors alone: of those Fourier transforms are quick."""
    return min(odd << max((length - 1) // odd, 0).bit_length() for odd in (1, 3, 5, 9, 15))


@functools.lru_cache(maxsize=32)
def _spectrum(kernel: bytes, size: int) -> NDArray[np.complex128]:
    """Of a kernel, which every simulation of a trial goes through again."""
    return np.fft.rfft(np.frombuffer(kernel), size)


def _convolve(values: FloatArray, kernel: FloatArray) -> FloatArray:
    """Convolution with a kernel centred on each sample; NaN where the kernel does not fit."""
    known = np.isfinite(values)
    # A running sum over a filled array would smear the position's large offset; take it off first.
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
