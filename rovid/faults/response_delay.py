"""Delay of the motion after the commands, of either sign, with its standard error.

The torque, shifted in time, is fitted by acceleration, drag and trim. The shift with the smallest residual is the
delay. Its standard error is a jackknife over blocks, because the residuals are autocorrelated. Clocks that are far
apart are found by correlations over half of a log.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.faults.clock_drift import BLOCK
from rovid.faults.log_regressors import first_order
from rovid.faults.quick_model import log_name, log_parts
from rovid.trial.preprocessing import Run
from rovid.trial.rates import fast_fft_length

#: Range of the shifts in periods of the cut-off: no thruster answers later.
LONGEST = 8.0
# Step of the shifts in periods of the cut-off; range as a share of the longest run, at least and at most; maximum
# number of samples in the regressions. The longer range counts: clocks are set apart whatever the vehicle.
_STEP, _SHARE, _MOST, _MAX_SAMPLES = 0.1, 0.04, 0.2, 20_000
# The least number of jackknife blocks in which the torque varies, and its least share of the mean square. The steps of
# one block alone have no error.
_MIN_BLOCKS, _VARIES = 5, 1e-3
# A log has a delay of its own if that reduces its residual below this share.
_OWN_DELAY = 0.5
# Largest shift of a log as a share of its length, where clocks may be far apart; share of the readings that stay.
_FAR = 0.5
# Least share of the mean square residual without a shift that a further one explains, in runs that repeat themselves.
_EXPLAINED = 0.2
# Range around such a shift, in periods of the cut-off, in which it is refined.
_NEAR = 2.0
#: Jackknife blocks of a shift that explains most of the torque, by this share: its error decides nothing.
FEW_BLOCKS, MOSTLY = 3, 0.8
# Relative ridge of regular moments.
_RIDGE = 1e-12


@dataclass(frozen=True, kw_only=True, eq=False)
class ResponseDelay:
    """Delay of the motion after the commands in s, negative where the motion comes first, with its standard error."""

    delay: float
    error: float
    improvement: float  #: Share of the mean square residual that the shift removes.
    values: FloatArray  #: (p,) parameters of the regression without a shift; the trim is the last one.


class ShiftedTorque:
    """The moments of each log, by blocks, with the torque at each shift.

    ``memories``: time constants of the water's memory in periods of the cut-off, with which a torque of the angle is
    part of the regression. ``of_sensor``: the delay of the logged rate after the position instead. ``longest``: range
    of the shifts in periods of the cut-off.
    """

    def __init__(
        self, runs: Sequence[Run], *, memories: Sequence[float] = (), of_sensor: bool = False, longest: float = LONGEST
    ) -> None:
        period = runs[0].rates.kernel.period
        step, reach = _shift_grid(runs, longest)
        stride = sum(len(run.filtered_torque) for run in runs) // _MAX_SAMPLES + 1
        self._unit = step * period
        blocks = [
            (log_name(run), *block)
            for run in runs
            for block in _blocks(run, reach, step, stride, period, memories, of_sensor)
        ]
        names, *moments = zip(*blocks, strict=True) if blocks else ((), (), (), (), ())
        self._names, self._logs = np.array(names), tuple(log_parts(runs))
        self._moments = [np.array(each) for each in moments]

    def model_without(self, log: str) -> tuple[float, FloatArray, float] | None:
        """Delay in s of the other logs, (p,) parameters of the regression at it, and the mean square that they leave.

        None where the other logs determine no delay.
        """
        kept = self._names != log
        if not kept.any():
            return None
        xx, xt, tt = (each[kept].sum(axis=0) for each in self._moments[:3])
        total, fitted = _residuals(xx, xt, tt)
        best = int(np.argmin(total))
        if not 0 < best < len(total) - 1:
            return None
        return (len(total) // 2 - best) * self._unit, fitted[:, best], float(total[best] / xx[-1, -1])

    def delay(self, values: FloatArray | None = None, *, least_blocks: int = _MIN_BLOCKS) -> ResponseDelay | None:
        """The delay of all logs; None where they do not determine one within the range of the shifts.

        ``values``: (p,) parameters of the regression if they are known; only the last one, the trim, is fitted then.
        One sine alone determines no delay without them.
        """
        xx, xt, tt, variation = self._moments
        blocks = np.count_nonzero(variation > _VARIES * tt[:, tt.shape[1] // 2].mean()) if len(xx) else 0
        if blocks < FEW_BLOCKS:
            return None
        sums = xx.sum(axis=0), xt.sum(axis=0), tt.sum(axis=0)
        total, fitted = _residuals(*sums, values)
        nearest = _nearest_minimum(total)
        if nearest is None:
            return None
        rests = (_residuals(sums[0] - xx[at], sums[1] - xt[at], sums[2] - tt[at], values)[0] for at in range(len(xx)))
        best, *found = (_minimum(each, nearest) for each in (total, *rests))
        count, middle = len(found), len(total) // 2
        error = math.sqrt((count - 1.0) * float(np.var(found)))
        improvement = 1.0 - float(total[nearest]) / max(float(total[middle]), 1e-300)
        if not math.isfinite(best + error) or (blocks < least_blocks and improvement < MOSTLY):
            return None
        return ResponseDelay(
            delay=float(middle - best) * self._unit,
            error=error * self._unit,
            improvement=improvement,
            values=fitted if values is not None else fitted[:, middle],
        )

    def coarse_delays(self) -> dict[str, float]:
        """Delay of the response in s, to one step of the shifts, by log; that of all logs unless one differs much.

        A log differs where both its own model and the model of all logs halve its residual: one sine alone determines
        no delay, and the model of all logs may miss a cause.
        """
        if not self._names.size:
            return {}
        xx, xt, tt, _ = self._moments
        total, fitted = _residuals(xx.sum(axis=0), xt.sum(axis=0), tt.sum(axis=0))
        common = int(np.argmin(total))
        places = dict.fromkeys(self._logs, common)
        for name in dict.fromkeys(self._names.tolist()):
            rows = self._names == name
            own = xx[rows].sum(axis=0), xt[rows].sum(axis=0), tt[rows].sum(axis=0)
            known, free = _residuals(*own, fitted[:, common])[0], _residuals(*own)[0]
            best = int(np.argmin(known))
            if known[best] < _OWN_DELAY * known[common] and free[best] < _OWN_DELAY * free[common]:
                places[name] = best
        return {name: float((len(total) // 2 - place) * self._unit) for name, place in places.items()}


def response_delay(
    runs: Sequence[Run], values: FloatArray | None = None, *, memories: Sequence[float] = (), of_sensor: bool = False
) -> ResponseDelay | None:
    """`ShiftedTorque.delay` of the ``runs``."""
    return ShiftedTorque(runs, memories=memories, of_sensor=of_sensor).delay(values)


def far_delay(runs: Sequence[Run], values: FloatArray | None = None, usual: float = 0.0) -> ResponseDelay | None:
    """The delay where clocks may be apart by half of a log, compared with the ``usual`` one in s.

    ``values``: (4,) parameters of the motion and the trim, if they are known. None where no shift fits a vehicle.
    """
    if runs[0].trial.axis.self_righting:
        return None
    period, cutoff = runs[0].rates.kernel.period, runs[0].rates.kernel.cutoff
    step, _ = _shift_grid(runs, _NEAR)
    reach = int(_FAR * max(len(run.filtered_torque) for run in runs)) // step
    shifts = step * np.arange(-reach, reach + 1) + round(usual / period)
    every = [_correlations(run, shifts, values) for run in runs]
    xx, xt, tt = (np.sum(each, axis=0) for each in zip(*every, strict=True))
    # Enough readings; with fewer, the moments are round-off.
    enough = xx[:, -1, -1] > _FAR * xx[:, -1, -1].max()
    if not enough.any():
        return None
    shifts, xx, xt, tt = shifts[enough], xx[enough], xt[enough], tt[enough]
    counts, squares = xx[:, -1, -1], np.diagonal(xx, axis1=1, axis2=2)
    size = np.sqrt(squares.clip(np.maximum(_RIDGE * squares.max(axis=0), 1e-300)))
    scaled = xx / size[:, :, None] / size[:, None, :] + _RIDGE * np.eye(xx.shape[1])
    fitted = np.linalg.solve(scaled, (xt / size)[..., None])[..., 0] / size
    power = tt - xt[:, -1] ** 2 / counts
    share = ((tt - np.sum(xt * fitted, axis=1)) / power.clip(1e-300)).clip(1e-9)
    # Enough torque. The first column is the acceleration, or the torque by the parameters.
    usable = (power > _FAR * power.max()) & (fitted[:, 0] > 0.0)
    if not usable.any():
        return None
    # By likelihood: in a periodic run many shifts fit, and the readings of half a log are fitted more easily.
    best = int(np.argmin(np.where(usable, counts * np.log(share), np.inf)))
    moved = ShiftedTorque([_shifted(run, int(shifts[best])) for run in runs], longest=_NEAR)
    near = moved.delay(values, least_blocks=FEW_BLOCKS)
    if near is None:
        return None
    # Another scale, or the opposite sign with a slightly wrong model, may explain the log without a shift.
    distance = np.abs(shifts - round(usual / period))
    opposite = (fitted[:, 0] < 0.0) & (distance * period < _NEAR / cutoff)
    improvement = 1.0 - float(share[best] / share[opposite].min(initial=share[np.argmin(distance)]))
    return replace(near, delay=near.delay + float(shifts[best]) * period, improvement=improvement)


def _shifted(run: Run, samples: int) -> Run:
    """``run`` with its filtered torque later by a number of samples."""
    rows = np.arange(len(run.filtered_torque)) - samples
    inside = (rows >= 0) & (rows < len(rows))
    return replace(run, filtered_torque=np.where(inside, run.filtered_torque[rows.clip(0, len(rows) - 1)], np.nan))


def _correlations(run: Run, shifts: IntArray, values: FloatArray | None) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(m, p, p), (m, p) and (m,) moments of the regressors and of the torque, at m shifts in samples."""
    rates, torque = run.rates, np.nan_to_num(run.filtered_torque)
    motion = np.column_stack((rates.acceleration, np.abs(rates.rate) * rates.rate, rates.rate))
    columns = motion if values is None else (motion @ values[:-1])[:, None]
    x = np.where(rates.valid[:, None], np.column_stack((columns, np.ones(len(torque)))), 0.0)
    size = fast_fft_length(len(torque) + int(np.abs(shifts).max()))
    known, held, power = (
        np.fft.rfft(each, size).conj() for each in (1.0 * np.isfinite(run.filtered_torque), torque, torque**2)
    )
    xx = [[np.fft.irfft(np.fft.rfft(a * b, size) * known, size)[shifts] for a in x.T] for b in x.T]
    xt = [np.fft.irfft(np.fft.rfft(a, size) * held, size)[shifts] for a in x.T]
    tt = np.fft.irfft(np.fft.rfft(x[:, -1], size) * power, size)[shifts]
    return np.moveaxis(np.array(xx), -1, 0), np.array(xt).T, np.asarray(tt)


def _shift_grid(runs: Sequence[Run], longest: float) -> tuple[int, int]:
    """Step between shifts to try, and the largest one, in samples."""
    kernel = runs[0].rates.kernel
    step = max(round(_STEP / (kernel.cutoff * kernel.period)), 1)
    duration = max(run.trial.duration for run in runs)
    seconds = min(max(longest / kernel.cutoff, _SHARE * duration), _MOST * duration)
    return step, step * max(round(seconds / (step * kernel.period)), 1)


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
    if run.trial.axis.self_righting or memories:
        known &= np.isfinite(position)  # A logged rate may be known where the position is not.
    columns = [rate] if of_sensor else [rates.acceleration[inside], np.abs(rate) * rate, rate]
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


def _residuals(
    xx: FloatArray, xt: FloatArray, tt: FloatArray, values: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """(m,) sums of squares, and (p, m) parameters at each shift; the (p,) ``values`` if they are given."""
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
