"""Commands and motion on clocks with an offset: the vehicle moves before its commands change, which is impossible.

Where the motion comes later, a delay of the thrusters looks the same. With commands and motion in joined files, such a
delay is listed, and stays a rival of every delay or lag.

The delay of the motion after the commands has either sign. The torque, shifted in time, is fitted by acceleration, drag
and trim. The shift with the smallest residual is the delay. Its standard error is a jackknife over blocks, because the
residuals are autocorrelated. In a sine run a torque of the heading, as of wind, looks like a negative delay, and water
that follows the hull lets the motion begin faster than it goes on. Motion comes before its commands only if it does so
with a torque of the heading and of the past rate in the regression, too.

The delay of a heading after a logged rate follows from the same regression, of the heading's derivative on that rate. A
navigation filter delays its heading; a fit would take that for a delay of the commands or a lag of the thrusters.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.formatting import plus_minus
from rovid.faults.base import Detection, Detectors, RunsData, named
from rovid.faults.clock_drift import BLOCK, clock_drift
from rovid.faults.log_regressors import first_order
from rovid.faults.quick_model import fit_quick_model, log_name, log_parts
from rovid.trial.fault import Fault
from rovid.trial.preprocessing import Run, prepare_trials
from rovid.trial.rates import integral
from rovid.trial.trial import Trial

# Step and range of the shifts in periods of the cut-off, range as a share of the longest run, at least and at most;
# maximum number of samples in the regressions. The longer range counts: clocks are set apart whatever the vehicle.
_STEP, _LONGEST, _SHARE, _MOST, _MAX_SAMPLES = 0.1, 8.0, 0.04, 0.2, 20_000
# The least number of jackknife blocks in which the torque varies, and its least share of the mean square. The steps of
# one block alone have no error.
_MIN_BLOCKS, _VARIES = 5, 1e-3
# A log has a delay of its own if that reduces its residual below this share.
_OWN_DELAY = 0.5

# Time constants of the water's memory in periods of the cut-off. Shorter ones would stand for a clock that is early.
_MEMORIES = (1.0, 4.0)
#: Octaves of time constants, a basis of any slow linear response: water that swings back and forth is part of it.
OCTAVES = (1.0, 2.0, 4.0, 8.0)

#: (p, p), (p, m) and (m,) moments of p regressors, and of the torque at each of m shifts.
Moments = tuple[FloatArray, FloatArray, FloatArray]
# Smallest offset in periods of the cut-off, in sampling intervals, and in standard errors; and the least share of the
# mean square residual that it explains. Feedback and waves move the delay of undamaged logs by one sampling
# interval and explain 8 % at most (60 campaigns).
_MIN_OFFSET, _INTERVALS, _SIGNIFICANT, _EXPLAINED = 0.04, 2.0, 5.0, 0.2
# Least share of the mean square residual that a drift explains: at most 0.03 in 200 undamaged campaigns, half of them
# with a hidden cause.
_DRIFT_EXPLAINS = 0.05
# Probability that a delay of joined files is an offset of their clocks: the logs do not show which.
_RIVAL = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class ResponseDelay:
    """Delay of the motion after the commands in s, negative where the motion comes first, with its standard error."""

    delay: float
    error: float
    improvement: float  #: Share of the mean square residual that the shift removes.
    values: FloatArray  #: (p,) parameters of the regression without a shift; the trim is the last one.


def shift_grid(runs: Sequence[Run]) -> tuple[int, int]:
    """Step between shifts to try, and the largest one, in samples."""
    kernel = runs[0].rates.kernel
    step = max(round(_STEP / (kernel.cutoff * kernel.period)), 1)
    duration = max(run.trial.duration for run in runs)
    longest = min(max(_LONGEST / kernel.cutoff, _SHARE * duration), _MOST * duration)
    return step, step * max(round(longest / (step * kernel.period)), 1)


def response_delay(
    runs: Sequence[Run], values: FloatArray | None = None, *, memories: Sequence[float] = (), of_sensor: bool = False
) -> ResponseDelay | None:
    """The delay; None where the logs do not determine one within the range of the shifts.

    ``values``: (p,) parameters of the regression if they are known; only the last one, the trim, is fitted then. One
    sine alone determines no delay without them. ``memories``: time constants of the water's memory in periods of the
    cut-off, with which a torque of the angle is part of it. ``of_sensor``: the delay of the logged rate after the
    position instead.
    """
    period = runs[0].rates.kernel.period
    step, reach = shift_grid(runs)
    stride = sum(len(run.filtered_torque) for run in runs) // _MAX_SAMPLES + 1
    blocks = [block for run in runs for block in _blocks(run, reach, step, stride, period, memories, of_sensor)]
    if len(blocks) < _MIN_BLOCKS:
        return None
    xx, xt, tt, variation = (np.array(each) for each in zip(*blocks, strict=True))
    if np.count_nonzero(variation > _VARIES * tt[:, tt.shape[1] // 2].mean()) < _MIN_BLOCKS:
        return None
    sums = xx.sum(axis=0), xt.sum(axis=0), tt.sum(axis=0)
    total, fitted = _residuals(sums, values)
    nearest = _nearest_minimum(total)
    if nearest is None:
        return None
    rests = ((sums[0] - xx[at], sums[1] - xt[at], sums[2] - tt[at]) for at in range(len(blocks)))
    best, *found = (_minimum(each, nearest) for each in (total, *(_residuals(rest, values)[0] for rest in rests)))
    count, unit, middle = len(found), step * period, len(total) // 2
    error = math.sqrt((count - 1.0) * float(np.var(found)))
    if not math.isfinite(best + error):
        return None
    return ResponseDelay(
        delay=float(middle - best) * unit,
        error=error * unit,
        improvement=1.0 - float(total[nearest]) / max(float(total[middle]), 1e-300),
        values=fitted if values is not None else fitted[:, middle],
    )


def coarse_delays(runs: Sequence[Run]) -> dict[str, float]:
    """Delay of the response in s, to one step of the shifts, by log; that of all logs unless one differs much.

    A log differs where both its own model and the model of all logs halve its residual: one sine alone determines no
    delay, and the model of all logs may miss a cause.
    """
    step, reach = shift_grid(runs)
    period = runs[0].rates.kernel.period
    stride = sum(len(run.filtered_torque) for run in runs) // _MAX_SAMPLES + 1
    parts: dict[str, list[Moments]] = {}
    for run in runs:
        for xx, xt, tt, _ in _blocks(run, reach, step, stride, period):
            parts.setdefault(log_name(run), []).append((xx, xt, tt))
    if not parts:
        return {}
    moments = {name: _sums(each) for name, each in parts.items()}
    total, fitted = _residuals(_sums(moments.values()))
    common = int(np.argmin(total))
    delays = {}
    for run in runs:
        best = common
        if (own := moments.get(log_name(run))) is not None:
            known, _ = _residuals(own, fitted[:, common])
            free, _ = _residuals(own)
            best = int(np.argmin(known))
            if not (known[best] < _OWN_DELAY * known[common] and free[best] < _OWN_DELAY * free[common]):
                best = common
        delays[log_name(run)] = float((len(total) // 2 - best) * step * period)
    return delays


def _blocks(
    run: Run, reach: int, step: int, stride: int, period: float, memories: Sequence[float] = (), of_sensor: bool = False
) -> Iterator[tuple[FloatArray, FloatArray, FloatArray, float]]:
    """(p, p), (p, m) and (m,) moments of regressors and of the torque at each of m shifts; its variation."""
    rates = run.rates
    torque = np.gradient(rates.position, period) if of_sensor else run.filtered_torque
    count = len(torque)
    if count <= 2 * reach:
        return
    windows = np.lib.stride_tricks.sliding_window_view(torque, 2 * reach + 1)[::stride, ::step]
    inside = np.arange(reach, count - reach)[::stride]
    known = rates.valid[inside] & np.isfinite(windows).all(axis=1)
    rate, position = rates.rate[inside], rates.position[inside]
    columns = [rate]
    if not of_sensor:
        drag = np.abs(rate) * rate
        columns = [rates.acceleration[inside], drag, rate]
    if run.trial.axis.self_righting and not of_sensor:
        columns += [np.sin(position), np.cos(position)]
    elif memories:
        if run.trial.axis.angular:
            for k in (1.0, 2.0):
                columns += [np.sin(k * position), np.cos(k * position)]
        past = np.nan_to_num(rates.rate)
        columns += [first_order(past, memory / rates.kernel.cutoff, period)[inside] for memory in memories]
    x = np.column_stack((*columns, np.ones(len(inside))))
    length = max(int(BLOCK / (rates.kernel.cutoff * period * stride)), 10)
    for first in range(0, len(inside), length):
        rows = np.flatnonzero(known[first : first + length]) + first
        if len(rows):
            block, shifted = x[rows], windows[rows]
            yield (
                block.T @ block,
                block.T @ shifted,
                np.sum(shifted**2, axis=0),
                float(np.var(shifted[:, shifted.shape[1] // 2]) * len(rows)),
            )


def _sums(moments: Iterable[Moments]) -> Moments:
    xx, xt, tt = (np.sum(each, axis=0) for each in zip(*moments, strict=True))
    return xx, xt, tt


def _residuals(moments: Moments, values: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
    """(m,) sums of squares, and (p, m) parameters at each shift; the (p,) ``values`` if they are given."""
    xx, xt, tt = moments
    if values is not None:
        # Torque that the known parameters leave, and its trim.
        known = values[:-1]
        rest = tt - 2.0 * known @ xt[:-1] + known @ xx[:-1, :-1] @ known
        return np.asarray(rest - (xt[-1] - known @ xx[:-1, -1]) ** 2 / xx[-1, -1]), values
    size = np.sqrt(np.diag(xx)).clip(1e-300)
    scaled = xt / size[:, None]
    fitted = np.linalg.lstsq(xx / size[:, None] / size, scaled, rcond=1e-12)[0]
    return np.asarray(tt - np.sum(scaled * fitted, axis=0)), fitted / size[:, None]


def _nearest_minimum(residuals: FloatArray) -> int | None:
    """Minimum of the (m,) residuals that is nearest to no shift; None where a much lower residual is at an end.

    Commands that repeat themselves, as a sine, fit as well when they are shifted by a period. A shift that is further
    away has to explain a share of the residual without a shift that a nearer one leaves.
    """
    at = np.flatnonzero((residuals[1:-1] < residuals[:-2]) & (residuals[1:-1] <= residuals[2:])) + 1
    before, here, after = residuals[at - 1], residuals[at], residuals[at + 1]
    depths = here - (before - after) ** 2 / (8.0 * (before - 2.0 * here + after))  # Of the parabolas.
    lowest, middle = min(residuals.min(), depths.min(initial=np.inf)), len(residuals) // 2
    at = at[depths - lowest <= _EXPLAINED * residuals[middle]]
    return int(at[np.argmin(np.abs(at - middle))]) if len(at) else None


def _minimum(residuals: FloatArray, near: int) -> float:
    """Place of the minimum by a parabola, downhill from the shift ``near``; nan at an end."""
    at = near
    while 0 < at < len(residuals) - 1:
        before, here, after = residuals[at - 1 : at + 2]
        if before >= here <= after:
            bend = before - 2.0 * here + after
            return at + (0.5 * (before - after) / bend if bend > 0.0 else 0.0)
        at += 1 if after < before else -1
    return math.nan


def _detect(data: RunsData) -> Iterator[Detection[RunsData]]:
    parts = log_parts(data.runs)
    joined = all(run.trial.companion_files for run in data.runs)
    if joined and (drift := _drift(data.runs)):
        yield Detection(fault=drift)
        return
    found = response_delay(data.runs) if data.runs else None
    if found is None:
        return
    with_further = cache(partial(response_delay, data.runs, memories=_MEMORIES))  # Only for logs that seem to be early.
    if _is_early(found, data.runs) and _is_early(with_further(), data.runs):
        yield Detection(fault=_early_motion(tuple(parts), found))
        return
    model = fit_quick_model(data.runs, data.vehicle)
    # In a sine, half a period looks like commands of the opposite sign: such a log is examined as a foreign one.
    opposite = {log.name for log in model.regressors if log.is_opposite} if model else set()
    for name, runs in parts.items():
        if name in opposite:
            continue
        # A log alone hardly determines delay and model; the model of all logs is biased by hidden causes. Both agree.
        known, own = response_delay(runs, found.values), response_delay(runs)
        if own is None or not (_is_early(known, runs) and _is_early(own, runs)):
            continue
        common = with_further()
        if common is None or _is_early(response_delay(runs, common.values, memories=_MEMORIES), runs):
            yield Detection(fault=_early_motion((name,), own))
    if joined and _is_offset(found.delay, found, data.runs):
        text = (
            f"{named(tuple(parts))}: the vehicle moves {plus_minus(found.delay, found.error)} s after the commands of "
            "another file: a lag or delay of the thrusters, or a clock that is behind. The logs do not show which."
        )
        yield Detection(fault=replace(_fault(tuple(parts), found, text), confidence=_RIVAL))


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


def _early_motion(logs: Sequence[str], found: ResponseDelay) -> Fault:
    text = (
        f"{named(logs)}: the vehicle moves {plus_minus(-found.delay, found.error)} s before its commands change, which "
        "is impossible. The clock of the commands is ahead by that, and by the delay of the thrusters in addition. Put "
        "commands and motion on one clock, or shift one of them."
    )
    return replace(_fault(logs, found, text), stops=True)


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
