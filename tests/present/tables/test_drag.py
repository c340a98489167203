"""The page's tables on drag."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rovid.estimate.steady_drag import DragFit
from rovid.present.page.report_data import ReportData
from rovid.present.tables.drag import directions_table, steady_table
from tests.present.tables.test_model import cells


@pytest.fixture(scope="module")
def fit(day: ReportData) -> DragFit:
    assert day.drag is not None
    return day.drag


def test_each_point_stands_with_its_residual_and_its_error(fit: DragFit) -> None:
    grid = steady_table(fit)
    assert grid.caption == "Steady turns that were fitted"
    assert cells(grid, "source") == [point.source for point in fit.points]
    for text, value, error in zip(cells(grid, "residual"), fit.residuals, fit.torque_error, strict=True):
        shown, known = (part.strip("\u2007\u2008") for part in text.split(" ± "))
        assert float(shown) == pytest.approx(value, abs=0.005)
        assert float(known) == pytest.approx(error, abs=0.005)


def test_when_it_was_is_said_only_where_it_is_known(fit: DragFit) -> None:
    known = {column.title for column in steady_table(fit).columns}
    table = [replace(point, start=np.nan, stop=np.nan) for point in fit.points]
    of_table = {column.title for column in steady_table(replace(fit, points=tuple(table))).columns}
    assert known - of_table == {"from–to, s"}


def test_both_directions_stand_first(fit: DragFit) -> None:
    rows = cells(directions_table(fit), "turns")
    assert rows[0] == "both"
    assert set(rows[1:]) == {"heading growing", "heading falling"}
