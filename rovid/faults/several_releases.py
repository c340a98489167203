"""Several tests in one log: free decays one after another, or a hand that turns the vehicle between two tests.

An axis that rights itself is tested by releases: each decay of at least four half swings is a test. In other axes the
vehicle gains speed between two tests while no actuator pushes, by far more than the disturbances of all logs explain.

`FreeMotion` finds the motion in stretches without thrust that neither a command nor the water explains.

The model of all logs leaves a torque e = I rdot + DQ |r| r + DL r - T unexplained. Through the vehicle's time constant
tau it makes the rate e_tau tau / I. Disturbances and errors of the model do that in driven stretches, too: their level
is the median over the logs of the largest e_tau there. A hand exceeds this level by far, and the rate grows.
"""

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray
from rovid.core.errors import DataError
from rovid.faults.base import Detection, Detectors, RunsData, TrialData
from rovid.faults.log_regressors import first_order, held
from rovid.faults.quick_model import QuickModel, fit_quick_model, log_name
from rovid.trial.fault import Fault
from rovid.trial.preprocessing import Run, measured_spans, prepare_trials
from rovid.trial.rates import highest_cutoff
from rovid.trial.segments import find_releases, resolution
from rovid.trial.vehicle import Vehicle

# Torque of an actuator as a share of the largest torque of all logs, below which it does not push.
_NEUTRAL = 0.02
# Largest unexplained torque of a hand over the level, which is about three standard deviations of a disturbance. The
# largest in 60 undamaged campaigns, half of them in hard water, was 1.5; in 600 s of rest with a slow disturbance, 3.1.
_HAND = 5.0
# Share of a hand's largest unexplained torque from which a hand is at work.
_AT_WORK = 0.15
# Share of the variance of a run's unexplained torque that is proportional to the angle, from which it is a spring's: a
# hand moves the vehicle for a while alone.
_SPRING = 0.9
# Time constants, and periods of the cut-off, of rest that stay next to a test; the rest shows the trim and the
# disturbances. At an end of a run the rates are unknown for two periods: of less rest, nothing would be known.
_KEPT, _KEPT_PERIODS = 3.0, 10.0
# Share of the run's largest rate below which the vehicle is at rest, if the disturbances are not larger.
_REST = 0.05


@dataclass(frozen=True, kw_only=True)
class FreeStretch:
    """A stretch without thrust, all in s from the run's first sample."""

    begin: float
    end: float
    first: bool  #: Whether the run begins with this stretch.
    last: bool  #: Whether the run ends with it.
    rest: float  #: Instant at which the vehicle has come to rest; infinite if it does not.
    hand: tuple[float, float] | None  #: Interval in which a hand moves the vehicle; None without a hand.
    rate: float  #: Rate in rad/s or m/s to which the hand moves the vehicle; 0 without a hand.
    kept: float  #: s of rest that stay next to a test.


