"""HTTP server of the page, on the loopback address only."""

import contextlib
import json
import logging
import secrets
import signal
import socket
import sys
import threading
import webbrowser
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

from rovid.app import access
from rovid.app.api import Api, axes_options, config_folder, output_paths, shell_word
from rovid.app.jobs import JobQueue
from rovid.core.errors import ConfigError, OutputError, RovidError
from rovid.core.output_files import PAGE
from rovid.preflight.raw_columns import FULL_TURN
from rovid.trial.log_files import FORMATS

# Maximum size in bytes of a request without a log.
_LARGEST = 4 << 20
_STATIC = files("rovid.app") / "static"
_REPORT = files("rovid.present.page")
_MEDIA_TYPES = {".html": "text/html; charset=utf-8", ".css": "text/css", ".js": "text/javascript"}
# Static files of the report that this page shares: name -> source.
_SHARED = {
    "style.css": _REPORT / "templates" / "style.css",
    "uPlot.min.css": _REPORT / "assets" / "uplot" / "uPlot.min.css",
    "uPlot.min.js": _REPORT / "assets" / "uplot" / "uPlot.iife.min.js",
}
# A report is shown in a sandbox without an origin. It may run one script, which this version of rovid wrote: no policy
# keeps another script from sending data by WebRTC.
_REPORT_POLICY = (
    "sandbox allow-scripts; default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src {}; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)


class _Handlers:
    """The request handlers."""

    def __init__(self, root: access.RootFolder, logs: Sequence[Path], budget: float | None, session: Path) -> None:
        self.root = root
        self.session = session
        self.options = [] if budget is None else ["--budget", f"{budget:g}"]
        self.api = Api(root=root, scratch=session)
        self.jobs = JobQueue()
        self.logs = [root.name(log.resolve()) for log in logs]
        self.upload_folders: set[str] = set()
        self.reports: dict[str, Path] = {}

    def app(self) -> access.Asgi:
        """The application, with paths that do not contain the token."""
        routes = [
            Route("/", self.static),
            Route("/static/{name}", self.static),
            Route("/api/start", self.start),
            Route("/api/folders", self.folders),
            Route("/api/look", self.look),
            Route("/api/columns", self.columns),
            Route("/api/draft", _json_handler(self.api.draft), methods=["POST"]),
            Route("/api/check", _json_handler(self.api.check), methods=["POST"]),
            Route("/api/save", _json_handler(self.api.save), methods=["POST"]),
            Route("/api/upload", self.upload, methods=["POST"]),
            Route("/api/run", _json_handler(self.run), methods=["POST"]),
            Route("/api/progress", self.progress),
            Route("/api/cancel", self.cancel, methods=["POST"]),
            Route("/report/{key}", self.report),
        ]
        handlers = dict.fromkeys((RovidError, ClientDisconnect, Exception), _error)
        return Starlette(routes=routes, exception_handlers=handlers)

    def static(self, request: Request) -> Response:
        """The page and its files."""
        name = request.path_params.get("name", "page.html")
        own = {item.name for item in _STATIC.iterdir() if Path(item.name).suffix in _MEDIA_TYPES}
        file = _SHARED.get(name) or (_STATIC / name if name in own else None)
        if file is None:
            return Response(status_code=404)
        return Response(file.read_bytes(), media_type=_MEDIA_TYPES[Path(name).suffix])

    def start(self, _: Request) -> Response:
        """Facts that the page needs first."""
        folder = self.root.folder
        uploads = folder == Path.cwd().resolve()
        return JSONResponse({"folder": str(folder), "logs": self.logs, "uploads": uploads, "formats": list(FORMATS)})

    def folders(self, request: Request) -> Response:
        """Subfolders of a folder."""
        inside = self.root.folders(request.query_params.get("in", ""))
        return JSONResponse([{"path": name, "logs": logs} for name, logs in inside])

    def look(self, request: Request) -> Response:
        """The chosen logs, with the key of their report if there is one."""
        document = self.api.look(request.query_params.getlist("log"))
        pages = {name: output_paths(document["folder"], planar=name == "planar")[1] for name in ("yaw", "planar")}
        reports = {name: self.report_key(self.root.folder / page / "index.html") for name, page in pages.items()}
        return JSONResponse(document | {"report": reports["yaw"], "reports": reports})

    def columns(self, request: Request) -> Response:
        """Columns of a log for plots."""
        query = request.query_params
        try:
            begin, end = float(query.get("from", "-inf")), float(query.get("to", "inf"))
            bins = int(query.get("bins", "400"))
        except ValueError:
            raise ConfigError("from, to and bins have to be numbers.") from None
        turn = FULL_TURN.get(query.get("unit", ""))
        turns = {} if turn is None else {query.get("heading", ""): turn}
        log, needed, unit = query.get("log", ""), query.getlist("needed"), query.get("time_unit", "auto")
        return JSONResponse(self.api.columns(log, needed, begin, end, bins, turns, unit))

    async def upload(self, request: Request) -> Response:
        """Store one dropped file in a new folder, or in the folder of an earlier upload."""
        if self.root.folder != Path.cwd().resolve():
            text = "logs can only be dropped if the page shows the folder in which `rovid open` was started."
            raise ConfigError(text)
        name = access.clean_name(request.query_params.get("name", ""))
        folder = request.query_params.get("folder", "")
        if folder and folder not in self.upload_folders:
            raise ConfigError("is not a folder of dropped logs.", where=folder)
        if not folder:
            folder = self.root.name(await run_in_threadpool(self.root.new_folder))
            self.upload_folders.add(folder)
        upload = await run_in_threadpool(access.Upload.start, self.root.path(folder), name, self.session)
        try:
            upload.check_size(request.headers.get("content-length", ""))
            async for part in request.stream():
                await run_in_threadpool(upload.write, part)
            path = await run_in_threadpool(upload.finish)
        except OSError as error:
            raise OutputError(f"cannot be written ({error.strerror or error}).", where=name) from error
        finally:
            upload.close()
        return JSONResponse({"folder": folder, "name": self.root.name(path), "bytes": upload.size})

    def run(self, document: object) -> dict[str, Any]:
        """Start `rovid report` for the logs."""
        if not isinstance(document, dict) or not isinstance(document.get("logs"), list):
            raise ConfigError("the page sent no logs.")
        paths = self.api.paths(list(map(str, document["logs"])))
        if self.api.config_file(paths) is None:
            raise ConfigError("there is no rovid.toml yet.", mend="Save it first.")
        planar = document.get("axes") == "planar"
        parameters, page = output_paths(self.root.name(config_folder(paths)), planar=planar)
        options = ["--no-diagnosis"] if document.get("diagnosis") is False else [*self.options]
        options += axes_options(planar=planar)
        logs = [shell_word(self.root.name(path)) for path in paths]
        job = self.jobs.start(["report", *options, "-p", parameters, "-o", page, *logs], self.root.folder)
        return job.document()

    def progress(self, _: Request) -> Response:
        """State of the current job."""
        job = self.jobs.current
        if job is None:
            return JSONResponse({"state": "none"})
        document = job.document()
        if page := document["page"]:
            document["report"] = self.report_key(self.root.folder / page)
        return JSONResponse(document)

    def cancel(self, _: Request) -> Response:
        """Cancel the current job."""
        self.jobs.close()
        return JSONResponse({})

    def report_key(self, page: Path) -> str | None:
        """Key of a report, under which `report` serves it; None if the file is not a report."""
        if not page.is_file() or not self.root.contains(page) or not PAGE.matches(page):
            return None
        key = next((key for key, known in self.reports.items() if known == page), secrets.token_urlsafe(32))
        self.reports[key] = page
        return key

    def report(self, request: Request) -> Response:
        """A report."""
        page = self.reports.get(request.path_params["key"])
        if page is None or self.report_key(page) is None:
            return Response(status_code=404)
        from rovid.present.page.page_files import read_assets

        headers = {"content-security-policy": _REPORT_POLICY.format(read_assets().script_source)}
        return FileResponse(page, media_type="text/html; charset=utf-8", headers=headers)


def _json_handler(act: Callable[[object], Any]) -> Callable[[Request], Any]:
    async def answer(request: Request) -> Response:
        body = b""
        async for part in request.stream():
            body += part
            if len(body) > _LARGEST:
                raise ConfigError(f"the page sent more than {_LARGEST} bytes.")
        try:
            document = json.loads(body or b"{}")
        except (ValueError, RecursionError):
            raise ConfigError("the page sent no JSON.") from None
        return JSONResponse(await run_in_threadpool(act, document))

    return answer


def _error(_: Request, error: Exception) -> Response:
    if isinstance(error, ClientDisconnect):
        return Response(status_code=400)
    if isinstance(error, RovidError):
        return JSONResponse({"error": str(error)}, status_code=400)
    text = f"This is a defect of rovid ({type(error).__name__}). The terminal shows the details."
    return JSONResponse({"error": text}, status_code=500)


def listen(port: int) -> socket.socket:
    """Open a listening socket on the loopback address. Raises ConfigError if the port is taken."""
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    if sys.platform != "win32":
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((access.ADDRESS, port))
    except OSError as error:
        listener.close()
        text = f"port {port} of this machine cannot be used ({error.strerror or error})."
        raise ConfigError(text, mend="Leave --port out to use a free port.") from error
    listener.listen()
    return listener


def serve(
    logs: Sequence[Path],
    listener: socket.socket,
    ready: Callable[[access.TokenGuard, access.RootFolder, Path], None],
    *,
    budget: float | None = None,
) -> None:
    """Serve the page until the user stops the program, then cancel the running job.

    Ctrl-C, SIGTERM and SIGHUP (a closed terminal) end the program alike.

    ``ready``: Called with the address once the server accepts connections.
    ``budget``: Time in s that a diagnosis may take; None: the default of the logs.
    """
    root = access.RootFolder.for_logs(logs)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    # nohup ignores SIGHUP.
    if sys.platform != "win32" and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        signal.signal(signal.SIGHUP, lambda *_: signal.raise_signal(signal.SIGTERM))
    with access.session_folder() as session:
        handlers = _Handlers(root, logs, budget, session)
        guard = access.TokenGuard(app=handlers.app(), port=listener.getsockname()[1], report_keys=handlers.reports)
        for name in ("uvicorn.error", "asyncio"):
            access.limit_messages(logging.getLogger(name))
        config = uvicorn.Config(
            guard,
            http=access.LimitedProtocol,
            # Most connections that are accepted before the limits apply.
            backlog=128,
            access_log=False,
            log_config=None,
            server_header=False,
            lifespan="off",
            ws="none",
            proxy_headers=False,
            timeout_graceful_shutdown=2,
        )
        ready(guard, root, session)
        try:
            with contextlib.suppress(KeyboardInterrupt):
                uvicorn.Server(config).run(sockets=[listener])
        finally:
            for name in ("SIGINT", "SIGTERM", "SIGHUP"):
                if hasattr(signal, name):
                    signal.signal(getattr(signal, name), signal.SIG_IGN)
            handlers.jobs.close()
            listener.close()


def show_in_browser(address: str, folder: Path) -> None:
    """Open a browser at ``address`` through a file in ``folder``, which only this user can read.

    All users of a machine can read the command lines of its processes, so the address must not be on one.
    """
    page = folder / "rovid.html"
    refresh = f'<meta http-equiv="refresh" content="0;url={address}">'
    page.write_text(f"<!doctype html>\n<title>rovid</title>\n{refresh}\n", encoding="utf-8")
    # A text browser blocks until it is closed.
    threading.Thread(target=webbrowser.open, args=(page.as_uri(),), daemon=True).start()
