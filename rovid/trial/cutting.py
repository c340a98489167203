"""Parts of a log: excluded intervals and cuts at faults."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray, IntArray
from rovid.trial.log_files import is_called
from rovid.trial.trial import Remark, Trial

# Measured positions that a part of a log needs to be kept.
_MIN_READINGS = 10
# A command that changes across a hole by less than this share of its range has not changed.
_SAME = 0.01
# Ratio of the change across a hole to the usual change over as many intervals, up to which the command is smooth.
_SMOOTH = 3.0
# Sampling intervals; instants as close as this are one.
_TICK = 1e-3
# Sampling intervals; commands in longer holes are unknown even if they are the same before and after.
_LONG_INTERVALS = 20.0


@dataclass(frozen=True, kw_only=True)
class Exclusion:
    """An interval of a log that rovid.toml excludes: a caught tether, a hand on the vehicle."""

    log: str  #: Name of the log, or a pattern such as "hold_*.csv".
    #: ``begin``, ``end``: s from the beginning of the log.
    begin: float = 0.0
    end: float = np.inf
    reason: str = ""  #: Text for people; may be empty.

    def __str__(self) -> str:
        """The interval, as "12 to 30.5 s"."""
        if np.isfinite(self.end):
            return f"{self.begin:g} to {self.end:g} s"
        if self.begin > 0.0:
            return f"all from {self.begin:g} s on"
        return "all of it"

    def applies_to(self, name: str) -> bool:
        """Whether the log ``name`` is meant, with or without its folder."""
        return is_called(name, self.log)


def split(trial: Trial, exclusions: Sequence[Exclusion] = ()) -> list[Trial]:
    """The parts of ``trial`` between its cuts and exclusions, without unknown commands; none if all is excluded."""
    own = [exclusion for exclusion in exclusions if exclusion.applies_to(trial.name)]
    if not own and not trial.cuts and not trial.unknown:
        return [trial]
    trial, excluded = _without_unknown(trial)
    lost = np.flatnonzero(excluded)
    remarks = list(trial.remarks)
    for exclusion in own:
        covered = (exclusion.begin <= trial.time) & (trial.time <= exclusion.end)
        excluded |= covered
        reason = f": {exclusion.reason.rstrip('.')}." if exclusion.reason else ", as rovid.toml says."
        text = f"Left out, {exclusion}{reason}"
        remarks.append(Remark(kind="left out", count=int(covered.sum()), text=text))
    # Each row belongs to the part with its number; rows of number zero are left out.
    begins = np.concatenate(([True], excluded[:-1])) & ~excluded
    cuts = np.searchsorted(trial.time, trial.cuts)
    begins[cuts[cuts < len(begins)]] = True
    part = np.where(excluded, 0, np.cumsum(begins))
    edges = np.flatnonzero(np.diff(part, prepend=0, append=0))
    spans = [slice(*pair) for pair in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True) if part[pair[0]]]
    kept = measured_spans(trial, spans)
    trial = replace(trial, cuts=(), unknown=())
    parts: list[Trial] = []
    for rows in kept:
        span, before = trial.time[rows], lost[lost < rows.start]
        name = trial.name if len(kept) == 1 else f"{trial.name}, {span[0]:.1f} to {span[-1]:.1f} s"
        # The commands since the last lost row are known.
        one = trial.part(rows, name, int(before[-1]) + 1 if before.size else 0)
        # The first part carries the remarks and the faults.
        parts.append(replace(one, remarks=(), faults=()) if parts else replace(one, remarks=tuple(remarks)))
    return parts


def measured_spans(trial: Trial, spans: Iterable[slice]) -> list[slice]:
    """The ``spans`` of rows from their first to their last measurement, without those with few measurements."""
    measured = np.flatnonzero(trial.measured)
    found = []
    for rows in spans:
        first, last = np.searchsorted(measured, (rows.start, rows.stop)).tolist()
        if last - first >= _MIN_READINGS:
            found.append(slice(int(measured[first]), int(measured[last - 1]) + 1))
    return found


def _without_unknown(trial: Trial) -> tuple[Trial, BoolArray]:
    """``trial`` with commands that run on smoothly through holes, cut at other holes; and (n,) rows to leave out.

    The log is cut where a command stepped in a hole, because the instant of the step is unknown. A command that changes
    at each of its ticks is interpolated at the ticks within the hole.
    """
    time, commands = trial.time, trial.commands.copy()
    excluded = np.zeros(len(time), dtype=bool)
    ticks, usual = _changes(time, commands)
    same = _SAME * np.ptp(commands, axis=0)
    interval = trial.sampling_interval
    instants, values, cuts = list[FloatArray](), list[FloatArray](), list(trial.cuts)
    for begin, end in trial.unknown:
        before, after = int(np.searchsorted(time, begin, side="right")) - 1, int(np.searchsorted(time, end))
        is_long = end - begin > _LONG_INTERVALS * interval
        if before < 0 or after >= len(time) or is_long:
            excluded[max(before + 1, 0) : after] = True
            cuts += time[after : after + 1].tolist()
            continue
        change = np.abs(commands[after] - commands[before])
        if np.all(change <= same):
            continue
        # A command that changes less often than once in such a hole steps.
        smooth = np.where(ticks <= end - begin, _SMOOTH * usual * (end - begin) / ticks, 0.0)
        if np.any(change > np.maximum(same, smooth)):
            excluded[before + 1 : after] = True
            cuts.append(time[after])
            continue
        tick = float(ticks[change > same].min())
        instants.append(begin + tick * np.arange(1.0, round((end - begin) / tick)))
        share = tick * np.floor((time[before + 1 : after] - begin) / tick + _TICK) / (end - begin)
        commands[before + 1 : after] = commands[before] + share[:, np.newaxis] * (commands[after] - commands[before])
        at = instants[-1][:, np.newaxis]
        values.append(commands[before] + (at - begin) / (end - begin) * (commands[after] - commands[before]))
    moved = replace(trial, commands=commands, cuts=tuple(sorted(set(cuts))))
    if not instants:
        return moved, excluded
    added, held = np.concatenate(instants), np.concatenate(values)
    rows = np.searchsorted(time, added)
    # Rows of another clock may lie at the ticks.
    is_new = np.minimum(np.abs(time[rows] - added), np.abs(added - time[rows - 1])) > _TICK * interval
    rows = rows[is_new]
    return with_rows(moved, added[is_new], held[is_new], rows), np.insert(excluded, rows, False)


def _changes(time: FloatArray, commands: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(k,) median time between the changes of each command in s, infinite without any, and (k,) usual large change."""
    ticks, usual = np.full(commands.shape[1], np.inf), np.zeros(commands.shape[1])
    for column, changes in enumerate(np.abs(np.diff(commands, axis=0)).T):
        rows = np.flatnonzero(changes)
        if len(rows) > 1:
            ticks[column], usual[column] = np.median(np.diff(time[rows])), np.percentile(changes[rows], 90.0)
    return ticks, usual


def with_rows(trial: Trial, instants: FloatArray, commands: FloatArray, at: IntArray) -> Trial:
    """``trial`` with rows at the (n,) ``instants`` in s, before its rows ``at``, with the (n, k) ``commands``."""
    unmeasured = dict.fromkeys(("position", "rate"), np.nan)
    rows = {}
    for name, values in trial.arrays().items():
        rows[name] = np.insert(values, at, unmeasured.get(name, values[at]), axis=0)
    rows["time"] = np.insert(trial.time, at, instants)
    rows["commands"] = np.insert(trial.commands, at, commands, axis=0)
    extras = {name: np.insert(values, at, values[at]) for name, values in trial.extras.items()}
    return replace(trial, **rows, extras=extras)