class FreeMotion:
    """The model of all logs and its level of unexplained torques."""

    def __init__(self, runs: Sequence[Run], vehicle: Vehicle) -> None:
        self.model = fit_quick_model(runs, vehicle)
        largest = max((float(np.abs(run.torque).max(initial=0.0)) for run in runs), default=0.0)
        self._free: dict[int, BoolArray] = {}
        for run in runs:
            pairs = zip(vehicle.thrusters, run.trial.commands.T, strict=True)
            torque = np.array([np.abs(thruster.torque(command)) for thruster, command in pairs]).max(axis=0)
            row = np.clip(np.searchsorted(run.trial.time, run.rates.time, side="right") - 1, 0, None)
            self._free[id(run)] = np.asarray(torque[row] <= _NEUTRAL * largest)
        self._unexplained: dict[int, FloatArray] = {}
        self.level = np.inf
        if self.model is not None:
            self._unexplained = {id(run): _unexplained(run, self.model) for run in runs}
            driven = []
            for key, free in self._free.items():
                if not free.all():
                    driven.append(float(np.nanmax(np.abs(self._unexplained[key][~free]), initial=0.0)))
            self.level = float(np.median(driven)) if driven else np.inf

    def stretches(self, run: Run) -> list[FreeStretch]:
        """The stretches without thrust of a run that has thrust elsewhere."""
        free = self._free[id(run)]
        if self.model is None or free.all() or not free.any():
            return []
        edges = np.flatnonzero(np.diff(free, prepend=False, append=False))
        return [self._stretch(run, self.model, *pair) for pair in edges.reshape(-1, 2).tolist()]

    def is_free(self, run: Run) -> BoolArray:
        """(m,) where no actuator pushes."""
        return self._free[id(run)]

    def _stretch(self, run: Run, model: QuickModel, begin: int, end: int) -> FreeStretch:
        time, tau = run.rates.time[begin:end], model.time_constant
        speed = np.nan_to_num(np.abs(run.rates.rate[begin:end]))
        known = np.isfinite(run.rates.rate[begin:end])
        disturbed = self.level * tau / model.inertia
        slow = max(_REST * float(np.nanmax(np.abs(run.rates.rate), initial=0.0)), disturbed)
        at_rest = np.flatnonzero(known & (speed <= slow))
        # The first instant, where the vehicle rests as soon as its rate is known.
        rest = float(time[0 if at_rest[0] == np.argmax(known) else at_rest[0]]) if at_rest.size else np.inf
        torque = np.abs(self._unexplained[id(run)][begin:end])
        torque[speed - np.minimum.accumulate(np.where(known, speed, np.inf)) < disturbed] = 0.0
        peak = float(torque.max(initial=0.0))
        hand = None
        # One step of a coarse heading is a pulse of the filtered rate, of about a period of the cut-off.
        step = 2.0 * run.rates.kernel.cutoff * resolution(run.trial.position[run.trial.measured])
        if peak > _HAND * (self.level + step * model.inertia / tau):
            at_work = time[torque > max(_AT_WORK * peak, self.level)]
            hand = max(float(at_work[0]) - tau, float(time[0])), float(at_work[-1]) + tau
        return FreeStretch(
            begin=float(time[0]),
            end=float(time[-1]),
            first=begin == 0,
            last=end == len(run.rates.time),
            rest=rest,
            hand=hand,
            rate=float(speed[int(torque.argmax())]) if hand else 0.0,
            kept=max(_KEPT * tau, _KEPT_PERIODS / run.rates.kernel.cutoff),
        )


@lru_cache(maxsize=1)
def free_motion(runs: tuple[Run, ...], vehicle: Vehicle) -> FreeMotion:
    """`FreeMotion` of the runs, which several kinds of faults examine one after another."""
    return FreeMotion(runs, vehicle)


def _unexplained(run: Run, model: QuickModel) -> FloatArray:
    """(m,) torque that the model leaves unexplained, through its time constant, about the median; 0 where unknown."""
    valid = run.valid
    known = moving_torque(run, model) - run.filtered_torque
    if not valid.any():
        return np.zeros(len(valid))
    position = held(run, run.rates.position)
    centred = known - np.median(known[valid]), position - np.mean(position[valid])
    unexplained, turned = (
        first_order(np.where(valid, each, 0.0), model.time_constant, run.rates.kernel.period) for each in centred
    )
    return _without_spring(unexplained, turned, valid)


def moving_torque(run: Run, model: QuickModel) -> FloatArray:
    """(m,) torque that moves the vehicle by ``model``; NaN where unknown."""
    rate = run.rates.rate
    return np.asarray(np.column_stack((run.rates.acceleration, np.abs(rate) * rate, rate)) @ model.values)


def _without_spring(torque: FloatArray, turned: FloatArray, valid: BoolArray) -> FloatArray:
    """The (m,) torque without a restoring torque by the angle ``turned``, as of a tether, if that explains it."""
    x, y = (each[valid] - each[valid].mean() for each in (turned, torque))
    product, power = float(x @ y), float(x @ x) * float(y @ y)
    if product >= 0.0 or not product**2 > _SPRING * power:
        return torque
    spring = product / float(x @ x) * (turned - turned[valid].mean()) + torque[valid].mean()
    return np.where(valid, torque - spring, 0.0)


