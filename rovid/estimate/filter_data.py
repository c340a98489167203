"""Readings of all runs, one after the other, as the Kalman filter takes them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray, IntArray
from rovid.core.threads import SizedCache
from rovid.estimate.dataset import NOISE_FLOOR, FitData, InputCache, rms
from rovid.estimate.unknown_past import UnknownPasts
from rovid.model.filter_batch import FilterData
from rovid.model.model import Model
from rovid.model.ode import driven_initial_rate, initial_rate, with_moved_past
from rovid.trial.preprocessing import Run

# Standard deviation of the initial rate of a trial, as a share of the RMS rate.
_RATE_ERROR = 0.2
# Time constants of the vehicle in which the motion forgets its state. Convention.
_FORGOTTEN = 5.0
# Shortest block in time constants of the vehicle, usual number of blocks in all logs, and the least number.
_BLOCK, _USUAL_BLOCKS, _BLOCKS = 8.0, 60, 12
# Intervals between the filter's steps that a gap needs to be divided into steps; convention.
_GAP_STEPS = 5.0
# Bytes of cached angles that are corrected for the heading sensor's deviation.
_CACHE_BYTES = 16_000_000
# Largest number of log samples in a chunk of several runs; bounds the memory of a filter pass.
_CHUNK_SAMPLES = 200_000


class CorrectedAngle(NamedTuple):
    """(n,) measured angle without the heading sensor's deviation, and d(measured)/d(true), None for a true sensor."""

    angle: FloatArray
    gain: FloatArray | None

    @property
    def nbytes(self) -> int:
        """Bytes."""
        return self.angle.nbytes + (0 if self.gain is None else self.gain.nbytes)


@dataclass(frozen=True, eq=False, kw_only=True)
class DataChunk:
    """Runs that one filter pass goes through."""

    runs: Sequence[tuple[Run, IntArray | slice]]  #: Each run with the samples at which the filter has its steps.
    angle: FloatArray  #: (n,) measured angle along the body's axis, all runs one after the other.
    filter_data: FilterData  #: The same readings as the filter takes them.
    innovation_index: IntArray  #: (N,) twice the sample of each innovation, plus one for an innovation of the rate.
    rows: slice  #: Rows of these innovations among those of all chunks.
    inputs: InputCache  #: Torque inputs of the runs, from each filter step to the next.
    unknown_pasts: UnknownPasts | None  #: Runs with estimated commands before their first sample; None without any.
    cache: SizedCache  #: Corrected angles of all chunks.

    def corrected_angle(self, model: Model) -> CorrectedAngle:
        """The angle that the filter takes, corrected for the deviation of the heading sensor of ``model``."""
        sensor = model.heading_sensor
        if not sensor.deviates:
            return CorrectedAngle(self.angle, None)

        def correct() -> CorrectedAngle:
            position = np.concatenate([run.trial.position[at] for run, at in self.runs])
            true, gain = sensor.to_true(position)
            return CorrectedAngle(self.angle - (position - true), gain)

        return self.cache.get_or_make((self.rows.start, sensor.cache_key), correct)


