"""The page's tables say what the evidence holds."""

from __future__ import annotations

from dataclasses import replace

from rovid.present.number_text import NOTHING
from rovid.present.page.nested_simulations import Stage
from rovid.present.page.report_data import Evidence
from rovid.present.tables import model
from rovid.present.tables.table import Grid
from rovid.trial.trial import Campaign
from rovid.trial.vehicle import Thruster


def cells(grid: Grid, title: str) -> list[str]:
    """A column, without the spaces that put its points in line."""
    column = next(column for column in grid.columns if column.title == title)
    return [cell.strip("\u2007\u2008") for cell in column.cells]


def test_a_parameter_that_the_file_lacks_has_its_row(day: Evidence) -> None:
    entries = {name: entry for name, entry in day.parameters.entries.items() if name != "linear_drag"}
    grid = model.parameters_grid(replace(day, parameters=replace(day.parameters, entries=entries)))
    rows = dict(zip(cells(grid, "parameter"), cells(grid, "value ± standard error"), strict=True))
    assert rows["linear drag DL"] == "not determined"
    assert "±" in rows["inertia I"]


def test_intervals_have_the_decimals_of_their_values_and_hold_them(day: Evidence) -> None:
    grid = model.parameters_grid(day)
    for value, interval in zip(cells(grid, "value ± standard error"), cells(grid, "95 % interval"), strict=True):
        low, high = map(float, interval.split(" … "))
        assert low < float(value.partition("\u00a0")[0]) < high


def test_each_trial_says_what_it_gave(day: Evidence) -> None:
    assert day.campaign is not None
    assert day.runs is not None
    gave = cells(model.trials_grid(day, day.campaign), "what it gave")
    assert any("periods of" in text for text in gave)
    assert any("steady turn" in text for text in gave)
    fewer = replace(day, runs=replace(day.runs, items=day.runs.items[1:]))
    left_out = model.trials_grid(fewer, day.campaign)
    assert cells(left_out, "what it gave")[0] == "left out"


def test_what_is_the_same_of_all_trials_is_said_once(day: Evidence) -> None:
    assert day.campaign is not None
    grid = model.trials_grid(day, day.campaign)
    assert grid.caption == "Trials, rate 20 Hz, longest gap 0.05 s"
    assert not {"rate", "longest gap", "noticed"} & {column.title for column in grid.columns}


def test_each_trial_stands_with_its_errors_without_and_with_what_was_found(day: Evidence) -> None:
    assert day.campaign is not None
    once = [column.title for column in model.trials_grid(day, day.campaign).columns]
    assert once[-2:] == ["R²", "heading off after 60 s"]
    worse = tuple(replace(item, fit=replace(item.fit, r2=0.5)) for item in day.simulations)
    found = day.parameters.model()
    stages = tuple(Stage(model=found, simulations=items) for items in (worse, day.simulations))
    grid = model.trials_grid(replace(day, stages=stages), day.campaign)
    assert set(cells(grid, "without: R²")) == {"0.5000"}
    assert cells(grid, "with: R²") == [f"{item.fit.r2:.4f}" for item in day.simulations]


def test_what_was_simulated_in_parts_stands_as_a_whole_by_the_plain_model(day: Evidence) -> None:
    assert day.campaign is not None
    item = day.simulations[0]
    part = replace(item, run=replace(item.run, trial=replace(item.run.trial, name="hold_0.csv part 1")))
    stages = (Stage(model=day.parameters.model(), simulations=(part,)),) * 2
    grid = model.trials_grid(replace(day, stages=stages), day.campaign)
    assert cells(grid, "R²") == [f"{item.fit.r2:.4f}" for item in day.simulations]


def test_a_logged_torque_has_no_curve(day: Evidence) -> None:
    vehicle = replace(day.vehicle, thrusters=(Thruster(name="torque", arm=1.0, curve=None),))
    assert cells(model.thrusters_grid(vehicle), "thrust") == ["torque logged"]
    assert cells(model.thrusters_grid(vehicle), "commands on the bench") == [NOTHING]


def test_without_logs_and_sources_there_is_no_table_of_hashes(day: Evidence) -> None:
    alone = replace(day, campaign=None, parameters=replace(day.parameters, sources=()))
    assert model.sources_grid(alone) is None
    trial = day.simulations[0].run.trial
    grid = model.sources_grid(replace(alone, campaign=Campaign(trials=(trial,), sources=())))
    assert grid is not None
    # Where all logs are used for the same, the table does not say for what.
    assert cells(grid, "log") == [trial.name]
    assert {column.title for column in grid.columns} == {"log", "SHA-256"}
