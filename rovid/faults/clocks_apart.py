"""Commands and motion on clocks with an offset: the vehicle moves before its commands change, which is impossible.

Where the motion comes later, a delay of the thrusters looks the same. With commands and motion in joined files, such a
delay is listed, and stays a rival of every delay or lag. A delay far longer than any thruster's is one of the clocks.

In a sine run a torque of the heading, as of wind, looks like a negative delay, and water that follows the hull lets the
motion begin faster than it goes on. Motion comes before its commands only if it does so with a torque of the heading
and of the past rate in the regression, too.

The model of the other logs shows the clocks of one log: a delay of the thrusters is the same in all.

The delay of a heading after a logged rate follows from the same regression, of the heading's derivative on that rate. A
navigation filter delays its heading; a fit would take that for a delay of the commands or a lag of the thrusters.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from rovid.core.formatting import plus_minus
from rovid.faults.base import Detection, Detectors, RunsData, named, without
from rovid.faults.clock_drift import clock_drift
from rovid.faults.quick_model import log_name, log_parts
from rovid.faults.response_delay import (
    FEW_BLOCKS,
    LONGEST,
    MOSTLY,
    ResponseDelay,
    ShiftedTorque,
    far_delay,
    response_delay,
)
from rovid.trial.fault import Fault
from rovid.trial.preprocessing import Run, prepare_trials
from rovid.trial.rates import integral
from rovid.trial.trial import Trial

# Time constants of the water's memory in periods of the cut-off. Shorter ones would stand for a clock that is early.
_MEMORIES = (1.0, 4.0)
#: Octaves of time constants, a basis of any slow linear response: water that swings back and forth is part of it.
OCTAVES = (1.0, 2.0, 4.0, 8.0)

# Smallest offset in periods of the cut-off, in sampling intervals, and in standard errors; and the least share of the
# mean square residual that it explains. Feedback and waves move the delay of undamaged logs by one sampling
# interval and explain 8 % at most (60 campaigns).
_MIN_OFFSET, _INTERVALS, _SIGNIFICANT, _EXPLAINED = 0.04, 2.0, 5.0, 0.2
# Least share of the mean square residual that a drift explains: at most 0.03 in 200 undamaged campaigns, half of them
# with a hidden cause.
_DRIFT_EXPLAINS = 0.05
# Logs with a majority. The clocks of one log explain 0.92 and more of the unexplained torque of 20 logs with clocks
# apart, and 0.55 and less of others: `MOSTLY` lies between. A lag may delay one log more than the others: by periods of
# the cut-off, and by delays of the others.
_MIN_LOGS, _LATE, _LAGS = 3, 0.5, 3.0
# Probability that a delay of joined files is an offset of their clocks: the logs do not show which.
_RIVAL = 0.5


def _detect(data: RunsData) -> Iterator[Detection[RunsData]]:
    joined = all(run.trial.companion_files for run in data.runs)
    if joined and (drift := _drift(data.runs)):
        yield Detection(fault=drift)
        return
    if not data.runs:
        return
    logs, longest = tuple(log_parts(data.runs)), LONGEST / data.runs[0].rates.kernel.cutoff
    # Fewer logs do not determine a vehicle as well as clocks that are far apart: most of all sines alone.
    far = far_delay(data.runs) if len(logs) >= _MIN_LOGS else None
    if far is not None and far.improvement > MOSTLY and _is_offset(abs(far.delay) - longest, far, data.runs):
        others = "and no thruster is as slow"
        yield Detection(fault=_early_motion(logs, far) if far.delay < 0.0 else _late_motion(logs, far, 0.0, others))
        return
    while (apart := _log_apart(data)) is not None:
        yield apart
        if apart.fault.stops:
            return
        data = apart.repair(data)
    logs = tuple(log_parts(data.runs))
    found = response_delay(data.runs)
    if found is None:
        return
    if _is_early(found, data.runs) and _is_early(response_delay(data.runs, memories=_MEMORIES), data.runs):
        yield Detection(fault=_early_motion(logs, found))
    elif joined and _is_offset(found.delay, found, data.runs):
        text = (
            f"{named(logs)}: the vehicle moves {plus_minus(found.delay, found.error)} s after the commands of "
            "another file: a lag or delay of the thrusters, or a clock that is behind. The logs do not show which."
        )
        yield Detection(fault=replace(_fault(logs, found, text), confidence=_RIVAL))


def _log_apart(data: RunsData) -> Detection[RunsData] | None:
    """The log in which other clocks than those of the other logs explain most of the torque; None without one."""
    parts, period = log_parts(data.runs), 1.0 / data.runs[0].rates.kernel.cutoff if data.runs else 0.0
    if len(parts) < 2 or data.vehicle.axis.self_righting:
        return None
    every, found = ShiftedTorque(data.runs), list[tuple[float, str, ResponseDelay, float]]()
    for name, runs in parts.items():
        if (others := every.model_without(name)) is None:
            continue
        usual, values, left = others
        own = far_delay(runs, values, usual)
        # A lag delays a fast programme by more than a slow one.
        late = _LATE * period + _LAGS * max(usual, 0.0)
        if own is None or own.improvement < MOSTLY:
            continue
        is_early = _is_early(own, data.runs) and _is_early_with_water(name, own, data.runs)
        if len(parts) < _MIN_LOGS:
            # One other log may hardly determine a model: a model of this log alone has to say the same.
            is_certain = is_early and _is_early(response_delay(runs), data.runs)
        else:
            is_certain = is_early or _is_offset(own.delay - late, own, data.runs)
        if is_certain:
            found.append((left, name, own, usual))
    if not found:
        return None
    # Where the log that is apart is one of the others, they explain less.
    _, name, own, usual = min(found, key=lambda one: one[0])
    if own.delay < 0.0:
        fault = _early_motion((name,), own, usual)
    else:
        fault = _late_motion((name,), own, usual, f"and {usual:.2g} s in the other logs")
    if len(parts) < _MIN_LOGS:
        return Detection(fault=fault)
    fault = replace(fault, stops=False, remedy="set_aside")
    return Detection(fault=fault, done="The log was set aside.", repair=partial(without, log=name))


def _is_early_with_water(log: str, found: ResponseDelay, runs: Sequence[Run]) -> bool:
    """Whether a ``log`` is early with a torque of the angle and the water's memory, as the other logs show them."""
    period = 1.0 / runs[0].rates.kernel.cutoff
    longest = 1.0 - 2.0 * found.delay / period
    if longest > LONGEST:
        return True
    others = ShiftedTorque(runs, memories=_MEMORIES, longest=longest).model_without(log)
    own = ShiftedTorque([run for run in runs if log_name(run) == log], memories=_MEMORIES, longest=longest)
    return others is not None and _is_early(own.delay(others[1], least_blocks=FEW_BLOCKS), runs)


