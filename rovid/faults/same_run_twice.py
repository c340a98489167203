"""One run in two logs: copies, in two formats or at two rates.

Counted twice, a run would pass for two independent runs and halve every variance. Two runs of one experiment can agree
to a fraction of a degree, but each has its own noise; two copies of one recording have the same noise. Criteria: equal
commands, positions within half a degree throughout, and a difference below the noise.

A second sensor has its own noise, another zero and, as a compass, another deviation. Both sensors then follow the same
disturbances: the positions differ by noise about a constant or about a function of the heading, although disturbances
moved the vehicle. In two runs the disturbances differ, and the positions drift apart. In calm water two runs of one
programme may agree as well. Only motion that no command explains shows that a run is one.

Parts of one run that overlap in two recordings are found by their common noise.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property, partial

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.faults.base import CampaignData, Detection, Detectors, RunsData
from rovid.trial.fault import Fault
from rovid.trial.preprocessing import Run, measured_spans
from rovid.trial.rates import fast_fft_length
from rovid.trial.segments import gap_limit
from rovid.trial.trial import Trial

# Readings that an overlap needs, and as many changes of the slope: fewer agree by chance in a coarse signal at rest.
_MIN_SAMPLES, _MIN_CHANGES = 50, 50
# RMS difference over the noise of one recording: independent noise makes it 1.41, and rounding far below 0.1.
_SAME_NOISE = 0.3
# Share of the sampling interval within which stamps agree; share of the time in which commands agree.
_STAMPS, _COMMANDS = 0.5, 0.9
_TURN = 2.0 * np.pi
# Share of the longer recording that the shorter must cover: one may be cut.
_MIN_COVER = 0.5
_MAX_DIFFERENCE = np.deg2rad(0.5)
# RMS difference over noise: 1.41 for two independent noises, that of the rounding for two copies.
_NOISE_RATIO = 1.1
# s; two formats may begin this far apart, because a trial begins when the last command becomes known.
_MAX_SHIFT = 5.0
_MAX_POINTS, _MIN_POINTS = 5000, 50
# Commands must agree to this share of their size for this share of the time, which excludes the steps.
_COMMAND_TOLERANCE, _COMMAND_SHARE = 0.03, 0.9
# RMS difference of two sensors over their noises, with a margin for noise that is not white. Mean square difference of
# one run's sensors over that of independent motions, which have 1; least number of samples for that.
_SENSOR_RATIO, _SHARED, _MIN_COMMON = 1.5, 0.5, 200
# Interval between the past torques that move a run, in periods of the cut-off, and their number.
_TAP, _TAPS = 1.0, 6


class _Recording:
    """A trial with cached quantities for comparisons with many others."""

    def __init__(self, trial: Trial) -> None:
        self.trial = trial
        self.rows = np.flatnonzero(trial.measured)
        self.time, self.position = trial.time[self.rows], trial.position[self.rows]

    @cached_property
    def third(self) -> FloatArray:
        """Third differences of the position in rad, without the largest: the noise, rather than motion or outliers."""
        third = np.diff(self.position, n=3)
        limit = 3.0 * float(np.median(np.abs(third))) if third.size else 0.0
        return np.clip(third, -limit, limit) if limit > 0.0 else third

    @cached_property
    def interval(self) -> float:
        """Median interval in s."""
        return float(np.median(np.diff(self.time))) if len(self.rows) > 1 else np.inf

    @cached_property
    def gap(self) -> float:
        """Longest interval in s that is no gap."""
        return gap_limit(np.diff(self.time))

    @cached_property
    def deviations(self) -> FloatArray:
        """(n - 3,) sizes in rad, in order, of third divided differences, scaled to the error of one reading."""
        # A quadratic motion has none, whatever the intervals: rows may be lost.
        windows = np.lib.stride_tricks.sliding_window_view
        if len(self.time) < 4:
            return np.zeros(0)
        time, position = windows(self.time, 4), windows(self.position, 4)
        weights = np.column_stack([1.0 / np.prod(time[:, [k]] - np.delete(time, k, axis=1), axis=1) for k in range(4)])
        return np.sort(np.abs(np.sum(weights * position, axis=1)) / np.linalg.norm(weights, axis=1))

    @cached_property
    def noise(self) -> float:
        """Standard deviation of the noise in rad: without its largest tenth, a Gaussian keeps 0.789 of its RMS."""
        kept = self.deviations[: max(1, int(0.9 * len(self.deviations)))]
        return float(np.sqrt(np.mean(kept**2)) / 0.789) if kept.size else 0.0

    @cached_property
    def resolution(self) -> float:
        """Smallest step in rad."""
        steps = np.abs(np.diff(self.position))
        return float(steps[steps > 1e-9].min(initial=0.1))

    @cached_property
    def at_seconds(self) -> FloatArray:
        """Position in rad at each full second."""
        return np.interp(np.arange(0.0, self.time[-1]), self.time, self.position)

    @cached_property
    def envelope(self) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest position in rad within the largest shift of each full second."""
        reach = int(_MAX_SHIFT) + 1
        padded = np.pad(self.at_seconds, reach, mode="edge")
        near = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1)
        return near.min(axis=1), near.max(axis=1)

    def difference(self, time: FloatArray, psi: FloatArray) -> FloatArray:
        """(n,) rad from the position at ``time`` to ``psi``, without whole turns; NaN in gaps."""
        after = np.clip(np.searchsorted(self.time, time), 1, len(self.time) - 1)
        inside = (time >= self.time[0]) & (time <= self.time[-1])
        inside &= self.time[after] - self.time[after - 1] <= self.gap
        difference = psi - np.interp(time, self.time, self.position)
        difference -= _TURN * np.rint(np.median(difference) / _TURN)
        return np.where(inside, difference, np.nan)


