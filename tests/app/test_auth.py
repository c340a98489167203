"""Access control: only the browser with the address gets an answer."""

from __future__ import annotations

import asyncio
import stat
import threading
import webbrowser
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import pytest

from rovid.app.access import Message, Receive, Send, TokenGuard, session_folder
from rovid.app.server import show_in_browser
from tests.app.served import Served

OTHERS: dict[str, dict[str, str]] = {
    "another site": {"Origin": "https://evil.example"},
    "another port of this machine": {"Origin": "http://127.0.0.1:9999"},
    "a page without an origin": {"Origin": "null"},
    "another scheme": {"Origin": "https://127.0.0.1:{port}"},
    "another name of this machine": {"Origin": "http://localhost:{port}"},
    "an image on another site": {"Sec-Fetch-Site": "cross-site"},
    "a page of another port": {"Sec-Fetch-Site": "same-site"},
    "a link on another site": {
        "Sec-Fetch-Site": "cross-site",
        "Sec-Fetch-Mode": "navigate",
        "Sec-Fetch-Dest": "document",
    },
    "a name made to lead here": {"Host": "evil.example:{port}"},
    "that name without a port": {"Host": "evil.example"},
    "the other name of this machine": {"Host": "localhost:{port}"},
    "another port": {"Host": "127.0.0.1:1"},
    "no port": {"Host": "127.0.0.1"},
}
TARGETS = ("", "static/app.js", "api/start", "api/progress", "report/0123456789abcdef")


@pytest.mark.parametrize("who", OTHERS)
def test_other_sites_and_names_are_refused_even_with_the_token(server: Served, who: str) -> None:
    headers = {name: value.format(port=server.port) for name, value in OTHERS[who].items()}
    for target in TARGETS:
        refused = server.ask(f"/{server.token}/{target}", headers=headers)
        assert (refused.status, refused.body) == (403, b"Forbidden\n")
    assert server.ask(f"/{server.token}/api/cancel", "POST", headers, b"{}").status == 403
    assert server.ask(f"/{server.token}/api/start", "OPTIONS", headers).status == 403


def test_requests_without_the_token_are_refused_alike(server: Served) -> None:
    token = server.token
    tokens = ("", token[:-1], f"{token}0", token.swapcase(), f"%00{token}", "x" * 5000, "..")
    answers = [server.ask(f"/{other}/{target}") for other in tokens for target in TARGETS]
    answers += [server.ask("/"), server.ask("/api/start"), server.ask(f"/x/../{token}/"), server.ask(f"/{token}")]
    # The answer reveals neither rovid nor existing paths.
    told = {(one.status, one.body, tuple(sorted({**one.headers, "date": ""}))) for one in answers}
    assert len(told) == 1
    assert next(iter(told))[:2] == (403, b"Forbidden\n")
    assert "server" not in {name.lower() for name in answers[0].headers}


def test_requests_with_the_address_are_answered(server: Served) -> None:
    for headers in ({}, {"Sec-Fetch-Site": "none"}, {"Sec-Fetch-Site": "same-origin", "Origin": server.address[:-45]}):
        answer = server.ask(f"/{server.token}/", headers=headers)
        assert answer.status == 200
        assert b"<title>rovid open</title>" in answer.body


def test_every_answer_keeps_the_browser_on_this_machine(server: Served) -> None:
    for answer in (server.get(""), server.get("api/start"), server.get("static/app.css"), server.ask("/")):
        headers = {name.lower(): value for name, value in answer.headers.items()}
        assert "default-src 'none'" in headers["content-security-policy"]
        assert "unsafe" not in headers["content-security-policy"]
        assert headers["referrer-policy"] == "no-referrer"
        assert headers["cache-control"] == "no-store"
        assert headers["x-content-type-options"] == "nosniff"
        assert not any(name.startswith("access-control") for name in headers)
        assert "set-cookie" not in headers


def answer_to(guard: TokenGuard, path: str, *headers: tuple[bytes, bytes]) -> tuple[int, bytes]:
    said: list[Any] = []

    async def send(message: Message) -> None:
        said.append(message)

    async def receive() -> Message:
        return {}

    scope = {"type": "http", "method": "GET", "path": path, "headers": [(b"host", b"127.0.0.1:5000"), *headers]}
    asyncio.run(guard(scope, receive, send))
    return said[0]["status"], said[1]["body"]


async def nothing(scope: Message, receive: Receive, send: Send) -> None:
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": scope["path"].encode()})


def test_a_ticket_leads_to_the_page_once() -> None:
    guard = TokenGuard(app=nothing, port=5000)
    ticket = guard.ticket().removeprefix("http://127.0.0.1:5000")
    # The redirect comes from a local file, which the browser treats as another site.
    status, page = answer_to(guard, ticket, (b"sec-fetch-site", b"cross-site"))
    assert status == 200
    assert f"/{guard.token}/".encode() in page
    assert answer_to(guard, ticket)[0] == 403
    assert answer_to(guard, f"/{guard.token}/api/x") == (200, b"/api/x")


def test_two_host_headers_are_refused() -> None:
    guard = TokenGuard(app=nothing, port=5000)
    assert answer_to(guard, f"/{guard.token}/", (b"host", b"evil.example"))[0] == 403
    assert (
        answer_to(guard, f"/{guard.token}/", (b"sec-fetch-site", b"none"), (b"sec-fetch-site", b"cross-site"))[0] == 403
    )


def test_the_token_is_not_in_the_repr() -> None:
    guard = TokenGuard(app=nothing, port=5000)
    assert guard.token not in repr(guard)


def test_the_browser_gets_the_address_from_a_private_file(monkeypatch: pytest.MonkeyPatch) -> None:
    """The folder exists as long as the page."""
    opened: list[str] = []
    told = threading.Event()

    def browse(address: str) -> bool:
        opened.append(address)
        told.set()
        return True

    monkeypatch.setattr(webbrowser, "open", browse)
    with session_folder() as session:
        show_in_browser("http://127.0.0.1:5000/a-ticket", session)
        assert told.wait(10.0)
        assert "a-ticket" not in opened[0]
        page = Path(unquote(urlsplit(opened[0]).path))
        assert "url=http://127.0.0.1:5000/a-ticket" in page.read_text()
        assert stat.S_IMODE(page.parent.stat().st_mode) == 0o700
    assert not page.parent.exists()
