"""Before a fit: what this campaign can tell, what it cannot, and which run is missing."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import RovidError
from rovid.core.formatting import plus_minus, significant
from rovid.effects.actuator_inputs import neutral_commands
from rovid.estimate.estimate import Estimate
from rovid.estimate.instrumental_variables import fit_regression
from rovid.preflight.clock_offsets import response_lead
from rovid.preflight.clock_report import ClockOffsets
from rovid.preflight.feedback_detection import SIGNIFICANCE_LEVEL, Feedback
from rovid.preflight.thruster_check import ThrusterCheck
from rovid.signals.preprocessing import PreparedRuns, Run, prepare
from rovid.signals.segments import Hold, SineRun, find_holds, find_sines
from rovid.trial.axis import Axis
from rovid.trial.trial import Campaign, Trial
from rovid.trial.vehicle import ThrustCurve, Vehicle

Weight = Literal["grave", "care", "aside"]

# Of a good campaign.
_LEVELS, _SINES, _CYCLES, _ALONE_SECONDS, _COAST_SECONDS = 4, 2, 5, 20.0, 20.0
_SETTLING, _TEN = "five time constants plus a minute", "ten vehicle time constants long"
_COAST, _NO_COAST = "Stop the thrusters under way", "there is no coast-down"
# The same along an axis that rights itself.
_SWINGS, _OWN_SWING = "some swings", "that of its own swing"
_RELEASE, _NO_RELEASE = "Tilt the vehicle, let go of it", "there is no release"
# Levels that differ by less than this share of the largest are one.
_SAME_LEVEL = 0.1
# A command within this share of its bench range from the end is at it; for this share of a trial that matters.
_AT_END, _MUCH = 1e-3, 0.02
# Clocks are compared over so many s, and an offset beyond this is said.
_LONGEST_OFFSET, _OFFSET = 3.0, 0.15
# An inertia that is so many times the rigid body's, or so small a part of it, is that of another vehicle.
_ORDERS = 20.0
# A parameter known worse than this share of itself, or a drag or buoyancy than of all there is, is not determined.
_VAGUE = 0.25


@dataclass(frozen=True, kw_only=True)
class Advice:
    """One thing to know before a fit.

    Attributes
    ----------
    kind
        A stable word.
    text
        Full sentences; the first says what to do, where there is anything to do.
    weight
        "grave" where no fit is worth its name until it is mended, "care" where it limits one, "aside" otherwise.
    """

    kind: str
    text: str
    weight: Weight = "care"


def advise(
    trials: Sequence[Trial],
    vehicle: Vehicle,
    feedback: Sequence[Feedback] = (),
    clocks: ClockOffsets | None = None,
    pushes: Sequence[ThrusterCheck] = (),
    *,
    all_read: bool = True,
) -> list[Advice]:
    """What to mind, and what to run besides, the gravest first; nothing where there is all that a fit wants.

    What to run besides is said of ``whole`` campaigns alone: the logs that could not be read may hold it.
    """
    if not trials:
        return []
    try:
        runs = prepare(Campaign(trials=tuple(trials), sources=()), vehicle)
    except RovidError as error:
        return [Advice(kind="filter", text=str(error), weight="grave")]
    if not runs.items[0].trial.has_actuators:
        # Of releases no commands are wanted.
        return []
    found = [
        *_guessed(vehicle),
        *(_clocks_of_files(clocks) if clocks and clocks.offsets else _clocks(runs)),
        *_pushing(pushes, vehicle.axis),
        *_saturated(runs.items, vehicle),
        *_fed_back(feedback, vehicle.axis),
        *(_missing(runs.items, vehicle) if all_read else ()),
        *(_determined(runs.items, vehicle) if all_read else ()),
    ]
    return sorted(found, key=lambda one: ("grave", "care", "aside").index(one.weight))


def _guessed(vehicle: Vehicle) -> Iterator[Advice]:
    if vehicle.assumptions:
        text = f"Measure {vehicle.assumptions.listing}, and put that into rovid.toml: what is there is a guess of rovid init."
        yield Advice(kind="guessed", text=text)


def _pushing(pushes: Sequence[ThrusterCheck], axis: Axis) -> Iterator[Advice]:
    """Thrusters that do not do what rovid.toml says of them."""
    for push in pushes:
        if text := push.text(axis):
            yield Advice(kind="thruster", text=text, weight="grave" if push.is_reversed else "care")


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
                f"Log the command that the drive of {thruster.name} gets, or lower it: it is at the end of its bench "
                f"curve for part of the time ({shortened_list(shares)}), and what was asked for beyond is not known."
            )
            yield Advice(kind="saturation", text=text)


def _share_at_end(curve: ThrustCurve, command: FloatArray) -> float:
    low, high = curve.command[[0, -1]]
    margin = _AT_END * curve.span
    at_end = (command <= low + margin) | (command >= high - margin)
    return float(np.mean(at_end))


def _fed_back(feedback: Sequence[Feedback], axis: Axis) -> Iterator[Advice]:
    """What commands answer to, and reversals that may be called by the clock as well."""
    sure = [one for one in feedback if one.chance < SIGNIFICANCE_LEVEL]
    if sure:
        text = (
            "Take `rovid fit` and `rovid diagnose`, which are right under feedback; `fit-drag` and `fit-inertia` are "
            f"biased by it. There is feedback, by an autopilot or a hand: {'; '.join(_seen(sure, axis))}. Chance does "
            f"as much in {_seldom(max(one.chance for one in sure))}."
        )
        yield Advice(kind="feedback", text=text)
    open_ = [one for one in feedback if one.chance >= SIGNIFICANCE_LEVEL]
    if open_:
        names = shortened_list([f"{one.name} (within {_far(one.scatter, axis)})" for one in open_])
        text = (
            f"Reversed at the same {axis.position_words} each time: {names}. Called by that, as in a zigzag test, this "
            "is feedback at the reversals; called by the clock it is none. So few reversals do not tell which."
        )
        yield Advice(kind="reversals", text=text, weight="aside")


def _seen(feedback: Sequence[Feedback], axis: Axis) -> Iterator[str]:
    """In which logs, and how, each way of it once."""
    told = {
        "flow": "{} of the commands' own changes answer to motion that they had not caused",
        "steps": f"{{}} of the new commands' size goes against the turn before them and the {axis.rate_words}",
    }
    for kind, words in told.items():
        if logs := [one for one in feedback if one.seen_in == kind]:
            yield f"in {shortened_list([one.name for one in logs])} {words.format(_shares(logs))}"
    if logs := [one for one in feedback if one.seen_in == "reversals"]:
        widest = max(logs, key=lambda one: one.scatter)
        yield (
            f"{shortened_list([one.name for one in logs])} reversed at a {axis.position_words}, as in a zigzag test (within "
            f"{_far(widest.scatter, axis)}; by the clock it would be {_far(widest.by_duration, axis)})"
        )


def _shares(logs: Sequence[Feedback]) -> str:
    least, most = (f"{100.0 * end([one.share for one in logs]):.0f}" for end in (min, max))
    return f"{least} %" if least == most else f"{least} to {most} %"


def _seldom(chance: float) -> str:
    if chance < 1e-6:
        return "fewer than one log in a million"
    return f"one log in {10 ** math.floor(-math.log10(chance))}"


def _far(distance: float, axis: Axis) -> str:
    return f"{significant(axis.to_display(distance) or 0.0, 2)} {axis.display_unit[0]}"


def _clocks_of_files(clocks: ClockOffsets) -> Iterator[Advice]:
    """What [join] should say of the clocks of one trial's files."""
    for alike in clocks.groups:
        words = clocks.text(alike)
        if not alike[0].certain:
            yield Advice(kind="clocks", text=words, weight="care" if alike[0].is_significant else "aside")
            continue
        settings: dict[str, list[str]] = {}
        for clock in alike:
            for key, setting in clock.join_settings.items():
                settings.setdefault(key, []).append(setting)
        tables = " and ".join(f"{key} = {{ {', '.join(entries)} }}" for key, entries in settings.items())
        yield Advice(kind="clock_offset", text=f"Put {tables} into [join] of rovid.toml. {words}", weight="grave")


