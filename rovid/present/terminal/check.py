"""The logs before any fit on a terminal: what `rovid check` and `rovid init` find in them, and what to do first."""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from rich.console import Console

from rovid.core.errors import shortened_list
from rovid.preflight.check import CheckedLogs, LogCheck
from rovid.preflight.config_writer import assumptions_in, log_count_text
from rovid.preflight.log_survey import LogSurvey
from rovid.preflight.planar_check import PlanarCheck
from rovid.present.console import (
    ResultTable,
    mixed_number_column,
    print_labelled,
    print_path,
    print_text,
    show_caution,
    show_warnings,
    text_column,
)
from rovid.present.number_format import NAME_LENGTH, format_number, shorten_name
from rovid.trial.axis import AXES, YAW
from rovid.trial.fault import fault_texts, stopping
from rovid.trial.trial import merged_remarks

VERDICTS = {
    "go": ("Go:", "the logs are good enough for a fit.", "bold green"),
    "care": ("Go with care:", "the logs can be fitted; read this first.", "bold yellow"),
    "no_go": ("No go:", "a fit would fail, or be wrong. First of all:", "bold red"),
}
_DIRECTIONS = {1: "as rovid.toml says", -1: "the other way", 0: "not determined"}


def show_check(console: Console, checked: LogCheck | PlanarCheck) -> None:
    """Print the verdict, the first tasks, what logs and sensors hold, and then all other tasks and notes."""
    print_labelled(console, *VERDICTS[checked.verdict])
    for number, task in enumerate(check_tasks(checked), 1):
        print_text(console, f"{number}. {task}", len(f"{number}. "))
    console.print()
    if isinstance(checked, PlanarCheck):
        _show_sensors(console, checked)
    elif checked.trials:
        first = checked.trials[0]
        quantity, unit, factor = first.axis.measured_quantity(integrated=first.rate_only)
        shown_unit, shown_factor = first.axis.display_unit
        travel = f"{'turned' if first.axis.angular else 'went'} {shown_unit}"
        titles = ("length s", "holds", "sine runs", "Hz", f"{quantity} noise {unit}", travel, "samples")
        table = ResultTable("Logs", text_column("log"), *map(mixed_number_column, titles), text_column("remarks"))
        for trial, facts in zip(checked.trials, checked.facts, strict=True):
            table.add_row(
                shorten_name(trial.name, NAME_LENGTH),
                f"{trial.duration:.0f}",
                str(facts["held_commands"]),
                str(facts["sine_runs"]),
                format_number(1.0 / trial.sampling_interval),
                format_number(factor * facts["noise"], 2),
                f"{shown_factor * facts['travel']:.0f}",
                str(facts["samples"]),
                ", ".join(f"{remark.count} {remark.kind}" for remark in trial.remarks) or "none",
            )
        console.print(table)
        if any(thruster.observed.direction for thruster in checked.thrusters):
            columns = map(mixed_number_column, ("certainty (standard errors)", "share of explained motion %"))
            text = "Thrusters, by these logs alone"
            table = ResultTable(text, text_column("thruster"), text_column("direction"), *columns)
            for thruster in checked.thrusters:
                observed = thruster.observed
                share = 100.0 * max(observed.explained_share, 0.0)
                direction = _DIRECTIONS[observed.direction]
                table.add_row(thruster.name, direction, f"{abs(observed.t_statistic):.0f}", f"{share:.0f}")
            console.print(table)
    show_warnings(console, check_notes(checked))


def check_notes(checked: CheckedLogs) -> list[str]:
    """Advice that asks for no action, and the remarks of the readers."""
    asides = [advice.text for advice in checked.advice if advice.weight == "aside"]
    remarks = merged_remarks(checked.trials)
    # A lost part of a log is a task.
    remarks = [text for text in remarks if not any(advice.text.startswith(text) for advice in checked.advice)]
    return [*asides, *remarks, *(remark.text for remark in checked.remarks)]


def check_tasks(checked: CheckedLogs) -> Iterator[str]:
    """Tasks before a fit: reasons of a "no go" first."""
    yield from fault_texts(stopping(checked.faults))
    yield from (advice.text for advice in checked.advice if advice.weight == "grave")
    problems = _merged_problems(checked.problems)
    if isinstance(checked, PlanarCheck):
        yield from problems
    elif problems:
        bad = len(checked.problems)
        count = f"{bad} of {bad + len(checked.trials)} logs cannot be used"
        if len(problems) > 1:
            yield f"{count} (reasons below): {shortened_list(list(checked.problems))}."
            yield from problems
        else:
            yield f"{count}. {problems[0]}" if bad > 1 else problems[0]
    yield from fault_texts(fault for fault in checked.faults if not fault.stops)
    yield from (advice.text for advice in checked.advice if advice.weight == "care")


def _merged_problems(problems: Mapping[str, str]) -> list[str]:
    """Each reason why logs cannot be used, led by the logs, and lines, with this fault."""
    places: dict[str, list[str]] = {}
    for name, problem in problems.items():
        if located := re.fullmatch(rf".*{re.escape(name)}((?::\d+)*): (.*)", problem, re.DOTALL):
            places.setdefault(located[2], []).append(name + located[1])
        elif name in problem:
            places[problem] = []
        else:
            places.setdefault(problem, []).append(name)
    return [f"{shortened_list(logs)}: {reason}" if logs else reason for reason, logs in places.items()]


