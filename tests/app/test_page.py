"""The page in a real browser: from a folder without rovid.toml to the report, by mouse and by keyboard."""

from __future__ import annotations

import contextlib
import http.server
import re
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar, Literal
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Browser, Locator, Page, sync_playwright

import rovid.app
from rovid.trial.config import load_config
from tests.app.conftest import logs_into, riddle
from tests.app.served import Served, served
from tests.conftest import SAMPLES
from tests.preflight.test_drive_guess import boat
from tests.present.chromium import find_chromium

pytestmark = pytest.mark.skipif(find_chromium() is None, reason="no Chromium here")
_PATIENCE = 180_000.0  # ms; a diagnosis on a busy machine
_QUICK = 30_000.0


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        # In a container Chromium has no sandbox of its own.
        one = playwright.chromium.launch(executable_path=find_chromium(), args=["--no-sandbox"])
        yield one
        one.close()


@contextlib.contextmanager
def opened(browser: Browser, server: Served, scheme: Literal["light", "dark"] = "light") -> Iterator[Page]:
    """The page; it must not log errors or send requests to other hosts or ports."""
    page = browser.new_page(color_scheme=scheme, viewport={"width": 1280, "height": 900})
    page.set_default_timeout(_QUICK)
    complaints: list[str] = []
    asked: list[str] = []
    # The browser also notes each refused request, which the page shows.
    page.on("console", lambda said: complaints.extend([said.text] * ("status of 400" not in said.text)))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))
    page.goto(server.address)
    yield page
    page.close()
    assert complaints == []
    own = urlsplit(server.address).netloc
    assert {urlsplit(url).netloc for url in asked if not url.startswith("data:")} == {own}


def headline(page: Page, words: str, timeout: float = _QUICK) -> None:
    page.locator("#now-title", has_text=words).wait_for(timeout=timeout)


def role(page: Page, column: str) -> Locator:
    return page.get_by_label(f"What {column} is", exact=True)


def show_step(page: Page, name: str) -> None:
    page.locator(f"#steps button[data-step={name}]").click()
    assert page.locator(".step:visible").count() == 1


def test_from_a_folder_without_rovid_toml_to_the_report(browser: Browser, tmp_path: Path) -> None:
    """Meaningless column names: the questions are answered where they are asked, and the run is always in reach."""
    top = tmp_path / "top"
    riddle(top / "day")
    with served(top) as server, opened(browser, server) as page:
        headline(page, "Choose the folder")
        page.get_by_role("button", name="day (4 files)").click()
        headline(page, "2 questions are open")
        # The run leads to what is missing.
        page.locator("#run-button").click()
        headline(page, "2 questions are open")
        page.get_by_label("Unit of the heading").select_option("deg")
        page.get_by_label("Column of the heading").select_option("a")
        for name in "bc":
            role(page, name).select_option("command")
        assert page.get_by_label("Unit of a", exact=True).input_value() == "deg"
        headline(page, "Go with care")
        # The one at the stern, 0.43 m behind the middle, pushes to port; its arm is asked for in the first lines.
        asked = page.locator("#now-list").get_by_label("c: yaw arm, m")
        asked.fill("0.43")
        asked.press("Enter")
        page.locator("#now-list button", has_text="Go there").first.click()
        assert page.evaluate("document.activeElement.id") == "t-arm-b"
        assert "position is not known: b, c." in page.locator("#unplaced").inner_text()
        page.get_by_label("b: ahead, m").fill("0,43")
        page.get_by_label("b: direction, degrees from the bow").fill("90")
        # The answer of the check may move the plots, so nobody drags before it is there.
        with page.expect_response("**/check"):
            page.get_by_label("b: direction, degrees from the bow").press("Tab")
        page.locator("#now-title:not(.busy)").wait_for()
        show_step(page, "signals")
        drag_over_a_plot(page)
        page.get_by_label("Reason").fill("a hand on the vehicle")
        page.get_by_role("button", name="Leave out", exact=True).click()
        show_step(page, "check")
        page.locator("#save summary").click()
        page.locator("#toml", has_text="a hand on the vehicle").wait_for()
        assert page.locator("#toml").inner_text().count("yaw_arm = 0.43") == 2
        headline(page, "Go with care")
        show_step(page, "run")
        page.get_by_label("without diagnosis").check()
        run(page)
        page.locator("#repeat summary").click()
        assert page.locator("#commands code").all_inner_texts()[0] == "rovid init day --heading a --command b,c"
        another_folder_clears_all(page, top)
    config = load_config(top / "day" / "rovid.toml")
    (stretch,) = config.exclusions
    assert (stretch.log, stretch.reason) == ("hold_03.csv", "a hand on the vehicle")
    assert 0.0 < stretch.begin < stretch.end <= 264.0
    assert [(one.name, round(one.arm, 3)) for one in config.vehicle.thrusters] == [("b", 0.43), ("c", 0.43)]
    assert (top / "day" / "report" / "index.html").is_file()


