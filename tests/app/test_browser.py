"""The browser is sent to the page without the address in any list of processes."""

from __future__ import annotations

import stat
import threading
import webbrowser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

from rovid.app.auth import show_in_browser


def test_it_is_told_by_way_of_a_file_that_is_the_users_own(monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    told = threading.Event()

    def browse(address: str) -> bool:
        opened.append(address)
        told.set()
        return True

    monkeypatch.setattr(webbrowser, "open", browse)
    show_in_browser("http://127.0.0.1:5000/a-ticket")
    assert told.wait(10.0)
    assert "a-ticket" not in opened[0]
    page = Path(unquote(urlsplit(opened[0]).path))
    assert "url=http://127.0.0.1:5000/a-ticket" in page.read_text()
    assert stat.S_IMODE(page.parent.stat().st_mode) == 0o700
