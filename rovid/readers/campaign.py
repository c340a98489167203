"""All logs of a campaign as trials: read, without duplicates, in order of time."""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import LogError
from rovid.core.spmd import ForkedCall
from rovid.readers.cleaning import gap_limit
from rovid.readers.discover import file_size, find_logs, left_out
from rovid.readers.formats import read_log
from rovid.trial.axis import Axis
from rovid.trial.config import Config, find_config, load_config
from rovid.trial.trial import Campaign, Remark, Trial, apply_exclusions

# Bytes; larger logs get a progress bar and are not prefetched.
_LARGE = 20_000_000

Progress = Callable[[Path, int], None]
# Signature of `read_trials`.
TrialReader = Callable[[Path, Config, str, list[Remark]], list[Trial]]


def read_campaign(
    paths: Sequence[Path],
    config: Config,
    progress: Progress | None = None,
    *,
    reading: TrialReader | None = None,
    without: Collection[Path] = (),
) -> Campaign:
    """Every log in ``paths``: files, and folders, searched with their subfolders except hidden ones.

    In a folder, CSV files that are no logs (thrust curves, tables of results, files without a mapped column) are left
    out; the last kind is remarked upon, and so are files of a format for which rovid.toml maps nothing. A missing path,
    an unreadable log or no log raises `LogError`, an unmapped format `ConfigError`.

    Parameters
    ----------
    progress
        Called with each file and its size in bytes after it is read. By default a bar is shown on stderr for large
        logs if stderr is a terminal.
    reading
        Function that reads a log; `read_trials` by default.
    without
        Files to ignore.
    """
    logs, remarks = find_logs(paths, config, without)
    read = reading or read_trials
    trials = []
    with _progress_of(logs, progress) as advance:
        for name, path in logs:
            trials += read(path, config, name, remarks)
            advance(path, file_size(path))
    if not trials:
        raise LogError("nothing is left of these logs.", where=config.path, mend="Correct [[leave_out]].")
    kept = without_duplicates(trials, remarks)
    medians = _medians(kept)
    placed = zip(kept, _campaign_times(kept), strict=True)
    together = tuple(replace(trial, reference=medians, campaign_time=time) for trial, time in placed)
    return Campaign(trials=together, sources=tuple(paths), remarks=tuple(remarks))


def read_trials(path: Path, config: Config, name: str, remarks: list[Remark]) -> list[Trial]:
    """The used parts of a log: one trial, or several with exclusions between them."""
    parts = apply_exclusions(read_log(path, config, name), config.exclusions)
    if not parts:
        remarks.append(left_out(name, "rovid.toml excludes all of it"))
    return parts


def _campaign_times(trials: Sequence[Trial]) -> list[float]:
    """Start of each trial in s after the first; one after the other by name unless all logs have absolute times."""
    starts = [trial.start_epoch for trial in trials if trial.start_epoch is not None]
    if len(starts) == len(trials):
        first = min(starts, default=0.0)
        return [start - first for start in starts]
    durations = [trial.duration for trial in trials[:-1]]
    return [0.0, *np.cumsum(durations).tolist()]


def _medians(trials: Sequence[Trial]) -> dict[str, float]:
    """Median of each further channel over all trials."""
    readings: dict[str, list[FloatArray]] = {}
    for trial in trials:
        for name, values in trial.extras.items():
            readings.setdefault(name, []).append(values)
    medians = {}
    for name in sorted(readings):
        values = np.concatenate(readings[name])
        if np.isfinite(values).any():
            medians[name] = float(np.nanmedian(values))
    return medians


def _are_large(logs: Sequence[tuple[str, Path]]) -> bool:
    return sum(file_size(path) for _, path in logs) >= _LARGE


