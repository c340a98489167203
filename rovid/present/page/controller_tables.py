"""The heading controller as the page words it, and its tables."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from rovid.control.design import ClosedLoopResult, ControllerDesign
from rovid.present.number_text import NOTHING, format_number, number_with_unit
from rovid.present.tables.table import Column, ResultTable, TableBuilder, number_column, text_column, words
from rovid.present.terminal.diagnosis_text import cycle_words


def gains_table(control: ControllerDesign) -> ResultTable:
    """Gains and margins; the margins over the parameters' uncertainty too, where that is known."""
    names, values, units, bounds = zip(*_gains(control), strict=True)
    shown = tuple(number_with_unit(value, its) for value, its in zip(values, units, strict=True))
    columns = [words("quantity", names), Column(title="value", cells=shown)]
    if control.spread is not None and control.margins.stable:
        columns.append(Column(title=f"95 % of {control.spread.draws} draws", cells=bounds))
    return ResultTable(caption="The controller and its margins", columns=tuple(columns))


def _gains(control: ControllerDesign) -> Iterator[tuple[str, str, str, str]]:
    """Quantity, value, unit, and what 95 % of the draws from the parameters' covariance keep."""
    law, margins, spread = control.law, control.margins, control.spread
    yield "gain on heading kp", format_number(law.kp, ".5g"), "N m/rad", NOTHING
    yield "gain on yaw rate kd", format_number(law.kd, ".5g"), "N m s/rad", NOTHING
    yield "damping ratio", format_number(control.damping, ".3f"), "", NOTHING
    yield "bandwidth", format_number(control.bandwidth, ".3g"), "rad/s", NOTHING
    yield "all that delays the loop", format_number(control.lag, ".2g"), "s", NOTHING
    if not margins.stable:
        return
    kept = (math.nan,) * 4
    if spread is not None:
        kept = spread.gain_db, spread.phase_deg, spread.delay_s, spread.sensitivity_peak
    yield "gain margin", _bounded(margins.gain_db, ".1f"), "dB", f"≥ {_bounded(kept[0], '.1f')}"
    yield "phase margin", format_number(margins.phase_deg, ".0f"), "deg", f"≥ {format_number(kept[1], '.0f')}"
    yield "delay margin", format_number(margins.delay_s, ".2f"), "s", f"≥ {format_number(kept[2], '.2f')}"
    yield "lag margin", _bounded(margins.lag_s, ".2f"), "s", NOTHING
    yield (
        "peak of the sensitivity",
        format_number(margins.sensitivity_peak, ".2f"),
        "",
        f"≤ {format_number(kept[3], '.2f')}",
    )


def _bounded(value: float, form: str) -> str:
    return "without limit" if math.isinf(value) else format_number(value, form)


def runs_table(control: ControllerDesign) -> ResultTable:
    """Every closed-loop run, in the order of the design."""
    table = TableBuilder(
        "Closed-loop runs, with 2 % of the torque in use as disturbance",
        text_column("run"),
        text_column("effects"),
        text_column("aid"),
        number_column("63 % after", "s"),
        number_column("10 to 90 % in", "s"),
        number_column("settled after", "s"),
        number_column("overshoot", "deg"),
        number_column("steady error", "deg"),
        number_column("torque rms", "N m"),
        text_column("limit cycle"),
    )
    for run in control.runs:
        effects = "all" if run.effects else "none"
        table.add(run.name, effects, _aid(run), *_measures(run), cycle_words(run, none="none"))
    grid = table.grid()
    if control.model.effects:
        return grid
    # Of a model without effects the column would say "none" in every row.
    return replace(grid, columns=tuple(column for column in grid.columns if column.title != "effects"))


def _measures(run: ClosedLoopResult) -> Iterator[str]:
    measures = run.metrics
    yield format_number(measures.time_constant, ".1f")
    yield format_number(measures.rise_time, ".1f")
    yield format_number(measures.settling_time, ".1f")
    yield format_number(measures.overshoot_deg, ".1f")
    yield format_number(measures.steady_error_deg, ".2f")
    yield format_number(measures.effort, ".1f")


def _aid(run: ClosedLoopResult) -> str:
    """What of the model the controller uses."""
    if not run.model_aid:
        return "none"
    return "drag and effects" if run.effects_known else "drag"
