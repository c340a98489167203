"""Who may talk to the page: this machine's browser, at the address that holds the token; all else learns nothing."""

from __future__ import annotations

import hmac
import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from dataclasses import dataclass, field
from typing import Any

ADDRESS = "127.0.0.1"
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
Asgi = Callable[[Message, Receive, Send], Awaitable[None]]

_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
# Of every answer; a page that has a policy of its own keeps it.
_HEADERS = {
    b"content-security-policy": _POLICY.encode(),
    b"cross-origin-opener-policy": b"same-origin",
    b"cross-origin-resource-policy": b"same-origin",
    b"referrer-policy": b"no-referrer",
    b"x-content-type-options": b"nosniff",
    b"cache-control": b"no-store",
}
_REFUSED = b"Forbidden\n"


@dataclass(frozen=True, kw_only=True)
class TokenGuard:
    """Lets through what names this very address and port, comes of no other site, and knows the token.

    The token is the first part of each path, and no cookie: cookies do not tell one port from another, so that a
    browser would hand one to whatever another user of this machine serves.

    Attributes
    ----------
    app
        What answers, with the token taken off the path.
    port
        At which it is served.
    tickets
        Each may be used once in the place of the token, by a browser that was sent here by a file of ours.
    """

    app: Asgi
    port: int
    token: str = field(default_factory=lambda: secrets.token_urlsafe(32), repr=False)
    tickets: set[str] = field(default_factory=set, repr=False)

    @property
    def origin(self) -> str:
        """Where the page is, without the token."""
        return f"http://{ADDRESS}:{self.port}"

    @property
    def address(self) -> str:
        """What a browser is to be given."""
        return f"{self.origin}/{self.token}/"

    def ticket(self) -> str:
        """An address that leads to the page once."""
        self.tickets.add(made := secrets.token_urlsafe(32))
        return f"{self.origin}/{made}"

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        """Answer, or refuse."""
        if scope["type"] != "http":
            return
        first, slash, rest = scope["path"].removeprefix("/").partition("/")
        if not self._addressed(scope):
            await _answer(send, 403, _REFUSED)
        elif slash and self._is_own(scope) and hmac.compare_digest(first.encode(), self.token.encode()):
            inside = {**scope, "path": f"/{rest}", "raw_path": f"/{rest}".encode(), "root_path": ""}
            await self.app(inside, receive, _headed(send))
        elif not slash and scope["method"] == "GET" and self._redeemed(first):
            # From here on the browser comes of this very origin.
            page = f'<!doctype html><meta http-equiv="refresh" content="0;url=/{self.token}/"><title>rovid</title>'
            await _answer(send, 200, page.encode(), b"text/html; charset=utf-8")
        else:
            await _answer(send, 403, _REFUSED)

    def _addressed(self, scope: Message) -> bool:
        """Whether it was meant for this server: another site's name may be made to lead here."""
        return _values(scope, b"host") == [self.origin.removeprefix("http://").encode()]

    def _is_own(self, scope: Message) -> bool:
        """Whether no other site asks; what is typed or followed from outside a browser has no site."""
        origins, sites = _values(scope, b"origin"), _values(scope, b"sec-fetch-site")
        return set(origins) <= {self.origin.encode()} and set(sites) <= {b"same-origin", b"none"}

    def _redeemed(self, given: str) -> bool:
        known = next((one for one in self.tickets if hmac.compare_digest(one.encode(), given.encode())), None)
        self.tickets.discard(known or "")
        return known is not None


def _values(scope: Message, name: bytes) -> list[bytes]:
    return [value for key, value in scope["headers"] if key.lower() == name]


def _headed(send: Send) -> Send:
    async def headed(message: Message) -> None:
        if message["type"] == "http.response.start":
            there = {key.lower() for key, _ in message["headers"]}
            message["headers"] = [*message["headers"], *((k, v) for k, v in _HEADERS.items() if k not in there)]
        await send(message)

    return headed


async def _answer(send: Send, status: int, body: bytes, kind: bytes = b"text/plain") -> None:
    own = [(b"content-type", kind), (b"content-length", str(len(body)).encode())]
    await _headed(send)({"type": "http.response.start", "status": status, "headers": own})
    await send({"type": "http.response.body", "body": body})
