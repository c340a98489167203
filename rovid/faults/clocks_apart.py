"""Commands and motion on clocks with an offset: the vehicle moves before its commands change, which is impossible.

Where the motion comes later, a delay of the thrusters looks the same. With commands and motion in joined files, such a
delay is listed, and stays a rival of every delay or lag.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from rovid.core.formatting import plus_minus
from rovid.faults.base import Detection, FaultKind, RunsData, named
from rovid.faults.quick_model import log_name
from rovid.faults.response_delay import ResponseDelay, response_delay
from rovid.signals.preprocessing import Run
from rovid.trial.fault import Fault

# Smallest offset in periods of the cut-off, in sampling intervals, and in standard errors; and the least share of the
# mean square residual that it explains. Feedback and waves move the delay of undamaged logs by one sampling
# interval and explain 8 % at most (60 campaigns).
_MIN_OFFSET, _INTERVALS, _SIGNIFICANT, _EXPLAINED = 0.04, 2.0, 5.0, 0.2
# Probability that a delay of joined files is an offset of their clocks: the logs do not show which.
_RIVAL = 0.5


def _detect(data: RunsData) -> Iterator[Detection[RunsData]]:
    parts: dict[str, list[Run]] = {}
    for run in data.runs:
        parts.setdefault(log_name(run), []).append(run)
    found = response_delay(data.runs) if data.runs else None
    if found is not None and _is_offset(-found.delay, found, data.runs):
        yield Detection(fault=_early_motion(tuple(parts), found))
        return
    if found is None:
        return
    for name, runs in parts.items():
        # A log alone hardly determines delay and model; the model of all logs is biased by hidden causes. Both agree.
        known, own = response_delay(runs, found.values), response_delay(runs)
        if known and own and all(_is_offset(-each.delay, each, runs) for each in (known, own)):
            yield Detection(fault=_early_motion((name,), own))
    joined = all(run.trial.companion_files for run in data.runs)
    if joined and _is_offset(found.delay, found, data.runs):
        yield Detection(fault=_late_motion(tuple(parts), found))


def _early_motion(logs: Sequence[str], found: ResponseDelay) -> Fault:
    text = (
        f"{named(logs)}: the vehicle moves {plus_minus(-found.delay, found.error)} s before its commands change, which "
        "is impossible. The clock of the commands is ahead by that, and by the delay of the thrusters in addition. Put "
        "commands and motion on one clock, or shift one of them."
    )
    return Fault(
        fault="clocks_apart",
        logs=tuple(logs),
        text=text,
        size=found.delay,
        standard_error=found.error,
        unit="s",
        stops=True,
    )


def _late_motion(logs: Sequence[str], found: ResponseDelay) -> Fault:
    text = (
        f"{named(logs)}: the vehicle moves {plus_minus(found.delay, found.error)} s after the commands of another "
        "file: a delay, or a clock that is behind. The logs do not show which."
    )
    return Fault(
        fault="clocks_apart",
        logs=tuple(logs),
        text=text,
        size=found.delay,
        standard_error=found.error,
        unit="s",
        confidence=_RIVAL,
    )


def _is_offset(offset: float, found: ResponseDelay, runs: Sequence[Run]) -> bool:
    least = max(_MIN_OFFSET / runs[0].rates.kernel.cutoff, _least_offset(runs), _SIGNIFICANT * found.error)
    return offset > least and found.improvement > _EXPLAINED


def _least_offset(runs: Sequence[Run]) -> float:
    """s: intervals of the motion; in joined logs an interval of the commands, by which a change may be earlier."""
    interval = float(max(run.trial.sampling_interval for run in runs))
    if not all(run.trial.companion_files for run in runs):
        return _INTERVALS * interval
    changes = [run.trial.time[1:][(np.diff(run.trial.commands, axis=0) != 0.0).any(axis=1)] for run in runs]
    steps = [float(np.percentile(np.diff(change), 5.0)) for change in changes if len(change) > 2]
    return max(_INTERVALS * interval, interval + min(steps, default=interval))


FAULT = FaultKind(
    id="clocks_apart",
    title="Clocks with an offset",
    stage="runs",
    detect=_detect,
    false_alarms="none in 60 campaigns: no undamaged log moves two sampling intervals before its commands.",
)
