"""`rovid check`: facts and problems of each log, and advice before a fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from rovid.core.errors import RovidError
from rovid.preflight.advice import Advice, advise
from rovid.preflight.clock_alignment import ClockOffsets
from rovid.preflight.clock_offsets import estimate_clock_offsets
from rovid.preflight.command_effects import ThrusterCheck, check_thrusters
from rovid.preflight.feedback_detection import Feedback, detect_feedback
from rovid.readers import find_logs, read_trials
from rovid.readers.campaign import without_duplicates
from rovid.signals.rates import white_noise
from rovid.signals.segments import find_holds, find_sines
from rovid.trial.config import Config
from rovid.trial.trial import Remark, Trial


@dataclass(frozen=True, kw_only=True)
class LogCheck:
    """Facts of each readable log, problems of the others, and findings on all logs together.

    ``advice`` is sorted by severity. It rests on ``feedback``, on the ``clocks`` of joined files and on the check of
    each of the ``thrusters``.
    """

    rows: tuple[tuple[Trial, dict[str, Any]], ...]
    problems: dict[str, str]
    remarks: tuple[Remark, ...]
    advice: tuple[Advice, ...]
    feedback: tuple[Feedback, ...] = ()
    clocks: ClockOffsets = field(default_factory=ClockOffsets)
    thrusters: tuple[ThrusterCheck, ...] = ()

    @property
    def verdict(self) -> Literal["go", "care", "no_go"]:
        """Whether the logs are ready for a fit."""
        weights = {one.weight for one in self.advice}
        if self.problems or not self.rows or "grave" in weights:
            return "no_go"
        return "care" if "care" in weights else "go"


def check_logs(paths: Sequence[Path], config: Config) -> LogCheck:
    """Check all logs. Each log is read by itself: an unreadable log does not hide the others."""
    found, remarks = find_logs(paths, config)
    rows: list[tuple[Trial, dict[str, Any]]] = []
    problems = {}
    for name, path in found:
        try:
            rows += [(trial, _facts(trial, config)) for trial in read_trials(path, config, name, remarks)]
        except RovidError as error:
            problems[name] = str(error)
    trials = without_duplicates([trial for trial, _ in rows], remarks)
    feedback = detect_feedback(trials, config.vehicle)
    clocks = estimate_clock_offsets(trials, config)
    thrusters = check_thrusters(trials, config.vehicle)
    return LogCheck(
        rows=tuple(rows),
        problems=problems,
        remarks=tuple(remarks),
        advice=tuple(advise(trials, config.vehicle, feedback, clocks, thrusters, all_read=not problems)),
        feedback=tuple(feedback),
        clocks=clocks,
        thrusters=tuple(thrusters),
    )


def _facts(trial: Trial, config: Config) -> dict[str, Any]:
    torque = config.vehicle.torque(trial)
    position = trial.position[trial.measured]
    measured = position
    if trial.rate_only and trial.rate is not None:
        measured = trial.rate[trial.measured]
    return {
        "duration": trial.duration,
        "samples": int(trial.measured.sum()),
        "sample_rate": 1.0 / trial.sampling_interval,
        "measured": config.measured_signal,
        "noise": white_noise(measured),
        "travel": float(np.sum(np.abs(np.diff(position)))),
        f"{trial.axis.force_name}_range": [float(torque.min()), float(torque.max())],
        "held_commands": len(find_holds(trial, config.vehicle, torque)),
        "sine_runs": len(find_sines(trial, torque)),
        "remarks": [remark_document(remark) for remark in trial.remarks],
    }


def remark_document(remark: Remark) -> dict[str, Any]:
    """JSON document of one remark of a reader."""
    return {"kind": remark.kind, "count": remark.count, "text": remark.text}