@dataclass(frozen=True, eq=False)
class InnovationData(FitData):
    """Data of the innovation likelihood: each reading is predicted from all readings before it."""

    @cached_property
    def steps(self) -> list[IntArray] | None:
        """For each run, the (n,) sample numbers of the filter's steps; None for all samples."""
        if self.interval <= 0.0:
            return None
        return [_thinned(run.trial.time, run.trial.measured, self.interval) for run in self.runs]

    @cached_property
    def _runs(self) -> list[tuple[Run, IntArray | slice]]:
        steps: Sequence[IntArray | slice] = self.steps or [slice(None)] * len(self.runs)
        return list(zip(self.runs, steps, strict=True))

    @cached_property
    def times(self) -> list[FloatArray]:
        """For each run, the (n,) s of the filter's steps."""
        return [run.trial.time[at] for run, at in self._runs]

    @cached_property
    def angles(self) -> list[FloatArray]:
        """For each run, the (n,) measured angle along the body's axis, rad or m.

        Where only the rate was measured, all but the first are NaN.
        """
        angles = [run.trial.body_position[at] for run, at in self._runs]
        if not self.rate_only:
            return angles
        return [np.where(np.arange(len(angle)) == 0, angle, np.nan) for angle in angles]

    @cached_property
    def gyro_rates(self) -> list[FloatArray]:
        """For each run, the (n,) measured rate less the gyro's offset; NaN where the rate is not used."""
        rates = []
        for (run, at), time in zip(self._runs, self.times, strict=True):
            rate = np.broadcast_to(np.nan, len(time))
            if run.trial.rate is not None and (self.gyro or run.trial.rate_only):
                rate = run.trial.rate[at] - np.nan_to_num(run.rates.gyro_offset)
            rates.append(rate)
        return rates

    @cached_property
    def innovation_samples(self) -> list[tuple[IntArray, IntArray]]:
        """For each run, the sample numbers of the innovations of the angle and of the rate.

        The filter starts at the first angle, which has no innovation.
        """
        pairs = zip(self.angles, self.gyro_rates, strict=True)
        return [(np.flatnonzero(np.isfinite(angle))[1:], np.flatnonzero(np.isfinite(rate))) for angle, rate in pairs]

    @property
    def innovation_spans(self) -> list[tuple[FloatArray, FloatArray]]:
        """For each run, the (n,) s of each innovation, twice: of the angles, followed by the rates."""
        pairs = zip(self.times, self.innovation_samples, strict=True)
        instants = [np.concatenate((time[angles], time[rates])) for time, (angles, rates) in pairs]
        return [(one, one) for one in instants]

    @property
    def block_seconds(self) -> float:
        """Length in s of a block: eight time constants or longer, less in short runs."""
        total = sum(float(np.ptp(time)) for time in self.times)
        return min(max(_BLOCK * self.usual_time, total / _USUAL_BLOCKS), total / _BLOCKS)

    @cached_property
    def chunks(self) -> list[DataChunk]:
        """All runs, in chunks of bounded size."""
        cache, chunks, begin = SizedCache(_CACHE_BYTES), list[DataChunk](), 0
        for place in _chunk_slices([len(run.trial.time) for run in self.runs]):
            chunks.append(self._chunk(place, begin, cache))
            begin = chunks[-1].rows.stop
        return chunks

    def _chunk(self, place: slice, begin: int, cache: SizedCache) -> DataChunk:
        """The chunk of the runs at ``place``, with its first innovation at row ``begin``."""
        times = self.times[place]
        offsets = np.cumsum([0, *map(len, times)])
        index = []
        for offset, (angles, rates) in zip(offsets[:-1], self.innovation_samples[place], strict=True):
            index += [2 * (offset + angles), 2 * (offset + rates) + 1]
        innovation_index = np.concatenate(index)
        row = np.full(2 * offsets[-1], -1)
        row[innovation_index] = np.arange(len(innovation_index))
        rate_error = _RATE_ERROR * self.rms_rate
        filter_data = FilterData(
            offsets=offsets,
            time=np.concatenate(times),
            rate=np.concatenate(self.gyro_rates[place]),
            start_position=np.array([run.trial.first_position for run in self.runs[place]]),
            initial_rate=np.array([(rate, rate_error) for rate in self.initial_rates[place]], dtype=float),
            output_index=row.reshape(-1, 2),
            states=np.zeros((len(times), 0)),
        )
        inputs = self.inputs.subset(place)
        return DataChunk(
            runs=self._runs[place],
            angle=np.concatenate(self.angles[place]),
            filter_data=filter_data,
            innovation_index=innovation_index,
            rows=slice(begin, begin + len(innovation_index)),
            inputs=inputs,
            unknown_pasts=self._unknown_pasts(inputs, filter_data),
            cache=cache,
        )

    def _unknown_pasts(self, inputs: InputCache, data: FilterData) -> UnknownPasts | None:
        """Those of the runs of ``inputs``, whose readings are ``data``."""
        trials = [run.trial for run in inputs.runs]
        # A run without a past begins at rest.
        numbers = [at for at, trial in enumerate(trials) if trial.past is not None]
        if self.vehicle is None or not numbers:
            return None
        moved = [with_moved_past(trials[at], self.vehicle) for at in numbers]
        runs = [replace(inputs.runs[at], trial=trial) for at, (trial, _) in zip(numbers, moved, strict=True)]
        steps = None if inputs.steps is None else [inputs.steps[at] for at in numbers]
        return UnknownPasts(
            runs=np.array(numbers),
            data=data,
            inputs=inputs.of(runs, steps),
            changes=np.array([change for _, change in moved]),
            std=self._accelerating_torque,
            memory=_FORGOTTEN * self.usual_time,
            rate=self.rms_rate,
            torque=self.rms_torque,
        )

    @cached_property
    def _accelerating_torque(self) -> float:
        """RMS of the torque that no drag balances, N m: the error of a balance at a sample taken at random."""
        return rms([run.filtered_torque - self.initial_model.drag(run.rates.rate) for run in self.runs])

    @cached_property
    def initial_rates(self) -> list[float]:
        """Rate of each run at its first instant, rad/s."""
        frequency, rates = self.initial_model.natural_frequency, []
        for run, driven in zip(self.runs, self.driven_runs, strict=True):
            if driven.trial is run.trial:
                rates.append(initial_rate(run.trial, frequency))
            else:
                rates.append(driven_initial_rate(run.trial, frequency)[0])
        return rates

    @cached_property
    def gyro_noise(self) -> float:
        """Standard deviation of the gyro's white noise, rad/s, from second differences; 1 where there is no gyro."""
        differences = np.concatenate([np.diff(rate, n=2) for rate in self.gyro_rates])
        if not np.isfinite(differences).any():
            return 1.0
        # The second difference of white noise has six times its variance.
        noise = float(np.sqrt(np.nanmean(differences**2) / 6.0))
        return max(noise, NOISE_FLOOR * self.position_scale / self.usual_time)


