"""Standard manoeuvres and their measures: turning circle, zigzag, Nomoto's model, and the steady turning curve.

Definitions: IMO MSC.137(76), annex, sections 4 and 5; ITTC 7.5-02-06-01 (free running model tests), section 3; Nomoto
et al. (1957), International Shipbuilding Progress 4(35), first order: T*rdot + r = K*(steering - offset). The steering
is a rudder angle in rad, or the share of the largest differential command; a positive steering turns to starboard. All
tracks are relative to the water: subtract the current first.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.jit.decorators import compiled

# Share of a turn, over whose last part a steady turn is averaged: the last quarter, as in ITTC 7.5-02-06-01.
_STEADY_PART = 0.25
# rad, smallest change of heading of a turning circle: MSC.137(76) needs 180 deg for the tactical diameter.
_FULL_TURN = np.pi
# Share of the range of the steering within which it counts as held, and the smallest share that counts as steering.
_HELD, _LEAST_STEERING = 0.02, 0.05
# Largest yaw rate of a straight approach, as a share of the largest one in the manoeuvre. A decision.
_STRAIGHT = 0.2
# Number of rows before the first order in which the approach has to be straight.
_BEFORE = 10
# Length of a hold that a slow rudder passes, as a share of the orders before and after it. A decision.
_PASSING = 0.25
# Largest relative difference between the headings of execution in one zigzag; MSC.137(76) keeps one angle.
_SAME_THRESHOLD = 0.4
# Number of time constants in the search for Nomoto's T, and number of refinements of the grid.
_GRID, _REFINEMENTS = 25, 6


@dataclass(frozen=True)
class ManoeuvreMeasure:
    """Value of one measure in ``unit``; the standard error is None where it is not known."""

    value: float
    unit: str
    standard_error: float | None = None


Measures = Mapping[str, ManoeuvreMeasure]


@dataclass(frozen=True, eq=False)
class Track:
    """Motion relative to the water: (n,) arrays in s, m, rad, m/s and rad/s; NaN where not measured."""

    time: FloatArray
    heading: FloatArray  #: Continuous, without jumps of 2 pi.
    yaw_rate: FloatArray
    steering: FloatArray
    north: FloatArray
    east: FloatArray
    surge: FloatArray
    sway: FloatArray

    def part(self, first: int, last: int) -> "Track":
        """Rows ``first`` to ``last``, the latter excluded."""
        return replace(self, **{name: value[first:last] for name, value in vars(self).items()})


class RecognisedManoeuvre(NamedTuple):
    """Rows ``first`` to ``last`` (excluded) of a track with a "turning_circle" or a "zigzag"."""

    kind: str
    first: int
    last: int
    steering: float  #: Magnitude with sign of the first order.


# ---- turning circle


def turning_circle(track: Track) -> Measures:
    """Measures of a turn whose steering is ordered at the first sample, with the vehicle on a straight course.

    Advance and transfer: distances along and across the approach course until the heading has changed by 90 deg.
    Tactical diameter: distance across until it has changed by 180 deg (MSC.137(76), annex, 4.2 and 4.3). Steady turning
    diameter, rate, drift angle and loss of speed: means over the last quarter of the turn, with standard errors from
    their scatter. Measures without the necessary measurement, or beyond the end of the turn, are absent. A simulation
    that diverges has none.
    """
    if not np.isfinite(track.heading[-1]):
        return {}
    turned = np.abs(track.heading - track.heading[0])
    side = 1.0 if track.heading[-1] >= track.heading[0] else -1.0
    course = track.heading[0]
    along = (track.north - track.north[0]) * np.cos(course) + (track.east - track.east[0]) * np.sin(course)
    across = side * ((track.east - track.east[0]) * np.cos(course) - (track.north - track.north[0]) * np.sin(course))
    found: dict[str, ManoeuvreMeasure] = {}

    def add(name: str, value: float, unit: str, error: float | None = None) -> None:
        if np.isfinite(value):
            found[name] = ManoeuvreMeasure(value, unit, error)

    add("advance", _when(turned, 0.5 * np.pi, along), "m")
    add("transfer", _when(turned, 0.5 * np.pi, across), "m")
    add("tactical_diameter", _when(turned, np.pi, across), "m")
    add("time_to_90_deg", _when(turned, 0.5 * np.pi, track.time - track.time[0]), "s")
    add("time_to_180_deg", _when(turned, np.pi, track.time - track.time[0]), "s")
    if turned[-1] < _FULL_TURN:
        return found
    last = turned >= turned[-1] * (1.0 - _STEADY_PART)
    duration = float(track.time[last][-1] - track.time[last][0])
    rate = side * float(turned[last][-1] - turned[last][0]) / duration if duration > 0.0 else np.nan
    speed = np.hypot(track.surge, track.sway)
    mean, error = _mean(speed[last])
    rate_error = _mean(track.yaw_rate[last])[1]
    add("steady_yaw_rate", rate, "rad/s", rate_error)
    add("steady_speed", mean, "m/s", error)
    both = None if error is None or rate_error is None else math.hypot(error / mean, rate_error / rate)
    add("steady_diameter", 2.0 * mean / abs(rate), "m", None if both is None else both * 2.0 * mean / abs(rate))
    # Positive where the bow points into the turn: beta = -v/u in a turn to starboard.
    drift, drift_error = _mean(np.arctan2(-side * track.sway[last], track.surge[last]))
    add("steady_drift_angle", drift, "rad", drift_error)
    if speed[0] > 0.0:
        add("speed_ratio", mean / float(speed[0]), "1", None if error is None else error / float(speed[0]))
    return found


def _when(level: FloatArray, wanted: float, values: FloatArray) -> float:
    """``values`` at the first crossing of ``wanted`` by ``level``, linear between samples; NaN if never reached."""
    reached = np.flatnonzero(level >= wanted)
    if not reached.size or reached[0] == 0:
        return float("nan")
    k = int(reached[0])
    share = (wanted - level[k - 1]) / (level[k] - level[k - 1])
    return float(values[k - 1] + share * (values[k] - values[k - 1]))


def _mean(values: FloatArray) -> tuple[float, float | None]:
    """Mean of the finite values and its standard error, for correlated samples; NaN and None where there are none."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return float("nan"), None
    mean = float(np.mean(finite))
    independent = len(finite) / _correlation_length(finite - mean)
    return mean, float(np.std(finite) / math.sqrt(max(independent - 1.0, 1.0)))


