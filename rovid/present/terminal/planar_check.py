"""The result of `rovid check --axes planar` on a terminal: verdict, tasks, sensors, degrees of freedom, logs."""

from __future__ import annotations

import math
from collections.abc import Iterator

from rich.console import Console

from rovid.preflight.planar_check import PlanarCheck
from rovid.present.console import print_labelled, print_text, show_warnings
from rovid.present.number_format import format_number
from rovid.present.tables.table import ResultTable, mixed_number_column, text_column
from rovid.present.terminal.check import VERDICTS, merged_problems
from rovid.trial.axis import AXES
from rovid.trial.fault import fault_texts
from rovid.trial.trial import merged_remarks


def show_planar_check(console: Console, checked: PlanarCheck) -> None:
    """Print the verdict, the tasks, what the sensors and the motions are, and the notes."""
    print_labelled(console, *VERDICTS[checked.verdict])
    for number, task in enumerate(planar_tasks(checked), 1):
        print_text(console, f"{number}. {task}", len(f"{number}. "))
    console.print()
    if checked.sensors:
        console.print(_sensors_table(checked))
        console.print(_axes_table(checked))
    show_warnings(console, planar_notes(checked))


def planar_notes(checked: PlanarCheck) -> list[str]:
    """Advice that asks for no action, and the remarks of the readers."""
    asides = [advice.text for advice in checked.advice if advice.weight == "aside"]
    return [*asides, *merged_remarks(checked.trials), *(remark.text for remark in checked.remarks)]


def planar_tasks(checked: PlanarCheck) -> Iterator[str]:
    """Tasks before a fit, the most serious first."""
    yield from fault_texts(checked.faults)
    yield from merged_problems(checked.problems)
    yield from (advice.text for advice in checked.advice if advice.weight != "aside")


def _sensors_table(checked: PlanarCheck) -> ResultTable:
    titles = ("Hz", "readings", "noise", "gaps", "longest gap s")
    columns = [*map(mixed_number_column, titles[:3]), text_column("unit"), *map(mixed_number_column, titles[3:])]
    table = ResultTable("Sensors", text_column("sensor"), *columns)
    for one in checked.sensors:
        unit, factor = _unit(one.name)
        noise = "unknown" if math.isnan(one.noise) else format_number(factor * one.noise, 2)
        gap = format_number(one.longest_gap, 2) if one.gaps else "none"
        table.add_row(
            one.name.replace("_", " "), format_number(one.rate), str(one.readings), noise, unit, str(one.gaps), gap
        )
    return table


def _unit(sensor: str) -> tuple[str, float]:
    """Unit for people, and its number in one SI unit."""
    if sensor == "heading":
        return AXES["yaw"].display_unit
    if sensor == "yaw_rate":
        unit, factor = AXES["yaw"].display_unit
        return f"{unit}/s", factor
    return ("m/s", 1.0) if sensor.endswith("velocity") else ("m", 1.0)


def _axes_table(checked: PlanarCheck) -> ResultTable:
    columns = map(mixed_number_column, ("thrust RMS", "speed RMS"))
    table = ResultTable("Motions", text_column("axis"), *columns, text_column("unit"), text_column("driven by"))
    for one in checked.axes:
        axis = AXES[one.axis]
        speed = format_number(one.velocity, 2) if math.isfinite(one.velocity) else "not measured"
        force = format_number(one.force, 2) if one.force else "none"
        driven = ", ".join(one.actuators) or "nothing"
        table.add_row(one.axis, force, speed, f"{axis.force_unit}, {axis.rate_unit}", driven)
    return table
