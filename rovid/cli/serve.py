"""``rovid open`` and ``rovid mcp``: a page for a browser, and tools for an assistant."""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from rovid.cli.context import print_json
from rovid.core.errors import ConfigError

if TYPE_CHECKING:
    from rovid.app.auth import TokenGuard
    from rovid.app.sandbox import RootFolder, SessionFolder


def open(  # noqa: A001 - the command's name
    logs: list[Path] | None = None,
    *,
    browser: bool = True,
    budget: float | None = None,
    port: int = 0,
    json: bool = False,
) -> None:
    """Set up, fit and diagnose on a page in the browser."""
    from rovid.core.input_files import require_exists

    for path in logs or []:
        require_exists(path)
    missing = [name for name in ("starlette", "uvicorn") if find_spec(name) is None]
    if missing:
        raise ConfigError(
            f"`rovid open` needs the package{'s' * (len(missing) > 1)} {' and '.join(missing)}.",
            mend="Install what it needs with `pip install 'rovid[app]'`.",
        )
    from rovid.app.auth import show_in_browser
    from rovid.app.server import listen, serve

    def announce(guard: TokenGuard, root: RootFolder, session: SessionFolder) -> None:
        if json:
            print_json({"schema": "rovid-open/1", "address": guard.address, "folder": str(root.folder)})
        else:
            typer.echo(f"{guard.address}\nKeep this address secret: it gives access to the page. Ctrl-C ends the page.")
        sys.stdout.flush()
        if browser:
            show_in_browser(guard.ticket(), session.path)

    serve(logs or [], listen(port), announce, budget=budget)


def mcp() -> None:
    """Serve an assistant by the Model Context Protocol."""
    if find_spec("mcp") is None or find_spec("mcp.server.mcpserver") is None:
        raise ConfigError(
            "needs the package mcp, version 2 or later.",
            where="rovid mcp",
            mend="Install it with `pip install 'rovid[mcp]'`.",
        )
    from rovid.api.mcp_server import server

    server().run("stdio")
