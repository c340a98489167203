"""Limits of the page: the files that it reaches, uploads, and who may connect. Every program of this machine can."""

import asyncio
import contextlib
import hmac
import itertools
import logging
import os
import re
import secrets
import shutil
import stat
import tempfile
import time
import unicodedata
from collections.abc import Awaitable, Callable, Container, Iterator, MutableMapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any, BinaryIO, Self

from filelock import FileLock, Timeout
from uvicorn.protocols.http.h11_impl import H11Protocol

from rovid.core.errors import ConfigError, OutputError, is_visible
from rovid.core.input_files import list_files
from rovid.trial.log_files import FORMATS

_PREFIX = "rovid-open-"
_LOCK = "lock"
# One path a line: files of unfinished uploads, which are next to the logs.
_UNFINISHED = "unfinished"
PART_PREFIX = ".rovid-upload-"
# Age in s from which a folder without a lock is stale; a starting page makes the lock at once.
_STARTED = 60.0


@contextlib.contextmanager
def session_folder() -> Iterator[Path]:
    """A folder that only this user can read, removed at the end; before that, those of killed pages are removed."""
    for path in Path(tempfile.gettempdir()).glob(f"{_PREFIX}*"):
        with contextlib.suppress(OSError, Timeout):
            # Whether this is a folder of this user and no link; other users may write to the folder above.
            status = path.lstat()
            is_own_folder = stat.S_ISDIR(status.st_mode) and (not hasattr(os, "getuid") or status.st_uid == os.getuid())
            if not is_own_folder or not ((path / _LOCK).exists() or time.time() - path.lstat().st_mtime > _STARTED):
                continue
            with FileLock(path / _LOCK, timeout=0):
                notes = path / _UNFINISHED
                for line in notes.read_bytes().splitlines() if notes.is_file() else []:
                    part = Path(os.fsdecode(line))
                    if part.name.startswith(PART_PREFIX):
                        part.unlink(missing_ok=True)
                        # The folder goes, too, if it was made for this file.
                        with contextlib.suppress(OSError):
                            part.parent.rmdir()
            shutil.rmtree(path, ignore_errors=True)
    path = Path(tempfile.mkdtemp(prefix=_PREFIX))  # mode 0700
    lock = FileLock(path / _LOCK)
    lock.acquire()
    try:
        yield path
    finally:
        lock.release()
        shutil.rmtree(path, ignore_errors=True)


# Bytes: maximum size of an uploaded file, and free disk space that an upload leaves.
LARGEST, _SPARE = 4 << 30, 200 << 20
# Limits of an uploaded file's name: letters of a part, number of parts.
_LONGEST, _DEEPEST = 120, 8
# Characters that are special on some system, and names of devices on Windows.
_SPECIAL = re.compile(r'[\\/:*?"<>|]')
_DEVICES = re.compile(r"(?i)(con|prn|aux|nul|com\d|lpt\d)(\..*)?")


@dataclass(frozen=True, kw_only=True)
class RootFolder:
    """The folder that contains every file the page may read or write."""

    folder: Path

    @classmethod
    def for_logs(cls, logs: Sequence[Path]) -> Self:
        """The working folder if it contains all ``logs``, else their common parent."""
        here = Path.cwd().resolve()
        paths = [log.resolve() for log in logs]
        if all(path.is_relative_to(here) and all(map(_is_plain, path.relative_to(here).parts)) for path in paths):
            return cls(folder=here)
        folders = [path if path.is_dir() else path.parent for path in paths]
        return cls(folder=Path(os.path.commonpath(folders)))

    def path(self, name: str) -> Path:
        """Path of ``name``, with parts separated by /. Raises RovidError if it is hidden or outside of the folder."""
        parts = [part for part in name.split("/") if part not in {"", "."}]
        path = self.folder
        plain = not name.startswith(("/", "~")) and all(map(_is_plain, parts)) and len(parts) <= 100
        if plain:
            path = path.joinpath(*parts)
        # The joined path may still be on another drive, and a link may lead anywhere.
        if not plain or not path.is_relative_to(self.folder) or not self.contains(path):
            mend = "Start `rovid open` with the folder that holds the logs."
            raise ConfigError(f"is not below {self.folder}, or is hidden.", where=name, mend=mend)
        return path

    def contains(self, path: Path) -> bool:
        """Whether ``path`` is below the folder after all links are resolved."""
        try:
            return path.resolve().is_relative_to(self.folder)
        except (OSError, RuntimeError):  # a loop of links
            return False

    def name(self, path: Path) -> str:
        """Name of ``path`` relative to the folder."""
        return "" if path == self.folder else path.relative_to(self.folder).as_posix()

    def require(self, paths: Sequence[Path]) -> None:
        """Refuse logs that are links out of the folder. Raises RovidError if there is such a link."""
        for path in paths:
            for file in list_files(path, lambda _: None).files:
                if file.suffix.lower() in FORMATS and not self.contains(file):
                    text = f"is a link that leads out of {self.folder}, and `rovid open` reads nothing outside."
                    raise ConfigError(text, where=file, mend="Copy the log there, or use the command line.")

    def folders(self, name: str) -> list[tuple[str, int]]:
        """Names of the subfolders of a folder, each with its number of logs."""
        inside = sorted(item for item in _visible_items(self.path(name)) if item.is_dir() and self.contains(item))
        return [
            (self.name(item), sum(one.suffix.lower() in FORMATS for one in _visible_items(item))) for item in inside
        ]

    def new_folder(self) -> Path:
        """Make a folder for uploaded logs."""
        name = f"logs_{datetime.now().astimezone():%Y-%m-%d_%H%M}"
        for number in range(1, 1000):
            folder = self.folder / (name if number == 1 else f"{name}_{number}")
            with contextlib.suppress(FileExistsError):
                folder.mkdir()
                return folder
        raise OutputError("no further folder can be made.", where=self.folder)


