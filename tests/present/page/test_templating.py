"""Templates and assets of pages."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from markupsafe import Markup

from rovid.present import page
from rovid.present.page.page_files import read_assets, require_same_vehicle, template_environment
from rovid.present.tables import diagnosis, fits, trials
from tests.conftest import SAMPLES, Rovid


def test_text_from_elsewhere_is_shown_for_what_it_is() -> None:
    template = template_environment().from_string("{{ a }} {{ b }} {{ 1234.5678|plain }} {{ 'kg m^2'|unit }}")
    assert template.render(a="<b>\u202e", b=Markup("<i>")) == r"&lt;b&gt;\u202e <i> 1235 kg m²"


def test_a_page_of_another_room_finds_its_own_templates_and_the_shared_style() -> None:
    environment = template_environment("rovid.fleet")
    assert environment.get_template("fleet.html.j2").filename
    assert environment.get_template("style.css").filename


def test_the_library_comes_with_its_licence_and_fits_into_a_page() -> None:
    assets = read_assets()
    assert "The MIT License (MIT)" in assets.script
    assert "uPlot (v1.6.32)" in assets.script
    assert "</script" not in assets.script.lower()
    assert "<!--" not in assets.script
    assert "url(" not in assets.style
    assert "@import" not in assets.style


def test_the_report_of_another_vehicle_is_not_replaced(
    tmp_path: Path, rovid: Rovid, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    page = tmp_path / "report" / "index.html"
    page.parent.mkdir()
    text = '<meta name="generator" content="rovid 1.0">\n<title>A &amp; B: C: yaw dynamics</title>'
    page.write_text(text)
    answer = rovid("report", SAMPLES / "rosub_hidden" / "hold_03.csv", "--no-diagnosis")
    assert answer.code == 2
    assert "is the report of another vehicle, 'A & B: C'" in answer.err
    assert "-o report_2" in answer.err
    assert page.read_text() == text
    assert sorted(path.name for path in tmp_path.iterdir()) == ["report"]
    # The same vehicle's own report is replaced.
    require_same_vehicle(page.parent, "A & B: C")


def test_templates_call_only_functions_that_exist() -> None:
    """A page of another kind than the tests render would fail only there."""
    modules = {"fit_tables": fits, "trial_tables": trials, "diagnosis_tables": diagnosis}
    for template in (Path(page.__file__).parent / "templates").rglob("*.j2"):
        for module, name in re.findall(rf"\b({'|'.join(modules)})\.(\w+)", template.read_text(encoding="utf-8")):
            assert hasattr(modules[module], name), f"{template.name}: {module}.{name}"
