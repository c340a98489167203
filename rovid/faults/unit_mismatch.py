"""Commands and thrust curve in different units: percent, volts, microseconds, -1 to 1.

Rule: a curve is measured over the commands that the drive accepts. A vehicle is at times given more than was tested,
by some tens of percent, but not 1.5 half widths of the curve for a tenth of its commands. Nor is it driven through a
whole campaign with less than a fiftieth of the curve: the thrust, about the square of it, would be nothing.

Or some logs have the time in another unit than the others: their intervals and their durations are both about a
thousand times longer or shorter. A log at another rate has other intervals, and not another duration by as much.

Or one free decay swings much slower or faster than the others: its time is at full scale among that of a model.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import groupby

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.formatting import significant
from rovid.faults.base import CampaignData, Detection, Detectors, named
from rovid.trial.fault import Fault
from rovid.trial.segments import swing_period
from rovid.trial.trial import Trial
from rovid.trial.vehicle import FAR_OUTSIDE, ThrustCurve, Thruster

# Share of a log's commands, without zeros, that are far outside the curve.
_MIN_SHARE = 0.1
# Largest reach in half widths of the curve, over all logs, that shows commands of a much larger unit.
_TINY = 0.02
# Reach over the limit of a thruster whose commands are clamped on purpose.
_CLAMPED = 2.0
# Unit -> smallest and largest command at full thrust, and the usual full command; the middle of a pulse width is 1500.
_UNITS = {
    "a share of full thrust (-1 to 1)": (0.0, 1.05, 1.0),
    "volts": (1.05, 55.0, 0.0),
    "percent": (55.0, 105.0, 100.0),
}
_PULSE = "microseconds of pulse width"
_PULSE_RANGE, _PULSE_MIDDLE, _PULSE_HALF = (700.0, 2300.0), 1500.0, 400.0
# Fewest logs with a majority. Powers of a thousand between units of time: seconds, ms, us and ns. Largest factors by
# which rates and durations of logs differ besides.
_MIN_LOGS = 3
_POWERS, _OTHER_RATE, _OTHER_DURATION = (-3, -2, -1, 1, 2, 3), 3.0, 20.0
# Ratio of a decay's period to that of the others, which agree within the second ratio. A period of large swings is some
# tens of percent longer or shorter by the shape of the restoring moment. Decisions.
_OTHER_PERIOD, _SAME_PERIOD = 1.6, 1.25


def _detect(data: CampaignData) -> Iterator[Detection[CampaignData]]:
    found = []
    for at, thruster in enumerate(data.vehicle.thrusters):
        if thruster.curve is None:
            continue
        logged = {trial.name: trial.commands[:, at] for trial in data.trials}
        for log, values in _mismatched(thruster, thruster.curve, logged):
            found.append((mismatch_text(thruster.curve, values), log, thruster.name))
    for text, group in groupby(sorted(found), key=lambda item: item[0]):
        items = list(group)
        logs = tuple(dict.fromkeys(log for _, log, _ in items))
        drives = " and ".join(dict.fromkeys(drive for _, _, drive in items))
        fault = Fault(fault="unit_mismatch", logs=logs, text=f"{named(logs)}: commands of {drives} {text}", stops=True)
        yield Detection(fault=fault)


def _detect_time(data: CampaignData) -> Iterator[Detection[CampaignData]]:
    """Logs whose time is in another unit than that of most logs."""
    parts: dict[str, list[Trial]] = {}
    for trial in data.trials:
        parts.setdefault(trial.parent or trial.name, []).append(trial)
    logs = [*parts]
    if len(logs) < _MIN_LOGS:
        return
    intervals = np.array([np.median([trial.sampling_interval for trial in own]) for own in parts.values()])
    durations = np.array([sum(trial.duration for trial in own) for own in parts.values()])
    for power in _POWERS:
        factor = 1000.0**power
        odd = np.abs(np.log(intervals / np.median(intervals) / factor)) < np.log(_OTHER_RATE)
        odd &= np.abs(np.log(durations / np.median(durations) / factor)) < np.log(_OTHER_DURATION)
        for at in np.flatnonzero(odd).tolist():  # Fewer than half: the medians are those of the others.
            how = f"{1000 ** abs(power)} times as {'long' if power > 0 else 'short'}"
            text = (
                f"{logs[at]}: its time is in another unit than that of the other logs. Its intervals of "
                f"{intervals[at]:.3g} s and its duration of {durations[at]:.3g} s are about {how}."
            )
            fault = Fault(fault="unit_mismatch", logs=(logs[at],), text=text, size=factor, remedy="set_aside")
            done = "It was set aside: convert its stamps, because the unit of time in rovid.toml holds for all logs."
            yield Detection(fault=fault, done=done, repair=partial(_without, log=logs[at]))


def _detect_periods(data: CampaignData) -> Iterator[Detection[CampaignData]]:
    """Free decays on another time scale than most."""
    free = [trial for trial in data.trials if not trial.has_actuators and trial.axis.self_righting]
    periods: dict[str, float] = {}
    for trial in free:
        if np.isfinite(period := swing_period(trial)):
            periods.setdefault(trial.parent or trial.name, period)
    if len(periods) < _MIN_LOGS:
        return
    ratios = {log: period / float(np.median([*periods.values()])) for log, period in periods.items()}
    odd = [log for log, ratio in ratios.items() if abs(np.log(ratio)) > np.log(_OTHER_PERIOD)]
    usual = np.array([ratio for log, ratio in ratios.items() if log not in odd])
    if 2 * len(odd) >= len(periods) or np.ptp(np.log(usual)) > np.log(_SAME_PERIOD):
        return
    for log in odd:
        ratio = ratios[log] / float(np.mean(usual))
        text = (
            f"{log}: it swings with a period of {significant(periods[log], 3)} s, {significant(ratio, 3)} times that "
            "of the other logs: its time has another scale, as that of the full-scale ship among its model's, or it is "
            "the log of another vehicle or loading."
        )
        fault = Fault(fault="unit_mismatch", logs=(log,), text=text, size=ratio, remedy="set_aside")
        yield Detection(fault=fault, done="It was set aside.", repair=partial(_without, log=log))


def _without(data: CampaignData, log: str) -> CampaignData:
    return replace(data, trials=[trial for trial in data.trials if log not in {trial.parent, trial.name}])


def _mismatched(
    thruster: Thruster, curve: ThrustCurve, logged: dict[str, FloatArray]
) -> Iterator[tuple[str, FloatArray]]:
    """Logs whose commands are not of the curve's unit, each with the commands that show it."""
    limit = FAR_OUTSIDE * (_CLAMPED if thruster.clamp else 1.0)
    used = {log: values[np.isfinite(values) & (values != 0.0)] for log, values in logged.items()}
    used = {log: values for log, values in used.items() if values.size}
    if not used:
        return
    every = np.concatenate(list(used.values()))
    unit, reach = unit_of(every), float(np.max(np.abs(every)))
    full = _full(unit) if unit in _UNITS else 0.0
    # Commands that are tiny in their own unit, too, are those of a vehicle that hardly moves.
    is_tiny = reach < _TINY * np.max(np.abs(curve.command)) and reach >= _TINY * full
    if is_tiny and unit != unit_of(curve.command):
        yield from ((log, every) for log in used)
        return
    far = {log: every for log, values in used.items() if np.mean(curve.reach(values) > limit) > _MIN_SHARE}
    yield from far.items()


