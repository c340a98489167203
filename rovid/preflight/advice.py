"""Advice before a fit: deficiencies of the logs, missing runs, and parameters that the data do not determine."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rovid.core.errors import DataError, RovidError, shortened_list
from rovid.core.formatting import plus_minus, significant
from rovid.effects.actuator_inputs import neutral_commands
from rovid.estimate.estimate import Estimate
from rovid.estimate.maximum_likelihood import fit_likelihood
from rovid.estimate.output_error import FINER_ADVICE, fit_regression
from rovid.faults.quick_model import log_parts
from rovid.faults.thrust_unit import inertia_fault
from rovid.preflight.clock_alignment import ClockOffsets
from rovid.preflight.command_effects import ThrusterCheck, all_reversed
from rovid.preflight.feedback_detection import SIGNIFICANCE_LEVEL, Feedback
from rovid.trial.axis import Axis
from rovid.trial.fault import FaultOverrides
from rovid.trial.preprocessing import Run, prepare
from rovid.trial.segments import Hold, SineRun, coarse_text, find_holds, find_sines
from rovid.trial.trial import Campaign, Trial, merged_remarks
from rovid.trial.vehicle import Vehicle

Weight = Literal["grave", "care", "aside"]

# Requirements on a campaign: levels each way, sine periods, cycles of each; time with one thruster alone and time of
# coasting, in periods of the cut-off.
_LEVELS, _SINES, _CYCLES, _ALONE, _COAST = 4, 2, 5, 16.0, 16.0
# Least number of reversals of a rudder in a zigzag: IMO's criteria ask for its first two overshoot angles.
_ZIGZAG = 3
# Parts of a log, above which a sine is in pieces.
_MANY_PARTS = 5
# Readings of all logs below which logs without a change of command are too short rather than wrong; decision.
_FEWEST = 100
# Levels that differ by less than this share of the largest count as one.
_SAME_LEVEL = 0.1
# Distance from the end of the bench curve as a share of its range; share of a trial there that is reported.
_AT_END, _SATURATED = 1e-3, 0.02
# Ratio of the estimated inertia to that of the rigid body that only wrong units or curves explain.
_IMPLAUSIBLE = 20.0
# The same ratio below which the scale of the thrust is in doubt: a body of uniform density has 1, and the water adds.
_LIGHT = 0.8
# Relative standard error of a parameter that is not determined; of a drag or buoyancy relative to the total.
_UNCERTAIN = 0.25


@dataclass(frozen=True, kw_only=True)
class Advice:
    """One deficiency of the logs."""

    kind: str  #: A stable word for programs.
    text: str  #: Full sentences; the first one is what to do, if anything can be done.
    #: "grave" if no fit is valid before it is corrected, "care" if it limits the fit, otherwise "aside".
    weight: Weight = "care"


def advise(
    trials: Sequence[Trial],
    vehicle: Vehicle,
    feedback: Sequence[Feedback] = (),
    clocks: ClockOffsets | None = None,
    thrusters: Sequence[ThrusterCheck] = (),
    overrides: FaultOverrides | None = None,
    *,
    all_read: bool = True,
) -> list[Advice]:
    """Advice sorted by severity; empty for a complete campaign.

    Unless ``all_read``, missing runs are not reported: they may be in the logs that could not be read.
    """
    if not trials:
        return []
    try:
        runs = prepare(Campaign(trials=tuple(trials), sources=()), vehicle)
    except RovidError as error:
        return [Advice(kind="filter", text=str(error), weight="grave")]
    if not runs.items[0].trial.has_actuators:
        # Releases need no commands.
        return []
    found: list[Advice] = []
    if vehicle.assumptions:
        text = f"Measure {vehicle.assumptions.listing}, and put it into rovid.toml, in place of a guess."
        found.append(Advice(kind="guessed", text=text))
    found += cut_logs(trials)
    found += joined_clocks(clocks) if clocks else ()
    if text := all_reversed(thrusters, vehicle.axis):
        found.append(Advice(kind="thruster", text=text, weight="grave"))
    for check in () if text else thrusters:
        if text := check.text(vehicle.axis):
            found.append(Advice(kind="thruster", text=text, weight="grave" if check.is_reversed else "care"))
    if text := coarse_text(trials):
        found.append(Advice(kind="coarse", text=f"{FINER_ADVICE} In these logs {text}."))
    found += _saturation(runs.items, vehicle)
    found += _feedback(feedback, vehicle.axis)
    if all_read:
        found += _missing_runs(runs.items, vehicle)
        found += _undetermined(runs.items, vehicle, overrides or FaultOverrides())
    return sorted(found, key=lambda one: ("grave", "care", "aside").index(one.weight))


# ---- deficiencies of the logs


def cut_logs(trials: Sequence[Trial]) -> Iterator[Advice]:
    """Logs whose end, or a part, is lost."""
    for text in merged_remarks(trials, ("truncated", "damaged")):
        yield Advice(kind="truncated", text=f"{text} If the recorder still has the whole file, copy it again.")


def joined_clocks(clocks: ClockOffsets) -> Iterator[Advice]:
    """Offsets between the files of one trial, with the setting of [join]."""
    for group in clocks.groups:
        text = clocks.text(group)
        if not group[0].certain:
            yield Advice(kind="clocks", text=text, weight="care" if group[0].is_significant else "aside")
            continue
        settings: dict[str, list[str]] = {}
        for clock in group:
            for key, setting in clock.join_settings.items():
                settings.setdefault(key, []).append(setting)
        tables = " and ".join(f"{key} = {{ {', '.join(entries)} }}" for key, entries in settings.items())
        yield Advice(kind="clock_offset", text=f"Put {tables} into [join] of rovid.toml. {text}", weight="grave")


def _saturation(runs: Sequence[Run], vehicle: Vehicle) -> Iterator[Advice]:
    for at, thruster in enumerate(vehicle.thrusters):
        if thruster.curve is None:
            continue
        low, high = thruster.curve.command[[0, -1]]
        margin = _AT_END * thruster.curve.span
        shares = []
        for run in runs:
            command = run.trial.commands[:, at]
            share = float(np.mean((command <= low + margin) | (command >= high - margin)))
            if share > _SATURATED:
                shares.append(f"{run.trial.name} {100.0 * share:.0f} %")
        if shares:
            text = (
                f"Log the command that the drive of {thruster.name} receives, or reduce it: the command is at the end "
                f"of its bench curve for part of the time ({shortened_list(shares)}). The thrust beyond is not known."
            )
            yield Advice(kind="saturation", text=text)


def _feedback(feedback: Sequence[Feedback], axis: Axis) -> Iterator[Advice]:
    """Feedback, and reversals that may be timed by a clock instead."""
    certain = [one for one in feedback if one.chance < SIGNIFICANCE_LEVEL]
    if certain:
        text = "Use `rovid fit` and `rovid diagnose`, which are valid under feedback; `fit-drag` and `fit-inertia` are "
        text += f"biased by it. {feedback_text(certain, axis)}"
        yield Advice(kind="feedback", text=text)
    uncertain = [one for one in feedback if one.chance >= SIGNIFICANCE_LEVEL]
    if uncertain:
        names = shortened_list([f"{one.name} (within {_distance(one.scatter, axis)})" for one in uncertain])
        text = (
            f"The commands reverse at the same {axis.position_words} each time: {names}. If the {axis.position_words} "
            "triggers the reversals, as in a zigzag test, this is feedback; if a clock does, it is not. There are too "
            "few reversals to decide."
        )
        yield Advice(kind="reversals", text=text, weight="aside")


def feedback_text(certain: Sequence[Feedback], axis: Axis) -> str:
    """Sentences on the evidence of significant feedback."""
    chance = max(one.chance for one in certain)
    rarity = (
        f"one log in {10 ** math.floor(-math.log10(chance))}" if chance >= 1e-6 else "fewer than one log in a million"
    )
    text = f"There is feedback, by an autopilot or a pilot: {'; '.join(_evidence(certain, axis))}. By chance, {rarity} "
    return f"{text}shows as much."


def _evidence(feedback: Sequence[Feedback], axis: Axis) -> Iterator[str]:
    """Logs with feedback, by kind of test."""
    templates = {
        "flow": "{} of the commands' own changes follow motion that the commands had not caused",
        "steps": f"{{}} of the size of new commands opposes the turn before them and the {axis.rate_words}",
    }
    for kind, template in templates.items():
        if logs := [one for one in feedback if one.seen_in == kind]:
            shares = [100.0 * one.share for one in logs]
            least, most = f"{min(shares):.0f}", f"{max(shares):.0f}"
            span = f"{least} %" if least == most else f"{least} to {most} %"
            yield f"in {shortened_list([one.name for one in logs])} {template.format(span)}"
    if logs := [one for one in feedback if one.seen_in == "reversals"]:
        widest = max(logs, key=lambda one: one.scatter)
        yield (
            f"{shortened_list([one.name for one in logs])} reversed at a {axis.position_words}, as in a zigzag test "
            f"(within {_distance(widest.scatter, axis)}; by a clock it would be {_distance(widest.by_duration, axis)})"
        )


def _distance(distance: float, axis: Axis) -> str:
    unit, factor = axis.display_unit
    return f"{significant(factor * distance, 2)} {unit}"


# ---- missing runs


def _missing_runs(runs: Sequence[Run], vehicle: Vehicle) -> Iterator[Advice]:
    axis = vehicle.axis
    holds: list[Hold] = []
    sines: list[SineRun] = []
    for run in runs:
        holds += find_holds(run.trial, vehicle, run.torque, run.rates.kernel.cutoff)
        sines += find_sines(run.trial, run.torque)
    up, down = (_count_levels([hold.torque for hold in holds if hold.torque * sign > 0.0]) for sign in (1.0, -1.0))
    if min(up, down) < _LEVELS:
        settling = "some swings" if axis.self_righting else "five time constants plus a minute"
        parameter = "Stiffness" if axis.self_righting else "Drag"
        held = "rudder" if vehicle.is_steered else "command"
        text = f"Hold the {held} at {_LEVELS} levels or more each way, each for {settling}: you have {up} with the "
        text += f"{axis.position_words} growing and {down} with it falling. {parameter} and differences between the "
        text += "directions depend on them."
        yield Advice(kind="holds", text=text)
    # A run's first cycle, and the last one without a torque after it, are not counted in `SineRun`.
    periods = _count_levels([sine.period for sine in sines if sine.cycles >= _CYCLES - 2])
    possible = 0
    for parts in log_parts(runs).values():
        # Faults, as lost rows, may have cut a log in many parts, over which the torque goes to and fro.
        torque = np.concatenate([run.torque for run in parts])
        reversals = np.count_nonzero(np.diff(np.sign(torque[torque != 0.0])))
        if vehicle.is_steered:
            possible += bool(reversals >= _ZIGZAG)
        else:
            possible += len(parts) > _MANY_PARTS and bool(reversals >= 2 * _CYCLES)
    if vehicle.is_steered:
        if not possible:
            text = f"Steer a zigzag with {_ZIGZAG} reversals or more: there is none. Inertia and lag depend on it."
            yield Advice(kind="sines", text=text)
    elif periods + possible < _SINES:
        longest = "that of its own swing" if axis.self_righting else "ten vehicle time constants"
        text = (
            f"Run sines of {_SINES} or more different periods, the longest about {longest}, each for {_CYCLES} cycles: "
            f"you have {'one' if periods else 'none'}. Inertia, lag and memory of the water depend on them."
        )
        yield Advice(kind="sines", text=text)
    # A self-righting vehicle may be released at the beginning of a run.
    earliest = 0.0 if axis.self_righting else 1.0
    needed = _COAST / runs[0].rates.kernel.cutoff
    if not any(hold.torque == 0.0 and hold.start >= earliest and hold.duration >= needed for hold in holds):
        stop = "Put the rudder amidships in a turn" if vehicle.is_steered else "Stop the thrusters under way"
        text = f"{stop} and wait {significant(needed, 2)} s or more: there is no coast-down."
        if axis.self_righting:
            text = f"Tilt the vehicle, let go of it and wait {significant(needed, 2)} s or more: there is no release."
        yield Advice(kind="coast", text=text)
    if len(vehicle.thrusters) > 1 and not _has_single_thruster_run(runs, vehicle):
        text = "Run each thruster by itself, both ways: none runs alone for long enough, and an imbalance between them "
        text += "cannot be found."
        yield Advice(kind="one_thruster", text=text)


def _count_levels(values: Sequence[float]) -> int:
    """Number of different sizes in ``values``."""
    levels: list[float] = []
    for size in sorted(np.abs(values)):
        if not levels or size > levels[-1] + _SAME_LEVEL * np.max(np.abs(values)):
            levels.append(size)
    return len(levels)


def _has_single_thruster_run(runs: Sequence[Run], vehicle: Vehicle) -> bool:
    neutral = neutral_commands(vehicle)
    needed = _ALONE / runs[0].rates.kernel.cutoff
    for run in runs:
        acting = (run.trial.commands != neutral) & (np.abs(vehicle.thrust(run.trial.commands)) > 0.0)
        single = acting.sum(axis=1) == 1
        if float(np.sum(np.diff(run.trial.time)[single[:-1]])) >= needed:
            return True
    return False


# ---- parameters


def _undetermined(runs: Sequence[Run], vehicle: Vehicle, overrides: FaultOverrides) -> Iterator[Advice]:
    """Parameters that a regression on all runs does not determine, and an implausible inertia.

    Where the regression leaves the inertia uncertain, `fit_likelihood` decides whether the logs determine it, and
    whether a vehicle can have it.
    """
    estimate, why = None, ""
    try:
        estimate = fit_regression(runs).estimate
    except RovidError as error:
        why = str(error)
    body = vehicle.rigid_body_inertia
    inertia = math.nan if estimate is None else estimate.value("inertia")
    # Without a rudder's coefficient the inertia has no scale.
    implausible = body is not None and inertia > 0.0 and not 1.0 / _IMPLAUSIBLE < inertia / body < _IMPLAUSIBLE
    implausible &= not vehicle.assumptions.includes_coefficient
    if estimate is None or implausible or not estimate.standard_error("inertia") <= _UNCERTAIN * inertia:
        try:
            fitted = fit_likelihood(runs, vehicle).estimate
        except RovidError as error:
            count = sum(int(run.trial.measured.sum()) for run in runs)
            if count < _FEWEST and not any(np.ptp(run.trial.commands, axis=0).any() for run in runs):
                seconds = sum(run.trial.duration for run in runs)
                raise DataError(
                    f"the logs last {seconds:.1f} s in all with {count} readings and no change of a command, "
                    "too short to determine the inertia.",
                    where=shortened_list([run.trial.name for run in runs]),
                    mend=f"Give logs of {_FEWEST} readings or more, in which commands change the "
                    f"{vehicle.axis.rate_words}.",
                ) from error
            yield Advice(kind="undetermined", text=str(error), weight="grave")
            return
        fault = None
        if "inertia" not in fitted.refused:
            fault = inertia_fault(fitted.value("inertia"), fitted.standard_error("inertia"), vehicle, runs)
        if fault is not None and not overrides.keep(fault):
            yield Advice(kind="scale", text=fault.text, weight="grave")
            return
    if estimate is None:
        yield Advice(kind="undetermined", text=f"A first regression fails, though not the fit: {why}")
        return
    # Guessed arms, curves and sizes give no more than the order of magnitude.
    if implausible and body is not None:
        text = (
            f"Check {vehicle.axis.arm_key}, thrust curve, mass and size, and the units of time and "
            f"{vehicle.axis.required_signals}: by its motion the vehicle would have {significant(inertia / body, 2)} "
            "times the inertia of its mass and size."
        )
        yield Advice(kind="scale", text=text)
    spread = 2.0 * estimate.standard_error("inertia")
    if body and not vehicle.relative_scale_error and body / _IMPLAUSIBLE < inertia < _LIGHT * body - spread:
        text = (
            "Measure the thrust by a pull or a hover for `rovid fit-thrust-scale`: by its motion the vehicle would "
            f"have {significant(inertia / body, 2)} times the inertia of its mass and size, to which the water adds."
        )
        yield Advice(kind="thrust_scale", text=text)
    yield from _hardly_determined(runs, vehicle, estimate)


def _hardly_determined(runs: Sequence[Run], vehicle: Vehicle, estimate: Estimate) -> Iterator[Advice]:
    hardly = {}
    for name, size in _relevant_sizes(runs, estimate).items():
        value, spread = estimate.value(name), estimate.standard_error(name)
        if spread > _UNCERTAIN * max(abs(value), size):
            hardly[name] = f"the {name.replace('_', ' ')}, {plus_minus(value, spread)} {estimate.unit(name)}"
    if hardly:
        options = " or ".join(f"`rovid plan --narrow {name}`" for name in hardly)
        mend = f"Let {options} write a run, once there is a parameter file"
        if vehicle.is_steered:
            mend = "Steer other zigzags and long turns, at small and large angles and several speeds ahead"
        text = f"{mend}: by a first regression these logs hardly determine {', and '.join(hardly.values())}."
        yield Advice(kind="undetermined", text=text)


def _relevant_sizes(runs: Sequence[Run], estimate: Estimate) -> dict[str, float]:
    """Value of each parameter that would cause all of the drag, or all of the force; a smaller one may be near zero."""
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
