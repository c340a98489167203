"""The page and what it asks for over HTTP, on the loopback address alone."""

from __future__ import annotations

import json
import logging
import secrets
import socket
import sys
from collections.abc import Callable, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Route

from rovid.app.api import Api, output_paths, shell_word
from rovid.app.auth import ADDRESS, Asgi, TokenGuard
from rovid.app.jobs import JobQueue
from rovid.app.sandbox import RootFolder, Upload, clean_name
from rovid.core.errors import ConfigError, OutputError, RovidError
from rovid.core.signatures import PAGE
from rovid.trial.log_files import FORMATS

# Bytes of what the page sends but for logs.
_LARGEST = 4 << 20
_STATIC = files("rovid.app") / "static"
_REPORT = files("rovid.present.page")
_KINDS = {".html": "text/html; charset=utf-8", ".css": "text/css", ".js": "text/javascript"}
# name -> where it comes from: the report's own style and plots, for the two look alike.
_SHARED = {
    "style.css": _REPORT / "templates" / "style.css",
    "uPlot.min.css": _REPORT / "assets" / "uplot" / "uPlot.min.css",
    "uPlot.min.js": _REPORT / "assets" / "uplot" / "uPlot.iife.min.js",
}
# A report is a page of its own: it may run its own script, which its own policy knows by its hash, in no one's origin.
_REPORT_POLICY = (
    "sandbox allow-scripts; default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)


class _Handlers:
    """What answers the page's requests."""

    def __init__(self, top: RootFolder, logs: Sequence[Path]) -> None:
        self.top = top
        self.desk = Api(top=top)
        self.works = JobQueue()
        self.given = [top.name(log.resolve()) for log in logs]
        self.arrived: set[str] = set()
        self.reports: dict[str, Path] = {}

    def app(self) -> Asgi:
        """Routes, without the token."""
        routes = [
            Route("/", self.static),
            Route("/static/{name}", self.static),
            Route("/api/start", self.start),
            Route("/api/folders", self.folders),
            Route("/api/look", self.look),
            Route("/api/columns", self.columns),
            Route("/api/draft", self.told(self.desk.draft), methods=["POST"]),
            Route("/api/check", self.told(self.desk.check), methods=["POST"]),
            Route("/api/save", self.told(self.desk.save), methods=["POST"]),
            Route("/api/upload", self.upload, methods=["POST"]),
            Route("/api/run", self.told(self.run), methods=["POST"]),
            Route("/api/progress", self.progress),
            Route("/api/cancel", self.cancel, methods=["POST"]),
            Route("/report/{key}", self.report),
        ]
        return Starlette(routes=routes, exception_handlers={RovidError: _refused, Exception: _defect})

    def static(self, request: Request) -> Response:
        name = request.path_params.get("name", "page.html")
        file = _SHARED.get(name) or (_STATIC / name if name in _own() else None)
        if file is None:
            return Response(status_code=404)
        return Response(file.read_bytes(), media_type=_KINDS[Path(name).suffix])

    def start(self, _: Request) -> Response:
        own = self.top.folder == Path.cwd().resolve()
        return JSONResponse(
            {"folder": str(self.top.folder), "logs": self.given, "uploads": own, "formats": list(FORMATS)}
        )

    def folders(self, request: Request) -> Response:
        inside = self.top.folders(request.query_params.get("in", ""))
        return JSONResponse([{"path": name, "logs": logs} for name, logs in inside])

    def look(self, request: Request) -> Response:
        names = request.query_params.getlist("log")
        document = self.desk.look(names)
        _, page = output_paths(document["folder"])
        return JSONResponse(document | {"report": self.known(self.top.folder / page / "index.html")})

    def columns(self, request: Request) -> Response:
        asked = request.query_params
        try:
            begin, end = float(asked.get("from", "-inf")), float(asked.get("to", "inf"))
            bins = int(asked.get("bins", "400"))
        except ValueError:
            raise ConfigError("from, to and bins are to be numbers.") from None
        return JSONResponse(self.desk.columns(asked.get("log", ""), asked.getlist("needed"), begin, end, bins))

    def told(self, act: Callable[[object], Any]) -> Callable[[Request], Any]:
        """An answer to a JSON document."""

        async def answer(request: Request) -> Response:
            document = await _document(request)
            return JSONResponse(await run_in_threadpool(act, document))

        return answer

    async def upload(self, request: Request) -> Response:
        """One file, as it is, into a folder that was made for what is dropped."""
        if self.top.folder != Path.cwd().resolve():
            raise ConfigError("logs are taken in the folder where `rovid open` was started, and these are elsewhere.")
        name = clean_name(request.query_params.get("name", ""))
        folder = request.query_params.get("folder", "")
        if folder and folder not in self.arrived:
            raise ConfigError("was not made for logs that are dropped.", where=folder)
        if not folder:
            folder = self.top.name(await run_in_threadpool(self.top.new_folder))
            self.arrived.add(folder)
        arrival = await run_in_threadpool(Upload.start, self.top.path(folder), name)
        try:
            arrival.check_size(request.headers.get("content-length", ""))
            async for part in request.stream():
                await run_in_threadpool(arrival.write, part)
            kept = await run_in_threadpool(arrival.finish)
        except ClientDisconnect:
            return Response(status_code=400)  # nobody reads it
        except OSError as error:
            raise OutputError(f"cannot be written ({error.strerror or error}).", where=name) from error
        finally:
            arrival.close()
        return JSONResponse({"folder": folder, "name": self.top.name(kept), "bytes": arrival.size})

    def run(self, document: object) -> dict[str, Any]:
        """Fit, diagnose, and write the page."""
        if not isinstance(document, dict) or not isinstance(document.get("logs"), list):
            raise ConfigError("the page sent no logs.")
        paths = self.desk.paths([str(name) for name in document["logs"]])
        if self.desk.config_file(paths) is None:
            raise ConfigError("there is no rovid.toml yet.", mend="Save it first.")
        kept, page = output_paths(self.top.name(self.desk.config_folder(paths)))
        more = ["--no-diagnosis"] if document.get("diagnosis") is False else []
        arguments = ["report", *more, "-p", kept, "-o", page, *map(shell_word, map(self.top.name, paths))]
        return self.works.start(arguments, self.top.folder).document()

    def progress(self, _: Request) -> Response:
        work = self.works.current
        if work is None:
            return JSONResponse({"state": "none"})
        document = work.document()
        if document["page"]:
            document["report"] = self.known(self.top.folder / document["page"])
        return JSONResponse(document)

    def cancel(self, _: Request) -> Response:
        self.works.close()
        return JSONResponse({})

    def known(self, page: Path) -> str | None:
        """The key of a report, where that is one; None where it is not."""
        if not page.is_file() or not self.top.contains(page) or not PAGE.matches(page):
            return None
        key = next((key for key, known in self.reports.items() if known == page), secrets.token_hex(8))
        self.reports[key] = page
        return key

    def report(self, request: Request) -> Response:
        page = self.reports.get(request.path_params["key"])
        if page is None or self.known(page) is None:
            return Response(status_code=404)
        headers = {"content-security-policy": _REPORT_POLICY}
        return FileResponse(page, media_type="text/html; charset=utf-8", headers=headers)


def _own() -> set[str]:
    return {item.name for item in _STATIC.iterdir() if Path(item.name).suffix in _KINDS}


async def _document(request: Request) -> object:
    body = b""
    async for part in request.stream():
        body += part
        if len(body) > _LARGEST:
            raise ConfigError("the page sent too much.")
    try:
        return json.loads(body or b"{}")
    except (ValueError, RecursionError):
        raise ConfigError("the page sent no JSON.") from None


def _refused(_: Request, error: Exception) -> Response:
    return JSONResponse({"error": str(error)}, status_code=400)


def _defect(_: Request, error: Exception) -> Response:
    text = f"That is a defect of rovid ({type(error).__name__}); the terminal says more."
    return JSONResponse({"error": text}, status_code=500)


def listen(port: int) -> socket.socket:
    """A socket of this machine alone.

    Raises
    ------
    ConfigError
        The port is taken.
    """
    made = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    if sys.platform != "win32":
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        made.bind((ADDRESS, port))
    except OSError as error:
        made.close()
        text = f"port {port} of this machine cannot be used ({error.strerror or error})."
        raise ConfigError(text, mend="Leave --port out, and a free one is taken.") from error
    made.listen()
    return made


def serve(logs: Sequence[Path], sock: socket.socket, said: Callable[[TokenGuard, RootFolder], None]) -> None:
    """Answer until somebody ends it; then end what was begun.

    Parameters
    ----------
    said
        Called with the address once a browser may come.
    """
    page = _Handlers(RootFolder.for_logs(logs), logs)
    guard = TokenGuard(app=page.app(), port=sock.getsockname()[1])
    logging.getLogger("uvicorn.error").setLevel(logging.ERROR)
    config = uvicorn.Config(
        guard,
        access_log=False,
        log_config=None,
        server_header=False,
        lifespan="off",
        ws="none",
        proxy_headers=False,
        timeout_graceful_shutdown=2,
    )
    said(guard, page.top)
    try:
        uvicorn.Server(config).run(sockets=[sock])
    except KeyboardInterrupt:
        pass  # how one ends it
    finally:
        page.works.close()
        sock.close()