@contextmanager
def _progress_of(logs: Sequence[tuple[str, Path]], progress: Progress | None) -> Iterator[Progress]:
    """Function to call after each file."""
    if progress is not None:
        yield progress
    elif not _are_large(logs) or not sys.stderr.isatty():
        yield lambda _path, _size: None
    else:
        from rich.console import Console
        from rich.progress import Progress as Bar

        with Bar(console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task("Reading logs", total=sum(file_size(path) for _, path in logs))
            yield lambda _path, size: bar.advance(task, size)


# --- logs read by a forked child while this process imports the estimators --------------------------------------

# (path, name) -> trials, and remarks on the log.
_TrialsRead = dict[tuple[Path, str], tuple[list[Trial], list[Remark]]]


class PrefetchedReader(ForkedCall[_TrialsRead]):
    """A `TrialReader` that takes trials from a forked child, and reads the remaining logs itself.

    The child calls ``asked`` for the paths to read and the axis. This process calls ``meanwhile`` before it waits.
    """

    def __init__(self, asked: Callable[[], tuple[Sequence[Path], Axis]], meanwhile: Callable[[], object]) -> None:
        super().__init__(lambda: _read_small_logs(*asked()))
        self._meanwhile = meanwhile
        self._known: _TrialsRead | None = None

    def __call__(self, path: Path, config: Config, name: str, remarks: list[Remark]) -> list[Trial]:
        """Trials of a log; remarks on the log are appended to ``remarks``."""
        if self._known is None:
            if self.is_running:
                self._meanwhile()
            self._known = self.result() or {}
        # Removed, so that only the caller keeps the trials in memory.
        trials, found = self._known.pop((path, name), (None, []))
        if trials is None:
            return read_trials(path, config, name, remarks)
        remarks += found
        return trials


def _read_small_logs(paths: Sequence[Path], axis: Axis) -> _TrialsRead:
    config, read = load_config(find_config(paths), axis), _TrialsRead()
    logs, _ = find_logs(paths, config)
    if not _are_large(logs):
        for name, path in logs:
            remarks: list[Remark] = []
            read[path, name] = read_trials(path, config, name, remarks), remarks
    return read


# --- recordings given twice, in two formats or at two rates -----------------------------------------------------
#
# Counted twice, a run would pass for two independent runs and halve every variance. Two runs of one experiment can
# agree to a fraction of a degree, but each has its own noise; two copies of one recording have the same noise.
# Criteria: equal commands, positions within half a degree throughout, and a difference below the noise.

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


class _Recording:
    """A trial with cached quantities for comparisons with many others."""

    def __init__(self, trial: Trial) -> None:
        self.trial = trial
        rows = np.flatnonzero(trial.measured)
        self.time, self.position = trial.time[rows], trial.position[rows]

    @cached_property
    def rates(self) -> FloatArray:
        """(n,) rad/s."""
        rates: FloatArray = np.gradient(self.position, self.time)
        return rates

    @cached_property
    def gap(self) -> float:
        """Longest interval in s that is no gap."""
        return gap_limit(np.diff(self.time))

    @cached_property
    def noise(self) -> float:
        """Standard deviation of the noise in rad, by third differences without the largest tenth."""
        differences = np.sort(np.abs(np.diff(self.position, n=3)))
        kept = differences[: max(1, int(0.9 * len(differences)))]
        # A third difference has 20 variances; without the largest tenth a Gaussian keeps 0.789 of its RMS.
        return float(np.sqrt(np.mean(kept**2) / 20.0) / 0.789)

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


def without_duplicates(trials: Sequence[Trial], remarks: list[Remark]) -> list[Trial]:
    """``trials`` without copies of a recording; the copy with the most measurements stays, or else the first."""
    kept: list[_Recording] = []
    for recording in sorted(map(_Recording, trials), key=lambda one: -len(one.time)):
        original = next((other for other in kept if _is_same(other, recording)), None)
        if original is None:
            kept.append(recording)
            continue
        more = ", which has more samples" if len(original.time) > len(recording.time) else ""
        reason = f"it is the same recording as {original.trial.name}{more}"
        remarks.append(left_out(recording.trial.name, reason, kind="repeated"))
    staying = {id(recording.trial) for recording in kept}
    return [trial for trial in trials if id(trial) in staying]


def _is_same(fine: _Recording, coarse: _Recording) -> bool:
    """Whether both are copies of one recording; ``fine`` has at least as many measurements."""
    if fine.trial.commands.shape[1] != coarse.trial.commands.shape[1] or len(coarse.time) < _MIN_POINTS:
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
    return bool(is_small) and _commands_agree(fine.trial, coarse.trial, shift)


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
    shift = 0.0
    for _ in range(8):
        difference = fine.difference(time - shift, psi)
        known = np.isfinite(difference)
        rate = np.interp(time[known] - shift, fine.time, fine.rates)
        if not rate.any():
            return shift
        step = -float(rate @ difference[known]) / float(rate @ rate)
        shift += step
        if abs(shift) > _MAX_SHIFT:
            return None
        if abs(step) < 1e-6:
            break
    return shift


def _commands_agree(fine: Trial, coarse: Trial, shift: float) -> bool:
    at = np.clip(np.searchsorted(fine.time, coarse.time - shift, side="right") - 1, 0, len(fine.time) - 1)
    difference = np.abs(fine.commands[at] - coarse.commands)
    scale = np.abs(coarse.commands).max(axis=0)
    return bool(np.all(np.mean(difference <= _COMMAND_TOLERANCE * scale, axis=0) >= _COMMAND_SHARE))