def _clocks(runs: PreparedRuns) -> Iterator[Advice]:
    """Whether the vehicle moves before it is told to."""
    offset = response_lead(runs, _LONGEST_OFFSET)
    # Where it is late that is a lag, which vehicles have.
    if offset is not None and offset > max(_OFFSET, 2.0 * runs.items[0].rates.kernel.period):
        text = (
            f"Put commands and {runs.axis.position_words} on one clock, or shift one of them: the vehicle moves "
            f"{offset:.2g} s before its commands change."
        )
        yield Advice(kind="clock_offset", text=text, weight="grave")


def _missing(runs: Sequence[Run], vehicle: Vehicle) -> Iterator[Advice]:
    """Runs that a campaign wants and this one has not."""
    holds: list[Hold] = []
    for run in runs:
        holds += find_holds(run.trial, vehicle, run.torque)
    yield from _missing_holds(holds, vehicle.axis)
    yield from _missing_sines(runs, vehicle.axis)
    yield from _missing_coast(holds, vehicle.axis)
    if len(vehicle.thrusters) > 1 and not _alone(runs, vehicle):
        text = (
            "Run each thruster by itself, both ways: none runs alone for a while, so that an imbalance between them "
            "cannot be told."
        )
        yield Advice(kind="one_thruster", text=text)


