"""Parts of a log: without excluded intervals, cut where it has a fault, with unknown commands left out."""

from __future__ import annotations

from collections.abc import Sequence
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
# s and sampling intervals; commands in longer holes are unknown even if they are the same before and after.
_LONG_SECONDS, _LONG_INTERVALS = 2.0, 20.0


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
    kept = [rows for rows in spans if trial.measured[rows].sum() >= _MIN_READINGS]
    trial = replace(trial, cuts=(), unknown=())
    if len(kept) == 1:
        return [replace(trial.part(kept[0], trial.name), remarks=tuple(remarks))]
    parts: list[Trial] = []
    for rows in kept:
        span = trial.time[rows]
        one = trial.part(rows, f"{trial.name}, {span[0]:.1f} to {span[-1]:.1f} s")
        # The first part carries the remarks and the faults.
        parts.append(replace(one, remarks=(), faults=()) if parts else replace(one, remarks=tuple(remarks)))
    return parts


def _without_unknown(trial: Trial) -> tuple[Trial, BoolArray]:
    """``trial`` with commands that run on smoothly through holes, cut at other holes; and (n,) rows to leave out.

    The log is cut where a command stepped in a hole, because the instant of the step is unknown. A command that changes
    all the time changes half an interval after the middle of the hole: held between the lost rows, which lie an
    interval apart up to the end of the hole, it would have had the same mean.
    """
    time, commands = trial.time, trial.commands
    excluded = np.zeros(len(time), dtype=bool)
    usual = np.percentile(np.abs(np.diff(commands, axis=0)), 90.0, axis=0) if len(time) > 1 else 0.0
    same = _SAME * np.ptp(commands, axis=0)
    interval = trial.sampling_interval
    middles, cuts = list[float](), list(trial.cuts)
    for begin, end in trial.unknown:
        before, after = int(np.searchsorted(time, begin, side="right")) - 1, int(np.searchsorted(time, end))
        is_long = end - begin > max(_LONG_SECONDS, _LONG_INTERVALS * interval)
        if before < 0 or after >= len(time) or is_long:
            excluded[max(before + 1, 0) : after] = True
            cuts += time[after : after + 1].tolist()
            continue
        change = np.abs(commands[after] - commands[before])
        if np.all(change <= same):
            continue
        if np.all(change <= np.maximum(same, _SMOOTH * usual * max(1.0, (end - begin) / interval))):
            middles.append(min(0.5 * (begin + end + interval), end - 1e-3 * interval))
        else:
            excluded[before + 1 : after] = True
            cuts.append(time[after])
    moved = replace(trial, cuts=tuple(sorted(set(cuts))))
    if not middles:
        return moved, excluded
    at = np.searchsorted(time, middles)
    return _with_changes(moved, np.array(middles), at), np.insert(excluded, at, False)


def _with_changes(trial: Trial, middles: FloatArray, at: IntArray) -> Trial:
    """``trial`` with an instant at each of ``middles`` (s), before row ``at``, at which the next commands begin."""
    unmeasured = dict.fromkeys(("position", "rate"), np.nan)
    rows = {
        name: np.insert(values, at, unmeasured.get(name, values[at]), axis=0) for name, values in trial.arrays().items()
    }
    rows["time"] = np.insert(trial.time, at, middles)
    extras = {name: np.insert(values, at, values[at]) for name, values in trial.extras.items()}
    return replace(trial, **rows, extras=extras)
