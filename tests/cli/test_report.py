"""`rovid report` from the command line, on logs and on tables."""

from __future__ import annotations

import re
import shutil
from datetime import UTC, datetime
from pathlib import Path

import pytest

from rovid.store.load import read_parameters
from tests.conftest import SAMPLES, SHOWN_PLOTS, Rovid, blank_plots, run_rovid

LOGS = ("hold_02.csv", "hold_03.csv", "hold_05.csv", "sine_40s_a.csv", "sine_40s_b.csv")


@pytest.fixture(scope="module")
def day_report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder, logs = tmp_path_factory.mktemp("report"), tmp_path_factory.mktemp("logs")
    for name in ("rovid.toml", "thrust_curve.csv", *LOGS):
        shutil.copy(SAMPLES / "rosub_tank" / name, logs)
    more = ("-o", folder, "-p", folder / "parameters.toml", "--no-diagnosis", "--no-control", "--no-export")
    with blank_plots(*SHOWN_PLOTS):
        done = run_rovid("report", logs, *more)
    assert done.code == 0, done.err
    return folder


def test_a_day_of_logs_makes_a_page(day_report: Path) -> None:
    page = day_report / "index.html"
    row = r'<th scope="row" class="k">{}</th><td class="n">[^<]*</td><td[^>]*>[^<]*</td><td class="n">0\.99'
    assert all(re.search(row.format(re.escape(name)), page.read_text()) for name in LOGS)
    # A page opens quickly on a tablet below 4 MB; a trial's samples in the viewer may take 150 kB of it, the rest 1 MB.
    assert page.stat().st_size < 150_000 * len(LOGS) + 1_000_000
    assert f"{datetime.now(UTC).year}" in page.read_text().split("<nav")[0]


def test_numbers_on_the_page_are_those_of_the_parameter_file(day_report: Path) -> None:
    drag = read_parameters(day_report / "parameters.toml").entries["quadratic_drag"]
    page = (day_report / "index.html").read_text()
    shown = re.search(r"quadratic drag DQ</th><td[^>]*>([\d.]+)[\s\u2007\u2008]*±[\s\u2007]*([\d.]+)", page)
    assert shown is not None
    assert float(shown.group(1)) == pytest.approx(drag.value, abs=0.5 * drag.standard_error)
    assert float(shown.group(2)) == pytest.approx(drag.standard_error, rel=0.05)  # two digits at least


@pytest.mark.usefixtures("blank")
def test_the_answer_comes_before_the_path_of_the_page(rovid: Rovid) -> None:
    shutil.copy(SAMPLES / "ardusub_small" / "small.tlog", ".")
    done = rovid("report", "small.tlog")
    assert done.code == 0
    said = " ".join(done.out.split())
    assert "There is too little data for a diagnosis: there are too few trials" in said
    assert said.endswith("report/index.html")
    document = rovid("report", "small.tlog", "--json").document
    assert document["verdict"] == "too_little_data"
    assert said.endswith(f"{document['answer']} report/index.html")


@pytest.mark.slow
@pytest.mark.usefixtures("blank")
def test_a_dive_without_holds_and_sines_says_so(rovid: Rovid) -> None:
    rovid("fit-inertia", SAMPLES / "bluerov2_pier59" / "dive.csv")
    assert rovid("report", "--no-diagnosis").code == 0
    page = " ".join(Path("report/index.html").read_text().split())  # a number and its noun do not break
    assert "1 steady turn is too few" in page
    assert "hold no sine" in page
    assert not Path("report/plots/steady_torque.png").exists()


def test_report_alone_fits_what_is_missing(day_report: Path, rovid: Rovid) -> None:
    done = rovid("simulate", "-p", day_report / "parameters.toml", "--json")
    assert done.document["overall"]["yaw_rate_r2"] > 0.99


def test_a_file_with_the_name_of_the_folder_is_one_message(rovid: Rovid) -> None:
    Path("taken").write_text("a file\n")
    done = rovid("report", SAMPLES / "rosub_paper", "-o", "taken")
    assert done.code == 2
    assert "cannot be written" in done.err
    assert "-o" in done.err