def _missing_holds(holds: Sequence[Hold], axis: Axis) -> Iterator[Advice]:
    settling, drag = (_SWINGS, "Stiffness") if axis.self_righting else (_SETTLING, "Drag")
    up, down = (_levels([hold.torque for hold in holds if hold.torque * way > 0.0]) for way in (1.0, -1.0))
    if min(up, down) < _LEVELS:
        text = (
            f"Hold the command at {_LEVELS} levels or more each way, each for {settling}: there are {up} with the "
            f"{axis.position_words} growing and {down} with it falling. {drag} and what differs between the directions "
            "rest on them."
        )
        yield Advice(kind="holds", text=text)


def _missing_sines(runs: Sequence[Run], axis: Axis) -> Iterator[Advice]:
    sines: list[SineRun] = []
    for run in runs:
        sines += find_sines(run.trial, run.torque)
    periods = _levels([sine.period for sine in sines if sine.cycles >= _CYCLES])
    if periods < _SINES:
        longest = _OWN_SWING if axis.self_righting else _TEN
        there = "there is one" if periods else "there is none"
        text = (
            f"Run sines of {_SINES} periods or more, about {longest} and shorter, each for {_CYCLES} cycles: {there}. "
            "Inertia, lag and memory of the water rest on them."
        )
        yield Advice(kind="sines", text=text)


def _missing_coast(holds: Sequence[Hold], axis: Axis) -> Iterator[Advice]:
    # Along an axis that rights itself a run may begin with the vehicle let go of.
    do, why, early = (_RELEASE, _NO_RELEASE, 0.0) if axis.self_righting else (_COAST, _NO_COAST, 1.0)
    for hold in holds:
        if hold.torque == 0.0 and hold.duration >= _COAST_SECONDS and hold.start >= early:
            return
    yield Advice(kind="coast", text=f"{do} and wait {_COAST_SECONDS:.0f} s or more: {why}.")


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


def _determined(runs: Sequence[Run], vehicle: Vehicle) -> Iterator[Advice]:
    """How well a regression over everything determines each parameter."""
    try:
        estimate = fit_regression(runs).estimate
    except RovidError as error:
        yield Advice(kind="undetermined", text=str(error), weight="grave")
        return
    yield from _scale(estimate, vehicle)
    for name, size in _sizes(runs, estimate).items():
        value = estimate.value(name)
        spread = estimate.standard_error(name)
        if spread > _VAGUE * max(abs(value), size):
            text = (
                f"Let `rovid plan --narrow {name}` write a run, once there is a parameter file: these logs hardly "
                f"determine the {name.replace('_', ' ')}, {plus_minus(value, spread)} {estimate.unit(name)} by a first "
                "regression."
            )
            yield Advice(kind="undetermined", text=text)


def _scale(estimate: Estimate, vehicle: Vehicle) -> Iterator[Advice]:
    """Whether arms, curves and inertia can all be right; guessed ones are known to no more than their order."""
    body = vehicle.rigid_body_inertia
    if body is None or not estimate.value("inertia") > 0.0:
        return
    ratio = estimate.value("inertia") / body
    if not 1.0 / _ORDERS < ratio < _ORDERS:
        axis = vehicle.axis
        text = (
            f"Look at {axis.arm_key}, thrust curve, mass and size, and at the units of time and {axis.required_signals}: to move "
            f"as it does the vehicle would have {significant(ratio, 2)} times the inertia that its mass and size give."
        )
        yield Advice(kind="scale", text=text)


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


def shortened_list(names: Sequence[str], most: int = 5) -> str:
    """The first of ``names``, and how many more there are."""
    shown = ", ".join(names[:most])
    if len(names) <= most:
        return shown
    return f"{shown} and {len(names) - most} more"
