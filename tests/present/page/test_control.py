"""Controller and exports on the page: their tables, plots and refusals."""

from __future__ import annotations

import html
import math
import re
from collections.abc import Callable
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rovid.control.closed_loop import limit_cycle
from rovid.control.design import ControllerDesign
from rovid.export import FORMATS
from rovid.export.verification import ExportLoss, Mismatch, Stability, VerifiedExport
from rovid.present.console import ResultTable
from rovid.present.number_format import format_number
from rovid.present.page import build
from rovid.present.page.figures import ReportFigures, draw_figures
from rovid.present.page.render import render_page
from rovid.present.plots import canvas
from rovid.present.plots.results import paper_step_runs, plot_closed_loop
from rovid.present.report_data import ReportData
from rovid.present.tables.trials import formats_table, gains_table, loss_reasons, loss_title, runs_table
from rovid.store.parameter_file import Parameters
from rovid.trial.vehicle import ThrustCurve, Thruster
from tests.conftest import SAMPLES, Rovid, blank_plots, run_rovid
from tests.present.conftest import BIAS, silent, study_of

REPORT = ("report", "--no-diagnosis")
# Of a run in the JSON, and the form in which the page shows it.
SHOWN = {
    "settling_time": ".1f",
    "overshoot_deg": ".1f",
    "steady_error_deg": ".2f",
    "time_constant": ".1f",
    "rise_time": ".1f",
}


def cells(grid: ResultTable, title: str) -> list[str]:
    """A column as text, without what fills it up."""
    column = next(column for column in grid.columns if column.title == title)
    return [re.sub("[\u2007\u2008]", "", cell) for cell in column.cells]


def shown(evidence: ReportData) -> str:
    page = render_page(evidence, ReportFigures(), today=date(2026, 3, 7))
    return re.sub(r"\s+", " ", html.unescape(re.sub(r"<[^>]+>", " ", page)))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page of the founding paper's tables, the parameter file beside it."""
    folder = tmp_path_factory.mktemp("page")
    with blank_plots():
        done = run_rovid(*REPORT, SAMPLES / "rosub_paper", "-o", folder, "-p", folder / "parameters.toml")
    assert done.code == 0, done.err
    return folder


def rows(page: str, caption: str) -> list[list[str]]:
    """The table of this caption, cell by cell."""
    table = re.search(rf"<caption>{re.escape(caption)}.*?</table>", page, re.DOTALL)
    assert table is not None
    found = re.findall(r"<tr[^>]*>(.*?)</tr>", table[0].split("<tbody>")[1], re.DOTALL)
    return [
        [
            re.sub("[\u2007\u2008]", "", html.unescape(c)).replace("\u00a0", " ")
            for c in re.findall(r"<t[hd][^>]*>(.*?)</t", r)
        ]
        for r in found
    ]


def test_the_controller_on_the_page_is_that_of_rovid_control(folder: Path) -> None:
    document = run_rovid("control", "-p", folder / "parameters.toml", "--json").document
    page = (folder / "index.html").read_text()
    values = {row[0]: row[1] for row in rows(page, "The controller and its margins")}
    assert values["gain on heading kp"] == f"{document['gains']['kp']:.5g} N m/rad"
    assert values["gain on yaw rate kd"] == f"{document['gains']['kd']:.5g} N m s/rad"
    assert values["damping ratio"] == f"{document['damping_ratio']:.3f}"
    assert values["bandwidth"] == f"{document['bandwidth']:.3g} rad/s"
    assert values["gain margin"] == f"{document['margins']['gain_db']:.1f} dB"
    assert values["phase margin"] == f"{document['margins']['phase_deg']:.0f} deg"
    assert values["delay margin"] == f"{document['margins']['delay_s']:.2f} s"
    expected = [
        [run["name"], *(format_number(run[key], form) for key, form in SHOWN.items())] for run in document["runs"]
    ]
    table = rows(page, "Closed-loop runs")
    assert [[row[0], *row[2:5], *row[6:8]] for row in table] == expected
    assert "closed_loop" in {path.stem for path in (folder / "plots").glob("*.svg")}


@pytest.mark.parametrize("name", ["gz-sim", "stonefish"])
def test_a_format_on_the_page_is_that_of_rovid_export(folder: Path, tmp_path: Path, name: str) -> None:
    done = run_rovid("export", name, "-p", folder / "parameters.toml", "-o", tmp_path / "file", "--json")
    table = rows((folder / "index.html").read_text(), "Yaw rate of each format")
    assert [row[0] for row in table] == list(FORMATS)
    row = next(row for row in table if row[0] == name)
    for cell, key in ((row[2], "mismatch"), (row[4], "mismatch_of_what_is_held")):
        assert cell == f"{done.document[key]['yaw_rate_percent_of_range']:.2g}"
    for loss in done.document["not_held"]:
        assert f"{loss_title(loss['what'])} {loss['yaw_rate_percent_of_range']:.2g}" in row[5]


@pytest.mark.slow
def test_either_section_can_be_left_out(folder: Path, rovid: Rovid) -> None:
    tables, parameters = SAMPLES / "rosub_paper", folder / "parameters.toml"
    assert rovid(*REPORT, tables, "--no-control", "-p", parameters).code == 0
    page = Path("report/index.html").read_text()
    assert ("Heading controller" in page, "Export to simulators" in page) == (False, True)
    assert rovid(*REPORT, tables, "--no-export", "-p", parameters).code == 0
    page = Path("report/index.html").read_text()
    assert ("Heading controller" in page, "Export to simulators" in page) == (True, False)


