"""Latency and scale of each position against a rate: of the heading, and of north and east."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.planar.dataset import PlanarRun
from rovid.trial.rates import integral

# Scales between sensors whose units and signs agree; correlation below which two sensors say nothing of each other.
SCALES, CORRELATED = (0.8, 1.25), 0.7
# s; largest latency that is searched for, number of latencies to each side, and length of a window.
_MOST, _COUNT, _WINDOW = 1.5, 60, 20.0
# Windows that an estimate needs, and readings of each sensor in a window.
_FEWEST_WINDOWS, _FEWEST_READINGS = 4, 8
# Groups of windows, one of which is left out at a time for the standard error.
_GROUPS = 10


@dataclass(frozen=True, kw_only=True)
class SensorLag:
    """How late a position is against a rate, and the scale between them."""

    late: str  #: Name of the position.
    against: str  #: Name of the rate.
    seconds: float
    standard_error: float  #: s, from windows that are left out in turn.
    scale: float  #: Change of the position over the integral of the rate: 1 if units and signs agree.
    correlation: float  #: Of both changes.


def sensor_lags(runs: Sequence[PlanarRun]) -> Iterator[SensorLag]:
    """Latency of the heading against the yaw rate, and of north and east against surge and sway velocity."""
    pairs = {
        ("heading", "yaw_rate"): [("heading", "yaw_rate")],
        ("position", "velocity"): [("north", "north"), ("east", "east")],
    }
    for (late, against), signals in pairs.items():
        windows = [sums for run in runs for position, rate in signals for sums in _windows(run, position, rate)]
        if len(windows) < _FEWEST_WINDOWS:
            continue
        sums = np.array(windows)  # (w, 3, lags): squares of the position, products, squares of the integral.
        at, scale, correlation = _best(sums.sum(axis=0))
        groups = np.arange(len(sums)) % min(_GROUPS, len(sums))
        others = [_best(sums[groups != group].sum(axis=0))[0] for group in np.unique(groups)]
        count = len(others)
        error = float(np.sqrt((count - 1) / count * np.sum((np.array(others) - np.mean(others)) ** 2)))
        yield SensorLag(
            late=late, against=against, seconds=at, standard_error=error, scale=scale, correlation=correlation
        )


def _windows(run: PlanarRun, position: str, rate: str) -> Iterator[FloatArray]:
    """(3, lags) sums of each window, without mean and trend."""
    time, turned = _integral(run, rate)
    if position not in run.sensors or len(time) < _FEWEST_READINGS:
        return
    readings = run.readings(position)
    lags = np.linspace(-_MOST, _MOST, 2 * _COUNT + 1)
    gap = 5.0 * float(np.median(np.diff(time)))
    for begin in np.arange(time[0] + _MOST, time[-1] - _MOST - _WINDOW, _WINDOW):
        inside = (readings.time >= begin) & (readings.time < begin + _WINDOW)
        near = time[(time >= begin - _MOST) & (time < begin + _WINDOW + _MOST)]
        if inside.sum() < _FEWEST_READINGS or len(near) < _FEWEST_READINGS or np.diff(near).max() > gap:
            continue
        stamps, values = readings.time[inside], readings.values[inside]
        trend = np.column_stack((np.ones(len(stamps)), stamps - stamps.mean()))
        basis, _ = np.linalg.qr(trend)
        moved = np.interp(stamps[:, None] - lags, time, turned)
        moved -= basis @ (basis.T @ moved)
        values = values - basis @ (basis.T @ values)
        yield np.stack((np.full(len(lags), values @ values), values @ moved, np.einsum("ij,ij->j", moved, moved)))


def _integral(run: PlanarRun, rate: str) -> tuple[FloatArray, FloatArray]:
    """Instants, and the integral of the yaw rate, or of the velocity over ground to north or east."""
    needed = ("yaw_rate",) if rate == "yaw_rate" else ("surge_velocity", "sway_velocity", "heading")
    if not set(needed) <= set(run.sensors):
        return np.zeros(0), np.zeros(0)
    first = run.readings(needed[0])
    values = first.values
    if rate != "yaw_rate":
        sway, heading = run.readings("sway_velocity"), run.readings("heading")
        across = np.interp(first.time, sway.time, sway.values)
        course = np.interp(first.time, heading.time, heading.values)
        cos, sin = np.cos(course), np.sin(course)
        values = values * cos - across * sin if rate == "north" else values * sin + across * cos
    return first.time, integral(first.time, values)


def _best(sums: FloatArray) -> tuple[float, float, float]:
    """Latency in s, scale and correlation by least squares, between the latencies tried by a parabola."""
    lags = np.linspace(-_MOST, _MOST, 2 * _COUNT + 1)
    squares, products, moved = sums
    gain = products * np.abs(products) / np.maximum(moved, 1e-300)
    best = int(np.argmax(np.abs(gain)))
    at = float(lags[best])
    if 0 < best < len(lags) - 1:
        left, middle, right = np.abs(gain[best - 1 : best + 2])
        bend = left - 2.0 * middle + right
        if bend < 0.0:
            at += 0.5 * (left - right) / bend * float(lags[1] - lags[0])
    scale = float(products[best] / max(moved[best], 1e-300))
    return float(at), scale, float(products[best] / np.sqrt(max(squares[best] * moved[best], 1e-300)))
