"""Limits on connections and on unfinished requests: every program of this machine can connect, also without the token.

A connection without the token is closed after a short time. Beyond a number of connections, the oldest connection
without the token is closed, and the user's browser therefore gets through.
"""

from __future__ import annotations

import asyncio
import itertools
import logging
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