def unit_of(values: FloatArray) -> str:
    """Unit by the range of ``values``; empty if no usual unit fits."""
    low, high = float(values.min()), float(values.max())
    if _PULSE_RANGE[0] <= low and high <= _PULSE_RANGE[1]:
        return _PULSE
    size = max(abs(low), abs(high))
    return next((unit for unit, (least, most, _) in _UNITS.items() if least < size <= most), "")


def mismatch_text(curve: ThrustCurve, values: FloatArray) -> str:
    """What the commands ``values`` and the ``curve`` look like, and how to convert them."""
    low, high = float(values.min()), float(values.max())
    ends = curve.command[[0, -1]]
    ours, theirs = unit_of(values), unit_of(ends)
    text = f"reach {low:.4g} to {high:.4g}, but the curve ends at {ends[0]:g} and {ends[1]:g}"
    if not ours or ours == theirs:
        return f"{text}: they are not of one unit. Give the curve in the unit of the commands."
    text += f": another unit. The commands look like {ours}" + (f", the curve like {theirs}." if theirs else ".")
    if _PULSE in (ours, theirs):
        other, full = (ends, 1.0) if ours == _PULSE else (values, _full(ours))
        half = float(np.abs(other).max()) if ours == _PULSE else full
        factor = _PULSE_HALF / half
        rule = f"{_PULSE_MIDDLE:g} + {factor:.4g} * {'curve command' if ours == _PULSE else 'command'}"
        what = "Give the curve in microseconds" if ours == _PULSE else "Give the curve in the unit of the commands"
        return f"{text} {what}: a pulse width is about {rule}."
    full = _full(ours) or max(abs(low), abs(high))
    factor = full / float(np.abs(ends).max())
    return f"{text} Multiply the commands of the curve by {factor:.4g}, if its end is full thrust."


def _full(unit: str) -> float:
    """Command at full thrust in ``unit``; 0 where it varies."""
    return _UNITS[unit][2]


DETECTORS: Detectors = {"campaign": (_detect_time, _detect, _detect_periods)}
