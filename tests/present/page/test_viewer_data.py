"""What the viewer is given: true samples, all extremes, within a budget, and names that stay text."""

from __future__ import annotations

import base64
import hashlib
import html
import json
import re
from dataclasses import replace
from datetime import date
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.model.simulation import TrialSimulation
from rovid.present.page.figures import ReportFigures
from rovid.present.page.render import render_page
from rovid.present.page.summary import summarize
from rovid.present.page.viewer_data import COARSEST, VALUES, decimate_table, fair_shares, trial_levels, viewer_document
from rovid.present.report_data import NestedSimulation, ReportData
from tests.present.conftest import make_evidence, staged
from tests.present.page.test_render import Parts

NASTY = '</script><b>x".csv'


def page_of(evidence: ReportData) -> str:
    return render_page(evidence, ReportFigures(), today=date(2026, 3, 7))


def scripts(page: str) -> list[str]:
    return re.findall(r"<script[^>]*>(.*?)</script>", page, flags=re.DOTALL)


def long_table(rows: int) -> FloatArray:
    """Time and seven signals as noise, with a gap in one of them and a single spike in each."""
    rng = np.random.default_rng(5)
    table = np.vstack([np.arange(rows) / 20.0, rng.normal(size=(7, rows))])
    for signal in range(1, 8):
        table[signal, rows // 8 * signal] = 50.0 * (-1) ** signal
    table[4, rows // 3 : rows // 3 + rows // 10] = np.nan
    return table


def spans(table: FloatArray) -> list[tuple[float, float]]:
    """Lowest and highest of each signal, and of each simulation's error."""
    signals = [*table[1:], *(rate - table[2] for rate in table[4::2])]
    return [(float(np.nanmin(values)), float(np.nanmax(values))) for values in signals]


def test_a_short_trial_is_given_as_it_is(day: ReportData) -> None:
    for given, item in zip(trial_levels([day.simulations]), day.simulations, strict=True):
        (level,) = given.levels
        trial = item.run.trial
        assert given.name == trial.name
        assert given.samples == level.shape[1] == len(trial.time)
        assert level[0] == pytest.approx(trial.time)
        assert level[1] == pytest.approx(item.run.torque, rel=1e-6)
        # The grid's instants are the trial's own but for rounding, by which the first and last may lie outside.
        inner = np.flatnonzero(np.isfinite(item.measured))[1:-1]
        grid = item.run.rates.time[inner]
        assert np.interp(grid, level[0], level[2]) == pytest.approx(item.measured[inner], abs=1e-5)
        assert level[3] == pytest.approx(np.degrees(trial.position - trial.position[0]), abs=1e-3)  # of 1000 deg
        assert np.interp(grid, level[0], level[4]) == pytest.approx(item.simulated[inner], abs=1e-5)
        assert level[5] == pytest.approx(np.degrees(item.position - trial.position), abs=1e-4)


def test_each_cause_has_a_switch_and_each_combination_its_numbers(day: ReportData) -> None:
    document = viewer_document(staged(day))
    assert document["causes"] == ["thruster lag", "constant torque"]
    assert document["stages"] == [[False, False], [True, False], [False, True], [True, True]]
    for trial in document["trials"]:
        (item,) = [item for item in day.simulations if item.run.trial.name == trial["name"]]
        expected = [item.fit.rmse / (number + 1) for number in range(4)]
        assert [numbers[-1] for numbers in trial["missed"]] == pytest.approx(expected, rel=1e-3)  # four digits
    rates = [numbers[-1] for numbers in document["missed"]]
    assert rates == pytest.approx([rates[0], rates[0] / 2, rates[0] / 3, rates[0] / 4], rel=1e-3)
    table = trial_levels([stage.simulations for stage in staged(day).nested])[0].levels[0]
    assert len(table) == 4 + 2 * 4


def test_the_worst_trial_comes_first(day: ReportData) -> None:
    document = viewer_document(staged(day))
    before = [trial["missed"][0][-1] for trial in document["trials"]]
    assert before == sorted(before, reverse=True)


def test_every_panel_draws_what_it_is_given(day: ReportData) -> None:
    document = viewer_document(day)
    assert not any("guessed" in panel["title"] for panel in document["panels"])
    panels = {panel["title"]: [line["look"] for line in panel["lines"]] for panel in document["panels"]}
    assert panels == {
        "yaw rate": ["measured", "without", "simulated"],
        "yaw rate error": ["without", "simulated"],
        "heading from the start": ["measured", "without", "simulated"],
        "heading error": ["without", "simulated"],
        "torque": ["applied"],
    }
    assert document["causes"] == []
    assert document["stages"] == [[]]


@pytest.mark.parametrize("count", [40, 500, 3000])
def test_thinning_keeps_extremes_ends_and_gaps(count: int) -> None:
    table = long_table(20_000)
    kept = decimate_table(table, count)
    assert kept.shape[1] <= count
    assert spans(kept) == spans(table)
    assert kept[0, 0] == table[0, 0]
    assert kept[0, -1] == table[0, -1]
    assert np.all(np.diff(kept[0]) > 0.0)
    gap = np.isnan(kept[4])
    assert gap.any()
    where = np.searchsorted(table[0], kept[0])
    assert np.array_equal(table[:, where], kept, equal_nan=True)  # true samples, at their own instants


def test_thinning_keeps_the_extremes_of_every_stretch() -> None:
    table = long_table(6_000)
    kept = decimate_table(table, 1_500)
    # Lowest and highest of eight lines are 16 rows of a stretch at the most: it is no longer than half of this.
    wide = 32 * 6_000 // kept.shape[1]
    for start in range(0, 6_000 - 2 * wide, wide):
        inner = table[1, start + wide // 2 : start + wide]
        inside = kept[1, (kept[0] >= table[0, start]) & (kept[0] <= table[0, start + 2 * wide - 1])]
        assert inside.min() <= inner.min()
        assert inside.max() >= inner.max()


def test_a_budget_is_kept_and_every_level_has_the_extremes(day: ReportData) -> None:
    first = day.simulations[0]
    budget = 1_200 * 6
    given = trial_levels([[first, *day.simulations[:3]]], values=budget)
    assert sum(level.size for each in given for level in each.levels) <= budget
    full = trial_levels([[first]])[0].levels[0]
    for level in given[0].levels:
        assert spans(np.asarray(level, dtype=np.float64)) == spans(np.asarray(full, dtype=np.float64))


def test_a_long_trial_has_levels_down_to_what_a_screen_shows(day: ReportData) -> None:
    given = trial_levels([[stretched(day, 40_000)]], values=240_000)[0]
    counts = [level.shape[1] for level in given.levels]
    assert given.samples == 40_000
    assert 20_000 < counts[0] <= 240_000 * 3 // 4 // 6
    assert all(finer // 12 < coarser <= finer // 4 for finer, coarser in pairwise(counts))
    assert counts[-1] <= COARSEST
    assert sum(counts) * 6 <= 240_000


def stretched(day: ReportData, samples: int) -> TrialSimulation:
    """A trial of the day, over and over, of which the simulation knows nothing."""
    item, rng = day.simulations[0], np.random.default_rng(2)
    time: FloatArray = np.arange(samples, dtype=np.float64) * 0.05
    trial = replace(
        item.run.trial,
        time=time,
        position=np.resize(item.run.trial.position, samples),
        commands=np.resize(item.run.trial.commands, (samples, 2)),
    )
    rates, torque = replace(item.run.rates, time=time), np.resize(item.run.torque, samples)
    measured, simulated, position = rng.normal(size=(3, samples))
    return replace(
        item,
        run=replace(item.run, trial=trial, torque=torque, rates=rates),
        measured=measured,
        simulated=simulated,
        position=position,
    )


@pytest.mark.parametrize(
    ("wanted", "budget", "granted"),
    [([5, 5], 20, [5, 5]), ([100, 2, 100], 50, [24, 2, 24]), ([30, 10], 20, [10, 10]), ([], 9, [])],
)
def test_short_trials_leave_what_they_do_not_want(wanted: list[int], budget: int, granted: list[int]) -> None:
    assert fair_shares(wanted, budget) == granted


def test_the_budget_leaves_room_on_a_page_of_three_megabytes() -> None:
    assert 4 * VALUES * 4 / 3 < 2.2e6  # four bytes each, and text takes a third more


def test_names_from_logs_cannot_leave_the_data_block(tmp_path: Path) -> None:
    page = page_of(make_evidence(tmp_path, {"hold_1.csv": NASTY, "hold_2.csv": "b.csv", "sine_a.csv": "c.csv"}))
    data, _ = scripts(page)
    assert {trial["name"] for trial in json.loads(data)["trials"]} == {NASTY, "b.csv", "c.csv"}
    assert "<" not in data
    parts = Parts(page)
    assert not parts.open
    assert parts.tags.count("script") == 2
    assert "<b>x" not in page
    assert html.escape(NASTY).replace("&quot;", "&#34;") in page


def test_only_the_pages_own_script_may_run_and_nothing_is_fetched(day: ReportData) -> None:
    page = page_of(day)
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page)
    assert policy is not None
    digest = base64.b64encode(hashlib.sha256(scripts(page)[1].encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in policy.group(1)
    assert policy.group(1).startswith("default-src 'none'")


def test_without_simulation_there_is_no_viewer(day: ReportData) -> None:
    page = page_of(replace(day, simulations=()))
    assert "<script" not in page
    assert "script-src 'none'" in page
    assert 'id="viewer-root"' not in page


def test_free_swings_without_an_inertia_have_a_viewer_without_torque(day: ReportData) -> None:
    still = tuple(replace(one, run=replace(one.run, torque=0.0 * one.run.torque)) for one in day.simulations)
    only = replace(day, simulations=(), nested=(NestedSimulation(model=day.parameters.model(), simulations=still),))
    assert 'id="viewer-root"' in page_of(only)
    assert "torque" not in {panel["title"] for panel in viewer_document(only)["panels"]}
    assert "torque" in {panel["title"] for panel in viewer_document(day)["panels"]}


def test_errors_have_the_decimals_of_the_first_screen(day: ReportData) -> None:
    decimals = [measure["decimals"] for measure in viewer_document(day)["measures"]]
    errors = summarize(day).gains
    assert [len(one.texts[0].split()[0].partition(".")[2]) for one in errors] == [decimals[0], decimals[-1]]


def test_panels_that_hang_on_a_guess_say_so(day: ReportData) -> None:
    def titles(*, arm: bool = False, curve: bool = False) -> list[str]:
        thrusters = tuple(replace(one, arm_guessed=arm, curve_guessed=curve) for one in day.vehicle.thrusters)
        vehicle = replace(day.vehicle, thrusters=thrusters)
        return [panel["title"] for panel in viewer_document(replace(day, vehicle=vehicle))["panels"]]

    *others, torque = titles(arm=True)
    assert torque == "torque, by guessed yaw_arm"
    assert not any("guessed" in title for title in others)
    assert all(title.endswith("by guessed curve") for title in titles(curve=True))
