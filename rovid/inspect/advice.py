"""Before a fit: what this campaign can tell, what it cannot, and which run is missing."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rovid.campaign.axis import Axis
from rovid.campaign.trial import Campaign, Trial
from rovid.campaign.vehicle import ThrustCurve, Vehicle
from rovid.effects import Effect, restoring_of
from rovid.effects.actuation import neutral_commands
from rovid.effects.restoring import columns
from rovid.ground.arrays import FloatArray, IntArray
from rovid.ground.errors import RovidError
from rovid.identify.estimate import Estimate
from rovid.identify.regression import fit_regression
from rovid.motion.rates import Rates
from rovid.motion.runs import Run, Runs, prepare
from rovid.motion.segments import Hold, SineRun, find_holds, find_sines

# Of a good campaign.
_LEVELS, _SINES, _CYCLES, _ALONE_SECONDS, _COAST_SECONDS = 4, 2, 5, 20.0, 20.0
_SETTLING, _TEN = "five time constants plus a minute", "ten vehicle time constants long"
_NO_COAST = "no coast-down: stop the thrusters under way"
# The same along an axis that rights itself.
_SWINGS, _OWN_SWING = "some swings", "that of its own swing"
_NO_RELEASE = "no release: tilt the vehicle, let go of it"
# Levels that differ by less than this share of the largest are one.
_SAME_LEVEL = 0.1
# A command within this share of its bench range from the end is at it; for this share of a trial that matters.
_AT_END, _MUCH = 1e-3, 0.02
# A command that goes with heading and rate so well is an autopilot's.
_FEEDBACK_R2 = 0.5
_FEEDBACK_SECONDS = 10.0
# Clocks are compared over so many s, and an offset beyond this is said.
_LONGEST_OFFSET, _OFFSET = 3.0, 0.15
# Steps of that, and how many readings are enough to compare by.
_STEP, _READINGS = 0.02, 20_000
# A parameter known worse than this share of itself, or a drag or buoyancy than of all there is, is not determined.
_VAGUE = 0.25


@dataclass(frozen=True, kw_only=True)
class Advice:
    """One thing to know before a fit; ``kind`` is a stable word, ``text`` full sentences."""

    kind: str
    text: str


def advise(trials: Sequence[Trial], vehicle: Vehicle) -> list[Advice]:
    """What to mind, and what to run besides; nothing where the campaign has all that a fit wants."""
    if not trials:
        return []
    try:
        runs = prepare(Campaign(trials=tuple(trials), sources=()), vehicle)
    except RovidError as error:
        return [Advice(kind="filter", text=str(error))]
    if not runs.items[0].trial.driven:
        # Of releases no commands are wanted.
        return []
    return [
        *_saturated(runs.items, vehicle),
        *_driven_back(runs.items),
        *_clocks(runs),
        *_missing(runs.items, vehicle),
        *_determined(runs.items),
    ]


def _saturated(runs: Sequence[Run], vehicle: Vehicle) -> Iterator[Advice]:
    for at, thruster in enumerate(vehicle.thrusters):
        if thruster.curve is None:
            continue
        shares = []
        for run in runs:
            share = _share_at_end(thruster.curve, run.trial.commands[:, at])
            if share > _MUCH:
                shares.append(f"{run.trial.name} {100.0 * share:.0f} %")
        if shares:
            text = (
                f"{thruster.name} is at the end of its bench curve for part of the time ({', '.join(shares)}). "
                "What was asked for beyond it is not known: log the command that the drive gets, or lower it."
            )
            yield Advice(kind="saturation", text=text)


def _share_at_end(curve: ThrustCurve, command: FloatArray) -> float:
    low, high = curve.command[[0, -1]]
    margin = _AT_END * curve.span
    at_end = (command <= low + margin) | (command >= high - margin)
    return float(np.mean(at_end))


def _driven_back(runs: Sequence[Run]) -> Iterator[Advice]:
    """Whether commands follow heading and rate, as an autopilot's do."""
    following = [run for run in runs if _follows(run) > _FEEDBACK_R2]
    # In a sine everything goes with everything.
    names = [run.trial.name for run in following if not find_sines(run.trial, run.torque)]
    if names:
        text = (
            f"{_listed(names)}: the commands follow {runs[0].trial.axis.position_words} and rate, so that an autopilot "
            "was on. `rovid fit` and `rovid diagnose` are right under feedback, `fit-drag` and `fit-inertia` biased."
        )
        yield Advice(kind="feedback", text=text)


