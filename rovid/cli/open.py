"""``rovid open``."""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rovid.cli.context import print_json
from rovid.cli.help_format import Page
from rovid.cli.options import Json
from rovid.core.errors import ConfigError

if TYPE_CHECKING:
    from rovid.app.auth import TokenGuard
    from rovid.app.sandbox import RootFolder

PAGE = Page(
    text="""
    Opens a page in the browser, served on this machine alone: choose a folder of logs or drop logs on it, see every
    column, say which is the heading and which are the thrusters, place the thrusters on a sketch of the vehicle, leave
    stretches out, see what rovid check says, save rovid.toml, and run fit and diagnosis, up to the report.

    Writes what these commands write, and nothing else: rovid.toml and a first thrust curve beside the logs, a folder
    for what is dropped, the parameter file and the report. A rovid.toml that it did not write it does not replace. It
    reads nothing outside the folder where it was started, or that LOGS are in. Ctrl-C ends it.

    Use it in the place of rovid init, where guesses have to be looked at. It shows the commands that do the same.
    """,
    examples=(
        ("With a folder of logs", "rovid open my_logs"),
        ("With the address alone, for a browser of your choice", "rovid open my_logs --no-browser"),
    ),
    see=("rovid init", "rovid check", "rovid report", "rovid help open"),
)


def open(  # noqa: A001 - the command's name
    logs: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="LOGS",
            help="A folder of logs, or logs one by one; chosen on the page if not given.",
            show_default=False,
        ),
    ] = None,
    *,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open a browser, or print the address alone.")
    ] = True,
    port: Annotated[
        int, typer.Option("--port", min=0, max=65535, help="Port of this machine; a free one if 0.", metavar="PORT")
    ] = 0,
    json: Json = False,
) -> None:
    """Set up, fit and diagnose on a page in the browser, on this machine."""
    from rovid.core.paths import require_exists

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

    def said(guard: TokenGuard, top: RootFolder) -> None:
        if json:
            print_json({"schema": "rovid-open/1", "address": guard.address, "folder": str(top.folder)})
        else:
            typer.echo(f"{guard.address}\nFor this machine, and whoever has this address. Ctrl-C ends it.")
        sys.stdout.flush()
        if browser:
            show_in_browser(guard.ticket())

    serve(logs or [], listen(port), said)