def _overlaps(recordings: Sequence[_Recording]) -> Iterator[tuple[Trial, Trial, slice]]:
    """(earlier log, later log, rows of the later one) of each pair of ``recordings`` that overlap in part."""
    size = fast_fft_length(2 * max((len(one.rows) for one in recordings), default=1))
    spectra = [np.fft.rfft(one.third, size) for one in recordings]
    for later, other in enumerate(recordings):
        for earlier, one in enumerate(recordings[:later]):
            shorter, apart = min(len(one.rows), len(other.rows)), abs(one.interval - other.interval)
            same_commands = one.trial.commands.shape[1] == other.trial.commands.shape[1]
            if shorter < _MIN_SAMPLES or apart > 0.01 * one.interval or not same_commands:
                continue
            products = np.fft.irfft(spectra[earlier] * np.conj(spectra[later]), size)
            lag = int(np.argmax(products))
            rows = _common(one, other, lag - size if lag > size // 2 else lag)
            if rows is not None:
                yield one.trial, other.trial, rows
                break


def _common(one: _Recording, other: _Recording, lag: int) -> slice | None:
    """Rows of ``other``'s trial that ``one`` has, too, ``lag`` readings later; None if these are no copies."""
    first, last = max(0, -lag), min(len(other.rows), len(one.rows) - lag)
    if last - first < _MIN_SAMPLES:
        return None
    own, theirs = slice(first + lag, last + lag), slice(first, last)
    difference = other.position[theirs] - one.position[own]
    turn = _TURN if one.trial.axis.angular and not one.trial.rate_only else 0.0
    offset = float(np.median(difference))
    difference = difference - (turn * np.rint(offset / turn) if turn else offset)
    changes = int(np.count_nonzero(np.abs(np.diff(other.position[theirs], n=3)) > 1e-9))
    stamps = (other.time[theirs] - other.time[first]) - (one.time[own] - one.time[first + lag])
    rms = float(np.sqrt(np.mean(difference**2)))
    noise = float(np.median(one.deviations)) / 0.6745
    if changes < _MIN_CHANGES or rms > _SAME_NOISE * noise + 1e-9 or np.abs(stamps).max() > _STAMPS * one.interval:
        return None
    mine, yours = one.trial.commands[one.rows[own]], other.trial.commands[other.rows[theirs]]
    if np.any(np.mean(np.isclose(mine, yours, rtol=0.03), axis=0) < _COMMANDS):
        return None
    return slice(int(other.rows[first]), int(other.rows[last - 1]) + 1)


def _detect(data: CampaignData) -> Iterator[Detection[CampaignData]]:
    """Trials that are copies of another; the copy with the most measurements stays, or else the first."""
    kept: list[_Recording] = []
    for recording in sorted(map(_Recording, data.trials), key=lambda one: -len(one.time)):
        original = next((other for other in kept if _is_same(other, recording)), None)
        if original is None:
            kept.append(recording)
            continue
        copy, stays = recording.trial, original.trial.name
        more = ", which has more samples" if len(original.time) > len(recording.time) else ""
        fault = Fault(
            fault="same_run_twice",
            logs=(copy.name,),
            text=f"{copy.name} is the same recording as {stays}{more}.",
            remedy="counted_once",
        )
        yield Detection(fault=fault, done="It was left out.", repair=partial(_without, copy=copy))
    order = {id(trial): at for at, trial in enumerate(data.trials)}
    for earlier, later, rows in _overlaps(sorted(kept, key=lambda one: order[id(one.trial)])):
        begin, end = float(later.time[rows][0]), float(later.time[rows][-1])
        fault = Fault(
            fault="same_run_twice",
            logs=(later.name,),
            at=(begin,),
            text=f"{later.name}: from {begin:.1f} to {end:.1f} s it is the same recording as a part of {earlier.name}, "
            "with the same noise.",
            size=end - begin,
            unit="s",
            remedy="counted_once",
        )
        done = "This part was counted once."
        yield Detection(fault=fault, done=done, repair=partial(_without_rows, trial=later, rows=rows))


def _without_rows(data: CampaignData, trial: Trial, rows: slice) -> CampaignData:
    spans = measured_spans(trial, (slice(0, rows.start), slice(rows.stop, len(trial.time))))
    names = [trial.name] if len(spans) < 2 else [f"{trial.name}, before", f"{trial.name}, after"]
    parts = [trial.part(span, name) for span, name in zip(spans, names, strict=False)]
    # The log's faults and remarks stay with its first part.
    parts[1:] = [replace(part, remarks=(), faults=()) for part in parts[1:]]
    trials: list[Trial] = []
    for one in data.trials:
        trials += parts if one is trial else [one]
    return replace(data, trials=trials)


def _without(data: CampaignData, copy: Trial) -> CampaignData:
    return replace(data, trials=[trial for trial in data.trials if trial is not copy])


def _is_same(fine: _Recording, coarse: _Recording) -> bool:
    """Whether both are copies of one recording; ``fine`` has at least as many measurements."""
    own, others = ((one.trial.time, one.trial.position, one.trial.commands) for one in (fine, coarse))
    if all(map(partial(np.array_equal, equal_nan=True), own, others)):
        return True
    # One clock stamped all parts of a log: they are cycles of one test, and no copies.
    of_one_log = bool(fine.trial.parent) and fine.trial.parent == coarse.trial.parent
    if of_one_log or fine.trial.commands.shape[1] != coarse.trial.commands.shape[1] or len(coarse.time) < _MIN_POINTS:
        return False
    shorter, longer = sorted((fine.trial.duration, coarse.trial.duration))
    if shorter < _MIN_COVER * longer or not _may_be_same(fine, coarse):
        return False
    every = len(coarse.time) // _MAX_POINTS + 1
    time, psi = coarse.time[::every], coarse.position[::every]
    shift = _align(fine, time, psi)
    if shift is None:
        return False
    difference = fine.difference(time - shift, psi)
    known = difference[np.isfinite(difference)]
    if len(known) < max(_MIN_POINTS, _MIN_COVER * len(difference)):
        return False
    rounding = (fine.resolution**2 + coarse.resolution**2) / 12.0
    limit = _NOISE_RATIO * np.sqrt(fine.noise**2 + rounding) + 1e-9
    is_small = np.abs(known).max() < _MAX_DIFFERENCE and float(np.sqrt(np.mean(known**2))) <= limit
    time, commands = fine.trial.time, coarse.trial.commands
    at = np.clip(np.searchsorted(time, coarse.trial.time - shift, side="right") - 1, 0, len(time) - 1)
    apart = np.abs(fine.trial.commands[at] - commands)
    agree = apart <= _COMMAND_TOLERANCE * np.abs(commands).max(axis=0)
    return bool(is_small and np.all(np.mean(agree, axis=0) >= _COMMAND_SHARE))


def _may_be_same(fine: _Recording, coarse: _Recording) -> bool:
    """Whether a shift could bring both together; a cheap test that excludes most pairs."""
    low, high = fine.envelope
    count = min(len(low), len(coarse.at_seconds))
    if not count:
        return True
    low, high, psi = low[:count], high[:count], coarse.at_seconds[:count]
    # The two may be unwrapped from different turns.
    psi = psi - _TURN * np.rint(np.median(psi - 0.5 * (low + high)) / _TURN)
    inside = (psi >= low - _MAX_DIFFERENCE) & (psi <= high + _MAX_DIFFERENCE)
    return bool(np.mean(inside) > _COMMAND_SHARE)


def _align(fine: _Recording, time: FloatArray, psi: FloatArray) -> float | None:
    """Delay of ``time`` in s by Gauss-Newton least squares from zero; None where it diverges."""
    shift, rates = 0.0, np.gradient(fine.position, fine.time)
    for _ in range(8):
        difference = fine.difference(time - shift, psi)
        known = np.isfinite(difference)
        rate = np.interp(time[known] - shift, fine.time, rates)
        if not rate.any():
            return shift
        step = -float(rate @ difference[known]) / float(rate @ rate)
        shift += step
        if abs(shift) > _MAX_SHIFT:
            return None
        if abs(step) < 1e-6:
            break
    return shift


def _detect_sensor(data: RunsData) -> Iterator[Detection[RunsData]]:
    """Runs that a second sensor of the same vehicle recorded; the first log stays."""
    kept: list[Run] = []
    for run in data.runs:
        alike = [other for other in kept if _are_alike(other, run)]
        first = next((other for other in alike if _at_once(other, run)), None)
        for other in () if first else alike:
            # They differ by less than independent motions of the size that no command explains.
            independent = _unexplained_motion(other) ** 2 + _unexplained_motion(run) ** 2
            if min(_disagreement(other, run)) ** 2 < _SHARED * independent:
                first = other
                break
        if first is None:
            kept.append(run)
            continue
        shared = "absolute time" if _at_once(first, run) else "disturbances"
        constant, deviating = _disagreement(first, run)
        deviation = ", by a deviation of the compass" if deviating < _SHARED * constant else ""
        offset = float(np.rad2deg(np.median(_common_positions(first, run)[1])) + 180.0) % 360.0 - 180.0
        fault = Fault(
            fault="same_run_twice",
            logs=(run.trial.name,),
            text=(
                f"{run.trial.name} is the same run as {first.trial.name} by another sensor: the positions differ by "
                f"{offset:.3g} deg{deviation} and by noise, and both have the same {shared}."
            ),
            size=offset,
            unit="deg",
            remedy="counted_once",
        )
        yield Detection(fault=fault, done="It was left out.", repair=partial(_without_run, copy=run))


def _without_run(data: RunsData, copy: Run) -> RunsData:
    return replace(data, runs=[run for run in data.runs if run is not copy])


def _common_positions(one: Run, other: Run) -> tuple[FloatArray, FloatArray]:
    """(n,) position of ``one`` and difference of ``other`` from it in rad, without NaN, on the common grid."""
    count = min(len(one.rates.position), len(other.rates.position))
    position = one.rates.position[:count]
    difference = other.rates.position[:count] - position
    known = np.isfinite(difference)
    return position[known], difference[known]


def _disagreement(one: Run, other: Run) -> tuple[float, float]:
    """RMS difference of the positions in rad about a constant, and about a deviation of the compasses.

    The constants of the deviation come from the first half. Where the vehicle turned in two runs, the positions drift
    apart with time, and a function of the heading does not continue this.
    """
    position, difference = _common_positions(one, other)
    if len(position) < _MIN_POINTS:
        return np.inf, np.inf
    harmonics = [function(k * position) for k in (1.0, 2.0) for function in (np.sin, np.cos)]
    x, half = np.column_stack((np.ones(len(position)), *harmonics)), len(position) // 2
    values = np.linalg.lstsq(x[:half], difference[:half], rcond=1e-6)[0]
    return float(np.std(difference)), float(np.sqrt(np.mean((difference - x @ values) ** 2)))


def _are_alike(one: Run, other: Run) -> bool:
    """Whether two runs have the same clock and torque, and positions that differ by noise and by their compasses."""
    period = one.rates.kernel.period
    count = min(len(one.filtered_torque), len(other.filtered_torque))
    long = max(len(one.filtered_torque), len(other.filtered_torque))
    if abs(period - other.rates.kernel.period) > 1e-3 * period or (long - count) * period > _MAX_SHIFT:
        return False
    if not one.trial.axis.angular or one.trial.rate_only or count < _MIN_POINTS:
        return False
    torques = np.column_stack((one.filtered_torque[:count], other.filtered_torque[:count]))
    torques = torques[np.isfinite(torques).all(axis=1)]
    if not np.abs(torques).any():
        return False
    tolerance = _COMMAND_TOLERANCE * float(np.abs(torques).max())
    same = float(np.mean(np.abs(torques[:, 0] - torques[:, 1]) <= tolerance))
    noise = float(np.linalg.norm([run.rates.position_noise for run in (one, other)]))
    limit = _SENSOR_RATIO * noise * float(np.linalg.norm(one.rates.kernel.value))
    return same >= _COMMAND_SHARE and min(_disagreement(one, other)) < limit


def _at_once(one: Run, other: Run) -> bool:
    """Whether both runs began at the same absolute time: one vehicle does one run at a time."""
    first, second = one.trial.start_epoch, other.trial.start_epoch
    return first is not None and second is not None and abs(first - second) < one.rates.kernel.period


def _unexplained_motion(run: Run) -> float:
    """RMS position in rad that a flexible model of this run leaves unexplained; 0 for a run with gaps.

    Two runs of one programme share the error of any simple model. The motion is therefore fitted by the response to
    past torque of any shape, different for both directions, by drag and by torques of the angle, all integrated twice.
    """
    kernel, count = run.rates.kernel, len(run.filtered_torque)
    apart, rows = max(round(_TAP / (kernel.cutoff * kernel.period)), 1), np.arange(count)
    rate, position = run.rates.rate, run.rates.position
    forces = [np.ones(count), rate, np.abs(rate) * rate, np.sin(position), np.cos(position)]
    for tap in range(_TAPS):
        torque = run.filtered_torque[(rows - tap * apart).clip(0)]
        forces += [torque, np.abs(torque)]
    known = np.flatnonzero(np.isfinite(np.column_stack((*forces, position))).all(axis=1))
    if len(known) < _MIN_COMMON or known[-1] - known[0] >= len(known):
        return 0.0
    integrated = np.cumsum(np.cumsum(np.column_stack(forces)[known], axis=0), axis=0)
    x = np.column_stack((integrated, rows[known], np.ones(len(known))))
    x /= np.linalg.norm(x, axis=0).clip(1e-300)
    rest = position[known] - x @ np.linalg.lstsq(x, position[known], rcond=1e-10)[0]
    return float(np.sqrt(np.mean(rest**2)))


DETECTORS: Detectors = {"campaign": (_detect,), "runs": (_detect_sensor,)}
