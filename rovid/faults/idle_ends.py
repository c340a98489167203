"""Long rest, or motion by other hands, before the first command of a log or after its last.

The stretch without thrust at an end of a log is idle from the instant at which the vehicle has come to rest: a
coast-down is a test. It is idle as well from the instant at which the vehicle is moved without a command.
"""

from collections.abc import Iterator
from functools import partial

from rovid.faults.base import Detection, Detectors, RunsData
from rovid.faults.quick_model import log_name
from rovid.faults.several_releases import FreeStretch, cut_out, free_motion, log_starts
from rovid.trial.fault import Fault

# Multiples of the rest that is kept, share of the log and share of all logs from which rest is long: shorter rest next
# to a test is usual and useful. After the coast-downs of 30 undamaged campaigns it took up to 23 s. Convention.
_LONG_RESTS, _SHARE, _SHARE_OF_ALL = 2.5, 0.25, 0.04


def _detect(data: RunsData) -> Iterator[Detection[RunsData]]:
    if data.vehicle.axis.self_righting:
        return
    motion, starts = free_motion(tuple(data.runs), data.vehicle), log_starts(data.runs)
    total = sum(run.trial.duration for run in data.runs)
    last = {log_name(run): run for run in sorted(data.runs, key=lambda run: run.trial.campaign_time)}
    for run in data.runs:
        name = log_name(run)
        offset = run.trial.campaign_time - starts[name]
        ends = [one for one in motion.stretches(run) if (one.first and not offset) or (one.last and run is last[name])]
        idle = []
        for one in ends:
            begin, end = span = _interval(one, run.trial.duration)
            long = max(_LONG_RESTS * one.kept, _SHARE * run.trial.duration, _SHARE_OF_ALL * total)
            if one.hand or end - begin > long:
                idle.append((one, span))
        if not idle:
            continue
        seconds = sum(end - begin for _, (begin, end) in idle)
        what = "is moved without a command" if any(one.hand for one, _ in idle) else "rests"
        where = " and ".join(f"from {offset + begin:.1f} to {offset + end:.1f} s" for _, (begin, end) in idle)
        fault = Fault(
            fault="idle_ends",
            logs=(name,),
            at=tuple(offset + begin for _, (begin, _) in idle),
            size=seconds,
            unit="s",
            text=f"{name}: no actuator pushes {where}, and the vehicle {what}.",
            remedy="cut",
        )
        repair = partial(cut_out, run=run, intervals=[span for _, span in idle])
        yield Detection(fault=fault, done="That was cut off.", repair=repair)


def _interval(stretch: FreeStretch, duration: float) -> tuple[float, float]:
    """Interval in s to cut off, without the rest that stays next to a test."""
    if stretch.first:
        last = stretch.hand[1] if stretch.hand else stretch.end - stretch.kept
        rests = stretch.hand or stretch.rest <= stretch.begin + stretch.kept
        return 0.0 if rests else stretch.rest + stretch.kept, min(max(last, stretch.end - stretch.kept), stretch.end)
    begin = stretch.rest + stretch.kept
    return min(begin, stretch.hand[0]) if stretch.hand else begin, duration


DETECTORS: Detectors = {"runs": (_detect,)}