def _follows(run: Run) -> float:
    """R^2 of how the drive changes on how position and rate change, over short stretches."""
    rates = run.rates
    step = max(round(0.5 / rates.kernel.period), 1)
    known = np.flatnonzero(run.valid & np.isfinite(rates.position))[::step]
    if len(known) < 30 or np.median(np.diff(known)) > 2 * step:
        return 0.0
    course = max(round(_FEEDBACK_SECONDS / (step * rates.kernel.period)), 3)
    # The set point moves, but slowly: what is left of each after a running mean.
    drive, *motion = (_less_mean(one[known], course) for one in (run.drive, rates.position, rates.rate))
    x = np.column_stack(motion)
    values, *_ = np.linalg.lstsq(x, drive, rcond=None)
    total = float(drive @ drive)
    # A vehicle's own answer to a command has the other sign: only what pushes back is feedback.
    if total <= 0.0 or values[0] >= 0.0:
        return 0.0
    left = drive - x @ values
    return 1.0 - float(left @ left) / total


def _less_mean(values: FloatArray, width: int) -> FloatArray:
    kernel = np.ones(width) / width
    mean = np.convolve(values, kernel, mode="same")
    # At the ends the mean takes in zeros from beyond.
    return np.asarray((values - mean)[width:-width])


def _clocks(runs: Runs) -> Iterator[Advice]:
    """Whether the vehicle moves before it is told to."""
    period = runs.items[0].rates.kernel.period
    each = max(round(_STEP / period), 1)
    most = round(_LONGEST_OFFSET / (each * period))
    steps = each * np.arange(-most, most + 1)
    misfits = np.array([_misfit(runs, int(shift)) for shift in steps])
    if not np.isfinite(misfits).all():
        return
    best = int(np.argmin(misfits))
    offset = -float(steps[best] * period)
    # Positive shifts are lags, which vehicles have.
    inside = 0 < best < len(steps) - 1
    if inside and offset > max(_OFFSET, 2.0 * period):
        text = (
            f"The vehicle moves {offset:.2g} s before its commands change: the clocks of the command and of the "
            f"{runs.axis.position_words} differ. Put them on one clock, or shift one of them, before the fit."
        )
        yield Advice(kind="clock_offset", text=text)


def _misfit(runs: Runs, shift: int) -> float:
    """Mean square that a regression leaves of a drive ``shift`` samples later."""
    restoring = restoring_of(runs.axis)
    readings = sum(len(run.drive) for run in runs.items)
    each = readings // _READINGS + 1
    rows, drives = [], []
    for run in runs.items:
        drive = _later(run.drive, shift)
        known = np.flatnonzero(run.rates.valid & np.isfinite(drive))[::each]
        rows.append(_regressors(run.rates, known, restoring))
        drives.append(drive[known])
    x = np.concatenate(rows)
    y = np.concatenate(drives)
    if len(y) < 10 * x.shape[1]:
        return math.nan
    values = np.linalg.lstsq(x, y, rcond=None)[0]
    left = y - x @ values
    return float(np.mean(left**2))


def _regressors(rates: Rates, rows: IntArray, restoring: Effect | None) -> FloatArray:
    """(n, k) what the drive of these rows works against: inertia, drag, a constant, and what brings back."""
    rate = rates.rate[rows]
    plain = (rates.acceleration[rows], np.abs(rate) * rate, rate, np.ones(len(rate)))
    return np.column_stack((*plain, columns(restoring, rates.position[rows])))


def _later(drive: FloatArray, shift: int) -> FloatArray:
    """The drive ``shift`` samples later, or earlier where that is negative; NaN where it was not logged."""
    late, early = max(shift, 0), max(-shift, 0)
    moved = np.full(len(drive), np.nan)
    moved[late : len(drive) - early] = drive[early : len(drive) - late]
    return moved


def _missing(runs: Sequence[Run], vehicle: Vehicle) -> Iterator[Advice]:
    """Runs that a campaign wants and this one has not."""
    holds: list[Hold] = []
    for run in runs:
        holds += find_holds(run.trial, vehicle, run.torque)
    yield from _missing_holds(holds, vehicle.axis)
    yield from _missing_sines(runs, vehicle.axis)
    if len(vehicle.thrusters) > 1 and not _alone(runs, vehicle):
        text = (
            "no thruster runs alone for a while: an imbalance between them cannot be told. Run each by itself, "
            "both ways."
        )
        yield Advice(kind="one_thruster", text=text)
    yield from _missing_coast(holds, vehicle.axis)


