"""The page in a real browser: it opens quickly, zooms, pans, changes trials, and asks for nothing but itself."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterator
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import pytest

from rovid.effects import effect_named
from rovid.present.page.figures import ReportFigures
from rovid.present.page.render import render_page
from rovid.present.report_data import NestedSimulation, ReportData
from tests.conftest import SAMPLES, SHOWN_PLOTS, blank_plots, run_rovid
from tests.present.conftest import make_evidence, nearer, staged

pytest.importorskip("fcntl", reason="Chromium is driven over a POSIX pipe")
from tests.present.chromium import NAMES, Tab, chromium, find_chromium

in_browser = pytest.mark.skipif(find_chromium() is None, reason=f"no browser: none of {', '.join(NAMES)} on the PATH")
NASTY = "</script><b>x</b>.csv"


@pytest.fixture(scope="module")
def sample_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sample day's page with all plots that it shows; those of single trials, which are files only, are blank."""
    folder = tmp_path_factory.mktemp("sample")
    more = ("-o", folder, "-p", folder / "parameters.toml", "--no-diagnosis", "--no-control", "--no-export")
    with blank_plots(*SHOWN_PLOTS):
        done = run_rovid("report", SAMPLES / "rosub_tank", *more)
    assert done.code == 0, done.err
    return folder / "index.html"


