"""The pages keep the rules of axe-core: on any screen, light or dark, with all parts open."""

from __future__ import annotations

import importlib.resources
from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import pytest
from playwright.sync_api import Browser, Page, sync_playwright

from tests.app.conftest import logs_into
from tests.app.served import served
from tests.conftest import slow
from tests.present.chromium import find_chromium

pytestmark = pytest.mark.skipif(find_chromium() is None, reason="no Chromium here")
_SCREENS: list[tuple[Literal["light", "dark"], int]] = [("light", 1280), ("dark", 390)]


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        one = playwright.chromium.launch(executable_path=find_chromium(), args=["--no-sandbox"])
        yield one
        one.close()


def violations(page: Page) -> list[str]:
    page.evaluate((importlib.resources.files("axe_playwright_python") / "axe.min.js").read_text())
    found = page.evaluate("axe.run().then(result => result.violations)")
    return [f"{one['id']}: {node['html'][:200]}" for one in found for node in one["nodes"]]


@pytest.mark.parametrize(("scheme", "width"), [slow(*_SCREENS[0]), _SCREENS[1]])
@pytest.mark.usefixtures("reported")
def test_the_report(browser: Browser, lagged_folder: Path, scheme: Literal["light", "dark"], width: int) -> None:
    page = browser.new_page(color_scheme=scheme, viewport={"width": width, "height": 900})
    page.goto((lagged_folder / "report" / "index.html").as_uri())
    assert violations(page) == []
    page.evaluate("document.querySelectorAll('details').forEach(one => { one.open = true; })")
    assert violations(page) == []


@pytest.mark.parametrize(("scheme", "width"), [_SCREENS[0], slow(*_SCREENS[1])])
def test_the_guided_page(browser: Browser, tmp_path: Path, scheme: Literal["light", "dark"], width: int) -> None:
    logs_into(tmp_path / "day")
    with served(tmp_path) as server:
        page = browser.new_page(color_scheme=scheme, viewport={"width": width, "height": 900})
        page.goto(server.address)
        page.locator("#run-short", has_text="Choose the folder").wait_for()
        assert violations(page) == []
        page.get_by_role("button", name="day (3 files)").click()
        page.locator("#now-title", has_text="Go with care").wait_for()
        for step in page.locator("#steps button").all():
            step.click()
            assert violations(page) == [], step.inner_text()
        page.close()