@pytest.mark.slow
def test_all_logs_are_guessed_from_and_a_no_go_is_not_run(browser: Browser, tmp_path: Path) -> None:
    """The first log is shown first. One thruster rests in this log, and the other format is not in it."""
    top = tmp_path / "top"
    logs_into(top / "day", "aft_only.csv", "hold_03.csv", "hold_06.mcap")
    script = (Path(rovid.app.__file__).parent / "static" / "app.js").read_text(encoding="utf-8")
    ahead = re.sub("const SMALL = [^;]*;", "const SMALL = 0;", script)
    with served(top) as server, opened(browser, server) as page:
        page.route("**/app.js", lambda route: route.fulfill(body=ahead, content_type="text/javascript"))
        page.reload()
        page.get_by_role("button", name="day (4 files)").click()
        role(page, "supply_V").select_option("")  # while the other logs are read
        headline(page, "Go with care")
        assert page.locator("#thruster-table tbody tr").count() == 2
        page.locator("#which").select_option("all")
        assert role(page, "supply_V").input_value() == ""
        page.locator("#time-unit").select_option("us")
        headline(page, "No go")
        page.locator("#run-button").click()
        assert page.evaluate("document.activeElement.id") == "despite"
        assert page.locator("#run-short").inner_text() == "The check says no go."
        assert server.get("api/progress").document["state"] == "none"
        page.get_by_label("run in spite of the check").check()
        assert page.locator("#run-short").inner_text() == ""


def another_folder_clears_all(page: Page, top: Path) -> None:
    (top / "empty").mkdir()
    show_step(page, "logs")
    page.get_by_label("Folder below").fill("empty")
    page.get_by_role("button", name="Open", exact=True).click()
    page.locator("#trouble", has_text="holds no logs").wait_for()
    headline(page, "Choose the folder")
    assert not re.search("previously|page …", page.locator("#heard").inner_text())
    for name in ("signals", "thrusters", "check", "run", "result"):
        show_step(page, name)
        assert "hold_03" not in page.locator("main").inner_text()
        assert page.locator(".chart:visible, #report:visible, #run-steps li, #toml span").count() == 0


def drag_over_a_plot(page: Page) -> None:
    """An answer that arrives meanwhile may move the plot away from the mouse; then the user drags again."""
    page.get_by_label("drag leaves out").check()
    plot = page.locator(".chart .u-over").first
    for _ in range(5):
        plot.scroll_into_view_if_needed()
        box = plot.bounding_box()
        assert box is not None
        middle = box["y"] + box["height"] / 2
        page.mouse.move(box["x"] + 0.2 * box["width"], middle)
        page.mouse.down()
        page.mouse.move(box["x"] + 0.4 * box["width"], middle, steps=4)
        page.mouse.up()
        if page.get_by_label("Reason").is_visible():
            return
        page.wait_for_timeout(500.0)
    pytest.fail("a drag over a plot selects nothing")


def run(page: Page) -> None:
    page.locator("#run-button").click()
    headline(page, "Done: here is the report", _PATIENCE)
    report = page.frame_locator("#report-frame")
    report.locator("#summary-title").wait_for()
    report.locator("canvas").first.wait_for()  # its own script runs
    # The report scrolls, the page around it does not.
    assert page.evaluate("document.documentElement.scrollHeight <= innerHeight")
    assert page.locator("#report-frame").get_attribute("sandbox") == "allow-scripts"