def _thinned(time: FloatArray, measured: BoolArray, interval: float) -> IntArray:
    """The first measured sample in each cell of a grid of ``interval`` s, the last of all, and samples across gaps.

    In a gap, the first sample of each cell is a step without a reading. A single step would take the mean torque of the
    whole gap, and an effect that divides the step would explain the error of that mean.
    """
    known = np.flatnonzero(measured)
    cell = np.floor((time - time[known[0]]) / interval + 1e-6)
    first = np.concatenate(([True], cell[known][1:] != cell[known][:-1]))
    first[-1] = True
    chosen = known[first]
    usual = max(interval, float(np.median(np.diff(time[known])))) if len(known) > 1 else interval
    for begin, end in pairwise(chosen.tolist()):
        if time[end] - time[begin] > _GAP_STEPS * usual:
            inside = np.arange(begin + 1, end)
            fresh = (cell[inside] != cell[inside - 1]) & (cell[inside] != cell[begin]) & (cell[inside] != cell[end])
            chosen = np.append(chosen, inside[fresh])
    return np.sort(chosen)


def _chunk_slices(lengths: Sequence[int]) -> list[slice]:
    """Consecutive runs of these ``lengths``, cut into chunks of no more samples than the limit where possible."""
    begins, length = [0], 0
    for place, one in enumerate(lengths):
        if length and length + one > _CHUNK_SAMPLES:
            begins.append(place)
            length = 0
        length += one
    return [slice(begin, end) for begin, end in pairwise([*begins, len(lengths)])]