def _show_sensors(console: Console, checked: PlanarCheck) -> None:
    """Print what the sensors of the coupled model are, and what drives each motion."""
    if not checked.sensors:
        return
    titles = ("Hz", "readings", "noise", "gaps", "longest gap s")
    columns = [*map(mixed_number_column, titles[:3]), text_column("unit"), *map(mixed_number_column, titles[3:])]
    table = ResultTable("Sensors", text_column("sensor"), *columns)
    for one in checked.sensors:
        unit, factor = _unit(one.name)
        noise = format_number(factor * one.noise, 2, "unknown")
        gap = format_number(one.longest_gap, 2) if one.gaps else "none"
        cells = format_number(one.rate), str(one.readings), noise, unit, str(one.gaps), gap
        table.add_row(one.name.replace("_", " "), *cells)
    console.print(table)
    motion = map(mixed_number_column, ("thrust RMS", "speed RMS"))
    table = ResultTable("Motions", text_column("axis"), *motion, text_column("unit"), text_column("driven by"))
    for driven in checked.axes:
        axis = AXES[driven.axis]
        speed = format_number(driven.velocity, 2, "not measured")
        force = format_number(driven.force, 2) if driven.force else "none"
        actuators = ", ".join(driven.actuators) or "nothing"
        table.add_row(driven.axis, force, speed, f"{axis.force_unit}, {axis.rate_unit}", actuators)
    console.print(table)


def _unit(sensor: str) -> tuple[str, float]:
    """Unit for people, and its number in one SI unit."""
    if sensor == "heading":
        return AXES["yaw"].display_unit
    if sensor == "yaw_rate":
        unit, factor = AXES["yaw"].display_unit
        return f"{unit}/s", factor
    return ("m/s", 1.0) if sensor.endswith("velocity") else ("m", 1.0)


# Largest number of columns that an open question lists.
_CANDIDATES = 8


def show_survey(console: Console, survey: LogSurvey, written: Sequence[Path]) -> None:
    """Print the columns that were recognised, open questions, and the next steps."""
    guess, config = assumptions_in(survey), written[0]
    for signal in survey.unrecognised:
        option = "command" if signal == "command" else "heading"
        unused = [source for mapping in survey.mappings.values() for source in mapping.unused][:_CANDIDATES]
        candidates = f" It may be one of {', '.join(unused)}." if unused else ""
        text = f"no column was recognised as {signal}; name it in {config}, or with --{option}.{candidates}"
        print_labelled(console, "Open:", text)
    if survey.unknown_directions:
        verb = survey.axis.motion_verb.removesuffix("s")
        thrusters = ", ".join(survey.unknown_directions)
        print_labelled(console, "Open:", f"which way {thrusters} {verb} the vehicle: the logs do not show it.")
    show_caution(console, guess)
    if survey.profile is not None:
        origin = "a guess, from the outputs that turn it" if survey.profile_guessed else "as published"
        print_labelled(console, "Vehicle:", f"{survey.profile.name} ({survey.profile.id}), {origin}.")
    if survey.join is not None:
        parts = " and ".join(survey.join.parts)
        print_labelled(console, "Joined:", f"files whose names differ in {parts} form one trial.")
    for group in survey.clock_offsets.groups:
        print_labelled(console, "Clocks:", survey.clock_offsets.text(group))
    console.print(_guess_table(survey))
    show_warnings(console, survey.warnings)
    for path in written:
        print_path(console, f"written: {path}")
    task = f"measure {guess.listing}, and enter the result in {config}" if guess else f"check the columns in {config}"
    print_labelled(console, "Next:", f"{task}; then")
    axis = "" if survey.axis is YAW else f" --axis {survey.axis.name}"
    axis = " --axes planar" if survey.with_planar else axis
    for name in ("check", "report"):
        print_path(console, f"  rovid {name} {survey.folder}{axis}")


def _guess_table(survey: LogSurvey) -> ResultTable:
    """The columns that were recognised."""
    columns = map(text_column, ("signal", "taken from", "unit", "why"))
    table = ResultTable(f"Guessed from {log_count_text(survey)}", *columns)
    for mapping in survey.mappings.values():
        for name, signal_guess in mapping.signals.items():
            table.add_row(name, signal_guess.source, signal_guess.unit, signal_guess.reason)
        for command in mapping.commands:
            table.add_row(f"command of {command.name}", command.source, "", command.reason)
        for rudder in mapping.rudders:
            table.add_row(f"angle of {rudder.name}", rudder.angle.source, rudder.angle.unit, rudder.angle.reason)
    for planar in survey.planar.values() if survey.with_planar else ():
        if planar.propeller[0]:
            table.add_row("command of propeller", planar.propeller[0], "", "by name; it does not turn the vehicle")
        for name, signal_guess in planar.signals.items():
            table.add_row(name, signal_guess.source, signal_guess.unit, signal_guess.reason)
    return table