def log_starts(runs: Sequence[Run]) -> dict[str, float]:
    """Name of each log -> s from the campaign's first trial to its beginning."""
    starts: dict[str, float] = {}
    for run in runs:
        starts[log_name(run)] = min(starts.get(log_name(run), np.inf), run.trial.campaign_time)
    return starts


def cut_out(data: RunsData, run: Run, intervals: Sequence[tuple[float, float]]) -> RunsData:
    """``data`` with the parts of ``run`` outside of the ``intervals`` in s, which are in order, in its place."""
    trial = run.trial
    edges = [0, *np.searchsorted(trial.time, np.ravel(intervals)).tolist(), len(trial.time)]
    kept = measured_spans(trial, (slice(*pair) for pair in zip(edges[::2], edges[1::2], strict=True)))
    trials = []
    for rows in kept:
        first, last = trial.time[rows][[0, -1]]
        trials.append(trial.part(rows, f"{trial.name}, {first:.1f} to {last:.1f} s" if len(kept) > 1 else trial.name))
    parts: Sequence[Run] = ()
    # An error: no part is long enough.
    with contextlib.suppress(DataError):
        if trials:
            cutoff = min(run.rates.kernel.cutoff, highest_cutoff(trials))
            parts = prepare_trials(trials, data.vehicle, cutoff=cutoff).items
    at = next(number for number, one in enumerate(data.runs) if one is run)
    return replace(data, runs=[*data.runs[:at], *parts, *data.runs[at + 1 :]])


def _detect_decays(data: TrialData) -> Iterator[Detection[TrialData]]:
    trial = data.trial
    if trial.has_actuators or not trial.axis.self_righting:
        return
    releases = find_releases(trial)
    if len(releases) < 2:
        return
    begins = [float(trial.time[rows][0]) for rows in releases]
    text = f"{trial.name}: the log holds {len(begins)} releases, at {_instants(begins)} s."
    fault = _fault(trial.name, tuple(begins), text, len(begins))
    yield Detection(fault=fault, done="The log was cut there.", repair=lambda data: data.cut_at(*begins))


def _detect_hands(data: RunsData) -> Iterator[Detection[RunsData]]:
    if data.vehicle.axis.self_righting:
        return
    motion, starts = free_motion(tuple(data.runs), data.vehicle), log_starts(data.runs)
    for run in data.runs:
        stretches = [one for one in motion.stretches(run) if one.hand and not one.first and not one.last]
        hands = [one.hand[0] for one in stretches if one.hand]
        if not hands:
            continue
        offset, axis = run.trial.campaign_time - starts[log_name(run)], run.trial.axis
        at, rate = tuple(offset + instant for instant in hands), max(one.rate for one in stretches)
        shown = f"{np.rad2deg(rate):.2g} deg/s" if axis.angular else f"{rate:.2g} {axis.rate_unit}"
        text = (
            f"{log_name(run)}: the log holds {len(hands) + 1} tests. Between them, at {_instants(at)} s, the vehicle "
            f"was moved without a command, at up to {shown}."
        )
        fault = _fault(log_name(run), at, text, len(hands) + 1)
        repair = partial(cut_out, run=run, intervals=[_interval(one) for one in stretches])
        yield Detection(fault=fault, done="The log was cut there.", repair=repair)


def _interval(stretch: FreeStretch) -> tuple[float, float]:
    """Interval in s to leave out: from the hand, or from long rest before it, to its end, or to long rest after it."""
    first, last = stretch.hand or (stretch.begin, stretch.end)
    return min(first, stretch.rest + stretch.kept), min(max(last, stretch.end - stretch.kept), stretch.end)


def _fault(log: str, at: tuple[float, ...], text: str, count: int) -> Fault:
    return Fault(fault="several_releases", logs=(log,), at=at, size=float(count), unit="tests", text=text, remedy="cut")


def _instants(at: tuple[float, ...] | list[float]) -> str:
    return ", ".join(f"{instant:.1f}" for instant in at)


DETECTORS: Detectors = {"trial": (_detect_decays,), "runs": (_detect_hands,)}