@pytest.fixture(scope="module")
def plain_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three trials, one of an evil name, with two causes to switch; no pictures."""
    folder = tmp_path_factory.mktemp("plain")
    evidence: ReportData = make_evidence(folder, {"hold_1.csv": NASTY, "hold_2.csv": "b.csv", "sine_a.csv": "c.csv"})
    page = folder / "index.html"
    text = render_page(staged(evidence), ReportFigures(), today=date(2026, 3, 7))
    page.write_text(text, encoding="utf-8")
    return page


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Tab]:
    with chromium(tmp_path_factory.mktemp("profile"), "--window-size=1100,1400") as tab:
        yield tab


@pytest.fixture
def tab(browser: Tab, plain_page: Path) -> Iterator[Tab]:
    """The plain page, freshly opened and scrolled to the viewer; afterwards, that it complained of nothing."""
    opened(browser, plain_page)
    yield browser
    quiet(browser, plain_page)


def opened(tab: Tab, page: Path) -> None:
    tab.complaints.clear()
    tab.requests.clear()
    tab.open(page)
    tab.ask("document.getElementById('trials').scrollIntoView()")


def quiet(tab: Tab, page: Path) -> None:
    assert tab.complaints == []
    assert {url for url in tab.requests if not url.startswith("data:")} == {page.resolve().as_uri()}


def view(tab: Tab) -> tuple[float, float]:
    """What the viewer says it shows."""
    text = tab.ask("document.getElementById('viewer-range').textContent")
    start, stop = re.findall(r"[\d.]+", text)[:2]
    return float(start), float(stop)


def panel(tab: Tab, index: int, share: float) -> tuple[float, float]:
    """A point of a panel, at that share of its width."""
    box = tab.ask(
        f"(() => {{ const box = document.querySelectorAll('#viewer-panels .u-over')[{index}].getBoundingClientRect();"
        " return [box.x, box.y, box.width, box.height]; })()"
    )
    return box[0] + share * box[2], box[1] + 0.5 * box[3]


def readings(tab: Tab) -> list[str]:
    found: list[str] = tab.ask("[...document.querySelectorAll('.viewer-key b')].map((each) => each.textContent)")
    return found


@in_browser
def test_the_sample_days_page_opens_quickly_and_moves(browser: Tab, sample_page: Path) -> None:
    assert 4e5 < sample_page.stat().st_size < 3e6
    browser.call("Performance.enable")
    opened(browser, sample_page)
    spent = {each["name"]: each["value"] for each in browser.call("Performance.getMetrics")["metrics"]}
    # Of the machine's time, not by the clock: other work may keep it waiting.
    assert spent["ScriptDuration"] + spent["LayoutDuration"] + spent["RecalcStyleDuration"] < 2.0
    whole = view(browser)
    browser.drag(panel(browser, 1, 0.25), panel(browser, 1, 0.5))
    assert view(browser) != whole
    assert browser.ask("document.querySelectorAll('#viewer-trial option').length") == 18
    quiet(browser, sample_page)


@in_browser
def test_a_drag_zooms_and_a_double_click_shows_the_whole(tab: Tab) -> None:
    start, stop = view(tab)
    tab.drag(panel(tab, 1, 0.2), panel(tab, 1, 0.6))
    length = stop - start
    assert view(tab) == pytest.approx((start + 0.2 * length, start + 0.6 * length), abs=0.02 * length)
    place = panel(tab, 2, 0.5)
    for count in (1, 2):
        tab.mouse("mousePressed", *place, button="left", buttons=1, clickCount=count)
        tab.mouse("mouseReleased", *place, button="left", clickCount=count)
    assert view(tab) == (start, stop)


@in_browser
def test_shift_and_drag_pans(tab: Tab) -> None:
    tab.drag(panel(tab, 1, 0.3), panel(tab, 1, 0.7))
    start, stop = view(tab)
    tab.drag(panel(tab, 3, 0.3), panel(tab, 3, 0.55), shift=True)
    length = stop - start
    assert view(tab) == pytest.approx((start - 0.25 * length, stop - 0.25 * length), abs=0.03 * length)


@in_browser
def test_the_wheel_scrolls_the_page_until_a_panel_was_clicked(tab: Tab) -> None:
    whole, scrolled = view(tab), tab.ask("scrollY")
    wheel: dict[str, Any] = {"deltaX": 0, "deltaY": -100}
    tab.mouse("mouseWheel", *panel(tab, 0, 0.5), **wheel)
    tab.until(f"scrollY < {scrolled}")
    assert view(tab) == whole
    tab.ask("document.getElementById('trials').scrollIntoView()")
    place = panel(tab, 1, 0.5)
    tab.mouse("mousePressed", *place, button="left", buttons=1, clickCount=1)
    tab.mouse("mouseReleased", *place, button="left", clickCount=1)
    scrolled = tab.ask("scrollY")
    tab.mouse("mouseWheel", *place, **wheel)
    assert view(tab)[1] - view(tab)[0] < 0.8 * (whole[1] - whole[0])
    assert tab.ask("scrollY") == scrolled


@in_browser
def test_two_fingers_zoom(tab: Tab) -> None:
    whole = view(tab)
    tab.call("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=2)
    try:
        for kind, shares in (("touchStart", (0.4, 0.6)), ("touchMove", (0.3, 0.7)), ("touchMove", (0.2, 0.8))):
            points = [dict(zip("xy", panel(tab, 1, share), strict=True), id=k) for k, share in enumerate(shares)]
            tab.call("Input.dispatchTouchEvent", type=kind, touchPoints=points)
        tab.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    finally:
        tab.call("Emulation.setTouchEmulationEnabled", enabled=False)
    length = whole[1] - whole[0]
    assert view(tab)[1] - view(tab)[0] == pytest.approx(length / 3.0, rel=0.1)  # fingers three times as far apart


@in_browser
def test_keys_alone_do_it_all(tab: Tab) -> None:
    whole = view(tab)
    tab.ask("document.getElementById('viewer-panels').focus()")
    tab.key("+")
    near = view(tab)
    assert near[1] - near[0] == pytest.approx(0.5 * (whole[1] - whole[0]), rel=0.01)
    tab.key("ArrowRight")
    assert view(tab)[0] == pytest.approx(near[0] + 0.2 * (near[1] - near[0]), abs=0.11)
    tab.key("ArrowRight", shift=True)
    assert all(readings(tab))
    tab.key("-")
    tab.key("0")
    assert view(tab) == whole


@in_browser
def test_arrows_change_the_trial(tab: Tab) -> None:
    whole = view(tab)
    tab.ask("document.getElementById('viewer-trial').focus()")
    tab.key("ArrowDown")
    tab.key("ArrowDown")
    tab.until("document.getElementById('viewer-trial').selectedIndex === 2")
    # The trials stand in the order of their errors, so that which is which is asked.
    shown = tab.ask("document.getElementById('viewer-trial').selectedOptions[0].textContent")
    length = 59.95 if shown.endswith("c.csv") else 39.95  # the sine, or a hold
    assert view(tab)[1] == pytest.approx(length, abs=0.06)
    assert whole[0] == 0.0


@in_browser
def test_buttons_do_what_they_say(tab: Tab) -> None:
    whole = view(tab)
    seen = [whole]
    for name in ("in", "earlier", "later", "out", "in", "whole"):
        tab.ask(f"document.getElementById('viewer-{name}').click()")
        seen.append(view(tab))
    _, near, before, after, far, again, last = seen
    assert near[1] - near[0] == pytest.approx(0.5 * (whole[1] - whole[0]))
    assert before[0] < after[0]
    assert far == last == whole
    assert again == near


@in_browser
def test_the_cursor_reads_all_panels_at_one_instant(tab: Tab) -> None:
    assert not any(readings(tab))
    tab.mouse("mouseMoved", *panel(tab, 2, 0.5))
    tab.until("document.getElementById('viewer-time').textContent")
    shown = [float(text.replace("−", "-")) for text in readings(tab)]
    assert len(shown) == 11  # measured, without, with; errors of two; the same of the heading; torque
    measured, without, simulated, error_without, error = shown[:5]
    assert error_without == pytest.approx(without - measured, abs=2e-3 * abs(measured))  # four digits are shown
    assert error == pytest.approx(simulated - measured, abs=2e-3 * abs(measured))
    assert error == pytest.approx(error_without / 4.0, abs=2e-3 * abs(measured))


def stage(tab: Tab) -> list[bool]:
    """Which switches are on."""
    on: list[bool] = tab.ask("[...document.querySelectorAll('#viewer-causes input')].map((each) => each.checked)")
    return on


def off_by(tab: Tab) -> list[float]:
    """What the table says of the rate: of this trial and of all."""
    cells = tab.ask(
        "[...document.querySelectorAll('#viewer-numbers tbody tr:last-child td')].map((each) => each.textContent)"
    )
    assert all(cell.endswith(" rad/s") for cell in cells)
    return [float(cell.removesuffix(" rad/s")) for cell in cells]


@in_browser
def test_a_switch_moves_the_lines_and_the_numbers(tab: Tab) -> None:
    tab.mouse("mouseMoved", *panel(tab, 1, 0.5))
    tab.until("document.getElementById('viewer-time').textContent")
    full = off_by(tab)
    assert stage(tab) == [True, True]
    tab.ask("document.querySelector('#viewer-causes input').click()")
    assert stage(tab) == [False, True]
    assert off_by(tab) == pytest.approx([4.0 / 3.0 * each for each in full], rel=0.05)  # two digits are shown
    named = tab.ask("document.querySelector('.viewer-simulated').textContent")
    assert named == "with constant torque"
    assert tab.ask("document.getElementById('viewer-trial').options[0].textContent").count("→") == 1


@in_browser
def test_causes_come_step_by_step(tab: Tab) -> None:
    seen = []
    for name in ("without", "step", "step", "step", "all"):
        tab.ask(f"document.getElementById('viewer-{name}').click()")
        seen.append((stage(tab), off_by(tab)))
    assert [switches for switches, _ in seen] == [
        [False, False],
        [True, False],
        [True, True],
        [False, False],
        [True, True],
    ]
    errors = [own for _, (own, _) in seen]
    assert errors[0] > errors[1] > errors[2]
    assert tab.ask("getComputedStyle(document.querySelector('.viewer-without')).display") != "none"


@in_browser
def test_the_switches_are_switches_for_keys_and_readers(tab: Tab) -> None:
    tab.ask("document.querySelector('#viewer-causes input').focus()")
    tab.key(" ")
    assert stage(tab) == [False, True]
    names = tab.ask(
        "[...document.querySelectorAll('[role=switch]')].map((each) => each.parentElement.textContent.trim())"
    )
    assert names == ["thruster lag", "constant torque"]
    assert tab.ask("document.querySelector('#viewer-numbers tbody').getAttribute('aria-live')") == "polite"


@in_browser
def test_names_from_logs_make_no_elements(tab: Tab) -> None:
    names = tab.ask("[...document.querySelectorAll('#viewer-trial option')].map((each) => each.textContent)")
    assert sum(name.endswith(f" rad/s: {NASTY}") for name in names) == 1  # the error first
    assert tab.ask("[...document.querySelectorAll('b')].filter((each) => each.textContent === 'x').length") == 0


@in_browser
def test_dark_and_narrow_and_print(tab: Tab) -> None:
    colour = "getComputedStyle(document.querySelector('.viewer-key line')).stroke"
    light = tab.ask(colour)
    tab.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark"}])
    tab.call("Emulation.setDeviceMetricsOverride", width=400, height=800, deviceScaleFactor=2, mobile=True)
    try:
        assert tab.ask(colour) != light
        tab.until("document.querySelectorAll('#viewer-panels canvas').length === 5")
        tab.until("document.querySelector('#viewer-panels canvas').clientWidth <= 400")
        assert tab.ask("document.documentElement.scrollWidth") <= 400
        tab.call("Emulation.setDeviceMetricsOverride", width=320, height=800, deviceScaleFactor=2, mobile=True)
        tab.until("document.querySelector('#viewer-panels canvas').clientWidth <= 320")
        assert tab.ask("document.documentElement.scrollWidth") <= 320
        tab.call("Emulation.setEmulatedMedia", media="print")
        assert tab.ask("getComputedStyle(document.getElementById('viewer-root')).display") == "none"
        # A title is not the last line of a sheet.
        folded = "[...document.querySelectorAll('h2, details.section > summary')]"
        assert tab.ask(f"{folded}.every((each) => getComputedStyle(each).breakAfter === 'avoid')")
    finally:
        tab.call("Emulation.setEmulatedMedia", media="", features=[])
        tab.call("Emulation.clearDeviceMetricsOverride")


@in_browser
def test_without_script_the_page_points_to_its_pictures(browser: Tab, plain_page: Path) -> None:
    browser.call("Emulation.setScriptExecutionDisabled", value=True)
    try:
        browser.open(plain_page)
        assert browser.ask("document.getElementById('viewer-root').hidden")
        assert browser.ask("document.querySelector('#trials .note').offsetHeight") > 0
    finally:
        browser.call("Emulation.setScriptExecutionDisabled", value=False)


@in_browser
def test_the_browser_would_tell_of_an_error_and_of_a_request(browser: Tab, tmp_path: Path) -> None:
    page = tmp_path / "bad.html"
    page.write_text("<img src='none.png'><script>nonsense()</script>")
    browser.complaints.clear()
    browser.requests.clear()
    browser.open(page)
    assert any("nonsense" in each for each in browser.complaints)
    assert any(url.endswith("none.png") for url in browser.requests)


@in_browser
def test_of_many_causes_one_comes_after_another(browser: Tab, tmp_path: Path) -> None:
    names = {"hold_1.csv": "a.csv", "hold_2.csv": "b.csv", "sine_a.csv": "c.csv"}
    evidence = make_evidence(tmp_path, names)
    ids = ("thruster_lag", "bias_torque", "drag_asymmetry", "coulomb_resistance")
    effects = tuple(map(effect_named, ids))
    plain, stages = evidence.parameters.model(), []
    for count in range(len(effects) + 1):
        values = tuple(parameter.neutral for effect in effects[:count] for parameter in effect.parameters)
        model = replace(plain, effects=effects[:count], effect_values=values)
        items = tuple(nearer(item, count + 1) for item in evidence.simulations)
        stages.append(NestedSimulation(model=model, simulations=items))
    page = tmp_path / "index.html"
    page.write_text(render_page(replace(evidence, nested=tuple(stages)), ReportFigures(), today=date(2026, 3, 7)))
    opened(browser, page)
    assert stage(browser) == [True] * 4
    switch = "document.querySelectorAll('#viewer-causes input')[{}].click()"
    browser.ask(switch.format(2))
    assert stage(browser) == [True, True, False, False]
    browser.ask(switch.format(3))
    assert stage(browser) == [True] * 4
    browser.ask(switch.format(0))
    assert stage(browser) == [False] * 4
    browser.ask("document.getElementById('viewer-step').click()")
    assert stage(browser) == [True, False, False, False]
    quiet(browser, page)


@in_browser
def test_a_link_unfolds_what_it_leads_to(tab: Tab) -> None:
    folded = "document.getElementById('sources').open"
    assert not tab.ask(folded)
    tab.ask("document.querySelector('nav a[href=\"#sources\"]').click()")
    tab.until(folded)
    # A key does the same for those who do not use a mouse.
    tab.ask("document.querySelector('#drag > summary').focus()")
    tab.key(" ")
    tab.until("document.getElementById('drag').open")


# What stands on the first screen, as it has to be seen without scrolling.
FIRST = (
    "#summary-title",
    ".answer dt:nth-of-type(1) + dd",
    ".answer dt:nth-of-type(2) + dd",
    ".answer dt:nth-of-type(3) + dd",
    ".answer dt:nth-of-type(4) + dd",
    ".worst svg",
)


def bottom(tab: Tab, selector: str) -> float:
    """Where the part of the page that is seen and fits ``selector`` ends, in px from the top of the page."""
    found = tab.ask(
        f"Math.max(...[...document.querySelectorAll({selector!r})].filter((each) => each.clientHeight)"
        ".map((each) => each.getBoundingClientRect().bottom + scrollY))"
    )
    return float(found)


@in_browser
@pytest.mark.parametrize(("width", "height"), [(1280, 800), (390, 844)])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_first_screen_tells_wrong_why_gain_and_next(
    browser: Tab, lagged: ReportData, lagged_folder: Path, width: int, height: int, scheme: str
) -> None:
    assert lagged.extended is not None
    page = lagged_folder / "report" / "index.html"
    media = [{"name": "prefers-color-scheme", "value": scheme}]
    browser.call("Emulation.setEmulatedMedia", media="", features=media)
    browser.call(
        "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 600
    )
    try:
        browser.open(page)
        terms = browser.ask("[...document.querySelectorAll('.answer dt')].map((each) => each.textContent)")
        assert terms == ["Wrong", "Why", "Better", "Next"]
        for selector in FIRST:
            assert bottom(browser, selector) <= height, selector
        assert browser.ask("document.documentElement.scrollWidth") <= width
        # Text and lines of the picture stand out from the page in either scheme.
        ink = browser.ask("getComputedStyle(document.querySelector('.worst svg text')).fill")
        back = browser.ask("getComputedStyle(document.body).backgroundColor")
        assert ink != back
    finally:
        browser.call("Emulation.setEmulatedMedia", media="", features=[])
        browser.call("Emulation.clearDeviceMetricsOverride")


@in_browser
def test_on_a_telephone_every_value_keeps_its_unit(browser: Tab, lagged_folder: Path) -> None:
    browser.call("Emulation.setDeviceMetricsOverride", width=390, height=844, deviceScaleFactor=1, mobile=True)
    try:
        browser.open(lagged_folder / "report" / "index.html")
        # The table of parameters scrolls sideways under its first column, which has the units and stays.
        row = (
            "(() => { const row = document.querySelector('#model tbody tr'), cell = row.cells[0];"
            " row.closest('.scroll').scrollLeft = 500; const box = cell.getBoundingClientRect();"
            " return [cell.textContent, box.left, box.right]; })()"
        )
        text, left, right = browser.ask(row)
        assert "kg m²" in text.replace("\xa0", " ")
        assert 0.0 <= left < right <= 390.0
        values = browser.ask("[...document.querySelectorAll('.gain-value')].map((each) => each.textContent)")
        assert all(value.endswith((" deg", " rad/s")) for value in values)
    finally:
        browser.call("Emulation.clearDeviceMetricsOverride")


def printed(tab: Tab, page: Path) -> bytes:
    """The page as the browser prints it on A4."""
    tab.open(page)
    answer = tab.call("Page.printToPDF", preferCSSPageSize=True, printBackground=False)
    return base64.b64decode(answer["data"])


def pages(document: bytes) -> int:
    return len(re.findall(rb"/Type\s*/Page\b", document))


@in_browser
def test_the_sample_days_page_prints_on_ten_sheets(browser: Tab, sample_page: Path) -> None:
    assert 2 <= pages(printed(browser, sample_page)) <= 10


@in_browser
def test_the_answer_and_the_numbers_print_on_one_sheet(browser: Tab, lagged_folder: Path, tmp_path: Path) -> None:
    page = lagged_folder / "report" / "index.html"
    whole = pages(printed(browser, page))
    # Without all that follows the model there is one sheet, and it is all that is lost.
    alone = tmp_path / "alone.html"
    text = page.read_text(encoding="utf-8")
    alone.write_text(
        text.replace("</style>", "#trials, #model ~ * { display: none !important; }</style>", 1), encoding="utf-8"
    )
    assert pages(printed(browser, alone)) == 1
    assert whole > 1