# ---- zigzag


def zigzag(track: Track) -> Measures:
    """First and second overshoot angle, times to the executes, and period of a zigzag from its first execute.

    An overshoot angle is the further change of heading after the steering is reversed (MSC.137(76), annex, 4.5). The
    period is the time between the first and the third reversal, one whole cycle (ITTC 7.5-02-06-01). Absent where the
    run is too short.
    """
    reversals = _reversals(track.steering)
    found: dict[str, ManoeuvreMeasure] = {}
    for index, name in enumerate(("first", "second")):
        if len(reversals) <= index:
            break
        begin = int(reversals[index])
        end = int(reversals[index + 1]) if len(reversals) > index + 1 else len(track.time)
        heading = track.heading[begin:end] * np.sign(track.steering[begin - 1])
        top = int(np.argmax(heading))
        # The peak lies inside the section, or the run ended before it.
        if 0 < top < len(heading) - 1:
            peak, later = _peak(heading, top)
            found[f"{name}_overshoot"] = ManoeuvreMeasure(peak - float(heading[0]), "rad")
            seconds = float(np.interp(begin + top + later, np.arange(len(track.time)), track.time) - track.time[begin])
            found[f"{name}_overshoot_time"] = ManoeuvreMeasure(seconds, "s")
        found[f"{name}_execute_time"] = ManoeuvreMeasure(float(track.time[begin] - track.time[0]), "s")
    if len(reversals) > 2:
        found["period"] = ManoeuvreMeasure(float(track.time[reversals[2]] - track.time[reversals[0]]), "s")
    return found


def _reversals(steering: FloatArray) -> FloatArray:
    """Rows at which the sign of the steering has changed, between orders of at least half the largest."""
    sign = np.where(np.abs(steering) > 0.5 * np.max(np.abs(steering)), np.sign(steering), 0.0)
    rows = np.flatnonzero(sign)
    changed = np.flatnonzero(np.diff(sign[rows]) != 0.0)
    # A slow rudder leaves the old side long before it reaches the new one: the order counts, which leaves first.
    leaves = []
    for begin, last in zip([0, *rows[changed + 1]], rows[changed], strict=False):
        size = np.abs(steering[begin : last + 1])
        leaves.append(begin + int(np.flatnonzero(size >= (1.0 - _HELD) * np.max(size))[-1]) + 1)
    return np.asarray(leaves, dtype=np.int64)


def _peak(values: FloatArray, top: int) -> tuple[float, float]:
    """Maximum of the parabola through three samples about ``top``, and its distance from ``top`` in samples."""
    before, at, after = values[top - 1 : top + 2].tolist()
    curvature = before - 2.0 * at + after
    later = 0.5 * (before - after) / curvature if curvature < 0.0 else 0.0
    return at - 0.25 * (before - after) * later, later


# ---- Nomoto's model