def _missing_holds(holds: Sequence[Hold], axis: Axis) -> Iterator[Advice]:
    settling, drag = (_SWINGS, "Stiffness") if axis.rights else (_SETTLING, "Drag")
    for way, name in ((1.0, "growing"), (-1.0, "falling")):
        levels = _levels([hold.torque for hold in holds if hold.torque * way > 0.0])
        if levels < _LEVELS:
            text = (
                f"{_counted(levels, 'level')} of held command with the {axis.position_words} {name}: run at least "
                f"{_LEVELS}, each for {settling}. {drag} and what differs between the directions rest on them."
            )
            yield Advice(kind="holds", text=text)


def _missing_sines(runs: Sequence[Run], axis: Axis) -> Iterator[Advice]:
    sines: list[SineRun] = []
    for run in runs:
        sines += find_sines(run.trial, run.torque)
    periods = _levels([sine.period for sine in sines if sine.cycles >= _CYCLES])
    if periods < _SINES:
        longest = _OWN_SWING if axis.rights else _TEN
        text = (
            f"{_counted(periods, 'period')} of sine with {_CYCLES} cycles or more: run sines of at least {_SINES} "
            f"periods, about {longest} and shorter. Inertia, lag and memory of the water rest on them."
        )
        yield Advice(kind="sines", text=text)


def _missing_coast(holds: Sequence[Hold], axis: Axis) -> Iterator[Advice]:
    # Along an axis that rights itself a run may begin with the vehicle let go of.
    what, early = (_NO_RELEASE, 0.0) if axis.rights else (_NO_COAST, 1.0)
    for hold in holds:
        if hold.torque == 0.0 and hold.duration >= _COAST_SECONDS and hold.start >= early:
            return
    yield Advice(kind="coast", text=f"{what} and wait {_COAST_SECONDS:.0f} s or more.")


def _counted(number: int, what: str) -> str:
    plural = "" if number == 1 else "s"
    return f"{number or 'no'} {what}{plural}"


def _levels(values: Sequence[float]) -> int:
    """How many of ``values`` differ."""
    sizes = sorted(np.abs(values))
    apart = _SAME_LEVEL * max(sizes, default=0.0)
    last, count = -math.inf, 0
    for size in sizes:
        if size > last + apart:
            last = size
            count += 1
    return count


def _alone(runs: Sequence[Run], vehicle: Vehicle) -> bool:
    neutral = neutral_commands(vehicle)
    for run in runs:
        pushes = np.abs(vehicle.thrust(run.trial.commands)) > 0.0
        moved = (run.trial.commands != neutral) & pushes
        single = moved.sum(axis=1) == 1
        intervals = np.diff(run.trial.time)
        if float(np.sum(intervals[single[:-1]])) >= _ALONE_SECONDS:
            return True
    return False


def _determined(runs: Sequence[Run]) -> Iterator[Advice]:
    """How well a regression over everything determines each parameter."""
    try:
        estimate = fit_regression(runs).estimate
    except RovidError as error:
        yield Advice(kind="undetermined", text=str(error))
        return
    for name, size in _sizes(runs, estimate).items():
        value = estimate.value(name)
        spread = estimate.standard_error(name)
        if spread > _VAGUE * max(abs(value), size):
            text = (
                f"{name.replace('_', ' ')} is hardly determined by these logs: {value:.3g} ± {spread:.2g} "
                f"{estimate.unit(name)} by a first regression."
            )
            yield Advice(kind="undetermined", text=text)


def _sizes(runs: Sequence[Run], estimate: Estimate) -> dict[str, float]:
    """What each parameter would be that did as much as all of its kind: one that is next to nothing may be so."""
    rates = np.concatenate([run.rates.rate for run in runs])
    torque = np.concatenate([run.torque for run in runs])
    rate = float(np.sqrt(np.nanmean(rates**2)))
    drag = estimate.value("quadratic_drag") * rate**2 + estimate.value("linear_drag") * rate
    known = {
        "quadratic_drag": drag / rate**2,
        "linear_drag": drag / rate,
        "net_buoyancy": float(np.sqrt(np.mean(torque[torque != 0.0] ** 2))),
    }
    return {name: known.get(name, 0.0) for name in estimate.names if name != "trim"}


def _listed(names: Sequence[str], most: int = 5) -> str:
    shown = ", ".join(names[:most])
    if len(names) <= most:
        return shown
    return f"{shown} and {len(names) - most} more"
