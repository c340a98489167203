"""The page's tables say what the evidence holds."""

from __future__ import annotations

from dataclasses import replace

from rovid.present.number_text import NOTHING
from rovid.present.page.nested_simulations import NestedSimulation
from rovid.present.page.report_data import ReportData
from rovid.present.tables import model
from rovid.present.tables.table import ResultTable
from rovid.trial.trial import Campaign
from rovid.trial.vehicle import Thruster


def cells(grid: ResultTable, title: str) -> list[str]:
    """A column, without the spaces that put its points in line."""
    column = next(column for column in grid.columns if column.title == title)
    return [cell.strip("\u2007\u2008") for cell in column.cells]


def test_a_parameter_that_the_file_lacks_has_its_row(day: ReportData) -> None:
    entries = {name: entry for name, entry in day.parameters.entries.items() if name != "linear_drag"}
    grid = model.parameters_table(replace(day, parameters=replace(day.parameters, entries=entries)))
    rows = dict(zip(cells(grid, "parameter"), cells(grid, "value ± standard error"), strict=True))
    assert rows["linear drag DL"] == "not determined"
    assert "±" in rows["inertia I"]


def test_intervals_have_the_decimals_of_their_values_and_hold_them(day: ReportData) -> None:
    grid = model.parameters_table(day)
    for value, interval in zip(cells(grid, "value ± standard error"), cells(grid, "95 % interval"), strict=True):
        low, high = map(float, interval.split(" … "))
        assert low < float(value.partition("\u00a0")[0]) < high


def test_each_trial_says_what_it_gave(day: ReportData) -> None:
    assert day.campaign is not None
    assert day.runs is not None
    gave = cells(model.trials_table(day, day.campaign), "what it gave")
    assert any("periods of" in text for text in gave)
    assert any("steady turn" in text for text in gave)
    fewer = replace(day, runs=replace(day.runs, items=day.runs.items[1:]))
    left_out = model.trials_table(fewer, day.campaign)
    assert cells(left_out, "what it gave")[0] == "left out"


def test_what_is_the_same_of_all_trials_is_said_once(day: ReportData) -> None:
    assert day.campaign is not None
    grid = model.trials_table(day, day.campaign)
    assert grid.caption == "Trials, rate 20 Hz, longest gap 0.05 s"
    assert not {"rate", "longest gap", "noticed"} & {column.title for column in grid.columns}


def test_each_trial_stands_with_its_errors_without_and_with_what_was_found(day: ReportData) -> None:
    assert day.campaign is not None
    once = [column.title for column in model.trials_table(day, day.campaign).columns]
    assert once[-2:] == ["R²", "heading off after 60 s"]
    worse = tuple(replace(item, fit=replace(item.fit, r2=0.5)) for item in day.simulations)
    found = day.parameters.model()
    stages = tuple(NestedSimulation(model=found, simulations=items) for items in (worse, day.simulations))
    grid = model.trials_table(replace(day, nested=stages), day.campaign)
    assert set(cells(grid, "without: R²")) == {"0.5000"}
    assert cells(grid, "with: R²") == [f"{item.fit.r2:.4f}" for item in day.simulations]


def test_what_was_simulated_in_parts_stands_as_a_whole_by_the_plain_model(day: ReportData) -> None:
    assert day.campaign is not None
    item = day.simulations[0]
    part = replace(item, run=replace(item.run, trial=replace(item.run.trial, name="hold_0.csv part 1")))
    stages = (NestedSimulation(model=day.parameters.model(), simulations=(part,)),) * 2
    grid = model.trials_table(replace(day, nested=stages), day.campaign)
    assert cells(grid, "R²") == [f"{item.fit.r2:.4f}" for item in day.simulations]


def test_a_logged_torque_has_no_curve(day: ReportData) -> None:
    vehicle = replace(day.vehicle, thrusters=(Thruster(name="torque", arm=1.0, curve=None),))
    assert cells(model.thrusters_table(vehicle), "thrust") == ["torque logged"]
    assert cells(model.thrusters_table(vehicle), "commands on the bench") == [NOTHING]


def test_without_logs_and_sources_there_is_no_table_of_hashes(day: ReportData) -> None:
    alone = replace(day, campaign=None, parameters=replace(day.parameters, sources=()))
    assert model.sources_table(alone) is None
    trial = day.simulations[0].run.trial
    grid = model.sources_table(replace(alone, campaign=Campaign(trials=(trial,), sources=())))
    assert grid is not None
    # Where all logs are used for the same, the table does not say for what.
    assert cells(grid, "log") == [trial.name]
    assert {column.title for column in grid.columns} == {"log", "SHA-256"}