def nomoto(track: Track, unit: str = "1/s") -> Measures:
    """K and T of T*rdot + r = K*(steering - offset) by output error on the yaw rate, with standard errors.

    The simulated rate is linear in K, the offset and the initial rate, for a given T: separable least squares over T.
    The standard errors are those of least squares with correlated residuals (Ljung 1999, sect. 9.4): the covariance is
    multiplied by the residuals' correlation time in samples.

    ``unit`` is that of K: 1/s for a rudder, rad/s for a share of the largest torque. Returns no measures where the rate
    or the steering does not change.
    """
    use = np.isfinite(track.yaw_rate) & np.isfinite(track.steering)
    time, rate, steering = track.time[use], track.yaw_rate[use], track.steering[use]
    if len(time) < 10 or np.ptp(rate) == 0.0 or np.ptp(steering) == 0.0:
        return {}
    low, high = 0.5 * float(np.median(np.diff(time))), 2.0 * float(time[-1] - time[0])
    for _ in range(_REFINEMENTS):
        grid = np.geomspace(low, high, _GRID)
        costs = [_nomoto_fit(time, rate, steering, constant)[1] for constant in grid]
        best = int(np.argmin(costs))
        low, high = grid[max(best - 1, 0)], grid[min(best + 1, _GRID - 1)]
    constant = float(np.sqrt(low * high))
    solution, _, columns = _nomoto_fit(time, rate, steering, constant)
    later = _nomoto_columns(time, steering, constant * 1.001) @ solution
    jacobian = np.column_stack((columns, (later - columns @ solution) / (0.001 * constant)))
    residual = rate - columns @ solution
    normal = jacobian.T @ jacobian
    if np.linalg.matrix_rank(normal / np.sqrt(np.outer(np.diag(normal), np.diag(normal)))) < len(normal):
        return {}
    variance = float(residual @ residual) / max(len(rate) - 4, 1) * _correlation_length(residual)
    errors = np.sqrt(variance * np.diag(np.linalg.inv(normal)))
    gain, offset = float(solution[0]), float(solution[1])
    measures = {"K": ManoeuvreMeasure(gain, unit, float(errors[0]))}
    measures["T"] = ManoeuvreMeasure(constant, "s", float(errors[3]))
    if gain != 0.0:
        measures["neutral_steering"] = ManoeuvreMeasure(-offset / gain, "steering", float(errors[1] / abs(gain)))
    return measures


@compiled
def _nomoto_columns(time: FloatArray, steering: FloatArray, constant: float) -> FloatArray:
    """(n, 3) responses of the rate to the steering (held between samples), to one, and to the initial rate."""
    columns = np.zeros((len(time), 3))
    columns[0, 2] = 1.0
    for k in range(1, len(time)):
        fade = np.exp((time[k - 1] - time[k]) / constant)
        columns[k, 0] = fade * columns[k - 1, 0] + (1.0 - fade) * steering[k - 1]
        columns[k, 1] = fade * columns[k - 1, 1] + (1.0 - fade)
        columns[k, 2] = fade * columns[k - 1, 2]
    return columns


def _nomoto_fit(
    time: FloatArray, rate: FloatArray, steering: FloatArray, constant: float
) -> tuple[FloatArray, float, FloatArray]:
    columns = _nomoto_columns(time, steering, constant)
    solution = np.asarray(np.linalg.lstsq(columns, rate, rcond=None)[0], dtype=np.float64)
    return solution, float(np.sum((rate - columns @ solution) ** 2)), columns


def _correlation_length(residual: FloatArray) -> float:
    """Sum of the autocorrelation up to its first zero, on both sides: samples for one independent residual."""
    centred = residual - np.mean(residual)
    power = float(centred @ centred)
    if power <= 0.0:
        return 1.0
    size = 1 << (2 * len(centred) - 1).bit_length()
    spectrum = np.abs(np.fft.rfft(centred, size)) ** 2
    correlation = np.fft.irfft(spectrum, size)[: len(centred)] / power
    negative = np.flatnonzero(correlation <= 0.0)
    end = int(negative[0]) if negative.size else len(correlation)
    return max(1.0, float(1.0 + 2.0 * np.sum(correlation[1:end])))


# ---- recognition


def recognise(track: Track) -> list[RecognisedManoeuvre]:
    """Turning circles and zigzags in a track, by its steering and heading.

    A turning circle is a held steering during which the heading changes by 180 deg. A zigzag is a sequence of at least
    three opposite orders of like size, reversed each time the heading has passed the same angle on the other side of
    the approach course. Both begin on a straight course ahead, as the definitions of their measures require.
    """
    found: list[RecognisedManoeuvre] = []
    level = np.max(np.abs(track.steering), initial=0.0)
    if level == 0.0:
        return []
    orders = _orders(track.steering, level)
    index = 0
    while index < len(orders):
        chain, order = _zigzag_chain(track, orders[index:]), orders[index]
        is_zigzag = len(chain) > 2 and _starts_straight(track, order.first, chain[-1].last)
        last = chain[-1].last if is_zigzag else order.last
        is_full = abs(track.heading[last - 1] - track.heading[order.first]) >= _FULL_TURN
        if is_zigzag or (is_full and _starts_straight(track, order.first, last)):
            kind = "zigzag" if is_zigzag else "turning_circle"
            found.append(RecognisedManoeuvre(kind, order.first, last, order.steering))
        index += len(chain) if is_zigzag else 1
    return found


