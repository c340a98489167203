"""Gaps of the measured signal: intervals between readings that are much longer than usual. Nothing is interpolated."""

from collections.abc import Iterator

import numpy as np

from rovid.faults.base import Detection, Detectors, SignalData
from rovid.trial.fault import Fault
from rovid.trial.segments import gap_limit


def _detect(data: SignalData) -> Iterator[Detection[SignalData]]:
    if not data.measured or len(data.time) < 2:
        return
    # Readings that another fault left out are no gap.
    time = data.logged
    intervals = np.diff(time)
    begins, ends = np.array(data.unknown).reshape(-1, 2).T
    gaps = np.flatnonzero(intervals > gap_limit(intervals))
    # Where nothing at all was logged, rows are lost.
    lost = [np.any((time[row] >= begins) & (time[row + 1] <= ends)) for row in gaps]
    gaps = gaps[~np.array(lost, dtype=bool)]
    if not gaps.size:
        return
    total, longest = float(intervals[gaps].sum()), int(gaps[np.argmax(intervals[gaps])])
    at = time[gaps] - time[0]
    several = f"in {len(gaps)} gaps, {total:.1f} s in all, the longest" if len(gaps) > 1 else "in a gap"
    text = (
        f"{data.log}: the {data.name} is absent {several} of {intervals[longest]:.1f} s "
        f"from {time[longest] - time[0]:.1f} s on."
    )
    fault = Fault(
        fault="heading_gaps", logs=(data.log,), at=tuple(at.tolist()), size=total, unit="s", text=text, remedy="unknown"
    )
    yield Detection(fault=fault, done="Gaps were not filled.")


DETECTORS: Detectors = {"signal": (_detect,)}
