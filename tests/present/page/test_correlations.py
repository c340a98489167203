"""Parameter correlation: the covariance over the errors, shaded by size, a dash where it is not known."""

from __future__ import annotations

from dataclasses import replace

import pytest

from rovid.present.page.correlations import correlation_table
from rovid.present.page.report_data import ReportData
from rovid.store.parameter_file import Entry


def test_the_files_covariance_is_shown_as_correlation(day: ReportData) -> None:
    found = correlation_table(day.parameters)
    assert found is not None
    assert found.names == ("inertia I", "quadratic drag DQ", "linear drag DL")
    assert day.drag is not None
    expected = day.drag.estimate.correlation("quadratic_drag", "linear_drag")
    shown, shade = found.cells[1][2]
    assert float(shown.replace("−", "-")) == pytest.approx(expected, abs=0.005)
    assert found.cells[2][1] == (shown, shade)
    assert [found.cells[k][k] for k in range(3)] == [("1", 0)] * 3
    assert found.cells[0][1] == ("–", 0)  # by different methods


@pytest.mark.parametrize(("value", "shade"), [(0.3, 0), (-0.6, 1), (0.9, 2), (-0.99, 3)])
def test_the_stronger_the_darker(day: ReportData, value: float, shade: int) -> None:
    entry = Entry(value=1.0, standard_error=2.0, unit="s", method="maximum likelihood")
    one, other = "inertia", "thruster_lag.time_constant"
    stored = replace(
        day.parameters,
        entries={one: entry, other: entry},
        covariance={(one, one): 4.0, (other, other): 4.0, (one, other): 4.0 * value},
    )
    found = correlation_table(stored)
    assert found is not None
    assert found.names == ("inertia I", "thruster lag: time constant")
    assert found.cells[1][0] == (f"{value:+.2f}".replace("-", "−"), shade)


def test_without_any_pair_there_is_no_table(day: ReportData) -> None:
    assert correlation_table(replace(day.parameters, covariance={})) is None