@pytest.mark.slow
def test_the_page_works_with_the_keyboard_in_dark_mode(browser: Browser, tmp_path: Path) -> None:
    """Only Tab, Enter, Space and arrow keys, up to the report; the run is at most 15 tab stops away."""
    top = tmp_path / "top"
    logs_into(top / "day", "hold_03.csv", "hold_05.csv", "sine_40s_a.csv", "staircase.csv")
    with served(top) as server, opened(browser, server, "dark") as page:
        assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(15, 19, 24)"
        assert tab_to(page, "document.activeElement.id === 'run-button'") <= 15
        tab_to(page, "document.activeElement.textContent === 'day (5 files)'")
        page.keyboard.press("Enter")
        headline(page, "Go with care")
        tab_to(page, "document.activeElement.dataset.step === 'thrusters'")
        page.keyboard.press("Enter")
        # The sketch: the thruster at the bow, moved ahead by 10 cm at a time.
        tab_to(page, "document.activeElement.dataset.thruster === 'fore'")
        assert "1 m ahead" in (page.locator(":focus").get_attribute("aria-label") or "")
        for _ in range(5):
            page.keyboard.press("Shift+ArrowDown")
        assert "0.5 m ahead" in (page.locator(":focus").get_attribute("aria-label") or "")
        page.locator("#heard", has_text="fore: arm 0.5 m").wait_for()
        tab_to(page, "document.activeElement.id === 't-arm-aft'")
        page.keyboard.press("Control+a")
        page.keyboard.type("0.5")
        page.keyboard.press("Enter")
        headline(page, "Go")
        tab_to(page, "document.activeElement.dataset.step === 'run'")
        page.keyboard.press("Enter")
        tab_to(page, "document.activeElement.id === 'run-quick'")
        page.keyboard.press("Space")
        tab_to(page, "document.activeElement.id === 'run-button'")
        page.keyboard.press("Enter")
        headline(page, "Done: here is the report", _PATIENCE)
        # It ends where the report is.
        assert page.evaluate("document.activeElement.id") == "report-link"
    thrusters = load_config(top / "day" / "rovid.toml").vehicle.thrusters
    assert [(one.name, one.arm) for one in thrusters] == [("fore", 0.5), ("aft", 0.5)]


def tab_to(page: Page, there: str) -> int:
    """Press Tab until ``there``, and return how often; each focused element is visible and has a name."""
    for stops in range(1, 80):
        page.keyboard.press("Tab")
        stop = page.evaluate(
            """() => { const one = document.activeElement, box = one.getBoundingClientRect();
            return { name: one.getAttribute("aria-label") || one.labels?.[0]?.textContent
                           || one.textContent || one.title,
                     seen: box.width > 0 && box.height > 0, tag: one.tagName }; }"""
        )
        assert stop["tag"] == "BODY" or (stop["seen"] and stop["name"].strip()), stop
        if page.evaluate(f"Boolean({there})"):
            return stops
    raise AssertionError(there)


@pytest.mark.slow
def test_a_cancelled_run_can_be_started_again(browser: Browser, tmp_path: Path) -> None:
    top = tmp_path / "top"
    logs_into(top / "day")
    with served(top, "day") as server, opened(browser, server) as page:
        headline(page, "Go")
        page.locator("#run-button").click()
        page.get_by_role("button", name="Cancel").click()
        page.locator("#run-said", has_text="Cancelled").wait_for()
        assert page.locator("#run-button").is_visible()
        assert not page.locator("#report").is_visible()


@pytest.mark.slow
def test_a_failed_run_is_the_first_line(browser: Browser, tmp_path: Path) -> None:
    top = tmp_path / "top"
    logs_into(top / "day")
    (top / "day" / "report").write_text("a file in the place of the folder")
    with served(top, "day") as server, opened(browser, server) as page:
        headline(page, "Go")
        page.locator("#run-button").click()
        headline(page, "The run failed.", _PATIENCE)
        why = page.locator("#run-error").inner_text()
        show_step(page, "check")
        assert why in page.locator("#now-list").inner_text()
        page.locator("#now-list button", has_text="Go to the run").click()
        assert page.locator("#run-error").is_visible()
        assert why not in page.locator("#now-list").inner_text()  # once is enough