def _drift(runs: Sequence[Run]) -> Fault | None:
    """A clock that runs fast or slow: in joined logs, the delay of the motion grows from begin to end."""
    found, longest = clock_drift(runs), max(run.trial.duration for run in runs)
    if found is None or abs(found.drift) < max(_least_offset(runs) / longest, _SIGNIFICANT * found.error):
        return None
    if found.explained < _DRIFT_EXPLAINS:
        return None
    size, error = 1e6 * found.drift, 1e6 * found.error
    logs = tuple(dict.fromkeys(log_name(run) for run in runs))
    text = (
        f"{named(logs)}: the clocks of commands and motion drift apart by {plus_minus(size, error)} ppm. In the "
        f"longest log ({longest:.0f} s) the delay of the motion after the commands changes by "
        f"{plus_minus(longest * found.drift, longest * found.error)} s. Record with one clock, or add {size:.0f} to "
        "the drift of the file of the commands under [join] in rovid.toml."
    )
    return Fault(fault="clocks_apart", logs=logs, text=text, size=size, standard_error=error, unit="ppm", stops=True)


def _early_motion(logs: Sequence[str], found: ResponseDelay, usual: float = 0.0) -> Fault:
    text = (
        f"{named(logs)}: the vehicle moves {plus_minus(-found.delay, found.error)} s before its commands change, which "
        "is impossible. The clock of the commands is ahead by that, and by the delay of the thrusters in addition. "
        f"{_shift(found.delay - usual)}"
    )
    return replace(_fault(logs, found, text), stops=True)


