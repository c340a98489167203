"""Several tests in one log: free decays one after another, or a hand that turns the vehicle between two tests.

An axis that rights itself is tested by releases: each decay of at least four half swings is a test. In other axes the
vehicle gains speed between two tests while no actuator pushes, by far more than the disturbances of all logs explain.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from rovid.faults.base import Detection, FaultKind, RunsData, TrialData
from rovid.faults.free_stretches import FreeStretch, free_motion, log_starts, without_intervals
from rovid.faults.quick_model import log_name
from rovid.signals.preprocessing import Run
from rovid.signals.segments import find_releases
from rovid.trial.fault import Fault


def _detect_decays(data: TrialData) -> Iterator[Detection[TrialData]]:
    trial = data.trial
    if trial.has_actuators or not trial.axis.self_righting:
        return
    releases = find_releases(trial)
    if len(releases) < 2:
        return
    spans = [(float(trial.time[rows][0]), float(trial.time[rows][-1])) for rows in releases]
    text = f"{trial.name}: the log holds {len(spans)} releases, at {_instants([begin for begin, _ in spans])} s."
    cuts = tuple(sorted({*trial.cuts, *(begin for begin, _ in spans)}))
    yield Detection(
        fault=_fault(trial.name, tuple(begin for begin, _ in spans), text, len(spans)),
        done="The log was cut there.",
        repair=lambda data: replace(data, trial=replace(data.trial, cuts=cuts)),
    )


def _detect_hands(data: RunsData) -> Iterator[Detection[RunsData]]:
    if data.vehicle.axis.self_righting:
        return
    motion, starts = free_motion(tuple(data.runs), data.vehicle), log_starts(data.runs)
    for run in data.runs:
        stretches = [one for one in motion.stretches(run) if one.hand and not one.first and not one.last]
        hands = [one.hand[0] for one in stretches if one.hand]
        if not hands:
            continue
        offset = run.trial.campaign_time - starts[log_name(run)]
        at = tuple(offset + instant for instant in hands)
        text = (
            f"{log_name(run)}: the log holds {len(hands) + 1} tests. Between them, at {_instants(at)} s, the vehicle "
            f"was moved without a command, at up to {_shown(run, max(one.rate for one in stretches))}."
        )
        yield Detection(
            fault=_fault(log_name(run), at, text, len(hands) + 1),
            done="The log was cut there.",
            repair=partial(_cut, run=run, intervals=[_interval(one) for one in stretches]),
        )


def _interval(stretch: FreeStretch) -> tuple[float, float]:
    """Interval in s to leave out: from the hand, or from long rest before it, to its end, or to long rest after it."""
    first, last = stretch.hand or (stretch.begin, stretch.end)
    return min(first, stretch.rest + stretch.kept), min(max(last, stretch.end - stretch.kept), stretch.end)


def _cut(data: RunsData, run: Run, intervals: list[tuple[float, float]]) -> RunsData:
    runs: list[Run] = []
    for one in data.runs:
        runs += without_intervals(run, intervals, data.vehicle) if one is run else [one]
    return replace(data, runs=runs)


def _fault(log: str, at: tuple[float, ...], text: str, count: int) -> Fault:
    return Fault(fault="several_releases", logs=(log,), at=at, size=float(count), unit="tests", text=text, remedy="cut")


def _shown(run: Run, rate: float) -> str:
    axis = run.trial.axis
    return f"{np.rad2deg(rate):.2g} deg/s" if axis.angular else f"{rate:.2g} {axis.rate_unit}"


def _instants(at: tuple[float, ...] | list[float]) -> str:
    return ", ".join(f"{instant:.1f}" for instant in at)


FAULT = FaultKind(
    id="several_releases",
    title="Several releases in one log",
    stage="trial",
    detect=_detect_decays,
    false_alarms="none: a decay does not grow again to a multiple of its last swings.",
)
FURTHER = (
    FaultKind(
        id="several_releases",
        title="Several tests in one log, with a hand that moves the vehicle between them",
        stage="runs",
        detect=_detect_hands,
        false_alarms="below one in 10^6 logs for Gaussian disturbances, and none in 60 undamaged campaigns.",
    ),
)
