"""The page's tables on drag from steady states, as text."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rovid.campaign.axis import Axis
from rovid.ground.numbers import plus_minus
from rovid.identify.estimate import Estimate
from rovid.identify.steady import DragFit
from rovid.identify.steady_points import SteadyPoint
from rovid.model.names import unit_of
from rovid.report.table import Column, Grid, Table, numbers, of_numbers, of_text, words
from rovid.report.text import NOTHING, column, in_form, number, steady_state, unit

_DIRECTIONS = {"up": "growing", "down": "falling"}


def steady_grid(fit: DragFit) -> Grid:
    """Steady states with residuals and leave-one-out."""
    axis = fit.estimate.axis
    quadratic, linear = _drag_units(axis)
    without_quadratic, without_linear, missed = fit.left_out.T.tolist()
    columns = (
        *_point_columns(fit.points),
        _torques(axis, fit.points),
        numbers(axis.rate_words, axis.rate_unit, _rates(fit.points)),
        numbers("residual", axis.push_unit, _residuals(fit)),
        numbers("without it: DQ", quadratic, column(without_quadratic, 4)),
        numbers("DL", linear, column(without_linear, 4)),
        numbers("predicted off by", axis.push_unit, in_form(missed, ".2f")),
    )
    return Grid(caption=f"{steady_state(axis).capitalize()}s that were fitted", columns=columns)


def _drag_units(axis: Axis) -> tuple[str, str]:
    return unit(unit_of("quadratic_drag", axis)), unit(unit_of("linear_drag", axis))


def _residuals(fit: DragFit) -> list[str]:
    """With their errors, where these are known."""
    if not fit.torque_error_known:
        return in_form(fit.residuals.tolist(), ".2f")
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
    return numbers(axis.push, axis.push_unit, in_form(torques, ".2f"))


def _point_columns(points: Sequence[SteadyPoint]) -> list[Column]:
    """Where the points come from, as far as it is known."""
    timed = commanded = False
    sources, spans, commands = [], [], []
    for point in points:
        timed |= math.isfinite(point.start)
        commanded |= bool(np.isfinite(point.command).any())
        sources.append(point.source)
        spans.append(f"{point.start:.0f} … {point.stop:.0f}")
        commands.append("; ".join(f"{value:.4g}" for value in point.command))
    columns = [words("source", sources)]
    if timed:
        columns.append(words("from … to, s", spans))
    if commanded:
        columns.append(words("command", commands))
    return columns


def unsteady_grid(fit: DragFit) -> Grid:
    """Held commands that were not fitted."""
    points, axis = fit.unsteady, fit.estimate.axis
    rates, changes = [], []
    for point in points:
        rates.append(number(point.rate, ".4f"))
        changes.append(plus_minus(point.drift, point.drift_error))
    columns = (
        *_point_columns(points),
        _torques(axis, points),
        numbers("mean rate", axis.rate_unit, rates),
        numbers("change over it", axis.rate_unit, changes),
    )
    return Grid(caption="Held commands left out, because the rate was still changing", columns=columns)


def directions_grid(fit: DragFit) -> Grid:
    """Drag of each direction alone beside that of both."""
    axis = fit.estimate.axis
    quadratic, linear = _drag_units(axis)
    table = Table(
        "Drag from each direction alone",
        of_text("turns" if axis.angular else "direction"),
        of_numbers(f"{steady_state(axis)}s"),
        of_numbers("DQ", quadratic),
        of_numbers("DL", linear),
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
