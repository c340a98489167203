"""A heading or a rate of another size: it wraps at another period than a turn, or a gyro contradicts the heading.

Radians for degrees and the reverse are refused by `rovid.readers.time_base`, which names the unit.
"""

from collections.abc import Iterator

import numpy as np

from rovid.core.formatting import plus_minus, significant
from rovid.faults.base import Detection, Detectors, RunsData, SignalData, named
from rovid.faults.quick_model import log_name
from rovid.trial.fault import Fault

# A wrap is a step of at least this share of the range, between ends of the range, with the heading for some samples on
# either side: a spike returns at once.
_SHARE, _END_SHARE, _STAYS = 0.9, 0.05, 4
# Least number of wraps, and for periods that no known scale has; a sensor that resets once jumps by less than a turn.
# Largest share of the samples with a large step.
_MIN_WRAPS, _MIN_UNUSUAL, _MOST = 2, 4, 0.05
# Share of the samples at an end of the range, above which the sensor is clipped there. It is clipped, too, where each
# wrap passes a reading exactly at an end.
_CLIPPED = 0.01
# Relative difference of a period from a turn that a vehicle's motion within one sample may cause.
_NEAR = 0.04
# Periods of known scales over a whole turn: half, gon, turns, per cent, twice.
_SCALES = {
    0.5: "half its size",
    400 / 360: "gon",
    1 / 360: "turns",
    100 / 360: "per cent of a turn",
    2.0: "twice its size",
    10.0: "tenths of a degree",
    100.0: "hundredths of a degree",
    1000.0: "thousandths of a degree",
    65536 / 360: "65536 counts a turn",
}
_AS_UNIT = ', or set unit = "0.01 deg" in [signals] heading.'
# Ratio of a logged rate to the heading's derivative, beyond which one of them has another scale; an ordinary gyro is
# right within 5 %. Largest relative difference between the logs.
_GAIN, _SAME = 1.2, 0.1
_DEG = 180.0 / np.pi


def _detect(data: SignalData) -> Iterator[Detection[SignalData]]:
    values = data.values
    if not np.isfinite(data.period) or len(values) < 10 * _STAYS:
        return
    low, high = float(values.min()), float(values.max())
    span = high - low
    steps = np.diff(values)
    large = np.flatnonzero(np.abs(steps) > _SHARE * span)
    at_end = np.mean((values >= high - 1e-9) | (values <= low + 1e-9))
    if not span > 0.0 or not 0 < len(large) <= _MOST * len(steps) or at_end > _CLIPPED:
        return
    if np.any((np.abs(steps) > 0.5 * span) & (np.abs(steps) <= _SHARE * span)):
        return
    apart = np.diff(np.concatenate(([-_STAYS], large, [len(steps) + _STAYS])))
    wraps = large[(apart[:-1] >= _STAYS) & (apart[1:] >= _STAYS)]
    edge = _END_SHARE * span
    ends = np.minimum(values - low, high - values) < edge
    wraps = wraps[ends[wraps] & ends[wraps + 1]]
    exact = np.count_nonzero(values == high) + np.count_nonzero(values == low)
    if not len(wraps) or data.clipped or exact >= len(wraps) + 2:
        return
    # The motion goes on across a wrap: its rate is that of the samples around.
    around = 0.5 * (steps[np.maximum(wraps - 1, 0)] + steps[np.minimum(wraps + 1, len(steps) - 1)])
    periods = np.abs(steps[wraps] - around)
    period, error = float(np.median(periods)), float(np.std(periods) / len(periods) ** 0.5)
    ratio = period / data.period
    usual = next((text for scale, text in _SCALES.items() if abs(ratio / scale - 1.0) < _NEAR), "")
    is_turn = abs(ratio - 1.0) < _NEAR or abs(ratio * _DEG - 1.0) < _NEAR or abs(ratio / _DEG - 1.0) < _NEAR
    # Readings that fill a half turn from its one end to the other wrap there. A sensor that resets once does not.
    half, bounds = 0.5 * data.period, np.array([low, high])
    fills = abs(ratio - 0.5) < 0.1 * _NEAR and any(
        np.all(np.abs(bounds - begin - [0.0, half]) < edge) for begin in (0.0, -0.5 * half)
    )
    fewest = (_MIN_WRAPS if ratio < 1.0 and not fills else 1) if usual else _MIN_UNUSUAL
    if is_turn or len(wraps) < fewest or np.ptp(periods) > _NEAR * period:
        return
    text = (
        f"{data.log}: the {data.name} jumps by {significant(period * _DEG, 3)} deg where it wraps, instead of 360 deg. "
        f"It is logged at {ratio:.3g} of its size{f' ({usual})' if usual else ''}: multiply it by {1.0 / ratio:.4g}"
        f"{_AS_UNIT if usual == _SCALES[100.0] else '.'}"
    )
    fault = Fault(
        fault="scaled_heading",
        logs=(data.log,),
        text=text,
        at=tuple(float(data.time[at] - data.time[0]) for at in wraps[:5].tolist()),
        size=ratio,
        standard_error=error / data.period,
        stops=True,
    )
    yield Detection(fault=fault)


def _detect_rate(data: RunsData) -> Iterator[Detection[RunsData]]:
    gains = {log_name(run): run.rates.gyro_gain for run in data.runs if np.isfinite(run.rates.gyro_gain)}
    every = np.array(list(gains.values()))
    if len(every) == 0:
        return
    middle = float(np.median(every))
    error = float(np.std(every) / len(every) ** 0.5)
    if 1.0 / _GAIN <= abs(middle) <= _GAIN or np.ptp(every) > _SAME * abs(middle):
        return
    axis = data.runs[0].trial.axis
    text = (
        f"{named(tuple(gains))}: the logged {axis.rate_words} is {plus_minus(middle, error)} times the derivative of "
        f"the {axis.position_words}. One of them has another scale or sign. Correct it, or leave {axis.rate_signal} "
        "out of [signals]."
    )
    fault = Fault(fault="scaled_heading", logs=tuple(gains), text=text, size=middle, standard_error=error, stops=True)
    yield Detection(fault=fault)


DETECTORS: Detectors = {"signal": (_detect,), "runs": (_detect_rate,)}
