"""Access control of the page, and limits on its connections: every program of this machine can connect."""

import asyncio
import hmac
import itertools
import logging
import secrets
import threading
import webbrowser
from collections.abc import Awaitable, Callable, Container, MutableMapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

# Largest number of connections. A browser opens six.
MOST_CONNECTIONS = 64
# Time in s that a connection may take until it shows the token.
UNKNOWN_TIMEOUT = 10.0
# Time in s between two parts of an unfinished request of the user's browser.
STALLED_TIMEOUT = 60.0
# Key of the state of a connection. `TokenGuard` adds an item to this list if a request has the token.
KNOWN = "rovid_known"
# Largest number of messages of the server on the terminal.
_MOST_MESSAGES = 20


class LimitedProtocol(H11Protocol):
    """One connection, closed if it is late or one too many."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override] # as in the base class
        """Start the clock, and close the oldest unknown connection if there are too many."""
        super().connection_made(transport)
        # uvicorn gives a shallow copy of the state to each request.
        self.known: list[bool] = []
        self.app_state = {KNOWN: self.known}
        self.made = self._heard = self.loop.time()
        self._timer = self.loop.call_later(UNKNOWN_TIMEOUT, self._close_if_late)
        connections: list[Any] = [one for one in self.connections if not one.transport.is_closing()]
        if len(connections) > MOST_CONNECTIONS:
            min(connections, key=lambda one: (bool(one.known), one.made)).transport.abort()

    def data_received(self, data: bytes) -> None:
        """Note the time."""
        self._heard = self.loop.time()
        super().data_received(data)

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop the clock."""
        self._timer.cancel()
        super().connection_lost(exc)

    def _close_if_late(self) -> None:
        is_answering = self.cycle is not None and not self.cycle.response_complete and not self.cycle.more_body
        is_stalled = not is_answering and self.loop.time() - self._heard > STALLED_TIMEOUT
        if not self.known or is_stalled:
            self.transport.abort()
        else:
            self._timer = self.loop.call_later(UNKNOWN_TIMEOUT, self._close_if_late)


def limit_messages(logger: logging.Logger) -> None:
    """Print only the first messages of ``logger``, errors only; no number of requests fills the terminal."""
    count = itertools.count()
    logger.setLevel(logging.ERROR)
    logger.addFilter(lambda _: next(count) < _MOST_MESSAGES)


ADDRESS = "127.0.0.1"
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
Asgi = Callable[[Message, Receive, Send], Awaitable[None]]

_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
# Headers of every answer, unless the answer sets them itself.
_HEADERS = {
    b"content-security-policy": _POLICY.encode(),
    b"cross-origin-opener-policy": b"same-origin",
    b"cross-origin-resource-policy": b"same-origin",
    b"referrer-policy": b"no-referrer",
    b"x-content-type-options": b"nosniff",
    b"x-dns-prefetch-control": b"off",
    b"cache-control": b"no-store",
}
_REFUSED = b"Forbidden\n"


@dataclass(frozen=True, kw_only=True)
class TokenGuard:
    """ASGI wrapper that admits requests to this address and port, from no other site, with the token.

    The token is the first part of each path. A cookie would not do: browsers send cookies to every port of a machine,
    also to a server of another user.

    A report is foreign content. Its address has no token, but a key of its own that opens this report only.
    """

    app: Asgi  # The wrapped application; its paths are without the token
    port: int
    report_keys: Container[str] = ()  # Reports that are shown under /report/KEY
    token: str = field(default_factory=lambda: secrets.token_urlsafe(32), repr=False)
    # Single-use tokens for a browser that is sent here by a local file
    tickets: set[str] = field(default_factory=set, repr=False)

    @property
    def origin(self) -> str:
        """Origin of the page, without the token."""
        return f"http://{ADDRESS}:{self.port}"

    @property
    def address(self) -> str:
        """Address of the page for a browser."""
        return f"{self.origin}/{self.token}/"

    def ticket(self) -> str:
        """A single-use address that leads to the page."""
        self.tickets.add(ticket := secrets.token_urlsafe(32))
        return f"{self.origin}/{ticket}"

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        """Answer or refuse a request."""
        if scope["type"] != "http":
            return
        first, slash, rest = scope["path"].removeprefix("/").partition("/")
        # Another site's name may resolve to this machine (DNS rebinding).
        if _values(scope, b"host") != [self.origin.removeprefix("http://").encode()]:
            await _answer(send, 403, _REFUSED)
        elif slash and self._is_same_site(scope) and (inside := self._path_inside(first, rest)):
            scope.get("state", {}).get(KNOWN, []).append(True)
            inner = {**scope, "path": inside, "raw_path": inside.encode(), "root_path": ""}
            await self.app(inner, receive, _with_headers(send))
        elif not slash and scope["method"] == "GET" and self._redeem(first):
            # After this redirect the browser's requests have our own origin.
            page = f'<!doctype html><meta http-equiv="refresh" content="0;url=/{self.token}/"><title>rovid</title>'
            await _answer(send, 200, page.encode(), b"text/html; charset=utf-8")
        else:
            await _answer(send, 403, _REFUSED)

    def _path_inside(self, first: str, rest: str) -> str | None:
        """Path for the application; None without the token or the key of a report."""
        if hmac.compare_digest(first.encode(), self.token.encode()):
            return None if rest.startswith("report/") else f"/{rest}"
        return f"/report/{rest}" if first == "report" and rest in self.report_keys else None

    def _is_same_site(self, scope: Message) -> bool:
        """Whether no other site sent the request; a typed address has no site."""
        origins, sites = _values(scope, b"origin"), _values(scope, b"sec-fetch-site")
        return set(origins) <= {self.origin.encode()} and set(sites) <= {b"same-origin", b"none"}

    def _redeem(self, given: str) -> bool:
        """Use up a ticket."""
        known = [ticket for ticket in self.tickets if hmac.compare_digest(ticket.encode(), given.encode())]
        self.tickets.difference_update(known)
        return bool(known)


def _values(scope: Message, name: bytes) -> list[bytes]:
    return [value for key, value in scope["headers"] if key.lower() == name]


def _with_headers(send: Send) -> Send:
    async def send_with_headers(message: Message) -> None:
        if message["type"] == "http.response.start":
            present = {key.lower() for key, _ in message["headers"]}
            message["headers"] = [*message["headers"], *((k, v) for k, v in _HEADERS.items() if k not in present)]
        await send(message)

    return send_with_headers


async def _answer(send: Send, status: int, body: bytes, kind: bytes = b"text/plain") -> None:
    headers = [(b"content-type", kind), (b"content-length", str(len(body)).encode())]
    await _with_headers(send)({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})


def show_in_browser(address: str, folder: Path) -> None:
    """Open a browser at ``address`` through a file in ``folder``, which only this user can read.

    All users of a machine can read the command lines of its processes, so the address must not be on one.
    """
    page = folder / "rovid.html"
    refresh = f'<meta http-equiv="refresh" content="0;url={address}">'
    page.write_text(f"<!doctype html>\n<title>rovid</title>\n{refresh}\n", encoding="utf-8")
    # A text browser blocks until it is closed.
    threading.Thread(target=webbrowser.open, args=(page.as_uri(),), daemon=True).start()