def _is_plain(part: str) -> bool:
    return not part.startswith(".") and "\\" not in part and "\0" not in part


def _visible_items(folder: Path) -> list[Path]:
    try:
        return [item for item in folder.iterdir() if not item.name.startswith(".")]
    except OSError:
        return []


def clean_name(name: str) -> Path:
    """Path for an uploaded file, in allowed characters. Raises RovidError if its suffix is not that of a log."""
    parts = []
    for part in re.split(r"[\\/]", name):
        if part not in {"", ".", ".."}:
            visible = "".join(filter(is_visible, unicodedata.normalize("NFC", part)))
            plain = _SPECIAL.sub("_", visible).strip(". ")
            stem, dot, suffix = plain.rpartition(".")
            short = f"{stem[: _LONGEST - len(suffix)]}{dot}{suffix}"[-_LONGEST:]
            parts.append(f"_{short}" if not short or _DEVICES.fullmatch(short) else short)
    path = Path(*parts[-_DEEPEST:]) if parts else Path("log")
    if path.suffix.lower() not in FORMATS:
        text = f"is no log that rovid reads; {', '.join(FORMATS)} were expected."
        raise ConfigError(text, where=name, mend="Drop only logs. This page writes rovid.toml itself.")
    return path


@dataclass(kw_only=True)
class Upload:
    """A file being uploaded: written to a temporary file and then moved to a free name."""

    name: Path
    home: Path
    part: Path
    stream: BinaryIO
    size: int = 0

    @classmethod
    def start(cls, folder: Path, name: Path, session: Path) -> Self:
        """Open the temporary file. The folder ``session`` notes it before: the next start deletes it after a kill."""
        home = (folder / name).parent
        home.mkdir(parents=True, exist_ok=True)
        part = home / f"{PART_PREFIX}{secrets.token_hex(8)}"
        with (session / _UNFINISHED).open("ab") as stream:
            stream.write(os.fsencode(part) + b"\n")
        return cls(name=name, home=home, part=part, stream=part.open("xb"))

    def check_size(self, size: str) -> None:
        """Refuse a file whose announced size is too large."""
        if size.isdigit():
            self._require_room(int(size))

    def write(self, data: bytes) -> None:
        """Append the next part."""
        self.size += len(data)
        self._require_room(self.size)
        self.stream.write(data)

    def _require_room(self, size: int) -> None:
        if size - self.size > shutil.disk_usage(self.home).free - _SPARE:
            raise OutputError("does not fit on the disk.", where=self.name, mend="Free some space there.")
        if size > LARGEST:
            text = f"is larger than {LARGEST >> 30} GB, the largest file that the page takes."
            mend = "Copy it into a folder, and start `rovid open` with that folder."
            raise OutputError(text, where=self.name, mend=mend)

    def finish(self) -> Path:
        """Move the file to its name, or to a free name like it."""
        self.stream.close()
        for number in range(1, 10_000):
            path = self.home / (self.name.name if number == 1 else f"{self.name.stem}_{number}{self.name.suffix}")
            try:
                os.link(self.part, path)
            except FileExistsError:
                continue
            except OSError:  # a file system without links
                if path.exists():
                    continue
                self.part.rename(path)
            return path
        raise OutputError("no further name is free.", where=self.name)

    def close(self) -> None:
        """Remove the temporary file, and the folder if it is empty."""
        self.stream.close()
        self.part.unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            self.home.rmdir()


# Largest number of connections. A browser opens six.
MOST_CONNECTIONS = 64
# s: time that a connection may take until it shows the token, and between two parts of an unfinished request.
UNKNOWN_TIMEOUT, STALLED_TIMEOUT = 10.0, 60.0
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
            await _answer(send, 403, b"Forbidden\n")
        elif slash and self._is_same_site(scope) and (inside := self._path_inside(first, rest)):
            scope.get("state", {}).get(KNOWN, []).append(True)
            inner = {**scope, "path": inside, "raw_path": inside.encode(), "root_path": ""}
            await self.app(inner, receive, _with_headers(send))
        elif not slash and scope["method"] == "GET" and self._redeem(first):
            # After this redirect the browser's requests have our own origin.
            page = f'<!doctype html><meta http-equiv="refresh" content="0;url=/{self.token}/"><title>rovid</title>'
            await _answer(send, 200, page.encode(), b"text/html; charset=utf-8")
        else:
            await _answer(send, 403, b"Forbidden\n")

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
