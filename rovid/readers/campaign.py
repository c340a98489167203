"""All logs of a campaign as trials: read, without duplicates, in order of time."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.budget import Budget, ProgressCallback
from rovid.core.errors import LogError
from rovid.core.spmd import ForkedCall
from rovid.faults.base import CampaignData, examine
from rovid.faults.catalogue import fault_kinds
from rovid.readers.discover import file_size, find_logs, left_out
from rovid.readers.formats import read_log
from rovid.trial.axis import Axis
from rovid.trial.config import Config, find_config, load_config
from rovid.trial.cutting import split
from rovid.trial.fault import Fault
from rovid.trial.trial import Campaign, Remark, Trial

# Bytes; larger logs are not prefetched.
_LARGE = 20_000_000

# Signature of `read_trials`.
TrialReader = Callable[[Path, Config, str, list[Remark]], list[Trial]]


def read_campaign(
    paths: Sequence[Path],
    config: Config,
    report: ProgressCallback = lambda _: None,
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
    report
        Called with progress messages.
    reading
        Function that reads a log; `read_trials` by default.
    without
        Files to ignore.
    """
    logs, remarks = find_logs(paths, config, without)
    read = reading or read_trials
    trials = []
    budget = Budget(report=report)
    began = budget.clock()
    for done, (name, path) in enumerate(logs):
        budget.tell("Reading the logs", done, len(logs), began, "log")
        trials += read(path, config, name, remarks)
    return campaign_of(trials, config, paths, remarks)


def campaign_of(
    trials: Sequence[Trial], config: Config, sources: Sequence[Path] = (), remarks: Sequence[Remark] = ()
) -> Campaign:
    """The ``trials`` as one campaign: without duplicates, and with what all of them together show.

    Raises
    ------
    LogError
        There are no trials.
    """
    if not trials:
        raise LogError("nothing is left of these logs.", where=config.path, mend="Correct [[leave_out]].")
    kept, faults = examine_campaign(trials, config)
    medians = _medians(kept)
    placed = zip(kept, _campaign_times(kept), strict=True)
    together = tuple(replace(trial, reference=medians, campaign_time=time) for trial, time in placed)
    return Campaign(trials=together, sources=tuple(sources), remarks=tuple(remarks), faults=faults)


def examine_campaign(trials: Sequence[Trial], config: Config) -> tuple[Sequence[Trial], tuple[Fault, ...]]:
    """The trials that stay after the remedies, and the faults of single logs and of all logs together."""
    own = [fault for trial in trials for fault in trial.faults]
    if any(fault.fault == "scaled_heading" for fault in own):
        # Where such a heading wraps only once in a log, the wrap looks like a step.
        own = [fault for fault in own if fault.fault != "heading_step"]
    data = CampaignData(trials=trials, vehicle=config.vehicle)
    data, faults = examine(fault_kinds("campaign"), data, config.faults)
    return data.trials, (*own, *faults)


def read_trials(path: Path, config: Config, name: str, remarks: list[Remark]) -> list[Trial]:
    """The used parts of a log: one trial, or several with exclusions between them."""
    parts = split(read_log(path, config, name), config.exclusions)
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
