"""Stretches of logs that are left out, because rovid.toml says so: a tether that caught, a hand on the vehicle."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rovid.trial.multi_file_trials import is_called
from rovid.trial.trial import Remark, Trial

# Readings without which a part of a log says nothing.
_FEWEST = 10


@dataclass(frozen=True, kw_only=True)
class Exclusion:
    """What is left out of a log.

    Attributes
    ----------
    log
        Name of the log, or a pattern such as "hold_*.csv".
    begin, end
        s from the beginning of the log.
    reason
        For people; may be empty.
    """

    log: str
    begin: float = 0.0
    end: float = np.inf
    reason: str = ""

    def __str__(self) -> str:
        """When, as "12 to 30.5 s"."""
        if np.isfinite(self.end):
            return f"{self.begin:g} to {self.end:g} s"
        return f"all from {self.begin:g} s on" if self.begin > 0.0 else "all of it"

    def applies_to(self, name: str) -> bool:
        """Whether it is of the log called ``name``, which may stand in a subfolder."""
        return is_called(name, self.log)


def apply_exclusions(trial: Trial, stretches: Sequence[Exclusion]) -> list[Trial]:
    """What is left of ``trial``, each stretch between two that are left out as a trial by itself; none where all is."""
    own = [stretch for stretch in stretches if stretch.applies_to(trial.name)]
    if not own:
        return [trial]
    out = np.zeros(len(trial.time), dtype=bool)
    for stretch in own:
        out |= (stretch.begin <= trial.time) & (trial.time <= stretch.end)
    bounds = np.flatnonzero(np.diff(np.concatenate(([True], out, [True])).astype(int)))
    where = [slice(int(first), int(end)) for first, end in bounds.reshape(-1, 2)]
    where = [part for part in where if trial.measured[part].sum() >= _FEWEST]
    remarks = (*trial.remarks, *_remarks(trial, own))
    parts: list[Trial] = []
    for part in where:
        span = trial.time[part]
        name = trial.name if len(where) == 1 else f"{trial.name}, {span[0]:.1f} to {span[-1]:.1f} s"
        # What was noticed is said once.
        parts.append(replace(trial.part(part, name), remarks=() if parts else remarks))
    return parts


def _remarks(trial: Trial, own: Sequence[Exclusion]) -> Iterator[Remark]:
    for stretch in own:
        inside = (stretch.begin <= trial.time) & (trial.time <= stretch.end)
        why = f": {stretch.reason.rstrip('.')}." if stretch.reason else ", as rovid.toml says."
        yield Remark(kind="left out", count=int(inside.sum()), text=f"Left out, {stretch}{why}")
