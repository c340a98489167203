"""The page's tables say what the evidence holds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rovid.campaign.trial import Campaign
from rovid.campaign.vehicle import Thruster
from rovid.report import grids
from rovid.report.evidence import Evidence
from rovid.report.table import Grid
from rovid.report.text import NOTHING


def cells(grid: Grid, title: str) -> list[str]:
    """A column, without the spaces that put its points in line."""
    column = next(column for column in grid.columns if column.title == title)
    return [cell.strip("\u2007\u2008") for cell in column.cells]


def test_a_parameter_that_the_file_lacks_has_its_row(day: Evidence) -> None:
    entries = {name: entry for name, entry in day.parameters.entries.items() if name != "linear_drag"}
    grid = grids.parameters_grid(replace(day, parameters=replace(day.parameters, entries=entries)))
    rows = dict(zip(cells(grid, "parameter"), cells(grid, "value"), strict=True))
    assert rows["linear drag DL"] == "not determined"
    assert "±" in rows["inertia I"]


def test_intervals_have_the_decimals_of_their_values_and_hold_them(day: Evidence) -> None:
    grid = grids.parameters_grid(day)
    for value, interval in zip(cells(grid, "value"), cells(grid, "95 % interval"), strict=True):
        low, high = map(float, interval.split(" … "))
        assert low < float(value.partition(" ± ")[0]) < high


def test_each_trial_says_what_it_gave(day: Evidence) -> None:
    assert day.campaign is not None
    assert day.runs is not None
    gave = cells(grids.trials_grid(day, day.campaign), "what it gave")
    assert any("periods of" in text for text in gave)
    assert any("steady turn" in text for text in gave)
    fewer = replace(day, runs=replace(day.runs, items=day.runs.items[1:]))
    left_out = grids.trials_grid(fewer, day.campaign)
    assert cells(left_out, "what it gave")[0] == "left out"


def test_the_last_row_is_all_trials_together(day: Evidence) -> None:
    grid = grids.simulation_grid(day.simulations)
    assert grid.total
    assert cells(grid, "trial")[-1] == "all together"
    samples = list(map(int, cells(grid, "samples")))
    assert samples[-1] == sum(samples[:-1])


def test_the_typical_error_is_the_median_of_the_trials_that_are_long_enough(day: Evidence) -> None:
    sizes = (0.1, 0.2, 0.6)
    items = [replace(day.simulations[0], position_errors={10.0: size}) for size in sizes]
    short = replace(day.simulations[0], position_errors={10.0: None})
    assert grids.typical_position_error([*items, short], 10.0) == np.degrees(0.2)
    assert grids.typical_position_error([short], 10.0) is None


def test_a_logged_torque_has_no_curve(day: Evidence) -> None:
    vehicle = replace(day.vehicle, thrusters=(Thruster(name="torque", arm=1.0, curve=None),))
    assert cells(grids.thrusters_grid(vehicle), "thrust") == ["torque logged"]
    assert cells(grids.thrusters_grid(vehicle), "commands on the bench") == [NOTHING]


def test_without_logs_and_sources_there_is_no_table_of_hashes(day: Evidence) -> None:
    alone = replace(day, campaign=None, parameters=replace(day.parameters, sources=()))
    assert grids.sources_grid(alone) is None
    trial = day.simulations[0].run.trial
    grid = grids.sources_grid(replace(alone, campaign=Campaign(trials=(trial,), sources=())))
    assert grid is not None
    assert cells(grid, "used for") == ["this page only"]
