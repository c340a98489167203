"""The page's tables on drag from steady states, as text."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rovid.core.formatting import plus_minus
from rovid.estimate.estimate import Estimate
from rovid.estimate.steady_drag import DragFit
from rovid.estimate.steady_points import SteadyPoint
from rovid.model.parameter_names import unit_of
from rovid.present.number_text import NOTHING, format_numbers, steady_state_words, unit_symbol
from rovid.present.tables.table import Column, ResultTable, TableBuilder, number_column, numbers, text_column, words
from rovid.trial.axis import Axis

_DIRECTIONS = {"up": "growing", "down": "falling"}


def steady_table(fit: DragFit) -> ResultTable:
    """Steady states with residuals: torque less fit, with the error of the point's torque where that is known."""
    axis = fit.estimate.axis
    columns = (
        *_point_columns(fit.points),
        _torques(axis, fit.points),
        numbers(axis.rate_words, axis.rate_unit, _rates(fit.points)),
        numbers("residual", axis.force_unit, _residuals(fit)),
    )
    return ResultTable(caption=f"{steady_state_words(axis).capitalize()}s that were fitted", columns=columns)


def _drag_units(axis: Axis) -> tuple[str, str]:
    return unit_symbol(unit_of("quadratic_drag", axis)), unit_symbol(unit_of("linear_drag", axis))


def _residuals(fit: DragFit) -> list[str]:
    """With their errors, where these are known."""
    if not fit.torque_error_known:
        return format_numbers(fit.residuals.tolist(), ".2f")
    both = zip(fit.residuals, fit.torque_error, strict=True)
    return [f"{value:.2f} ± {error:.2f}" for value, error in both]


def _rates(points: Sequence[SteadyPoint]) -> list[str]:
    """With their errors, where these are known."""
    return [_rate(point) for point in points]


def _rate(point: SteadyPoint) -> str:
    if math.isfinite(point.rate_error):
        return plus_minus(point.rate, point.rate_error)
    return f"{point.rate:.4g}"


def _torques(axis: Axis, points: Sequence[SteadyPoint]) -> Column:
    torques = [point.torque for point in points]
    return numbers(axis.force_name, axis.force_unit, format_numbers(torques, ".2f"))


def _point_columns(points: Sequence[SteadyPoint]) -> list[Column]:
    """Where the points come from, as far as it is known."""
    columns = [words("source", [point.source for point in points])]
    if any(math.isfinite(point.start) for point in points):
        spans = [f"{point.start:.0f}–{point.stop:.0f}" for point in points]
        columns.append(words("from–to, s", spans))
    return columns


def directions_table(fit: DragFit) -> ResultTable:
    """Drag of each direction alone beside that of both."""
    axis = fit.estimate.axis
    quadratic, linear = _drag_units(axis)
    table = TableBuilder(
        "Drag from each direction alone",
        text_column("turns" if axis.angular else "direction"),
        number_column(f"{steady_state_words(axis)}s"),
        number_column("DQ", quadratic),
        number_column("DL", linear),
    )
    rows = {"both": fit.estimate}
    for name, each in fit.directions.items():
        rows[f"{axis.position_words} {_DIRECTIONS.get(name, name)}"] = each
    for name, each in rows.items():
        table.add(name, str(each.samples), _of(each, "quadratic_drag"), _of(each, "linear_drag"))
    return table.grid()


def _of(estimate: Estimate, name: str) -> str:
    if name in estimate.refused:
        return NOTHING
    return plus_minus(estimate.value(name), estimate.standard_error(name))