def _starts_straight(track: Track, first: int, last: int) -> bool:
    """Whether the vehicle moves straight ahead before row ``first``, compared to the turn up to row ``last``."""
    # Smoothing spreads the beginning of a turn over some rows.
    before = np.abs(track.yaw_rate[max(first - _BEFORE, 0) : first + 1])
    ahead = track.surge[first]
    return bool(np.median(before) <= _STRAIGHT * np.nanmax(np.abs(track.yaw_rate[first:last]))) and not ahead <= 0.0


class _Order(NamedTuple):
    """A held steering, from row ``first``, where the steering leaves the order before, to ``last`` (excluded)."""

    first: int
    last: int
    steering: float


def _orders(steering: FloatArray, level: float) -> list[_Order]:
    """The orders of a track whose largest steering is ``level``."""
    holds = _without_passing(_holds(steering, _HELD * level), steering)
    executes = [holds[0][0] if holds else 0, *(last for _, last in holds)]
    every = (_Order(begin, last, float(steering[first])) for begin, (first, last) in zip(executes, holds, strict=False))
    return [order for order in every if abs(order.steering) > _LEAST_STEERING * level]


def _holds(steering: FloatArray, tolerance: float) -> list[tuple[int, int]]:
    """Rows (first, last excluded) of sections whose steering stays within ``tolerance`` of its first value."""
    sections, first = [], 0
    for k in range(1, len(steering) + 1):
        if k == len(steering) or not abs(steering[k] - steering[first]) <= tolerance:
            if k - first > 1:
                sections.append((first, k))
            first = k
    return sections


def _without_passing(holds: list[tuple[int, int]], steering: FloatArray) -> list[tuple[int, int]]:
    """The ``holds`` without those that a slow rudder passes on its way from one order to the next, in one or more."""
    kept = []
    for at, (first, last) in enumerate(holds):
        long = (last - first) / _PASSING
        before = next((begin for begin, end in reversed(holds[:at]) if end - begin > long), None)
        after = next((begin for begin, end in holds[at + 1 :] if end - begin > long), None)
        ends = sorted(float(steering[one]) for one in (before, after) if one is not None)
        if len(ends) < 2 or not ends[0] < steering[first] < ends[1]:
            kept.append((first, last))
    return kept


def _zigzag_chain(track: Track, orders: list[_Order]) -> list[_Order]:
    """The first orders that make one zigzag."""
    chain = orders[:1]
    course, size = track.heading[chain[0].first], abs(chain[0].steering)
    threshold = 0.0
    for order in orders[1:]:
        before = chain[-1].steering
        turned = (track.heading[order.first] - course) * np.sign(before)
        alike = order.steering * before < 0.0 and abs(abs(order.steering) - size) < 0.1 * size
        if not alike or not 0.0 < turned < 0.5 * np.pi:
            break
        threshold = threshold or turned
        if abs(turned - threshold) > _SAME_THRESHOLD * threshold:
            break
        chain.append(order)
    return chain


# ---- measures of a model, with errors


def with_errors(
    measure: Callable[[FloatArray], Measures], values: FloatArray, covariance: FloatArray, step: float = 0.1
) -> Measures:
    """Measures of ``measure`` at the (p,) ``values``, with (p, p) ``covariance``; standard errors by the delta method.

    The derivatives are central differences with ``step`` standard errors along the principal axes of the correlations.
    A measure that a displaced model does not have gets no error.
    """
    at = measure(values)
    scale = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    eigenvalues, axes = np.linalg.eigh(covariance / np.maximum(np.outer(scale, scale), 1e-300))
    axes = axes * scale[:, None]
    variances = dict.fromkeys(at, 0.0)
    for size, axis in zip(np.sqrt(np.maximum(eigenvalues, 0.0)), axes.T, strict=True):
        if size == 0.0:
            continue
        ahead, back = measure(values + step * size * axis), measure(values - step * size * axis)
        for name in at:
            if name in ahead and name in back:
                variances[name] += ((ahead[name].value - back[name].value) / (2.0 * step)) ** 2
            else:
                variances[name] = np.nan
    errors = {name: float(np.sqrt(one)) if np.isfinite(one) else None for name, one in variances.items()}
    return {name: replace(one, standard_error=errors[name]) for name, one in at.items()}
