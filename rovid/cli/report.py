"""``rovid report``, ``rovid open`` and ``rovid mcp``: pages, and tools for an assistant."""

from __future__ import annotations

import sys
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from rovid.cli import context
from rovid.cli.options import SharedOptions
from rovid.cli.sessions import open_planar_session, store_planar_fit
from rovid.cli.streams import progress
from rovid.core.errors import ConfigError

if TYPE_CHECKING:
    from rovid.app.access import RootFolder, TokenGuard

_JOURNAL_WIDTHS = ("84mm", "174mm")


def report(
    logs: list[Path] | None = None,
    *,
    output: Path | None = None,
    diagnosis: bool = True,
    control: bool = True,
    export: bool = True,
    pdf: bool = False,
    journal: list[str] | None = None,
    shared: SharedOptions,
) -> None:
    """Write all results on one page."""
    planar = context.is_planar(shared)
    if not planar:
        context.compile_in_background()
    from rovid.present.console import print_path, show_caution, show_faults, show_warnings
    from rovid.present.documents.fits import all_warnings, axis_document, fault_documents, guess_document
    from rovid.present.page.page_files import pdf_output

    document, further = dict[str, Any](schema="rovid-report/1"), dict[str, Any]()
    choices: dict[str, Any] = {"diagnosed": diagnosis, "budget": shared.budget, "force": shared.force}
    choices |= {"pdf": pdf, "journal": list(map(_journal_width, journal or ()))}
    if planar:
        from rovid.present.documents.fits import AXES_DOCUMENT, measures_document
        from rovid.present.page.planar import build_planar_report

        session = open_planar_session(logs, shared)
        stored, reported = session.stored, session.study.logs
        folder = output or _default_folder("planar", session.study.vehicle.name, force=shared.force)
        with progress("Fitting surge, sway and yaw …") as show_progress:
            store = partial(store_planar_fit, session)
            page, contents = build_planar_report(session.study, stored, folder, store, report=show_progress, **choices)
        assumptions, answer = session.study.vehicle.assumptions, contents.headline
        notes = [*session.notes, *contents.notes]
        document |= AXES_DOCUMENT | {"verdict": contents.diagnosis and contents.diagnosis.verdict}
        further = {"standard_manoeuvres": measures_document(contents.manoeuvres)}
    else:
        from rovid.present.page.build import build_report
        from rovid.present.page.summary import summarize

        stored = context.parameters_at(shared, force=shared.force)
        notes = context.write_missing_config(logs, stored.axis) if logs else []
        reported = context.open_logs(logs or context.stored_logs(stored), shared.cutoff, stored.axis)
        if not shared.force:
            reported.require_sound()
        folder = output or _default_folder(stored.axis.name, reported.vehicle.name, force=shared.force)
        with progress("Fitting drag and inertia …") as show_progress:
            page, data = build_report(
                stored, reported, folder, controlled=control, exported=export, report=show_progress, **choices
            )
        assumptions, answer, found = reported.vehicle.assumptions, summarize(data).headline, data.diagnosis
        if found is not None and found.missing:
            answer = f"{answer.removesuffix('.')}: {found.missing}"
        notes = [*notes, *data.notes]
        document |= axis_document(stored.axis) | {"verdict": None if found is None else found.verdict}
    files = {"page": str(page)} | ({"pdf": str(pdf_output(folder).path)} if pdf else {})
    if shared.json:
        document |= {"answer": answer, **files, "parameters": str(stored.path)}
        document |= {"faults": fault_documents(reported.faults), **further}
        context.print_json(document | guess_document(assumptions) | {"warnings": all_warnings(assumptions, notes)})
        return
    show_caution(context.console(), assumptions)
    show_faults(context.console(), reported.faults)
    show_warnings(context.console(), notes)
    context.console().print(answer, highlight=False)
    for path in files.values():
        print_path(context.console(), path)


def _default_folder(axis: str, vehicle: str, *, force: bool) -> Path:
    """The folder for the page of ``vehicle`` along ``axis``; OutputError if it holds the report of another vehicle."""
    from rovid.present.page.page_files import require_same_vehicle

    folder = Path("report" if axis == "yaw" else f"report_{axis}")
    if not force:
        require_same_vehicle(folder, vehicle)
    return folder


def _journal_width(text: str) -> str:
    """The width of a plot in print as "84mm": one column, or the page, of most journals."""
    width = f"{text.removesuffix('mm').strip()}mm"
    if width not in _JOURNAL_WIDTHS:
        raise ConfigError(f"is {text!r}; {' or '.join(_JOURNAL_WIDTHS)} was expected.", where="--journal")
    return width


def open(  # noqa: A001 - the command's name
    logs: list[Path] | None = None, *, browser: bool = True, port: int = 0, shared: SharedOptions
) -> None:
    """Set up, fit and diagnose on a page in the browser."""
    from rovid.core.input_files import require_exists

    for path in logs or []:
        require_exists(path)
    missing = [name for name in ("starlette", "uvicorn") if find_spec(name) is None]
    if missing:
        text = f"`rovid open` needs the package{'s' * (len(missing) > 1)} {' and '.join(missing)}."
        raise ConfigError(text, mend="Install what it needs with `pip install 'rovid[app]'`.")

    from rovid.app.server import listen, serve, show_in_browser

    def announce(guard: TokenGuard, root: RootFolder, session: Path) -> None:
        if shared.json:
            context.print_json({"schema": "rovid-open/1", "address": guard.address, "folder": str(root.folder)})
        else:
            typer.echo(f"{guard.address}\nKeep this address secret: it gives access to the page. Ctrl-C ends the page.")
        sys.stdout.flush()
        if browser:
            show_in_browser(guard.ticket(), session)

    serve(logs or [], listen(port), announce, budget=shared.budget)


def mcp() -> None:
    """Serve an assistant by the Model Context Protocol."""
    if find_spec("mcp") is None or find_spec("mcp.server.mcpserver") is None:
        mend = "Install it with `pip install 'rovid[mcp]'`."
        raise ConfigError("needs the package mcp, version 2 or later.", where="rovid mcp", mend=mend)
    from rovid.api.mcp_server import server

    server().run("stdio")
