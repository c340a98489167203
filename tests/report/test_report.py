"""The page: whole, self-contained, honest about what is missing, safe with what logs and names may hold."""

from __future__ import annotations

import re
import shutil
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from rovid.report.plots import extremes
from tests.conftest import SAMPLES, Rovid, run_rovid

SECTIONS = (
    "Summary",
    "The model",
    "What was measured",
    "Drag from steady turns",
    "Inertia",
    "Simulation against measurement",
    "What these data cannot tell",
    "Where it comes from",
)


class Links(HTMLParser):
    """Every src and href of a page, and whether every image has a text for those who cannot see it."""

    def __init__(self) -> None:
        super().__init__()
        self.targets: list[str] = []
        self.images_without_text = 0

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        known = dict(attrs)
        self.targets += [str(value) for key, value in attrs if key in {"src", "href"}]
        self.images_without_text += tag == "img" and not known.get("alt")


def links(page: str) -> Links:
    parser = Links()
    parser.feed(page)
    return parser


@pytest.fixture(scope="module")
def day_report(csv_day: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    for command in (["fit-drag", csv_day], ["fit-inertia"], ["report", "-o", folder]):
        done = run_rovid(*command, "-p", folder / "parameters.toml")
        assert done.code == 0, done.err
    return folder


def test_page_holds_every_section_and_is_self_contained(day_report: Path) -> None:
    page = (day_report / "index.html").read_text()
    for title in SECTIONS:
        assert re.search(rf"<h2[^>]*>{title}</h2>", page), title
    found = links(page)
    assert found.targets
    assert all(target.startswith("data:image/png;base64,") for target in found.targets)
    assert found.images_without_text == 0
    assert (day_report / "index.html").stat().st_size < 4_000_000


def test_every_trial_appears_with_its_plot_as_png_and_svg(day_report: Path, csv_day: Path) -> None:
    page = (day_report / "index.html").read_text()
    logs = [path.name for path in csv_day.glob("*.csv") if path.name != "thrust_curve.csv"]
    assert all(f"<summary>{name}</summary>" in page for name in logs)
    png, svg = ({path.stem for path in (day_report / "plots").glob(f"*.{kind}")} for kind in ("png", "svg"))
    assert png == svg
    named = {"steady_torque", "inertia", "sine_runs", "thrust_curves", "overview", "residuals"}
    assert named <= png
    assert len(png - named) == len(logs)


def test_numbers_on_the_page_are_those_of_the_parameter_file(day_report: Path, csv_day: Path, rovid: Rovid) -> None:
    drag = rovid("fit-drag", csv_day, "--json").document["parameters"]["quadratic_drag"]
    shown = re.search(r"quadratic drag</td><td[^>]*>([\d.]+) ± ([\d.]+)", (day_report / "index.html").read_text())
    assert shown is not None
    assert float(shown.group(1)) == pytest.approx(drag["value"], abs=0.5 * drag["standard_error"])
    assert float(shown.group(2)) == pytest.approx(drag["standard_error"], rel=0.05)


def test_same_evidence_same_bytes(day_report: Path, tmp_path: Path, rovid: Rovid) -> None:
    rovid("report", "-p", day_report / "parameters.toml", "-o", tmp_path / "again")
    assert (tmp_path / "again" / "index.html").read_bytes() == (day_report / "index.html").read_bytes()
    plot = Path("plots") / "residuals.svg"
    assert (tmp_path / "again" / plot).read_bytes() == (day_report / plot).read_bytes()


def test_names_from_logs_are_escaped(csv_day: Path, tmp_path: Path, rovid: Rovid) -> None:
    day = tmp_path / "day"
    day.mkdir()
    for name in ("rovid.toml", "thrust_curve.csv", "hold_01.csv", "hold_03.csv"):
        shutil.copy(csv_day / name, day)
    (day / "hold_01.csv").rename(day / 'a & "b" <i>.csv')
    toml = (day / "rovid.toml").read_text()
    (day / "rovid.toml").write_text(re.sub(r'name = "ROSUB[^"]*"', 'name = "<script>alert(1)</script>"', toml))
    rovid("fit-drag", day)
    assert rovid("report").code == 0
    page = Path("report/index.html").read_text()
    assert "<script" not in page
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in page
    assert "a &amp; &#34;b&#34; &lt;i&gt;.csv" in page


def test_what_is_missing_is_named(rovid: Rovid) -> None:
    rovid("fit-inertia", SAMPLES / "bluerov2_pier59" / "dive.csv")
    assert rovid("report").code == 0
    page = Path("report/index.html").read_text()
    assert "no held command" in page
    assert "no sine" in page
    assert not Path("report/plots/steady_torque.png").exists()


def test_tables_alone_make_a_page(rovid: Rovid) -> None:
    assert rovid("report", SAMPLES / "rosub_paper").code == 0
    page = Path("report/index.html").read_text()
    assert "No single inertia fits all sine trials" in page
    assert "there are tables, no logs" in page


def test_report_alone_fits_what_is_missing(csv_day: Path, rovid: Rovid) -> None:
    assert rovid("report", csv_day).code == 0
    assert rovid("simulate", "--json").document["overall"]["yaw_rate_r2"] > 0.99


def test_decimation_keeps_extremes() -> None:
    values = np.random.default_rng().normal(size=100_000)
    values[[1234, 77_777]] = 50.0, -50.0
    values[500:600] = np.nan
    time, kept = extremes(np.arange(100_000.0), values)
    assert len(kept) <= 1100
    assert (np.diff(time) >= 0).all()
    assert np.nanmax(kept) == 50.0
    assert np.nanmin(kept) == -50.0
