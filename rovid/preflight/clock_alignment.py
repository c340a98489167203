"""Offset and drift between two clocks from signals in both files: a heading, a yaw rate, or a copy of a command."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import shortened_list
from rovid.core.formatting import plus_minus, round_to_error, toml_key
from rovid.preflight.raw_columns import MIN_SAMPLES, Log, is_thruster_command, is_yaw_rate
from rovid.preflight.signal_guess import turn_of_heading
from rovid.trial.rates import integral

# Standard errors of a significant offset or drift, and s, the smallest offset that matters; decision.
SIGNIFICANT, _RELEVANT = 3.0, 0.02
# Number of clocks that one sentence lists.
_MAX_LISTED = 8
# Minimum correlation of two motions, and of two copies of a command.
_CORRELATED, _COPIED = 0.9, 0.999
# s and share of the common time, largest offsets.
_MAX_OFFSET, _MAX_SHARE = 30.0, 0.25
# Averaging windows, in sampling intervals of the coarser series. Alignments are compared with the best one up to this
# multiple of its standard error.
_WINDOWS, _COMPARABLE = (2.0, 5.0, 12.0, 30.0), 2.0
# Ratio of true to estimated standard error of the best alignment, from `benchmarks.clocks`.
_SELECTION_BIAS = 1.4
# Number of blocks for the standard error under autocorrelation, at most and at least.
_BLOCKS, _MIN_BLOCKS = 24, 8
_ITERATIONS, _MAX_DRIFT = 12, 0.01


@dataclass(frozen=True, kw_only=True)
class ClockOffset:
    """Offset of the clock of a file, or of one part of every trial."""

    name: str  #: File, or part, as in [join].
    #: ``offset``, ``error``: s to be added to the clock, besides the setting in [join], at the beginning of the file if
    #: the clock drifts (`at_start`); standard error.
    offset: float
    error: float
    #: ``drift``, ``drift_error``: ppm; 0 where not significant.
    drift: float = 0.0
    drift_error: float = 0.0
    by: str = ""  #: Columns that were compared; empty for an estimate from the response of the vehicle.
    given: tuple[float, float] = (0.0, 0.0)  #: s and ppm that [join] adds already.
    middle: float = 0.0  #: s from the beginning of the file to where the offset holds; 0 if the clock drifts.

    @property
    def certain(self) -> bool:
        """Whether the offset is significant and cannot be a delay of the thrusters."""
        return self.is_significant and (bool(self.by) or self.offset < 0.0)

    @property
    def is_significant(self) -> bool:
        """Whether the offset is significant and relevant, or the clock drifts."""
        return abs(self.offset) > max(SIGNIFICANT * self.error, _RELEVANT) or (bool(self.by) and bool(self.drift))

    @property
    def at_start(self) -> Self:
        """The offset at the beginning of the file if the drift is significant; else the offset without a drift."""
        if abs(self.drift) <= SIGNIFICANT * self.drift_error:
            return replace(self, drift=0.0, drift_error=0.0)
        offset, error = self.offset - 1e-6 * self.drift * self.middle, 1e-6 * self.drift_error * self.middle
        return replace(self, offset=offset, error=math.hypot(self.error, error), middle=0.0)

    @property
    def with_given(self) -> Self:
        """The whole offset, with the setting in [join]."""
        drift = self.drift + self.given[1]
        return replace(self, offset=self.offset + self.given[0], drift=drift, given=(0.0, 0.0))

    @property
    def join_settings(self) -> dict[str, str]:
        """Lines for the tables "offset" and "drift" of [join]."""
        key = toml_key(self.name)
        settings = {"offset": f"{key} = {round_to_error(self.given[0] + self.offset, self.error)}"}
        if self.drift:
            settings["drift"] = f"{key} = {round_to_error(self.given[1] + self.drift, self.drift_error)}"
        return settings

    @property
    def text(self) -> str:
        """One sentence for people."""
        size = f"{plus_minus(abs(self.offset), self.error)} s"
        if self.by:
            drift = f" and {plus_minus(self.drift, self.drift_error)} ppm" if self.drift else ""
            side = "behind" if self.offset > 0.0 else "ahead"
            return f"The clock of {self.name} is {size} {side}{drift}, by {self.by} in both files."
        if self.certain:
            return (
                f"The vehicle responds {size} before the commands in {self.name}, which is impossible: that clock is "
                "ahead by as much, and by the delay of the thrusters in addition."
            )
        if self.is_significant:
            return (
                f"The vehicle responds {size} after the commands in {self.name}: a lag or delay of the thrusters, or a "
                "clock that is behind. The logs do not show which."
            )
        offset = plus_minus(self.offset, self.error)
        return f"Clock offset between the commands in {self.name} and the motion: {offset} s (none seen)."


@dataclass(frozen=True, kw_only=True)
class ClockOffsets:
    """Offsets of all joined files; ``lag`` is the time constant of the thrusters in s, 0 if not significant."""

    offsets: tuple[ClockOffset, ...] = ()
    lag: float = 0.0

    @property
    def groups(self) -> list[tuple[ClockOffset, ...]]:
        """Clocks with the same kind of finding."""
        kinds: dict[tuple[bool, ...], list[ClockOffset]] = {}
        for clock in self.offsets:
            kinds.setdefault((clock.certain, clock.is_significant, bool(clock.by)), []).append(clock)
        return list(map(tuple, kinds.values()))

    def text(self, clocks: Sequence[ClockOffset]) -> str:
        """Sentences on one of the groups."""
        first, *others = clocks
        text = first.text
        if self.lag and not first.by:
            text += f" In addition, thrust seems to lag the command by {self.lag:.2g} s."
        if others:
            listed = [f"{other.name} {plus_minus(other.offset, other.error)}" for other in others]
            text += f" Likewise, s to be added: {shortened_list(listed, _MAX_LISTED)}."
        return text


@dataclass(frozen=True, kw_only=True, eq=False)
class _Integral:
    """Integral of a signal at (n,) times in s, which gives the mean rate over any window."""

    source: str
    time: FloatArray
    values: FloatArray
    is_command: bool = False
    is_gyro: bool = False

    @property
    def interval(self) -> float:
        return float(np.median(np.diff(self.time)))

    def rate(self, instants: FloatArray, window: float) -> FloatArray:
        """(m,) mean rates over ``window`` s around ``instants``."""
        after = np.interp(instants + 0.5 * window, self.time, self.values)
        return np.asarray((after - np.interp(instants - 0.5 * window, self.time, self.values)) / window)

    def slope(self, instants: FloatArray, window: float) -> FloatArray:
        """(m,) time derivatives of that rate."""
        step = 0.5 * window
        return np.asarray((self.rate(instants + step, window) - self.rate(instants - step, window)) / (2.0 * step))


def align_clocks(reference: Log, other: Log) -> ClockOffset | None:
    """Offset of the clock of ``other`` in the middle of its log; None without a signal that ``reference`` has, too."""
    found: list[ClockOffset] = []
    for one in _integrals(reference):
        for two in _integrals(other):
            if one.is_command is two.is_command and _common_time(one, two) > 0.0:
                step = max(one.interval, two.interval)
                for window in (step * factor for factor in _WINDOWS):
                    offset = _coarse_offset(one, two, step, window)
                    alignment = None if offset is None else _refined(one, two, window, offset)
                    if alignment is not None:
                        found.append(alignment)
    if not found:
        return None
    best = min(found, key=lambda alignment: alignment.error)
    # The scatter of comparable alignments is a part of the error.
    near = [alignment for alignment in found if alignment.error <= _COMPARABLE * best.error]
    error = math.hypot(best.error, float(np.std([alignment.offset for alignment in near])))
    drift_error = math.hypot(best.drift_error, float(np.std([alignment.drift for alignment in near])))
    return replace(best, error=_SELECTION_BIAS * error, drift_error=_SELECTION_BIAS * drift_error)


def _integrals(log: Log) -> Iterator[_Integral]:
    for source, column in log.items():
        known = np.isfinite(column.values) & np.isfinite(column.time)
        time, values = column.time[known], column.values[known]
        if len(time) < 4 * MIN_SAMPLES or not np.ptp(values) > 0.0 or not (np.diff(time) > 0.0).all():
            continue
        if (turn := turn_of_heading(column)) is not None:
            yield _Integral(source=source, time=time, values=np.unwrap(values * (2.0 * np.pi / turn)))
        elif is_yaw_rate(source):
            yield _Integral(source=source, time=time, values=integral(time, values), is_gyro=True)
        elif is_thruster_command(source):
            held = np.append(0.0, np.cumsum(values[:-1] * np.diff(time)))
            yield _Integral(source=source, time=time, values=held, is_command=True)


def _common_time(one: _Integral, two: _Integral) -> float:
    """Time in s that both cover, by their clocks."""
    return float(min(one.time[-1], two.time[-1]) - max(one.time[0], two.time[0]))


def _coarse_offset(one: _Integral, two: _Integral, step: float, window: float) -> float | None:
    """Offset in s of the clock of ``two``, to one ``step``, at the largest correlation of the mean rates."""
    longest = min(_MAX_OFFSET, _MAX_SHARE * _common_time(one, two))
    grid = np.arange(max(one.time[0], two.time[0]), min(one.time[-1], two.time[-1]), step)
    if len(grid) < 4 * MIN_SAMPLES:
        return None
    a, b = one.rate(grid, window), two.rate(grid, window)
    a, b = a - a.mean(), b - b.mean()
    size = float(np.sqrt((a @ a) * (b @ b)))
    if not size > 0.0:
        return None
    # Zero padding avoids circular correlation.
    count = 2 * len(grid)
    products = np.fft.irfft(np.fft.rfft(a, count) * np.conj(np.fft.rfft(b, count)), count) / size
    shifts = np.fft.fftfreq(count, 1.0 / count) * step
    near = np.abs(shifts) <= longest
    # Unbiased for the shorter overlap at larger shifts.
    correlation = products[near] * len(grid) / np.maximum(len(grid) - np.abs(shifts[near]) / step, 1.0)
    at = int(np.argmax(np.abs(correlation)))
    # A maximum at the end of the range is no maximum.
    if abs(correlation[at]) >= _CORRELATED - 0.1 and abs(shifts[near][at]) < longest - step:
        return float(shifts[near][at])
    return None


def _refined(one: _Integral, two: _Integral, window: float, offset: float) -> ClockOffset | None:
    """Gauss-Newton from the coarse ``offset``, with the slopes of ``two`` as instruments: both signals are noisy."""
    margin = 0.5 * window + 2.0 * two.interval
    grid = np.arange(two.time[0] + margin, two.time[-1] - margin, max(one.interval, two.interval))
    middle, drift, step = 0.5 * (two.time[0] + two.time[-1]), 0.0, np.full(2, np.inf)
    for _ in range(_ITERATIONS):
        mapped = grid + offset + drift * (grid - middle)
        inside = (mapped > one.time[0] + margin) & (mapped < one.time[-1] - margin)
        if int(inside.sum()) < 4 * MIN_SAMPLES:
            return None
        at, since = grid[inside], grid[inside] - middle
        reference, target = one.rate(mapped[inside], window), two.rate(at, window)
        if not (np.ptp(reference) > 0.0 and np.ptp(target) > 0.0):
            return None
        gain, level = np.polyfit(reference, target, 1)
        residual = target - level - gain * reference
        basis = np.column_stack((np.ones(len(at)), since))
        jacobian = gain * one.slope(mapped[inside], window)[:, None] * basis
        instruments = two.slope(at, window)[:, None] * basis
        inverse = np.linalg.pinv(instruments.T @ jacobian)
        step = inverse @ (instruments.T @ residual)
        offset, drift = offset + float(step[0]), drift + float(step[1])
        if not (np.isfinite(step).all() and abs(offset) < _MAX_OFFSET and abs(drift) < _MAX_DRIFT):
            return None
    # Sandwich estimate over blocks, because the residuals are autocorrelated.
    blocks = max(min(_BLOCKS, len(residual) // MIN_SAMPLES), _MIN_BLOCKS)
    sums = np.array([block.sum(axis=0) for block in np.array_split(instruments * residual[:, None], blocks)])
    errors = np.sqrt(np.diag(inverse @ (sums.T @ sums) @ inverse.T) * (blocks / (blocks - 1.0)))
    correlation = float(np.corrcoef(reference, target)[0, 1])
    if not (abs(correlation) >= (_COPIED if one.is_command else _CORRELATED) and abs(step[0]) <= errors[0]):
        return None
    # A logged rate is either an instantaneous value or the mean of an interval, a heading may be late by either.
    ambiguity = max(one.interval, two.interval) / 12.0**0.5 if one.is_gyro is not two.is_gyro else 0.0
    return ClockOffset(
        name="",
        offset=offset,
        error=math.hypot(float(errors[0]), ambiguity),
        drift=1e6 * drift,
        drift_error=1e6 * float(errors[1]),
        middle=float(middle - two.time[0]),
        by=one.source if one.source == two.source else f"{two.source} against {one.source}",
    )
