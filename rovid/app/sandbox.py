"""The temporary folder of a running page, and its access to files: limited to one folder, and uploads into it."""

import contextlib
import os
import re
import secrets
import shutil
import stat
import tempfile
import time
import unicodedata
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import BinaryIO, Self

from filelock import FileLock, Timeout

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


@dataclass(frozen=True)
class SessionFolder:
    """A folder that only this user can read, for the time of one page."""

    path: Path

    def note_unfinished(self, part: Path) -> None:
        """Note the file of an upload, which the next start deletes if this process is killed."""
        with (self.path / _UNFINISHED).open("ab") as stream:
            stream.write(os.fsencode(part) + b"\n")


@contextlib.contextmanager
def session_folder() -> Iterator[SessionFolder]:
    """A new folder, removed at the end; before that, those of killed pages are removed."""
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
        yield SessionFolder(path)
    finally:
        lock.release()
        shutil.rmtree(path, ignore_errors=True)


# Maximum size of an uploaded file in bytes.
LARGEST = 4 << 30
# Free disk space in bytes that an upload leaves.
_SPARE = 200 << 20
# Limits of an uploaded file's name: letters of a part, number of parts.
_LONGEST = 120
_DEEPEST = 8
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
        return [(self.name(item), sum(map(_is_log, _visible_items(item)))) for item in inside]

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


def _is_log(path: Path) -> bool:
    return path.suffix.lower() in FORMATS


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
    if not _is_log(path):
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
    def start(cls, folder: Path, name: Path, session: SessionFolder) -> Self:
        """Open the temporary file, which the ``session`` notes before it exists."""
        home = (folder / name).parent
        home.mkdir(parents=True, exist_ok=True)
        part = home / f"{PART_PREFIX}{secrets.token_hex(8)}"
        session.note_unfinished(part)
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
