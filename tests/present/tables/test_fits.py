"""Tables of parameters, trials, drag and correlations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rovid.estimate.steady_drag import DragFit
from rovid.present.console import ResultTable
from rovid.present.number_format import DASH
from rovid.present.report_data import NestedSimulation, ReportData
from rovid.present.tables import fits, trials
from rovid.present.tables.fits import correlation_table, directions_table, steady_table
from rovid.store.parameter_file import Entry
from rovid.trial.assumptions import Assumptions
from rovid.trial.trial import Campaign
from rovid.trial.vehicle import Thruster


def cells(grid: ResultTable, title: str) -> list[str]:
    """A column, without the spaces that put its points in line."""
    column = next(column for column in grid.columns if column.title == title)
    return [cell.strip("\u2007\u2008") for cell in column.cells]


def test_a_parameter_that_the_file_lacks_has_its_row(day: ReportData) -> None:
    entries = {name: entry for name, entry in day.parameters.entries.items() if name != "linear_drag"}
    grid = fits.parameters_table(replace(day, parameters=replace(day.parameters, entries=entries)))
    rows = dict(zip(cells(grid, "parameter"), cells(grid, "value ± standard error"), strict=True))
    assert rows["linear drag DL"] == "not determined"
    assert "±" in rows["inertia I"]


def test_the_coupled_model_has_no_interval_where_a_guess_decides(day: ReportData) -> None:
    guess = Assumptions(items=("yaw_arm of fore", "yaw_arm of aft"), thrusters=2)
    entry = Entry(value=27.6, standard_error=2.5, unit="kg m^2", method="")
    stored = replace(day.parameters, entries={"yaw.inertia": entry})
    assert cells(fits.planar_parameters_table(stored, guess), "95 % interval")[0] == "guessed"
    assert "…" in cells(fits.planar_parameters_table(stored, Assumptions()), "95 % interval")[0]


def test_intervals_have_the_decimals_of_their_values_and_hold_them(day: ReportData) -> None:
    grid = fits.parameters_table(day)
    for value, interval in zip(cells(grid, "value ± standard error"), cells(grid, "95 % interval"), strict=True):
        low, high = map(float, interval.split(" … "))
        assert low < float(value.partition("\u00a0")[0]) < high


def test_each_trial_says_what_it_gave(day: ReportData) -> None:
    assert day.campaign is not None
    assert day.runs is not None
    gave = cells(trials.trials_table(day, day.campaign), "what it gave")
    assert any("periods of" in text for text in gave)
    assert any("steady turn" in text for text in gave)
    fewer = replace(day, runs=replace(day.runs, items=day.runs.items[1:]))
    left_out = trials.trials_table(fewer, day.campaign)
    assert cells(left_out, "what it gave")[0] == "left out"


def test_what_is_the_same_of_all_trials_is_said_once(day: ReportData) -> None:
    assert day.campaign is not None
    grid = trials.trials_table(day, day.campaign)
    assert grid.caption == "Trials, rate 20 Hz, longest gap 0.05 s"
    assert not {"rate", "longest gap", "noticed"} & {column.title for column in grid.columns}


def test_each_trial_stands_with_its_errors_without_and_with_what_was_found(day: ReportData) -> None:
    assert day.campaign is not None
    once = [column.title for column in trials.trials_table(day, day.campaign).columns]
    assert once[-2:] == ["R²", "heading off after 60 s"]
    worse = tuple(replace(item, fit=replace(item.fit, r2=0.5)) for item in day.simulations)
    found = day.parameters.model()
    stages = tuple(NestedSimulation(model=found, simulations=items) for items in (worse, day.simulations))
    grid = trials.trials_table(replace(day, nested=stages), day.campaign)
    assert set(cells(grid, "without: R²")) == {"0.5000"}
    assert cells(grid, "with: R²") == [f"{item.fit.r2:.4f}" for item in day.simulations]


def test_what_was_simulated_in_parts_stands_as_a_whole_by_the_plain_model(day: ReportData) -> None:
    assert day.campaign is not None
    item = day.simulations[0]
    part = replace(item, run=replace(item.run, trial=replace(item.run.trial, name="hold_0.csv part 1")))
    stages = (NestedSimulation(model=day.parameters.model(), simulations=(part,)),) * 2
    grid = trials.trials_table(replace(day, nested=stages), day.campaign)
    assert cells(grid, "R²") == [f"{item.fit.r2:.4f}" for item in day.simulations]


def test_a_logged_torque_has_no_curve(day: ReportData) -> None:
    vehicle = replace(day.vehicle, thrusters=(Thruster(name="torque", arm=1.0, curve=None),))
    assert cells(trials.thrusters_table(vehicle), "thrust") == ["torque logged"]
    assert cells(trials.thrusters_table(vehicle), "commands on the bench") == [DASH]


def test_without_logs_and_sources_there_is_no_table_of_hashes(day: ReportData) -> None:
    alone = replace(day, campaign=None, parameters=replace(day.parameters, sources=()))
    assert trials.sources_table(alone) is None
    trial = day.simulations[0].run.trial
    grid = trials.sources_table(replace(alone, campaign=Campaign(trials=(trial,), sources=())))
    assert grid is not None
    # Where all logs are used for the same, the table does not say for what.
    assert cells(grid, "log") == [trial.name]
    assert {column.title for column in grid.columns} == {"log", "SHA-256"}


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