def _late_motion(logs: Sequence[str], found: ResponseDelay, usual: float, others: str) -> Fault:
    text = (
        f"{named(logs)}: the vehicle moves {plus_minus(found.delay, found.error)} s after its commands change, "
        f"{others}. The clock of the commands is behind. {_shift(found.delay - usual)}"
    )
    return replace(_fault(logs, found, text), stops=True)


def _shift(seconds: float) -> str:
    return f"Add {seconds:+.3g} s to the stamps of the commands, in joined files under [join.offset] in rovid.toml."


def _detect_sensor(data: RunsData) -> Iterator[Detection[RunsData]]:
    """A position that is late against a logged rate, or the reverse; the later one is moved."""
    runs = [run for run in data.runs if run.trial.rate is not None and not run.trial.rate_only]
    found = response_delay(runs, of_sensor=True) if runs else None
    if found is None or not _is_offset(abs(found.delay), found, runs):
        return
    axis = runs[0].trial.axis
    words = [f"The {axis.position_words}", f"the logged {axis.rate_words}"]
    late, early = words if found.delay < 0.0 else [words[1].capitalize(), words[0].lower()]
    text = (
        f"{late} is {plus_minus(abs(found.delay), found.error)} s late against {early}, as behind a navigation filter."
    )
    logs = tuple(dict.fromkeys(map(log_name, runs)))
    if len(runs) < len(data.runs):
        yield Detection(fault=_fault(logs, found, text), done="Correct its stamps, or log it before that filter.")
        return
    # A filter does more than delay: what it gives is no measure of the motion.
    done = f"{late} was left out, and {early} fitted. Correct its stamps, or log it before that filter."
    fault = replace(_fault(logs, found, text), remedy="left_out")
    yield Detection(fault=fault, done=done, repair=partial(_without_sensor, late_rate=found.delay > 0.0))


def _without_sensor(data: RunsData, *, late_rate: bool) -> RunsData:
    """``data`` without the logged rate, or with its integral in place of the position; without the gyro's offset."""
    cutoff, trials = data.runs[0].rates.kernel.cutoff, list[Trial]()
    for run in data.runs:
        trial, rate = run.trial, run.trial.rate
        if rate is not None and late_rate and not trial.rate_only:
            trial = replace(trial, rate=None)
        elif rate is not None and not trial.rate_only:
            rate = rate - np.nan_to_num(run.rates.gyro_offset)
            trial = replace(trial, rate=rate, position=integral(trial.time, rate), rate_only=True)
        trials.append(trial)
    return replace(data, runs=prepare_trials(trials, data.vehicle, cutoff=cutoff).items)


def _fault(logs: Sequence[str], found: ResponseDelay, text: str) -> Fault:
    size, error = found.delay, found.error
    return Fault(fault="clocks_apart", logs=tuple(logs), text=text, size=size, standard_error=error, unit="s")


def _is_early(found: ResponseDelay | None, runs: Sequence[Run]) -> bool:
    """Whether the motion comes before the commands."""
    return found is not None and _is_offset(-found.delay, found, runs)


def _is_offset(offset: float, found: ResponseDelay, runs: Sequence[Run]) -> bool:
    """Whether an ``offset`` in s is significant, and longer than a share of a period of the cut-off and than intervals.

    The intervals are those of the motion; in joined logs also one of the commands, by which a change may be earlier.
    """
    if not (offset > _SIGNIFICANT * found.error and found.improvement > _EXPLAINED):
        return False
    interval = float(max(run.trial.sampling_interval for run in runs))
    shortest = max(_least_offset(runs), _INTERVALS * interval)
    if all(run.trial.companion_files for run in runs):
        changes = [run.trial.time[1:][(np.diff(run.trial.commands, axis=0) != 0.0).any(axis=1)] for run in runs]
        steps = [float(np.percentile(np.diff(change), 5.0)) for change in changes if len(change) > 2]
        shortest = max(shortest, interval + min(steps, default=interval))
    return offset > shortest


def _least_offset(runs: Sequence[Run]) -> float:
    """Smallest offset in s that changes a fit."""
    return _MIN_OFFSET / runs[0].rates.kernel.cutoff


DETECTORS: Detectors = {"runs": (_detect, _detect_sensor)}