@pytest.mark.slow
def test_the_type_of_the_vehicle_answers_for_all_its_motors(browser: Browser, tmp_path: Path) -> None:
    """Eight outputs, four of them vertical motors: one question, and one answer."""
    top = tmp_path / "top"
    (top / "day").mkdir(parents=True)
    shutil.copy(SAMPLES / "bluerov2_pier59" / "dive.csv", top / "day")
    with served(top, "day") as server, opened(browser, server) as page:
        headline(page, "One question is open")
        page.locator("#now-list button", has_text="Go there").first.click()
        page.locator("#type:focus").select_option("bluerov2")
        headline(page, "Go with care")
        assert page.locator("#thruster-table tbody tr").count() == 4
        show_step(page, "signals")
        assert role(page, "pwm5_us").input_value() == ""


@pytest.mark.slow
def test_a_rudder_and_the_unit_of_the_time_are_shown(browser: Browser, tmp_path: Path) -> None:
    top = tmp_path / "top"
    (top / "day").mkdir(parents=True)
    boat(top / "day")
    log = top / "day" / "run.csv"
    head, *rows = log.read_text().splitlines()
    stamped = [f"{100 * at},{row.partition(',')[2]}" for at, row in enumerate(rows)]
    log.write_text("\n".join([f"tick,{head.partition(',')[2]}", *stamped]) + "\n")
    with served(top, "day") as server, opened(browser, server) as page:
        headline(page, "Go with care")
        assert page.locator("#time-unit option:checked").inner_text() == "ms (a guess)"
        assert role(page, "helm_deg").locator("option:checked").inner_text() == "angle of a rudder"
        page.locator("#columns-said", has_text="in use: 3").wait_for()
        show_step(page, "thrusters")
        assert "its angle is helm_deg" in page.locator("#senses").inner_text()
        page.locator("#t-rudder-rudder").fill("12,5")
        page.locator("#t-rudder-rudder").press("Enter")
        page.locator("#toml", has_text="coefficient = 12.5 ").wait_for(state="attached")
        show_step(page, "signals")
        page.locator("#time-unit").select_option("us")
        headline(page, "No go")
        page.locator("#now-list button", has_text="Go to the unit of the time").click()
        assert page.evaluate("document.activeElement.id") == "time-unit"