@pytest.mark.parametrize("work", [build.designed_control, build.every_export])
def test_without_inertia_a_sentence_stands_in_place(day: ReportData, work: Callable[..., Any], tmp_path: Path) -> None:
    made, refusal = work(study_of(day), Parameters(path=tmp_path / "p.toml"), silent)
    assert made is None
    assert refusal == "inertia or drag is missing."
    text = shown(replace(day, control_refusal=refusal, export_refusal=refusal))
    assert "A controller. Inertia or drag is missing." in text
    assert "Exports. Inertia or drag is missing." in text
    assert "Heading controller" not in text


def test_thrusters_that_turn_one_way_get_no_controller(day: ReportData) -> None:
    curve = ThrustCurve(command=np.array([-5.0, 0.0, 5.0]), thrust=np.array([0.0, 0.0, 100.0]))
    vehicle = replace(day.vehicle, thrusters=(Thruster(name="aft", arm=0.5, curve=curve),))
    control, refusal = build.designed_control(replace(study_of(day), vehicle=vehicle), day.parameters, silent)
    assert control is None
    assert "A controller. The thrusters turn the vehicle one way only." in shown(replace(day, control_refusal=refusal))


def test_runs_say_what_acts_and_what_the_aid_knows(control: ControllerDesign, pushed: ControllerDesign) -> None:
    assert [column.title for column in runs_table(control).columns][:2] == ["run", "model aid"]
    assert set(cells(runs_table(control), "model aid")) == {"drag", "none"}
    grid = runs_table(pushed)
    pairs = list(zip(cells(grid, "effects"), cells(grid, "model aid"), strict=True))[:5]
    assert pairs == [("none", "drag"), ("none", "none"), ("all", "drag and effects"), ("all", "drag"), ("all", "none")]


def test_an_unstable_loop_has_no_margins(control: ControllerDesign) -> None:
    grid = gains_table(replace(control, margins=replace(control.margins, stable=False)))
    assert "gain margin" not in cells(grid, "quantity")
    assert [column.title for column in grid.columns] == ["quantity", "value"]


def test_what_has_no_bound_is_said_in_words(control: ControllerDesign) -> None:
    grid = gains_table(replace(control, spread=None, margins=replace(control.margins, lag_s=math.inf)))
    at = cells(grid, "quantity").index("lag margin")
    assert cells(grid, "value")[at] == "without limit"


def test_the_plot_shows_every_way_with_units(
    day: ReportData, control: ControllerDesign, pushed: ControllerDesign
) -> None:
    for each, ways in ((control, 2), (pushed, 3)):
        figure = plot_closed_loop(paper_step_runs(each), each.bandwidth)
        assert len(figure.axes) == 6
        assert all(axes.get_ylabel() in {"heading, deg", "torque, N m"} for axes in figure.axes)
        assert len(figure.legends[0].get_texts()) == ways + 1
        canvas.render_png(figure)
        box = figure.get_tightbbox()
        assert min(box.x0, box.y0) >= 0.0
        assert box.x1 <= figure.get_figwidth()


def test_a_page_with_effects_says_what_holds_against_them(day: ReportData, pushed: ControllerDesign) -> None:
    evidence = replace(day, control=pushed)
    text = shown(evidence)
    assert "T = DQ·|r|·r + DL·r + hold + kp·(ψ wanted − ψ) − kd·r" in text
    assert "Effects of the model: constant torque." in text
    (picture,) = draw_figures(replace(evidence, simulations=(), runs=None, inertia=None, drag=None))["closed_loop"]
    assert "90 to 200 deg" in picture.alt


def test_the_courses_are_those_of_the_runs(day: ReportData, pushed: ControllerDesign) -> None:
    courses = paper_step_runs(pushed)
    for name, ways in courses.items():
        run = next(run for run in pushed.runs if run.name == name and run.effects_known)
        course = ways["aid of drag and effects"]
        assert limit_cycle(course.time, np.degrees(course.heading)) == run.metrics.limit_cycle
        step = np.degrees(course.setpoint[0] - course.heading[0])
        # Without disturbance it ends where it shall; what the aid does not know of leaves its size over kp.
        ends = {way: np.degrees(each.setpoint[-1] - each.heading[-1]) for way, each in ways.items()}
        assert ends["aid of drag and effects"] == pytest.approx(0.0, abs=1e-3 * step)
        assert ends["aid of drag alone"] == pytest.approx(-np.degrees(BIAS.value / pushed.law.kp), rel=0.02)


AT_REST = Stability(
    stable=True, step=0.001, largest_stable_step=None, rest_time=9.0, envelope=(0.0, 0.0, 0.3), text="Stable."
)


def test_each_reason_is_given_once() -> None:
    size = Mismatch(percent_of_range={"yaw_rate": 7.6}, rms={"yaw_rate": 0.01})
    lag = ExportLoss(what="thruster_lag:rotor", why="there is none", percent_of_range={"yaw_rate": 7.6})
    wave = ExportLoss(what="wave_torque", why="its phase is not known", percent_of_range={"yaw_rate": math.nan})
    made = {
        name: VerifiedExport(
            content="",
            mismatch=size,
            kept_mismatch=size,
            losses=losses,
            stability=AT_REST,
            warnings=(),
            velocities={"yaw_rate": "rad/s"},
        )
        for name, losses in {"gz-sim": (lag, wave), "vrx": (lag,), "json": ()}.items()
    }
    assert cells(formats_table(made), "not held, % of range") == [
        "thruster lag (rotor) 7.6; wave torque –",
        "thruster lag (rotor) 7.6",
        "–",
    ]
    assert loss_reasons(made) == [
        ("gz-sim, vrx", "thruster lag (rotor)", "there is none"),
        ("gz-sim", "wave torque", "its phase is not known"),
    ]
