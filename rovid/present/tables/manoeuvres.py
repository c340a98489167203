"""Tables of standard manoeuvres: in the runs, and as the coupled model predicts them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from rovid.core.formatting import plus_minus
from rovid.planar.manoeuvres import ManoeuvreMeasure, Measures
from rovid.planar.standard_manoeuvres import RunManoeuvre
from rovid.present.number_format import DASH, format_number, unit_symbol
from rovid.present.tables.table import Column, ResultTable, mixed_number_column, text_column

# Units that are shown in degrees.
_ANGLES = ("rad", "rad/s")
_TITLES = {"turning_circle": "Turning circles in the logs", "zigzag": "Zigzags in the logs"}
_MODEL_TITLES = {"circle": "Predicted turning circles", "zigzag": "Predicted zigzags"}


def run_manoeuvre_tables(found: Sequence[RunManoeuvre]) -> list[ResultTable]:
    """Turning circles and zigzags of the runs, as measured and as simulated; a table of each kind."""
    tables = []
    for kind, title in _TITLES.items():
        rows = [one for one in found if one.kind == kind]
        if not rows:
            continue
        units = _units(side for one in rows for side in (one.measured, one.simulated))
        table = ResultTable(title, text_column("run"), text_column("track"), *_columns(units))
        for one in rows:
            name = f"{one.run}, from {one.begin:.0f} s"
            table.add_row(name, "measured", *_cells(one.measured, units), begins_section=True)
            table.add_row("", "simulated", *_cells(one.simulated, units))
        tables.append(table)
    return tables


def model_manoeuvre_tables(measures: Measures) -> list[ResultTable]:
    """Standard manoeuvres of the model, with errors; names of ``measures`` are as "circle_port.advance"."""
    sides: dict[str, dict[str, ManoeuvreMeasure]] = {}
    for name, one in measures.items():
        manoeuvre, _, measure = name.partition(".")
        sides.setdefault(manoeuvre, {})[measure] = one
    tables = []
    for kind, title in _MODEL_TITLES.items():
        rows = {name: side for name, side in sides.items() if name.startswith(kind)}
        if not rows:
            continue
        units = _units(rows.values())
        table = ResultTable(title, text_column("manoeuvre"), *_columns(units))
        for name, side in rows.items():
            table.add_row(_manoeuvre_title(name), *_cells(side, units))
        tables.append(table)
    return tables


def _manoeuvre_title(name: str) -> str:
    kind, _, detail = name.partition("_")
    return f"to {detail}" if kind == "circle" else f"{detail}/{detail} deg"


def _units(sides: Iterable[Measures]) -> dict[str, str]:
    """Each measure with its unit, in their order."""
    return {name: _unit(one) for side in sides for name, one in side.items()}


def _columns(units: Mapping[str, str]) -> list[Column]:
    return [mixed_number_column(name.replace("_", " "), unit) for name, unit in units.items()]


def _cells(measures: Measures, names: Iterable[str]) -> list[str]:
    return [_cell(measures[name]) if name in measures else DASH for name in names]


def _cell(one: ManoeuvreMeasure) -> str:
    factor = 180.0 / math.pi if one.unit in _ANGLES else 1.0
    if one.standard_error is None:
        return format_number(factor * one.value)
    return plus_minus(factor * one.value, factor * one.standard_error)


def _unit(one: ManoeuvreMeasure) -> str:
    return unit_symbol(one.unit.replace("rad", "deg") if one.unit in _ANGLES else one.unit)