@pytest.mark.slow
def test_sixty_columns_fit_a_phone_and_are_drawn_when_visible(browser: Browser, tmp_path: Path) -> None:
    top = tmp_path / "top"
    folder = logs_into(top / "day")
    head, *rows = (folder / "hold_03.csv").read_text().splitlines()
    names = ",".join(f"a_long_name_of_a_column_{k}" for k in range(54))
    text = "\n".join(
        [
            f"{head},{names}",
            *(f"{row},{','.join(str((at + k) % 17) for k in range(54))}" for at, row in enumerate(rows)),
        ]
    )
    (folder / "wide.csv").write_text(text + "\n")
    with served(top, "day") as server, opened(browser, server) as page:
        page.set_viewport_size({"width": 390, "height": 800})
        headline(page, "Go")
        page.locator("#log").select_option(label="wide.csv")
        page.locator("#which").select_option("all")
        page.locator("#columns-said", has_text="60 of 60").wait_for()
        page.locator(".chart canvas").first.wait_for()
        drawn = page.locator(".chart canvas").count()
        assert 0 < drawn < 20
        page.locator(".chart").last.scroll_into_view_if_needed()
        page.locator(".chart").last.locator("canvas").wait_for()
        assert page.evaluate("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
        # The arms are on the screen without scrolling sideways.
        show_step(page, "thrusters")
        arm = page.locator("#t-arm-fore").bounding_box()
        assert arm is not None
        assert arm["x"] + arm["width"] < 390


class _Evil(http.server.BaseHTTPRequestHandler):
    """A page of another user's server on this machine that knows the address."""

    target = ""
    visits: ClassVar[list[str]] = []

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("content-type", "text/html")
        self.end_headers()
        _Evil.visits.append(self.path)
        text = f"""<!doctype html><img id=i src="{self.target}static/app.css"><iframe src="{self.target}"></iframe>
        <script>
        const tried = [["GET", {{}}], ["POST", {{ method: "POST", body: "{{}}" }}]].map(async ([name, options]) => {{
          try {{
            return [name, (await fetch("{self.target}api/start", options)).status];
          }} catch {{ return [name, "refused"]; }}
        }});
        fetch("{self.target}api/cancel", {{ method: "POST", mode: "no-cors" }});
        Promise.all(tried).then((all) => {{ window.done = all; }});
        </script>"""
        self.wfile.write(text.encode())

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def evil(server: Served) -> Iterator[str]:
    """Address of the page of another user."""
    _Evil.target = server.address
    _Evil.visits.clear()
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), _Evil) as other:
        threading.Thread(target=other.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{other.server_port}/"
        other.shutdown()


def test_a_page_of_another_port_gets_no_answer(browser: Browser, server: Served, evil: str) -> None:
    page = browser.new_page()
    answers: list[tuple[str, int]] = []
    page.on("response", lambda answer: answers.append((answer.url, answer.status)))
    page.goto(evil)
    page.wait_for_function("window.done")
    page.wait_for_load_state("networkidle")
    assert page.evaluate("window.done") == [["GET", "refused"], ["POST", "refused"]]
    got = [status for url, status in answers if url.startswith(server.address)]
    assert got
    assert set(got) == {403}
    page.close()


# Everything by which a page may run a script, send a request, or lead to another address without a click.
_SPY = """<!doctype html>
<meta name="generator" content="rovid 1.0">
<link rel="prefetch" href="EVIL?prefetch"><link rel="preconnect" href="EVIL"><link rel="stylesheet" href="EVIL?style">
<link rel="modulepreload" href="EVIL?module"><link rel="manifest" href="EVIL?manifest"><base href="EVIL">
<style>@import "EVIL?import"; body {background: url(EVIL?picture)}</style>
<body id="body" onload="document.body.append('ran')">
<img src="EVIL?image"><img src="x" onerror="document.body.append('ran')"><video src="EVIL?video" autoplay></video>
<object data="EVIL?object"></object><embed src="EVIL?embed"><iframe src="EVIL?frame"></iframe>
<iframe srcdoc="<script>parent.document.body.append('ran')</script><img src='EVIL?inner'>"></iframe>
<svg><image href="EVIL?drawing"/></svg><a id="out" href="EVIL?link" target="_top" ping="EVIL?ping">out</a>
<a id="script" href="javascript:document.body.append('ran')">script</a>
<form action="EVIL?form" target="_top" method="post"><button id="form">send</button></form>
<script>document.body.append("ran")</script><script src="EVIL?script"></script>
<script>
const iceServers = [{urls: "turn:TURN?transport=tcp", username: "a", credential: "b"}];
const peer = new RTCPeerConnection({iceServers});
peer.createDataChannel("x"); peer.createOffer().then((offer) => peer.setLocalDescription(offer))</script>"""


def test_a_report_from_elsewhere_runs_no_script_and_sends_no_request(
    browser: Browser, tmp_path: Path, evil: str
) -> None:
    """A report is foreign content: no script of it runs, in the frame and in a tab of its own, and nothing is sent."""
    top = tmp_path / "top"
    logs_into(top / "day")
    (top / "day" / "report").mkdir()
    page_of_evil = _SPY.replace("EVIL", evil).replace("TURN", urlsplit(evil).netloc)
    (top / "day" / "report" / "index.html").write_text(page_of_evil)
    with served(top, "day") as server:
        page = browser.new_page()
        page.goto(server.address)
        headline(page, "Go")
        show_step(page, "result")
        frame = page.frame_locator("#report-frame")
        frame.locator("#out").wait_for()
        with page.context.expect_page() as opened_tab:
            page.get_by_role("link", name="Open the report").click()
        tab = opened_tab.value
        tab.locator("#out").wait_for()
        for one in (frame, tab):
            for way in ("script", "form"):
                one.locator(f"#{way}").click()
            assert "ran" not in one.locator("#body").inner_text()
        frame.locator("#out").click()
        page.wait_for_timeout(300)
        assert page.url == server.address
        assert server.token not in tab.url
        page.context.close()
    assert _Evil.visits == []
